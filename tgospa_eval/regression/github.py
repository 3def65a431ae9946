"""What a gate found for GitHub Actions: annotations and the step summary, within GitHub's limits.

Ten errors and ten warnings of a step are shown, and a summary of at most 1 MiB.
"""

import os
from collections.abc import Iterator

from tgospa_eval.common.files import is_missing, named, patience
from tgospa_eval.errors import ConfigError
from tgospa_eval.regression.outcome import Outcome, Report
from tgospa_eval.regression.report import github_lines, title
from tgospa_eval.reports.escape import workflow_data, workflow_property
from tgospa_eval.text import clipped, visible

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
    warnings = [
        _warning(outcome) for outcome in report.outcomes if outcome.warned or outcome.warnings
    ]
    for kind, found in (("error", errors), ("warning", warnings)):
        shown = found if len(found) <= MOST_ANNOTATIONS else found[: MOST_ANNOTATIONS - 1]
        for name, text in shown:
            yield _command(kind, f"TGOSPA gate: {name}", text)
        if len(found) > len(shown):
            rest = found[len(shown) :]
            names = ", ".join(name for name, _ in rest)
            yield _command(kind, f"TGOSPA gate: {len(rest)} more pairs", names)


def _warning(outcome: Outcome) -> tuple[str, str]:
    broken = ", ".join(f"{finding.rule.text}" for finding in outcome.warned)
    lines = [f"broken or undecided, for a warning only: {broken}"] if broken else []
    return title(outcome), "\n".join((*lines, *(notice.sentence for notice in outcome.warnings)))


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
