"""``gate``: an estimate, a suite or the store of a batch, judged by a baseline."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from datetime import datetime
from fnmatch import fnmatchcase
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tgospa_eval._version import __version__
from tgospa_eval.api.batch_row import JobTask, Run, judged_rows
from tgospa_eval.api.evaluate import evaluate
from tgospa_eval.api.keywords import KEYWORDS, with_options
from tgospa_eval.api.options import FLAGS, NAMES, OF_THE_NUMBER, SETTINGS, Request, Values, typed
from tgospa_eval.campaign.gate.baseline import (
    CHANGED,
    Baseline,
    Measured,
    dump,
    load,
    make_entry,
    measured,
    nights_of,
    parse,
    with_nights,
)
from tgospa_eval.campaign.gate.groups import few_runs, judge_groups
from tgospa_eval.campaign.gate.outcome import (
    PairOutcome,
    Report,
    accepting_options,
    judged_outcome,
    leftover,
    of_its_runs,
    updated_outcome,
    without_option,
)
from tgospa_eval.campaign.gate.report import GATE_REPORTS, finding_record
from tgospa_eval.campaign.gate.rules import OF_NEES, Rule, Verdict, parse_rules, split_rules
from tgospa_eval.campaign.gate.suite import (
    ONLY_PAIR,
    SEED,
    GroupTable,
    load_suite,
    make_group,
)
from tgospa_eval.campaign.gate.target import Target, last_change
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.campaign.row import Row, job_name, labels_of, row_to_judge
from tgospa_eval.campaign.store import SETTINGS_FILE, Store
from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.writing import write_file
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.evaluation.sides import TrajectoriesLike
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import Json
from tgospa_eval.results.saved import ACCURACY
from tgospa_eval.text import clipped, option, quoted

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.api.result import Result

WITHOUT_EFFECT = ("jobs", "max-input")
"""Options of an evaluation that change neither the number nor its bracket."""

PATHS_GIVEN = ("covariance", "step-weights", "ignore-regions")
"""Options that name a file."""

RULE_PARAMETERS = {"fail-on": "fail_on", "warn-on": "warn_on", "max": "maximum"}
"""Rules by their names in a suite and as parameters."""

ACCURACY_KEYS = tuple(name.replace("_", "-") for name in ACCURACY)

Evaluated = tuple[Row, Mapping[str, object]]
"""The row of a pair, and the options that made it."""

Evaluate = Callable[[Sequence[Job], Baseline], Iterator[Evaluated]]
"""Answers of pairs, in their order; a baseline may have options of them."""


@dataclass(frozen=True, kw_only=True)
class GateOptions(Values):
    """What to judge by, how to evaluate, and what to write.

    A default yields to the baseline, that to a configuration file, that to the suite, that to the
    environment, that to a flag.

    Parameters
    ----------
    evaluation : Request
        Options of the evaluation.
    sources : mapping of str to str
        Where the value of each parameter comes from: ``commandline``, ``environment``,
        ``default_map`` for a configuration file, or ``default``.
    typed : tuple of str
        The arguments, for commands that messages propose.
    """

    evaluation: Request = Request()
    sources: Mapping[str, str] = field(default_factory=dict)
    typed: tuple[str, ...] = ()
    suite: str | None = None
    baseline: str | None = None
    update_baseline: bool = False
    add: bool = False
    strict: bool = False
    fail_on: tuple[str, ...] = ()
    warn_on: tuple[str, ...] = ()
    maximum: tuple[str, ...] = ()
    group: str | None = None
    confidence: float | None = None
    seed_label: str | None = None
    only: tuple[str, ...] = ()
    prune: bool = False
    against: str | None = None
    newer_than: str | None = None
    output: str | None = None
    force: bool = False
    junit: str | None = None
    proof: str | None = None
    quiet: bool = False
    verbose: bool = False
    config: SettingsFile | None = None

    def given(self, *sources: str) -> dict[str, object]:
        """Options of the evaluation from these sources, by field."""
        return {
            name: getattr(self.evaluation, name)
            for name in NAMES.values()
            if self.sources[name] in sources
        }

    def strong(self, name: str) -> bool:
        """Whether it is a flag or from the environment."""
        return self.sources.get(name) in ("commandline", "environment")

    def chosen(self, name: str) -> bool:
        """Whether an update is about this pair."""
        return not self.only or any(fnmatchcase(name, pattern) for pattern in self.only)

    @property
    def renewed(self) -> Callable[[str], bool] | None:
        """Which entries an update makes anew; None without one."""
        return self.chosen if self.update_baseline else None

    def prefix(self, pair: Job) -> str:
        """What a line about a pair begins with: its name, where there are several."""
        return f"{clipped(pair.name)}: " if self.suite else ""

    def resolve(self, pair: Job, entry: Json | None, path: str) -> dict[str, object]:
        """The options of a pair that are no defaults, by field."""
        inherited = dict(entry["options"]) if entry else {}
        for key in (key for key in PATHS_GIVEN if inherited.get(key)):
            inherited[key] = os.path.join(os.path.dirname(path), str(inherited[key]))
        return {
            **typed(inherited, f"{path}, options"),
            **self.given("default_map"),
            **typed(pair.options, f"pair {quoted(pair.name)}, options"),
            **self.given("commandline", "environment"),
        }

    def tables(self, pairs: Sequence[Job], groups: Sequence[GroupTable]) -> list[GroupTable]:
        """The groups of a suite, or those of the command line, which have its rules.

        Raises
        ------
        ConfigError
            Something is wrong with them.
        """
        if self.group is None:
            for name, value in (("confidence", self.confidence), ("seed_label", self.seed_label)):
                if value is not None and not groups:
                    raise ConfigError(
                        f"{option(name)} is for {option('group')}, or a suite with [[group]]"
                    )
            return [
                replace(
                    one,
                    confidence=self.confidence or one.confidence,
                    seed=self.seed_label or one.seed,
                )
                for one in groups
            ]
        names = [name.strip() for name in self.group.split(",")]
        pattern = "all" if names == ["all"] else "/".join(f"{{{name}}}" for name in names)
        texts = [getattr(self, name) for name in RULE_PARAMETERS.values()]
        labels = {label for pair in pairs for label in pair.labels}
        seed, confidence = self.seed_label or SEED, self.confidence or GroupTable.confidence
        return [make_group(pattern, texts, confidence, seed, labels, option("group", self.group))]

    def rules(self, pair: Job, *, baseline: bool = True, default: bool = True) -> list[Rule]:
        """The rules of a pair; `default`: whether the usual one holds where none is given.

        Raises
        ------
        ConfigError
            One is wrong; or there is no baseline, and they are not all absolute limits.
        """
        own = {key: _texts(getattr(self, name)) for key, name in RULE_PARAMETERS.items()}
        suite = {key: _texts(pair.rules.get(key, ())) for key in own}
        is_own = own["fail-on"] and (self.strong("fail_on") or not suite["fail-on"])
        found = parse_rules(
            (own if is_own else suite)["fail-on"],
            (*suite["warn-on"], *own["warn-on"]),
            (*suite["max"], *own["max"]),
            default=baseline and default,
        )
        relative = [rule for rule in found if not rule.absolute]
        if not baseline and (relative or not found) and default:
            why = (
                f"{relative[0].text} needs one"
                if relative
                else f"limits of {option('limits')} need none"
            )
            raise ConfigError(
                f"{self.prefix(pair)}no baseline: name it with "
                f"{option('baseline', metavar='FILE')}; {why}"
            )
        return found


# -------------------------------------------------------------------------------------------------
# Pairs of files, suites and stores: all are judged, or the baseline of all is made anew.


class OverInputError(ConfigError):
    """The JUnit report would be written over what is read."""


def judge_all(
    gate: GateOptions,
    truth: str | None,
    estimate: str | None,
    notify: Callable[[str], None],
    run: Run | None = None,
) -> Report:
    """Judge a pair of files, the pairs of a suite or the jobs of a store; or make the baseline.

    Of a store nothing is solved: what was proven is compared.

    Parameters
    ----------
    gate : GateOptions
        What to judge by.
    truth, estimate : str, optional
        Two files; or the store that is judged, with another one in front that is the baseline.
    notify : callable
        Gets lines for the user.
    run : callable, optional
        Runs the work of a pair in this process; by default it is called.

    Raises
    ------
    TgospaError
        Nothing can be judged.
    """
    _check_junit(gate, truth, estimate)
    if truth is not None and is_store(truth):
        for name, value in (("against", gate.against), ("newer_than", gate.newer_than)):
            if value is not None:
                raise ConfigError(f"{option(name)} is for files and suites, not for stores")
        folder, path = _stores(gate, truth, estimate)
        table = _store_rows(folder)
        settings = _store_options(folder)
        pairs = [
            Job(
                name=name,
                truth=row["truth"],
                estimate=row["estimate"],
                fault=f"failed in {folder}: {row['message']}" if row["status"] == "failed" else "",
                labels=labels_of(row),
            )
            for name, row in table.items()
        ]

        def evaluated(pairs: Sequence[Job], _: Baseline) -> Iterator[Evaluated]:
            for row in (table[pair.name] for pair in pairs):
                yield row, _row_options(row, settings, path or "")

        old = load_baseline(path) if path else None
        return _report(gate, pairs, [], path or "", old, evaluated, folder)
    if gate.against is not None and gate.update_baseline:
        raise ConfigError(
            f"{option('against')} and {option('update_baseline')}: leave one of them out"
        )
    target = None if gate.against is None else Target(gate.against)
    pairs, groups, named = _pairs(gate, truth, estimate, notify, target)
    if truth is not None:
        gate = replace(gate, suite=None)
    for pair in pairs:
        _check_junit(gate, pair.truth, pair.estimate, named)
    path = (gate.baseline if gate.strong("baseline") or not named else named) or ""
    if target is None:
        old = load_baseline(path, gate.renewed) if path else None
    else:
        old = parse(target.demand(path), target.name(path)) if path else None
        pairs = [*_with_faults(gate, target, pairs, groups, old, path)]
    if gate.newer_than is not None:
        pairs = [*_with_stale(pairs, gate.newer_than)]
    report = _report(
        gate,
        pairs,
        groups,
        path,
        old,
        lambda pairs, old: _evaluated(gate, pairs, old, path, groups, notify, run),
        "the suite",
    )
    return _with_first_changes(gate, report, pairs, old or {}, path, target)


def _with_first_changes(
    gate: GateOptions,
    report: Report,
    pairs: Sequence[Job],
    old: Baseline,
    path: str,
    target: Target | None,
) -> Report:
    """The report with the first state of truths that changed, where git has what they were."""
    there = {pair.name: pair for pair in pairs}
    outcomes = list(report.outcomes)
    changed = [
        place
        for place, one in enumerate(outcomes)
        if one.verdict is Verdict.INCOMPARABLE and one.name in there and not one.group
        if there[one.name].fault_is == one.verdict or CHANGED in " ".join(one.notes)
    ]
    for place in changed[:MOST_CHANGES]:
        one, pair = outcomes[place], there[outcomes[place].name]
        before = target or last_change(path)
        content = None if before is None else before.read(pair.truth)
        if before is None or content is None:
            continue
        with suppress(TgospaError):  # what cannot be read has been said, or is not there to compare
            text = _first_change(gate.resolve(pair, old.get(pair.name), path), pair, content)
            note = f"{text} (was -> is; since {before.where})"
            outcomes[place] = replace(one, notes=(*one.notes, note))
    return replace(report, outcomes=tuple(outcomes))


MOST_CHANGES = 10
"""Truths that changed of which the first state is looked for."""


def _first_change(options: Mapping[str, object], pair: Job, content: bytes) -> str:
    """The first state of a truth that is another one than in a former file."""
    from tempfile import TemporaryDirectory  # here: truths seldom change

    from tgospa_eval.api.evaluate import read_sides
    from tgospa_eval.api.resolve import make_settings

    def states(truth: str) -> dict[tuple[float, str], tuple[str, list[float]]]:
        sides = read_sides(settings, truth, pair.estimate, Stopwatch(), lambda _: None)
        side = sides.fitted.given[0]
        rows = zip(side.step.tolist(), side.track.tolist(), side.state.tolist(), strict=True)
        return {
            (side.times[k].item(), str(side.ids[track])): (str(side.shown[k]), state)
            for k, track, state in rows
        }

    settings = make_settings(Request.of(options))
    with TemporaryDirectory() as folder:
        path = os.path.join(folder, os.path.basename(pair.truth))
        with open(path, "wb") as file:
            file.write(content)
        before, now = states(path), states(pair.truth)
    for key in sorted(before.keys() | now.keys()):
        was, is_ = (side.get(key, ("", []))[1] for side in (before, now))
        if was != is_:
            shown = [", ".join(map(repr, state)) or "nothing" for state in (was, is_)]
            when = (before.get(key) or now[key])[0]
            return f"the first state that differs: {key[1]} at {when}: {' -> '.join(shown)}"
    return "no state differs in what is evaluated"


def _with_faults(
    gate: GateOptions,
    target: Target,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    old: Baseline | None,
    path: str,
) -> Iterator[Job]:
    """The pairs; those whose files are not the target's have a fault, or are new."""
    known, tables = old or {}, gate.tables(pairs, groups)
    seeds = {table.seed for table in tables}

    def scene(labels: Mapping[str, str]) -> set[tuple[str, str]]:
        return {item for item in labels.items() if item[0] not in seeds}

    scenes = [scene(entry.get("labels", {})) for entry in known.values()]
    for pair in pairs:
        options = gate.resolve(pair, known.get(pair.name), path)
        named = [options.get(NAMES[key]) for key in (*PATHS_GIVEN, "region")]
        files = [pair.truth, *(str(file) for file in named if file)]
        other = [file for file in files if target.has_another(file)]
        if other and not pair.fault:
            fault = f"{other[0]}: is another one in {target.where}, which judges"
            yield replace(pair, fault=fault, fault_is=Verdict.INCOMPARABLE)
            continue
        # Of a scene that the target knows, runs with other seeds are judged in their group.
        judged = target.has(pair.truth) and scene(pair.labels) in scenes
        judged = judged and any(table.has(pair.labels) for table in tables)
        yield replace(pair, is_new=old is not None and pair.name not in known and not judged)


