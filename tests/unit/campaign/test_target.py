"""Tests files of the target branch."""

import subprocess
from pathlib import Path

import pytest

from tgospa_eval.campaign.target import Target
from tgospa_eval.errors import ConfigError


def git(*arguments: str) -> None:
    names = ("-c", "user.name=a", "-c", "user.email=a@example.com", "-c", "init.defaultBranch=main")
    subprocess.run(("git", *names, *arguments), check=True, capture_output=True)


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One with a file, which the working tree has changed since; in a folder of it."""
    monkeypatch.chdir(tmp_path)
    Path("ci").mkdir()
    Path("ci/suite.toml").write_bytes(b"old\r\n\xff")
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    Path("ci/suite.toml").write_text("new")
    Path("ci/more.toml").write_text("new")
    return tmp_path


@pytest.mark.parametrize(("inside", "path"), [(".", "ci/suite.toml"), ("ci", "suite.toml")])
def test_of_a_revision(
    repository: Path, monkeypatch: pytest.MonkeyPatch, inside: str, path: str
) -> None:
    monkeypatch.chdir(repository / inside)
    target = Target("main")
    assert target.read(path) == target.read(str(Path(path).resolve())) == b"old\r\n\xff"
    assert target.read(f"{path}.no") is None
    assert target.name(path) == f"main:{path}"


def test_of_a_folder(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other")
    (other / "ci").mkdir()
    (other / "ci/suite.toml").write_text("theirs")
    target = Target(str(other))
    assert target.read("ci/suite.toml") == b"theirs"
    assert target.read(str(repository / "ci/suite.toml")) == b"theirs"
    assert target.read("ci/more.toml") is None


@pytest.mark.parametrize("where", ["nowhere", "--output=x", "HEAD:ci", ""])
def test_refused(repository: Path, where: str) -> None:
    with pytest.raises(ConfigError, match="neither a folder nor a git revision"):
        Target(where)
    assert not (repository / "x").exists()


def test_a_name_of_both(repository: Path) -> None:
    (repository / "main").mkdir()
    with pytest.raises(ConfigError, match=r"write \./main for the folder, refs/heads/main"):
        Target("main")
    assert Target("refs/heads/main").commit
    assert not Target("./main").commit


def test_no_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="neither"):
        Target("main")
