"""From the options of the gate to verdicts, and these to stdout and files."""

import json
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Self

import click
from click.core import ParameterSource

from tgospa_eval._version import __version__
from tgospa_eval.api.request import Request, Values
from tgospa_eval.campaign.baseline import (
    Baseline,
    BaselineEntry,
    Measured,
    dump,
    load,
    make_entry,
    measured,
    values_of,
)
from tgospa_eval.campaign.gate_report import GATE_REPORTS
from tgospa_eval.campaign.outcome import (
    PairOutcome,
    Report,
    change,
    compare,
    leftover,
    update_notes,
)
from tgospa_eval.campaign.rules import (
    DEFAULT,
    Rule,
    Verdict,
    parse_maximum,
    parse_rule,
    split_rules,
    worst,
)
from tgospa_eval.campaign.store import SETTINGS_FILE, Row, Store
from tgospa_eval.campaign.suite import ONLY_PAIR, Pair, Suite
from tgospa_eval.campaign.suite import load as load_suite
from tgospa_eval.cli.evaluate.run import evaluate_files
from tgospa_eval.cli.shared.options import BY_KEY, EVALUATION, KNOWN, typed_options
from tgospa_eval.cli.shared.streams import emit, heard, print_notice, print_raw
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.verbs import TYPED
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.reports.files import PROOF, write_file, write_texts
from tgospa_eval.reports.proofs import folder_name, proof_files
from tgospa_eval.results.saved import ACCURACY
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import clipped, quoted
from tgospa_eval.tracks.judged import judged_of

WITHOUT_EFFECT = ("jobs", "max-input")
"""Options of an evaluation that change neither the number nor its bracket."""

PATHS_GIVEN = ("covariance", "step_weights")
"""Options that name a file, by parameter."""

RULE_PARAMETERS = {"fail-on": "fail_on", "warn-on": "warn_on", "max": "maximum"}
"""Rules by their names in a suite and as parameters."""

ACCURACY_KEYS = tuple(name.replace("_", "-") for name in ACCURACY)

STRONG = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)


