"""Blocks of a problem at a smaller cutoff, and what that proves of the whole.

    V(C) >= V(s C) + (1 - s) C sum_k (A (m_k - nu_k) + B (n_k - nu_k)),   C = c^p,   0 < s < 1,

where a missed target costs A C and a false one B C, A + B = 1. For every cost is a sum,
min(d^p, C) = min(d^p, s C) + rest; nu_k is the size of a largest matching of near pairs at step k
(docs/theory/certificate.md, "Cutoffs far above the errors").
"""

from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.paths import down
from tgospa_eval.problem.states import States

LARGEST_SWITCH_PRICE = 1e100
"""Switch prices above this are no different."""


def reduce_cutoff(states: States, blocks: Mask, scale: float) -> States:
    """The problem of some blocks at the cutoff price `scale`, a power of 2, in units of that.

    Rows and tracks keep their numbers. All truths must have one price, and all estimates
    (`Problem.object_prices`).
    """
    problem = states.problem
    entry = _entries(states, blocks)
    entry = entry[problem.cost[entry] < scale * (problem.pair_price or 0.0)]
    return merge_runs(
        replace(
            problem,
            truth_row=problem.truth_row[entry],
            estimate_row=problem.estimate_row[entry],
            cost=problem.cost[entry] / scale,
            distance_power=None,
            switch_price=np.minimum(problem.switch_price / scale, LARGEST_SWITCH_PRICE),
            cost_error=0.0,
            cost_slack=0.0,
            rounding=0.0,
        )
    )


def _entries(states: States, blocks: Mask) -> Ints:
    """The entries of some blocks, in order."""
    return np.sort(states.entry[states.states_of(blocks) & (states.entry >= 0)])


def forced_cost(states: States, blocks: Mask) -> Floats:
    """``C sum_k (A (m_k - nu_k) + B (n_k - nu_k))`` of each of these blocks, (B,).

    nu_k is at most the size of any vertex cover of the near pairs (König).
    """
    problem = states.problem
    count = len(states.block_begin)
    cover = vertex_cover(states, blocks)
    covered = np.zeros(count, np.int64)
    objects = []
    for side, blocks_of, mine in zip(problem.sides, states.track_blocks, cover, strict=True):
        block = blocks_of[side.track]
        objects.append(np.bincount(block[block >= 0], minlength=count))
        covered += np.bincount(block[(block >= 0) & mine], minlength=count)
    first, second = problem.object_prices or (0.0, 0.0)
    if first == second:
        forced = first * np.maximum(objects[0] + objects[1] - 2 * covered, 0)
    else:
        free = (np.maximum(of - covered, 0) for of in objects)
        forced = down(first * next(free)) + down(second * next(free))
        forced = np.maximum(down(forced), 0.0)
    return np.where(blocks, forced, 0.0)


def vertex_cover(states: States, blocks: Mask) -> tuple[Mask, Mask]:
    """Rows of either side that cover the near pairs of some blocks: of each pair at least one.

    They belong to a largest matching, so they are as few as can be; that they cover is checked.
    """
    problem = states.problem
    entry = _entries(states, blocks)
    truth = problem.truth_row[entry].astype(np.int64)
    estimate = problem.estimate_row[entry].astype(np.int64)
    cover = _cover(truth, estimate, len(problem.truth_step), len(problem.estimate_step))
    if not np.all(cover[0][truth] | cover[1][estimate]):
        return np.ones_like(cover[0]), np.ones_like(cover[1])
    return cover


def _cover(truth: Ints, estimate: Ints, truths: int, estimates: int) -> tuple[Mask, Mask]:
    """A least vertex cover of a bipartite graph by Konig's theorem: marks of either side."""
    from scipy import sparse  # lazy: slow to import and rarely needed
    from scipy.sparse.csgraph import maximum_bipartite_matching

    row, column = truth.astype(np.int32), estimate.astype(np.int32)  # no others before SciPy 1.15
    graph = sparse.csr_array(
        (np.ones(len(truth), np.int8), (row, column)), shape=(truths, estimates)
    )
    partner = maximum_bipartite_matching(graph, perm_type="column")
    # Alternating paths from the truths without partner: along any pair, back along a matched one.
    reached = partner < 0
    paired = np.full(estimates, -1)
    paired[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    seen = np.zeros(estimates, bool)
    while True:
        fresh = np.unique(estimate[reached[truth] & ~seen[estimate]])
        if not len(fresh):
            return ~reached, seen
        seen[fresh] = True
        back = paired[fresh]
        reached[back[back >= 0]] = True
