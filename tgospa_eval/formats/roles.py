"""Roles of the columns of a table, such as id, time and state, by their headers."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import field
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.fields import Coded, TimeError, is_number, read_times, reading_of
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES
from tgospa_eval.tracks.weights import EXISTENCE

if TYPE_CHECKING:
    from tgospa_eval.formats.spread import SpreadColumns
from tgospa_eval.formats.headers import (
    BOX,
    CORNERS,
    EDGES,
    FIRST_ALIASES,
    FRACTIONS,
    GROUP,
    ID_MARK,
    LENGTHS,
    OTHER_AXIS,
    PREFIXES,
    SKIPPED,
    SPREAD,
    WEIGHT,
    Headers,
    Mix,
    absent,
    ask,
    direction_of,
    has_patterns,
    objects_in,
    parse_columns,
    shared_columns,
    two_parts_of_a_stamp,
    unit_of,
    without_maps,
    words_of,
)


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Positions of the columns that are used.

    Parameters
    ----------
    id : int
        Position of the column of ids.
    time : int
        Position of the column of times.
    state : tuple of Mix
        Quantities of the state in order, each a sum of columns.
    names : tuple of str
        Names of the quantities of the state.
    second : int, optional
        Second column of the times, if a time is in two columns, such as date and time of day.
    klass : int, optional
        Column of the classes, if classes are requested.
    region : dict of str to Mix
        Quantities that the filter by region compares.
    where : dict of str to int
        Columns that filters compare, by the names that the filters use.
    sizes : tuple of Mix
        Width and height, if the states are boxes or their centres.
    centres : bool
        Whether the states are the centres of boxes.
    unused : tuple of str
        Headers of all other columns.
    weight : int, optional
        Column of the weights of particles.
    attributes : dict of str to int
        Columns of the requested attributes that the table has.
    spread : SpreadColumns, optional
        Columns of the covariances.
    headers : tuple of str
        All headers.
    fixed : bool
        Whether the format has no headers. Then the names are those of this package.
    passed : tuple of str
        Notices about other headers that may be ids or times, about comments, and about the decimal
        mark.
    missing : dict of str to str
        Names of columns that this table lacks. Each has a message, which is raised if all files
        lack the column.
    doubts : tuple of Notice
        Warnings about columns whose role is doubtful.
    more_ids : tuple of int
        Further columns, if an id consists of the texts in several columns.
    other_ids : tuple of int
        Unused columns that may be ids.
    groups : tuple of int
        Unused columns of recordings, clusters or classes; ids may restart in each of these.
    flags : tuple of int
        Unused columns that may say which rows do not count, see `FLAG`.
    halves : tuple of int
        Columns that may say north or south, and east or west, see `HALF`.
    height : str
        Header of a column that is left out: heights beside latitude and longitude, or elevation
        angles beside range and bearing.
    stated : dict of int to str
        Units below the headers, by column.
    options : ReadOptions
        Options of reading.
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
    where: dict[str, int] = field(default_factory=dict)
    spread: "SpreadColumns | None" = None
    headers: tuple[str, ...] = ()
    fixed: bool = False
    passed: tuple[str, ...] = ()
    second: int | None = None
    missing: dict[str, str] = field(default_factory=dict)
    doubts: tuple[Notice, ...] = ()
    more_ids: tuple[int, ...] = ()
    other_ids: tuple[int, ...] = ()
    groups: tuple[int, ...] = ()
    flags: tuple[int, ...] = ()
    halves: tuple[int, ...] = ()
    height: str = ""
    stated: dict[int, str] = field(default_factory=dict)
    options: ReadOptions

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Columns that are read as numbers; those of the state are first."""
        mixes = (*self.state, *self.region.values(), *self.sizes)
        columns = [column for mix in mixes for column, _ in mix]
        if self.weight is not None:
            columns.append(self.weight)
        return tuple(dict.fromkeys([*columns, *(self.spread.columns if self.spread else ())]))

    @property
    def texts(self) -> tuple[int, ...]:
        """Columns that are read as texts and have no other role."""
        return tuple(sorted((self._needed | self.doubtful) - self.known))

    @property
    def _needed(self) -> set[int]:
        """Columns of attributes and filters, and further columns of ids."""
        return {*self.attributes.values(), *self.where.values(), *self.more_ids}

    @property
    def known(self) -> set[int | None]:
        """Columns of ids, times, classes and numbers."""
        return {self.id, self.time, self.klass, *self.numbers}

    @property
    def doubtful(self) -> set[int]:
        """Columns that are read only for messages or signs, so values may be of any type."""
        other = [] if self.other_id is None else [self.other_id]
        every = {*self.groups, *self.flags, *self.halves, *self.dates, *other}
        return every - self._needed

    @property
    def dates(self) -> list[int]:
        """Columns of dates that are not used. If times are times of day, they may lack the date."""
        names = [*map(str.casefold, self.headers)] if self.second is None else []
        return [k for k, name in enumerate(names) if DATE.fullmatch(name) and k not in self.known]

    def dated(self, texts: Sequence[Coded], decimal: str, row: int) -> str:
        """Return the message that a time of day can be read with its date; blank if it cannot.

        `texts` has the column of dates and the column of times, or only the latter if the table has
        no dates. The time of day is in the row `row`.
        """
        if len(texts) < 2:
            return ""
        date, time = texts
        also = ""
        try:
            read_times(date, decimal, self.options.form, time)
        except TimeError:
            also = reading_of(f"{date[row].strip()} {time[row].strip()}")
            if not also:
                return ""
        both = "+".join(self.headers[k] for k in (self.dates[0], self.time))
        way = ask(self.options.option, [f"t={both}"])
        also = also and f"; {also}"
        return f"a time of day: {quoted(time[row])}; {way} reads it with its date{also}"

    @property
    def other_id(self) -> int | None:
        """First unused column that may be ids, to compare with a column ``id``.

        It is None if the ids are not in a column ``id``, or if the user named the column of ids.
        """
        named = any(item.partition("=")[0].strip() == "id" for item in self.options.columns or ())
        plain = self.headers[self.id].casefold() == "id" and not (named or self.more_ids)
        return next(iter(self.other_ids), None) if plain else None

    @property
    def used(self) -> list[int]:
        """All columns that are read, in the order of the table."""
        single = {self.id, self.time, self.second, self.klass}
        return sorted({k for k in single if k is not None} | {*self.numbers, *self.texts})

    @property
    def digits(self) -> int:
        """Number of digits of the column `second` if it has fractions of a second: 3 for ms.

        It is 0 if there is no such column, or if its header does not say the unit.
        """
        return (
            0 if self.second is None else FRACTIONS.get(words_of(self.headers[self.second])[-1], 0)
        )

    @property
    def units(self) -> dict[str, str]:
        """Units in the headers of states, or in a line below the headers; by name of the state."""
        columns = zip(self.names, (mix[0][0] for mix in self.state), strict=True)
        units = {n: self.stated.get(k) or unit_of(self.headers[k]) for n, k in columns}
        return {} if self.fixed else {name: unit for name, unit in units.items() if unit}

    @property
    def named(self) -> dict[str, str]:
        """Headers of the ids, of the times, and of each state that is a single column; by name.

        The result is empty if the headers are `fixed`.
        """
        if self.fixed:
            return {}
        states = zip(self.names, self.state, strict=True)
        single = {name: mix[0][0] for name, mix in states if len(mix) == 1}
        places = {"id": self.id, "t": self.time} | single
        return {name: self.headers[column] for name, column in places.items()}

    def notices(self, *, clouds: bool) -> Iterator[str]:
        """Yield notices about columns that are not used, and about covariances.

        `clouds` says whether rows are particles. Particles use weights but not covariances, and
        other rows use covariances but not weights.
        """
        for name, header in self.named.items():
            if name in self.missing:
                yield (
                    f"{name} is read from column {quoted(header)}: there is no header as named by "
                    f"{option('columns')}"
                )
        yield from self.passed
        wants_covariance = self.options.covariance and not self.options.clouds
        unused = list(self.unused)
        if clouds and self.spread is not None:
            unused += [self.headers[column] for column in self.spread.columns]
        if not clouds and self.weight is not None:
            unused.append(self.headers[self.weight])
        if unused:
            folded = {name.casefold() for name in unused}
            way = ""
            if not (wants_covariance or clouds) and any(map(SPREAD.fullmatch, folded)):
                way = (
                    f"; {option('distance', 'gaussian-wasserstein')} compares covariances; see "
                    f"also {option('with_', 'nees')}"
                )
            if EXISTENCE in folded:
                way += f"; {option('existence', 'use')} takes existence as probabilities"
            yield f"columns not used: {listed(unused)}{way}"
        if self.spread is not None and not clouds:
            read = [self.headers[column] for column in self.spread.columns]
            deviations = [n for n in read if n.casefold().startswith(("var_", "sigma_"))]
            if self.spread.is_unusual or deviations:
                what = "standard deviations" if self.spread.deviations else "covariances"
                yield f"{what} are read from {listed(read)}"
        if wants_covariance and self.spread is None and not clouds:
            from tgospa_eval.formats.spread import entries  # lazy: most states are points

            labels = [label for _, _, label in entries(self.names)]
            text = f"no columns of covariances ({', '.join(labels[:3])}): its states are points"
            if any(map(SPREAD.fullmatch, unused)):
                items = [f"{label}=HEADER" for label in labels[:3]]
                proposal = ask(self.options.option, items)
                text += f"; if other columns are covariances, map them with {proposal}"
            yield text

    def mixed(self, numbers: Floats, mixes: Sequence[Mix]) -> Floats:
        """Compute quantities of each row from the columns `Roles.numbers`.

        `numbers` (R, n) has the values of these n columns in R rows. The result (R, m) has the m
        quantities `mixes` in these rows. It can be a view of `numbers`.
        """
        at = {column: k for k, column in enumerate(self.numbers)}
        if list(mixes) == [((column, 1.0),) for column in self.numbers[: len(mixes)]]:
            return numbers[:, : len(mixes)]
        answer = np.zeros((len(numbers), len(mixes)), order="F")
        with np.errstate(over="ignore", invalid="ignore"):  # a later error names the row
            for k, mix in enumerate(mixes):
                for column, factor in mix:
                    answer[:, k] += factor * numbers[:, at[column]]
        return answer


