"""Association of the states of two sensors, step by step. Knows no file.

At every step the pairs are chosen whose distances, with half a cutoff for everything that stays
alone, have the smallest sum: a pair is worth ``c - d``, and none at the cutoff or beyond is taken.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.distances import Distance, Effort, Pairs, near_pairs
from tgospa_eval.distances.transport import cross_covariance
from tgospa_eval.errors import ConfigError, InputError, real_number
from tgospa_eval.trajectories import Trajectories

Table = dict[str, list[Any]]
Floats = NDArray[np.float64]

LARGEST = 3000
"""Rows of either side of a step: the matrix of their gains takes 72 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Association:
    """Pairs of rows of two sides.

    Parameters
    ----------
    first, second : Trajectories
        The sides, on the same times.
    near : Pairs
        All pairs of one step that are nearer than the cutoff.
    chosen : (N,) bool array
        Which of them were associated.
    cutoff : float
        The cutoff c.
    """

    first: Trajectories
    second: Trajectories
    near: Pairs
    chosen: NDArray[np.bool_]
    cutoff: float

    @property
    def total(self) -> float:
        """The sum that was minimised."""
        alone = len(self.first.step) + len(self.second.step) - 2 * int(self.chosen.sum())
        return float(self.near.distance[self.chosen].sum() + 0.5 * self.cutoff * alone)

    def associations_table(self) -> Table:
        """Each state once: pairs by step, with None for the partner of one that stays alone."""
        pairs = np.flatnonzero(self.chosen)
        i, j = self.near.truth_row[pairs], self.near.estimate_row[pairs]
        values = zip(self.near.distance[pairs].tolist(), self._means_apart(pairs), strict=True)
        steps = self.first.step, self.second.step
        alone = [
            np.setdiff1d(np.arange(len(step)), taken).tolist()
            for step, taken in zip(steps, (i, j), strict=True)
        ]
        rows = [
            *(
                (int(steps[0][a]), 0, a, self._names(a, b, *value))
                for a, b, value in zip(i.tolist(), j.tolist(), values, strict=True)
            ),
            *((int(steps[0][a]), 1, a, self._names(a, None, None, None)) for a in alone[0]),
            *((int(steps[1][b]), 2, b, self._names(None, b, None, None)) for b in alone[1]),
        ]
        rows.sort(key=lambda row: row[:3])
        names = ("t", "id_a", "id_b", "distance", "mean_distance")
        return {name: [row[3][k] for row in rows] for k, name in enumerate(names)}

    def costs_table(self) -> Table:
        """All pairs that are nearer than the cutoff; any other pair costs the cutoff."""
        table = self._pairs_table(np.arange(len(self.chosen)))
        return {**table, "associated": self.chosen.astype(int).tolist()}

    def cross_covariances_table(self) -> Table:
        """Of each associated pair the cross-covariance of the particles.

        Raises
        ------
        InputError
            No side has clouds, or one has normal laws.
        """
        kinds = {self.first.kind, self.second.kind}
        if "cloud" not in kinds or "gaussian" in kinds:
            lacks = "one file has covariances" if "cloud" in kinds else "neither file has any"
            raise InputError(
                f"cross-covariances are those of particles, and {lacks}; add a column weight"
            )
        pairs = np.flatnonzero(self.chosen)
        names = self.first.columns
        matrices = np.zeros((len(pairs), len(names), len(names)))
        if self.first.clouds is not None and self.second.clouds is not None:
            for k, pair in enumerate(pairs.tolist()):
                a = self.first.clouds[int(self.near.truth_row[pair])]
                b = self.second.clouds[int(self.near.estimate_row[pair])]
                matrices[k] = cross_covariance(*a, *b)
        entries = {
            f"cov_{one}_{other}": matrices[:, r, s].tolist()
            for r, one in enumerate(names)
            for s, other in enumerate(names)
        }
        return {**self._pairs_table(pairs), **entries}

    def _pairs_table(self, pairs: NDArray[np.intp]) -> Table:
        apart = self._means_apart(pairs)
        rows = [
            self._names(int(a), int(b), float(value), far)
            for a, b, value, far in zip(
                self.near.truth_row[pairs],
                self.near.estimate_row[pairs],
                self.near.distance[pairs],
                apart,
                strict=True,
            )
        ]
        names = ("t", "id_a", "id_b", "distance", "mean_distance")
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}

    def _names(
        self, a: int | None, b: int | None, value: float | None, apart: float | None
    ) -> tuple[Any, ...]:
        side, row = (self.first, a) if a is not None else (self.second, b)
        time = side.shown[side.step[row]]
        return (
            time.item() if hasattr(time, "item") else time,
            None if a is None else self.first.ids[self.first.track[a]],
            None if b is None else self.second.ids[self.second.track[b]],
            value,
            apart,
        )

    def _means_apart(self, pairs: NDArray[np.intp]) -> list[float]:
        """Euclidean distances of the states, those of clouds being their means."""
        a, b = self.first.state, self.second.state
        difference = a[self.near.truth_row[pairs]] - b[self.near.estimate_row[pairs]]
        return [float(value) for value in np.linalg.norm(difference, axis=1)]


def associate(
    first: Trajectories,
    second: Trajectories,
    *,
    cutoff: float,
    distance: Distance,
    effort: Effort | None = None,
) -> Association:
    """Associate the states of two sides on the same times.

    Parameters
    ----------
    first, second : Trajectories
        On the same times, with the same state columns.
    cutoff : float
        c > 0, in the unit of the distance.
    distance : Distance
        Distance of states.
    effort : Effort, optional
        Threads, and progress.

    Raises
    ------
    ConfigError
        The cutoff is not finite and > 0.
    InputError
        A step has too many states.
    """
    cutoff = real_number("cutoff", cutoff)
    if not 0 < cutoff < np.inf:
        raise ConfigError(f"cutoff is {cutoff:g}: must be finite and > 0")
    near = near_pairs(first, second, cutoff, distance.fitted(first, second), effort)
    chosen = np.zeros(len(near.distance), bool)
    step = first.step[near.truth_row]
    for begin, end in _runs(step):
        axes = [
            np.unique(rows[begin:end], return_inverse=True)[1]
            for rows in (near.truth_row, near.estimate_row)
        ]
        shape = [int(axis.max()) + 1 for axis in axes]
        if max(shape) > LARGEST:
            raise InputError(
                f"t {first.shown[step[begin]]}: {max(shape)} states with a partner within the "
                f"cutoff, at most {LARGEST} are possible; take a smaller cutoff"
            )
        chosen[begin:end] = _best(cutoff - near.distance[begin:end], axes, shape)
    return Association(first=first, second=second, near=near, chosen=chosen, cutoff=cutoff)


def _runs(step: NDArray[np.integer]) -> list[tuple[int, int]]:
    """Where each step begins and ends among the pairs."""
    begin = np.flatnonzero(np.diff(step, prepend=-1))
    return list(pairwise([*begin.tolist(), len(step)]))


def _best(gain: Floats, axes: list[NDArray[np.intp]], shape: list[int]) -> NDArray[np.bool_]:
    """Which pairs have the largest sum of gains, each row and column once."""
    from scipy.optimize import linear_sum_assignment

    table = np.zeros(shape)
    table[axes[0], axes[1]] = gain
    taken = np.zeros(shape, bool)
    taken[linear_sum_assignment(table, maximize=True)] = True
    return np.asarray(taken[axes[0], axes[1]] & (gain > 0))
