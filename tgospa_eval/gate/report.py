"""What a gate found: a table of 80 columns, JSON, Markdown for a pull request."""

import math
import textwrap
from collections.abc import Iterator
from typing import Any

from tgospa_eval.common.figures import number
from tgospa_eval.gate.outcome import Outcome, Report
from tgospa_eval.gate.rules import Finding, Verdict
from tgospa_eval.gate.suite import ONLY_PAIR
from tgospa_eval.reports import escape
from tgospa_eval.reports.console import WIDTH
from tgospa_eval.reports.escape import markdown_code
from tgospa_eval.results.records import json_text as document_text
from tgospa_eval.text import visible

SCHEMA = "tgospa-eval/gate/1"
PAIR, RULE, NUMBER = 16, 20, 11
"""Widths of columns."""


def title(outcome: Outcome) -> str:
    """What to call a pair."""
    return outcome.estimate if outcome.name == ONLY_PAIR and outcome.estimate else outcome.name


def headline(report: Report) -> str:
    """The verdict and what it is made of, in one line."""
    counts = ", ".join(f"{report.count(v)} {v}" for v in Verdict if report.count(v))
    pairs = "" if len(report.outcomes) == 1 else f": {counts}"
    return f"gate: {report.verdict} (exit status {report.status}){pairs}"


def table(report: Report) -> str:
    """The rules of all pairs, then notes about them."""
    updated = report.verdict is Verdict.UPDATED
    rows = [_head(*(("value", "old", "new", "") if updated else ("rule", *LIMITS)))]
    for outcome in report.outcomes:
        rows += list(_changes(outcome) if updated else _findings(outcome))
    if any(not finding.now.proven for o in report.outcomes for finding in o.findings):
        rows += ["", f"* {SPLIT}"]
    notes = [
        line
        for outcome in report.outcomes
        for note in outcome.notes
        if outcome.verdict is not Verdict.ERROR  # that is on stderr
        for line in textwrap.wrap(
            visible(f"{title(outcome)}: {note}"), WIDTH, subsequent_indent="  ",
            break_on_hyphens=False, break_long_words=False,
        )
    ]  # fmt: skip
    advice = ["To make the whole baseline anew, if that is right:", f"  {visible(report.advice)}"]
    blocks = [
        [headline(report)], rows if len(rows) > 1 else [], notes, advice if report.advice else [],
    ]  # fmt: skip
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


SPLIT = "the reported split, not proven: where optima tie, another has the same total"
"""Of values that are marked."""

LIMITS = ("baseline", "limit", "now")


def _head(name: str, *columns: str) -> str:
    return (f"{'pair':<{PAIR}}{name:<{RULE}}" + _numbers(*columns)).rstrip()


def _numbers(*columns: str) -> str:
    return "".join(f"{column:>{NUMBER}}" for column in columns)


def _row(pair: str, rule: str, *columns: str) -> str:
    return (f"{_fit(pair, PAIR)}{_fit(rule, RULE)}" + _numbers(*columns)).rstrip()


def _fit(text: str, width: int) -> str:
    """The end of a text, in which names differ, in its column."""
    text = visible(text)
    return f"{text if len(text) < width else '...' + text[4 - width :]:<{width}}"


def _findings(outcome: Outcome) -> Iterator[str]:
    if not outcome.findings:
        yield f"{_fit(title(outcome), PAIR)}{outcome.verdict}"
    for k, finding in enumerate(outcome.findings):
        rule = finding.rule.text + ("" if finding.now.proven else " *")
        base = "-" if finding.base is None or finding.rule.maximum else number_of(finding.base)
        yield (
            _row(
                "" if k else title(outcome), rule, base, number_of(finding.limit),
                number_of(deciding(finding)),
            )
            + f" {shown_verdict(finding)}"
        )  # fmt: skip


def shown_verdict(finding: Finding) -> str:
    """The verdict of a rule; one that only warns and is not known to be kept is a warning."""
    return "warning" if finding.warning else finding.verdict


def deciding(finding: Finding) -> float:
    """The bound that decides: the lower one of a failure, else the upper one."""
    return finding.now.lower if finding.verdict is Verdict.FAIL else finding.now.upper


