"""From the values of the options to a result, and the result to stdout and files."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.cli.shared.distance import notices, unit_notices
from tgospa_eval.cli.shared.interrupts import undisturbed
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.settings import Settings, make_settings
from tgospa_eval.cli.shared.streams import emit, on_terminal, say
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.cli.shared.writing import Files, write_output
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import counted, install
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.diagnosis import alignment_notices, diagnose
from tgospa_eval.evaluation.diagnosis.scale import default_notice, explained
from tgospa_eval.evaluation.evaluate import evaluate_fitted
from tgospa_eval.evaluation.prepare import Fitted, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.reports import REPORTS
from tgospa_eval.reports.files import result_texts
from tgospa_eval.reports.folders import RESULT, probe_folder
from tgospa_eval.results.records import FileInfo
from tgospa_eval.results.summary import Summary

NARROWEST = 1e-12
"""Relative gap below which the outward rounding of the bounds may keep them apart."""

if TYPE_CHECKING:
    from tgospa_eval.plots.report import Pictures


Tell = Callable[[Notice], None]
"""What to do with a notice, or a warning."""


def teller(*, quiet: bool, say: Callable[[str], None] = say) -> Tell:
    """Prints notices, and warnings even where the user wants quiet."""

    def tell(notice: Notice) -> None:
        if notice.code or not quiet:
            say(str(notice))

    return tell


def evaluate_files(
    truth: str,
    estimate: str,
    options: EvaluationOptions,
    output: OutputOptions,
    say: Callable[[str], None] = say,
) -> tuple[Summary, bool]:
    """Read, evaluate, and say whether the asked accuracy was reached.

    Parameters
    ----------
    truth, estimate : str
        Paths.
    options : EvaluationOptions
        What to evaluate, and how.
    output : OutputOptions
        What to print, and where to write.
    say : callable
        What to do with a line for the user; by default it goes to stderr.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    settings = make_settings(options, output)
    wanted = None
    if output.output is not None:
        wanted = wanted_pictures(output)
        also = () if wanted is None else wanted.names
        also += ("curve.csv",) if options.curve else ()
        also += ("per_class.csv",) if options.by else ()
        probe_folder(output.output, RESULT, force=output.force, also=also)
    stopwatch = Stopwatch()
    if not output.quiet:
        stopwatch.tell = say

    tell = teller(quiet=output.quiet, say=say)

    def work() -> Summary:
        sides, fitted, request, warnings = read_sides((truth, estimate), settings, tell, stopwatch)
        if wanted is not None:
            with _named_options():
                wanted.check(sides[0].trajectories.columns)
        if settings.reading.by_class:
            of_all = replace(request, distance=fitted.distance)  # what it takes from the data
            result: Summary = _evaluate_classes(sides, of_all, stopwatch)
        else:
            result = evaluate_fitted(fitted, request, files=infos(sides), stopwatch=stopwatch)
        for notice in result.warnings:
            tell(notice)
        return replace(
            result,
            warnings=(*warnings, *result.warnings),
            files={"truth": truth, "estimate": estimate},
        )

    result = run(work, stopwatch, show=not output.quiet)
    if output.verbose:
        for text in _progress(result, stopwatch):
            say(text)
    if result.certified and not result.finished:
        missed = np.count_nonzero(~result.traced.met(result.gap)) if result.traced else 0
        where = f"{counted(int(missed), 'step')} of the curve"
        say(f"accuracy not reached at {where}, asked was {result.gap:g}")
    elif not result.finished:
        asked = f", asked was {result.gap:g}" if settings.solver.name == "certified" else ""
        narrowest = ""
        if result.gap < NARROWEST:
            narrowest = f": bounds are rounded outward, ask for no less than {NARROWEST:g}"
        say(
            f"accuracy not reached: solver {result.solver['status']}, the relative gap is "
            f"{result.relative_gap:.2g}{asked}{narrowest}"
        )
    return result, result.finished


def read_sides(
    paths: tuple[str, str], settings: Settings, tell: Tell, stopwatch: Stopwatch
) -> tuple[tuple[Reading, ...], Fitted, EvaluationRequest, tuple[Notice, ...]]:
    """Both files, the same on one grid, what is asked of them, and warnings.

    What the user should know of them is told.

    Raises
    ------
    TgospaError
        Something is wrong with the files, or the options do not fit them.
    """
    with stopwatch.span("read"):
        sides = settings.read(*paths)
    fitted, request = settings.fit(sides, paths)
    notices = [
        *(notice for path, side in zip(paths, sides, strict=True) for notice in about(path, side)),
        *pair_notices(fitted, request, pixels=any(side.pixels for side in sides)),
        *(slow_notice() if settings.solver.name != "exact" else ()),
    ]
    for notice in notices:
        tell(notice)
    return sides, fitted, request, tuple(notice for notice in notices if notice.code)


def _evaluate_classes(
    sides: tuple[Reading, ...], request: EvaluationRequest, stopwatch: Stopwatch
) -> Summary:
    """One evaluation for each class, and their sum."""
    from tgospa_eval.common.words import natural
    from tgospa_eval.results.by_class import add_up

    truth, estimate = sides
    read_s = stopwatch.elapsed()
    results = {}
    classes = sorted({*truth.classes, *estimate.classes}, key=natural) or [""]
    for number, name in enumerate(classes):
        part = stopwatch.beside()
        with stopwatch.progress.part(f"class {name}", number, len(classes)):
            fitted = fit(truth.of_class(name), estimate.of_class(name), request)
            results[name] = evaluate_fitted(fitted, request, stopwatch=part)
        stopwatch.absorb(part)
    return add_up(results, infos(sides), read_s)


