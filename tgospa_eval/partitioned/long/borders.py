"""What it is worth to enter a window, or to leave it, with a pair: best paths outside of it.

A window by itself is entered and left for free with any pair. Where more is known, the best paths
of the rows before and after it, at the prices at hand, say what each pair is worth at its borders
beside "none"; with these its prices and weights fit to those outside.
"""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.partitioned.long.columns import load_columns
from tgospa_eval.partitioned.long.rows import load_rows
from tgospa_eval.partitioned.long.tables import (
    WindowPiece,
    renumbered,
)
from tgospa_eval.partitioned.shards import ENTRY, Table, load_part, problem_of, save_parts
from tgospa_eval.partitioned.tasks import writing_folder
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.paths import row_steps, turns
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.rows import PricedPlaces, rows_of_component, running_of
from tgospa_eval.problem.states import States

BORDER = np.dtype(
    [
        ("truth", "<i4"),
        ("estimate", "<i4"),
        ("before", "<f8"),
        ("after", "<f8"),
        ("held_before", "<i8"),
        ("held_after", "<i8"),
    ]
)
"""A pair, what it is worth at the borders of a window, and its weight just outside of them."""

ENTERED_THERE = 1 - 1e-9
"""Pairs worth less than minus this switch price are as good as entered, or left, at the border."""


def value_borders(
    output: str,
    *,
    rows: str,
    pieces: tuple[WindowPiece, ...],
    number: int,
    columns: tuple[str, ...],
    window: tuple[int, int],
    parameters: Parameters,
    around: tuple[tuple[int, int], ...],
) -> None:
    """Write what the pairs of some truths are worth: a table of BORDER for each of some windows.

    Parameters
    ----------
    output : str
        The folder that is written.
    rows : str
        What `prove_rows` wrote of these truths.
    pieces, number, columns, window, parameters
        As of `prove_rows`.
    around : tuple of pairs of int
        The steps of each window: from, and to before.
    """
    first, last = window
    problem, _, numbers = load_rows(pieces, number, window, parameters)
    places, _, _ = load_columns(columns, numbers[1], first)
    states = rows_of_component(problem, places)
    values = _Values(states, places)
    held = renumbered(np.load(Path(rows) / "by_estimate.npy"), numbers)
    width = np.int64(states.problem.estimates)
    known = states.pair_truth * width + states.pair_estimate
    whose = np.searchsorted(known, held["truth"] * width + held["estimate"])
    of_entry = np.empty(len(problem.cost), np.int32)
    gains = np.flatnonzero(states.entry >= 0)
    of_entry[states.entry[gains]] = states.pair[gains]
    step = problem.entry_step
    tables = [np.zeros(0, BORDER)]
    for low, high in around:
        a, b = np.searchsorted(step, (low - first, high - first))
        near = (held["begin"] <= high) & (held["end"] >= low - 1)
        pair = np.union1d(of_entry[a:b], whose[near])
        table = np.zeros(len(pair), BORDER)
        table["truth"] = numbers[0][states.pair_truth[pair]]
        table["estimate"] = numbers[1][states.pair_estimate[pair]]
        if low > first:
            table["before"] = values.before(pair, low - first)
            table["held_before"] = _weights(held[near], whose[near], pair, low - 1)
        if high <= last:
            table["after"] = values.after(pair, high - first)
            table["held_after"] = _weights(held[near], whose[near], pair, high)
        tables.append(table)
    part = np.repeat(np.arange(len(around)), [len(table) for table in tables[1:]])
    with writing_folder(output) as folder:
        save_parts(folder, "borders", np.concatenate(tables), part, len(around))


def _weights(held: Table, whose: Ints, pair: Ints, step: int) -> Ints:
    """What is held of pairs, sorted, at a step."""
    there = (held["begin"] <= step) & (held["end"] >= step)
    weights = np.zeros(len(pair), np.int64)
    weights[np.searchsorted(pair, whose[there])] = held["weight"][there]
    return weights


