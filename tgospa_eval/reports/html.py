"""The report as one page: words from a template, pictures by its script from packed data.

The page loads nothing: style, script and data are inside. Everything that comes from the user
passes through the autoescape of the template, or through `tojson` as data that the script shows as
text.
"""

import base64
import zlib
from collections.abc import Mapping, Sequence
from functools import cache

import jinja2
import numpy as np

from tgospa_eval.common.palette import DARK, DARK_TRACK_COLOURS, LIGHT, TRACK_COLOURS, variables
from tgospa_eval.common.words import counted, number, sizes_in_words
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.clock import ROOM, upward
from tgospa_eval.reports.console import (
    SPLIT_WORDS,
    meaning,
    part_rows,
    repair_notes,
    repair_table,
    similarity_in_words,
)
from tgospa_eval.reports.other_metrics import other_table, similarity
from tgospa_eval.reports.page_data import Drawn, document, thinned
from tgospa_eval.reports.slices import about_slices, share, shown_slices
from tgospa_eval.reports.tables import Table
from tgospa_eval.results.numbers import costliest
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import PARTS, Columns, Json, Time
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import as_unicode

SHOWN_ROWS = 20
"""Steps, truths, estimates and switches that are listed."""

TICKS_UP, TICKS_ACROSS = 4, 5


def partitioned_values(result: PartitionedResult, drawn: Drawn | None) -> dict[str, object]:
    """What the template takes beside the values that every page has."""
    data = (thinned(result) if drawn is None else drawn)[0]
    return {
        "together": data.get("together", 1),
        "costs": _stacked(data),
        "curve": _lines(data),
        "tables": [
            ("h-steps", "Costliest steps", _steps(result)),
            ("h-truths", "Costliest truths", _tracks(result, "missed")),
            ("h-estimates", "Costliest estimates", _tracks(result, "false")),
            ("h-switches", *_switches(result)),
        ],
    }


def _stacked(data: Json) -> Json:
    """Costs as bars without gaps, one part on the other."""
    tops = np.cumsum([data["costs"][name] for name in PARTS], axis=0).reshape(len(PARTS), -1)
    high = ROOM * float(tops.max(initial=0.0)) or 1.0
    bases = np.vstack([np.zeros(tops.shape[1]), tops[:-1]])
    shapes = [
        {"name": name, "looks": "area", "path": _between(top, base, high)}
        for name, top, base in zip(PARTS, tops, bases, strict=True)
        if (top > base).any()
    ]
    return _chart(shapes, high, data["times"])


def _lines(data: Json) -> Json:
    """The cumulative cost, a line for each part and for the total."""
    names = ("total", *PARTS)
    curve = {name: np.asarray(data["curve"][name], float) for name in names}
    high = ROOM * max(float(values.max(initial=0.0)) for values in curve.values()) or 1.0
    shapes = []
    for name, values in curve.items():
        across = 100 * (np.arange(len(values)) + 1) / max(len(values), 1)
        points = [f"{x:.2f} {y:.2f}" for x, y in zip(across, _down(values, high), strict=True)]
        if points:
            path = f"M0 {points[0].split()[1]}L" + "L".join(points)
            shapes.append({"name": name, "looks": "line", "path": path})
    return _chart(shapes, high, data["times"])


def _between(top: Floats, base: Floats, high: float) -> str:
    """The area between two staircases."""
    edges = 100 * np.arange(len(top) + 1) / max(len(top), 1)
    forth = "".join(
        f"L{left:.2f} {y:.2f}H{right:.2f}"
        for left, right, y in zip(edges[:-1], edges[1:], _down(top, high), strict=True)
    )
    back = "".join(
        f"L{right:.2f} {y:.2f}H{left:.2f}"
        for left, right, y in zip(
            edges[:-1][::-1], edges[1:][::-1], _down(base, high)[::-1], strict=True
        )
    )
    return f"M{forth[1:]}{back}Z"


def _down(values: Floats, high: float) -> Floats:
    """In percent from the top."""
    return 100 * (1 - values / high)


def _chart(shapes: list[Json], high: float, times: Sequence[Time]) -> Json:
    """Shapes one over the other, with ticks: times at some of the stretches, where they begin."""
    chosen = np.unique(np.linspace(0, len(times) - 1, TICKS_ACROSS).round().astype(int))
    across = [{"at": 100 * k / len(times), "text": str(times[k])} for k in chosen.tolist() if times]
    return {"shapes": shapes, "up": upward(high, TICKS_UP), "across": across}