def _with_stale(pairs: Iterable[Job], since: str) -> Iterator[Job]:
    """The pairs; those whose estimates were last written before a time, or a file, have a fault.

    Raises
    ------
    ConfigError
        It is neither.
    """
    try:
        exists = os.path.exists(since)
        least = os.path.getmtime(since) if exists else datetime.fromisoformat(since).timestamp()
    except ValueError:
        raise ConfigError(
            f"{option('newer_than')} {quoted(since)}: is neither a file nor a time, as "
            "2026-11-28T06:00"
        ) from None
    for pair in pairs:
        files = files_at(file_of(pair.estimate))
        written = max(
            (os.path.getmtime(file) for file in files if os.path.exists(file)), default=least
        )
        if written < least and not pair.fault:
            times = (str(datetime.fromtimestamp(one)) for one in (written, least))
            fault = "{}: is of {}, before {}: did the tracker run?".format(pair.estimate, *times)
            pair = replace(pair, fault=fault, fault_is=Verdict.FAIL)
        yield pair


def _check_junit(gate: GateOptions, *paths: str | None) -> None:
    """Whether the JUnit report would be written over what is read.

    Raises
    ------
    OverInputError
        It is one of these files, the suite, the baseline or the configuration.
    """
    if not gate.junit:
        return
    target, used = os.path.realpath(gate.junit), gate.config
    for path in (*paths, gate.suite, gate.baseline, used and used.path):
        if path and os.path.realpath(path) == target:
            raise OverInputError(
                f"{option('junit', gate.junit)}: is an input of the gate; name another file"
            )


