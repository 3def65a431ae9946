"""HOTA, CLEAR (MOTA) and Identity (IDF1) of pairs of states with a similarity above 0.

The metrics are those of [Luiten 2021], [Bernardin 2008] and [Ristani 2016], as TrackEval evaluates
them:

    HOTA_a = sqrt(DetA AssA),  DetA = TP / (TP + FN + FP),
    AssA = mean over the matches of n / (states of the object + states of the track - n),
    MOTA = 1 - (FN + FP + IDSW) / (TP + FN),
    IDF1 = 2 IDTP / (2 IDTP + IDFN + IDFP),

where a is a threshold of the similarity. TP, FN and FP are the numbers of matches, missed states
and false states. For a match, n is the number of all matches between its object and its track.

Floating-point operations have the same order as in TrackEval, so every digit is the same. TrackEval
uses matrices of all pairs, which only add zeros to the sums. Here a matrix is made only for a step
at which some state is in several pairs, because only these steps need an assignment.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.boxes import TRACKEVAL_EPS

THRESHOLD = 0.5
"""Smallest similarity of a match, in CLEAR and Identity."""

THRESHOLDS = np.arange(0.05, 0.99, 0.05)
"""Smallest similarities of a match, in HOTA."""

SUMMED_FIELDS = {
    "hota": ("HOTA_TP", "HOTA_FN", "HOTA_FP", "AssA", "AssRe", "AssPr", "LocA"),
    "clear": (
        *("CLR_TP", "CLR_FN", "CLR_FP", "IDSW", "MT", "PT", "ML", "Frag"),
        *("CLR_Frames", "MOTP_sum"),
    ),
    "identity": ("IDTP", "IDFN", "IDFP"),
}
"""Sums of each metric, from which sequences are joined; those of HOTA are by threshold."""

SUM_AT_ONCE = 4096
"""Largest number of values that are added as one dense array."""

Sums = dict[str, Any]
"""Numbers and arrays by the names of `SUMMED_FIELDS`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SimilarPairs:
    """All P pairs of states at the same step with a similarity above 0.

    Pairs are sorted by step, then by true state, then by estimate.

    Parameters
    ----------
    step : (P,) int array
        Step of each pair.
    place : (2, P) int array
        Indices of both states of a pair among the states of the step, in the order of the file.
        This order decides ties.
    track : (2, P) int array
        Indices of the tracks of both states.
    similarity : (P,) float array
        Similarity of each pair, in (0, 1].
    sizes : (2, T) int array
        Numbers of true states and of estimates at each step.
    lengths : pair of int arrays
        Number of states of each true object, and of each estimate track. Each number is 1 or more.
    """

    step: Ints
    place: Ints
    track: Ints
    similarity: Floats
    sizes: Ints
    lengths: tuple[Ints, Ints]

    def cells(self) -> Ints:
        """Return, for each pair, the flat index of its two tracks in a matrix of all tracks."""
        cells: Ints = self.track[0] * len(self.lengths[1]) + self.track[1]
        return cells

    def near(self, threshold: float) -> "SimilarPairs":
        """Return the pairs with at least this similarity."""
        kept = self.similarity >= threshold
        return SimilarPairs(
            step=self.step[kept],
            place=self.place[:, kept],
            track=self.track[:, kept],
            similarity=self.similarity[kept],
            sizes=self.sizes,
            lengths=self.lengths,
        )

    def disputed(self) -> Iterator[tuple[slice, tuple[Ints, Ints], Floats]]:
        """Yield the input of an assignment, for each step at which a state is in several pairs.

        The input is the slice of the pairs of the step, their two places, and a matrix of zeros.
        """
        several = np.zeros(len(self.step), bool)
        for place, size in zip(self.place, self.sizes, strict=True):
            state = (np.cumsum(size) - size)[self.step] + place
            several |= np.bincount(state)[state] > 1
        steps = np.unique(self.step[several])
        ends = (np.searchsorted(self.step, steps, side=side).tolist() for side in ("left", "right"))
        for begin, end, size in zip(*ends, self.sizes[:, steps].T.tolist(), strict=True):
            part = slice(begin, end)
            yield part, (self.place[0, part], self.place[1, part]), np.zeros(size)


