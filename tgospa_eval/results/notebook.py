"""What a notebook shows of a result: HTML of plain values, with styles inside. Knows no result.

The bars stand on white, for a notebook does not say whether its paper is light or dark.
"""

from collections.abc import Sequence

from tgospa_eval.common.palette import LIGHT
from tgospa_eval.common.words import number

PART_COLOURS = {name: LIGHT[name] for name in ("localisation", "missed", "false", "switch")}
CHART_WIDTH, CHART_HEIGHT = 560, 56
BARS = 140


def card(
    *,
    title: str,
    proof: str,
    notes: Sequence[str],
    parts: Sequence[tuple[str, str, str, str]],
    costs: dict[str, list[float]],
    ends: tuple[str, str],
) -> str:
    """A headline, the four parts, and the cost of each step.

    Parameters
    ----------
    title, proof : str
        The value, and how it is known.
    notes : sequence of str
        Lines below: sizes, parameters.
    parts : sequence of (name, cost, share, count)
        Rows of the table.
    costs : dict
        Of each part its cost at each step.
    ends : pair of str
        First and last time.
    """
    from html import escape  # here: few are in a notebook, and it brings a long table

    rows = "".join(
        f'<tr><th scope="row" style="text-align:left;font-weight:500">{_swatch(name)}'
        f"{escape(name)}</th>"
        + "".join(f'<td style="text-align:right">{escape(cell)}</td>' for cell in cells)
        + "</tr>"
        for name, *cells in parts
    )
    lines = "".join(
        f'<div style="opacity:.75;font-size:.92em"><bdi>{escape(note)}</bdi></div>'
        for note in notes
    )
    head = "".join(
        f'<th scope="col" style="text-align:right;opacity:.75">{name}</th>'
        for name in ("", "cost", "share", "count")
    )
    return (
        '<div style="max-width:600px;line-height:1.5">'
        f'<div style="font-size:1.35em;font-weight:600"><bdi>{escape(title)}</bdi></div>'
        f"<div><bdi>{escape(proof)}</bdi></div>{lines}"
        '<table style="margin:.5em 0;color:inherit;font-size:inherit;border-spacing:.8em 0">'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"{_chart(costs, ends)}</div>"
    )


def _swatch(name: str) -> str:
    colour = PART_COLOURS.get(name)
    return (
        f'<span style="display:inline-block;width:.8em;height:.8em;margin-right:.45em;'
        f'background:{colour};border:1px solid #888"></span>'
        if colour
        else ""
    )


def _chart(costs: dict[str, list[float]], ends: tuple[str, str]) -> str:
    """Stacked bars; where there are many steps the costliest of several stands for them."""
    from html import escape

    totals = [sum(values) for values in zip(*costs.values(), strict=True)]
    high = max(totals, default=0.0)
    if not high > 0:
        return ""
    together = -(-len(totals) // BARS)
    chosen = [
        max(range(first, min(first + together, len(totals))), key=totals.__getitem__)
        for first in range(0, len(totals), together)
    ]
    wide = CHART_WIDTH / len(chosen)
    below = [0.0] * len(chosen)
    paths = ""
    for name, values in costs.items():
        path = ""
        for bar, step in enumerate(chosen):
            tall = values[step] / high * CHART_HEIGHT
            if tall > 0:
                below[bar] += tall
                x, y = bar * wide, CHART_HEIGHT - below[bar]
                path += f"M{x:.1f} {y:.1f}h{wide * 0.85:.1f}v{tall:.1f}h{-wide * 0.85:.1f}z"
        if path:
            paths += f'<path d="{path}" fill="{PART_COLOURS[name]}"/>'
    label = f"cost of each step from {ends[0]} to {ends[1]}, at most {number(high)}"
    if together > 1:
        label += f"; each bar is the dearest of {together}"
    return (
        f'<svg viewBox="0 0 {CHART_WIDTH} {CHART_HEIGHT}" role="img" '
        'style="width:100%;display:block;background:#fff" '
        f'aria-label="{escape(label)}">{paths}<path d="M0 {CHART_HEIGHT}h{CHART_WIDTH}" '
        f'stroke="#888"/></svg>'
        f'<div style="opacity:.75;font-size:.85em">{escape(label)}</div>'
    )
