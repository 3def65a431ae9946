"""What associate and reduce found, as tables, JSON and CSV."""

from collections.abc import Mapping, Sequence

from tgospa_eval.common.words import counted
from tgospa_eval.sensors.association import Pairing
from tgospa_eval.show.rendering import Table, text_lines

Spread = dict[str, float]
"""Smallest, median and largest of some numbers, by these names: min, median, max."""

ROWS = 40
"""Rows that a table on stdout shows at most."""

ROUNDING = 1e-9
"""Shift of a mean, as a share of the distance to the cloud, that is nothing but rounding."""


def association_text(found: Pairing, *, rows: bool = True) -> str:
    """Counts, and the associations in columns."""
    count, (rest_a, rest_b) = int(found.chosen.sum()), found.unassigned
    lines = [
        f"{count} associated, {rest_a} of A and {rest_b} of B alone, in "
        f"{counted(len(found.first.times), 'step')}",
        f"sum {found.total:.6g}: distances, and {found.cutoff / 2:g} for each state that stays "
        "alone\n",
    ]
    if rows:
        table = list(zip(*found.associations_table().values(), strict=True))
        lines += _columns(("t", "A", "B", "distance", "of means"), table)
    return "\n".join(lines) + "\n"


def reduction_text(counts: Mapping[str, int], change: Mapping[str, Spread | None]) -> str:
    """What changed, on the whole; the arguments are parts of the document."""
    shown = {
        "Wasserstein distance to the cloud": change["wasserstein"],
        "sliced Wasserstein distance": change["sliced_wasserstein"],
        "shift of the mean": change["mean_shift"],
    }
    rows = [(name, value["median"], value["max"]) for name, value in shown.items() if value]
    lines = [
        f"{counted(counts['clouds'], 'cloud')}, {counted(counts['particles'], 'particle')} -> "
        f"{counts['kept']}\n"
    ]
    if len(rows) > 1 and rows[-1][2] <= ROUNDING * rows[-2][2]:
        lines += [*_columns(("", "median", "largest"), rows[:-1]), "means kept"]
    else:
        lines += _columns(("", "median", "largest"), rows)
    kept = change["trace_kept"]
    if kept:
        lines.append(
            f"kept of the trace of the covariance: {100 * kept['median']:.4g} %, at least "
            f"{100 * kept['min']:.4g} %"
        )
    return "\n".join(lines) + "\n"


def _columns(head: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Aligned columns; of many rows the first ones."""
    table = Table(head=head, rows=[list(map(_cell, row)) for row in rows[:ROWS]])
    lines = text_lines(table, "") if rows else []
    rest = len(rows) - ROWS
    return [*lines, f"and {rest} more; all of them: --format csv"] if rest > 0 else lines


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
