"""Figures of matplotlib without windows and pyplot, and files with reproducible bytes."""

import io
import warnings
from collections.abc import Sequence
from contextvars import ContextVar
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import StepPatch
from matplotlib.ticker import AutoLocator, MaxNLocator
from PIL import Image

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import number
from tgospa_eval.errors import ConfigError
from tgospa_eval.show.style import DOTS, FILES, LIGHT, SOFT, Style

QUICK = 1
"""Compression level of PNG files. It is low, because this is quick."""

PLACE: ContextVar["Axes | Figure | SubFigure | None"] = ContextVar("place", default=None)
"""Axes or figure of the user in which the next picture is drawn; None for a new figure."""


def figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    """Return a figure and an array of its axes, of shape (`rows`, `columns`).

    The figure is that of `PLACE`, or a new one with `width` and `height` in inches.

    Raises
    ------
    ConfigError
        `PLACE` has single axes, but several are needed.
    """
    grid = 0.75 * matplotlib.rcParams["grid.linewidth"]
    made: Any = PLACE.get()
    if made is None:
        made = ShownFigure(figsize=(width, height), layout="constrained", facecolor="white")
        FigureCanvasAgg(made)
    if isinstance(made, Axes):
        if rows * columns > 1:
            raise ConfigError(f"ax: the picture has {rows * columns} panels; give figure=")
        made, axes = made.figure, np.array([[made]])
    else:
        axes = made.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(visible=True, which="major", color=LIGHT["grid"], linewidth=grid)
        axis.set_axisbelow(True)
        for side, spine in axis.spines.items():
            spine.set_visible(side not in ("top", "right"))
            spine.set_in_layout(False)  # it is inside the figure, and a check would be slow
        counted(axis.xaxis)
        counted(axis.yaxis)
        axis.xaxis.set_major_locator(SpacedLocator())
    return made, axes


def written(made: Figure, kind: str = "png", dots: int = DOTS) -> bytes:
    """Return the content of a file with the picture; call it in a block of `styled`.

    `kind` is a key of `FILES`. The first call computes the layout, which all later files keep.
    """
    # With a salt, ids in an SVG are always the same. 42 is the font type that publishers accept.
    matplotlib.rcParams.update({"svg.hashsalt": "tgospa-eval", "pdf.fonttype": 42})
    target = io.BytesIO()
    with warnings.catch_warnings():
        # Letters that the font lacks are drawn as boxes; no warning is needed.
        warnings.filterwarnings("ignore", message=".*(missing from|does not support)")
        made.set_dpi(dots)
        canvas, engine = FigureCanvasAgg(made), made.get_layout_engine()
        if engine is not None:
            engine.execute(made)
            made.set_layout_engine("none")
        if kind == "png":  # quicker than savefig, and without an alpha channel
            canvas.draw()
            colours = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
            image = Image.fromarray(colours)
            image.save(target, "png", compress_level=QUICK, dpi=(dots, dots))
        else:
            made.savefig(target, format=kind, dpi=dots, **FILES[kind])
    return target.getvalue()


def stairs(axis: Axes, top: Floats, edges: Floats, **looks: Any) -> StepPatch:
    """Draw filled steps. The limits of the axes are not computed here, because this is slow."""
    made = StepPatch(top, edges, fill=True, **looks)
    axis.add_artist(made)
    return made


def boxes(left: Floats, right: Floats, low: Floats, high: Floats) -> Floats:
    """Return the corners (N, 4, 2) of N boxes."""
    x = np.stack([left, right, right, left], axis=1)
    return np.stack([x, np.stack([low, low, high, high], axis=1)], axis=2)


def counted(which: Axis) -> None:
    """Write numbers on this axis with commas between thousands, as in all other output."""
    which.set_major_formatter(lambda value, _: number(float(f"{value:.10g}"), 10))