def inspect_files(
    paths: tuple[str, ...], options: EvaluationOptions, output: OutputOptions
) -> dict[str, Any]:
    """What one file or two hold and what looks wrong with it, as the JSON document of the verb.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    from tgospa_eval.inspection import inspect

    settings = make_settings(options, output)
    stopwatch = Stopwatch()

    def work() -> dict[str, Any]:
        with stopwatch.span("read"):
            sides = settings.read(*paths)
        if len(sides) == 1:
            fitted, request = None, settings.request(sides[0].trajectories.columns)
        else:
            fitted, request = settings.fit(sides, paths)
        return inspect(list(zip(paths, sides, strict=True)), fitted, request)

    return run(work, stopwatch, show=not output.quiet)


def slow_notice() -> Iterator[Notice]:
    """A notice where the kernels were not built."""
    if KERNEL == "numpy":
        yield Notice(
            text="no compiled kernels, slower: installing with a C compiler at hand builds them"
        )


def about(path: str, side: Reading) -> Iterator[Notice]:
    """What the user should know of one file."""
    for text in side.notices:
        yield Notice(text=f"{path}: {text}")
    for notice in side.warnings:
        yield notice.about(path)


def infos(sides: tuple[Reading, ...]) -> tuple[FileInfo, FileInfo]:
    """What the result says of both files."""
    truth, estimate = (
        FileInfo(rows=side.rows, format=side.format, left_out=side.left_out) for side in sides
    )
    return truth, estimate


def pair_notices(sides: Fitted, request: EvaluationRequest, *, pixels: bool) -> Iterator[Notice]:
    """What the user should know of the choice of the distance, and of the two files together.

    `pixels` says whether places of one of them are in pixels.
    """
    aligned, distance, parameters = sides.alignment, sides.distance, request.parameters
    yield from notices(distance, aligned.truth.columns, parameters.cutoff)
    truth, estimate = sides.read
    if "gaussian" in distance.kinds:
        for text in _about_points(truth.kind == "point", estimate.kind == "point"):
            yield Notice(text=text)
    if pixels:
        yield from unit_notices(request.unit)
    for text in alignment_notices(aligned, request.time_matching):
        yield Notice(text=text)
    found = diagnose(sides.read, aligned, request.time_matching, parameters, distance)
    yield from found
    if request.defaults:
        yield default_notice(
            aligned, distance, parameters, request.defaults, others=explained(found)
        )


def _about_points(truth: bool, estimate: bool) -> Iterator[str]:
    """What states without covariance mean; the two say whether a side has none."""
    if truth and estimate:
        yield "neither side has covariances: gaussian-wasserstein is the euclidean distance"
    elif truth:
        yield (
            "the truth has no covariances: against points a smaller reported covariance always "
            "costs less, whether it is right or not"
        )


def _progress(result: Summary, stopwatch: Stopwatch) -> Iterator[str]:
    """Times of the stages, and how the solver came near."""
    for name, seconds in stopwatch.spans.items():
        yield f"{name:<20} {seconds:9.3f} s"
    if stopwatch.work:
        yield (
            f"{'one state':<20} {stopwatch.nanoseconds:9.1f} ns in half a sweep, of "
            f"{stopwatch.work} done"
        )
    for check in result.solver["history"]:
        yield (
            f"sweep {check['sweep']:5d}  epsilon {check['epsilon']:<7g} "
            f"violation {check['violation']:.1e}  total {check['lower']:.9g} to "
            f"{check['upper']:.9g}"
        )


def show(result: Summary, output: OutputOptions, names: tuple[str, str]) -> None:
    """Print the result, and write the folder if one was asked for."""
    try:
        if output.output is not None:
            _write(result, output, names)
    except ConfigError:  # a full disk must not cost what was computed
        _print(result, output)
        raise
    with undisturbed():
        _print(result, output)


def _print(result: Summary, output: OutputOptions) -> None:
    """The result to stdout."""
    name = output.format_
    if name == "table" and on_terminal():
        from tgospa_eval.reports.terminal import report  # here: rich is for terminals alone

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
    from tgospa_eval.plots.report import Pictures, names_in  # here: of folders alone

    if output.pictures == "none":
        return None
    parts, plane = output.components, output.plane
    with _named_options():
        return Pictures(
            formats=names_in(output.pictures),
            style=output.style,
            components=None if parts is None else names_in(parts),
            columns=None if plane is None else names_in(plane),
        )


@contextmanager
def _named_options() -> Iterator[None]:
    """What is wrong with pictures, with the name of the option as it is typed."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"--{error}") from None


def _write(result: Summary, output: OutputOptions, names: tuple[str, str]) -> None:
    """The result folder; says what is not in it for want of an extra."""
    from tgospa_eval import plots

    wanted = wanted_pictures(output)
    absent: list[tuple[str, str]] = []

    def make(tell: Callable[[str, float], None]) -> Files:
        tell("report.html", 0.0)
        texts, missing = result_texts(result, names)
        absent.extend(("report.html", extra) for extra in missing)
        if wanted is None:
            return texts
        if not plots.available():
            absent.append(("the pictures", "plot"))
            return texts
        from tgospa_eval.plots.report import result_pictures

        return {**texts, **result_pictures(result, wanted, tell)}

    write_output(output, RESULT, make)
    if absent and not output.quiet:
        what, extras = (list(column) for column in zip(*absent, strict=True))
        single = absent == [("report.html", "report")]
        say(
            f"{' and '.join(what)} {'is' if single else 'are'} not written: "
            f"{'it needs' if single else 'they need'} {install(*extras)}"
        )
