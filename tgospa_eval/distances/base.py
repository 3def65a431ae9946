"""Interface of a base distance: the distance of two states, and the search for near pairs.

A pair is an object and an estimate at one step. It is near if its distance is less than the cutoff.
Truth and estimate are the two sides. `check_columns` checks that both sides have the same columns.
`check_states` checks that a distance can compare the states of both sides.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence, Sized
from contextlib import suppress
from dataclasses import field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.earth import from_crs
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import more
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import PLACES, Trajectories

if TYPE_CHECKING:
    from fractions import Fraction


NEAR_PLACES = 1.0
"""Two sides are at the same place if their medians differ by less than this, in degrees."""

Fault = tuple[Mask, str, str]
"""A column with wrong values: mask of the wrong states, name of the column, and what is wrong with
the first of these states."""

REACH_ROUNDING = 2.0**-40
"""Share by which reaches (`Distance.reach`) are widened. It is far above rounding errors, so no
near pair is lost."""


DistanceSettings = dict[str, Any]
"""Settings that change the value of a distance, by the names of their options."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Near pairs, sorted by (step, truth, estimate).

    Parameters
    ----------
    truth_row, estimate_row : (N,) int32 arrays
        Row of the truth and row of the estimate of each pair. The type is int64 if a table has too
        many rows for int32.
    distance : (N,) float array
        Base distance, less than the cutoff.
    """

    truth_row: Ints
    estimate_row: Ints
    distance: Floats

    def chosen(self, which: Ints) -> "Pairs":
        """Return the pairs with the indices `which`."""
        return Pairs(
            truth_row=self.truth_row[which],
            estimate_row=self.estimate_row[which],
            distance=self.distance[which],
        )


Sides = tuple[Trajectories, Trajectories]
"""Truth and estimate, at the same times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Resources:
    """Threads and a stopwatch for long work.

    Parameters
    ----------
    jobs : int, optional
        Number of threads; all cores by default.
    stopwatch : Stopwatch
        Stopwatch, which shows the user the stage of the work.
    """

    jobs: int | None = None
    stopwatch: Stopwatch = field(default_factory=Stopwatch)


