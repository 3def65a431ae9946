"""Derivatives of a result: those of the cost of its assignment, which is held.

The metric is a minimum over assignments, so by the envelope theorem (Danskin) its derivative is
that of the cost at the best one, where that is unique; else it is a subgradient of the minimum's
directional derivatives (docs/theory/gradient.md).
"""

import math
from functools import partial

import numpy as np

from tgospa_eval.distances import Effort, Pairs
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.prepare import Fitted, Source
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.weights import ONE
from tgospa_eval.results.gradient import Gradient
from tgospa_eval.results.result import Result


def gradient(result: Result) -> Gradient:
    """Derivatives of the total by estimate states, cutoff and switch penalty."""
    source = result.source
    if not isinstance(source, Source):
        raise ConfigError("this result was not made by evaluate: evaluate again")
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
    slopes = change * _slopes(source.sides, pairs)
    total = np.zeros((len(problem.estimate_step), len(slopes)))
    for k, slope in enumerate(slopes):
        total[:, k] = np.bincount(pairs.estimate_row, slope, minlength=len(total))
    at_zero = math.nan if p == 1 else 0.0  # where switches are free, any number of them is best
    return Gradient(
        total=total,
        cutoff=p / cutoff * (result.missed + result.false + mismatch),
        switch_penalty=p / gamma * result.switch if gamma > 0 else at_zero,
        root=result.tgospa / (p * result.total) if result.total > 0 else 0.0,
        shown_unique=partial(is_unique, proof, result.gap),
        step=problem.estimate_step,
        track=problem.estimate_track,
        columns=source.sides.alignment.estimate.columns,
        labels=result.labels,
    )


def _slopes(fitted: Fitted, pairs: Pairs) -> Floats:
    """Derivative of the distances of near pairs by the estimate, (d, N)."""
    aligned, distance = fitted.alignment, fitted.distance
    truth, estimate = (side.seen_as(distance.kinds) for side in (aligned.truth, aligned.estimate))
    sides, prepared = distance.prepared((truth, estimate), Effort())
    return prepared.slopes(pairs, sides)
