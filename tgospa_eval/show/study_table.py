"""Main table of a study: RMS-TGOSPA of each tracker, its parts, intervals, and more."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import THOUSANDS, number
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import LOWER, NUMBERS, SHARES, SUMMARY
from tgospa_eval.show.result_text import COMPARED, LOW, SHORT_NAMES, other_value
from tgospa_eval.show.table_text import PART_HEADS, Table, best_cells, between, parameters_of

PART_COLUMNS = dict(zip(("loc", *PARTS[1:]), PARTS, strict=True))
"""Part of the cost in a column, by the name of the column that users type."""

OF_METRICS = {
    parts[0].lower() if metric != "gospa" else metric: (metric, parts[0])
    for metric, parts in COMPARED.items()
}
"""Metric and its main value in each of the columns hota, mota, idf1 and gospa."""

ALIASES = {"detection": "detection_rate", "error": "mean_error"}
"""Short names that can be used for numbers of the summary."""

COLUMNS = ("jobs", "tgospa", "interval", *PART_COLUMNS, "place", "p", "mean_of_roots")
"""Columns that need no other metric. By default, all of them are shown that have information, see
`_says_nothing`."""

INTERVAL = "95 % interval"
"""Head of the column with confidence intervals for the values in the column before it."""

MIN_P = 1e-4
"""Smallest p value that is shown as a number. Smaller ones are shown as "<0.0001"."""

NARROW = 1e-9
"""Largest relative distance of two bounds at which they are shown as one number."""

DISTINCT = 1e-10
"""Largest relative difference of two numbers that can come from rounding errors alone."""

DIGITS, MAX_DECIMALS = 4, 6
"""Number of significant digits of the largest value in a column, and limit of the decimals of all
values in the column."""

WIDE_COLUMNS = 7
"""Smallest number of columns of a table that LaTeX sets over both columns of a page."""


@dataclass(frozen=True, kw_only=True)
class StudyRow:
    """Row of the main table: a tracker, or a group of jobs.

    Parameters
    ----------
    names : tuple of str
        Names that distinguish the row from others.
    jobs : str
        Number of runs with a value; "3 of 4" if one of four runs has no value.
    steps, order : float
        Mean number of steps of the runs, and the order p.
    total : Interval
        Bounds of the mean total of the runs, in state units to the power p.
    costs : mapping of str to float
        Mean cost over the runs, for each part.
    confidence : pair of float, optional
        Ends of the 95 % interval of `value`.
    place : str
        Proven place in words.
    p : float, optional
        P value of the difference to the best row, adjusted by Holm's method. It is NaN for the best
        row itself, and None without a test.
    mean_of_roots : float, optional
        Mean of the values per step of the single runs.
    numbers : mapping of str to float
        Numbers of the summary and of other metrics by name, such as ``summary.rmse`` and
        ``hota.HOTA``.
    """

    names: tuple[str, ...]
    jobs: str
    steps: float
    order: float
    total: Interval
    costs: Mapping[str, float]
    confidence: tuple[float, float] | None = None
    place: str = ""
    p: float | None = None
    mean_of_roots: float | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def value(self) -> Interval:
        """Bounds of RMS-TGOSPA: (sum of the totals / sum of the steps)^(1/p) over the runs."""
        return self.rooted(self.steps)

    def rooted(self, steps: float = 1.0) -> Interval:
        """Return the bounds of (total / `steps`)^(1/p)."""
        ends = ((end / steps) ** (1 / self.order) for end in (self.total.lower, self.total.upper))
        return Interval(lower=next(ends), upper=next(ends))

    def part(self, name: str) -> float:
        """Return (cost of the part / steps)^(1/p)."""
        root: float = (self.costs[name] / self.steps) ** (1 / self.order)
        return root


def checked_columns(columns: Iterable[str]) -> tuple[str, ...]:
    """Check that these columns exist, and return their names.

    Raises
    ------
    ConfigError
        A name is not a column.
    """
    listed_names = columns.split(",") if isinstance(columns, str) else columns
    names = tuple(filter(None, map(str.strip, listed_names)))
    for name in names:
        own = ALIASES.get(name, name).removeprefix(f"{SUMMARY}.")
        known = own in (*COLUMNS, *NUMBERS, *OF_METRICS) or own.startswith("rmse_by_axis.")
        if not known:
            there = listed([*COLUMNS, *OF_METRICS, *ALIASES, *NUMBERS], len(COLUMNS) + 12)
            raise ConfigError(
                f"{option('columns_of_table')} {quoted(name)}: there is no such column; there are "
                f"{there}"
            )
    return names


def value_name(order: float | None, jobs: int) -> str:
    """Return the name of the value per step over this number of jobs.

    `order` is None if rows have several orders.
    """
    return "RMS-TGOSPA" if order == 2 and jobs > 1 else "TGOSPA per step"


def study_caption(title: str, parameters: Mapping[str, Any]) -> str:
    """Return the caption of the table for a paper."""
    about = parameters_of(parameters).replace("gamma", "\u03b3")
    return (
        f"{title} and its parts over runs and time steps{' (' * bool(about)}{about}"
        f"{')' * bool(about)}. Best in bold, second best underlined."
    )


def study_table(
    rows: Sequence[StudyRow],
    heads: Sequence[str],
    rivals: Sequence[Sequence[int]],
    title: str,
    requested: Sequence[str] = (),
    caption: str = "",
) -> Table:
    """Return the main table.

    Parameters
    ----------
    rows : sequence of StudyRow
        Rows of the table, at least one.
    heads : sequence of str
        Heads of the columns with the names of a row.
    rivals : sequence of sequence of int
        Lists of row indices. The rows of each list are compared, and the best values are marked.
    title : str
        Head of the column with the value per step.
    requested : sequence of str
        Names of the columns. By default these are `COLUMNS`, except those without information.
    caption : str
        Caption of the table in LaTeX.

    Raises
    ------
    ConfigError
        A name is not a column.
    """
    columns: dict[str, Sequence[str]] = {}
    compared: dict[int, list[Interval]] = {}
    for name in dict.fromkeys(requested) or COLUMNS:
        for head, cells, worse in _columns(name, rows, title, wanted=bool(requested)):
            if requested or (any(cells) and not _says_nothing(name, cells)):
                if worse:
                    compared[len(heads) + len(columns)] = worse
                columns[head] = [cell or "-" for cell in cells]
    names = zip(*(row.names for row in rows), strict=True)
    table: list[Sequence[str]] = [*names, *columns.values()]
    return Table(
        head=(*heads, *columns),
        rows=list(zip(*table, strict=True)),
        labels=len(heads),
        bold=best_cells(compared, rivals),
        underlined=best_cells(compared, rivals, place=2),
        caption=caption,
        is_wide=len(table) >= WIDE_COLUMNS,
    )


def _says_nothing(name: str, cells: Sequence[str]) -> bool:
    """Check whether a column has no information: equal numbers of jobs, or places 1, 2, 3, ..."""
    if name == "jobs":
        return len(set(cells)) == 1
    return name == "place" and list(cells) == [str(k + 1) for k in range(len(cells))]


Column = tuple[str, Sequence[str], list[Interval]]
"""Head, cells, and a list of values. The cell with the smallest value is marked as the best. If the
list is empty, no cell is marked."""


def _columns(name: str, rows: Sequence[StudyRow], title: str, *, wanted: bool) -> Iterator[Column]:
    """Yield the column with this name.

    Nothing is yielded if the name is ``mean_of_roots`` and no row has this value.

    Raises
    ------
    ConfigError
        The rows lack the value, and the column is `wanted`.
    """
    if name == "jobs":
        yield "jobs", [row.jobs for row in rows], []
    elif name == "tgospa":
        values = [row.value for row in rows]
        yield title, aligned(values, DIGITS + 1), values
    elif name == "interval":
        ends = [row.confidence for row in rows]
        largest = max((high for low, high in filter(None, ends)), default=0.0)
        digits = [
            [fixed(_exact(end), largest, DIGITS - 1) for end in both] if both else []
            for both in ends
        ]
        yield INTERVAL, [" to ".join(both) for both in digits], []
    elif name in PART_COLUMNS:
        part = PART_COLUMNS[name]
        values = [_exact(row.part(part)) for row in rows]
        yield PART_HEADS[PARTS.index(part)], aligned(values), []
    elif name == "place":
        yield "place", [row.place for row in rows], []
    elif name == "p":
        yield "p", ["" if row.p is None else _p_value(row.p) for row in rows], []
    elif name == "mean_of_roots":
        means = [row.mean_of_roots for row in rows if row.mean_of_roots is not None]
        if means:
            yield "mean of roots", [number(mean) for mean in means], []
        elif wanted:
            raise ConfigError(
                f"{option('columns_of_table', name)}: is missing; {option('mean_of_roots')} of a "
                "batch adds it"
            )
    elif name == "gospa" and any("gospa.total" in row.numbers for row in rows):
        costs = [row.numbers["gospa.total"] / row.steps for row in rows]
        roots = [_exact(cost ** (1 / row.order)) for cost, row in zip(costs, rows, strict=True)]
        yield title.replace("TGOSPA", "GOSPA"), aligned(roots), _distinct(roots)
    else:
        yield _of_number(name, rows)


def _of_number(name: str, rows: Sequence[StudyRow]) -> Column:
    """Return a column with a number of the summary, or of another metric.

    Numbers of the summary depend on the assignment. Therefore, the best number is marked only if
    TGOSPA of all rows is exact.

    Raises
    ------
    ConfigError
        The rows lack the number.
    """
    metric, part = OF_METRICS.get(name, ("", ""))
    own = ALIASES.get(name, name).removeprefix(f"{SUMMARY}.")
    path = f"{metric}.{part}" if metric else f"{SUMMARY}.{own}"
    if not any(path in row.numbers for row in rows) and (metric or own not in NUMBERS):
        more = f"; {option('with_', metric)} adds it" if metric else ""
        raise ConfigError(f"{option('columns_of_table', name)}: is missing{more}")
    values = [row.numbers.get(path, math.nan) for row in rows]
    if metric:
        low, cells = part in LOW, [other_value(part, {part: value}) for value in values]
    else:
        low = own in LOWER
        cells = _shares(values) if own in SHARES else aligned([_exact(value) for value in values])
    known = [value for value in values if value == value]
    has_best = metric or (
        (low or own in SHARES)
        and all(row.total.upper - row.total.lower <= NARROW * row.total.upper for row in rows)
    )
    distances: list[Interval] = []
    if has_best and len(known) == len(values):
        distances = _distinct([_exact(value if low else -value) for value in values])
    head = SHORT_NAMES.get(part, part) if metric else name.replace("_", " ")
    return head, cells, distances


def _distinct(values: Sequence[Interval]) -> list[Interval]:
    """Return the differences between the values and the smallest one, without rounding errors."""
    smallest, largest = (end(value.upper for value in values) for end in (min, max))
    width = DISTINCT * max(abs(smallest), abs(largest)) or 1.0
    return [_exact(round((value.upper - smallest) / width)) for value in values]


def _exact(value: float) -> Interval:
    return Interval(lower=value, upper=value)


def _shares(values: Sequence[float]) -> list[str]:
    return [f"{100 * value:.1f} %" if value == value else "-" for value in values]


def _p_value(p: float) -> str:
    if p != p:
        return "-"
    return f"<{MIN_P:g}" if p < MIN_P else f"{p:.2g}"


def aligned(values: Sequence[Interval], digits: int = DIGITS) -> list[str]:
    """Format values with the same number of decimals, with `digits` digits for the largest."""
    largest = max((abs(value.upper) for value in values if math.isfinite(value.upper)), default=0.0)
    return [fixed(value, largest, digits) for value in values]


def fixed(value: Interval, largest: float, digits: int = DIGITS) -> str:
    """Format the bounds of a value: one number, or both if they look different.

    There are so many decimals that the value `largest` would have `digits` significant digits.
    """
    if not math.isfinite(value.upper):
        return "-"
    decimals = max(0, digits - 1 - math.floor(math.log10(largest))) if largest > 0 else 0
    form = f",.{decimals}f"
    if largest >= THOUSANDS or decimals > MAX_DECIMALS:
        form = f".{digits - 1}e"
    low, high = (f"{end:{form}}" for end in (value.lower, value.upper))
    is_one = value.upper - value.lower <= NARROW * value.upper
    return high if low == high or is_one else f"{low} to {high}"


def costs_table(
    rows: Sequence[StudyRow],
    heads: Sequence[str],
    rivals: Sequence[Sequence[int]],
    caption: str = "",
) -> Table:
    """Return the table of costs: means over runs of the total and its parts, in state units^p.

    The column before these costs has TGOSPA, the p-th root of the mean total. The parameters are
    those of `study_table`.
    """
    roots, totals = [row.rooted() for row in rows], [row.total for row in rows]
    cells = [
        (
            *row.names,
            *(between(value.lower, value.upper) for value in (root, row.total)),
            *(number(row.costs[part], 5) for part in PARTS),
        )
        if math.isfinite(row.total.upper)
        else (*row.names, *["-"] * (2 + len(PARTS)))
        for row, root in zip(rows, roots, strict=True)
    ]
    return Table(
        head=(*heads, "TGOSPA", "total", *PART_HEADS),
        rows=cells,
        labels=len(heads),
        bold=best_cells({len(heads): roots, len(heads) + 1: totals}, rivals),
        caption=f"Costs of a run. {caption}" if caption else "",
        is_wide=True,
    )
