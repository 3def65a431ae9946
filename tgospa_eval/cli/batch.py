"""``tgospa-eval batch``: evaluation of a whole benchmark or study, stored and tabulated."""

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from tgospa_eval.api.options import BatchOptions, Request
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import PATH, Option, Verb, dashed, typed_options
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.errors import ConfigError

if TYPE_CHECKING:
    from tgospa_eval.campaign.store import Store
    from tgospa_eval.show.batch import BatchTables

OF_REPORT = {
    *("paths", "by", "mean_of_roots", "band", "over", "output", "force"),
    *("format_", "columns_of_table", "pictures", "style", "config", "quiet"),
}
"""Names of the parameters that also apply to ``batch report``."""


class Batch(Verb):
    """Command ``batch``; ``batch report`` only reports stored results."""

    def uses(self, ctx: click.Context, name: str) -> bool:
        """Check whether an option applies to the command, which can be ``batch report``."""
        return ctx.params["paths"][:1] != ("report",) or name in OF_REPORT


@click.command(
    "batch",
    cls=Batch,
    params=[
        *click_builder.options_of(BatchOptions).values(),
        *(item for item in click_builder.EVALUATION if item.key not in ("by", "jobs")),
        Option(
            "--force",
            "Replace curves and report.html even if no batch wrote them.",
            section="Output",
        ),
        click_builder.report_format(Option),
        click_builder.SLICE,
        click_builder.WITH,
        click_builder.COLUMNS_OF_TABLE,
        *click_builder.PICTURES,
        click_builder.CONFIG_FILE,
        click_builder.QUIET,
    ],
)
@click.argument("paths", type=PATH, nargs=-1)
@click.pass_context
def command(ctx: click.Context, /, paths: tuple[str, ...], **options: object) -> None:
    """Evaluate many pairs of files: a benchmark, a Monte Carlo study, a nightly set.

    The jobs come from patterns with fields, from a manifest (a CSV file with the
    columns truth and estimate, labels, and options), or from the folders GT TRACKERS
    of a --layout. Results are stored as Parquet. Finished jobs are not done again.

    \b
    Examples:
      tgospa-eval batch --truth 'gt/{run}.csv' --estimate 'out/{run}.csv' \\
          -c 10 -g 5 -o results
      tgospa-eval batch manifest.csv -c 10 -g 5 -o results --workers 4
      tgospa-eval batch --layout kitti gt trackers --distance iou -o results
      tgospa-eval batch report results --by tracker

    Exit status: 0 done, 2 wrong option or missing files, 3 bad manifest, 4 the accuracy
    of some job was not reached, 5 some jobs failed.
    """
    from tgospa_eval.api.batch import evaluate_batch, tables_of
    from tgospa_eval.campaign.store import Store
    from tgospa_eval.show.batch import batch_report
    from tgospa_eval.show.study_table import checked_columns

    output = click_builder.OutputOptions.of(options)
    checked_columns(output.columns_of_table)
    if paths[:1] == ("report",):
        if len(paths) != 2:
            raise click.UsageError("batch report takes one folder: that of -o DIR of a batch")
        _check_typed(ctx)
        store = Store(paths[1])
        store.settings()
        tables = tables_of(store, store.rows(), BatchOptions.of({**options, "output": paths[1]}))
        tables = replace(tables, columns=output.columns_of_table)
        emit(batch_report(tables, output.format_), output.format_)
        _write(store, tables, output)
        return
    if output.output is None:
        raise click.UsageError("name the folder of the results with -o DIR")
    chosen = Request.of({**options, "by": None, "summed": True})
    done = evaluate_batch(paths, BatchOptions.of({**options, "evaluation": chosen}), print_notice)
    tables = replace(done.tables, columns=output.columns_of_table)
    emit(batch_report(tables, output.format_), output.format_)
    if done.page:
        try:
            _write(done.store, tables, output)
        except ConfigError as error:  # the batch did not fail: all rows are stored
            print_notice(f"the page was not written: {error}")
    for text in () if output.quiet else done.notices:
        print_notice(text)
    for text in done.faults:
        print_notice(text)
    ctx.exit(done.status)


def _write(store: "Store", tables: "BatchTables", output: click_builder.OutputOptions) -> None:
    """Write the HTML page of a batch, its curves and pictures to the folder of ``-o``.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    from tgospa_eval.api.batch import batch_files
    from tgospa_eval.cli.shared.writing import drawable_pictures, write_output
    from tgospa_eval.show.files import BATCH

    folder = output.output
    if folder is None or not len(tables.rows):
        return
    wanted = drawable_pictures(output)
    write_output(output, BATCH, lambda notify: batch_files(store, tables, folder, wanted, notify))


def _check_typed(ctx: click.Context) -> None:
    """Check that all typed options apply to ``batch report``.

    Raises
    ------
    click.UsageError
        An option is only for evaluations.
    """
    given = typed_options(ctx)
    for name in ctx.params:
        if name in given and name not in OF_REPORT:
            raise click.UsageError(
                f"{dashed(name)} is only for evaluating; batch report shows stored results"
            )
