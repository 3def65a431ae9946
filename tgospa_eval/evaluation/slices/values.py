"""Values of attributes for each state of both sides: columns, and what follows from the states."""

from collections.abc import Callable
from functools import reduce

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.distances import Distance, Resources
from tgospa_eval.distances.pair_search import prepared_pairs
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.slicing import DERIVED, Attribute
from tgospa_eval.formats.headers import BOX
from tgospa_eval.text import listed, option, quoted
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories, Values

INSIDE, OUTSIDE = "inside", "outside"
"""Of a region."""


def values_of(
    sides: tuple[Trajectories, Trajectories],
    attribute: Attribute,
    distance: Distance,
    cutoff: float,
) -> tuple[Values | None, Values | None]:
    """Of each row of truth and estimate; None where a side has no such attribute.

    A column goes before what would follow from the states under the same name.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate on one grid.
    attribute : Attribute
        Which.
    distance : Distance
        Base distance.
    cutoff : float
        Neighbours are nearer than this.

    Raises
    ------
    ConfigError
        Neither side has it.
    """
    first, second = (_column(side, attribute.name) for side in sides)
    name = attribute.name.partition("@")[0]
    if first is None and second is None and name in DERIVED:
        makers: dict[str, Callable[[Trajectories], Values | None]] = {
            "range": lambda side: _ranges(side, attribute),
            "speed": _speeds,
            "size": _sizes,
            "age": _ages,
            "density": lambda side: _neighbours(side, distance, cutoff),
            "region": lambda side: _inside(side, attribute),
        }
        first, second = map(makers[name], sides)
    if first is None and second is None:
        raise ConfigError(_unknown(sides, attribute))
    return first, second


def _neighbours(side: Trajectories, distance: Distance, cutoff: float) -> Floats:
    """How many other objects of this side are nearer than the cutoff."""
    seen = side.seen_as(distance.kinds)
    effort = Resources(jobs=1)
    both, distance = distance.prepared((seen, seen), effort)
    margin = distance.margin(both, cutoff)
    pairs = prepared_pairs(both, cutoff, distance, effort, margin=margin)
    nearer = distance.nearer(pairs, both, np.full(len(pairs.distance), cutoff))
    pairs = pairs.chosen(np.flatnonzero(nearer))
    others = pairs.truth_row[pairs.truth_row != pairs.estimate_row]
    return np.bincount(others, minlength=len(side.step)).astype(np.float64)


def _unknown(sides: tuple[Trajectories, Trajectories], attribute: Attribute) -> str:
    """What to say of an attribute that neither side has."""
    name = attribute.name
    offered = {header for side in sides for header in side.offered}
    for column, _, _ in attribute.ranges:
        if all(_column(side, column) is None for side in sides):
            name = column
            break
    if name in offered:
        return (
            f"{option('slices')} {quoted(name)}: the column was not read; name it where the files "
            "are read"
        )
    known = (("id", "t", *side.columns, *side.attributes) for side in sides)
    there = sorted(offered.union(*known))
    if name == "size":
        return (
            f"{option('slices', 'size')}: neither side has boxes, nor columns width and height "
            f"(found: {listed(there)})"
        )
    return (
        f"{option('slices')} {quoted(name)}: neither side has such a column (found: "
        f"{listed(there)}); beside columns there are {', '.join(DERIVED)}"
    )


def _column(side: Trajectories, name: str) -> Values | None:
    """A column by its name: asked for, of the states, ids or times."""
    if name in side.attributes:
        given: Values = side.attributes[name]
        return given
    if name in side.columns:
        return np.asarray(side.state[:, side.columns.index(name)], np.float64)
    if name in ("x", "y") and side.columns == BOX:
        return np.asarray(_positions(side)["xy".index(name)], np.float64)
    if name == "id":
        return np.asarray(side.ids[side.track], dtype=object)
    if name == "t":
        if side.labels is None:
            return np.asarray(side.times[side.step], np.float64)
        return np.asarray(side.labels[side.step], dtype=object)
    return None


def _is_earth(side: Trajectories) -> bool:
    return "lat" in side.columns and "lon" in side.columns


def _positions(side: Trajectories) -> Floats:
    """Where the objects are, (d, R): places, not speeds that states may have beside them."""
    if side.columns == BOX:
        left, top, width, height = side.state.T
        return np.stack((left + 0.5 * width, top + 0.5 * height))
    names = [name for name in ("lat", "lon") if _is_earth(side)]
    names = names or [name for name in ("x", "y", "z") if name in side.columns]
    places = [side.columns.index(name) for name in names or side.columns]
    return np.ascontiguousarray(side.state.T[places])


