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
from tgospa_eval.cli.shared.settings import Settings, make_settings, make_solver
from tgospa_eval.cli.shared.streams import emit, on_terminal, say
from tgospa_eval.cli.shared.writing import Files, write_output
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import counted, install
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.diagnosis import alignment_notices, diagnose
from tgospa_eval.evaluation.diagnosis.scale import default_notice, explained
from tgospa_eval.evaluation.evaluate import check_curve, evaluate_trajectories
from tgospa_eval.formats import Reading
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.reports import REPORTS
from tgospa_eval.reports.files import result_texts
from tgospa_eval.reports.folders import RESULT, probe_folder
from tgospa_eval.results.summary import Summary
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import Alignment

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
    options: dict[str, Any],
    given: dict[str, bool],
    say: Callable[[str], None] = say,
) -> tuple[Summary, bool]:
    """Read, evaluate, and say whether the asked accuracy was reached.

    Parameters
    ----------
    truth, estimate : str
        Paths.
    options : dict
        Values of the options.
    given : dict
        Whether cutoff and switch penalty were given, or are defaults.
    say : callable
        What to do with a line for the user; by default it goes to stderr.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    quiet = options["quiet"]
    settings = make_settings(options, given)
    solver = make_solver(options)
    if options.get("curve"):
        check_curve(solver)
    wanted = None
    if options["output"] is not None:
        wanted = wanted_pictures(options)
        also = () if wanted is None else wanted.names
        also += ("curve.csv",) if options.get("curve") else ()
        also += ("per_class.csv",) if options.get("by") else ()
        probe_folder(options["output"], RESULT, force=options["force"], also=also)
    stopwatch = Stopwatch()
    if not quiet:
        stopwatch.tell = say

    tell = teller(quiet=quiet, say=say)

    def work() -> Summary:
        sides, distance, warnings = read_sides(
            (truth, estimate), settings, solver, given, tell, stopwatch
        )
        if wanted is not None:
            with _named_options():
                wanted.check(sides[0].trajectories.columns)
        result = evaluate_sides(
            sides, distance, settings, solver, stopwatch, curve=options.get("curve", False)
        )
        for notice in result.warnings:
            tell(notice)
        return replace(
            result,
            warnings=(*warnings, *result.warnings),
            files={"truth": truth, "estimate": estimate},
        )

    result = run(work, stopwatch, show=not quiet)
    if options["verbose"]:
        for text in _progress(result, stopwatch):
            say(text)
    if result.certified and not result.finished:
        missed = np.count_nonzero(~result.traced.met(result.gap)) if result.traced else 0
        where = f"{counted(int(missed), 'step')} of the curve"
        say(f"accuracy not reached at {where}, asked was {result.gap:g}")
    elif not result.finished:
        asked = f", asked was {result.gap:g}" if solver.name == "certified" else ""
        narrowest = ""
        if result.gap < NARROWEST:
            narrowest = f": bounds are rounded outward, ask for no less than {NARROWEST:g}"
        say(
            f"accuracy not reached: solver {result.solver['status']}, the relative gap is "
            f"{result.relative_gap:.2g}{asked}{narrowest}"
        )
    return result, result.finished


def read_sides(
    paths: tuple[str, str],
    settings: Settings,
    solver: Solver,
    given: dict[str, bool],
    tell: Tell,
    stopwatch: Stopwatch,
) -> tuple[tuple[Reading, ...], Distance, tuple[Notice, ...]]:
    """Both files, the distance between their states, and warnings.

    What the user should know of them is told.

    Raises
    ------
    TgospaError
        Something is wrong with the files, or the options do not fit them.
    """
    with stopwatch.span("read"):
        sides = settings.read(*paths)
    distance, aligned = settings.fit(sides, paths)
    notices = [
        *(notice for path, side in zip(paths, sides, strict=True) for notice in about(path, side)),
        *pair_notices(sides, aligned, distance, settings, given),
        *(slow_notice() if solver.name != "exact" else ()),
    ]
    for notice in notices:
        tell(notice)
    return sides, distance, tuple(notice for notice in notices if notice.code)


def evaluate_sides(
    sides: tuple[Reading, ...],
    distance: Distance,
    settings: Settings,
    solver: Solver,
    stopwatch: Stopwatch,
    *,
    curve: bool = False,
) -> Summary:
    """One evaluation of what was read, or one for each class and their sum."""
    common: dict[str, Any] = {
        "curve": curve,
        "parameters": settings.parameters,
        "distance": distance,
        "solver": solver,
        "stamps": settings.stamps,
        "unit": settings.unit,
        "settings": settings.recorded,
    }
    truth, estimate = sides
    inputs = told(truth), told(estimate)
    if not settings.reading.by_class:
        return evaluate_trajectories(
            truth.trajectories, estimate.trajectories, inputs=inputs, stopwatch=stopwatch, **common
        )
    from tgospa_eval.formats.assemble import natural
    from tgospa_eval.results.by_class import add_up

    read_s = stopwatch.elapsed()
    results = {}
    classes = sorted({*truth.classes, *estimate.classes}, key=natural) or [""]
    for number, name in enumerate(classes):
        part = stopwatch.beside()
        with stopwatch.progress.part(f"class {name}", number, len(classes)):
            results[name] = evaluate_trajectories(
                truth.of_class(name), estimate.of_class(name), stopwatch=part, **common
            )
        stopwatch.absorb(part)
    return add_up(results, dict(zip(("truth", "estimate"), inputs, strict=True)), read_s)


def inspect_files(
    paths: tuple[str, ...], options: dict[str, Any], given: dict[str, bool]
) -> dict[str, Any]:
    """What one file or two hold and what looks wrong with it, as the JSON document of the verb.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    from tgospa_eval.inspection import inspect

    settings = make_settings(options, given)

    stopwatch = Stopwatch()

    def work() -> dict[str, Any]:
        with stopwatch.span("read"):
            sides = settings.read(*paths)
        files = list(zip(paths, sides, strict=True))
        if len(files) == 1:
            distance, aligned = settings.measure.distance(sides[0].trajectories.columns), None
        else:
            distance, aligned = settings.fit(sides, paths)
        recorded = {**settings.recorded, "unit": settings.unit}
        return inspect(files, aligned, settings.parameters, distance, settings.stamps, recorded)

    return run(work, stopwatch, show=not options["quiet"])


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


