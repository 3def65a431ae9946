"""Which states are inside regions: points, and boxes by the share of their area."""

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from tgospa_eval.common.words import install
from tgospa_eval.distances.pair_search import starts_of_steps
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.sides import as_frame, is_path
from tgospa_eval.tracks.alignment import comparable, joined_to
from tgospa_eval.tracks.ignored import Mask
from tgospa_eval.tracks.interpolation import found_at
from tgospa_eval.tracks.regions import BOX, CAP, CIRCLE, GEOJSON, POLYGON, SHAPES, Regions, Shape
from tgospa_eval.tracks.trajectories import CLOCKS, Floats, TimeArray, Trajectories

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.evaluation.sides import ArrowTable

RegionsLike: TypeAlias = "str | os.PathLike[str] | pd.DataFrame | ArrowTable | Mapping[str, Any]"
"""A path, a table, or a GeoJSON document."""

Placed: TypeAlias = "tuple[Shape, int | None]"
"""A region and its step; None is all."""

GIVEN = "ignore_regions"

HALF = 0.5 - 1e-12
"""Least share of the area of a box that is inside, with room for rounding."""

PLANE, EARTH = ("x", "y"), ("lat", "lon")


def as_regions(given: "RegionsLike | None", decimal: str = ".") -> Regions | None:
    """Any accepted form of regions; `decimal` is the mark in a file.

    Raises
    ------
    ConfigError
        It is of no accepted type, or there are polygons and shapely is missing.
    InputError
        A region is wrong: it has no area, or a polygon crosses itself.
    """
    if given is None:
        return None
    from tgospa_eval.formats.regions import of_geojson, of_rows, read_regions  # here: few have any

    if is_path(given):
        found = read_regions(os.fspath(given), decimal)
    elif isinstance(given, Mapping):
        found = of_geojson(given, GIVEN)
    else:
        frame = as_frame(given, GIVEN)
        if frame is None:
            raise ConfigError(
                f"{GIVEN} is of the type {type(given).__name__}: must be a path, a table or a "
                "GeoJSON document"
            )
        rows = [[_text(value) for value in row] for row in frame.itertuples(index=False)]
        places = [GIVEN, *(f"{GIVEN}, row {row}" for row in range(len(rows)))]
        found = of_rows([*map(str, frame.columns)], rows, places, ".", GIVEN)
    for shape in found.shapes:
        if shape.kind in (POLYGON, GEOJSON):
            shapely = _shapely()
            polygon = _polygon(shape)
            if not shapely.is_valid(polygon):
                why = shapely.is_valid_reason(polygon).partition("[")
                place = f" at {why[2].rstrip(']')}" if why[2] else ""
                raise InputError(
                    f"{shape.where}: a polygon whose edges cross or overlap{place}; write its "
                    "corners in order around it, or two polygons"
                )
    return found


def inside(regions: Regions, side: Trajectories, tolerance: float, name: str) -> Mask:
    """Which rows (R,) are in the regions of their step; `name` is that of the side, for messages.

    Points are in a region or on its edge; boxes are, if at least half of their area is in all
    regions of the step together.

    Raises
    ------
    InputError
        Regions and states are not of one kind, or their times are not.
    """
    placed = _placed(regions, side, tolerance, name)
    most, total = _shares(placed, side, regions.name, name)
    found = most >= HALF
    at_step: dict[int | None, list[Shape]] = {None: []}
    for shape, step in placed:
        at_step.setdefault(step, []).append(shape)
    for row in np.flatnonzero(~found & (total >= HALF)).tolist():
        together = at_step[None] + at_step.get(int(side.step[row]), [])
        found[row] = _share_of_all(side.state[row], together) >= HALF
    return found


def shares(
    regions: Regions, side: Trajectories, tolerance: float, name: str
) -> tuple[Floats, Floats]:
    """Share of the area of each row (R,) in the region that has most of it, and their sum.

    Of a box with the edges a_1 <= b_1, a_2 <= b_2 and a box of a region the share is that of
    TrackEval, ``prod_k max(0, min(b_k, b'_k) - max(a_k, a'_k)) / prod_k (b_k - a_k)``; 0 where it
    has no area. That of a point is 1 inside and 0 outside.
    """
    return _shares(_placed(regions, side, tolerance, name), side, regions.name, name)


def _shares(
    placed: Sequence[Placed], side: Trajectories, source: str, name: str
) -> tuple[Floats, Floats]:
    most, total = np.zeros((2, len(side.step)))
    begins = starts_of_steps(side)
    boxes = side.columns == SHAPES[BOX]
    axes = [side.columns.index(c) for c in (EARTH if "lat" in side.columns else PLANE)
            if not boxes and c in side.columns]  # fmt: skip
    if not boxes and len(axes) < 2:
        raise InputError(
            f"{source}: regions are of states x,y, lat,lon or left,top,width,height; those "
            f"of {name} are {','.join(side.columns)}"
        )
    for shape, step in placed:
        rows = slice(None) if step is None else slice(begins[step], begins[step + 1])
        state = side.state[rows]
        if boxes:
            share = _share(shape, state)
        else:
            share = _holds(shape, state[:, axes], earth="lat" in side.columns).astype(float)
        most[rows] = np.maximum(most[rows], share)
        total[rows] += share
    return most, total