def _check_options(gate: GateOptions, path: str) -> None:
    """Whether the options of an update go together.

    Raises
    ------
    ConfigError
        They do not, or there is no file to make.
    """
    for name, value in (("only", gate.only), ("prune", gate.prune), ("add", gate.add)):
        if value and not gate.update_baseline:
            raise ConfigError(f"{option(name)} is for {option('update_baseline')}")
    if gate.update_baseline and (not path or is_store(path)):
        wrong = f"{path} is a batch, which tgospa-eval batch makes" if path else "no baseline"
        raise ConfigError(
            f"{wrong}: name the file to make with {option('baseline', metavar='FILE')}"
        )


def _report(
    gate: GateOptions,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    old: Baseline | None,
    evaluated: Evaluate,
    whence: str,
) -> Report:
    """The outcomes of all groups and pairs, or of an update of the baseline."""
    _check_options(gate, path)
    groups = gate.tables(pairs, groups)
    if gate.group is not None:  # whose rules are those of the command line
        gate = replace(gate, fail_on=(), warn_on=(), maximum=())
    alone = {pair.name for pair in pairs} == {ONLY_PAIR} and not gate.suite
    if alone and old and ONLY_PAIR not in old:
        raise ConfigError(
            f"{path}: is the baseline of a suite ({', '.join(old)}); name {option('suite')}"
        )
    if groups and not path:
        raise ConfigError(
            f"no baseline: name it with {option('baseline', metavar='FILE')}; groups need one"
        )
    rules = {
        pair.name: [replace(rule, warns=True) for rule in found if rule.absolute]
        if pair.is_new
        else found
        for pair in pairs
        if not pair.fault
        for found in [gate.rules(pair, baseline=bool(path), default=not groups)]
    }  # wrong ones before any work
    if gate.update_baseline:
        return _updated(gate, pairs, groups, path, old, evaluated, whence)
    outcomes = _judged(pairs, groups, path, old, rules, evaluated, whence, strict=gate.strict)
    again: tuple[str, ...] = ()
    if gate.typed and path and not is_store(path):
        command = without_option(gate.typed, "--against")
        at = command.index("--") if "--" in command else len(command)
        accepted = accepting_options(outcomes, groups, pairs, old or {})
        if accepted:
            # In the environment of pre-commit, the program is not where shells look for it.
            alone = "PRE_COMMIT" in os.environ
            program = (sys.executable, "-m", "tgospa_eval") if alone else ("tgospa-eval",)
            again = (*program, "gate", *command[:at], *accepted, *command[at:])
    return Report(
        baseline=path,
        outcomes=tuple(outcomes),
        version=__version__,
        again=again,
        against=gate.against or "",
        notices=tuple(_few_runs(pairs, groups, {})) if old is None else (),
    )


