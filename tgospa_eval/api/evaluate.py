"""Read this first: the steps of one evaluation, from truth and estimate to a result."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

from tgospa_eval.api.in_parts import can_be_divided, in_parts_if_large
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.notices import pair_notices
from tgospa_eval.api.reading import align_sides, display_names, read_pair
from tgospa_eval.api.resolve import ResolvedRequest, resolve_request
from tgospa_eval.api.result import ByClass, Result, ResultInParts, result_of
from tgospa_eval.common.frozen import dataclass, recast, replace
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import parsed_size
from tgospa_eval.distances import Resources
from tgospa_eval.errors import MemoryTooSmallError
from tgospa_eval.evaluation.pair import add_up
from tgospa_eval.evaluation.prepare import AlignedPair, fit, prepare
from tgospa_eval.evaluation.prove import nested_timings, prove
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.formats.objects import is_path
from tgospa_eval.formats.reading import classes_in
from tgospa_eval.results.records import Json

if TYPE_CHECKING:
    from typing import Unpack

    from tgospa_eval.api.option_types import EvaluateOptions
    from tgospa_eval.formats.objects import Components, TrajectoriesLike

Notify = Callable[[Notice], None]
"""Function that is called with each notice and each warning."""


@with_options()
def evaluate(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    cutoff: float | None = None,
    order: float = 2.0,
    switch_penalty: float | None = None,
    *,
    mapping: "Components | None" = None,
    memory: "float | str | None" = None,
    scheduler: str | None = None,
    **options: "Unpack[EvaluateOptions]",
) -> Result:
    """Compute TGOSPA between two sets of trajectories, with proven bounds.

    Every option of ``tgospa-eval evaluate`` is also a keyword.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        One of the following:

        - a file, or the result of `read_trajectories`
        - a table ``id, t, x[, y[, z]]`` of pandas, Polars or a library with the Arrow interface
        - an array or tensor (T, k, d): T steps, k trajectories, d columns; NaN if absent
        - a pair ``(times, array)`` with such an array
        - a dictionary from each id to an array (T, d) or a pair ``(times, array)``
        - tracks or ground-truth paths of Stone Soup, with the parameter `mapping`

        Arrays and tables must have the state columns that the distance needs.
    cutoff : float, optional
        Cutoff c > 0, in the unit of the distance. The default is 10.0, or 0.5 with ``"iou"``.
    order : float
        Order p >= 1.
    switch_penalty : float, optional
        Switch penalty gamma >= 0, in the unit of the distance. The default is 2.0, or 0.5 with
        ``"iou"``.
    mapping : sequence of int, or pair of such, optional
        For tracks and arrays in memory: indices of the state components to compare. ``(0, 2)``
        selects x and y of ``(x, vx, y, vy)``. If truth and estimate have different components, give
        a pair of sequences.
    memory : str or float, optional
        Largest memory of the evaluation, ``"4GB"`` or a number of GB; by default half of the memory
        of the machine. Folders of Parquet or CSV files, and files that would take more memory, are
        evaluated in parts by up to `jobs` processes. For that, truth and estimate must be paths.
    scheduler : str, optional
        Address of a Dask cluster that evaluates data in parts, instead of local processes.

    Returns
    -------
    Result
        The value with its lower and upper bound, its parts, and tables. With ``by="class"`` the
        answer is a `ByClass`, the sum over classes. For data in parts it is a `ResultInParts`,
        whose tables are temporary files.

    Warns
    -----
    TgospaWarning
        Data look wrong; `Result.warnings` has the same warnings.

    Raises
    ------
    ConfigError
        A parameter is out of range, a name is unknown, or the data do not support an option.
    InputError
        A file is wrong, states are out of range, or truth and estimate differ in their state
        columns or in their kind of time.
    TypeError
        A keyword is unknown.
    """
    given = {"cutoff": cutoff, "order": order, "switch_penalty": switch_penalty, **options}
    limit = None if memory is None else parsed_size(memory)
    request = requested({**given, "memory": limit, "scheduler": scheduler})
    resolved, stopwatch = resolve_request(request), Stopwatch()
    result: Result | ByClass | ResultInParts | None
    result = in_parts_if_large(truth, estimate, request, resolved, stopwatch)
    if result is None:
        try:
            pair = read_sides(resolved, truth, estimate, stopwatch, mapping=mapping)
            result = evaluate_sides(resolved, pair, stopwatch)
        except MemoryTooSmallError as error:
            if not can_be_divided((truth, estimate)):
                raise
            why = error.reason
            result = in_parts_if_large(truth, estimate, request, resolved, stopwatch, why)
            assert result is not None
    warn_user(result.warnings)
    return cast("Result", result)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackPair:
    """Truth and estimate, ready to be evaluated.

    Parameters
    ----------
    read : pair of Reading
        Truth and estimate as they were read.
    fitted : AlignedPair
        Truth and estimate on one time grid.
    request : EvaluationRequest
        What to compute.
    files : dict
        Paths of ``"truth"`` and ``"estimate"``; None for data in memory.
    said : tuple of Notice
        Warnings about the data, and notices about how the data were read and which defaults are
        used.
    """

    read: tuple[Reading, ...]
    fitted: AlignedPair
    request: EvaluationRequest
    files: dict[str, str | None]
    said: tuple[Notice, ...]

    @property
    def warnings(self) -> tuple[Notice, ...]:
        """Warnings about truth and estimate."""
        return tuple(notice for notice in self.said if notice.code)

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices about how truth and estimate were read, and which defaults are used."""
        return tuple(notice.sentence for notice in self.said if not notice.code)

    @property
    def records(self) -> list[dict[str, Any]]:
        """Records of truth and estimate: format, number of rows, numbers of rows left out."""
        return [side.record for side in self.read]


