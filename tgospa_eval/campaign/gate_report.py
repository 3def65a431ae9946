"""What a gate found: a table of 80 columns, JSON, Markdown for a pull request."""

import math
import os
from collections.abc import Iterable, Iterator
from textwrap import TextWrapper

from tgospa_eval.campaign.outcome import PairOutcome, Report, texts
from tgospa_eval.campaign.rules import Finding, Verdict
from tgospa_eval.campaign.suite import ONLY_PAIR
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.files import is_missing, named, patience
from tgospa_eval.common.words import number
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports import tables as escape
from tgospa_eval.reports.tables import (
    WIDTH,
    Row,
    Table,
    markdown_code,
    markdown_lines,
    text_lines,
    workflow_data,
    workflow_property,
    xml,
)
from tgospa_eval.results.records import Json, json_text
from tgospa_eval.text import clipped, ending, visible

SCHEMA = "tgospa-eval/gate/1"
WIDTHS = (16, 20, 11, 11, 11, 0)
"""Of the columns: pair, rule, three numbers, verdict."""

ANEW = "To make the whole baseline anew, if that is right"


def title(outcome: PairOutcome) -> str:
    """What to call a pair."""
    return outcome.estimate if outcome.name == ONLY_PAIR and outcome.estimate else outcome.name


def headline(report: Report) -> str:
    """The verdict and what it is made of, in one line."""
    counts = ", ".join(f"{report.count(v)} {v}" for v in Verdict if report.count(v))
    pairs = "" if len(report.outcomes) == 1 else f": {counts}"
    return f"gate: {report.verdict} (exit status {report.status}){pairs}"


UNPROVEN = "the reported split, not proven: where optima tie, another has the same total"
"""Of values that are marked."""

LIMITS = ("baseline", "limit", "now")


def _rows(
    report: Report,
) -> Iterator[tuple[PairOutcome, str, tuple[float | None, ...], str, bool]]:
    """Of each rule the pair, its text, baseline, limit, value, the verdict, whether proven.

    Of an update each value that changes, before and after; of what could not be judged a single
    row without numbers.
    """
    for outcome in report.outcomes:
        for path, change in outcome.changes.items():
            yield outcome, path, change, "", True
        for finding in outcome.findings:
            base = None if finding.rule.maximum else finding.base
            # The bound that decides.
            now = finding.now.lower if finding.verdict is Verdict.FAIL else finding.now.upper
            values = (base, finding.limit, now)
            yield outcome, finding.rule.text, values, shown_verdict(finding), finding.now.proven
        if not outcome.findings and outcome.verdict is not Verdict.UPDATED:
            yield outcome, "", (None,) * len(LIMITS), outcome.verdict, True


def table(report: Report) -> str:
    """The rules of all pairs, then notes about them."""
    updated = report.verdict is Verdict.UPDATED
    rows: list[Row] = []
    above = None
    for outcome, rule, values, verdict, proven in _rows(report):
        pair = "" if outcome is above else ending(visible(title(outcome)), WIDTHS[0] - 1)
        text = ending(visible(f"{rule or verdict}{'' if proven else ' *'}"), WIDTHS[1] - 1)
        numbers = map(number_of, values) if rule else ()
        rows.append((pair, text, *numbers, *([f" {verdict}"] if rule and not updated else [])))
        above = outcome
    head = ("pair", "value", "old", "new") if updated else ("pair", "rule", *LIMITS)
    lines = text_lines(Table(head=head, rows=rows, align="llrrrl", widths=WIDTHS), "")
    if any(not finding.now.proven for o in report.outcomes for finding in o.findings):
        lines += ["", f"* {UNPROVEN}"]
    lay = TextWrapper(WIDTH, "", "  ", break_on_hyphens=False, break_long_words=False)
    notes = [
        line
        for outcome in report.outcomes
        for note in outcome.notes
        if outcome.verdict is not Verdict.ERROR  # that is on stderr
        for line in lay.wrap(visible(f"{title(outcome)}: {note}"))
    ]
    blocks = [[headline(report)], lines if len(lines) > 1 else [], notes]
    blocks += [lay.wrap(visible(text)) for text in report.told()]
    if report.advice:
        blocks.append([f"{ANEW}:", f"  {visible(report.advice)}"])
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def shown_verdict(finding: Finding) -> str:
    """The verdict of a rule; one that only warns and is not proven to hold is a warning."""
    return "warning" if finding.warning else finding.verdict


