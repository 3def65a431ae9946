"""Files that the system refuses, that never end or never begin: a sentence, the right status."""

import os
import resource
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import click
import pytest
from answer import Run, Write
from browser import PATIENCE

from tgospa_eval import ConfigError, InputError
from tgospa_eval.cli.verbs import VERBS, Verbs
from tgospa_eval.common import files
from tgospa_eval.formats import read

TABLE = "id,t,x,y\n1,0,0,0\n1,1,0,0\n"
LONG = "n" * 300
STUDY = ["compare", "--simulate", "--targets", "2", "--steps", "3", "--runs", "1", "-q"]


def refused(answer: Any, status: int, *parts: str) -> None:
    assert (answer.status, answer.out) == (status, "")
    (line,) = answer.err.splitlines()
    for part in parts:
        assert part in line


@pytest.mark.parametrize("bad", [LONG, "loop", "t.csv/x"], ids=["long", "loop", "below a file"])
@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["{}", "t.csv"], 3),
        (["inspect", "{}"], 3),
        (["t.csv", "t.csv", "--distance", "mahalanobis", "--covariance", "{}"], 3),
        (["t.csv", "t.csv", "--config", "{}"], 2),
        (["t.csv", "t.csv", "-o", "{}"], 2),
        (["simulate", "{}"], 2),
        ([*STUDY, "-o", "{}"], 2),
        (["reduce", "t.csv", "{}/o.csv", "-n", "2"], 2),
        (["associate", "t.csv", "t.csv", "--cutoff", "1", "--cost-matrix", "{}/c"], 2),
        (["gate", "t.csv", "t.csv", "--baseline", "{}"], 2),
        (["gate", "t.csv", "t.csv", "--baseline", "{}/b", "--update-baseline"], 2),
        (["gate", "--suite", "{}"], 2),
    ],
)
def test_paths_that_lead_nowhere(
    invoke: Run,
    write: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    bad: str,
    arguments: list[str],
    status: int,
) -> None:
    write("t.csv", TABLE)
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.setenv("TGOSPA_EVAL_QUIET", "1")
    refused(invoke(*(text.format(bad) for text in arguments)), status, bad)


@pytest.mark.parametrize("bad", [LONG, "a\\u0000b"], ids=["long", "NUL"])
def test_paths_of_a_suite(invoke: Run, write: Write, bad: str) -> None:
    write("t.csv", TABLE)
    pair = '[[pair]]\nname = "p"\ntruth = "{}"\nestimate = "t.csv"\n'
    write("suite.toml", f'baseline = "{bad}"\n' + pair.format("t.csv"))
    refused(invoke("gate", "--suite", "suite.toml"), 2, "cannot be read")
    write("suite.toml", pair.format(bad))
    answer = invoke("gate", "--suite", "suite.toml", "--baseline", "b", "--update-baseline")
    refused(answer, 3, "p: ", "cannot be read")


def test_the_working_folder_is_gone(
    invoke: Run, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = write("t.csv", TABLE), write("e.csv", TABLE.replace("0\n", "1\n"))
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    monkeypatch.setenv("TGOSPA_EVAL_QUIET", "1")
    for arguments in (
        [path, path, "-o", "out"],
        ["simulate", "out"],
        [*STUDY, "-o", "out"],
        ["gate", path, other, "--baseline", "b.json", "--update-baseline"],
        ["gate", path, other, "--baseline", "b.json", "--junit", "j.xml"],
    ):
        refused(invoke(*arguments), 2, "the working folder was removed")
    refused(invoke("t.csv", path), 3, "t.csv: no such file")
    assert invoke(path, path, "-q").status == 0
    assert invoke("compare", path, path, "--solvers", "certified").status == 0


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["t.csv", "t.csv", "--config", "/dev/zero"], 2),
        (["gate", "t.csv", "t.csv", "--baseline", "/dev/zero"], 2),
        (["gate", "--suite", "/dev/zero"], 2),
        (["t.csv", "t.csv", "--distance", "mahalanobis", "--covariance", "/dev/zero"], 3),
    ],
)
def test_files_without_end(invoke: Run, write: Write, arguments: list[str], status: int) -> None:
    write("t.csv", TABLE)
    refused(invoke(*arguments, "-q"), status, "/dev/zero: ")


def test_a_device_may_say_that_there_are_no_settings(invoke: Run, write: Write) -> None:
    path = write("t.csv", TABLE)
    assert invoke(path, path, "--config", os.devnull, "-q").status == 0


def test_a_pipe_is_waited_for_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipe = str(tmp_path / "pipe.csv")
    os.mkfifo(pipe)
    said: list[str] = []

    def writer() -> None:
        Path(pipe).write_text(TABLE, encoding="ascii")

    def announce(text: str) -> None:  # nobody writes before
        said.append(text)
        threading.Thread(target=writer).start()

    monkeypatch.setattr(files, "PIPE_PATIENCE", 0.01)
    monkeypatch.setattr(files, "announce", announce)
    assert read(pipe).rows == 2
    assert said == [f"waiting for data from {pipe}"]


def test_what_is_too_large_for_settings(write: Write, tmp_path: Path) -> None:
    path = write("large", b"x" * 100)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    threading.Thread(target=lambda: pipe.write_bytes(b"x" * 100)).start()
    for name in (path, str(pipe)):
        with pytest.raises(ConfigError, match="larger than 0 MiB"):
            files.read_bytes(name, ConfigError, 99)
    assert files.read_bytes(path, InputError, 100) == b"x" * 100


def _full() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))


def test_a_study_on_a_full_disk(tmp_path: Path, unmeasured: dict[str, str]) -> None:
    command = [sys.executable, "-m", "tgospa_eval", *STUDY, "-o", "study"]
    done = subprocess.run(
        command, cwd=tmp_path, env=unmeasured, preexec_fn=_full, capture_output=True,
        text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("-o study/runs: cannot be written: ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("verb", list(VERBS))
def test_files_that_cannot_be_read_are_refused_where_they_are_read(verb: str) -> None:
    """By click they would be refused as options, whatever they are."""
    command = Verbs(name="all").get_command(click.Context(Verbs(name="all")), verb)
    assert command is not None
    paths = [item.type for item in command.params if isinstance(item.type, click.Path)]
    assert paths
    assert not any(item.readable for item in paths)
