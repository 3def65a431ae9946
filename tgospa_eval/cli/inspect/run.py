"""From the options of ``inspect`` to its document."""

import os

from tgospa_eval.api.request import Request
from tgospa_eval.api.settings import make_settings
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import check_apart
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.inspection import inspect
from tgospa_eval.plots import FILES, MISSING, available, written
from tgospa_eval.reports.files import check_file, write_file
from tgospa_eval.results.records import Json
from tgospa_eval.tracks.trajectories import Trajectories

PLOT_OPTION = "--plot"


def check_picture(path: str, inputs: tuple[str, ...]) -> None:
    """Whether a picture may be written there.

    Raises
    ------
    ConfigError
        Its name has no known ending, it is one of the inputs or a folder, or matplotlib is missing.
    """
    if _kind(path) not in FILES:
        raise ConfigError(f"{PLOT_OPTION} {path}: must end in .{', .'.join(FILES)}")
    check_apart(path, list(inputs), PLOT_OPTION)
    check_file(path, force=True, option=PLOT_OPTION)
    if not available():
        raise ConfigError(MISSING)


def write_picture(
    path: str, sides: list[tuple[str, Trajectories]], unit: str, *, quiet: bool
) -> None:
    """Draw what was read.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    from tgospa_eval.plots.plane import plot_inspection  # here: matplotlib takes a second
    from tgospa_eval.plots.style import styled

    made = plot_inspection(sides, unit=unit)
    with styled():
        data = written(made, _kind(path))
    write_file(path, data, PLOT_OPTION)
    if not quiet:
        print_notice(f"picture in {path}")


def _kind(path: str) -> str:
    return os.path.splitext(path)[1].lower().removeprefix(".")


def inspect_files(
    paths: tuple[str, ...],
    options: Request,
    output: OutputOptions,
    plot: str | None = None,
) -> Json:
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

    def work() -> Json:
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
