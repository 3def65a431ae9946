"""Small text files for an evaluation: a matrix of numbers, and weights of steps."""

import csv

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import TimeError, floats, is_number, parse_times
from tgospa_eval.formats.headers import FIRST_ALIASES
from tgospa_eval.formats.loading import load, unpack
from tgospa_eval.formats.text.lines import check_text, decode, numbers
from tgospa_eval.quoting import quoted
from tgospa_eval.tracks.weights import WeightsByTime, repeated

MATRIX_NEEDED = "a matrix d x d is needed, without header"
WEIGHTS_HEADER = "t,weight[,switch_weight]"


def read_matrix(path: str, decimal: str) -> list[list[float]]:
    """Read a square matrix from CSV without a header, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing or unreadable, a field is not a number, or the matrix is not square.
    """
    data = unpack(load(path), path)
    lines, rows = rows_of(data, path, decimal) if data.strip() else ([], [])
    if not rows:
        raise InputError(f"{path}: the file is empty; {MATRIX_NEEDED}")
    for line, fields in zip(lines, rows, strict=True):
        if len(fields) != len(rows):
            raise InputError(
                f"{path}, line {line}: {counted(len(fields), 'field')} in a file of "
                f"{counted(len(rows), 'row')}; {MATRIX_NEEDED}"
            )
        for column, field in enumerate(fields, start=1):
            if not is_number(field, decimal):
                raise InputError(
                    f"{path}, line {line}, column {column}: not a number: "
                    f"{quoted(field.strip())}; a matrix of numbers is needed, without header"
                )
    return [floats(fields, decimal).tolist() for fields in rows]


def read_step_weights(path: str, decimal: str = ".") -> WeightsByTime:
    """Read the weights of steps: one row per step, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing or has other columns, a row is wrong, or a time is a duplicate.
    """
    lines, rows = rows_of(unpack(load(path), path), path, decimal, even=True)
    names = [name.strip().lower() for name in rows[0]] if rows else []
    time = next((name for name in names if name in FIRST_ALIASES["t"]), "")
    if not time or "weight" not in names:
        missing = "weight" if time else "t"
        raise InputError(
            f"{path}, line {lines[0] if lines else 1}: no column {quoted(missing)}; weights of "
            f"steps are a CSV file with the header {WEIGHTS_HEADER}"
        )
    if len(rows) == 1:
        raise InputError(f"{path}: a header alone; give every step of the two files a row")
    columns = dict(zip(names, zip(*rows[1:], strict=True), strict=True))

    def wrong(row: int, name: str, what: str) -> InputError:
        return InputError(f'{path}, line {lines[1 + row]}, column "{name}": {what}')

    def weights(name: str) -> Floats:
        """Return a column of finite numbers >= 0."""
        values, faults = numbers(columns[name], decimal)
        for row, message in faults:
            raise wrong(row, name, message)
        odd = np.flatnonzero(~(values >= 0))
        if len(odd):
            text = columns[name][odd[0]].strip()
            what = f"a weight of {text}" if text else "a blank weight"
            remedy = "write a number >= 0, 0 for a step that does not count"
            raise wrong(int(odd[0]), name, f"{what}{more(len(odd))}; {remedy}")
        return values

    try:
        times = parse_times(columns[time], lambda texts: floats(texts, decimal))
    except TimeError as error:
        raise wrong(error.row, time, str(error)) from None
    again = repeated(times.value)
    if again is not None:
        later, before, count = again
        what = f"t = {columns[time][later]} is a duplicate{more(count)}"
        remedy = f"first on line {lines[1 + before]}; give each step one row"
        raise wrong(later, time, f"{what}, {remedy}")
    cost = weights("weight")
    switch = weights("switch_weight") if "switch_weight" in names else cost
    return WeightsByTime(times=times.value, cost=cost, switch=switch, clock=times.clock, name=path)


def rows_of(
    data: bytes, path: str, decimal: str, *, even: bool = False
) -> tuple[list[int], list[list[str]]]:
    """Return line numbers and fields of all rows; the first row decides the delimiter.

    With `even`, the first row is a header, and all rows must have as many fields as the header.
    """
    check_text(data, path)
    text = decode(data, path)
    head = text.lstrip("\n").partition("\n")[0]
    delimiter = max("\t;,", key=lambda mark: (mark != decimal and mark in head, head.count(mark)))
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
    for line, row in zip(lines, rows, strict=True) if even else ():
        if len(row) != len(rows[0]):
            raise InputError(
                f"{path}, line {line}: {counted(len(row), 'field')}, the header has {len(rows[0])}"
            )
    return lines, rows
