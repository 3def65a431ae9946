"""``gate``: judges an estimate, a suite of pairs or the store of a batch by a baseline."""

import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.batch_row import JobTask, Run, gate_rows
from tgospa_eval.api.evaluate import evaluate
from tgospa_eval.api.keywords import KEYWORDS, each, with_options
from tgospa_eval.api.options import (
    FLAGS,
    NAMES,
    OF_THE_NUMBER,
    OPTION_SPECS,
    Request,
    names_file,
    typed,
)
from tgospa_eval.campaign.gate import judge_pairs
from tgospa_eval.campaign.gate.baseline import (
    CHANGED,
    Baseline,
    load,
    make_entry,
    measured,
    parse,
)
from tgospa_eval.campaign.gate.options import GateOptions
from tgospa_eval.campaign.gate.outcome import Report
from tgospa_eval.campaign.gate.report import GATE_REPORTS, finding_record, title
from tgospa_eval.campaign.gate.rules import OF_NEES, Verdict
from tgospa_eval.campaign.gate.suite import (
    ONLY_PAIR,
    GroupTable,
    Target,
    last_change,
    load_suite,
)
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.campaign.row import Row, job_name, labels_of, row_to_judge
from tgospa_eval.campaign.store import REST, SETTINGS_FILE, Store, is_store
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.formats.objects import TrajectoriesLike
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import Json
from tgospa_eval.results.saved import ACCURACY

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd

    from tgospa_eval.api.option_types import GateEvaluationOptions
    from tgospa_eval.api.result import Result


def resolve(gate: GateOptions, pair: Job, entry: Json | None, path: str) -> dict[str, object]:
    """Return the options that are given for a pair, by the names of the fields of `Request`.

    There are four sources, and later ones have priority:

    1. the `entry` of the baseline at `path`
    2. the settings file
    3. the suite
    4. the command line and the environment
    """
    return {
        **typed(_inherited(entry, path), f"{path}, options"),
        **gate.given("default_map"),
        **typed(pair.options, f"pair {quoted(pair.name)}, options"),
        **gate.given("commandline", "environment"),
    }


def _inherited(entry: Json | None, path: str) -> dict[str, object]:
    """Return the options of an `entry` of the baseline at `path`, with paths from here."""
    options = dict(entry["options"]) if entry else {}
    for key in _naming_files(options):
        options[key] = os.path.join(os.path.dirname(path), str(options[key]))
    return options


# -------------------------------------------------------------------------------------------------
# Judging of pairs of files, suites and stores, and writing of their baselines.


def judge_all(
    gate: GateOptions,
    truth: str | None,
    estimate: str | None,
    notify: Callable[[str], None],
    run: Run | None = None,
) -> Report:
    """Judge a pair of files, the pairs of a suite or the jobs of a store.

    With ``--update-baseline``, write the baseline instead. The jobs of a store are not solved
    again: their proven bounds are compared.

    Parameters
    ----------
    gate : GateOptions
        Options of the gate, such as rules and baseline.
    truth, estimate : str, optional
        One of the following:

        - two files: the pair to judge
        - two stores: `estimate` is judged, and `truth` is its baseline
        - only `truth`: the store to judge
        - neither: the suite is judged
    notify : callable
        Function that receives each line for the user.
    run : callable, optional
        Function that runs an evaluation in this process, and for example shows its progress.

    Raises
    ------
    TgospaError
        Nothing can be judged.
    """
    judge_pairs.check_junit(gate, truth, estimate)
    if truth is not None and is_store(truth):
        return _said(_judge_store(gate, truth, estimate), notify, stored=True)
    if gate.against is not None and gate.update_baseline:
        raise ConfigError(
            f"{option('against')} and {option('update_baseline')}: leave one of them out"
        )
    target = None if gate.against is None else Target(gate.against)
    pairs, groups, named = _pairs(gate, truth, estimate, notify, target)
    if truth is not None:
        gate = replace(gate, suite=None)
    for pair in pairs:
        judge_pairs.check_junit(gate, pair.truth, pair.estimate, named)
    path = (gate.baseline if gate.strong("baseline") or not named else named) or ""
    if target is None:
        old = _renamed(load_baseline(path, gate.renewed), pairs, is_store(path)) if path else None
    else:
        old = _renamed(parse(target.demand(path), target.name(path)), pairs) if path else None
        pairs = [*_with_faults(gate, target, pairs, groups, old, path)]
    if gate.newer_than is not None:
        pairs = [*judge_pairs.with_stale(pairs, gate.newer_than)]
    report = judge_pairs.judge_pairs(
        gate,
        pairs,
        groups,
        path,
        old,
        lambda pairs, old: _evaluated(gate, pairs, old, path, groups, notify, run),
        "the suite",
    )
    warned = _unfinished({path: len(Store(path).rows())}) if is_store(path) else []
    report = replace(report, notices=(*report.notices, *warned))
    return _said(_with_first_changes(gate, report, pairs, old or {}, path, target), notify)