def _steps(result: PartitionedResult) -> Table:
    """The costliest steps, with what they are made of."""
    table, names = result.table("per_step"), ("total", *PARTS)
    chosen = costliest(list(range(len(table["t"]))), np.array(table["total"]), SHOWN_ROWS)
    rows = [(str(table["t"][k]), *(number(table[name][k], 5) for name in names)) for k in chosen]
    return Table(head=("t", *names), rows=rows)


def _tracks(result: PartitionedResult, kind: str) -> Table:
    """The costliest tracks of one side."""
    found = result.costliest_tracks(kind, SHOWN_ROWS)
    parts = ("localisation", kind, "switch")
    rows = [
        (
            str(row["id"]),
            f"{row['steps']:,}",
            *(number(cost, 5) for cost in (sum(row[p] for p in parts), *(row[p] for p in parts))),
        )
        for row in found
    ]
    return Table(head=("id", "steps", "total", *parts), rows=rows)


def _switches(result: PartitionedResult) -> tuple[str, Table]:
    """The first switches, and how many there are."""
    table, count = result.first_switches(SHOWN_ROWS)
    ends = [["none" if end is None else str(end) for end in table[name]] for name in ("from", "to")]
    rows = [
        (str(t), str(truth), before, after, number(mass, 3), number(cost, 5))
        for t, truth, before, after, mass, cost in zip(
            table["t"], table["truth"], *ends, table["mass"], table["cost"], strict=True
        )
    ]
    of = f"The first of {counted(count, 'switch', 'switches')}"
    title = "Switches" if count == len(rows) else of
    return title, Table(head=("t", "truth", "from", "to", "switches", "cost"), rows=rows)


SCRIPTS = (
    "data",
    "canvas",
    "costs",
    "lanes",
    "shapes",
    "plane",
    "gestures",
    "tables",
    "repairs",
    "page",
)
"""Files of the script, in order; they share one scope."""

PLAIN = 300_000
"""Bytes of arrays that are too few to be deflated."""

AREAS = (
    "".join(
        f".area.{name} {{ fill: var(--{name}); }} .solid .{name} {{ background: var(--{name}); }}\n"
        for name in PARTS
    )
    + ".chart .line { vector-effect: non-scaling-stroke; stroke-linejoin: round; }\n"
    + ".costliest td { white-space: nowrap; }\n"
)
"""Style of the charts of data in parts."""

WORST_ROWS = 10
DISTANCE = "distance of assigned pairs"
"""What localisation is, which has no count."""


def page(
    result: Summary, names: tuple[str, str] = ("truth", "estimate"), drawn: Drawn | None = None
) -> str:
    """The whole page.

    Parameters
    ----------
    result : Summary
        What to show.
    names : pair of str
        What truth and estimate are called, as the paths of their files.
    drawn : Drawn, optional
        The `document` of the result, where it is known.
    """
    if isinstance(result, PartitionedResult):
        style = page_colours() + inlined("page.css") + inlined("batch.css") + AREAS
        template = environment().get_template("partitioned.html.j2")
        return template.render(
            style=style, **_values(result, names), **partitioned_values(result, drawn)
        )
    data, arrays = document(result) if drawn is None else drawn
    repaired = result.explained
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            **_values(result, names),
            repairs=[] if repaired is None else repair_table(result, repaired).rows,
            repair_notes=[] if repaired is None else list(repair_notes(repaired)),
            worst=WORST_ROWS,
            data=data,
            arrays=packed(arrays),
            style=page_colours() + inlined("page.css"),
            script="".join(inlined(f"{name}.js") for name in SCRIPTS),
        )
    )


def _values(result: Summary, names: tuple[str, str]) -> dict[str, object]:
    """What every page of a result says."""
    return {
        "names": list(map(as_unicode, names)),
        "result": result,
        "number": number,
        "meaning": meaning(result),
        "score": "" if result.calibration is None else similarity_in_words(result),
        "parts": _parts(result),
        "per_step": result.quantity(result.normalised["tgospa"]),
        "classes": list(zip(*result.table("per_class").values(), strict=True)),
        "others": other_table(result.with_).rows,
        "similarity": list(similarity(result.with_)),
        "shown_slices": shown_slices,
        "share": share,
        "about_slices": list(about_slices(result.sliced, certified=result.certified)),
        "seconds": {k: v for k, v in _flat(result.timings).items() if not k.startswith("nano")},
        "parameters": _flat(result.parameters),
        "inputs": {name: _flat(about) for name, about in result.input.items()},
        "solver": {k: v for k, v in _flat(result.solver).items() if k != "history"},
    }


