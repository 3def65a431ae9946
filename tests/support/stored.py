"""Rows and settings as the store of a batch has them."""

import functools
from typing import Any

import numpy as np

import tgospa_eval
from tgospa_eval.campaign.row import row_of
from tgospa_eval.campaign.store import SCHEMA


def settings_of(cutoff: float) -> dict[str, Any]:
    """What batch.json says."""
    jobs = {"paths": ["m.csv"], "truth": None, "estimate": None, "layout": None, "seqmap": None}
    return {"schema": SCHEMA, "version": "1", "options": {"cutoff": cutoff}, "jobs": jobs}


@functools.cache
def numbers() -> dict[str, Any]:
    """Columns of a job that has a value."""
    truth = np.arange(6.0).reshape(3, 2, 1)
    return row_of(tgospa_eval.evaluate(truth, truth + 0.5, 3.0, 2.0, 1.0))


def stored_row(key: str, status: str, finished: int, **more: object) -> dict[str, Any]:
    """A row, with other values where they are given."""
    about = {"key": key, "status": status, "message": "", "finished": finished, "seconds": 0.5}
    names = {"label.run": key, "truth": "t", "estimate": "e", "options": "{}", "version": "1"}
    values = {} if status == "failed" else numbers() | {"warnings": "[]"}
    return {**about, **names, **values, **more}
