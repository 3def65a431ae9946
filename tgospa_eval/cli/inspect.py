"""``tgospa-eval inspect TRUTH [ESTIMATE]``: contents of the files, and problems with them."""

from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from tgospa_eval.api.options import Request
from tgospa_eval.cli.shared.click_builder import READING, STYLE, OutputOptions, format_option
from tgospa_eval.cli.shared.command import PATH, SOURCE, Option, Verb
from tgospa_eval.errors import ConfigError

if TYPE_CHECKING:
    from tgospa_eval.tracks.trajectories import Trajectories

PLOT = Option(
    "--plot FILE",
    "Draw the data to this file, a .png, .svg or .pdf: the trajectories in the plane, and the "
    "times of each. An existing picture is replaced.",
    section="Output",
    type=PATH,
)


@click.command("inspect", cls=Verb, params=[*READING, PLOT, STYLE, format_option("table", "json")])
@click.argument("truth", type=SOURCE)
@click.argument("estimate", type=SOURCE, required=False)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    truth: str,
    estimate: str | None,
    *,
    plot: str | None,
    **options: object,
) -> None:
    """Show what is in TRUTH, and how well ESTIMATE fits it in time and space.

    The files are read as evaluate reads them, and nothing is solved. If an id has
    several rows at one time, the rows are counted and the first one is used, unless
    --on-duplicate is given.

    \b
    Examples:
      tgospa-eval inspect truth.csv
      tgospa-eval inspect truth.csv estimate.csv -c 10
      tgospa-eval inspect truth.csv estimate.csv --plot seen.png

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.api.reading import align_sides, read_pair
    from tgospa_eval.api.resolve import resolve_request
    from tgospa_eval.cli.shared.progress import run
    from tgospa_eval.cli.shared.streams import emit, print_notice
    from tgospa_eval.common.config import settings_field
    from tgospa_eval.common.progress import Stopwatch
    from tgospa_eval.inspection import inspect, table
    from tgospa_eval.results.records import Json, json_text

    if ctx.get_parameter_source("on_duplicate") is ParameterSource.DEFAULT:
        options["on_duplicate"] = "first"
    paths = (truth,) if estimate is None else (truth, estimate)
    output = OutputOptions.of(options)
    request = Request.of({"switch_penalty": 0.0, **options})
    if plot is not None:
        from tgospa_eval.show.files import check_file
        from tgospa_eval.show.style import FILES, MISSING, available

        suffixes = [f".{kind}" for kind in FILES]
        ending = check_file(plot, "--plot", force=True, inputs=paths, suffixes=suffixes)
        if not available():
            raise ConfigError(MISSING)
    resolved, stopwatch = resolve_request(request), Stopwatch()

    def work() -> Json:
        with stopwatch.span("read"):
            sides = read_pair(resolved, *paths)
        if len(sides) == 1:
            fitted, evaluation_request = None, resolved.request(sides[0].trajectories.columns)
        else:
            fitted, evaluation_request = align_sides(resolved, sides, paths)
        if plot is not None:
            shown = [side.trajectories for side in sides] if fitted is None else fitted.read
            shown_sides = list(zip(paths, shown, strict=True))
            _write_picture(plot, ending[1:], output.style, shown_sides, request.unit or "")
            if not output.quiet:
                print_notice(f"picture in {plot}")
        document = inspect(list(zip(paths, sides, strict=True)), fitted, evaluation_request)
        return {**document, **settings_field(output.config)}

    document = run(work, stopwatch, show=not output.quiet)
    emit((json_text if output.format_ == "json" else table)(document), output.format_)


def _write_picture(
    path: str, kind: str, style: str, sides: "list[tuple[str, Trajectories]]", unit: str
) -> None:
    """Draw the states of the files, and write the picture in the format `kind`."""
    from tgospa_eval.common.writing import write_file
    from tgospa_eval.show.chart_list import Pictures, pictures

    wanted = Pictures(formats=(kind,), style=style)
    (data,) = pictures("inspect", (sides, unit), wanted).values()
    write_file(path, data, "--plot")
