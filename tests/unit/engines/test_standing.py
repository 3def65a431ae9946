"""Workers that stay, and what is done before there are any."""

import os
from functools import partial
from pathlib import Path

import pytest

from tgospa_eval import ConfigError, SolverError
from tgospa_eval.common.writing import writing
from tgospa_eval.engines import PersistentPool, Processes
from tgospa_eval.partitioned.tasks import Task, run_tasks


def note(output: str) -> None:
    """Write whose task it was."""
    Path(output).write_text(str(os.getpid()))


def refuse(output: str, job: int) -> None:
    raise ValueError(job)


def whose(folder: Path, jobs: range, engine: PersistentPool) -> dict[int, int]:
    tasks: dict[str, Task] = {str(folder / str(job)): note for job in jobs}
    run_tasks(tasks, engine)
    return {int(Path(output).name): int(Path(output).read_text()) for output in tasks}


def test_little_work_is_done_here(tmp_path: Path) -> None:
    with PersistentPool(Processes(2), 2, patience=60.0) as engine:
        found = whose(tmp_path, range(40), engine)
    assert found == dict.fromkeys(range(40), os.getpid())


def test_what_is_left_when_patience_ends_is_done_by_workers(tmp_path: Path) -> None:
    with PersistentPool(Processes(2), 2, patience=1e-9) as engine:
        first = whose(tmp_path, range(40), engine)
        second = whose(tmp_path, range(40, 50), engine)
    here = [job for job, process in first.items() if process == os.getpid()]
    assert here == [0]
    workers = set(first.values()) - {os.getpid()}
    assert len(workers) >= 1
    # The same two as before, of which one may have begun after all first jobs were done.
    assert len(workers | set(second.values())) <= 2
    assert os.getpid() not in second.values()


def test_errors_of_work_done_here_are_raised(tmp_path: Path) -> None:
    with (
        PersistentPool(Processes(2), 2, patience=60.0) as engine,
        pytest.raises(ValueError, match="3"),
    ):
        run_tasks({str(tmp_path / "3"): partial(refuse, job=3)}, engine)


def kill(output: str) -> None:
    os._exit(1)


def test_a_task_of_which_processes_die_is_named(tmp_path: Path) -> None:
    with (
        PersistentPool(Processes(1), 1) as pool,
        pytest.raises(SolverError, match="a process died during 000007, most likely from lack of"),
    ):
        run_tasks({str(tmp_path / "000007"): kill}, pool)


def fill(beside: Path) -> None:
    beside.write_text("half")
    raise OSError("10931 requested and 5520 written")  # as NumPy says it


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(ConfigError, match="cannot be written: no space left on the disk"),
        writing(str(tmp_path / "out" / "block")) as beside,
    ):
        fill(beside)
    assert not list((tmp_path / "out").iterdir())
