"""Plain text to columns by a compiled loop: one pass, correctly rounded, no objects for fields.

A quick way only: whatever is not plainly right is left to the careful one, which reports what is
wrong and where. Nothing is different without it but the time.
"""

from typing import Any

import numpy as np

from tgospa_eval.common.compiled import compiled
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.fields import Coded
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.text.bulk import Layout
from tgospa_eval.formats.text.convert import Fields, text_columns

scanner: Any = compiled("tgospa_eval.formats.text._scan")
"""The extension module, or None."""

ODD = (b'"', *(mark[:1].encode() for mark in COMMENTS))
"""Letters of what may be not plain."""

AS_NUMBER, AS_TEXT = 1, 2
"""What a column is read as; it may be both."""

LONG_BYTES = 8_000_000
"""Bytes from which numbers of 16 digits and more are read faster by the parser of pandas."""

MOST_LONG = 1_000
"""Such numbers in a file of that size."""


def scanned(
    data: bytes,
    start: int,
    layout: Layout,
    roles: Roles,
    decimal: str,
    texts: tuple[int, ...] = (),
) -> Fields | None:
    """The columns of ASCII text whose rows begin at byte `start`; None if it is not plain.

    Plain are rows of the same number of fields, without quotes, comments, blank lines and returns,
    with numbers that are finite or blank.
    """
    if scanner is None or layout.delimiter == decimal or b"\r" in data:
        return None
    if any(data.find(mark, start) >= 0 for mark in ODD):
        return None
    wanted = text_columns(roles, texts)
    kinds = np.zeros(layout.width, np.uint8)
    kinds[list(roles.numbers)] |= AS_NUMBER
    kinds[list(wanted)] |= AS_TEXT
    most_long = MOST_LONG if len(data) >= LONG_BYTES else len(data)
    found = scanner.scan(data, start, layout.delimiter, decimal, kinds, most_long)
    if found is None:
        return None
    values, codes, distinct = found
    if list(roles.numbers) != sorted(roles.numbers):
        values = values[np.searchsorted(np.sort(roles.numbers), roles.numbers)]
    return Fields(
        lines=range(layout.first, layout.first + values.shape[1]),
        coded={column: Coded(distinct[k], codes[k]) for k, column in enumerate(sorted(wanted))},
        values=values.T,
    )
