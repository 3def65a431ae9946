"""``tgospa-eval gate TRUTH ESTIMATE --baseline FILE``: a regression gate for CI."""

import os
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from tgospa_eval.cli.shared.click_options import GATE_OPTIONS, format_option
from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option
from tgospa_eval.cli.shared.streams import emit, interrupted, print_notice, print_raw
from tgospa_eval.errors import ConfigError, TgospaError

if TYPE_CHECKING:
    from tgospa_eval.api.gate import GateOptions
    from tgospa_eval.api.options import Request
    from tgospa_eval.campaign.outcome import Report
    from tgospa_eval.cli.shared.values import OutputOptions
    from tgospa_eval.results.summary import Summary

TYPED = "tgospa_eval.typed"
"""Under this name the context keeps the arguments as they were typed."""


class Gate(Verb):
    """Keeps its arguments, for commands that messages propose."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep them, then parse them."""
        ctx.meta[TYPED] = tuple(args)
        return super().parse_args(ctx, args)


@click.command(
    "gate",
    cls=Gate,
    params=[
        *GATE_OPTIONS,
        Option(
            "--update-baseline",
            "Make the baseline, or replace it, and exit with 0.",
            section="Gate",
        ),
        Option(
            "--proof DIR",
            "Write the proof of each value: to DIR/run, with --update-baseline to DIR/baseline.",
            section="Gate",
            type=PATH,
        ),
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
    Of the store of a batch every job is judged, by that of another batch or by a
    baseline, and nothing is solved.

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

    Exit status: 0 passed, 1 regression proven, 2 wrong option, baseline missing or
    not comparable, 3 bad input file, 4 undecided.
    """
    from tgospa_eval.api.gate import GateOptions
    from tgospa_eval.api.options import Request
    from tgospa_eval.cli.shared.values import OutputOptions

    asked = {
        **options,
        "evaluation": Request.of(options),
        "sources": {
            name: getattr(ctx.get_parameter_source(name), "name", "").lower() for name in ctx.params
        },
        "typed": ctx.meta[TYPED],
    }
    output, github = OutputOptions.of(options), bool(options["github"])
    ctx.exit(_run(GateOptions.of(asked), truth, estimate, output, github=github))


def _run(
    gate: "GateOptions",
    truth: str | None,
    estimate: str | None,
    output: "OutputOptions",
    *,
    github: bool,
) -> int:
    """Judge, print, write; the exit status.

    Raises
    ------
    TgospaError
        Nothing could be judged.
    """
    from tgospa_eval._version import __version__
    from tgospa_eval.api.gate import OverInputError, is_store, judge_all
    from tgospa_eval.campaign.gate_report import GATE_REPORTS
    from tgospa_eval.campaign.outcome import PairOutcome, Report
    from tgospa_eval.campaign.rules import Verdict, worst
    from tgospa_eval.cli.shared.values import OutputOptions

    def evaluated(
        truth: str, estimate: str, options: "Request", tell: Callable[[str], None]
    ) -> "tuple[Summary, bool]":
        from tgospa_eval.cli.evaluate.run import evaluate_files  # here: stores do without

        shown = OutputOptions(quiet=output.quiet, verbose=output.verbose)
        result, finished = evaluate_files(truth, estimate, options, shown, tell)
        if interrupted():
            tell(f"{result.claim}, {result.proven}; nothing is judged")
            raise KeyboardInterrupt
        return result, finished

    try:
        report = judge_all(gate, truth, estimate, evaluated, print_notice)
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
        _publish(report, None if isinstance(error, OverInputError) else gate.junit, github=github)
        raise
    report = replace(report, settings_file=gate.config)
    several = (gate.suite and (truth is None or estimate is None)) or is_store(truth)
    for outcome in report.outcomes:
        if outcome.verdict is Verdict.ERROR:
            print_notice((f"{outcome.name}: " if several else "") + " ".join(outcome.notes))
    # The files first: a full disk behind stdout must not cost the report, nor hide a regression.
    status = worst((report.status, _publish(report, gate.junit, github=github)))
    try:
        emit(GATE_REPORTS[output.format_](report), output.format_)
    except ConfigError as error:
        print_notice(str(error))
        status = worst((status, error.exit_status))
    return status


def _publish(report: "Report", path: str | None, *, github: bool) -> int:
    """JUnit file, annotations and step summary; 2 if one cannot be written, else 0."""
    from tgospa_eval.campaign.gate_report import annotations, append_summary, junit
    from tgospa_eval.reports.files import write_file

    status = 0
    try:
        if path is not None:
            write_file(path, junit(report), "--junit")
    except ConfigError as error:
        print_notice(str(error))
        status = error.exit_status
    if not github:
        return status
    for line in annotations(report):
        print_raw(line)
    try:
        append_summary(report, os.environ.get("GITHUB_STEP_SUMMARY"))
    except ConfigError as error:
        print_notice(str(error))
        status = error.exit_status
    return status