class Distance(ABC):
    """Metric on states, with the properties that the search for near pairs needs.

    The search sorts points, not states. `embed` maps each state to a point. `reach` returns a
    length for each coordinate of each point. If two points differ on a coordinate by the larger of
    their two reaches or more, the pair is not near, and its distance need not be computed.

    Attributes
    ----------
    name : str
        Name as on the command line.
    tree_power : float
        Power of a Minkowski norm (`inf`: the maximum norm), with this property for each near pair:
        if the difference of the two points on each coordinate is divided by the larger of their
        two reaches, the norm of these quotients is at most 1.
    columns : tuple of str, optional
        State columns that the distance needs, in order; None if it compares any columns.
    options : tuple of str
        Options that change settings of the distance, as fields of `api.options.Request`.
    on_earth : bool
        True if states are latitudes and longitudes in degrees, and distances are in metres.
    defaults : tuple of float
        Default cutoff and switch penalty.
    largest : float
        Upper bound of all distances.
    limits : dict of str to tuple
        For each column with limits: its least value, its largest value, and both in words.
    scale : sequence of float, optional
        Factor of each column, from its unit to the state unit; None if columns are not scaled.
    period : sequence of float, optional
        Period of each column; None if no column is periodic.
    """

    name: str
    scale: Sequence[float] | None = None
    period: Sequence[float] | None = None
    columns: ClassVar[tuple[str, ...] | None] = None
    options: ClassVar[tuple[str, ...]] = ()
    on_earth: ClassVar[bool] = False
    defaults: ClassVar[tuple[float, float]] = (10.0, 2.0)
    largest: ClassVar[float] = float("inf")
    limits: ClassVar[dict[str, tuple[float, float, str]]] = {}

    def __call__(self, a: ArrayLike, b: ArrayLike) -> Floats:
        """Return distances of states; the last axis has the components, other axes broadcast."""
        a, b = (np.moveaxis(np.asarray(side, np.float64), -1, 0) for side in (a, b))
        with np.errstate(over="ignore", invalid="ignore"):
            return self.between(zip(a, b, strict=True))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of states besides points that the distance compares, as in `Trajectories.kind`.

        Possible kinds are gaussian and cloud. If the result is empty, all states are treated as
        points. Else the distance compares points and the kinds in the result, and refuses others.
        """
        return ()

    def axes(self, side: Trajectories, rows: slice | Ints) -> Floats:
        """Return the d components of some R states, (d, R), as `between` and `embed` need them."""
        return np.ascontiguousarray(side.state[rows].T)

    def parts(self, pairs: Pairs, sides: Sides) -> tuple[Floats, Floats] | None:
        """Split the distance of each near pair into a part of the means and a part of the spreads.

        The squares of the two parts add up to the squared distance. The result is None if the
        distance has no such parts.
        """
        return None

    def slopes(self, pairs: Pairs, sides: Sides) -> Floats:
        """Return the derivative of each pair's distance by each column of its estimate, (d, N).

        The N pairs are near, and the sides come from `prepared`. The unit is distance per unit of
        the column. For Gaussians the derivatives are by the mean. They are 0 if the distance is 0.
        At a kink of the distance several derivatives are possible, and the result is one of them.

        Raises
        ------
        ConfigError
            No derivative is known for the distance or its settings.
        """
        a, b = self.axes(sides[0], pairs.truth_row), self.axes(sides[1], pairs.estimate_row)
        return self.slopes_between(a, b)

    def particle_slopes(self, pairs: Pairs, sides: Sides) -> Floats | None:
        """Return the derivative of each near pair's distance by each particle of its estimate.

        The shape is (M, d): the particles of the estimates of all pairs, pair after pair. The
        result is None if states have no particles. The sides are as read, not from `prepared`.

        Raises
        ------
        ConfigError
            No derivative is known for the distance or its settings.
        """
        return None

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return the derivative of the distance of `a` and `b` by each component of `b`, (d, N).

        Raises
        ------
        ConfigError
            No derivative is known for the distance or its settings.
        """
        raise ConfigError(f"the distance {self.name} has no known derivative with these settings")

    @property
    def lower_bound(self) -> "Distance":
        """A cheap distance of points or means that is never larger than this distance."""
        return self

    def fitted(self, sides: Sides) -> "Distance":
        """Return the distance with all settings; some defaults depend on the data of the run."""
        return self

    def prepared(self, sides: Sides, resources: Resources) -> tuple[Sides, "Distance"]:
        """Convert both sides to a form that is fast to compare; return them and their distance."""
        return sides, self

    def horizon(self, sides: Sides, cutoff: float) -> float:
        """Return a limit of `between`: pairs below the limit are candidates for near pairs."""
        return cutoff

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, resources: Resources) -> Pairs:
        """Return the near pairs among the candidates.

        All candidates are near, except in distances whose `between` is only a lower bound.
        """
        return pairs

    def error(self, dimension: int) -> float:
        """Return a proven bound of the relative rounding error of a distance.

        `dimension` is the number of state columns. The result is 0 if no bound is known. In that
        case proofs are about the distances as computed, not about exact distances.
        """
        return 0.0

    def margin(self, sides: Sides, cutoff: float) -> float:
        """Return a margin around the cutoff in which rounding may decide if a pair is near.

        It covers the rounding of the computation, and that of decimals in the files. The sides come
        from `prepared`.
        """
        return REACH_ROUNDING * cutoff

    def nearer(self, pairs: Pairs, sides: Sides, cutoff: Floats) -> Mask:
        """Return for each of N pairs whether it is nearer than its own cutoff, (N,).

        The computed distances decide. If the distance has a closed form and a pair is within the
        `margin` of the cutoff, the exact distance of the states decides
        (docs/theory/certificate.md).
        """
        return pairs.distance < cutoff

    def last_place(self, sides: Sides) -> float:
        """Return roughly by how much a distance changes if a state is rounded.

        The state is the one whose largest component is smallest. A distance up to the result may
        come from rounding alone.
        """
        sizes = [np.abs(side.state).max(axis=1, initial=0.0) for side in sides]
        smallest = float(np.concatenate(sizes).min(initial=np.inf))
        return 2.0**-50 * smallest if sides[0].step.size else 0.0

    @property
    def tree_power(self) -> float:
        """Power of the norm of quotients (see the class); inf is always valid."""
        return float("inf")

    @abstractmethod
    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distances of states; each component is given as one array for each side."""

    def embed(self, axes: Floats) -> Floats:
        """Return the points of R states: e coordinates (e, R) from d components (d, R)."""
        return axes

    @abstractmethod
    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of each of R states on each of the e axes of the points, (e, R).

        The shape is (e, 1) if the reach is the same for all states. Two near states differ on each
        axis by less than the larger of their two reaches. This must hold for differences and
        distances as they are computed, with rounding. On an axis that does not separate states the
        reach is infinite.
        """

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Check that the distance can compare states with these columns; `name` begins the message.

        Raises
        ------
        ConfigError, InputError
            The distance needs other columns, or its settings are for another number of columns.
        """
        if self.columns is not None and columns != self.columns:
            needed = ",".join(self.columns)
            raise InputError(
                f"{name}: the distance {self.name} needs the state columns {needed}, not "
                f"{','.join(columns)}; name or map them with {option('columns', needed)}"
            )
        check_length("scale", self.scale, columns, name)
        check_length("period", self.period, columns, name)

    def fault(self, axes: Floats) -> Fault | None:
        """Return the first column of the states (d, R) with values out of range, or None."""
        for name, (low, high, rule) in self.limits.items():
            values = axes[(self.columns or ()).index(name)]
            wrong = ~((values >= low) & (values <= high))
            if wrong.any():
                first = values[int(np.argmax(wrong))]
                return wrong, name, f"{first:g}{more(int(np.count_nonzero(wrong)))} must be {rule}"
        return None

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return periods and scales by column name, and other settings that change the value."""
        record: DistanceSettings = {}
        if self.period is not None:
            periods = zip(columns, self.period, strict=True)
            record["periodic"] = {column: period for column, period in periods if period != np.inf}
        if self.scale is not None:
            record["scale"] = dict(zip(columns, self.scale, strict=True))
        return record


