"""``tgospa-eval gate TRUTH ESTIMATE --baseline FILE``: a regression gate for CI."""

from typing import Any

import click

from tgospa_eval.cli.options import gate_options

FORMATS = ("table", "json", "markdown")
TYPED = "tgospa_eval.typed"
"""Under this name the context keeps the arguments as they were typed."""


class Gate(click.Command):
    """Keeps its arguments, for commands that messages propose."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep them, then parse them."""
        ctx.meta[TYPED] = list(args)
        return super().parse_args(ctx, args)


@click.command("gate", cls=Gate, context_settings={"max_content_width": 80})
@click.argument("truth", type=click.Path(), required=False)
@click.argument("estimate", type=click.Path(), required=False)
@gate_options
@click.option("--update-baseline", is_flag=True, help="Make the baseline, or replace it; exit 0.")
@click.option(
    "--format", "format_", type=click.Choice(FORMATS), default="table",
    show_default=True, help="What to print.",
)  # fmt: skip
@click.pass_context
def command(ctx: click.Context, /, truth: str | None, estimate: str | None, **options: Any) -> None:
    """Judge ESTIMATE by a baseline, whether it is worse than it was.

    It fails only if the proven lower bound is worse than the rule allows, and passes
    only if the proven upper bound is not. Options that are not given come from the
    baseline.

    Exit status: 0 passed, 1 regression proven, 2 wrong option, baseline missing or
    not comparable, 3 bad input file, 4 undecided.
    """
    from tgospa_eval.cli.pairs import run_gate

    ctx.exit(run_gate(ctx, truth, estimate, options))
