"""Repairs of an estimate with the largest savings: their search, trial, proof and description."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tgospa_eval.common.arrays import Ints, Mask
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted, number
from tgospa_eval.distances import near_pairs
from tgospa_eval.errors import ConfigError, InputError, whole_number
from tgospa_eval.evaluation.axis import check_left
from tgospa_eval.evaluation.pair import PairEvaluation, source_of
from tgospa_eval.evaluation.prepare import AlignedPair, PreparedPair, fit, prepare, reach_of
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.explain.candidates import (
    NO_PARTNER,
    Assigned,
    Candidate,
    Edit,
    StatePlaces,
    as_read,
    edited,
    exchanged,
    extended,
    filled,
    is_same,
    moved,
    of_rows,
    renamed,
    shifted,
    split_up,
)
from tgospa_eval.formats import Reading
from tgospa_eval.problem.certificate import ROUNDOFF, certify, lower_bounds, lower_cost
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.quoting import option
from tgospa_eval.results.explanation import Explanation, Repair
from tgospa_eval.results.records import Columns, PairProof, outward
from tgospa_eval.solvers.block_costs import feasible_costs
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, WarmStart, make_warm_start
from tgospa_eval.tracks.alignment import Alignment
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Trajectories

# -------------------------------------------------------------------------------------------------
# Proof of savings.
#
# A bound of the cost is the sum of the bounds of the components, plus the cost of the objects and
# tracks in no component. A repair changes few components. Only these are solved again
# (docs/theory/solvers.md, "Repairs").


Masks = tuple[Mask, Mask]
"""A mask of true objects and a mask of tracks."""


class Trials:
    """Trials of repairs of an evaluated estimate.

    A trial applies a repair to the estimate, and proves bounds of the cost of the result.

    Parameters
    ----------
    proof : PairProof
        Proof of the evaluation.
    assigned : Assigned
        Assignment of the evaluation.
    sides : AlignedPair
        Truth and estimate of the evaluation.
    request : EvaluationRequest
        Options of the evaluation.
    """

    def __init__(
        self, proof: PairProof, assigned: Assigned, sides: AlignedPair, request: EvaluationRequest
    ) -> None:
        self.assigned, self.sides, self.request = assigned, sides, request
        self.aligned, self.parameters = sides.alignment, proof.parameters
        self.estimate = as_read(self.aligned.estimate)
        self.number = {name: k for k, name in enumerate(self.aligned.estimate.ids.tolist())}
        states, self.problem = proof.states, proof.states.problem
        self.blocks = states.track_blocks
        self.lower = lower_bounds(states, proof.prices, proof.reduced)
        self.cost = feasible_costs(states, proof.weights)
        self.rounding = (len(proof.weights) + 2 * len(self.problem.cost) + 64) * ROUNDOFF
        distance = request.distance.settings(sides.read[0].columns)
        filters = {name.rpartition("_")[2] for name in request.recorded}
        self.is_filtered = not filters.isdisjoint(("time", "class", "region", "where"))
        self.as_a_whole = (
            sides.distance is not request.distance  # settings of the distance come from the data
            or "reduce" in distance
            or reach_of(self.aligned.truth, request) is not None
        )

    def run(
        self, candidates: Sequence[Candidate], stopwatch: Stopwatch
    ) -> list[tuple[Candidate, Bounds, float]]:
        """Try repairs until all are tried or the user stops.

        A repair is left out if the evaluation is not possible after it.

        Returns
        -------
        list of tuples
            Each repair that was tried, the proven bounds of the cost after it, and the cost of the
            computed assignment, in units of c^p.
        """
        progress = stopwatch.progress
        tried = []
        for done, candidate in enumerate(candidates):
            if progress.stop.is_set():
                break
            progress.again("repairs", done / len(candidates))
            try:
                tried.append((candidate, *self._trial(candidate.edit, stopwatch)))
            except (ConfigError, InputError):  # for example, there is no evaluated step any more
                continue
        return tried

    def _trial(self, edit: Edit, stopwatch: Stopwatch) -> tuple[Bounds, float]:
        """Return the bounds and the cost of the estimate after an edit.

        If the edit leaves the truth and all tracks outside the edit unchanged, only the components
        that it touches are solved. If not, the whole problem is solved.
        """
        conversion = own_conversion(self.request, self.estimate)
        after = conversion(conversion.undone(edited(self.estimate, edit)), "estimate")
        if self.request.ignoring is not None:
            reading = Reading(trajectories=after, rows=len(after.step))
            after = self.request.ignoring.marked(reading, *2 * ("estimate",)).trajectories
        if self.is_filtered and not any(len(side.step) for side in (self.sides.given[0], after)):
            raise ConfigError("no row is left to evaluate")
        sides = fit(self.sides.given[0], after, self.request)
        kept = sum(len(side.step) for side in sides.axis.sides)
        check_left(self.request.time_matching, kept, sides.axis.left_out)
        if edit.local and not self.as_a_whole and self._keeps_rest(edit, sides.alignment):
            return self._of_components(edit, sides, stopwatch)
        return self._evaluated(sides, edit, stopwatch)

    def _keeps_rest(self, edit: Edit, after: Alignment) -> bool:
        """Return whether the truth and all tracks outside the edit are the same in `after`."""
        before = self.aligned
        is_other = np.ones(len(self.number) + len(edit.fresh), bool)
        is_other[list(self._tracks(edit))] = False
        first, second = (
            side.chosen(np.flatnonzero(is_other[self._numbers(side, edit)[side.track]]))
            for side in (before.estimate, after.estimate)
        )
        return is_same(before.truth, after.truth) and is_same(first, second)

    def _tracks(self, edit: Edit) -> set[int]:
        """Return the indices of the tracks that an edit changes or adds."""
        fresh = range(len(self.number), len(self.number) + len(edit.fresh))
        added = () if edit.added is None else edit.added.track.tolist()
        return {*edit.pieces, *added, *fresh}

    def _numbers(self, side: Trajectories, edit: Edit) -> Ints:
        """Return, for each track of the estimate `side`, its index in the edit.

        An edit numbers the tracks of the evaluated estimate from 0, and its new tracks after them.
        """
        number = self.number | {name: len(self.number) + k for k, name in enumerate(edit.fresh)}
        return np.array([number[name] for name in side.ids.tolist()], np.int64)

    def _of_components(
        self, edit: Edit, after: AlignedPair, stopwatch: Stopwatch
    ) -> tuple[Bounds, float]:
        """Solve the components that an edit touches, and keep the bounds of all others.

        `after` has truth and estimate after the edit.
        """
        problem = self.problem
        side = after.alignment.estimate
        track = self._numbers(side, edit)[side.track]
        touched, blocks = self._touched(edit, side, track)
        estimate_in = np.append(touched[1], np.ones(len(edit.fresh), bool))
        truth = self.aligned.truth
        truth = truth.chosen(np.flatnonzero(touched[0][truth.track]))
        estimate = side.chosen(np.flatnonzero(estimate_in[track]))
        aligned = replace(after.alignment, truth=truth, estimate=estimate)
        bounds, total = self._evaluated(replace(after, alignment=aligned), edit, stopwatch)
        unpaired: list[float] = []
        for price, block, mask in zip(problem.unassigned_costs, self.blocks, touched, strict=True):
            unpaired += price[(block < 0) & ~mask].tolist()
        rest = math.fsum((*self.cost[~blocks].tolist(), *unpaired))
        unpaired_lower = math.fsum((*self.lower[~blocks].tolist(), *unpaired)) * (1 - self.rounding)
        return (
            replace(
                bounds,
                lower=bounds.lower + lower_cost(problem, unpaired_lower),
                upper=bounds.upper + rest * (1 + self.rounding) / (1 - problem.cost_error),
            ),
            total + rest,
        )

    def _touched(self, edit: Edit, after: Trajectories, track: Ints) -> tuple[Masks, Mask]:
        """Return masks of the objects and tracks that an edit touches, and of their components.

        The edit touches a component if it changes a track of the component. If the estimate can
        have new rows, an object can be near a changed track only after the edit. The edit touches
        the components of these objects, too. `after` is the estimate after the edit, with R rows.
        `track` (R,) has, for each row, the index of its track in the edit (see `_numbers`).
        """
        tracks = self._tracks(edit)
        truth_in = np.zeros(self.problem.truths, bool)
        estimate_in = np.zeros(self.problem.estimates, bool)
        estimate_in[[k for k in tracks if k < self.problem.estimates]] = True
        if edit.added is not None or self.request.time_matching.gaps:
            distance, truth = self.sides.distance, self.aligned.truth
            own = after.chosen(np.flatnonzero(np.isin(track, list(tracks))))
            pairs = near_pairs(
                truth.reduced_to(distance.kinds),
                own.reduced_to(distance.kinds),
                self.parameters.cutoff,
                distance,
            )
            truth_in[truth.track[pairs.truth_row]] = True
        blocks = np.zeros(len(self.lower) + 1, bool)  # the last element means "no component"
        for mask, block in zip((truth_in, estimate_in), self.blocks, strict=True):
            blocks[block[mask]] = True
        blocks[-1] = False
        truth_in |= blocks[self.blocks[0]]
        estimate_in |= blocks[self.blocks[1]]
        return (truth_in, estimate_in), blocks[:-1]

    def _evaluated(
        self, sides: AlignedPair, edit: Edit, stopwatch: Stopwatch
    ) -> tuple[Bounds, float]:
        """Return bounds and cost of two sides after an edit.

        If the solver supports it, it begins with the solution before the edit.
        """
        prepared = prepare(sides, self.request, stopwatch=stopwatch)
        solver = self.request.solver
        if isinstance(solver, Certified):
            solution = solver(prepared.states, stopwatch, self._warm_start(edit, prepared))
        else:
            solution = solver(prepared.states, stopwatch)
        bounds, _, split = certify(prepared.states, solution, consume=solution.disposable)
        return bounds, split.total

    def _warm_start(self, edit: Edit, prepared: PreparedPair) -> WarmStart:
        """Translate the assignment and the prices before the edit to the tracks after it."""
        old = self.assigned.saved
        run, estimate, begin, end = renamed(old, edit)
        became = edit.tracks(old.priced, old.step)
        paid = np.flatnonzero(became >= 0)
        saved = SavedSolution(
            truth=old.truth[run],
            estimate=estimate,
            begin=begin,
            end=end,
            weight=old.weight[run],
            priced=became[paid],
            step=old.step[paid],
            price=old.price[paid],
            estimates=old.estimates + len(edit.fresh),
            steps=old.steps,
        )
        before = self.aligned
        step = np.searchsorted(before.truth.times, prepared.timestamps).clip(0, old.steps - 1)
        number = {name: k for k, name in enumerate(before.truth.ids.tolist())}
        sides = prepared.sides
        # After an edit, the grid can have rows of a true object that had none before. The solution
        # does not know such an object.
        known = [number.get(name, NO_PARTNER) for name in sides[0].ids.tolist()]
        origin = np.array(known, np.int64), self._numbers(sides[1], edit), step
        return replace(make_warm_start(prepared.states, (saved,), (1.0,), origin), near=True)


# -------------------------------------------------------------------------------------------------
# The repairs of a result.


TOP = 10
"""Default number of listed repairs."""

TRIED = 2
"""Largest number of repairs that are tried, divided by the largest number that are listed."""


def explain(
    result: PairEvaluation,
    top: int = TOP,
    *,
    stopwatch: Stopwatch | None = None,
) -> Explanation:
    """Return the repairs with the largest proven savings, at most `top`.

    Parameters
    ----------
    result : PairEvaluation
        Result of `evaluate`.
    top : int
        Largest number of listed repairs. At most `TRIED` * `top` repairs are tried.
    stopwatch : Stopwatch, optional
        Stopwatch that shows the progress.

    Raises
    ------
    ConfigError
        `top` is less than 1, the result does not contain the evaluated data, or an option of the
        evaluation does not support repairs.
    """
    top = whole_number("top", top)
    sides, request = source_of(result)
    if sides.alignment.reports is not None:
        raise ConfigError(
            f"explain: repairs are not supported with {option('resample')}, where a report holds "
            "for several steps; evaluate at the times of the estimate, with "
            f"{option('interpolate', 'truth')}"
        )
    without = not_explained(request)
    stopwatch = stopwatch or Stopwatch()
    begin = stopwatch.elapsed()
    with stopwatch.span("explain"):
        proof = result.proof
        assigned = Assigned(proof.states, proof.weights, proof.prices)
        able = [
            candidate
            for candidate in _candidates(result, sides, request, assigned, TRIED * top)
            if candidate.kind not in without
        ]
        tried = sorted(able, key=lambda candidate: -candidate.saving)[: TRIED * top]
        trials = Trials(proof, assigned, sides, request).run(tried, stopwatch) if tried else []
        repairs = [_repair(result, sides.read[0].columns, *trial) for trial in trials]
    worth = [repair for repair in repairs if repair.saving_upper > result.gap * result.total]
    worth.sort(key=lambda repair: -float(f"{repair.saving_lower:.6g}"))  # stable for equal savings
    estimate = as_read(sides.alignment.estimate)
    return Explanation(
        result=result,
        repairs=tuple(worth[:top]),
        candidates=len(able),
        tried=len(trials),
        seconds=stopwatch.elapsed() - begin,
        estimate=estimate,
        conversion=own_conversion(request, estimate),
    )


def own_conversion(request: EvaluationRequest, estimate: Trajectories) -> Conversion:
    """Return the conversion from the units of the estimate to those of the evaluation.

    It scales times only if the times of the estimate are plain numbers.
    """
    scaled = estimate.clock == "number"
    return request.conversion if scaled else replace(request.conversion, time_scale=1.0)


def not_explained(request: EvaluationRequest) -> tuple[str, ...]:
    """Return the kinds of repairs that are not tried because the evaluation filters rows.

    These repairs change or add states or times. After such a repair, a filter could leave out other
    rows than before.

    Raises
    ------
    ConfigError
        The evaluation uses the rules of a benchmark.
    """
    filters = request.recorded
    if "preprocess" in filters:
        raise ConfigError(
            f"{option('preprocess')} is not supported by explain: what it leaves out changes with "
            "the repair; remove those objects from the files"
        )
    is_of_rows = not {"where", "estimate_where"}.isdisjoint(filters)
    moving = ("shift",) if "time" in filters or is_of_rows else ()
    return (*moving, "offset", "extend", "fill") if "region" in filters or is_of_rows else moving


def _candidates(
    result: PairEvaluation,
    sides: AlignedPair,
    request: EvaluationRequest,
    assigned: Assigned,
    limit: int,
) -> Iterator[Candidate]:
    """Yield repairs with an estimated saving above 0.

    `limit` is the largest number of drops, of fills, and of extensions at each end.
    """
    estimate = sides.alignment.estimate
    if not len(estimate.step):
        return
    places = StatePlaces(sides, result.proof.parameters, probabilistic=request.probabilistic)
    names = result.labels.truths, result.labels.estimates
    makers = [exchanged(assigned), split_up(assigned, *names), of_rows(assigned, limit)]
    if len(sides.alignment.truth.step):
        if estimate.clouds is None:
            makers += [
                filled(assigned, places, limit),
                extended(assigned, places, limit),
            ]
        if assigned.problem.steps > 1 and request.step_weights is None:
            makers.append(shifted(assigned, places))
        makers.append(moved(assigned, places))
    for maker in makers:
        yield from (candidate for candidate in maker if candidate.saving > 0)


def _repair(
    result: PairEvaluation,
    columns: tuple[str, ...],
    candidate: Candidate,
    after: Bounds,
    total: float,
) -> Repair:
    """Return the repair that a candidate proposes, with ids and times as in the user's files.

    `after` has the bounds of the cost after the repair, and `total` is the cost of its assignment,
    in units of c^p.
    """
    edit, labels, scale = candidate.edit, result.labels, result.scale
    before = result.proof.bounds
    begin, end = (None if k is None else labels.times[k] for k in (candidate.begin, candidate.end))
    rows: Columns = {}
    if edit.added is not None:
        rows = {"t": [labels.times[k] for k in edit.added.step.tolist()]}
        rows |= dict(zip(columns, edit.added.state.T.tolist(), strict=True))
    offset = {} if edit.offset is None else dict(zip(columns, edit.offset.tolist(), strict=True))
    return Repair(
        kind=candidate.kind,
        text=in_words(candidate, result, offset),
        estimates=tuple(labels.estimates[track] for track in candidate.tracks),
        tracks=candidate.tracks,
        begin=begin,
        end=end,
        shift=edit.shift,
        offset=offset,
        rows=rows,
        total=scale * total,
        tgospa=result.proof.parameters.root(total),
        lower_bound=result.proof.outward_root(after.lower, -1),
        upper_bound=result.proof.outward_root(after.upper, 1),
        saving_lower=_outward(scale * (before.lower - after.upper), -1),
        saving_upper=_outward(scale * (before.upper - after.lower), 1),
        edit=partial(edited, edit=edit),
    )


def _outward(value: float, sign: int) -> float:
    """Round a saving down (`sign` -1) or up (`sign` 1).

    The change is larger than the rounding error of ``scale * (before - after)``.
    """
    return outward(value, sign if value > 0 else -sign) if value else 0.0


def in_words(candidate: Candidate, result: PairEvaluation, offset: dict[str, float]) -> str:
    """Return the description of a repair in words."""
    labels, edit = result.labels, candidate.edit
    first, second = ([labels.estimates[track] for track in candidate.tracks] + 2 * [""])[:2]
    begin, end = (
        "" if k is None else str(labels.times[k]) for k in (candidate.begin, candidate.end)
    )
    span = f"t = {begin}" if begin == end else f"t = {begin} to {end}"
    kind, size = candidate.kind, abs(edit.shift)
    if kind in ("exchange", "extend"):
        problem = result.proof.states.problem
        own = problem.estimate_step[problem.estimate_track == candidate.tracks[0]]
        kind += "-after" * bool(own.max() < (candidate.begin or 0))
    parts = ", ".join(f"{name} = {number(value, 4)}" for name, value in offset.items())
    return {
        "merge": f"join estimate {second}, {span}, to estimate {first}",
        "exchange": f"exchange estimates {first} and {second} from t = {begin} on",
        "exchange-after": f"join estimate {second} from t = {begin} on to estimate {first}",
        "split": f"split estimate {first} at t = {begin}",
        "drop": f"drop estimate {first}, {span}",
        "trim": f"remove {span} from estimate {first}",
        "fill": f"fill the gap of estimate {first}, {span}",
        "extend": f"extend estimate {first} back to t = {begin}",
        "extend-after": f"extend estimate {first} to t = {end}",
        "shift": f"shift the whole estimate {counted(size, 'step')} "
        f"{'later' if edit.shift > 0 else 'earlier'}",
        "offset": f"subtract the offset {parts} from the whole estimate",
    }[kind]
