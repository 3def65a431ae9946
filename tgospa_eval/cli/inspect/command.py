"""``tgospa-eval inspect TRUTH [ESTIMATE]``: what was read, and what looks wrong with it."""

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, SOURCE, Option
from tgospa_eval.cli.shared.options import READING, format_option

PLOT = Option(
    "--plot FILE",
    "Draw what was read to this file, a .png, .svg or .pdf: the plane, and who is there when. A "
    "picture of that name is replaced.",
    section="Output",
    type=PATH,
)


@click.command("inspect", cls=Verb, params=[*READING, PLOT, format_option("table", "json")])
@click.argument("truth", type=SOURCE)
@click.argument("estimate", type=SOURCE, required=False)
@click.pass_context
def command(ctx: click.Context, /, truth: str, estimate: str | None, **options: object) -> None:
    """Show what is in TRUTH, and how well ESTIMATE fits it in time and space.

    The files are read as evaluate reads them, and nothing is solved. Where an id has
    several rows at one time these are counted, and the first is taken, unless
    --on-duplicate is given.

    \b
    Examples:
      tgospa-eval inspect truth.csv
      tgospa-eval inspect truth.csv estimate.csv -c 10
      tgospa-eval inspect truth.csv estimate.csv --plot seen.png

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.api.request import Request
    from tgospa_eval.cli.inspect.run import inspect_files
    from tgospa_eval.cli.shared.streams import emit
    from tgospa_eval.cli.shared.values import OutputOptions
    from tgospa_eval.reports.inspection import table
    from tgospa_eval.results.records import json_text

    if ctx.get_parameter_source("on_duplicate") is ParameterSource.DEFAULT:
        options["on_duplicate"] = "first"
    paths = (truth,) if estimate is None else (truth, estimate)
    output = OutputOptions.of(options)
    plot = None if options["plot"] is None else str(options["plot"])
    chosen = Request.of({"switch_penalty": 0.0, **options})
    document, name = inspect_files(paths, chosen, output, plot), output.format_
    emit((json_text if name == "json" else table)(document), name)
