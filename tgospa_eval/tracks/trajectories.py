"""Trajectories as one flat table with a row per object and step, independent of files and metric.

Attributes are further values of each state, by name: the other columns of a file. A side is the
truth or the estimate.
"""

import warnings
from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, freeze, index_type, places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError, TgospaWarning
from tgospa_eval.quoting import quoted

if TYPE_CHECKING:
    from tgospa_eval.tracks.clouds import Clouds


Values: TypeAlias = Floats | NDArray[np.object_]
"""Array of numbers (NaN if missing) or of texts (blank if missing)."""

Attributes: TypeAlias = Mapping[str, Values]
"""Values (R,) of each row, by name."""


ROW = "\0row"
"""Attribute, if requested, with the index of each row in its file."""


def file_order(step: Ints, attributes: Attributes) -> Ints:
    """Return row indices (R,) sorted by step, then by order in the file if `ROW` is given."""
    if ROW not in attributes:
        return np.arange(len(step))
    return np.lexsort((attributes[ROW], step))


def checked(attributes: Attributes, rows: int) -> dict[str, Values]:
    """Return attributes as read-only arrays of doubles or of texts, `rows` values each.

    Raises
    ------
    InputError
        An attribute has another number of values.
    """
    arrays: dict[str, Values] = {}
    for name, given in attributes.items():
        values = np.asarray(given)
        if values.shape != (rows,):
            raise InputError(
                f"attribute {quoted(name)} has the shape {values.shape}: must be ({rows},), a "
                "value for each row"
            )
        kept: Values
        if values.dtype.kind in "iuf":
            kept = np.asarray(values, np.float64)
        elif values.dtype.kind == "O" and all(isinstance(text, str) for text in values.tolist()):
            kept = values.astype(object, copy=False)
        else:
            texts = ["" if value is None else str(value) for value in values.tolist()]
            kept = np.array(texts, dtype=object)
        arrays[str(name)] = kept.view()
        arrays[str(name)].setflags(write=False)
    return arrays


def chosen(attributes: Attributes, rows: Ints) -> dict[str, Values]:
    """Return the attributes of some rows."""
    return {name: values[rows] for name, values in attributes.items()}


def stacked(first: Attributes, second: Attributes, rows: int) -> dict[str, Values]:
    """Append the values of `second` to each attribute of `first`.

    If `second` lacks an attribute, `rows` missing values are appended.
    """
    joined: dict[str, Values] = {}
    for name, values in first.items():
        missing = np.full(rows, np.nan if values.dtype.kind == "f" else "", values.dtype)
        joined[name] = np.concatenate((values, second.get(name, missing)))
    return joined


TimeArray = NDArray[np.int64] | Floats

CLOCKS = {"number": "numbers", "local": "ISO times without zone", "zoned": "ISO times with zone"}
"""Kinds of time, and what they are called in messages."""