def number_of(value: float | None) -> str:
    """A number in its column; what is not known is a dash."""
    if value is None or math.isnan(value):
        return "-"
    text = number(value, 7)
    return text if len(text) < WIDTHS[2] else f"{value:.4g}"


def json_report(report: Report) -> str:
    """The report with sorted keys, never NaN or Infinity."""
    document = {
        "schema": SCHEMA,
        "version": report.version,
        "baseline": report.baseline,
        "verdict": report.verdict,
        "status": report.status,
        "update": report.advice,
        **settings_field(report.settings_file),
        "pairs": [_pair(outcome) for outcome in report.outcomes],
    }
    return json_text(document)


def _pair(outcome: PairOutcome) -> Json:
    return {
        "name": outcome.name,
        "truth": outcome.truth,
        "estimate": outcome.estimate,
        "verdict": outcome.verdict,
        "status": outcome.status,
        "notes": list(outcome.notes),
        "warnings": [notice.record() for notice in outcome.warnings],
        "rules": [finding_record(finding) for finding in outcome.findings],
        "changes": {path: {"old": old, "new": new} for path, (old, new) in outcome.changes.items()},
        "seconds": outcome.seconds,
    }


def finding_record(finding: Finding) -> Json:
    """What a rule found, as the JSON has it."""
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
    return "\n".join(github_lines(report)) + "\n"


def github_lines(report: Report) -> Iterator[str]:
    """The lines of the Markdown report, the verdict first."""
    yield from (f"**TGOSPA {headline(report)}**", "")
    updated = report.verdict is Verdict.UPDATED
    rows: list[Row] = []
    for outcome, rule, values, verdict, proven in _rows(report):
        about = verdict if rule and verdict == Verdict.PASS else f"**{verdict}**"
        about += "" if proven else ", split, not proven"
        cells = [_cell(value) for value in values] if rule else [None] * len(LIMITS)
        text = markdown_code(rule) if rule else None
        rows.append((markdown_code(title(outcome)), text, *cells, *([] if updated else [about])))
    head = ("value", "old", "new") if updated else ("rule", *LIMITS, "verdict")
    align = "llrr" if updated else "llrrrl"
    found = Table(head=("pair", *head), rows=rows, align=align)
    yield from (*markdown_lines(found, escape=str), "")
    for outcome in report.outcomes:
        for note in (*outcome.notes, *map(str, outcome.warnings)):
            yield f"- {markdown_code(title(outcome))}: {escape.markdown(note)}"
    yield from (f"- {escape.markdown(text)}" for text in report.told())
    if report.advice:
        yield f"\n{ANEW}: {markdown_code(report.advice)}"


