"""What a gate found: one outcome for each pair, and what the user should know."""

import math
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import field, replace
from typing import Any, Self

from tgospa_eval.campaign.baseline import (
    MEASURED,
    Baseline,
    Measured,
    differences,
    value_at,
)
from tgospa_eval.campaign.rules import (
    BY_CLASS,
    STATUS,
    Finding,
    Rule,
    Value,
    Verdict,
    judge,
    meanings,
    worst,
)
from tgospa_eval.campaign.suite import Pair
from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, told
from tgospa_eval.common.words import number
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.tracks.judged import incomparable

WORST_FIRST = (Verdict.FAIL, Verdict.INCOMPARABLE, Verdict.UNDECIDED, Verdict.PASS)
OPEN = 1e-6
"""Relative gap of a total from which on a baseline is called open."""


@dataclass(frozen=True, kw_only=True)
class PairOutcome:
    """One pair.

    Parameters
    ----------
    name, truth, estimate : str
        The pair and its files.
    verdict : Verdict
        The worst of its findings, or why there are none.
    status : int
        Exit status.
    findings : tuple of Finding
        One for each rule.
    changes : mapping of str to pair of float
        Of an update: values before and after by path; None where there is none.
    notes : tuple of str
        What the user should know: reasons, remedies.
    seconds : float
        Time of reading and solving.
    warnings : tuple of Notice
        What looks wrong with the data.
    """

    name: str
    truth: str
    estimate: str
    verdict: Verdict
    status: int
    findings: tuple[Finding, ...] = ()
    changes: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    warnings: tuple[Notice, ...] = ()

    @classmethod
    def of(cls, pair: Pair, verdict: Verdict, *notes: str, **about: Any) -> Self:
        """Of a pair, with notes, and further fields."""
        names = {"name": pair.name, "truth": pair.truth, "estimate": pair.estimate}
        return cls(verdict=verdict, notes=notes, **{"status": STATUS[verdict], **names, **about})

    @property
    def warned(self) -> tuple[Finding, ...]:
        """Rules of ``--warn-on`` that are broken, or not proven to hold."""
        return tuple(f for f in self.findings if f.warning)


@dataclass(frozen=True, kw_only=True)
class Report:
    """All pairs.

    Parameters
    ----------
    baseline : str
        Path.
    outcomes : tuple of PairOutcome
        In the order of the suite.
    version : str
        Of the program.
    again : tuple of str
        Command that makes the baseline anew, word for word.
    settings_file : SettingsFile, optional
        The configuration file that set options.
    """

    baseline: str
    outcomes: tuple[PairOutcome, ...]
    version: str
    again: tuple[str, ...] = ()
    settings_file: SettingsFile | None = None

    def told(self, *warnings: Notice) -> list[str]:
        """What is said beside the verdicts: where settings come from, and these warnings."""
        return told(self.settings_file, warnings)

    @property
    def status(self) -> int:
        """Exit status."""
        return worst(outcome.status for outcome in self.outcomes)

    @property
    def verdict(self) -> Verdict:
        """The verdict that decides the exit status."""
        return next(o.verdict for o in self.outcomes if o.status == self.status)

    @property
    def advice(self) -> str:
        """Command that makes the baseline anew, if there is a reason to think of it."""
        import shlex  # here: most gates pass

        outdated = any(
            outcome.verdict is Verdict.INCOMPARABLE or any(f.improved for f in outcome.findings)
            for outcome in self.outcomes
        )
        return shlex.join(self.again) if outdated else ""

    def count(self, verdict: Verdict) -> int:
        """Pairs of a verdict."""
        return sum(outcome.verdict is verdict for outcome in self.outcomes)


def judged_outcome(
    pair: Pair, now: Measured, entry: Json | None, rules: Iterable[Rule], **about: Any
) -> PairOutcome:
    """Verdict, findings and notes of a result against its entry of the baseline.

    Without an entry all rules are absolute limits. `about` has further fields.
    """
    apart = differences(entry, now) if entry else []
    if apart:
        return PairOutcome.of(pair, Verdict.INCOMPARABLE, *apart, **about)
    findings = [_judged(rule, now, entry["values"] if entry else {}) for rule in rules]
    binding = [finding.verdict for finding in findings if not finding.rule.warns]
    verdict = min(binding, key=WORST_FIRST.index)
    notes = _notes(findings, now, entry)
    return PairOutcome.of(pair, verdict, *notes, findings=tuple(findings), **about)


def updated_outcome(
    pair: Pair, before: Json | None, entry: Json, now: Measured, **about: Any
) -> PairOutcome:
    """What an update of a baseline changes; `about` has further fields."""
    notes = _update_notes(before, entry, now)
    changes = _changes(before["values"] if before else {}, entry["values"])
    return PairOutcome.of(pair, Verdict.UPDATED, *notes, changes=changes, **about)


