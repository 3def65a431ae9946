"""``tgospa-eval gate TRUTH ESTIMATE --baseline FILE``: a regression gate for CI."""

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from tgospa_eval.api.options import NAMES
from tgospa_eval.campaign.gate.options import GateOptions
from tgospa_eval.cli.shared.click_builder import (
    CONFIG_FILE,
    EVALUATION,
    QUIET,
    VERBOSE,
    OutputOptions,
    format_option,
    options_of,
)
from tgospa_eval.cli.shared.command import (
    IGNORED,
    SOURCE,
    TARGET,
    Verb,
    removed,
)
from tgospa_eval.cli.shared.streams import emit, interrupted, print_notice, print_raw
from tgospa_eval.errors import ConfigError, TgospaError

if TYPE_CHECKING:
    from tgospa_eval.campaign.gate.outcome import Report
    from tgospa_eval.common.progress import Stopwatch
    from tgospa_eval.results.evaluation import Evaluation

TYPED = "tgospa_eval.typed"
"""Key of the click context for the arguments as they were typed."""

AGAINST = "TGOSPA_EVAL_AGAINST"

GATE = options_of(GateOptions)
GATE["against"].envvar = AGAINST
GATE["confidence"].type = click.FloatRange(0.5, 1, max_open=True)


class Gate(Verb):
    """Command that stores its arguments and the target of ``--against`` before parsing.

    Messages repeat the arguments. Configuration is read from the target.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Store the arguments and the target, then parse the arguments."""
        ctx.meta[TYPED] = tuple(args)
        where = None
        with suppress(click.UsageError):  # the same error is raised again
            typed, *_ = self.make_parser(ctx).parse_args([*args])
            where = typed.get("against", os.environ.get(AGAINST))
        if where:
            from tgospa_eval.campaign.gate.suite import Target  # lazy: few gates have one

            ctx.meta[TARGET], ctx.meta[IGNORED] = None, []
            with suppress(ConfigError):  # the same error is raised again
                ctx.meta[TARGET] = Target(where)
        return super().parse_args(ctx, args)

    def uses(self, ctx: click.Context, name: str) -> bool:
        """Check whether an option applies. A store of results needs no options of evaluations."""
        from tgospa_eval.campaign.store import is_store

        return name not in NAMES.values() or not is_store(ctx.params["truth"])


@click.command(
    "gate",
    cls=Gate,
    params=[
        *GATE.values(),
        *EVALUATION,
        CONFIG_FILE,
        QUIET,
        VERBOSE,
        format_option("table", "json", "markdown"),
    ],
)
@click.argument("truth", type=SOURCE, required=False)
@click.argument("estimate", type=SOURCE, required=False)
@click.pass_context
def command(
    ctx: click.Context, /, truth: str | None, estimate: str | None, **options: object
) -> None:
    """Fail if ESTIMATE is worse than a baseline allows: a regression gate for CI.

    The gate fails only if the proven lower bound breaks a rule, and passes only if the
    proven upper bound keeps it. Options that are not given come from the baseline.
    With the folder of a batch, each of its jobs is judged, by the same job of an
    older folder or by a baseline. These jobs are not evaluated again.

    \b
    Examples:
      tgospa-eval gate truth.csv estimate.csv --baseline base.json \\
          -c 10 -g 5 --update-baseline                  make the baseline
      tgospa-eval gate truth.csv estimate.csv --baseline base.json
      tgospa-eval gate truth.csv estimate.csv --baseline base.json \\
          --fail-on total:+2% --max counts.switch=10
      tgospa-eval gate truth.csv estimate.csv -c 10 -g 5 --max tgospa=50
      tgospa-eval gate --suite suite.toml --junit gate.xml
      tgospa-eval gate old_results new_results          two stores of a batch
      tgospa-eval gate --suite suite.toml --against origin/main

    Exit status: 0 passed, 1 regression (proven; of groups of seeds: significant),
    2 wrong option, baseline missing or not comparable, 3 bad input file, 4 undecided.
    """
    given = {
        **options,
        "evaluation": {name: options[name] for name in NAMES.values()},
        "sources": {
            name: getattr(ctx.get_parameter_source(name), "name", "").lower() for name in ctx.params
        },
        "typed": ctx.meta[TYPED],
    }
    output = OutputOptions.of(options)
    if truth == "history" and estimate is not None and not os.path.lexists(truth):
        raise click.UsageError(removed("gate history"), ctx)
    if ctx.meta.get(IGNORED) and not output.quiet:
        names = ", ".join(ctx.meta[IGNORED])
        print_notice(f"{names}: ignored, because the settings of {options['against']} count")
    ctx.exit(_run(GateOptions.of(given), truth, estimate, output))


