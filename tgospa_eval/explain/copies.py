"""Components as repairs leave them, as copies in one problem at steps of their own."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.explain.assigned import Held
from tgospa_eval.explain.edits import Edit
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.warm_start import SavedSolution

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Original:
    """What is solved, and how.

    Parameters
    ----------
    problem : Problem
        Before any repair.
    held : Held
        Its assignment.
    priced : Priced
        Its prices.
    """

    problem: Problem
    held: Held
    priced: "Priced"


@dataclass(frozen=True, kw_only=True, eq=False)
class Copy:
    """The components that an edit touches.

    Parameters
    ----------
    original : Original
        What is edited.
    edit : Edit
        How.
    blocks : (B,) bool array
        Components of the original that it touches.
    truth_in, estimate_in : bool arrays
        Tracks that it consists of: those of the components, and tracks without one that it changes;
        of estimates the new ones come last.
    near : Problem, optional
        The rows that edits add as its estimates, with all truths.
    rows, entries : int arrays
        Those of `near` that this edit adds.
    """

    original: Original
    edit: Edit
    blocks: Mask
    truth_in: Mask
    estimate_in: Mask
    near: Problem | None
    rows: Ints
    entries: Ints

    @property
    def size(self) -> int:
        """About how many rows and entries it has."""
        problem = self.original.problem
        whole = len(problem.cost) + len(problem.truth_step) + len(problem.estimate_step)
        return int(whole * np.count_nonzero(self.truth_in) / max(len(self.truth_in), 1)) + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Priced:
    """Prices by estimate and first step of their slot."""

    estimate: Ints
    step: Ints
    price: Floats


def priced(states: States, prices: Floats) -> Priced:
    """The prices more than 0 of estimates; those of blocks whose columns are truths are nothing."""
    paid = np.flatnonzero(prices > 0)
    node = states.columns.node[paid]
    direct = np.flatnonzero(~states.transposed[states.node_block[node]])
    paid, node = paid[direct], node[direct]
    track = np.zeros(states.nodes, np.int64)
    track[states.pair_column] = states.pair_estimate
    return Priced(
        estimate=track[node], step=states.columns.step[paid].astype(np.int64), price=prices[paid]
    )


def joined(copies: list[Copy], problem: Problem) -> tuple[Problem, SavedSolution]:
    """One problem of all copies, each at steps of its own, and where its solution may begin."""
    parts: dict[str, list[Any]] = {}
    warm: dict[str, list[Any]] = {}
    truths = estimates = truth_rows = estimate_rows = 0
    for number, copy in enumerate(copies):
        first = number * problem.steps
        rows = _rows(copy)
        own = _entries(copy, rows)
        for name, value in (
            ("truth_step", problem.truth_step[rows.truth] + first),
            ("truth_track", rows.truth_number[problem.truth_track[rows.truth]] + truths),
            ("truth_price", problem.truth_price[rows.truth]),
            ("estimate_step", rows.step + first),
            ("estimate_track", rows.track + estimates),
            ("estimate_price", rows.price),
            ("truth_row", own[0] + truth_rows),
            ("estimate_row", own[1] + estimate_rows),
            ("cost", own[2]),
        ):
            parts.setdefault(name, []).append(value)
        for name, value in _warm(copy, rows, first):
            shift = {"truth": truths, "estimate": estimates, "price_of": estimates}.get(name, 0)
            warm.setdefault(name, []).append(value + shift if shift else value)
        truths += int(np.count_nonzero(copy.truth_in))
        estimates += int(np.count_nonzero(copy.estimate_in))
        truth_rows, estimate_rows = truth_rows + len(rows.truth), estimate_rows + len(rows.step)
    arrays: dict[str, Any] = {name: np.concatenate(values) for name, values in parts.items()}
    steps = len(copies) * problem.steps
    price = problem.switch_price
    if not isinstance(price, float):
        price = np.tile(np.append(price, 0.0), len(copies))[:-1]
    near = [copy.near for copy in copies if copy.near is not None]
    whole = Problem(
        steps=steps,
        truths=truths,
        estimates=estimates,
        switch_price=price,
        cost_error=max(part.cost_error for part in (problem, *near)),
        cost_slack=max(part.cost_slack for part in (problem, *near)),
        rounding=problem.rounding,
        **arrays,
    )
    return whole, _saved({k: np.concatenate(v) for k, v in warm.items()}, whole)


@dataclass(frozen=True, kw_only=True, eq=False)
class _CopyRows:
    """Rows of a copy: of truths those of the problem, of estimates with new tracks, in order.

    `place` is where each old row is here, and each that is added, -1 for others.
    """

    truth: Ints
    truth_number: Ints
    estimate_number: Ints
    step: Ints
    track: Ints
    price: Floats
    place: Ints


def _rows(copy: Copy) -> _CopyRows:
    problem, edit = copy.original.problem, copy.edit
    chosen = np.flatnonzero(copy.estimate_in[problem.estimate_track])
    track = edit.tracks(problem.estimate_track[chosen], problem.estimate_step[chosen])
    chosen, track = chosen[track >= 0], track[track >= 0]
    step, price = problem.estimate_step[chosen], problem.estimate_price[chosen]
    sources = len(problem.estimate_step)
    if copy.near is not None and edit.added is not None:
        step = np.concatenate((step, copy.near.estimate_step[copy.rows]))
        track = np.concatenate((track, np.full(len(copy.rows), edit.added.track[0])))
        price = np.concatenate((price, copy.near.estimate_price[copy.rows]))
    number = np.cumsum(copy.estimate_in) - 1
    track = number[track]
    order = np.lexsort((track, step))
    back = np.empty(len(order), np.int64)
    back[order] = np.arange(len(order))
    place = np.full(sources + len(copy.rows), -1)
    place[chosen] = back[: len(chosen)]
    place[sources:] = back[len(chosen) :]
    return _CopyRows(
        truth=np.flatnonzero(copy.truth_in[problem.truth_track]),
        truth_number=np.cumsum(copy.truth_in) - 1,
        estimate_number=number,
        step=step[order],
        track=track[order],
        price=price[order],
        place=place,
    )


def _entries(copy: Copy, rows: _CopyRows) -> tuple[Ints, Ints, Floats]:
    """Rows of the entries of a copy, and their costs."""
    problem = copy.original.problem
    truth_place = np.full(len(problem.truth_step), -1)
    truth_place[rows.truth] = np.arange(len(rows.truth))
    truth, estimate = truth_place[problem.truth_row], rows.place[problem.estimate_row]
    kept = np.flatnonzero((truth >= 0) & (estimate >= 0))
    truth, estimate, cost = truth[kept], estimate[kept], problem.cost[kept]
    if copy.near is not None and len(copy.entries):
        near, at = copy.near, np.zeros(len(copy.near.estimate_step), np.int64)
        at[copy.rows] = len(problem.estimate_step) + np.arange(len(copy.rows))
        truth = np.concatenate((truth, truth_place[near.truth_row[copy.entries]]))
        estimate = np.concatenate((estimate, rows.place[at[near.estimate_row[copy.entries]]]))
        cost = np.concatenate((cost, near.cost[copy.entries]))
    order = np.lexsort((estimate, truth))
    return truth[order].astype(np.int32), estimate[order].astype(np.int32), cost[order]


def _warm(copy: Copy, rows: _CopyRows, first: int) -> Iterator[tuple[str, Ints | Floats]]:
    """The assignment and the prices at hand, with the names of tracks after the edit."""
    held, priced, edit = copy.original.held, copy.original.priced, copy.edit
    mine = np.flatnonzero(copy.truth_in[held.truth])
    moved = np.isin(held.estimate[mine], list(edit.pieces))
    still = mine[~moved]
    pieces = [(still, held.estimate[still], held.begin[still], held.end[still])]
    for name, parts in edit.pieces.items():
        own = mine[held.estimate[mine] == name]
        for piece in parts:
            begin, end = (
                np.maximum(held.begin[own], piece.begin),
                np.minimum(held.end[own], piece.end),
            )
            some = begin <= end
            pieces.append(
                (own[some], np.full(np.count_nonzero(some), piece.to), begin[some], end[some])
            )
    which, track, begin, end = (np.concatenate(part) for part in zip(*pieces, strict=True))
    yield "truth", rows.truth_number[held.truth[which]]
    yield "estimate", rows.estimate_number[track]
    yield "begin", begin + first
    yield "end", end + first
    yield "weight", held.weight[which]
    became = edit.tracks(priced.estimate, priced.step)
    paid = np.flatnonzero((became >= 0) & copy.estimate_in[np.maximum(became, 0)])
    yield "price_of", rows.estimate_number[became[paid]]
    yield "price_at", priced.step[paid] + first
    yield "price", priced.price[paid]


def _saved(warm: dict[str, Any], problem: Problem) -> SavedSolution:
    pair = (warm["truth"] * problem.estimates + warm["estimate"]) * problem.steps
    order = np.argsort(pair + warm["begin"], kind="stable")
    slot = warm["price_of"] * problem.steps + warm["price_at"]
    by_slot = np.argsort(slot, kind="stable")
    return SavedSolution(
        begin=(pair + warm["begin"])[order],
        end=(pair + warm["end"])[order],
        weight=warm["weight"][order],
        slot=slot[by_slot],
        price=warm["price"][by_slot],
    )
