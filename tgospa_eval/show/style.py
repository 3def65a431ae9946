"""Looks of pages and pictures: colours, patterns and sizes.

Colours are distinct even for colour-blind readers. Parts of the cost differ in lightness and in
hue, and have patterns as well.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import quoted
from tgospa_eval.results.records import SPREAD

LIGHT: Mapping[str, str] = {
    "paper": "#ffffff",
    "ink": "#16191d",
    "soft": "#50575f",
    "grid": "#e3e6ea",
    "localisation": "#4d86c2",
    "missed": "#b83a00",
    "false": "#6d35b0",
    "switch": "#16191d",
    "panel": "#f6f7f9",
    "line": "#c9ced4",
    "accent": "#0b5cad",
    "chosen": "#0b5cad22",
    "truth": "#50575f",
    "label": "#ffffff",
    "good": "#17692e",
}
"""Colours on white paper."""

DARK: Mapping[str, str] = {
    "paper": "#14171a",
    "ink": "#eceff2",
    "soft": "#a9b2bb",
    "grid": "#2b3036",
    "localisation": "#5b93d0",
    "missed": "#ff9152",
    "false": "#d3b4ff",
    "switch": "#f4f6f8",
    "panel": "#1d2125",
    "line": "#454c54",
    "accent": "#7db7f5",
    "chosen": "#7db7f533",
    "truth": "#a9b2bb",
    "label": "#101214",
    "good": "#73d28d",
}
"""Colours on a dark screen."""

TRACK_COLOURS = (
    "#2569a8",
    "#b2574e",
    "#087957",
    "#8463b0",
    "#855e02",
    "#067a91",
    "#994569",
    "#578032",
    "#4c60aa",
    "#ae5d31",
    "#00766d",
    "#975c9f",
)
"""Colours on white for tracks of the estimate, in turn. Neighbouring colours differ in hue, and
white letters are legible on each colour."""

DARK_TRACK_COLOURS = (
    "#79b6f4",
    "#fdaa9f",
    "#66c7a0",
    "#d0b1fe",
    "#d6a95b",
    "#63d4f1",
    "#e893b4",
    "#a7d287",
    "#96aef7",
    "#fdac84",
    "#4dc8ba",
    "#e5abec",
)
"""Colours on a dark screen for tracks of the estimate. Dark letters are legible on each colour."""


def variables(colours: Mapping[str, str], tracks: tuple[str, ...]) -> str:
    """Return declarations of CSS variables: ``--missed: #b83a00;`` and ``--track-0`` and so on."""
    named = {**colours, **{f"track-{k}": colour for k, colour in enumerate(tracks)}}
    return " ".join(f"--{name}: {colour};" for name, colour in named.items())


HEAT_LEVELS = 9
"""Number of shades of the cells of a table. The first is the colour of the paper."""

_DARKEST = {LIGHT["paper"]: 0.85, DARK["paper"]: 0.6}
"""Share of the full colour in the last shade, by the colour of the paper. With this share, letters
on the shade are legible."""


def heat_shades(colours: Mapping[str, str]) -> tuple[str, ...]:
    """Return the shades of the cells of a table, from the colour of the paper to almost full."""
    paper, full = (bytes.fromhex(colours[name][1:]) for name in ("paper", "localisation"))
    darkest = _DARKEST[colours["paper"]]
    shares = (darkest * k / (HEAT_LEVELS - 1) for k in range(HEAT_LEVELS))
    return tuple(
        "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(paper, full, strict=True))
        for share in shares
    )


COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours of Okabe and Ito, which are distinct in print and for colour-blind readers."""

MARKERS = "osD^vPX"
DASHES = ("-", (0, (6, 2)), (0, (2, 2)), (0, (8, 2, 2, 2)), (0, (1, 1)), (0, (10, 2, 2, 2, 2, 2)))


def line_looks(k: int, *, marked: bool = False) -> dict[str, Any]:
    """Return colour and dashes of the k-th line, and a marker if `marked`.

    Dashes make lines distinct in print without colours.
    """
    marker = {"marker": MARKERS[k % len(MARKERS)]} if marked else {}
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k % len(DASHES)], **marker}


DOTS = 150
"""Dots per inch of a PNG by default."""

MISSING = f"no pictures: they need the extra plot: {install('plot')}"

FILES: Mapping[str, dict[str, Any]] = {
    "png": {},
    "svg": {"metadata": {"Creator": None, "Date": None}},
    "pdf": {"metadata": {"Creator": None, "Producer": None, "CreationDate": None}},
}
"""Formats of pictures, each with arguments for saving. Metadata are left out, so that files do not
depend on the time and on versions."""


def available() -> bool:
    """Check whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


@dataclass(frozen=True, kw_only=True)
class Style:
    """Sizes and settings of all pictures in one style.

    Parameters
    ----------
    width : float
        Width of a picture in inches.
    low : float
        Height of a picture over time, in inches.
    dots : int
        Dots per inch of a PNG. In vector files, this applies to shapes that are drawn as pixels.
    titles : bool
        Whether a picture has a title; papers have captions instead.
    bars : int
        Largest number of bars over time. If there are more steps, a bar shows the costliest of
        several steps.
    lanes : int
        Largest number of true objects with a lane of their own. For estimates, half of this number
        is the limit.
    worst : int
        Largest number of bars for each kind: costliest steps, true objects and estimates.
    settings : dict
        Settings of matplotlib (rcParams).
    """

    width: float
    low: float
    dots: int
    titles: bool
    bars: int
    lanes: int
    worst: int
    settings: Mapping[str, Any]

    @property
    def wide(self) -> bool:
        """True if there is room for several panels side by side."""
        return self.width > 5

    @property
    def mark(self) -> float:
        """Size of a marker on a line, in points."""
        return 0.5 * float(self.settings["font.size"])


_BOTH = {"axes.titley": 1.0}
"""Fixed position of titles. By default, matplotlib searches for ticks above the axes. This takes as
long as drawing the text."""

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
    "paper-wide": Style(
        width=7.16, low=1.9, dots=400, titles=False, bars=600, lanes=40, worst=5, settings=_PAPER
    ),
}
"""Styles by value of ``--style``. ``screen`` is for windows and notes, the others are for one or
both columns of a journal, without titles."""

INK, SOFT = LIGHT["ink"], LIGHT["soft"]
MISSED, FALSE = LIGHT["missed"], LIGHT["false"]

FILLS: Mapping[str, dict[str, Any]] = {
    "localisation": {"facecolor": LIGHT["localisation"], "edgecolor": LIGHT["localisation"]},
    SPREAD: {"facecolor": "white", "edgecolor": LIGHT["localisation"], "hatch": "|||||"},
    "missed": {"facecolor": "white", "edgecolor": MISSED, "hatch": "/////"},
    "false": {"facecolor": "white", "edgecolor": FALSE, "hatch": "....."},
    "switch": {"facecolor": LIGHT["switch"], "edgecolor": LIGHT["switch"]},
}
"""Fills of the parts of the cost, with patterns for output without colours."""

UNJUDGED: Mapping[str, Any] = {"facecolor": "none", "edgecolor": SOFT, "hatch": "\\\\\\"}
"""Looks of bars of ignored and excused states, which are drawn over the other bars."""

LINES: Mapping[str, dict[str, Any]] = {
    "localisation": {"color": LIGHT["localisation"], "linestyle": "-"},
    "missed": {"color": MISSED, "linestyle": (0, (6, 2))},
    "false": {"color": FALSE, "linestyle": (0, (2, 2))},
    "switch": {"color": SOFT, "linestyle": (0, (8, 2, 2, 2))},
    "total": {"color": INK, "linestyle": "-"},
}


@contextmanager
def styled(name: str = "screen") -> Iterator[Style]:
    """Apply the settings of a style to matplotlib in the block, and no settings of the user.

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