OF_HEIGHTS: dict[tuple[str, ...], str] = {
    PLACES: HEIGHT,
    ("x", "y"): "z",
    ("range", "bearing"): "elevation",
}
"""Name of the column of heights or elevations, by the names of the other two state columns."""


def _with_height(
    headers: Headers, options: ReadOptions, wanted: tuple[str, ...]
) -> tuple[tuple[str, ...], str]:
    """Return the state columns, and the header of a column of heights that is left out.

    `wanted` has the state columns without heights. If the table has heights, the option
    `ReadOptions.heights` decides:

    - ``"use"`` adds them to the state columns. The header is blank.
    - ``"tell"`` leaves them out, and their header is returned.
    - ``""`` ignores them. The header is blank.
    """
    name = OF_HEIGHTS.get(wanted, "") if options.heights else ""
    sizes = _heights_of_objects(headers)
    known = headers.places(HEIGHT if name == "z" else name)  # the most usual name is first
    column = next((k for k in known if k not in sizes), None) if name else None
    if column is None:
        return wanted, ""
    if options.heights == "tell":
        return wanted, headers.names[column]
    headers.mapped[name] = headers.names[column]
    return (*wanted, name), ""


def _heights_of_objects(headers: Headers) -> set[int]:
    """Return the columns ``height`` that are sizes, as the table also has a width or a length."""
    sized = any({"length", "width", "dx", "dy"} & {*words_of(n)} for n in headers.names)
    return {*headers.places("height")} if sized or headers.places("width") else set()