def _few_runs(pairs: Sequence[Job], groups: Sequence[GroupTable], baseline: Baseline) -> list[str]:
    """What is said of groups whose seeds can support nothing."""
    nights = min((len(nights_of(entry)) for entry in baseline.values()), default=1)
    return few_runs(groups, {pair.name: pair.labels for pair in pairs}, nights)


def _judged(
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    baseline: Baseline | None,
    rules: Mapping[str, list[Rule]],
    evaluated: Evaluate,
    whence: str,
    *,
    strict: bool,
) -> list[PairOutcome]:
    """The outcomes of all groups and pairs; wrong files do not keep others from being judged."""
    missing = f"no such file: {path}" if baseline is None else f"not in {path}"
    old = baseline or {}
    labels = {name: entry.get("labels", {}) for name, entry in old.items()}
    labels |= {pair.name: pair.labels for pair in pairs}
    results: dict[str, Measured] = {}
    outcomes: dict[str, PairOutcome] = {}
    chosen: list[Job] = []
    tables = {
        pair.name: [table for table in groups if table.has(pair.labels) and not pair.is_new]
        for pair in pairs
    }
    for pair in pairs:
        if pair.fault:
            outcomes[pair.name] = PairOutcome.of(pair, Verdict(pair.fault_is), pair.fault)
        elif not path or pair.name in old or pair.is_new or (tables[pair.name] and baseline):
            chosen.append(pair)
        else:
            outcomes[pair.name] = PairOutcome.of(pair, Verdict.INCOMPARABLE, missing)
    for pair, (row, _) in zip(chosen, evaluated(chosen, old), strict=True):
        now, about = _measured(row)
        entry = old.get(pair.name)
        if isinstance(now, TgospaError):
            about = {"status": now.exit_status, **about}
            outcome = PairOutcome.of(pair, Verdict.ERROR, str(now), **about)
        elif path and entry is None and not pair.is_new:
            outcome = PairOutcome.of(pair, Verdict.PASS, IN_GROUP, values=now.values, **about)
        else:
            noisy = any(table.seed in pair.labels for table in tables[pair.name])
            outcome = judged_outcome(pair, now, entry, rules[pair.name], noisy=noisy, **about)
            if pair.is_new:
                note = "new, not judged: the target does not have it yet; its limits of "
                note += f"{option('limits')} only warn"
                outcome = replace(outcome, verdict=Verdict.NEW, notes=(*outcome.notes, note))
        if isinstance(now, Measured) and not pair.is_new:
            results[pair.name] = now
        hidden = len(pairs) > MAX_PAGES and not outcome.status
        outcomes[pair.name] = replace(outcome, page="") if hidden else outcome
    judged = [outcomes[pair.name] for pair in pairs]
    if baseline is not None:
        failed = [one.name for one in judged if one.verdict is Verdict.ERROR]
        failed += [pair.name for pair in pairs if pair.fault and pair.name not in failed]
        added = judge_groups(groups, results, old, labels, failed, strict=strict)
        first = (of_its_runs(one, groups, labels, results, old) for one in added[:MAX_PAGES])
        judged = [*first, *added[MAX_PAGES:], *judged]
    named = {name for name in old if any(table.has(labels[name]) for table in groups)}
    named |= {pair.name for pair in pairs}
    note = (
        f"in the baseline and not in {whence}; {option('update_baseline')} {option('prune')} "
        "removes it"
    )
    return judged + leftover(old, named, Verdict.INCOMPARABLE, note)


