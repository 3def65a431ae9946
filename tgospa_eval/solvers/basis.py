"""Where the simplex method starts: a basis that fits the prices.

A starting basis marks columns and constraints as basic. It may be too large, too small or singular:
whoever factors it leaves columns out and puts slacks in. It only decides how many iterations
follow.
"""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem.compiled import kernels
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.solvers.programme import Programme

Marks = NDArray[np.bool_]

LEAST_STATES = 300
"""Free states from which on a starting basis saves time: fewer take a few milliseconds without."""

BASIC = 1e-10
"""Reduced costs and duals that are smaller count as zero."""


def suggest(p: Programme) -> tuple[Marks, Marks] | None:
    """Basic columns and constraints by complementary slackness at the prices; None: too small.

    Prices alone leave the duals of rows and transitions open. Those of the shortest path problem
    of each row are potentials, best values of paths that end in each state: see `_potentials`.
    What has a reduced cost or a dual of about zero then is basic.
    """
    if not kernels or len(p.free) < LEAST_STATES:
        return None
    dual = _potentials(p)
    rows = dual <= BASIC
    rows[p.constraints[1]] = True
    return np.abs(p.reduced(-dual)) <= BASIC, rows


def _potentials(p: Programme) -> Floats:
    """Duals >= 0 of all constraints that fit the prices.

    Along each row in time: h, the best value of a path that is in no state; F_s, that of a path
    through state s to its end, F_s = (F or h before) + gain - prices; h rises to F_s - lambda. The
    dual of a constraint is the rise of h over it, and that of a transition with the price lambda is
    lambda - f, with f = F_s - h cut to [-lambda, lambda], the relative value of s at that time.
    """
    size, moves = len(p.free), p.moves
    source, to, paid = moves.source[moves.two], moves.to[moves.two], moves.paid[moves.two]
    value = p.reward[:size].copy()
    value[to] -= paid
    value[source] += paid
    np.subtract.at(value, p.columns.state, p.columns.price[p.columns.constraint])
    leave = np.zeros(size)
    leave[source] = paid
    follows = np.zeros(size, np.uint8)
    follows[to] = True

    low, high, row, first = _spans(p)
    none, through = kernels.row_potentials(
        np.argsort(high, kind="stable").astype(np.int32),
        row.astype(np.int32),
        first.astype(np.int32),
        low.astype(np.int32),
        high.astype(np.int32),
        value,
        leave,
        follows,
    )
    inner = np.ones(len(none), bool)
    inner[first[1:] - 1] = False
    dual = np.empty(len(p.full))
    rows, columns, transitions = p.constraints
    dual[rows] = np.diff(none, append=0.0)[inner]
    dual[columns] = p.columns.price
    dual[transitions] = moves.paid
    dual[transitions][moves.two] -= through[source]
    return np.maximum(dual, 0.0)


def _spans(p: Programme) -> tuple[Ints, Ints, Ints, Ints]:
    """Borders of constraints around each free state, its row, first border of each and their end.

    Each row has a border before its first constraint and one after each; borders are numbered row
    by row. A state without a constraint lies where the one before it of its pair ends.
    """
    states, size = p.states, len(p.free)
    pair = np.searchsorted(states.pair_first, p.free, side="right") - 1
    used, row = np.unique(states.pair_row[pair], return_inverse=True)
    row_of = np.zeros(len(p.rows.room), np.intp)
    row_of[p.rows.constraint] = row[p.rows.state]
    base = np.searchsorted(row_of, np.arange(len(used))) + np.arange(len(used))
    first = np.flatnonzero(np.diff(p.rows.state, prepend=-1))
    last = np.append(first[1:], len(p.rows.state)) - 1
    low, high = np.full(size, -1), np.full(size, -1)
    has = p.rows.state[first]
    low[has] = p.rows.constraint[first] + row[has]
    high[has] = p.rows.constraint[last] + 1 + row[has]
    known = low >= 0
    opens = known | (np.diff(pair, prepend=-1) != 0)
    before = np.maximum.accumulate(np.where(opens, np.arange(size), 0))
    border = np.where(known[before], high[before], base[row])
    return (
        np.where(known, low, border),
        np.where(known, high, border),
        row,
        np.append(base, len(row_of) + len(used)),
    )
