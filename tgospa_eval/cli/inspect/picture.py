"""The picture of ``inspect --plot``: checked before anything is read, and written whole."""

import os

from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.writing import check_apart
from tgospa_eval.errors import ConfigError
from tgospa_eval.plots import FILES, MISSING, available, written
from tgospa_eval.reports.files import check_file, write_file
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
    from tgospa_eval.plots.inspection import plot_inspection  # here: matplotlib takes a second
    from tgospa_eval.plots.style import styled

    made = plot_inspection(sides, unit=unit)
    with styled():
        data = written(made, _kind(path))
    write_file(path, data, PLOT_OPTION)
    if not quiet:
        print_notice(f"picture in {path}")


def _kind(path: str) -> str:
    return os.path.splitext(path)[1].lower().removeprefix(".")
