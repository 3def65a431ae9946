"""``tgospa-eval gate TRUTH ESTIMATE --baseline FILE``: a regression gate for CI."""

import click

from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option
from tgospa_eval.cli.shared.options import GATE_OPTIONS, format_option
from tgospa_eval.cli.verbs import TYPED


class Gate(Verb):
    """Keeps its arguments, for commands that messages propose."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep them, then parse them."""
        ctx.meta[TYPED] = list(args)
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
    from tgospa_eval.cli.gate.run import Given, run_gate

    ctx.exit(run_gate(Given.of(ctx, options), truth, estimate))
