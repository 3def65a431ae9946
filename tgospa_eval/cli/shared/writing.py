"""Writing of the folder of ``-o``: a check before any work, and all files together at the end."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tgospa_eval.api.options import Request
from tgospa_eval.cli.shared.click_builder import OutputOptions
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import interrupted, print_notice, shielded
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.proof import PROOF_FOLDER
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.show.files import (
    GEOJSON,
    PROOF_FILES,
    RESULT,
    Files,
    Kind,
    probe_folder,
    result_pictures,
    result_texts,
    write_texts,
)

if TYPE_CHECKING:
    from tgospa_eval.show.chart_list import Pictures


def write_output(
    output: OutputOptions, kind: Kind, make: Callable[[Callable[[str, float], None]], Files]
) -> None:
    """Write the folder of ``-o`` if it is requested. After a Ctrl-C, nothing is written.

    Parameters
    ----------
    output : OutputOptions
        Where to write, and what to print.
    kind : Kind
        Kind of the folder.
    make : callable
        Function that returns the content of the files by name. Its argument is a function that
        shows progress: it receives the name of the next picture, and the share of the work that is
        done.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    folder = output.output
    if folder is None:
        return
    files = None if interrupted() else _made(output, make)
    if files is None:
        print_notice(f"interrupted: nothing was written to {folder}")
        return
    proof = os.path.join(folder, PROOF_FOLDER)
    had_proof = os.path.isdir(proof)
    with shielded():
        written = write_texts(files, folder, kind, force=output.force)
    if not output.quiet:
        print_notice(written)
    if had_proof and not os.path.isdir(proof):  # the user must know: a paper may refer to it
        print_notice(f"{proof} of an earlier run is removed; --proof writes one for this run")


def _made(
    output: OutputOptions, make: Callable[[Callable[[str, float], None]], Files]
) -> Files | None:
    """Make the files of `write_output`, and show progress; return None after a Ctrl-C."""
    stopwatch = Stopwatch()
    stopwatch.stage = "report"

    def notify(name: str, share: float) -> None:
        stopwatch.stage = f"drawing {name}"
        stopwatch.progress.done(share)

    try:
        return run(lambda: make(notify), stopwatch, show=not output.quiet)
    except KeyboardInterrupt:  # the folder is not written, but the result is printed
        return None


# -------------------------------------------------------------------------------------------------
# The folder of a result: which files are requested, and how it is written.


def probed_folder(
    options: Request, output: OutputOptions, also: tuple[str, ...] = ()
) -> "Pictures | None":
    """Check that the folder of a result can be written; return which pictures are requested.

    `also` has the names of further files that will be written to it.

    Raises
    ------
    ConfigError
        The folder cannot be written, or the request for its files is wrong.
    """
    also += ("curve.csv",) if options.curve else ()
    also += ("windows.csv",) if options.window is not None else ()
    also += ("per_class.csv",) if options.by else ()
    also += ("explanation.json", "explanation.csv") if options.explain else ()
    also += (GEOJSON,) if output.geojson else ()
    also += tuple(f"{PROOF_FOLDER}/{name}" for name in PROOF_FILES) if output.proof else ()
    return probed(output, RESULT, "result", also=also)


def probed(
    output: OutputOptions, kind: Kind, *charts: str, also: tuple[str, ...] = ()
) -> "Pictures | None":
    """Check that the folder of ``-o`` can be written; return which pictures are requested.

    Without ``-o``, return None. `charts` names the kinds of results whose pictures will be drawn.
    `also` has the names of further files that will be written.

    Raises
    ------
    ConfigError
        The folder cannot be written, or the request for pictures is wrong.
    """
    if output.output is None:
        return None
    wanted = wanted_pictures(output)
    also += () if wanted is None else wanted.names(*charts)
    probe_folder(output.output, kind, force=output.force, also=also)
    return wanted


def wanted_pictures(output: OutputOptions) -> "Pictures | None":
    """Return which pictures are requested; None for ``--pictures none``, or if a verb draws none.

    Raises
    ------
    ConfigError
        The request for pictures is wrong.
    """
    if output.pictures == "none":
        return None
    from tgospa_eval.show.chart_list import Pictures  # lazy: only for pictures

    given = (output.pictures, output.components, output.plane)
    formats, components, columns = (
        None if text is None else tuple(map(str.strip, text.split(","))) for text in given
    )
    with named_options():
        return Pictures(
            formats=formats or (), style=output.style, components=components, columns=columns
        )


def can_draw(*, quiet: bool) -> bool:
    """Return whether matplotlib is installed; if not, print a notice."""
    from tgospa_eval.show import style  # lazy: only for folders

    if not style.available() and not quiet:
        print_notice(style.MISSING)
    return style.available()


def drawable_pictures(output: OutputOptions) -> "Pictures | None":
    """Return which pictures are requested; None if they cannot be drawn."""
    wanted = wanted_pictures(output)
    return wanted if wanted is not None and can_draw(quiet=output.quiet) else None


@contextmanager
def named_options() -> Iterator[None]:
    """Put two dashes before an error about pictures, because it begins with an option's name."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"--{error}") from None


def write_folder(
    result: Evaluation, options: Request, output: OutputOptions, names: tuple[str, str]
) -> None:
    """Write the folder of a result; print a notice if pictures cannot be drawn."""
    wanted = drawable_pictures(output)

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("report.html", 0.0)
        texts = {**result_texts(result, names)}
        if output.proof:
            from tgospa_eval.show.files import proof_files  # lazy: only for proofs

            notify(PROOF_FOLDER, 0.0)
            proof = proof_files(result, options.given)
            texts |= {f"{PROOF_FOLDER}/{name}": text for name, text in proof.items()}
        if output.geojson:
            notify(GEOJSON, 0.0)
            from tgospa_eval.show.files import geojson  # lazy: slow to import

            texts |= {GEOJSON: geojson(result)}
        return texts | ({} if wanted is None else result_pictures(result, wanted, notify))

    write_output(output, RESULT, make)
