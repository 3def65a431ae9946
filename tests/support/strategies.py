"""Random instances for the property tests: small, of every kind that has bitten somebody."""

import numpy as np
from far_scenes import KINDS, FarScene, largest_distance, sides, within_range
from hypothesis import strategies as st

ORDERS = st.sampled_from([1.0, 1.5, 2.0, 3.0])
SWITCH = st.sampled_from([0.0, 0.05, 0.3, 1.0, 2.0, 5.0, 1000.0])


@st.composite
def sets(
    draw: st.DrawFn, steps: int, dimension: int, most: int = 3, grid: bool | None = None
) -> np.ndarray:
    """Trajectories (T, k, d): holes anywhere, often on a coarse grid so that ties are common."""
    count = draw(st.integers(0, most))
    on_grid = draw(st.booleans()) if grid is None else grid
    seed = draw(st.integers(0, 2**32 - 1))
    holes = draw(st.sampled_from([0.0, 0.2, 0.5]))
    rng = np.random.default_rng(seed)
    states = rng.uniform(0, 4, (steps, count, dimension))
    if on_grid:
        states = np.round(states)
    states[rng.random((steps, count)) < holes] = np.nan
    return states


@st.composite
def pairs_of_sets(
    draw: st.DrawFn, most: int = 3, most_steps: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    steps = draw(st.integers(1, most_steps))
    dimension = draw(st.integers(1, 3))
    return draw(sets(steps, dimension, most)), draw(sets(steps, dimension, most))


WHOLE_ORDERS = st.sampled_from([1.0, 2.0, 3.0, 4.0, 5.0, 10.0])
ANY_ORDERS = st.sampled_from([1.5, 2.9]) | st.floats(0, 1).map(lambda exponent: 10.0**exponent)


@st.composite
def far_scenes(
    draw: st.DrawFn,
    *,
    orders: st.SearchStrategy[float] = WHOLE_ORDERS,
    most: int = 3,
    steps: tuple[int, int] = (1, 4),
    farthest: float = 6.0,
    kinds: tuple[str, ...] = KINDS,
) -> FarScene:
    """Costs far below c^p: order, cutoff and switch penalty log-uniform in units of the distances.

    The cutoff is from the largest distance to `farthest` powers of ten above it.
    """
    p = draw(orders)
    distance = draw(st.sampled_from(["euclidean", "manhattan", "chebyshev"]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    m, n = draw(st.integers(1, most)), draw(st.integers(1, most))
    holes = draw(st.sampled_from([0.0, 0.0, 0.3]))
    truth, estimate = sides(
        rng, draw(st.sampled_from(kinds)), m, n, draw(st.integers(*steps)), 2, holes
    )
    unit = draw(st.sampled_from([1.0, 1.0, 1e-6, 1e5]))
    truth, estimate = truth * unit, estimate * unit
    d = largest_distance(truth, estimate, distance)
    c = within_range(d * 10.0 ** draw(st.floats(0.0, farthest)), p)
    return FarScene(truth, estimate, c, p, d * 10.0 ** draw(st.floats(-3.0, 6.0)), distance)


@st.composite
def few_among_many(
    draw: st.DrawFn, most: int = 16, longest: int = 100
) -> tuple[np.ndarray, np.ndarray]:
    """One to four tracks on one side, up to `most` on the other, of any length up to `longest`.

    Tracks walk, stand still, or jump; in rounded places much ties. Short scenes have more tracks.
    """
    steps = int(draw(st.floats(1.0, 2.0).map(lambda power: longest ** (power - 1.0))))
    few = draw(st.integers(1, 4))
    many = draw(st.integers(few, max(few, min(most, 6 * longest // (few * steps)))))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dimension = draw(st.integers(1, 2))
    restless = draw(st.sampled_from([0.0, 0.1, 1.0]))
    grid = draw(st.sampled_from([None, None, 1.0, 4.0]))
    holes = draw(st.sampled_from([0.0, 0.0, 0.1, 0.5]))

    def side(count: int) -> np.ndarray:
        states = rng.normal(0, 2, (1, count, dimension)) + np.cumsum(
            rng.normal(0, restless, (steps, count, dimension)), axis=0
        )
        if grid is not None:
            states = np.round(states / grid) * grid
        states[rng.random((steps, count)) < holes] = np.nan
        return states

    sides = side(few), side(many)
    return sides if draw(st.booleans()) else sides[::-1]


def scene(
    seed: int, m: int, n: int, steps: int, *, side: float, noise: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Crowded scene: walkers in a square; estimates with noise, misses, swaps, and false tracks."""
    rng = np.random.default_rng(seed)
    truth = np.empty((steps, m, 2))
    position = rng.uniform(0, side, (m, 2))
    velocity = rng.normal(0, 1, (m, 2))
    for k in range(steps):
        truth[k] = position
        velocity += rng.normal(0, 0.2, (m, 2))
        position = np.abs(position + velocity)
        over = position > side
        position = np.where(over, 2 * side - position, position)
        velocity = np.where(over, -velocity, velocity)
    estimate = np.full((steps, n, 2), np.nan)
    who = rng.permutation(n)[: min(m, n)]
    for k in range(steps):
        if rng.random() < 0.2 and len(who) > 1:
            a, b = rng.choice(len(who), 2, replace=False)
            who[[a, b]] = who[[b, a]]
        seen = rng.random(len(who)) < 0.9
        estimate[k, who[seen]] = (truth[k, : len(who)] + rng.normal(0, noise, (len(who), 2)))[seen]
    for j in set(range(n)) - set(who.tolist()):
        begin = rng.integers(0, steps)
        estimate[begin : begin + 5, j] = rng.uniform(0, side, 2)
    return truth, estimate


def coincident(
    seed: int, m: int, n: int, steps: int, *, places: int = 3, holes: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """Objects that stand still at few places, each missing at random steps: everything ties."""
    rng = np.random.default_rng(seed)
    spots = rng.integers(0, 10, (places, 2)).astype(float)

    def side(count: int) -> np.ndarray:
        return np.repeat(spots[rng.integers(0, places, count)][None], steps, axis=0)

    truth, estimate = side(m), side(n)
    truth[rng.random((steps, m)) < holes] = np.nan
    estimate[rng.random((steps, n)) < holes] = np.nan
    return truth, estimate


def lattice_walks(
    seed: int, m: int, n: int, steps: int, *, side: int = 6, holes: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Random walks on a lattice, nobody following anybody: distances tie, optima are fractional."""
    rng = np.random.default_rng(seed)

    def walk(count: int) -> np.ndarray:
        position = rng.integers(0, side, (count, 2))
        states = np.empty((steps, count, 2))
        for k in range(steps):
            states[k] = position
            position = np.clip(position + rng.integers(-1, 2, (count, 2)), 0, side - 1)
        states[rng.random((steps, count)) < holes] = np.nan
        return states

    return walk(m), walk(n)


def dice(seed: int, m: int, n: int, steps: int, *, side: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Everybody at a random point of a small lattice at each step."""
    rng = np.random.default_rng(seed)
    truth, estimate = (rng.integers(0, side, (steps, k, 2)).astype(float) for k in (m, n))
    return truth, estimate


def overlapping(
    seed: int, m: int, steps: int, *, noise: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Walkers side by side, each with an estimate; two estimates change places half way."""
    rng = np.random.default_rng(seed)
    truth = np.cumsum(rng.normal(0, 1, (steps, m, 2)), axis=0) + rng.uniform(0, 4, (1, m, 2))
    estimate = truth + rng.normal(0, noise, truth.shape)
    order = np.r_[1, 0, 2:m]
    estimate[steps // 2 :] = estimate[steps // 2 :, order]
    return truth, estimate