def _judged(rule: Rule, now: Measured, old: Json) -> Finding:
    """What a rule finds; a class that is on one side only costs 0 on the other."""
    for name, path in meanings(rule.path):
        own = now.values if name is None else now.classes.get(name)
        before = old if name is None else old.get("by_class", {}).get(name)
        if own or before:
            value = own[path] if own else replace(now.values[path], lower=0.0, upper=0.0)
            return judge(rule, value, value_at(before, path) if before else 0.0)
    unknown = Value(lower=math.nan, upper=math.nan, proven=True, unit=1.0)
    return Finding(rule=rule, base=None, limit=math.nan, now=unknown, verdict=Verdict.INCOMPARABLE)


def _changes(
    before: Json, after: Json, name: str = ""
) -> dict[str, tuple[float | None, float | None]]:
    """Values that differ between two entries, bounds left out: `tgospa` is the upper one."""
    values = {path: (value_at(before, path), value_at(after, path)) for path in MEASURED}
    changes = {name + path: ends for path, ends in values.items() if ends[0] != ends[1]}
    old, new = (side.get("by_class", {}) for side in (before, after))
    for inner in sorted({*old, *new}):
        about = f"{BY_CLASS}{inner}."
        changes |= _changes(old.get(inner, {}), new.get(inner, {}), about)
    return changes


def _notes(findings: list[Finding], now: Measured, entry: Json | None) -> Iterator[str]:
    for finding in findings:
        yield from _sentences(finding)
    if entry and any(f.verdict is Verdict.FAIL and f.now.proven for f in findings):
        yield from _parts(now.values, entry["values"])
    if any(f.verdict is Verdict.UNDECIDED for f in findings):
        yield f"undecided: {now.remedy}"
    if entry:
        yield from _against(findings, now, entry["values"])


def _against(findings: list[Finding], now: Measured, old: Json) -> Iterator[str]:
    """What the user should know of the baseline."""
    moved = any(f.verdict is Verdict.FAIL and not f.now.proven for f in findings)
    if moved and now.values["total"].lower <= old["total"] * (1 + 1e-9):
        yield (
            "the total is not proven to be worse: where optima tie, another one splits the same "
            "total in another way"
        )
    better = [finding.rule.path for finding in findings if finding.improved]
    if better:
        yield (
            f"baseline can be tightened: {', '.join(dict.fromkeys(better))} improved by more than "
            "the slack"
        )
    lower, upper = (old[f"{side}_bound"] for side in ("lower", "upper"))
    gap = 1 - (lower / upper) ** now.order if upper else 0.0
    if gap > OPEN:
        yield (
            f"the bracket of the baseline is open, relative gap {gap:.2g}: the gate is as loose as "
            "its upper bound"
        )


def _sentences(finding: Finding) -> Iterator[str]:
    rule, now = finding.rule, finding.now
    lower, upper, limit = texts(now.lower, now.upper, finding.limit)
    allowed = f"{limit} allowed by {rule.text}"
    warning = "warning: " if rule.warns else ""
    if finding.verdict is Verdict.INCOMPARABLE:
        yield f"{warning}{rule.text}: the result has no {rule.path}, nor has a baseline"
    elif finding.verdict is Verdict.UNDECIDED:
        yield f"{warning}{rule.path} is between {lower} and {upper}, {allowed}"
    elif finding.verdict is Verdict.FAIL:
        known = f"at least {lower}, proven" if now.proven else lower
        mark = "" if now.proven else " (split, not proven)"
        yield f"{warning}{rule.path} is {known}, {allowed}{mark}"


def _parts(values: Mapping[str, Value], old: Json) -> Iterator[str]:
    """Where the cost went, as far as the split shows."""
    moved = [
        f"{path} {number(old[path], 7)} -> {number(values[path].upper, 7)}"
        for path in PARTS
        if abs(values[path].upper - old[path]) > values[path].tolerance
    ]
    if moved:
        yield f"split, not proven: {', '.join(moved)}"


def texts(*numbers: float) -> list[str]:
    """The numbers with so many digits that those which differ look different.

    The last places are those of outward rounding.
    """
    differ = len({f"{value:.12g}" for value in numbers})
    for digits in (7, 10):
        found = [number(value, digits) for value in numbers]
        if len({*found}) == differ:
            return found
    return [f"{value:,.12g}" for value in numbers]


def leftover(
    old: Baseline, names: Container[str], verdict: Verdict, note: str
) -> list[PairOutcome]:
    """Outcomes of pairs of the baseline that are not among these names."""
    gone = (Pair(name=name, truth="", estimate="") for name in old if name not in names)
    return [PairOutcome.of(pair, verdict, note) for pair in gone]


def _update_notes(before: Json | None, entry: Json, now: Measured) -> Iterator[str]:
    """What is not seen from the values."""
    if before is None:
        yield "new in the baseline"
    elif before == entry:
        yield "unchanged"
    elif incomparable({"before": before["judged"], "now": entry["judged"]}):
        yield "the truth is another one than before"
    elif before["parameters"] != entry["parameters"]:
        yield "parameters are others than before"
    if not now.certified:
        yield (
            f"the bracket is open, relative gap {now.relative_gap:.2g}: the gate is as loose as "
            "the upper bound"
        )
