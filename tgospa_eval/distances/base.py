"""What every base distance offers: to users its value, to the search a space to sort in."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgospa_eval.errors import InputError
from tgospa_eval.trajectories import Ints, Trajectories

Floats = NDArray[np.float64]

Fault = tuple[int, str, str]
"""Row of a state, its column, and what is wrong with its value."""

ROUNDING = 2.0**-40
"""What reaches are widened by: far above the rounding of a distance, and it loses no candidate."""


class Distance(ABC):
    """A metric on states, with what the search for near pairs needs to know about it.

    The search sorts points, not states: `embed` maps states to points and `reach` bounds the
    differences of the coordinates of near ones, so that a pair beyond a bound needs no distance.
    Each state has a reach of its own, and the larger one of a pair is the bound.

    Attributes
    ----------
    name : str
        As on the command line.
    tree_power : float
        For states nearer than the cutoff, the Minkowski norm with this power of the difference of
        their points is at most 1, if every coordinate is measured in the larger of their reaches.
    columns : tuple of str, optional
        State columns that it needs, in order; None if any will do.
    defaults : tuple of float
        Cutoff and switch penalty, if the user names none.
    uses_covariance : bool
        Whether it looks at covariances.
    """

    name: str
    columns: ClassVar[tuple[str, ...] | None] = None
    defaults: ClassVar[tuple[float, float]] = (10.0, 2.0)
    uses_covariance: ClassVar[bool] = False

    def __call__(self, a: ArrayLike, b: ArrayLike) -> Floats:
        """Distance along the last axis of `a` and `b`, which broadcast."""
        a, b = (np.moveaxis(np.asarray(side, np.float64), -1, 0) for side in (a, b))
        with np.errstate(over="ignore", invalid="ignore"):
            return self.between(zip(a, b, strict=True))

    def axes(self, side: Trajectories, rows: slice | Ints) -> Floats:
        """Components (d, R) of some rows, as `between` and `embed` take them."""
        return np.ascontiguousarray(side.state[rows].T)

    def parts(self, components: Iterable[tuple[Floats, Floats]]) -> tuple[Floats, Floats] | None:
        """Two distances whose squares add up to that of `between`: of means, and of spreads.

        None if there are no such.
        """
        del components
        return None

    @property
    def tree_power(self) -> float:
        """Power of a norm that the search may use; inf is always right."""
        return float("inf")

    @abstractmethod
    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of states that are given component by component."""

    def embed(self, axes: Floats) -> Floats:
        """Points (e, R) of the states (d, R)."""
        return axes

    @abstractmethod
    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """How far near ones may be from each of the states (d, R), on every axis of the points.

        Shape (e, R), or (e, 1) if it is the same for all. Two states that are near differ on each
        axis by less than the larger of their two reaches: no distance that is computed as less than
        the cutoff may have a computed difference that is not. Infinite on an axis that tells
        nothing.
        """

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Whether it can compare states with these columns; `name` begins the message.

        Raises
        ------
        ConfigError, InputError
            It cannot.
        """
        if self.columns is not None and columns != self.columns:
            needed = ",".join(self.columns)
            raise InputError(
                f"{name}: the distance {self.name} needs the state columns {needed}, not "
                f"{','.join(columns)}; name or map them with --columns {needed}"
            )

    def fault(self, axes: Floats) -> Fault | None:
        """First of the states (d, R) that is out of range, its column, and what is wrong."""
        del axes
        return None

    def settings(self, columns: tuple[str, ...]) -> dict[str, Any]:
        """What changes the number beside the name, by the names of the options."""
        del columns
        return {}


def first_fault(wrong: NDArray[np.bool_], values: Floats, name: str, rule: str) -> Fault:
    """The first wrong value of a column in words."""
    row = int(np.flatnonzero(wrong)[0])
    count = int(np.count_nonzero(wrong))
    others = f" (and {count - 1} more)" if count > 1 else ""
    return row, name, f"{values[row]:g}{others} {rule}"
