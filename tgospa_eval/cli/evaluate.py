"""``tgospa-eval [evaluate] TRUTH ESTIMATE``: one evaluation, printed and optionally written."""

from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.options import OF_PICTURES, evaluation_options

ACCURACY_MISSED = 4


@click.command("evaluate", context_settings={"max_content_width": 80})
@click.argument("truth", type=click.Path())
@click.argument("estimate", type=click.Path())
@click.option(  # not from settings files: it would make a sweep of every evaluation
    "--sweep", metavar="NAME=VALUES", multiple=True,
    help="Over a range of cutoff, switch-penalty or order: cutoff=2:50:12 (12 values, evenly "
    "spaced), cutoff=2:50:12:log, or cutoff=2,5,10.",
)  # fmt: skip
@click.option(
    "--curve", is_flag=True,
    help="Evaluate the steps up to each step as well: the normalised curve of the literature.",
)  # fmt: skip
@evaluation_options
@click.pass_context
def command(
    ctx: click.Context, /, truth: str, estimate: str, sweep: tuple[str, ...], **options: Any
) -> None:
    """Evaluate ESTIMATE against TRUTH with the TGOSPA metric.

    Both are tables id,t,x[,y[,z]] (CSV, Parquet), one row per object and step, or
    MOTChallenge or KITTI text; a row that is not there means that the object does
    not exist at that step.

    Exit status: 0 done, 2 wrong option, 3 bad input file, 4 accuracy not reached.
    """
    for name in OF_PICTURES if options["output"] is None else ():
        if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name} is for the pictures of -o DIR")
    from tgospa_eval.cli.work import evaluate_files, show

    given = {
        name: ctx.get_parameter_source(name) is not ParameterSource.DEFAULT
        for name in ("cutoff", "switch_penalty")
    }
    if sweep:
        from tgospa_eval.cli.sweeping import sweep_files

        source = ctx.get_parameter_source
        typed = {name for name in options if source(name) is ParameterSource.COMMANDLINE}
        finished = sweep_files((truth, estimate), sweep, options, given, typed)
        ctx.exit(0 if finished else ACCURACY_MISSED)
    result, finished = evaluate_files(truth, estimate, options, given)
    show(result, options, (truth, estimate))
    ctx.exit(0 if finished else ACCURACY_MISSED)
