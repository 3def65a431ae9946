"""Which column is what: headers to roles."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.columns.headers import (
    BOX,
    PREFIXES,
    WEIGHT,
    Headers,
    Mix,
    absent,
    ask,
    parse_columns,
    without_maps,
)
from tgospa_eval.formats.fields import is_number
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.existence import EXISTENCE
from tgospa_eval.tracks.trajectories import Floats

if TYPE_CHECKING:
    from tgospa_eval.formats.columns.spread import SpreadColumns


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Positions of the columns that are used.

    Parameters
    ----------
    id, time : int
        Column of the ids and of the times.
    state : tuple of Mix
        The states, in order.
    names : tuple of str
        Their names.
    klass : int, optional
        Column of the classes, if a filter asks for it.
    region : dict of str to Mix
        What the filter by region looks at.
    sizes : tuple of Mix
        Width and height where the states are boxes or their centres.
    centres : bool
        The states are the centres of boxes.
    unused : tuple of str
        Headers of all other columns.
    weight : int, optional
        Column of the weights of particles.
    attributes : dict of str to int
        Columns of the attributes that are asked for, as far as they are there.
    spread : SpreadColumns, optional
        Columns of the covariances.
    asked : bool
        Whether covariances were asked for.
    headers : tuple of str
        All headers.
    fixed : bool
        They are names of ours, for columns of a format without headers.
    passed : tuple of str
        Notices about headers that may be ids or times as well, and about the decimal mark.
    lacking : dict of str to str
        Of the columns that another file may have: those that this one lacks, and the message if
        every file does.
    """

    id: int
    time: int
    state: tuple[Mix, ...]
    names: tuple[str, ...]
    klass: int | None
    region: dict[str, Mix]
    sizes: tuple[Mix, ...]
    centres: bool
    unused: tuple[str, ...]
    weight: int | None = None
    attributes: dict[str, int] = field(default_factory=dict)
    spread: "SpreadColumns | None" = None
    asked: bool = False
    headers: tuple[str, ...] = ()
    fixed: bool = False
    passed: tuple[str, ...] = ()
    lacking: dict[str, str] = field(default_factory=dict)

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Columns that are read as numbers, those of the state first."""
        mixes = (*self.state, *self.region.values(), *self.sizes)
        columns = [column for mix in mixes for column, _ in mix]
        if self.weight is not None:
            columns.append(self.weight)
        return tuple(dict.fromkeys([*columns, *(self.spread.columns if self.spread else ())]))

    @property
    def texts(self) -> tuple[int, ...]:
        """Columns of attributes that are nothing else, and are read as texts."""
        others = {self.id, self.time, self.klass, *self.numbers}
        return tuple(sorted(set(self.attributes.values()) - others))

    @property
    def called(self) -> dict[str, str]:
        """Headers of ids, times and states that bear another name; none of a format without."""
        if self.fixed:
            return {}
        places = self._places()
        found = {name: self.headers[column] for name, column in places.items()}
        return {name: header for name, header in found.items() if header.casefold() != name}

    def _places(self) -> dict[str, int]:
        """Columns of ids, times and the states that are columns, by name."""
        states = zip(self.names, self.state, strict=True)
        single = {name: mix[0][0] for name, mix in states if len(mix) == 1}
        return {"id": self.id, "t": self.time} | single

    def notices(self, *, clouds: bool) -> Iterator[str]:
        """Columns that are passed over, and what becomes of covariances.

        `clouds`: whether rows are particles; weights are for them only, covariances are not.
        """
        for name, column in ({} if self.fixed else self._places()).items():
            if name in self.lacking:
                yield (
                    f"{name} is read from column {quoted(self.headers[column])}: it has no header "
                    "as named by --columns"
                )
        yield from self.passed
        unused = list(self.unused)
        if clouds and self.spread is not None:
            unused += [self.headers[column] for column in self.spread.columns]
        if not clouds and self.weight is not None:
            unused.append(self.headers[self.weight])
        if unused:
            folded = {name.casefold() for name in unused}
            way = ""
            if not (self.asked or clouds) and any(name.startswith(PREFIXES) for name in folded):
                entries = {name.casefold() for names in self._covariances() for name in names}
                if entries & folded:
                    way = "; --distance gaussian-wasserstein compares covariances"
            if EXISTENCE in folded:
                way += "; --existence use takes existence as probabilities"
            yield f"columns not used: {listed(unused)}{way}"
        if self.asked and self.spread is None and not clouds:
            shown = ", ".join([names[0] for names in self._covariances()[:3]])
            yield f"no columns of covariances ({shown}): its states are points"

    def _covariances(self) -> list[list[str]]:
        """Headers that the entries of the covariance may have."""
        from tgospa_eval.formats.columns.spread import spelt  # here: most states are points

        return [
            spelt(first, second, deviations=deviations)
            for deviations in (False, True)
            for k, second in enumerate(self.names)
            for first in self.names[: k + 1]
        ]

    def mixed(self, numbers: Floats, mixes: Sequence[Mix]) -> Floats:
        """Quantities (R, len(mixes)) of the `numbers` columns (R, n); a view where it can be."""
        at = {column: k for k, column in enumerate(self.numbers)}
        if list(mixes) == [((column, 1.0),) for column in self.numbers[: len(mixes)]]:
            return numbers[:, : len(mixes)]
        answer = np.zeros((len(numbers), len(mixes)), order="F")
        with np.errstate(over="ignore", invalid="ignore"):  # refused with the row, later
            for k, mix in enumerate(mixes):
                for column, factor in mix:
                    answer[:, k] += factor * numbers[:, at[column]]
        return answer


def find_roles(
    header: Sequence[str],
    options: ReadOptions,
    where: str,
    *,
    fixed: bool = False,
) -> Roles:
    """Assign roles to the headers of a table; `where` begins every message.

    `fixed` headers are those of a format, which nobody can rename.

    Raises
    ------
    InputError
        A header is blank, repeated or missing, or there is no position column.
    ConfigError
        The columns asked for cannot be understood.
    """
    names = [name.strip() for name in header]
    _check_names(names, where)
    mapped, wanted = parse_columns(options.columns)
    if options.boxes:
        other = next((name for name in wanted if name not in BOX), None)
        if other is not None:
            raise ConfigError(
                f"columns: {quoted(other)} is no part of a box; for boxes map left, top, width, "
                "height"
            )
        wanted = BOX
    headers = Headers(names, mapped, options.option, where)
    lacking = without_maps(headers, options)
    mixes = _Mixes(headers)
    identity, time = headers.find("id"), headers.find("t")
    wanted = wanted or mixes.default_states()
    found = {name: mixes.of(name, wanted) for name in wanted}
    state = tuple(mix for mix in found.values() if mix is not None)
    if identity is None or time is None or not wanted or len(state) < len(wanted):
        fault = absent(headers, (identity, time), found)
        raise InputError(f"{fault}; this format has no other" if fixed else fault)
    region = {name: mixes.of_region(name, wanted) for name in options.ranges}
    klass = _class_column(headers, options, lacking, fixed=fixed)
    spread = None
    if options.covariance:
        from tgospa_eval.formats.columns.spread import find_spread  # here: most states are points

        namings = _namings(wanted, state, headers)
        each = (find_spread(naming, headers.find, where) for naming in namings)
        spread = next(filter(None, each), None)
    weight = None if options.boxes else headers.find(WEIGHT)
    centres = not options.boxes and any(len(mix) > 1 for mix in state)
    sizes = (mixes.box["width"], mixes.box["height"]) if centres or options.boxes else ()
    used = {identity, time, klass}
    used |= {column for mix in (*state, *region.values(), *sizes) for column, _ in mix}
    if weight in used:
        weight = None
    used |= {weight, *(spread.columns if spread else ())}
    places = {name: headers.find(name) for name in options.attributes}
    attributes = {name: column for name, column in places.items() if column is not None}
    used |= set(attributes.values())
    unused = tuple(name for k, name in enumerate(names) if k not in used)
    parts = "" if "t" in headers.mapped else headers.stamp([names[time], *unused])
    if parts.startswith(quoted(names[time])):
        raise InputError(f"{headers.where}: {parts}")
    return Roles(
        id=identity,
        time=time,
        state=state,
        names=wanted,
        klass=klass,
        region=region,
        sizes=sizes,
        centres=centres,
        unused=unused,
        weight=weight,
        attributes=attributes,
        spread=spread,
        asked=options.covariance and not options.clouds,
        headers=tuple(names),
        fixed=fixed,
        passed=(*headers.passed_over("id", unused), *headers.passed_over("t", unused)),
        lacking=lacking,
    )


class _Mixes:
    """Quantities of a table: columns, or what follows from edges and sizes of boxes.

    Headers that are the very name go before aliases, and both before those looked at last.
    """

    def __init__(self, headers: Headers) -> None:
        self.headers = headers
        self.plainly = partial(headers.find, plainly=True)
        self.plain_box = _box(self.plainly)

    @cached_property
    def box(self) -> dict[str, Mix]:
        """The box also by aliases: only where it is needed, as these may be doubtful."""
        return self.plain_box or _box(self.headers.find)

    def of(self, name: str, states: Sequence[str]) -> Mix | None:
        """A quantity, beside these states: in space x is a place, not the centre of a box."""
        found = self.plainly(name)
        if found is None and name in ("x", "y", "z") and "z" in states:
            found = self.headers.find(f"loc_{name}")
        if found is None and name not in self.plain_box:
            found = self.headers.find(name)
        return self.box.get(name) if found is None else ((found, 1.0),)

    def of_region(self, name: str, states: Sequence[str]) -> Mix:
        """A quantity that the filter by region looks at."""
        mix = self.of(name, states)
        if mix is None:
            raise InputError(
                f"{self.headers.where}: no column {quoted(name)} for --region (found: "
                f"{self.headers.shown}); name one that both files have"
            )
        return mix

    def default_states(self) -> tuple[str, ...]:
        """x, y, z as far as they are there, else lat and lon, else the centres of boxes."""
        for find in (self.plainly, self.headers.find):
            places = [find(name) for name in ("x", "y", "z")]
            size = places.index(None) if None in places else 3
            if size:
                return ("x", "y", "z")[:size]
            if find("lat") is not None and find("lon") is not None:
                return ("lat", "lon")
            if self.plain_box if find is self.plainly else self.box:
                return ("x", "y")
        return ()


def _class_column(
    headers: Headers, options: ReadOptions, lacking: dict[str, str], *, fixed: bool
) -> int | None:
    """Column of the classes, if they are asked for; the message if every file lacks it."""
    if options.classes is None and not options.by_class:
        return None
    klass = headers.find("class")
    if klass is None:
        option = "--class" if options.classes is not None else options.class_for
        remedy = f"add it, or map it with {ask(headers.option, ['class=HEADER'])}"
        fault = (
            f"{headers.where}: no column class for {option} (found: {headers.shown}); "
            f"{'rows of this length have none' if fixed else remedy}"
        )
        if options.by_class or "class" not in options.shared:
            raise InputError(fault)
        lacking["class"] = fault
    return klass


def _namings(
    wanted: tuple[str, ...], state: Sequence[Mix], headers: Headers
) -> Iterator[tuple[str, ...]]:
    """What state columns are called in the names of covariances: by their headers, or as named.

    Where another column bears the name as its header, the covariance is that column's.
    """
    own = tuple(
        name if len(mix) > 1 or headers.spelt(name, name) == mix[0][0] else headers.names[mix[0][0]]
        for name, mix in zip(wanted, state, strict=True)
    )
    if own != wanted and not any(name.startswith(PREFIXES) for name in headers.mapped):
        yield own
        if any(headers.spelt(name, name) is not None for name in set(wanted) - set(own)):
            return
        if sorted(own) == sorted(wanted):
            return
    yield wanted


def _box(find: Callable[[str], int | None]) -> dict[str, Mix]:
    """Edges, sizes and centre of boxes, as far as there are columns for them."""
    box: dict[str, Mix] = {}
    for axis, begin, size, end in (
        ("x", "left", "width", "right"),
        ("y", "top", "height", "bottom"),
    ):
        first, extent, last = find(begin), find(size), find(end)
        if first is not None and extent is not None:
            box |= {axis: ((first, 1.0), (extent, 0.5)), size: ((extent, 1.0),)}
        elif first is not None and last is not None:
            box |= {axis: ((first, 0.5), (last, 0.5)), size: ((last, 1.0), (first, -1.0))}
    return box if len(box) == 4 else {}


def _check_names(names: list[str], where: str) -> None:
    """Whether these are the headers of columns that are distinct."""
    if 2 * sum(map(is_number, names)) > len(names):
        raise InputError(
            f"{where}: numbers where the header should be; begin with id,t,x,y, or name the format "
            "(--truth-format, --estimate-format)"
        )
    seen: set[str] = set()
    for k, name in enumerate(names, start=1):
        if not name:
            raise InputError(
                f"{where}: column {k} has no name in the header; name it, also if unused"
                " (pandas writes such a one but for to_csv(..., index=False))"
            )
        if name in seen:
            raise InputError(f"{where}: the header names {quoted(name)} twice; rename one")
        seen.add(name)
