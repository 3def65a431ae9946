"""Rules of a gate: limits for values, and verdicts that the bounds of a value prove."""

import math
import re
from collections.abc import Iterable, Iterator
from enum import StrEnum

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import parsed
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import NUMBERS, SUMMARY, names_summary

PROVEN = ("total", "tgospa", "normalised.tgospa")
"""Values with proven lower and upper bounds."""

SPLIT = (*PARTS, "counts.missed", "counts.false", "counts.switch")
"""Values of one optimal assignment; another one can split the same total differently."""

OF_NEES = (NEES, f"{NEES}.anees", f"{NEES}.inside")
"""Values of the assigned pairs of one optimal assignment. Single classes do not have them."""

RULE_VALUES = (*PROVEN, *SPLIT, *OF_NEES)
"""Values that a rule can name, without the values of classes and of the summary."""


def is_beside(path: str) -> bool:
    """Return whether a value describes assigned pairs (NEES or the summary), not the cost."""
    return path in OF_NEES or names_summary(path)


BY_CLASS = "by_class."
TAILS = tuple(sorted((*PROVEN, *SPLIT), key=len, reverse=True))
"""Values that single classes have, sorted by the length of their names.

The longest come first, because a path that ends with ``counts.missed`` also ends with ``missed``.
"""

TOLERANCE = 1e-6
"""Tolerance of rules on values that are not proven; for costs, as a multiple of c^p."""

MIN_SLACK = 1e-9
"""Rise that the default rule always allows, as a multiple of c^p."""

NO_CHANGE = 1e-9
"""Largest relative change that does not count as an improvement."""

_RULE = r"(?P<path>.+):(?P<sign>[+-])\s*(?P<slack>[^%\s]+)\s*(?P<percent>%?)"
_RANGE = r"(?P<path>.+):\s*(?P<least>[^:]*?)\s*\.\.\s*(?P<most>[^:]*)"


class Verdict(StrEnum):
    """Verdict on a pair, or on one rule."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"
    NOISE = "undecided by seeds"
    INCOMPARABLE = "not comparable"
    ERROR = "error"
    NEW = "new, not judged"
    UPDATED = "updated"


STATUS = {
    Verdict.PASS: ExitStatus.DONE,
    Verdict.UPDATED: ExitStatus.DONE,
    Verdict.NOISE: ExitStatus.DONE,
    Verdict.NEW: ExitStatus.DONE,
    Verdict.FAIL: ExitStatus.REGRESSION,
    Verdict.INCOMPARABLE: ExitStatus.WRONG_OPTION,
    Verdict.ERROR: ExitStatus.WRONG_INPUT,
    Verdict.UNDECIDED: ExitStatus.NOT_REACHED,
}
"""Exit status of each verdict; an error can have its own exit status."""

SEVERITY = (
    ExitStatus.REGRESSION,
    ExitStatus.WRONG_INPUT,
    ExitStatus.WRONG_OPTION,
    ExitStatus.NOT_REACHED,
    ExitStatus.DONE,
)
"""Exit statuses, the worst first.

A proven regression comes first: a pipeline that tolerates the status 2 or 4 must still fail for a
regression.
"""


def worst(statuses: Iterable[int]) -> int:
    """Return the worst of several exit statuses."""
    return min(statuses, key=SEVERITY.index, default=0)


@dataclass(frozen=True, kw_only=True)
class Value(Interval):
    """A number with its lower and upper bound.

    Parameters
    ----------
    lower, upper : float
        The bounds. If the value is not proven, both are the reported number.
    proven : bool
        Whether the bounds are proven.
    unit : float
        Unit of tolerances: c^p for costs, 1 for other values.
    """

    proven: bool
    unit: float

    @classmethod
    def of(cls, number: float, unit: float = 1.0) -> "Value":
        """Return a value that is not proven: both bounds are the reported number."""
        return cls(lower=number, upper=number, proven=False, unit=unit)

    @property
    def tolerance(self) -> float:
        """Amount by which a value is allowed to exceed its limit."""
        return 0.0 if self.proven else TOLERANCE * self.unit


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A limit for one value.

    Parameters
    ----------
    text : str
        The rule as a text.
    path : str
        Name of the value.
    slack : float
        Largest allowed change for the worse. If `absolute`, it is the limit itself.
    relative : bool
        Whether the slack is a share of the baseline.
    floor : float
        Smallest slack, as a multiple of `Value.unit`.
    absolute : bool
        Whether the limit is independent of the baseline.
    is_minimum : bool
        Whether the limit is the smallest allowed value, instead of the largest.
    warns : bool
        Whether the rule only warns if it is broken.
    """

    text: str
    path: str
    slack: float
    relative: bool = False
    floor: float = 0.0
    absolute: bool = False
    is_minimum: bool = False
    warns: bool = False

    def limit(self, base: float | None, unit: float) -> float:
        """Return the worst value that the rule allows, given the value of the baseline."""
        if self.absolute:
            return self.slack
        if base is None:
            raise ConfigError(f"{self.text}: the baseline has no {self.path}")
        slack = base * self.slack if self.relative else self.slack
        limit = base - slack if self.is_minimum else base + max(slack, self.floor * unit)
        if math.isinf(limit):
            raise ConfigError(f"{self.text}: the limit is too large; choose a smaller one")
        return limit


