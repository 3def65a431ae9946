"""Coverage of an evaluation: its horizon, and the states of the truth that count.

A side is the truth or the estimate. For values per step, totals are divided by the number of steps
of the horizon: the timestamps in the file of the truth, or the declared steps. Timestamps of an
estimate do not matter. Two values are comparable if their digests of the steps are equal, and their
digests of the truth, too. States that are not evaluated have a mark in an attribute of their side.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.kernels import kernels
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories
from tgospa_eval.tracks.weights import existence_of

IGNORED, EXCUSED = "ignored", "excused"
"""Names of the columns of marks: ignored states of the truth, excused states of the estimate."""

MARKED, OWN_MARKS = "marked", "marked-estimates"
MARKS: Mapping[str, str] = {MARKED: IGNORED, OWN_MARKS: EXCUSED}
"""Values of ``--ignore`` that use marks, each with its column of marks."""

NOT_COUNTED = "\0not judged"
"""Attribute that is 1 for states that are not evaluated, for whatever reason: states of the truth
are then ignored, states of the estimate excused. A column of a file cannot have this name."""

AWAY = "\0time to the nearer state"
"""Attribute of states that were interpolated across a long gap: the time to the nearer end of the
gap, in seconds or the unit of the timestamps. It is 0 for other states."""


MEANINGS: Mapping[object, bool] = {
    **dict.fromkeys((0.0, "0", "false", "no", ""), False),
    **dict.fromkeys((1.0, "1", "true", "yes"), True),
}
"""Values of a mark that are allowed, and whether they mean marked."""


def marks_of(side: Trajectories, name: str) -> Mask:
    """Return a mask (R,) of the rows that are marked in the attribute `name`.

    Without this attribute, no row is marked.

    Raises
    ------
    InputError
        A value is neither yes nor no.
    """
    given = side.attributes.get(name)
    if given is None:
        return np.zeros(len(side.step), bool)
    if given.dtype.kind == "f":
        marks = [MEANINGS.get(value) for value in np.nan_to_num(given).tolist()]
    else:
        marks = [MEANINGS.get(text.strip().lower()) for text in given.tolist()]
    is_marked, odd = (np.array([mark is kind for mark in marks], bool) for kind in (True, None))
    if odd.any():
        row = int(np.argmax(odd))
        raise InputError(
            f'column "{name}": id {quoted(side.ids[side.track[row]])} at '
            f"t = {side.shown[side.step[row]]} is {quoted(str(given[row]))}; must be 0 or 1, false "
            "or true"
        )
    return is_marked


def marked(side: Trajectories, rows: Mask) -> Trajectories:
    """Mark these rows as `NOT_COUNTED`; earlier marks stay."""
    if not rows.any():
        return side
    marks = (marks_of(side, NOT_COUNTED) | rows).astype(np.float64)
    return replace(side, attributes={**side.attributes, NOT_COUNTED: marks})


def refuse_own_marks(rules: Iterable[object], verb: str) -> None:
    """Refuse marks of estimates for a command that compares estimates with each other.

    Raises
    ------
    ConfigError
        The rules, values of ``--ignore``, include marks of estimates.
    """
    if OWN_MARKS in rules:
        raise ConfigError(
            f"{option('ignore', OWN_MARKS)}: {verb} does not take marks of estimates, or the "
            "tracker would choose what is not evaluated; mark the truth "
            f"({option('ignore', MARKED)}) or give {option('ignore_regions')}"
        )


Number = TypeVar("Number", bound=np.ndarray[Any, Any])

COVERAGE_FIELDS = ("steps", "steps_sha256", "truth_states", "truth_steps", "truth_sha256")
"""Fields of a coverage that are needed to compare two values."""


DIGESTS = ("judged.steps_sha256", "judged.truth_sha256")
"""Columns of a table of results. Two results are comparable if both columns are equal."""

LANES = np.array([[0x9E3779B97F4A7C15], [0xC2B2AE3D27D4EB4F]], np.uint64)
"""Odd factors of two independent 64-bit hashes of each row."""

DOWN, MODULUS, HASHED = np.uint64(32), 1 << 64, 1 << 14
"""In this order: bits by which a hash is shifted, modulus of sums, rows hashed at a time."""

NO_SUMS = (0,) * (1 + len(LANES))
"""Result of `row_sums` for a side without rows."""


def judge_alike() -> str:
    """Return, for messages, what the user can do to make values comparable."""
    ways = f"{option('resample')}, or with {option('steps')} or {option('grid', 'truth')}"
    return f"evaluate all on a common clock, by {ways}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Coverage:
    """Steps and truth states on which a value is evaluated.

    Parameters
    ----------
    steps : int
        Size of the horizon.
    before : (T,) int array
        Number of timestamps of the horizon before each evaluated step.
    so_far : (T,) int array
        Number of timestamps of the horizon up to and including each evaluated step.
    ends : tuple of int, float or str
        First and last timestamp of the horizon, as they were read; empty if it has none.
    steps_sha256 : str
        Digest of the timestamps of the horizon.
    truth_states : int
        Number of states of the truth that count.
    truth_steps : int
        Number of steps with a state of the truth that counts.
    truth_sha256 : str
        Digest of the states of the truth that count.
    """

    steps: int
    before: Ints
    so_far: Ints
    ends: tuple[int | float | str, ...]
    steps_sha256: str
    truth_states: int
    truth_steps: int
    truth_sha256: str

    @property
    def each(self) -> int:
        """Divisor of costs per step: the number of steps, at least 1."""
        return max(self.steps, 1)

    def row(self) -> dict[str, object]:
        """Return the record for a table: first and last timestamp are texts."""
        return {
            name: str(value) if name in ("first", "last") else value
            for name, value in self.record().items()
        }

    def record(self) -> dict[str, object]:
        """Return the record for the JSON document."""
        first, last = (self.ends[0], self.ends[-1]) if self.ends else (None, None)
        steps, *rest = ((name, getattr(self, name)) for name in COVERAGE_FIELDS)
        return dict([steps, ("first", first), ("last", last), *rest])


def judge(
    horizon: Trajectories,
    truth: Trajectories,
    sha256: str,
    *,
    states: int | None = None,
    at: int | None = None,
) -> Coverage:
    """Return the coverage of an evaluation.

    Parameters
    ----------
    horizon : Trajectories
        Trajectories with the timestamps of the horizon; their rows are not used. If they have no
        timestamps, those of `truth` are the horizon.
    truth : Trajectories
        States of the truth that count, on the evaluated steps.
    sha256 : str
        Digest of these states.
    states : int, optional
        Number of these states, if `truth` is given without its rows.
    at : int, optional
        Number of steps with such a state, if `truth` is given without its rows.
    """
    ticks = horizon.times if len(horizon.times) else truth.times
    shown = horizon.shown if len(horizon.times) else truth.shown
    return Coverage(
        steps=len(ticks),
        before=np.searchsorted(ticks, truth.times),
        so_far=np.searchsorted(ticks, truth.times, side="right"),
        ends=tuple(shown[[0, -1]].tolist()) if len(ticks) else (),
        steps_sha256=digest_of_times(ticks, truth.clock),
        truth_states=len(truth.step) if states is None else states,
        truth_steps=_distinct(truth.step) if at is None else at,
        truth_sha256=sha256,
    )


def _distinct(step: Ints) -> int:
    """Count the distinct steps of sorted rows, without np.unique, whose import is slow."""
    return int(np.count_nonzero(step[1:] != step[:-1])) + bool(len(step))


def incomparable(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a message if values have different steps or truths; a blank if they are comparable.

    Parameters
    ----------
    records : mapping of str to mapping
        Coverage of each value by its name, in the form of `Coverage.record`.
    """
    first, *rest = records.values()
    differing = [
        what
        for what, name in (("steps", "steps_sha256"), ("truth", "truth_sha256"))
        if any(other[name] != first[name] for other in rest)
    ]
    if not differing:
        return ""
    sizes = "; ".join(
        f"{name}: {counted(one['truth_states'], 'truth state')} at {_steps_of(one)}"
        for name, one in records.items()
    )
    return f"not judged on the same {' and '.join(differing)} ({sizes})"


