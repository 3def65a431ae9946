"""HTML pages: report of a result, association, batch, and other reports.

Text and tables come from templates. On the pages of a result and of an association, a script draws
pictures from encoded data. A page loads nothing: it contains its style, script and data. Texts of
the user are either escaped by the template, or encoded by `tojson` and shown by the script as text.
"""

import base64
import itertools
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import counted, number, sizes_in_words
from tgospa_eval.evaluation.pair import explanation_of
from tgospa_eval.quoting import as_unicode
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.summary import percent
from tgospa_eval.sensors import Pairing
from tgospa_eval.show import batch, result_text, table_text
from tgospa_eval.show.chart_list import Pictures, pictures
from tgospa_eval.show.plot_data import PlotData, plot_data
from tgospa_eval.show.study_table import NARROW
from tgospa_eval.show.style import (
    DARK,
    DARK_TRACK_COLOURS,
    HEAT_LEVELS,
    LIGHT,
    TRACK_COLOURS,
    heat_shades,
    variables,
)

if TYPE_CHECKING:
    import pandas as pd


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
"""Files that are joined to one script, in this order. Each can use the names of all files."""

PLAIN = 300_000
"""Largest size of the uncompressed data of a page, in bytes. Larger data are compressed."""

DISTANCE = "distance of assigned pairs"
"""Explanation of localisation in the table of parts. Other parts have the unit of their count."""


def page(result: Evaluation, names: tuple[str, str] = ("truth", "estimate")) -> str:
    """Return the page of a result. `names` has names of truth and estimate, such as their paths."""
    plotted, repaired = plot_data(result), explanation_of(result)
    return template("page.html.j2").render(
        **_values(result, names),
        partitioned=isinstance(result, PartitionedResult),
        repairs=[] if repaired is None else result_text.repair_table(result, repaired).rows,
        repair_notes=[] if repaired is None else list(result_text.repair_notes(repaired)),
        **_inside(plotted),
    )


def association_page(pairing: Pairing, names: tuple[str, str]) -> str:
    """Return the page of an association. `names` has names of both sides, such as their paths."""
    plotted = plot_data(pairing)
    return template("association.html.j2").render(
        names=list(map(as_unicode, names)),
        version=__version__,
        lines=result_text.association_text(pairing, rows=False).splitlines(),
        parts=[{"name": name} for name in plotted.document["parts"]],
        each={"tgospa": number(plotted.document["curve"]["total"][-1]) if plotted.steps else ""},
        distance=pairing.distance.name,
        partitioned=False,
        **_inside(plotted),
    )


def _inside(plotted: PlotData) -> dict[str, object]:
    """Return the values that all templates of pages with a script need."""
    return {
        "data": plotted.document,
        "word": plotted.word,
        "arrays": packed(plotted.arrays),
        "style": page_colours() + inlined("page.css"),
        "script": "".join(inlined(f"{name}.js") for name in SCRIPTS),
    }


def _values(result: Evaluation, names: tuple[str, str]) -> dict[str, object]:
    """Return the values that only the template of the page of a result needs."""
    return {
        "names": list(map(as_unicode, names)),
        "result": result,
        "meaning": result_text.meaning(result),
        "nees": "" if result.nees is None else result.nees.in_words,
        "score": "" if result.calibration is None else result_text.similarity_in_words(result),
        "parts": _parts(result),
        "each": {
            name: result.each_in_words(name)
            for name in ("tgospa", "per_object")
            if name in result.normalised
        },
        "classes": result_text.class_table(result),
        "other_metrics": result_text.other_table(result.with_),
        "similarity": list(result_text.similarity(result.with_)),
        "about_slices": list(result_text.about_slices(result.slicings, certified=result.certified)),
        "summary": table_text.Table(
            head=("", ""), rows=[*result_text.summary_of(result)], align="ll"
        ),
        "seconds": {
            k: v for k, v in _flat(result.timings, digits=3).items() if not k.startswith("nano")
        },
        "parameters": _flat(result.parameters),
        "inputs": {name: _flat(about) for name, about in result.input.items()},
        "solver": {k: v for k, v in _flat(result.solver).items() if k != "history"},
    }


USED_BY_TEMPLATES = {
    "number": number,
    "percent": percent,
    "share": result_text.share,
    "orders": table_text.ORDERS,
    "shown_slices": result_text.shown_slices,
    "of_expected": batch.of_expected,
    "tracks": len(TRACK_COLOURS),
    "levels": HEAT_LEVELS,
    "all_parts": PARTS,
}