def _said(report: Report, notify: Callable[[str], None], *, stored: bool = False) -> Report:
    """Print warnings about groups, stored jobs and the whole baseline, and return the report.

    All other warnings were printed during the evaluations. `stored` is true for jobs of a store.
    """
    for one in report.outcomes:
        for warning in one.warnings if stored or one.group else ():
            notify(f"{title(one)}: {warning}")
    for text in report.warnings:
        notify(text)
    return report


def _judge_store(gate: GateOptions, first: str, second: str | None) -> Report:
    """Judge the jobs of a store by those of another store, or by a baseline file.

    With two stores, `first` has the baseline and `second` is judged.
    """
    for name, value in (("against", gate.against), ("newer_than", gate.newer_than)):
        if value is not None:
            raise ConfigError(f"{option(name)} is for files and suites, not for stores")
    folder, baseline = _stores(gate, first, second)
    path = baseline or ""
    table = _stored(folder, path)
    done = {folder: len(table)} | ({first: len(Store(first).rows())} if second else {})
    warned = _unfinished(done)
    if warned and gate.update_baseline:
        raise InputError(warned[0].removeprefix("warning: "))
    pairs = [
        Job(
            name=name,
            truth=row["truth"],
            estimate=row["estimate"],
            fault=f"failed in {folder}: {row['message']}" if row["status"] == "failed" else "",
            labels=labels_of(row),
        )
        for name, (row, _) in table.items()
    ]
    old = _renamed(load_baseline(path), pairs, not gate.update_baseline) if path else None
    report = judge_pairs.judge_pairs(
        gate, pairs, [], path, old, lambda pairs, _: (table[pair.name] for pair in pairs), folder
    )
    return replace(report, notices=(*report.notices, *warned))


def _unfinished(done: Mapping[str, int]) -> list[str]:
    """Return a warning for each store of which not all jobs are done, from the numbers `done`."""
    texts = {name: Store(name).unfinished(count) for name, count in done.items()}
    return [f"warning: {name}: {text}; {REST}" for name, text in texts.items() if text]


def _with_first_changes(
    gate: GateOptions,
    report: Report,
    pairs: Sequence[Job],
    old: Baseline,
    path: str,
    target: Target | None,
) -> Report:
    """Add a note on each truth that changed: its first changed state.

    The earlier file of the truth is read from `target`, or else from git. If it is not there, no
    note is added. At most `MAX_CHANGES` truths are read.
    """
    there = {pair.name: pair for pair in pairs}
    outcomes = list(report.outcomes)
    changed = [
        place
        for place, one in enumerate(outcomes)
        if one.verdict is Verdict.INCOMPARABLE and one.name in there and not one.group
        if there[one.name].fault_is == one.verdict or CHANGED in " ".join(one.notes)
    ]
    for place in changed[:MAX_CHANGES]:
        one, pair = outcomes[place], there[outcomes[place].name]
        before = target or last_change(path)
        content = None if before is None else before.read(pair.truth)
        if before is None or content is None:
            continue
        with suppress(TgospaError):  # files that cannot be read are reported elsewhere
            text = _first_change(resolve(gate, pair, old.get(pair.name), path), pair, content)
            note = f"{text} (was -> is; since {before.where})"
            outcomes[place] = replace(one, notes=(*one.notes, note))
    return replace(report, outcomes=tuple(outcomes))


