"""Figures and their files, by matplotlib; no window, no global state, the same bytes.

matplotlib is imported when a picture is made.
"""

import io
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeAlias

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import install, number
from tgospa_eval.show.palette import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import StepPatch

Draw: TypeAlias = "Mapping[str, Callable[[], Figure]]"
"""By name what makes a figure."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito: distinguished by those who do not see all colours, and in print."""

MARKERS = "osD^vPX"
DOTS = 150
"""Dots per inch."""

QUICK = 1
"""Level of compression."""

MISSING = f"no pictures: they need the extra plot: {install('plot')}"

FILES: Mapping[str, dict[str, Any]] = {
    "png": {},
    "svg": {"metadata": {"Creator": None, "Date": None}},
    "pdf": {"metadata": {"Creator": None, "Producer": None, "CreationDate": None}},
}
"""Formats, and what is left out of each: nothing depends on the time or on who made it."""

_SAME = {"svg.hashsalt": "tgospa-eval", "pdf.fonttype": 42}
"""The ids of an SVG are the same each time; in a PDF fonts are those that publishers take."""


def available() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def figure(width: float, height: float, rows: int = 1, columns: int = 1) -> "tuple[Figure, Any]":
    """An empty figure of inches, and its axes as a (rows, columns) array."""
    from matplotlib import rcParams
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from tgospa_eval.show.notebook import ApartLocator, ShownFigure

    grid = 0.75 * rcParams["grid.linewidth"]
    made = ShownFigure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(visible=True, which="major", color=LIGHT["grid"], linewidth=grid)
        axis.set_axisbelow(True)
        for side, spine in axis.spines.items():
            spine.set_visible(side not in ("top", "right"))
            spine.set_in_layout(False)  # on the edge of the axes, and to find that out takes long
        counted(axis.xaxis)
        counted(axis.yaxis)
        axis.xaxis.set_major_locator(ApartLocator())
    return made, axes


def pictures(draw: Draw, formats: Sequence[str] = ("png",)) -> dict[str, bytes]:
    """Files of figures by name, whatever the user's settings of matplotlib."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        return files_of(draw, formats, DOTS, lambda name, share: None)  # noqa: ARG005


def files_of(
    draw: Draw, formats: Sequence[str], dots: int, notify: Callable[[str, float], None]
) -> dict[str, bytes]:
    """Files by name, each in all formats; `notify` takes the name of the next and what is done.

    One figure after the other: they hold memory.
    """
    files: dict[str, bytes] = {}
    for name, make in draw.items():
        made = None
        for kind in formats:
            notify(f"{name}.{kind}", len(files) / (len(draw) * len(formats)))
            made = make() if made is None else made
            files[f"{name}.{kind}"] = written(made, kind, dots)
    return files


def written(made: "Figure", kind: str = "png", dots: int = DOTS) -> bytes:
    """The picture as a file of one of `FILES`; to be called under `styled`.

    The layout is that of a PNG whatever the format and those before, and made once.
    """
    import matplotlib

    matplotlib.rcParams.update(_SAME)
    target = io.BytesIO()
    with warnings.catch_warnings():
        # An id in a script that the font does not have is drawn as boxes, which says enough.
        warnings.filterwarnings("ignore", message=".*(missing from|does not support)")
        canvas = _laid_out(made, dots)
        if kind == "png":
            _write_png(canvas, target, dots)
        else:
            made.savefig(target, format=kind, dpi=dots, **FILES[kind])
    return target.getvalue()


def _laid_out(made: "Figure", dots: int) -> "FigureCanvasAgg":
    """Where everything is, from now on."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    made.set_dpi(dots)
    canvas = FigureCanvasAgg(made)
    engine = made.get_layout_engine()
    if engine is not None:
        engine.execute(made)
        made.set_layout_engine("none")
    return canvas


def _write_png(canvas: "FigureCanvasAgg", target: io.BytesIO, dots: int) -> None:
    """As savefig does it, which draws everything once more before, and stores opacities too."""
    import numpy as np
    from PIL import Image

    canvas.draw()
    colours = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])  # all is opaque
    image = Image.fromarray(colours)
    image.save(target, "png", compress_level=QUICK, dpi=(dots, dots))


def stairs(axis: "Axes", top: Floats, edges: Floats, **looks: Any) -> "StepPatch":
    """Filled steps within limits that are set by hand: to find theirs takes longer than to draw."""
    from matplotlib.patches import StepPatch

    made = StepPatch(top, edges, fill=True, **looks)
    axis.add_artist(made)
    return made


def boxes(left: Floats, right: Floats, low: Floats, high: Floats) -> Floats:
    """Corners (N, 4, 2) of boxes."""
    import numpy as np

    x = np.stack([left, right, right, left], axis=1)
    return np.stack([x, np.stack([low, low, high, high], axis=1)], axis=2)


def counted(which: "Axis") -> None:
    """Numbers on this axis are written as everywhere else."""
    which.set_major_formatter(lambda value, _: number(float(f"{value:.10g}"), 10))


def label(axis: "Axes", x: str, y: str, title: str) -> None:
    """Names of the axes, and what is to be seen."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.set_title(title, fontsize="medium", loc="left")