HEIGHTS = re.compile(
    r"((baro|geo|press|g[np]s)\w*)? ?(alt(itude)?|elev(ation)?|hae|hgt|height|flight ?level)"
    r"( ?((baro|geo|ellips)\w*|above \w+( \w+)*|g[np]ss?|a?msl|agl|wgs84|fl|"
    + "|".join(unit for unit, metres in LENGTHS.items() if metres)
    + "))*"
)
"""Pattern of the words of a header of heights in any unit, above any surface."""


def _other_heights(
    headers: Headers, wanted: tuple[str, ...], unused: Sequence[str]
) -> Iterator[Notice]:
    """Warn if heights are left out, because it is not sure that they are metres, or heights."""
    sizes = _heights_of_objects(headers) if wanted == PLACES else headers.places("height")
    own = {headers.names[k] for k in sizes}
    heights = [n for n in unused if n not in own and HEIGHTS.fullmatch(" ".join(words_of(n)))]
    if not heights or wanted not in (PLACES, ("x", "y")):
        return
    text, words = f"heights ({listed(heights)}) are left out", words_of(heights[0])
    if wanted == PLACES:
        unknown = any(LENGTHS.get(word, 1) != 1 or word in ("fl", "flight") for word in words)
        text += ": they are not in metres" * unknown
        remedy = "to compare heights, write them in metres in a column alt of both files"
    else:
        remedy = "if both files have heights, in one unit, map z in both: "
        remedy += ask(headers.option, [*wanted, f"z={heights[0]}"])
    yield Notice(code="heights-left-out", text=text, remedy=remedy)


