"""Some truths of a long component over all its time: their bounds, and what they hold."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.partitioned.long.columns import load_columns
from tgospa_eval.partitioned.long.holding import hold_runs
from tgospa_eval.partitioned.long.tables import (
    GAIN,
    WindowPiece,
    expansion,
    halves,
    load_pieces,
    no_assignment,
    renumbered,
)
from tgospa_eval.partitioned.shards import (
    HELD,
    Table,
    contribute,
    judged_rows,
    problem_of,
    tables_of,
)
from tgospa_eval.partitioned.tasks import writing_folder
from tgospa_eval.problem.certificate import row_terms
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.paths import best_values
from tgospa_eval.problem.problem import REGRET, Problem, sum_by
from tgospa_eval.problem.readout import read_tracks
from tgospa_eval.problem.rows import rows_of_component, running_of
from tgospa_eval.problem.slots import changed
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, assigned, row_parts


def load_rows(
    pieces: tuple[WindowPiece, ...], number: int, window: tuple[int, int], parameters: Parameters
) -> tuple[Problem, Ints, tuple[Ints, Ints]]:
    """All entries of some truths, their weights, and the numbers of the truths and estimates."""
    first, last = window
    gains = load_pieces(pieces, "gains", number, GAIN)
    numbers = np.unique(gains["truth"]), np.unique(gains["estimate"])
    problem = replace(problem_of(gains, first, numbers, parameters), steps=last - first + 1)
    return problem, np.ascontiguousarray(gains["weight"]), numbers


def prove_rows(
    output: str,
    *,
    pieces: tuple[WindowPiece, ...],
    number: int,
    columns: tuple[str, ...],
    window: tuple[int, int],
    parameters: Parameters,
) -> None:
    """Best paths at the prices, runs that are held, switches, intervals, regrets of some truths.

    Parameters
    ----------
    output : str
        The folder that is written.
    pieces : tuple of WindowPiece
        All steps.
    number : int
        Which shard of truths.
    columns : tuple of str
        What `join_columns` wrote of all estimates.
    window : pair of int
        First and last step of the component.
    parameters : Parameters
        Of the metric.
    """
    first = window[0]
    problem, entry_weights, numbers = load_rows(pieces, number, window, parameters)
    places, index, busy = load_columns(columns, numbers[1], first)
    states = rows_of_component(problem, places)
    running = running_of(places, problem.truths)
    holds = renumbered(load_pieces(pieces, "holds", number, HELD), numbers, first)
    weights = hold_runs(states, entry_weights, holds, busy)
    _check_rows(states, weights)
    terms, pairs, left = _bound(states, running, len(index))
    moved = np.flatnonzero(changed(states.pair_first, weights))
    variation = np.abs(weights[moved] - weights[moved - 1])
    intervals = _intervals(states, weights, first, numbers)
    with writing_folder(output) as folder:
        contribute(
            folder,
            tables=tables_of(states, weights, first, numbers),
            truths=_tracks(states, weights, numbers, 0),
            estimates=_tracks(states, weights, numbers, 1),
        )
        np.save(folder / "columns.npy", numbers[1])
        np.save(folder / "assigned_columns.npy", _assigned(states, weights))
        aside = np.flatnonzero(left != 1)
        np.save(folder / "aside.npy", index[aside])
        np.save(folder / "asides.npy", 1 - left[aside])
        by_estimate = intervals[np.lexsort((intervals["begin"], intervals["estimate"]))]
        np.save(folder / "by_estimate.npy", by_estimate)
        np.save(folder / "by_estimate.key.npy", by_estimate["estimate"])
        np.savez(
            folder / "sums.npz",
            lower=expansion(terms),
            pairs=pairs,
            variation=halves(variation, states.begin[moved], problem.steps),
            regret=_regrets(states, weights, running, first),
        )


def _tracks(
    states: States, weights: Ints, numbers: tuple[Ints, Ints], side: int
) -> dict[str, NDArray[np.generic]]:
    """What tracks contribute; where estimates are unassigned, other rows have to say."""
    parts = vars(read_tracks(states, weights, side))
    size = len(numbers[side])
    rows = judged_rows(states.problem.sides[side])
    if side == 1:
        parts |= {"unassigned": np.zeros(size), "unassigned_count": np.zeros(size)}
        rows = np.zeros(size, np.int64)
    return {"track": numbers[side], "rows": rows, **parts}


def _assigned(states: States, weights: Ints) -> Ints:
    """How much of each estimate is assigned where it is judged, as `halves` has it."""
    used, entry, _ = assigned(states, weights)
    excused = states.problem.sides[1].unjudged
    if excused is not None:
        used = used[~excused[states.problem.estimate_row[entry]]]
    estimate = states.pair_estimate[states.pair[used]]
    return halves(weights[used], estimate, states.problem.estimates)


def _check_rows(states: States, weights: Ints) -> None:
    """Refuse what sums to more than 1 in a row, or is negative."""
    most = weights.max(initial=0)
    for part, own in row_parts(states):
        most = max(most, part.rows.sums(weights[own]).max(initial=0))
    if most > ONE or weights.min(initial=0) < 0:
        raise no_assignment()


def _bound(
    states: States, running: tuple[Floats, Ints], places: int
) -> tuple[list[float], Ints, Ints]:
    """Terms of the lower bound, pairs put aside whose truths and whose estimates are judged.

    And what these leave of each place.
    """
    left = np.ones(places, np.int32)
    terms: list[float] = []
    pairs = np.zeros(2, np.int64)
    for part, _ in row_parts(states):
        best, aside, _, entry = row_terms(part, running, left)
        terms += (-best).tolist()
        terms += aside.tolist()
        for number, side in enumerate(states.problem.sides):
            free = 0 if side.unjudged is None else np.count_nonzero(side.unjudged[side.row[entry]])
            pairs[number] += len(entry) - free
    return terms, pairs, left


def _intervals(states: States, weights: Ints, first: int, numbers: tuple[Ints, Ints]) -> Table:
    """What is assigned, by (truth, estimate, begin); neighbours of one weight are one."""
    opens = changed(states.pair_first, weights)
    opens[states.pair_first[:-1]] = True
    start = np.flatnonzero(opens)
    stop = np.append(start[1:], len(weights)) - 1
    used = weights[start] > 0
    start, stop = start[used], stop[used]
    pair = states.pair[start]
    found = np.zeros(len(start), HELD)
    found["truth"] = numbers[0][states.pair_truth[pair]]
    found["estimate"] = numbers[1][states.pair_estimate[pair]]
    found["begin"], found["end"] = states.begin[start] + first, states.end[stop] + first
    found["weight"] = weights[start]
    return found


def _regrets(states: States, weights: Ints, running: tuple[Floats, Ints], first: int) -> Floats:
    """Rows that could do better at these prices: by how much, and their first and last step."""
    value = states.gain - states.columns.spans(running)
    used = np.flatnonzero(weights)
    row = states.pair_row[states.pair]
    own = sum_by(row[used], weights[used] / ONE * value[used], states.nodes)
    moved = np.flatnonzero(changed(states.pair_first, weights))
    amount = np.abs(weights[moved] - weights[moved - 1]) / ONE
    own -= states.problem.switch_price_at[1] * sum_by(row[moved], amount, states.nodes)
    regret = np.zeros(states.nodes)
    for part, _ in row_parts(states):
        regret += best_values(part, value[_])
    regret -= own
    gains = np.flatnonzero(states.entry >= 0)
    begin = np.full(states.nodes, states.problem.steps)
    end = np.zeros(states.nodes, np.int64)
    np.minimum.at(begin, row[gains], states.begin[gains])
    np.maximum.at(end, row[gains], states.begin[gains])
    open_ = np.flatnonzero(regret[: states.problem.truths] > REGRET)
    return np.stack((regret[open_], begin[open_] + first, end[open_] + first))