def _measured(row: Row) -> tuple[Measured | TgospaError, dict[str, Any]]:
    """Values of a row or what is wrong with it, and more for its outcome."""
    about: dict[str, Any] = {name: row[name] for name in ("seconds", "page") if name in row}
    if "error" in row:
        return row["error"], about
    about["warnings"] = tuple(Notice(**record) for record in json.loads(row["warnings"]))
    try:
        return measured(row), about
    except TgospaError as error:
        return error, about


MAX_PAGES = 200
"""Pairs of which each has a page; of more those have one that do not pass."""

IN_GROUP = "not in the baseline: judged in its group alone"


def _updated(
    gate: GateOptions,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    baseline: Baseline | None,
    evaluated: Evaluate,
    whence: str,
) -> Report:
    """Renew the entries of all pairs, or of those that are named; all of these or none."""
    chosen = [pair for pair in pairs if gate.chosen(pair.name)]
    faults = [
        pair.fault if gate.suite else f"{pair.name}: {pair.fault}" for pair in chosen if pair.fault
    ]
    if faults:
        raise InputError(*faults)
    old = baseline or {}
    for pattern in gate.only:
        if not any(fnmatchcase(name, pattern) for name in (*(pair.name for pair in pairs), *old)):
            raise ConfigError(f"{option('only')} {quoted(pattern)}: no pair is called so")
    new, outcomes = dict(old), []
    for pair, (row, options) in zip(chosen, evaluated(chosen, old), strict=True):
        now, about = _measured(row)
        before = old.get(pair.name)
        try:
            if isinstance(now, TgospaError):
                raise now
            entry = make_entry(now, options, pair.labels)
            new[pair.name] = with_nights(entry, before) if gate.add else entry
        except TgospaError as error:
            raise type(error)(f"{gate.prefix(pair)}{error}") from None
        outcomes.append(updated_outcome(pair, before, new[pair.name], now, **about))
    names = {pair.name for pair in pairs}
    gone = [name for name in old if name not in names and gate.chosen(name)]
    for name in gone if gate.prune else ():
        del new[name]
    if new != old or not os.path.exists(path):
        write_file(path, dump(new), option("baseline"))
    note = "removed" if gate.prune else f"kept; {option('prune')} removes it"
    outcomes += leftover(old, {*old} - {*gone}, Verdict.UPDATED, f"not in {whence}: {note}")
    changed = sum(new[name] != old.get(name) for name in new)
    tally = {"updated": changed, "unchanged": len(new) - changed, "removed": len({*old} - {*new})}
    return Report(
        baseline=path,
        outcomes=tuple(outcomes),
        version=__version__,
        tally=tally,
        notices=tuple(_few_runs(pairs, groups, new)),
    )


def _pairs(
    gate: GateOptions,
    truth: str | None,
    estimate: str | None,
    notify: Callable[[str], None],
    target: Target | None,
) -> tuple[list[Job], list[GroupTable], str | None]:
    """The pairs, one of two files or those of a suite; groups and the baseline of the suite."""
    path = gate.suite
    if truth is not None and estimate is not None:
        if path and gate.sources["suite"] == "commandline":
            raise ConfigError(f"give TRUTH ESTIMATE or {option('suite')}, not both")
        return [Job(name=ONLY_PAIR, truth=truth, estimate=estimate)], [], None
    if truth is not None or not path:
        name = "TRUTH" if truth is None else "ESTIMATE"
        raise ConfigError(
            f"{name} is missing; type tgospa-eval gate {truth or 'TRUTH'} ESTIMATE "
            "--baseline FILE, or tgospa-eval gate --suite FILE"
        )
    pairs, groups, baseline, notices = load_suite(path, FLAGS, target)
    for text in () if gate.quiet else notices:
        notify(text)
    return pairs, groups, baseline