@dataclass(frozen=True, kw_only=True)
class GateOptions(Values):
    """What to judge by, and what to write beside stdout."""

    suite: str | None
    baseline: str | None
    update_baseline: bool
    fail_on: tuple[str, ...]
    warn_on: tuple[str, ...]
    maximum: tuple[str, ...]
    junit: str | None
    proof: str | None
    github: bool

    def prefix(self, pair: Pair) -> str:
        """What a line about a pair begins with: its name, where there are several."""
        return f"{clipped(pair.name)}: " if self.suite else ""


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """The options of the evaluation of a pair, and the names of those that are no defaults."""

    options: Request
    given: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Given:
    """The options of the command line, with where they come from.

    A default yields to the baseline, that to a configuration file, that to the suite, that to the
    environment, that to a flag.

    Parameters
    ----------
    context : Context
        Knows where a value comes from.
    evaluation, gate, output : Request, GateOptions, OutputOptions
        Those of the evaluation, of the gate itself, and of printing.
    """

    context: click.Context
    evaluation: Request
    gate: GateOptions
    output: OutputOptions

    @classmethod
    def of(cls, context: click.Context, values: Mapping[str, object]) -> Self:
        """From all options of the verb by parameter."""
        return cls(
            context=context,
            evaluation=Request.of(values),
            gate=GateOptions.of(values),
            output=OutputOptions.of(values),
        )

    def strong(self, name: str) -> bool:
        """Whether it is a flag or from the environment."""
        return self.context.get_parameter_source(name) in STRONG

    def typed(self, name: str) -> bool:
        """Whether it is a flag."""
        return self.context.get_parameter_source(name) is ParameterSource.COMMANDLINE

    def weak(self, name: str) -> bool:
        """Whether it is from a configuration file."""
        return self.context.get_parameter_source(name) is ParameterSource.DEFAULT_MAP

    def resolve(self, pair: Pair, entry: BaselineEntry | None, path: str) -> Chosen:
        """The options of a pair."""
        own = {str(i.name): getattr(self.evaluation, str(i.name)) for i in EVALUATION}
        given = (
            {}
            if entry is None
            else typed_options(self.context, dict(entry.options), f"{path}, options")
        )
        for name in (name for name in PATHS_GIVEN if given.get(name)):
            given[name] = os.path.join(os.path.dirname(path), str(given[name]))
        given |= {name: value for name, value in own.items() if self.weak(name)}
        given |= typed_options(
            self.context, dict(pair.options), f"pair {quoted(pair.name)}, options"
        )
        given |= {name: value for name, value in own.items() if self.strong(name)}
        return Chosen(options=Request.of(given), given=tuple(given))

    def recorded(
        self, chosen: Chosen, result: Summary, path: str, *, finished: bool
    ) -> dict[str, object]:
        """What the baseline records of the options: those given, and c and gamma in any case.

        Those of a solver that did not reach its accuracy are left out, a later run would inherit
        them; the path of a file is relative to the folder of the baseline.
        """
        keys = {str(item.name): key for key, item in BY_KEY.items()}
        values = {name: getattr(chosen.options, name) for name in chosen.given}
        recorded: dict[str, object] = {
            keys[name]: ",".join(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if keys[name] not in WITHOUT_EFFECT and value not in (None, ())
            if finished or keys[name] not in ACCURACY_KEYS
        }
        for key in (keys[name] for name in PATHS_GIVEN if keys[name] in recorded):
            recorded[key] = relative_path(str(recorded[key]), os.path.dirname(path))
        used = result.proof.parameters
        return {**recorded, "cutoff": used.cutoff, "switch-penalty": used.switch_penalty}

    def rules(self, pair: Pair, *, baseline: bool = True) -> list[Rule]:
        """The rules of a pair.

        Raises
        ------
        ConfigError
            One is wrong; or there is no baseline, and they are not all absolute limits.
        """
        found: list[Rule] = []
        for key, name in RULE_PARAMETERS.items():
            own = [part for text in getattr(self.gate, name) for part in split_rules(text)]
            suite = [
                part for text in pair.rules.get(key, ()) for part in split_rules(text) or [text]
            ]
            if key == "fail-on":
                texts = own if own and (self.strong(name) or not suite) else suite
                found += [parse_rule(text) for text in texts] or [DEFAULT][:baseline]
            elif key == "warn-on":
                found += [parse_rule(text, option=key) for text in (*suite, *own)]
            else:
                found += [parse_maximum(text) for text in (*suite, *own)]
        relative = [rule for rule in found if not rule.maximum]
        if not baseline and (relative or not found):
            why = f"{relative[0].text} needs one" if relative else "limits of --max need none"
            raise ConfigError(
                f"{self.gate.prefix(pair)}no baseline: name it with --baseline FILE; {why}"
            )
        return found


def relative_path(path: str, folder: str) -> str:
    """The path from a folder, with slashes; from another drive there is none but the whole."""
    try:
        return os.path.relpath(path, folder or os.curdir).replace(os.sep, "/")
    except ValueError:
        return os.path.abspath(path)


# -------------------------------------------------------------------------------------------------
# A gate over stores of batches: nothing is solved, what was proven is compared.

JUDGED_COLUMNS = ("parameters", "judged.truth_sha256", "normalised.tgospa")
"""Columns without which rows cannot be judged."""


def is_store(path: str | None) -> bool:
    """Whether it is the folder of a batch."""
    return path is not None and os.path.isfile(os.path.join(path, SETTINGS_FILE))


def load_baseline(path: str) -> Baseline | None:
    """A baseline from a file, or from the jobs of a store that have a value; None without it.

    Raises
    ------
    ConfigError, InputError
        It cannot be read, or is no baseline of this version.
    """
    if not is_store(path):
        return load(path)
    stored = _Stored.of(path)
    return {name: make_entry(now, stored.options(name, path)) for name, now in stored.now.items()}


def check_updated(path: str | None) -> None:
    """Whether this can be written as a baseline.

    Raises
    ------
    ConfigError
        It is the folder of a batch.
    """
    if is_store(path):
        raise ConfigError(
            f"--baseline {path}: is a batch, which tgospa-eval batch makes; --update-baseline "
            "writes a file"
        )


def judge_stores(given: Given, first: str, second: str | None) -> Report:
    """Judge the jobs of a store by a baseline, by another store, or by limits alone.

    Parameters
    ----------
    given : Given
        The options.
    first : str
        The store; with `second` the one that is the baseline.
    second : str, optional
        The store that is judged.

    Raises
    ------
    TgospaError
        Nothing can be judged.
    """
    gate = given.gate
    _check_options(given)
    if second is not None and given.strong("baseline"):
        raise ConfigError("name the baseline once: OLD_STORE NEW_STORE, or STORE --baseline FILE")
    if second is not None and not is_store(second):
        raise ConfigError(f"{second}: holds no batch, and {first} does; name two stores or one")
    judged, path = (first, gate.baseline) if second is None else (second, first)
    if gate.update_baseline:
        if not path:
            raise ConfigError("no baseline: name the file to make with --baseline FILE")
        check_updated(path)
    stored = _Stored.of(judged)
    rules = {name: given.rules(pair, baseline=bool(path)) for name, pair in stored.pairs.items()}
    old = load_baseline(path) if path else None
    if path and gate.update_baseline:
        return _update_store(stored, old or {}, path)
    missing = f"no such file: {path}" if old is None else f"not in {path}"
    outcomes = [
        _store_outcome(stored, pair, (old or {}).get(name), rules[name])
        if name in stored.faults or not path or (old and name in old)
        else PairOutcome.of(pair, Verdict.INCOMPARABLE, missing)
        for name, pair in stored.pairs.items()
    ]
    outcomes += leftover(
        old or {}, rules, Verdict.INCOMPARABLE, f"in the baseline and not in {judged}"
    )
    again = ("tgospa-eval", "gate", *given.context.meta[TYPED], "--update-baseline")
    return Report(
        baseline=path or "",
        outcomes=tuple(outcomes),
        version=__version__,
        again=() if is_store(path) else again,
    )


def _check_options(given: Given) -> None:
    """Whether no option is given that is for evaluating.

    Raises
    ------
    ConfigError
        One is given.
    """
    typed = [item.key for item in EVALUATION if given.typed(str(item.name))]
    if given.gate.proof:
        typed.append("proof")
    if typed:
        raise ConfigError(f"--{typed[0]}: stores are compared as they are, nothing is evaluated")
    if given.typed("suite"):
        raise ConfigError("give a store or --suite, not both")


@dataclass(frozen=True, kw_only=True)
class _Stored:
    """The jobs of a store by name: labels, and own options, as in ``careful/SIM-01 cutoff=5``.

    Parameters
    ----------
    pairs : mapping of str to Pair
        All jobs.
    now : mapping of str to Measured
        Those that have a value.
    faults : mapping of str to str
        Why the others have none.
    rows : mapping of str to mapping
        Their rows.
    settings : mapping of str to object
        Options of the batch, by parameter.
    """

    pairs: Mapping[str, Pair]
    now: Mapping[str, Measured]
    faults: Mapping[str, str]
    rows: Mapping[str, Row]
    settings: Mapping[str, object]

    @classmethod
    def of(cls, folder: str) -> "_Stored":
        """Read a store.

        Raises
        ------
        InputError
            It cannot be read, has no rows, or is one of an older version.
        """
        store = Store(folder)
        settings, table = store.settings(), store.rows()
        if not len(table):
            raise InputError(f"{folder}: no job of this batch is done")
        done = table["status"] != "failed"
        if done.any() and not all(name in table for name in JUDGED_COLUMNS):
            raise InputError(f"{folder}: was made by an older version; make it anew with batch")
        labels = [str(name) for name in table.columns if str(name).startswith("label.")]
        rows = {}
        for values in table.to_dict("records"):
            row = {str(name): value for name, value in values.items()}
            name = _name(row, labels)
            if name in rows:
                raise InputError(f"{folder}: two jobs are called {quoted(name)}; rename a label")
            rows[name] = row
        failed = {name for name, row in rows.items() if row["status"] == "failed"}
        return cls(
            pairs={
                name: Pair(name=name, truth=row["truth"], estimate=row["estimate"])
                for name, row in rows.items()
            },
            now={name: _measured(row) for name, row in rows.items() if name not in failed},
            faults={name: f"failed in {folder}: {rows[name]['message']}" for name in failed},
            rows=rows,
            settings=settings["options"],
        )

    def options(self, name: str, path: str) -> dict[str, object]:
        """Options of a job as a baseline records them, by their names in a configuration file."""
        keys = {str(item.name): key for key, item in BY_KEY.items()}
        found = {keys[parameter]: value for parameter, value in self.settings.items()}
        found = {
            key: ",".join(map(str, value)) if isinstance(value, list) else value
            for key, value in found.items()
        }
        row = self.rows[name]
        own = {key.replace("_", "-"): value for key, value in json.loads(row["options"]).items()}
        found |= own | {"cutoff": row["cutoff"], "switch-penalty": row["switch_penalty"]}
        for name in (name for name in PATHS_GIVEN if name in found):
            found[name] = relative_path(str(found[name]), os.path.dirname(path))
        return found


def _name(row: Row, labels: list[str]) -> str:
    """What a job is called, as a suite calls it whose fields are these labels."""
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return " ".join(("/".join(str(row[name]) for name in labels) or row["estimate"], *own))


def _measured(row: Row) -> Measured:
    """What a gate judges of a row."""
    return Measured(
        values=values_of(row, row["cutoff"] ** row["order"]),
        bounds=(row["lower_bound"], row["upper_bound"]),
        parameters=json.loads(row["parameters"]),
        judged=judged_of(row),
        version=row["version"],
        status=row["message"],
        certified=bool(row["certified"]),
    )


def _store_outcome(
    stored: _Stored, pair: Pair, entry: BaselineEntry | None, rules: list[Rule]
) -> PairOutcome:
    """The verdict on a job."""
    if pair.name in stored.faults:
        return PairOutcome.of(pair, Verdict.ERROR, stored.faults[pair.name])
    verdict, findings, notes = compare(stored.now[pair.name], entry, rules)
    return _with_row(
        replace(PairOutcome.of(pair, verdict, *notes), findings=findings), stored.rows[pair.name]
    )


def _with_row(outcome: PairOutcome, row: Row) -> PairOutcome:
    """With what the row has: how long it took, and warnings about the data."""
    warnings = tuple(Notice(**record) for record in json.loads(row["warnings"]))
    return replace(outcome, seconds=float(row["seconds"]), warnings=warnings)


def _update_store(stored: _Stored, old: Baseline, path: str) -> Report:
    """Make the baseline of all jobs, or not at all, and list what changed."""
    if stored.faults:
        raise InputError(*(f"{name}: {fault}" for name, fault in stored.faults.items()))
    new = {name: make_entry(now, stored.options(name, path)) for name, now in stored.now.items()}
    outcomes = [
        _with_row(
            replace(
                PairOutcome.of(
                    pair, Verdict.UPDATED, *update_notes(old.get(name), new[name], stored.now[name])
                ),
                changes=change(old.get(name), new[name]),
            ),
            stored.rows[name],
        )
        for name, pair in stored.pairs.items()
    ]
    outcomes += leftover(old, new, Verdict.UPDATED, "removed: it is not in the batch")
    if new != old or not os.path.exists(path):
        write_file(path, dump(new), "--baseline")
    return Report(baseline=path, outcomes=tuple(outcomes), version=__version__)


Files = Mapping[str, str]


class OverInputError(ConfigError):
    """The JUnit report would be written over what is read."""


def run_gate(given: Given, truth: str | None, estimate: str | None) -> int:
    """Judge, print, write; the exit status.

    Raises
    ------
    TgospaError
        Nothing could be judged.
    """
    gate, output = given.gate, given.output
    _check_junit(given, truth, estimate)
    try:
        report = replace(_judge(given, truth, estimate), settings_file=output.config)
    except TgospaError as error:
        pair = Pair(name="gate", truth=truth or "", estimate=estimate or "")
        failed = replace(PairOutcome.of(pair, Verdict.ERROR, str(error)), status=error.exit_status)
        spared = replace(gate, junit=None) if isinstance(error, OverInputError) else gate
        report = replace(_report(gate.baseline or "", [failed]), settings_file=output.config)
        _publish(report, spared)
        raise
    several = (gate.suite and (truth is None or estimate is None)) or is_store(truth)
    for outcome in report.outcomes:
        if outcome.verdict is Verdict.ERROR:
            print_notice((f"{outcome.name}: " if several else "") + " ".join(outcome.notes))
    # The files first: a full disk behind stdout must not cost the report, nor hide a regression.
    status = worst((report.status, _publish(report, gate)))
    try:
        emit(GATE_REPORTS[output.format_](report), output.format_)
    except ConfigError as error:
        print_notice(str(error))
        status = worst((status, error.exit_status))
    return status


def _check_junit(given: Given, *paths: str | None) -> None:
    """Whether the JUnit report would be written over what is read.

    Raises
    ------
    OverInputError
        It is one of these files, the suite, the baseline or the configuration.
    """
    gate = given.gate
    if not gate.junit:
        return
    target, used = os.path.realpath(gate.junit), given.output.config
    for path in (*paths, gate.suite, gate.baseline, used and used.path):
        if path and os.path.realpath(path) == target:
            raise OverInputError(
                f"--junit {gate.junit}: is an input of the gate; name another file"
            )


def _judge(given: Given, truth: str | None, estimate: str | None) -> Report:
    """All pairs, and the new baseline if one is asked for."""
    if truth is not None and is_store(truth):
        return judge_stores(given, truth, estimate)
    suite = _suite(given, truth, estimate)
    if truth is not None:
        given = replace(given, gate=replace(given.gate, suite=None))
    gate = given.gate
    if gate.junit:
        for pair in suite.pairs:
            _check_junit(given, pair.truth, pair.estimate, suite.baseline)
    path = gate.baseline if given.strong("baseline") or not suite.baseline else suite.baseline
    if gate.update_baseline and not path:
        raise ConfigError("no baseline: name the file to make with --baseline FILE")
    if gate.update_baseline:
        check_updated(path)
    old = load_baseline(path) if path else None
    if suite.pairs[0].name == ONLY_PAIR and not gate.suite and old and ONLY_PAIR not in old:
        raise ConfigError(f"{path}: is the baseline of a suite ({', '.join(old)}); name --suite")
    rules = {
        p.name: given.rules(p, baseline=bool(path)) for p in suite.pairs if not p.fault
    }  # wrong ones before any work
    if path and gate.update_baseline:
        return _update(given, suite, old or {}, path)
    if not path:  # absolute limits only
        return _report(
            "", [_outcome(given, p, None, rules.get(p.name, []), "") for p in suite.pairs]
        )
    missing = f"no such file: {path}" if old is None else f"not in {path}"
    outcomes = [
        _outcome(given, pair, (old or {}).get(pair.name), rules.get(pair.name, []), path)
        if pair.fault or (old and pair.name in old)
        else PairOutcome.of(pair, Verdict.INCOMPARABLE, missing)
        for pair in suite.pairs
    ]
    outcomes += leftover(
        old or {}, rules, Verdict.INCOMPARABLE, "in the baseline and not in the suite"
    )
    typed = given.context.meta[TYPED]
    at = typed.index("--") if "--" in typed else len(typed)
    again = ("tgospa-eval", "gate", *typed[:at], "--update-baseline", *typed[at:])
    return _report(path, outcomes, () if is_store(path) else again)


def _report(path: str, outcomes: list[PairOutcome], again: tuple[str, ...] = ()) -> Report:
    return Report(baseline=path, outcomes=tuple(outcomes), version=__version__, again=again)


def _suite(given: Given, truth: str | None, estimate: str | None) -> Suite:
    path = given.gate.suite
    if truth is not None and estimate is not None:
        source = given.context.get_parameter_source("suite")
        if path and source is ParameterSource.COMMANDLINE:
            raise ConfigError("give TRUTH ESTIMATE or --suite, not both")
        return Suite(pairs=(Pair(name=ONLY_PAIR, truth=truth, estimate=estimate),), baseline=None)
    if truth is not None or not path:
        name = "TRUTH" if truth is None else "ESTIMATE"
        raise ConfigError(
            f"{name} is missing; type tgospa-eval gate {truth or 'TRUTH'} ESTIMATE "
            "--baseline FILE, or tgospa-eval gate --suite FILE"
        )
    suite = load_suite(path, KNOWN)
    for text in () if given.output.quiet else suite.notices:
        print_notice(text)
    return suite


def _evaluate(
    given: Given, pair: Pair, entry: BaselineEntry | None, path: str
) -> tuple[Summary, dict[str, object], Files]:
    """The result of a pair, the options that made it, and the proof of its value, if asked for."""
    chosen, prefix = given.resolve(pair, entry, path), given.gate.prefix(pair)
    output = OutputOptions(quiet=given.output.quiet, verbose=given.output.verbose)
    result, finished = evaluate_files(
        pair.truth, pair.estimate, chosen.options, output, lambda text: print_notice(prefix + text)
    )
    if heard():
        print_notice(f"{prefix}{result.claim}, {result.proven}; nothing is judged")
        raise KeyboardInterrupt
    recorded = given.recorded(chosen, result, path, finished=finished)
    return result, recorded, proof_files(result, chosen.options.given) if given.gate.proof else {}


def _write_proof(gate: GateOptions, pair: Pair, files: Files) -> None:
    """The proof of a pair: to a folder of its own in a suite."""
    if gate.proof is None:
        return
    of = "baseline" if gate.update_baseline else "run"
    parts = (gate.proof, of, *([folder_name(pair.name)] if gate.suite else []))
    write_texts(files, os.path.join(*parts), PROOF, force=False, option="--proof")


def _outcome(
    given: Given, pair: Pair, entry: BaselineEntry | None, rules: list[Rule], path: str
) -> PairOutcome:
    """The verdict on a pair; wrong files do not keep others from being judged."""
    if pair.fault:
        return PairOutcome.of(pair, Verdict.ERROR, pair.fault)
    begin = time.monotonic()
    try:
        result, _, proof = _evaluate(given, pair, entry, path)
        _write_proof(given.gate, pair, proof)
    except TgospaError as error:
        outcome = PairOutcome.of(pair, Verdict.ERROR, str(error))
        return replace(outcome, status=error.exit_status, seconds=time.monotonic() - begin)
    verdict, findings, notes = compare(measured(result), entry, rules)
    return replace(
        PairOutcome.of(pair, verdict, *notes),
        findings=findings,
        seconds=time.monotonic() - begin,
        warnings=result.warnings,
    )


def _update(given: Given, suite: Suite, old: Baseline, path: str) -> Report:
    """Make the baseline anew, of all pairs or not at all, and list what changed."""
    new: Baseline = {}
    outcomes = []
    proofs: dict[str, Files] = {}
    for pair in suite.pairs:
        if pair.fault:
            raise InputError(pair.fault)
        begin = time.monotonic()
        before = old.get(pair.name)
        try:
            result, recorded, proofs[pair.name] = _evaluate(given, pair, before, path)
        except TgospaError as error:
            raise type(error)(f"{given.gate.prefix(pair)}{error}") from None
        now = measured(result)
        entry = new[pair.name] = make_entry(now, recorded)
        outcome = replace(
            PairOutcome.of(pair, Verdict.UPDATED, *update_notes(before, entry, now)),
            changes=change(before, entry),
            seconds=time.monotonic() - begin,
            warnings=result.warnings,
        )
        outcomes.append(outcome)
    outcomes += leftover(old, new, Verdict.UPDATED, "removed: it is not in the suite")
    if new != old or not os.path.exists(path):
        write_file(path, dump(new), "--baseline")
    for pair in suite.pairs:
        _write_proof(given.gate, pair, proofs[pair.name])
    return _report(path, outcomes)


def _publish(report: Report, gate: GateOptions) -> int:
    """JUnit file, annotations and step summary; 2 if one cannot be written, else 0."""
    status = 0
    if gate.junit is not None:
        from tgospa_eval.campaign.gate_report import junit  # here: most runs need no XML

        try:
            write_file(gate.junit, junit(report), "--junit")
        except ConfigError as error:
            print_notice(str(error))
            status = error.exit_status
    if gate.github:
        from tgospa_eval.campaign.gate_report import annotations, append_summary

        for line in annotations(report):
            print_raw(line)
        try:
            append_summary(report, os.environ.get("GITHUB_STEP_SUMMARY"))
        except ConfigError as error:
            print_notice(str(error))
            status = error.exit_status
    return status
