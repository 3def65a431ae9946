"""Groups of a gate: runs with different seeds, added up and judged together.

A *scene* is a set of runs that differ only in their seed. A *night* is an earlier evaluation whose
values the baseline keeps.

A group fails if its value is above the limit, and if the choice of seeds is an unlikely reason for
this. The choice is an unlikely reason in two cases:

- A test is significant. It uses the scatter of the runs.
- One scene or run is far above the usual spread of its seeds. Such a *jump* only counts for rules
  on totals (see `jumps`).

A group within its limit does not fail because of a jump. With `strict`, a group above its limit
always fails. The sums are judged without a test in three cases: under absolute limits, for values
of assigned pairs, and if each scene of a group has only one run.

A run in which the tracker failed is *dead*. A dead run always fails, whatever the limit is. The
missed share of a run is the share of the ground-truth states that it misses. Let m be the largest
missed share that a run of the scene has in the baseline. Shares of 1 do not count for m.

- A new run is dead if its missed share is above m + (1 - m) / 2.
- If its missed share is a jump, it is dead above m + (1 - m) / 4.
- A run that missed all states in each night of the baseline is allowed to miss all states again.

A table of a suite defines groups by one pattern. All groups of a table are also judged together, as
one more group. This shows small changes that all groups have in common.

`confidence` is that of the whole gate: a tracker that is as good as the limit fails in at most
1 - confidence of its gates, for any number of groups and rules. For this purpose, p values are
adjusted (Holm 1979, with weights). Each rule of each table has the same share of the error
probability 1 - confidence. Of this share, `OF_ALL` belongs to the test of all groups together.
Single groups share the rest equally. The rest is small, because jumps also find large changes of a
single group.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.campaign.gate import rules
from tgospa_eval.campaign.gate.baseline import (
    Baseline,
    Measured,
    differences,
    lowest_in,
    nees_values,
    nights_of,
    number_in,
    typical,
    value_at,
)
from tgospa_eval.campaign.gate.jumps import FALSE_ALARMS, MIN_SCATTER, PRIOR, Rises, jumps
from tgospa_eval.campaign.gate.outcome import PairOutcome, combined_outcome
from tgospa_eval.campaign.gate.suite import GroupTable
from tgospa_eval.campaign.row import COPIED, MISSED, about_copies, originals
from tgospa_eval.campaign.statistics import exchanged_p_values, exchanges, holm
from tgospa_eval.common import patterns
from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, natural
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.results.consistency import NeesSums
from tgospa_eval.results.records import Json
from tgospa_eval.results.saved import unlike
from tgospa_eval.results.summary import names_summary

FEWEST_RUNS = 5
"""Smallest number of runs for a test."""

OF_ALL = 0.8
"""Share of the error probability of a rule that the test of all groups together has."""

SHOWN = 5
"""Largest number of runs that a sentence names."""

MIN_STATES = 10
"""Smallest number of ground-truth states with which a run can be dead.

