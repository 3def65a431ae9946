"""A result to stdout, and to the folder of ``-o``."""

import sys

from tgospa_eval.cli.shared.interrupts import undisturbed
from tgospa_eval.cli.shared.streams import emit, on_terminal
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports import REPORTS
from tgospa_eval.results.summary import Summary


def show(
    result: Summary, options: EvaluationOptions, output: OutputOptions, names: tuple[str, str]
) -> None:
    """Print the result, and write the folder if one was asked for."""
    try:
        if output.output is not None:
            from tgospa_eval.cli.evaluate.folder import write_folder  # here: only where asked for

            write_folder(result, options, output, names)
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
