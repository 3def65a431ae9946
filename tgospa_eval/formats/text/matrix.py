"""A matrix of numbers: CSV without a header."""

from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import floats
from tgospa_eval.formats.loading import load, unpack
from tgospa_eval.formats.text.scan import check_text, decode
from tgospa_eval.text import quoted

MATRIX_DELIMITERS = ";\t,"


def read_matrix(path: str, decimal: str) -> list[list[float]]:
    """Read a square matrix: CSV without header, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing or unreadable, a field is no number, the matrix is not square.
    """
    data = unpack(load(path), path)
    if data:
        check_text(data, path)
    text = decode(data, path)
    delimiter = next((mark for mark in MATRIX_DELIMITERS if mark in text and mark != decimal), ";")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        raise InputError(f"{path}: the file is empty; a matrix d x d is needed, without header")
    matrix: list[list[float]] = []
    for number, line in lines:
        fields = line.split(delimiter)
        if len(fields) != len(lines):
            raise InputError(
                f"{path}, line {number}: {len(fields)} fields in a file of {len(lines)} rows; "
                "a matrix d x d is needed, without header"
            )
        matrix.append([])
        for column, field in enumerate(fields, start=1):
            try:
                matrix[-1].append(float(floats([field], decimal)[0]))
            except ValueError:
                raise InputError(
                    f"{path}, line {number}, column {column}: not a number: "
                    f"{quoted(field.strip())}; a matrix of numbers is needed, without header"
                ) from None
    return matrix