A run without any estimate can be dead with fewer states.
"""

ALIVE = rules.Rule(text="no dead run", path="counts.missed", slack=0.0, absolute=True)

Labels = Mapping[str, str]

Part = tuple[str | None, str]
"""Name of a class, or None for all classes; and path of a value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneRuns:
    """Runs of one scene that differ only in their seed: new runs and runs of the baseline.

    Parameters
    ----------
    name : str
        Name of the scene: its labels as text.
    names : sequence of str
        Names of the new runs.
    now : sequence of Measured
        New runs, in the order of their names.
    old : sequence of dict
        Entries of the baseline. If `paired`, they are in the order of `names`.
    paired : bool
        Whether the new runs and the entries have the same names.
    added : mapping of str to Measured
        Further new runs, if `paired`. They have no entry in the baseline. In the group, only the
        rule on dead runs judges them.
    """

    name: str
    names: Sequence[str]
    now: Sequence[Measured]
    old: Sequence[Json]
    paired: bool
    added: Mapping[str, Measured]

    @cached_property
    def originals(self) -> tuple[list[int], list[int]]:
        """Results of `row.originals` for the new runs and for those of the baseline."""
        now = [
            (one.evaluated_on, one.estimate, {path: v.upper for path, v in one.values.items()})
            for one in self.now
        ]
        old = [
            (
                e["judged"],
                e.get("estimate_sha256", ""),
                {p: value_at(e["values"], p) for p in (*COPIED, MISSED[0])},
            )
            for e in self.old
        ]
        first, second = (
            originals(
                (judged["truth_sha256"], estimate, {**values, MISSED[1]: judged["truth_states"]})
                for judged, estimate, values in side
            )
            for side in (now, old)
        )
        return first, second

    @cached_property
    def tested(self) -> tuple[list[int], list[int]]:
        """Indices in `now` and in `old` of the runs that a test uses; copies are left out."""
        first, second = ([k for k, own in enumerate(s) if own == k] for s in self.originals)
        if self.paired:
            first = second = [k for k in first if k in second]
        return first, second

    def foreign(self) -> Iterator[str]:
        """Yield the names of new runs on steps or a truth that no run of the baseline has.

        The runs have other seeds than the baseline. If no two seeds have the same truth, the steps
        matter only if they are the same in all new runs, and in the whole baseline.
        """
        sides = [one.evaluated_on for one in self.now], [entry["judged"] for entry in self.old]
        steps, truths = (
            [{one[name] for one in side} for side in sides]
            for name in ("steps_sha256", "truth_sha256")
        )
        shared = any(
            len(own) < (len({*first}) if len(own) > 1 else len(first))
            for own, first in zip(truths, self.originals, strict=True)
        )
        alike = all(len(own) == 1 < len(side) for own, side in zip(steps, sides, strict=True))
        for name, one in zip(self.names, sides[0], strict=True):
            other = one["steps_sha256"] not in steps[1]
            if (shared and (other or one["truth_sha256"] not in truths[1])) or (alike and other):
                yield name

    def rises(self, now: Floats, old: Sequence[Floats]) -> Rises | None:
        """Return the rises of the costs of new runs above their limits; copies add no certainty."""
        first, second = self.tested
        used = old if self.paired else [old[k] for k in second]
        rises = Rises.of_costs(now, used, paired=self.paired)
        return rises and replace(rises, of_mean=rises.of_mean * len(now) / len(first))

    def missed(self) -> Rises:
        """Return the rises of the missed shares of new runs above those of the baseline."""
        nights = [
            np.array(list(map(_missed, nights_of(entry)))) / max(entry["judged"]["truth_states"], 1)
            for entry in self.old
        ]
        states = [max(one.evaluated_on["truth_states"], 1) for one in self.now]
        now = [one.values[ALIVE.path].lower for one in self.now]
        size = float(np.mean(states))
        return Rises.of_missed(np.array(now) / states, nights, size, paired=self.paired)

    def dead(self, p_values: Floats) -> list[rules.Finding]:
        """Return a finding for each dead run, by the definition in the docstring of this module.

        For each new run, `p_values` has the p value of the test that its missed share is a jump.
        """
        findings = []
        nights = [
            [
                missed / all_states
                for missed in map(_missed, nights_of(entry))
                if missed < all_states
            ]
            for entry in self.old
            for all_states in [entry["judged"]["truth_states"]]
        ]
        ever = max((missed for living in nights for missed in living), default=math.inf)
        died = sum(map(len, nights)) < sum(len(nights_of(entry)) for entry in self.old)
        lengths = {entry["judged"]["truth_states"] for entry in self.old}
        could_live = map(bool, nights) if self.paired else [True] * len(self.now)
        runs = [*zip(self.names, self.now, p_values, could_live, strict=True)]
        runs += [(name, one, 1.0, True) for name, one in self.added.items()]
        for name, one, p, alive in runs if ever < math.inf else ():
            states = one.evaluated_on["truth_states"]
            missed = replace(one.values[ALIVE.path], proven=one.silent)
            before = round(ever * states, 9)
            limit = before + (states - before) * (0.25 if p <= FALSE_ALARMS else 0.5)
            if alive and missed.lower > limit and (one.silent or states >= MIN_STATES):
                note = (
                    f"{name}: the tracker failed: it misses {missed.lower:g} of {states} "
                    "ground-truth states"
                    f"{' and reports none' if one.silent else ''}; no "
                    f"{'living run' if died else 'run'} of {self.name} in the baseline missed "
                    f"more than {before:g}{f' of {states}' * (len(lengths) > 1)}"
                )
                finding = rules.judge(replace(ALIVE, slack=limit), missed, before)
                findings.append(replace(finding, note=note, run=name))
        return findings


