"""Which column is what: headers to roles."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.fields import is_number
from tgospa_eval.text import listed, quoted
from tgospa_eval.trajectories import Floats

if TYPE_CHECKING:
    from tgospa_eval.formats import ReadOptions
    from tgospa_eval.formats.spread import Spread

ALIASES = {
    "id": ("id", "track_id", "target_id", "object_id"),
    "t": ("t", "time", "timestamp", "frame", "step"),
    "class": ("class",),
    "weight": ("weight", "w"),
}
"""Headers under which the columns are found that are no numbers of a state."""

WEIGHT = "weight"
"""Of particles."""

PREFIXES = ("cov_", "std_", "rho_")
"""Of entries of covariances."""

BOX = ("left", "top", "width", "height")
EDGES = (*BOX, "right", "bottom")

Mix = tuple[tuple[int, float], ...]
"""A quantity as columns times factors: the centre of a box is left + 0.5 width."""


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
    spread : Spread, optional
        Columns of the covariances.
    asked : bool
        Whether covariances were asked for.
    headers : tuple of str
        All headers.
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
    spread: "Spread | None" = None
    asked: bool = False
    headers: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns that are read as numbers, those of the state first."""
        mixes = (*self.state, *self.region.values(), *self.sizes)
        columns = [column for mix in mixes for column, _ in mix]
        if self.weight is not None:
            columns.append(self.weight)
        return tuple(dict.fromkeys([*columns, *(self.spread.columns if self.spread else ())]))

    def notices(self, *, clouds: bool) -> Iterator[str]:
        """Columns that are passed over, and what becomes of covariances.

        `clouds` says whether rows are particles: weights are for them alone, covariances are not.
        """
        unused = list(self.unused)
        if clouds and self.spread is not None:
            unused += [self.headers[column] for column in self.spread.columns]
        if not clouds and self.weight is not None:
            unused.append(self.headers[self.weight])
        if unused:
            there = not (self.asked or clouds) and self._any_covariance(unused)
            way = "; --distance gaussian-wasserstein compares covariances" if there else ""
            yield f"columns not used: {listed(unused)}{way}"
        if self.asked and self.spread is None and not clouds:
            shown = ", ".join([names[0] for names in self._covariances()[:3]])
            yield f"no columns of covariances ({shown}): its states are points"

    def _any_covariance(self, headers: Sequence[str]) -> bool:
        """Whether any of the headers is that of an entry of the covariance."""
        alike = {name.casefold() for name in headers if name.casefold().startswith(PREFIXES)}
        return bool(alike) and any(
            name.casefold() in alike for names in self._covariances() for name in names
        )

    def _covariances(self) -> list[list[str]]:
        """Headers that the entries of the covariance may have."""
        from tgospa_eval.formats.spread import spelt  # here: most states are points

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
    header: Sequence[str], options: "ReadOptions", where: str, *, fixed: bool = False
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
    if 2 * sum(map(is_number, names)) > len(names):
        raise InputError(
            f"{where}: numbers where the header should be; begin with id,t,x,y, or name the format "
            "(--truth-format, --estimate-format)"
        )
    _check_names(names, where)
    mapped, wanted = parse_columns(options.columns)
    alike: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        alike.setdefault(name.casefold(), []).append(k)

    def spellings(name: str) -> tuple[str, ...]:
        return (mapped[name],) if name in mapped else ALIASES.get(name, (name,))

    def find(name: str) -> int | None:
        for spelling in spellings(name):
            folded = alike.get(spelling.casefold(), [])
            exact = [k for k in folded if names[k] == spelling]
            if exact:
                return exact[0]
            if len(folded) > 1:
                both = " and ".join(quoted(names[k]) for k in folded)
                raise InputError(
                    f"{where}: {both} may both be {name}; say which, --columns "
                    f"{name}={names[folded[0]]}"
                )
            if folded:
                return folded[0]
        return None

    def need(name: str) -> int:
        found = find(name)
        if found is None:
            raise _absent(name)
        return found

    def _absent(name: str) -> InputError:
        remedy = f"rename it, or map it with --columns {name}=HEADER"
        return InputError(
            f"{where}: no column {name} (looked for: {', '.join(spellings(name))}; "
            f"found: {listed(names)}); {'this format has no other' if fixed else remedy}"
        )

    box = _box(find)

    def quantity(name: str) -> Mix | None:
        found = find(name)
        if found is None and name in ("x", "y", "z") and "z" in wanted:
            found = find(f"loc_{name}")
        return box.get(name) if found is None else ((found, 1.0),)

    identity, time = need("id"), need("t")
    if options.boxes:
        if set(wanted) - set(BOX):
            (other, *_) = (name for name in wanted if name not in BOX)
            raise ConfigError(
                f"columns: {quoted(other)} is no part of a box; for boxes map left, top, width, "
                "height"
            )
        wanted = BOX
    elif not wanted:
        wanted = _default_states(find, box)
        if not wanted:
            raise InputError(
                f"{where}: no position column (looked for x, y, z, lat, lon and boxes; found: "
                f"{listed(names)}); name the state columns with --columns"
            )
    state = []
    for name in wanted:
        mix = quantity(name)
        if mix is None:
            raise _absent(name)
        state.append(mix)
    region = {}
    for name in options.ranges:
        mix = quantity(name)
        if mix is None:
            raise InputError(
                f"{where}: no column {quoted(name)} for --region (found: {listed(names)}); "
                "name one that both files have"
            )
        region[name] = mix
    klass = find("class")
    if klass is None and (options.classes is not None or options.by_class):
        option = "--class" if options.classes is not None else "--by class"
        remedy = "add it, or map it with --columns class=HEADER"
        raise InputError(
            f"{where}: no column class for {option} (found: {listed(names)}); "
            f"{'rows of this length have none' if fixed else remedy}"
        )
    if options.classes is None and not options.by_class:
        klass = None
    spread = None
    if options.covariance:
        from tgospa_eval.formats.spread import find_spread

        for naming in _namings(wanted, mapped, names):
            spread = spread or find_spread(naming, find, where)
    weight = None if options.boxes else find(WEIGHT)
    for name in mapped:
        needed = spread is not None if name.startswith(PREFIXES) else name == WEIGHT
        if needed and find(name) is None:
            raise _absent(name)
    centres = not options.boxes and any(len(mix) > 1 for mix in state)
    sizes = (box["width"], box["height"]) if centres or options.boxes else ()
    mixes = (*state, *region.values(), *sizes)
    used = {identity, time, klass, *(k for mix in mixes for k, _ in mix)}
    if weight in used:
        weight = None
    used |= {weight, *(spread.columns if spread else ())}
    return Roles(
        id=identity,
        time=time,
        state=tuple(state),
        names=wanted,
        klass=klass,
        region=region,
        sizes=sizes,
        centres=centres,
        unused=tuple(name for k, name in enumerate(names) if k not in used),
        weight=weight,
        spread=spread,
        asked=options.covariance and not options.clouds,
        headers=tuple(names),
    )


