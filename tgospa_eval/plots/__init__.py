"""RESULT -> pictures, by matplotlib (extra ``plot``); no window, no global state, the same bytes.

matplotlib is imported when a picture is made.
"""

import io
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito: told apart by those who do not see all colours, and in print."""

MARKERS = "osD^vPX"
DOTS = 150
"""Dots per inch."""

MISSING = 'no pictures: they need the extra plot, pip install "tgospa-eval[plot]"'


def available() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def figure(width: float, height: float, rows: int = 1, columns: int = 1) -> "tuple[Figure, Any]":
    """An empty figure of inches, and its axes as a (rows, columns) array."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
        axis.set_axisbelow(True)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    return made, axes


def pictures(draw: Callable[[T], "Mapping[str, Figure]"], subject: T) -> dict[str, bytes]:
    """PNG files of what `draw` makes of the subject, whatever the user's settings of matplotlib."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        return {f"{name}.png": _png(made) for name, made in draw(subject).items()}


def _png(made: "Figure") -> bytes:
    """The picture; nothing in it depends on the time or the version of the program."""
    target = io.BytesIO()
    made.savefig(target, format="png", dpi=DOTS, metadata={"Software": None})
    return target.getvalue()


def label(axis: "Axes", x: str, y: str, title: str) -> None:
    """Names of the axes, and what is to be seen."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.set_title(title, fontsize="medium", loc="left")
