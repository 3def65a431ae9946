"""pandas DataFrames in the long form of the CSV files."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats import Reading, ReadOptions
from tgospa_eval.formats.assemble import Numbered, Rows, assemble, number_ids
from tgospa_eval.formats.columns import Roles, find_roles
from tgospa_eval.formats.times import TimeError, Times, more, parse_times, quoted
from tgospa_eval.trajectories import Floats, Ints

if TYPE_CHECKING:
    import pandas as pd


def from_frame(
    frame: "pd.DataFrame", options: ReadOptions | None = None, name: str = "table"
) -> Reading:
    """Read a DataFrame with the columns ``id, t, x[, y[, z]]``; NaN means absent.

    Raises
    ------
    InputError
        As for files, with the position of the row (from 0) instead of a line.
    """
    options = options or ReadOptions()
    roles = find_roles([str(column) for column in frame.columns], options, name)
    return assemble(frame_rows(frame, roles, name), options, "frame")


def frame_rows(frame: "pd.DataFrame", roles: Roles, name: str) -> Rows:
    """The rows of a DataFrame; `name` begins the messages.

    Raises
    ------
    InputError
        A column has no numbers, ids or times, or an infinite one.
    """

    def where(row: int) -> str:
        return f"{name}, row {row}"

    numbers = np.empty((len(frame), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        numbers[:, k] = _numbers(
            frame.iloc[:, column], f'column "{frame.columns[column]}"', where, name
        )
    try:
        times = _times(frame.iloc[:, roles.time])
    except TimeError as error:
        header = frame.columns[roles.time]
        raise InputError(f'{where(error.row)}, column "{header}": {error}') from None
    ids, blank = _numbered(frame.iloc[:, roles.id])
    if len(blank):
        header = frame.columns[roles.id]
        raise InputError(
            f'{where(int(blank[0]))}, column "{header}": blank id{more(len(blank))}; '
            "name the object"
        )
    return Rows(
        name=name,
        roles=roles,
        ids=ids,
        times=times,
        numbers=numbers,
        where=where,
        classes=None if roles.klass is None else _numbered(frame.iloc[:, roles.klass])[0],
    )


def _numbers(
    column: "pd.Series[Any]", header: str, where: Callable[[int], str], name: str
) -> Floats:
    """Finite numbers, NaN where there is none."""
    if column.dtype.kind not in "iufO":
        raise InputError(f"{name}, {header}: {column.dtype}, not numbers; write a numeric column")
    try:
        values: Floats = column.to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError, OverflowError):
        row, value = next(
            ((k, item) for k, item in enumerate(column.tolist()) if not _is_number(item)),
            (0, column.iloc[0]),
        )
        raise InputError(
            f"{where(row)}, {header}: not a number: {quoted(str(value))}; write a numeric column"
        ) from None
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        raise InputError(
            f"{where(int(infinite[0]))}, {header}: infinite position{more(len(infinite))}; "
            "use NaN if absent"
        )
    return values


def _is_number(value: object) -> bool:
    try:
        float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return value is None
    return True


def _numbered(column: "pd.Series[Any]") -> tuple[Numbered, Ints]:
    """Distinct texts, the number of each row's, and rows that are blank."""
    import pandas as pd

    # Factorizing objects wants what can be hashed, and takes 1 for True.
    if column.dtype == object and pd.api.types.infer_dtype(column) != "string":
        texts = ["" if value is None or value != value else str(value) for value in column.tolist()]
        numbered = number_ids([text.strip() for text in texts])
        return numbered, _blank(numbered)
    code, found = pd.factorize(column)
    names = [str(name).strip() for name in found] + [""] * bool((code < 0).any())
    table, number = number_ids(names)
    numbered = table, number[code]  # -1, missing, is the last: ""
    return numbered, _blank(numbered)


def _blank(numbered: Numbered) -> Ints:
    table, number = numbered
    return np.flatnonzero(number == table.tolist().index("")) if "" in table else number[:0]


def _times(column: "pd.Series[Any]") -> Times:
    """Numbers, timestamps or texts."""
    missing = np.flatnonzero(column.isna())
    if len(missing):
        raise TimeError(
            int(missing[0]), f"blank time{more(len(missing))}; write a number or a time"
        )
    kind = column.dtype.kind
    if kind in "iu":
        if len(column) and column.max() > np.iinfo(np.int64).max:
            raise TimeError(int(column.argmax()), "a time beyond 64 bits; write smaller numbers")
        return Times(value=np.asarray(column, dtype=np.int64), clock="number", text=None)
    if kind == "f":
        value = np.asarray(column, dtype=np.float64)
        odd = np.flatnonzero(~np.isfinite(value))
        if len(odd):
            raise TimeError(int(odd[0]), "not a finite time; write a number")
        return Times(value=np.asarray(value + 0.0), clock="number", text=None)
    if kind == "M":
        moments = column.drop_duplicates().tolist()
        texts = {stamp: stamp.isoformat() for stamp in moments}
        return parse_times([texts[stamp] for stamp in column.tolist()], _floats)
    return parse_times([str(value) for value in column.tolist()], _floats)


def _floats(texts: Sequence[str]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([float(text) for text in texts], dtype=np.float64)
