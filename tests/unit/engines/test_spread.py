"""How jobs are spread, what a dying worker costs, and who may work on a store."""

import errno
import os
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from browser import PATIENCE
from checkout import ROOT
from faults import FATAL, FATAL_ONCE, double, greedy

from tgospa_eval import ConfigError, engines
from tgospa_eval.campaign.store import locked
from tgospa_eval.common import files
from tgospa_eval.engines import Processes


class Done:
    """A future that has ended."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def add_done_callback(self, function: Callable[[Any], object]) -> None:
        function(self)


class Plain:
    """An engine without processes; a job that is fatal takes what is with it."""

    def __init__(self, workers: int = 2) -> None:
        self.number, self.chunks, self.opened = workers, list[list[int]](), list[int]()
        self.broken = False

    @contextmanager
    def open(self, most: int) -> Iterator["Plain"]:
        self.opened.append(most)
        self.broken = False
        yield self

    def workers(self) -> int:
        return self.number

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Done:
        if self.broken:
            raise engines.DiedError
        chunk = arguments[1]
        self.chunks.append(list(chunk))
        self.broken = FATAL in chunk
        return Done(None if self.broken else function(*arguments))

    def answer(self, future: Done) -> Any:
        if future.answer is None:
            raise engines.DiedError
        return future.answer

    def poll(self) -> None:
        raise AssertionError("nothing is waited for")


def test_chunks_become_smaller() -> None:
    plain = Plain()
    jobs = [2 * job for job in range(300)]  # without the fatal one
    assert sorted(engines.spread(abs, jobs, abs, plain)) == jobs
    sizes = [len(chunk) for chunk in plain.chunks]
    assert sizes[0] == 32
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-4:] == [1] * 4
    assert plain.chunks[0] == jobs[:32]  # the order of jobs is kept


def test_what_takes_long_comes_back_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "CHUNK_SECONDS", -1.0)
    assert engines.some(abs, [-3, -4]) == [3]
    plain = Plain()
    assert sorted(engines.spread(abs, range(-200, 0), abs, plain)) == list(range(1, 201))


def test_one_job_is_to_blame() -> None:
    plain = Plain()
    answers = list(engines.spread(lambda job: 2 * job, range(40), lambda job: -job, plain))
    assert sorted(answers) == sorted([2 * job for job in range(40) if job != FATAL] + [-FATAL])
    tries = [chunk for chunk in plain.chunks if FATAL in chunk]
    assert len(tries) == len(engines.ATTEMPTS)
    assert tries[1:] == [[FATAL], [FATAL]]
    assert plain.opened[-1] == 1


@pytest.fixture
def helped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers find what they are to do."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "support"))


@pytest.mark.process
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_dying_process_costs_its_jobs_a_retry(helped: None) -> None:
    jobs = [0, FATAL_ONCE, 1, 2, 3, FATAL, 4, 5]
    answers = list(engines.spread(double, jobs, lambda job: -job, Processes(2)))
    assert sorted(answers) == sorted([2 * job for job in jobs if job != FATAL] + [-FATAL])


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="a limit of Linux")
def test_a_process_keeps_to_its_share_of_the_memory(
    helped: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "available_memory", lambda: 4 << 30)
    answers = engines.spread(greedy, [1, 3], lambda _: "died", Processes(2))
    assert sorted(answers) == ["had 1 GiB", "had no memory"]


def check_locks(folder: Path) -> None:
    with locked(folder, (1, 2)):
        with locked(folder, (2, 2)):
            pass
        for shard in ((1, 2), (1, 1)):
            with (
                pytest.raises(ConfigError, match="another process uses it"),
                locked(folder, shard),
            ):
                pass
    with (
        locked(folder, (1, 1)),
        pytest.raises(ConfigError, match="another process uses it"),
        locked(folder, (2, 2)),
    ):
        pass


def test_two_processes_never_work_on_the_same_jobs(tmp_path: Path) -> None:
    check_locks(tmp_path)


class Ranges(types.ModuleType):
    """Locks of Windows: ranges of bytes from where a file is, given back when it is closed."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.held: list[tuple[int, range]] = []

    def locking(self, number: int, mode: int, size: int) -> None:
        assert mode == self.LK_NBLCK
        begin = os.lseek(number, 0, os.SEEK_CUR)
        self.held = [held for held in self.held if is_open(held[0]) and held[0] != number]
        wanted = range(begin, begin + size)
        if any(wanted.start < held.stop and held.start < wanted.stop for _, held in self.held):
            raise PermissionError(errno.EACCES, "Permission denied")
        self.held.append((number, wanted))


def is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def test_locks_of_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a stand-in for what Windows has."""
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", Ranges())
    check_locks(tmp_path)


def test_a_file_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    told: list[str] = []
    monkeypatch.setattr(fcntl, "flock", refuse)
    monkeypatch.setattr(files, "announce", told.append)
    with locked(tmp_path, (1, 1)):
        pass
    said = (
        f'output="{tmp_path}": the file system has no locks; '
        "let no other process use this folder meanwhile"
    )
    assert told == [said]


def test_a_worker_whose_parent_is_gone_when_it_begins() -> None:
    code = "import time\nfrom tgospa_eval.engines import _begin\n_begin(None, 0)\n"
    end = subprocess.run(
        [sys.executable, "-c", f"{code}time.sleep({PATIENCE})"], timeout=PATIENCE, check=False
    )
    assert end.returncode == 1