def _evaluated(
    gate: GateOptions,
    pairs: Sequence[Job],
    old: Baseline,
    path: str,
    groups: Sequence[GroupTable],
    notify: Callable[[str], None],
    run: Run | None,
) -> Iterator[Evaluated]:
    """Pairs of files, read and evaluated, by processes where that takes long."""
    given: dict[str, dict[str, object]] = {}
    tasks: list[JobTask] = []
    waiting: dict[str, Row] = {}
    prefixes = {"": ""} | {pair.name: gate.prefix(pair) for pair in pairs}

    def say(name: str, text: str) -> None:
        notify(prefixes[name] + text)

    for pair in pairs:
        try:
            given[pair.name] = gate.resolve(pair, old.get(pair.name), path)
            tasks.append(_task(gate, pair, given[pair.name], groups))
        except TgospaError as error:
            waiting[pair.name] = {"error": error, "lines": ()}
    rows = judged_rows(tasks, say, run)
    keys = {name: key for key, name in NAMES.items()}
    for pair in pairs:
        while pair.name not in waiting:
            row = next(rows)
            waiting[row["name"]] = row
        row = waiting.pop(pair.name)
        for text in row["lines"]:
            say(pair.name, text)
        if "error" in row:
            yield row, {}
            continue
        # Settings of a solver that did not reach its accuracy are left out: a later run would
        # inherit them.
        recorded = {
            keys[name]: value
            for name, value in given[pair.name].items()
            if keys[name] not in WITHOUT_EFFECT and value not in (None, ())
            if row["status"] == "done" or keys[name] not in ACCURACY_KEYS
        }
        yield row, _portable(recorded | _chosen_by_data(row), path)


def _chosen_by_data(row: Row) -> dict[str, object]:
    """Options that a baseline has in any case, those that follow from the data included."""
    recorded = row["parameters"]
    parameters = json.loads(recorded) if isinstance(recorded, str) else recorded
    period = {"period": str(parameters["period"])} if "period" in parameters else {}
    return {"cutoff": row["cutoff"], "switch-penalty": row["switch_penalty"], **period}


def _task(
    gate: GateOptions,
    pair: Job,
    given: Mapping[str, object],
    groups: Sequence[GroupTable],
) -> JobTask:
    """The task of a pair with these options."""
    rules = [*gate.rules(pair, default=False), *(rule for table in groups for rule in table.rules)]
    nees = {"with_": NEES} if any(rule.path in OF_NEES for rule in rules) else {}
    folder = None
    if gate.proof is not None:
        from tgospa_eval.show.files import folder_name  # here: few ask for proofs

        of = "baseline" if gate.update_baseline else "run"
        folder = os.path.join(gate.proof, of, *([folder_name(pair.name)] if gate.suite else []))
    options = Request.of({**given, **nees})
    if options.outage == "none" and any(rule.absolute for rule in rules):
        raise ConfigError(
            f"{gate.prefix(pair)}{option('outage', 'none')}: limits of a gate are for all that a "
            "tracker had to report, and its silences are not charged; leave it out, or "
            f"{option('limits')}"
        )
    return JobTask(
        job=pair,
        options=options,
        folder=folder,
        page=gate.output is not None,
        quiet=gate.quiet,
        verbose=gate.verbose,
    )


def _portable(options: Mapping[str, object], path: str) -> dict[str, object]:
    """Options as a baseline records them: lists as texts, paths relative to its folder.

    From another drive there is no path but the whole.
    """
    found = {
        key: ",".join(map(str, value)) if isinstance(value, (list, tuple)) else value
        for key, value in options.items()
    }
    for key in (key for key in PATHS_GIVEN if key in found):
        try:
            relative = os.path.relpath(str(found[key]), os.path.dirname(path) or os.curdir)
            found[key] = relative.replace(os.sep, "/")
        except ValueError:
            found[key] = os.path.abspath(str(found[key]))
    return found


# -------------------------------------------------------------------------------------------------
# Stores of batches.


def is_store(path: str | None) -> bool:
    """Whether it is the folder of a batch."""
    return path is not None and os.path.isfile(os.path.join(path, SETTINGS_FILE))


def load_baseline(path: str, renewed: Callable[[str], bool] | None = None) -> Baseline | None:
    """A baseline from a file, or from the jobs of a store that have a value; None without it.

    `renewed` says which entries are made anew: these may be in conflict.

    Raises
    ------
    ConfigError, InputError
        It cannot be read, or is no baseline of this version.
    """
    if not is_store(path):
        return load(path, renewed)
    settings = _store_options(path)
    return {
        name: make_entry(measured(row), _row_options(row, settings, path), labels_of(row))
        for name, row in _store_rows(path).items()
        if row["status"] != "failed"
    }


