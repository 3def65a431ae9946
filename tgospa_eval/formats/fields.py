"""Fields of text: the one rule of what is a number, and columns that hold each text once."""

from collections.abc import Iterator, Sequence
from typing import overload

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.tracks.trajectories import Values

MISSING = frozenset(
    (
        *("", "NaN", "nan", "-NaN", "-nan", "NA", "<NA>", "N/A", "n/a", "NULL", "null", "None"),
        *("#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "1.#IND", "1.#QNAN"),
    )
)
"""Texts without a number: what pandas reads as missing."""


def floats(texts: Sequence[str], decimal: str = ".") -> Floats:
    """The exact doubles of a whole column; ValueError unless every text is a number."""
    joined = "".join(texts)
    if "_" in joined or not joined.isascii():  # float() takes 1_000 and digits of any script
        raise ValueError
    if decimal == ",":
        if "." in joined:
            raise ValueError
        texts = [text.replace(",", ".") for text in texts]
    return np.array(list(map(float, texts)), dtype=np.float64)


def is_number(text: str, decimal: str = ".") -> bool:
    """Whether a text is a number, with this mark if any."""
    if "_" in text or not text.isascii() or (decimal == "," and "." in text):  # as in `floats`
        return False
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class Coded(Sequence[str]):
    """A column of texts that holds each distinct text once.

    Parameters
    ----------
    distinct : list of str
        Distinct texts in the order in which they first appear.
    code : (R,) int array
        Which of them each row has.
    """

    distinct: list[str]
    code: Ints

    def __len__(self) -> int:
        return len(self.code)

    @overload
    def __getitem__(self, row: int) -> str: ...
    @overload
    def __getitem__(self, row: slice) -> list[str]: ...
    def __getitem__(self, row: int | slice) -> str | list[str]:
        if isinstance(row, slice):
            return [self.distinct[code] for code in self.code[row].tolist()]
        return self.distinct[int(self.code[row])]

    def __iter__(self) -> Iterator[str]:
        return map(self.distinct.__getitem__, self.code.tolist())


def joined_texts(first: Coded, second: Coded) -> Coded:
    """Two columns as one, with a blank between."""
    width = max(len(second.distinct), 1)
    pair, code = np.unique(first.code.astype(np.int64) * width + second.code, return_inverse=True)
    texts = [
        f"{first.distinct[a].strip()} {second.distinct[b].strip()}"
        for a, b in zip(*(part.tolist() for part in np.divmod(pair, width)), strict=True)
    ]
    return Coded(texts, code)


def attribute_of(column: Coded, decimal: str = ".") -> Values:
    """Numbers if every text that is not missing is one, NaN where it is; else the texts."""
    texts = [text.strip() for text in column.distinct]
    try:
        numbers = ["nan" if text in MISSING else text for text in texts]
        return floats(numbers, decimal)[column.code]
    except ValueError:
        table = np.empty(len(texts), dtype=object)
        table[:] = texts
        return np.asarray(table[column.code])
