"""``tgospa-eval associate A B``: which states of two sensors belong together."""

from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.cli.options import FILE_FORMATS, chosen_options, option

SHARED = (
    "distance", "cloud-order", "inner", "inner-cov", "reduce", "reduce-method", "directions",
    "iterations", "restarts", "polish", "seed", "no-gating", "covariance", "periodic", "scale",
    "fix-cov", "missing-cov", "mixed", "columns", "jobs", "time-tolerance", "grid",
    "on-duplicate", "decimal", "time", "class", "region",
)  # fmt: skip


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    return chosen_options(
        command,
        SHARED,
        (
            option("--a-format", "truth_format", type=click.Choice(FILE_FORMATS),
                   help="Format of A.  [default: guessed by name and content]"),
            option("--b-format", "estimate_format", type=click.Choice(FILE_FORMATS),
                   help="Format of B, likewise."),
            click.option("--cost-matrix", metavar="FILE", type=click.Path(),
                         help="Write the distances of all pairs of each step, CSV."),
            click.option("--cross-cov", metavar="FILE", type=click.Path(),
                         help="Write the cross-covariances of associated clouds, CSV."),
            click.option("--force", is_flag=True, help="Write files that exist."),
            click.option("--format", "format_", type=click.Choice(("table", "json", "csv")),
                         default="table", show_default=True, help="What to print."),
        ),
    )  # fmt: skip


@click.command("associate", context_settings={"max_content_width": 80})
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@click.option(
    "-c",
    "--cutoff",
    type=float,
    required=True,
    help="Cutoff c > 0: nothing farther apart is associated; a state alone costs c/2.",
)
@_options
def command(a: str, b: str, **options: Any) -> None:
    """Associate the states of A and B at every step.

    The association with the least sum of distances, c/2 for each state that stays
    alone. A and B are read as evaluate reads its files.

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.cli.sensors import associate_files

    associate_files((a, b), options)