def told(reading: Reading) -> dict[str, Any]:
    """What the result says of a file."""
    return {"rows": reading.rows, "format": reading.format, "left_out": reading.left_out}


def pair_notices(
    sides: tuple[Reading, ...],
    aligned: Alignment,
    distance: Distance,
    settings: Settings,
    given: dict[str, bool],
) -> Iterator[Notice]:
    """What the user should know of the choice of the distance, and of the two files together."""
    yield from notices(distance, aligned.truth.columns, settings.parameters.cutoff)
    truth, estimate = (side.trajectories for side in sides)
    if "gaussian" in distance.kinds:
        for text in _about_points(truth.kind == "point", estimate.kind == "point"):
            yield Notice(text=text)
    if any(side.pixels for side in sides):
        yield from unit_notices(settings.unit)
    stamps, parameters = settings.stamps, settings.parameters
    for text in alignment_notices(aligned, stamps):
        yield Notice(text=text)
    found = diagnose((truth, estimate), aligned, stamps, parameters, distance)
    yield from found
    defaults = [name for name, is_given in given.items() if not is_given]
    if defaults:
        yield default_notice(aligned, distance, parameters, defaults, others=explained(found))


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


def show(result: Summary, options: dict[str, Any], names: tuple[str, str]) -> None:
    """Print the result, and write the folder if one was asked for."""
    try:
        if options["output"] is not None:
            _write(result, options, names)
    except ConfigError:  # a full disk must not cost what was computed
        _print(result, options)
        raise
    with undisturbed():
        _print(result, options)


def _print(result: Summary, options: dict[str, Any]) -> None:
    """The result to stdout."""
    name = options["format_"]
    if name == "table" and on_terminal():
        from tgospa_eval.reports.terminal import report  # here: rich is for terminals alone

        emit(report(result, sys.stdout.encoding or "ascii"), "colours")
    else:
        emit(REPORTS[name](result), name)


def wanted_pictures(options: dict[str, Any]) -> "Pictures | None":
    """The pictures that the options ask for; None without an option of that kind, or for none.

    Raises
    ------
    ConfigError
        Something is wrong with them.
    """
    from tgospa_eval.plots.report import Pictures, names_in  # here: of folders alone

    if options.get("pictures", "none") == "none":
        return None
    parts, plane = options["components"], options["plane"]
    with _named_options():
        return Pictures(
            formats=names_in(options["pictures"]),
            style=options["style"],
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


def _write(result: Summary, options: dict[str, Any], names: tuple[str, str]) -> None:
    """The result folder; says what is not in it for want of an extra."""
    from tgospa_eval import plots

    wanted = wanted_pictures(options)
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

    write_output(options, RESULT, make)
    if absent and not options["quiet"]:
        what, extras = (list(column) for column in zip(*absent, strict=True))
        single = absent == [("report.html", "report")]
        say(
            f"{' and '.join(what)} {'is' if single else 'are'} not written: "
            f"{'it needs' if single else 'they need'} {install(*extras)}"
        )
