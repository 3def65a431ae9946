"""Some rows of a component by themselves, at prices of places: estimates at single steps.

Where a component is larger than memory its rows are looked at a part at a time. What all of them
share is the prices, and these are spread over places at will: a slot is the stretch from one priced
place of its column to the next.
"""

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import check_size
from tgospa_eval.problem.merging import split_pairs
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.slots import Slots
from tgospa_eval.problem.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class PricedPlaces:
    """Where estimates are priced, by (estimate, step).

    Parameters
    ----------
    first : (n + 1,) int array
        First place of each estimate.
    step : (K,) int array
        When.
    whole : (K,) int array
        The prices, >= 0, in the units of `slots.exact_running`.
    unit : (n,) float array
        Unit of the prices of each estimate.
    """

    first: Ints
    step: Ints
    whole: Ints
    unit: Floats


def rows_of_component(problem: Problem, places: PricedPlaces) -> States:
    """The states of some rows of one component whose window is all steps of the problem.

    Its truths are the rows, nodes 0 to m - 1, whatever their number; its estimates the columns,
    nodes m to m + n - 1. The slots of the columns are the places.

    Parameters
    ----------
    problem : Problem
        Some truths of the component with all their entries, and the estimates of these.
    places : PricedPlaces
        Those of its estimates.

    Raises
    ------
    InputError
        There is more of something than 32-bit indices can number.
    """
    truths, estimates, steps = problem.truths, problem.estimates, problem.steps
    check_size("near pairs", len(problem.cost))
    check_size("steps", steps)
    key = problem.truth_track[problem.truth_row].astype(np.int64) * estimates
    key += problem.estimate_track[problem.estimate_row]
    key, pair_of = np.unique(key, return_inverse=True)
    truth, estimate = (part.astype(np.int32) for part in np.divmod(key, max(estimates, 1)))
    pairs = len(key)
    pair_first, begin, entry = split_pairs(
        pair_of.astype(np.int32),
        problem.entry_step,
        np.zeros(pairs, np.int32),
        np.full(pairs, steps - 1, np.int32),
        single=False,
    )
    column = estimate + np.int32(truths)
    first = np.concatenate((np.zeros(truths, np.int32), places.first.astype(np.int32)))
    return States(
        problem=problem,
        pair_row=truth,
        pair_column=column,
        pair_block=np.zeros(pairs, np.int32),
        pair_first=pair_first,
        pair_truth=truth,
        pair_estimate=estimate,
        begin=begin,
        entry=entry,
        columns=Slots(
            first=first,
            step=places.step,
            begin=_first_places(places, estimate, pair_first, begin, steps),
            pair_first=pair_first,
            pair_node=column,
        ),
        node_block=np.zeros(truths + estimates, np.int32),
        block_begin=np.zeros(1, np.int32),
        block_end=np.full(1, steps - 1, np.int32),
        transposed=np.zeros(1, bool),
    )


def _first_places(
    places: PricedPlaces, estimate: Ints, pair_first: Ints, begin: Ints, steps: int
) -> Ints:
    """The first place of its column at or after the first step of each state, (S,)."""
    columns = np.arange(len(places.unit), dtype=np.int64) * (steps + 1)
    known = np.repeat(columns, np.diff(places.first)) + places.step
    sought = np.repeat(columns[estimate], np.diff(pair_first)) + begin
    return np.searchsorted(known, sought).astype(np.int32)
