"""``tgospa-eval explain TRUTH ESTIMATE``: which single repairs would save most."""

import os
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.click_options import (
    CONFIG_FILE,
    EVALUATION,
    QUIET,
    VERBOSE,
    format_option,
)
from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option, option
from tgospa_eval.errors import ConfigError, ExitStatus

if TYPE_CHECKING:
    from tgospa_eval.results.explanation import Explanation

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
    typed = {name for name in ctx.params if source(name) is ParameterSource.COMMANDLINE}
    if "by" in typed:
        raise click.UsageError(
            "--by class: explain takes all rows together; choose one class by --class NAME"
        )
    if "preprocess" in typed:
        raise click.UsageError(
            "--preprocess: what it leaves out depends on the repair; explain files without such "
            "objects"
        )
    if output is None and typed & {"apply", "force"}:
        raise click.UsageError(f"--{min(typed & {'apply', 'force'})} is for the file of -o")
    from tgospa_eval.api.options import Request
    from tgospa_eval.cli.evaluate.run import evaluate_files, explained
    from tgospa_eval.cli.shared.streams import emit
    from tgospa_eval.cli.shared.values import OutputOptions
    from tgospa_eval.cli.shared.writing import check_apart
    from tgospa_eval.formats.write import TABLES
    from tgospa_eval.reports import rendered
    from tgospa_eval.reports.explanation import explanation_document
    from tgospa_eval.reports.files import check_file

    if output is not None:
        check_file(output, force=force, option="-o")
        check_apart(output, [truth, estimate], "-o")
        if _ending(output) not in TABLES:
            raise ConfigError(f"-o {output}: must end in {', '.join(TABLES)}")
    request, shown = Request.of(options | dict.fromkeys(LEFT_ASIDE)), OutputOptions.of(options)
    result, finished = evaluate_files(truth, estimate, request, shown)
    found = explained(result, request, shown, max(top, apply))
    if output is not None:
        _write(found, apply, output, quiet=shown.quiet)
    emit(rendered(found, shown.format_, explanation_document(found)), shown.format_)
    ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)


def _ending(path: str) -> str:
    return os.path.splitext(path)[1].casefold()


def _write(found: "Explanation", rank: int, path: str, *, quiet: bool) -> None:
    """Write the estimate with the repair of a rank."""
    from tgospa_eval.cli.shared.streams import print_notice
    from tgospa_eval.formats.write import TABLES
    from tgospa_eval.reports.files import write_file

    try:
        repaired = found.repaired(rank)
    except ConfigError as error:
        raise ConfigError(f"--apply {rank}: {error}; nothing is written") from None
    write_file(path, TABLES[_ending(path)](repaired), "-o")
    if not quiet:
        text = found.repairs[rank - 1].text
        print_notice(f"wrote {path}: the estimate with repair {rank}, {text}")
