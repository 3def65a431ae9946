"""Notices about files, defaults, and the status of a solver."""

from collections.abc import Iterator, Sequence

import numpy as np

from tgospa_eval.api.distance import notices
from tgospa_eval.api.options import Request
from tgospa_eval.api.resolve import ResolvedRequest
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.distances import as_distance
from tgospa_eval.evaluation import diagnosis
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.formats.assemble import centres_compared
from tgospa_eval.formats.objects import is_path
from tgospa_eval.kernels import KERNEL
from tgospa_eval.quoting import option
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.tracks.coverage import NOT_COUNTED, marks_of
from tgospa_eval.tracks.trajectories import Trajectories

NARROWEST = 1e-12
"""Relative gap that can always be reached. Outward rounding of bounds can prevent smaller gaps."""


def slow_notice() -> Iterator[Notice]:
    """Yield a notice if the kernels are not compiled."""
    if KERNEL == "numpy":
        yield Notice(
            text="no compiled kernels, so this is slower; to build them, install with a C compiler"
        )


def about(path: str, side: Reading) -> Iterator[Notice]:
    """Yield notices about one file."""
    for text in side.notices:
        yield Notice(text=f"{path}: {text}")
    for notice in side.warnings:
        yield notice.about(path)


def about_same(truth: Trajectories, estimate: Trajectories) -> Iterator[Notice]:
    """Warn if both files have exactly the same states; a tracker never returns the true states."""
    if (
        len(truth.step) == len(estimate.step) > 1
        and np.array_equal(truth.track, estimate.track)
        and np.array_equal(truth.state, estimate.state)
        and np.array_equal(truth.times[truth.step], estimate.times[estimate.step])
        and np.abs(truth.state).max() < 2.0**52  # larger numbers may have been rounded
    ):
        yield Notice(
            code="same-data",
            text="the estimate has exactly the states of the truth",
            remedy="check that it is the file that the tracker wrote",
        )


def pair_notices(
    given: Sequence[object],
    names: Sequence[str],
    files: Sequence[Reading],
    sides: AlignedPair,
    request: EvaluationRequest,
    *,
    sound: bool = False,
) -> Iterator[Notice]:
    """Yield notices about each file, about the distance, and about truth and estimate together.

    Parameters
    ----------
    given, names, files : pairs
        Truth and estimate as the user gave them, their names in messages, and what was read.
    sides, request : AlignedPair, EvaluationRequest
        Truth and estimate on one time grid, and what to compute.
    sound : bool
        Whether times and states were checked before. Then some tests are not done again.
    """
    for name, side in zip(names, files, strict=True):
        yield from about(name, side)
    if is_path(given[0]) or given[0] is not given[1]:
        yield from about_same(*sides.read)
    aligned, distance, parameters = sides.alignment, sides.distance, request.parameters
    yield from notices(distance, aligned.truth.columns, parameters.cutoff)
    truth, estimate = sides.read
    if "gaussian" in distance.kinds:
        for text in _about_points(truth.kind == "point", estimate.kind == "point"):
            yield Notice(text=text)
    yield from diagnosis.unit_notices(request, files)
    yield from diagnosis.axis_notices(sides.axis, request.time_matching)
    for text in diagnosis.alignment_notices(aligned, request.time_matching):
        yield Notice(text=text)
    if request.ignoring is not None:
        ignored, excused = (
            bool(marks_of(side, NOT_COUNTED).any()) for side in (aligned.truth, aligned.estimate)
        )
        for text in request.ignoring.messages(ignored=ignored, excused=excused):
            yield Notice(text=text)
    warnings = diagnosis.diagnose(sides, request, sound=sound)
    yield from warnings
    yield from diagnosis.lost_warnings(sides, request.time_matching)
    if request.defaults:
        yield diagnosis.default_notice(
            aligned,
            distance,
            parameters,
            request.defaults,
            is_explained=diagnosis.explained(warnings),
            boxes=any(side.centres for side in files),
        )
    if not request.solver.referee:
        yield from slow_notice()


def _about_points(truth: bool, estimate: bool) -> Iterator[str]:
    """Explain the effect of missing covariances.

    `truth` is true if the truth has no covariances, `estimate` if the estimate has none.
    """
    if truth and estimate:
        yield "neither side has covariances: gaussian-wasserstein equals the euclidean distance"
    elif truth:
        yield (
            "the truth has no covariances: smaller covariances of the estimate always cost less, "
            "even if they are too small"
        )


def about_defaults(options: Request, *, boxes: bool) -> Iterator[str]:
    """Yield notices of the defaults in use; a command with many jobs prints them once.

    `boxes` says whether the files have boxes.
    """
    if boxes and options.distance in (None, "euclidean") and not options.columns:
        yield centres_compared()
    given = {"cutoff": options.cutoff, "switch_penalty": options.switch_penalty}
    values = zip(given, as_distance(options.distance).defaults, strict=True)
    used = {name: value for name, value in values if given[name] is None}
    if used:
        shown = " and ".join(
            f"{letter} = {used[name]:g}"
            for name, letter in (("cutoff", "c"), ("switch_penalty", "gamma"))
            if name in used
        )
        yield f"default {shown}; choose with {' and '.join(option(name) for name in used)}"


def about_run(
    result: Evaluation, resolved: ResolvedRequest, stopwatch: Stopwatch, *, verbose: bool
) -> Iterator[str]:
    """Yield notices about missed accuracy; if `verbose`, also times and progress."""
    if verbose:
        yield from _progress(result, stopwatch)
    if not result.finished:
        yield from _not_reached(result, resolved)


def _not_reached(result: Evaluation, resolved: ResolvedRequest) -> Iterator[str]:
    """Yield a notice for each kind of value that did not reach the requested accuracy."""
    if result.certified:
        requested = (
            (result.curve_bounds, "step", " of the curve"),
            (result.window_bounds, "window", ""),
        )
        for bounds, what, of in requested:
            missed = 0 if bounds is None else int(np.count_nonzero(~bounds.met(result.gap)))
            if missed:
                where = f"{counted(missed, what)}{of}"
                yield f"accuracy not reached at {where}; requested: {result.gap:g}"
        return
    gap_note = f"; requested: {result.gap:g}" if resolved.evaluation.solver.proves else ""
    narrowest = ""
    if result.gap < NARROWEST:
        narrowest = f"; bounds are rounded outward, so a gap below {NARROWEST:g} may be impossible"
    yield (
        f"accuracy not reached: solver {result.solver['status']}, the relative gap is "
        f"{result.relative_gap:.2g}{gap_note}{narrowest}"
    )


def _progress(result: Evaluation, stopwatch: Stopwatch) -> Iterator[str]:
    """Yield the time of each stage, and a line for each check of the solver."""
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
