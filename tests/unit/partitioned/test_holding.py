"""What pairs hold without gain, from windows that know a part of it."""

import numpy as np
import pytest

from tgospa_eval.partitioned.long.holding import hold_runs
from tgospa_eval.partitioned.long.tables import BUSY
from tgospa_eval.partitioned.shards import ENTRY, HELD, problem_of
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.weights import ONE

HALF = ONE // 2
STEPS = 8


def held(
    gains: list[tuple[int, int, int]],
    holds: list[tuple[int, int, int]],
    busy: list[tuple[int, int]],
) -> dict[tuple[int, int], int]:
    """Weights of the runs of truth 0, by estimate and first step.

    Gains are (step, estimate, weight), holds of windows (estimate, begin, end) at one half, and
    busy (estimate, step).
    """
    entries = np.zeros(len(gains), ENTRY)
    entries["step"], entries["estimate"] = np.array(gains).T[:2]
    numbers = np.zeros(1, np.int32), np.unique(entries["estimate"])
    parameters = Parameters(cutoff=1.0, order=1.0, switch_penalty=1.0)
    problem = problem_of(entries, 0, numbers, parameters)
    states = merge_runs(problem, transpose=False)
    known = np.zeros(len(holds), HELD)
    known["weight"] = HALF
    if holds:
        known["estimate"], known["begin"], known["end"] = np.array(holds).T
    table = np.zeros(len(busy), BUSY)
    if busy:
        table["estimate"], table["begin"] = np.array(busy).T
        table["end"] = table["begin"]
    of_entry = np.array([weight for *_, weight in gains])
    weights = hold_runs(states, of_entry, known, table)
    runs = np.flatnonzero(states.entry < 0)
    whose = zip(states.pair_estimate[states.pair[runs]], states.begin[runs], strict=True)
    return {(int(k), int(t)): int(w) for (k, t), w in zip(whose, weights[runs], strict=True)}


GAINS = [(0, 2, 0), (4, 0, HALF), (6, 1, ONE), (STEPS - 1, 2, 0)]
"""Estimate 1 is followed from step 6 on; half of estimate 0 at step 4. 2 is near, but not used."""


@pytest.mark.parametrize(
    ("holds", "busy", "expected"),
    [
        ([], [], 0),  # half of it could be, but no window says so, and a gain lies between
        ([(1, 0, 5)], [], HALF),
        ([(1, 3, 5)], [], HALF),  # nothing gains before step 3
        ([(1, 5, 5)], [], 0),  # of step 4, where the row gains, no window says anything
        ([(1, 3, 4)], [], HALF),
        ([(1, 3, 5)], [(1, 1)], 0),  # the estimate gains elsewhere
        ([(1, 3, 5)], [(1, 4)], HALF),  # as the window knows
        ([(1, 1, 3), (1, 4, 5)], [], HALF),
    ],
)
def test_runs_that_windows_know_in_part(
    holds: list[tuple[int, int, int]], busy: list[tuple[int, int]], expected: int
) -> None:
    found = held(GAINS, holds, busy)
    assert found[1, 0] == expected
    assert found[0, 0] == HALF  # nothing else is there before step 4
