"""``tgospa-eval reduce IN OUT -n N``: particle clouds with fewer particles."""

from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.cli.shared.help import Option, Verb
from tgospa_eval.cli.shared.option import option
from tgospa_eval.cli.shared.options import FILE_FORMATS, chosen_options
from tgospa_eval.cli.shared.state_options import REDUCTION


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    return chosen_options(
        command,
        ("columns", "decimal", "max-input", "time", "class", "region", "jobs"),
        (
            *REDUCTION,
            option(
                "--in-format",
                "truth_format",
                section="Files",
                metavar="FORMAT",
                type=click.Choice(FILE_FORMATS),
                show_default="found from name and content",
                help="Format of IN: csv, parquet or npz.",
            ),
            click.option(
                "--force",
                cls=Option,
                section="Output",
                is_flag=True,
                help="Write over OUT if it exists.",
            ),
            click.option(
                "--format",
                "format_",
                cls=Option,
                section="Output",
                type=click.Choice(("table", "json", "csv")),
                default="table",
                show_default=True,
                help="What to print.",
            ),
        ),
    )


@click.command("reduce", cls=Verb)
@click.argument("source", metavar="IN", type=click.Path(readable=False))
@click.argument("target", metavar="OUT", type=click.Path(readable=False))
@click.option(
    "-n",
    "--size",
    cls=Option,
    section="Particles",
    type=click.IntRange(min=1),
    metavar="N",
    required=True,
    help="Number of particles of each cloud. A cloud with no more than N stays as it is.",
)
@_options
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
    from tgospa_eval.cli.sensors.run import reduce_file

    reduce_file(source, target, options)
