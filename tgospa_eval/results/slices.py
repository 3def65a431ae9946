"""Costs and counts split into slices by attributes of truth and estimate, and their sums."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.results.records import PARTS, Columns, Json, records

if TYPE_CHECKING:
    import pandas as pd

CROSSED = " * "
"""Text between two attributes, or their values, if an evaluation is split by both."""

NO_VALUE, NO_ATTRIBUTE, UNNAMED = "(missing)", "(none)", "(others)"
"""Names of slices: of states without a value, of states of a file without the attribute, and of all
texts that the user did not name."""

UNDER, BEYOND_LAST, AND_MORE = "below ", "above ", " and more"
"""Words in the names of slices below the first edge or above the last edge."""

BETWEEN_EDGES = " to "


@dataclass(frozen=True, kw_only=True)
class Slice:
    """Numbers of one slice; fields of all slices add up to those of the evaluation.

    Parameters
    ----------
    name : str
        Range or value of the attribute.
    localisation, missed, false, switch : float
        Costs, in state units to the power p.
    missed_count, false_count, switch_count : float
        Numbers of missed targets, false targets and switches.
    truth_steps, estimate_steps : float
        Numbers of states of truth and of estimate in the slice. They are fractions if an attribute
        splits states between slices.
    assigned_steps, squared_error : float
        Number of assigned states of the truth in the slice, and the sum of their squared errors;
        NaN in results of older versions.
    """

    name: str
    localisation: float
    missed: float
    false: float
    switch: float
    missed_count: float
    false_count: float
    switch_count: float
    truth_steps: float
    estimate_steps: float
    assigned_steps: float = math.nan
    squared_error: float = math.nan

    @property
    def detection_rate(self) -> float | None:
        """Share of the states of the truth that are assigned, as in the summary."""
        return _ratio(self.assigned_steps, self.truth_steps)

    @property
    def rmse(self) -> float | None:
        """Root mean square of the error of assigned states."""
        square = _ratio(self.squared_error, self.assigned_steps)
        return None if square is None else math.sqrt(square)

    @property
    def total(self) -> float:
        """Sum of the costs of the slice."""
        return math.fsum(getattr(self, part) for part in PARTS)


def _known(value: float | None) -> float | None:
    return None if value is None or value != value else value


def _ratio(value: float, by: float) -> float | None:
    return value / by if by > 0 and value == value else None


SLICE_NUMBERS = tuple(field.name for field in fields(Slice))[1:]
"""Names of the numbers of a slice, without the total."""

OLDER_NUMBERS = SLICE_NUMBERS[:-2]
"""Names of the numbers that results of older versions have, too."""

RATIOS = ("detection_rate", "rmse")
"""Names of numbers that are ratios of other numbers; None if the divisor is 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slicing:
    """An evaluation split by one attribute, or by two attributes.

    Parameters
    ----------
    by : str
        The attribute, or both, as requested.
    slices : tuple of Slice
        Slices in the order of their ranges or values.
    unique : bool
        Whether the best assignment is proven to be the only one; then the split is unique, too.
    """

    by: str
    slices: tuple[Slice, ...]
    unique: bool

    @property
    def total(self) -> float:
        """Sum of the costs of all slices, which is the cost of the evaluation."""
        return math.fsum(getattr(part, name) for part in self.slices for name in PARTS)

    def __repr__(self) -> str:
        costs = ", ".join(f"{part.name}: {part.total:.6g}" for part in self.slices)
        return f"Slicing({self.by!r}, total={self.total:.6g}; {costs})"

    def table(self) -> Columns:
        """Return a table with a row for each slice."""
        names = ("total", *SLICE_NUMBERS)
        return {"slice": [part.name for part in self.slices]} | {
            name: [_known(getattr(part, name)) for part in self.slices] for name in names + RATIOS
        }

    @property
    def frame(self) -> "pd.DataFrame":
        """Slices as a DataFrame."""
        import pandas as pd  # lazy: importing it takes longer than most evaluations

        return pd.DataFrame(self.table())

    def record(self) -> Json:
        """Return the slices as a record for the JSON of a result."""
        return {"by": self.by, "unique": self.unique, "slices": records(self.table())}

    @classmethod
    def of(cls, record: Json) -> "Slicing":
        """Restore the slices from the result of `record`."""
        slices = [
            Slice(name=row["slice"], **{name: row[name] for name in SLICE_NUMBERS if name in row})
            for row in record["slices"]
        ]
        return cls(by=record["by"], slices=tuple(slices), unique=record["unique"])


def added_up(groups: Iterable[Sequence[Slicing]]) -> Iterator[Slicing]:
    """Add the slices of several evaluations, and yield the sums for each attribute.

    Slices with the same name are added. Not all evaluations need to be split by all attributes.
    """
    by_key: dict[str, list[Slicing]] = {}
    for group in groups:
        for part in group:
            by_key.setdefault(part.by, []).append(part)
    for by, parts in by_key.items():
        rows: dict[str, list[Slice]] = {}
        for one in (one for part in parts for one in part.slices):
            rows.setdefault(one.name, []).append(one)
        slices = tuple(
            Slice(
                name=name,
                **{
                    key: math.fsum(getattr(row, key) for row in rows[name]) for key in SLICE_NUMBERS
                },
            )
            for name in in_order(rows)
        )
        yield Slicing(by=by, slices=slices, unique=all(part.unique for part in parts))


def slices_columns(slicings: Sequence[Slicing]) -> Columns:
    """Return the slices by all attributes in one table; its first column names the attribute."""
    tables: list[tuple[str, Mapping[str, Sequence[object]]]] = [
        (one.by, one.table()) for one in slicings
    ]
    columns: Columns = {"by": [by for by, table in tables for _ in table["slice"]]}
    for name in ("slice", "total", *SLICE_NUMBERS, *RATIOS):
        columns[name] = [value for _, table in tables for value in table[name]]
    return columns


def in_order(names: Iterable[str]) -> list[str]:
    """Sort names of slices: ranges and numbers by value, then texts, then special names."""
    return sorted(names, key=lambda name: [_place(part) for part in name.split(CROSSED)])


def _place(name: str) -> tuple[int, float, tuple[list[tuple[int, int, str]], str]]:
    """Return the sort key of the name of a slice."""
    for last, special in enumerate((UNNAMED, NO_VALUE, NO_ATTRIBUTE), start=4):
        if name == special:
            return last, 0.0, natural("")
    if name.startswith(UNDER):
        return 0, 0.0, natural("")
    if name.startswith(BEYOND_LAST):
        return 3, 0.0, natural("")
    try:
        return 1, float(name.partition(BETWEEN_EDGES)[0].removesuffix(AND_MORE)), natural("")
    except ValueError:
        return 2, 0.0, natural(name)
