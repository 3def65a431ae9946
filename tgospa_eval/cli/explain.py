"""``tgospa-eval explain TRUTH ESTIMATE``: repairs of the estimate with the largest savings."""

from functools import partial

import click

from tgospa_eval.api.options import PREPROCESS, Request
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import PATH, SOURCE, Option, Verb, option, typed_options
from tgospa_eval.errors import ConfigError, ExitStatus

LEFT_ASIDE = ("by", "preprocess")
"""Options of evaluations that this verb does not support; in a settings file they are ignored."""

_output = partial(Option, section="Output")


@click.command(
    "explain",
    cls=Verb,
    params=[
        *(item for item in click_builder.EVALUATION if item.key not in LEFT_ASIDE),
        click_builder.BY_OF_SETTINGS,
        option(
            "--preprocess RULES",
            "",
            section="Filters",
            type=click.Choice(PREPROCESS),
            hidden=True,
        ),
        _output(
            "--top N",
            "Number of repairs to list; up to twice as many are tried.",
            type=click.IntRange(min=1),
            default=10,
        ),
        _output(
            "-o, --output FILE",
            "Write the repaired estimate: id,t and the state columns. The ending gives the "
            "format: .csv, .parquet or .npz.",
            type=PATH,
        ),
        _output(
            "--apply N",
            "Rank of the repair to write to the file of -o.",
            type=click.IntRange(min=1),
            default=1,
        ),
        _output("--force", "Write over the file of -o if it exists."),
        click_builder.format_option("table", "json", "csv", "markdown", "latex"),
        click_builder.CONFIG_FILE,
        click_builder.QUIET,
        click_builder.VERBOSE,
    ],
)
@click.argument("truth", type=SOURCE)
@click.argument("estimate", type=SOURCE)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    truth: str,
    estimate: str,
    *,
    top: int,
    apply: int,
    output: str | None,
    force: bool,
    **options: object,
) -> None:
    """Show which single repairs of ESTIMATE would save most of the cost, with proof.

    A repair joins, exchanges, splits, drops, cuts, fills or extends tracks, or moves
    the whole estimate in time or space. Bounds before and after a repair prove its
    saving. Savings do not add up: apply one repair, then explain the repaired file.

    \b
    Examples:
      tgospa-eval explain truth.csv estimate.csv -c 10 -g 5
      tgospa-eval explain truth.csv estimate.csv --top 20 --format json
      tgospa-eval explain truth.csv estimate.csv --apply 2 -o repaired.csv

    Exit status: 0 done, 2 wrong option, 3 bad input, 4 accuracy not reached.
    """
    given = typed_options(ctx)
    if "by" in given:
        raise click.UsageError(
            "--by class: explain evaluates all classes together; choose one class by --class NAME"
        )
    if "preprocess" in given:
        raise click.UsageError(
            "--preprocess is not supported by explain: what it leaves out changes with the repair; "
            "remove those objects from the files"
        )
    if output is None and given & {"apply", "force"}:
        raise click.UsageError(
            f"--{min(given & {'apply', 'force'})} needs -o FILE, the file to write"
        )
    from tgospa_eval.cli.evaluate.run import evaluate_files, explained
    from tgospa_eval.cli.shared.streams import emit, print_notice
    from tgospa_eval.common.writing import write_file
    from tgospa_eval.formats.write import TABLES
    from tgospa_eval.results.explanation import Explanation
    from tgospa_eval.show.files import check_file
    from tgospa_eval.show.result_text import explanation_document
    from tgospa_eval.show.table_text import rendered

    if output is not None:
        inputs = truth, estimate
        ending = check_file(output, "-o", force=force, inputs=inputs, suffixes=TABLES)
    request, shown = (
        Request.of(options | dict.fromkeys(LEFT_ASIDE)),
        click_builder.OutputOptions.of(options),
    )
    result, finished = evaluate_files(truth, estimate, request, shown)
    explanation = explained(result, shown, max(top, apply))
    if output is not None:
        try:
            repaired = explanation.repaired(apply)
        except ConfigError as error:
            raise ConfigError(f"--apply {apply}: {error}; nothing was written") from None
        write_file(output, TABLES[ending](repaired), "-o")
        if not shown.quiet:
            text = explanation.repairs[apply - 1].text
            print_notice(f"wrote {output}: the estimate with repair {apply}, {text}")
            if (request.truth_crs, request.estimate_crs) != (None, None):
                frame = "enu" if "x" in repaired.columns else ",".join(repaired.columns)
                print_notice(
                    f"{output} has the compared coordinates: evaluate it with "
                    f"--estimate-crs {frame}, without --unit-scale and --estimate-scale"
                )
    makers = explanation_document, Explanation.to_json, Explanation.columns
    emit(rendered(shown.format_, explanation, *makers), shown.format_)
    ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)