def _run(
    gate: GateOptions,
    truth: str | None,
    estimate: str | None,
    output: OutputOptions,
) -> int:
    """Judge, print the report and write files; return the exit status.

    Raises
    ------
    TgospaError
        Nothing can be judged. Requested files have the error, too, and so has the report on stdout,
        except in the format ``table``.
    """
    from tgospa_eval._version import __version__
    from tgospa_eval.api.gate import judge_all
    from tgospa_eval.campaign.gate.judge_pairs import OverInputError
    from tgospa_eval.campaign.gate.outcome import PairOutcome, Report
    from tgospa_eval.campaign.gate.report import GATE_REPORTS
    from tgospa_eval.campaign.gate.rules import Verdict, worst
    from tgospa_eval.campaign.store import is_store
    from tgospa_eval.cli.shared.progress import run
    from tgospa_eval.show.files import GATE as FOLDER
    from tgospa_eval.show.files import probe_folder

    def run_shown(work: "Callable[[], Evaluation]", stopwatch: "Stopwatch") -> "Evaluation":
        result = run(work, stopwatch, show=not output.quiet)
        if interrupted():
            print_notice(f"{result.claim}, {result.proven}; nothing is judged")
            raise KeyboardInterrupt
        return result

    if gate.output is not None:
        probe_folder(gate.output, FOLDER, force=gate.force)
    try:
        report = judge_all(gate, truth, estimate, print_notice, run_shown)
    except TgospaError as error:
        failed = PairOutcome(
            name="gate",
            truth=truth or "",
            estimate=estimate or "",
            verdict=Verdict.ERROR,
            status=error.exit_status,
            notes=(str(error),),
        )
        report = Report(
            baseline=gate.baseline or "",
            outcomes=(failed,),
            version=__version__,
            settings_file=gate.config,
        )
        if output.format_ != "table":  # programs read the error from the report on stdout
            emit(GATE_REPORTS[output.format_](report), output.format_)
        over = isinstance(error, OverInputError)
        _publish(replace(gate, junit=None) if over else gate, report)
        raise
    report = replace(report, settings_file=gate.config)
    several = (gate.suite and (truth is None or estimate is None)) or is_store(truth)
    for outcome in report.outcomes:
        for note in outcome.notes if outcome.verdict is Verdict.ERROR else ():
            print_notice((f"{outcome.name}: " if several else "") + note)
    # Files are written first, because they must be there even if stdout cannot be written.
    status = worst((report.status, _publish(gate, report)))
    try:
        emit(_printed(report, output.format_), output.format_)
    except ConfigError as error:
        print_notice(str(error))
        status = worst((status, error.exit_status))
    return status


def _printed(report: "Report", format: str) -> str:
    """Return the report for stdout. Tables are as wide as the terminal, but at least `WIDTH`."""
    from tgospa_eval.campaign.gate.report import GATE_REPORTS, table
    from tgospa_eval.show.table_text import WIDTH

    if format != "table":
        return GATE_REPORTS[format](report)
    return table(report, max(shutil.get_terminal_size((WIDTH, 24)).columns, WIDTH))


def _publish(gate: GateOptions, report: "Report") -> int:
    """Write the requested files, and the annotations and step summary of GitHub.

    Return 0, or 2 if something cannot be written. Everything else is written nevertheless.
    """
    from tgospa_eval.campaign.gate.report import annotations, append_summary, junit
    from tgospa_eval.common.writing import write_file

    status = 0

    def attempt(write: Callable[[], object]) -> None:
        nonlocal status
        try:
            write()
        except ConfigError as error:
            print_notice(str(error))
            status = error.exit_status

    if (path := gate.junit) is not None:
        attempt(lambda: write_file(path, junit(report, gate.output), "--junit"))
    if gate.output is not None:
        attempt(lambda: _write_folder(gate, report))
    if gate.github:
        for line in annotations(report):
            print_raw(line)
        attempt(lambda: append_summary(report, os.environ.get("GITHUB_STEP_SUMMARY")))
    return status


def _write_folder(gate: GateOptions, report: "Report") -> None:
    """Write the folder of ``-o`` of a gate.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    from tgospa_eval.campaign.gate.report import gate_files
    from tgospa_eval.campaign.gate.suite import SEED
    from tgospa_eval.show.files import GATE as FOLDER
    from tgospa_eval.show.files import write_texts

    assert gate.output is not None
    files = gate_files(report, gate.seed_label or SEED)
    written = write_texts(files, gate.output, FOLDER, force=gate.force)
    if not gate.quiet:
        print_notice(str(written))