class _Values:
    """Best values of rows up to each state, and from each on."""

    def __init__(self, states: States, places: PricedPlaces) -> None:
        columns = states.columns
        self.states, self.steps = states, row_steps(states)
        self.value = states.gain - columns.spans(running_of(places, states.problem.truths))
        price = places.whole * np.repeat(places.unit, np.diff(places.first))
        self.running = np.concatenate(([0.0], np.cumsum(price)))
        self.switch = float(np.max(states.problem.switch_price))
        size, groups = len(states.begin), len(self.steps.step)
        self.entered, self.reached, self.onward = np.zeros((3, size))
        self.none_before, self.none_after = np.zeros((2, groups))
        self._forward()
        self._backward()
        every = np.int64(states.problem.steps + 1)
        node = np.repeat(np.arange(states.nodes), np.diff(columns.first))
        self.place_key = node * every + columns.step
        self.state_key = states.pair * every + states.begin
        row = np.repeat(np.arange(states.nodes), np.diff(self.steps.first))
        self.group_key = row * every + self.steps.step
        self.every = every

    def _forward(self) -> None:
        turn = turns(self.states, self.steps)
        none, current = np.zeros(self.states.nodes), np.zeros(len(self.states.pair_row))
        group = self.steps.begin[turn.order]
        for low, high in itertools.pairwise(turn.bounds):
            pair, row, order = turn.pair[low:high], turn.row[low:high], turn.order[low:high]
            before = current[pair]
            np.maximum.at(none, row, before - self.switch)
            self.entered[order] = entered = np.maximum(before, none[row] - self.switch)
            self.reached[order] = current[pair] = entered + self.value[order]
            self.none_before[group[low:high]] = none[row]

    def _backward(self) -> None:
        turn = turns(self.states, self.steps)
        none = np.zeros(self.states.nodes)
        group = self.steps.begin
        final = np.zeros(len(group), bool)
        final[self.states.pair_first[1:] - 1] = True
        for low, high in reversed(list(itertools.pairwise(turn.bounds))):
            row, order = turn.row[low:high], turn.order[low:high]
            following = np.where(final[order], order, order + 1)
            left = self.none_after[group[following]] - self.switch
            goes_on = np.where(final[order], 0.0, np.maximum(self.onward[following], left))
            self.onward[order] = onward = self.value[order] + goes_on
            np.maximum.at(none, row, onward - self.switch)
            self.none_after[group[order]] = none[row]

    def before(self, pair: Ints, step: int) -> Floats:
        """What being in pairs is worth beside "none", when a step begins."""
        state = np.searchsorted(self.state_key, pair * self.every + step) - 1
        run = self.states.entry[state] < 0
        value = np.where(run, self.entered[state] - self._paid(state, step), self.reached[state])
        row = self.states.pair_row[pair] * self.every
        group = np.searchsorted(self.group_key, row + step, side="right") - 1
        return self._worth(value - self.none_before[group])

    def after(self, pair: Ints, step: int) -> Floats:
        """What going on in pairs is worth beside "none", from a step on."""
        state = np.searchsorted(self.state_key, pair * self.every + step, side="right") - 1
        value = self.onward[state] + self._paid(state, step)
        row = self.states.pair_row[pair]
        group = np.searchsorted(self.group_key, row * self.every + step)
        there = group < self.steps.first[row + 1]
        none = np.where(there, self.none_after[np.where(there, group, 0)], 0.0)
        return self._worth(value - none)

    def _worth(self, value: Floats) -> Floats:
        """Pairs that are as good as entered at the border are entered later: ties make work."""
        return np.where(value <= -ENTERED_THERE * self.switch, -2.0 * self.switch, value)

    def _paid(self, state: Ints, step: int) -> Floats:
        """What states pay from their first step to before a step."""
        columns = self.states.columns
        node = columns.pair_node[self.states.pair[state]]
        low = columns.begin[state]
        high = np.searchsorted(self.place_key, node * self.every + step)
        return self.running[high] - self.running[low]


def frame(
    entry: Table, before: Table, after: Table, around: tuple[int, int], parameters: Parameters
) -> tuple[Problem, int, tuple[Ints, Ints]]:
    """A window as a problem, with a step before it and one after it where there is more.

    Its gains may be negative at these steps.

    Parameters
    ----------
    entry : table of ENTRY
        Of the window.
    before, after : table of BORDER
        What pairs are worth at the borders; none at an end of the component.
    around : pair of int
        Its steps: from, and to before.
    parameters : Parameters
        Of the metric.

    Returns
    -------
    problem : Problem
        Entries of the window lie between those of its borders.
    first : int
        Its first step.
    numbers : pair of int arrays
        Its truths and estimates.
    """
    first, last = around[0] - (len(before) > 0), around[1] - 1 + (len(after) > 0)
    joined = np.concatenate((_at(before, around[0] - 1), entry, _at(after, around[1])))
    numbers = np.unique(joined["truth"]), np.unique(joined["estimate"])
    problem = problem_of(joined, first, numbers, parameters)
    price = sum(parameters.unassigned_prices)
    inside = problem.cost[len(before) : len(before) + len(entry)]
    cost = np.concatenate((price - before["before"], inside, price - after["after"]))
    return replace(problem, steps=last - first + 1, cost=cost, signed=True), first, numbers


def _at(borders: Table, step: int) -> Table:
    entry = np.zeros(len(borders), ENTRY)
    entry["step"] = step
    entry["truth"], entry["estimate"] = borders["truth"], borders["estimate"]
    return entry


def load_borders(folders: tuple[str, ...], number: int) -> Table:
    """Of one window, from all truths, by (truth, estimate)."""
    found = [load_part(Path(folder), "borders", number) for folder in folders]
    borders = np.concatenate([np.zeros(0, BORDER), *found])
    return borders[np.lexsort((borders["estimate"], borders["truth"]))]
