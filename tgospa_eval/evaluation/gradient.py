"""Derivatives of a result: those of the cost of its assignment, which is kept fixed.

The metric is a minimum over assignments. By the envelope theorem (Danskin), its derivative is the
derivative of the cost at the best assignment, where the best one is unique. Otherwise this is a
subgradient of the minimum's directional derivatives (docs/how-to/gradient.md).
"""

import math
from functools import partial

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.distances import CloudWasserstein, Distance, Pairs, Resources
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import PairEvaluation, source_of
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import ONE
from tgospa_eval.quoting import option
from tgospa_eval.results.gradient import Gradient


def gradient(result: PairEvaluation) -> Gradient:
    """Return derivatives of the total with respect to estimate states, cutoff, switch penalty."""
    sides, request = source_of(result)
    if sides.alignment.reports is not None:
        raise ConfigError(
            f"{option('resample')}: a report holds for several steps, so no derivative is known; "
            "evaluate at the times of the estimate instead, by "
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
    at_zero = math.nan if p == 1 else 0.0  # free switches: any number of them is best
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
    """Return derivatives with respect to the estimate: states, particles and first particles.

    They are arrays for R states (R, d), P particles (P, d), and the index of the first particle of
    each state (R + 1,). The last two may be None. `given` is the distance before it is
    fitted to the data. `change` (N,) is the derivative of the total with respect to the distance of
    each of N pairs.
    """
    aligned, distance = fitted.alignment, fitted.distance
    sides = aligned.truth.reduced_to(distance.kinds), aligned.estimate.reduced_to(distance.kinds)
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
    """Sum the rows of values (N, d) that share an index, (size, d)."""
    return np.stack([sum_by(index, column, size) for column in values.T], axis=1)
