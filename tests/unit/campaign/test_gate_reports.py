"""What a gate prints and writes: widths, JUnit, GitHub's commands and limits, hostile names."""

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgospa_eval import ConfigError
from tgospa_eval.campaign.gate.outcome import PairOutcome, Report
from tgospa_eval.campaign.gate.report import (
    SUMMARY,
    annotations,
    append_summary,
    junit,
    markdown,
    summary,
    table,
)
from tgospa_eval.campaign.gate.rules import STATUS, Value, Verdict, judge, parse_rule

HOSTILE = [
    "<script>alert(1)</script>",
    "\"double\" & 'single'",
    "a,b:c",
    "two\nlines\r\n::error::no",
    "%0A::error::no",
    "::stop-commands::x",
    " ::set-output name=a::b",
    "##[error]no",
    "שלום עולם",
    "a\u202eb\u2066c",
    "=cmd|' /C calc'!A0",
    "\x00\x07\x1b[31mred\x7f\ud800\ufffe",
    "a|b`c``d\\|e",
    "@everyone #1 **bold** [x](http://y) ![z](w)",
    " ",
    "]]>",
    "漢" * 60,
]


def outcome(
    name: str, now: float = 1.0, slack: str = "total:+0", warns: bool = False
) -> PairOutcome:
    rule = parse_rule(slack, name="warn_on" if warns else "fail_on")
    found = judge(rule, Value(lower=now, upper=now, proven=True, unit=1.0), 1.0)
    verdict = Verdict.PASS if warns else found.verdict
    return PairOutcome(
        name=name,
        truth="t.csv",
        estimate="e.csv",
        verdict=verdict,
        status=STATUS[verdict],
        findings=(found,),
        notes=(f"about {name}",) if found.verdict is not Verdict.PASS else (),
        seconds=0.25,
    )


def absent(name: str) -> PairOutcome:
    verdict = Verdict.INCOMPARABLE
    return PairOutcome(
        name=name, truth="", estimate="", verdict=verdict, status=2, notes=("not there",)
    )


def report(*outcomes: PairOutcome) -> Report:
    return Report(baseline="b.json", outcomes=outcomes, version="1", again=("tgospa-eval", "gate"))


def everything() -> Report:
    """Each hostile name passes, fails, warns, and cannot be judged."""
    return report(
        *(outcome(name) for name in HOSTILE),
        *(outcome(name, 2.0) for name in HOSTILE),
        *(outcome(name, 2.0, warns=True) for name in HOSTILE),
        *(absent(name) for name in HOSTILE),
    )


# --- table, JSON, Markdown ------------------------------------------------------------------------


def test_markdown_has_no_markup_of_others() -> None:
    broken = (replace(absent(name), verdict=Verdict.ERROR, notes=(name,)) for name in HOSTILE)
    lines = markdown(report(*everything().outcomes, *broken)).splitlines()
    rows = [line for line in lines if line.startswith("| ") and not line.startswith("| pair |")]
    assert len(rows) == 5 * len(HOSTILE)
    for row in rows:
        outside = re.sub(r"`[^`]*`|<code>[^<]*</code>", "CODE", row)
        assert re.fullmatch(r"\| CODE \|( [^|<>`\[\]@#\\]*\|){6}", outside), row
    for line in lines:
        outside = re.sub(r"`[^`]*`", "", line)
        assert "<script" not in outside
        assert "@everyone" not in outside


# --- JUnit ----------------------------------------------------------------------------------------

STRUCTURE = {
    "testsuites": ({"name", "tests", "failures", "errors", "time"}, {"testsuite"}),
    "testsuite": (
        {"name", "tests", "failures", "errors", "skipped", "time"},
        {"testcase"},
    ),
    "testcase": ({"name", "classname", "time"}, {"failure", "error", "system-out"}),
    "failure": ({"type", "message"}, set()),
    "error": ({"type", "message"}, set()),
    "system-out": (set(), set()),
}
"""Attributes and children: what both Jenkins' schema (junit-10.xsd) and GitLab know."""