def _stores(gate: GateOptions, first: str, second: str | None) -> tuple[str, str | None]:
    """The store that is judged, and the baseline.

    Raises
    ------
    ConfigError
        An option is given that is for evaluating, or the baseline twice.
    """
    typed = [key for key, name in NAMES.items() if gate.sources[name] == "commandline"]
    if gate.proof:
        typed.append("proof")
    if typed:
        raise ConfigError(
            f"{option(typed[0])}: stores are compared as they are, nothing is evaluated"
        )
    if gate.sources["suite"] == "commandline":
        raise ConfigError(f"give a store or {option('suite')}, not both")
    if second is None:
        return first, gate.baseline
    if gate.strong("baseline"):
        raise ConfigError(
            "name the baseline once: OLD_STORE NEW_STORE, or STORE "
            f"{option('baseline', metavar='FILE')}"
        )
    if not is_store(second):
        raise ConfigError(f"{second}: holds no batch, and {first} does; name two stores or one")
    return second, first


def _store_rows(folder: str) -> dict[str, Row]:
    """The rows of a store by the names of their jobs, as in ``careful/SIM-01 cutoff=5``.

    Raises
    ------
    InputError
        It cannot be read, or has no rows.
    """
    store = Store(folder)
    store.settings()
    table = store.rows()
    if not len(table):
        raise InputError(f"{folder}: no job of this batch is done")
    rows: dict[str, Row] = {}
    for values in table.to_dict("records"):
        name = job_name(values)
        if name in rows:
            raise InputError(f"{folder}: two jobs are called {quoted(name)}; rename a label")
        rows[name] = {str(column): value for column, value in values.items()}
    return rows


def _store_options(folder: str) -> dict[str, object]:
    """Options of all jobs of a store, by their names in a configuration file.

    Raises
    ------
    InputError
        It holds no batch, or an option is none of ours.
    """
    keys = {name: key for key, name in NAMES.items()}
    options = Store(folder).settings()["options"]
    unknown = next((name for name in options if name not in keys), None)
    if unknown is not None:
        path = os.path.join(folder, SETTINGS_FILE)
        raise InputError(f"{path}: options.{unknown}: is no option; make it anew with batch")
    return {keys[name]: value for name, value in options.items()}


def _row_options(row: Row, of_all: Mapping[str, object], path: str) -> dict[str, object]:
    """Options of a job as a baseline records them, by their names in a configuration file."""
    own = {key.replace("_", "-"): value for key, value in json.loads(row["options"]).items()}
    return _portable({**of_all, **own, **_chosen_by_data(row)}, path)


# -------------------------------------------------------------------------------------------------
# ``gate`` of Python.

INHERITED = {key: name for key, name in KEYWORDS.items() if name in OF_THE_NUMBER}
"""Keywords by the names of their options, as a baseline has these."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GateResult:
    """What `gate` found; true if it passed, printed it is the table of the command.

    Parameters
    ----------
    report : Report
        Verdict, findings and notes.
    result : Result, optional
        The evaluation that was judged; of a suite there are many, and none is kept.
    """

    report: Report
    result: "Result | None" = None

    @property
    def verdict(self) -> str:
        """``"pass"``, ``"fail"``, ``"undecided"``, ``"not comparable"`` or ``"updated"``."""
        return str(self.report.verdict)

    @property
    def passed(self) -> bool:
        """Whether it is proven that all rules hold, or the baseline was made."""
        return self.report.status == 0

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: reasons, remedies."""
        return tuple(note for outcome in self.report.outcomes for note in outcome.notes)

    @cached_property
    def findings(self) -> "pd.DataFrame":
        """A row for each rule: value, limit, verdict; of a suite of each pair and group."""
        import pandas as pd  # here: slow to import

        records = [
            {**({} if self.result else {"pair": outcome.name}), **finding_record(finding)}
            for outcome in self.report.outcomes
            for finding in outcome.findings
        ]
        table = pd.DataFrame(records)
        return table.rename(columns={"lower": "lower_bound", "upper": "upper_bound"})

    def __bool__(self) -> bool:
        if not self.passed and "PYTEST_CURRENT_TEST" in os.environ:
            sys.stdout.write(f"{self}\n")  # of which `assert` shows one line
        return self.passed

    def __str__(self) -> str:
        return GATE_REPORTS["table"](self.report).rstrip("\n")

    __repr__ = __str__


