"""Rules and verdicts over hand-made brackets, and the order of exit statuses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgospa_eval import ConfigError
from tgospa_eval.campaign.gate.rules import (
    DEFAULT,
    SEVERITY,
    STATUS,
    Rule,
    Value,
    Verdict,
    judge,
    parse_maximum,
    parse_rule,
    worst,
)


def bracket(lower: float, upper: float, unit: float = 100.0) -> Value:
    return Value(lower=lower, upper=upper, proven=True, unit=unit)


def split(number: float, unit: float = 1.0) -> Value:
    return Value(lower=number, upper=number, proven=False, unit=unit)


@pytest.mark.parametrize(
    ("lower", "upper", "verdict"),
    [
        (90, 110, Verdict.PASS),  # the upper bound may be the limit itself
        (90, 110.001, Verdict.UNDECIDED),
        (110, 110.001, Verdict.UNDECIDED),  # the lower bound must be above the limit to break it
        (110.001, 120, Verdict.FAIL),
        (50, 60, Verdict.PASS),
        (0, float("inf"), Verdict.UNDECIDED),
        (float("nan"), float("nan"), Verdict.UNDECIDED),
    ],
)
def test_brackets(lower: float, upper: float, verdict: Verdict) -> None:
    """The limit is 100 + 10."""
    assert judge(parse_rule("total:+10"), bracket(lower, upper), 100.0).verdict is verdict
    assert judge(parse_rule("total:+10%"), bracket(lower, upper), 100.0).verdict is verdict
    assert judge(parse_maximum("total=110"), bracket(lower, upper), None).verdict is verdict


def test_default_rule_has_a_floor() -> None:
    """0.001 % of the baseline, or 1e-9 c^p where that is more: at a baseline of 0."""
    assert judge(DEFAULT, bracket(0, 1000.01), 1000.0).verdict is Verdict.PASS
    assert judge(DEFAULT, bracket(1000.0101, 1000.0101), 1000.0).verdict is Verdict.FAIL
    assert judge(DEFAULT, bracket(0, 1e-7), 0.0).verdict is Verdict.PASS
    assert judge(DEFAULT, bracket(1.1e-7, 1.1e-7), 0.0).verdict is Verdict.FAIL
    # A rule that was written down means what it says.
    assert judge(parse_rule("total:+0.001%"), bracket(1e-9, 1e-9), 0.0).verdict is Verdict.FAIL


def test_tolerance_of_the_split_scales_with_the_unit() -> None:
    """1e-6 of a count; of a cost 1e-6 c^p, so that small units of length do not switch it off."""
    rule = parse_rule("counts.switch:+0")
    assert judge(rule, split(3 + 9e-7), 3.0).verdict is Verdict.PASS
    assert judge(rule, split(3 + 2e-6), 3.0).verdict is Verdict.FAIL
    rule = parse_rule("switch:+0")
    assert judge(rule, split(2e-6, unit=1e-6), 1e-6).verdict is Verdict.FAIL
    assert judge(rule, split(75.00009, unit=100.0), 75.0).verdict is Verdict.PASS


def test_improvement_is_more_than_the_slack() -> None:
    rule = parse_rule("total:+10")
    assert judge(rule, bracket(80, 89.9), 100.0).improved
    assert not judge(rule, bracket(80, 90), 100.0).improved
    assert not judge(parse_rule("total:+0"), bracket(80, 100 - 1e-12), 100.0).improved
    assert judge(parse_rule("counts.switch:+0"), split(2), 3.0).improved
    assert not judge(parse_maximum("total=200"), bracket(1, 1), 100.0).improved


numbers = st.floats(0, 1e9)
rules = st.one_of(
    st.builds(lambda n: parse_rule(f"total:+{n!r}"), numbers),
    st.builds(lambda n: parse_rule(f"total:+{n!r}%"), st.floats(0, 1e4)),
    st.builds(lambda n: parse_maximum(f"total={n!r}"), numbers),
    st.just(DEFAULT),
)


@given(rules, numbers, numbers, numbers)
def test_never_more_than_is_proven(rule: Rule, a: float, b: float, base: float) -> None:
    now = bracket(min(a, b), max(a, b))
    found = judge(rule, now, base)
    assert (found.verdict is Verdict.FAIL) == (now.lower > found.limit)
    assert (found.verdict is Verdict.PASS) == (now.upper <= found.limit)
    # Whatever the value within the bracket is, a narrower bracket never turns the verdict round.
    for exact in (now.lower, now.upper):
        narrow = judge(rule, bracket(exact, exact), base).verdict
        assert found.verdict in (narrow, Verdict.UNDECIDED)


@given(rules, numbers, st.lists(numbers, min_size=2, max_size=5))
def test_worse_is_never_judged_better(rule: Rule, base: float, values: list[float]) -> None:
    order = [Verdict.PASS, Verdict.FAIL]
    found = [order.index(judge(rule, bracket(v, v), base).verdict) for v in sorted(values)]
    assert found == sorted(found)


@pytest.mark.parametrize(
    "text",
    [
        "", "total", "total:1%", "total:-1%", "total:+", "total:+%", "total:+x", "total:+1%%",
        "total:+nan", "total:+inf", "total:+-1", "totl:+1%", "per_step:+1", "sizes.steps:+1",
        "lower_bound:+1", "by_class.car:+1", ":+1", "counts:+1", "total:+1_0%", "total:+\u0661%",
        "total:+\uff11", "total:+0x10", "total:+1e309", "total:+1e309%", "total:+.", "total:+1e",
        "total:+1% best-of-last 3",
    ],
)  # fmt: skip
def test_no_rules(text: str) -> None:
    with pytest.raises(ConfigError, match="fail_on"):
        parse_rule(text)


@pytest.mark.parametrize(
    "text",
    ["", "tgospa", "tgospa=", "tgospa=x", "tgospa=-1", "tgospa=inf", "tgospa=1_0", "tgospa=\uff11"],
)
def test_no_maxima(text: str) -> None:
    with pytest.raises(ConfigError, match="limits"):
        parse_maximum(text)


def test_rules_are_read() -> None:
    assert parse_rule(" total : +0.5 % ".replace(" : ", ":")).slack == 0.005
    assert parse_rule("by_class.a.b:c.counts.switch:+1").path == "by_class.a.b:c.counts.switch"
    assert parse_rule("total:+1e-3%").slack == 1e-5
    assert [parse_rule(f"total:+{text}").slack for text in (".5", "2.", "1.5E+2")] == [0.5, 2, 150]
    assert parse_rule("switch:+1", name="warn_on").warns


def test_a_proven_regression_comes_first_and_nothing_else_passes() -> None:
    assert set(SEVERITY) == {*STATUS.values()}
    assert worst([0, 4, 2, 3, 1]) == 1
    assert worst([0, 4, 2, 3]) == 3
    assert worst([0, 4, 2]) == 2
    assert worst([0, 4]) == 4
    assert worst([0, 0]) == 0
