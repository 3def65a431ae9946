"""Tests whether states are in regions. For boxes, the share of their area in a region decides.

Regions come from a CSV file, a table or a GeoJSON document.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.words import install
from tgospa_eval.distances.pair_search import SearchedSide, search, starts_of_steps
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.fields import TimeError, floats, is_number, parse_times
from tgospa_eval.formats.headers import FIRST_ALIASES
from tgospa_eval.formats.loading import load, unpack
from tgospa_eval.formats.objects import as_frame, is_path
from tgospa_eval.formats.reading import BOX, CAP, CIRCLE, GEOJSON, POLYGON, SHAPES, Regions, Shape
from tgospa_eval.formats.text.lines import decode
from tgospa_eval.formats.text.small import rows_of
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.interpolation import match_times
from tgospa_eval.tracks.places import on_earth
from tgospa_eval.tracks.trajectories import PLACES, TimeArray, Trajectories

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.formats.objects import ArrowTable


RegionsLike: TypeAlias = "str | os.PathLike[str] | pd.DataFrame | ArrowTable | Mapping[str, Any]"
"""Path, table, or GeoJSON document."""

GIVEN = "ignore_regions"

HALF = 0.5 - 1e-12
"""Smallest share of the area of a box that counts as inside: a half, with room for rounding."""

ROUNDED = 2.0**-40
"""Share by which the search for overlapping boxes goes farther, because of rounding."""

PLANE, EARTH = ("x", "y"), PLACES


def as_regions(given: "RegionsLike | None", decimal: str = ".") -> Regions | None:
    """Return regions of any accepted form; `decimal` is the decimal mark in a file.

    Raises
    ------
    ConfigError
        The type is not accepted, or there are polygons and shapely is missing.
    InputError
        A region is wrong: for example, it has no area, or a polygon crosses itself.
    """
    if given is None:
        return None

    if is_path(given):
        regions = read_regions(os.fspath(given), decimal)
    elif isinstance(given, Mapping):
        regions = of_geojson(given, GIVEN)
    else:
        frame = as_frame(given, GIVEN)
        if frame is None:
            kind = type(given).__name__
            raise ConfigError(f"{GIVEN} is of the type {kind}: must be a path, a table or GeoJSON")
        rows = [[_text(value) for value in row] for row in frame.itertuples(index=False)]
        places = [GIVEN, *(f"{GIVEN}, row {row}" for row in range(len(rows)))]
        regions = of_rows([*map(str, frame.columns)], rows, places, ".", GIVEN)
    for shape in regions.shapes:
        if shape.kind in (POLYGON, GEOJSON) and not _shapely().is_valid(_polygon(shape)):
            place = _shapely().is_valid_reason(_polygon(shape)).partition("[")[2].rstrip("]")
            raise InputError(
                f"{shape.where}: edges of the polygon cross or overlap at {place or 'a hole'}; "
                "write its corners in order around it, or write two polygons"
            )
    return regions


def coverage(text: str, decimal: str = ".", *, earth: bool) -> Regions:
    """Parse ``circle=LAT,LON,RADIUS`` or ``circle=X,Y,RADIUS``, or read regions of a file.

    `earth` means that centres are latitudes and longitudes.

    Raises
    ------
    ConfigError
        The text begins with ``circle=`` but is not a circle.
    InputError
        The file is missing, or a region in it is wrong.
    """
    circle, equals, numbers = text.partition("=")
    if circle != CIRCLE or not equals:
        if not os.path.exists(text):
            raise InputError(
                f"{option('region', text)}: is neither a range, a circle nor an existing file; "
                "write x=5:10, circle=X,Y,RADIUS or the path of a file of regions"
            )
        regions = as_regions(text, decimal)
        assert regions is not None
        if not regions.shapes:
            raise InputError(
                f"{regions.name}: has no region, so no row would be left; add a region"
            )
        return regions

    row = [part.strip() for part in numbers.split(",")]
    header = SHAPES[CAP if earth else CIRCLE]
    if len(row) != len(header) or not all(map(is_number, row)):
        raise ConfigError(
            f"{option('region')} {quoted(text)}: must be circle=LAT,LON,RADIUS, in degrees and "
            "metres, or circle=X,Y,RADIUS"
        )
    return of_rows(header, [row], [option("region")] * 2, ".", option("region", text))


@np.errstate(over="ignore")  # overflow gives an infinite distance, which is right
def inside(
    regions: Regions,
    side: Trajectories,
    tolerance: float,
    name: str,
    more_than: float | None = None,
) -> Mask:
    """Return a mask of the rows that are in the regions of their step.

    A point is inside if it is in a region or on its edge. A box is inside if the regions of its
    step together cover at least half of its area. If a region is a box, too, the covered area is
    the intersection of both boxes, as in TrackEval. A box without area is never inside.

    Parameters
    ----------
    regions : Regions
        Regions that are tested.
    side : Trajectories
        Truth or estimate, whose R rows are tested.
    tolerance : float
        Difference up to which two times are one step.
    name : str
        Name of the side, for messages.
    more_than : float, optional
        If given, a box is inside if a single region covers more than this share of it.

    Raises
    ------
    InputError
        Kinds or times of regions and states do not fit each other.
    """
    boxes, earth = side.columns == SHAPES[BOX], "lat" in side.columns
    axes = [side.columns.index(c) for c in (EARTH if earth else PLANE) if c in side.columns]
    if not boxes and len(axes) < 2:
        raise InputError(
            f"{regions.name}: regions need state columns x,y, lat,lon or left,top,width,height; "
            f"{name} has {','.join(side.columns)}"
        )
    own_places = side.state[:, axes], earth
    there = own_places if regions.origin is None else (on_earth(side.state, regions.origin), True)
    largest, total = np.zeros((2, len(side.step)))
    rings = np.array([s.rings[0] if s.kind == BOX else np.zeros(4) for s in regions.shapes])
    around: list[tuple[Ints, Ints]] = []  # rows and shapes that may overlap
    for step, shapes in _placed(regions, side, tolerance, name).items():
        for rows, shape in _candidates(regions, shapes, side, step, spread=boxes):
            points, places = (
                there if regions.shapes[shape[0]].kind in (CAP, GEOJSON) else own_places
            )
            if boxes:
                of_box = regions.shapes[shape[0]].kind == BOX
                several = rings[shape] if of_box else regions.shapes[shape[0]]
                share = _shares(several, side.state[rows])
            else:
                within = _contains(regions.shapes[shape[0]], points[rows, :2], earth=places)
                share = within.astype(np.float64)
            np.maximum.at(largest, rows, share)
            np.add.at(total, rows, share)
            around.append((rows, shape))
    if more_than is not None:
        return np.asarray(largest > more_than)
    is_inside = largest >= HALF
    unsure = np.flatnonzero(~is_inside & (total >= HALF))
    if len(unsure):
        rows, shape = (np.concatenate(parts) for parts in zip(*around, strict=True))
        order = np.lexsort((shape, rows))
        rows, shape = rows[order], shape[order]
        first, last = rows.searchsorted(unsure), rows.searchsorted(unsure, "right")
        for row, low, high in zip(unsure.tolist(), first.tolist(), last.tolist(), strict=True):
            together = [regions.shapes[k] for k in shape[low:high].tolist()]
            is_inside[row] = _share_of_all(side.state[row], together) >= HALF
    return np.asarray(is_inside)


def _candidates(
    regions: Regions, shapes: Ints, side: Trajectories, step: int | None, *, spread: bool
) -> Iterator[tuple[Ints, Ints]]:
    """Yield rows, and for each row the index of a region that may overlap with it.

    The rows are those of one step, or of all steps if `step` is None. `spread` says that they are
    boxes. If a region is from a table, and in the plane or in an image, only rows with a bounding
    box near that of the region are yielded. For other regions, all rows are yielded. One yield has
    several regions only if both rows and regions are boxes.
    """
    begins = starts_of_steps(side)
    low, high = (0, len(side.step)) if step is None else begins[step : step + 2].tolist()
    plain = [k for k in shapes.tolist() if regions.shapes[k].kind not in (CAP, GEOJSON)]
    for k in np.setdiff1d(shapes, plain).tolist():
        yield np.arange(low, high), np.full(high - low, k)
    if not plain or high == low:
        return
    if "lat" in side.columns:  # bounding boxes do not help, as longitudes wrap around
        for k in plain:
            yield np.arange(low, high), np.full(high - low, k)
        return
    columns = [side.columns.index(name) for name in (SHAPES[BOX] if spread else PLANE)]
    state = side.state[low:high, columns]
    size = state[:, 2:] if spread else np.zeros_like(state)
    bounds = np.array([_bounds(regions.shapes[k]) for k in plain])
    sides, reaches = [], []
    for corner, extent in ((state[:, :2], size), (bounds[:, 0], bounds[:, 1] - bounds[:, 0])):
        axes = (corner + 0.5 * extent).T
        sides.append(
            SearchedSide(
                first=0,
                step=np.zeros(len(corner), np.int64),
                at=np.array([0, len(corner)]),
                axes=np.ascontiguousarray(axes),
            )
        )
        # Centres of boxes that touch differ by half of both sizes, so at most by the larger size.
        reaches.append(extent.T * (1 + ROUNDED) + ROUNDED * np.abs(axes) + np.finfo(float).tiny)
    of_box = np.array([regions.shapes[k].kind == BOX for k in plain])
    numbers = np.array(plain)
    rest = []
    for row, shape in search(sides[0], sides[1], (reaches[0], reaches[1]), float("inf")):
        together = of_box[shape] & spread
        if together.any():
            yield row[together] + low, numbers[shape[together]]
        rest.append((row[~together] + low, shape[~together]))
    if not rest:
        return
    rows, shape = (np.concatenate(parts) for parts in zip(*rest, strict=True))
    for k in np.unique(shape).tolist():
        own = rows[shape == k]
        yield own, np.full(len(own), numbers[k])


def _bounds(shape: Shape) -> Floats:
    """Return the lower left and upper right corner (2, 2) of a region of the plane."""
    if shape.kind == BOX:
        left, top, width, height = shape.rings[0]
        return np.array([[left, top], [left + width, top + height]])
    if shape.kind == CIRCLE:
        centre, radius = shape.rings[0][:2], shape.rings[0][2]
        return np.array([centre - radius, centre + radius])
    return np.array([shape.rings[0].min(axis=0), shape.rings[0].max(axis=0)])


def _placed(
    regions: Regions, side: Trajectories, tolerance: float, name: str
) -> dict[int | None, Ints]:
    """Return the indices of the regions of each step; the key None has regions of all steps."""
    times = cast("TimeArray", np.unique([s.moment for s in regions.shapes if s.moment is not None]))
    own = Trajectories.of_times(times, (), regions.clock)
    at, there = match_times(own, side, tolerance, (regions.name, name))
    step: dict[int | float | None, int | None] = {None: None}
    step |= dict(zip(times[there].tolist(), at[there].tolist(), strict=True))
    placed: dict[int | None, list[int]] = {}
    for number, shape in enumerate(regions.shapes):
        if shape.moment in step:
            placed.setdefault(step[shape.moment], []).append(number)
    return {where: np.array(numbers) for where, numbers in placed.items()}


def _shares(region: Shape | Floats, state: Floats) -> Floats:
    """Return the share of each box that is in a region.

    `state` (N, 4) has the boxes. `region` is one region for all, or (N, 4) with a box for each.
    """
    begin, end = state[:, :2], state[:, :2] + state[:, 2:]
    area = (end - begin).prod(axis=1)
    if isinstance(region, Shape):
        shared = _shared([region], state)
    else:
        edges = np.minimum(end, region[:, :2] + region[:, 2:]) - np.maximum(begin, region[:, :2])
        shared = np.maximum(edges, 0.0).prod(axis=1)
    share: Floats = np.divide(shared, area, out=np.zeros(len(area)), where=area > 0)
    return share


def _share_of_all(state: Floats, shapes: Sequence[Shape]) -> float:
    """Return the share of the area of one box (4,) that is in any of several regions."""
    begin, end = state[:2], state[:2] + state[2:]
    area = float((end - begin).prod())
    if any(shape.kind != BOX for shape in shapes):
        return float(_shared(shapes, state[None])[0] / area)
    boxes = np.array([shape.rings[0] for shape in shapes])
    edges = np.stack((boxes[:, :2], boxes[:, :2] + boxes[:, 2:])).clip(begin, end)  # (end, N, axis)
    edges = edges[:, (edges[0] < edges[1]).all(axis=1)]
    cuts = [np.unique(edges[:, :, axis]) for axis in (0, 1)]
    across, along = (  # which intervals between two neighbouring edges each region covers
        (edges[0, :, axis, None] <= cuts[axis][:-1]) & (cuts[axis][1:] <= edges[1, :, axis, None])
        for axis in (0, 1)
    )
    covered = (across[:, :, None] & along[:, None, :]).any(axis=0)
    return float(np.diff(cuts[0]) @ covered @ np.diff(cuts[1]) / area)


def _contains(shape: Shape, points: Floats, *, earth: bool) -> Mask:
    """Return a mask of points (N, 2) in a region or on its edge; columns are x, y or lat, lon.

    Edges of polygons on the Earth are straight lines in longitude and latitude (RFC 7946).
    """
    if shape.kind not in ((CAP, POLYGON, GEOJSON) if earth else (BOX, CIRCLE, POLYGON, GEOJSON)):
        raise InputError(
            f"{shape.where}: {','.join(SHAPES[shape.kind])} is not a region for state columns "
            f"{','.join(EARTH if earth else PLANE)}"
        )
    ring, turned = shape.rings[0], earth and shape.kind == GEOJSON
    corners = ring[None, :2] if shape.kind == CAP else np.concatenate(shape.rings)
    if earth and (abs(corners[:, ::-1] if turned else corners) > (90, 360)).any():
        order = "lon, lat" if turned else "lat lon"
        raise InputError(f"{shape.where}: a position is out of range; write {order} in degrees")
    if shape.kind == CAP:
        sides = ((points[:, axis], ring[axis]) for axis in (0, 1))
        near: Mask = Haversine().between(sides) <= ring[2]
        return near
    if shape.kind == CIRCLE:
        return np.asarray(np.hypot(*(points - ring[:2]).T) <= ring[2])
    if shape.kind == BOX:
        edges = (points >= ring[:2]) & (points <= ring[:2] + ring[2:])
        return np.asarray(edges.all(axis=1))
    shapely, polygon = _shapely(), _polygon(shape, turned=turned)
    shapely.prepare(polygon)
    x, y = points.T
    turns = (-360, 0, 360) if earth else (0,)
    return np.asarray(np.any([shapely.intersects_xy(polygon, x, y + t) for t in turns], axis=0))


def _shared(shapes: Sequence[Shape], state: Floats) -> Floats:
    """Return the area of boxes (N, 4) in several regions together, computed by shapely."""
    for shape in shapes:
        if shape.kind in (CIRCLE, CAP):
            raise InputError(
                f"{shape.where}: a circle holds points, and the states are boxes; give a box or a "
                "polygon"
            )
    shapely = _shapely()
    every = shapely.union_all([_polygon(shape) for shape in shapes])
    boxes = shapely.box(*state[:, :2].T, *(state[:, :2] + state[:, 2:]).T)
    return np.asarray(shapely.area(shapely.intersection(every, boxes)))


def _polygon(shape: Shape, *, turned: bool = False) -> Any:
    """Return a box or polygon as a shapely object; `turned` exchanges its coordinates."""
    if shape.kind == BOX:
        left, top, width, height = shape.rings[0]
        return _shapely().box(left, top, left + width, top + height)
    edge, *holes = (ring[:, ::-1] if turned else ring for ring in shape.rings)
    return _shapely().Polygon(edge, holes)


def _shapely() -> Any:
    try:
        import shapely  # lazy: the extra ``regions`` may not be installed
    except ModuleNotFoundError:
        raise ConfigError(
            f"{option('ignore_regions')}: polygons need the extra regions: {install('regions')}"
        ) from None
    return shapely


def _text(value: Any) -> str:
    """Return a value of a table as text; a list of corners becomes ``x y; x y``."""
    import pandas as pd  # lazy: only for tables

    if isinstance(value, list | tuple | np.ndarray):
        return "; ".join(" ".join(str(float(part)) for part in pair) for pair in value)
    return "" if pd.isna(value) else str(value)


NEEDED = "; or ".join(",".join(columns) for columns in SHAPES.values())
"""Sets of columns, as a text for messages; each region must have the columns of one set."""

KNOWN = {name for columns in SHAPES.values() for name in columns}


def read_regions(path: str, decimal: str = ".") -> Regions:
    """Read regions of a CSV file, delimited by comma, semicolon or tab, or of a GeoJSON file.

    Raises
    ------
    InputError
        The file is missing, has wrong columns, or has a wrong region.
    """
    data = unpack(load(path), path)
    if not data.strip():
        raise InputError(f"{path}: the file is empty; regions need a header with {NEEDED}")
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{":
        try:
            return of_geojson(json.loads(decode(data, path)), path)
        except json.JSONDecodeError as error:
            place = f"{path}, line {error.lineno}, column {error.colno}"
            raise InputError(f"{place}: not JSON: {error.msg}") from None
        except RecursionError:
            raise InputError(f"{path}: not GeoJSON: nested too deeply") from None
    lines, rows = rows_of(data, path, decimal, even=True)
    return of_rows(rows[0], rows[1:], [f"{path}, line {line}" for line in lines], decimal, path)


def of_rows(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    places: Sequence[str],
    decimal: str,
    name: str,
) -> Regions:
    """Return the regions in the rows of a table.

    `places` are names of the header and of each row, for messages.

    Raises
    ------
    InputError
        A column is unknown, or a region is wrong.
    """
    names = [text.strip().lower() for text in header]
    time = next((text for text in names if text in FIRST_ALIASES["t"]), "")
    unknown = [text for text in names if text not in {*KNOWN, time}]
    whole = any({*columns} <= {*names} for columns in SHAPES.values())
    if unknown or len({*names}) < len(names) or not whole:
        what = "columns are missing or duplicate"
        if unknown:
            what = f"column {quoted(unknown[0])} is not a column of regions"
        raise InputError(f"{places[0]}: {what}; must be {NEEDED}, and t for regions of one step")
    shapes, timestamps = [], []
    for place, row in zip(places[1:], rows, strict=True):
        cells = {key: text.strip() for key, text in zip(names, row, strict=True)}
        timestamps.append(cells.pop(time, ""))
        given = {key: text for key, text in cells.items() if text}
        kind = next((kind for kind, columns in SHAPES.items() if {*columns} == {*given}), None)
        if kind is None:
            has = listed(given) or "nothing"
            raise InputError(f"{place}: has {has}; a region has {NEEDED}")
        if kind == POLYGON:
            corners = [corner.split() for corner in given[kind].strip(" ;").split(";")]
            if any(len(corner) != 2 for corner in corners):
                raise InputError(
                    f"{place}, column {quoted(kind)}: {quoted(given[kind])}; write its corners as "
                    "x y; x y; x y"
                )
            columns, texts = [kind] * 2 * len(corners), [text for pair in corners for text in pair]
        else:
            columns, texts = list(SHAPES[kind]), [given[key] for key in SHAPES[kind]]
        for key, text in zip(columns, texts, strict=True):
            if not is_number(text, decimal):
                raise InputError(f"{place}, column {quoted(key)}: not a number: {quoted(text)}")
        numbers = floats(texts, decimal)
        ring = numbers.reshape(-1, 2) if kind == POLYGON else numbers
        shapes.append(Shape(kind=kind, rings=(ring,), where=place))
    of_time = f", column {quoted(time)}"
    return _regions(shapes, timestamps, lambda row: f"{places[1 + row]}{of_time}", decimal, name)


def of_geojson(document: Any, name: str) -> Regions:
    """Return the regions of a FeatureCollection, Feature or geometry.

    The property t of a feature is the time of its regions.

    Raises
    ------
    InputError
        A geometry is not a polygon, or is wrong.
    """
    if not isinstance(document, Mapping):
        raise InputError(f"{name}: not GeoJSON; must be a FeatureCollection of polygons")
    kind = document.get("type")
    features = document.get("features") if kind == "FeatureCollection" else [document]
    shapes, timestamps, places = [], [], []
    for k, feature in enumerate(features if isinstance(features, list) else [features]):
        where = f"{name}, feature {k}"
        whole = isinstance(feature, Mapping) and feature.get("type") == "Feature"
        geometry, known = (
            (feature.get("geometry"), feature.get("properties")) if whole else (feature, None)
        )
        moment = known.get("t") if isinstance(known, Mapping) else None
        for rings in _polygons(geometry, where):
            shapes.append(Shape(kind=GEOJSON, rings=rings, where=where))
            timestamps.append("" if moment is None else str(moment))
            places.append(f'{where}, property "t"')
    return _regions(shapes, timestamps, places.__getitem__, ".", name)


def _polygons(geometry: Any, where: str) -> list[tuple[Floats, ...]]:
    """Return the rings of each polygon of a geometry, with two numbers for each position."""
    kind = geometry.get("type") if isinstance(geometry, Mapping) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise InputError(f"{where}: {quoted(kind)} is neither a Polygon nor a MultiPolygon")
    try:
        given = geometry["coordinates"]
        return [
            tuple(np.array([(_plain(x), _plain(y)) for x, y, *_ in ring]) for ring in (*rings,))
            for rings in ([given] if kind == "Polygon" else given)
            if rings[0][2]  # raises an error if there are fewer than three corners
        ]
    except (LookupError, TypeError, ValueError, OverflowError):
        raise InputError(
            f"{where}: the coordinates of a {kind} are lists of rings of positions, such as "
            "[[[0, 0], [4, 0], [4, 3], [0, 0]]]"
        ) from None


def _plain(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)


def _regions(
    shapes: Sequence[Shape],
    timestamps: Sequence[str],
    where: Callable[[int], str],
    decimal: str,
    name: str,
) -> Regions:
    """Return these shapes as regions; a timestamp that is not blank is the time of its shape.

    `where` returns the place of a timestamp, for messages.
    """
    timed = [k for k, moment in enumerate(timestamps) if moment.strip()]
    try:
        times = parse_times([timestamps[k] for k in timed], lambda texts: floats(texts, decimal))
    except TimeError as error:
        raise InputError(f"{where(timed[error.row])}: {error}") from None
    placed = list(shapes)
    for k, moment in zip(timed, times.value.tolist(), strict=True):
        placed[k] = replace(placed[k], moment=moment)
    return Regions(shapes=tuple(placed), clock=times.clock, name=name)