MAX_CHANGES = 10
"""Largest number of changed truths that get a note on their first changed state."""


def _first_change(options: Mapping[str, object], pair: Job, content: bytes) -> str:
    """Describe the first state in which the truth of a pair differs from its earlier content.

    `options` are those of the pair. `content` has the bytes of the earlier file.
    """
    from tempfile import TemporaryDirectory  # lazy: truths seldom change

    from tgospa_eval.api.evaluate import read_sides
    from tgospa_eval.api.resolve import resolve_request

    def states(truth: str) -> dict[tuple[float, str], tuple[str, list[float]]]:
        sides = read_sides(settings, truth, pair.estimate, Stopwatch(), lambda _: None)
        side = sides.fitted.given[0]
        rows = zip(side.step.tolist(), side.track.tolist(), side.state.tolist(), strict=True)
        return {
            (side.times[k].item(), str(side.ids[track])): (str(side.shown[k]), state)
            for k, track, state in rows
        }

    settings = resolve_request(Request.of(options))
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
            return f"first state that differs: {key[1]} at {when}: {' -> '.join(shown)}"
    return "no evaluated state differs"


def _with_faults(
    gate: GateOptions,
    target: Target,
    pairs: Sequence[Job],
    groups: Sequence[GroupTable],
    old: Baseline | None,
    path: str,
) -> Iterator[Job]:
    """Yield the pairs, with a fault if `target` has another truth, or another file of an option.

    `target` is the git revision or folder of ``--against``. Pairs that the baseline lacks are
    marked as new.
    """
    known, tables = old or {}, judge_pairs.tables_of(gate, pairs, groups)
    seeds = {table.seed for table in tables}

    def scene(labels: Mapping[str, str]) -> set[tuple[str, str]]:
        return {item for item in labels.items() if item[0] not in seeds}

    scenes = [scene(entry.get("labels", {})) for entry in known.values()]
    kept = [scene(pair.labels) for pair in pairs if pair.name in known]
    for pair in pairs:
        options = resolve(gate, pair, known.get(pair.name), path)
        named = [value for name, value in options.items() if value and names_file(name, value)]
        files = [pair.truth, *map(str, named)]
        other = [file for file in files if target.has_another(file)]
        if other and not pair.fault:
            fault = (
                f"{other[0]}: this branch changes this file, but {target.where} judges by its own"
            )
            yield replace(pair, fault=fault, fault_is=Verdict.INCOMPARABLE)
            continue
        # A pair that the baseline lacks is not marked as new if only its seed is new: the baseline
        # has a pair with the same other labels, the target has the truth, and a group judges it.
        # Without the truth, the group only judges whether it is dead, if it judges such a pair.
        own, in_group = scene(pair.labels), any(table.has(pair.labels) for table in tables)
        known_scene = in_group and own in scenes and target.has(pair.truth)
        is_new = old is not None and pair.name not in known and not known_scene
        yield replace(pair, is_new=is_new, in_scene=in_group and own in kept)