DEFAULT = Rule(text="total:+0.001%", path="total", slack=1e-5, relative=True, floor=MIN_SLACK)
"""The rule that applies if no rule ``fail-on`` is given."""


@dataclass(frozen=True, kw_only=True)
class Inference:
    """Statistical inference about a tracker, from runs with several seeds.

    The inference goes beyond the proof: a proof is only about the files of these runs.

    Parameters
    ----------
    p_value : float
        p value of the test that the tracker is worse than the limit.
    confidence : float
        Confidence of the tests. A p value of at most 1 - confidence supports their hypothesis.
    runs : int
        Number of runs that are judged.
    needed : int
        Smallest number of runs with which the test can support its hypothesis.
    paired : bool
        Whether the seeds are those of the baseline.
    noticeable : float
        Smallest relative change from the baseline that the test would probably detect with these
        runs. It can be infinite.
    better : float
        p value of the test that the tracker is better than the baseline by at least the slack.
    jump : str
        Sentence about a scene or run that is far above the usual spread of its seeds (a jump);
        blank if there is none.
    """

    p_value: float
    confidence: float
    runs: int
    needed: int
    paired: bool
    noticeable: float
    better: float
    jump: str = ""

    def supports(self, p_value: float) -> bool:
        """Return whether this p value is at most 1 - confidence."""
        return p_value <= 1 - self.confidence + 1e-12


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Result of judging a value by one rule.

    Parameters
    ----------
    rule : Rule
        The rule.
    base : float or None
        Value of the baseline.
    limit : float
        The worst value that the rule allows.
    now : Value
        Value of this run.
    verdict : Verdict
        Verdict of the rule.
    inference : Inference, optional
        Inference from the runs of a group with several seeds.
    noisy : bool
        Whether the value is that of one run among several seeds. Such a run cannot show an
        improvement.
    note : str
        Message that replaces the usual message of the rule.
    low : float, optional
        Proven lower bound of the baseline, if `base` is an upper bound.
    run : str
        Name of a dead run; else blank.
    """

    rule: Rule
    base: float | None
    limit: float
    now: Value
    verdict: Verdict
    inference: Inference | None = None
    noisy: bool = False
    note: str = ""
    low: float | None = None
    run: str = ""

    @property
    def proven(self) -> bool:
        """True if the bounds prove the change from the baseline.

        The new value must have proven bounds, and the seeds must be those of the baseline: with
        other seeds, the runs of a group can have other ground truths.
        """
        return self.now.proven and (self.inference is None or self.inference.paired)

    @property
    def warning(self) -> bool:
        """True if the rule only warns, and is broken or undecided."""
        return self.rule.warns and self.verdict in (Verdict.FAIL, Verdict.UNDECIDED)

    @property
    def improved(self) -> bool:
        """True if the value is proven to be better than the baseline, by more than the slack."""
        if self.base is None or self.rule.absolute or is_beside(self.rule.path) or self.noisy:
            return False
        if self.inference and not self.inference.supports(self.inference.better):
            return False
        slack = max(self.limit - self.base, NO_CHANGE * self.base, self.now.tolerance)
        return self.now.upper < (self.base if self.low is None else self.low) - slack

    @property
    def gap(self) -> float:
        """Width of the bracket of the baseline, relative to its upper bound."""
        return 1 - self.low / self.base if self.base and self.low is not None else 0.0


def judge(rule: Rule, now: Value, base: float | None, low: float | None = None) -> Finding:
    """Judge a value by a rule; the verdict is undecided if the limit is between the bounds.

    `base` is the upper bound of the value in the baseline, `low` is the lower bound.

    Raises
    ------
    ConfigError
        The baseline does not have the value, or the limit is too large.
    """
    limit = rule.limit(base, now.unit)
    sign = -1 if rule.is_minimum else 1
    best, worst_ = sorted((sign * now.lower, sign * now.upper))
    if best > sign * limit + now.tolerance:
        verdict = Verdict.FAIL
    elif worst_ <= sign * limit + now.tolerance:
        verdict = Verdict.PASS
    else:
        verdict = Verdict.UNDECIDED
    return Finding(rule=rule, base=base, limit=limit, now=now, verdict=verdict, low=low)


def parse_rule(text: str, *, name: str = "fail_on") -> Rule:
    """Parse the rule ``PATH:+N`` or ``PATH:+N%``.

    In ``PATH:-N``, N is the allowed decrease of NEES, or of a number of the summary.

    Raises
    ------
    ConfigError
        The text has another form, or names a value that cannot be judged.
    """
    if "best-of-last" in text:
        raise ConfigError(
            f"{option(name)} {quoted(text)}: best-of-last is gone; use a rule such as total:+5%, "
            "which compares with the baseline"
        )
    match = re.fullmatch(_RULE, text.strip())
    slack = _not_negative(match["slack"]) if match else None
    if match is None or slack is None:
        raise ConfigError(
            f"{option(name)} {quoted(text)}: must be a value of the result with its limit: a "
            "largest increase, such as total:+5 or total:+0.1%, or a range, such as nees:1.5..2.5"
        )
    path = _path(match["path"].strip(), name, text)
    relative, less = match["percent"] == "%", match["sign"] == "-"
    if not is_beside(path) if less else path == OF_NEES[-1]:
        right = "smaller; write PATH:+N" if less else "larger; write PATH:-N"
        raise ConfigError(f"{option(name)} {quoted(text)}: {path} is better when {right}")
    return Rule(
        text=f"{path}:{match['sign']}{match['slack'].strip()}{match['percent']}",
        path=path,
        slack=slack / 100 if relative else slack,
        relative=relative,
        is_minimum=less,
        warns=name == "warn_on",
    )


def parse_maximum(text: str) -> Rule:
    """Parse the rule ``NAME=VALUE``.

    Raises
    ------
    ConfigError
        The text has another form, or names a value that cannot be judged.
    """
    name, equals, number = text.rpartition("=")
    limit = _not_negative(number)
    if not equals or limit is None:
        raise ConfigError(
            f"{option('limits')} {quoted(text)}: must be NAME=VALUE, such as tgospa=50"
        )
    path = _path(name.strip(), "limits", text)
    return Rule(text=f"{path}<={number.strip()}", path=path, slack=limit, absolute=True)


def parse_rules(
    fail_on: Iterable[str], warn_on: Iterable[str], maximum: Iterable[str], *, default: bool = True
) -> list[Rule]:
    """Parse all rules; a text can have several, with commas between them.

    If `fail_on` is empty and `default` is true, the default rule is added.

    Raises
    ------
    ConfigError
        A text is wrong.
    """
    return [
        *([*_parsed(fail_on, "fail_on")] or [DEFAULT][:default]),
        *_parsed(warn_on, "warn_on"),
        *(parse_maximum(text) for text in _each(maximum)),
    ]


def _parsed(rules: Iterable[str], name: str) -> Iterator[Rule]:
    """Parse the rules of one option; a range ``PATH:LEAST..MOST`` becomes a rule for each end."""
    for text in _each(rules):
        ends = re.fullmatch(_RANGE, text.strip())
        if ends is None:
            yield parse_rule(text, name=name)
            continue
        given = {sign: ends[sign] for sign in ("least", "most") if ends[sign]}
        path = _path(ends["path"].strip(), name, text)
        read = parsed if names_summary(path) else _not_negative  # a mean error can be negative
        limits = {sign: read(number) for sign, number in given.items()}
        for sign, limit in (limits or {"": None}).items():
            if limit is None:
                raise ConfigError(
                    f"{option(name)} {quoted(text)}: must be a range such as nees:1.5..2.5, "
                    "nees:1.5.. or nees:..2.5"
                )
            low = sign == "least"
            smallest = (limits or {}).get("least")
            if smallest is not None and limit < smallest:
                raise ConfigError(
                    f"{option(name)} {quoted(text)}: the first limit is larger; swap them"
                )
            shown = f"{path}{'>=' if low else '<='}{given[sign]}"
            warns = name == "warn_on"
            yield Rule(
                text=shown, path=path, slack=limit, absolute=True, is_minimum=low, warns=warns
            )


def meanings(path: str) -> list[tuple[str | None, str]]:
    """Return the possible meanings of a path, the likeliest first: a class or None, and a value.

    A path with a class can have several meanings, because the name of a class can have dots. The
    meaning with the longest value comes first: ``counts.missed`` before ``missed``.
    """
    if not path.startswith(BY_CLASS):
        return [(None, path)]
    rest = path[len(BY_CLASS) :]
    return [(rest[: -len(tail) - 1], tail) for tail in TAILS if rest.endswith(f".{tail}")]


def _each(texts: Iterable[str]) -> Iterator[str]:
    """Yield single rules from texts that can have several rules with commas between them.

    Only a comma after the number ends a rule, because the name of a class can have commas, too.
    """
    for text in texts:
        parts = re.split(r"(:[+-][^,]*|:[^,:]*\.\.[^,:]*|=[^,=]*)(?:,|$)", text)
        rules = [head + end for head, end in zip(parts[::2], (*parts[1::2], ""), strict=True)]
        yield from [rule for rule in rules if rule.strip()] or [text]


def _not_negative(text: str) -> float | None:
    number = parsed(text)
    return None if number is None or number < 0 else number


def _path(path: str, name: str, text: str) -> str:
    if not names_summary(path) and not any(value in RULE_VALUES for _, value in meanings(path)):
        there = NUMBERS if path.startswith(f"{SUMMARY}.") else RULE_VALUES
        raise ConfigError(
            f"{option(name)} {quoted(text)}: {quoted(path)} is not a value; values are "
            f"{', '.join(there)}; numbers of the summary such as {SUMMARY}.rmse; and, if "
            f"{option('by', 'class')} is given, those of a class such as {BY_CLASS}NAME.total"
        )
    return path