def _placed(regions: Regions, side: Trajectories, tolerance: float, name: str) -> list[Placed]:
    """The regions that are at a step of the side."""
    step: dict[int, int | None] = dict.fromkeys(range(len(regions.shapes)))
    if len(regions.timed):
        if regions.clock != side.clock and len(side.times):
            raise InputError(
                f"{regions.name} has {CLOCKS[regions.clock]}, {name} has {CLOCKS[side.clock]}; "
                "write both alike"
            )
        moments = cast("TimeArray", np.unique(regions.times))
        own_times = Trajectories.of_times(moments, (), regions.clock)
        mine, theirs = comparable(own_times, side, (regions.name, name))
        if len(theirs):
            mine, _ = joined_to(mine, theirs, tolerance, side.clock)
        at, there = found_at(mine, theirs)
        for k, stamp in zip(regions.timed.tolist(), regions.times, strict=True):
            own = int(np.searchsorted(moments, stamp))
            if there[own]:
                step[k] = int(at[own])
            else:
                del step[k]
    return [(regions.shapes[k], at) for k, at in step.items()]


def _share(shape: Shape, state: Floats) -> Floats:
    """Share of the area of boxes (N, 4) that is in a region."""
    begin, end = state[:, :2], state[:, :2] + state[:, 2:]
    area = (end - begin).prod(axis=1)
    if shape.kind == BOX:
        box = shape.rings[0]
        edges = np.minimum(end, box[:2] + box[2:]) - np.maximum(begin, box[:2])
        shared = np.maximum(edges, 0.0).prod(axis=1)
    else:
        shapely, polygon = _shapely(), _in_plane(shape)
        shared = shapely.area(shapely.intersection(polygon, _boxes(state)))
    share: Floats = np.divide(shared, area, out=np.zeros(len(area)), where=area > 0)
    return share


def _share_of_all(state: Floats, shapes: Sequence[Shape]) -> float:
    """Share of the area of one box (4,) that is in several regions together."""
    begin, end = state[:2], state[:2] + state[2:]
    area = float((end - begin).prod())
    if any(shape.kind != BOX for shape in shapes):
        shapely = _shapely()
        every = shapely.union_all([_in_plane(shape) for shape in shapes])
        return float(shapely.area(shapely.intersection(every, _boxes(state[None])[0])) / area)
    boxes = np.array([shape.rings[0] for shape in shapes])
    edges = np.stack((boxes[:, :2], boxes[:, :2] + boxes[:, 2:])).clip(begin, end)  # (2, N, axis)
    edges = edges[:, (edges[0] < edges[1]).all(axis=1)]
    cuts = [np.unique(edges[:, :, axis]) for axis in (0, 1)]
    across, along = (  # which stretches between two cuts each region has
        (edges[0, :, axis, None] <= cuts[axis][:-1]) & (cuts[axis][1:] <= edges[1, :, axis, None])
        for axis in (0, 1)
    )
    covered = (across[:, :, None] & along[:, None, :]).any(axis=0)
    return float(np.diff(cuts[0]) @ covered @ np.diff(cuts[1]) / area)


def _holds(shape: Shape, points: Floats, *, earth: bool) -> Mask:
    """Which of the points (N, 2), x, y or latitude and longitude, are in a region or on its edge.

    Edges of polygons on the Earth are straight lines in longitude and latitude (RFC 7946).
    """
    if shape.kind not in ((CAP, POLYGON, GEOJSON) if earth else (BOX, CIRCLE, POLYGON, GEOJSON)):
        raise InputError(
            f"{shape.where}: {','.join(SHAPES[shape.kind])} is no region of states "
            f"{','.join(EARTH if earth else PLANE)}"
        )
    ring = shape.rings[0]
    if shape.kind == CAP:
        sides = ((points[:, axis], ring[axis]) for axis in (0, 1))
        near: Mask = Haversine().between(sides) <= ring[2]
        return near
    if shape.kind == CIRCLE:
        return np.asarray(np.hypot(*(points - ring[:2]).T) <= ring[2])
    if shape.kind == BOX:
        edges = (points >= ring[:2]) & (points <= ring[:2] + ring[2:])
        return np.asarray(edges.all(axis=1))
    shapely, polygon = _shapely(), _polygon(shape)
    shapely.prepare(polygon)
    if not earth:
        return np.asarray(shapely.intersects_xy(polygon, *points.T))
    corners = np.concatenate(shape.rings)
    latitude, longitude = (1, 0) if shape.kind == GEOJSON else (0, 1)
    if (abs(corners[:, latitude]) > 90).any() or (abs(corners[:, longitude]) > 360).any():
        order = "lon, lat" if shape.kind == GEOJSON else "lat lon"
        raise InputError(f"{shape.where}: corners are {order}, in degrees, and one is out of range")
    held = np.zeros(len(points), bool)
    for turn in (-360.0, 0.0, 360.0):
        turned = points[:, 0], points[:, 1] + turn
        held |= shapely.intersects_xy(polygon, turned[1 - longitude], turned[1 - latitude])
    return held


def _in_plane(shape: Shape) -> Any:
    """A region as shapely has it, among boxes."""
    if shape.kind in (CIRCLE, CAP):
        raise InputError(
            f"{shape.where}: a circle holds points, and the states are boxes; give a box or a "
            "polygon"
        )
    return _boxes(shape.rings[0][None])[0] if shape.kind == BOX else _polygon(shape)


def _boxes(state: Floats) -> Any:
    return _shapely().box(*state[:, :2].T, *(state[:, :2] + state[:, 2:]).T)


def _polygon(shape: Shape) -> Any:
    return _shapely().Polygon(shape.rings[0], shape.rings[1:])


def _shapely() -> Any:
    try:
        import shapely  # here: of an extra
    except ModuleNotFoundError:
        raise ConfigError(
            f"--ignore-regions: polygons need the extra regions: {install('regions')}"
        ) from None
    return shapely


def _text(value: Any) -> str:
    """A value of a table as a file has it; a list of corners as ``x y; x y``."""
    import pandas as pd  # here: files do without

    if isinstance(value, list | tuple | np.ndarray):
        return "; ".join(" ".join(str(float(part)) for part in pair) for pair in value)
    return "" if pd.isna(value) else str(value)