def check_junit(text: str) -> ET.Element:
    """The document, after a look at its structure and its counts."""
    root = ET.fromstring(text.encode())
    for element in root.iter():
        attributes, children = STRUCTURE[element.tag]
        assert set(element.attrib) == attributes
        assert {child.tag for child in element} <= children
        for name in {"tests", "failures", "errors", "skipped"} & attributes:
            assert element.get(name, "").isdigit()
        if "time" in attributes:
            assert re.fullmatch(r"\d{1,3}\.\d{3}", element.get("time", ""))
    cases = root.findall("testsuite/testcase")
    for element in (root, root[0]):
        assert int(element.get("tests", "")) == len(cases)
        for kind in ("failure", "error"):
            found = [case for case in cases if case.find(kind) is not None]
            assert int(element.get(f"{kind}s", "")) == len(found)
    assert all(len(case) <= 1 for case in cases)
    return root


def test_junit() -> None:
    root = check_junit(junit(everything()))
    count = str(len(HOSTILE))
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == (
        str(4 * len(HOSTILE)), count, count,
    )  # fmt: skip
    first = root.findall("testsuite/testcase")
    assert first[0].get("classname") == HOSTILE[0]
    assert first[0].get("name") == "total"
    failure = root.find("testsuite/testcase/failure")
    assert failure is not None
    assert failure.get("message") == "total is 2, allowed is 1"
    assert root.findall("testsuite/testcase/system-out")[0].text == (
        "warning: total is 2, allowed is 1"
    )


@given(st.text())
def test_any_name_can_be_written(name: str) -> None:
    found = report(outcome(name, 2.0), absent(name))
    check_junit(junit(found))
    assert all(line.isprintable() for line in table(found).splitlines())
    for line in annotations(found):
        assert re.fullmatch(r"::error title=[^:,\r\n]*::[^\r\n]*", line)
        assert not re.search(r"%(?!25|0A|0D|3A|2C)", line)
    summary(found, 500).decode()


# --- GitHub ---------------------------------------------------------------------------------------


def test_annotations_are_escaped() -> None:
    (line,) = annotations(report(outcome("100%, a:b\n::error::x", 2.0)))
    assert line == (
        "::error title=TGOSPA gate%3A 100%25%2C a%3Ab\\n%3A%3Aerror%3A%3Ax::fail%0A"
        "about 100%25, a:b%0A\\x3a:error::x"
    )


def test_ten_annotations_of_a_kind() -> None:
    def kinds(count: int) -> list[str]:
        found = [outcome(f"p{k}", 2.0) for k in range(count)]
        found += [outcome(f"w{k}", 2.0, warns=True) for k in range(count)]
        return [line.split()[0] for line in annotations(report(*found))]

    assert kinds(10) == ["::error"] * 10 + ["::warning"] * 10
    assert kinds(500) == ["::error"] * 10 + ["::warning"] * 10
    lines = list(annotations(report(*(outcome(f"p{k}", 2.0) for k in range(12)))))
    assert lines[-1] == "::error title=TGOSPA gate%3A 3 more pairs::p9, p10, p11"
    assert list(annotations(report(outcome("a")))) == []
    assert max(map(len, annotations(report(outcome("x" * 10_000, 2.0))))) < 4096


def test_step_summary_stays_under_a_megabyte(tmp_path: Path) -> None:
    path = tmp_path / "summary.md"
    path.write_text("# Of an earlier command\n", encoding="utf-8")
    append_summary(report(outcome("a")), str(path))
    assert path.read_text(encoding="utf-8").startswith(
        "# Of an earlier command\n**TGOSPA gate: pass"
    )
    many = report(*(outcome(f"pair {k} {'é' * 50}", 2.0) for k in range(10_000)))
    append_summary(many, str(path))
    size = path.stat().st_size
    assert 900_000 < size <= SUMMARY
    assert path.read_text(encoding="utf-8").endswith("see the log or the JUnit report.*\n")
    append_summary(many, str(path))
    assert path.stat().st_size <= SUMMARY
    append_summary(report(outcome("a")), None)
    with pytest.raises(ConfigError, match="cannot be written"):
        append_summary(report(outcome("a")), str(tmp_path / "none" / "summary.md"))
