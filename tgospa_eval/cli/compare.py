"""``tgospa-eval compare TRUTH ESTIMATE``: solvers, and later estimates, side by side."""

from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.options import CONFIG_FILE, EVALUATION, FORMATS, KEYS, QUIET, option

ACCURACY_MISSED = 4
ELSEWHERE = {"solver", "epsilon", "by"}
"""Options of everything that evaluates that this verb has not, or in another form."""

SHARED = [add for add in EVALUATION if KEYS[add][0] not in ELSEWHERE]
OWN = (
    option(
        "--solvers", metavar="NAMES",
        help="Of certified, exact, sinkhorn.  [default: all; exact only where it is quick]",
    ),
    option(
        "--epsilon", metavar="NUMBERS", default="0.1,0.05,0.03,0.01",
        help="Temperatures of sinkhorn, fractions of c^p; one run each.",
    ),
    option(
        "--format", "format_", type=click.Choice(FORMATS), default="table",
        help="What to print.",
    ),
    option(
        "-o", "--output", metavar="DIR", type=click.Path(),
        help="Write compare.json, CSV tables and, with the extra plot, pictures to this folder.",
    ),
    option("--force", is_flag=True, help="Write into a folder that is not empty."),
    CONFIG_FILE,
    QUIET,
)  # fmt: skip


def _options(command: Any) -> Any:
    for add in reversed((*OWN[:2], *SHARED, *OWN[2:])):
        command = add(command)
    return command


@click.command("compare", context_settings={"max_content_width": 80})
@click.argument("truth", type=click.Path())
@click.argument("estimate", type=click.Path())
@_options
@click.pass_context
def command(ctx: click.Context, /, truth: str, estimate: str, **options: Any) -> None:
    """Solve one problem with several solvers and settings, and compare.

    Exit status: 0 done, 2 wrong option, 3 bad input file, 4 brackets contradict
    each other, or accuracy not reached.
    """
    from tgospa_eval.cli.comparing import compare_files

    given = {
        name
        for name in ctx.params
        if ctx.get_parameter_source(name) is not ParameterSource.DEFAULT
    }
    ctx.exit(0 if compare_files(truth, estimate, options, given) else ACCURACY_MISSED)
