"""From the values of the options to a result, and the result to stdout and files."""

import math
import os
import sys
from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.alignment import Stamps, align
from tgospa_eval.cli.progress import run
from tgospa_eval.compiled import KERNEL
from tgospa_eval.distances import DISTANCES
from tgospa_eval.distances.gating import median_nearest
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation import Result
from tgospa_eval.formats import Reading, ReadOptions, read
from tgospa_eval.inspection import inspect, remarks
from tgospa_eval.pipeline import check_columns, evaluate_trajectories
from tgospa_eval.problem import Parameters
from tgospa_eval.reports import REPORTS
from tgospa_eval.reports.files import check_folder, write_folder
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.timing import Stopwatch
from tgospa_eval.trajectories import Trajectories


def evaluate_files(
    truth: str, estimate: str, options: dict[str, Any], given: dict[str, bool]
) -> tuple[Result, bool]:
    """Read, evaluate, and say whether the asked accuracy was reached.

    Parameters
    ----------
    truth, estimate : str
        Paths.
    options : dict
        Values of the options.
    given : dict
        Whether cutoff and switch penalty were given, or are defaults.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    quiet, verbose = options["quiet"], options["verbose"]

    def say(message: str) -> None:
        if not quiet:
            click.echo(message, err=True)

    if options["config"]:
        say(f"settings from {options['config']}")
    parameters = Parameters(
        cutoff=options["cutoff"],
        order=options["order"],
        switch_penalty=options["switch_penalty"],
    )
    solver = make_solver(options)
    stamps = Stamps(tolerance=options["time_tolerance"], grid=options["grid"])
    reading = read_options(options)
    if options["output"] is not None:
        check_folder(options["output"], force=options["force"])
    stopwatch = Stopwatch()

    def work() -> Result:
        with stopwatch.span("read"):
            sides = read(truth, reading), read(estimate, reading)
        return _evaluate(
            sides, (truth, estimate), parameters, solver, stamps, options, given, say, stopwatch
        )

    result = run(work, stopwatch, show=not quiet)
    if verbose:
        for name, seconds in stopwatch.spans.items():
            click.echo(f"{name:<20} {seconds:9.3f} s", err=True)
        if stopwatch.work:
            click.echo(
                f"{'one state':<20} {stopwatch.nanoseconds:9.1f} ns in half a sweep, of "
                f"{stopwatch.work} done",
                err=True,
            )
        for check in result.solver["history"]:
            click.echo(
                f"sweep {check['sweep']:5d}  epsilon {check['epsilon']:<7g} "
                f"violation {check['violation']:.1e}  total {check['lower']:.9g} to "
                f"{check['upper']:.9g}",
                err=True,
            )
    finished = result.certified if solver.name == "certified" else bool(result.solver["finished"])
    if not finished:
        asked = f", asked was {result.gap:g}" if solver.name == "certified" else ""
        click.echo(
            f"accuracy not reached: solver {result.solver['status']}, the relative gap is "
            f"{result.relative_gap:.2g}{asked}",
            err=True,
        )
    return result, finished


def _evaluate(
    sides: tuple[Reading, Reading],
    paths: tuple[str, str],
    parameters: Parameters,
    solver: Solver,
    stamps: Stamps,
    options: dict[str, Any],
    given: dict[str, bool],
    say: Callable[[str], None],
    stopwatch: Stopwatch,
) -> Result:
    truth, estimate = (side.trajectories for side in sides)
    check_columns(truth, estimate, paths)
    aligned = align(truth, estimate, stamps, paths)
    for path, side in zip(paths, sides, strict=True):
        for notice in side.notices:
            say(f"{path}: {notice}")
    if truth.columns == ("lat", "lon"):
        say("lat and lon are compared as plain numbers: c, gamma and errors are in degrees")
    if not options["quiet"]:
        distance = DISTANCES[options["distance"]]
        notices, warnings = remarks((truth, estimate), aligned, stamps, parameters, distance)
        for text in (*notices, *(f"warning: {text}" for text in warnings)):
            say(text)
    if KERNEL == "numpy" and solver.name != "exact":
        say("no compiled kernels, slower: installing with a C compiler at hand builds them")
    if not all(given.values()) and not options["quiet"]:
        say(_default_notice((aligned.truth, aligned.estimate), options, given))
    return evaluate_trajectories(
        truth,
        estimate,
        parameters=parameters,
        distance=options["distance"],
        solver=solver,
        stamps=stamps,
        unit=options["unit"],
        settings={"decimal": options["decimal"], "on_duplicate": options["on_duplicate"]},
        rows=(sides[0].rows, sides[1].rows),
        stopwatch=stopwatch,
    )


def inspect_files(truth: str, estimate: str | None, options: dict[str, Any]) -> dict[str, Any]:
    """What the files hold and what looks wrong with it, as the JSON document of the verb.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    if options["config"] and not options["quiet"]:
        click.echo(f"settings from {options['config']}", err=True)
    parameters = Parameters(cutoff=options["cutoff"], order=options["order"], switch_penalty=0.0)
    stamps = Stamps(tolerance=options["time_tolerance"], grid=options["grid"])
    reading = read_options(options)
    names = (truth,) if estimate is None else (truth, estimate)
    settings = {name: options[name] for name in ("decimal", "on_duplicate", "unit")}

    def work() -> dict[str, Any]:
        files = [(name, read(name, reading)) for name in names]
        return inspect(files, parameters, DISTANCES[options["distance"]], stamps, settings)

    return run(work, Stopwatch(), show=not options["quiet"])


