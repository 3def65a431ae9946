"""Near pairs against all pairs, and the ways in which the search is made to go."""

import numpy as np
import pytest

from tgospa_eval import Trajectories
from tgospa_eval.distances import Distance, near_pairs, pair_search
from tgospa_eval.distances import pair_search as points
from tgospa_eval.distances import pair_search as search

WAYS = {
    "as it is": {},
    "in stretches": {"ROWS_TOGETHER": 11},
    "search": {},
    "small pieces": {"ROWS_TOGETHER": 11, "CANDIDATES_TOGETHER": 30},
    "all axes": {"FEW_CANDIDATES": 0, "ROWS_TOGETHER": 50, "CANDIDATES_TOGETHER": 64},
    "trees": {"FEW_CANDIDATES": 0, "MANY_CANDIDATES": 1e-9, "CANDIDATES_TOGETHER": 30},
    "divided": {
        "FEW_CANDIDATES": 0,
        "MANY_CANDIDATES": 1,
        "CANDIDATES_TOGETHER": 5,
        "EQUAL_REACHES": 1.001,
    },
}


def go(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the search go one of the ways; in the first two few pairs are compared without one."""
    if way not in ("as it is", "in stretches"):
        monkeypatch.setattr(points, "MAX_PAIRS", -1)
    for name, value in WAYS[way].items():
        monkeypatch.setattr(pair_search if name == "ROWS_TOGETHER" else search, name, value)


def table(step: np.ndarray, state: np.ndarray, steps: int) -> Trajectories:
    """Rows with the steps given, sorted, each with a track of its own."""
    return Trajectories(
        step=np.sort(step),
        track=np.arange(len(step)),
        state=state,
        ids=np.array([str(k) for k in range(len(step))], dtype=object),
        times=np.arange(steps),
        columns=tuple(f"x{k}" for k in range(state.shape[1])),
    )


def assert_as_by_brute_force(
    truth: Trajectories, estimate: Trajectories, cutoffs: float | list[float], norm: Distance
) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        distance = norm(truth.state[:, None], estimate.state[None])
    for cutoff in np.atleast_1d(cutoffs).tolist():
        i, j = np.nonzero((distance < cutoff) & (truth.step[:, None] == estimate.step[None]))
        pairs = near_pairs(truth, estimate, cutoff, norm)
        assert np.array_equal(pairs.truth_row, i)
        assert np.array_equal(pairs.estimate_row, j)
        assert np.array_equal(pairs.distance, distance[i, j])
        assert pairs.truth_row.dtype == pairs.estimate_row.dtype == np.int32
