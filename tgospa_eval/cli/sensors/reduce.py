"""``tgospa-eval reduce IN OUT -n N``: particle clouds with fewer particles."""

from typing import Any

import click

from tgospa_eval.api.request import FILE_FORMATS
from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option, option
from tgospa_eval.cli.shared.options import REDUCTION, chosen_options, format_option


@click.command(
    "reduce",
    cls=Verb,
    params=[
        Option(
            "-n, --size N",
            "Number of particles of each cloud. A cloud with no more than N stays as it is.",
            section="Particles",
            type=click.IntRange(min=1),
            required=True,
        ),
        *chosen_options(
            ("columns", "decimal", "max-input", "time", "class", "region", "jobs"),
            *REDUCTION,
            option(
                "--in-format FORMAT",
                "Format of IN: csv, parquet or npz.",
                name="truth_format",
                section="Files",
                trusted=True,
                type=click.Choice(FILE_FORMATS),
                show_default="found from name and content",
            ),
            Option("--force", "Write over OUT if it exists.", section="Output"),
            format_option("table", "json", "csv"),
        ),
    ],
)
@click.argument("source", metavar="IN", type=SOURCE)
@click.argument("target", metavar="OUT", type=PATH)
def command(source: str, target: str, **options: Any) -> None:
    """Reduce the particle clouds of IN to N particles each, and write them to OUT.

    IN has the columns id,t,weight,x[,y[,z]] and a row for each particle (CSV, Parquet
    or npz). The ending of OUT gives its format. What the reduction changed is printed.

    \b
    Examples:
      tgospa-eval reduce particles.csv small.csv -n 20
      tgospa-eval reduce particles.npz small.npz -n 50 --reduce-method kmeans

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.api.request import Request
    from tgospa_eval.cli.sensors.run import SensorOptions, reduce_file

    reduce_file(source, target, Request.of(options), SensorOptions.of(options))
