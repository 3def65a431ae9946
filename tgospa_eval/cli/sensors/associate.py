"""``tgospa-eval associate A B``: which states of two sensors belong together."""

from collections.abc import Callable
from functools import partial
from typing import Any

import click

from tgospa_eval.cli.shared.help import Option, Verb
from tgospa_eval.cli.shared.option import option
from tgospa_eval.cli.shared.options import FILE_FORMATS, chosen_options

SENSOR_OPTIONS = (
    "distance",
    "cloud-order",
    "inner",
    "inner-cov",
    "reduce",
    "reduce-method",
    "directions",
    "iterations",
    "restarts",
    "polish",
    "seed",
    "no-gating",
    "covariance",
    "periodic",
    "scale",
    "fix-cov",
    "missing-cov",
    "mixed",
    "columns",
    "jobs",
    "time-tolerance",
    "grid",
    "on-duplicate",
    "decimal",
    "max-input",
    "time",
    "class",
    "region",
)

_files = partial(
    option,
    section="Files",
    type=click.Choice(FILE_FORMATS),
    metavar="FORMAT",
    show_default="found from name and content",
)
_output = partial(click.option, cls=Option, section="Output")


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    return chosen_options(
        command,
        SENSOR_OPTIONS,
        (
            _files(
                "--a-format",
                "truth_format",
                help="Format of A: csv, parquet, motchallenge, kitti or npz.",
            ),
            _files("--b-format", "estimate_format", help="Format of B, one of the same."),
            option(
                "--a-columns",
                "truth_columns",
                section="Files",
                metavar="NAMES",
                help="--columns for A alone.",
            ),
            option(
                "--b-columns",
                "estimate_columns",
                section="Files",
                metavar="NAMES",
                help="--columns for B alone.",
            ),
            _output(
                "--format",
                "format_",
                type=click.Choice(("table", "json", "csv")),
                default="table",
                show_default=True,
                help="What to print.",
            ),
            _output(
                "--cost-matrix",
                metavar="FILE",
                type=click.Path(readable=False),
                help="Write the distances of all pairs of each step to a CSV file.",
            ),
            _output(
                "--cross-cov",
                metavar="FILE",
                type=click.Path(readable=False),
                help="Write the cross-covariances of associated clouds to a CSV file.",
            ),
            _output("--force", is_flag=True, help="Write over files that exist."),
        ),
    )


@click.command("associate", cls=Verb)
@click.argument("a", type=click.Path(readable=False))
@click.argument("b", type=click.Path(readable=False))
@click.option(
    "-c",
    "--cutoff",
    cls=Option,
    section="Metric",
    type=float,
    metavar="C",
    required=True,
    help="Cutoff c > 0: states farther apart are not associated, and each costs c/2.",
)
@_options
def command(a: str, b: str, **options: Any) -> None:
    """Associate the states of two sensors, A and B, at every step.

    Printed is the association with the least sum of distances, where each state that
    stays alone costs c/2. The files are read as evaluate reads them.

    \b
    Examples:
      tgospa-eval associate radar.csv lidar.csv -c 10
      tgospa-eval associate radar.csv lidar.csv -c 3 --distance mahalanobis

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.cli.sensors.run import associate_files

    associate_files((a, b), options)
