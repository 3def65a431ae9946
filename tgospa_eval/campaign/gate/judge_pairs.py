"""Judgement of rows by the rules of a gate, or an update of the baseline from these rows."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from fnmatch import fnmatchcase
from typing import Any

from tgospa_eval._version import __version__
from tgospa_eval.campaign.gate.baseline import (
    Baseline,
    Measured,
    dump,
    in_conflict,
    make_entry,
    measured,
    nights_of,
    with_nights,
)
from tgospa_eval.campaign.gate.groups import copied_runs, few_runs, judge_groups
from tgospa_eval.campaign.gate.options import GateOptions
from tgospa_eval.campaign.gate.outcome import (
    PairOutcome,
    Report,
    accepting_options,
    evaluated_outcome,
    leftover,
    of_its_runs,
    updated_outcome,
    without_option,
)
from tgospa_eval.campaign.gate.rules import Rule, Verdict, parse_rules
from tgospa_eval.campaign.gate.suite import ONLY_PAIR, SEED, GroupTable, check_labels, make_group
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.campaign.row import Row
from tgospa_eval.campaign.store import is_store
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.writing import write_file
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.quoting import listed, option, quoted

RULE_PARAMETERS = {"fail-on": "fail_on", "warn-on": "warn_on", "max": "maximum"}
"""Parameters with rules, by their keys in a suite."""

Evaluated = tuple[Row, Mapping[str, object]]
"""The row of a pair, and the options that made it."""

Evaluate = Callable[[Sequence[Job], Baseline], Iterator[Evaluated]]
"""Callable that evaluates jobs and yields their rows in order.

Options that are not given come from the baseline.
"""


def tables_of(
    gate: GateOptions, pairs: Sequence[Job], groups: Sequence[GroupTable]
) -> list[GroupTable]:
    """Return the groups of a suite, or the group that the options of the command line define.

    Raises
    ------
    ConfigError
        An option needs groups, or a group is wrong.
    """
    labels = {label for pair in pairs for label in pair.labels}
    if gate.group is None:
        for one in groups if gate.seed_label else ():
            where = option("seed_label", gate.seed_label)
            check_labels(one.name, str(gate.seed_label), labels, where)
        for name, value in (("confidence", gate.confidence), ("seed_label", gate.seed_label)):
            if value is not None and not groups:
                raise ConfigError(
                    f"{option(name)} is for {option('group')}, or a suite with [[group]]"
                )
        return [
            replace(
                one,
                confidence=gate.confidence or one.confidence,
                seed=gate.seed_label or one.seed,
            )
            for one in groups
        ]
    names = [name.strip() for name in gate.group.split(",")]
    pattern = "all" if names == ["all"] else "/".join(f"{{{name}}}" for name in names)
    texts = [getattr(gate, name) for name in RULE_PARAMETERS.values()]
    seed, confidence = gate.seed_label or SEED, gate.confidence or GroupTable.confidence
    return [make_group(pattern, texts, confidence, seed, labels, option("group", gate.group))]


def rules_of(
    gate: GateOptions, pair: Job, *, baseline: bool = True, default: bool = True
) -> list[Rule]:
    """Return the rules of a pair.

    With `default` and a baseline, the default rule applies if no rule ``fail-on`` is given.

    Raises
    ------
    ConfigError
        A rule is wrong, or a needed baseline is missing. With `default`, a baseline is needed if a
        rule compares with it, or if no rule is given.
    """
    own = {key: getattr(gate, name) for key, name in RULE_PARAMETERS.items()}
    suite = {key: pair.rules.get(key, ()) for key in own}
    is_own = own["fail-on"] and (gate.strong("fail_on") or not suite["fail-on"])
    rules = parse_rules(
        (own if is_own else suite)["fail-on"],
        (*suite["warn-on"], *own["warn-on"]),
        (*suite["max"], *own["max"]),
        default=baseline and default,
    )
    relative = [rule for rule in rules if not rule.absolute]
    if not baseline and (relative or not rules) and default:
        why = (
            f"{relative[0].text} needs one"
            if relative
            else f"{option('update_baseline')} makes this file; a fixed limit ({option('limits')}) "
            "needs no baseline"
        )
        raise ConfigError(
            f"{gate.prefix(pair.name)}no baseline: give one with "
            f"{option('baseline', metavar='FILE')}; {why}"
        )
    return rules


class OverInputError(ConfigError):
    """The JUnit report would overwrite an input."""


def check_junit(gate: GateOptions, *paths: str | None) -> None:
    """Check that the JUnit report does not overwrite an input.

    Raises
    ------
    OverInputError
        The report is one of these files, the suite, the baseline or the configuration file.
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
    """Check that an update has a file to write, and that its options are given only for an update.

    Raises
    ------
    ConfigError
        An option is only for updates, or the update has no file to write.
    """
    for name, value in (("only", gate.only), ("prune", gate.prune), ("add", gate.add)):
        if value and not gate.update_baseline:
            raise ConfigError(f"{option(name)} is for {option('update_baseline')}")
    if gate.update_baseline and (not path or is_store(path)):
        wrong = f"{path} is a batch, made by tgospa-eval batch" if path else "no baseline"
        raise ConfigError(f"{wrong}: give the file to write, {option('baseline', metavar='FILE')}")


