"""Columns of numbers and ids to Trajectories: absent rows, duplicates, order."""

import re
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import InputError
from tgospa_eval.formats.times import Times, quoted
from tgospa_eval.trajectories import Floats, Ints, Trajectories


def assemble(
    *,
    ids: tuple[NDArray[np.object_], Ints],
    times: Times,
    state: Floats,
    names: tuple[str, ...],
    on_duplicate: str,
    where: Callable[[int], str],
) -> tuple[Trajectories, list[str], dict[str, int]]:
    """Trajectories of the rows of a table, notices, and how many rows were left out by what rule.

    Parameters
    ----------
    ids : tuple
        Distinct ids (k,), and the number of each row's (R,).
    times : Times
        Time of each row.
    state : (R, d) float array
        NaN in a row means that the object is absent there.
    names : tuple of str
        Names of the state columns.
    on_duplicate : {"error", "first", "last"}
        What to do with a repeated (id, t).
    where : callable
        Says where a row of the table is, for messages.

    Raises
    ------
    InputError
        An (id, t) is repeated and `on_duplicate` is ``"error"``.
    """
    notices: list[str] = []
    present = np.ones(len(state), bool)
    for column in state.T:
        present &= column == column  # NaN is not
    absent = len(present) - int(np.count_nonzero(present))
    left_out: dict[str, int] = {}
    if absent:
        left_out["absent"] = absent
        plural = "rows" if absent > 1 else "row"
        notices.append(f"{absent} {plural} with a blank or NaN position: absent at that step")

    track_ids, track = ids
    moments, step = _number_times(times.value)
    key = step.astype(np.int64) * max(len(track_ids), 1) + track
    rows, ordered = _by_key(key, np.flatnonzero(present) if absent else None)
    again = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(again):
        if on_duplicate == "error":
            raise InputError(_duplicate(rows, again, key, track_ids[track], times, where))
        drop = again + 1 if on_duplicate == "first" else again
        rows, ordered = np.delete(rows, drop), np.delete(ordered, drop)
        left_out["duplicate"] = len(again)
        verb = "rows repeat" if len(again) > 1 else "row repeats"
        notices.append(f"{len(again)} {verb} an (id, t): the {on_duplicate} one was taken")

    labels = None
    if times.text is not None:
        labels = np.empty(len(moments), dtype=object)
        labels[step[::-1]] = np.array([text.strip() for text in times.text], dtype=object)[::-1]
    # From the sorted keys: cheaper than gathering two columns from all over the table.
    step_used, track_used = np.divmod(ordered, max(len(track_ids), 1))
    has_rows = np.bincount(track_used, minlength=len(track_ids)) > 0
    used = np.flatnonzero(has_rows)
    if len(used) < len(track_ids):
        track_used = (np.cumsum(has_rows) - 1)[track_used]
    trajectories = Trajectories(
        step=step_used,
        track=track_used,
        state=state.take(rows, axis=0),
        ids=track_ids[used],
        times=cast(NDArray[np.float64], moments),
        columns=names,
        clock=times.clock,
        labels=labels,
    )
    return trajectories, notices, left_out


def _by_key(key: Ints, chosen: Ints | None) -> tuple[Ints, Ints]:
    """Rows, all or the chosen, in the order of their keys, and the sorted keys."""
    if chosen is not None:
        key = key[chosen]
    if len(key) and key.max() < 4 * len(key):  # nearly a full grid: a table is quicker than sorting
        table = np.full(int(key.max()) + 1, -1)
        table[key] = np.arange(len(key))
        ordered = np.flatnonzero(table >= 0)
        if len(ordered) == len(key):
            rows = table[ordered]
            return (rows if chosen is None else chosen[rows]), ordered
    rows = np.argsort(key, kind="stable")
    return (rows if chosen is None else chosen[rows]), key[rows]


def _number_times(value: NDArray[Any]) -> tuple[NDArray[Any], Ints]:
    """Distinct times in order, and the number of each row's."""
    if value.dtype.kind == "i" and len(value):
        low, high = int(value.min()), int(value.max())
        if high - low < 4 * len(value):  # a table is quicker than sorting
            seen = np.zeros(high - low + 1, bool)
            seen[value - low] = True
            return np.flatnonzero(seen) + low, (np.cumsum(seen) - 1)[value - low]
    moments, step = np.unique(value, return_inverse=True)
    return moments, step


def number_ids(ids: Sequence[str]) -> tuple[NDArray[np.object_], Ints]:
    """Distinct ids in natural order (2 before 10), and the number of each row's."""
    seen: dict[str, int] = {}
    number = np.array([seen.setdefault(text, len(seen)) for text in ids], np.int64)
    order = sorted(seen, key=natural)
    rank = np.empty(len(order), np.int64)
    rank[[seen[text] for text in order]] = np.arange(len(order))
    table = np.empty(len(order), dtype=object)
    table[:] = order
    return table, rank[number] if len(number) else number


def natural(text: str) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key: digits in a text compare as numbers."""
    parts = re.findall(r"[0-9]+|[^0-9]+", text)
    keys = [(0, len(p.lstrip("0")), p.lstrip("0")) if p[0].isdigit() else (1, 0, p) for p in parts]
    return keys, text


def _duplicate(
    rows: Ints,
    again: Ints,
    key: Ints,
    ids: NDArray[np.object_],
    times: Times,
    where: Callable[[int], str],
) -> str:
    """Message for the repeated row that comes first in the file."""
    second = rows[again + 1]
    k = int(np.argmin(second))
    row = int(second[k])
    first = int(rows[np.searchsorted(key[rows], key[row])])
    moment = times.text[row].strip() if times.text is not None else times.value[row].item()
    more = f" (and {len(again) - 1} more)" if len(again) > 1 else ""
    return (
        f"{where(row)}: id {quoted(ids[row])} at t {moment} was given before, "
        f"{where(first)}{more}; one row per object and step, or --on-duplicate first or last"
    )
