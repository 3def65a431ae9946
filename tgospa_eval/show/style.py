"""What pictures of a kind have in common: sizes, fills, words. No data."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.numbers import SPREAD
from tgospa_eval.show.figures import DOTS, MISSING, available
from tgospa_eval.show.palette import LIGHT
from tgospa_eval.text import quoted

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Style:
    """Sizes of a kind of pictures.

    Parameters
    ----------
    width : float
        Inches.
    low : float
        Height of a picture over time, in inches.
    dots : int
        Dots per inch, of a PNG and of what is too much for a vector.
    titles : bool
        Whether a picture says what it shows; papers have captions.
    bars : int
        Most bars beside each other; of more steps the costliest stand for several.
    lanes : int
        Most truths with a lane of their own, and half as many estimates.
    worst : int
        Bars of each kind of what is worst.
    settings : dict
        Settings of matplotlib.
    """

    width: float
    low: float
    dots: int
    titles: bool
    bars: int
    lanes: int
    worst: int
    settings: Mapping[str, Any] = field(default_factory=dict)


_BOTH = {"axes.titley": 1.0}
"""No ticks are on top; to look for them in each draw takes as long as the text."""

_SCREEN = {**_BOTH, "font.size": 9, "hatch.linewidth": 0.8}
_PAPER = {
    **_BOTH,
    "font.size": 7,
    "axes.titlesize": 7,
    "axes.labelpad": 2,
    "axes.linewidth": 0.5,
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.5,
    "legend.handlelength": 1.8,
    "lines.linewidth": 0.9,
    "patch.linewidth": 0.5,
    "xtick.major.pad": 2,
    "xtick.major.size": 2.5,
    "xtick.major.width": 0.5,
    "ytick.major.pad": 2,
    "ytick.major.size": 2.5,
    "ytick.major.width": 0.5,
}

STYLES = {
    "screen": Style(
        width=8.0, low=2.9, dots=DOTS, titles=True, bars=600, lanes=60, worst=8, settings=_SCREEN
    ),
    "paper": Style(
        width=3.5, low=1.7, dots=400, titles=False, bars=300, lanes=24, worst=5, settings=_PAPER
    ),
}
"""``--style``: a window or a page of notes, or one column of a journal without titles."""

INK, SOFT = LIGHT["ink"], LIGHT["soft"]
MISSED, FALSE = LIGHT["missed"], LIGHT["false"]

FILLS: Mapping[str, dict[str, Any]] = {
    "localisation": {"facecolor": LIGHT["localisation"], "edgecolor": LIGHT["localisation"]},
    SPREAD: {"facecolor": "white", "edgecolor": LIGHT["localisation"], "hatch": "|||||"},
    "missed": {"facecolor": "white", "edgecolor": MISSED, "hatch": "/////"},
    "false": {"facecolor": "white", "edgecolor": FALSE, "hatch": "....."},
    "switch": {"facecolor": LIGHT["switch"], "edgecolor": LIGHT["switch"]},
}
"""Of the parts of the cost, distinguished by their patterns where there are no colours."""

NOT_JUDGED: Mapping[str, Any] = {"facecolor": "none", "edgecolor": SOFT, "hatch": "\\\\\\"}
"""Of stretches of which nothing is judged, over whatever else is there."""

LINES: Mapping[str, dict[str, Any]] = {
    "localisation": {"color": LIGHT["localisation"], "linestyle": "-"},
    "missed": {"color": MISSED, "linestyle": (0, (6, 2))},
    "false": {"color": FALSE, "linestyle": (0, (2, 2))},
    "switch": {"color": SOFT, "linestyle": (0, (8, 2, 2, 2))},
    "total": {"color": INK, "linestyle": "-"},
}


@contextmanager
def styled(name: str = "screen") -> Iterator[Style]:
    """The settings of matplotlib that make a picture of this style, whatever those of the user.

    Raises
    ------
    ConfigError
        The name is not one of `STYLES`, or matplotlib is not installed.
    """
    if name not in STYLES:
        raise ConfigError(f"style {quoted(name)}: must be one of {', '.join(STYLES)}")
    if not available():
        raise ConfigError(MISSING)
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLES[name].settings)
        yield STYLES[name]


def titled(axis: "Axes", style: Style, title: str, about: str = "") -> None:
    """What is to be seen, and of what, where pictures have titles."""
    if not style.titles:
        return
    axis.set_title(title, loc="left", fontsize="medium", fontweight="bold", parse_math=False)
    axis.set_title(about, loc="right", fontsize="small", color=SOFT, parse_math=False)


def legend(made: "Figure", handles: "Sequence[Artist]", names: list[str], columns: int) -> None:
    """Above the axes, where it hides nothing."""
    if handles:
        tight: Any = {"columnspacing": 1.2, "handletextpad": 0.5, "borderpad": 0.1}
        where: Any = {"loc": "outside upper left", "frameon": False, "fontsize": "small"}
        made.legend(handles, names, ncols=columns, **where, **tight)


def literal(text: str, most: int = 24) -> str:
    """A text of the user's on one line; of a long one the ends, of which the last matters more."""
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return text if len(text) <= most else f"{text[: most // 3]}…{text[-(most - most // 3 - 1) :]}"


def power(unit: str, order: float) -> str:
    """The unit of a cost in brackets, with a space in front; nothing without unit."""
    raised = {1.0: "", 2.0: "²", 3.0: "³"}.get(float(order), f"^{order:g}")
    return f" ({literal(unit)}{raised})" if unit else ""
