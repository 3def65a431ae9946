"""From the options of the gate to verdicts, and these to stdout and files."""

import os
import time
from collections.abc import Mapping
from dataclasses import replace

from click.core import ParameterSource

from tgospa_eval._version import __version__
from tgospa_eval.cli.evaluate.run import evaluate_files
from tgospa_eval.cli.gate.sources import GateOptions, Given
from tgospa_eval.cli.gate.stores import check_updated, is_store, judge_stores, load_baseline
from tgospa_eval.cli.shared.interrupts import heard
from tgospa_eval.cli.shared.options import KNOWN
from tgospa_eval.cli.shared.streams import emit, print_notice, print_raw
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.verbs import TYPED
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.regression.baseline import Baseline, Entry, dump, make_entry
from tgospa_eval.regression.measured import measured
from tgospa_eval.regression.outcome import Outcome, Report, change, compare, leftover, update_notes
from tgospa_eval.regression.report import GATE_REPORTS
from tgospa_eval.regression.rules import Rule, Verdict, worst
from tgospa_eval.regression.suite import ONLY_PAIR, Pair, Suite
from tgospa_eval.regression.suite import load as load_suite
from tgospa_eval.reports.files import write_file
from tgospa_eval.reports.folders import PROOF, write_texts
from tgospa_eval.reports.proofs import folder_name, proof_files
from tgospa_eval.results.summary import Summary

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
        failed = replace(Outcome.of(pair, Verdict.ERROR, str(error)), status=error.exit_status)
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
        else Outcome.of(pair, Verdict.INCOMPARABLE, missing)
        for pair in suite.pairs
    ]
    outcomes += leftover(
        old or {}, rules, Verdict.INCOMPARABLE, "in the baseline and not in the suite"
    )
    typed = given.context.meta[TYPED]
    at = typed.index("--") if "--" in typed else len(typed)
    again = ("tgospa-eval", "gate", *typed[:at], "--update-baseline", *typed[at:])
    return _report(path, outcomes, () if is_store(path) else again)


def _report(path: str, outcomes: list[Outcome], again: tuple[str, ...] = ()) -> Report:
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
    given: Given, pair: Pair, entry: Entry | None, path: str
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
    given: Given, pair: Pair, entry: Entry | None, rules: list[Rule], path: str
) -> Outcome:
    """The verdict on a pair; wrong files do not keep others from being judged."""
    if pair.fault:
        return Outcome.of(pair, Verdict.ERROR, pair.fault)
    begin = time.monotonic()
    try:
        result, _, proof = _evaluate(given, pair, entry, path)
        _write_proof(given.gate, pair, proof)
    except TgospaError as error:
        outcome = Outcome.of(pair, Verdict.ERROR, str(error))
        return replace(outcome, status=error.exit_status, seconds=time.monotonic() - begin)
    verdict, findings, notes = compare(measured(result), entry, rules)
    return replace(
        Outcome.of(pair, verdict, *notes),
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
            Outcome.of(pair, Verdict.UPDATED, *update_notes(before, entry, now)),
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
        from tgospa_eval.regression.junit import junit  # here: most runs need no XML

        try:
            write_file(gate.junit, junit(report), "--junit")
        except ConfigError as error:
            print_notice(str(error))
            status = error.exit_status
    if gate.github:
        from tgospa_eval.regression.github import annotations, append_summary

        for line in annotations(report):
            print_raw(line)
        try:
            append_summary(report, os.environ.get("GITHUB_STEP_SUMMARY"))
        except ConfigError as error:
            print_notice(str(error))
            status = error.exit_status
    return status
