"""Workers that stay, and what is done before there are any."""

import os

import pytest

from tgospa_eval.engines.engine import spread
from tgospa_eval.engines.processes import PersistentPool, Processes


def whose(job: int) -> tuple[int, int]:
    return job, os.getpid()


def refuse(job: int) -> int:
    raise ValueError(job)


def lost(job: int) -> tuple[int, int]:
    return job, 0


def test_little_work_is_done_here() -> None:
    with PersistentPool(Processes(2), 2, patience=60.0) as engine:
        found = dict(spread(whose, range(40), lost, engine))
    assert found == dict.fromkeys(range(40), os.getpid())


def test_what_is_left_when_patience_ends_is_done_by_workers() -> None:
    with PersistentPool(Processes(2), 2, patience=1e-9) as engine:
        first = dict(spread(whose, range(40), lost, engine))
        second = dict(spread(whose, range(40, 50), lost, engine))
    assert sorted(first) == list(range(40))
    here = [job for job, process in first.items() if process == os.getpid()]
    assert 0 in here
    assert len(here) < 40
    workers = set(first.values()) - {os.getpid()}
    assert 1 <= len(workers) <= 2
    assert set(second.values()) <= workers  # the same as before


def test_errors_of_work_done_here_are_raised() -> None:
    with (
        PersistentPool(Processes(2), 2, patience=60.0) as engine,
        pytest.raises(ValueError, match="3"),
    ):
        list(spread(refuse, [3], lost, engine))