def read_sides(
    resolved: ResolvedRequest,
    truth: "TrajectoriesLike | Reading",
    estimate: "TrajectoriesLike",
    stopwatch: Stopwatch,
    notify: Notify | None = None,
    *,
    mapping: "Components | None" = None,
    known: dict[str, Reading] | None = None,
) -> TrackPair:
    """Read truth and estimate, bring them to one time grid, and say what looks wrong.

    Parameters
    ----------
    resolved : ResolvedRequest
        How to read, and what to evaluate.
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        Truth and estimate as given to `evaluate`. The truth can also be a `Reading`.
    stopwatch : Stopwatch
        Running clock.
    notify : callable, optional
        Function that receives each notice; the command line gives one. If it is given, the message
        of an error about a folder or a pattern ends with a command that reads the files in it.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.
    known : dict, optional
        Cache of the truth that was read last; the key is its path. This function updates it. Pass
        the same dict for several estimates to read their truth once.

    Raises
    ------
    TgospaError
        Truth or estimate is wrong, or the options do not fit them.
    """
    given = (truth, estimate)
    with stopwatch.span("read"):
        sides = read_pair(resolved, *given, mapping=mapping, advise=notify is not None, known=known)
    pair = noticed(given, sides, *align_sides(resolved, sides, display_names(given)))
    for notice in pair.said if notify else ():
        notify(notice)  # type: ignore[misc]
    return pair


def noticed(
    given: Sequence[object],
    sides: tuple[Reading, ...],
    fitted: AlignedPair,
    request: EvaluationRequest,
    *,
    sound: bool = False,
) -> TrackPair:
    """Return truth and estimate, which were read and aligned before, with notices about them.

    Parameters
    ----------
    given : pair
        Truth and estimate as the user gave them.
    sides : pair of Reading
        Both as they were read.
    fitted : AlignedPair
        Both on one time grid.
    request : EvaluationRequest
        What to compute.
    sound : bool
        Whether their times and states were checked before. Then some tests are not done again.
    """
    names = display_names(given)
    notices = [*pair_notices(given, names, sides, fitted, request, sound=sound)]
    paths = (name if is_path(side) else None for name, side in zip(names, given, strict=True))
    return TrackPair(
        read=sides,
        fitted=fitted,
        request=request,
        files=dict(zip(("truth", "estimate"), paths, strict=True)),
        said=tuple(notices),
    )


def evaluate_sides(
    resolved: ResolvedRequest, sides: TrackPair, stopwatch: Stopwatch, notify: Notify | None = None
) -> Result | ByClass:
    """Evaluate two sides that were read: solve, and prove the bounds.

    With ``by="class"`` this is done for each class, and the results are added up. `notify` receives
    only the warnings that arise here. The result also has the warnings that arose in reading.
    """
    result: Result | ByClass
    if resolved.reading.by_class:
        result = _evaluate_classes(sides, stopwatch)
    else:
        result = evaluate_pair(sides.fitted, sides.request, stopwatch, sides.records)
    for notice in result.warnings if notify else ():
        notify(notice)  # type: ignore[misc]
    return replace(
        result,
        warnings=(*sides.warnings, *result.warnings),
        notices=sides.notices,
        files=sides.files,
        calibration=resolved.similarity,
        tracked_shares=resolved.tracked_shares,
    )


def evaluate_pair(
    aligned: AlignedPair,
    request: EvaluationRequest,
    stopwatch: Stopwatch,
    files: Sequence[Json] | None = None,
) -> Result:
    """Build the problem of truth and estimate, solve it, certify it, and add requested extras.

    Parameters
    ----------
    aligned : AlignedPair
        Truth and estimate on one time grid, and their distance.
    request : EvaluationRequest
        What to compute.
    stopwatch : Stopwatch
        Running clock with the time of reading.
    files : pair of dict, optional
        `TrackPair.records` of truth and estimate. Without it, the records of the result have only
        the number of rows of each side.
    """
    prepared = prepare(aligned, request, files=files, stopwatch=stopwatch)
    slices = None
    if request.slices:
        # lazy: few evaluations have slices
        from tgospa_eval.evaluation.slices import slice_members, slicings

        with stopwatch.span("slices"):
            slices = slice_members(aligned, request.slices, request.parameters.cutoff)
    stopwatch.progress.begin(request.parameters.root)
    solution = request.solver(prepared.states, stopwatch)
    result = prove(prepared, request.solver, solution, stopwatch, request)
    result = replace(result, source=(aligned, request))
    if request.with_:
        # lazy: few evaluations have other metrics
        from tgospa_eval.evaluation.other_metrics import joined, other_metrics

        resources = Resources(jobs=request.solver.jobs, stopwatch=stopwatch)
        computed = other_metrics(prepared, request.with_, resources, result.proof)
        result = replace(result, with_=joined([computed]), sums=computed.sums())
    if slices is not None:
        with stopwatch.span("slices"):
            split = slicings(slices, result)
        result = replace(result, slicings=split, timings=nested_timings(stopwatch))
    return result_of(result)


def _evaluate_classes(sides: TrackPair, stopwatch: Stopwatch) -> ByClass:
    """Evaluate each class, and add up the results."""
    request = sides.fitted.of_parts(sides.request)
    truth, estimate = sides.read
    read_s = stopwatch.elapsed()
    results = {}
    classes = classes_in(sides.read)
    for number, name in enumerate(classes):
        part = stopwatch.beside()
        with stopwatch.progress.part(f"class {name}", number, len(classes)):
            fitted = fit(truth.of_class(name), estimate.of_class(name), request)
            results[name] = evaluate_pair(fitted, request, part)
        stopwatch.absorb(part)
    return recast(add_up(results, sides.records, read_s), ByClass)