def with_stale(pairs: Iterable[Job], since: str) -> Iterator[Job]:
    """Yield all pairs; a pair gets a fault if its estimate is older than the file or time `since`.

    Raises
    ------
    ConfigError
        `since` is neither a file nor a time.
    """
    try:
        exists = os.path.exists(since)
        oldest = os.path.getmtime(since) if exists else datetime.fromisoformat(since).timestamp()
    except ValueError:
        raise ConfigError(
            f"{option('newer_than')} {quoted(since)}: must be a file or a time, such as "
            "2026-11-28T06:00"
        ) from None
    for pair in pairs:
        files = files_at(file_of(pair.estimate))
        written = max(
            (os.path.getmtime(file) for file in files if os.path.exists(file)), default=oldest
        )
        if written < oldest and not pair.fault:
            times = (str(datetime.fromtimestamp(one)) for one in (written, oldest))
            fault = "{}: was written {}, before {}: did the tracker run?".format(
                pair.estimate, *times
            )
            pair = replace(pair, fault=fault, fault_is=Verdict.FAIL)
        yield pair


def judge_pairs(
    gate: GateOptions,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    old: Baseline | None,
    evaluated: Evaluate,
    source: str,
) -> Report:
    """Judge all groups and pairs, or update the baseline, and return a report.

    `path` is the path of the baseline, blank without a baseline. `old` has the entries of the
    baseline, if the file exists. `source` says in messages where the pairs come from.
    """
    _check_options(gate, path)
    groups = tables_of(gate, pairs, groups)
    if gate.group is not None:  # with --group, these rules judge only groups
        gate = replace(gate, fail_on=(), warn_on=(), maximum=())
    single = {pair.name for pair in pairs} == {ONLY_PAIR} and not gate.suite
    if single and old and ONLY_PAIR not in old:
        raise ConfigError(
            f"{path}: is the baseline of a suite ({', '.join(old)}); "
            f"give {option('suite', metavar='FILE')}"
        )
    if groups and not path:
        raise ConfigError(
            f"no baseline: give one with {option('baseline', metavar='FILE')}; groups need one"
        )
    rules = {
        pair.name: [replace(rule, warns=True) for rule in rules_of_pair if rule.absolute]
        if pair.is_new
        else rules_of_pair
        for pair in pairs
        if not pair.fault
        for rules_of_pair in [rules_of(gate, pair, baseline=bool(path), default=not groups)]
    }  # all rules are parsed before any evaluation, so that wrong rules fail early
    if gate.update_baseline:
        return _updated(gate, pairs, groups, path, old, evaluated, source)
    outcomes = _judge_all(pairs, groups, path, old, rules, evaluated, source, strict=gate.strict)
    can_accept = gate.typed and path and not is_store(path)
    accepted = accepting_options(outcomes, groups, pairs, old or {}) if can_accept else []
    return Report(
        baseline=path,
        outcomes=tuple(outcomes),
        version=__version__,
        again=_again(gate, accepted) if accepted else (),
        against=gate.against or "",
        notices=tuple(_few_runs(pairs, groups, {})) if old is None else (),
    )