def find_roles(
    header: Sequence[str],
    options: ReadOptions,
    where: str,
    *,
    fixed: bool = False,
    wide: bool = False,
) -> Roles:
    """Assign roles to the headers of a table; `where` begins every message.

    With `fixed`, the format has no headers: the names are those of this package, and the user
    cannot rename them. With `wide`, each object
    may have columns of its own. If so, the roles are for the reshaped table that
    `formats.frames.lengthened` returns.

    Raises
    ------
    InputError
        A header is blank, repeated or missing, or no column is a position.
    ConfigError
        The requested columns cannot be understood.
    """
    names = [name.strip() for name in header]
    last = max((k for k, name in enumerate(names) if name), default=-1)
    for k in (0, *range(last + 1, len(names))) if last > 0 else ():
        names[k] = names[k] or UNNAMED.format(k + 1)
    _check_names(names, where, options.option)
    mapped, wanted = parse_columns(options.columns)
    if wide and has_patterns(options):
        names = _lengthened(names, mapped)
    if options.boxes:
        wanted = _box_columns(wanted)
    headers = Headers(names, mapped, options.option, where, options.hidden, options.axes)
    second = _second_of_times(headers)
    more_ids = _more_ids(headers)
    missing = without_maps(headers, options)
    mixes = _Mixes(headers)
    identity = headers.find("id")
    _check_stamp(headers)
    time = headers.find("t")
    named, wanted = bool(wanted), wanted or mixes.default_states()
    wanted, height = _with_height(headers, options, wanted)
    by_name = {name: mixes.of(name, wanted) for name in wanted}
    state = tuple(mix for mix in by_name.values() if mix is not None)
    if identity is None or time is None or not wanted or len(state) < len(wanted):
        fault = absent(headers, (identity, time), by_name)
        raise InputError(f"{fault}; this format has no more columns" if fixed else fault)
    state = _along(options.axes, headers, by_name)
    region = {name: mixes.of_region(name, wanted) for name in options.ranges}
    klass = _class_column(headers, options, missing, fixed=fixed)
    spread = _spread(wanted, state, headers) if options.covariance else None
    weight = None if options.boxes else headers.find(WEIGHT)
    is_width = weight is not None and names[weight].casefold() == "w"
    if is_width and headers.find("height") is not None:
        weight = None  # w is the width of a box
    centres = not options.boxes and any(len(mix) > 1 for mix in state)
    sizes = (mixes.box["width"], mixes.box["height"]) if centres or options.boxes else ()
    used = {identity, time, second, klass, *more_ids}
    used |= {column for mix in (*state, *region.values(), *sizes) for column, _ in mix}
    weight = None if weight in used else weight
    used |= {weight, *(spread.columns if spread else ())}
    places = ((name, headers.find(name)) for name in options.attributes)
    attributes = {name: column for name, column in places if column is not None}
    where_columns = {
        name: headers.compared(name, one.option) for one in options.where for name in one.columns
    }
    halves = tuple(k for k, name in enumerate(names) if HALF.fullmatch(name) and k not in used)
    if wanted[:2] != PLACES or len(halves) != 2:  # "ns" alone may be nanoseconds
        halves = ()
    used |= {*attributes.values(), *where_columns.values(), *halves}
    unused = tuple(name for k, name in enumerate(names) if k not in used)
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
        where=where_columns,
        spread=spread,
        headers=tuple(names),
        fixed=fixed,
        passed=(*headers.passed_over("id", unused), *headers.passed_over("t", unused)),
        second=second,
        missing=missing,
        more_ids=more_ids,
        other_ids=tuple(k for k in headers.places("id") if k not in used),
        groups=tuple(
            k
            for k, name in enumerate(names)
            if k not in used and (GROUP.fullmatch(name) or CLASS.fullmatch(name))
        ),
        flags=tuple(
            k
            for k, name in enumerate(names)
            if k not in used
            and not fixed
            and (match := FLAG.fullmatch(name))
            and (match["score"] is None or "truth" in (options.option.partition("_")[0], where))
        ),
        halves=halves,
        height=height,
        options=options,
        doubts=(
            *(() if named or options.boxes else mixes.doubts),
            *(
                ()
                if fixed or height or (not options.heights if wanted == PLACES else named)
                else _other_heights(headers, wanted, unused)
            ),
        ),
    )


