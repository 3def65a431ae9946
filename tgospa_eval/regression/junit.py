"""What a gate found as JUnit XML, as Jenkins and GitLab read it: one case for each rule.

A rule that is broken is a failure, what could not be judged an error; a warning passes with a text.
Written by hand: to import a library for XML takes as long as a small evaluation.
"""

from collections.abc import Iterable, Iterator

from tgospa_eval.regression.outcome import Outcome, Report, texts
from tgospa_eval.regression.report import shown_verdict, title
from tgospa_eval.regression.rules import Verdict
from tgospa_eval.reports.escape import xml

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


def _cases(outcome: Outcome, told: list[str]) -> Iterator[str]:
    """A case for each rule, or one for what could not be judged; the first has time and lines."""
    text = "\n".join(outcome.notes)
    if not outcome.findings:
        result = _result("error", outcome.verdict, text) if outcome.status else ""
        yield _case(outcome, "gate", outcome.seconds, result + _output(told))
    for number, finding in enumerate(outcome.findings):
        verdict = shown_verdict(finding)
        mark = "" if finding.now.proven else " (split, not proven)"
        lower, upper, limit = texts(finding.now.lower, finding.now.upper, finding.limit)
        about = f"{finding.rule.path} is between {lower} and {upper}, allowed is {limit}{mark}"
        if finding.verdict is Verdict.INCOMPARABLE:
            about = f"there is no {finding.rule.path}"
        result, lines = "", [] if number else told
        if finding.rule.warns and verdict != Verdict.PASS:
            lines = [f"{verdict}: {about}", *lines]
        elif verdict == Verdict.FAIL:
            result = _result("failure", verdict, text, about)
        elif verdict != Verdict.PASS:
            result = _result("error", verdict, text, about)
        seconds = 0.0 if number else outcome.seconds
        yield _case(outcome, finding.rule.text, seconds, result + _output(lines))


def _case(outcome: Outcome, name: str, seconds: float, result: str) -> str:
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
