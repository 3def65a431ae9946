"""Trajectories of a file, with notices and warnings about how they were read.

A side is the truth or the estimate. Regions in which estimates are not evaluated are shapes in the
plane, in an image or on the Earth.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import field, replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.words import counted, natural
from tgospa_eval.errors import ConfigError, InputError, NothingLeftError
from tgospa_eval.formats.headers import ANGLES, LENGTHS
from tgospa_eval.formats.options import ROLES, ReadOptions, class_named, is_alike
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.coverage import unsigned_zeros, whole
from tgospa_eval.tracks.trajectories import PLACES, Trajectories

BOX, CIRCLE, CAP, POLYGON, GEOJSON = "box", "circle", "cap", "polygon", "geojson"

SHAPES = {
    BOX: ("left", "top", "width", "height"),
    CIRCLE: ("x", "y", "radius"),
    CAP: (*PLACES, "radius"),
    POLYGON: ("polygon",),
}
"""Columns of each shape; the corners of a polygon of GeoJSON are x, y or lon, lat."""


FARTHEST = 1e150
"""Largest coordinate or size of a region; the area of a larger box could overflow a double."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One region.

    Parameters
    ----------
    kind : str
        One of `SHAPES`, or ``"geojson"``.
    rings : tuple of array
        For a polygon: an array (n, 2) with the n corners of its edge, then such an array for each
        hole. For other shapes: one array with the values of their columns in `SHAPES`.
    where : str
        Place in the file, for messages.
    moment : int or float, optional
        Time of the region, as in `Trajectories.times`; None means all times.

    Raises
    ------
    InputError
        The region has no area, or a number is too large.
    """

    kind: str
    rings: tuple[Floats, ...]
    where: str
    moment: int | float | None = None

    def __post_init__(self) -> None:
        if not all((np.abs(ring) <= FARTHEST).all() for ring in self.rings):
            raise InputError(f"{self.where}: a number beyond {FARTHEST:g}, or not a number")
        if self.kind in (POLYGON, GEOJSON):
            for ring in self.rings:
                if np.linalg.matrix_rank(ring - ring[0]) < 2:
                    raise InputError(
                        f"{self.where}: a polygon without area; it needs three corners or more "
                        "that are not on one line"
                    )
        else:
            sizes = dict(zip(SHAPES[self.kind], self.rings[0], strict=True))
            for name in ("width", "height", "radius"):
                if sizes.get(name, 1.0) <= 0:
                    raise InputError(
                        f"{self.where}: a {name} of {sizes[name]:g}, a region without area; it "
                        "must be > 0"
                    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Regions:
    """Regions without evaluation; each is for all steps or for one step.

    Parameters
    ----------
    shapes : tuple of Shape
        Shapes of the regions.
    clock : {"number", "local", "zoned"}
        Kind of the times of the regions: numbers, ISO times without a zone, or ISO times with a
        zone.
    name : str
        Source of the regions, for messages.
    origin : tuple of float, optional
        Latitude, longitude and height of the origin of local axes, if states are positions along
        such axes. Then circles on the Earth and GeoJSON are converted to these axes.
    """

    shapes: tuple[Shape, ...]
    clock: str = "number"
    name: str = "ignore_regions"
    origin: tuple[float, float, float] | None = None

    @property
    def sha256(self) -> str:
        """Digest of the shapes and times of the regions."""
        sha = hashlib.sha256(self.clock.encode())
        for shape in self.shapes:
            rings = [unsigned_zeros(ring).tolist() for ring in shape.rings]
            time = None if shape.moment is None else whole(np.array([shape.moment])).tolist()
            sha.update(f"{shape.kind} {time} {rings}".encode())
        return sha.hexdigest()


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """Trajectories of a file, with messages about how they were read.

    Parameters
    ----------
    trajectories : Trajectories
        Trajectories that take part in the evaluation.
    rows : int
        Number of rows of the file, without the header.
    notices : tuple of str
        Notices, one sentence each.
    warnings : tuple of Notice
        Warnings, such as about repaired data.
    left_out : dict
        Number of left-out rows, by the rule that left them out.
    format : str
        Format in which the file was read; blank for an object in memory.
    classes : tuple of str
        Names of the classes that take part, if `ReadOptions.by_class` is set.
    klass : (R,) int array, optional
        Index in `classes` of the class of each row of the trajectories.
    named : tuple of str
        Classes of all rows of the file, if classes were requested.
    missing : dict of str to str
        Columns of `ReadOptions.shared` that the file lacks, each with the message to raise if all
        files lack the column.
    headers : dict of str to str
        Header of the ids, of the times, and of each state that is a single column, by name. Empty
        for a file without headers.
    unused : tuple of str
        Headers of columns that are not used.
    centres : bool
        Whether the states are centres of boxes.
    pixels : bool
        Whether the states are centres of boxes in an image, as the format says.
    idle : tuple of str
        Headers of the states if all positions seem to be unknown. For example, they are the same in
        all rows.
    hidden : tuple of str
        Headers of unknown positions, if other columns of positions were read instead of them.
    height : str
        Header of heights or elevations that are not part of the states; blank if there are none.
    units : dict of str to str
        Units that the file states for its positions, such as ``m``, by the name of the state.
    regions : Regions, optional
        Boxes of the file that mark regions without evaluation instead of objects, if
        `ReadOptions.regions` is set.
    """

    trajectories: Trajectories
    rows: int
    notices: tuple[str, ...] = field(default=())
    warnings: tuple[Notice, ...] = ()
    left_out: dict[str, int] = field(default_factory=dict)
    format: str = "csv"
    classes: tuple[str, ...] = ()
    klass: Ints | None = None
    named: tuple[str, ...] = ()
    missing: dict[str, str] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    centres: bool = False
    pixels: bool = False
    idle: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    height: str = ""
    units: dict[str, str] = field(default_factory=dict)
    regions: Regions | None = None

    @property
    def record(self) -> dict[str, Any]:
        """Numbers of rows and format of the file, as the document of a result has them."""
        counts = {"rows": self.rows, "left_out": self.left_out}
        return counts | ({"format": self.format} if self.format else {})

    @property
    def taken(self) -> int:
        """Number of rows that take part."""
        return len(self.trajectories.step)

    def has_class(self, name: str) -> bool:
        """Return whether the file has rows of a requested class."""
        return class_named(name, self.named) is not None

    def warn(self) -> Trajectories:
        """Return the trajectories, and issue their warnings as Python warnings."""
        warn_user(self.warnings)
        return self.trajectories

    def of_class(self, name: str) -> Trajectories:
        """Return the rows of one class, with the times of the whole file."""
        whole = self.trajectories
        if self.klass is None or name not in self.classes:
            rows = np.zeros(0, np.int64)
        else:
            rows = np.flatnonzero(self.klass == self.classes.index(name))
        return whole.chosen(rows)


def classes_in(sides: Iterable[Reading]) -> list[str]:
    """Return the classes of all sides, in natural order; a blank name if there are none."""
    return sorted({name for side in sides for name in side.classes}, key=natural) or [""]


def by_place(read_by: Callable[[ReadOptions], Reading], options: ReadOptions) -> Reading:
    """Read a side; if its positions seem to be unknown, read other columns of positions.

    Positions seem to be unknown if, for example, they are the same in all rows. Such a reading has
    headers in `Reading.idle`.

    Parameters
    ----------
    read_by : callable
        Callable that receives options and reads the side.
    options : ReadOptions
        Options of reading.
    """
    reading = read_by(options)
    if not reading.idle or options.hidden:
        return reading
    fault = f"{listed(reading.idle)}: the same in all rows"
    with suppress(InputError, ConfigError):
        other = read_by(replace(options, hidden=reading.idle))
        if other.taken and not other.idle:
            place = "centres of boxes" if other.centres else listed(other.trajectories.columns)
            text = f"{fault}, so not a position: {place} are compared instead"
            return replace(other, hidden=reading.idle, notices=(text, *other.notices))
    if not (reading.trajectories.state == -1).all():  # other numbers may be positions
        return read_by(replace(options, hidden=("",))) if reading.centres else reading
    warning = Notice(
        code="no-place",
        text=f"{fault}, as if the position is unknown",
        remedy=f"name the columns of positions, {option('columns', 'x=HEADER,y=HEADER')}",
    )
    return replace(reading, warnings=(*reading.warnings, warning))


def by_one_place(
    sides: Sequence[Reading | None],
    options: Sequence[ReadOptions],
    again: Sequence[Callable[[ReadOptions], Reading] | None],
) -> list[Reading | None]:
    """Read both sides by the same columns of positions, if `by_place` changed those of a side.

    Afterwards, one side can have centres of boxes, and the other can have points. If so, a warning
    is added to the side with unknown positions.

    Parameters
    ----------
    sides : sequence of Reading or None
        Sides as they were read; None for an empty collection in memory.
    options : sequence of ReadOptions
        Options with which each side was read.
    again : sequence of callable or None
        Callable for each side that receives options and reads the side again; None if that is not
        possible.
    """
    there = [one for one in sides if one is not None]
    hidden = tuple(sorted({name for one in there for name in one.hidden}))
    if not hidden:
        return list(sides)
    answer: list[Reading | None] = []
    for one, own, read_by in zip(sides, options, again, strict=False):
        if one is not None and read_by is not None and {*hidden} > {*one.hidden}:
            with suppress(InputError, ConfigError):
                other = read_by(replace(own, hidden=hidden))
                if other.taken or not one.taken:
                    place = listed(other.trajectories.columns)
                    text = f"{place} are compared, as in the other file"
                    one = replace(other, notices=(text, *other.notices))
        answer.append(one)
    unlike = len({one.centres for one in answer if one is not None}) > 1
    warning = Notice(
        code="no-place",
        text="its positions are unknown, so centres of its boxes are compared with points of the "
        "other file",
        remedy=f"name the columns of positions, {option('truth_columns')} and "
        f"{option('estimate_columns')}",
    )
    return [
        replace(one, warnings=(*one.warnings, warning)) if one and one.hidden and unlike else one
        for one in answer
    ]


def with_heights(
    sides: Sequence[Reading | None],
    options: Sequence[ReadOptions],
    again: Sequence[Callable[[ReadOptions], Reading] | None],
    names: Sequence[str],
    *,
    local: bool,
    distance: str,
) -> list[Reading | None]:
    """Add heights to the states if both sides have heights; add a warning if only one side has.

    Parameters
    ----------
    sides, options, again : sequences
        See `by_one_place`.
    names : sequence of str
        Names of the sides in messages.
    local : bool
        Whether positions on the Earth are converted to local axes. A height then also changes the
        horizontal coordinates.
    distance : str
        Name of the distance.

    Raises
    ------
    ConfigError
        Both sides have heights, and the distance does not support heights. Or a side with heights
        cannot be read again.
    """
    there = [one for one in sides if one is not None]
    headers = [one.height for one in there]
    if len(there) < len(sides) or not any(headers):
        return list(sides)
    have = [bool(one.height) or len(one.trajectories.columns) > 2 for one in there]
    if all(have):
        check_heights(
            list(filter(None, headers)), distance, [one.trajectories.columns[:2] for one in there]
        )
    answer: list[Reading | None] = list(sides)
    for k, (one, own, read_by, name) in enumerate(zip(there, options, again, names, strict=False)):
        if one.height and (all(have) or local):
            if read_by is None:
                raise ConfigError(
                    f"{name}: {quoted(one.height)} may be heights, and it cannot be read again; "
                    "name all state columns, or leave heights out by "
                    f"{option(own.option or 'columns', ','.join(one.trajectories.columns))}"
                )
            high = read_by(replace(own, heights="use"))
            columns = one.trajectories.columns
            if high.taken < one.taken:
                without = f"{name} has {counted(one.taken - high.taken, 'row')} without heights"
                warning = left_out_heights(one.height, own, columns, without)
                return [there[0], replace(there[1], warnings=(*there[1].warnings, warning))]
            text = heights_notice(one.height, own, columns)
            answer[k] = replace(high, notices=(*high.notices, *([text] if all(have) else ())))
        elif one.height:
            without = f"{names[1 - k]} has none"
            warning = left_out_heights(one.height, own, one.trajectories.columns, without)
            answer[k] = replace(one, warnings=(*one.warnings, warning))
    return answer


def in_one_clock(sides: tuple[Reading, ...]) -> tuple[Reading, ...]:
    """Convert numeric times of one side, if the other side has ISO times with a zone.

    The numbers are converted only if they are as large as times since 1970 in some unit. A notice
    names this unit.
    """
    clocks = [side.trajectories.clock for side in sides]
    if sorted(clocks) != ["number", "zoned"] or not all(len(s.trajectories.times) for s in sides):
        return sides
    from tgospa_eval.formats.clocks import since_1970  # lazy: seldom needed

    k = clocks.index("number")
    made, unit = since_1970(sides[k].trajectories)
    if not unit:
        return sides
    text = f"times are taken as {unit} since 1970, by their size; "
    text += f"{option(f'{ROLES[k]}_time_format', unit)} says so"
    side = replace(sides[k], trajectories=made, notices=(*sides[k].notices, text))
    return (side, sides[1]) if k == 0 else (sides[0], side)


def in_one_spelling(truth: Reading, estimate: Reading) -> Reading:
    """Return the estimate with its classes spelled as in the truth, and with notices about them."""
    classes, notices, there = [], [], truth.classes
    for name in estimate.classes:
        match = class_named(name, there) or name
        is_only = sum(is_alike(match, other) for other in estimate.classes) == 1
        if match != name:
            way = "read as" if is_only else "not the same class as"
            notices.append(f"class {quoted(name)} is {way} {quoted(match)}")
        classes.append(match if is_only else name)
    own, lost = ([*filter(None, {*a} - {*b})] for a, b in ((classes, there), (there, classes)))
    warnings = estimate.warnings
    if own and lost and {*classes}.isdisjoint(there):
        text = f"its classes {listed(sorted(own))} are not in the truth, which has "
        text += listed(sorted(lost))
        remedy = f"write classes alike in both files, or leave out {option('by', 'class')}"
        warnings += (Notice(code="classes-differ", text=text, remedy=remedy),)
    elif own and lost:
        notices.append(
            f"no {listed(sorted(own))} in the truth, and no {listed(sorted(lost))} here: states of "
            "different classes are never matched"
        )
    said = (*estimate.notices, *notices)
    return replace(estimate, classes=tuple(classes), notices=said, warnings=warnings)


def check_heights(headers: Sequence[str], distance: str, columns: Sequence[Sequence[str]]) -> None:
    """Check that the distance supports heights, which both sides have under these headers.

    `columns` has the other state columns of both sides.

    Raises
    ------
    ConfigError
        The distance does not support heights.
    """
    if distance == "haversine":
        ways = [option(f"{r}_columns", ",".join(c)) for r, c in zip(ROLES, columns, strict=True)]
        raise ConfigError(
            f"both files have heights ({listed(list(dict.fromkeys(headers)))}), but "
            f"{option('distance', 'haversine')} ignores heights; use "
            f"{option('distance', 'geodesic')}, or leave heights out with {' '.join(ways)}"
        )


def heights_notice(header: str, options: ReadOptions, columns: tuple[str, ...]) -> str:
    """Return the notice that heights are compared beside these columns."""
    return (
        f"heights are compared ({header}); "
        f"{option(options.option or 'columns', ','.join(columns))} leaves them out"
    )


def left_out_heights(
    header: str, options: ReadOptions, columns: tuple[str, ...], reason: str
) -> Notice:
    """Return the warning that heights are left out, and only these columns are compared."""
    return Notice(
        code="heights-left-out",
        text=f"heights ({header}) are left out: {reason}",
        remedy=f"if heights do not count, {option(options.option or 'columns', ','.join(columns))} "
        "leaves them out without a warning",
    )


def check_units(
    sides: Sequence[Reading],
    paths: Sequence[str],
    scaled: Callable[[int, str], bool],
    *,
    metres: Sequence[str] = (),
    degrees: Sequence[str] = (),
) -> None:
    """Check that the sides state the same units; `scaled` says which columns have a factor.

    `metres` and `degrees` have an option for each side, if the options need these units.

    Raises
    ------
    ConfigError
        Two columns of the same quantity, or two lengths, have different units; or they are not in
        metres and degrees, and must be.
    """
    stated = [
        (k, name, unit, sizes[unit], sizes is LENGTHS)
        for sizes in (LENGTHS, ANGLES)
        for k, side in enumerate(sides)
        for name, unit in side.units.items()
        if unit in sizes and not scaled(k, name)
    ]
    for k, name, unit, size, is_length in stated:
        first, column, known, base, _ = next(
            one for one in stated if one[1] == name or (one[4] == is_length and one[3] and size)
        )
        other = f"{column} of {paths[first]} is in {known}"
        fixed = metres if is_length else degrees
        if fixed:
            base, known = 1.0, "m" if is_length else "degrees"
            other = f"{fixed[k]} needs {known}"
        if size == base:
            continue
        remedy = f"write {f'it in {known}' if fixed else 'both in one unit'}"
        if size and base:
            factors = [
                [
                    (n, s if (metres if of else degrees) else s / base)
                    for i, n, _, s, of in stated
                    if i == j and (of == is_length or (metres if of else degrees))
                ]
                for j in range(len(ROLES))
            ]
            given = (
                ",".join(f"{n}={f:.12g}" for n, f in one if f not in (0, 1)) for one in factors
            )
            ways = [option(f"{r}_scale", x) for r, x in zip(ROLES, given, strict=True) if x]
            remedy = f"use {' and '.join(ways)}"
        raise ConfigError(f"{paths[k]}: {name} is in {unit}, but {other}; {remedy}")


def check_classes(
    sides: Sequence[Reading],
    paths: Sequence[str],
    classes: Sequence[str] | None,
    each: Sequence[ReadOptions],
) -> None:
    """Check that the sides have rows of every requested class.

    Parameters
    ----------
    sides : sequence of Reading
        Truth and estimate.
    paths : sequence of str
        Paths of the sides.
    classes : sequence of str, optional
        Classes that are requested for both sides.
    each : sequence of ReadOptions
        Options of each side. If the classes in the options of a side differ from `classes`, they
        are requested for this side only.

    Raises
    ------
    ConfigError
        No row is of a requested class. Or it is not clear which class was requested, because names
        of classes differ only in upper and lower case.
    """
    requested = [(option("class_"), name, tuple(sides), "") for name in classes or ()]
    for path, role, side, options in zip(paths, ROLES, sides, each, strict=False):
        if options.classes != classes:
            own = options.classes or ()
            requested += [(option(f"{role}_class"), name, (side,), f" of {path}") for name in own]
    for way, name, those, of in requested:
        alike = [sorted(known for known in side.named if is_alike(name, known)) for side in those]
        mixed = any(len(names) > 1 for names in alike)
        for side, names in zip(those, alike, strict=True):
            if names and name not in names and (mixed or not side.has_class(name)):
                shown = " and ".join(map(quoted, sorted(set().union(*alike))))
                raise ConfigError(
                    f"{way} {quoted(name)}: there is {shown}; write it as in the files, by "
                    f"{option('truth_class')} and {option('estimate_class')} where they differ"
                )
        if not any(side.has_class(name) for side in those):
            there = sorted({known for side in those for known in side.named})
            shown = ", ".join(map(quoted, there[:10])) or "none"
            raise NothingLeftError(
                f"{way} {quoted(name)}: no row{of} is of that class; there are {shown}"
            )
