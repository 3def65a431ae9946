"""Weights of steps: CSV ``t,weight[,switch_weight]``."""

import csv
from collections.abc import Callable

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import FIRST_ALIASES
from tgospa_eval.formats.fields import floats
from tgospa_eval.formats.loading import load, unpack
from tgospa_eval.formats.text.scan import check_text, decode, numbers
from tgospa_eval.formats.times import TimeError, parse_times
from tgospa_eval.text import quoted
from tgospa_eval.tracks.step_weights import WeightsByTime, repeated
from tgospa_eval.tracks.trajectories import Floats

WEIGHTS_HEADER = "t,weight[,switch_weight]"


def read_step_weights(path: str, decimal: str = ".") -> WeightsByTime:
    """Read what each step counts: one row per step, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing, has other columns, a row is wrong, or a time is there twice.
    """
    data = unpack(load(path), path)
    check_text(data, path)
    text = decode(data, path)
    head = text.lstrip("\n").partition("\n")[0]
    delimiter = max(";\t,", key=lambda mark: (mark != decimal and mark in head, head.count(mark)))
    lines, rows = _rows(text, delimiter, path)
    names = [name.strip().lower() for name in rows[0]] if rows else []
    times = next((k for k, name in enumerate(names) if name in FIRST_ALIASES["t"]), None)
    if times is None or "weight" not in names:
        lacking = "t" if times is None else "weight"
        raise InputError(
            f"{path}, line {lines[0] if lines else 1}: no column {quoted(lacking)}; weights of "
            f"steps are a CSV file with the header {WEIGHTS_HEADER}"
        )
    for line, row in zip(lines, rows, strict=True):
        if len(row) != len(names):
            raise InputError(
                f"{path}, line {line}: {counted(len(row), 'field')}, the header has {len(names)}"
            )
    if len(rows) == 1:
        raise InputError(f"{path}: a header alone; give every step of the two files a row")
    lines, columns = lines[1:], list(zip(*rows[1:], strict=True))

    def weights(name: str) -> Floats:
        return _weights(columns[names.index(name)], decimal, lambda row: where(row, name))

    def where(row: int, name: str) -> str:
        return f'{path}, line {lines[row]}, column "{name}"'

    try:
        found = parse_times(columns[times], lambda texts: floats(texts, decimal))
    except TimeError as error:
        raise InputError(f"{where(error.row, names[times])}: {error}") from None
    again = repeated(found.value)
    if again is not None:
        later, before, count = again
        raise InputError(
            f"{where(later, names[times])}: t = {columns[times][later]} is there twice"
            f"{more(count)}, first on line {lines[before]}; give each step one row"
        )
    cost = weights("weight")
    switch = weights("switch_weight") if "switch_weight" in names else cost
    return WeightsByTime(times=found.value, cost=cost, switch=switch, clock=found.clock, name=path)


def _rows(text: str, delimiter: str, path: str) -> tuple[list[int], list[list[str]]]:
    """Line and fields of each row that is not blank."""
    reader = csv.reader(text.split("\n"), delimiter=delimiter, strict=True, skipinitialspace=True)
    lines: list[int] = []
    rows: list[list[str]] = []
    try:
        for row in reader:
            if any(field.strip() for field in row):
                lines.append(reader.line_num)
                rows.append(row)
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {error}") from None
    return lines, rows


def _weights(texts: tuple[str, ...], decimal: str, where: Callable[[int], str]) -> Floats:
    """A column of weights: finite numbers >= 0."""
    values, wrong = numbers(texts, decimal)
    for row, message in wrong:
        raise InputError(f"{where(row)}: {message}")
    odd = np.flatnonzero(~(values >= 0))
    if len(odd):
        row = int(odd[0])
        what = f"a weight of {texts[row].strip()}" if texts[row].strip() else "a blank weight"
        raise InputError(
            f"{where(row)}: {what}{more(len(odd))}; write a number >= 0, 0 for a step that does "
            "not count"
        )
    return values
