"""``python tests/benchmarks/tiny_gamma.py``: tiny switch penalties and p = 1 beside plain HiGHS.

Seconds of the processor for random scenes, by `certified` and by the linear programme of the
definition, with presolve as SciPy has it: at the usual tolerances, and where its total is off, at
the smallest.
"""

import time

import click
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linprog

from tgospa_eval import Certified, evaluate

Floats = NDArray[np.float64]

TOLERANCES, ACCURATE = (1e-7, 1e-10), 1e-9
"""Those of HiGHS in units of c^p: the usual ones, and the smallest, for scenes whose total the
usual ones get wrong by more than ours may be: they do not see a switch penalty below them."""

LIMIT = 60.0
"""Seconds of HiGHS, after which it has no value. Where gamma is above its tolerances, and nearly
all assignments tie, it takes longer than this."""


def scene(seed: int) -> tuple[Floats, Floats, float, float]:
    """Truths, estimates, cutoff and switch penalty: everybody near everybody, most on a line."""
    rng = np.random.default_rng(seed)
    m, n, steps = rng.integers(2, 26, 3)
    if rng.random() < 0.5:
        n = m + rng.integers(-1, 2)
    dimension = rng.choice([1, 1, 1, 2])
    shift = rng.choice([0.0, 0.0, rng.uniform(0, 2)])  # far: nearly all assignments tie
    truth, estimate = (rng.normal(x, 1, (steps, k, dimension)) for x, k in ((0, m), (shift, n)))
    if rng.random() < 0.3:  # ties
        truth, estimate = np.round(4 * truth) / 4, np.round(4 * estimate) / 4
    return truth, estimate, 10.0 ** rng.uniform(0.3, 3), 10.0 ** rng.uniform(-9, -4)


def programme(
    truth: Floats, estimate: Floats, c: float, gamma: float
) -> tuple[Floats, sparse.csr_array, sparse.csr_array]:
    """Costs, capacities and transitions: gains of pairs, and a rise and a fall for each change."""
    distance = np.linalg.norm(truth[:, :, None] - estimate[:, None], axis=3)
    gain = 1.0 - np.minimum(distance / c, 1.0)
    steps, m, n = gain.shape
    pair = np.arange(gain.size).reshape(gain.shape)
    slots = [group for step in pair for group in (*step, *step.T)]
    row = np.repeat(np.arange(len(slots)), [len(slot) for slot in slots])
    changes = (steps - 1) * m * n
    size = gain.size + 2 * changes
    capacities = sparse.csr_array(
        (np.ones(len(row)), (row, np.concatenate(slots))), shape=(len(slots), size)
    )
    one = sparse.eye_array(changes)
    before, after = (
        sparse.csr_array((np.ones(changes), (np.arange(changes), at.ravel())), (changes, gain.size))
        for at in (pair[:-1], pair[1:])
    )
    transitions = sparse.hstack((after - before, -one, one), "csr")
    return np.append(-gain, np.full(2 * changes, 0.5 * gamma / c)), capacities, transitions


@click.command(help=__doc__)
@click.option("--scenes", default=200)
@click.option("--first", default=0)
def main(scenes: int, first: int) -> None:
    """Print a line for each scene, and the ratios of all."""
    ratios: dict[float, list[float]] = {tolerance: [] for tolerance in TOLERANCES}
    for seed in range(first, first + scenes):
        truth, estimate, c, gamma = scene(seed)
        begin = time.process_time()
        result = evaluate(truth, estimate, c, 1, gamma, solver=Certified(jobs=1))
        own = time.process_time() - begin
        costs, capacities, transitions = programme(truth, estimate, c, gamma)
        full, still = np.ones(capacities.shape[0]), np.zeros(transitions.shape[0])
        steps, m, n = *truth.shape[:2], estimate.shape[1]
        for tolerance in TOLERANCES:
            begin = time.process_time()
            answer = linprog(
                *(costs, capacities, full, transitions, still),
                method="highs",
                options={
                    "time_limit": LIMIT,
                    "primal_feasibility_tolerance": tolerance,
                    "dual_feasibility_tolerance": tolerance,
                },
            )
            plain = time.process_time() - begin
            value = np.nan if answer.fun is None else answer.fun
            off = c * (value + 0.5 * steps * (m + n)) / result.total - 1
            ratios[tolerance].append(own / plain)
            click.echo(
                f"{seed:4}  {m:2} x {n:2} x {steps:2}, {truth.shape[2]} d, c {c:8.3g}, "
                f"gamma {gamma:7.1e}  {own:7.3f} s, HiGHS {plain:7.3f} s, "
                f"ratio {own / plain:6.2f}  {'exact' if result.certified else 'OPEN'}, "
                f"that off by {off:.0e}"
            )
            if abs(off) < ACCURATE:
                break
    for tolerance, each in ratios.items():
        if each:
            _report(tolerance, each)


def _report(tolerance: float, ratios: list[float]) -> None:
    low, middle, high = np.quantile(ratios, [0.1, 0.5, 0.9])
    click.echo(
        f"HiGHS at {tolerance:g}, {len(ratios)} scenes: ratio {low:.2f}, {middle:.2f}, {high:.2f} "
        f"(10, 50, 90 %), at most {max(ratios):.2f}; {sum(one > 5 for one in ratios)} above 5"
    )


if __name__ == "__main__":
    main()
