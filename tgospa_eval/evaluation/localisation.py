"""What the cost of localisation is made of: means and spreads, distances and existence."""

import numpy as np

from tgospa_eval.distances import Distance, Pairs
from tgospa_eval.distances.base import Sides
from tgospa_eval.evaluation.prepare import Prepared
from tgospa_eval.problem.weights import ONE
from tgospa_eval.results.result import Proof

BLOCK = 1 << 16
"""Pairs whose distances are taken apart at a time."""


def split_localisation(prepared: Prepared, proof: Proof) -> dict[str, float] | None:
    """Parts of the cost of localisation, which sum to it, if it has any."""
    found = _split_of_distances(prepared.sides, prepared.distance, proof) or {}
    if prepared.existence is None:
        return found or None
    states, problem = proof.states, proof.states.problem
    used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
    entry, weight = states.entry[used], proof.weights[used] / ONE
    scale = proof.parameters.cutoff**proof.parameters.order
    if not found:
        expected = weight * problem.share(entry) * problem.powers(entry)
        found = {"expected_localisation": scale * float(expected.sum())}
    mismatch = float(np.sum(weight * problem.mismatch(entry)))
    return {**found, "existence_mismatch": scale * mismatch}


def _split_of_distances(sides: Sides, distance: Distance, proof: Proof) -> dict[str, float] | None:
    """Cost of localisation by means and by spreads, if the cost is a square and has such parts."""
    if proof.parameters.order != 2 or type(distance).parts is Distance.parts:
        return None
    states, problem = proof.states, proof.states.problem
    used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
    sums = [0.0, 0.0]
    for begin in range(0, len(used) or 1, BLOCK):
        state = used[begin : begin + BLOCK]
        entry = states.entry[state]
        share = problem.share(entry)
        pairs = Pairs(
            truth_row=problem.truth_row[entry],
            estimate_row=problem.estimate_row[entry],
            distance=proof.parameters.cutoff * np.sqrt(problem.powers(entry)),
        )
        parts = distance.parts(pairs, sides)
        if parts is None:
            return None
        for k, part in enumerate(parts):
            sums[k] += float((share * proof.weights[state] / ONE) @ (part * part))
    return {"localisation_mean": sums[0], "localisation_spread": sums[1]}
