"""``tgospa-eval batch``: a whole benchmark or Monte Carlo study, stored and tabulated."""

from functools import partial
from typing import TYPE_CHECKING

import click

from tgospa_eval.api.options import Request
from tgospa_eval.cli.shared.click_options import (
    CONFIG_FILE,
    EVALUATION,
    PICTURE_OPTIONS,
    QUIET,
    REPORT_FORMATS,
    SLICE,
    WITH,
    OutputOptions,
)
from tgospa_eval.cli.shared.command import PATH, Option, Verb, dashed, typed_options
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.errors import ConfigError

if TYPE_CHECKING:
    from tgospa_eval.campaign.store import Store
    from tgospa_eval.show.batch import BatchTables

OF_REPORT = {
    *(
        "paths",
        "by",
        "mean_of_roots",
        "band",
        "over",
        "output",
        "force",
        "format_",
        "pictures",
        "style",
    ),
    *("config", "quiet"),
}
"""Parameters that mean something to ``batch report``."""

OVER = ("start", "stamps")
BAND_KINDS = ("interval", "bootstrap", "percentiles", "deviation")
LAYOUTS = ("motchallenge", "kitti")


_batch = partial(Option, section="Batch")


@click.command(
    "batch",
    cls=Verb,
    params=[
        _batch(
            "--truth PATTERN",
            "Path of the truth, with fields: gt/{sequence}/gt/gt.txt.",
            type=PATH,
        ),
        _batch(
            "--estimate PATTERN",
            "Paths of the estimates, with fields: runs/{tracker}/{sequence}.txt. Each file found "
            "is a job.",
            type=PATH,
        ),
        _batch(
            "--layout NAME",
            "Folders GT TRACKERS as a benchmark has them: motchallenge or kitti.",
            type=click.Choice(LAYOUTS),
        ),
        _batch(
            "--seqmap FILE",
            "Only the sequences in this file, of a --layout; of kitti with their frames.",
            type=PATH,
        ),
        _batch(
            "-o, --output DIR",
            "The store: a folder that the same command goes on with. Of batch report: where to "
            "write its files.",
            type=PATH,
        ),
        _batch("--allow-missing", "Go on where truths or estimates are missing."),
        _batch("--retry-failed", "Try jobs again that failed before."),
        _batch(
            "--shard K/N",
            "Only every N-th job, from the K-th: for N processes on one store, as in a job array.",
        ),
        _batch(
            "--workers N",
            "Processes; by default as many as there are cores.",
            type=click.IntRange(1),
        ),
        _batch(
            "--scheduler ADDRESS",
            "Use the workers of a Dask cluster that is there: tcp://host:8786.",
        ),
        _batch("--reports", "Write the result folder of each job, DIR/reports/LABELS."),
        _batch("--proof", "With --reports: with the proof of each value."),
        _batch("--per-step", "Store the costs of each step as well, for curves over time."),
        _batch(
            "--curve",
            "With --per-step: also evaluate the steps up to each step, as evaluate --curve does.",
        ),
        _batch(
            "--by LABELS",
            "Labels by which tables add up, with commas or this option again; values of the first "
            "are ranked.",
            multiple=True,
            show_default="the first",
        ),
        _batch("--mean-of-roots", "Also show the plain means of the values, which are no sums."),
        _batch(
            "--band KIND",
            "Bands around curves over time: interval or bootstrap, of the RMS; percentiles or "
            "deviation, of the runs.",
            type=click.Choice(BAND_KINDS),
            show_default="interval",
        ),
        _batch(
            "--over CLOCK",
            "Time of curves: since the start of each run, or its stamps. A run counts from its "
            "first step to its last then.",
            type=click.Choice(OVER),
            show_default="stamps, start where runs have none in common",
        ),
        *(item for item in EVALUATION if item.key not in ("by", "jobs")),
        Option(
            "--force",
            "Write curves and report.html over files that no batch wrote.",
            section="Output",
        ),
        Option(
            "--format FORMAT",
            "What to print: table, json, csv, markdown or latex.",
            name="format_",
            section="Output",
            type=click.Choice(REPORT_FORMATS),
            default="table",
        ),
        SLICE,
        WITH,
        *(item for item in PICTURE_OPTIONS if item.key in ("pictures", "style")),
        CONFIG_FILE,
        QUIET,
    ],
)
@click.argument("paths", type=PATH, nargs=-1)
@click.pass_context
def command(ctx: click.Context, /, paths: tuple[str, ...], **options: object) -> None:
    """Evaluate many pairs of files: a benchmark, a Monte Carlo study, a nightly set.

    The jobs come from patterns with fields, from a manifest (a CSV file with the
    columns truth and estimate, labels, and options), or from the folders GT TRACKERS
    of a --layout. Rows are stored as Parquet; what is done is never done again.

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
    from tgospa_eval.api.batch import BatchOptions, evaluate_batch, tables_of
    from tgospa_eval.campaign.store import Store
    from tgospa_eval.show.batch_text import batch_report

    output = OutputOptions.of(options)
    if paths[:1] == ("report",):
        if len(paths) != 2:
            raise click.UsageError("batch report takes one folder, a store")
        _check_typed(ctx)
        store = Store(paths[1])
        store.settings()
        tables = tables_of(store, store.rows(), BatchOptions.of({**options, "output": paths[1]}))
        emit(batch_report(tables, output.format_), output.format_)
        _write(store, tables, output)
        return
    if output.output is None:
        raise click.UsageError("name the folder of the results with -o DIR")
    chosen = Request.of({**options, "by": None, "summed": True})
    done = evaluate_batch(paths, BatchOptions.of({**options, "evaluation": chosen}), print_notice)
    emit(batch_report(done.tables, output.format_), output.format_)
    if done.page:
        try:
            _write(done.store, done.tables, output)
        except ConfigError as error:  # the rows are stored in any case
            print_notice(f"the page is not written: {error}")
    for text in () if output.quiet else done.notices:
        print_notice(text)
    for text in done.faults:
        print_notice(text)
    ctx.exit(done.status)


def _write(store: "Store", tables: "BatchTables", output: OutputOptions) -> None:
    """Write the page of a batch, its curves and pictures to the folder of ``-o``.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    from tgospa_eval.api.batch import batch_files
    from tgospa_eval.cli.shared.writing import can_draw, wanted_pictures, write_output
    from tgospa_eval.show.files import BATCH

    folder = output.output
    if folder is None or not len(tables.rows):
        return
    wanted = wanted_pictures(output)
    if wanted is not None and not can_draw(quiet=output.quiet):
        wanted = None
    write_output(output, BATCH, lambda notify: batch_files(store, tables, folder, wanted, notify))


def _check_typed(ctx: click.Context) -> None:
    """Whether all options are for what is stored.

    Raises
    ------
    click.UsageError
        One is for evaluating, which a report does not.
    """
    given = typed_options(ctx)
    for name in ctx.params:
        if name in given and name not in OF_REPORT:
            raise click.UsageError(
                f"{dashed(name)} is for evaluating; batch report shows what is stored"
            )
