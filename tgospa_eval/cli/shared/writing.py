"""The folder of ``-o``: made in a thread, written at once, announced."""

import os
from collections.abc import Callable

from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import heard, print_notice, undisturbed
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.files import Files, Kind, write_texts


def write_output(
    output: OutputOptions, kind: Kind, make: Callable[[Callable[[str, float], None]], Files]
) -> None:
    """Write the folder if one was asked for, and nothing was interrupted.

    Parameters
    ----------
    output : OutputOptions
        Where to write, and what to print.
    kind : Kind
        What the folder holds.
    make : callable
        Makes the files by name; gets what takes the name of each that is drawn, and the share done.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    folder = output.output
    if folder is None:
        return
    files = None if heard() else _made(output, make)
    if files is None:
        print_notice(f"interrupted: nothing is written to {folder}")
        return
    with undisturbed():
        written = write_texts(files, folder, kind, force=output.force)
    if not output.quiet:
        print_notice(str(written))


def _made(
    output: OutputOptions, make: Callable[[Callable[[str, float], None]], Files]
) -> Files | None:
    """The files by name; None if that was interrupted."""
    stopwatch = Stopwatch()
    stopwatch.stage = "report"

    def notify(name: str, share: float) -> None:
        stopwatch.stage = f"drawing {name}"
        stopwatch.progress.done(share)

    try:
        return run(lambda: make(notify), stopwatch, show=not output.quiet)
    except KeyboardInterrupt:  # what is known is printed all the same
        return None


def check_apart(path: str, others: list[str], option: str) -> None:
    """Whether what is written would replace what is read, or is written as well.

    Raises
    ------
    ConfigError
        `path` is the same file as one of `others`.
    """
    for other in others:
        if os.path.realpath(path) == os.path.realpath(other):
            raise ConfigError(f"{option} {path}: is read or written otherwise; name another file")
