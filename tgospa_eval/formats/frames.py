"""pandas DataFrames in the long form of the CSV files."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats import Reading, ReadOptions
from tgospa_eval.formats.assemble import assemble, number_ids
from tgospa_eval.formats.columns import find_roles
from tgospa_eval.formats.times import TimeError, Times, parse_times

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
    roles = find_roles([str(column) for column in frame.columns], options.columns, name)

    def where(row: int) -> str:
        return f"{name}, row {row}"

    identity = frame.iloc[:, roles.id]
    blank = np.flatnonzero(identity.isna() | (identity.astype(str).str.strip() == ""))
    if len(blank):
        raise InputError(f"{where(int(blank[0]))}: blank id; name the object")
    state = np.empty((len(frame), len(roles.state)))
    for k, column in enumerate(roles.state):
        if frame.dtypes.iloc[column].kind not in "iufO":
            what = frame.dtypes.iloc[column]
            raise InputError(f'{name}, column "{frame.columns[column]}": {what}, not numbers')
        try:
            state[:, k] = frame.iloc[:, column].to_numpy(dtype=np.float64, na_value=np.nan)
        except (TypeError, ValueError) as error:
            raise InputError(f'{name}, column "{frame.columns[column]}": {error}') from None
    infinite = np.flatnonzero(np.isinf(state).any(axis=1))
    if len(infinite):
        raise InputError(f"{where(int(infinite[0]))}: infinite position; use NaN if absent")
    try:
        times = _times(frame.iloc[:, roles.time])
    except TimeError as error:
        raise InputError(f"{where(error.row)}: {error}") from None
    trajectories, notices, left_out = assemble(
        ids=number_ids([str(value).strip() for value in identity.tolist()]),
        times=times,
        state=state,
        names=roles.names,
        on_duplicate=options.on_duplicate,
        where=where,
    )
    return Reading(
        trajectories=trajectories, rows=len(frame), notices=tuple(notices), left_out=left_out
    )


def _times(column: "pd.Series[Any]") -> Times:
    """Numbers, timestamps or texts."""
    missing = np.flatnonzero(column.isna())
    if len(missing):
        raise TimeError(int(missing[0]), "blank; write a number or a time")
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
        texts = [stamp.isoformat() for stamp in column.tolist()]
        return parse_times(texts, _floats)
    return parse_times([str(value) for value in column.tolist()], _floats)


def _floats(texts: Sequence[str]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([float(text) for text in texts], dtype=np.float64)
