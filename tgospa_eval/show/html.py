"""The report as one page: words from a template, pictures by its script from packed data.

The page loads nothing: style, script and data are inside. Everything that comes from the user
passes through the autoescape of the template, or through `tojson` as data that the script shows as
text.
"""

import base64
import zlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import jinja2
import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.words import number, sizes_in_words
from tgospa_eval.evaluation.pair import explanation_of
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.sensors import Pairing
from tgospa_eval.show.plot_data import PlotData, plot_data
from tgospa_eval.show.result_text import (
    SPLIT_WORDS,
    association_text,
    class_table,
    meaning,
    part_rows,
    repair_notes,
    repair_table,
    similarity_in_words,
)
from tgospa_eval.show.side_tables import about_slices, other_table, share, shown_slices, similarity
from tgospa_eval.show.style import DARK, DARK_TRACK_COLOURS, LIGHT, TRACK_COLOURS, variables
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

DISTANCE = "distance of assigned pairs"
"""What localisation is, which has no count."""


def page(result: Evaluation, names: tuple[str, str] = ("truth", "estimate")) -> str:
    """The whole page.

    Parameters
    ----------
    result : Evaluation
        What to show.
    names : pair of str
        What truth and estimate are called, as the paths of their files.
    """
    drawn, repaired = plot_data(result), explanation_of(result)
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            **_values(result, names),
            partitioned=isinstance(result, PartitionedResult),
            repairs=[] if repaired is None else repair_table(result, repaired).rows,
            repair_notes=[] if repaired is None else list(repair_notes(repaired)),
            **_inside(drawn),
        )
    )


def association_page(found: Pairing, names: tuple[str, str]) -> str:
    """The page of an association, with the same views.

    Parameters
    ----------
    found : Pairing
        What to show.
    names : pair of str
        What the sides are called, as the paths of their files.
    """
    drawn = plot_data(found)
    template = environment().get_template("association.html.j2")
    return template.render(
        names=list(map(as_unicode, names)),
        version=__version__,
        lines=association_text(found, rows=False).splitlines(),
        parts=[{"name": name} for name in drawn.document["parts"]],
        each={"tgospa": number(drawn.document["curve"]["total"][-1]) if drawn.steps else ""},
        distance=found.distance.name,
        partitioned=False,
        **_inside(drawn),
    )


def _inside(drawn: PlotData) -> dict[str, object]:
    """What every page with views holds."""
    return {
        "data": drawn.document,
        "word": drawn.word,
        "tracks": len(TRACK_COLOURS),
        "arrays": packed(drawn.arrays),
        "style": page_colours() + inlined("page.css"),
        "script": "".join(inlined(f"{name}.js") for name in SCRIPTS),
    }


def _values(result: Evaluation, names: tuple[str, str]) -> dict[str, object]:
    """What every page of a result says."""
    return {
        "names": list(map(as_unicode, names)),
        "result": result,
        "number": number,
        "meaning": meaning(result),
        "nees": "" if result.nees is None else result.nees.in_words,
        "score": "" if result.calibration is None else similarity_in_words(result),
        "parts": _parts(result),
        "each": {name: result.quantity(value) for name, value in result.normalised.items()},
        "classes": class_table(result),
        "others": other_table(result.with_),
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
        loader=jinja2.PackageLoader("tgospa_eval.show", "page"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def inlined(name: str) -> str:
    """The text of a file beside the templates, as it stands."""
    return Path(__file__).with_name("page").joinpath(name).read_text(encoding="utf-8")


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


def _parts(result: Evaluation) -> list[dict[str, str]]:
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


def card(result: Evaluation) -> str:
    """What a notebook shows: a headline and the four parts."""
    rows = [row[:4] for row in part_rows(result)]
    rows.append(("total", number(result.total), result.share(result.total), ""))
    notes = [
        *result.told,
        sizes_in_words(result.sizes),
        result.parameters_in_words(result.labels.unit),
        *filter(None, [result.not_judged]),
    ]
    template = environment().get_template("card.html.j2")
    return template.render(result=result, notes=notes, rows=rows, colours=LIGHT)