def parse_columns(columns: Sequence[str] | None) -> tuple[dict[str, str], tuple[str, ...]]:
    """Header of each mapped name, and the names of the state columns, in order.

    Edges of boxes, weights and entries of covariances that are mapped are no state columns by that;
    named without ``=`` they are.
    """
    mapped: dict[str, str] = {}
    wanted: dict[str, None] = {}  # in order, and quick to look in
    for item in columns or ():
        name, equals, header = (part.strip() for part in item.partition("="))
        if not name or (equals and not header):
            raise ConfigError(f"columns: {quoted(item)} is neither a name nor name=header")
        if name in wanted or name in mapped:
            raise ConfigError(f"columns: {quoted(name)} is given twice")
        if equals:
            mapped[name] = header
        if name not in ALIASES and not (equals and _is_beside(name)):
            wanted[name] = None
    return mapped, tuple(wanted)


def _namings(
    wanted: tuple[str, ...], mapped: dict[str, str], names: Sequence[str]
) -> Iterator[tuple[str, ...]]:
    """What state columns are called in the names of covariances: by their headers, or as mapped.

    Where another column bears the name as its header, the covariance is that column's.
    """
    headers = tuple(mapped.get(name, name) for name in wanted)
    if headers != wanted and not any(name.startswith(PREFIXES) for name in mapped):
        yield headers
        folded = {name.casefold() for name in names}
        if any(name.casefold() in folded for name in set(wanted) - set(headers)):
            return
        if sorted(headers) == sorted(wanted):
            return
    yield wanted


def _is_beside(name: str) -> bool:
    """Whether a column is of the box around a state, its covariance or its weight."""
    return name in (*EDGES, WEIGHT) or name.startswith(PREFIXES)


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


def _default_states(find: Callable[[str], int | None], box: dict[str, Mix]) -> tuple[str, ...]:
    places = [find(name) for name in ("x", "y", "z")]
    size = places.index(None) if None in places else 3
    if size:
        return ("x", "y", "z")[:size]
    if find("lat") is not None and find("lon") is not None:
        return ("lat", "lon")
    return ("x", "y") if box else ()


def _check_names(names: list[str], where: str) -> None:
    seen: set[str] = set()
    for k, name in enumerate(names, start=1):
        if not name:
            raise InputError(
                f"{where}: column {k} has no name in the header; name it, also if unused"
            )
        if name in seen:
            raise InputError(f"{where}: the header names {quoted(name)} twice; rename one")
        seen.add(name)
