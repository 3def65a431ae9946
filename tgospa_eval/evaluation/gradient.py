"""Derivatives of a result: those of the cost of its assignment, which is held.

The metric is a minimum over assignments, so by the envelope theorem (Danskin) its derivative is
that of the cost at the best one, where that is unique; else it is a subgradient of the minimum's
directional derivatives (docs/how-to/gradient.md).

`is_unique` says whether the prices show that no other assignment of near pairs is as good. At best
prices v every best assignment is a mixture of paths that are best for their rows, and fills
every slot with v > 0 (complementary slackness). Rows that compete for an estimate are indifferent
at the best prices, so that is not enough to see what each does; but what is certain of one row
decides others: a slot that it fills is closed to them, and a priced slot that a single state can
still fill is filled by it (docs/how-to/gradient.md).

What is assigned at steps without gain, as between two tracks while neither exists, is often free.
It changes no part of the cost, and is asked about for the steps of switches alone.
"""

import itertools
import math
from functools import partial

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.distances import CloudWasserstein, Distance, Pairs, Resources
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import PairEvaluation, source_of
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.paths import turns
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import ONE, States
from tgospa_eval.results.gradient import Gradient
from tgospa_eval.results.proof import PairProof
from tgospa_eval.text import option

NO_TIE = 1e-9
"""In units of c^p: a path that is worse by less may be as good, but for rounding."""

SHARE = 100.0
"""What is worse by so many times the gap has at most one such part in any best assignment: weights
of vertices are multiples of 1/2 to 1/18."""

ROUNDS = 50
"""Of drawing conclusions; each takes as long as looking for best paths twice."""


def is_unique(proof: PairProof, gap: float, *, everywhere: bool = False) -> bool:
    """Whether the assignment is shown to be the only best one.

    Parameters
    ----------
    proof : PairProof
        Assignment and prices.
    gap : float
        What counts as exact.
    everywhere : bool
        Whether steps without gain are asked about as well: they decide when a switch is booked.
    """
    states, bounds = proof.states, proof.bounds
    if not bounds.met(gap) or proof.reduced:
        return False
    reach = max(NO_TIE, SHARE * (bounds.upper - bounds.lower))
    used, assigned = proof.weights > 0, proof.weights == ONE
    if not np.array_equal(used, assigned):
        return False  # a mixture of paths
    if not len(used):
        return True
    rows = _Rows(states, proof.prices, reach)
    for _ in range(ROUNDS):
        if not rows.draw_conclusions():
            return False
        open_ = rows.open(used, everywhere=everywhere)
        if not open_.any():
            return True
        if not rows.survey(open_):
            return False
    return False


class _Rows:
    """What the best paths of the rows may be; fewer with each conclusion.

    Parameters
    ----------
    states : States
        The problem.
    prices : (K,) float array
        Of its column slots.
    reach : float
        Paths that are worse by no more count as best ones.
    """

    def __init__(self, states: States, prices: Floats, reach: float) -> None:
        self.states, self.reach = states, reach
        slots, rows = states.columns, states.rows
        self.value = states.gain - slots.totals(prices)
        self.priced = prices > reach
        self.row = states.pair_row[states.pair]
        single = rows.first[states.pair_row] == rows.first[states.pair_row + 1]
        # Rows with a single pair have no slots: nothing of theirs is beside it.
        self.alone = np.repeat(single, np.diff(states.pair_first))
        self.near, self.needed = _marks(states, self.value, prices, reach)
        self.certain = np.zeros(len(states.begin), bool)
        self.closed = np.zeros(len(states.begin), bool)

    def open(self, used: Mask, *, everywhere: bool) -> Mask:
        """Rows of which it is not known what they have, of near pairs or everywhere, (nodes,)."""
        unsure = (self.near != used) | (self.near & ~self.certain)
        if not everywhere:
            unsure &= self.states.entry >= 0
        rows = np.zeros(self.states.nodes, bool)
        rows[self.row[unsure]] = True
        return rows

    def draw_conclusions(self) -> bool:
        """Close what is beside certain states, and fill priced slots; whether that is possible."""
        columns, rows = self.states.columns, self.states.rows
        while True:
            at = np.where(self.alone, 0, rows.begin)
            count = np.append(rows.sums(self.near.astype(np.int64)), 1)[at]
            fresh = self.near & self.needed & (self.alone | (count == 1))
            must = self.priced & (columns.sums(self.near.astype(np.int64)) == 1)
            fresh = (fresh | (self.near & columns.touching(must))) & ~self.certain
            if not fresh.any():
                return True
            self.certain |= fresh
            for slots in (columns, rows):
                load = slots.sums(self.certain.astype(np.int64))
                if load.max(initial=0) > 1:
                    return False  # rounding: prices that are none of the best
                self.closed |= slots.touching(load > 0) & ~self.certain
            self.near &= ~self.closed

    def survey(self, asked: Mask) -> bool:
        """Look for the best paths of some rows (nodes,) anew; whether fewer are left."""
        part, own = self.states.of_pairs(np.flatnonzero(asked[self.states.pair_row]))
        value = np.where(self.closed[own], -np.inf, self.value[own]) + self.certain[own]
        loss, without = path_losses(part, value)
        near, needed = self.near[own] & (loss <= self.reach), without > self.reach
        fewer = bool((near != self.near[own]).any() or (needed & ~self.needed[own]).any())
        self.near[own] = near
        self.needed[own] |= needed
        return fewer


