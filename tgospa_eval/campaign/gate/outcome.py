"""Result of a gate: an outcome for each pair, and messages for the user."""

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, Self

from tgospa_eval.campaign.gate.baseline import (
    Baseline,
    Measured,
    check_equal,
    differences,
    lowest_in,
    nights_of,
    patterns_of,
    typical,
    value_at,
)
from tgospa_eval.campaign.gate.rules import (
    BY_CLASS,
    OF_NEES,
    RULE_VALUES,
    STATUS,
    Finding,
    Inference,
    Rule,
    Value,
    Verdict,
    is_beside,
    judge,
    meanings,
    worst,
)
from tgospa_eval.campaign.gate.suite import GroupTable
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, messages_of
from tgospa_eval.common.words import counted, number
from tgospa_eval.errors import SolverError
from tgospa_eval.quoting import option, visible
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.saved import unlike
from tgospa_eval.results.summary import names_summary
from tgospa_eval.tracks.coverage import incomparable

WORST_FIRST = tuple(
    getattr(Verdict, name) for name in ("FAIL", "INCOMPARABLE", "UNDECIDED", "NOISE", "PASS")
)
OPEN = 1e-6
"""Relative gap of a total above which a note says that the baseline is not exact."""


@dataclass(frozen=True, kw_only=True)
class PairOutcome:
    """Outcome of one pair or of one group.

    Parameters
    ----------
    name, truth, estimate : str
        Name of the pair, and paths of its files.
    verdict : Verdict
        The worst verdict of the findings, without rules that only warn. If there are no findings,
        the reason for this.
    status : int
        Exit status.
    findings : tuple of Finding
        A finding for each rule.
    changes : mapping of str to pair of float
        Values before and after an update, by path; None for a missing value.
    notes : tuple of str
        Reasons and remedies for the user.
    seconds : float
        Time of reading and solving.
    warnings : tuple of Notice
        Suspicious features of the data.
    group : bool
        Whether this is the outcome of a group: several pairs, added up.
    values : mapping of str to Value
        Values that rules can name, if the pair was evaluated.
    labels : mapping of str to str
        Labels of the pair.
    base : float, optional
        Total of the baseline for the same ground truth.
    page : str
        Text of the HTML page of the pair; blank without one.
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
    group: bool = False
    values: Mapping[str, Value] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    base: float | None = None
    page: str = ""

    @classmethod
    def of(cls, pair: Job, verdict: Verdict, *notes: str, **about: Any) -> Self:
        """Return the outcome of a pair; `about` has further fields of the outcome."""
        names = {"name": pair.name, "truth": pair.truth, "estimate": pair.estimate}
        about = {"status": STATUS[verdict], **names, "labels": pair.labels, **about}
        return cls(verdict=verdict, notes=notes, **about)

    @property
    def page_name(self) -> str:
        """Path of the page in the folder of a gate; blank without a page."""
        from tgospa_eval.show.files import folder_name  # lazy: needed only to write a folder

        return f"pairs/{folder_name(self.name)}.html" if self.page else ""

    @property
    def warned(self) -> tuple[Finding, ...]:
        """Findings of rules of ``--warn-on`` that are broken or undecided."""
        return tuple(f for f in self.findings if f.warning)


@dataclass(frozen=True, kw_only=True)
class Report:
    """Report on all pairs and groups.

    Parameters
    ----------
    baseline : str
        Path of the baseline.
    outcomes : tuple of PairOutcome
        Outcomes of groups, then those of pairs in the order of the suite.
    version : str
        Version of the program.
    again : tuple of str
        Words of the command that accepts the outcomes (see `accepting_options`); empty without one.
    settings_file : SettingsFile, optional
        The configuration file that set options.
    against : str
        Git revision or folder with the suite and the baseline by which pairs are judged. It is
        blank if suite and baseline are those of the working tree.
    tally : mapping of str to int
        Numbers of entries that an update renewed, kept and removed.
    notices : tuple of str
        Notes on the baseline as a whole.
    """

    baseline: str
    outcomes: tuple[PairOutcome, ...]
    version: str
    again: tuple[str, ...] = ()
    settings_file: SettingsFile | None = None
    against: str = ""
    tally: Mapping[str, int] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    def messages(self, *warnings: Notice) -> list[str]:
        """Return the messages that are not verdicts: source of settings, warnings and notices."""
        return [*messages_of(self.settings_file, warnings), *self.notices]

    @property
    def warnings(self) -> list[str]:
        """Notices that are warnings."""
        return [text for text in self.notices if text.startswith("warning: ")]

    @property
    def status(self) -> int:
        """Exit status."""
        return worst(outcome.status for outcome in self.outcomes)

    @property
    def verdict(self) -> Verdict:
        """The verdict that decides the exit status."""
        status = self.status  # it depends on all pairs, so it is computed once
        verdicts = [one.verdict for one in self.outcomes if one.status == status]
        passes = Verdict.NOISE in verdicts or Verdict.PASS in verdicts
        return Verdict.PASS if passes else verdicts[0]

    @property
    def advice(self) -> str:
        """Command that accepts the failed pairs or tightens the baseline.

        It is blank in two cases: there is no such command, or the command has characters that
        cannot be shown, so that no one could copy it.
        """
        import shlex  # lazy: most gates pass

        command = shlex.join(self.again)
        return command if visible(command) == command else ""

    def count(self, verdict: Verdict) -> int:
        """Count the outcomes with a verdict."""
        return sum(outcome.verdict is verdict for outcome in self.outcomes)


def evaluated_outcome(
    pair: Job,
    now: Measured,
    entry: Json | None,
    rules: Iterable[Rule],
    *,
    noisy: bool = False,
    **about: Any,
) -> PairOutcome:
    """Return the outcome of a pair: its result is judged against its entry of the baseline.

    Without an entry, all rules must be absolute limits. `noisy` is true if the pair is one run
    among several seeds, because such a run cannot show an improvement. `about` has further fields
    of the outcome.
    """
    reasons = differences(entry, now) if entry else []
    if reasons:
        return PairOutcome.of(pair, Verdict.INCOMPARABLE, *reasons, **about)
    if entry:
        try:
            check_equal(entry, now)
        except SolverError as error:
            about["status"] = error.exit_status
            return PairOutcome.of(pair, Verdict.ERROR, str(error), **about)
    findings = [_judge_rule(rule, now, typical(entry) if entry else {}) for rule in rules]
    if noisy:
        findings = [replace(finding, noisy=True) for finding in findings]
    notes = _notes(findings, now, entry)
    about |= {"values": now.values, "base": typical(entry)["total"] if entry else None}
    return PairOutcome.of(pair, _worst(findings), *notes, findings=tuple(findings), **about)


def combined_outcome(
    name: str,
    findings: Iterable[Finding | None],
    rules: Iterable[Rule],
    faults: Iterable[str],
    dead: Sequence[Finding] = (),
) -> PairOutcome:
    """Return the outcome of a group.

    `findings` has a finding for each rule, or None if its value is absent. `faults` are reasons why
    the group is not comparable. `dead` has a finding for each dead run.
    """
    pair, faults = Job(name=name), list(faults)
    if faults:
        return PairOutcome.of(pair, Verdict.INCOMPARABLE, *faults, group=True)
    every = [*dead, *(one or _unknown(rule) for one, rule in zip(findings, rules, strict=True))]
    notes = [text for one in every for text in _sentences(one)]
    better = [one.rule.path for one in every if one.improved]
    if better:
        notes.append(TIGHTER.format(", ".join(dict.fromkeys(better))))
    notes += _open(max((one.gap for one in every), default=0.0))
    return PairOutcome.of(pair, _worst(every), *notes, findings=tuple(every), group=True)


TIGHTER = (
    "baseline can be tightened: {} is better than the baseline, by more than its rule allows it to "
    "be worse"
)


def _worst(findings: Iterable[Finding]) -> Verdict:
    binding = [finding.verdict for finding in findings if not finding.rule.warns]
    return min(binding, key=WORST_FIRST.index, default=Verdict.PASS)


def _unknown(rule: Rule) -> Finding:
    """Return the finding for a value that is absent from the result or the baseline."""
    now = Value(lower=math.nan, upper=math.nan, proven=True, unit=1.0)
    return Finding(rule=rule, base=None, limit=math.nan, now=now, verdict=Verdict.INCOMPARABLE)


def updated_outcome(
    pair: Job, before: Json | None, entry: Json, now: Measured, **about: Any
) -> PairOutcome:
    """Return the outcome of an update, with the changed values; `about` has further fields."""
    notes = _update_notes(before, entry, now)
    changes = _changes(before["values"] if before else {}, entry["values"])
    return PairOutcome.of(pair, Verdict.UPDATED, *notes, changes=changes, **about)


def _judge_rule(rule: Rule, now: Measured, old: Json) -> Finding:
    """Judge a result by a rule.

    A class that only the result or only the baseline has costs 0 in the other.
    """
    if is_beside(rule.path):
        value, base = now.values.get(rule.path), value_at(old, rule.path)
        if value is None or (base is None and not rule.absolute):
            return replace(_unknown(rule), now=value) if value else _unknown(rule)
        return judge(rule, value, base)
    for name, path in meanings(rule.path):
        own = now.values if name is None else now.classes.get(name)
        before = old if name is None else old.get("by_class", {}).get(name)
        if own or before:
            value = own[path] if own else replace(now.values[path], lower=0.0, upper=0.0)
            base = value_at(before, path) if before else 0.0
            return judge(
                rule, value, base, lowest_in(old, now.order, name, path) if before else base
            )
    return _unknown(rule)


def _changes(
    before: Json, after: Json, name: str = ""
) -> dict[str, tuple[float | None, float | None]]:
    """Return the old and the new value for each path at which two entries differ.

    All paths begin with `name`. The value of ``tgospa`` is its upper bound.
    """
    values = {path: (value_at(before, path), value_at(after, path)) for path in RULE_VALUES}
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
        yield from _parts(now.values, typical(entry))
    if any(f.verdict is Verdict.UNDECIDED for f in findings):
        again = (
            "; run batch with this into a new folder" if now.stored and "--" in now.remedy else ""
        )
        yield f"undecided: {now.remedy}{again}"
    if entry:
        yield from _against(findings, now, typical(entry))


def _against(findings: list[Finding], now: Measured, old: Json) -> Iterator[str]:
    """Yield notes on how the result compares with the baseline."""
    moved = any(f.verdict is Verdict.FAIL and not f.now.proven for f in findings)
    if moved and now.values["total"].lower <= old["total"] * (1 + 1e-9):
        yield (
            "the total is not proven to be worse: another assignment may split the same total in "
            "another way"
        )
    better = [finding.rule.path for finding in findings if finding.improved]
    if better:
        yield TIGHTER.format(", ".join(dict.fromkeys(better)))
    lower, upper = (old[f"{side}_bound"] for side in ("lower", "upper"))
    gap = 1 - (lower / upper) ** now.order if upper else 0.0
    yield from _open(gap)


def _open(gap: float) -> Iterator[str]:
    """Yield a note if a baseline with this relative gap is not exact."""
    if gap > OPEN:
        yield (
            f"the baseline is not exact, relative gap {gap:.2g}: limits and changes in per cent "
            "refer to its upper bound"
        )


def _sentences(finding: Finding) -> Iterator[str]:
    rule, now = finding.rule, finding.now
    lower, upper, limit = texts(now.lower, now.upper, finding.limit)
    allowed = f"{rule.text} allows {'at least ' * rule.is_minimum}{limit}"
    warning = "warning: " if rule.warns else ""
    if finding.verdict is Verdict.INCOMPARABLE:
        yield f"{warning}{rule.text}: {_absent(finding)}"
    elif finding.note:
        yield finding.note
    elif finding.inference and finding.verdict in (Verdict.FAIL, Verdict.NOISE):
        yield from _inferred(finding, finding.inference, warning)
    elif finding.verdict is Verdict.UNDECIDED:
        about = f"between {lower} and {upper}" if lower != upper else f"{lower} up to rounding"
        yield f"{warning}{rule.path} is {about}; {allowed}"
    elif finding.verdict is Verdict.FAIL:
        known = f"at least {lower} (proven)" if now.proven else f"{lower} (split, not proven)"
        yield f"{warning}{rule.path} is {known}; {allowed}"


def _absent(finding: Finding) -> str:
    """Return the reason why a value cannot be judged."""
    path = finding.rule.path
    if names_summary(path):
        return (
            f"the result or the baseline has no {path}: it is not defined, or the baseline is too "
            f"old; renew the baseline with {option('update_baseline')}"
        )
    if path not in OF_NEES:
        return f"the result has no {path}"
    if not math.isnan(finding.now.upper):
        return (
            "the baseline has no NEES; make it again with "
            f"{option('update_baseline')} and this rule"
        )
    return (
        "the result has no NEES: no assigned state has a covariance that can be inverted, or it "
        f"was stored without {option('with_', 'nees')}"
    )


def _inferred(finding: Finding, inference: Inference, warning: str) -> Iterator[str]:
    """Yield sentences on the change between these files, and on what follows for the tracker."""
    rule, base = finding.rule, finding.base or 0.0
    now, limit, before = texts(finding.now.lower, finding.limit, base)
    change = f"{finding.now.lower / base - 1:+.1%} " if base else ""
    yield (
        f"{warning}{rule.path} of these files is {change}({before} -> {now}"
        f"{', proven' if finding.proven else ''}); {rule.text} allows {limit}"
    )
    seeds = f"{'the same' if inference.paired else 'other'} seeds"
    runs = f"{counted(inference.runs, 'run')} with {seeds}"
    p = f"p = {inference.p_value:.2g}"
    supported = inference.supports(inference.p_value)
    if inference.jump:
        yield f"{warning}seeds are an unlikely reason: {inference.jump}"
    if supported:
        yield f"the tracker is worse than allowed, inferred from {runs}, {p}"
    if supported or inference.jump:
        return
    mark = f"because of {option('strict')}, although " if finding.verdict is Verdict.FAIL else ""
    if inference.runs < inference.needed:
        without = f"Without {option('strict')}, o" if mark else "O"
        yield (
            f"{mark}within noise: {runs}, too few different runs for the test; it needs "
            f"{inference.needed} runs, or fewer groups and rules. {without}nly a jump (a total far "
            "above the usual spread of its seeds) or a dead run could fail"
        )
    elif math.isinf(inference.noticeable):
        yield f"{mark}within noise: few of {runs} are worse, {p}"
    else:
        yield (
            f"{mark}within the noise of {runs}, {p}; a change of about "
            f"{inference.noticeable:+.1%} would be detected"
        )


def _parts(values: Mapping[str, Value], old: Json) -> Iterator[str]:
    """Yield a note with the parts of the cost that changed."""
    moved = [
        f"{path} {number(old[path], 7)} -> {number(values[path].upper, 7)}"
        for path in PARTS
        if abs(values[path].upper - old[path]) > values[path].tolerance
    ]
    if moved:
        yield f"parts of the cost, not proven: {', '.join(moved)}"


def of_its_runs(
    one: PairOutcome,
    groups: Sequence[GroupTable],
    labels: Mapping[str, Mapping[str, str]],
    results: Mapping[str, Measured],
    old: Baseline,
) -> PairOutcome:
    """Add notes to the outcome of a failed group, and return it.

    The notes name the parts of the cost that changed, the worst scenes and the worst runs. Any
    other outcome is returned unchanged.
    """
    sums: dict[str, dict[str, tuple[float, float]]] = {"scenes": {}, "runs": {}}
    parts = dict.fromkeys(PARTS, (0.0, 0.0))
    for name in results if one.group and one.verdict is Verdict.FAIL else ():
        if name not in old:
            continue
        own, values, before = labels[name], results[name].values, old[name]["values"]
        for table in (t for t in groups if t.has(own)):
            if one.name in (table.group_of(own), f"all of {table.name}"):
                scene = "/".join(text for label, text in own.items() if label != table.seed)
                change = values["total"].upper, before["total"]
                sums["runs"][name] = change
                sums["scenes"][scene] = _plus(sums["scenes"].get(scene, (0.0, 0.0)), change)
                for path in PARTS:
                    parts[path] = _plus(parts[path], (values[path].upper, before[path]))
    notes = [
        *_parts(
            {k: Value.of(now) for k, (now, _) in parts.items()},
            {k: b for k, (_, b) in parts.items()},
        )
    ]
    for kind, sums_of_kind in sums.items():
        worse = sorted(
            (name for name, (now, base) in sums_of_kind.items() if now > base),
            key=lambda name: sums_of_kind[name][1] - sums_of_kind[name][0],
        )
        if worse and len(sums_of_kind) > 1:
            shown = [
                f"{name} {now / base - 1:+.1%}" if base else name
                for name in worse[:MAX_WORST]
                for now, base in [sums_of_kind[name]]
            ]
            notes.append(f"worst {kind}: {', '.join(shown)}")
    return replace(one, notes=(*one.notes, *notes))


MAX_WORST = 3
"""Largest number of scenes, and of runs, that the notes of a group name."""


def _plus(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return one[0] + other[0], one[1] + other[1]


def texts(*numbers: float) -> list[str]:
    """Format numbers with enough digits that different numbers look different.

    Numbers that agree to 12 digits count as equal, because outward rounding changes later digits.
    """
    differ = len({f"{value:.12g}" for value in numbers})
    for digits in (7, 10):
        shown = [number(value, digits) for value in numbers]
        if len({*shown}) == differ:
            return shown
    return [f"{value:,.12g}" for value in numbers]


def leftover(
    old: Baseline, names: Container[str], verdict: Verdict, note: str
) -> list[PairOutcome]:
    """Return an outcome for each pair of the baseline that is not in `names`."""
    gone = (Job(name=name) for name in old if name not in names)
    return [PairOutcome.of(pair, verdict, note) for pair in gone]


def _update_notes(before: Json | None, entry: Json, now: Measured) -> Iterator[str]:
    """Yield notes about changes that the values do not show."""
    if before is None:
        yield "new in the baseline"
    elif before == entry:
        yield "unchanged"
    elif entry["values"] in nights_of(before) and len(nights_of(entry)) == len(nights_of(before)):
        yield "the baseline has a night with the same values, so this one is not added again"
    elif incomparable({"before": before["judged"], "now": entry["judged"]}):
        yield "the truth has changed"
    kept, nights = len(nights_of(entry)), len(nights_of(before)) if before else 1
    if kept > 1:
        yield f"{kept} nights, whose mean is the baseline"
    elif nights > 1:
        yield f"one night replaces {nights}; {option('add')} keeps those of the same data"
    for name, now_is, was in unlike(entry["parameters"], before["parameters"]) if before else ():
        yield f"{name} is {now_is}, was {was}"
    if not now.certified:
        yield (
            f"not exact, relative gap {now.relative_gap:.2g}: the gate will compare with the "
            "upper bound"
        )


# -------------------------------------------------------------------------------------------------
# Options of the command that a gate proposes to accept the new values.


def without_option(arguments: Sequence[str], option: str) -> list[str]:
    """Return the arguments without this option and its value."""
    kept = [text for text in arguments if not text.startswith(f"{option}=")]
    if option in kept:
        at = kept.index(option)
        del kept[at : at + 2]
    return kept


def accepting_options(
    outcomes: Iterable[PairOutcome],
    groups: Sequence[GroupTable],
    pairs: Sequence[Job],
    old: Baseline,
) -> list[str]:
    """Return the options with which ``gate`` accepts pairs that failed or are not comparable.

    If every outcome has exit status 0, return the options that accept the improved pairs. If a file
    of a pair is missing or wrong, the options remove no entry, and accept no group that is not
    comparable.
    """
    there = {pair.name: pair for pair in pairs}
    outcomes = [*outcomes]
    broken = any(pair.fault and pair.fault_is == Verdict.ERROR for pair in pairs)
    broken = broken or any(one.verdict is Verdict.ERROR for one in outcomes)
    labels = {name: entry.get("labels", {}) for name, entry in old.items()}
    labels |= {name: pair.labels for name, pair in there.items()}

    def names_of(bad: Iterable[PairOutcome]) -> set[str]:
        names = set[str]()
        for one in bad:
            if not one.group:
                names.add(one.name)
                continue
            lost = one.verdict is Verdict.INCOMPARABLE
            if lost and broken:
                continue
            names |= {
                name
                for name, own in labels.items()
                if any(one.name in (t.group_of(own), f"all of {t.name}") for t in groups)
                if not lost or (name in there) != (name in old)
            }
        return names

    names = names_of(
        one
        for one in outcomes
        if one.verdict is Verdict.INCOMPARABLE
        or any(finding.verdict is Verdict.FAIL for finding in one.findings)
    )
    if not names and not any(one.status for one in outcomes):
        names = names_of(one for one in outcomes if any(each.improved for each in one.findings))
    names = names & there.keys() if broken else names
    if not names:
        return []
    some = [] if names >= there.keys() else patterns_of(names, {*there, *old})
    chosen = [text for pattern in some for text in ("--only", pattern)]
    return [
        "--update-baseline",
        *(["--prune"] if names - there.keys() else []),
        *chosen,
    ]
