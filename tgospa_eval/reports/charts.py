"""Charts of a page as shapes in percent of their width and height, for SVG and for letters.

A browser stretches the shapes to any width, and keeps the letters as they are.
"""

from collections.abc import Sequence

from tgospa_eval.common.figures import number
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.curves import CURVE_KINDS, LINE_NAMES, RmsCurve, RmsLine, on_one_axis
from tgospa_eval.reports.ticks import ROOM, Tick, round_steps

MOST_POINTS = 400
"""Of a line; of more times every second, third ... is drawn."""

ROOM_FOR_TIMES = 60
"""Room for the names of times."""


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
        Its last value in words, if that is of several steps.
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
        Of how many times one is drawn.
    runs : str
        How many runs there are, in words.
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


def curve_charts(
    curves: Sequence[tuple[int, RmsCurve]], unit: str
) -> list[tuple[Chart, list[Chart]]]:
    """A chart of each kind of curves, with one for each of its parts.

    Parameters
    ----------
    curves : sequence of (int, RmsCurve)
        With the number of the colour of each.
    unit : str
        Of the values.
    """
    found: list[tuple[Chart, list[Chart]]] = []
    if not curves:
        return found
    clock, places, (first, last) = on_one_axis([curve for _, curve in curves])
    percent = 100.0 / (last - first)
    marks, names, about_time = clock.ticks(first, last, ROOM_FOR_TIMES)
    across = [
        Tick(at=percent * (at - first), text=name) for at, name in zip(marks, names, strict=True)
    ]
    for kind, about in CURVE_KINDS.items():
        lines: dict[str, list[_Drawn]] = {}
        for (track, curve), at in zip(curves, places, strict=True):
            for name, line in curve.lines.items() if curve.kind == kind else ():
                lines.setdefault(name, []).append((track, curve, line, percent * (at - first)))
        if lines:
            total, *parts = (
                _chart(f"{LINE_NAMES[name]} {about}", drawn, unit, (across, about_time))
                for name, drawn in lines.items()
            )
            found.append((total, parts))
    return found


_Drawn = tuple[int, RmsCurve, RmsLine, Floats]
"""The number of a colour, the curve, what is drawn of it, and where its times are, in percent."""


def _chart(title: str, drawn: Sequence[_Drawn], unit: str, across: tuple[list[Tick], str]) -> Chart:
    top = ROOM * max(line.top for _, _, line, _ in drawn) or 1.0
    stride = -(-max(len(at) for *_, at in drawn) // MOST_POINTS)
    runs = sorted({curve.runs for _, curve, _, _ in drawn})
    return Chart(
        title=title,
        lines=[_line(each, top, stride, unit) for each in drawn],
        up=[Tick(at=_percent(y, top), text=number(y, 4)) for y in round_steps(0.0, top)],
        across=across[0],
        stride=stride,
        runs=(f"{runs[0]:,} to " if len(runs) > 1 else "") + counted(runs[-1], "run"),
        across_name=across[1],
    )


def _line(drawn: _Drawn, top: float, stride: int, unit: str) -> Line:
    track, curve, line, at = drawn
    size = len(at)
    chosen = sorted({*range(0, size, stride), size - 1})
    x = at[chosen].tolist()
    if size == 1:  # a dash, which can be seen
        chosen, x = [0, 0], [0.0, 100.0]

    def path(values: Sequence[float]) -> str:
        places = zip(x, (_percent(values[k], top) for k in chosen), strict=True)
        return "L".join(f"{across:.2f} {up:.2f}" for across, up in places)

    around = ""
    if line.band:
        low, high = map(path, line.band)
        around = f"M{high}L{'L'.join(reversed(low.split('L')))}Z"
    last = number(line.rms[-1], 4)
    return Line(
        name=curve.name,
        track=track,
        path=f"M{path(line.rms)}",
        band=around,
        last=f"{last} {unit}".strip() if curve.kind != "step" else "",
    )


def _percent(value: float, top: float) -> float:
    """Of a value, in percent from the top."""
    return 100.0 * (1.0 - value / top)