def _again(gate: GateOptions, accepted: Sequence[str]) -> tuple[str, ...]:
    """Return the typed command with the options that accept the failed pairs."""
    command = without_option(gate.typed, "--against")
    at = command.index("--") if "--" in command else len(command)
    # pre-commit installs the program outside of the PATH, so the interpreter is named instead.
    from_hook = "PRE_COMMIT" in os.environ
    program = (sys.executable, "-m", "tgospa_eval") if from_hook else ("tgospa-eval",)
    return (*program, "gate", *command[:at], *accepted, *command[at:])


def _few_runs(pairs: Sequence[Job], groups: Sequence[GroupTable], baseline: Baseline) -> list[str]:
    """Return notes about groups with too few runs for the statistical test."""
    nights = min((len(nights_of(entry)) for entry in baseline.values()), default=1)
    return few_runs(groups, {pair.name: pair.labels for pair in pairs}, nights)


def _judge_all(
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    baseline: Baseline | None,
    rules: Mapping[str, list[Rule]],
    evaluated: Evaluate,
    source: str,
    *,
    strict: bool,
) -> list[PairOutcome]:
    """Return the outcomes of all groups and pairs; a wrong file does not stop the other pairs."""
    missing = f"not in {path}"
    if baseline is None:
        missing = f"the baseline {path} does not exist; {option('update_baseline')} makes it"
    old = baseline or {}
    labels = {name: entry.get("labels", {}) for name, entry in old.items()}
    labels |= {pair.name: pair.labels for pair in pairs}
    results: dict[str, Measured] = {}
    outcomes: dict[str, PairOutcome] = {}
    chosen: list[Job] = []
    wrong: list[ConfigError] = []
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
        if isinstance(now, TgospaError):
            wrong += [now] if isinstance(now, ConfigError) else []
            about = {"status": now.exit_status, **about}
            outcome = PairOutcome.of(pair, Verdict.ERROR, *map(str, now.args), **about)
        else:
            noisy = any(table.seed in pair.labels for table in tables[pair.name])
            entry, own = old.get(pair.name), rules[pair.name]
            in_group = path and entry is None and not pair.is_new
            own = [rule for rule in own if rule.absolute] if in_group else own
            outcome = evaluated_outcome(pair, now, entry, own, noisy=noisy, **about)
            if in_group:
                outcome = replace(outcome, notes=(*outcome.notes, IN_GROUP))
            if pair.is_new:
                note = "new, not judged: the target does not have it yet; limits of "
                note += f"{option('limits')} only warn"
                outcome = replace(outcome, verdict=Verdict.NEW, notes=(*outcome.notes, note))
            in_group = pair.in_scene or not pair.is_new
            results |= {pair.name: replace(now, is_new=pair.is_new)} if in_group else {}
        hidden = len(pairs) > MAX_PAGES and not outcome.status
        outcomes[pair.name] = replace(outcome, page="") if hidden else outcome
    if len(wrong) == len(pairs) > 1 and len({*map(str, wrong)}) == 1:
        raise wrong[0]  # all pairs have the same error: an option is wrong
    in_order = [outcomes[pair.name] for pair in pairs]
    if baseline is not None:
        failed = [one.name for one in in_order if one.verdict is Verdict.ERROR]
        failed += [pair.name for pair in pairs if pair.fault and pair.name not in failed]
        added = judge_groups(groups, results, old, labels, failed, strict=strict)
        first = (of_its_runs(one, groups, labels, results, old) for one in added[:MAX_PAGES])
        in_order = [*first, *added[MAX_PAGES:], *in_order]
    named = {name for name in old if any(table.has(labels[name]) for table in groups)}
    named |= {pair.name for pair in pairs}
    note = f"in the baseline, but not in {source}"
    if not is_store(path) and not any(one.verdict is Verdict.ERROR for one in in_order):
        note += f"; {option('update_baseline')} {option('prune')} removes it"
    return in_order + leftover(old, named, Verdict.INCOMPARABLE, note)


