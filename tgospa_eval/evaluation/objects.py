"""What programs hold in memory, as Trajectories: arrays with times, mappings, sets of tracks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.errors import InputError
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Trajectories, as_doubles, column_names

if TYPE_CHECKING:
    from tgospa_eval.formats.times import Times
    from tgospa_eval.tracks.trajectories import TimeArray


class ArrayLike(Protocol):
    """A tensor of PyTorch or JAX, or another array: NumPy can see its numbers."""

    def __array__(self) -> "np.ndarray[Any, Any]":
        """The numbers."""


TimedArray: TypeAlias = "tuple[Sequence[object] | ArrayLike, ArrayLike]"
"""Times and states."""


def array_of(value: object, name: str) -> "np.ndarray[Any, Any]":
    """The array that NumPy sees: of a tensor without its derivative, off its device.

    Raises
    ------
    InputError
        NumPy cannot see it.
    """
    if isinstance(value, np.ndarray):
        return value
    tensor: Any = value
    for method in ("detach", "cpu"):
        tensor = getattr(tensor, method)() if hasattr(tensor, method) else tensor
    try:
        return np.asarray(tensor)
    except (TypeError, ValueError, RuntimeError) as error:
        text = " ".join(str(error).split())
        raise InputError(f"{name}: no array that NumPy can see: {text}") from None


def of_array(side: object, name: str, columns: tuple[str, ...] | None) -> Trajectories:
    """An array (T, k, d)."""
    states = array_of(side, name)
    fits = columns is not None and states.ndim == 3 and states.shape[2] == len(columns)
    try:
        return Trajectories.from_array(states, columns if fits else None)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def of_timed_array(
    side: tuple[object, ...], name: str, columns: tuple[str, ...] | None
) -> Trajectories:
    """Times and an array (T, k, d)."""
    made = of_array(side[1], name, columns)
    times = times_of(side[0], name)
    if len(times.value) != len(made.times):
        raise InputError(
            f"{name}: {len(times.value)} times and {len(made.times)} steps of the array (T, k, d); "
            "one time for each step"
        )
    if (np.diff(times.value) <= 0).any():
        raise InputError(f"{name}: times must increase strictly")
    return _timed(made, times)


def is_timed_array(side: object) -> bool:
    """Whether it is times and states."""
    return isinstance(side, tuple) and len(side) == 2 and hasattr(side[1], "__array__")


def of_mapping(
    tracks: Mapping[object, object], name: str, columns: tuple[str, ...] | None
) -> Trajectories:
    """Tracks by their ids, each an array (T, d) or a pair of times and such.

    Raises
    ------
    InputError
        Shapes do not fit, some have times and others not, or an id is there twice.
    """
    timed = {isinstance(value, tuple) for value in tracks.values()}
    if len(timed) > 1:
        raise InputError(
            f"{name}: some tracks are pairs of times and states, others are not; all or none"
        )
    moments: list[object] = []
    states: list[Floats] = []
    for key, value in tracks.items():
        where = f"{name}, track {quoted(key)}"
        if not isinstance(value, tuple):
            states.append(_states(value, where))
            continue
        if len(value) != 2:
            raise InputError(f"{where}: a tuple of {len(value)}; a pair is times and states")
        states.append(_states(value[1], where))
        own = _listed(value[0], where)
        if len(own) != len(states[-1]):
            raise InputError(f"{where}: {len(own)} times and {len(states[-1])} states")
        moments += own
    first = states[0]
    for key, found in zip(tracks, states, strict=True):
        if found.shape[1] != first.shape[1] or (timed == {False} and len(found) != len(first)):
            raise InputError(
                f"{name}: track {quoted(next(iter(tracks)))} has the shape {first.shape}, track "
                f"{quoted(key)} {found.shape}: arrays (T, d) have the same d and, unless they are "
                "pairs of times and states, the same T; NaN where a track is absent"
            )
    steps = np.tile(np.arange(len(first)), len(states))
    times = times_of(moments if timed == {True} else steps, name)
    track = np.repeat(np.arange(len(states)), [len(found) for found in states])
    at = np.arange(len(track)), track
    return from_rows(name, list(tracks), at, np.concatenate(states), times, columns)


def from_rows(
    name: str,
    ids: Sequence[object],
    at: tuple[Ints, Ints],
    states: Floats,
    times: "Times",
    columns: tuple[str, ...] | None,
) -> Trajectories:
    """Trajectories of rows in any order; those with NaN are absent, their times remain steps.

    Parameters
    ----------
    name : str
        What messages begin with.
    ids : sequence of k objects
        Texts, numbers and the like.
    at : pair of (R,) int arrays
        Positions in `times` and in `ids`.
    states : (R, d) array
        States.
    times : Times
        Every one of them is a step, and they may repeat.
    columns : tuple of str, optional
        Names of the d columns, where there are so many.

    Raises
    ------
    InputError
        A state is infinite, or an id is none, is there twice, or twice at a time.
    """
    from tgospa_eval.formats.frames import id_text  # here: as pandas
    from tgospa_eval.formats.rows import number_ids

    table, number = number_ids([id_text(value, name) for value in ids])
    if len(table) < len(ids):
        twice = next(text for k, text in enumerate(table) if (number == k).sum() > 1)
        raise InputError(f"{name}: two tracks have the id {quoted(twice)}")
    moments, of_stamp = np.unique(times.value, return_inverse=True)
    step, track = of_stamp[at[0]], number[at[1]]
    order = np.lexsort((track, step))
    again = np.flatnonzero((np.diff(step[order]) == 0) & (np.diff(track[order]) == 0))
    if len(again):
        row = order[again[0]]
        stamp = at[0][row]
        moment = times.value[stamp] if times.text is None else times.text[stamp]
        raise InputError(f"{name}: id {quoted(table[track[row]])} is there twice at t = {moment}")
    if np.isinf(states).any():
        row = int(np.flatnonzero(np.isinf(states).any(axis=1))[0])
        raise InputError(
            f"{name}, track {quoted(table[track[row]])}: infinite state; NaN means absent"
        )
    kept = order[~np.isnan(states[order]).any(axis=1)]
    size = states.shape[1]
    made = Trajectories(
        step=step[kept],
        track=track[kept],
        state=states[kept],
        ids=table,
        times=np.arange(len(moments)),
        columns=columns if columns is not None and len(columns) == size else column_names(size),
    )
    return _timed(made, times)


def _timed(made: Trajectories, times: "Times") -> Trajectories:
    """The same steps at these times, which may repeat."""
    labels = None
    moments, step = np.unique(times.value, return_inverse=True)
    if times.text is not None:
        labels = np.empty(len(moments), dtype=object)
        labels[step[::-1]] = np.array(times.text, dtype=object)[::-1]
    return replace(made, times=cast("TimeArray", moments), clock=times.clock, labels=labels)


def _listed(moments: object, where: str) -> Sequence[Any]:
    """Times one by one."""
    if isinstance(moments, (list, tuple)):
        return moments
    if hasattr(moments, "tolist") and not hasattr(moments, "dtype"):
        return list(moments.tolist())
    array = array_of(moments, f"{where}: times")
    if array.ndim != 1:
        raise InputError(f"{where}: times of shape {array.shape}; must be (T,)")
    return list(array)


def times_of(moments: object, name: str) -> "Times":
    """Numbers, datetimes or ISO texts as times.

    Raises
    ------
    InputError
        One is no time, or they are of several kinds.
    """
    import pandas as pd  # here: arrays and files do without

    from tgospa_eval.formats.frames import frame_times

    given = moments if isinstance(moments, (list, tuple)) else array_of(moments, f"{name}: times")
    if np.ndim(given) != 1:
        raise InputError(f"{name}: times of shape {np.shape(given)}; must be (T,)")
    kind = None if len(given) else np.int64
    return frame_times(pd.Series(given, name="t", dtype=kind), name)


def _states(value: object, where: str) -> Floats:
    """States of one track (T, d)."""
    found = array_of(value, where)
    if found.ndim != 2 or not found.shape[1]:
        hint = "; a table is a DataFrame, pandas.DataFrame(...)" if found.ndim == 1 else ""
        raise InputError(f"{where}: shape {found.shape}; states have the axes (T, d){hint}")
    return numbers_of(found, where)


def numbers_of(value: object, where: str) -> Floats:
    """Numbers as doubles.

    Raises
    ------
    InputError
        They are none.
    """
    try:
        return as_doubles(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: a state holds numbers: {error}") from None
