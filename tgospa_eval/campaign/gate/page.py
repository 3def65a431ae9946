"""The folder of a gate: a page with verdicts and changes, and the pages of pairs.

Words and numbers from a template, without a script; the page loads nothing.
"""

from urllib.parse import quote

from tgospa_eval.campaign.gate.outcome import PairOutcome, Report
from tgospa_eval.campaign.gate.report import (
    PAGE,
    accept_title,
    change,
    headline,
    json_report,
    markdown,
    notes_of,
    number_of,
    rows_of,
    title,
)
from tgospa_eval.campaign.gate.rules import Verdict
from tgospa_eval.campaign.gate.suite import SEED
from tgospa_eval.common.words import natural
from tgospa_eval.results.records import Json
from tgospa_eval.show.html import environment, inlined, page_colours
from tgospa_eval.text import as_unicode

LEVELS = (0.01, 0.03, 0.1, 0.3)
"""Relative changes from which on a cell is darker."""


def gate_files(report: Report, seed: str = SEED) -> dict[str, str]:
    """The files of the folder by name.

    Parameters
    ----------
    report : Report
        What the gate found.
    seed : str
        The label in which runs of one scene differ.
    """
    pages = {one.page_name: one.page for one in report.outcomes if one.page}
    return {
        "gate.json": json_report(report),
        "gate.md": markdown(report),
        PAGE: page(report, seed),
        **pages,
    }


def page(report: Report, seed: str) -> str:
    """The page of all pairs."""
    rows = [
        {
            "name": title(outcome),
            "link": _link(outcome),
            "rule": rule,
            "numbers": [*map(number_of, values), change(values) or ""] if rule else [""] * 4,
            "verdict": verdict + ("" if proven else ", split, not proven"),
            "passes": verdict == Verdict.PASS,
        }
        for outcome, rule, values, verdict, proven in rows_of(report)
    ]
    seeds, grid = _grid(report, seed)
    html = (
        environment()
        .get_template("gate.html.j2")
        .render(
            report=report,
            headline=headline(report),
            accept_title=accept_title(report),
            beside=report.told(),
            failing=[row for row in rows if not row["passes"]],
            passing=[row for row in rows if row["passes"]],
            notes=list(notes_of(report)),
            seeds=seeds,
            grid=grid,
            style=page_colours() + inlined("page.css") + inlined("batch.css"),
        )
    )
    return as_unicode(html)


def _link(outcome: PairOutcome) -> str:
    return quote(outcome.page_name)


def _grid(report: Report, seed: str) -> tuple[list[str], list[tuple[str, list[Json]]]]:
    """Seeds, and for each scene a cell for each seed; nothing without values."""
    found: dict[str, dict[str, PairOutcome]] = {}
    for one in report.outcomes:
        if one.values and not one.group:
            scene = "/".join(text for label, text in one.labels.items() if label != seed)
            found.setdefault(scene if seed in one.labels else one.name, {})[
                one.labels.get(seed, "")
            ] = one
    seeds = sorted({name for runs in found.values() for name in runs}, key=natural)
    return seeds, [
        (scene, [_cell(runs.get(name)) for name in seeds])
        for scene, runs in sorted(found.items(), key=lambda item: natural(item[0]))
    ]


def _cell(one: PairOutcome | None) -> Json:
    if one is None:
        return {"text": "", "level": "", "link": ""}
    ends = one.base, one.values["total"].upper
    share = ends[1] / ends[0] - 1 if ends[0] else 0.0
    level = sum(abs(share) >= least for least in LEVELS)
    kind = "worse" if share > 0 else "better"
    return {
        "text": change(ends) or "-",
        "level": f"{kind}{level}" if level else "",
        "link": _link(one),
    }