def _changes(outcome: Outcome) -> Iterator[str]:
    for k, one in enumerate(outcome.changes):
        old, new = ("-" if value is None else number_of(value) for value in (one.old, one.new))
        yield _row("" if k else title(outcome), one.path, old, new)


def number_of(value: float) -> str:
    """A number in its column; what is not known is a dash."""
    if math.isnan(value):
        return "-"
    text = number(value, 7)
    return text if len(text) < NUMBER else f"{value:.4g}"


def json_text(report: Report) -> str:
    """The report with sorted keys, never NaN or Infinity."""
    document = {
        "schema": SCHEMA,
        "version": report.version,
        "baseline": report.baseline,
        "verdict": report.verdict,
        "status": report.status,
        "update": report.advice,
        "pairs": [_pair(outcome) for outcome in report.outcomes],
    }
    return document_text(document)


def _pair(outcome: Outcome) -> dict[str, Any]:
    return {
        "name": outcome.name,
        "truth": outcome.truth,
        "estimate": outcome.estimate,
        "verdict": outcome.verdict,
        "status": outcome.status,
        "notes": list(outcome.notes),
        "warnings": [notice.record() for notice in outcome.warnings],
        "rules": [_finding(finding) for finding in outcome.findings],
        "changes": {one.path: {"old": one.old, "new": one.new} for one in outcome.changes},
        "seconds": outcome.seconds,
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "rule": finding.rule.text,
        "warns": finding.rule.warns,
        "path": finding.rule.path,
        "baseline": None if finding.rule.maximum else finding.base,
        "limit": _finite(finding.limit),
        "lower": _finite(finding.now.lower),
        "upper": _finite(finding.now.upper),
        "proven": finding.now.proven,
        "improved": finding.improved,
        "verdict": finding.verdict,
    }


def _finite(value: float) -> float | None:
    """The number, if JSON can express it."""
    return value if math.isfinite(value) else None


def markdown(report: Report) -> str:
    """A table for a pull request."""
    return "\n".join(markdown_lines(report)) + "\n"


def markdown_lines(report: Report) -> Iterator[str]:
    """The lines of the Markdown report, the verdict first."""
    yield f"**TGOSPA {headline(report)}**"
    yield ""
    updated = report.verdict is Verdict.UPDATED
    if updated:
        yield from ("| pair | value | old | new |", "|---|---|---:|---:|")
    else:
        yield "| pair | rule | baseline | limit | now | verdict |"
        yield "|---|---|---:|---:|---:|---|"
    for outcome in report.outcomes:
        yield from _cells(outcome, updated=updated)
    yield ""
    for outcome in report.outcomes:
        for note in (*outcome.notes, *map(str, outcome.warnings)):
            yield f"- {markdown_code(title(outcome))}: {escape.markdown(note)}"
    if report.advice:
        yield f"\nTo make the whole baseline anew, if that is right: {markdown_code(report.advice)}"


def _cells(outcome: Outcome, *, updated: bool) -> Iterator[str]:
    name = markdown_code(title(outcome))
    if updated:
        for one in outcome.changes:
            old, new = ("" if v is None else number(v, 7) for v in (one.old, one.new))
            yield f"| {name} | {markdown_code(one.path)} | {old} | {new} |"
        return
    if not outcome.findings:
        yield f"| {name} | | | | | **{outcome.verdict}** |"
    for finding in outcome.findings:
        base = "" if finding.base is None or finding.rule.maximum else number(finding.base, 7)
        mark = "" if finding.now.proven else ", split, not proven"
        verdict = shown_verdict(finding)
        shown = verdict if verdict == Verdict.PASS else f"**{verdict}**"
        yield (
            f"| {name} | {markdown_code(finding.rule.text)} | {base} | {_cell(finding.limit)} | "
            f"{_cell(deciding(finding))} | {shown}{mark} |"
        )


def _cell(value: float) -> str:
    return "" if math.isnan(value) else number(value, 7)


GATE_REPORTS = {"table": table, "json": json_text, "markdown": markdown}
"""What ``--format`` of the gate prints, by name."""
