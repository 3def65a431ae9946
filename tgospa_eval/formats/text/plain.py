"""Formats of text without a header: the names of the columns follow from their number."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import find_roles
from tgospa_eval.formats.fields import Coded
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.guess import split as split_line
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.scan import (
    Block,
    beginning,
    check_text,
    chunks,
    convert,
    decode,
    gather,
    plain_id,
    scanned,
    with_comments,
)


def read_plain(
    path: str,
    data: bytes,
    options: ReadOptions,
    header: Callable[[list[str], str], list[str]],
    *,
    empty: int,
    given: bool,
    texts: Sequence[str],
    commas: bool = True,
) -> tuple[Rows, dict[int, Coded]]:
    """The rows, and some columns as texts by position.

    Parameters
    ----------
    path, data
        The file.
    options : ReadOptions
        Decimal marks are points whatever the options are.
    header : callable
        Names of the columns, from the fields of the first row and where that is.
    empty : int
        Fields of the rows that an empty file does not have.
    given : bool
        Whether the user named the format: then a file without content is an empty set. There is
        no other way to write one without a header.
    texts : sequence of str
        Names of the columns to be returned as texts, as far as they are there.
    commas : bool
        Whether fields may be separated by commas instead of blanks.

    Raises
    ------
    InputError
        The text is wrong.
    """
    blank = given and not data.strip()
    if not blank:
        check_text(data, path)
    text, whole = ("", True) if blank else beginning(data, path)
    first, line = _first_line(text)
    if not line and not whole:
        text, whole = decode(data, path), True
        first, line = _first_line(text)
    if not line and not given:
        raise InputError(f"{path}: blank lines only; name the format if the set is empty")
    split = split_line if commas else str.split
    place = f"{path}, line {first}"
    names = header(split(line) if line else ["0"] * empty, place)
    roles = replace(find_roles(names, options, place, fixed=True), unused=())
    wanted = [names.index(name) for name in texts if name in names]
    fields = None
    delimiter = "," if commas and "," in line else " "
    if first == 1 and data.isascii() and not (commas and delimiter == " " and b"," in data):
        fields = scanned(data, 1, len(names), delimiter, roles, texts=wanted, quotes=False)
    if fields is None:
        comments: list[int] = []
        blocks = _blocks(
            text if whole else decode(data, path), split, len(names), path, first, comments
        )
        fields = gather(blocks, roles, ".", wanted)
        roles = with_comments(roles, len(comments))
    rows = convert(fields, roles, ".", path, names, plain_id)
    return rows, {column: fields.coded[column] for column in wanted}


def _first_line(text: str) -> tuple[int, str]:
    """The first line that is not blank, and its number."""
    number = 1
    for chunk in chunks(text):
        for line in chunk.split("\n"):
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                return number, line
            number += 1
    return 1, ""


def _blocks(
    text: str,
    split: Callable[[str], list[str]],
    width: int,
    path: str,
    first: int,
    comments: list[int],
) -> Iterator[Block]:
    """The lines that are not blank; all must have as many fields as the first.

    Those of comments are noted: no frame begins so.
    """
    number = 0
    wrong: list[tuple[int, int]] = []
    for chunk in chunks(text):
        lines: list[int] = []
        rows: list[list[str]] = []
        for line in chunk.split("\n"):
            number += 1
            if line.lstrip().startswith(COMMENTS):
                comments.append(number)
            elif line.strip():
                fields = split(line)
                if len(fields) == width:
                    lines.append(number)
                    rows.append(fields)
                else:
                    wrong.append((number, len(fields)))
        if rows:
            yield np.array(lines), list(zip(*rows, strict=True))
    if wrong:
        line_number, found = wrong[0]
        raise InputError(
            f"{path}, line {line_number}: {counted(found, 'field')}, "
            f"line {first} has {width}{more(len(wrong))}; give every row as many"
        )


def leave_out_unknown(rows: Rows, unknown: float) -> None:
    """Set rows apart whose place in space is not known, if the states are places.

    Raises
    ------
    InputError
        None is known.
    """
    place = [
        k
        for k, mix in enumerate(rows.roles.state)
        if len(mix) == 1 and rows.roles.headers[mix[0][0]].startswith("loc_")
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
