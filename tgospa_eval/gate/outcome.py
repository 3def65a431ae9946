"""What a gate found: one outcome for each pair, and what it says to the user."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from tgospa_eval.evaluation import Summary
from tgospa_eval.gate.baseline import VALUES, Entry, differences, measure
from tgospa_eval.gate.rules import COSTS, Finding, Rule, Value, Verdict, judge, worst


@dataclass(frozen=True, kw_only=True)
class Change:
    """A value of a baseline before and after an update; None where there is none."""

    path: str
    old: float | None
    new: float | None


@dataclass(frozen=True, kw_only=True)
class Outcome:
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
    changes : tuple of Change
        Of an update.
    notes : tuple of str
        What the user should know: reasons, remedies.
    seconds : float
        Time of reading and solving.
    """

    name: str
    truth: str
    estimate: str
    verdict: Verdict
    status: int
    findings: tuple[Finding, ...] = ()
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Rules of ``--warn-on`` that are broken."""
        return tuple(f for f in self.findings if f.rule.warns and f.verdict is Verdict.FAIL)


@dataclass(frozen=True, kw_only=True)
class Report:
    """All pairs.

    Parameters
    ----------
    baseline : str
        Path.
    outcomes : tuple of Outcome
        In the order of the suite.
    version : str
        Of the program.
    again : tuple of str
        Command that makes the baseline anew, word for word.
    """

    baseline: str
    outcomes: tuple[Outcome, ...]
    version: str
    again: tuple[str, ...] = ()

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


def compare(
    result: Summary, entry: Entry, rules: Iterable[Rule]
) -> tuple[Verdict, tuple[Finding, ...], tuple[str, ...]]:
    """Verdict, findings and notes of a result against its entry of the baseline."""
    apart = differences(entry, result)
    if apart:
        return Verdict.INCOMPARABLE, (), tuple(apart)
    values = measure(result)
    findings = []
    for rule in rules:
        if rule.path not in values:
            return Verdict.INCOMPARABLE, (), (f"{rule.text}: the result has no {rule.path}",)
        if not rule.maximum and rule.path not in entry.values:
            return Verdict.INCOMPARABLE, (), (f"{rule.text}: the baseline has no {rule.path}",)
        findings.append(judge(rule, values[rule.path], entry.values.get(rule.path)))
    binding = [finding.verdict for finding in findings if not finding.rule.warns]
    verdict = min(
        binding, key=lambda one: (Verdict.FAIL, Verdict.UNDECIDED, Verdict.PASS).index(one)
    )
    return verdict, tuple(findings), tuple(_notes(findings, result, entry))


def change(old: Entry | None, new: Entry | None) -> tuple[Change, ...]:
    """Values that differ between two entries, bounds left out: `tgospa` is the upper one."""
    before, after = (entry.values if entry else {} for entry in (old, new))
    return tuple(
        Change(path=path, old=before.get(path), new=after.get(path))
        for path in (*VALUES, *sorted({*before, *after} - {*VALUES}))
        if path not in ("lower_bound", "upper_bound") and before.get(path) != after.get(path)
    )


def _notes(findings: list[Finding], result: Summary, entry: Entry) -> Iterator[str]:
    for finding in findings:
        yield from _sentences(finding)
    if any(f.verdict is Verdict.FAIL and f.now.proven for f in findings):
        yield from _parts(measure(result), entry)
    if any(f.verdict is Verdict.UNDECIDED for f in findings):
        yield f"undecided: {_remedy(result)}"
    moved = any(f.verdict is Verdict.FAIL and not f.now.proven for f in findings)
    if moved and measure(result)["total"].lower <= entry.values["total"] * (1 + 1e-9):
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


def _sentences(finding: Finding) -> Iterator[str]:
    rule, now = finding.rule, finding.now
    lower, upper, limit = texts(now.lower, now.upper, finding.limit)
    allowed = f"{limit} allowed by {rule.text}"
    if finding.verdict is Verdict.UNDECIDED:
        yield f"{rule.path} is between {lower} and {upper}, {allowed}"
    elif finding.verdict is Verdict.FAIL:
        known = f"at least {lower}, proven" if now.proven else lower
        mark = "" if now.proven else " (split, not proven)"
        warning = "warning: " if rule.warns else ""
        yield f"{warning}{rule.path} is {known}, {allowed}{mark}"


def _parts(values: dict[str, Value], entry: Entry) -> Iterator[str]:
    """Where the cost went, as far as the split tells."""
    moved = [
        " -> ".join((f"{path} {entry.values[path]:.7g}", f"{values[path].upper:.7g}"))
        for path in COSTS
        if abs(values[path].upper - entry.values[path]) > values[path].tolerance
    ]
    if moved:
        yield f"split, not proven: {', '.join(moved)}"


def texts(*numbers: float) -> list[str]:
    """The numbers with so many digits that those which differ look different."""
    for digits in (7, 10, 13):
        found = [f"{number:.{digits}g}" for number in numbers]
        if len({*found}) == len({*numbers}):
            return found
    return [repr(number) for number in numbers]


def _remedy(result: Summary) -> str:
    """Which option makes the bracket narrower."""
    if result.certified and result.solver["name"] == "certified" and result.gap <= 1e-9:
        return "the bracket is about as narrow as rounding; let the rule allow more"
    settings = result.parameters
    if result.solver["name"] == "sinkhorn":
        return f"a smaller --epsilon than {settings['epsilon']:g}, or --solver certified"
    if result.solver["name"] == "exact":
        return "--solver certified narrows the bracket"
    if "time_limit" in settings:
        return f"a larger --time-limit than {settings['time_limit']:g}"
    return f"a smaller --gap than {settings['gap']:g}"