@dataclass(frozen=True, kw_only=True, eq=False)
class Group:
    """Scenes that are added up.

    Parameters
    ----------
    name : str
        Pattern of the table, filled with the labels of the group.
    scenes : tuple of SceneRuns
        Scenes with new runs and runs of the baseline.
    faults : tuple of str
        Reasons why the group cannot be compared.
    """

    name: str
    scenes: tuple[SceneRuns, ...]
    faults: tuple[str, ...]

    @property
    def runs(self) -> int:
        """Number of new runs."""
        return sum(len(scene.now) for scene in self.scenes)

    @property
    def tested(self) -> int:
        """Number of new runs without copies."""
        return sum(len(scene.tested[0]) for scene in self.scenes)

    def warnings(self) -> Iterator[Notice]:
        """Yield warnings about new runs that are not in the baseline, and about copies.

        Copies in the baseline matter only without copies among the new runs.
        """
        runs = (item for scene in self.scenes for item in scene.added.items())
        added = [name for name, one in runs if not one.is_new]
        if added:
            text = f"{listed(added, SHOWN)}: not in the baseline, so only the rule on dead runs and"
            yield Notice(code="not-in-baseline", text=f"{text} 'max' apply")
        now, old = ([(s.name, k) for s in self.scenes for k in s.originals[i]] for i in (0, 1))
        yield from [*about_copies("", now)] or about_copies("the baseline", old)


def copied_runs(
    tables: Iterable[GroupTable],
    now: Mapping[str, Measured],
    baseline: Baseline,
    labels: Mapping[str, Labels],
) -> list[str]:
    """Return warnings about copies among runs that become the baseline."""
    return [
        f"group {group.name}: {warning}"
        for table in tables
        for group in _groups(table, now, baseline, labels, ())
        for warning in group.warnings()
    ]


def judge_groups(
    tables: Iterable[GroupTable],
    now: Mapping[str, Measured],
    old: Baseline,
    labels: Mapping[str, Labels],
    failed: Iterable[str] = (),
    *,
    strict: bool = False,
) -> list[PairOutcome]:
    """Return the outcomes of all groups.

    Parameters
    ----------
    tables : iterable of GroupTable
        Tables of groups with their rules.
    now, old : mapping
        New results and the entries of the baseline, by name of the pair.
    labels : mapping of str to mapping
        Labels of new pairs and of pairs of the baseline, by name.
    failed : iterable of str
        Pairs that could not be evaluated, so that their groups cannot be judged.
    strict : bool
        Whether a group above its limit fails even if the choice of seeds can explain the excess.

    Raises
    ------
    ConfigError
        Two groups have the same name.
    """
    tables = list(tables)
    groups = [_groups(table, now, old, labels, list(failed)) for table in tables]
    names = [group.name for among in groups for group in among]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"two groups have the name {quoted(twice)}; put a label into the name, as in 'site "
            f"{{site}}'"
        )
    sums = {
        (place, number): [(group, _summed(rule, group)) for group in (*among, *together)]
        for place, (table, among) in enumerate(zip(tables, groups, strict=True))
        for together in [_together(table, among)]
        for number, rule in enumerate(table.rules)
    }
    weights: list[float] = []
    tested: list[tuple[Summed, float]] = []
    jumped: dict[int, str] = {}
    for (place, _), row in sums.items():
        some = [(one, group in groups[place]) for group, one in row if one and one.is_tested]
        tested += [(one, tables[place].confidence) for one, _ in some]
        singles = sum(single for _, single in some)
        rest = 1.0 - OF_ALL if singles < len(some) else 1.0
        weights += [rest / singles if single else OF_ALL for _, single in some]
        jumped |= _jumped([one for one, single in some if single], FALSE_ALARMS / len(sums))
    shares = np.array(weights) / len(sums or "-")
    worse, better = (
        holm(
            np.array(
                [
                    p_value(strata(one)) if one.group.tested >= FEWEST_RUNS else 1.0
                    for one, _ in tested
                ]
            ),
            shares,
        )
        for strata in (Summed.strata, Summed.better)
    )
    # In Holm's method, the tests that are not significant share the error probability.
    errors = np.array([1 - confidence for _, confidence in tested])
    left = float(shares[worse > errors + 1e-12].sum())
    known = {
        id(one): one.inferred(
            confidence,
            min(float(share) / left, 1.0) if left else 1.0,
            (float(p), float(q)),
            jumped.get(id(one), ""),
            strict=strict,
        )
        for (one, confidence), share, p, q in zip(tested, shares, worse, better, strict=True)
    }
    outcomes = []
    for place, (table, among) in enumerate(zip(tables, groups, strict=True)):
        scenes = [scene for group in among for scene in group.scenes]
        misses = {
            id(scene): each
            for scene, (_, each) in zip(
                scenes, jumps([scene.missed() for scene in scenes]), strict=True
            )
        }
        for k, group in enumerate((*among, *_together(table, among))):
            column = [sums[place, number][k][1] for number in range(len(table.rules))]
            findings = [known.get(id(one), one.finding) if one else None for one in column]
            dead = (
                [one for scene in group.scenes for one in scene.dead(misses[id(scene)])]
                if k < len(among)
                else []
            )
            outcomes.append(
                _warned(
                    combined_outcome(group.name, findings, table.rules, group.faults, dead),
                    [*group.warnings()] if k < len(among) else [],
                    strict=strict,
                )
            )
    return outcomes