def _pairs(
    gate: GateOptions,
    truth: str | None,
    estimate: str | None,
    notify: Callable[[str], None],
    target: Target | None,
) -> tuple[list[Job], list[GroupTable], str | None]:
    """Return the pairs to judge: two files, or those of the suite.

    Also return the groups and the baseline that the suite names.
    """
    path = gate.suite
    if truth is not None and estimate is not None:
        if path and gate.sources.get("suite") == "commandline":
            raise ConfigError(f"give TRUTH ESTIMATE or {option('suite')}, not both")
        return [Job(name=ONLY_PAIR, truth=truth, estimate=estimate)], [], None
    if truth is not None or not path:
        name = "TRUTH" if truth is None else "ESTIMATE"
        raise ConfigError(
            f"{name} is missing; type tgospa-eval gate {truth or 'TRUTH'} ESTIMATE "
            f"{option('baseline', metavar='FILE')}, or tgospa-eval gate "
            f"{option('suite', metavar='FILE')}"
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
) -> Iterator[judge_pairs.Evaluated]:
    """Evaluate pairs of files; yield the row of each, and the options for the baseline.

    Pairs keep their order. Several processes share long work.
    """
    given: dict[str, dict[str, object]] = {}
    tasks: list[JobTask] = []
    waiting: dict[str, Row] = {}
    prefixes = {"": ""} | {pair.name: gate.prefix(pair.name) for pair in pairs}

    def say(name: str, text: str) -> None:
        notify(prefixes[name] + text)

    for pair in pairs:
        try:
            given[pair.name] = resolve(gate, pair, old.get(pair.name), path)
            tasks.append(_task(gate, pair, given[pair.name], groups))
        except TgospaError as error:
            waiting[pair.name] = {"error": error, "lines": ()}
    rows = gate_rows(tasks, say, run)
    for pair in pairs:
        while pair.name not in waiting:
            row = next(rows)
            waiting[row["key"]] = row
        row = waiting.pop(pair.name)
        for text in row["lines"]:
            say(pair.name, text)
        if "error" in row:
            yield row, {}
            continue
        # Later runs inherit the recorded options. Settings of the solver are not recorded if they
        # missed the requested accuracy.
        recorded = {
            OPTION_SPECS[name].key: value
            for name, value in given[pair.name].items()
            if OPTION_SPECS[name].number and value not in (None, ())
            if row["status"] == "done" or name not in ACCURACY
        }
        yield row, _portable(recorded | _chosen_by_data(row), path)


def _chosen_by_data(row: Row) -> dict[str, object]:
    """Return the options that a baseline always records, even if they are defaults.

    These are cutoff and switch penalty, and the period if it was taken from the data.
    """
    parameters = json.loads(row["parameters"])
    period = {"period": str(parameters["period"])} if "period" in parameters else {}
    return {"cutoff": row["cutoff"], "switch-penalty": row["switch_penalty"], **period}


def _task(
    gate: GateOptions,
    pair: Job,
    given: Mapping[str, object],
    groups: Sequence[GroupTable],
) -> JobTask:
    """Return the task that evaluates a pair with the options `given`.

    NEES is computed if a rule needs it.
    """
    rules = [
        *judge_pairs.rules_of(gate, pair, default=False),
        *(rule for table in groups for rule in table.rules),
    ]
    nees = {"with_": NEES} if any(rule.path in OF_NEES for rule in rules) else {}
    folder = None
    if gate.proof is not None:
        from tgospa_eval.show.files import folder_name  # lazy: few gates write proofs

        of = "baseline" if gate.update_baseline else "run"
        folder = os.path.join(gate.proof, of, *([folder_name(pair.name)] if gate.suite else []))
    options = Request.of({**given, **nees})
    if options.outage == "none" and any(rule.absolute for rule in rules):
        raise ConfigError(
            f"{gate.prefix(pair.name)}{option('outage', 'none')} cannot be combined with a limit "
            f"({option('limits')}), because it does not count outages; leave one of them out"
        )
    return JobTask(
        job=pair,
        key=pair.name,
        for_gate=True,
        options=options,
        folder=folder,
        page=gate.output is not None,
        quiet=gate.quiet,
        verbose=gate.verbose,
    )


def _naming_files(options: Mapping[str, object]) -> list[str]:
    """Return the names, as in a settings file, of the options whose values are paths of files."""
    named = {key: NAMES.get(key, key) for key, value in options.items() if value}
    return [key for key, name in named.items() if names_file(name, options[key])]


def _portable(options: Mapping[str, object], path: str) -> dict[str, object]:
    """Return options as the baseline at `path` records them: lists as texts, and relative paths.

    Paths are relative to the folder of the baseline, but absolute if they are on another drive.
    """
    portable = {
        key: ",".join(map(str, value)) if isinstance(value, (list, tuple)) else value
        for key, value in options.items()
    }
    for key in _naming_files(portable):
        try:
            relative = os.path.relpath(str(portable[key]), os.path.dirname(path) or os.curdir)
            portable[key] = relative.replace(os.sep, "/")
        except ValueError:
            portable[key] = os.path.abspath(str(portable[key]))
    return portable


# -------------------------------------------------------------------------------------------------
# Stores of batches: one is judged, and another one can be the baseline.


