"""From the options of the gate to verdicts, and these to stdout and files."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval._version import __version__
from tgospa_eval.cli.evaluate.run import evaluate_files
from tgospa_eval.cli.gate.sources import KNOWN, Given
from tgospa_eval.cli.shared.interrupts import heard
from tgospa_eval.cli.shared.streams import emit, say, say_as_is
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.cli.verbs import TYPED
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.gate.baseline import Baseline, Entry, dump, load, make_entry
from tgospa_eval.gate.outcome import Change, Outcome, Report, change, compare
from tgospa_eval.gate.report import GATE_REPORTS
from tgospa_eval.gate.rules import STATUS, Finding, Rule, Verdict, worst
from tgospa_eval.gate.suite import ALONE, Pair, Suite
from tgospa_eval.gate.suite import load as load_suite
from tgospa_eval.reports.files import write_file
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import clipped


def run_gate(
    context: click.Context, truth: str | None, estimate: str | None, options: dict[str, Any]
) -> int:
    """Judge, print, write; the exit status.

    Raises
    ------
    TgospaError
        Nothing could be judged.
    """
    given = Given(context=context, options=options)
    if options["config"] and not options["quiet"]:
        say(f"settings from {options['config']}")
    _check_junit(options, truth, estimate)
    try:
        report = _judge(given, truth, estimate)
    except TgospaError as error:
        failed = Outcome(
            name="gate", truth=truth or "", estimate=estimate or "",
            verdict=Verdict.ERROR, status=error.exit_status, notes=(str(error),),
        )  # fmt: skip
        _publish(_report(options["baseline"] or "", [failed]), options)
        raise
    for outcome in report.outcomes:
        if outcome.verdict is Verdict.ERROR:
            notes = (f"{outcome.name}: " if options["suite"] else "") + " ".join(outcome.notes)
            say(notes)
    # The files first: a full disk behind stdout must not cost the report, nor hide a regression.
    status = worst((report.status, _publish(report, options)))
    try:
        emit(GATE_REPORTS[options["format_"]](report), options["format_"])
    except ConfigError as error:
        say(str(error))
        status = worst((status, error.exit_status))
    return status


def _check_junit(options: dict[str, Any], *sides: str | None) -> None:
    """Whether the JUnit report would be written over what is read.

    Raises
    ------
    ConfigError
        It would.
    """
    if not options["junit"]:
        return
    target = os.path.realpath(options["junit"])
    for path in (*sides, options["suite"], options["baseline"], options["config"]):
        if path and os.path.realpath(path) == target:
            name, options["junit"] = options["junit"], None
            raise ConfigError(f"--junit {name}: is an input of the gate; name another file")


def _judge(given: Given, truth: str | None, estimate: str | None) -> Report:
    """All pairs, and the new baseline if one is asked for."""
    options = given.options
    suite = _suite(given, truth, estimate)
    if options["junit"]:
        for pair in suite.pairs:
            _check_junit(options, pair.truth, pair.estimate, suite.baseline)
    path = options["baseline"] if given.strong("baseline") or not suite.baseline else suite.baseline
    update = options["update_baseline"]
    if update and not path:
        raise ConfigError("no baseline: name the file to make with --baseline FILE")
    old = load(path) if path else None
    single = suite.pairs[0].name == ALONE and not options["suite"]
    if single and old and ALONE not in old:
        raise ConfigError(f"{path}: is the baseline of a suite ({', '.join(old)}); name --suite")
    rules = {
        p.name: given.rules(p, baseline=bool(path)) for p in suite.pairs if not p.fault
    }  # wrong ones before any work
    if path and update:
        return _update(given, suite, old or {}, path)
    if not path:  # absolute limits only
        judged = (
            _failed(p) if p.fault else _outcome(given, p, None, rules[p.name], "")
            for p in suite.pairs
        )
        return _report("", list(judged))
    missing = f"no such file: {path}" if old is None else f"not in {path}"
    outcomes = [
        _failed(pair)
        if pair.fault
        else _outcome(given, pair, old[pair.name], rules[pair.name], path)
        if old and pair.name in old
        else _absent(pair, missing)
        for pair in suite.pairs
    ]
    outcomes += [
        _absent(Pair(name=name, truth="", estimate=""), "in the baseline and not in the suite")
        for name in old or ()
        if name not in rules
    ]
    typed = given.context.meta[TYPED]
    at = typed.index("--") if "--" in typed else len(typed)
    again = ("tgospa-eval", "gate", *typed[:at], "--update-baseline", *typed[at:])
    return _report(path, outcomes, again)


def _report(path: str, outcomes: list[Outcome], again: tuple[str, ...] = ()) -> Report:
    return Report(baseline=path, outcomes=tuple(outcomes), version=__version__, again=again)


def _suite(given: Given, truth: str | None, estimate: str | None) -> Suite:
    path = given.options["suite"]
    if truth is not None and estimate is not None:
        source = given.context.get_parameter_source("suite")
        if path and source is ParameterSource.COMMANDLINE:
            raise ConfigError("give TRUTH ESTIMATE or --suite, not both")
        given.options["suite"] = None
        return Suite(pairs=(Pair(name=ALONE, truth=truth, estimate=estimate),), baseline=None)
    if truth is not None or not path:
        name = "TRUTH" if truth is None else "ESTIMATE"
        raise ConfigError(
            f"{name} is missing; type tgospa-eval gate {truth or 'TRUTH'} ESTIMATE "
            "--baseline FILE, or tgospa-eval gate --suite FILE"
        )
    return load_suite(path, KNOWN)


def _absent(pair: Pair, why: str) -> Outcome:
    return Outcome(
        name=pair.name, truth=pair.truth, estimate=pair.estimate, verdict=Verdict.INCOMPARABLE,
        status=STATUS[Verdict.INCOMPARABLE], notes=(why,),
    )  # fmt: skip


def _failed(pair: Pair) -> Outcome:
    return Outcome(
        name=pair.name, truth=pair.truth, estimate=pair.estimate, verdict=Verdict.ERROR,
        status=STATUS[Verdict.ERROR], notes=(pair.fault,),
    )  # fmt: skip


def _evaluate(
    given: Given, pair: Pair, entry: Entry | None, path: str
) -> tuple[Summary, dict[str, Any]]:
    """The result of a pair, and the options that made it."""
    chosen = given.resolve(pair, entry, path)
    output = OutputOptions(quiet=given.options["quiet"], verbose=given.options["verbose"])
    prefix = f"{clipped(pair.name)}: " if given.options["suite"] else ""
    result, finished = evaluate_files(
        pair.truth, pair.estimate, EvaluationOptions.of(chosen), output, _prefixed(prefix)
    )
    if heard():
        claim = f"{result.claim}, {result.proven}"
        say(f"{prefix}{claim}; nothing is judged")
        raise KeyboardInterrupt
    return result, given.kept(chosen, result, path, finished=finished)


def _prefixed(prefix: str) -> Callable[[str], None]:
    return lambda text: say(prefix + text)


def _outcome(
    given: Given, pair: Pair, entry: Entry | None, rules: list[Rule], path: str
) -> Outcome:
    """The verdict on a pair; wrong files do not keep others from being judged."""
    begin = time.monotonic()
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...]
    warnings: tuple[Notice, ...] = ()
    try:
        result, _ = _evaluate(given, pair, entry, path)
    except TgospaError as error:
        verdict, status, notes = Verdict.ERROR, error.exit_status, (str(error),)
    else:
        verdict, findings, notes = compare(result, entry, rules)
        status, warnings = STATUS[verdict], result.warnings
    return Outcome(
        name=pair.name, truth=pair.truth, estimate=pair.estimate, verdict=verdict, status=status,
        findings=findings, notes=notes, seconds=time.monotonic() - begin, warnings=warnings,
    )  # fmt: skip


def _update(given: Given, suite: Suite, old: Baseline, path: str) -> Report:
    """Make the baseline anew, of all pairs or not at all, and list what changed."""
    new: Baseline = {}
    outcomes = []
    for pair in suite.pairs:
        if pair.fault:
            raise InputError(pair.fault)
        begin = time.monotonic()
        before = old.get(pair.name)
        try:
            result, kept = _evaluate(given, pair, before, path)
        except TgospaError as error:
            prefix = f"{clipped(pair.name)}: " if given.options["suite"] else ""
            raise type(error)(f"{prefix}{error}") from None
        entry = new[pair.name] = make_entry(result, kept)
        changes, notes = change(before, entry), tuple(_notes(before, entry, result))
        made = _updated(pair, time.monotonic() - begin, changes, notes)
        outcomes.append(replace(made, warnings=result.warnings))
    removed = ("removed: it is not in the suite",)
    outcomes += [
        _updated(Pair(name=name, truth="", estimate=""), 0.0, (), removed)
        for name in old
        if name not in new
    ]
    if new != old or not os.path.exists(path):
        write_file(path, dump(new), "--baseline")
    return _report(path, outcomes)


def _updated(
    pair: Pair, seconds: float, changes: tuple[Change, ...], notes: tuple[str, ...]
) -> Outcome:
    return Outcome(
        name=pair.name, truth=pair.truth, estimate=pair.estimate, verdict=Verdict.UPDATED,
        status=STATUS[Verdict.UPDATED], changes=changes, notes=notes, seconds=seconds,
    )  # fmt: skip


def _notes(before: Entry | None, entry: Entry, result: Summary) -> Iterator[str]:
    """What is not seen from the values."""
    if before is None:
        yield "new in the baseline"
    elif before == entry:
        yield "unchanged"
    elif before.truth != entry.truth:
        yield "the truth is another one than before"
    elif {**before.parameters} != {**entry.parameters}:
        yield "parameters are others than before"
    if not result.certified:
        yield (
            f"the bracket is open, relative gap {result.relative_gap:.2g}: the gate is as loose as "
            "the upper bound"
        )


def _publish(report: Report, options: dict[str, Any]) -> int:
    """JUnit file, annotations and step summary; 2 if one cannot be written, else 0."""
    status = 0
    if options["junit"] is not None:
        from tgospa_eval.gate.junit import junit  # here: most runs need no XML

        try:
            write_file(options["junit"], junit(report), "--junit")
        except ConfigError as error:
            say(str(error))
            status = error.exit_status
    if options["github"]:
        from tgospa_eval.gate.github import annotations, append_summary

        for line in annotations(report):
            say_as_is(line)
        try:
            append_summary(report, os.environ.get("GITHUB_STEP_SUMMARY"))
        except ConfigError as error:
            say(str(error))
            status = error.exit_status
    return status