def _warned(one: PairOutcome, warnings: Sequence[Notice], *, strict: bool) -> PairOutcome:
    """Return the outcome with these warnings; an outcome that is not comparable is unchanged.

    With `strict`, a group does not pass if some of its new runs are not in the baseline.
    """
    if one.verdict is rules.Verdict.INCOMPARABLE:
        return one
    if strict and not one.status and any(each.code == "not-in-baseline" for each in warnings):
        verdict = rules.Verdict.INCOMPARABLE
        one = replace(one, verdict=verdict, status=rules.STATUS[verdict])
    return replace(one, warnings=tuple(warnings))


def _jumped(column: Sequence["Summed"], error: float) -> dict[int, str]:
    """Return a sentence about each sum that has a jump; the keys are Python's `id` of the sums.

    `column` has the sums of one rule, one for each group. A rise is a jump if its p value is at
    most `error`. Only values with a proven bracket can have jumps. Counts cannot, because the size
    of a rise says little for small counts.
    """
    if not column or column[0].part[1] not in rules.PROVEN:
        return {}
    scenes = [(one, scene, side) for one in column for scene, side in one.sides()]
    notes: dict[int, str] = {}
    p_values = jumps([scene.rises(*side) for _, scene, side in scenes])
    for (one, scene, _), (whole, each) in zip(scenes, p_values, strict=True):
        runs = [name for name, p in zip(scene.names, each, strict=False) if p <= error]
        if whole <= error:
            which = f"{scene.name}: " if len(one.group.scenes) > 1 else ""
            notes.setdefault(
                id(one), f"{which}total is far above the usual spread of its seeds (a jump)"
            )
        elif runs:
            notes.setdefault(
                id(one),
                f"{listed(runs, SHOWN)}: total is far above the usual spread of the runs of "
                f"{scene.name} (a jump)",
            )
    return notes


def few_runs(tables: Sequence[GroupTable], labels: Mapping[str, Labels], nights: int) -> list[str]:
    """Return notes about groups with so few runs that the statistical test can never fail them.

    `labels` has the labels of the pairs by name. `nights` is the smallest number of nights that an
    entry of the baseline has.
    """
    notes = []
    columns = sum(len(table.rules) for table in tables)
    for table in tables:
        runs: dict[str, int] = {}
        scenes = set[tuple[object, ...]]()
        for name, own in labels.items():
            if table.has(own):
                group = patterns.fill(table.name, own)
                runs[group] = runs.get(group, 0) + 1
                scenes.add(tuple(sorted(i for i in own.items() if i[0] != table.seed)) or (name,))
        share = ((1.0 - OF_ALL) / len(runs) if len(runs) > 1 else 1.0) / max(columns, 1)
        needed = max(FEWEST_RUNS, fewest(1 - (1 - table.confidence) * share, nights=nights))
        more = "with these nights" if nights > 1 else f"or further nights with {option('add')}"
        few = sorted((name for name in runs if runs[name] < needed), key=natural)
        if few and len(scenes) < sum(runs.values()):
            notes.append(
                f"group {listed([f'{name} ({runs[name]})' for name in few], SHOWN)}: with so few "
                f"runs the test can never show that one group alone is worse: {needed} runs are "
                f"needed, {more}. "
                "Jumps above the limit (totals far above the usual spread of seeds) and dead runs "
                "still fail"
            )
    return notes


def _together(table: GroupTable, among: Sequence[Group]) -> list[Group]:
    """Return a list of one group, with the scenes of all groups of a table.

    The list is empty if the table has fewer than two groups, or if a group cannot be judged.
    """
    if len(among) < 2 or any(group.faults for group in among):
        return []
    scenes = tuple(scene for group in among for scene in group.scenes)
    return [Group(name=f"all of {table.name}", scenes=scenes, faults=())]