def _along(
    axes: tuple[str, ...], headers: Headers, by_name: dict[str, Mix | None]
) -> tuple[Mix, ...]:
    """Return the state along axes with known directions: a height along "down" is negated.

    Raises
    ------
    InputError
        The user mapped x or y to a header that names the other axis.
    """
    state = {name: mix for name, mix in by_name.items() if mix is not None}
    for name, axis in zip("xyz", axes, strict=False):
        header = headers.names[state[name][0][0]] if len(state.get(name, ())) == 1 else ""
        direction = direction_of(header)
        if name == "z" and direction == {"up": "down", "down": "up"}[axis]:
            state[name] = ((state[name][0][0], -1.0),)
        elif direction == OTHER_AXIS.get(axis):
            swapped = {**headers.mapped, "xy"[name == "x"]: header}
            swapped |= {name: headers.names[state["xy"[name == "x"]][0][0]]}
            remedy = ask(headers.option, [f"{one}={own}" for one, own in swapped.items()])
            raise InputError(
                f"{headers.where}: {name} is read from {quoted(header)}, but {name} is {axis} in "
                f"these axes; use {remedy}"
            )
    return tuple(state.values())


def _lengthened(names: list[str], mapped: dict[str, str]) -> list[str]:
    """Return the headers that `formats.frames.lengthened` gives to a wide table."""
    objects = objects_in(names, mapped)
    if not objects:
        return names
    if "id" in mapped:
        ids = f"{ID_MARK} in headers and id={mapped['id']}"
        raise ConfigError(f"columns: ids are named by {ids}; leave out one")
    own = list(next(iter(objects.values())))
    mapped |= dict(zip(own, own, strict=True))
    return ["id", *(names[k] for k in shared_columns(names, objects)), *own]


def _box_columns(wanted: tuple[str, ...]) -> tuple[str, ...]:
    """Return the state columns of boxes.

    An error is raised if the user named a column that is neither one of these nor the centre x, y.
    """
    other = next((name for name in wanted if name not in (*BOX, "x", "y")), None)
    if other is not None:
        raise ConfigError(
            f"columns: {quoted(other)} is not part of a box; for boxes map left, top, width, "
            "height, or the centre: x, y, width, height"
        )
    return BOX


def _check_stamp(headers: Headers) -> None:
    """Raise an error if a time is split into two columns, and no other column is the time."""
    mapped = headers.mapped
    if "t" in mapped or set(FIRST_ALIASES["t"]) & headers.folded.keys():
        return
    stamp = two_parts_of_a_stamp(headers.names)
    if stamp:
        items = [f"{name}={header}" for name, header in mapped.items()]
        remedy = ask(headers.option, [*items, f"t={'+'.join(stamp)}"])
        parts = " and ".join(map(quoted, stamp))
        raise InputError(f"{headers.where}: {parts} are two parts of one time; read both, {remedy}")


DATE = re.compile(r"(.*[\W_])?date([\W_]?utc)?")
"""Pattern of headers of dates."""

