"""``tgospa-eval reduce IN OUT -n N``: particle clouds with fewer particles."""

from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.cli.options import FILE_FORMATS, REDUCTION, chosen_options, option


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    return chosen_options(
        command,
        ("columns", "decimal", "time", "class", "region", "jobs"),
        (
            *REDUCTION,
            option("--in-format", "truth_format", type=click.Choice(FILE_FORMATS),
                   help="Format of IN.  [default: guessed by name and content]"),
            click.option("--force", is_flag=True, help="Write OUT where it exists."),
            click.option("--format", "format_", type=click.Choice(("table", "json", "csv")),
                         default="table", show_default=True, help="What to print."),
        ),
    )  # fmt: skip


@click.command("reduce", context_settings={"max_content_width": 80})
@click.argument("source", metavar="IN", type=click.Path())
@click.argument("target", metavar="OUT", type=click.Path())
@click.option(
    "-n",
    "--size",
    type=click.IntRange(min=1),
    metavar="N",
    required=True,
    help="Particles of each cloud; a cloud that has no more is not changed.",
)
@_options
def command(source: str, target: str, **options: Any) -> None:
    """Write the particle clouds of IN with N particles each to OUT.

    IN has a row for each particle, id,t,weight,x[,y[,z]] (CSV, Parquet, npz); what
    OUT is says the end of its name. What the reduction changed is printed.

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.cli.sensors import reduce_file

    reduce_file(source, target, options)