def _cell(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else number(value, 7)


GATE_REPORTS = {"table": table, "json": json_report, "markdown": markdown}
"""What ``--format`` of the gate prints, by name."""


# -------------------------------------------------------------------------------------------------
# What a gate found for GitHub Actions: annotations and the step summary, within GitHub's limits.
#
# Ten errors and ten warnings of a step are shown, and a summary of at most 1 MiB.

MOST_ANNOTATIONS = 10
"""Annotations of one kind that GitHub shows of a step."""

LONGEST = 1000
"""Characters of a message."""

SUMMARY = 1_000_000
"""Bytes of the step summary."""

CUT = "\n*The rest does not fit into a step summary; see the log or the JUnit report.*\n"


def annotations(report: Report) -> Iterator[str]:
    """Workflow commands: an error for each pair that does not pass, a warning if one warns."""
    errors = [
        (title(outcome), "\n".join((outcome.verdict, *outcome.notes)))
        for outcome in report.outcomes
        if outcome.status
    ]
    warnings = []
    for outcome in report.outcomes:
        lines = [notice.sentence for notice in outcome.warnings]
        if outcome.warned:
            broken = ", ".join(finding.rule.text for finding in outcome.warned)
            lines.insert(0, f"broken or undecided, for a warning only: {broken}")
        if lines:
            warnings.append((title(outcome), "\n".join(lines)))
    for kind, found in (("error", errors), ("warning", warnings)):
        shown = found if len(found) <= MOST_ANNOTATIONS else found[: MOST_ANNOTATIONS - 1]
        for name, text in shown:
            yield _command(kind, f"TGOSPA gate: {name}", text)
        if len(found) > len(shown):
            rest = found[len(shown) :]
            names = ", ".join(name for name, _ in rest)
            yield _command(kind, f"TGOSPA gate: {len(rest)} more pairs", names)


def _command(kind: str, heading: str, text: str) -> str:
    message = "\n".join(map(visible, text.split("\n")))
    if len(message) > LONGEST:
        message = message[: LONGEST - 3] + "..."
    heading = workflow_property(clipped(heading, LONGEST))
    return f"::{kind} title={heading}::{workflow_data(message)}"


def append_summary(report: Report, path: str | None) -> None:
    """Append the Markdown report to the step summary, whole lines as far as they fit.

    Outside of GitHub Actions there is none, and nothing is done.

    Raises
    ------
    ConfigError
        The system refuses to write the file.
    """
    if not path:
        return
    with named(f"--github: {path}", ConfigError, "cannot be written"):
        used = 0 if is_missing(path) else os.stat(path).st_size
        with patience(path, "a reader of"), open(path, "ab") as file:
            file.write(summary(report, SUMMARY - used))


def summary(report: Report, room: int) -> bytes:
    """The Markdown report in at most so many bytes."""
    lines = [f"{line}\n".encode() for line in (*github_lines(report), "")]
    if sum(map(len, lines)) <= room:
        return b"".join(lines)
    room -= len(CUT.encode())
    shown = []
    for line in lines:
        room -= len(line)
        if room < 0:
            break
        shown.append(line)
    return b"".join((*shown, CUT.encode())) if shown else b""


# -------------------------------------------------------------------------------------------------
# What a gate found as JUnit XML, as Jenkins and GitLab read it: one case for each rule.
#
# A rule that is broken is a failure, what could not be judged an error; a warning passes with a
# text.
# Written by hand: to import a library for XML takes as long as a small evaluation.

SUITE = "tgospa-eval gate"


def junit(report: Report) -> str:
    """The report as a document."""
    cases = [
        case
        for outcome in report.outcomes
        for case in _cases(outcome, report.told(*outcome.warnings))
    ]
    attributes = {
        "name": SUITE,
        "tests": str(len(cases)),
        "failures": str(sum("<failure " in case for case in cases)),
        "errors": str(sum("<error " in case for case in cases)),
        "time": f"{sum(outcome.seconds for outcome in report.outcomes):.3f}",
    }
    return "".join(
        (
            '<?xml version="1.0" encoding="UTF-8"?>\n',
            f"<testsuites{_attributes(attributes)}>\n",
            f" <testsuite{_attributes(attributes | {'skipped': '0'})}>\n",
            *cases,
            " </testsuite>\n</testsuites>\n",
        )
    )


def _cases(outcome: PairOutcome, told: list[str]) -> Iterator[str]:
    """A case for each rule, or one for what could not be judged; the first has time and lines."""
    text = "\n".join(outcome.notes)
    if not outcome.findings:
        result = _result("error", outcome.verdict, text) if outcome.status else ""
        yield _case(outcome, "gate", outcome.seconds, result + _output(told))
    for place, finding in enumerate(outcome.findings):
        verdict = shown_verdict(finding)
        mark = "" if finding.now.proven else " (split, not proven)"
        lower, upper, limit = texts(finding.now.lower, finding.now.upper, finding.limit)
        about = f"{finding.rule.path} is between {lower} and {upper}, allowed is {limit}{mark}"
        if finding.verdict is Verdict.INCOMPARABLE:
            about = f"there is no {finding.rule.path}"
        result, lines = "", [] if place else told
        if finding.rule.warns and verdict != Verdict.PASS:
            lines = [f"{verdict}: {about}", *lines]
        elif verdict == Verdict.FAIL:
            result = _result("failure", verdict, text, about)
        elif verdict != Verdict.PASS:
            result = _result("error", verdict, text, about)
        seconds = 0.0 if place else outcome.seconds
        yield _case(outcome, finding.rule.text, seconds, result + _output(lines))


def _case(outcome: PairOutcome, name: str, seconds: float, result: str) -> str:
    about = {"classname": title(outcome), "name": name, "time": f"{seconds:.3f}"}
    inner = f">\n   {result}\n  </testcase>\n" if result else " />\n"
    return f"  <testcase{_attributes(about)}{inner}"


def _result(kind: str, verdict: str, text: str, message: str = "") -> str:
    about = {"type": verdict, "message": message or text.partition("\n")[0]}
    return f"<{kind}{_attributes(about)}>{xml(text)}</{kind}>"


def _output(lines: Iterable[str]) -> str:
    text = "\n".join(lines)
    return f"<system-out>{xml(text)}</system-out>" if text else ""


def _attributes(values: dict[str, str]) -> str:
    return "".join(f' {name}="{xml(value)}"' for name, value in values.items())
