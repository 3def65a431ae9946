"""Ground truth of synthetic scenes, without trackers and files.

Every scenario is a function ``(targets, steps, area, rng) -> (T, m, 2)``. It returns positions in
the square [0, A]^2 with side A = `area`, NaN where a target does not exist.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats

Ints = NDArray[np.int64]


def encounters(truth: Floats, near: float) -> Ints:
    """Return all encounters of two targets, with their begin and end.

    Parameters
    ----------
    truth : (T, m, d) array
        States with the position in the first two coordinates; NaN where absent.
    near : float
        Distance below which two targets meet, in state units.

    Returns
    -------
    (E, 5) array
        One row for each of the E encounters: first and second target, first step, step after the
        end, step of the smallest distance. Rows are sorted by first step, then by the two targets.
    """
    from scipy.spatial import cKDTree  # memory and time grow only with the number of near pairs

    pairs = [np.zeros((0, 2), np.int64)]
    for position in truth[..., :2]:
        present = np.flatnonzero(~np.isnan(position[:, 0]))
        # An unbalanced tree is built in half the time of a balanced one, and searched as fast.
        tree = cKDTree(position[present], balanced_tree=False, compact_nodes=False)
        pairs.append(present[tree.query_pairs(near, output_type="ndarray")])
    first, second = np.sort(np.concatenate(pairs), axis=1).T
    step = np.repeat(np.arange(len(truth)), [len(own) for own in pairs[1:]])
    distance = np.hypot(*np.moveaxis(truth[step, first, :2] - truth[step, second, :2], -1, 0))
    first, second, step, distance = (a[distance < near] for a in (first, second, step, distance))
    order = np.lexsort((step, second, first))
    first, second, step = first[order], second[order], step[order]
    fresh = np.ones(len(step), bool)
    fresh[1:] = (np.diff(first) != 0) | (np.diff(second) != 0) | (np.diff(step) != 1)
    begin = np.flatnonzero(fresh)
    run = np.cumsum(fresh) - 1
    by_distance = np.lexsort((step, distance[order], run))
    last = np.append(begin, len(step))[1:] - 1
    met = np.stack(
        (first[begin], second[begin], step[begin], step[last] + 1, step[by_distance[begin]]), axis=1
    )
    return met[np.lexsort((met[:, 1], met[:, 0], met[:, 2]))]


Scenario = Callable[[int, int, float, np.random.Generator], Floats]

SPEED = 1 / 100
"""Typical displacement of a target in a time step, as a share of the side of the square."""

LEG = 10
"""Number of steps in which a manoeuvring target goes straight, or turns by 90 degrees in all."""


def crossing(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return straight lines that meet in the middle at half time.

    Target i of m is at A/2 + o_i + 0.4 A u (cos a_i, sin a_i), where the time u goes from -1 to 1.
    Offsets o_i are uniform in [-A/40, A/40]^2. Directions are a_i = 2 pi (i + U[0, 1]) / m.
    """
    angle = 2 * np.pi * (np.arange(targets) + rng.random(targets)) / max(targets, 1)
    along = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    middle = area / 2 + rng.uniform(-area / 40, area / 40, (targets, 2))
    states: Floats = middle + 0.4 * area * (2 * _progress(steps) - 1) * along
    return states


def parallel(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return m targets in lanes with spacing A / (m + 1), all at one speed.

    Target i is at x_i = A (s_i + 0.8 u), y_i = A (i + 1) / (m + 1), where the time u goes from 0 to
    1. Starts s_i are uniform in [0, 0.2].
    """
    start = np.stack(
        (rng.uniform(0, 0.2, targets), (np.arange(targets) + 1) / (targets + 1)), axis=-1
    )
    return area * (start + np.array([0.8, 0.0]) * _progress(steps))


def convoy(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return m targets in a row on a winding road, with spacing g = min(A/20, 0.3 A/m).

    With the time u from 0 to 1 and a uniform angle phi, target i is at
    x_i = A/20 + g (m - 1 - i) + (0.9 A - g (m - 1)) u,
    y_i = A/2 + A/5 sin(2 pi x_i / A + phi).
    """
    spacing = min(area / 20, 0.3 * area / max(targets, 1))
    behind = spacing * np.arange(targets)[::-1]
    way = 0.9 * area - spacing * max(targets - 1, 0)
    x = area / 20 + behind + way * _progress(steps)[..., 0]
    y = area / 2 + area / 5 * np.sin(2 * np.pi * x / area + rng.uniform(0, 2 * np.pi))
    return np.stack((x, y), axis=-1)


def dense(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return random walkers that fill the square and turn back at its sides.

    The first displacement is N(0, (A/100)^2). It changes by N(0, (A/500)^2) at each time step.
    """
    sizes = np.full((steps, 1, 1), SPEED * area / 5)
    sizes[:1] = SPEED * area
    velocity = np.cumsum(rng.normal(size=(steps, targets, 2)) * sizes, axis=0)
    return _walk(velocity, area, rng)


def births(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return straight lines of targets that are born and die.

    In a recording of T steps, lifetimes are uniform in {ceil(T/4), ..., T}. The step of birth is
    uniform among the steps at which this lifetime fits into the recording. The displacement at each
    time step is N(0, (A/100)^2).
    """
    velocity = np.repeat(rng.normal(0, SPEED * area, (1, targets, 2)), steps, axis=0)
    states = _walk(velocity, area, rng)
    life = rng.integers(-(-steps // 4), steps, targets, endpoint=True)
    born = rng.integers(0, steps - life, endpoint=True)
    step = np.arange(steps)[:, None]
    states[(step < born) | (step >= born + life)] = np.nan
    return states


def manoeuvring(targets: int, steps: int, area: float, rng: np.random.Generator) -> Floats:
    """Return targets at speed A/100; in each 10 steps they go straight or turn by 90 degrees."""
    legs = rng.integers(-1, 1, (-(-steps // LEG), targets), endpoint=True)
    turn = np.repeat(legs * (np.pi / 2 / LEG), LEG, axis=0)[:steps]
    heading = rng.uniform(0, 2 * np.pi, targets) + np.cumsum(turn, axis=0)
    velocity = SPEED * area * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    return _walk(velocity, area, rng)


SCENARIOS: dict[str, Scenario] = {
    "crossing": crossing,
    "parallel": parallel,
    "convoy": convoy,
    "dense": dense,
    "births": births,
    "manoeuvring": manoeuvring,
}


def _progress(steps: int) -> Floats:
    """Return the elapsed share of the time, 0 to 1, (T, 1, 1)."""
    return np.linspace(0, 1, steps)[:, None, None]


def _walk(velocity: Floats, area: float, rng: np.random.Generator) -> Floats:
    """Return positions from a uniform start, reflected at the sides of the square.

    Reflection at both sides is a triangle wave of the unbounded position z:
    A - |z mod 2A - A|.
    """
    start = rng.uniform(0, area, velocity.shape[1:])
    return area - np.abs((start + np.cumsum(velocity, axis=0)) % (2 * area) - area)