def hota(pairs: SimilarPairs) -> Sums:
    """Compute the sums of HOTA, for all thresholds from one assignment.

    The assignment prefers pairs whose tracks are similar at many steps.
    """
    similarity = pairs.similarity
    union = similarity.copy()  # right if both states are in no other pair: s + s - s = s
    for part, at, matrix in pairs.disputed():
        matrix[at] = similarity[part]
        union[part] = matrix.sum(0)[at[1]] + matrix.sum(1)[at[0]] - similarity[part]
    share = np.divide(similarity, union, out=np.zeros_like(similarity), where=union > TRACKEVAL_EPS)
    cells, cell = np.unique(pairs.cells(), return_inverse=True)
    shape = [len(length) for length in pairs.lengths]
    lengths = [
        length[track]
        for length, track in zip(pairs.lengths, divmod(cells, max(shape[1], 1)), strict=True)
    ]
    joint = np.bincount(cell, share, len(cells))
    score = (joint / (lengths[0] + lengths[1] - joint))[cell] * similarity
    taken = _assigned(pairs, lambda part, _: score[part])
    similarity, step, cell = similarity[taken], pairs.step[taken], cell[taken]

    matches, error = np.zeros(len(THRESHOLDS)), np.zeros(len(THRESHOLDS))
    association = np.zeros((3, len(THRESHOLDS)))
    for k, minimum in enumerate(THRESHOLDS - TRACKEVAL_EPS):
        matched = similarity >= minimum
        matches[k] = np.count_nonzero(matched)
        error[k] = _by_step(step[matched], similarity[matched])
        count = np.bincount(cell[matched], minlength=len(cells))
        unions = np.stack((lengths[0] + lengths[1] - count, *lengths))
        values = count * (count / np.maximum(1, unions))
        association[:, k] = _as_dense(cells, values, shape[0] * shape[1])
    association /= np.maximum(1, matches)
    return {
        "HOTA_TP": matches,
        "HOTA_FN": pairs.sizes[0].sum() - matches,
        "HOTA_FP": pairs.sizes[1].sum() - matches,
        **dict(zip(("AssA", "AssRe", "AssPr"), association, strict=True)),
        "LocA": np.maximum(1e-10, error) / np.maximum(1e-10, matches),
    }


def clear(pairs: SimilarPairs) -> Sums:
    """Compute the sums of CLEAR.

    The assignment of a step keeps matches of the step before, if this is possible.
    """
    sizes, lengths = pairs.sizes, pairs.lengths
    pairs = pairs.near(THRESHOLD - TRACKEVAL_EPS)
    both = sizes.all(axis=0)
    turn = np.cumsum(both)[pairs.step]  # index of the step among those with states of both sides
    cells = pairs.cells()
    order = np.argsort(cells, kind="stable")
    follows = (np.diff(cells[order]) == 0) & (np.diff(turn[order]) == 1)
    before = np.full(len(cells), -1)
    before[order[1:][follows]] = order[:-1][follows]
    taken = _assigned(
        pairs, lambda part, taken: 1000 * taken[before[part]] + pairs.similarity[part]
    )
    matches = np.count_nonzero(taken)
    truth, estimate = pairs.track[:, taken]
    order = np.argsort(truth, kind="stable")
    again = np.diff(truth[order]) == 0
    ratio = np.bincount(truth, minlength=len(lengths[0])) / lengths[0]
    mostly = np.count_nonzero(ratio > 0.8)
    partly = np.count_nonzero(ratio >= 0.2) - mostly
    return {
        "CLR_TP": matches,
        "CLR_FN": int(sizes[0].sum()) - matches,
        "CLR_FP": int(sizes[1].sum()) - matches,
        "IDSW": np.count_nonzero(again & (np.diff(estimate[order]) != 0)),
        "MT": mostly,
        "PT": partly,
        "ML": len(lengths[0]) - mostly - partly,
        "Frag": np.count_nonzero(again & (np.diff(turn[taken][order]) != 1)),
        "CLR_Frames": sizes.shape[1] if sizes.any(axis=1).all() else 0,
        "MOTP_sum": _by_step(pairs.step[taken], pairs.similarity[taken]),
    }


def identity(pairs: SimilarPairs) -> Sums:
    """Compute the sums of the identity metrics.

    Whole tracks are assigned to each other, with the largest sum of common matches. An object can
    stay unassigned: each object has an additional estimate, with which it has no match.
    """
    from scipy.sparse import coo_array  # lazy: slow to import
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    sizes = pairs.sizes.sum(axis=1).tolist()
    cells, count = np.unique(pairs.near(THRESHOLD).cells(), return_counts=True)
    shared = 0
    if len(cells):
        row, column = divmod(cells, len(pairs.lengths[1]))
        row = np.unique(row, return_inverse=True)[1]
        own = np.arange(row.max() + 1)
        none = count.max() + 1.0
        costs = np.append(none - count, np.full(len(own), none))
        places = np.append(row, own), np.append(column, len(pairs.lengths[1]) + own)
        graph = coo_array((costs, places)).tocsr()
        shared = int(none * len(own) - graph[min_weight_full_bipartite_matching(graph)].sum())
    return {"IDTP": shared, "IDFN": sizes[0] - shared, "IDFP": sizes[1] - shared}