def _steps_of(record: Mapping[str, Any]) -> str:
    """Format the number of steps with truth and the number of steps of the horizon."""
    at, horizon = record["truth_steps"], record["steps"]
    if at > horizon:
        return f"{counted(at, 'step')} (horizon: {horizon:,})"
    return f"{at:,} of {counted(horizon, 'step')}"


def coverage_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that comparisons need, from the row of a table of results."""
    return {name: row[f"judged.{name}"] for name in COVERAGE_FIELDS}


def digest_of_times(ticks: TimeArray, clock: str) -> str:
    """Return the SHA-256 digest of times."""
    sha = hashlib.sha256(clock.encode())
    _add(sha, whole(ticks))
    return sha.hexdigest()


def digest(side: Trajectories, *, existence: bool = False) -> str:
    """Return a digest of exactly the parts of a side that change the value of the metric.

    The digest covers the names of the state columns. For each row, it covers id, time, state,
    covariance or particles with their weights, and the mark `NOT_COUNTED`. With `existence`, it
    also covers the probability of existence. The side must be given as the distance uses it: as
    points, for example.

    The digest does not cover labels, other attributes, the order of the ids, and tracks and times
    without rows. A row without a mark is hashed as in a side without marks. The digest of the steps
    covers the kind of the times. The parameters record regions, weights of steps and all options.
    """
    clouds = side.clouds
    arrays = () if clouds is None else (clouds.first, clouds.points, clouds.weights)
    return digest_of_sums(side.columns, [row_sums(side, existence=existence)], arrays)


@lru_cache(4096)  # parts of a side repeat the same few ids
def _hash_of(name: str) -> bytes:
    return hashlib.sha256(name.encode("utf-8", "surrogatepass")).digest()[:16]


def row_sums(side: Trajectories, *, existence: bool = False) -> tuple[int, ...]:
    """Return the number of rows, and the two sums of their hashes modulo 2^64.

    Sums of the parts of a side add up to those of the whole side.

    The sums detect accidental differences of data. They do not resist a deliberate search for other
    data with the same sums. SHA-256 of each row would take as long as an evaluation.
    """
    marks = marks_of(side, NOT_COUNTED)
    if not marks.any():
        return _row_sums(side, existence=existence)
    evaluated, excluded = (side.chosen(np.flatnonzero(marks == kind)) for kind in (False, True))
    return _added(
        [
            _row_sums(evaluated, existence=existence),
            _row_sums(excluded, existence=existence, marked=True),
        ]
    )


def _row_sums(side: Trajectories, *, existence: bool, marked: bool = False) -> tuple[int, ...]:
    """Return `row_sums` of rows that are either all `marked` or all not marked."""
    names = b"".join([_hash_of(name) for name in side.ids.tolist()])
    ids = np.frombuffer(names, "<u8").reshape(-1, len(LANES))
    timestamps = _bits(side.times)
    tables = [side.state] if side.covariance is None else [side.state, side.covariance]
    if existence:
        tables.append(existence_of(side)[:, None])
    if marked:
        tables.append(np.ones((len(side.step), 1)))
    numbers = [unsigned_zeros(table).view(np.uint64) for table in tables]
    if kernels is not None and side.step.dtype == side.track.dtype == np.int32:
        sums = kernels.hash_rows(timestamps, ids, side.step, side.track, numbers, LANES)
        return len(side.step), *sums
    sums = [0] * len(LANES)
    for first in range(0, len(side.step), HASHED):
        rows = slice(first, first + HASHED)
        hashes = timestamps[side.step[rows]] * LANES
        columns = (column for table in numbers for column in table[rows].T)
        for column in (ids[side.track[rows]].T, *columns):
            hashes ^= hashes >> DOWN
            hashes ^= column
            hashes *= LANES
        for _ in range(2):
            hashes ^= hashes >> DOWN
            hashes *= LANES
        hashes ^= hashes >> DOWN
        sums = [old + new for old, new in zip(sums, hashes.sum(axis=1).tolist(), strict=True)]
    return len(side.step), *(total % MODULUS for total in sums)


def digest_of_sums(
    columns: tuple[str, ...],
    parts: Iterable[Sequence[int]],
    arrays: tuple[Ints | Floats, ...] = (),
) -> str:
    """Return the SHA-256 digest of a side in hexadecimal.

    Parameters
    ----------
    columns : tuple of str
        Names of the state columns.
    parts : iterable of sequence of int
        Results of `row_sums` for the parts of the side, in any order.
    arrays : tuple of arrays
        Arrays of clouds, if the side has them.
    """
    sha = hashlib.sha256(repr((list(columns), list(_added(parts)))).encode())
    for array in arrays:
        _add(sha, array)
    return sha.hexdigest()


def _added(parts: Iterable[Sequence[int]]) -> tuple[int, ...]:
    """Add the `row_sums` of all parts."""
    return tuple(sum(each) % MODULUS for each in zip(NO_SUMS, *parts, strict=True))


def unsigned_zeros(numbers: Number) -> Number:
    """Replace -0.0 by 0.0, because the two differ in their bits."""
    return numbers + 0  # type: ignore[return-value]


def _bits(times: TimeArray) -> NDArray[np.uint64]:
    """Return the 64 bits of each time; a whole number has the bits of an integer, also if float."""
    if times.dtype.kind == "i":
        return times.astype(np.int64).view(np.uint64)
    answer = times.astype(np.float64).view(np.uint64)
    fits = (np.floor(times) == times) & (np.abs(times) < 2.0**63)
    answer[fits] = times[fits].astype(np.int64).view(np.uint64)
    return answer


def whole(times: TimeArray) -> TimeArray:
    """Return times as integers if all are whole, so that 0 and 0.0 have equal digests."""
    if times.dtype.kind != "f" or not np.all((np.floor(times) == times) & (abs(times) < 2.0**63)):
        return times
    return times.astype(np.int64)


def _add(sha: Any, array: np.ndarray[Any, Any]) -> None:
    kind = "<i8" if array.dtype.kind == "i" else "<f8"
    sha.update(kind.encode())
    sha.update(np.ascontiguousarray(unsigned_zeros(array), dtype=kind).data)