def load_baseline(path: str, renewed: Callable[[str], bool] | None = None) -> Baseline | None:
    """Return the baseline in a file, or that of the jobs of a store; None if there is no file.

    Jobs that failed are not in the baseline of a store. `renewed` receives the name of an entry,
    and returns whether an update will replace it. A merge conflict in such an entry is no error.

    Raises
    ------
    ConfigError, InputError
        The file cannot be read, or is not a baseline of this version.
    """
    if not is_store(path):
        return load(path, renewed)
    return {
        name: make_entry(measured(row), options, labels_of(row))
        for name, (row, options) in _stored(path, path).items()
        if row["status"] != "failed"
    }


def _renamed(old: Baseline | None, pairs: Sequence[Job], any_name: bool = False) -> Baseline | None:
    """Return a baseline with the entries of equal labels under the names of these pairs.

    A name such as ``a/1`` also stands for ``1/a``. With `any_name`, only the labels must be equal.
    """

    def lone(labels: Mapping[str, Mapping[str, str]]) -> dict[Hashable, str]:
        keys = {
            name: (frozenset(own.items()), any_name or tuple(sorted(name.split("/"))))
            for name, own in labels.items()
        }
        count = Counter(keys.values())
        return {key: name for name, key in keys.items() if key[0] and count[key] == 1}

    known = {pair.name: pair.labels for pair in pairs}
    new = lone({name: own for name, own in known.items() if name not in (old or {})})
    labels = {name: entry.get("labels", {}) for name, entry in (old or {}).items()}
    before = lone({name: own for name, own in labels.items() if name not in known})
    names = {before[key]: new[key] for key in before.keys() & new.keys()}
    return old and {names.get(name, name): entry for name, entry in old.items()}


def _stores(gate: GateOptions, first: str, second: str | None) -> tuple[str, str | None]:
    """Return the path of the store to judge, and the path of the baseline or None.

    Raises
    ------
    ConfigError
        An option applies only to evaluations, or `second` is no store. Or too much is given: two
        baselines, a store and a suite, or one store as both store and baseline.
    """
    typed = [*gate.given("commandline")]
    if gate.proof:
        typed.append("proof")
    if typed:
        raise ConfigError(
            f"{option(typed[0])}: not for stores, which are compared as they are; leave it out"
        )
    if gate.sources.get("suite") == "commandline":
        raise ConfigError(f"give a store or {option('suite')}, not both")
    other = second or gate.baseline
    if other and os.path.realpath(other) == os.path.realpath(first) and not gate.update_baseline:
        raise ConfigError(
            f"{other}: is given twice; name the store to judge, and another as the baseline"
        )
    if second is None:
        return first, gate.baseline
    if gate.strong("baseline"):
        raise ConfigError(
            "two baselines are given; give OLD_STORE NEW_STORE, or STORE "
            f"{option('baseline', metavar='FILE')}"
        )
    if not is_store(second):
        raise ConfigError(
            f"{second}: is not the folder of a batch, but {first} is; name one or two such folders"
        )
    return second, first


def _stored(folder: str, path: str) -> dict[str, judge_pairs.Evaluated]:
    """Return the row of each job of a store, and its options as a baseline at `path` records them.

    The keys are names of jobs, such as ``careful/SIM-01 cutoff=5``.

    Raises
    ------
    InputError
        The store cannot be read or has no rows, an option is unknown, or two names are equal.
    """
    store = Store(folder)
    options, table = store.settings()["options"], store.rows()
    if not len(table):
        raise InputError(f"{folder}: no job of this batch is finished")
    unknown = next((name for name in options if name not in NAMES.values()), None)
    if unknown is not None:
        file = os.path.join(folder, SETTINGS_FILE)
        raise InputError(
            f"{file}: options.{unknown} is not an option of an evaluation; gate takes stores that "
            "this version of batch made"
        )
    of_all = {OPTION_SPECS[name].key: value for name, value in options.items()}
    rows: dict[str, judge_pairs.Evaluated] = {}
    for values in table.to_dict("records"):
        name, row = job_name(values), {**{str(key): values[key] for key in values}, "stored": True}
        if name in rows:
            raise InputError(f"{folder}: two jobs are called {quoted(name)}; rename a label")
        own = {key.replace("_", "-"): value for key, value in json.loads(row["options"]).items()}
        chosen = {} if row["status"] == "failed" else _chosen_by_data(row)
        rows[name] = row, _portable({**of_all, **own, **chosen}, path)
    return rows


