"""Ignored truths and excused estimates, against the linear programme of the definition."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exact_lp import Costs, costs_of, solve

from tgospa_eval import evaluate
from tgospa_eval.api.arrays import trajectories_of


def ignoring(costs: Costs, truth: np.ndarray, ignored: np.ndarray, excused: np.ndarray) -> Costs:
    """The same programme with ``A = w c^p / 2, B = (1 - e) c^p / 2, D = min(w d^p, A + B)``.

    `ignored` (T, m) and `excused` (T, n) are of states that exist.
    """
    steps, m, n = (size - shift for size, shift in zip(costs.low.shape, (0, 1, 1), strict=True))
    tables = []
    for table, whole in ((costs.low, costs.cutoff[0]), (costs.high, costs.cutoff[1])):
        half = whole // 2
        found = table.copy()
        missed = np.where(ignored, 0, table[:, :m, n])
        false = np.where(excused, 0, table[:, m, :n])
        both = (table[:, :m, n] == half)[:, :, None] & (table[:, m, :n] == half)[:, None, :]
        neutral = missed[:, :, None] + false[:, None, :]
        near = both & (table[:, :m, :n] < whole)
        judged = np.where(ignored[:, :, None], 0, table[:, :m, :n])
        found[:, :m, :n] = np.where(near, np.minimum(judged, neutral), neutral)
        found[:, :m, n], found[:, m, :n] = missed, false
        tables.append(found)
    assert steps == len(truth)
    return replace(costs, low=tables[0], high=tables[1])
