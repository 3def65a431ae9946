"""``tgospa-eval reduce IN OUT -n N``: particle clouds with fewer particles."""

from typing import TYPE_CHECKING, Any

import click

from tgospa_eval._version import __version__
from tgospa_eval.api.options import Request
from tgospa_eval.cli.associate import read_states, run_with_resources
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import PATH, SOURCE, Option, Verb

if TYPE_CHECKING:
    from tgospa_eval.distances import Resources
    from tgospa_eval.formats import Reading
    from tgospa_eval.results.records import Columns


@click.command(
    "reduce",
    cls=Verb,
    params=[
        Option(
            "-n, --size N",
            "Number of particles of each cloud. A cloud of at most N particles stays as it is.",
            section="Particles",
            type=click.IntRange(min=1),
            required=True,
        ),
        *click_builder.chosen_options(
            ("columns", "decimal", "max-input", "time", "class", "region", "where", "jobs"),
            *click_builder.REDUCTION,
            click_builder.side_option("truth_format", "in"),
            Option("--force", "Write over OUT if it exists.", section="Output"),
            click_builder.format_option("table", "json", "csv"),
        ),
    ],
)
@click.argument("source", metavar="IN", type=SOURCE)
@click.argument("target", metavar="OUT", type=PATH)
def command(source: str, target: str, *, size: int, force: bool, **options: Any) -> None:
    """Reduce the particle clouds of IN to N particles each, and write them to OUT.

    IN has the columns id,t,weight,x[,y[,z]] and a row for each particle (CSV, Parquet
    or npz). The ending of OUT gives its format. What the reduction changed is printed.

    \b
    Examples:
      tgospa-eval reduce particles.csv small.csv -n 20
      tgospa-eval reduce particles.npz small.npz -n 50 --reduce-method kmeans

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.api.sensors import reduce_side, reducing
    from tgospa_eval.cli.shared.streams import emit
    from tgospa_eval.common.config import settings_field
    from tgospa_eval.common.writing import write_file
    from tgospa_eval.formats.write import TABLES
    from tgospa_eval.results.records import json_text, records
    from tgospa_eval.sensors import CHANGES, HISTORY
    from tgospa_eval.show.files import check_file
    from tgospa_eval.show.result_text import reduction_text
    from tgospa_eval.show.table_text import csv_text

    request, output = Request.of(options), click_builder.OutputOptions.of(options)
    ending = check_file(target, "OUT", force=force, inputs=[source], suffixes=TABLES)
    how, settings = reducing(request, size)

    def work(resources: "Resources") -> "tuple[Reading, bytes, Columns]":
        (side,) = read_states((source,), settings, ("--in-format",), quiet=output.quiet)
        after, table = reduce_side(side, how, source, resources)
        return side, TABLES[ending](after), table

    side, data, table = run_with_resources(work, request.jobs, quiet=output.quiet)
    write_file(target, data, "OUT")
    counts = {
        "clouds": len(table["id"]),
        "particles": sum(table["particles"]),
        "kept": sum(table["kept"]),
    }
    change = {name: _spread(name, table[name]) for name in CHANGES[2:]}
    document = {
        "schema": "tgospa-eval/reduce/1",
        "version": __version__,
        "parameters": {
            **how.settings(),
            "columns": list(side.trajectories.columns),
            **settings.recorded,
        },
        "counts": counts,
        "change": change,
        "clouds": records(table),
        **settings_field(output.config),
    }
    texts = {
        "table": lambda: reduction_text(counts, change),
        "json": lambda: json_text(document),
        "csv": lambda: csv_text({name: table[name] for name in table if name != HISTORY}),
    }
    emit(texts[output.format_](), output.format_)


def _spread(name: str, values: list[float | None]) -> dict[str, float] | None:
    """Return statistics of the known values of a column.

    For the column ``"wasserstein"``, return None if a value is unknown. It could be the largest, so
    statistics without it would mislead.
    """
    import numpy as np

    from tgospa_eval.inspection import spread

    known = [value for value in values if value is not None]
    if name == "wasserstein" and len(known) < len(values):
        return None
    return spread(np.array(known))
