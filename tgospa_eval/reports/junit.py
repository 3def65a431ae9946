"""What a gate found as JUnit XML, as Jenkins and GitLab read it: one case for each rule.

A rule that is broken is a failure, what could not be judged an error; a warning passes with a text.
"""

import re
from xml.etree import ElementTree as ET

from tgospa_eval.gate.outcome import Outcome, Report, texts
from tgospa_eval.gate.rules import Verdict
from tgospa_eval.reports.gate import said, title

SUITE = "tgospa-eval gate"

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot express, escaped or not."""


def junit(report: Report) -> str:
    """The report as a document."""
    root = ET.Element("testsuites", name=SUITE)
    suite = ET.SubElement(root, "testsuite", name=SUITE)
    for outcome in report.outcomes:
        _cases(suite, outcome)
    counts = {
        "tests": len(suite),
        "failures": len(suite.findall("testcase/failure")),
        "errors": len(suite.findall("testcase/error")),
    }
    for element in (root, suite):
        for name, count in counts.items():
            element.set(name, str(count))
        element.set("time", _seconds(sum(o.seconds for o in report.outcomes)))
    suite.set("skipped", "0")
    ET.indent(root, " ")
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _cases(suite: ET.Element, outcome: Outcome) -> None:
    """A case for each rule, or one for what could not be judged; the first has the time."""
    text = "\n".join(outcome.notes)
    if not outcome.findings:
        case = _case(suite, outcome, "gate", outcome.seconds)
        if outcome.status:
            _result(case, "error", outcome.verdict, text)
    for number, finding in enumerate(outcome.findings):
        case = _case(suite, outcome, finding.rule.text, 0.0 if number else outcome.seconds)
        verdict = said(finding)
        mark = "" if finding.now.proven else " (split, not proven)"
        lower, upper, limit = texts(finding.now.lower, finding.now.upper, finding.limit)
        about = f"{finding.rule.path} is between {lower} and {upper}, allowed is {limit}{mark}"
        if finding.verdict is Verdict.INCOMPARABLE:
            about = f"there is no {finding.rule.path}"
        if finding.rule.warns and verdict != Verdict.PASS:
            ET.SubElement(case, "system-out").text = _clean(f"{verdict}: {about}")
        elif verdict == Verdict.FAIL:
            _result(case, "failure", verdict, text, about)
        elif verdict != Verdict.PASS:
            _result(case, "error", verdict, text, about)


def _case(suite: ET.Element, outcome: Outcome, name: str, seconds: float) -> ET.Element:
    return ET.SubElement(
        suite, "testcase", classname=_clean(title(outcome)), name=_clean(name),
        time=_seconds(seconds),
    )  # fmt: skip


def _result(case: ET.Element, kind: str, verdict: str, text: str, message: str = "") -> None:
    about = _clean(message or text.partition("\n")[0])
    ET.SubElement(case, kind, type=verdict, message=about).text = _clean(text)


def _clean(text: str) -> str:
    """The text with what XML cannot express written as Python would."""
    return _FORBIDDEN.sub(lambda found: repr(found[0])[1:-1], text)


def _seconds(value: float) -> str:
    return f"{value:.3f}"