def _default_notice(
    aligned: tuple[Trajectories, Trajectories], options: dict[str, Any], given: dict[str, bool]
) -> str:
    """One line about the defaults in use, with the scale of the data beside it."""
    names = {"cutoff": ("cutoff c", "-c"), "switch_penalty": ("switch penalty gamma", "-g")}
    defaults = [name for name, is_given in given.items() if not is_given]
    used = " and ".join(f"{names[name][0]} = {options[name]:g}" for name in defaults)
    nearest = median_nearest(*aligned, DISTANCES[options["distance"]])
    known = nearest is not None and math.isfinite(nearest)
    scale = "" if not known else f"; the median nearest estimate is {nearest:.3g} away"
    return f"default {used}{scale}; choose with {' and '.join(names[name][1] for name in defaults)}"


def make_solver(options: dict[str, Any]) -> Solver:
    """The solver that the options ask for."""
    name = options["solver"]
    settings: dict[str, Any] = {"time_limit": options["time_limit"]}
    if name != "exact":
        settings |= {"gap": options["gap"], "jobs": options["jobs"]}
    if name == "sinkhorn":
        settings["epsilon"] = options["epsilon"]
    return solver_class(name)(**settings)


def read_options(options: dict[str, Any]) -> ReadOptions:
    """How to read the files."""
    columns = options["columns"]
    return ReadOptions(
        columns=None if columns is None else tuple(columns.split(",")),
        decimal=options["decimal"],
        on_duplicate=options["on_duplicate"],
    )


def show(result: Result, options: dict[str, Any]) -> None:
    """Print the result, and write the folder if one was asked for."""
    if options["output"] is not None:
        write_folder(result, options["output"], force=options["force"])
    emit(REPORTS[options["format_"]](result))


def emit(text: str) -> None:
    """Write data to stdout, in its own encoding, escaping what that cannot express.

    Not by click.echo, which writes UTF-8 where the user asked for ASCII and exits with 1 when the
    reader of a pipe goes away; as head does, so that is no failure of ours.
    """
    if sys.stdout is None:  # closed by the caller
        return
    encoding = sys.stdout.encoding or "ascii"
    try:
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise ConfigError(f"stdout cannot be written: {error.strerror}") from None
