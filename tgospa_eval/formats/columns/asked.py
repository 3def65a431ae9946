"""Columns that the user asks for: ``name`` and ``name=header``, for one file or several."""

from collections.abc import Sequence

from tgospa_eval.errors import ConfigError
from tgospa_eval.text import quoted

WEIGHT = "weight"
"""Of particles."""

NO_STATES = ("id", "t", "class", WEIGHT)
"""Columns that are no part of the state, also where they are named."""

PREFIXES = ("cov_", "std_", "rho_")
"""Of entries of covariances."""

BOX = ("left", "top", "width", "height")
EDGES = (*BOX, "right", "bottom")


def columns_of_each(
    shared: Sequence[str] | None, *own: Sequence[str] | None
) -> list[tuple[tuple[str, ...] | None, tuple[str, ...]]]:
    """The columns of each file, and the names among them whose headers it may lack.

    Parameters
    ----------
    shared : sequence of str, optional
        Items for all files.
    own : sequences of str, optional
        Items for each, which go before. States that are named for one are those of all.
    """
    maps, wanted = parse_columns(shared)
    found = [parse_columns(items) for items in own]
    named = wanted or next((states for _, states in found if states), ())
    answer = []
    for mapped, states in found:
        chosen = named if set(states) <= set(named) else states
        headers = maps | mapped
        # Names of states in order, the others in front.
        names = [*(name for name in headers if name not in chosen), *chosen]
        items = tuple(f"{name}={headers[name]}" if name in headers else name for name in names)
        answer.append((items or None, tuple(name for name in maps if name not in mapped)))
    return answer


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
        if name not in NO_STATES and not (equals and _is_beside(name)):
            wanted[name] = None
    return mapped, tuple(wanted)


def _is_beside(name: str) -> bool:
    """Whether a column is of the box around a state, its covariance or its weight."""
    return name in (*EDGES, WEIGHT) or name.startswith(PREFIXES)


def ask(option: str, items: Sequence[str]) -> str:
    """What to type or write so that these items are columns: ready to be pasted.

    `option` is an option of the command line, an argument of Python, or nothing for a DataFrame.
    """
    if option.startswith("-"):
        from shlex import quote  # here: for messages only

        return f"{option} {quote(','.join(items))}"
    if option:
        return f"{option}={tuple(items)!r}"
    names = (item.partition("=")[::2] for item in items)
    return f"rename(columns={ ({header: name for name, header in names if header})!r})"
