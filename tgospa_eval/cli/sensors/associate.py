"""``tgospa-eval associate A B``: which states of two sensors belong together."""

from functools import partial
from typing import Any

import click

from tgospa_eval.api.request import FILE_FORMATS
from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option, option
from tgospa_eval.cli.shared.options import (
    EVALUATION,
    chosen_options,
    format_option,
)

SENSOR_OPTIONS = {
    item.key for item in EVALUATION if not item.key.startswith(("truth-", "estimate-"))
} - {
    *("cutoff", "order", "switch-penalty", "rho", "step-weights", "existence"),
    *("by", "preprocess", "unit", "solver", "gap", "epsilon", "time-limit"),
}
"""What it has of the options of everything that evaluates."""

_files = partial(
    option,
    section="Files",
    trusted=True,
    type=click.Choice(FILE_FORMATS),
    show_default="found from name and content",
)
_output = partial(Option, section="Output")


@click.command(
    "associate",
    cls=Verb,
    params=[
        Option(
            "-c, --cutoff C",
            "Cutoff c > 0: states farther apart are not associated, and each costs c/2.",
            section="Metric",
            type=float,
            required=True,
        ),
        *chosen_options(
            SENSOR_OPTIONS,
            _files(
                "--a-format FORMAT",
                f"Format of A: {', '.join(FILE_FORMATS[:-1])} or {FILE_FORMATS[-1]}.",
                name="truth_format",
            ),
            _files("--b-format FORMAT", "Format of B, one of the same.", name="estimate_format"),
            *(
                option(
                    f"--{letter}-columns NAMES",
                    f"--columns for {letter.upper()} alone.",
                    name=name,
                    section="Files",
                    trusted=True,
                )
                for letter, name in (("a", "truth_columns"), ("b", "estimate_columns"))
            ),
            format_option("table", "json", "csv"),
            _output(
                "--cost-matrix FILE",
                "Write the distances of all pairs of each step to a CSV file.",
                type=PATH,
            ),
            _output(
                "--cross-cov FILE",
                "Write the cross-covariances of associated clouds to a CSV file.",
                type=PATH,
            ),
            _output("--force", "Write over files that exist."),
        ),
    ],
)
@click.argument("a", type=SOURCE)
@click.argument("b", type=SOURCE)
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
    from tgospa_eval.api.request import Request
    from tgospa_eval.cli.sensors.run import SensorOptions, associate_files

    fixed = {"pairwise": True, "sides": ("a", "b"), "switch_penalty": 0.0}
    associate_files((a, b), Request.of(options | fixed), SensorOptions.of(options))
