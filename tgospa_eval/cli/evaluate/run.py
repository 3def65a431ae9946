"""``evaluate`` of two files: from options to a result, and its output to stdout and a folder."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from tgospa_eval.api.evaluate import evaluate_sides, read_sides
from tgospa_eval.api.notices import about_run
from tgospa_eval.api.options import Request
from tgospa_eval.api.resolve import resolve_request
from tgospa_eval.cli.shared.click_builder import OutputOptions
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import emit, notifier, on_terminal, print_notice, shielded
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.memory import left_of_drawing
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.show.result_text import REPORTS

if TYPE_CHECKING:
    from tgospa_eval.results.explanation import Explanation


def evaluate_files(
    truth: str,
    estimate: str,
    options: Request,
    output: OutputOptions,
    output_line: Callable[[str], None] = print_notice,
) -> tuple[Evaluation, bool]:
    """Evaluate two files; return the result, and whether the requested accuracy was reached.

    Parameters
    ----------
    truth, estimate : str
        Paths.
    options : Request
        What to evaluate, and how.
    output : OutputOptions
        What to print, and where to write.
    output_line : callable
        Function that receives each line for the user. The default writes it to stderr.

    Raises
    ------
    TgospaError
        An option or a file is wrong.
    """
    resolved = resolve_request(options)
    limit = resolved.evaluation.memory
    if limit is not None and output.output is not None:
        limit = left_of_drawing(limit, (truth, estimate))
        resolved = replace(resolved, evaluation=replace(resolved.evaluation, memory=limit))
    wanted = None
    if output.output is not None:
        # lazy: only for folders
        from tgospa_eval.cli.shared.writing import named_options, probed_folder

        wanted = probed_folder(options, output)
    stopwatch = Stopwatch()
    if not output.quiet:
        stopwatch.notify = output_line
    notify = notifier(quiet=output.quiet, output=output_line)

    def work() -> Evaluation:
        sides = read_sides(resolved, truth, estimate, stopwatch, notify)
        if wanted is not None:
            with named_options():
                wanted.check(sides.read[0].trajectories.columns)
        result = evaluate_sides(resolved, sides, stopwatch, notify)
        return replace(result, settings_file=output.config)

    result = run(work, stopwatch, show=not output.quiet)
    for text in about_run(result, resolved, stopwatch, verbose=output.verbose):
        output_line(text)
    return result, result.finished


# -------------------------------------------------------------------------------------------------
# Repairs of the estimate of a result, for ``--explain`` and the verb ``explain``.


def explained(result: Evaluation, output: OutputOptions, top: int | None = None) -> "Explanation":
    """Search for the repairs of the estimate that save most, and show the progress.

    Parameters
    ----------
    result : Evaluation
        Result of all classes together.
    output : OutputOptions
        What to print: progress, and the time of the search.
    top : int
        Largest number of repairs; the default is that of `tgospa_eval.explain`.
    """
    from tgospa_eval.explain import TOP, explain  # lazy: only for repairs

    assert isinstance(result, PairEvaluation)  # `explain` with `by class` was refused before
    stopwatch = Stopwatch()
    explanation = run(
        lambda: explain(result, top or TOP, stopwatch=stopwatch),
        stopwatch,
        show=not output.quiet,
    )
    if output.verbose:
        print_notice(f"{'explain':<20} {explanation.seconds:9.3f} s")
    return explanation


def with_repairs(result: Evaluation, output: OutputOptions) -> Evaluation:
    """Return the result with its repairs, and with the time of their search."""
    assert isinstance(result, PairEvaluation)
    explanation = explained(result, output)
    total = result.timings["total"] + explanation.seconds
    timings = {**result.timings, "explain": explanation.seconds, "total": total}
    return replace(result, explained=explanation, timings=timings)


# -------------------------------------------------------------------------------------------------
# Output of a result to stdout, and to the folder of ``-o``.


def show(
    result: Evaluation, options: Request, output: OutputOptions, names: tuple[str, str]
) -> None:
    """Print the result, and write the folder of ``-o`` if requested.

    `names` are those of both files, for the HTML page.
    """
    try:
        if output.output is not None:
            from tgospa_eval.cli.shared.writing import write_folder  # lazy: only for folders

            write_folder(result, options, output, names)
    except ConfigError:  # the result is printed even if the disk is full
        _print(result, output)
        raise
    with shielded():
        _print(result, output)


def _print(result: Evaluation, output: OutputOptions) -> None:
    """Print the result to stdout in the requested format, in colours on a terminal."""
    name = output.format_
    if name == "table" and on_terminal():
        from tgospa_eval.show.result_text import report  # lazy: only for terminals

        emit(report(result), "colours")
    else:
        emit(REPORTS[name](result), name)
