"""Charts of a page as shapes in percent of their width and height, for SVG and for letters.

A browser stretches the shapes to any width, and keeps the letters as they are.
"""

from collections.abc import Sequence

from tgospa_eval.common.figures import number
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.reports.curves import CURVE_KINDS, CurveKind, RmsCurve
from tgospa_eval.reports.ticks import ROOM, Tick, round_steps

MOST_POINTS = 400
"""Of a line; of more steps every second, third ... is drawn."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of a chart.

    Parameters
    ----------
    name : str
        Whose it is.
    track : int
        Number of its colour and of its dashes.
    path : str
        Of SVG.
    band : str
        The same of what is around it; nothing without.
    last : str
        Its last value in words, if that is of all steps.
    """

    name: str
    track: int
    path: str
    band: str
    last: str


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Lines with axes.

    Parameters
    ----------
    title : str
        What is to be seen.
    lines : sequence of Line
        In order.
    up, across : sequence of Tick
        Of the two axes.
    stride : int
        Of how many steps one is drawn.
    runs : str
        How many runs there are at a step, in words.
    across_name : str
        What is across.
    """

    title: str
    lines: Sequence[Line]
    up: Sequence[Tick]
    across: Sequence[Tick]
    stride: int
    runs: str
    across_name: str


def curve_chart(curves: Sequence[tuple[int, RmsCurve]], kind: CurveKind, unit: str) -> Chart | None:
    """The curves of one kind; None if there is none.

    Parameters
    ----------
    curves : sequence of (int, RmsCurve)
        With the number of the colour of each.
    kind : str
        Which are drawn.
    unit : str
        Of the values.
    """
    shown = [(track, curve) for track, curve in curves if curve.kind == kind]
    if not shown:
        return None
    size = max(len(curve.rms) for _, curve in shown)
    top = max(
        max([*curve.rms, *(value for value in curve.band[1] if value is not None)])
        for _, curve in shown
    )
    top = ROOM * top or 1.0
    stride = -(-size // MOST_POINTS)
    longest = max((curve for _, curve in shown), key=lambda curve: len(curve.rms))
    times = longest.times
    by_time = all(t is not None and len(t) <= 8 for t in times) and all(
        list(curve.times) == list(times[: len(curve.times)]) for _, curve in shown
    )
    names = [str(t) for t in times] if by_time else [f"{k:,}" for k in range(1, size + 1)]
    spread = sorted({count for _, curve in shown for count in (min(curve.runs), max(curve.runs))})
    return Chart(
        title=CURVE_KINDS[kind],
        lines=[_line(track, curve, (size, top), stride, unit) for track, curve in shown],
        up=[Tick(at=_percent(y, top), text=number(y, 4)) for y in round_steps(0.0, top)],
        across=[Tick(at=_place(k, size), text=names[k]) for k in _marked(names)],
        stride=stride,
        runs=(f"{spread[0]:,} to " if len(spread) > 1 else "") + counted(spread[-1], "run"),
        across_name="time" if by_time else "number of the step",
    )


def _line(track: int, curve: RmsCurve, extent: tuple[int, float], stride: int, unit: str) -> Line:
    size, top = extent
    chosen = sorted({*range(0, len(curve.rms), stride), len(curve.rms) - 1})
    points = [(_place(k, size), curve.rms[k]) for k in chosen]
    low, high = (
        [(_place(k, size), value) for k in chosen if (value := end[k]) is not None]
        for end in curve.band
    )
    if len(points) == 1:  # a dash, which can be seen
        points = [(0.0, points[0][1]), (100.0, points[0][1])]
    around = _path([*high, *reversed(low)], top)
    last = number(curve.rms[-1], 4)
    return Line(
        name=curve.name,
        track=track,
        # A single point is a dash that can be seen.
        path=_path(
            points if len(points) > 1 else [(0.0, points[0][1]), (100.0, points[0][1])], top
        ),
        band=f"{around}Z" if around else "",
        last=f"{last} {unit}".strip() if curve.kind == "growing" else "",
    )


def _marked(names: Sequence[str]) -> list[int]:
    """Steps with a label: those at round numbers, or every so many."""
    try:
        places = {float(name.replace(",", "")): k for k, name in enumerate(names)}
        found = [places[each] for each in round_steps(min(places), max(places)) if each in places]
    except ValueError:
        found = []
    if len(found) > 1:
        return found
    return sorted({round(k) for k in round_steps(0, len(names) - 1)})


def _place(step: int, size: int) -> float:
    """Of a step, in percent from the left."""
    return 100.0 * step / max(size - 1, 1)


def _percent(value: float, top: float) -> float:
    """Of a value, in percent from the top."""
    return 100.0 * (1.0 - value / top)


def _path(points: Sequence[tuple[float, float]], top: float) -> str:
    """Points joined by lines."""
    if not points:
        return ""
    return "M" + "L".join(f"{x:.2f} {_percent(y, top):.2f}" for x, y in points)
