"""From the options of ``inspect`` to its document."""

from tgospa_eval.cli.inspect.picture import check_picture, write_picture
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.settings import make_settings
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.inspection import inspect
from tgospa_eval.reports.inspection import Inspection


def inspect_files(
    paths: tuple[str, ...],
    options: EvaluationOptions,
    output: OutputOptions,
    plot: str | None = None,
) -> Inspection:
    """What one file or two hold and what looks wrong with it, as the JSON document of the verb.

    `plot` is the file of a picture to write.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    if plot is not None:
        check_picture(plot, paths)
    settings = make_settings(options)
    stopwatch = Stopwatch()

    def work() -> Inspection:
        with stopwatch.span("read"):
            sides = settings.read(*paths)
        if len(sides) == 1:
            fitted, request = None, settings.request(sides[0].trajectories.columns)
        else:
            fitted, request = settings.fit(sides, paths)
        if plot is not None:
            shown = [side.trajectories for side in sides] if fitted is None else fitted.read
            named = list(zip(paths, shown, strict=True))
            write_picture(plot, named, options.unit or "", quiet=output.quiet)
        found = inspect(list(zip(paths, sides, strict=True)), fitted, request)
        return {**found, **settings_field(output.config)}

    return run(work, stopwatch, show=not output.quiet)
