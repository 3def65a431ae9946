"""Which column is what: headers to roles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tgospa_eval.errors import ConfigError, InputError

ALIASES = {
    "id": ("id", "track_id", "target_id", "object_id"),
    "t": ("t", "time", "timestamp", "frame", "step"),
}


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Positions of the columns that are used.

    Parameters
    ----------
    id, time : int
        Column of the ids and of the times.
    state : tuple of int
        Columns of the state, in order.
    names : tuple of str
        Names of the state columns.
    unused : tuple of str
        Headers of all other columns.
    """

    id: int
    time: int
    state: tuple[int, ...]
    names: tuple[str, ...]
    unused: tuple[str, ...]


def find_roles(header: Sequence[str], columns: Sequence[str] | None, where: str) -> Roles:
    """Assign roles to the headers of a table; `where` begins every message.

    Raises
    ------
    InputError
        A header is blank, repeated or missing, or there is no position column.
    ConfigError
        `columns` cannot be understood.
    """
    names = [name.strip() for name in header]
    if names and all(_is_number(name) for name in names):
        raise InputError(f"{where}: numbers where the header should be; begin with id,t,x,y")
    _check_names(names, where)
    mapped, wanted = parse_columns(columns)

    def find(name: str) -> int | None:
        for spelling in (mapped[name],) if name in mapped else ALIASES.get(name, (name,)):
            if spelling in names:
                return names.index(spelling)
            folded = [k for k, other in enumerate(names) if other.casefold() == spelling.casefold()]
            if len(folded) == 1:
                return folded[0]
        return None

    def need(name: str) -> int:
        found = find(name)
        if found is None:
            sought = mapped.get(name) or ", ".join(ALIASES.get(name, (name,)))
            raise InputError(
                f"{where}: no column {name}, or two (looked for: {sought}; "
                f"found: {', '.join(names)}); rename it, or map it with --columns {name}=HEADER"
            )
        return found

    identity, time = need("id"), need("t")
    if wanted:
        state = tuple(need(name) for name in wanted)
    else:
        wanted, state = _default_states(find)
        if not state:
            raise InputError(
                f"{where}: no position column (looked for x, y, z and lat, lon; found: "
                f"{', '.join(names)}); name the state columns with --columns"
            )
    used = {identity, time, *state}
    return Roles(
        id=identity,
        time=time,
        state=state,
        names=tuple(wanted),
        unused=tuple(name for k, name in enumerate(names) if k not in used),
    )


def parse_columns(columns: Sequence[str] | None) -> tuple[dict[str, str], tuple[str, ...]]:
    """Header of each mapped name, and the names of the state columns, in order."""
    mapped: dict[str, str] = {}
    wanted: list[str] = []
    for item in columns or ():
        name, equals, header = (part.strip() for part in item.partition("="))
        if not name or (equals and not header):
            raise ConfigError(f'columns: "{item}" is neither a name nor name=header')
        if name in wanted or name in mapped:
            raise ConfigError(f'columns: "{name}" is given twice')
        if equals:
            mapped[name] = header
        if name not in ALIASES:
            wanted.append(name)
    return mapped, tuple(wanted)


def _default_states(find: Callable[[str], int | None]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    places = [find(name) for name in ("x", "y", "z")]
    size = places.index(None) if None in places else 3
    if size:
        return ("x", "y", "z")[:size], tuple(at for at in places[:size] if at is not None)
    latitude, longitude = find("lat"), find("lon")
    if latitude is None or longitude is None:
        return (), ()
    return ("lat", "lon"), (latitude, longitude)


def _check_names(names: list[str], where: str) -> None:
    for k, name in enumerate(names, start=1):
        if not name:
            raise InputError(
                f"{where}: column {k} has no name in the header; name it, also if unused"
            )
        if names.index(name) != k - 1:
            raise InputError(f'{where}: the header names "{name}" twice; rename one')


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
