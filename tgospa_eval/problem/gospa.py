"""GOSPA of every step by itself, and the switches between the assignments of these steps.

GOSPA is not a metric between trajectories: each step is assigned independently of the other steps.
Afterwards, the changes from step to step are counted, by the rules of Stone Soup and by those of
MathWorks. This module imports no solver. `Problem` explains truth rows and entries.
"""

from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.problem.problem import Problem, sum_by
from tgospa_eval.problem.states import connected_components

DENSE_MATRIX = 4_000_000
"""Matrices of all pairs with at most this number of elements are always dense, not sparse."""

SPARSE_RATIO = 8
"""Larger matrices are also dense if they have at most this number of elements per near pair."""


Switched = tuple[Floats, Floats]
"""Two arrays (T,). The first has the number of switches into each step, where a change from or to
"none" counts as half a switch. The second has the number of changes from or to "none"."""


def per_step_gospa(problem: Problem) -> tuple[Ints, Floats, Floats, Floats]:
    """Return the exact GOSPA (alpha = 2) of each step.

    The p-th power of GOSPA is the smallest cost of a partial assignment. An assigned pair costs
    min(d, c)^p, and an object without partner c^p / 2 (Rahmathullah, García-Fernández and Svensson,
    2017). Connected components of the near pairs of a step are assigned separately. If several
    assignments have the smallest cost, the result is the one that SciPy returns for the objects in
    the order of their rows.

    Returns
    -------
    entries : int array
        Entries of the problem that are assigned.
    localisation, missed, false : (T,) float arrays
        Costs of each step, in units of c^p.
    """
    entries = np.sort(np.concatenate([np.zeros(0, np.int64), *_cheapest(problem)]))
    free = []
    for side in problem.sides:
        price = side.price.copy()
        price[side.row[entries]] = 0.0
        free.append(sum_by(side.step, price, problem.steps))
    localisation = sum_by(problem.entry_step[entries], problem.cost[entries], problem.steps)
    return entries, localisation, free[0], free[1]


def _cheapest(problem: Problem) -> Iterator[Ints]:
    """Yield the entries of a cheapest assignment of all steps.

    The first array has the entries of all components with a single pair. Then there is an array for
    each other component.
    """
    rows, columns = problem.truth_row, problem.estimate_row
    truths = len(problem.truth_step)
    label = connected_components(rows, columns + truths, truths + len(problem.estimate_step))
    order = np.argsort(label[rows], kind="stable")
    opens = np.flatnonzero(np.diff(label[rows][order], prepend=-1))
    size = np.diff(opens, append=len(order))
    # If A + B is the same for all pairs, the loss is the cost. If not, the loss is minus the gain,
    # although gains lose digits of tiny costs.
    unpaired = problem.pair_price
    losses = -problem.gain if unpaired is None else problem.cost
    yield order[opens[size == 1]]
    for begin, count in zip(opens[size > 1].tolist(), size[size > 1].tolist(), strict=True):
        group = order[begin : begin + count]
        yield group[assign_pairs(rows[group], columns[group], losses[group], unpaired or 0.0)]


def assign_pairs(rows: Ints, columns: Ints, loss: Floats, unpaired: float) -> Ints:
    """Return the indices of the pairs to assign at the smallest total cost.

    Each row and each column is used at most once. `loss` is the cost of each pair if it is
    assigned. `unpaired` is the cost of leaving both objects of a pair unassigned. It must be larger
    than every element of `loss`.
    """
    from scipy.optimize import linear_sum_assignment  # lazy: slow to import

    row, column = (np.unique(axis, return_inverse=True)[1] for axis in (rows, columns))
    shape = int(row.max()) + 1, int(column.max()) + 1
    if shape[0] * shape[1] > max(DENSE_MATRIX, SPARSE_RATIO * len(loss)):
        return _assign_sparse(row, column, loss, unpaired, shape)
    matrix = np.full(shape, unpaired)
    matrix[row, column] = loss
    partner = np.full(shape[0], -1)
    i, j = linear_sum_assignment(matrix)
    partner[i] = j
    return np.flatnonzero(partner[row] == column)


def _assign_sparse(
    row: Ints, column: Ints, loss: Floats, unpaired: float, shape: tuple[int, int]
) -> Ints:
    """Compute `assign_pairs` with a sparse matrix.

    Each row has a column of its own that means "unassigned".
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    own = np.arange(shape[0])
    shift = 1.0 - loss.min()  # makes all weights positive: SciPy would treat 0 as "no pair"
    weight = np.concatenate((loss, np.full(shape[0], unpaired))) + shift
    graph = csr_array(
        (weight, (np.concatenate((row, own)), np.concatenate((column, shape[1] + own)))),
        shape=(shape[0], shape[1] + shape[0]),
    )
    partner = np.full(shape[0], -1)
    i, j = min_weight_full_bipartite_matching(graph)
    partner[i] = j
    return np.flatnonzero(partner[row] == column)


def partners(problem: Problem, entries: Ints) -> Ints:
    """Return the track of the estimate assigned to each truth row, -1 for none, (R_truth,)."""
    track = np.full(len(problem.truth_step), -1)
    track[problem.truth_row[entries]] = problem.estimate_track[problem.estimate_row[entries]]
    return track


def changes_since_last_stored(problem: Problem, track: Ints) -> Switched:
    """Return switches into each step as Stone Soup counts them.

    At each step, the partner of a true object is compared with the last stored partner of the
    object, and is then stored. Storing begins with the first estimate that is a partner. Later,
    having no partner is stored as "none". Steps without any estimate are skipped. A change counts
    1, and a change from or to "none" 1/2.
    """
    reported = np.zeros(problem.steps, bool)
    reported[problem.estimate_step] = True
    order = _by_truth(problem)
    order = order[reported[problem.truth_step[order]]]
    count = np.cumsum(track[order] >= 0)
    # `count` is not reset at the next true object. `before` is its value before the first row of
    # each object.
    opens = np.diff(problem.truth_track[order], prepend=-1) != 0
    before = np.where(opens, count - (track[order] >= 0), 0)
    order = order[count > np.maximum.accumulate(before)]
    return _changes(problem, track, order, np.ones(max(len(order) - 1, 0), bool))


def changes_since_last_step(problem: Problem, track: Ints) -> Switched:
    """Return switches into each step as MathWorks describes them.

    The partner of a true object at a step is compared with its partner at the step before, if the
    object exists at both steps. A change counts 1, and a change from or to "none" 1/2.
    """
    order = _by_truth(problem)
    return _changes(problem, track, order, np.diff(problem.truth_step[order]) == 1)


def _by_truth(problem: Problem) -> Ints:
    """Return truth rows sorted by (track, step)."""
    return np.lexsort((problem.truth_step, problem.truth_track))


def _changes(problem: Problem, track: Ints, order: Ints, counts: Mask) -> Switched:
    """Return the changes of partner from each row to the next row of the same object.

    A change counts at the later of the two steps. `order` has truth rows sorted by object and step.
    If counts[i] is False, a change from row order[i] to row order[i + 1] does not count.
    """
    after, before = track[order[1:]], track[order[:-1]]
    counts = counts & (np.diff(problem.truth_track[order]) == 0) & (after != before)
    both = (after >= 0) & (before >= 0)
    step = problem.truth_step[order[1:]]
    whole = np.bincount(step[counts & both], minlength=problem.steps)
    half = np.bincount(step[counts & ~both], minlength=problem.steps)
    return whole + 0.5 * half, half.astype(float)
