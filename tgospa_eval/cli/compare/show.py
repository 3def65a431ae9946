"""A comparison to stdout, and to the folder that was asked for."""

from collections.abc import Callable, Mapping

from tgospa_eval import plots
from tgospa_eval.cli.shared.interrupts import undisturbed
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import write_output
from tgospa_eval.reports.comparison import render
from tgospa_eval.reports.folders import COMPARISON, STUDY, Files
from tgospa_eval.reports.records import Comparison
from tgospa_eval.reports.study import study_report
from tgospa_eval.results.records import json_text


def show(
    answer: Comparison, output: OutputOptions, tables: Mapping[str, str], draw: plots.Draw
) -> None:
    """Print the document, and write the folder if one was asked for.

    Parameters
    ----------
    answer : dict
        The document.
    output : OutputOptions
        What to print, and where to write.
    tables : mapping of str to str
        Further files by name.
    draw : callable
        Makes figures by name; it is called where matplotlib is there.
    """
    kind = STUDY if answer["kind"] == "study" else COMPARISON
    if output.config is not None:
        answer["settings_file"] = output.config.record()

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("the pictures", 0.0)
        pictures: dict[str, bytes] = {}
        if plots.available():
            pictures = plots.pictures(draw)
        elif not output.quiet:
            print_notice(plots.MISSING)
        files: dict[str, str | bytes] = {
            "compare.json": json_text(answer),
            "compare.csv": render(answer, "csv"),
            **tables,
            **pictures,
        }
        if answer["kind"] == "study":
            names = [name.removesuffix(".png") for name in pictures]
            files["report.md"] = study_report(answer, names)
        return files

    try:
        with undisturbed():
            emit(render(answer, output.format_), output.format_)
    finally:  # the one is not lost where the other fails
        write_output(output, kind, make)