def _measured(row: Row) -> tuple[Measured | TgospaError, dict[str, Any]]:
    """Return two results: the values of a row or its error, and further fields of its outcome."""
    about: dict[str, Any] = {name: row[name] for name in ("seconds", "page") if name in row}
    if "error" in row:
        return row["error"], about
    about["warnings"] = tuple(Notice(**record) for record in json.loads(row["warnings"]))
    try:
        return measured(row), about
    except TgospaError as error:
        return error, about


MAX_PAGES = 200
"""Largest number of pairs for which each pair has a page; with more, passing pairs have none."""

DEAD = (
    "this night raises the limits, but such a run still fails: it found objects in another night",
    "a baseline with a dead run allows such a run again, and raises the limits",
)
"""Effect of a dead run on the baseline: if it lived in another night, or in none."""

IN_GROUP = "not in the baseline: only its group and rules of 'max' judge it"


def _updated(
    gate: GateOptions,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    path: str,
    baseline: Baseline | None,
    evaluated: Evaluate,
    source: str,
) -> Report:
    """Renew the entries of all pairs, or of those chosen by ``--only``.

    After an error, no entry is written.
    """
    chosen = [pair for pair in pairs if gate.chosen(pair.name)]
    faults = [
        pair.fault if gate.suite else f"{pair.name}: {pair.fault}" for pair in chosen if pair.fault
    ]
    if faults:
        raise InputError(*faults)
    old = baseline or {}
    for pattern in gate.only:
        if not any(fnmatchcase(name, pattern) for name in (*(pair.name for pair in pairs), *old)):
            raise ConfigError(f"{option('only')} {quoted(pattern)}: no pair has such a name")
    new, outcomes, dead = dict(old), list[PairOutcome](), dict[str, list[str]]()
    results = dict[str, Measured]()
    for pair, (row, options) in zip(chosen, evaluated(chosen, old), strict=True):
        now, about = _measured(row)
        before = old.get(pair.name)
        try:
            if isinstance(now, TgospaError):
                raise now
            entry = make_entry(now, options, pair.labels)
            new[pair.name] = with_nights(entry, before) if gate.add else entry
        except TgospaError as error:
            lines = (f"{gate.prefix(pair.name)}{line}" for line in error.args)
            raise type(error)(*lines) from None
        results[pair.name] = now
        outcomes.append(updated_outcome(pair, before, new[pair.name], now, **about))
        states, nights = now.evaluated_on["truth_states"], nights_of(new[pair.name])
        if now.values["counts.missed"].lower >= states > 0:
            ever = all(night["counts"]["missed"] >= states for night in nights)
            dead.setdefault(DEAD[ever], []).append(pair.name)
    names = {pair.name for pair in pairs}
    gone = [name for name in old if name not in names and gate.chosen(name)]
    for name in gone if gate.prune else ():
        del new[name]
    merged = os.path.exists(path) and in_conflict(path)
    if new != old or not os.path.exists(path) or merged:
        write_file(path, dump(new), option("baseline"))
    note = "removed" if gate.prune else f"kept; {option('prune')} removes it"
    outcomes += leftover(old, {*old} - {*gone}, Verdict.UPDATED, f"not in {source}: {note}")
    changed = sum(new[name] != old.get(name) for name in new)
    tally = {"updated": changed, "unchanged": len(new) - changed, "removed": len({*old} - {*new})}
    empty = [
        f"{listed(names, 5)}: misses all ground-truth states: {effect}; check the estimate before "
        "you commit the baseline"
        for effect, names in dead.items()
    ]
    return Report(
        baseline=path,
        outcomes=tuple(outcomes),
        version=__version__,
        tally=tally,
        notices=(
            *([f"{path}: the merge conflict is resolved by new entries"] if merged else ()),
            *empty,
            *copied_runs(groups, results, new, {pair.name: pair.labels for pair in pairs}),
            *_few_runs(pairs, groups, new),
        ),
    )
