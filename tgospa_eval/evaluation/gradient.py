"""Derivatives of a result, computed as those of the cost of its assignment.

The total is a minimum of the cost over assignments. If the best assignment is unique, the total has
the same derivative as the cost of this assignment (envelope theorem, Danskin). If several
assignments are best, the total may have a kink, and the derivative is one-sided
(docs/how-to/gradient.md).
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
    """Return the derivatives of the total with respect to the estimate and to parameters.

    The parameters are the cutoff and the switch penalty.
    """
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
    at_zero = math.nan if p == 1 else 0.0  # switches are free, so their number is arbitrary
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
    """Return the derivatives of the total with respect to the estimate.

    Parameters
    ----------
    fitted : AlignedPair
        Truth and estimate, with the distance fitted to them.
    given : Distance
        Distance before it was fitted.
    pairs : Pairs
        The N assigned pairs.
    change : (N,) float array
        Derivative of the total with respect to the distance of each pair.

    Returns
    -------
    total : (R, d) float array
        Derivative with respect to each state of the estimate.
    particles : (P, d) float array or None
        Derivative with respect to each particle.
    first : (R + 1,) int array or None
        Index of the first particle of each state.
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
            f"give one with {option('inner_cov', metavar='FILE')}"
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
