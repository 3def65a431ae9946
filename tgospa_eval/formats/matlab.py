"""Sets of trajectories in MAT files, as the published MATLAB code of the metric has them.

A structure with ``tVec`` (n,), the first step of each trajectory, from 1 on; ``iVec`` (n,), their
lengths; ``xState`` (d, T, n), the states by step, of which those within a trajectory count. NaN
among these is a hole, in which the target is absent.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles, find_roles
from tgospa_eval.formats.guess import file_of
from tgospa_eval.formats.mat_files import structures
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, number_ids
from tgospa_eval.formats.times import Times
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.trajectories import Floats, Ints

TRAJECTORY_FIELDS = ("tVec", "iVec", "xState")

VARIABLES = {"truth": "X", "estimate": "Y"}
"""What the published code calls its arguments: the one to take where a file has several."""


def read_mat(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a MAT file; the role chooses among several variables.

    Raises
    ------
    InputError
        The file is no MAT file, or has no set of trajectories, or several.
    ConfigError
        h5py is not installed, and the file needs it.
    """
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    found = structures(path, data, options.max_input)
    sets = {
        name: fields for name, fields in found.items() if fields.keys() >= set(TRAJECTORY_FIELDS)
    }
    name = _chosen(path, role, sets, found)
    tracks = _Tracks(f"{path}, {name}", sets[name])
    names = _names(len(tracks.state))
    asked, notices = options, []
    if options.columns is None and not options.boxes and len(names) > 3:
        asked = replace(options, columns=names)
        notices.append(
            f"states have {len(names)} components, {names[0]} to {names[-1]}, and all are "
            f"compared; of positions and velocities name the positions: --columns x=x0,y=x2"
        )
    if len(sets) > 1 and file_of(path) == path:
        other = next(other for other in sets if other != name)
        is_named = file_of(f"{path}:{other}") == path  # not where it comes by a pipe
        way = f"; {path}:{other} reads another" if is_named else ""
        notices.append(f"variable {name} of {listed(list(sets))}{way}")
    roles = find_roles(["id", "t", *names], asked, path, fixed=True)
    return tracks.rows(path, replace(roles, passed=(*roles.passed, *notices)))


def _names(size: int) -> tuple[str, ...]:
    """Names of the components of a state."""
    return tuple("xyz"[:size]) if size <= 3 else tuple(f"x{k}" for k in range(size))


def _chosen(path: str, role: str, sets: Mapping[str, object], found: Mapping[str, object]) -> str:
    """Name of the variable to read."""
    file = file_of(path)
    asked = path[len(file) + 1 :]
    if asked:
        if asked not in sets:
            there = listed(list(sets)) or "none"
            raise InputError(f"{path}: no set of trajectories {quoted(asked)} (there are: {there})")
        return asked
    if len(sets) == 1:
        return next(iter(sets))
    if not sets:
        there = f"in it: {listed(list(found))}" if found else "nothing else is in it"
        raise InputError(
            f"{path}: no structure with the fields tVec, iVec, xState ({there}); save one: "
            "tVec are the first steps, iVec the lengths, xState the states (d, T, n)"
        )
    if VARIABLES[role] in sets:
        return VARIABLES[role]
    raise InputError(
        f"{path}: {len(sets)} sets of trajectories ({listed(list(sets))}); say which, "
        f"{path}:{next(iter(sets))}"
    )


class _Tracks:
    """A set of trajectories, checked.

    Parameters
    ----------
    name : str
        Begins the messages.
    fields : dict of str to array
        Fields of the structure.
    """

    def __init__(self, name: str, fields: Mapping[str, NDArray[np.generic]]) -> None:
        self.name = name
        for field in TRAJECTORY_FIELDS:
            if fields[field].dtype.kind not in "iuf":
                raise InputError(
                    f"{name}.{field}: no real numbers; it must be a numeric array of one structure"
                )
        self.start, self.length = (self._whole(field, fields[field]) for field in ("tVec", "iVec"))
        state = fields["xState"]
        if not state.size and not len(self.start):
            state = np.zeros((state.shape[0] or 2, 0, 0))
        if state.ndim == 2:  # MATLAB drops a last dimension of 1
            state = state[:, :, None]
        sizes = f"{len(self.start)} in tVec, {len(self.length)} in iVec"
        if state.ndim != 3 or not len(self.start) == len(self.length) == state.shape[2]:
            shape = " x ".join(map(str, fields["xState"].shape))
            raise InputError(
                f"{name}: {sizes}, and xState is {shape}; it must be d x T x n for n trajectories"
            )
        self.state: NDArray[np.generic] = state
        last = self.start + self.length - 1
        wrong = np.flatnonzero((self.length > 0) & ((self.start < 1) | (last > state.shape[1])))
        if len(wrong):
            k = int(wrong[0])
            raise InputError(
                f"{name}: trajectory {k + 1} is from step {self.start[k]} to {last[k]}"
                f"{more(len(wrong))}; xState has the steps 1 to {state.shape[1]}"
            )

    def _whole(self, field: str, values: NDArray[np.generic]) -> Ints:
        """Start steps or lengths as integers."""
        numbers = values.astype(np.float64).ravel()
        if values.size and max(values.shape, default=1) != values.size:
            shape = " x ".join(map(str, values.shape))
            raise InputError(f"{self.name}.{field}: is {shape}; it must be a vector")
        wrong = np.flatnonzero(~((np.abs(numbers) < 2**31) & (numbers == np.rint(numbers))))
        if len(wrong) or (numbers < 0).any():
            k = int(wrong[0]) if len(wrong) else int(np.argmin(numbers))
            raise InputError(
                f"{self.name}.{field}: {numbers[k]:g} of trajectory {k + 1} is no step; it must be "
                "a whole number"
            )
        return numbers.astype(np.int64)

    def rows(self, path: str, roles: Roles) -> Rows:
        """A row for each trajectory and step."""
        step = np.arange(1, self.state.shape[1] + 1)[:, None]
        track, index = np.nonzero(((step >= self.start) & (step < self.start + self.length)).T)

        def where(row: int) -> str:
            return f"{self.name}, trajectory {track[row] + 1}, step {index[row] + 1}"

        def component(column: int) -> Floats:
            return np.asarray(self.state[column - 2, index, track], dtype=np.float64)

        numbers = np.empty((len(track), len(roles.numbers)), order="F")
        for k, column in enumerate(roles.numbers):
            numbers[:, k] = component(column)
        infinite = np.flatnonzero(np.isinf(numbers).any(axis=1))
        if len(infinite):
            raise InputError(
                f"{where(int(infinite[0]))}: infinite{more(len(infinite))}; use NaN if absent"
            )
        ids, number = number_ids([str(k + 1) for k in range(len(self.start))])
        return Rows(
            name=path,
            roles=roles,
            ids=(ids, number[track]),
            times=Times(value=index + 1, clock="number", text=None),
            numbers=numbers,
            where=where,
            attributes={column: component(column) for column in roles.texts},
        )
