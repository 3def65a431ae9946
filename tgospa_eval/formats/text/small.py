"""Small files of text beside the tracks: a matrix of numbers, and weights of steps."""

import csv

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

MATRIX_NEEDED = "a matrix d x d is needed, without header"
WEIGHTS_HEADER = "t,weight[,switch_weight]"


def read_matrix(path: str, decimal: str) -> list[list[float]]:
    """Read a square matrix: CSV without header, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing or unreadable, a field is no number, the matrix is not square.
    """
    data = unpack(load(path), path)
    lines, rows = _rows(data, path, decimal) if data.strip() else ([], [])
    if not rows:
        raise InputError(f"{path}: the file is empty; {MATRIX_NEEDED}")
    matrix: list[list[float]] = []
    for line, fields in zip(lines, rows, strict=True):
        if len(fields) != len(rows):
            raise InputError(
                f"{path}, line {line}: {counted(len(fields), 'field')} in a file of "
                f"{counted(len(rows), 'row')}; {MATRIX_NEEDED}"
            )
        matrix.append([])
        for column, field in enumerate(fields, start=1):
            try:
                matrix[-1].append(float(floats([field], decimal)[0]))
            except ValueError:
                raise InputError(
                    f"{path}, line {line}, column {column}: not a number: "
                    f"{quoted(field.strip())}; a matrix of numbers is needed, without header"
                ) from None
    return matrix


def read_step_weights(path: str, decimal: str = ".") -> WeightsByTime:
    """Read what each step counts: one row per step, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing, has other columns, a row is wrong, or a time is there twice.
    """
    lines, rows = _rows(unpack(load(path), path), path, decimal)
    names = [name.strip().lower() for name in rows[0]] if rows else []
    times = next((k for k, name in enumerate(names) if name in FIRST_ALIASES["t"]), None)
    if times is None or "weight" not in names:
        missing = "t" if times is None else "weight"
        raise InputError(
            f"{path}, line {lines[0] if lines else 1}: no column {quoted(missing)}; weights of "
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

    def where(row: int, name: str) -> str:
        return f'{path}, line {lines[row]}, column "{name}"'

    def weights(name: str) -> Floats:
        """A column of finite numbers >= 0."""
        texts = columns[names.index(name)]
        values, wrong = numbers(texts, decimal)
        for row, message in wrong:
            raise InputError(f"{where(row, name)}: {message}")
        odd = np.flatnonzero(~(values >= 0))
        if len(odd):
            text = texts[int(odd[0])].strip()
            raise InputError(
                f"{where(int(odd[0]), name)}: {f'a weight of {text}' if text else 'a blank weight'}"
                f"{more(len(odd))}; write a number >= 0, 0 for a step that does not count"
            )
        return values

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


def _rows(data: bytes, path: str, decimal: str) -> tuple[list[int], list[list[str]]]:
    """Line and fields of each row that is not blank; the first one decides the delimiter."""
    check_text(data, path)
    text = decode(data, path)
    head = text.lstrip("\n").partition("\n")[0]
    delimiter = max(";\t,", key=lambda mark: (mark != decimal and mark in head, head.count(mark)))
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
