"""Sets of trajectories in MAT files, as the published MATLAB code of the metric has them.

A structure with ``tVec`` (n,), the first step of each trajectory, from 1 on; ``iVec`` (n,), their
lengths; ``xState`` (d, T, n), the states by step, of which those within a trajectory count. NaN
among these is a hole, in which the target is absent. A cell may have one in each element: the runs
of a Monte Carlo study.
"""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles, find_roles
from tgospa_eval.formats.guess import file_of
from tgospa_eval.formats.mat_files import Fields, Variable, variables
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, number_ids
from tgospa_eval.formats.times import Times
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.trajectories import Floats, Ints

TRAJECTORY_FIELDS = ("tVec", "iVec", "xState")
NO_SET = "no structure with the fields tVec, iVec, xState"

VARIABLES = {"truth": "X", "estimate": "Y"}
"""What the published code calls its arguments: the one to take where a file has several."""


def read_mat(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a MAT file; the role chooses among several variables.

    Raises
    ------
    InputError
        The file is no MAT file, or has no set of trajectories, or several; or both sides would be
        the same one, and nobody asked for that.
    ConfigError
        h5py is not installed, and the file needs it.
    """
    with _sets(path, data, options.max_input) as sets:
        name = sets.chosen(path, role)
        sets.check_sides(options.beside, options.roles)
        fields, about = sets.fields(name), list(sets.notices(path, name, role))
    tracks = _Tracks(f"{path}, {name}", fields)
    names = _names(len(tracks.state))
    asked, notices = options, []
    if options.columns is None and not options.boxes and len(names) > 3:
        asked = replace(options, columns=names)
        notices.append(
            f"states have {len(names)} components, {names[0]} to {names[-1]}, and all are "
            f"compared; of positions and velocities name the positions: --columns x=x0,y=x2"
        )
    roles = find_roles(["id", "t", *names], asked, path, fixed=True)
    return tracks.rows(path, replace(roles, passed=(*roles.passed, *notices, *about)))


def names_of_runs(path: str, data: bytes, limit: float | None) -> list[str]:
    """Names of all sets of trajectories of a file: ``X``, and of a cell ``Y{1}``, ``Y{2}``, ...

    Raises
    ------
    InputError, ConfigError
        As of `read_mat`.
    """
    with _sets(path, data, limit) as sets:
        found = []
        for name, count in sets.there.items():
            if count:
                sets.fields(_element(name, count))  # a damaged file may claim any count
            found += [name] if count is None else [_element(name, k + 1) for k in range(count)]
        return found


@contextmanager
def _sets(path: str, data: bytes, limit: float | None) -> "Iterator[_Sets]":
    """The sets of trajectories of a file, to be read while the context lasts."""
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    with variables(path, data, limit) as found:
        yield _Sets(file_of(path), found)


def _names(size: int) -> tuple[str, ...]:
    """Names of the components of a state."""
    return tuple("xyz"[:size]) if size <= 3 else tuple(f"x{k}" for k in range(size))


def _element(name: str, place: int) -> str:
    """An element of a cell, as MATLAB writes it."""
    return f"{name}{{{place}}}"


class _Sets:
    """The sets of trajectories of a file: structures, and elements of cells.

    Parameters
    ----------
    file : str
        Path of the file itself.
    found : mapping of str to Variable
        What is in it.
    """

    def __init__(self, file: str, found: Mapping[str, Variable]) -> None:
        self.file, self.found = file, found
        self.there = {
            name: variable.cells
            for name, variable in found.items()
            if variable.fields >= set(TRAJECTORY_FIELDS)
        }

    def fields(self, name: str) -> Fields:
        """Fields of ``X``, or of ``Y{3}``.

        Raises
        ------
        InputError
            An element of a cell is something else.
        """
        variable, _, place = name.partition("{")
        fields = self.found[variable].read(int(place[:-1]) - 1 if place else 0)
        if not fields.keys() >= set(TRAJECTORY_FIELDS):
            raise InputError(f"{self.file}: {name} is {NO_SET}")
        return fields

    def chosen(self, path: str, role: str) -> str:
        """What to read, ``X`` or ``Y{3}``: what the path names, else what is usual for the role.

        Raises
        ------
        InputError
            There is none of this name, or there are several and none is usual.
        """
        asked = path[len(self.file) + 1 :]
        if asked:
            return self._named(path, asked)
        if not self.there:
            inside = f"in it: {listed(self.found)}" if self.found else "nothing else is in it"
            raise InputError(
                f"{path}: {NO_SET} ({inside}); save one: tVec are the first steps, iVec the "
                "lengths, xState the states (d, T, n)"
            )
        name = next(iter(self.there)) if len(self.there) == 1 else VARIABLES[role]
        if name in self.there:
            return self._one_of(path, name)
        raise InputError(
            f"{path}: {len(self.there)} sets of trajectories ({self._listed()}); say which, "
            f"{path}:{self._runs()[0]}"
        )

    def check_sides(self, paths: tuple[str, ...], roles: tuple[str, ...]) -> None:
        """Whether both sides are one set of this file, though not both are named.

        Raises
        ------
        InputError
            They are.
        """
        files = [file_of(path) for path in paths]
        if len(files) != 2 or len({*map(os.path.realpath, files)}) > 1 or not {*paths} & {*files}:
            return
        try:
            name, other = map(self.chosen, paths, roles)
        except InputError:
            return  # which is said when that side is read
        if name == other:
            others = [run for run in self._runs() if run != name] or [name]
            raise InputError(
                f"{self.file}: both sides are its variable {name}, compared with itself; in it: "
                f"{self._listed(everything=True)}; name both, {self.file}:{name} "
                f"{self.file}:{others[0]}"
            )

    def notices(self, path: str, name: str, role: str) -> Iterator[str]:
        """What is not read, where nobody said what to read."""
        usual = VARIABLES[role]
        if path != self.file:
            return
        if len(self.there) > 1:
            other = next(run for run in self._runs() if run != name)
            is_named = file_of(f"{path}:{other}") == path  # not where it comes by a pipe
            way = f"; {path}:{other} reads another" if is_named else ""
            yield f"variable {name} of {self._listed()}{way}"
        elif usual in self.found and usual not in self.there:
            yield f"variable {name}; {usual} is {NO_SET}"

    def _named(self, path: str, asked: str) -> str:
        """What the path names."""
        found = re.fullmatch(r"(\w+)(?:\{([0-9]+)\})?", asked)
        name, place = found.groups() if found else (asked, None)
        if name not in self.there:
            there = self._listed() or "none"
            raise InputError(f"{path}: no set of trajectories {quoted(asked)} (there are: {there})")
        count = self.there[name]
        if place is None:
            return self._one_of(path, name)
        if count is None:
            raise InputError(f"{path}: {name} is no cell; {self.file}:{name} reads it")
        if not 1 <= int(place) <= count:
            raise InputError(f"{path}: {name} has {counted(count, 'run')}, {self._span(name)}")
        return _element(name, int(place))

    def _one_of(self, path: str, name: str) -> str:
        """A variable, or the only run of a cell."""
        count = self.there[name]
        if count is None:
            return name
        if count == 1:
            return _element(name, 1)
        raise InputError(
            f"{path}: {name} is a cell of {counted(count, 'run')}; choose one, "
            f"{self.file}:{_element(name, 1)}, or all in a batch, {self.file}:{name}{{run}}"
        )

    def _runs(self) -> list[str]:
        """The variables, cells by their first elements."""
        return [name if count is None else _element(name, 1) for name, count in self.there.items()]

    def _span(self, name: str) -> str:
        """A variable, a cell from its first element to its last."""
        count = self.there[name]
        ends = [name] if count is None else [_element(name, k) for k in sorted({1, count})]
        return " to ".join(ends)

    def _listed(self, *, everything: bool = False) -> str:
        """The sets; on request with what is none."""
        rest = [name for name in self.found if name not in self.there] if everything else []
        others = (f"{name} (no trajectories)" for name in rest)
        return listed([*map(self._span, self.there), *others])


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
