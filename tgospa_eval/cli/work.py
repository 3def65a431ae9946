"""From the values of the options to a result, and the result to stdout and files."""

import math
import os
import sys
from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.cli.distance import DistanceOptions, notices
from tgospa_eval.cli.progress import run
from tgospa_eval.compiled import KERNEL
from tgospa_eval.distances import Distance
from tgospa_eval.distances.gating import median_nearest
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation import Summary
from tgospa_eval.formats import Reading, ReadOptions, read
from tgospa_eval.pipeline import check_columns, check_states, evaluate_trajectories
from tgospa_eval.problem import Parameters
from tgospa_eval.reports import REPORTS
from tgospa_eval.reports.files import check_folder, write_folder
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.timing import Stopwatch
from tgospa_eval.trajectories import Trajectories, align

FEW = 0.9
"""Share of common steps below which something is probably wrong with the clocks."""


def evaluate_files(
    truth: str, estimate: str, options: dict[str, Any], given: dict[str, bool]
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
    measure = DistanceOptions(options)
    options = with_defaults(options, given, measure)
    parameters = Parameters(
        cutoff=options["cutoff"],
        order=options["order"],
        switch_penalty=options["switch_penalty"],
    )
    solver = make_solver(options)
    reading = read_options(options, measure)
    if options["output"] is not None:
        check_folder(options["output"], force=options["force"])
    stopwatch = Stopwatch()

    def work() -> Summary:
        with stopwatch.span("read"):
            sides = (
                read(truth, reading, "truth", options["truth_format"]),
                read(estimate, reading, "estimate", options["estimate_format"]),
            )
        return _evaluate(
            sides, (truth, estimate), parameters, solver, options, given, measure, say, stopwatch
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
    options: dict[str, Any],
    given: dict[str, bool],
    measure: DistanceOptions,
    say: Callable[[str], None],
    stopwatch: Stopwatch,
) -> Summary:
    truth, estimate = (side.trajectories for side in sides)
    check_columns(truth, estimate, paths)
    distance = measure.distance(truth.columns)
    check_states(truth, estimate, distance, paths)
    aligned = align(truth, estimate, paths)
    for path, side in zip(paths, sides, strict=True):
        for notice in side.notices:
            say(f"{path}: {notice}")
    for notice in notices(distance, truth.columns, parameters.cutoff):
        say(notice)
    steps = len(aligned[0].times)
    common = len(truth.times) + len(estimate.times) - steps
    say(f"{common} of {steps} steps are in both files")
    if steps and common < FEW * steps:
        say(f"warning: only {100 * common / steps:.0f} % of the steps are in both files")
    if KERNEL == "numpy" and solver.name != "exact":
        say("no compiled kernels, slower: installing with a C compiler at hand builds them")
    if not all(given.values()) and not options["quiet"]:
        say(_default_notice(aligned, distance, options, given))
    settings = {
        "parameters": parameters,
        "distance": distance,
        "solver": solver,
        "unit": options["unit"],
        "settings": {
            "decimal": options["decimal"],
            "on_duplicate": options["on_duplicate"],
            **dict(read_options(options, measure).filters()),
        },
    }
    told = about(sides[0]), about(sides[1])
    if options["by"] == "class":
        return _by_class(sides, settings, told, stopwatch)
    return evaluate_trajectories(truth, estimate, inputs=told, stopwatch=stopwatch, **settings)


def _by_class(
    sides: tuple[Reading, Reading],
    settings: dict[str, Any],
    told: tuple[dict[str, Any], dict[str, Any]],
    stopwatch: Stopwatch,
) -> Summary:
    """One evaluation for each class of either file, and their sum."""
    from tgospa_eval.by_class import add_up
    from tgospa_eval.formats.assemble import natural

    read_s = stopwatch.elapsed()
    results = {}
    for name in sorted({*sides[0].classes, *sides[1].classes}, key=natural) or [""]:
        stopwatch.stage = f"class {name}"
        part = Stopwatch()
        results[name] = evaluate_trajectories(
            sides[0].of_class(name), sides[1].of_class(name), stopwatch=part, **settings
        )
        stopwatch.absorb(part)
    return add_up(results, dict(zip(("truth", "estimate"), told, strict=True)), read_s)


def _default_notice(
    aligned: tuple[Trajectories, Trajectories],
    distance: Distance,
    options: dict[str, Any],
    given: dict[str, bool],
) -> str:
    """One line about the defaults in use, with the scale of the data beside it."""
    names = {"cutoff": ("cutoff c", "-c"), "switch_penalty": ("switch penalty gamma", "-g")}
    defaults = [name for name, is_given in given.items() if not is_given]
    used = " and ".join(f"{names[name][0]} = {options[name]:g}" for name in defaults)
    nearest = median_nearest(*aligned, distance)
    known = nearest is not None and math.isfinite(nearest)
    scale = "" if not known else f"; the median nearest estimate is {nearest:.3g} away"
    return f"default {used}{scale}; choose with {' and '.join(names[name][1] for name in defaults)}"


def with_defaults(
    options: dict[str, Any], given: dict[str, bool], measure: DistanceOptions
) -> dict[str, Any]:
    """The options with the cutoff and the switch penalty of the distance where none is given."""
    defaults = dict(zip(("cutoff", "switch_penalty"), measure.named.defaults, strict=True))
    return options | {name: value for name, value in defaults.items() if not given[name]}


def make_solver(options: dict[str, Any]) -> Solver:
    """The solver that the options ask for."""
    name = options["solver"]
    settings: dict[str, Any] = {"time_limit": options["time_limit"]}
    if name != "exact":
        settings |= {"gap": options["gap"], "jobs": options["jobs"]}
    if name == "sinkhorn":
        settings["epsilon"] = options["epsilon"]
    return solver_class(name)(**settings)


def read_options(options: dict[str, Any], measure: DistanceOptions) -> ReadOptions:
    """How to read the files."""
    columns, classes = options["columns"], options["class_"]
    return ReadOptions(
        columns=measure.columns(None if columns is None else tuple(columns.split(","))),
        decimal=options["decimal"],
        on_duplicate=options["on_duplicate"],
        boxes=measure.boxes,
        time=options["time"],
        classes=None if classes is None else tuple(name.strip() for name in classes.split(",")),
        region=options["region"],
        by_class=options["by"] == "class",
    )


def about(reading: Reading) -> dict[str, Any]:
    """What the result says of a file."""
    return {"rows": reading.rows, "format": reading.format, "left_out": reading.left_out}


def show(result: Summary, options: dict[str, Any]) -> None:
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