@cache
def template(name: str) -> jinja2.Template:
    """Return the template with this file name; it escapes all text."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tgospa_eval.show", "page"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= USED_BY_TEMPLATES
    return environment.get_template(name)


def still_page(name: str, more_style: str = "", **values: object) -> str:
    """Return a page without a script from its template; `more_style` is added to its CSS."""
    style = page_colours() + more_style + inlined("page.css") + inlined("batch.css")
    return as_unicode(template(name).render(style=style, **values))


def images(kind: str, subject: Any, *, draws: bool = True) -> dict[str, str]:
    """Return the pictures of a subject by name, as SVG in base64; empty if `draws` is false.

    `kind` is the kind of the subject, a key of `CHARTS`.
    """
    made = pictures(kind, subject, Pictures(formats=("svg",))) if draws else {}
    return {name: base64.b64encode(image).decode() for name, image in made.items()}


def inlined(name: str) -> str:
    """Return the unchanged text of a file in the folder of the templates."""
    return Path(__file__).with_name("page").joinpath(name).read_text(encoding="utf-8")


def packed(arrays: dict[str, Ints]) -> str:
    """Encode the arrays one after the other as base64 text.

    Each number is stored as the 32-bit difference to the number before it, with the sign in the
    lowest bit. For each array, the lowest bytes of all its numbers come first, then the next bytes.
    In this way, regular data become zeros, which compress well.

    Small data are not compressed, because a page can draw uncompressed data while it loads. The
    page recognises compressed data by their length: they are shorter than the arrays.
    """
    planes = []
    for array in (values.astype(np.int64) for values in arrays.values()):
        change = np.empty(len(array), np.int64)
        change[:1], change[1:] = array[:1], array[1:] - array[:-1]
        code = ((change << 1) ^ (change >> 63)).astype(np.uint32)
        planes += [(code >> shift).astype(np.uint8).tobytes() for shift in (0, 8, 16, 24)]
    data = b"".join(planes)
    if len(data) > PLAIN:
        # Z_RLE only compresses repeated bytes. It takes a third of the time for the same size.
        packer = zlib.compressobj(strategy=zlib.Z_RLE)
        data = min(packer.compress(data) + packer.flush(), data, key=len)
    return base64.b64encode(data).decode("ascii")


def page_colours() -> str:
    """Return CSS that declares the colours of all pictures; printed pages have the light ones."""
    light, dark = variables(LIGHT, TRACK_COLOURS), variables(DARK, DARK_TRACK_COLOURS)
    return (
        f":root, :root.printing {{ {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )


def _parts(result: Evaluation) -> list[dict[str, str]]:
    keys = ("name", "cost", "share", "count", "note")
    rows = [
        dict(zip(keys, row, strict=True)) | {"split": ""} for row in result_text.part_rows(result)
    ]
    rows[0]["note"] = DISTANCE
    if result.split is not None:  # the distance splits localisation
        parts = result.split.items()
        rows[0]["split"] = ", ".join(
            f"{result_text.SPLIT_WORDS[k]} {result.share(v)}" for k, v in parts
        )
    return rows


def _flat(record: Mapping[str, object], before: str = "", digits: int = 6) -> dict[str, str]:
    """Return texts by name for a nested mapping; nested names are joined by a slash."""
    lines: dict[str, str] = {}
    for name, value in record.items():
        if isinstance(value, dict):
            lines |= _flat(value, f"{before}{name}/", digits)
        elif isinstance(value, float):
            lines[before + name] = number(value, digits)
        elif isinstance(value, list | tuple):
            lines[before + name] = ", ".join(map(str, value))
        elif value is not None:
            lines[before + name] = str(value)
    return lines


def card(result: Evaluation) -> str:
    """Return the HTML that a notebook shows for a result: a headline and the four parts."""
    rows = [row[:4] for row in result_text.part_rows(result)]
    rows.append(("total", number(result.total), result.share(result.total), ""))
    notes = [
        *result.messages,
        sizes_in_words(result.sizes),
        result.parameters_in_words(result.labels.unit),
        *filter(None, [result.exclusions]),
    ]
    return template("card.html.j2").render(result=result, notes=notes, rows=rows, colours=LIGHT)


def document_page(document: table_text.Document, kind: str, subject: Any, *, draws: bool) -> str:
    """Return a page with a report, and with the pictures of `images` if `draws`."""
    shown = images(kind, subject, draws=draws).items()
    named = {name.removesuffix(".svg").replace("_", " "): image for name, image in shown}
    return still_page("document.html.j2", document=document, version=__version__, images=named)


# -------------------------------------------------------------------------------------------------
# Page of a batch: ranking, jobs, parts of the costs, values over time. It has no script.

METRIC_COLUMNS = ("distance", "cutoff", "order", "switch_penalty")
"""Columns of a batch that have parameters of the metric."""

MAX_GROUPS = 40
MAX_FAULTS = 50
COSTLIEST = 10

ALL_PAIRS = 5
"""Largest number of ranked entries for which the page lists all pairs. For more entries, it lists
only pairs of neighbours in the ranking."""


def batch_page(tables: batch.BatchTables, *, draws: bool) -> str:
    """Return the page of a batch, with pictures if `draws`."""
    rows, ranked = tables.rows, tables.rankings
    # With several sets of parameters, there are several rankings, and no entry is the best of all.
    ranking = ranked[0] if len(ranked) == 1 else None
    failed = rows[rows["status"] == "failed"]
    valued = rows[rows["status"] != "failed"]
    runs = sorted({count for _, curve in tables.plotted_curves for count in curve.runs})
    return still_page(
        "batch.html.j2",
        _shades(),
        tables=tables,
        source=_source(tables),
        title=_title(tables, ranking),
        sentence=""
        if ranking is None
        else table_text.order_in_words(ranking.value, ranking.entries, ranking.comparisons),
        failed=len(failed),
        unproven=int((~valued["certified"].astype(bool)).sum()) if len(valued) else 0,
        rankings=[_ranking(tables, one) for one in ranked],
        parameter_sets=len({(*group["parameters"],) for group in tables.shown_groups}),
        groups=tables.shown_groups[:MAX_GROUPS],
        common=any(one.jobs < one.all_jobs for one in ranked),
        other_metrics=list(batch.other_tables(tables)),
        about_other_metrics=list(batch.about_other_metrics(tables)),
        slices=list(batch.slice_tables(tables)),
        about_slices=list(batch.about_slices_of(tables)),
        images=list(images("page of a batch", tables, draws=draws).values()),
        curves_shown=len({curve.name for _, curve in tables.plotted_curves}),
        fewest_runs=f"{runs[0]:,} to " if len(runs) > 1 else "",
        runs=counted(max(runs, default=0), "run"),
        bands=[batch.BANDS[curve.band] for curve in tables.curves[:1]],
        curve_groups=len({curve.name for curve in tables.curves}),
        costliest=list(_costliest(tables, valued)),
        faults=_rows(failed.head(MAX_FAULTS)),
        per_step=_per_step,
        settings=_settings(tables),
    )


def _shades() -> str:
    """Return CSS for the shades of the table of jobs and for the colours of groups."""
    light, dark = (
        " ".join(f"--heat-{k}: {shade};" for k, shade in enumerate(heat_shades(colours)))
        for colours in (LIGHT, DARK)
    )
    levels = "\n".join(f".h{k} {{ background: var(--heat-{k}); }}" for k in range(HEAT_LEVELS))
    tracks = "\n".join(
        f".c{k} {{ background: var(--track-{k}); }}" for k in range(len(TRACK_COLOURS))
    )
    return (
        f":root {{ {light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
        f"{levels}\n{tracks}\n"
    )


def _source(tables: batch.BatchTables) -> tuple[str, str]:
    """Return the paths or patterns of the estimates and of the ground truth, as given."""
    jobs = tables.settings["jobs"]
    paths = [str(path) for path in jobs["paths"]]
    if jobs["layout"]:
        return paths[1], paths[0]
    return (str(jobs["estimate"]), str(jobs["truth"])) if jobs["estimate"] else (paths[0], "")


def _title(tables: batch.BatchTables, ranking: batch.Ranking | None) -> str:
    """Return the headline of the page of a batch."""
    if ranking is not None:
        best = ranking.entries[0]
        if best["place"] != (1, 1):
            return f"{ranking.label}: none of {len(ranking.entries)} is proven best"
        return f"{best['name']}: {ranking.value} {tables.between(batch.bracket(best, 'per_step'))}"
    if len(tables.shown_groups) == 1:
        return f"TGOSPA {tables.between(tables.shown_groups[0]['per_step'])} per step"
    return "TGOSPA of a batch"


def _ranking(tables: batch.BatchTables, ranking: batch.Ranking) -> dict[str, object]:
    """Return a ranking for the template: texts, and positions of bounds and intervals in percent.

    All positions are on one scale, from the smallest to the largest end.
    """
    entries: list[tuple[dict[str, object], Interval, Interval | None]] = []
    for entry in ranking.entries:
        name, per_step = entry["name"], batch.bracket(entry, "per_step")
        ends = entry["per_step_confidence"]
        sure = Interval(lower=ends[0], upper=ends[1]) if ends else None
        words = {
            "name": name,
            "track": tables.compared[name],
            "place": ranking.place(entry),
            "statistical": table_text.place_in_words(*(entry["statistical_place"] or (0, 0))),
            "per_step": tables.between(per_step),
            "sure": tables.between(sure, 4) if sure else "",
        }
        entries.append((words, per_step, sure))
    shown = [interval for _, *both in entries for interval in both if interval is not None]
    low, high = min(interval.lower for interval in shown), max(interval.upper for interval in shown)
    room = (high - low) * 0.04 if high - low > NARROW * high else 1.0

    def place(value: float) -> float:
        return 100 * (value - low + room) / (high - low + 2 * room)

    return {
        "about": ranking,
        "parameters": batch.parameters_in_words(ranking.parameters),
        "entries": [
            words | {"bracket": _span(place, value), "whisker": sure and _span(place, sure)}
            for words, value, sure in entries
        ],
        "ends": [tables.quantity(end, 4) for end in (low, high)],
        "pairs": list(_pairs(tables, ranking)),
        "all_pairs": len(ranking.comparisons),
    }


def _span(place: Callable[[float], float], interval: Interval) -> tuple[str, str]:
    """Return the left end and the width of an interval in percent, as texts."""
    left, right = place(interval.lower), place(interval.upper)
    return f"{left:.2f}", f"{right - left:.2f}"


def _pairs(tables: batch.BatchTables, ranking: batch.Ranking) -> Iterator[Json]:
    """Yield all pairs of entries if there are few entries, otherwise the pairs of neighbours."""
    near = set(itertools.pairwise(entry["name"] for entry in ranking.entries))
    for pair in ranking.comparisons:
        if len(ranking.entries) <= ALL_PAIRS or (pair["first"], pair["second"]) in near:
            low, high = pair["per_step_difference"]
            yield {**pair, "difference": tables.between(Interval(lower=low, upper=high))}


def _costliest(
    tables: batch.BatchTables, valued: "pd.DataFrame"
) -> "Iterator[tuple[str, list[pd.Series[Any]]]]":
    """Yield the jobs with the largest cost per step, for each set of parameters."""
    if len(valued) < 2:
        return
    each = valued["total"] / valued["judged.steps"].clip(lower=1)
    order = each.sort_values(ascending=False, kind="stable").index
    names = list(tables.parameters)
    if not names:
        yield "", _rows(valued.loc[order[:COSTLIEST]])
        return
    sets = valued.loc[order].groupby(names, dropna=False)
    for _, jobs in itertools.islice(sets, COSTLIEST):
        about = batch.parameters_in_words({name: jobs[name].iloc[0] for name in names})
        yield about, _rows(jobs.head(max(1, COSTLIEST // sets.ngroups)))


def _rows(jobs: "pd.DataFrame") -> "list[pd.Series[Any]]":
    return [row for _, row in jobs.iterrows()]


def _per_step(row: "pd.Series[Any]") -> Interval:
    """Return the bounds of the normalised value of a job."""
    steps, power = max(float(row["judged.steps"]), 1.0), 1 / float(row["order"])
    return Interval(
        lower=(float(row["total_lower"]) / steps) ** power,
        upper=(float(row["total_upper"]) / steps) ** power,
    )


def _settings(tables: batch.BatchTables) -> dict[str, str]:
    """Return inputs and settings of the evaluation as texts by name."""
    rows, jobs = tables.rows, tables.settings["jobs"]
    settings = {name: str(value) for name, value in jobs.items() if value and name != "paths"}
    if jobs["paths"]:
        settings["paths"] = " ".join(map(str, jobs["paths"]))
    for name in METRIC_COLUMNS:
        values: list[float | str] = list(rows[name].dropna().unique()) if name in rows else []
        if len(values) == 1:
            value = values[0]
            settings[name] = value if isinstance(value, str) else number(float(value))
        elif len(values):
            settings[name] = "different between jobs"
    settings |= dict(text.split(": ", 1) for text in batch.about_periods(tables))
    return {str(k): str(v) for k, v in tables.settings["options"].items()} | settings
