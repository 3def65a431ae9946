"""Large and regular CSV files through the C parser of pandas.

A quick way only: whatever is not plainly right (quotes, blank lines, a row too short, a text that
is no number) is left to `tgospa_eval.formats.table`, which says what is wrong and where.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.formats.assemble import Numbered, Rows, number_ids
from tgospa_eval.formats.columns import Roles
from tgospa_eval.formats.times import EXACT, Times
from tgospa_eval.trajectories import Ints

SIZE = 4_000_000
"""Bytes from which importing pandas pays."""


def read_bulk(
    path: str, data: bytes, first: int, delimiter: str, width: int, roles: Roles, decimal: str
) -> Rows | None:
    """The rows of the file, or None if it is irregular.

    Parameters
    ----------
    path : str
        The file: pandas reads it twice as fast from there as from memory.
    data : bytes
        Its content.
    first : int
        Line of the first row.
    delimiter, decimal : str
        As found.
    width : int
        Columns of the header.
    roles : Roles
        Which column is what.
    """
    columns = _columns(roles)
    used = set(columns)
    if b'"' in data or len(used) < len(columns) or not Path(path).is_file():
        return None
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        return None
    start = 0
    for _ in range(first - 1):
        start = data.find(b"\n", start) + 1
    if start in (0, len(data)):  # a header alone
        return None
    ends = start + np.flatnonzero(np.frombuffer(data, np.uint8, offset=start) == ord("\n"))
    if not data.endswith(b"\n"):
        ends = np.append(ends, len(data))
    rows = len(ends)
    # pandas drops one empty field too many in the first row, and takes True for 1.
    if data.count(delimiter.encode(), start, ends[0]) != width - 1:
        return None
    # (One letter first: that search is ten times as fast.)
    for letter, word in ((b"u", b"rue"), (b"U", b"RUE"), (b"l", b"alse"), (b"L", b"ALSE")):
        if letter in data and word in data:
            return None
    frame = None
    if roles.id == 0:
        frame = _parse(path, first, delimiter, width, roles, decimal, "int64")
        begins = np.append(start, ends[:-1] + 1)
        if frame is not None and not _plain_integers(data, begins, frame[0], delimiter):
            frame = None
    if frame is None:
        frame = _parse(path, first, delimiter, width, roles, decimal, object)
    if frame is None or len(frame) != rows:
        return None
    # With all columns in use a row that is too long makes the parser fail, and one that is too
    # short has no last field: NaN in a number, refused below elsewhere. Else the delimiters tell.
    in_doubt = len(used) < width or any(frame[column].isna().any() for column in roles.numbers)
    if in_doubt and not is_regular(data, start, delimiter, width):
        return None
    time = frame.pop(roles.time).to_numpy()
    ids = _numbered(frame.pop(roles.id))
    classes = None if roles.klass is None else _numbered(frame.pop(roles.klass), blank=True)
    numbers = np.empty((rows, len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        numbers[:, k] = frame.pop(column).to_numpy()
    if time.dtype not in (np.int64, np.float64) or np.isinf(numbers).any():
        return None
    if time.dtype == np.float64 and not (np.abs(time) < EXACT).all():
        return None
    if ids is None or (roles.klass is not None and classes is None):
        return None
    clean = time if time.dtype == np.int64 else time + 0.0  # -0.0 is the same step as 0.0
    return Rows(
        name=path,
        roles=roles,
        ids=ids,
        times=Times(value=clean, clock="number", text=None),
        numbers=numbers,
        where=lambda row: f"{path}, line {first + row}",
        classes=classes,
    )


def _columns(roles: Roles) -> list[int]:
    """Columns to be read."""
    return [roles.id, roles.time, *roles.numbers, *([] if roles.klass is None else [roles.klass])]


def is_regular(data: bytes, start: int, delimiter: str, width: int) -> bool:
    """Whether every line from byte `start` on has `width` fields; there must be no quotes."""
    view = np.frombuffer(data, np.uint8, offset=start)
    marks = view[(view == ord(delimiter)) | (view == ord("\n"))]
    if len(view) and view[-1] != ord("\n"):
        marks = np.append(marks, np.uint8(ord("\n")))
    if len(marks) % width:
        return False
    ends = marks.reshape(-1, width) == ord("\n")
    return bool(ends[:, -1].all() and not ends[:, :-1].any())


def _plain_integers(data: bytes, begins: Ints, column: Any, delimiter: str) -> bool:
    """Whether the integers read are the very texts of the first fields: not 007, not 1.0."""
    value = column.to_numpy()
    if len(value) != len(begins) or value.min() < 0:
        return False
    digits = np.searchsorted(10 ** np.arange(1, 19), value, side="right") + 1
    view = np.frombuffer(data, np.uint8)
    ends = begins + digits
    if ends[-1] >= len(view) or not (view[ends] == ord(delimiter)).all():
        return False
    for place in range(digits.max()):
        text = view[begins[digits > place] + place]
        if not ((text >= ord("0")) & (text <= ord("9"))).all():
            return False
    return True


def _parse(
    path: str, first: int, delimiter: str, width: int, roles: Roles, decimal: str, id_type: Any
) -> Any:
    """A DataFrame with numbered columns, or None."""
    import pandas as pd  # here: small files do without it

    options: dict[str, Any] = {}
    if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1):  # newer ones always are exact
        options["float_precision"] = "round_trip"
    used = _columns(roles)
    if len(used) < width:
        options["usecols"] = used  # only then: it costs as much as the parsing
    kinds = {roles.id: id_type} | dict.fromkeys(roles.numbers, "float64")
    if roles.klass is not None:
        kinds[roles.klass] = "category"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            frame: Any = pd.read_csv(  # type: ignore[call-overload]
                path,
                skiprows=first - 1,
                sep=delimiter,
                decimal=decimal,
                header=None,
                names=list(range(width)),
                index_col=False,
                dtype=kinds,
                keep_default_na=False,
                na_values={column: ["", "nan", "NaN"] for column in roles.numbers},
                encoding="utf-8",
                compression=None,
                engine="c",
                **options,
            )
            return frame
    except (
        ValueError,
        OverflowError,
        Warning,
    ):  # ParserError and UnicodeDecodeError are ValueErrors
        return None


def _numbered(column: Any, *, blank: bool = False) -> Numbered | None:
    """Distinct texts in natural order, and the number of each row's.

    None where one is missing or, unless `blank` may be, empty.
    """
    import pandas as pd

    code, found = pd.factorize(column)
    names = [str(name).strip() for name in found]
    if len(set(names)) != len(names) or (not blank and "" in names) or (code < 0).any():
        return None
    table, number = number_ids(names)
    return table, number[code]