@with_options()
def gate(
    truth: "TrajectoriesLike | None" = None,
    estimate: "TrajectoriesLike | None" = None,
    baseline: "str | os.PathLike[str] | None" = None,
    *,
    suite: "str | os.PathLike[str] | None" = None,
    against: str | None = None,
    newer_than: "str | os.PathLike[str] | None" = None,
    fail_on: str | Iterable[str] = (),
    warn_on: str | Iterable[str] = (),
    limits: Mapping[str, float] | None = None,
    group: str | None = None,
    confidence: float | None = None,
    seed_label: str | None = None,
    update_baseline: bool = False,
    add: bool = False,
    only: str | Iterable[str] = (),
    prune: bool = False,
    strict: bool = False,
    **options: Any,
) -> GateResult:
    """Judge an estimate against a baseline, as ``tgospa-eval gate`` does.

    It fails only if the proven lower bound breaks a rule, and passes only if the proven upper bound
    keeps it.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    baseline : str or path, optional
        The JSON file that an update makes; the command reads and makes the same. A suite may name
        its own.
    suite : str or path, optional
        TOML file that lists several pairs of files, instead of `truth` and `estimate`.
    against : str, optional
        Git revision or folder whose suite, baseline, truths and configuration judge.
    newer_than : str or path, optional
        A file or a time; estimates of a suite that are older fail.
    fail_on : str or iterable of str
        Rules, ``"total:+2%"`` or ``"nees:1.5..2.5"``; ``"total:+0.001%"`` by default.
    warn_on : str or iterable of str
        Rules that only warn.
    limits : mapping of str to float, optional
        Largest values that do not depend on the baseline: ``{"tgospa": 50.0}``.
    group : str, optional
        Labels of a suite by which pairs are added up, and the sums judged: ``"scenario"``.
    confidence : float, optional
        Of conclusions from runs with other seeds; 0.97 by default.
    seed_label : str, optional
        Label in which the runs of one scene differ; ``"seed"`` by default.
    update_baseline : bool
        Whether to make the baseline, or to replace it, instead.
    add : bool
        Whether an update keeps what the baseline has: the limit is then judged against the mean of
        up to 10 nights.
    only : str or iterable of str
        Patterns of the pairs of a suite whose entries an update renews.
    prune : bool
        Whether an update removes entries of pairs that the suite no longer has.
    strict : bool
        Whether a group above its limit fails although its seeds may be the reason.

    An option that is not given is that of the baseline or the suite, and else as for `evaluate`.
    Options of a suite are texts and numbers: no records, matrices or tables.

    Returns
    -------
    GateResult
        True if it passed; `GateResult.verdict`, `GateResult.findings`, `GateResult.result`.

    Raises
    ------
    ConfigError, InputError
        As for `evaluate`; a rule is wrong, or the baseline or the suite cannot be read.
    TypeError
        Neither two sides and a baseline nor a suite are given.
    """
    judge_by = GateOptions(
        suite=None if suite is None else os.fspath(suite),
        baseline=None if baseline is None else os.fspath(baseline),
        against=against,
        newer_than=None if newer_than is None else os.fspath(newer_than),
        update_baseline=update_baseline,
        add=add,
        strict=strict,
        fail_on=tuple(_texts(fail_on)),
        warn_on=tuple(_texts(warn_on)),
        maximum=tuple(f"{name}={value!r}" for name, value in (limits or {}).items()),
        group=group,
        confidence=confidence,
        seed_label=seed_label,
        only=(only,) if isinstance(only, str) else tuple(only),
        prune=prune,
        quiet=True,
    )
    if suite is not None and truth is None and estimate is None:
        return _gate_of_suite(judge_by, options)
    if truth is None or estimate is None or baseline is None or suite is not None:
        raise TypeError("gate() takes truth, estimate and baseline; or suite")
    for name in ("against", "newer_than", "group", "confidence", "seed_label", "only", "prune"):
        if getattr(judge_by, name) not in (None, (), False):
            raise ConfigError(f"{option(name)} is for suites")
    path = str(judge_by.baseline)
    old = load(path, judge_by.renewed)
    if old and ONLY_PAIR not in old:
        raise ConfigError(f"{path}: is the baseline of a suite ({', '.join(old)}); name another")
    pair = Job(name=ONLY_PAIR, truth=_called(truth, "truth"), estimate=_called(estimate, ""))
    judge_by.rules(pair)  # wrong ones before any work
    kept = old[ONLY_PAIR]["options"] if old else {}
    inherited = {name: kept[key] for key, name in INHERITED.items() if key in kept}
    given: dict[str, Any] = {**inherited, **options}
    result = evaluate(truth, estimate, **given)
    plain = {key: given.get(name) for key, name in INHERITED.items()}
    row = row_to_judge(result)
    measured(row)  # raises at once what a report would say
    recorded = {
        **{key: value for key, value in plain.items() if isinstance(value, (str, float, int))},
        **_chosen_by_data(row),
    }
    report = _report(
        judge_by,
        [pair],
        [],
        path,
        old,
        lambda pairs, _: ((row, recorded) for _ in pairs),
        "",
    )
    return GateResult(report=report, result=result)


def _gate_of_suite(judge_by: GateOptions, options: Mapping[str, Any]) -> GateResult:
    """Judge a suite by options that are texts and numbers, as those of a batch."""
    given = {name: value for name, value in options.items() if value is not None}
    values = typed({SETTINGS[name].key: value for name, value in given.items()}, "gate")
    named = ("baseline", "suite", *RULE_PARAMETERS.values())
    chosen = {name for name in named if getattr(judge_by, name)}
    sources = dict.fromkeys(NAMES.values(), "default")
    sources |= dict.fromkeys({*chosen, *given}, "commandline")
    judge_by = replace(judge_by, evaluation=Request.of(values), sources=sources)
    warnings: list[str] = []
    report = judge_all(judge_by, None, None, warnings.append)
    warn_user([Notice(text=text) for text in warnings])
    return GateResult(report=report)


def _texts(given: str | Iterable[str]) -> list[str]:
    """The rules of a text, or of several."""
    texts = [given] if isinstance(given, str) else given
    return [part for text in texts for part in split_rules(text) or [text]]


def _called(side: object, otherwise: str) -> str:
    """The path of a file."""
    return os.fspath(side) if isinstance(side, (str, os.PathLike)) else otherwise
