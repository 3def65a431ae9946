"""``tgospa-eval inspect TRUTH [ESTIMATE]``: what was read, and what looks wrong with it."""

from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.options import reading_options


@click.command("inspect", context_settings={"max_content_width": 80})
@click.argument("truth", type=click.Path())
@click.argument("estimate", type=click.Path(), required=False)
@reading_options
@click.option(
    "--format", "format_", type=click.Choice(("table", "json")), default="table",
    show_default=True, help="What to print.",
)  # fmt: skip
@click.pass_context
def command(ctx: click.Context, /, truth: str, estimate: str | None, **options: Any) -> None:
    """Say what is in TRUTH, and how well ESTIMATE fits it in time and space.

    Reads as evaluate does, and solves nothing. Repeated (id, t) are counted instead
    of refused unless --on-duplicate is given; the first of them is taken.

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.cli.work import emit, inspect_files
    from tgospa_eval.reports.inspection import json_text, table

    if ctx.get_parameter_source("on_duplicate") is ParameterSource.DEFAULT:
        options["on_duplicate"] = "first"
    given = {"cutoff": ctx.get_parameter_source("cutoff") is not ParameterSource.DEFAULT}
    paths = (truth,) if estimate is None else (truth, estimate)
    document = inspect_files(paths, options, given)
    emit((json_text if options["format_"] == "json" else table)(document))
