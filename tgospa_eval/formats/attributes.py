"""Columns that are neither ids, times nor states, where they are asked for: numbers or texts."""

import numpy as np

from tgospa_eval.formats.fields import Coded, floats
from tgospa_eval.formats.rows import Rows
from tgospa_eval.tracks.attributes import Values
from tgospa_eval.tracks.trajectories import Ints


def attribute_of(column: Coded, decimal: str = ".") -> Values:
    """Numbers if every text that is not blank is one, NaN where blank; else the texts."""
    texts = [text.strip() for text in column.distinct]
    try:
        return floats([text or "nan" for text in texts], decimal)[column.code]
    except ValueError:
        table = np.empty(len(texts), dtype=object)
        table[:] = texts
        return np.asarray(table[column.code])


def attributes_of(rows: Rows, taken: Ints) -> dict[str, Values]:
    """What is asked for of some rows of a file, by name; of a cloud its first particle's."""
    roles = rows.roles
    found: dict[str, Values] = {}
    for name, column in roles.attributes.items():
        if column in rows.attributes:
            found[name] = rows.attributes[column][taken]
        elif column in roles.numbers:
            found[name] = rows.numbers[taken, roles.numbers.index(column)]
        elif column == roles.time and rows.times.text is None:
            found[name] = rows.times.value[taken].astype(np.float64)
        elif column == roles.time:
            found[name] = np.array([rows.moment(row) for row in taken.tolist()], dtype=object)
        else:
            numbered = rows.ids if column == roles.id else rows.classes
            assert numbered is not None  # a column is one of these or among the texts
            found[name] = attribute_of(Coded(numbered[0].tolist(), numbered[1][taken]))
    return found