def label(axis: Axes, x: str, y: str, title: str) -> None:
    """Set the names of the axes, and the title unless the axes are those of the user."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    if not isinstance(PLACE.get(), Axes):
        axis.set_title(title, fontsize="medium", loc="left")


def titled(axis: Axes, style: Style, title: str, about: str = "") -> None:
    """Write `title` at the left and `about` at the right above the axes.

    Nothing is written if the style has no titles, or if the axes are those of the user.
    """
    if not style.titles or isinstance(PLACE.get(), Axes):
        return
    axis.set_title(title, loc="left", fontsize="medium", fontweight="bold", parse_math=False)
    axis.set_title(about, loc="right", fontsize="small", color=SOFT, parse_math=False)


def legend(made: Any, handles: Sequence[Artist], names: list[str], columns: int) -> None:
    """Draw the legend above the axes, where it covers nothing."""
    if handles:
        tight: Any = {"columnspacing": 1.2, "handletextpad": 0.5, "borderpad": 0.1}
        where: Any = {"loc": "outside upper left", "frameon": False, "fontsize": "small"}
        place: Any = PLACE.get()
        if isinstance(place, Axes):
            made, where = place, where | {"loc": "lower left", "bbox_to_anchor": (0, 1)}
        for text in made.legend(handles, names, ncols=columns, **where, **tight).get_texts():
            text.set_parse_math(False)


def literal(text: str, width: int = 24) -> str:
    """Return a user's text on one line. In a long text, dots replace a part in the middle."""
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if len(text) <= width:
        return text
    return f"{text[: width // 3]}…{text[-(width - width // 3 - 1) :]}"


def power(unit: str, order: float) -> str:
    """Return " (unit^p)", the unit of a cost, or an empty text if there is no unit."""
    raised = {1.0: "", 2.0: "²", 3.0: "³"}.get(float(order), f"^{order:g}")
    return f" ({literal(unit)}{raised})" if unit else ""


# -------------------------------------------------------------------------------------------------
# Figures in a notebook, and ticks.


class ShownFigure(Figure):
    """Figure that a notebook shows as the result of a cell. %matplotlib and pyplot are not needed.

    The figure is drawn with the settings of its style, not with those of the user.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        defaults = matplotlib.rcParamsDefault
        self._settings = {
            name: value
            for name, value in matplotlib.rcParams.items()
            if name in defaults and not name.startswith("backend") and value != defaults[name]
        }

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return a PNG with twice the pixels of the screen, and the size at which it is shown."""
        target = io.BytesIO()
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(self._settings)
            self.savefig(target, format="png", dpi=2 * SHARP, metadata={"Software": None})
        wide, tall = (round(SHARP * inches) for inches in self.get_size_inches())
        return target.getvalue(), {"width": wide, "height": tall}


class SpacedLocator(AutoLocator):
    """Locator for a horizontal axis. It makes so few ticks that their labels do not touch."""

    def __call__(self) -> list[float]:
        """Return the positions of the ticks."""
        axis: Any = self.axis
        ticks = list(super().__call__())
        low, high = sorted(axis.get_view_interval())
        for count in range(len(ticks), 0, -1):
            if _labels_fit(axis, [tick for tick in ticks if low <= tick <= high], low, high):
                break
            ticks = list(MaxNLocator(count, steps=NICE).tick_values(low, high))
        return ticks


def _labels_fit(axis: Any, ticks: list[float], low: float, high: float) -> bool:
    """Check, with estimated widths of the labels, that there are gaps between them."""
    axes, size = axis.axes, axis.label.get_fontsize()
    room = axes.bbox.width / axes.get_figure().dpi * 72 / size
    texts = axis.get_major_formatter().format_ticks(ticks)
    wide = [sum(0.32 if sign in ",." else 0.64 for sign in text) for text in texts]
    places = [(tick - low) / (high - low) * room for tick in ticks]
    labels = zip(places, wide, strict=True)
    return all(b - a > (u + v) / 2 + LABEL_SPACING for (a, u), (b, v) in pairwise(labels))


NICE = (1, 2, 2.5, 5, 10)
"""Possible first digits of the distance between ticks."""

LABEL_SPACING = 0.6
"""Smallest gap between labels, relative to the size of letters."""

SHARP = 96
"""Assumed pixels per inch of a screen."""
