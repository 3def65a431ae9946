"""Slices of jobs: stored with each row as text, added up by groups."""

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tgospa_eval.reports.batch_records import GroupSlices
from tgospa_eval.results.slices import Slicing, added_up
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd

STORED_SLICES = "slices"
"""Column of the rows of jobs."""


def stored_slices(result: Summary) -> dict[str, str]:
    """What the row of a job has of its slices."""
    if not result.sliced:
        return {}
    return {STORED_SLICES: json.dumps([one.record() for one in result.sliced])}


def sliced_groups(having: "pd.DataFrame", numbers: "pd.Series[int]") -> Iterator[GroupSlices]:
    """The sums of each group that has slices.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    numbers : Series of int
        The group of each row, by the index of the rows.
    """
    if STORED_SLICES not in having:
        return
    stored = having[STORED_SLICES].dropna()
    for number, texts in stored.groupby(numbers[stored.index]):
        records = map(json.loads, texts)
        jobs = [tuple(map(Slicing.of, record)) for record in records]
        yield GroupSlices(group=int(number), slicings=tuple(added_up(jobs)))
