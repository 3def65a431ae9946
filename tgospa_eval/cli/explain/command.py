"""``tgospa-eval explain TRUTH ESTIMATE``: which single repairs would save most."""

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option, option
from tgospa_eval.cli.shared.options import CONFIG_FILE, EVALUATION, QUIET, VERBOSE, format_option
from tgospa_eval.errors import ExitStatus

LEFT_ASIDE = ("by", "preprocess")
"""Options of everything that evaluates that this verb has not; a settings file may have them."""


@click.command(
    "explain",
    cls=Verb,
    params=[
        *(item for item in EVALUATION if item.key not in LEFT_ASIDE),
        option("--by class", "", section="Filters", type=click.Choice(("class",)), hidden=True),
        option(
            "--preprocess motchallenge",
            "",
            section="Filters",
            type=click.Choice(("motchallenge",)),
            hidden=True,
        ),
        Option(
            "--top N",
            "How many repairs to list; up to twice as many are tried.",
            section="Output",
            type=click.IntRange(min=1),
            default=10,
        ),
        Option(
            "-o, --output FILE",
            "Write the repaired estimate: id,t and the state columns. The ending gives the "
            "format: .csv, .parquet or .npz.",
            section="Output",
            type=PATH,
        ),
        Option(
            "--apply N",
            "Rank of the repair that the file of -o has.",
            section="Output",
            type=click.IntRange(min=1),
            default=1,
        ),
        Option("--force", "Write over the file of -o if it exists.", section="Output"),
        format_option("table", "json", "csv", "markdown", "latex"),
        CONFIG_FILE,
        QUIET,
        VERBOSE,
    ],
)
@click.argument("truth", type=SOURCE)
@click.argument("estimate", type=SOURCE)
@click.pass_context
def command(ctx: click.Context, /, truth: str, estimate: str, **options: object) -> None:
    """Show which single repairs of ESTIMATE would save most of the cost, proven.

    A repair joins, exchanges, splits, drops, cuts, fills or extends tracks, or moves
    the whole estimate in time or space. What each saves is proven from bounds before
    and after it. Savings do not add up: apply one, and explain what is left.

    \b
    Examples:
      tgospa-eval explain truth.csv estimate.csv -c 10 -g 5
      tgospa-eval explain truth.csv estimate.csv --top 20 --format json
      tgospa-eval explain truth.csv estimate.csv --apply 2 -o repaired.csv

    Exit status: 0 done, 2 wrong option, 3 bad input, 4 accuracy not reached.
    """
    source = ctx.get_parameter_source
    typed = {name for name in options if source(name) is ParameterSource.COMMANDLINE}
    if "by" in typed:
        raise click.UsageError(
            "--by class: explain takes all rows together; choose one class by --class NAME"
        )
    if "preprocess" in typed:
        raise click.UsageError(
            "--preprocess: what it leaves out depends on the repair; explain files without such "
            "objects"
        )
    if options["output"] is None and typed & {"apply", "force"}:
        raise click.UsageError(f"--{min(typed & {'apply', 'force'})} is for the file of -o")
    from tgospa_eval.api.request import Request
    from tgospa_eval.cli.explain.run import ExplainOptions, explain_files
    from tgospa_eval.cli.shared.values import OutputOptions

    aside = dict.fromkeys(LEFT_ASIDE)
    finished = explain_files(
        (truth, estimate),
        Request.of({**options, **aside}),
        OutputOptions.of({**options, "output": None}),
        ExplainOptions.of(options),
    )
    ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)
