"""A side to `Reading`: a path by the format of its file, an object by what it is.

A reader yields `formats.rows.Rows`, the rows before anything is left out, or a DataFrame;
`formats.assemble` makes a `Reading` of them.
"""

import os
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from tgospa_eval.common.files import is_regular
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import FORMATS
from tgospa_eval.formats.objects import is_path, read_object
from tgospa_eval.formats.options import ROLES, ReadOptions, one_of
from tgospa_eval.formats.reading import Reading, by_place
from tgospa_eval.text import READER, option, spelled_for
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from tgospa_eval.formats.objects import TrajectoriesLike


def read(
    side: "TrajectoriesLike | Reading",
    options: ReadOptions | None = None,
    role: str = "truth",
    format: str | None = None,
    name: str | None = None,
    *,
    columns: tuple[str, ...] | None = None,
    mapping: Sequence[int] | None = None,
) -> Reading:
    """Read a side, a file or an object, with its notices.

    Parameters
    ----------
    side : path, Trajectories, DataFrame, array, mapping, set of tracks, or Reading
        The side; what was read before is returned.
    options : ReadOptions, optional
        How, and which rows.
    role : {"truth", "estimate"}
        What the side is; formats of challenges mean different things by one column.
    format : str, optional
        Of a file a key of `FORMATS`; by default guessed by name and content.
    name : str, optional
        What messages call an object; by default its role.
    columns : tuple of str, optional
        Of an object the state columns that the distance prescribes.
    mapping : sequence of int, optional
        Of tracks with state vectors the components to compare.

    Raises
    ------
    InputError
        The side is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is none of those allowed or not for such a side, or the package that reads the
        format is missing.
    """
    options = options or ReadOptions()
    if isinstance(side, Reading):
        return side
    if is_path(side):
        return _read_file(side, options, role, format)
    return read_object(side, options, name or role, columns, mapping)


def _read_file(
    path: str | os.PathLike[str], options: ReadOptions, role: str, format: str | None
) -> Reading:
    """Read a file, by the reader of its format."""
    from tgospa_eval.formats.assemble import assemble
    from tgospa_eval.formats.guess import file_of, folder_format, guess
    from tgospa_eval.formats.headers import has_patterns
    from tgospa_eval.formats.loading import unpacked_file
    from tgospa_eval.formats.rows import Rows

    one_of("role", role, ROLES)
    reader = None if format is None else FORMATS.chosen(format)
    try:
        name = os.fsdecode(path)
    except TypeError:
        tables = "; evaluate takes DataFrames themselves" if hasattr(path, "columns") else ""
        kind = type(path).__name__
        raise ConfigError(f"path is of the type {kind}: must be a path{tables}") from None
    file = file_of(name)
    kind = folder_format(file)
    is_folder = kind != "" and format in (None, kind)

    def load_content() -> bytes:
        return b"" if is_folder else unpacked_file(file, options.max_input)

    data = load_content()
    chosen = format or (kind if is_folder else guess(file, data))
    if format is None and chosen in WITHOUT_HEADER and "t" in options.placed:
        chosen = "csv"  # whose columns are named by place
    if chosen == "csv" and has_patterns(options):
        chosen, reader = "wide", None
    if reader is None:
        reader = FORMATS.ours(chosen) if chosen in FORMATS.own else FORMATS[chosen]
    held = [data]  # given up before rows are assembled, and read again where that is needed
    del data

    def read_by(options: ReadOptions) -> Reading:
        content = held.pop() if held else load_content()
        if not os.path.exists(file) or not is_regular(file):
            held.append(content)  # a pipe has its content once
        with FORMATS.blamed(chosen, InputError, f"{name}: "):
            rows = reader(name, content, options, role, given=format is not None)
            if not isinstance(rows, Rows):
                from tgospa_eval.formats.frames import table_rows  # lazy: pandas is slow to import

                rows = table_rows(rows, options, name)
        del content
        made: Reading = assemble(rows, options, chosen)
        return made

    reading = by_place(read_by, options)
    if format is None and chosen not in ("csv", "wide"):
        notice = (
            f"read as {chosen}, by its name and content; {option(f'{role}_format')} to say "
            "otherwise"
        )
        reading = replace(reading, notices=(notice, *reading.notices))
    return reading


WITHOUT_HEADER = ("motchallenge", "visdrone", "kitti", "tum", "yolo")
"""Formats of text that are guessed by their numbers."""


def runs_inside(path: str, max_input: float | None = None) -> list[str]:
    """Names of the sets of trajectories in a MAT file: ``X``, ``Y{1}``, ``Y{2}``, ...

    Parameters
    ----------
    path : str
        The file.
    max_input : float, optional
        As in `formats.ReadOptions`.

    Raises
    ------
    InputError
        It is no such file.
    ConfigError
        The package that reads it is missing.
    """
    from tgospa_eval.formats.loading import unpacked_file
    from tgospa_eval.formats.matlab import names_of_runs

    return names_of_runs(path, unpacked_file(path, max_input), max_input)


@spelled_for(READER)
def read_trajectories(
    path: str | os.PathLike[str],
    *,
    role: str = "truth",
    format: str | None = None,
    columns: tuple[str, ...] | None = None,
    decimal: str = ".",
    on_duplicate: str = "error",
    on_invalid: str = "error",
    boxes: bool = False,
    time: str | None = None,
    classes: tuple[str, ...] | None = None,
    region: str | None = None,
    covariance: bool = True,
    fix_covariance: bool = False,
    missing_covariance: str = "error",
    clouds: bool = False,
    attributes: tuple[str, ...] = (),
    time_offset: float = 0.0,
    time_scale: float = 1.0,
    unit_scale: float = 1.0,
    max_input: float | None = None,
    beside: tuple[str, ...] = (),
) -> Trajectories:
    """Read a file of trajectories: CSV ``id,t,x[,y[,z]]``, Parquet, MOTChallenge and others.

    Rows that repeat an (id, t) are particles of one cloud if there is a column ``weight``.
    Covariances that are not quite such get a warning.

    Parameters
    ----------
    path : path
        The file.
    role : {"truth", "estimate"}
        What the file is: column 7 of MOTChallenge is a flag in truth and a score in results.
    format : str, optional
        One of ``formats.FORMATS``, as of ``--truth-format``; guessed by name and content if not
        given.
    covariance : bool
        Read covariances where there are columns of such, ``cov_xx, cov_xy, cov_yy`` or ``std_x,
        std_y, rho_xy``; whether they are compared depends on the distance.
    attributes : tuple of str
        Headers of further columns to read into `Trajectories.attributes`, as far as they are
        there.
    time_offset, time_scale, unit_scale : float
        The stamps of the file are multiplied by `time_scale`, then `time_offset` is added, in
        seconds for ISO times, which have no scale; state columns, with covariances and particles,
        are multiplied by `unit_scale`. `time` and `region` are in the new units.
    columns, decimal, on_duplicate, on_invalid, boxes, time, classes, region
        As in `formats.ReadOptions`.
    fix_covariance, missing_covariance, clouds, max_input, beside
        Likewise.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is none of those allowed, or the package that reads the format is missing.
    """
    given = locals().copy()  # all arguments, those of `ReadOptions` by the same names
    names = [each.name for each in fields(ReadOptions) if each.name in given]
    options = ReadOptions(
        **{name: given[name] for name in names},
        conversion=Conversion(
            time_offset=time_offset, time_scale=time_scale, unit_scale=unit_scale
        ),
    )
    return _read_file(path, options, role, format).warn()
