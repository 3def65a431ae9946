"""A gate of many pairs evaluates each content once for all tests of a process.

The row of a pair follows from the task and the bytes of its files alone; a suite that is judged
anew in every test has the same few. A task that writes, and one in another process, is worked on.
"""

import os
from collections.abc import Callable
from typing import Any

import pytest

from tgospa_eval.api import batch_row
from tgospa_eval.api.batch_row import JobTask, Row, digest_of, evaluate_job, files_of

ROWS: dict[Any, tuple[Row, list[str]]] = {}


def row_of(task: JobTask, run: Any = None, say: Callable[[str], None] | None = None) -> Row:
    """Work on a task whose like has not been seen, and tell what was told of it."""
    if say is None or task.folder is not None or task.page:
        return evaluate_job(task, run, say)
    files = files_of(task.job, task.options)
    contents = tuple(digest_of(path) if os.path.exists(path) else None for path in files)
    key = (repr(task), contents)
    if key not in ROWS:
        told: list[str] = []
        ROWS[key] = (evaluate_job(task, run, told.append), told)
    row, told = ROWS[key]
    for text in told:
        say(text)
    return dict(row)


@pytest.fixture
def evaluated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_row, "evaluate_job", row_of)