CLASS = re.compile(r"((object|obj)_?)?(class|category|label|type)(_?(id|name))?", re.IGNORECASE)
"""Pattern of headers of classes. Ids may restart in each class, as in each group."""


FLAG = re.compile(
    r"(?P<mark>iscrowd|ignored?)|(?P<score>conf|confidence)|(?P<zone>(utm[\W_]?)?zone)|"
    r"(is_?)?vis(ib(le|ility))?",
    re.I,
)
"""Pattern of headers of columns that may say which rows do not count.

A row seems not to count if its mark (``iscrowd``, ``ignore``) is above 0, or if its score or
visibility is 0. Positions in several zones of UTM are not in one system."""


HALF = re.compile(
    r"(gps[\W_]?)?(lat|lon|long|latitude|longitude)[\W_]?"
    r"(ref|dir(ection)?|hemi(sphere)?|n[\W_]?s|e[\W_]?w)|(n[\W_]?s|e[\W_]?w)([\W_]?indicator)?",
    re.IGNORECASE,
)
"""Pattern of headers of columns that may have N or S, and E or W."""


def _more_ids(headers: Headers) -> tuple[int, ...]:
    """Return the further columns of ids, if the user mapped several columns: ``id=CLUSTER+TRACK``.

    Afterwards ``id`` is mapped to the first column only.
    """
    whole = headers.mapped.get("id", "")
    parts = [part.strip() for part in whole.split("+")]
    if len(parts) < 2 or headers.spelt(whole, "id") is not None:
        return ()
    places = [headers.spelt(part, "id") for part in parts]
    known = [place for place in places if place is not None]
    if len(known) < len(parts):
        headers.mapped["id"] = parts[places.index(None)]  # the message names the missing part
        return ()
    headers.mapped["id"] = parts[0]
    return tuple(known[1:])


def _second_of_times(headers: Headers) -> int | None:
    """Return the second column, if the user mapped times to two columns: ``t=DATE+TIME``.

    Afterwards ``t`` is mapped to the first column only.
    """
    first, _, second = (part.strip() for part in headers.mapped.get("t", "").partition("+"))
    if not second or headers.spelt(headers.mapped["t"], "t") is not None:
        return None
    position = headers.spelt(second, "t")
    headers.mapped["t"] = second if position is None else first  # if missing, a message names it
    return position


