"""Tests files of the target branch."""

import subprocess
from pathlib import Path

import pytest

from tgospa_eval.campaign.gate.suite import Target


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


def test_what_differs_from_a_revision(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("same.csv", "other.csv", "gone.csv", "scene/a.csv", "é {run}.mat"):
        path = Path("data", name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"of {name}\n")
    git("add", ".")
    git("commit", "-m", "second")
    Path("data/same.csv").chmod(0o755)
    for name in ("other.csv", "scene/a.csv", "é {run}.mat", "new.csv"):
        Path("data", name).write_text("changed")
    Path("data/gone.csv").unlink()
    copy = repository.parent / f"{repository.name}-copy"
    git("clone", ".", str(copy))
    expected = {
        "same.csv": (True, False),
        "other.csv": (True, True),
        "gone.csv": (True, True),
        "scene": (True, True),
        "é {run}.mat:Y{1}": (True, True),
        "new.csv": (False, False),
    }
    for where, inside, data in (("main", ".", ""), ("main", "ci", "../"), (str(copy), ".", "")):
        monkeypatch.chdir(repository / inside)
        target = Target(where)
        paths = {name: f"{data}data/{name}" for name in expected}
        assert target.missing == [paths["gone.csv"]]
        assert {
            name: (target.has(path), target.has_another(path)) for name, path in paths.items()
        } == expected
