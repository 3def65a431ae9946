"""The colours of all pictures: PNG, page and notebook. Distinct without full colour vision.

The parts of the cost differ in lightness as well as in hue, and have patterns besides.
"""

from collections.abc import Mapping

LIGHT: Mapping[str, str] = {
    "paper": "#ffffff",
    "ink": "#16191d",
    "soft": "#50575f",
    "grid": "#e3e6ea",
    "localisation": "#4d86c2",
    "missed": "#b83a00",
    "false": "#6d35b0",
    "switch": "#16191d",
}
"""On white paper."""

DARK: Mapping[str, str] = {
    "paper": "#14171a",
    "ink": "#eceff2",
    "soft": "#a9b2bb",
    "grid": "#2b3036",
    "localisation": "#5b93d0",
    "missed": "#ff9152",
    "false": "#d3b4ff",
    "switch": "#f4f6f8",
}
"""On a dark screen."""

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
"""Of estimates, in turn, on white: neighbours are far apart in hue; white letters are legible."""

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
"""The same on a dark screen, for dark letters."""


def variables(colours: Mapping[str, str], tracks: tuple[str, ...]) -> str:
    """Declarations of CSS, ``--missed: #b83a00`` and ``--track-0`` to the last."""
    named = {**colours, **{f"track-{k}": colour for k, colour in enumerate(tracks)}}
    return " ".join(f"--{name}: {colour};" for name, colour in named.items())


HEAT_LEVELS = 9
"""Shades from paper on."""

_DARKEST = {LIGHT["paper"]: 0.85, DARK["paper"]: 0.6}
"""How much of the full colour the darkest shade has: letters are legible on it."""


def heat_shades(colours: Mapping[str, str]) -> tuple[str, ...]:
    """Shades of one colour, from little to much."""
    paper, full = (_channels(colours[name]) for name in ("paper", "localisation"))
    most = _DARKEST[colours["paper"]]
    shares = (most * k / (HEAT_LEVELS - 1) for k in range(HEAT_LEVELS))
    return tuple(
        "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(paper, full, strict=True))
        for share in shares
    )


def _channels(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))