PLACES, HEIGHT = ("lat", "lon"), "alt"
"""Names of the state columns of latitude and longitude in degrees, and of height in metres."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trajectories:
    """A set of trajectories.

    A row has the state of a trajectory at a step. If a trajectory has no row at a step, it does not
    exist there. No array has the size of all steps times all trajectories.

    Parameters
    ----------
    step, track : (R,) int32 arrays
        Index in `times` and index in `ids` of each of R rows. Rows are sorted by (step, track), and
        no such pair occurs twice. Arrays are int64 if there are too many times or ids.
    state : (R, d) float array
        Finite states, in the user's unit.
    ids : (k,) array of str
        Ids of the k trajectories, which are never interpreted.
    times : (T,) int64 or float64 array
        Strictly increasing times of the T steps: nanoseconds since 1970 unless `clock` is
        ``"number"``.
    columns : tuple of str
        Names of the d state columns.
    clock : {"number", "local", "zoned"}
        Kind of the times: numbers, ISO times without zone, or ISO times with zone.
    labels : (T,) array of str, optional
        Times as they were read, unless they are numbers.
    covariance : (R, d, d) or (R, d (d + 1) / 2) float array, optional
        Covariance of each state, in the unit of the states squared; by default states are points.
        The attribute has lower triangles, row by row: xx, xy, yy. Given matrices are checked: a
        negative eigenvalue of up to a thousandth of the largest becomes 0, with a warning. Given
        lower triangles are only checked to be finite.
    clouds : Clouds, optional
        Particles of each row, whose weighted means are the states. Covariances are not allowed
        together with clouds.
    attributes : mapping of str to (R,) array, optional
        Further values of each row, by name: numbers (NaN if missing) or texts (blank if missing).
        Readers of files read only requested columns.
    offered : tuple of str, optional
        All headers of the file, if attributes were requested.

    Raises
    ------
    InputError
        A shape does not fit, rows are not sorted or not unique, a state is not finite, or a matrix
        is not a covariance.
    """

    step: Ints
    track: Ints
    state: Floats
    ids: NDArray[np.object_]
    times: TimeArray
    columns: tuple[str, ...]
    clock: str = "number"
    labels: NDArray[np.object_] | None = None
    covariance: Floats | None = None
    clouds: "Clouds | None" = None
    attributes: Attributes = field(default_factory=dict)
    offered: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("step", "track"):
            array = np.asarray(getattr(self, name))
            if array.dtype.kind not in "iu" and len(array):
                raise InputError(f"{name} must be integers, not {array.dtype}")
            object.__setattr__(self, name, array if len(array) else array.astype(np.int32))
        object.__setattr__(self, "state", np.asarray(self.state, np.float64))
        object.__setattr__(self, "times", np.asarray(self.times))
        object.__setattr__(self, "ids", np.asarray(self.ids, dtype=object))
        self._check_states()
        if self.clouds is not None:
            self._check_clouds(self.clouds)
        if self.attributes:
            values = checked(self.attributes, len(self.step))
            object.__setattr__(self, "attributes", values)
        self._check_order()
        if self.covariance is not None:
            object.__setattr__(self, "covariance", self._packed(np.asarray(self.covariance, float)))
        for name, size in (("step", len(self.times)), ("track", len(self.ids))):
            array = np.ascontiguousarray(getattr(self, name), index_type(size))
            object.__setattr__(self, name, array)
        freeze(self)

    def _check_states(self) -> None:
        """Check names, shapes and finiteness."""
        if self.clock not in CLOCKS:
            raise InputError(f"clock is {quoted(self.clock)}: must be one of {', '.join(CLOCKS)}")
        if len(set(self.ids.tolist())) != len(self.ids):
            raise InputError("ids must be distinct")
        rows = len(self.step)
        if self.track.shape != (rows,) or self.state.shape != (rows, len(self.columns)):
            raise InputError(
                f"step {self.step.shape}, track {self.track.shape} and state {self.state.shape} "
                f"do not fit {len(self.columns)} columns; use (R,), (R,) and (R, d)"
            )
        if not np.isfinite(self.state).all():
            raise InputError("states must be finite; leave the row out where an object is absent")
        if self.covariance is not None and self.clouds is not None:
            raise InputError("states have a covariance each, or a cloud, not both")

    def _check_order(self) -> None:
        """Check that times and rows increase strictly, and that rows point into times and ids."""
        times, step, track = self.times, self.step, self.track
        if not (times[1:] > times[:-1]).all() or (len(times) == 1 and times[0] != times[0]):
            raise InputError("times must increase strictly")
        if not len(step):
            return
        later = step[1:] > step[:-1]
        later |= (step[1:] == step[:-1]) & (track[1:] > track[:-1])
        in_order = later.all()
        # Sorted steps have the smallest and the largest at their ends.
        low, high = (step[0], step[-1]) if in_order else (step.min(), step.max())
        if low < 0 or high >= len(times):
            raise InputError("a step lies outside the times")
        if track.min() < 0 or track.max() >= len(self.ids):
            raise InputError("a track lies outside the ids")
        if not in_order:
            raise InputError("rows must be sorted by (step, track), each at most once")

    def _packed(self, covariance: Floats) -> Floats:
        rows, d = self.state.shape
        if covariance.shape not in ((rows, d, d), (rows, d * (d + 1) // 2)):
            raise InputError(
                f"covariance {covariance.shape} does not fit state {self.state.shape}; "
                "use (R, d, d) or (R, d (d + 1) / 2)"
            )
        wrong = np.flatnonzero(~np.isfinite(covariance).all(axis=tuple(range(1, covariance.ndim))))
        if len(wrong):
            raise InputError(
                f"{self._covariance(wrong[0])}: not finite{more(len(wrong))}; use zeros for a "
                "state that is a point"
            )
        if covariance.ndim == 2:
            return covariance
        from tgospa_eval.tracks.covariances import from_matrices  # lazy: most states are points

        packed, notices = from_matrices(covariance, self._covariance)
        for notice in notices:
            warnings.warn(notice.sentence, TgospaWarning, stacklevel=4)
        return np.ascontiguousarray(packed.T)

    def _covariance(self, row: int) -> str:
        """Name the covariance of a row by id and time, for messages."""
        return (
            f"covariance of id {quoted(self.ids[self.track[row]])}, t {self.shown[self.step[row]]}"
        )

    def _check_clouds(self, clouds: "Clouds") -> None:
        if len(clouds) != len(self.state) or clouds.points.shape[1] != len(self.columns):
            raise InputError(
                f"{len(clouds)} clouds of {clouds.points.shape[1]} components do not fit state "
                f"{self.state.shape}"
            )
        scale = np.abs(clouds.points).max(initial=0)
        if not np.all(np.abs(self.state - clouds.means) <= 1e-9 * scale):
            raise InputError("states of clouds must be the means of their particles, clouds.means")

    def __repr__(self) -> str:
        particles = "" if self.clouds is None else f", {len(self.clouds.points)} particles"
        covariances = "" if self.covariance is None else ", with covariances"
        return (
            f"Trajectories({counted(len(self.ids), 'track')}, {counted(len(self.times), 'step')}, "
            f"{counted(len(self.step), 'row')}"
            f"{particles}, columns {','.join(self.columns)}{covariances})"
        )

    @property
    def spread(self) -> Floats | None:
        """Lower triangles (R, d (d + 1) / 2) of covariances, for clouds too; None for points."""
        if self.clouds is None:
            return self.covariance
        from tgospa_eval.tracks.covariances import pack  # lazy: points do not need it

        with np.errstate(over="ignore", invalid="ignore"):  # pictures ignore overflows
            return pack(self.clouds.covariances).T

    def dense(self) -> Floats:
        """Return states as an array (T, k, d), with NaN where a trajectory does not exist."""
        table = np.full((len(self.times), len(self.ids), len(self.columns)), np.nan)
        table[self.step, self.track] = self.state
        return table

    @property
    def shown(self) -> TimeArray | NDArray[np.object_]:
        """Times as they were read (T,)."""
        return self.times if self.labels is None else self.labels

    def chosen(
        self,
        rows: Ints,
        step: Ints | None = None,
        times: TimeArray | None = None,
        labels: NDArray[np.object_] | None = None,
        clock: str | None = None,
    ) -> "Trajectories":
        """Return the trajectories with these rows only; trajectories without rows are left out.

        `step` has the new step of each row, and `times`, `labels` and `clock` describe the new
        steps. By default steps stay the same.
        """
        if step is None or times is None:
            step, times, labels = self.step[rows], self.times, self.labels
        track = self.track[rows]
        has_rows = np.zeros(len(self.ids), bool)
        has_rows[track] = True
        if not has_rows.all():
            track = (np.cumsum(has_rows) - 1)[track]
        ids = self.ids[has_rows]
        part = object.__new__(Trajectories)  # the rows were checked before
        vars(part).update(
            vars(self),
            step=step.astype(index_type(len(times)), copy=False),
            track=track.astype(index_type(len(ids)), copy=False),
            state=self.state[rows],
            ids=ids,
            times=times,
            labels=labels,
            clock=clock or self.clock,
            covariance=None if self.covariance is None else self.covariance[rows],
            clouds=None if self.clouds is None else self.clouds.chosen(rows),
            attributes=chosen(self.attributes, rows),
        )
        freeze(part)
        return part

    @classmethod
    def of_times(
        cls,
        times: TimeArray,
        columns: tuple[str, ...],
        clock: str,
        labels: NDArray[np.object_] | None = None,
    ) -> "Trajectories":
        """Return empty trajectories: with these times, but without rows."""
        none = np.zeros(0, np.int32)
        return cls(
            step=none,
            track=none,
            state=np.zeros((0, len(columns))),
            ids=np.zeros(0, dtype=object),
            times=times,
            columns=columns,
            clock=clock,
            labels=labels,
        )

    @property
    def kind(self) -> str:
        """Kind of the states: ``"point"``, ``"gaussian"`` or ``"cloud"``."""
        if self.clouds is not None:
            return "cloud"
        return "point" if self.covariance is None else "gaussian"

    def reduced_to(self, kinds: tuple[str, ...]) -> "Trajectories":
        """Return the trajectories unchanged if their kind is in `kinds`, otherwise as points."""
        if self.kind in ("point", *kinds):
            return self
        return replace(self, covariance=None, clouds=None)

    def with_clouds(self, clouds: "Clouds") -> "Trajectories":
        """Return the same rows with other particles, and their means as states."""
        return replace(self, state=clouds.means, covariance=None, clouds=clouds)

    @classmethod
    def from_array(
        cls,
        states: Floats,
        columns: tuple[str, ...] | None = None,
        covariance: Floats | None = None,
    ) -> "Trajectories":
        """Build trajectories from an array of T times, k tracks and d columns, NaN if absent.

        Ids and times count from 0.

        Parameters
        ----------
        states : (T, k, d) array
            States, or means of Gaussians; NaN or masked if absent.
        columns : tuple of str, optional
            Names of the d columns; x, y, z by default.
        covariance : (T, k, d, d) array, optional
            Covariances; those of absent states are ignored. A single matrix (d, d) is used for all
            states.

        Raises
        ------
        InputError
            The array does not have three axes, a value is infinite, or a covariance does not fit or
            is not valid.
        """
        try:
            states = as_doubles(states)
        except (TypeError, ValueError) as error:
            raise InputError(f"an array of states holds numbers: {error}") from None
        if states.ndim != 3 or not states.shape[2]:
            raise InputError(
                "an array of states has the axes (T, k, d): steps, trajectories and state columns; "
                f"this one has the shape {states.shape}"
            )
        if np.isinf(states).any():
            step, track, _ = (int(axis[0]) for axis in np.nonzero(np.isinf(states)))
            raise InputError(f"infinite state at step {step}, track {track}; NaN means absent")
        steps, tracks, size = states.shape
        present = ~np.isnan(states[:, :, 0])
        for axis in range(1, size):
            present &= ~np.isnan(states[:, :, axis])
        rows = places_of(present.ravel())
        at = np.arange(steps, dtype=np.int64).repeat(present.sum(axis=1))
        if covariance is not None:
            covariance = np.asarray(covariance, np.float64)
            if covariance.shape not in ((*states.shape, size), (size, size)):
                raise InputError(
                    f"covariance {covariance.shape} does not fit states {states.shape}; "
                    f"use {(*states.shape, size)}, or one matrix {(size, size)}"
                )
            whole = np.broadcast_to(covariance, (*states.shape, size))
            covariance = whole[at, rows - at * tracks]
        return cls(
            step=at,
            track=rows - at * tracks,
            state=states.reshape(-1, size).take(rows, axis=0),
            ids=np.array([str(k) for k in range(tracks)], dtype=object),
            times=np.arange(steps),
            columns=column_names(size) if columns is None else columns,
            covariance=covariance,
        )


def as_doubles(values: object) -> Floats:
    """Convert numbers to doubles; masked numbers become NaN.

    Raises
    ------
    TypeError, ValueError
        A value is not a number.
    """
    if isinstance(values, np.ma.MaskedArray):
        return np.asarray(np.ma.filled(values.astype(np.float64), np.nan))
    array = np.asarray(values)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"not of type {array.dtype}")
    return array.astype(np.float64, copy=False)


def column_names(size: int) -> tuple[str, ...]:
    """Return default names of state columns: x, y, z, or x0, x1, ... for more than three."""
    return tuple("xyz"[:size]) if size <= 3 else tuple(f"x{i}" for i in range(size))