def exactly_nearer(
    distance: Distance,
    pairs: Pairs,
    sides: Sides,
    cutoff: Floats,
    decide: Callable[["list[Fraction]", "list[Fraction]", "Fraction"], bool],
) -> Mask:
    """Return the result of `Distance.nearer`; `decide` evaluates a closed form exactly."""
    from fractions import Fraction  # lazy: slow to import, and few pairs are at the cutoff

    nearer: Mask = pairs.distance < cutoff
    margin = distance.margin(sides, float(cutoff.max(initial=0.0)))
    close = np.flatnonzero(np.abs(pairs.distance - cutoff) <= margin)
    a, b = (
        distance.axes(side, row[close]).T.tolist()
        for side, row in zip(sides, (pairs.truth_row, pairs.estimate_row), strict=True)
    )
    for pair, x, y in zip(close.tolist(), a, b, strict=True):
        exact = list(map(Fraction, x)), list(map(Fraction, y))
        nearer[pair] = decide(*exact, Fraction(float(cutoff[pair])))
    return nearer


def check_length(what: str, values: Sized | None, columns: tuple[str, ...], name: str) -> None:
    """Check that there is one value for each state column.

    Raises
    ------
    ConfigError
        The number of values is not the number of columns.
    """
    if values is not None and len(values) != len(columns):
        raise ConfigError(
            f"{name} has {len(columns)} state columns ({','.join(columns)}), but {what} is for "
            f"{len(values)}"
        )


def pair_named(sides: Sides, i: int, j: int, *which: str) -> str:
    """Return a text for messages: ids of truth row `i` and estimate row `j`, and their time.

    `which` has two texts: the first follows the id of the truth, the second that of the estimate.
    """
    rows = zip(sides, (i, j), which or ("", ""), strict=True)
    names = (f"id {quoted(side.ids[side.track[row]])}{what}" for side, row, what in rows)
    return f"{' and '.join(names)} at t {sides[0].shown[sides[0].step[i]]}"