def _groups(
    table: GroupTable,
    now: Mapping[str, Measured],
    old: Baseline,
    labels: Mapping[str, Labels],
    failed: Sequence[str],
) -> list[Group]:
    """Return the groups of a table, sorted by name.

    Pairs without the labels in the pattern of the table are left out.
    """
    runs_by_group: dict[str, dict[tuple[str, ...], tuple[list[str], list[str]]]] = {}
    for side, names in enumerate((now, old)):
        for name in sorted(names, key=natural):
            own = labels.get(name, {})
            if not table.has(own):
                continue
            other_labels = (f"{key} {own[key]}" for key in sorted(own) if key != table.seed)
            scene = tuple(other_labels) if table.seed in own else (name,)
            group = runs_by_group.setdefault(patterns.fill(table.name, own), {})
            group.setdefault(scene, ([], []))[side].append(name)
    lost: dict[str, list[str]] = {}
    for name in failed:
        if table.has(labels[name]):
            lost.setdefault(patterns.fill(table.name, labels[name]), []).append(name)
    runs_by_group |= {name: {} for name in lost.keys() - runs_by_group.keys()}
    return [
        _group(name, scenes, now, old, lost.get(name, ()))
        for name, scenes in sorted(runs_by_group.items(), key=lambda item: natural(item[0]))
    ]


def _group(
    name: str,
    runs_by_scene: Mapping[tuple[str, ...], tuple[list[str], list[str]]],
    now: Mapping[str, Measured],
    old: Baseline,
    lost: Iterable[str],
) -> Group:
    """Return one group.

    `runs_by_scene` has for each scene the names of its new runs and of its runs in the baseline.
    `lost` has the names of runs that could not be evaluated.
    """
    scenes = []
    faults = [f"{run}: could not be evaluated" for run in lost]
    for scene, (mine, theirs) in runs_by_scene.items():
        where = ", ".join(scene) or "all runs"
        common = [run for run in theirs if run in now]
        gone = [run for run in theirs if run not in now]
        if not mine or not theirs:
            what = "in the baseline, but not among the pairs" if theirs else "not in the baseline"
            faults.append(f"{where}: {what}")
            continue
        if common and gone:
            faults.append(f"{listed(gone, SHOWN)}: in the baseline, but not among the pairs")
            continue
        if not common and len(mine) < len(theirs):
            faults.append(
                f"{where}: {counted(len(mine), 'run')}, but {len(theirs)} in the baseline, with "
                "other seeds; if that is right, renew the baseline"
            )
            continue
        names = common or mine
        scenes.append(
            SceneRuns(
                name=where,
                names=names,
                now=[now[run] for run in names],
                old=[old[run] for run in theirs],
                paired=bool(common),
                added={run: now[run] for run in mine if common and run not in common},
            )
        )
        reasons = [f"{run}: {text}" for run in common for text in differences(old[run], now[run])]
        if not common:
            reasons = [
                f"{mine[0]}: {option} is {value}, in the baseline {before}"
                for option, value, before in unlike(
                    now[mine[0]].parameters, old[theirs[0]]["parameters"]
                )
            ]
            for run in scenes[-1].foreign():
                reasons += [f"{run}: {text}" for text in differences(old[theirs[0]], now[run])]
        faults += reasons[:1]
    if len(scenes) == sum(len(one.now) for one in scenes) and not all(s.paired for s in scenes):
        faults.append("the seeds differ from the baseline, and each scene has only one run")
    orders = {one.order for scene in scenes for one in scene.now}
    if len(orders) > 1:
        faults.append("the orders p of its runs differ: they have no common sum")
    return Group(name=name, scenes=tuple(scenes), faults=tuple(faults))


