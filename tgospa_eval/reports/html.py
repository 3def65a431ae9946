"""The report as one page: words from a template, pictures by its script from packed data.

The page loads nothing: style, script and data are inside. Everything that comes from the user
passes through the autoescape of the template, or through `tojson` as data that the script shows as
text.
"""

import base64
import zlib
from collections.abc import Mapping
from functools import cache

import jinja2
import numpy as np

from tgospa_eval.common.figures import number
from tgospa_eval.common.palette import DARK, DARK_TRACK_COLOURS, LIGHT, TRACK_COLOURS, variables
from tgospa_eval.problem.problem import Ints
from tgospa_eval.reports.console import SPLIT_WORDS, meaning, part_rows, similarity_in_words
from tgospa_eval.reports.drawn import Drawn
from tgospa_eval.reports.other_metrics import other_table, similarity
from tgospa_eval.reports.page_data import document
from tgospa_eval.reports.partitioned_page import partitioned_values
from tgospa_eval.reports.repairs import repair_notes, repair_rows
from tgospa_eval.reports.slices import about_slices, slices_of_page
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import PARTS, Columns
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import as_unicode

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
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            **_values(result, names),
            traced=result.traced is not None,
            worst_window=_worst_window(result),
            **_explained(result),
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
        "value": result.quantity(result.tgospa),
        "bracket": [result.quantity(bound) for bound in (result.lower_bound, result.upper_bound)],
        "meaning": meaning(result),
        "score": "" if result.calibration is None else similarity_in_words(result),
        "parts": _parts(result),
        "total": number(result.total),
        "per_step": result.quantity(result.normalised["tgospa"]),
        "classes": _classes(result),
        "others": other_table(result.with_).rows,
        "similarity": list(similarity(result.with_)),
        "slices": list(map(slices_of_page, result.sliced)),
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


def _worst_window(result: Summary) -> str:
    found = result.windows_table().get("normalised")
    return result.quantity(max(found)) if found else ""


def _classes(result: Summary) -> list[list[str]]:
    table: Columns = result.per_class_table()
    rows = zip(*table.values(), strict=True)
    return [[str(name), *map(number, values)] for name, *values in rows]


def _explained(result: Summary) -> dict[str, object]:
    """Repairs as rows of cells, and what is said of them; none where they were not asked for."""
    found = result.explained
    return {
        "explained": found,
        "repairs": [] if found is None else repair_rows(result, found),
        "repair_notes": [] if found is None else list(repair_notes(found)),
    }


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
