"""Formats of text without a header: the names of the columns follow from their number."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats.assemble import Rows
from tgospa_eval.formats.columns import find_roles, parse_columns
from tgospa_eval.formats.text import Places, check_text, convert, decode
from tgospa_eval.formats.times import more

if TYPE_CHECKING:
    from tgospa_eval.formats import ReadOptions


def read_plain(
    path: str,
    data: bytes,
    options: "ReadOptions",
    header: Callable[[list[str], str], list[str]],
    split: Callable[[str], list[str]],
    *,
    given: bool,
    empty: int,
) -> tuple[Rows, list[list[str]], Places]:
    """The rows, all columns as texts, and where they are.

    Parameters
    ----------
    path, data
        The file.
    options : ReadOptions
        Decimal marks are points whatever they say.
    header : callable
        Names of the columns, from the fields of the first row and where that is.
    split : callable
        Fields of a line.
    given : bool
        Whether the user named the format: then a file without content is an empty set. There is
        no other way to write one without a header.
    empty : int
        Fields of the rows that an empty file does not have.

    Raises
    ------
    InputError
        The text is wrong.
    """
    if not data.strip() and given:
        fields: list[list[str]] = []
        lines: list[int] = []
    else:
        check_text(data, path)
        lines, fields = _fields(decode(data, path), split)
    if not fields and not given:
        raise InputError(f"{path}: blank lines only; name the format if the set is empty")
    place = f"{path}, line {lines[0] if lines else 1}"
    names = header(fields[0] if fields else ["0"] * empty, place)
    width = len(names)
    wrong = [k for k, row in enumerate(fields) if len(row) != width]
    if wrong:
        found = len(fields[wrong[0]])
        raise InputError(
            f"{path}, line {lines[wrong[0]]}: {found} {'field' if found == 1 else 'fields'}, "
            f"line {lines[0]} has {width}{more(len(wrong))}; give every row as many"
        )
    columns = [list(column) for column in zip(*fields, strict=True)] or [[] for _ in names]
    del fields
    asked = replace(options, columns=_known(options.columns, names))
    roles = replace(find_roles(names, asked, place, fixed=True), unused=())
    places = Places(path=path, lines=lines, names=names)
    columns[roles.id] = list(map(_plain_id, columns[roles.id]))
    return convert(columns, roles, ".", places), columns, places


def leave_out_unknown(rows: Rows, names: Sequence[str], unknown: float) -> None:
    """Set rows apart whose place in space is not known, if the states are places.

    Raises
    ------
    InputError
        None is known.
    """
    place = [
        k
        for k, mix in enumerate(rows.roles.state)
        if len(mix) == 1 and names[mix[0][0]].startswith("loc_")
    ]
    if not place:
        return
    state = rows.roles.mixed(rows.numbers, rows.roles.state)[:, place]
    apart = np.asarray((state == unknown).all(axis=1), bool)
    if len(apart) and apart.all():
        raise InputError(
            f"{rows.name}: no row has a place in space, all are {unknown:g}; without --columns the "
            "centres of the boxes are compared, with --distance iou the boxes"
        )
    rows.apart["no place"] = apart, f"without a place in space ({unknown:g}): absent at that step"


def _fields(text: str, split: Callable[[str], list[str]]) -> tuple[list[int], list[list[str]]]:
    """Lines that are not blank, and their fields."""
    lines, fields = [], []
    for number, line in enumerate(text.split("\n"), start=1):
        if line.strip():
            lines.append(number)
            fields.append(split(line))
    return lines, fields


def _known(columns: Sequence[str] | None, names: Sequence[str]) -> tuple[str, ...] | None:
    """Without maps to headers of the other file: these names are fixed."""
    mapped, wanted = parse_columns(columns)
    kept = [f"{name}={header}" for name, header in mapped.items() if header in names]
    items = [next((k for k in kept if k.startswith(f"{name}=")), name) for name in wanted]
    return tuple(items + [k for k in kept if k not in items]) or None


def _plain_id(text: str) -> str:
    """Ids of these formats are integers, which some programs write as 3.0 or 3.000e+00."""
    if text.isdigit() or "_" in text:
        return text
    try:
        value = float(text)
    except ValueError:
        return text
    return str(int(value)) if value.is_integer() else text
