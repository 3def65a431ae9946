"""FILES -> Trajectories. A member is one file here, one line in `FORMATS` and one docs page.

A reader yields `formats.assemble.Rows`, the rows before anything is left out;
`assemble` makes a `Reading` of them.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tgospa_eval.common.notices import Notice, in_python, spoken_in_python
from tgospa_eval.errors import ConfigError, TgospaWarning
from tgospa_eval.formats.filters import Moments, parse_moments, parse_region
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Floats, Ints, Trajectories

FORMATS = {
    "csv": ("tgospa_eval.formats.table", "read_table"),
    "parquet": ("tgospa_eval.formats.parquet", "read_parquet"),
    "motchallenge": ("tgospa_eval.formats.motchallenge", "read_motchallenge"),
    "kitti": ("tgospa_eval.formats.kitti", "read_kitti"),
    "npz": ("tgospa_eval.formats.npz", "read_npz"),
}
"""Module and function that read each format; imported when used."""

PACKED = ("parquet", "npz")
"""Formats whose readers know what a file unpacks to."""

ROLES = ("truth", "estimate")


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What was read from a file, and what the user should know about it.

    Parameters
    ----------
    trajectories : Trajectories
        What takes part in the evaluation.
    rows : int
        Rows of the file, the header not counted.
    notices : tuple of str
        One sentence each.
    warnings : tuple of Notice
        What was repaired.
    left_out : dict
        How many rows do not take part, by the rule or option that left them out.
    format : str
        How the file was read.
    classes : tuple of str
        Names of the classes that take part, if `ReadOptions.by_class` asks for them.
    klass : (R,) int array, optional
        Position in `classes` of each row of the trajectories.
    named : tuple of str
        Classes of all rows of the file, if they were asked for.
    lacking : dict of str to str
        Of `ReadOptions.shared` what the file lacks, and what to say if every file does.
    headers : dict of str to str
        Headers of the columns whose names are others.
    pixels : bool
        The states are centres of boxes in an image, by the rules of the format.
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
    lacking: dict[str, str] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    pixels: bool = False

    def warn(self) -> Trajectories:
        """The trajectories, with a Python warning for each of its own."""
        import warnings

        for notice in self.warnings:
            warnings.warn(in_python(notice.sentence), TgospaWarning, stacklevel=4)
        return self.trajectories

    def of_class(self, name: str) -> Trajectories:
        """The rows of one class, on the times of the whole file."""
        whole = self.trajectories
        if self.klass is None or name not in self.classes:
            rows = np.zeros(0, np.int64)
        else:
            rows = np.flatnonzero(self.klass == self.classes.index(name))
        part = whole.chosen(rows, whole.step[rows], whole.times)
        return replace(part, labels=whole.labels)


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How to read a file, and which rows of it.

    Parameters
    ----------
    columns : tuple of str, optional
        State columns in order; an item ``"name=header"`` says under which header a name is found
        (``"id=trk"``, ``"t=clock"``, ``"x=px"``). By default x, y, z as far as present, else
        lat, lon, else the centres of boxes.
    decimal : {".", ","}
        Decimal mark.
    on_duplicate : {"error", "first", "last"}
        What to do with a repeated (id, t).
    boxes : bool
        The states are the boxes themselves, left, top, width, height.
    time : str, optional
        ``"A:B"``: steps from A to B, both included; either end may be blank.
    classes : tuple of str, optional
        Rows of these classes.
    region : str, optional
        ``"x=-50:50,y=0:100"``: rows inside these ranges, ends included; either end may be blank.
    by_class : bool
        The reading says which row is of which class.
    covariance : bool
        Read covariances, if there are columns of such.
    fix_covariance : bool
        Replace what is no covariance by the nearest matrix that is.
    missing_covariance : {"error", "zero"}
        What a row with blank covariance is, where there are columns: wrong, or a point.
    clouds : bool
        A column of weights makes rows particles, also where no (id, t) is repeated.
    fault : callable, optional
        Of names of state columns and states (d, R): the first that is out of range, its column, and
        what is wrong with it.
    max_input : float, optional
        GB of memory that reading may take, 0 for any; by default 4, or what is available.
    shared : tuple of str
        Names in `columns`, or ``"class"``, that were given for several files: where one lacks the
        header, it is read by the usual names, and without a filter by class.
    option : str
        What messages call `columns`, see `formats.asked.ask`.

    Raises
    ------
    ConfigError
        A value is none of these.
    """

    columns: tuple[str, ...] | None = None
    decimal: str = "."
    on_duplicate: str = "error"
    boxes: bool = False
    time: str | None = None
    classes: tuple[str, ...] | None = None
    region: str | None = None
    by_class: bool = False
    covariance: bool = False
    fix_covariance: bool = False
    missing_covariance: str = "error"
    clouds: bool = False
    fault: Callable[[tuple[str, ...], Floats], tuple[int, str, str] | None] | None = None
    max_input: float | None = None
    shared: tuple[str, ...] = ()
    option: str = "columns"

    def __post_init__(self) -> None:
        for name in ("columns", "classes"):
            if isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} is {getattr(self, name)!r}: must be a tuple of names")
        for name, allowed in (
            ("decimal", (".", ",")),
            ("on_duplicate", ("error", "first", "last")),
            ("missing_covariance", ("error", "zero")),
        ):
            _one_of(name.replace("_", "-"), getattr(self, name), allowed)
        if self.classes is not None and not all(name.strip() for name in self.classes):
            raise ConfigError("class: a name is blank; name classes, --class car,van")
        parse_moments(self.time)
        parse_region(self.region)

    @property
    def moments(self) -> Moments | None:
        """`time`, understood."""
        return parse_moments(self.time)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """`region`, understood."""
        return parse_region(self.region)

    def filters(self) -> Iterator[tuple[str, Any]]:
        """The filters in use, by the names of their options."""
        for name, value in (("time", self.time), ("class", self.classes), ("region", self.region)):
            if value is not None:
                yield name, list(value) if isinstance(value, tuple) else value
        if self.by_class:
            yield "by", "class"

    def covariances(self) -> Iterator[tuple[str, Any]]:
        """What is done about covariances, by the names of the options."""
        if self.covariance:
            yield "fix_cov", self.fix_covariance
            yield "missing_cov", self.missing_covariance