# -------------------------------------------------------------------------------------------------
# The Python function ``gate``.

INHERITED = {key: name for key, name in KEYWORDS.items() if name in OF_THE_NUMBER}
"""Keyword of ``evaluate`` for each option that changes TGOSPA, by its name in a baseline."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GateResult:
    """Result of `gate`; ``bool`` says whether it passed, ``print`` shows the table of the command.

    Parameters
    ----------
    report : Report
        Verdict, findings and notes.
    result : Result, optional
        The evaluation that was judged; None for a suite.
    """

    report: Report
    result: "Result | None" = None

    @property
    def verdict(self) -> str:
        """``"pass"``, ``"fail"``, ``"undecided"``, ``"not comparable"`` or ``"updated"``."""
        return str(self.report.verdict)

    @property
    def passed(self) -> bool:
        """True if all rules are proven to be kept, or if the baseline was written."""
        return self.report.status == 0

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user: reasons and remedies."""
        return tuple(note for outcome in self.report.outcomes for note in outcome.notes)

    @cached_property
    def findings(self) -> "pd.DataFrame":
        """A row for each rule and each pair or group that it judges: value, limit and verdict."""
        import pandas as pd  # lazy: slow to import

        records = [
            {**({} if self.result else {"pair": outcome.name}), **finding_record(finding)}
            for outcome in self.report.outcomes
            for finding in outcome.findings
        ]
        table = pd.DataFrame(records)
        return table.rename(columns={"lower": "lower_bound", "upper": "upper_bound"})

    def __bool__(self) -> bool:
        if not self.passed and "PYTEST_CURRENT_TEST" in os.environ:
            sys.stdout.write(f"{self}\n")  # a failed `assert` shows only its first line
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
    **options: "Unpack[GateEvaluationOptions]",
) -> GateResult:
    """Judge an estimate, or the pairs of a suite, by a baseline, as ``tgospa-eval gate`` does.

    A rule fails only if the proven lower bound breaks it, and passes only if the proven upper bound
    keeps it.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        Truth and estimate, as for `evaluate`.
    baseline : str or path, optional
        JSON file of the baseline, in the format of the command line. `update_baseline` writes this
        file. A suite can name its baseline, too. Fixed `limits` alone need none.
    suite : str or path, optional
        TOML file with several pairs of files, instead of `truth` and `estimate`.
    against : str, optional
        Git revision or folder from which suite, baseline, truths and configuration are read.
    newer_than : str or path, optional
        A time, or a file that stands for the time of its last change. A pair of a suite fails if
        its estimate is older.
    fail_on : str or iterable of str
        Rules such as ``"total:+2%"`` or ``"nees:1.5..2.5"``; by default ``"total:+0.001%"``.
    warn_on : str or iterable of str
        Rules that only warn.
    limits : mapping of str to float, optional
        Largest allowed values, which do not depend on the baseline: ``{"tgospa": 50.0}``.
    group : str, optional
        Labels of a suite, such as ``"scenario"``. Pairs with equal labels are added up, and the
        sums are judged.
    confidence : float, optional
        Confidence of conclusions from runs with different seeds; 0.975 by default.
    seed_label : str, optional
        Label of the random seed; ``"seed"`` by default. Runs that differ only in this label repeat
        one scenario.
    update_baseline : bool
        Whether to write the baseline instead of judging.
    add : bool
        Whether an update keeps the values of earlier updates (nightly runs) beside its own. Rules
        then compare with the mean of the last runs, at most 10.
    only : str or iterable of str
        Patterns of names of pairs of a suite. An update changes only the entries of these pairs.
    prune : bool
        Whether an update removes entries of pairs that the suite no longer has.
    strict : bool
        Whether a group above its limit fails even if the choice of seeds can explain the excess. If
        true, a group with runs that the baseline lacks does not pass either.

    Options that are not given come from the suite or the baseline. If these lack an option, it has
    the default of `evaluate`. Options of a suite must be texts or numbers. Objects such as
    distances, matrices and tables are refused.

    Returns
    -------
    GateResult
        Verdict, findings and evaluation; true as a condition if the gate passed.

    Raises
    ------
    ConfigError, InputError
        An option or the data are wrong, as for `evaluate`; a rule is wrong; or the baseline or the
        suite cannot be read.
    TypeError
        The arguments are neither truth and estimate, nor a suite; or `limits` is not a mapping.
    """
    given = dict(locals())  # in the first line, so that these are only the parameters
    if not isinstance(limits, Mapping | None):
        raise TypeError(f"limits is {limits!r}: must be a mapping from path to limit")
    named = {name: given[name] for name in ("suite", "baseline", "newer_than")}
    judge_by = GateOptions.of(
        {
            **given,
            **{name: path if path is None else os.fspath(path) for name, path in named.items()},
            **{name: each(given[name]) for name in ("fail_on", "warn_on", "only")},
            "maximum": tuple(f"{name}={value!r}" for name, value in (limits or {}).items()),
            "quiet": True,
        }
    )
    if suite is not None and truth is None and estimate is None:
        return _gate_of_suite(judge_by, options)
    if truth is None or estimate is None or suite is not None:
        raise TypeError("gate() takes truth and estimate, or suite")
    for name in ("against", "newer_than", "group", "confidence", "seed_label", "only", "prune"):
        if getattr(judge_by, name) not in (None, (), False):
            raise ConfigError(f"{option(name)} is for suites")
    return _gate_of_pair(judge_by, truth, estimate, options)


