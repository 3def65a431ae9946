"""Preparation before any solver: both sides on one grid, their near pairs, and the problem."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass, recast
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Distance, Pairs, Resources
from tgospa_eval.distances.base import check_columns, check_states
from tgospa_eval.distances.pair_search import prepared_pairs
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis, with_outages
from tgospa_eval.evaluation.memory import check_pairs
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.metric_family import (
    Parameters,
    check_weights,
    ignore_states,
    tgospa_problem,
    weight_existence,
    weight_steps,
)
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.states import States, merge_runs
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import ComparedSides, Json, Labels, input_record
from tgospa_eval.tracks.alignment import Alignment, TimeMatching, align
from tgospa_eval.tracks.coverage import (
    AWAY,
    NOT_COUNTED,
    Coverage,
    digest,
    judge,
    marks_of,
    unsigned_zeros,
    whole,
)
from tgospa_eval.tracks.trajectories import Trajectories
from tgospa_eval.tracks.weights import EXISTENCE, existence_of, expected

if TYPE_CHECKING:
    from tgospa_eval.tracks.alignment import ClockReports
    from tgospa_eval.tracks.weights import WeightsByTime


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedPair:
    """Truth and estimate on one grid, after the checks that they fit each other.

    Parameters
    ----------
    given : pair of Trajectories
        Truth and estimate, each at its own times.
    read : pair of Trajectories
        Truth and estimate after interpolation and after the choice of declared steps.
    alignment : Alignment
        Truth and estimate on one grid, which has the steps that count.
    distance : Distance
        Base distance, fitted to the data.
    axis : Axis
        Both sides at their steps, with the numbers of states that were interpolated or left out.
    headers : mapping of str to str
        Header of each column of the estimate, if it is a table.
    same_header : str
        Option with which the times of truth and estimate are read from columns of the same name.
        Blank if they are already read from such columns, or if no such columns exist.
    in_parts : bool
        Whether the data are read in parts, and this is one of them. Parts are not interpolated.
    """

    given: tuple[Trajectories, Trajectories]
    read: tuple[Trajectories, Trajectories]
    alignment: Alignment
    distance: Distance
    axis: Axis
    headers: Mapping[str, str] = field(default_factory=dict)
    same_header: str = ""
    in_parts: bool = False

    def of_parts(self, request: EvaluationRequest) -> EvaluationRequest:
        """Return the request for a part of the data, with the distance and the period of all data.

        The period is that of the reports of the estimate on a common clock.
        """
        matching, reports = request.time_matching, self.alignment.reports
        if reports is not None:
            matching = replace(matching, period=reports.period)
        return replace(request, distance=self.distance, time_matching=matching)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredSides(ComparedSides):
    """Truth and estimate as they are compared, from which problems with any parameters are built.

    `settings` include neither the parameters nor the settings of the solver.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate on one grid, with states as `distance` compares them.
    distance : Distance
        Base distance, after its method `prepared`.
    recorded : callable
        Function without arguments. It returns the records of both sides, with numbers of rows and
        digests, and a record of the evaluated truth. Trials of repairs do not call it.
    step_weights : pair of float arrays, optional
        Weight of each step for its costs, and for its switches.
    existence : pair of (R,) float arrays, optional
        Probability of existence of each row of the truth, and of each row of the estimate.
    """

    sides: tuple[Trajectories, Trajectories]
    distance: Distance
    recorded: Callable[[], tuple[Mapping[str, Json], Coverage]]
    step_weights: tuple[Floats, Floats] | None = None
    existence: tuple[Floats, Floats] | None = None

    def problem(self, near: "NearPairs", parameters: Parameters) -> Problem:
        """Return the problem of `near`, which must include all pairs nearer than the cutoff."""
        problem = near.problem(parameters)
        if self.existence is not None:
            problem = weight_existence(problem, *self.existence)
        if self.step_weights is not None:
            problem = weight_steps(problem, *self.step_weights)
        return problem

    def prepared(self, states: States, parameters: Parameters) -> "PreparedPair":
        """Return both sides together with `states`, their reduced problem."""
        settings = {**parameters.recorded, **self.settings}
        return recast(self, PreparedPair, parameters=parameters, states=states, settings=settings)


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedPair(MeasuredSides):
    """Truth and estimate with their reduced problem, which is ready for any solver.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order and switch penalty, which are also in `settings`.
    states : States
        The reduced problem.
    """

    parameters: Parameters
    states: States

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of objects, estimates, steps and components, and two numbers of near pairs.

        ``candidate_pairs`` counts pairs of an object and an estimate that are near at some step.
        ``pair_steps`` counts them at each step at which they are near.
        """
        problem = self.states.problem
        return {
            "truth": problem.truths,
            "estimates": problem.estimates,
            "steps": problem.steps,
            "candidate_pairs": len(self.states.pair_row),
            "pair_steps": len(problem.cost),
            "components": len(self.states.block_begin),
        }

    @property
    def compared(self) -> ComparedSides:
        """Truth and estimate with only the fields that are kept with the proof."""
        kept = vars(self)
        return ComparedSides(**{field.name: kept[field.name] for field in fields(ComparedSides)})