def read(
    path: str | os.PathLike[str],
    options: ReadOptions | None = None,
    role: str = "truth",
    format: str | None = None,
) -> Reading:
    """Read a file of trajectories, with its notices.

    Parameters
    ----------
    path : path
        The file.
    options : ReadOptions, optional
        How, and which rows.
    role : {"truth", "estimate"}
        What the file is; formats of challenges mean different things by one column.
    format : str, optional
        A key of `FORMATS`; by default guessed by name and content.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is none of those allowed, or the package that reads the format is missing.
    """
    from importlib import import_module

    from tgospa_eval.formats.assemble import assemble
    from tgospa_eval.formats.guess import guess
    from tgospa_eval.formats.room import TEXT, check_room, most_bytes
    from tgospa_eval.formats.text import load

    _one_of("role", role, ROLES)
    if format is not None:
        _one_of("format", format, tuple(FORMATS))
    try:
        name = os.fsdecode(path)
    except TypeError:
        tables = "; evaluate takes DataFrames themselves" if hasattr(path, "columns") else ""
        kind = type(path).__name__
        raise ConfigError(f"path is of the type {kind}: must be a path{tables}") from None
    options = options or ReadOptions()
    data = load(name, most_bytes(options.max_input))
    chosen = format or guess(name, data)
    if chosen not in PACKED:
        size = len(data)
        check_room(name, TEXT * size, size, options.max_input, f"{size:,} bytes of text")
    module, function = FORMATS[chosen]
    reader = getattr(import_module(module), function)
    rows = reader(name, data, options, role, given=format is not None)
    del data
    reading: Reading = assemble(rows, options, chosen)
    if format is None and chosen != "csv":
        notice = f"read as {chosen}, by its name and content; --{role}-format to say otherwise"
        reading = replace(reading, notices=(notice, *reading.notices))
    return reading


@spoken_in_python()
def read_trajectories(
    path: str | os.PathLike[str],
    *,
    role: str = "truth",
    format: str | None = None,
    columns: tuple[str, ...] | None = None,
    decimal: str = ".",
    on_duplicate: str = "error",
    boxes: bool = False,
    time: str | None = None,
    classes: tuple[str, ...] | None = None,
    region: str | None = None,
    covariance: bool = True,
    fix_covariance: bool = False,
    missing_covariance: str = "error",
    clouds: bool = False,
    max_input: float | None = None,
) -> Trajectories:
    """Read a file of trajectories: CSV ``id,t,x[,y[,z]]``, Parquet, npz, MOTChallenge or KITTI.

    Rows that repeat an (id, t) are particles of one cloud if there is a column ``weight``.
    Covariances that are not quite such are told of by a warning.

    Parameters
    ----------
    path : path
        The file.
    role : {"truth", "estimate"}
        What the file is: column 7 of MOTChallenge is a flag in truth and a score in results.
    format : {"csv", "parquet", "motchallenge", "kitti", "npz"}, optional
        Guessed by name and content if not given.
    covariance : bool
        Read covariances where there are columns of such, ``cov_xx, cov_xy, cov_yy`` or ``std_x,
        std_y, rho_xy``; the distance says whether they are compared.
    columns, decimal, on_duplicate, boxes, time, classes, region
        As in `formats.ReadOptions`.
    fix_covariance, missing_covariance, clouds, max_input
        Likewise.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is none of those allowed, or the package that reads the format is missing.
    """
    options = ReadOptions(
        columns=columns,
        decimal=decimal,
        on_duplicate=on_duplicate,
        boxes=boxes,
        time=time,
        classes=classes,
        region=region,
        covariance=covariance,
        fix_covariance=fix_covariance,
        missing_covariance=missing_covariance,
        clouds=clouds,
        max_input=max_input,
    )
    return read(path, options, role, format).warn()


def _one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        options = ", ".join(f'"{item}"' for item in allowed)
        raise ConfigError(f"{name} is {quoted(value)}: must be one of {options}")