def _gate_of_pair(
    judge_by: GateOptions,
    truth: TrajectoriesLike,
    estimate: TrajectoriesLike,
    options: Mapping[str, Any],
) -> GateResult:
    """Judge one estimate, in memory or in a file, with options of `evaluate`."""
    path = judge_by.baseline or ""
    old = load(path, judge_by.renewed) if path else None
    if old and ONLY_PAIR not in old:
        raise ConfigError(f"{path}: is the baseline of a suite ({', '.join(old)}); name another")
    pair = Job(
        name=ONLY_PAIR, truth=_display_name(truth, "truth"), estimate=_display_name(estimate, "")
    )
    # A wrong rule raises its error before any work.
    judge_pairs.rules_of(judge_by, pair, baseline=bool(path))
    kept = _inherited(old[ONLY_PAIR] if old else None, path)
    inherited = {name: kept[key] for key, name in INHERITED.items() if key in kept}
    chosen: dict[str, Any] = {**inherited, **options}
    result = evaluate(truth, estimate, **chosen)
    plain = {key: chosen.get(name) for key, name in INHERITED.items()}
    row = row_to_judge(result)
    measured(row)  # raises the error of a result that cannot be judged
    kinds = (str, float, int, os.PathLike)
    plain = {key: value for key, value in plain.items() if isinstance(value, kinds)}
    recorded = _portable(plain | _chosen_by_data(row), path)
    report = judge_pairs.judge_pairs(
        judge_by, [pair], [], path, old, lambda pairs, _: ((row, recorded) for _ in pairs), ""
    )
    return GateResult(report=report, result=result)


def _gate_of_suite(judge_by: GateOptions, options: Mapping[str, Any]) -> GateResult:
    """Judge a suite. Options of `evaluate` must be texts or numbers."""
    given = {name: value for name, value in options.items() if value is not None}
    values = typed({OPTION_SPECS[name].key: value for name, value in given.items()}, "gate")
    named = ("baseline", "suite", *judge_pairs.RULE_PARAMETERS.values())
    chosen = {name for name in named if getattr(judge_by, name)}
    sources = dict.fromkeys({*chosen, *given}, "commandline")
    judge_by = replace(judge_by, evaluation=values, sources=sources)
    warnings: list[str] = []
    report = judge_all(judge_by, None, None, warnings.append)
    warn_user([Notice(text=text.removeprefix("warning: ")) for text in warnings])
    return GateResult(report=report)


def _display_name(side: object, otherwise: str) -> str:
    """Return the path of a file, or `otherwise` for data in memory."""
    return os.fspath(side) if isinstance(side, (str, os.PathLike)) else otherwise