def prepare(
    sides: AlignedPair,
    request: EvaluationRequest,
    *,
    files: Sequence[Json] | None = None,
    stopwatch: Stopwatch,
) -> PreparedPair:
    """Build the reduced problem of truth and estimate: do all the work before the solver."""
    measured, near = measure(
        sides, request, cutoff=request.parameters.cutoff, files=files, stopwatch=stopwatch
    )
    with stopwatch.span("solve/preparation"):
        problem = measured.problem(near, request.parameters)
        del near  # frees the memory of the distances
        states = merge_runs(problem)
    return measured.prepared(states, request.parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class NearPairs:
    """Truth and estimate as they are compared, and all pairs nearer than a cutoff.

    Some pairs may be beyond the cutoff (see `of`).

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate, with states as `distance` compares them.
    distance : Distance
        Base distance, after its method `prepared`.
    pairs : Pairs
        Near pairs.
    unjudged : pair of (R,) bool arrays, optional
        Ignored rows of the truth, and excused rows of the estimate.
    reach : (R_truth,) float array, optional
        Distance beyond the cutoff up to which an estimate may follow each true state. This is above
        0 only for states in gaps.
    given : bool
        Whether the distances were computed at the timestamps of reports, not from these rows.
    """

    sides: Sides
    distance: Distance
    pairs: Pairs
    unjudged: tuple[Mask, Mask] | None = None
    reach: Floats | None = None
    given: bool = False

    @classmethod
    def of(
        cls,
        aligned: Alignment,
        request: EvaluationRequest,
        distance: Distance,
        cutoff: float,
        resources: Resources,
    ) -> "NearPairs":
        """Return both sides as they are compared, and all pairs that matter at this cutoff.

        These are the pairs nearer than the cutoff. If true states are ignored, two kinds of pairs
        are added: those so close to the cutoff that rounding decides if they are nearer, and those
        within the reach of a true state in a gap.
        """
        unjudged, reach = unjudged_of(aligned, request), reach_of(aligned.truth, request)
        compared = (
            aligned.truth.reduced_to(distance.kinds),
            aligned.estimate.reduced_to(distance.kinds),
        )
        raw = distance
        sides, distance = distance.prepared(compared, resources)
        margin = 0.0
        if unjudged is not None and unjudged[0].any():
            margin = distance.margin(sides, cutoff)

        def pairs_of(sides: Sides, reach: Floats | None) -> Pairs:
            pairs = prepared_pairs(sides, cutoff, distance, resources, margin=margin)
            if reach is None:
                return pairs
            return with_far_pairs(pairs, sides, distance, (cutoff, margin), reach, resources)

        reports = aligned.reports
        if reports is None:
            pairs = pairs_of(sides, reach)
        else:

            def at_reports(both: Sides) -> Pairs:
                compared = both[0].reduced_to(raw.kinds), both[1].reduced_to(raw.kinds)
                return pairs_of(raw.prepared(compared, resources)[0], reach_of(both[0], request))

            pairs = pairs_at_reports(reports, (aligned.truth, aligned.estimate), at_reports)
            widest = cutoff + margin + (0.0 if reach is None else reach[pairs.truth_row])
            pairs = pairs.chosen(np.flatnonzero(pairs.distance <= widest))
        return cls(
            sides=sides,
            distance=distance,
            pairs=pairs,
            unjudged=unjudged,
            reach=reach,
            given=reports is not None,
        )

    def problem(self, parameters: Parameters) -> Problem:
        """Return the problem of these pairs, in which some states may not be evaluated."""
        (truth, estimate), pairs, near, at_cutoff = self.sides, self.pairs, None, 0
        if self.unjudged is not None:
            near = pairs.distance < parameters.cutoff
            which, jumps = self._jumps(parameters)
            if self.given:
                near[which] = pairs.distance[which] < jumps
            else:
                near[which] = self.distance.nearer(pairs.chosen(which), self.sides, jumps)
            margin = self.distance.margin(self.sides, parameters.cutoff)
            at_cutoff = int(np.count_nonzero(np.abs(pairs.distance[which] - jumps) <= margin))
        problem = tgospa_problem(
            parameters=parameters,
            steps=len(truth.times),
            truths=len(truth.ids),
            estimates=len(estimate.ids),
            truth_step=truth.step,
            truth_track=truth.track,
            estimate_step=estimate.step,
            estimate_track=estimate.track,
            truth_row=pairs.truth_row,
            estimate_row=pairs.estimate_row,
            distance=pairs.distance,
            distance_error=self.distance.error(truth.state.shape[1]),
            last_place=self.distance.last_place(self.sides),
            near=near,
        )
        if self.unjudged is None:
            return problem
        return replace(ignore_states(problem, *self.unjudged), at_cutoff=at_cutoff)

    def _jumps(self, parameters: Parameters) -> tuple[Ints, Floats]:
        """Return the indices of pairs whose gain jumps at some distance, and this distance.

        These are the pairs of an ignored true state and an estimate that is not excused. The gain
        jumps at the cutoff plus the reach of the true state. The gain of any other pair falls
        continuously to 0 at the cutoff, so rounding of its distance does not matter.
        """
        assert self.unjudged is not None
        ignored, excused = self.unjudged
        which = np.flatnonzero(ignored[self.pairs.truth_row] & ~excused[self.pairs.estimate_row])
        reach = 0.0 if self.reach is None else self.reach[self.pairs.truth_row[which]]
        return which, np.broadcast_to(parameters.cutoff + reach, len(which))


def pairs_at_reports(
    clock: "ClockReports", sides: Sides, search: Callable[[Sides], Pairs]
) -> Pairs:
    """Return near pairs on a common clock, with distances at the timestamps of the reports.

    `search` receives truth and reports at these timestamps, and returns their near pairs.
    """
    none = np.zeros(0, np.int64)
    blocks: list[tuple[Ints, Ints, Floats]] = [(none, none, np.zeros(0))]
    for (truth, reports), rows in clock.blocks():
        part = search((truth, reports))
        track = clock.number(truth)[truth.track[part.truth_row]]
        blocks.append((track, rows[part.estimate_row], part.distance))
    track, report, distance = map(np.concatenate, zip(*blocks, strict=True))
    row, other, length = clock.on_clock((track, report, distance), sides)
    return Pairs(truth_row=row, estimate_row=other, distance=length)


def recorded_settings(
    distance: Distance,
    request: EvaluationRequest,
    columns: tuple[str, ...],
    reports: "ClockReports | None" = None,
) -> dict[str, object]:
    """Return every option that changes the number, except parameters and solver settings."""
    return {
        "distance": distance.name,
        **distance.settings(columns),
        "columns": list(columns),
        **request.time_matching.recorded,
        **({} if reports is None else {"period": reports.period}),
        "unit": request.unit,
        **_recorded_weights(request.step_weights),
        **({EXISTENCE: request.existence} if request.probabilistic else {}),
        **request.recorded,
    }


def measure(
    sides: AlignedPair,
    request: EvaluationRequest,
    *,
    cutoff: float,
    files: Sequence[Json] | None = None,
    stopwatch: Stopwatch,
) -> tuple[MeasuredSides, "NearPairs"]:
    """Return both sides as they are compared, and all pairs nearer than the cutoff.

    `files` are the records of both files (see `input_record`). By default they have only the
    numbers of rows.
    """
    distance, aligned = sides.distance, sides.alignment

    @cache
    def recorded() -> tuple[dict[str, Json], Coverage]:
        with stopwatch.span("report"):
            return _recorded(sides, request, files)

    with stopwatch.span("distances"):
        truth, estimate = (
            side.reduced_to(request.kinds) for side in (aligned.truth, aligned.estimate)
        )
        scene: dict[str, Any] = {  # states in their own units; `near` may have scaled ones
            "columns": truth.columns,
            "truth": truth.state,
            "estimate": estimate.state,
            "truth_covariance": truth.spread,
            "estimate_covariance": estimate.spread,
            "truth_clouds": truth.clouds,
            "estimate_clouds": estimate.clouds,
        }
        resources = Resources(jobs=request.solver.jobs, stopwatch=stopwatch)
        near = NearPairs.of(aligned, request, distance, cutoff, resources)
        truth, estimate = near.sides
        if request.memory is not None:
            rows = len(truth.step) + len(estimate.step)
            check_pairs(rows, len(near.pairs.distance), request.memory)
    weights = None
    if request.step_weights is not None:
        weights = check_weights(*request.step_weights.on(truth))
    measured = MeasuredSides(
        sides=near.sides,
        distance=near.distance,
        labels=Labels(
            times=truth.shown.tolist(),
            truths=truth.ids.tolist(),
            estimates=estimate.ids.tolist(),
            unit=request.unit,
        ),
        timestamps=truth.times,
        settings=recorded_settings(distance, request, truth.columns, aligned.reports),
        recorded=recorded,
        **scene,
        step_weights=weights,
        existence=(
            (existence_of(aligned.truth), existence_of(aligned.estimate))
            if request.probabilistic
            else None
        ),
        reports=aligned.reports,
    )
    return measured, near


def reach_of(truth: Trajectories, request: EvaluationRequest) -> Floats | None:
    """Return how far beyond the cutoff an estimate may follow each true state.

    The result is None if this distance is 0 for all states.
    """
    speed = 0.0 if request.ignoring is None else request.ignoring.max_speed
    if not speed or AWAY not in truth.attributes:  # no state is in a gap
        return None
    return speed * np.asarray(truth.attributes[AWAY], np.float64)


def with_far_pairs(
    pairs: Pairs,
    sides: Sides,
    distance: Distance,
    cutoff: tuple[float, float],
    reach: Floats,
    resources: Resources,
) -> Pairs:
    """Add pairs of true states in gaps, with distances up to the cutoff plus `reach`.

    `cutoff` has the cutoff, and a margin for rounding that is added to all limits.
    """
    rows = np.flatnonzero(reach > 0)
    if not len(rows):
        return pairs
    gaps = sides[0].chosen(rows)
    margin = cutoff[1]
    widest = cutoff[0] + float(reach.max())
    far = prepared_pairs((gaps, sides[1]), widest, distance, resources, margin=margin)
    row = rows[far.truth_row]
    kept = far.distance <= cutoff[0] + reach[row] + margin
    truth_row = np.concatenate((pairs.truth_row, row[kept]))
    estimate_row = np.concatenate((pairs.estimate_row, far.estimate_row[kept]))
    both = truth_row.astype(np.int64) * max(len(sides[1].step), 1) + estimate_row
    first = np.unique(both, return_index=True)[1]  # some pairs are in both lists
    value = np.concatenate((pairs.distance, far.distance[kept]))
    return Pairs(
        truth_row=truth_row[first], estimate_row=estimate_row[first], distance=value[first]
    )


def unjudged_of(aligned: Alignment, request: EvaluationRequest) -> tuple[Mask, Mask] | None:
    """Return masks of ignored rows of the truth and excused rows of the estimate.

    The result is None if all rows count.
    """
    if request.ignoring is None:
        return None
    masks = marks_of(aligned.truth, NOT_COUNTED), marks_of(aligned.estimate, NOT_COUNTED)
    return masks if any(mask.any() for mask in masks) else None


def digest_of_evaluated(request: EvaluationRequest, truth: str) -> str:
    """Return one digest of the truth and the regions; `truth` is the digest of the truth."""
    regions = None if request.ignoring is None else request.ignoring.regions
    if regions is None:
        return truth
    return hashlib.sha256(f"{truth} {regions.sha256}".encode()).hexdigest()


def _recorded(
    sides: AlignedPair, request: EvaluationRequest, files: Sequence[Json] | None
) -> tuple[dict[str, Json], Coverage]:
    """Return the records of both sides, and a record of the truth that is evaluated."""
    aligned, kinds, likely = sides.alignment, sides.distance.kinds, request.probabilistic
    files = files or [{"rows": len(side.step), "left_out": {}} for side in sides.given]
    digests = [digest(side.reduced_to(kinds), existence=likely) for side in sides.given]
    counts = aligned.truth.reduced_to(kinds)
    is_whole = sides.read[0] is sides.given[0] and len(counts.step) == len(sides.read[0].step)
    sha256 = digests[0] if is_whole else digest(counts, existence=likely)
    unjudged = unjudged_of(aligned, request)
    if unjudged is not None and unjudged[0].any():
        counts = counts.chosen(np.flatnonzero(~unjudged[0]))
    evaluated_on = judge(sides.axis.horizon, counts, digest_of_evaluated(request, sha256))
    left_out = zip(aligned.left_out, sides.axis.left_out, strict=True)
    records = {
        role: input_record(file, sha256, {"grid": off_grid, "steps": off_steps})
        for role, file, sha256, (off_grid, off_steps) in zip(
            ("truth", "estimate"), files, digests, left_out, strict=True
        )
    }
    return records, evaluated_on


def fit(
    truth: Trajectories,
    estimate: Trajectories,
    request: EvaluationRequest,
    names: tuple[str, str] = ("truth", "estimate"),
    placed: Callable[[Sides], Axis] | None = None,
) -> AlignedPair:
    """Return both sides on the same steps, and the distance fitted to the data.

    `placed` is a function that brings both sides to known steps. By default, the request decides on
    the steps.

    Raises
    ------
    ConfigError
        The grid has no step, or requested probabilities of existence are missing.
    InputError
        Columns, states, times or probabilities do not fit each other or the distance. Messages use
        `names`.
    """
    distance, time_matching = request.distance, request.time_matching
    check_columns(truth, estimate, names)
    check_states(truth, estimate, distance, names)
    if request.probabilistic:
        truth, estimate = expected(truth, estimate, names)
    given = truth, estimate
    if placed is None:
        across = NOT_COUNTED if request.ignoring is not None and request.ignoring.gaps else ""
        cutoff = request.parameters.cutoff
        axis = on_axis(given, time_matching, distance, names, cutoff, across)
        axis = with_outages(axis, time_matching, distance, names, cutoff)
    else:
        axis, time_matching = placed(given), TimeMatching()
    truth, estimate = axis.sides
    if request.ignoring is not None:
        near = request.time_matching.near
        truth = request.ignoring.ignore_inside(truth, near, names[0])
        estimate = request.ignoring.excuse(estimate, given[0], near, names)
    silent = axis.outages.ticks if axis.outages is not None and axis.outages.counted else None
    aligned = align(truth, estimate, time_matching, names, silent)
    if axis.reports is not None:
        aligned = replace(aligned, reports=axis.reports)
    if request.step_weights is not None:
        aligned = _weighted(aligned, request.step_weights.on(aligned.truth)[0])
    if time_matching.of_estimate:  # the horizon has the timestamps of estimate and outages
        axis = replace(axis, horizon=aligned.truth)
    if aligned.union and not len(aligned.truth.times):
        raise ConfigError(
            f"{option('grid', time_matching.grid)}: none of {aligned.union:,} steps is left; if "
            f"the clocks differ, see {option('time_tolerance')}"
        )
    if request.nees and len(aligned.estimate.step) and aligned.estimate.kind == "point":
        raise InputError(
            f"{names[1]}: {option('with_', NEES)} needs covariances (columns cov_xx, cov_xy, "
            "cov_yy or std_x, std_y) or particles, and its states have neither"
            f"{' after interpolation' * (axis.made is not None)}"
        )
    if request.sliding is not None:
        request.sliding.check(aligned.truth.clock)
    fitted = distance.fitted((aligned.truth, aligned.estimate))
    both = truth, estimate
    return AlignedPair(given=given, read=both, alignment=aligned, distance=fitted, axis=axis)


def _weighted(aligned: Alignment, weights: Floats) -> Alignment:
    """Return both sides without the rows at steps with weight 0; the steps stay."""
    if weights.all():
        return aligned
    rows = [np.flatnonzero(weights[side.step] > 0) for side in (aligned.truth, aligned.estimate)]
    reports = aligned.reports
    return replace(
        aligned,
        truth=aligned.truth.chosen(rows[0]),
        estimate=aligned.estimate.chosen(rows[1]),
        reports=reports and replace(reports, row=reports.row[rows[1]]),
    )


def _recorded_weights(given: "WeightsByTime | None") -> dict[str, object]:
    """Return the record of the weights of the steps: their digest."""
    if given is None:
        return {}
    order = np.argsort(given.times, kind="stable")
    sha = hashlib.sha256(given.clock.encode())
    for array in (whole(given.times[order]), given.cost[order], given.switch[order]):
        sha.update(np.ascontiguousarray(unsigned_zeros(array)).data)
    return {"step_weights": sha.hexdigest()}