def _marks(states: States, value: Floats, prices: Floats, reach: float) -> tuple[Mask, Mask]:
    """States on paths that are best within reach; and those at which "none" is on no such path."""
    if not kernels:
        loss, without = path_losses(states, value)
        return loss <= reach, without > reach
    from tgospa_eval.solvers.dual_ascent import Ascent  # lazy: as the solvers are

    blocks = np.ones(len(states.block_begin), bool)
    ascent = Ascent(
        states, blocks, 0.0, np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
    )
    ascent.mark(prices, reach)
    return ascent.has(kernels.NEAR), ascent.has(kernels.NEEDED)


def path_losses(states: States, value: Floats) -> tuple[Floats, Floats]:
    """By how much the best path of the row is better than the best one with restrictions.

    Viterbi forward and backward in time, as `problem.paths.best_values` does it.

    Parameters
    ----------
    states : States
        Rows, whole.
    value : (S,) float array
        Gains less prices; minus infinity closes a state.

    Returns
    -------
    through : (S,) float array
        Loss of going through each state.
    without : (S,) float array
        Loss of being in "none" when it begins.
    """
    bounds, order, pair_of, row_of = turns(states)
    price = states.problem.switch_price_at[states.begin[order]]
    value = value[order]
    size = len(value)
    pairs, nodes = len(states.pair_row), states.nodes
    through, without = np.zeros(size), np.zeros(size)
    spans = [slice(*ends) for ends in itertools.pairwise(bounds)]

    none, current = np.zeros(nodes), np.zeros(pairs)
    for own in spans:
        pair, row = pair_of[own], row_of[own]
        reached = current[pair]
        np.maximum.at(none, row, reached - price[own])
        without[own] = none[row]
        current[pair] = np.maximum(reached, none[row] - price[own]) + value[own]
        through[own] = current[pair]
    best = none
    np.maximum.at(best, states.pair_row, current)
    best = best[row_of]

    none, current = np.zeros(nodes), np.zeros(pairs)
    for own in reversed(spans):
        pair, row = pair_of[own], row_of[own]
        through[own] += current[pair]
        without[own] += none[row]
        entered = value[own] + current[pair]
        np.maximum.at(none, row, entered - price[own])
        current[pair] = np.maximum(entered, none[row] - price[own])
    losses = np.empty((2, size))
    losses[0, order], losses[1, order] = best - through, best - without
    return losses[0], losses[1]


def gradient(result: PairEvaluation) -> Gradient:
    """Derivatives of the total by estimate states, cutoff and switch penalty."""
    sides, request = source_of(result)
    if sides.alignment.held is not None:
        raise ConfigError(
            f"{option('resample')}: reports hold for several steps, and no derivative by their "
            "states is known; evaluate at the times of the estimate, "
            f"{option('interpolate', 'truth')}"
        )
    proof = result.proof
    states, problem, parameters = proof.states, proof.states.problem, proof.parameters
    cutoff, p, gamma = parameters.cutoff, parameters.order, parameters.switch_penalty
    used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
    entry = states.entry[used]
    share = problem.share(entry)
    pairs = Pairs(
        truth_row=problem.truth_row[entry],
        estimate_row=problem.estimate_row[entry],
        distance=cutoff * problem.powers(entry) ** (1 / p),
    )
    change = share * (proof.weights[used] / ONE) * p * pairs.distance ** (p - 1)
    mismatch = result.scale * float(np.sum(problem.mismatch(entry) * (proof.weights[used] / ONE)))
    total, particles, first = _moved(sides, request.distance, pairs, change)
    at_zero = math.nan if p == 1 else 0.0  # where switches are free, any number of them is best
    return Gradient(
        total=total,
        particles=particles,
        first_particle=first,
        cutoff=p / cutoff * (result.missed + result.false + mismatch),
        switch_penalty=p / gamma * result.switch if gamma > 0 else at_zero,
        root=result.tgospa / (p * result.total) if result.total > 0 else 0.0,
        shown_unique=partial(is_unique, proof, result.gap),
        step=problem.estimate_step,
        track=problem.estimate_track,
        columns=sides.alignment.estimate.columns,
        labels=result.labels,
    )


def _moved(
    fitted: AlignedPair, given: Distance, pairs: Pairs, change: Floats
) -> tuple[Floats, Floats | None, Ints | None]:
    """Derivative by each state of the estimate (R, d), of clouds by each particle (P, d).

    `given` is the distance without what it takes from the data, `change` (N,) that of the total by
    the distance of each pair; clouds also have the place of their first particles (R + 1,).
    """
    aligned, distance = fitted.alignment, fitted.distance
    sides = aligned.truth.seen_as(distance.kinds), aligned.estimate.seen_as(distance.kinds)
    clouds = sides[1].clouds
    by_particle = distance.particle_slopes(pairs, sides)
    if by_particle is None:
        prepared, measure = distance.prepared(sides, Resources())
        slopes = (change * measure.slopes(pairs, prepared)).T
        return _sums(pairs.estimate_row, slopes, len(sides[1].step)), None, None
    if isinstance(distance, CloudWasserstein) and distance != given:
        raise ConfigError(
            "no derivative is known where the covariance of the particles is taken from the data: "
            f"name one with {option('inner_cov', metavar='FILE')}"
        )
    if clouds is None:
        slopes = by_particle * change[:, None]
        return _sums(pairs.estimate_row, slopes, len(sides[1].step)), None, None
    count = clouds.counts[pairs.estimate_row]
    place = concatenated(clouds.first[pairs.estimate_row], count)
    slopes = by_particle * np.repeat(change, count)[:, None]
    particles = _sums(place, slopes, len(clouds.points))
    return clouds.sums(particles), particles, clouds.first


def _sums(index: Ints, values: Floats, size: int) -> Floats:
    """Sums of the rows of values (N, d) that share an index, (size, d)."""
    return np.stack([sum_by(index, column, size) for column in values.T], axis=1)
