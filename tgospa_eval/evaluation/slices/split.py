"""Costs and counts of the reported assignment, each in one slice or shared between slices.

A cost belongs to a row: localisation and misses to that of the truth at the step, a false target to
its own, a switch to the row of its truth at the step that it is booked at. Each share of a row
adds to one slice, by sums in pairs: slices add up to the total but for a few roundings.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.by_class import EvaluationByClass
from tgospa_eval.evaluation.pair import PairEvaluation, source_of
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.slices.members import MOST_CROSSINGS, Members, members
from tgospa_eval.evaluation.slices.values import values_of
from tgospa_eval.evaluation.slicing import SliceBy, parse_slices
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.problem.problem import Objects, sum_by
from tgospa_eval.problem.states import ONE, States, changes, spare
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.slices import Slice, Slicing, added_up
from tgospa_eval.text import option, quoted

RowCosts = tuple[dict[str, Floats], dict[str, Floats]]
"""What each row of truth and estimate costs, in units of c^p, and how often: localisation, misses
and switches of truths, false targets of estimates."""


def cut(fitted: AlignedPair, asked: Sequence[SliceBy], cutoff: float) -> dict[str, Members]:
    """What each row of two sides belongs to, by what is asked for; known before a solution.

    Raises
    ------
    ConfigError
        There is no such attribute, or its values do not fit.
    """
    return {by.text: _members(by, fitted, cutoff) for by in asked}


def slicings(members: dict[str, Members], result: PairEvaluation) -> tuple[Slicing, ...]:
    """The costs of a result of these two sides."""
    costs = row_costs(result.proof.states, result.proof.weights)
    unique = is_unique(result.proof, result.gap, everywhere=True)
    return tuple(
        Slicing(by=by, slices=tuple(_slices(costs, found, result.scale)), unique=unique)
        for by, found in members.items()
    )


def slices_of(
    result: PairEvaluation | EvaluationByClass, texts: Sequence[str], *, summed: bool = False
) -> tuple[Slicing, ...]:
    """A result split by what texts ask for; `summed`: to be added to those of others.

    Raises
    ------
    ConfigError
        As of `cut`, or the result was not made by `evaluate`.
    """
    if isinstance(result, EvaluationByClass):
        parts = [slices_of(part, texts, summed=True) for part in result.results.values()]
        return tuple(added_up(parts))
    sides, _ = source_of(result)
    members = cut(sides, parse_slices(texts, summed=summed), result.proof.parameters.cutoff)
    return slicings(members, result)


def _members(by: SliceBy, fitted: AlignedPair, cutoff: float) -> Members:
    aligned = fitted.alignment
    sides, held = (aligned.truth, aligned.estimate), aligned.held
    rows = len(sides[0].step), len(sides[1].step)
    found = []
    for attribute in by.attributes:
        if held is None:
            values = values_of(sides, attribute, fitted.distance, cutoff)
        else:  # speeds and neighbours are those of reports
            at = sides[0], held.reports
            first, second = values_of(at, attribute, fitted.distance, cutoff)
            values = first, None if second is None else second[held.row]
        found.append(members(attribute, values, rows, summed=by.summed))
    whole = found[0] if len(found) == 1 else found[0].crossed(found[1])
    if len(whole.names) > MOST_CROSSINGS:
        raise ConfigError(
            f"{option('slices')} {quoted(by.text)}: would make {len(whole.names):,} slices"
        )
    return whole


def row_costs(states: States, weights: Ints) -> RowCosts:
    """The cost of an assignment, row by row."""
    problem = states.problem
    truths, estimates = problem.sides
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    entry, weight = states.entry[used], weights[used]

    paid = weight / ONE * problem.cost[entry]
    missed, false = (spare(side, entry, weight) / ONE for side in problem.sides)
    moved, amount = changes(states, weights)
    pair = np.searchsorted(states.pair_first, moved, side="right") - 1
    step = states.begin[moved]
    row = _row_at(truths, states.pair_truth[pair], step)
    size = len(truths.step)
    price = problem.switch_price_at[step] * amount
    return (
        {
            "localisation": sum_by(truths.row[entry], paid, size),
            "missed": missed * truths.price,
            "missed_count": missed,
            "switch": sum_by(row, price, size),
            "switch_count": 0.5 * sum_by(row, amount, size),
            "truth_steps": _judged(truths),
        },
        {
            "false": false * estimates.price,
            "false_count": false,
            "estimate_steps": np.ones(len(estimates.step)),
        },
    )


def _judged(truths: Objects) -> Floats:
    """1 for each row that is judged."""
    judged = np.ones(len(truths.step))
    if truths.unjudged is not None:
        judged[truths.unjudged] = 0.0
    return judged


def _row_at(truths: Objects, track: Ints, step: Ints) -> Ints:
    """The row of a truth at a step; where it does not exist then its next one, or its last."""
    order = np.argsort(truths.track, kind="stable")
    steps = int(truths.step.max(initial=0)) + 2
    key = truths.track[order].astype(np.int64) * steps + truths.step[order]
    place = np.searchsorted(key, track.astype(np.int64) * steps + np.minimum(step, steps - 1))
    last = np.searchsorted(key, (track.astype(np.int64) + 1) * steps) - 1
    found: Ints = order[np.minimum(place, last)]
    return found


def _slices(costs: RowCosts, whole: Members, scale: float) -> list[Slice]:
    """The sums of all slices in which is anything, or that are shown without."""
    size = len(whole.names)
    sums: dict[str, Floats] = {}
    for side, columns in enumerate(costs):
        for part in whole.shares:
            place, share = part[side]
            order = np.argsort(place.astype(np.min_scalar_type(size)), kind="stable")
            first = np.searchsorted(place[order], np.arange(size + 1))
            for name, value in columns.items():
                found = _sum_of_parts((value * share)[order], first)
                sums[name] = sums[name] + found if name in sums else found
    for name in PARTS:
        sums[name] = sums[name] * scale
    # A slice of ignored truths alone has no states that count, but may have a switch.
    there = whole.kept | np.logical_or.reduce([value > 0 for value in sums.values()])
    return [
        Slice(name=whole.names[k], **{name: float(value[k]) for name, value in sums.items()})
        for k in np.flatnonzero(there).tolist()
    ]


def _sum_of_parts(value: Floats, first: Ints) -> Floats:
    """Sums of contiguous parts, each in pairs: a sum of n terms is off by log2 n roundings."""
    bounds = first.tolist()
    return np.array([value[low:high].sum() for low, high in pairwise(bounds)], np.float64)
