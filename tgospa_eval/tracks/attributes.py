"""Attributes of states: what a table says of each beside where it is, by the name of its column."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.errors import InputError
from tgospa_eval.text import quoted

Values: TypeAlias = Floats | NDArray[np.object_]
"""Numbers, NaN where missing, or texts, blank where missing."""

Attributes: TypeAlias = Mapping[str, Values]
"""Values (R,) of each row, by name."""


ROW = "\0row"
"""The attribute with the number of the row of the file, as readers have it if it is asked for."""


def file_order(step: Ints, attributes: Attributes) -> Ints:
    """Rows (R,) step by step as their file has them; as they are if that is not known."""
    if ROW not in attributes:
        return np.arange(len(step))
    return np.lexsort((attributes[ROW], step))


def checked(attributes: Attributes, rows: int) -> dict[str, Values]:
    """Arrays of so many rows that cannot be written to: numbers as doubles, all else as texts.

    Raises
    ------
    InputError
        One is not of this length.
    """
    found: dict[str, Values] = {}
    for name, given in attributes.items():
        values = np.asarray(given)
        if values.shape != (rows,):
            raise InputError(
                f"attribute {quoted(name)} has the shape {values.shape}: must be ({rows},), a "
                "value for each row"
            )
        kept: Values
        if values.dtype.kind in "iuf":
            kept = np.asarray(values, np.float64)
        elif values.dtype.kind == "O" and all(isinstance(text, str) for text in values.tolist()):
            kept = values.astype(object, copy=False)
        else:
            texts = ["" if value is None else str(value) for value in values.tolist()]
            kept = np.array(texts, dtype=object)
        found[str(name)] = kept.view()
        found[str(name)].setflags(write=False)
    return found


def chosen(attributes: Attributes, rows: Ints) -> dict[str, Values]:
    """Those of some rows."""
    return {name: values[rows] for name, values in attributes.items()}


def stacked(first: Attributes, second: Attributes, rows: int) -> dict[str, Values]:
    """The attributes of the first, with so many more rows; missing where the second lacks one."""
    found: dict[str, Values] = {}
    for name, values in first.items():
        missing = np.full(rows, np.nan if values.dtype.kind == "f" else "", values.dtype)
        found[name] = np.concatenate((values, second.get(name, missing)))
    return found
