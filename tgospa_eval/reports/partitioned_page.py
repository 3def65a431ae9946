"""The page of a result of data in parts: costs over time, the worst by name; without a script.

Words and shapes from a template; the page loads nothing. Everything that comes from the user passes
through the autoescape of the template.
"""

from collections.abc import Sequence

import numpy as np

from tgospa_eval.common.figures import number
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.drawn import Drawn, PageData, thinned
from tgospa_eval.reports.tables import Table
from tgospa_eval.reports.ticks import ROOM, Tick, round_steps
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import PARTS, Time

SHOWN_ROWS = 20
"""Steps, truths, estimates and switches that are listed."""

TICKS_ACROSS = 5


@dataclass(frozen=True)
class Shape:
    """A part of a chart.

    Parameters
    ----------
    name : str
        Which part of the cost, or the total.
    looks : str
        ``"area"`` or ``"line"``.
    path : str
        Of SVG, in percent of the width and from the top.
    """

    name: str
    looks: str
    path: str


@dataclass(frozen=True)
class TimeChart:
    """Something over time, with ticks.

    Parameters
    ----------
    shapes : sequence of Shape
        Drawn one over the other.
    up, across : sequence of Tick
        Of the two axes.
    """

    shapes: Sequence[Shape]
    up: Sequence[Tick]
    across: Sequence[Tick]


def partitioned_values(result: PartitionedResult, drawn: Drawn | None) -> dict[str, object]:
    """What the template takes beside the values that every page has."""
    data = (thinned(result) if drawn is None else drawn)[0]
    return {
        "together": data.get("together", 1),
        "costs": _stacked(data),
        "curve": _lines(data),
        "tables": [
            ("h-steps", "Costliest steps", _steps(result)),
            ("h-truths", "Costliest truths", _tracks(result, "missed")),
            ("h-estimates", "Costliest estimates", _tracks(result, "false")),
            ("h-switches", *_switches(result)),
        ],
    }


def _stacked(data: PageData) -> TimeChart:
    """Costs as bars without gaps, one part on the other."""
    tops = np.cumsum([data["costs"][name] for name in PARTS], axis=0).reshape(len(PARTS), -1)
    high = ROOM * float(tops.max(initial=0.0)) or 1.0
    bases = np.vstack([np.zeros(tops.shape[1]), tops[:-1]])
    shapes = [
        Shape(name, "area", _between(top, base, high))
        for name, top, base in zip(PARTS, tops, bases, strict=True)
        if (top > base).any()
    ]
    return TimeChart(shapes, _up(high), _across(data["times"]))


def _lines(data: PageData) -> TimeChart:
    """The cumulative cost, a line for each part and for the total."""
    names = ("total", *PARTS)
    curve = {name: np.asarray(data["curve"][name], float) for name in names}
    high = ROOM * max(float(values.max(initial=0.0)) for values in curve.values()) or 1.0
    shapes = []
    for name, values in curve.items():
        across = 100 * (np.arange(len(values)) + 1) / max(len(values), 1)
        points = [f"{x:.2f} {y:.2f}" for x, y in zip(across, _down(values, high), strict=True)]
        if points:
            shapes.append(Shape(name, "line", f"M0 {points[0].split()[1]}L" + "L".join(points)))
    return TimeChart(shapes, _up(high), _across(data["times"]))


def _between(top: Floats, base: Floats, high: float) -> str:
    """The area between two staircases."""
    edges = 100 * np.arange(len(top) + 1) / max(len(top), 1)
    forth = "".join(
        f"L{left:.2f} {y:.2f}H{right:.2f}"
        for left, right, y in zip(edges[:-1], edges[1:], _down(top, high), strict=True)
    )
    back = "".join(
        f"L{right:.2f} {y:.2f}H{left:.2f}"
        for left, right, y in zip(
            edges[:-1][::-1], edges[1:][::-1], _down(base, high)[::-1], strict=True
        )
    )
    return f"M{forth[1:]}{back}Z"


def _down(values: Floats, high: float) -> Floats:
    """In percent from the top."""
    return 100 * (1 - values / high)


def _up(high: float) -> list[Tick]:
    return [Tick(at=100 * (1 - y / high), text=number(y, 4)) for y in round_steps(0.0, high, 5)]


def _across(times: Sequence[Time]) -> list[Tick]:
    """Times at some of the stretches, each where it begins."""
    chosen = np.unique(np.linspace(0, len(times) - 1, TICKS_ACROSS).round().astype(int))
    return [Tick(at=100 * k / len(times), text=str(times[k])) for k in chosen.tolist() if times]


def _steps(result: PartitionedResult) -> Table:
    """The costliest steps, with what they are made of."""
    split = result.proof.breakdown
    parts = {name: result.scale * getattr(split, name) for name in PARTS}
    total = sum(parts.values(), np.zeros(len(result.labels.times)))
    chosen = [k for k in np.argsort(-total, kind="stable")[:SHOWN_ROWS].tolist() if total[k] > 0]
    rows = [
        (
            str(result.labels.times[k]),
            *(number(cost, 5) for cost in (total[k], *(parts[name][k] for name in PARTS))),
        )
        for k in chosen
    ]
    return Table(head=("t", "total", *PARTS), rows=rows)


def _tracks(result: PartitionedResult, kind: str) -> Table:
    """The costliest tracks of one side."""
    found = result.costliest_tracks(kind, SHOWN_ROWS)
    parts = ("localisation", kind, "switch")
    rows = [
        (
            str(row["id"]),
            f"{row['steps']:,}",
            *(number(cost, 5) for cost in (sum(row[p] for p in parts), *(row[p] for p in parts))),
        )
        for row in found
    ]
    return Table(head=("id", "steps", "total", *parts), rows=rows)


def _switches(result: PartitionedResult) -> tuple[str, Table]:
    """The first switches, and how many there are."""
    table, count = result.first_switches(SHOWN_ROWS)
    ends = [["none" if end is None else str(end) for end in table[name]] for name in ("from", "to")]
    rows = [
        (str(t), str(truth), before, after, number(mass, 3), number(cost, 5))
        for t, truth, before, after, mass, cost in zip(
            table["t"], table["truth"], *ends, table["mass"], table["cost"], strict=True
        )
    ]
    of = f"The first of {counted(count, 'switch', 'switches')}"
    title = "Switches" if count == len(rows) else of
    return title, Table(head=("t", "truth", "from", "to", "switches", "cost"), rows=rows)
