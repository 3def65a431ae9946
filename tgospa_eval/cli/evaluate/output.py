"""A result to stdout, and to the folder of ``-o``."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tgospa_eval.cli.shared.interrupts import undisturbed
from tgospa_eval.cli.shared.streams import emit, on_terminal, print_notice
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.cli.shared.writing import Files, write_output
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports import REPORTS
from tgospa_eval.reports.files import result_texts
from tgospa_eval.reports.folders import PROOF_FOLDER, RESULT
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from tgospa_eval.plots.result_pictures import Pictures


def show(
    result: Summary, options: EvaluationOptions, output: OutputOptions, names: tuple[str, str]
) -> None:
    """Print the result, and write the folder if one was asked for."""
    try:
        if output.output is not None:
            _write(result, options, output, names)
    except ConfigError:  # a full disk must not cost what was computed
        _print(result, output)
        raise
    with undisturbed():
        _print(result, output)


def _print(result: Summary, output: OutputOptions) -> None:
    """The result to stdout."""
    name = output.format_
    if name == "table" and on_terminal():
        from tgospa_eval.reports.terminal import report  # here: rich is for terminals only

        emit(report(result, sys.stdout.encoding or "ascii"), "colours")
    else:
        emit(REPORTS[name](result), name)


def wanted_pictures(output: OutputOptions) -> "Pictures | None":
    """The pictures that the options ask for; None without an option of that kind, or for none.

    Raises
    ------
    ConfigError
        Something is wrong with them.
    """
    from tgospa_eval.plots.result_pictures import Pictures, names_in  # here: for folders only

    if output.pictures == "none":
        return None
    parts, plane = output.components, output.plane
    with named_options():
        return Pictures(
            formats=names_in(output.pictures),
            style=output.style,
            components=None if parts is None else names_in(parts),
            columns=None if plane is None else names_in(plane),
        )


@contextmanager
def named_options() -> Iterator[None]:
    """What is wrong with pictures, with the name of the option as it is typed."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"--{error}") from None


def _write(
    result: Summary, options: EvaluationOptions, output: OutputOptions, names: tuple[str, str]
) -> None:
    """The result folder; prints what is not in it for want of an extra."""
    from tgospa_eval import plots

    wanted = wanted_pictures(output)
    absent: list[tuple[str, str]] = []

    def make(notify: Callable[[str, float], None]) -> Files:
        from tgospa_eval.reports.page_data import document  # here: for folders only

        notify("report.html", 0.0)
        drawn = document(result)
        texts, missing = result_texts(result, names, drawn)
        if output.proof:
            from tgospa_eval.reports.proofs import proof_files  # here: only where asked for

            notify(PROOF_FOLDER, 0.0)
            proof = proof_files(result, options.given)
            texts |= {f"{PROOF_FOLDER}/{name}": text for name, text in proof.items()}
        absent.extend(("report.html", extra) for extra in missing)
        if wanted is None:
            return texts
        if not plots.available():
            absent.append(("the pictures", "plot"))
            return texts
        from tgospa_eval.plots.result_pictures import result_pictures

        return {**texts, **result_pictures(result, wanted, notify, drawn)}

    write_output(output, RESULT, make)
    if absent and not output.quiet:
        what, extras = (list(column) for column in zip(*absent, strict=True))
        single = absent == [("report.html", "report")]
        print_notice(
            f"{' and '.join(what)} {'is' if single else 'are'} not written: "
            f"{'it needs' if single else 'they need'} {install(*extras)}"
        )