METRICS: dict[str, Callable[[SimilarPairs], Sums]] = {
    "hota": hota,
    "clear": clear,
    "identity": identity,
}


def combined(name: str, every: Sequence[Mapping[str, Any]]) -> Sums:
    """Join the sums of several sequences.

    Means over the matches of a sequence become means over the matches of all sequences.
    """
    sums: Sums = {key: sum([each[key] for each in every]) for key in SUMMED_FIELDS[name]}
    if name == "hota":
        matches = sums["HOTA_TP"]
        for key, minimum in (("AssA", 1.0), ("AssRe", 1.0), ("AssPr", 1.0), ("LocA", 1e-10)):
            weighted = sum([each[key] * each["HOTA_TP"] for each in every])
            if key == "LocA":
                weighted = np.maximum(minimum, weighted)
            sums[key] = weighted / np.maximum(minimum, matches)
    return sums


def finished(name: str, sums: Mapping[str, Any]) -> Sums:
    """Return the sums, together with the reported numbers that follow from them."""

    def ratio(number: Any, *parts: Any) -> Any:
        return number / np.maximum(1.0, sum(parts))

    if name == "hota":
        matches, missed, false = (sums[f"HOTA_{key}"] for key in ("TP", "FN", "FP"))
        accuracy = ratio(matches, matches, missed, false)
        return {
            **sums,
            "DetRe": ratio(matches, matches, missed),
            "DetPr": ratio(matches, matches, false),
            "DetA": accuracy,
            "HOTA": np.sqrt(accuracy * sums["AssA"]),
        }
    if name == "clear":
        matches, missed, false = (sums[f"CLR_{key}"] for key in ("TP", "FN", "FP"))
        return {
            **sums,
            "MOTA": ratio(matches - false - sums["IDSW"], matches, missed),
            "MOTP": ratio(sums["MOTP_sum"], matches),
            "MODA": ratio(matches - false, matches, missed),
            "CLR_Re": ratio(matches, matches, missed),
            "CLR_Pr": ratio(matches, matches, false),
        }
    shared, missed, false = (sums[key] for key in SUMMED_FIELDS["identity"])
    return {
        **sums,
        "IDF1": ratio(shared, shared, 0.5 * false, 0.5 * missed),
        "IDR": ratio(shared, shared, missed),
        "IDP": ratio(shared, shared, false),
    }


def _assigned(pairs: SimilarPairs, score: Callable[[slice, Mask], Floats]) -> Mask:
    """Return a mask of the pairs in the assignment with the largest score at each step.

    `score` receives the slice of the pairs of a step, and a mask of the pairs assigned before. The
    mask that it receives has one more element, False, at the end. It returns a score above 0 for
    each pair of the slice.
    """
    from scipy.optimize import linear_sum_assignment  # lazy: slow to import

    taken = np.ones(len(pairs.step) + 1, bool)
    taken[-1] = False
    for part, at, matrix in pairs.disputed():
        matrix[at] = -score(part, taken)
        chosen = np.full(len(matrix), -1)
        rows, columns = linear_sum_assignment(matrix)
        chosen[rows] = columns
        taken[part] = chosen[at[0]] == at[1]
    return taken[:-1]


def _by_step(step: Ints, values: Floats) -> np.float64:
    """Sum the values of each step, and add these sums in order of the steps."""
    total: np.float64 = np.bincount(step, values, 1).cumsum()[-1]
    return total


def _as_dense(index: Ints, values: Floats, size: int) -> Floats:
    """Sum each row of `values` (k, N) with the rounding of the sum of a longer row with zeros.

    The longer rows (k, `size`) have the values at the sorted places `index`, and zeros elsewhere.
    NumPy adds such rows half by half, and the first half has a multiple of 8 values.
    """
    if not len(index):
        return np.zeros(len(values))
    if size <= SUM_AT_ONCE:
        dense = np.zeros((len(values), size))
        dense[:, index] = values
        return np.asarray(dense.sum(axis=1))
    half = size // 2 - size // 2 % 8
    split = int(np.searchsorted(index, half))
    first = _as_dense(index[:split], values[:, :split], half)
    return first + _as_dense(index[split:] - half, values[:, split:], size - half)