class _Mixes:
    """Quantities of a table: columns, or sums of edges and sizes of boxes.

    A quantity such as x is the first of these that the table has:

    1. a column with this name as the header
    2. the x of boxes with plain headers (left, top, width, height)
    3. a column with an alias of the name as the header
    4. the x of boxes with aliases as headers
    """

    def __init__(self, headers: Headers) -> None:
        self.headers = headers
        self.plainly = partial(headers.find, plainly=True)
        self.plain_box = _box(self.plainly, self._centre)

    @cached_property
    def box(self) -> dict[str, Mix]:
        """Quantities of the box.

        It can be unclear which column an alias means. So aliases of the names are tried only if
        plain names do not define a box.
        """
        return self.plain_box or _box(self.headers.find, self._centre)

    def _centre(self, axis: str) -> int | None:
        """Return the column of a coordinate of the centre of boxes, or None.

        Its header says that it is a centre, or the user mapped it.
        """
        column = self.headers.find(axis)
        known = axis in self.headers.mapped or (
            column is not None and CENTRE.search(self.headers.names[column])
        )
        return column if known else None

    @property
    def doubts(self) -> Iterator[Notice]:
        """Warning if it is not clear whether x and y are a corner of boxes or their centre."""
        place = [self.plainly(name) for name in ("x", "y")]
        if None in place or not {"x", "y"}.isdisjoint(self.headers.mapped):
            return
        for edges in (BOX, CORNERS):
            with suppress(InputError):  # raised if several headers fit
                size = [self.headers.find(name) for name in edges[2:]]
                if None in size or self.box:
                    continue
                names = [self.headers.names[k] for k in (*place, *size) if k is not None]
                corner = [f"{name}={header}" for name, header in zip(edges, names, strict=True)]
                centre = [f"{n}={h}" for n, h in zip(("x", "y", *BOX[2:]), names, strict=True)]
                or_centre = f", {ask(self.headers.option, centre)} if the centre"
                yield Notice(
                    code="corner-or-centre",
                    text=f"{listed(names[:2])} next to {listed(names[2:])} may be the corner or "
                    "the centre of boxes, and are compared as they are",
                    remedy=f"use {ask(self.headers.option, corner)} if they are the corner"
                    + or_centre * (edges == BOX),
                )
                return

    def of(self, name: str, states: Sequence[str]) -> Mix | None:
        """Return a quantity, or None if the table lacks it.

        If the user mapped edges of boxes, x and y are the centre of the box. But if the states have
        z, other columns have priority: x and y themselves, then ``loc_x`` and ``loc_y``.
        """
        column = self.plainly(name)
        if name in ("x", "y") and name not in self.headers.mapped and "z" not in states:
            mapped = not self.headers.mapped.keys().isdisjoint(EDGES)
            column = None if mapped and name in self.box else column
        if column is None and name in ("x", "y", "z") and "z" in states:
            column = self.headers.find(f"loc_{name}")
        if column is None and name not in self.plain_box:
            column = self.headers.find(name)
        return self.box.get(name) if column is None else ((column, 1.0),)

    def of_region(self, name: str, states: Sequence[str]) -> Mix:
        """Return a quantity that the filter by region compares."""
        mix = self.of(name, states)
        if mix is None:
            raise InputError(
                f"{self.headers.where}: no column {quoted(name)} for {option('region')} (found: "
                f"{self.headers.shown}); name one that both files have; "
                f"{self.headers.way_of_one_side}"
            )
        return mix

    def _has_z(self, x: int, *, plain: bool) -> bool:
        """Return whether the table has the z of the position whose x is in this column.

        Beside a `plain` x only ``z`` fits, also with a unit; up and down fit beside east or north.
        """
        headers, on_axes = self.headers, direction_of(self.headers.names[x]) in OTHER_AXIS
        fits = [headers.names[k] for k in headers.places("z")]
        if plain:
            fits = [name for name in fits if words_of(name) in (["z"], ["z", unit_of(name)])]
        fits = [name for name in fits if on_axes or not direction_of(name)]
        if len(fits) == 1:
            headers.mapped["z"] = fits[0]
        return bool(fits)

    def default_states(self) -> tuple[str, ...]:
        """Return the state columns to use if the user named none.

        They are the first of these that the table has:

        1. x, y: the centres of boxes that the user mapped
        2. x, y, z as far as present, but not without x; z as `_has_z` says
        3. lat, lon
        4. x, y: the centres of other boxes
        5. x, y, z, read from ``loc_x``, ``loc_y``, ``loc_z``; only if
           `ReadOptions.hidden` leaves out other columns, whose positions are all unknown

        For 2 to 4, headers that are equal to x, to lat and lon, or to the names of a box have
        priority over aliases.
        """
        if not self.headers.mapped.keys().isdisjoint(EDGES) and self.box:
            return ("x", "y")
        for find in (self.plainly, self.headers.find):
            if (x := find("x")) is not None:
                names = "xyz" if self._has_z(x, plain=find is self.plainly) else "xy"
                return tuple(name for name in names if self.headers.find(name) is not None)
            if find("lat") is not None and find("lon") is not None:
                return ("lat", "lon")
            if self.plain_box if find is self.plainly else self.box:
                return ("x", "y")
        is_known = all(self.headers.spelt(f"loc_{name}", name) is not None for name in "xyz")
        return ("x", "y", "z") if is_known and self.headers.hidden else ()


def _class_column(
    headers: Headers, options: ReadOptions, missing: dict[str, str], *, fixed: bool
) -> int | None:
    """Return the column of the classes if classes are requested.

    If the table lacks the column and another file may have it, add a message to `missing`.
    """
    if options.classes is None and not options.by_class:
        return None
    klass = headers.find("class")
    if klass is None:
        way = options.class_for or option("by", "class")
        way = way if options.classes is None else option("class_")
        candidates = (name for name in headers.names if re.search("class|categor|type", name, re.I))
        mapped = f"class={next(candidates, 'HEADER')}"
        remedy = f"add it, or map it with {ask(headers.option, [mapped])}"
        fault = (
            f"{headers.where}: no column class for {way} (found: {headers.shown}); "
            f"{'rows of this length have none' if fixed else remedy}"
        )
        if options.by_class or "class" not in options.shared:
            raise InputError(fault)
        missing["class"] = fault
    return klass