@dataclass(frozen=True, kw_only=True, eq=False)
class Stratum:
    """Values that a test can exchange. They belong to one scene, or to one run and its nights.

    Parameters
    ----------
    allowed : array, shape (n,)
        For each of n runs (or nights) of the baseline: the limit that follows from its value.
    now : array, shape (m,)
        Values of the m new runs, in the order of `allowed` if `paired`.
    paired : bool
        Whether the k-th new run has the same seed as the k-th limit, for each k.
    weight : float
        Weight in a sum with other strata.
    """

    allowed: Floats
    now: Floats
    paired: bool
    weight: float = 1.0

    @property
    def all(self) -> Floats:
        """Values of the new runs, then the limits that follow from the baseline."""
        return np.concatenate([self.now, self.allowed])

    def relative(self) -> "Stratum":
        """Return the stratum with all values divided by their mean and multiplied by the weight."""
        factor = self.weight / (abs(float(self.all.mean())) or 1.0)
        return replace(self, now=self.now * factor, allowed=self.allowed * factor, weight=1.0)

    def scatter(self) -> tuple[float, float]:
        """Return the sum of squared deviations of single values, and its degrees of freedom.

        Values are divided by their mean. Under the hypothesis, new values and limits have the same
        mean. Deviations are therefore those from the mean of both together; if `paired`, from the
        mean of each pair. Exchanges do not change the results.
        """
        one = replace(self, weight=1.0).relative()
        if self.paired:
            return float(((one.now - one.allowed) ** 2).sum()) / 2, len(one.now)
        return float(((one.all - one.all.mean()) ** 2).sum()), len(one.all) - 1

    @property
    def variance(self) -> float:
        """Estimated variance of the excess of the new runs over their limits, summed over runs."""
        if self.paired:
            return len(self.now) * float(np.var(self.now - self.allowed, ddof=1))
        # One variance is estimated for new runs and baseline, because either can have a single run.
        squares = sum(float(((side - side.mean()) ** 2).sum()) for side in (self.now, self.allowed))
        count = len(self.now)
        return squares / self.freedom * count * (1 + count / len(self.allowed))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of `variance`."""
        return len(self.now) - 1 if self.paired else len(self.now) + len(self.allowed) - 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Summed:
    """A value of a group, summed over its runs, with the finding on the sum.

    Parameters
    ----------
    finding : Finding
        Finding on the sum, judged like the value of a pair.
    group : Group
        Group whose runs are summed.
    part : pair of str
        Name of a class, or None for all classes; and path of the value that is summed.
    base : float
        Sum of the baseline, scaled to the number of new runs.
    limit : float
        Largest allowed sum.
    of_sum : callable
        Callable that receives a sum and returns the value of the rule: the sum or its root.
    """

    finding: rules.Finding
    group: Group
    part: Part
    base: float
    limit: float
    of_sum: Callable[[float], float]

    @property
    def is_tested(self) -> bool:
        """True if the value is tested: a scene has different runs, and the rule limits a change.

        Different runs on one side are enough: they show that seeds matter. Absolute limits and
        values of assigned pairs are not tested.
        """
        rule = self.finding.rule
        return not (rule.absolute or rules.is_beside(rule.path)) and any(
            len({*own}) > 1 for scene in self.group.scenes for own in scene.originals
        )

    def sides(self) -> list[tuple[SceneRuns, tuple[Floats, list[Floats]]]]:
        """Return for each scene the new values, and the limits that follow from the baseline.

        Each run in the baseline has one limit for each night.
        """
        if self.finding.rule.relative and self.base > 0:
            factor, more = self.limit / self.base, 0.0
        else:
            factor, more = 1.0, (self.limit - self.base) / self.group.runs
        return [
            (
                scene,
                (
                    np.array([_now(one, self.part).lower for one in scene.now]),
                    [_old(entry, self.part) * factor + more for entry in scene.old],
                ),
            )
            for scene in self.group.scenes
        ]

    def strata(self) -> list[Stratum]:
        """Return the strata for the test that the values are above their limits."""
        return weighted([_strata(now, old, scene) for scene, (now, old) in self.sides()])

    def inferred(
        self,
        confidence: float,
        share: float,
        p_values: tuple[float, float],
        jump: str,
        *,
        strict: bool,
    ) -> rules.Finding:
        """Return the finding with an inference about the tracker, from runs with several seeds.

        `share` is the share of the error probability that this test has after Holm's method.
        `p_values` has two p values, adjusted for all tests. The first is for the test that the
        tracker is worse, the second for the test that it is better. `jump` is the sentence about a
        jump, or blank. `judge_groups` describes `strict`.
        """
        runs, level = self.group.tested, 1 - (1 - confidence) * share
        worse, better = p_values
        paired = all(scene.paired for scene in self.group.scenes)
        nights = min(len(nights_of(entry)) for scene in self.group.scenes for entry in scene.old)
        needed = max(FEWEST_RUNS, fewest(level, paired=paired, nights=nights))
        rise = noticeable(self.strata(), level, needed=needed)
        base = self.finding.base or 0.0
        noticed = self.of_sum(self.limit * (1 + rise)) / base - 1 if base > 0 else math.inf
        inference = rules.Inference(
            p_value=worse,
            confidence=confidence,
            runs=runs,
            needed=needed,
            paired=paired,
            noticeable=noticed,
            better=better,
            jump=jump,
        )
        verdict = self.finding.verdict
        if verdict is rules.Verdict.FAIL and not (inference.supports(worse) or jump):
            verdict = rules.Verdict.FAIL if strict else rules.Verdict.NOISE
            if self.finding.now.lower >= base * (1 + noticed):
                # The test would detect a rise of all runs by this much. Only few runs are worse.
                inference = replace(inference, noticeable=math.inf)
        return replace(self.finding, verdict=verdict, inference=inference)

    def better(self) -> list[Stratum]:
        """Return the strata for the test that the values are below the baseline minus the slack."""
        share = max(2 - self.limit / self.base, 0.0) if self.base > 0 else 0.0
        scenes = []
        for scene in self.group.scenes:
            now = np.array([-_now(one, self.part).upper for one in scene.now])
            old = [_old(entry, self.part, low=True) * -share for entry in scene.old]
            scenes.append(_strata(now, old, scene))
        return weighted(scenes)


def _strata(now: Floats, old: Sequence[Floats], scene: SceneRuns) -> list[Stratum]:
    """Return the strata of a scene; copies of runs are left out.

    `old` has the values of each run in the baseline, by night. If the runs are paired and the
    baseline has several nights, each run is a stratum. In other cases, the scene is one stratum.
    """
    first, second = scene.tested
    now, old, paired = now[first], [old[k] for k in second], scene.paired
    if paired and any(len(nights) > 1 for nights in old):
        return [
            Stratum(allowed=nights, now=now[k : k + 1], paired=False)
            for k, nights in enumerate(old)
        ]
    means = np.array([nights.mean() for nights in old])
    return [Stratum(allowed=means, now=now, paired=paired)]


def weighted(scenes: Sequence[Sequence[Stratum]]) -> list[Stratum]:
    """Return the strata of all scenes, with the weight 1 / variance of each scene.

    The variance is that of the values divided by their mean. As in the module `jumps`, the variance
    of a scene is moderated: the median variance of all scenes counts as much as `PRIOR` values of
    the scene.
    """
    sums = [np.sum([one.scatter() for one in scene], axis=0) for scene in scenes]
    squares, freedom = np.reshape(sums, (-1, 2)).T
    median = float(np.median(squares / freedom)) if len(scenes) else 0.0
    variances = np.maximum((squares + PRIOR * median) / (freedom + PRIOR), MIN_SCATTER**2)
    return [
        replace(one, weight=float(1 / variance))
        for scene, variance in zip(scenes, variances, strict=True)
        for one in scene
    ]


def _missed(night: Json) -> float:
    return number_in(night, None, ALIVE.path)


def _now(one: Measured, part: Part) -> rules.Value:
    """Return a value of a new run; a class that the run does not have costs 0."""
    name, path = part
    values = one.values if name is None else one.classes.get(name)
    return values[path] if values else replace(one.values[path], lower=0.0, upper=0.0)


def _old(entry: Json, part: Part, *, low: bool = False) -> Floats:
    """Return the values of a run of the baseline, or their lower bounds, one for each night."""
    order = float(entry["parameters"]["order"])
    return np.array(
        [
            lowest_in(night, order, *part) if low else number_in(night, *part)
            for night in nights_of(entry)
        ]
    )


def _summed(rule: rules.Rule, group: Group) -> Summed | None:
    """Sum the value of a rule over all runs of a group.

    There are two exceptions: NEES is computed from its sums over all runs, and a number of the
    summary is averaged over the runs. The result is None if the value is not known, or if the group
    is not comparable.
    """
    runs = [one for scene in group.scenes for one in scene.now]
    classes: set[str | None] = {None, *(name for one in runs for name in one.classes)}
    for scene in group.scenes:
        classes |= {
            name
            for entry in scene.old
            for night in nights_of(entry)
            for name in night.get("by_class", {})
        }
    part = next((part for part in rules.meanings(rule.path) if part[0] in classes), None)
    if part is None or group.faults:
        return None
    if names_summary(rule.path):
        values = [one.values.get(rule.path) for one in runs]
        earlier = [value_at(typical(e), rule.path) for scene in group.scenes for e in scene.old]
        if None in values or (None in earlier and not rule.absolute):
            return None
        now = rules.Value.of(math.fsum(v.upper for v in values if v) / len(values))
        base = math.fsum(earlier) / len(earlier) if earlier and None not in earlier else None
        finding = rules.judge(rule, now, base)
        return Summed(finding=finding, group=group, part=part, base=0.0, limit=0.0, of_sum=float)
    if rule.path in rules.OF_NEES:
        old = [NeesSums.of_values(typical(entry)) for scene in group.scenes for entry in scene.old]
        sums = (NeesSums.joined(filter(None, each)) for each in ([one.nees for one in runs], old))
        own, before = (nees_values(each).get(rule.path) for each in sums)
        if own is None or (before is None and not rule.absolute):
            return None
        finding = rules.judge(rule, own, before.upper if before else None)
        return Summed(finding=finding, group=group, part=part, base=0.0, limit=0.0, of_sum=float)
    tail, order, steps, old_steps = part[1], 1.0, 1.0, 1.0
    if tail.endswith("tgospa"):
        part, order = (part[0], "total"), runs[0].order
    if tail == "normalised.tgospa":
        steps = max(math.fsum(one.evaluated_on["steps"] for one in runs), 1.0)
        old_steps = max(_sum_of(group, lambda entry: float(entry["judged"]["steps"])), 1.0)
    values_of_runs = [_now(one, part) for one in runs]
    base = _sum_of(group, lambda entry: float(_old(entry, part).mean()))

    def of_sum(total: float) -> float:
        return float((total / steps) ** (1 / order))

    now = rules.Value(
        lower=of_sum(math.fsum(one.lower for one in values_of_runs)),
        upper=of_sum(math.fsum(one.upper for one in values_of_runs)),
        proven=all(one.proven for one in values_of_runs),
        unit=1.0 if tail.endswith("tgospa") else sum(one.unit for one in values_of_runs),
    )
    low = _sum_of(group, lambda entry: float(_old(entry, part, low=True).mean()))
    low, upper = ((total / old_steps) ** (1 / order) for total in (low, base))
    finding = rules.judge(rule, now, upper, low)
    limit = finding.limit**order * steps
    return Summed(finding=finding, group=group, part=part, base=base, limit=limit, of_sum=of_sum)


def _sum_of(group: Group, number: Callable[[Json], float]) -> float:
    """Sum a number over the baseline; each scene is scaled to its number of new runs."""
    return math.fsum(
        math.fsum(map(number, scene.old)) * (len(scene.now) / len(scene.old))
        for scene in group.scenes
    )


# -------------------------------------------------------------------------------------------------
# Permutation tests that a sum is above a limit. The tests need runs with several seeds.
#
# Runs are stratified: a stratum is one scene, whose runs differ only in their seed. If the baseline
# has several nights of the same seeds, a stratum is one run with its nights. The hypothesis is that
# the tracker is exactly as good as the limit. Under this hypothesis, the new value and the limit of
# a seed can be exchanged. An exchange flips the sign of their difference (Fisher 1935, section 21).
# If the seeds differ from those of the baseline, or if the baseline has several nights, all values
# of a stratum can be exchanged (Pitman 1937).
#
# The statistic is the excess of the new runs over their limits, summed over all strata. The excess
# of a stratum is divided by the mean of its values, because noise grows with the cost of a scene:
# the costliest scene must not hide the other scenes. Each scene has the weight 1 / variance of the
# divided values (see `weighted`). Exchanges do not change means or weights.

POWER = 0.8
"""Probability with which the test detects a change of the size that `noticeable` returns."""


def p_value(strata: Sequence[Stratum]) -> float:
    """Return the one-sided p value of the test that a sum is above its limit.

    The p value is exact if all exchanges can be tried.

    Parameters
    ----------
    strata : sequence of Stratum
        At least one stratum; all are tested together.
    """
    strata = [one.relative() for one in strata]
    both = [(one.now - one.allowed, 0) if one.paired else (one.all, len(one.now)) for one in strata]
    size = sum(float(np.abs(one.all).sum()) for one in strata)
    values = [(values[:, None], first) for values, first in both]
    return float(exchanged_p_values(values, size)[0])


def fewest(confidence: float, *, paired: bool = True, nights: int = 1) -> int:
    """Return the smallest number of runs with enough exchanges for a p value of 1 - confidence."""
    wanted = 1 / (1 - confidence) - 1e-9
    runs = 1
    while ((1 + nights) ** runs if paired else exchanges(2 * runs, runs)) < wanted:
        runs += 1
    return runs


def noticeable(strata: Sequence[Stratum], confidence: float, *, needed: int = 1) -> float:
    """Estimate how far all runs must rise above the limit so that the test detects the rise.

    The rise is a share of the limit. The test detects a rise of this size with the probability
    `POWER`. The rise is estimated by Student's t, from the scatter of these runs. `needed` is the
    smallest number of runs for a test. With exactly this number, each run has to be above the
    limit. The rise is infinite in three cases: with fewer runs, without degrees of freedom, and
    with limits of 0.
    """
    strata = [one.relative() for one in strata]
    freedom = sum(one.freedom for one in strata if one.freedom > 0)
    size = sum(len(one.now) * float(one.allowed.mean()) for one in strata)
    runs = sum(len(one.now) for one in strata)
    if freedom == 0 or size <= 0 or runs < needed:
        return math.inf
    from scipy.special import ndtri, stdtrit  # lazy: slow to import

    deviation = math.sqrt(sum(one.variance for one in strata if one.freedom > 0))
    share = float(stdtrit(freedom, confidence) + stdtrit(freedom, POWER)) * deviation
    if runs == needed:
        share = max(share, float(ndtri(POWER ** (1 / runs))) * deviation * math.sqrt(runs))
    return share / size
