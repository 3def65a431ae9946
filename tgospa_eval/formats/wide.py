"""Tables of text with columns of their own for each object: ``t,x1,y1,x2,y2``, and DeepLabCut."""

import csv
from collections.abc import Iterable, Sequence

import pandas as pd

from tgospa_eval.errors import InputError
from tgospa_eval.formats.frames import lengthened
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.headers import ID_MARK, ask
from tgospa_eval.formats.loading import check_text_memory
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.text.lines import check_text, decode, lines_of
from tgospa_eval.formats.text.table import header_of, split_rows
from tgospa_eval.text import listed

LEVELS = ("scorer", "individuals", "bodyparts", "coords")
"""First fields of the lines that are the header of DeepLabCut."""


def read_wide(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """The table of a CSV file whose columns are named by pattern.

    Raises
    ------
    InputError
        There is no such header, or a row has another number of fields.
    """
    text = _text(path, data, options)
    names, _roles, delimiter, first, start = header_of(text, path, options, wide=True)
    return _table(path, split_rows(lines_of(text, start), delimiter), first, names)


def read_deeplabcut(
    path: str, data: bytes, options: ReadOptions, *_: str, **__: bool
) -> pd.DataFrame:
    """The table of a CSV file of DeepLabCut, whose columns are called ``mouse.nose.x``.

    Raises
    ------
    InputError
        It is none, or there are several body parts.
    """
    rows = list(csv.reader(_text(path, data, options).split("\n")))
    levels = {row[0]: row[1:] for row in rows[: len(LEVELS)] if row and row[0] in LEVELS}
    if not {"bodyparts", "coords"} <= levels.keys():
        raise InputError(f"{path}: no file of DeepLabCut; its first lines are {', '.join(LEVELS)}")
    begin = len(levels)
    levels.pop("scorer", None)
    names = ["frame", *map(".".join, zip(*levels.values(), strict=False))]
    table = _table(path, rows[begin:], begin + 1, names)
    if options.columns is not None:
        return table
    parts = list(dict.fromkeys(levels["bodyparts"]))
    has_animals = "individuals" in levels
    each = f"{ID_MARK}.{parts[0]}" if has_animals else ID_MARK
    mapped = {"x": f"{each}.x", "y": f"{each}.y"}
    if len(parts) > 1:
        what = "one of each animal" if has_animals else "each as an object"
        remedy = ask(options.option, [f"{name}={header}" for name, header in mapped.items()])
        raise InputError(f"{path}: several body parts ({listed(parts)}); to read {what}, {remedy}")
    return lengthened(table, mapped)


def _text(path: str, data: bytes, options: ReadOptions) -> str:
    check_text_memory(path, data, options.max_input)
    check_text(data, path)
    return decode(data, path)


def _table(path: str, rows: Iterable[list[str]], first: int, names: Sequence[str]) -> pd.DataFrame:
    """The rows from a line on, with their lines as the index."""
    kept, places = [], []
    for line, row in enumerate(rows, start=first):
        if len(row) == len(names):
            kept.append(row)
            places.append(f"line {line}")
        elif any(map(str.strip, row)) and not row[0].lstrip().startswith(COMMENTS):
            raise InputError(f"{path}, line {line}: {len(row)} fields, the header has {len(names)}")
    return pd.DataFrame(kept, columns=list(names), index=places)
