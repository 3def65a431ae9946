"""Formats of text without a header: the names of the columns follow from their number."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import find_roles
from tgospa_eval.formats.fields import Coded
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.guess import split as split_line
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text import bulk
from tgospa_eval.formats.text.comments import with_comments
from tgospa_eval.formats.text.convert import (
    Block,
    Places,
    check_text,
    chunks,
    convert,
    decode,
    gather,
)


@dataclass(frozen=True)
class PlainForm:
    """What a format without a header is like.

    Parameters
    ----------
    header : callable
        Names of the columns, from the fields of the first row and where that is.
    commas : bool
        Whether fields may be separated by commas instead of blanks.
    empty : int
        Fields of the rows that an empty file does not have.
    """

    header: Callable[[list[str], str], list[str]]
    commas: bool
    empty: int


def read_plain(
    path: str,
    data: bytes,
    options: ReadOptions,
    form: PlainForm,
    *,
    given: bool,
    texts: Sequence[str],
) -> tuple[Rows, dict[int, Coded], Places]:
    """The rows, some columns as texts by position, and where they are.

    Parameters
    ----------
    path, data
        The file.
    options : ReadOptions
        Decimal marks are points whatever the options are.
    form : PlainForm
        What the format is like.
    given : bool
        Whether the user named the format: then a file without content is an empty set. There is
        no other way to write one without a header.
    texts : sequence of str
        Names of the columns to be returned as texts, as far as they are there.

    Raises
    ------
    InputError
        The text is wrong.
    """
    quick = _first_of_many(data)
    if quick is None:
        blank = given and not data.strip()
        if not blank:
            check_text(data, path)
        text = "" if blank else decode(data, path)
        first, line = _first_line(text)
    else:
        check_text(data, path)
        first, line = 1, quick
    if not line and not given:
        raise InputError(f"{path}: blank lines only; name the format if the set is empty")
    split = split_line if form.commas else str.split
    place = f"{path}, line {first}"
    names = form.header(split(line) if line else ["0"] * form.empty, place)
    roles = replace(find_roles(names, options, place, fixed=True), unused=())
    wanted = [names.index(name) for name in texts if name in names]
    if quick is not None:
        layout = bulk.Layout(
            path=path,
            first=1,
            delimiter="," if form.commas and "," in line else " ",
            width=len(names),
            header=False,
        )
        found = bulk.read_bulk(data, layout, roles, ".", texts=wanted, name_id=plain_id)
        if found is not None:
            rows, coded = found
            lines = range(1, len(rows.numbers) + 1)
            return rows, coded, Places(path=path, lines=lines, names=names)
        text = decode(data, path)
    del data
    comments: list[int] = []
    blocks = _blocks(text, split, len(names), path, first, comments)
    fields = gather(blocks, roles, ".", wanted)
    roles = with_comments(roles, len(comments))
    rows, places = convert(fields, roles, ".", path, names, name_id=plain_id)
    return rows, {column: fields.coded[column] for column in wanted}, places


def _first_of_many(data: bytes) -> str | None:
    """First line of a large file, which needs no decoding unless it takes the careful way."""
    if len(data) < bulk.BULK_BYTES or not data.isascii():
        return None
    line = data[: data.find(b"\n") + 1]
    # A return anywhere but before its end is the end of a line.
    has_return = b"\r" in line.removesuffix(b"\n").removesuffix(b"\r")
    odd = not line.strip() or line.lstrip().startswith(tuple(map(str.encode, COMMENTS)))
    return None if odd or has_return else line.decode()


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
            yield Block(lines=np.array(lines), columns=list(zip(*rows, strict=True)))
    if wrong:
        line_number, found = wrong[0]
        raise InputError(
            f"{path}, line {line_number}: {counted(found, 'field')}, "
            f"line {first} has {width}{more(len(wrong))}; give every row as many"
        )


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


def plain_id(text: str) -> str:
    """Ids of these formats are integers, which some programs write as 3.0 or 3.000e+00."""
    text = text.strip()
    if text.isdigit() or "_" in text or not text.isascii():
        return text
    from decimal import Decimal  # here: slow to import, and few numbers are ids

    try:
        if not math.isfinite(float(text)):
            return text
        value = Decimal(text)  # float() makes one id of 9007199254740993.0 and ...992.0
        return str(int(value)) if value == value.to_integral_value() else text
    except (ValueError, ArithmeticError):
        return text