def check_columns(
    truth: Trajectories, estimate: Trajectories, names: tuple[str, str] = ("truth", "estimate")
) -> None:
    """Check that both sides have the same state columns.

    Raises
    ------
    InputError
        A state column is on one side only, or the columns are in different orders.
    """
    for own, other, name, missing in ((truth, estimate, *names), (estimate, truth, *names[::-1])):
        extra = [column for column in own.columns if column not in other.columns]
        if extra:
            common = [column for column in own.columns if column in other.columns]
            remedy = f"to compare only some, use {option('columns', ','.join(common) or 'x,y')}"
            if {*PLACES} <= {*truth.columns} ^ {*estimate.columns}:
                local = "truth" if "lat" in estimate.columns else "estimate"
                sides = (estimate, truth) if local == "truth" else (truth, estimate)
                zone = _utm_zone(*sides)
                remedy = (
                    f"x and y of the {local} seem to be UTM coordinates; if so, use "
                    f"{option(f'{local}_crs', zone)} and {option('distance', 'geodesic')}"
                    if zone
                    else f"if x and y of the {local} are east and north in metres from a point, "
                    f"give {option(f'{local}_crs', 'enu')} and "
                    f"{option('origin', metavar='LAT,LON')} of this point (ned: north and east)"
                )
            raise InputError(
                f"{name} has a column {quoted(extra[0])} that {missing} lacks (state columns "
                f"{','.join(own.columns)} against {','.join(other.columns)}); {remedy}"
            )
    if truth.columns != estimate.columns:
        orders = f"{names[0]} {','.join(truth.columns)}, {names[1]} {','.join(estimate.columns)}"
        raise InputError(f"state columns are in different orders: {orders}; use one order in both")


def _utm_zone(earth: Trajectories, local: Trajectories) -> str:
    """Return the UTM zone in which x and y of `local` are near the places of `earth`; "" if none.

    The medians of both sides are compared, in the zone of the places and in both zones beside it.
    """
    if not (len(earth.state) and len(local.state)) or local.columns[:2] != ("x", "y"):
        return ""
    lat, lon = np.median(earth.state[:, [earth.columns.index(name) for name in PLACES]], axis=0)
    gaps = {}
    for zone in range(int(lon // 6) + 29, int(lon // 6) + 32):
        code = f"EPSG:{(32700 if lat < 0 else 32600) + zone % 60 + 1}"
        with suppress(ConfigError):  # the extra is not installed
            place = from_crs(code, "").transform(*np.median(local.state[:, :2], axis=0))
            gaps[code] = max(abs(place[0] - lon), abs(place[1] - lat))
    code = min(gaps, key=gaps.__getitem__, default="")
    return code if code and gaps[code] < NEAR_PLACES else ""


def check_states(
    truth: Trajectories,
    estimate: Trajectories,
    distance: Distance,
    names: tuple[str, str] = ("truth", "estimate"),
) -> None:
    """Check that the distance can compare the states of both sides.

    Raises
    ------
    ConfigError
        The settings of the distance do not fit the state columns.
    InputError
        The distance needs other columns or does not compare states of this kind, or a state is
        out of range.
    """
    _check_kinds((truth, estimate), distance, names)
    for side, name in zip((truth, estimate), names, strict=True):
        distance.check_columns(side.columns, name)
        fault = distance.fault(side.state.T)
        if fault is not None:
            wrong, column, message = fault
            row = int(np.argmax(wrong))
            time = side.shown[side.step[row]]
            identity = side.ids[side.track[row]]
            raise InputError(f"{name}: at t = {time}, id {quoted(identity)}: {column} is {message}")


def _check_kinds(
    sides: tuple[Trajectories, Trajectories], distance: Distance, names: tuple[str, str]
) -> None:
    """Check that the distance compares states of these kinds (`Distance.kinds`)."""
    named = {side.kind: name for side, name in zip(sides[::-1], names[::-1], strict=True)}
    refused = set(named) - {"point", *distance.kinds}
    if not distance.kinds or not refused:
        return
    if {"gaussian", "cloud"} <= set(named):
        raise InputError(
            f"{named['gaussian']} has covariances, and {named['cloud']} has particles: the "
            "distance between a Gaussian and a cloud has no closed form; use "
            f"{option('distance', 'gaussian-wasserstein')} {option('mixed', 'moments')}, which "
            "treats a cloud as a Gaussian"
        )
    if "cloud" in refused:
        raise InputError(
            f"{named['cloud']} has particles: clouds are not Gaussians; use "
            f"{option('distance', 'cloud-wasserstein')}, or {option('mixed', 'moments')}, which "
            "treats a cloud as a Gaussian"
        )
    raise InputError(
        f"{named['gaussian']} has covariances, not particles; use "
        f"{option('distance', 'gaussian-wasserstein')}, or leave the columns out to compare points"
    )