def _spread(
    wanted: tuple[str, ...], state: Sequence[Mix], headers: Headers
) -> "SpreadColumns | None":
    """Return the columns of the covariances, or None if the table has no covariances."""
    from tgospa_eval.formats.spread import find_spread  # lazy: most states are points

    namings = _namings(wanted, state, headers)
    return next(filter(None, (find_spread(n, headers.find, headers.where) for n in namings)), None)


def _namings(
    wanted: tuple[str, ...], state: Sequence[Mix], headers: Headers
) -> Iterator[tuple[str, ...]]:
    """Yield the names that states may have in the headers of covariances.

    First come the headers of the states: ``px, py`` for ``cov_px_py``. Then come the names of the
    states: ``x, y`` for ``cov_x_y``. The names of the states are left out if
    another column has such a header: ``cov_x_y`` belongs to a column with the header x.
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


CENTRE = re.compile(r"^c.?[xy]\b|^[xy].?c\b|cent", re.IGNORECASE)
"""Pattern of headers of the centres of boxes."""


def _box(
    find: Callable[[str], int | None], centre_of: Callable[[str], int | None]
) -> dict[str, Mix]:
    """Return edges, sizes and centre of boxes by name; empty unless the columns define a box.

    Both callables return the position of a column, or None. `find` receives the name of the column.
    `centre_of` receives the axis, x or y, and finds the column with this coordinate of the centre.
    """
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
        elif first is None and extent is not None and (centre := centre_of(axis)) is not None:
            box |= {
                axis: ((centre, 1.0),),
                begin: ((centre, 1.0), (extent, -0.5)),
                size: ((extent, 1.0),),
            }
    return box if len(box) >= 4 else {}


UNNAMED = "column {} (blank header)"
"""Name of a column with a blank header, which is the first or after all others.

pandas writes such a first column for the index, and R for row names. Spreadsheets, and programs
that end lines with a comma, write such columns after all others."""


def are_numbers(fields: Sequence[str]) -> bool:
    """Return whether most of the fields are numbers, so that they are a row and not a header."""
    return 2 * sum(map(is_number, fields)) > len(fields)


def without_header(fields: Sequence[str], name: str, where: str, order: str = "id,t,x,y") -> str:
    """Return the message about a table that begins with numbers instead of a header."""
    formats = ", ".join(dict.fromkeys((option("truth_format"), option("estimate_format"))))
    return (
        f"{where}: the numbers {listed([*map(str.strip, fields)])} instead of a header; name the "
        f"columns in the order of the file with {option(name or 'columns', order)} (also z, left, "
        f"top, width, height; a minus for a column to skip), or name the format ({formats})"
    )


def placed_names(columns: Sequence[str] | None, count: int, where: str) -> list[str] | None:
    """Return names for all columns of a table without a header.

    `columns` are the names that the user gives to the first columns, in order. The result is None
    if ``t`` is not among them.

    Raises
    ------
    InputError
        There are more names than columns.
    """
    names = [item.strip() for item in columns or () if "=" not in item]
    if "t" not in names or not count:
        return None
    if len(names) > count:
        raise InputError(
            f"{where}: {counted(count, 'column')}, but {option('columns')} names {len(names)}; "
            f"name at most {count}"
        )
    shown = [name if name not in SKIPPED else "" for name in names]
    return [
        name or f"column {k}" for k, name in enumerate([*shown, *[""] * (count - len(names))], 1)
    ]


def _check_names(names: list[str], where: str, keyword: str) -> None:
    """Check that these are headers, and that none is blank or a duplicate."""
    if are_numbers(names):
        raise InputError(without_header(names, keyword, where))
    earlier: set[str] = set()
    for k, name in enumerate(names, start=1):
        if not name:
            raise InputError(
                f"{where}: column {k} has no name in the header; name it, also if unused"
            )
        if name in earlier:
            raise InputError(f"{where}: the header names {quoted(name)} twice; rename one")
        earlier.add(name)