@cache
def environment() -> jinja2.Environment:
    """What makes pages of the templates: all text that is put into them is escaped."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("tgospa_eval.reports", "page"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def inlined(name: str) -> str:
    """The text of a file beside the templates, as it stands."""
    loader = environment().loader
    assert loader is not None
    return loader.get_source(environment(), name)[0]


def packed(arrays: dict[str, Ints]) -> str:
    """The arrays one after the other as base64 text.

    Differences of neighbours, with the sign in the lowest bit, 32 bits, all lowest bytes first:
    what is regular becomes zeros, which deflate away. What is small stays as it is, and is drawn
    when the page is loaded: browsers inflate later. Deflated text is shorter than the arrays.
    """
    planes = []
    for array in (values.astype(np.int64) for values in arrays.values()):
        change = np.empty(len(array), np.int64)
        change[:1], change[1:] = array[:1], array[1:] - array[:-1]
        code = ((change << 1) ^ (change >> 63)).astype(np.uint32)
        planes += [(code >> shift).astype(np.uint8).tobytes() for shift in (0, 8, 16, 24)]
    data = b"".join(planes)
    if len(data) > PLAIN:
        # Only runs are looked for: a third of the time for the same size, as the rest is noise.
        packer = zlib.compressobj(strategy=zlib.Z_RLE)
        data = min(packer.compress(data) + packer.flush(), data, key=len)
    return base64.b64encode(data).decode("ascii")


def page_colours() -> str:
    """Those of all pictures, as style; paper is white."""
    light, dark = variables(LIGHT, TRACK_COLOURS), variables(DARK, DARK_TRACK_COLOURS)
    return (
        f":root, :root.printing {{ {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )


def _parts(result: Summary) -> list[dict[str, str]]:
    keys = ("name", "cost", "share", "count", "note")
    rows = [dict(zip(keys, row, strict=True)) | {"split": ""} for row in part_rows(result)]
    rows[0]["note"] = DISTANCE
    if result.split is not None:  # where the distance separates them
        parts = result.split.items()
        rows[0]["split"] = ", ".join(f"{SPLIT_WORDS[k]} {result.share(v)}" for k, v in parts)
    return rows


def _flat(record: Mapping[str, object], before: str = "") -> dict[str, str]:
    """A record as lines of text, nested names joined by a slash."""
    lines: dict[str, str] = {}
    for name, value in record.items():
        if isinstance(value, dict):
            lines |= _flat(value, f"{before}{name}/")
        elif isinstance(value, float):
            lines[before + name] = number(value)
        elif isinstance(value, list | tuple):
            lines[before + name] = ", ".join(map(str, value))
        elif value is not None:
            lines[before + name] = str(value)
    return lines


BARS = 140
"""Bars of the chart of a notebook, at most; of more steps the costliest of several are shown."""

CHART_WIDTH, CHART_HEIGHT = 560, 56


def card(result: Summary) -> str:
    """What a notebook shows: a headline, the four parts, and the cost of each step."""
    per_step = result.table("per_step")
    rows = [row[:4] for row in part_rows(result)]
    rows.append(("total", number(result.total), result.share(result.total), ""))
    notes = [
        *result.told,
        sizes_in_words(result.sizes),
        result.parameters_in_words(result.labels.unit),
    ]
    template = environment().get_template("card.html.j2")
    return template.render(result=result, notes=notes, rows=rows, colours=LIGHT, **_bars(per_step))


def _bars(per_step: Columns) -> Json:
    """Stacked bars as paths; where there are many steps the costliest of several stands for them.

    They stand on white, for a notebook does not say whether its paper is light or dark.
    """
    totals = [sum(values) for values in zip(*(per_step[name] for name in PARTS), strict=True)]
    high = max(totals, default=0.0)
    paths = dict.fromkeys(PARTS, "")
    if not high > 0:
        return {"label": "", "paths": paths}
    together = -(-len(totals) // BARS)
    chosen = [
        max(range(first, min(first + together, len(totals))), key=totals.__getitem__)
        for first in range(0, len(totals), together)
    ]
    wide = CHART_WIDTH / len(chosen)
    below = [0.0] * len(chosen)
    for name in PARTS:
        for bar, step in enumerate(chosen):
            tall = per_step[name][step] / high * CHART_HEIGHT
            if tall > 0:
                below[bar] += tall
                x, y = bar * wide, CHART_HEIGHT - below[bar]
                paths[name] += f"M{x:.1f} {y:.1f}h{wide * 0.85:.1f}v{tall:.1f}h{-wide * 0.85:.1f}z"
    times = per_step["t"]
    label = f"cost of each step from {times[0]} to {times[-1]}, at most {number(high)}"
    if together > 1:
        label += f"; each bar is the dearest of {together}"
    return {"label": label, "paths": paths, "width": CHART_WIDTH, "height": CHART_HEIGHT}
