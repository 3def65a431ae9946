"""What the cost of localisation is made of: means and spreads, distances and existence."""

import math

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance, Pairs
from tgospa_eval.distances.base import Sides
from tgospa_eval.evaluation.prepare import PreparedPair
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.readout import read_assigned
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.results.records import MEAN, SPREAD, PairProof
from tgospa_eval.text import option

LARGE = 1e7
"""Coordinates below this have nine decimals of which all are kept."""

ROUNDED_DIGIT = 2e-10
"""Relative error of a total from the rounding of decimals that is worth a warning."""


def within_rounding(bounds: Bounds, gap: float) -> tuple[Notice, ...]:
    """Whether the value itself is one of the last places of the states."""
    if not bounds.within_rounding(gap):
        return ()
    return (
        Notice(
            code="within-rounding",
            text="the value is within the rounding of the distances: only its bounds are known",
            remedy="coordinates with a nearby origin keep more digits",
        ),
    )


def at_cutoff(pairs: int) -> tuple[Notice, ...]:
    """Warning about so many pairs with an ignored truth whose distance is the cutoff, if any."""
    if not pairs:
        return ()
    of = "an ignored truth and an estimate"
    return (
        Notice(
            code="at-cutoff",
            text=f"{counted(pairs, f'pair of {of} is', f'pairs of {of} are')} at the cutoff within "
            "rounding: nearer ones cost nothing, others are false, so the last digits of the "
            "states decide",
            remedy=f"a slightly larger {option('cutoff')} makes them cost nothing, a smaller one "
            "false",
        ),
    )


def rounded_coordinates(prepared: PreparedPair, proof: PairProof) -> tuple[Notice, ...]:
    """Whether decimals of large coordinates are so rounded that ten digits of the total are not.

    Let u be the distance of neighbouring doubles; a decimal is off by u / sqrt(12), a difference by
    sqrt(2) times that, and the cost d^p of an assigned pair by p d^(p - 1) times that. These are
    independent, so their squares add up.
    """
    largest = max(np.abs(side.state).max(initial=0.0) for side in prepared.sides)
    sides = prepared.truth, prepared.estimate
    if largest < LARGE or all((states % 1 == 0).all() for states in sides):
        return ()
    states, cutoff, order = proof.states, proof.parameters.cutoff, proof.parameters.order
    used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
    slope = order * states.problem.cost[states.entry[used]] ** (1 - 1 / order)
    spacing = float(np.spacing(largest))
    error = float(np.linalg.norm(slope)) * spacing / math.sqrt(6) / cutoff
    total = proof.breakdown.total
    if not ROUNDED_DIGIT * total < error < total:  # where all is rounding, the bounds say so
        return ()
    return (
        Notice(
            code="rounded-coordinates",
            text=f"coordinates up to {largest:.3g} are {spacing:.2g} apart as floating-point "
            f"numbers: digit {math.ceil(-math.log10(error / total))} of the "
            "total may come from their rounding",
            remedy="coordinates with a nearby origin keep more digits",
        ),
    )


BLOCK = 1 << 16
"""Pairs whose distances are taken apart at a time."""


def pair_parts(prepared: PreparedPair, proof: PairProof) -> dict[str, Floats]:
    """Parts of the cost of each assigned pair (N,), which sum to it, if it has any."""
    if prepared.existence is None and type(prepared.distance).parts is Distance.parts:
        return {}
    problem, scale = proof.states.problem, proof.parameters.scale
    pairs = read_assigned(proof.states, proof.weights)
    entry, weight = pairs.entry, pairs.weight
    sides, held = prepared.sides, prepared.held
    own = problem.truth_row[entry], problem.estimate_row[entry]
    if held is not None and type(prepared.distance).parts is not Distance.parts:
        sides = held.located(sides[0].ids[sides[0].track[own[0]]], own[1])
        own = np.arange(len(entry)), np.arange(len(entry))
    measure, parameters = prepared.distance, proof.parameters
    parts = parts_of_distances(sides, measure, parameters, problem, entry, own)
    found = {name: weight * part for name, part in parts.items()}
    if prepared.existence is None:
        return found
    if not found:
        expected = weight * problem.share(entry) * problem.powers(entry)
        found = {"expected_localisation": scale * expected}
    return {**found, "existence_mismatch": scale * weight * problem.mismatch(entry)}


def parts_of_distances(
    sides: Sides,
    distance: Distance,
    parameters: Parameters,
    problem: Problem,
    entries: Ints,
    rows: tuple[Ints, Ints],
) -> dict[str, Floats]:
    """Cost of whole pairs by means and by spreads, if the cost is a square and has such parts.

    `rows` are those of the entries in either side.
    """
    if parameters.order != 2 or type(distance).parts is Distance.parts:
        return {}
    costs = np.zeros((2, len(entries)))
    for begin in range(0, len(entries) or 1, BLOCK):
        part = slice(begin, begin + BLOCK)
        entry = entries[part]
        pairs = Pairs(
            truth_row=rows[0][part],
            estimate_row=rows[1][part],
            distance=parameters.cutoff * np.sqrt(problem.powers(entry)),
        )
        parts = distance.parts(pairs, sides)
        if parts is None:
            return {}
        costs[:, part] = problem.share(entry) * np.square(parts)
    return dict(zip((MEAN, SPREAD), costs, strict=True))