def _apart(side: Trajectories, first: Floats, second: Floats) -> Floats:
    """Lengths between places (d, N), on the Earth in metres."""
    if _is_earth(side):
        return Haversine().between(zip(first, second, strict=True))
    difference: Floats = first - second
    with np.errstate(over="ignore"):
        return np.asarray(reduce(np.hypot, difference[1:], np.abs(difference[0])))


def _ranges(side: Trajectories, attribute: Attribute) -> Floats:
    """Distance from a point, by as many coordinates as that has; from 0 if none is given."""
    places = _positions(side)
    origin = np.array(attribute.origin or (0.0,) * len(places))
    if _is_earth(side) and len(origin) != len(places):
        raise ConfigError(
            f"{option('slices', 'range')}: of latitudes and longitudes write range@LAT,LON"
        )
    if len(origin) > len(places):
        raise ConfigError(
            f"{option('slices', attribute.name)}: the point has {len(origin)} numbers, positions "
            f"have {len(places)} ({', '.join(side.columns)})"
        )
    places = places[: len(origin)]
    return _apart(side, places, np.broadcast_to(origin[:, None], places.shape))


def _speeds(side: Trajectories) -> Floats:
    """Length of the velocity, of the states if they have one, else from the neighbours in time.

    From the row before to the row after, at the ends of a track from or to the row itself; per
    second where times are ISO times. A track of one row has none.
    """
    velocity = [side.columns.index(name) for name in ("vx", "vy", "vz") if name in side.columns]
    if velocity:
        return np.asarray(np.hypot.reduce(side.state[:, velocity].T, axis=0))
    order = np.lexsort((side.step, side.track))
    track = side.track[order]
    same = track[1:] == track[:-1]
    before = np.arange(len(order)) - np.append(False, same)[: len(order)]
    after = np.arange(len(order)) + np.append(same, False)[: len(order)]
    times = side.times[side.step[order]]
    span = (times[after] - times[before]).astype(np.float64)
    places = _positions(side)
    if side.clock != "number":
        span /= SECOND
    speed = np.full(len(order), np.nan)
    moved = np.flatnonzero(span > 0)
    ends = (order[at[moved]] for at in (after, before))
    way = _apart(side, *(places.take(end, axis=1) for end in ends))
    speed[order[moved]] = way / span[moved]
    return speed


def _sizes(side: Trajectories) -> Floats | None:
    """Area of boxes: of the states, or width times height of columns, else times length."""
    if side.columns == BOX:
        return side.state[:, 2] * side.state[:, 3]
    width = _extent(side, "width", ("left", "right"))
    height = _extent(side, "height", ("top", "bottom"))
    other = _extent(side, "length", ()) if height is None else height
    return None if width is None or other is None else width * other


def _extent(side: Trajectories, name: str, ends: tuple[str, ...]) -> Floats | None:
    """A size by its column, or by those of both ends, as far as they are numbers."""
    found = [side.attributes.get(column) for column in (name, *ends)]
    numbers = [None if v is None or v.dtype.kind != "f" else v.astype(np.float64) for v in found]
    if numbers[0] is not None or not ends:
        return numbers[0]
    first, last = numbers[1:]
    return None if first is None or last is None else last - first


def _ages(side: Trajectories) -> Floats:
    """Steps since the first of the track."""
    first = np.zeros(len(side.ids), side.step.dtype)
    first[side.track[::-1]] = side.step[::-1]
    return (side.step - first[side.track]).astype(np.float64)


def _inside(side: Trajectories, attribute: Attribute) -> Values | None:
    """Whether all columns of a region are in their ranges, ends included; blank if one is."""
    inside, known = np.ones(len(side.step), bool), np.ones(len(side.step), bool)
    for name, low, high in attribute.ranges:
        values = _column(side, name)
        if values is None:
            return None
        if values.dtype.kind != "f":
            raise ConfigError(
                f"{option('slices', 'region')}: column {quoted(name)} has texts, not numbers"
            )
        known &= ~np.isnan(values.astype(np.float64))
        inside &= (values >= low) & (values <= high)
    names = np.array(["", OUTSIDE, INSIDE], dtype=object)
    place: Ints = np.where(known, 1 + inside, 0)
    return np.asarray(names[place])
