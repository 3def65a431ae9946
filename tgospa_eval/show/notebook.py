"""A figure that a notebook shows by itself, without %matplotlib and without a window; its ticks."""

import io
from itertools import pairwise
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator


class ShownFigure(Figure):
    """As a cell of a notebook ends with it; pyplot, where someone uses it, has its own way.

    It is drawn with the settings with which it was made, whatever those of the user are.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        usual = matplotlib.rcParamsDefault
        self._settings = {
            name: value
            for name, value in matplotlib.rcParams.items()
            if name in usual and not name.startswith("backend") and value != usual[name]
        }

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """A sharp picture, and the size at which it is shown."""
        target = io.BytesIO()
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(self._settings)
            self.savefig(target, format="png", dpi=2 * SHARP, metadata={"Software": None})
        wide, tall = (round(SHARP * inches) for inches in self.get_size_inches())
        return target.getvalue(), {"width": wide, "height": tall}


class ApartLocator(AutoLocator):
    """Ticks across, so few that their labels do not touch, however long and in whatever room."""

    def __call__(self) -> list[float]:
        """Where they are."""
        axis: Any = self.axis
        ticks = list(super().__call__())
        low, high = sorted(axis.get_view_interval())
        for most in range(len(ticks), 0, -1):
            if _apart(axis, [tick for tick in ticks if low <= tick <= high], low, high):
                break
            ticks = list(MaxNLocator(most, steps=NICE).tick_values(low, high))
        return ticks


def _apart(axis: Any, ticks: list[float], low: float, high: float) -> bool:
    """Whether there are gaps between the labels, by the usual widths of their signs."""
    axes, size = axis.axes, axis.label.get_fontsize()
    room = axes.bbox.width / axes.get_figure().dpi * 72 / size
    texts = axis.get_major_formatter().format_ticks(ticks)
    wide = [sum(0.32 if sign in ",." else 0.64 for sign in text) for text in texts]
    places = [(tick - low) / (high - low) * room for tick in ticks]
    labels = zip(places, wide, strict=True)
    return all(b - a > (u + v) / 2 + APART_BY for (a, u), (b, v) in pairwise(labels))


NICE = (1, 2, 2.5, 5, 10)
"""First digits of the distances of ticks."""

APART_BY = 0.6
"""Between labels, in sizes of the letters."""

SHARP = 96
"""Per inch on a screen."""
