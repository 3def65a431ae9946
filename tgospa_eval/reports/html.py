"""The report as one page: words from a template, pictures by its script from packed data.

The page loads nothing: style, script and data are inside. Everything that comes from the user
passes through the autoescape of the template, or through `tojson` as data that the script shows as
text.
"""

from collections.abc import Mapping

import jinja2

from tgospa_eval.common.figures import number
from tgospa_eval.common.palette import DARK, DARK_TRACK_COLOURS, LIGHT, TRACK_COLOURS, variables
from tgospa_eval.reports.console import meaning, part_rows
from tgospa_eval.reports.page_data import document, packed
from tgospa_eval.results.records import Columns
from tgospa_eval.results.summary import Summary

SCRIPTS = ("data", "canvas", "costs", "lanes", "shapes", "plane", "gestures", "tables", "page")
"""Files of the script, in order; they share one scope."""

WORST_ROWS = 10
DISTANCE = "distance of assigned pairs"
"""What localisation is, which has no count."""


def page(result: Summary, names: tuple[str, str] = ("truth", "estimate")) -> str:
    """The whole page.

    Parameters
    ----------
    result : Summary
        What to show.
    names : pair of str
        What truth and estimate are called, as the paths of their files.
    """
    loader = jinja2.PackageLoader("tgospa_eval.reports", "page")
    environment = jinja2.Environment(
        loader=loader,
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    data, arrays = document(result)

    def inlined(name: str) -> str:
        return loader.get_source(environment, name)[0]

    return environment.get_template("page.html.j2").render(
        # a path may hold bytes that are no text
        names=[name.encode("utf-8", "backslashreplace").decode() for name in names],
        result=result,
        value=result.quantity(result.tgospa),
        bracket=[result.quantity(bound) for bound in (result.lower_bound, result.upper_bound)],
        traced=result.traced is not None,
        meaning=meaning(result),
        parts=_parts(result),
        total=number(result.total),
        per_step=result.quantity(result.normalised["tgospa"]),
        classes=_classes(result),
        seconds={k: v for k, v in _flat(result.timings).items() if not k.startswith("nano")},
        parameters=_flat(result.parameters),
        inputs={name: _flat(about) for name, about in result.input.items()},
        solver={k: v for k, v in _flat(result.solver).items() if k != "history"},
        worst=WORST_ROWS,
        data=data,
        arrays=packed(arrays),
        style=_colours() + inlined("page.css"),
        script="".join(inlined(f"{name}.js") for name in SCRIPTS),
    )


def _colours() -> str:
    """Those of all pictures; paper is white."""
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
        means, spread = map(result.share, result.split)
        rows[0]["split"] = f"means {means}, spread {spread}"
    return rows


def _classes(result: Summary) -> list[list[str]]:
    table: Columns = result.per_class_table()
    rows = zip(*table.values(), strict=True)
    return [[str(name), *map(number, values)] for name, *values in rows]


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
