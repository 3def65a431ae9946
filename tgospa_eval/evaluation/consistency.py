"""NEES of the assigned pairs: errors in units of the covariances of the estimates.

    NEES = (a - b)' (P + R)^-1 (a - b)

a is the state of the truth and b the state of the estimate. P is the covariance of the estimate, or
the second moments of its particles. R is the covariance of the truth, or 0 if it has none. The
errors of the truth must be independent of those of the filter, as those of a separate sensor are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.axis import periods_of, shortest_differences
from tgospa_eval.problem.solution import read_assigned
from tgospa_eval.results.consistency import BINS, NeesSums, nees_sums
from tgospa_eval.results.records import PairProof
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.clouds import Clouds

LARGEST = 1e100
"""Largest NEES; above it, the covariance counts as singular, so that sums are finite."""

PAIRS_TOGETHER = 1 << 16
"""Number of pairs whose particles are processed together."""


def pair_nees(proof: PairProof, distance: Distance) -> tuple[Floats, NeesSums]:
    """Return the NEES of each assigned pair, NaN where it does not count, and sums of all.

    The NEES of a pair does not count if its covariance is singular or its object is ignored.

    The estimate must have covariances or particles.
    """
    compared, problem = proof.compared, proof.states.problem
    assert compared.estimate_covariance is not None
    assigned = read_assigned(proof.states, proof.weights)
    rows = on_steps = problem.truth_row[assigned.entry], problem.estimate_row[assigned.entry]
    states = compared.truth, compared.estimate
    spreads = compared.truth_covariance, compared.estimate_covariance
    periods, clouds = periods_in(distance, compared.columns), compared.estimate_clouds
    if compared.reports is not None:  # on a common clock, errors are those at the times of reports
        names = np.array(compared.labels.truths, dtype=object)
        pair = compared.reports.located(names[problem.sides[0].track[rows[0]]], rows[1])
        states = pair[0].state, pair[1].state
        spreads = pair[0].covariance, spreads[1][rows[1]]
        clouds = pair[1].clouds
        rows = np.arange(len(rows[0])), np.arange(len(rows[0]))
    nees, histogram = nees_of(states, spreads, rows, periods), None
    if problem.unjudged is not None:  # ignored states of the truth do not count
        ignored = problem.unjudged[0][on_steps[0]]
        nees[ignored] = np.nan
        assigned = replace(assigned, weight=np.where(ignored, 0.0, assigned.weight))
    if clouds is not None:
        histogram = ranks(states[0][rows[0]], clouds, rows[1], assigned.weight, periods)
    return nees, nees_sums(assigned, nees, states[0].shape[1], histogram)


def periods_in(distance: Distance, columns: tuple[str, ...]) -> list[float] | None:
    """Return the period of each state column, inf for no period; None if no column has one."""
    periods = periods_of(distance, columns)
    return [periods.get(name, np.inf) for name in columns] if periods else None


def nees_of(
    states: tuple[Floats, Floats],
    spreads: tuple[Floats | None, Floats],
    rows: tuple[Ints, Ints],
    periods: Sequence[float] | None,
) -> Floats:
    """Return the NEES of N pairs, (N,).

    `states` and `spreads` have all states and their covariances: of the truth, and of the estimate.
    `rows` has the row of the truth and the row of the estimate of each pair.
    """
    packed = spreads[1][rows[1]].T
    if spreads[0] is not None:
        packed = packed + spreads[0][rows[0]].T
    errors = shortest_differences(states[0][rows[0]] - states[1][rows[1]], periods)
    return squared(errors.T, covariances.factor(packed))


def squared(errors: Floats, factors: Floats) -> Floats:
    """Return ``e' (L L')^-1 e`` for each of N pairs, (N,).

    `errors` (d, N) has the error e of each pair. `factors` has its lower triangular matrix L as
    packed rows. The result is NaN where L is singular, and where the value is above `LARGEST`.
    """
    d = len(errors)
    solved = np.empty_like(errors)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for i in range(d):  # forward substitution for all pairs at once
            row = i * (i + 1) // 2
            known = sum(factors[row + k] * solved[k] for k in range(i))
            solved[i] = (errors[i] - known) / factors[row + i]
        nees: Floats = (solved * solved).sum(axis=0)
    diagonal = factors[[i * (i + 3) // 2 for i in range(d)]]
    nees[(diagonal <= 0).any(axis=0) | ~(nees <= LARGEST)] = np.nan
    return nees


def ranks(
    truth: Floats,
    clouds: Clouds,
    rows: Ints,
    weight: Floats,
    periods: Sequence[float] | None = None,
) -> Floats:
    """Return a histogram of the ranks of true states among the particles, for each state column.

    The result has the shape (d, 10). Let n be the effective number of particles, 1 / (sum of
    squared weights). Let S be the weight of the particles below the true state, plus half the
    weight of equal particles. The rank is spread evenly between n S / (n + 1) and
    (n S + 1) / (n + 1). If the particles are drawn from the posterior, the true state is like one
    more draw, and the histogram is flat.
    """
    edges = np.linspace(0, 1, BINS + 1)
    counts = np.zeros((truth.shape[1], BINS))
    for begin in range(0, len(rows), PAIRS_TOGETHER):
        part = slice(begin, begin + PAIRS_TOGETHER)
        number = clouds.counts[rows[part]]
        place = concatenated(clouds.first[rows[part]], number)
        pair = np.repeat(np.arange(len(number)), number)
        above = shortest_differences(clouds.points[place] - truth[part][pair], periods)
        mass = clouds.weights[place]
        draws = 1 / np.bincount(pair, mass * mass, minlength=len(number))
        for k in range(truth.shape[1]):
            below = (above[:, k] < 0) + 0.5 * (above[:, k] == 0)
            share = np.bincount(pair, mass * below, minlength=len(number))
            up_to = edges * (draws[:, None] + 1) - (draws * share)[:, None]
            counts[k] += weight[part] @ np.diff(np.clip(up_to, 0, 1), axis=1)
    return counts
