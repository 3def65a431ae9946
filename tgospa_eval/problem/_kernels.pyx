# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
# cython: initializedcheck=False, embedsignature=True
"""Loops that NumPy cannot do without large temporaries; each names its NumPy twin.

All arrays are contiguous; indices are 32-bit. Everything runs without the interpreter lock, and
never on the same rows in two threads, so that many threads give the bytes of one.
"""

import numpy as np

from libc.math cimport INFINITY, exp, fabs, floor, fmax, fmin, hypot, log, nextafter, rint, sqrt
from libc.stdint cimport int64_t, uint64_t
from libc.string cimport memcpy, memset

from tgospa_eval.errors import check_size
from tgospa_eval.problem.problem import REGRET as SUM_ERROR

ctypedef int i32
ctypedef unsigned char u8

ctypedef fused Weight:
    double
    u8

cdef double NOTHING = -1e300
cdef double NEVER = 1e300


cdef object full_of(Py_ssize_t size, value, kind=np.int32):
    """As np.full, which takes as long as many of the loops here."""
    array = np.empty(size, kind)
    array.fill(value)
    return array


# --- sums in NumPy's order ---------------------------------------------------------------------


cdef double pairwise(const double* value, Py_ssize_t size) noexcept nogil:
    """Sum by halves, down to eight sums side by side, as NumPy's: its rounding hardly grows."""
    cdef double part[8]
    cdef double total = 0.0
    cdef Py_ssize_t i, half, whole = size - size % 8
    if size > 128:
        half = size // 2
        half -= half % 8
        return pairwise(value, half) + pairwise(value + half, size - half)
    if whole:
        for i in range(8):
            part[i] = value[i]
        for i in range(8, whole):
            part[i % 8] += value[i]
        total = (((part[0] + part[1]) + (part[2] + part[3]))
                 + ((part[4] + part[5]) + (part[6] + part[7])))
    for i in range(whole, size):
        total += value[i]
    return total


# --- merging of runs: the twins are in problem.merging and problem.slots -------------------------


cdef void sort_by(const i32[::1] key, i32[::1] at, i32[::1] order) noexcept nogil:
    """Positions by (key, position): a counting sort.

    `at` comes as zeros, one more than there are keys, and becomes the end of each key in `order`.
    """
    cdef Py_ssize_t n
    for n in range(key.shape[0]):
        at[key[n] + 1] += 1
    for n in range(at.shape[0] - 1):
        at[n + 1] += at[n]
    for n in range(key.shape[0]):
        order[at[key[n]]] = <i32>n
        at[key[n]] += 1


def number_pairs(const i32[::1] truth, const i32[::1] estimate, int truths, int estimates):
    """Pair of each entry, and truth and estimate of each pair, in order of truth and appearance.

    The entries of one truth are visited together, so that a stamp for each estimate is enough.
    """
    cdef Py_ssize_t N = truth.shape[0], e, a
    cdef i32 j, pairs = 0
    cdef i32[::1] at = np.zeros(truths + 1, np.int32)
    cdef i32[::1] order = np.empty(N, np.int32)
    cdef i32[::1] pair_of = np.empty(N, np.int32)
    cdef i32[::1] stamp = full_of(max(estimates, 1), -1)
    cdef i32[::1] number = np.empty(max(estimates, 1), np.int32)
    with nogil:
        sort_by(truth, at, order)
        for a in range(N):
            e = order[a]
            j = estimate[e]
            if stamp[j] != truth[e]:
                stamp[j] = truth[e]
                number[j] = pairs
                pairs += 1
            pair_of[e] = number[j]
    pair_truth = np.empty(pairs, np.int32)
    pair_estimate = np.empty(pairs, np.int32)
    cdef i32[::1] pt = pair_truth, pe = pair_estimate
    with nogil:
        for e in range(N):
            pt[pair_of[e]] = truth[e]
            pe[pair_of[e]] = estimate[e]
    return np.asarray(pair_of), pair_truth, pair_estimate


def components(const i32[::1] a, const i32[::1] b, int nodes):
    """Smallest node of the component of each node: union and find with halving."""
    root_array = np.arange(nodes, dtype=np.int32)
    cdef i32[::1] root = root_array
    cdef Py_ssize_t e
    cdef i32 x, y
    with nogil:
        for e in range(a.shape[0]):
            x, y = a[e], b[e]
            while root[x] != x:
                root[x] = root[root[x]]
                x = root[x]
            while root[y] != y:
                root[y] = root[root[y]]
                y = root[y]
            if x < y:
                root[y] = x
            elif y < x:
                root[x] = y
        for x in range(nodes):
            root[x] = root[root[x]]
    return root_array


def merge_pairs(const i32[::1] truth, const i32[::1] estimate, const i32[::1] step, int truths,
                int estimates, bint transpose):
    """Pairs, nodes and blocks from the truth, the estimate and the step of each entry, in time.

    The pair of each entry, then the fields of `problem.merging.PairGraph`, in their order;
    `transpose` is that of `merge_runs`.
    """
    pair_of, tracks, others = number_pairs(truth, estimate, truths, estimates)
    cdef const i32[::1] root = components(tracks, others + np.int32(truths), truths + estimates)
    cdef i32[::1] of_entry = pair_of
    cdef const i32[::1] pt = tracks, pe = others
    cdef Py_ssize_t P = pt.shape[0], p, i, e, nodes = truths + estimates, count = 0
    cdef i32 b, blocks = 0, total = 0
    cdef bint is_row
    cdef i32[::1] number = full_of(nodes, -1)    # of the block with this root
    cdef i32[::1] block_of = full_of(nodes, -1)  # of each track
    with nogil:
        for p in range(P):  # by truth: the root of a block is the first that is met
            if number[root[pt[p]]] < 0:
                number[root[pt[p]]] = blocks
                blocks += 1
            block_of[pt[p]] = block_of[truths + pe[p]] = number[root[pt[p]]]
        for i in range(nodes):
            count += block_of[i] >= 0
    transposed = np.zeros(blocks, bool)
    node_block = np.empty(count, np.int32)
    window = np.zeros((2, blocks), np.int32)
    row, column, block = np.empty(P, np.int32), np.empty(P, np.int32), np.empty(P, np.int32)
    pair_truth, pair_estimate = np.empty(P, np.int32), np.empty(P, np.int32)
    cdef u8[::1] flip = transposed.view(np.uint8)
    cdef i32[::1] node_blocks = node_block, rows = row, columns = column, own_block = block
    cdef i32[::1] own_truth = pair_truth, own_estimate = pair_estimate
    cdef i32[:, ::1] ends = window, side = np.zeros((2, blocks), np.int32)
    cdef i32[::1] key = np.empty(P, np.int32), by_column = np.empty(P, np.int32)
    cdef i32[::1] order = np.empty(P, np.int32), rank = np.empty(P, np.int32)
    cdef i32[::1] first = np.zeros(count + 1, np.int32), next = np.zeros(count + 1, np.int32)
    with nogil:
        for i in range(nodes):
            if block_of[i] >= 0:
                side[i >= truths, block_of[i]] += 1
        for b in range(blocks):  # rows are truths, unless there is a single estimate for several
            flip[b] = transpose and side[1, b] == 1 and side[0, b] > 1
            i = side[0, b] + side[1, b]
            side[1, b] = total + (1 if flip[b] else side[0, b])
            side[0, b] = total
            total += <i32>i
        for i in range(nodes):
            b = block_of[i]
            if b >= 0:
                is_row = (i < truths) != flip[b]
                number[i] = side[not is_row, b]
                side[not is_row, b] += 1
                node_blocks[number[i]] = b
        for p in range(P):
            b = block_of[pt[p]]
            key[p] = number[pt[p]] if flip[b] else number[truths + pe[p]]
        sort_by(key, first, by_column)
        for p in range(P):
            i = by_column[p]
            b = block_of[pt[i]]
            key[p] = number[truths + pe[i]] if flip[b] else number[pt[i]]
        sort_by(key, next, order)
        for p in range(P):
            i = by_column[order[p]]
            b = own_block[p] = block_of[pt[i]]
            own_truth[p], own_estimate[p], rank[i] = pt[i], pe[i], <i32>p
            rows[p] = number[truths + pe[i]] if flip[b] else number[pt[i]]
            columns[p] = number[pt[i]] if flip[b] else number[truths + pe[i]]
        for e in range(of_entry.shape[0] - 1, -1, -1):
            of_entry[e] = rank[of_entry[e]]
            ends[0, own_block[of_entry[e]]] = step[e]
        for e in range(of_entry.shape[0]):
            ends[1, own_block[of_entry[e]]] = step[e]
    return (pair_of, row, column, block, pair_truth, pair_estimate, node_block, window[0],
            window[1], transposed)


def split(const i32[::1] pair_of, const i32[::1] step, const i32[::1] first, const i32[::1] last,
          bint single):
    """States of every pair in order of time: `pair_first`, `begin`, `entry` (-1 for a run).

    `first`, `last` (P,): the window of each pair. With `single` a run is one state for each step.
    Entries come in order of time.
    """
    cdef Py_ssize_t N = pair_of.shape[0], a, P = first.shape[0], p, n = 0
    cdef i32 k, next_step
    cdef i32[::1] at = np.zeros(P + 1, np.int32)
    cdef i32[::1] order = np.empty(N, np.int32)
    pair_first = np.zeros(P + 1, np.int32)
    cdef i32[::1] pf = pair_first
    with nogil:
        sort_by(pair_of, at, order)
        a = 0
        for p in range(P):
            next_step = first[p]
            while a < at[p]:
                k = step[order[a]]
                if k > next_step:
                    n += k - next_step if single else 1
                n += 1
                next_step = k + 1
                a += 1
            if next_step <= last[p]:
                n += last[p] - next_step + 1 if single else 1
            pf[p + 1] = <i32>n
    check_size("states", n)
    begin = np.empty(n, np.int32)
    entry = np.empty(n, np.int32)
    cdef i32[::1] begins = begin, entries = entry
    with nogil:
        n = 0
        a = 0
        for p in range(P):
            next_step = first[p]
            while True:
                k = step[order[a]] if a < at[p] else last[p] + 1
                if k > next_step:
                    begins[n], entries[n] = next_step, -1
                    n += 1
                    if single:
                        for next_step in range(next_step + 1, k):
                            begins[n], entries[n] = next_step, -1
                            n += 1
                if a == at[p]:
                    break
                begins[n], entries[n] = k, order[a]
                n += 1
                a += 1
                next_step = k + 1
    return pair_first, begin, entry


def in_time(const i32[::1] begin, int steps):
    """The states by (begin, number): a stable counting sort."""
    order = np.empty(begin.shape[0], np.int32)
    cdef i32[::1] out = order
    cdef i32[::1] at = np.zeros(steps + 1, np.int32)
    with nogil:
        sort_by(begin, at, out)
    return order


def slots(const i32[::1] order, const i32[::1] begin, const i32[::1] pair_first,
          const i32[::1] pair_node, const u8[::1] shared):
    """Slots of the shared nodes: first slot of each node, step of each, and of each state its first.

    `order` has the states in time. States of nodes that are not shared get the (empty) place of
    their node.
    """
    cdef Py_ssize_t S = begin.shape[0], P = pair_node.shape[0], nodes = shared.shape[0], s, p, a
    cdef i32 node
    cdef i32[::1] node_of = np.empty(S, np.int32)
    cdef i32[::1] latest = full_of(nodes, -1)
    node_first = np.zeros(nodes + 1, np.int32)
    cdef i32[::1] first = node_first
    slot_begin = np.empty(S, np.int32)
    cdef i32[::1] begins = slot_begin
    with nogil:
        for p in range(P):
            for s in range(pair_first[p], pair_first[p + 1]):
                node_of[s] = pair_node[p]
        for a in range(S):
            s = order[a]
            node = node_of[s]
            if shared[node] and latest[node] != begin[s]:
                latest[node] = begin[s]
                first[node + 1] += 1
        for node in range(nodes):
            first[node + 1] += first[node]
            latest[node] = -1
    step = np.empty(first[nodes], np.int32)
    cdef i32[::1] steps = step
    cdef i32[::1] filled = node_first.copy()
    with nogil:
        for a in range(S):
            s = order[a]
            node = node_of[s]
            if not shared[node]:
                begins[s] = first[node]
                continue
            if latest[node] != begin[s]:
                latest[node] = begin[s]
                steps[filled[node]] = begin[s]
                filled[node] += 1
            begins[s] = filled[node] - 1
    return node_first, step, slot_begin


def by_row(const i32[::1] order, const i32[::1] pair_first, const i32[::1] pair_row, int nodes):
    """The states by (row, begin, number), and the place of the first of each node, (nodes + 1,)."""
    cdef Py_ssize_t S = order.shape[0], P = pair_row.shape[0], s, p, a
    cdef i32 node
    row_first = np.zeros(nodes + 1, np.int32)
    cdef i32[::1] first = row_first
    cdef i32[::1] row_of = np.empty(S, np.int32)
    ordered = np.empty(S, np.int32)
    cdef i32[::1] out = ordered
    with nogil:
        for p in range(P):
            first[pair_row[p] + 1] += pair_first[p + 1] - pair_first[p]
            for s in range(pair_first[p], pair_first[p + 1]):
                row_of[s] = pair_row[p]
        for node in range(nodes):
            first[node + 1] += first[node]
    cdef i32[::1] at = row_first.copy()
    with nogil:
        for a in range(S):
            s = order[a]
            out[at[row_of[s]]] = <i32>s
            at[row_of[s]] += 1
    return ordered, row_first


# --- exact sums over slots: the twins are in problem.slots, with the same bits -------------------
#
# Sums over all slots may overflow, differences of them do not: they are computed without sign.


def slot_sums(const i32[::1] first, const i32[::1] begin, const i32[::1] pair_first,
              const i32[::1] pair_node, const int64_t[::1] weight):
    """Sum of the integer weights (S,) of the states over each slot, (K,): `Slots.sums`."""
    cdef Py_ssize_t K = first[first.shape[0] - 1], p, s, t
    cdef int64_t held
    change = np.zeros(K + 1, np.int64)
    cdef uint64_t[::1] total = change.view(np.uint64)
    with nogil:
        for p in range(pair_node.shape[0]):
            held = 0
            for s in range(pair_first[p], pair_first[p + 1]):
                if weight[s] != held:
                    total[begin[s]] += <uint64_t>weight[s] - <uint64_t>held
                    held = weight[s]
            total[first[pair_node[p] + 1]] -= <uint64_t>held
        for t in range(1, K):
            total[t] += total[t - 1]
    return change[:-1]


def slot_loads(const i32[::1] first, const i32[::1] begin, const i32[::1] pair_first,
               const i32[::1] pair_node, const double[::1] weight):
    """Sum of the weights (S,) of the states over each slot, (K,): `Slots.loads`."""
    cdef Py_ssize_t p, s, t
    cdef i32 node
    cdef double held
    change = np.zeros(first[first.shape[0] - 1])
    cdef double[::1] total = change
    with nogil:
        for p in range(pair_node.shape[0]):
            node = pair_node[p]
            if first[node] == first[node + 1]:
                continue
            held = 0.0
            for s in range(pair_first[p], pair_first[p + 1]):
                if weight[s] != held:
                    total[begin[s]] += weight[s] - held
                    held = weight[s]
        for node in range(first.shape[0] - 1):
            for t in range(first[node] + 1, first[node + 1]):
                total[t] += total[t - 1]
    return change


def whole_sums(const double[::1] value, const i32[::1] first, const double[::1] unit, bint down):
    """Sums of ``value / unit`` before each slot (K + 1,), rounded first: `exact_running`."""
    cdef Py_ssize_t i, t
    cdef double whole
    sums = np.zeros(value.shape[0] + 1, np.int64)
    cdef uint64_t[::1] total = sums.view(np.uint64)
    with nogil:
        for i in range(unit.shape[0]):
            for t in range(first[i], first[i + 1]):
                whole = value[t] / unit[i]
                whole = floor(whole) if down else rint(whole)
                total[t + 1] = total[t] + <uint64_t><int64_t>whole
    return sums


def spans(const i32[::1] first, const i32[::1] begin, const i32[::1] pair_first,
          const i32[::1] pair_node, const double[::1] unit, const int64_t[::1] sums, bint down):
    """Sum over the slots of each state, (S,), from the sums before each: `Slots.spans`."""
    cdef Py_ssize_t p, s
    cdef uint64_t before, after
    found = np.empty(begin.shape[0])
    cdef double[::1] total = found
    with nogil:
        for p in range(pair_node.shape[0]):
            after = <uint64_t>sums[first[pair_node[p] + 1]]
            for s in range(pair_first[p + 1] - 1, pair_first[p] - 1, -1):
                before = <uint64_t>sums[begin[s]]
                total[s] = unit[pair_node[p]] * <double><int64_t>(after - before)
                if down:
                    total[s] = nextafter(total[s], 0.0)
                after = before
    return found


# --- gains relative to the cheapest pair: the twin is problem.paths.relative_gains --------------


cdef inline void add_to(double* total, double* rest, double part) noexcept nogil:
    """Add to a sum of two doubles: what `total` loses by rounding goes to `rest` (Knuth)."""
    cdef double new = total[0] + part
    cdef double got = new - total[0]
    rest[0] += (total[0] - (new - got)) + (part - got)
    total[0] = new


def relative_gains(const i32[::1] row_first, const i32[::1] order, const i32[::1] begin,
                   const i32[::1] entry, const double[::1] cost, double price,
                   const double[::1] prices=None):
    """``G - r = (D_best - D) + (A + B) - (A + B)_best``, and ``r = (A + B - D)_best`` of each group.

    A *group* are the states of a row that begin together, "best" the cheapest pair of it: sums of
    gains near 1 lose the digits that differences of costs keep. A run loses the r while it lasts,
    and so does "none", in `row_forward`.

    Parameters
    ----------
    price : float
        Cost of leaving both objects of an entry unassigned, where that is the same for all.
    prices : (N,) float array, optional
        The same for each entry.

    Returns
    -------
    gain : (S,) float array
    group_first : (nodes + 1,) int array
        The first group of each row.
    offset : (G,) float array
        What was taken off in each group.
    """
    cdef Py_ssize_t S = order.shape[0], nodes = row_first.shape[0] - 1, i, a, c, low, high, width
    cdef i32 s, k, g, total = 0
    cdef double least, least_price, running, rest
    cdef bint vary = prices is not None
    group_first_array = np.zeros(nodes + 1, np.int32)
    cdef i32[::1] group_first = group_first_array
    with nogil:
        width = 0
        for i in range(nodes):
            low, high = row_first[i], row_first[i + 1]
            if high - low > width:
                width = high - low
            for a in range(low, high):
                if a == low or begin[order[a]] != begin[order[a - 1]]:
                    total += 1
            group_first[i + 1] = total
    gain_array, offset_array = np.empty(S), np.zeros(total)
    cdef double[::1] gain = gain_array, offset = offset_array
    # What was taken off before the group of a state, in two parts.
    cdef double[::1] before = np.empty(width + 1), lost = np.empty(width + 1)
    cdef i32[::1] group = np.empty(width + 1, np.int32)
    with nogil:
        for i in range(nodes):
            low, high = row_first[i], row_first[i + 1]
            g = group_first[i]
            running = rest = 0.0
            a = low
            while a < high:
                k = begin[order[a]]
                c = a
                least = NEVER
                while c < high and begin[order[c]] == k:
                    s = order[c]
                    before[s - low], lost[s - low], group[s - low] = running, rest, g
                    if entry[s] >= 0 and cost[entry[s]] < least:
                        least = cost[entry[s]]
                        least_price = prices[entry[s]] if vary else price
                    if k > begin[low] and entry[s - 1] < 0:
                        gain[s - 1] = (-offset[g - 1] if group[s - 1 - low] == g - 1
                                       else (before[s - 1 - low] - running)
                                       + (lost[s - 1 - low] - rest))
                    c += 1
                if least < NEVER:
                    offset[g] = least_price - least
                while a < c:
                    s = order[a]
                    if entry[s] >= 0:
                        gain[s] = least - cost[entry[s]]
                        if vary:
                            gain[s] += prices[entry[s]] - least_price
                    a += 1
                add_to(&running, &rest, offset[g])
                g += 1
            for s in range(<i32>low, <i32>high):
                if (s + 1 == high or begin[s + 1] == begin[low]) and entry[s] < 0:
                    gain[s] = (-offset[g - 1] if group[s - low] == g - 1
                               else (before[s - low] - running) + (lost[s - low] - rest))
    return gain_array, group_first_array, offset_array


# --- best paths: the twin is problem.paths.best_values ------------------------------------------


cdef class Layout:
    """The states of some blocks by row and time, their relative gains, and their column slots.

    Parameters
    ----------
    states : States
        The blocks.
    switch_price : (T + 1,) float array
        As `Problem.switch_price_at`, perhaps cut.
    price : float
    prices : (N,) float array, optional
        As in `relative_gains`.

    Attributes
    ----------
    row_first, order, begin : arrays
        From `by_row`, and the first step of each state.
    gain, group_first, offset : arrays
        From `relative_gains`.
    rows, columns : (R,), (C,) int arrays
        Nodes that take part: those of the open blocks; `keep` chooses them.
    """

    cdef readonly object gain, group_first, offset, rows, columns
    cdef const i32[::1] order, row_first, begin, entry, window_end, groups, row, column, block
    cdef const u8[::1] open
    cdef const i32[::1] column_first, slot_step, slot_begin, slot_end
    cdef const double[::1] switch_price, gains, offsets
    cdef Py_ssize_t longest, widest  # states of a row, and pairs of one, at most
    cdef double[::1] before, lost    # room for what is computed on the way, made once:
    cdef double[:, ::1] room         # small problems take no longer to solve than to make arrays
    cdef i32[::1] came

    def __init__(self, states, const double[::1] switch_price, double price,
                 const double[::1] prices=None):
        slots = states.columns
        self.switch_price = switch_price
        self.begin, self.entry = states.begin, states.entry
        self.window_end = states.block_end[states.node_block]
        self.column_first, self.slot_step = slots.first, slots.step
        self.slot_begin, self.slot_end = slots.begin, slots.end
        in_order = in_time(states.begin, switch_price.shape[0] - 1)
        self.order, self.row_first = by_row(in_order, states.pair_first, states.pair_row,
                                            states.nodes)
        self.gain, self.group_first, self.offset = relative_gains(
            self.row_first, self.order, self.begin, self.entry, states.problem.cost, price, prices)
        self.gains, self.groups, self.offsets = self.gain, self.group_first, self.offset
        self.block = states.node_block
        cdef Py_ssize_t i, longest = 0, slots_ = self.slot_step.shape[0] + 1
        for i in range(self.block.shape[0]):
            longest = max(longest, self.row_first[i + 1] - self.row_first[i])
        self.before, self.lost = np.empty((2, slots_))
        self.room, self.came = np.empty((5, longest + 1)), np.empty(longest + 1, np.int32)

    def keep(self, const u8[::1] blocks):
        """Go on with these blocks, (B,); their nodes without states of their own are columns."""
        cdef Py_ssize_t nodes = self.block.shape[0], i, a, low, rows = 0, columns = 0, pairs
        row_array, column_array = np.empty(nodes, np.int32), np.empty(nodes, np.int32)
        cdef i32[::1] row = row_array, column = column_array
        self.open, self.longest, self.widest = blocks, 0, 1
        with nogil:
            for i in range(nodes):
                if not blocks[self.block[i]]:
                    continue
                low = self.row_first[i]
                if self.row_first[i + 1] > low:
                    row[rows] = <i32>i
                    rows += 1
                    self.longest = max(self.longest, self.row_first[i + 1] - low)
                    pairs = 0
                    for a in range(low, self.row_first[i + 1]):
                        pairs += self.begin[a] == self.begin[low]
                    self.widest = max(self.widest, pairs)
                else:
                    column[columns] = <i32>i
                    columns += 1
        self.rows, self.columns = row_array[:rows], column_array[:columns]
        self.row, self.column = self.rows, self.columns


cdef struct Row:
    Py_ssize_t low, high         # its states
    const i32 *order             # these in time, and the first step of each
    const i32 *begin
    const double *switch_price
    const double *offset         # of its groups


cdef struct Paths:
    double* value                # all of one row: gains less prices,
    double* forward              # results of `row_forward` and `row_backward` for each state
    double* none
    double* rest
    double* slack
    i32* came


cdef inline Row row_of(Layout layout, i32 node) noexcept nogil:
    cdef Row row
    row.low, row.high = layout.row_first[node], layout.row_first[node + 1]
    row.order, row.begin = &layout.order[0], &layout.begin[0]
    row.switch_price, row.offset = &layout.switch_price[0], &layout.offsets[layout.groups[node]]
    return row


cdef inline Paths paths_in(Layout layout) noexcept nogil:
    cdef Paths paths
    cdef double* room = &layout.room[0, 0]
    cdef Py_ssize_t size = layout.room.shape[1]
    paths.value, paths.forward, paths.none = room, room + size, room + 2 * size
    paths.rest, paths.slack, paths.came = room + 3 * size, room + 4 * size, &layout.came[0]
    return paths


cdef double row_forward(Row row, Paths paths, i32* final) noexcept nogil:
    """Best value of a path up to each state of one row, and the state that it came from (or -1).

    ``h = max(h, F_t - lambda)`` over the states t that end, then ``F_s = max(F_before, h - lambda)
    + value_s``, and ``h = h - r``, see `problem.paths.best_values`. `forward` is F - h, and
    h = `none` + `rest` a sum of two doubles, so that no digits are lost to the length of a
    recording. Returns the value of the best path; its last state goes to `final`.
    """
    cdef Py_ssize_t low = row.low, high = row.high
    cdef const i32 *order = row.order, *begin = row.begin
    cdef const double *switch_price = row.switch_price, *offset = row.offset
    cdef double *value = paths.value, *forward = paths.forward
    cdef double *none = paths.none, *rest = paths.rest
    cdef i32* came = paths.came
    cdef Py_ssize_t a = low, c, g = 0
    cdef i32 s, k, unassigned_from = -1
    cdef double unassigned = 0.0, lost = 0.0, price, rise, best
    final[0] = -1
    if low == high:
        return 0.0
    k = begin[order[low]]
    while a < high and begin[order[a]] == k:
        s = order[a] - <i32>low
        forward[s] = value[s]
        none[s] = 0.0
        rest[s] = 0.0
        came[s] = -1
        a += 1
    while a < high:
        add_to(&unassigned, &lost, -offset[g])
        g += 1
        k = begin[order[a]]
        price = switch_price[k]
        c = a
        rise = 0.0
        while c < high and begin[order[c]] == k:
            s = order[c] - <i32>low
            forward[s] = forward[s - 1] - ((unassigned - none[s - 1]) + (lost - rest[s - 1]))
            if forward[s] - price > rise:
                rise = forward[s] - price
                unassigned_from = s - 1
            c += 1
        add_to(&unassigned, &lost, rise)
        while a < c:
            s = order[a] - <i32>low
            if forward[s] - rise >= -price:
                forward[s] = (forward[s] - rise) + value[s]
                came[s] = s - 1
            else:
                forward[s] = value[s] - price
                came[s] = unassigned_from
            none[s] = unassigned
            rest[s] = lost
            a += 1
    add_to(&unassigned, &lost, -offset[g])
    best = 0.0
    final[0] = unassigned_from
    k = begin[low]
    for s in range(<i32>(high - low)):
        if low + s + 1 == high or begin[low + s + 1] == k:
            price = forward[s] - ((unassigned - none[s]) + (lost - rest[s]))
            if price > best:
                best = price
                final[0] = s
    return unassigned + (lost + best)


cdef void row_regret(Row row, Paths paths, const double* weight, double* at) noexcept nogil:
    """Add what the assignment of one row loses against its best path to the steps where it does.

    The reduced costs, at the values of `row_forward`, of the transitions that the assignment uses:
    each is 0 or more, and their sum is the regret of the row. `weight` begins with the row, `at`
    with the first step.
    """
    cdef Py_ssize_t low = row.low, high = row.high
    cdef const i32 *order = row.order, *begin = row.begin
    cdef const double *switch_price = row.switch_price, *offset = row.offset
    cdef double *value = paths.value, *forward = paths.forward
    cdef double *none = paths.none, *rest = paths.rest
    cdef Py_ssize_t a = low, c, g = 0
    cdef i32 s, k, first = begin[order[low]]
    cdef double unassigned = 0.0, lost = 0.0, cover = 0.0, price, rise, stays, reached, best
    while a < high and begin[order[a]] == first:
        cover += weight[order[a] - low]
        a += 1
    while a < high:
        add_to(&unassigned, &lost, -offset[g])
        g += 1
        k = begin[order[a]]
        price = switch_price[k]
        s = order[a] - <i32>low
        rise = (none[s] - unassigned) + (rest[s] - lost)
        unassigned, lost = none[s], rest[s]
        at[k] += fmax(1.0 - cover, 0.0) * rise
        c = a
        while c < high and begin[order[c]] == k:
            s = order[c] - <i32>low
            reached = forward[s - 1] - ((unassigned - none[s - 1]) + (lost - rest[s - 1]))
            stays = weight[s] if weight[s] < weight[s - 1] else weight[s - 1]
            at[k] += (stays * fmax(forward[s] - value[s] - reached, 0.0)
                      + (weight[s] - stays) * fmax(forward[s] - value[s] + price, 0.0)
                      + (weight[s - 1] - stays) * fmax(price - reached, 0.0))
            cover += weight[s] - weight[s - 1]
            c += 1
        a = c
    add_to(&unassigned, &lost, -offset[g])
    best = 0.0
    for s in range(<i32>(high - low)):
        if low + s + 1 == high or begin[low + s + 1] == first:
            best = fmax(best, forward[s] - ((unassigned - none[s]) + (lost - rest[s])))
    k = begin[order[high - 1]]
    at[k] += fmax(1.0 - cover, 0.0) * best
    for s in range(<i32>(high - low)):
        if low + s + 1 == high or begin[low + s + 1] == first:
            at[k] += weight[s] * fmax(best - (forward[s] - ((unassigned - none[s]) + (lost - rest[s]))),
                                      0.0)


cdef void row_backward(Row row, Paths paths, Py_ssize_t groups, double best) noexcept nogil:
    """``slack_s = best - (F_s + B_s)``: what the best path has over the best one through the state.

    ``h = max(h, value_s + B_s - lambda)``, ``B_before = max(value_s + B_s, h - lambda)``, backward.
    `forward` and `none` are those of `row_forward`, the first no longer relative; `none` becomes
    the same for the paths that are in no state when the state begins.
    """
    cdef Py_ssize_t low = row.low, high = row.high
    cdef const i32 *order = row.order, *begin = row.begin
    cdef const double *switch_price = row.switch_price, *offset = row.offset
    cdef double *value = paths.value, *forward = paths.forward
    cdef double *none = paths.none, *slack = paths.slack
    cdef Py_ssize_t a = high, c, g = groups - 1
    cdef i32 s, k = begin[low]
    cdef double unassigned = -offset[g], price, top, after
    for s in range(<i32>(high - low)):
        if low + s + 1 == high or begin[low + s + 1] == k:
            slack[s] = 0.0
    while a > low:
        k = begin[order[a - 1]]
        price = switch_price[k]
        c = a
        top = NOTHING
        while a > low and begin[order[a - 1]] == k:
            a -= 1
            s = order[a] - <i32>low
            none[s] = best - (none[s] + unassigned)
            if value[s] + slack[s] > top:
                top = value[s] + slack[s]
        if a == low:
            break
        if top - price > unassigned:
            unassigned = top - price
        while c > a:
            c -= 1
            s = order[c] - <i32>low
            after = value[s] + slack[s]
            if unassigned - price > after:
                after = unassigned - price
            slack[s - 1] = after
        g -= 1
        unassigned -= offset[g]
    for s in range(<i32>(high - low)):
        slack[s] = best - (forward[s] + slack[s])


cdef enum:
    NEAR = 1     # slack within reach
    NEEDED = 2   # doing without any state when this one begins costs more than the reach
    LOSES = 4    # slack that is more than rounding
    BEST = 8     # on the best path that was found
    TEMPTED = 16 # hardly any slack
    MAJORITY = 32    # on the best path, or more than half of the row in the last sweeps
cdef double REGRET = SUM_ERROR
cdef double HARDLY = 1e-6
globals().update(NEAR=NEAR, NEEDED=NEEDED, LOSES=LOSES, BEST=BEST, TEMPTED=TEMPTED, MAJORITY=MAJORITY)


cdef void run_up(Layout layout, const double* price) noexcept nogil:
    """Sum of the prices before each slot of its column, in two parts, as a recording may be long."""
    cdef Py_ssize_t r, t
    cdef double *before = &layout.before[0], *lost = &layout.lost[0]
    cdef double total, rest
    for r in range(layout.column.shape[0]):
        total = rest = 0.0
        for t in range(layout.column_first[layout.column[r]],
                       layout.column_first[layout.column[r] + 1]):
            before[t], lost[t] = total, rest
            add_to(&total, &rest, price[t])


cdef double row_own(Row row, const double* value, const Weight* weight) noexcept nogil:
    """Value of the assignment of one row: sum of weight x value, less its changes and offsets.

    `value` and `weight` begin with the row.
    """
    cdef Py_ssize_t low = row.low, high = row.high
    cdef const i32 *order = row.order, *begin = row.begin
    cdef const double *switch_price = row.switch_price, *offset = row.offset
    cdef Py_ssize_t a = low, g = 0
    cdef i32 s, k, first = begin[low]
    cdef double total = 0.0, rest = 0.0, cover = 0.0, change, part
    while a < high:
        k = begin[order[a]]
        part = 0.0
        while a < high and begin[order[a]] == k:
            s = order[a] - <i32>low
            part += weight[s] * value[s]
            change = weight[s]
            if k > first:
                change -= weight[s - 1]
                if change != 0.0:
                    part -= switch_price[k] * fabs(change)
            cover += change
            a += 1
        add_to(&total, &rest, part - (1.0 - cover) * offset[g])
        g += 1
    return total + rest


cdef void majority(Layout layout, const u8* flags, u8* weight, i32* load) noexcept nogil:
    """Feasible weights 0 and 1: states that are MAJORITY, unless one before is in their way.

    `load` (K,) must come as zeros and becomes the number of rows on each column slot.
    """
    cdef const i32 *rows = &layout.row[0], *row_first = &layout.row_first[0]
    cdef const i32 *order = &layout.order[0], *begin = &layout.begin[0]
    cdef const i32 *slot_begin = &layout.slot_begin[0], *slot_end = &layout.slot_end[0]
    cdef Py_ssize_t r, a, t
    cdef i32 i, s, high, until
    cdef bint free
    for r in range(layout.row.shape[0]):
        i = rows[r]
        high = row_first[i + 1]
        until = -1
        for a in range(row_first[i], high):
            s = order[a]
            weight[s] = 0
            if not flags[s] & MAJORITY or begin[s] <= until:
                continue
            free = True
            for t in range(slot_begin[s], slot_end[s]):
                if load[t]:
                    free = False
                    break
            if not free:
                continue
            for t in range(slot_begin[s], slot_end[s]):
                load[t] = 1
            weight[s] = 1
            until = layout.window_end[i]
            if s + 1 < high and begin[s + 1] > begin[s]:
                until = begin[s + 1] - 1


cdef int improve(Layout layout, i32* load, u8* weight, double* own) noexcept nogil:
    """Each row in turn takes its best path through what the others leave; how many changed.

    `weight` (S,) is 0 or 1, `load` (K,) the number of rows on each column slot; both are updated.
    `own` becomes the value of each row.
    """
    cdef const i32 *slot_begin = &layout.slot_begin[0], *slot_end = &layout.slot_end[0]
    cdef const double *gain = &layout.gains[0]
    cdef Py_ssize_t r, t, low, high, s
    cdef i32 i, last
    cdef int changed = 0
    cdef double best
    cdef Paths paths = paths_in(layout)
    cdef Row row
    for r in range(layout.row.shape[0]):
        i = layout.row[r]
        row = row_of(layout, i)
        low, high = row.low, row.high
        for s in range(low, high):
            if weight[s]:
                for t in range(slot_begin[s], slot_end[s]):
                    load[t] -= 1
        own[i] = row_own(row, gain + low, weight + low)
        for s in range(low, high):
            paths.value[s - low] = gain[s]
            for t in range(slot_begin[s], slot_end[s]):
                if load[t] > 0:
                    paths.value[s - low] = NOTHING
                    break
        best = row_forward(row, paths, &last)
        if best > own[i]:
            # Sums in another order differ in the last digit: that is no change for the better.
            changed += best > own[i] + 1e-12
            own[i] = best
            memset(weight + low, 0, high - low)
            while last >= 0:
                weight[low + last] = 1
                last = paths.came[last]
        for s in range(low, high):
            if weight[s]:
                for t in range(slot_begin[s], slot_end[s]):
                    load[t] += 1
    return changed


cdef class Brackets:
    """The best prices and the best assignment of each block so far, and what both prove.

    Sums by block are 0 in blocks that are not open.

    Parameters
    ----------
    layout : Layout
        The blocks, and those that are open.
    weights, prices : (S,), (K,) float arrays
        Where the best are kept.
    rounding : float
        How wrong a sum of prices along a path may be, as a fraction of all of them.

    Attributes
    ----------
    dual, primal : (B,), (B,) float arrays
        What the prices prove that a block can gain at most, and what the assignment gains.
    most : (B,) float array
        What a block could gain if everything were free, to be set.
    flags, chosen : (S,), (S,) uint8 arrays
        Marks of each state by the last survey; the working set that was chosen last.
    best, own : (nodes,), (nodes,) float arrays
        Value of the best path of each row by the last survey, and that of an assignment.
    """

    cdef readonly object dual, primal, most, flags, best, own
    cdef Layout layout
    cdef double rounding
    cdef readonly object chosen
    cdef double[::1] weight, price, duals, primals, mosts, bests, owns, trial, found, part
    cdef u8[::1] flag, rounded, choice

    def __init__(self, Layout layout, double[::1] weights, double[::1] prices, double rounding):
        cdef Py_ssize_t blocks = layout.open.shape[0], nodes = layout.block.shape[0]
        self.layout, self.rounding = layout, rounding
        self.weight, self.price = weights, prices
        self.dual, self.primal, self.most, self.found, self.part = np.zeros((5, blocks))
        self.best, self.own = np.zeros((2, nodes))
        self.flags, self.rounded, self.chosen = np.zeros((3, weights.shape[0]), np.uint8)
        self.choice = self.chosen
        self.trial = full_of(prices.shape[0], np.nan, np.float64)
        self.duals, self.primals, self.mosts = self.dual, self.primal, self.most
        self.bests, self.owns, self.flag = self.best, self.own, self.flags

    # --- prices

    def bound(self, const double[::1] prices):
        """Bound of each block at the prices of the last survey, (B,)."""
        with nogil:
            self._bound(&prices[0])
        return np.array(self.found)

    def mark(self, const double[::1] prices, double reach):
        """`flags` of every state, and the value `own` of the best assignment at the prices."""
        with nogil:
            self._survey(&prices[0], True, reach, NULL)

    def regrets(self, const double[::1] prices, double[::1] lost):
        """Add what the best assignment loses against the best paths to its steps, (T + 1,)."""
        with nogil:
            self._survey(&prices[0], False, 0.0, &lost[0])

    def try_prices(self, const double[::1] prices):
        """Take the prices in the open blocks where they prove more."""
        with nogil:
            self._take_prices(&prices[0])

    def try_above(self, const double[::1] prices, double least, double gap):
        """`try_prices` with 0 for those up to `least`; whether some bracket is still too wide."""
        cdef Py_ssize_t t
        cdef bint wide
        cdef bint fresh = False
        cdef double price
        with nogil:
            for t in range(prices.shape[0]):
                price = prices[t] if prices[t] > least else 0.0
                fresh = fresh or price != self.trial[t]
                self.trial[t] = price
            if fresh:  # else these were tried before, in the same blocks or more
                self._take_prices(&self.trial[0])
            wide = False
            for t in range(self.duals.shape[0]):
                wide = wide or self._is_wide(t, gap)
        return wide

    def choose(self, const double[::1] prices, double reach):
        """`mark`, and the working set of what is within reach: `chosen`."""
        with nogil:
            self._survey(&prices[0], True, reach, NULL)
            memset(&self.choice[0], 0, self.choice.shape[0])
            working_set(self.layout, &self.weight[0], &prices[0], &self.flag[0], &self.choice[0])

    cdef void _survey(self, const double* price, bint judge, double reach,
                      double* regret) noexcept nogil:
        """Value of the best path of each row at the prices; to `judge`, marks of each state.

        The prices of a state are those of its slots, from running sums in each column. To judge
        also the value `own` of the best assignment at the prices, less its changes. What that loses
        against the best paths is added to `regret`, step by step, unless that is NULL.
        """
        cdef Py_ssize_t r, s, low
        cdef i32 b, e, i, last
        cdef Paths paths = paths_in(self.layout)
        cdef Row row
        cdef const double *gain = &self.layout.gains[0], *weight = &self.weight[0]
        cdef const double *before = &self.layout.before[0], *lost = &self.layout.lost[0]
        cdef const i32 *slot_begin = &self.layout.slot_begin[0], *slot_end = &self.layout.slot_end[0]
        cdef u8* flags = &self.flag[0]
        run_up(self.layout, price)
        for r in range(self.layout.row.shape[0]):
            i = self.layout.row[r]
            row = row_of(self.layout, i)
            low = row.low
            for s in range(low, row.high):
                b, e = slot_begin[s], slot_end[s]
                if e == b:
                    paths.value[s - low] = gain[s]
                elif e == b + 1:
                    paths.value[s - low] = gain[s] - price[b]
                else:
                    paths.value[s - low] = gain[s] - (((before[e - 1] - before[b])
                                                       + (lost[e - 1] - lost[b])) + price[e - 1])
            self.bests[i] = row_forward(row, paths, &last)
            if regret:
                row_regret(row, paths, weight + low, regret)
            if not judge:
                continue
            for s in range(row.high - low):
                paths.forward[s] += paths.none[s]
            row_backward(row, paths, self.layout.groups[i + 1] - self.layout.groups[i], self.bests[i])
            self.owns[i] = row_own(row, paths.value, weight + low)
            for s in range(low, row.high):
                flags[s] = ((NEAR if paths.slack[s - low] <= reach else 0)
                            | (NEEDED if paths.none[s - low] > reach else 0)
                            | (LOSES if paths.slack[s - low] > REGRET else 0)
                            | (TEMPTED if paths.slack[s - low] <= HARDLY else 0))
            while last >= 0:
                flags[low + last] |= BEST | MAJORITY
                last = paths.came[last]

    cdef void _pay(self, const double* price) noexcept nogil:
        """`found` becomes the sum of the prices of each block; of a column as `sum_parts`."""
        cdef Py_ssize_t r, K = self.price.shape[0], low, high
        cdef i32 i
        cdef double* last = &self.layout.before[0]
        cdef double* total = &self.found[0]
        memset(total, 0, self.found.shape[0] * sizeof(double))
        for r in range(self.layout.column.shape[0]):
            i = self.layout.column[r]
            low, high = self.layout.column_first[i], self.layout.column_first[i + 1]
            if low == high:
                continue
            if high == K:  # `sum_parts` has a 0 behind it
                memcpy(last, price + low, (high - low) * sizeof(double))
                last[high - low] = 0.0
                total[self.layout.block[i]] += last[0] + pairwise(last + 1, high - low)
            else:
                total[self.layout.block[i]] += price[low] + pairwise(price + low + 1, high - low - 1)

    cdef void _bound(self, const double* price) noexcept nogil:
        """`found` becomes the bound of each block, after a survey at the prices."""
        cdef Py_ssize_t b
        self._pay(price)
        for b in range(self.found.shape[0]):  # what the values of paths may have lost as well
            self.found[b] = (1 + self.rounding) * self.found[b]
        self._add_rows(&self.bests[0], &self.found[0])

    cdef void _add_rows(self, const double* value, double* total) noexcept nogil:
        """Add the sum of the values (nodes,) of the rows of each block to `total`."""
        cdef Py_ssize_t r, b
        cdef double* sums = &self.part[0]
        memset(sums, 0, self.found.shape[0] * sizeof(double))
        for r in range(self.layout.row.shape[0]):
            sums[self.layout.block[self.layout.row[r]]] += value[self.layout.row[r]]
        for b in range(self.found.shape[0]):
            total[b] += sums[b]

    cdef void _take_prices(self, const double* trial) noexcept nogil:
        cdef Py_ssize_t r, b, t
        cdef i32 i
        cdef double *found = &self.found[0], *dual = &self.duals[0]
        self._survey(trial, False, 0.0, NULL)
        self._bound(trial)
        for r in range(self.layout.column.shape[0]):
            i = self.layout.column[r]
            if found[self.layout.block[i]] < dual[self.layout.block[i]]:
                for t in range(self.layout.column_first[i], self.layout.column_first[i + 1]):
                    self.price[t] = trial[t]
        for b in range(self.duals.shape[0]):
            if self.layout.open[b] and found[b] < dual[b]:
                dual[b] = found[b]

    # --- assignments

    def values(self, const double[::1] weights):
        """Gain of a feasible assignment in each block, (B,)."""
        with nogil:
            self._value(&weights[0])
        return np.array(self.found)

    def try_weights(self, const double[::1] weights):
        """Take the feasible assignment in the open blocks where it gains more."""
        with nogil:
            self._value(&weights[0])
            self._take_weights(&weights[0])

    def round(self, int rounds):
        """Try the majorities, each row then in so many rounds re-optimised given the others."""
        cdef u8* rounded = &self.rounded[0]
        cdef i32* load = <i32*>&self.layout.before[0]  # whose sums nobody needs any more
        cdef int k
        with nogil:
            memset(load, 0, self.price.shape[0] * sizeof(i32))
            majority(self.layout, &self.flag[0], rounded, load)
            if not rounds:
                self._value(rounded)
            for k in range(rounds):
                if not improve(self.layout, load, rounded, &self.owns[0]):
                    break
            memset(&self.found[0], 0, self.found.shape[0] * sizeof(double))
            self._add_rows(&self.owns[0], &self.found[0])
            self._take_weights(rounded)

    cdef void _value(self, const Weight* weight) noexcept nogil:
        """`found` becomes the gain of an assignment in each block, at the gains of the layout."""
        cdef Py_ssize_t r
        cdef Row row
        for r in range(self.layout.row.shape[0]):
            row = row_of(self.layout, self.layout.row[r])
            self.owns[self.layout.row[r]] = row_own(row, &self.layout.gains[row.low], weight + row.low)
        memset(&self.found[0], 0, self.found.shape[0] * sizeof(double))
        self._add_rows(&self.owns[0], &self.found[0])

    cdef void _take_weights(self, const Weight* trial) noexcept nogil:
        cdef Py_ssize_t r, b, s
        cdef i32 i
        cdef double *found = &self.found[0], *primal = &self.primals[0]
        for r in range(self.layout.row.shape[0]):
            i = self.layout.row[r]
            if found[self.layout.block[i]] > primal[self.layout.block[i]]:
                for s in range(self.layout.row_first[i], self.layout.row_first[i + 1]):
                    self.weight[s] = trial[s]
        for b in range(self.primals.shape[0]):
            if self.layout.open[b] and found[b] > primal[b]:
                primal[b] = found[b]

    # --- widths

    def wide(self, double gap):
        """Open blocks whose bracket is wider than the gap, relative to its cost, (B,)."""
        found = np.zeros(self.found.shape[0], bool)
        cdef u8[::1] wider = found.view(np.uint8)
        cdef Py_ssize_t b
        for b in range(wider.shape[0]):
            wider[b] = self._is_wide(b, gap)
        return found

    def only_rounding(self, double gap):
        """Whether some bracket is wide by hardly more than rounding of its prices."""
        cdef Py_ssize_t b
        self._pay(&self.price[0])
        for b in range(self.found.shape[0]):
            if self._is_wide(b, gap) and (
                    self.duals[b] - self.primals[b] < 4 * (self.rounding * self.found[b])):
                return True
        return False

    cdef bint _is_wide(self, Py_ssize_t b, double gap) noexcept nogil:
        cdef double primal = self.primals[b]
        return self.layout.open[b] and (
            self.duals[b] - primal > gap * fmax(self.mosts[b] - primal, 0.0))

    @property
    def open_dual(self):
        """Sum of the bounds of the open blocks, as NumPy adds."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = self.duals[b]
                n += 1
        return pairwise(&self.part[0], n)

    @property
    def open_gap(self):
        """Width of the brackets of the open blocks together."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = self.duals[b] - self.primals[b]
                n += 1
        return pairwise(&self.part[0], n)

    @property
    def open_cost(self):
        """Cost of the best assignment of the open blocks together."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = fmax(self.mosts[b] - self.primals[b], 0.0)
                n += 1
        return pairwise(&self.part[0], n)


def row_potentials(const i32[::1] order, const i32[::1] row, const i32[::1] first,
                   const i32[::1] low, const i32[::1] high, const double[::1] value,
                   const double[::1] leave, const u8[::1] follows):
    """Best values of paths through the free states of a programme, in each row forward in time.

    The rows have borders before, between and after their constraints, numbered row by row from
    `first` (rows + 1,) on. States lie between the borders `low` and `high`, those without a
    constraint where the state before them ends; `order` has them by (high, number). A state that
    `follows` the one before it takes over its value. Returns the value of "none" at each border,
    and that of each state at its end less that, cut to [-leave, leave].
    """
    cdef Py_ssize_t F = order.shape[0], a, b, c
    cdef i32 s, r, at = 0
    cdef double unassigned = 0.0, best
    none_array = np.zeros(first[first.shape[0] - 1])
    through_array = np.zeros(F)
    cdef double[::1] none = none_array, through = through_array
    with nogil:
        a = 0
        while a < F:
            s = order[a]
            r = row[s]
            while at < high[s]:
                none[at] = unassigned
                at += 1
            b = a
            while b < F and high[order[b]] == high[s]:
                s = order[b]
                if low[s] < at:
                    through[s] = none[low[s]] + value[s] + (through[s - 1] if follows[s] else 0.0)
                    unassigned = fmax(unassigned, through[s] - leave[s])
                b += 1
            for c in range(a, b):
                s = order[c]
                if low[s] < at:
                    best = through[s] - unassigned
                else:
                    best = value[s] + (through[s - 1] if follows[s] else 0.0)
                through[s] = fmax(-leave[s], best if best < leave[s] else leave[s])
            a = b
            if a == F or row[order[a]] != r:
                while at < first[r + 1]:
                    none[at] = unassigned
                    at += 1
                unassigned = 0.0
    return none_array, through_array


# --- the certificate: the twins are in problem.paths and problem.certificate, with the same bits --
#
# Nothing above or below is called but `sort_by` and `pairwise`, and no solver calls these.


cdef inline double up(double value) noexcept nogil:
    """The next larger double: `nextafter`, of which the library takes several times as long."""
    cdef int64_t bits
    if value == 0.0:
        return 5e-324
    if not value < INFINITY:
        return value
    memcpy(&bits, &value, sizeof(bits))
    bits += 1 if value > 0.0 else -1
    memcpy(&value, &bits, sizeof(bits))
    return value


cdef inline double down(double value) noexcept nogil:
    return -up(-value)


def upper_gains(const i32[::1] group, Py_ssize_t groups, const i32[::1] entry,
                const double[::1] cost, const double[::1] price, double base):
    """`Gains` where A + B is `base` for all pairs; those of runs remain to be filled in.

    `group` (S,) is the row and step that each state begins at, `price` (S,) that of each state.
    """
    cdef Py_ssize_t S = entry.shape[0], s, b, g
    cdef double loss, d
    relative_array, offset_array = np.empty(S), np.empty(groups)
    best_array = np.empty(groups, np.int64)
    cdef double[::1] relative = relative_array, offset = offset_array
    cdef int64_t[::1] best = best_array
    with nogil:
        for g in range(groups):
            best[g], offset[g] = -1, 0.0  # first the least loss
        for s in range(S):
            if entry[s] >= 0:
                loss = cost[entry[s]] + price[s] - base
                if loss < 0.0 and loss <= offset[group[s]]:
                    best[group[s]], offset[group[s]] = s, loss
        for g in range(groups):
            b = best[g]
            if b >= 0:
                offset[g] = fmax(down(down(down(base) - cost[entry[b]]) - price[b]), 0.0)
        for s in range(S):
            if entry[s] < 0:
                continue
            b, d = best[group[s]], cost[entry[s]]
            if b >= 0:
                relative[s] = up(up(cost[entry[b]] - d) + up(price[b] - price[s]))
            else:
                relative[s] = up(up(up(base - d)) - price[s])
    return relative_array, offset_array, best_array


def upper_values(const i32[::1] group, const i32[::1] group_first, const i32[::1] pair_first,
                 const i32[::1] pair_row, const i32[::1] begin, const double[::1] value,
                 const double[::1] switch_price, const double[::1] offset):
    """Upper bound of the value of the best path of each row, (nodes,): `best_values`.

    `group` (S,) is the row and step that each state begins at, `group_first` (nodes + 1,) the first
    of each row; `switch_price` is one number, or one for each step.
    """
    cdef Py_ssize_t S = begin.shape[0], nodes = group_first.shape[0] - 1, a, c, p
    cdef i32 i, g, s
    cdef bint varies = switch_price.shape[0] > 1
    cdef double price = switch_price[0], none, enter
    cdef i32[::1] at = np.zeros(group_first[nodes] + 1, np.int32)
    cdef i32[::1] order = np.empty(S, np.int32)
    cdef double[::1] reached = np.empty(S)
    none_array = np.zeros(nodes)
    cdef double[::1] unassigned = none_array
    with nogil:
        sort_by(group, at, order)
        a = 0
        for i in range(<i32>nodes):
            none = 0.0
            for g in range(group_first[i], group_first[i + 1]):
                if varies:
                    price = switch_price[begin[order[a]]]
                for c in range(a, at[g]):
                    s = order[c]
                    reached[s] = 0.0 if g == group_first[i] else reached[s - 1]
                    none = fmax(none, up(reached[s] - price))
                enter = up(none - price)
                for c in range(a, at[g]):
                    s = order[c]
                    reached[s] = up(fmax(reached[s], enter) + value[s])
                none = up(none - offset[g])
                a = at[g]
            unassigned[i] = none
        for p in range(pair_row.shape[0]):
            i = pair_row[p]
            unassigned[i] = fmax(unassigned[i], reached[pair_first[p + 1] - 1])
    return none_array


def run_gains(const i32[::1] first, const i32[::1] begin, const i32[::1] pair_first,
              const i32[::1] pair_node, const double[::1] unit, const int64_t[::1] sums,
              const i32[::1] entry, const double[::1] price, double[::1] relative):
    """Fill in the relative gains of runs, ``-v - sum r``: the end of `problem.paths.relative_gains`.

    `unit` and `sums` are the running sums of the offsets over the slots of `first` and `begin`.
    """
    cdef Py_ssize_t p, s
    cdef uint64_t before, after
    cdef double lost
    with nogil:
        for p in range(pair_node.shape[0]):
            after = <uint64_t>sums[first[pair_node[p] + 1]]
            for s in range(pair_first[p + 1] - 1, pair_first[p] - 1, -1):
                before = <uint64_t>sums[begin[s]]
                if entry[s] < 0:
                    lost = unit[pair_node[p]] * <double><int64_t>(after - before)
                    relative[s] = up(-price[s] - (down(lost) if lost > 0.0 else lost))
                after = before


def put_aside(const int64_t[::1] best, const i32[::1] group, const i32[::1] entry,
              const double[::1] cost, const i32[::1] first, const i32[::1] begin,
              const i32[::1] pair_first, const i32[::1] pair_node, i32[::1] left):
    """Cost of the best pair of each group, 0 without one; `left` is less 1 at its column slot.

    `best` (G,) and `group` (S,) as in `Gains` and `row_steps`; `first`, `begin`, `pair_first` and
    `pair_node` are those of the columns.
    """
    cdef Py_ssize_t p, s
    cdef i32 end
    found = np.zeros(best.shape[0])
    cdef double[::1] least = found
    with nogil:
        for p in range(pair_node.shape[0]):
            end = first[pair_node[p] + 1]
            for s in range(pair_first[p + 1] - 1, pair_first[p] - 1, -1):
                if best[group[s]] == s:
                    least[group[s]] = cost[entry[s]]
                    if end > begin[s]:
                        left[begin[s]] -= 1
                end = begin[s]
    return found


def idle_prices(const double[::1] unit, const int64_t[::1] sums, const i32[::1] left,
                const i32[::1] first):
    """``-sum (left v)`` of the slots of each node in two halves, (2, nodes), from above.

    Prices are `unit` times the differences of `sums`; the halves keep sums from overflow.
    """
    cdef Py_ssize_t i, t
    cdef int64_t whole, low, high
    found = np.empty((2, unit.shape[0]))
    cdef double[:, ::1] part = found
    with nogil:
        for i in range(unit.shape[0]):
            low = high = 0
            for t in range(first[i], first[i + 1]):
                whole = <int64_t>(<uint64_t>sums[t + 1] - <uint64_t>sums[t])
                low += (whole & 0x7fffffff) * left[t]
                high += (whole >> 31) * left[t]
            part[0, i] = -up(unit[i] * <double>low)
            part[1, i] = -up(unit[i] * 2147483648.0 * <double>high)
    return found


cdef class Terms:
    """Terms of a cost, added up in groups of 64: `problem.certificate._in_chunks`."""

    cdef double[::1] sums
    cdef double[64] group
    cdef Py_ssize_t count, size

    def __init__(self, Py_ssize_t most):
        self.sums = np.empty(most // 64 + 4)

    cdef void add(self, double term) noexcept nogil:
        self.group[self.size] = term
        self.size += 1
        if self.size == 64:
            self.close()

    cdef void close(self) noexcept nogil:
        if self.size:
            self.sums[self.count] = self.group[0] + pairwise(&self.group[1], self.size - 1)
            self.count += 1
            self.size = 0


def break_down(states, const int64_t[::1] weight, int64_t one):
    """The sums of `problem.certificate.break_down`, of a problem that is one part.

    Returns
    -------
    costs : (6, T) float array
        Localisation, missed, false, missed count, false count, variation.
    terms : list of float
        Sums of some terms of the total each.
    """
    problem = states.problem
    cdef const i32[::1] begin = states.begin, entry = states.entry, pair_first = states.pair_first
    cdef const double[::1] cost = problem.cost
    cdef const double[::1] switch_price = problem.switch_price_at
    cdef const i32[::1] row, step
    cdef const double[:] price
    cdef Py_ssize_t s, e, p, steps = problem.steps, side, i
    cdef double whole = one, share, paid
    cdef int64_t rise
    cdef int64_t[::1] free
    costs = np.zeros((6, steps))
    cdef double[:, ::1] at = costs
    cdef Terms terms = Terms(2 * begin.shape[0] + len(problem.truth_step)
                             + len(problem.estimate_step))
    for side, objects in enumerate(problem.sides):
        row = objects.row.astype(np.int32, copy=False)
        step = objects.step.astype(np.int32, copy=False)
        price = objects.price
        free = full_of(step.shape[0], one, np.int64)
        with nogil:
            for s in range(begin.shape[0]):
                e = entry[s]
                if e < 0 or weight[s] == 0:
                    continue
                free[row[e]] -= weight[s]
                if side == 0:
                    paid = <double>weight[s] / whole * cost[e]
                    at[0, begin[s]] += paid
                    terms.add(paid)
            terms.close()
        if objects.unjudged is not None:
            np.asarray(free)[objects.unjudged] = 0
        with nogil:
            for i in range(step.shape[0]):
                if free[i]:
                    share = <double>free[i] / whole
                    at[3 + side, step[i]] += share
                    paid = share * price[i]
                    at[1 + side, step[i]] += paid
                    terms.add(paid)
            terms.close()
    with nogil:
        for p in range(pair_first.shape[0] - 1):
            for s in range(pair_first[p] + 1, pair_first[p + 1]):
                rise = weight[s] - weight[s - 1]
                if rise:
                    share = <double>(rise if rise > 0 else -rise) / whole
                    at[5, begin[s]] += share
                    terms.add(switch_price[begin[s]] * share)
        terms.close()
    return costs, np.asarray(terms.sums[:terms.count]).tolist()


# --- entropic sweeps ------------------------------------------------------------------------------

cdef enum:
    INSIDE = 1   # of a link: the state goes on from the link before, no way in between them
    GOES_ON = 2  # of a link: the state goes on with the next link, no way out between them
    FIRST = 4    # of a node: the window begins
    CERTAIN = 8    # of a node and its state: before it the row was surely in this pair
    FINAL = 16   # of a node and its state: after it the row is surely in this pair
    FREE = 8     # constraints that stand for "no price", by turns: sums do not wait for each other


cdef void working_set(Layout layout, const double* weight, const double* price, const u8* flags,
                      u8* chosen) noexcept nogil:
    """Choose the states that a chain is built of; 1 = chosen, with CERTAIN and FINAL at its ends.

    Chosen are the states near, by the flags of `survey`, and those in use. Stretches where a row
    has one option only, for which no other row competes, are left out but for their ends, and so
    are rows with which none competes (docs/theory/solvers.md, "Working set").
    """
    cdef const i32 *rows = &layout.row[0], *row_first = &layout.row_first[0]
    cdef const i32 *order = &layout.order[0], *begin = &layout.begin[0]
    cdef const i32 *slot_begin = &layout.slot_begin[0], *slot_end = &layout.slot_end[0]
    cdef Py_ssize_t r, a, c, low, high, t, K = layout.slot_step.shape[0]
    cdef i32 i, s, k, first, group, active, crowded
    cdef bint rivalled
    cdef i32 *change = <i32*>&layout.before[0], *rivals = <i32*>&layout.lost[0]
    cdef i32 *since = &layout.came[0]
    memset(change, 0, (K + 1) * sizeof(i32))
    rivals[0] = 0
    for r in range(layout.row.shape[0]):
        for s in range(row_first[rows[r]], row_first[rows[r] + 1]):
            chosen[s] = 1 if flags[s] & NEAR or weight[s] > 0.0 else 0
            if chosen[s]:
                change[slot_begin[s]] += 1
                change[slot_end[s]] -= 1
    active = 0
    for t in range(K):
        active += change[t]
        rivals[t + 1] = rivals[t] + (active > 1 or (active == 1 and price[t] > 0.0))
    for r in range(layout.row.shape[0]):
        i = rows[r]
        low, high = row_first[i], row_first[i + 1]
        if low == high:
            continue
        rivalled = False
        for s in range(low, high):
            if chosen[s] and rivals[slot_end[s]] > rivals[slot_begin[s]]:
                rivalled = True
                break
        if not rivalled:
            memset(chosen + low, 0, high - low)
            continue
        # A state is sure (2) if no other is chosen while it lasts, nor "none", nor a rival.
        first = begin[low]
        active = 0
        group = 0
        crowded = -1
        a = low
        while a < high:
            k = begin[order[a]]
            c = a
            while c < high and begin[order[c]] == k:
                s = order[c]
                if k > first and chosen[s - 1]:
                    active -= 1
                    if crowded < since[s - 1 - low] and is_sure(
                            s - 1, flags, rivals, slot_begin, slot_end):
                        chosen[s - 1] = 2
                if chosen[s]:
                    active += 1
                    since[s - low] = group
                c += 1
            if active > 1:
                crowded = group
            group += 1
            a = c
        for s in range(low, high):
            if chosen[s] == 1 and (s + 1 == high or begin[s + 1] == first) and (
                    crowded < since[s - low]) and is_sure(
                        s, flags, rivals, slot_begin, slot_end):
                chosen[s] = 2
        # Sure states stay where a neighbour in time is not sure; 3 is left out.
        for s in range(low, high):
            if chosen[s] == 2 and (begin[s] == first or chosen[s - 1] >= 2) and (
                    s + 1 == high or begin[s + 1] == first or chosen[s + 1] == 2):
                chosen[s] = 3
        for s in range(low, high):
            if chosen[s] == 2:
                chosen[s] = 1
                if begin[s] != first and chosen[s - 1] == 3:
                    chosen[s] |= CERTAIN
                if s + 1 < high and begin[s + 1] != first and chosen[s + 1] == 3:
                    chosen[s] |= FINAL
        for s in range(low, high):
            if chosen[s] == 3:
                chosen[s] = 0


cdef bint is_sure(i32 s, const u8* flags, const i32* rivals, const i32* slot_begin,
                  const i32* slot_end) noexcept nogil:
    """Whether leaving the state costs more than the reach and nobody else wants its column."""
    return flags[s] & (NEAR | NEEDED) == (NEAR | NEEDED) and (
        rivals[slot_end[s]] == rivals[slot_begin[s]])


cdef struct Walk:
    i32* held                    # states that a row could be in at a step,
    i32* cursor                  # the next slot that they compete for,
    i32* latest                  # and their latest link
    i32* link_of                 # that of each state of the row, when it ended
    const i32* slot_step
    const i32* slot_end
    const i32* constraint_of
    const i32* after
    i32* node_at                 # next node and link of each step
    i32* link_at


cdef struct AtRow:               # what a pass knows of a row at its latest node: a line of the cache
    double none                  # paths in no state,
    double left[2]               # in states that go on, and in those that may end or come here
    double price                 # q there
    double factor[2]             # of what comes to a link: by way of "none", and without
    double added[2]


cdef class Chain:
    """The working set as a chain of links, and messages along it (docs/theory/solvers.md).

    A *node* is a row at a step where something happens to it: a state of the working set begins or
    has just ended, or a stretch of slots begins for which a state of it competes. It has a *link*
    for each state that the row could be in. Nodes are sorted by (step, row), links by node. Link 0
    stands for "none before" and "none after" and holds 0; the first constraints for "no price".

    Parameters
    ----------
    layout : Layout
        The rows and columns that take part.
    chosen : (S,) uint8 array
        The working set, from `working_set`.
    price : (K,) float array
        Prices at the start, absorbed into the kernel.
    most : int
        Nothing is built if there were more links; `links` says how many.
    """

    cdef readonly Py_ssize_t links, nodes, constraints, rows, steps
    cdef const double[::1] switch_price
    cdef double[::1] kernel, none_kernel, ahead, behind, passed, share
    cdef double[::1] none_ahead, none_behind
    cdef double[::1] price, slack, cap, u, load, stay
    cdef double[::1] row, total
    cdef i32[::1] state, previous, next, constraint, node_link, node_row, step_node
    cdef i32[::1] step_constraint, slot_first, slot_count
    cdef i32[::1] link_row
    cdef u8[::1] kind, ends

    def __init__(self, Layout layout, const u8[::1] chosen, const double[::1] price,
                 Py_ssize_t most):
        cdef Py_ssize_t K = price.shape[0]
        self.switch_price = layout.switch_price
        self.steps = layout.switch_price.shape[0]
        self.rows = layout.row.shape[0]
        # One stretch for all that is needed on the way: a small chain takes hardly longer to make.
        cdef i32[::1] room = np.zeros(4 * (K + 1) + 2 * (self.steps + 1) + 3 * layout.widest
                                      + layout.longest + 1, np.int32)
        cdef i32 *constraint_of = &room[0], *after = constraint_of + K + 1
        self._constrain(layout, &chosen[0], &price[0], constraint_of, after, after + K + 1)

        cdef i32 *node_at = after + 3 * (K + 1), *link_at = node_at + self.steps + 1
        cdef Walk walk
        walk.held = link_at + self.steps + 1
        walk.cursor, walk.latest = walk.held + layout.widest, walk.held + 2 * layout.widest
        walk.link_of = walk.held + 3 * layout.widest
        walk.slot_step, walk.slot_end = &layout.slot_step[0], &layout.slot_end[0]
        walk.constraint_of, walk.after = constraint_of, after
        walk.node_at, walk.link_at = node_at, link_at
        with nogil:
            self._emit(False, layout, &chosen[0], walk)
        cdef Py_ssize_t k, l, widest = 0
        cdef i32 count
        for k in range(self.steps):
            count, node_at[k] = node_at[k], <i32>self.nodes
            self.nodes += count
            count, link_at[k] = link_at[k], <i32>(self.links + 1)
            self.links += count
            widest = max(widest, count)
        if self.links > most:
            return
        self._make_room(widest)
        for k in range(self.steps):
            self.step_node[k] = node_at[k]
        self.step_node[self.steps] = <i32>self.nodes
        for l in range(self.links + 1):
            self.constraint[l] = l % FREE
        for k in range(self.constraints + FREE):
            self.slack[k] = self.cap[k] = self.u[k] = 1.0
        self.node_link[self.nodes] = <i32>(self.links + 1)
        with nogil:
            self._emit(True, layout, &chosen[0], walk)

    cdef object _make_room(self, Py_ssize_t widest):
        """All arrays, zeros, as stretches of three: small chains take no longer to make than to use.

        `widest` is the largest number of links of a step.
        """
        cdef Py_ssize_t links = self.links + 1, nodes = self.nodes + 1
        cdef Py_ssize_t constraints = self.constraints + FREE
        cdef double[::1] numbers = np.zeros(4 * links + 3 * nodes + 4 * constraints + widest
                                            + self.steps + 9 * self.rows + 1)
        cdef i32[::1] places = np.zeros(5 * links + 2 * nodes + self.steps + 1, np.int32)
        cdef u8[::1] marks = np.zeros(links + nodes, np.uint8)
        self.kernel, numbers = numbers[:links], numbers[links:]
        self.ahead, numbers = numbers[:links], numbers[links:]
        self.behind, numbers = numbers[:links], numbers[links:]
        self.passed, numbers = numbers[:links], numbers[links:]
        self.none_kernel, numbers = numbers[:nodes], numbers[nodes:]
        self.none_ahead, numbers = numbers[:nodes], numbers[nodes:]
        self.none_behind, numbers = numbers[:nodes], numbers[nodes:]
        self.slack, numbers = numbers[:constraints], numbers[constraints:]
        self.cap, numbers = numbers[:constraints], numbers[constraints:]
        self.u, numbers = numbers[:constraints], numbers[constraints:]
        self.load, numbers = numbers[:constraints], numbers[constraints:]
        self.share, numbers = numbers[:widest], numbers[widest:]
        self.stay, numbers = numbers[:self.steps], numbers[self.steps:]
        self.total, self.row = numbers[:self.rows], numbers[self.rows:]
        self.state, places = places[:links], places[links:]
        self.previous, places = places[:links], places[links:]
        self.next, places = places[:links], places[links:]
        self.constraint, places = places[:links], places[links:]
        self.link_row, places = places[:links], places[links:]
        self.node_row, places = places[:nodes], places[nodes:]
        self.node_link, self.step_node = places[:nodes], places[nodes:]
        self.kind, self.ends = marks[:links], marks[links:]

    cdef object _constrain(self, Layout layout, const u8* chosen, const double* price,
                           i32* constraint_of, i32* after, i32* opens):
        """Stretches of slots with the same chosen states; those that need a price, by step.

        A stretch is priced where two states compete, or where a price has to come down again.
        `opens` is room for twice as many numbers as there are slots and one, zeros as
        `constraint_of`.
        """
        cdef const i32 *rows = &layout.row[0], *row_first = &layout.row_first[0]
        cdef const i32 *slot_step = &layout.slot_step[0]
        cdef const i32 *slot_begin = &layout.slot_begin[0], *slot_end = &layout.slot_end[0]
        cdef const i32 *columns = &layout.column[0], *column_first = &layout.column_first[0]
        cdef Py_ssize_t r, s, K = layout.slot_step.shape[0], t, n = 0
        cdef i32 c, active, start, last
        cdef double total
        cdef bint fill
        cdef i32* closes = opens + K + 1
        self.step_constraint = np.zeros(self.steps + 2, np.int32)
        cdef i32* at = &self.step_constraint[0]
        with nogil:
            for r in range(layout.row.shape[0]):
                for s in range(row_first[rows[r]], row_first[rows[r] + 1]):
                    if chosen[s] and slot_end[s] > slot_begin[s]:
                        opens[slot_begin[s]] += 1
                        closes[slot_end[s] - 1] += 1
        for fill in (False, True):  # how many there are at each step, then what they are
            with nogil:
                for r in range(layout.column.shape[0]):
                    c = columns[r]
                    active = 0
                    t = column_first[c]
                    while t < column_first[c + 1]:
                        active += opens[t]
                        start = <i32>t
                        total = price[t]
                        t += 1
                        while t < column_first[c + 1] and not opens[t] and not closes[t - 1]:
                            total += price[t]
                            t += 1
                        if active > 1 or (active == 1 and total > 0.0):
                            if fill:
                                n = at[slot_step[start]]
                                at[slot_step[start]] += 1
                                self.slot_first[n] = start
                                self.slot_count[n] = <i32>t - start
                                self.price[n] = total
                                constraint_of[start] = <i32>n
                            else:
                                at[slot_step[start] + 2] += 1
                                n += 1
                        active -= closes[t - 1]
            if not fill:
                self.constraints = n
                self.slot_first, self.slot_count = np.zeros((2, n + FREE), np.int32)
                self.slot_count[:FREE] = 1
                self.price = np.zeros(n + FREE)
                at[0] = FREE
                for t in range(self.steps + 1):
                    at[t + 1] += at[t]
                at += 1  # the places move on to the next step below
        with nogil:
            last = <i32>K
            for t in range(K, -1, -1):
                if constraint_of[t]:
                    last = <i32>t
                after[t] = last

    cdef void _emit(self, bint fill, Layout layout, const u8* chosen, Walk walk) noexcept nogil:
        """Walk the rows in time; count nodes and links of every step, or write them."""
        cdef const i32 *rows = &layout.row[0], *row_first = &layout.row_first[0]
        cdef const i32 *slot_step = walk.slot_step, *slot_begin = &layout.slot_begin[0]
        cdef const i32 *slot_end = walk.slot_end, *constraint_of = walk.constraint_of
        cdef const i32 *after = walk.after, *group_first = &layout.groups[0]
        cdef const i32 *order = &layout.order[0], *begin = &layout.begin[0]
        cdef const i32 *entry = &layout.entry[0], *window_end = &layout.window_end[0]
        cdef const double *gain = &layout.gains[0], *offset = &layout.offsets[0]
        cdef i32 *held = walk.held, *cursor = walk.cursor, *latest = walk.latest
        cdef i32 *link_of = walk.link_of, *node_at = walk.node_at, *link_at = walk.link_at
        cdef Py_ssize_t r, a, c, low, high, x, y
        cdef i32 i, s, k, e, g, first, active, link
        cdef bint event
        for r in range(layout.row.shape[0]):
            i = rows[r]
            low, high = row_first[i], row_first[i + 1]
            if low == high:
                continue
            first = begin[low]
            active = 0
            a = low
            g = group_first[i] - 1
            while True:
                k = begin[order[a]] if a < high else window_end[i] + 1
                while active:
                    e = k
                    for x in range(active):
                        if cursor[x] < slot_end[held[x]] and slot_step[cursor[x]] < e:
                            e = slot_step[cursor[x]]
                    if e == k:
                        break
                    self._node(fill, r, e, active, walk)
                if a == high:
                    break
                event = False
                c = a
                g += 1
                while c < high and begin[order[c]] == k:
                    s = order[c]
                    if chosen[s]:
                        event = True
                    elif k > first and chosen[s - 1]:
                        if chosen[s - 1] & FINAL:
                            active = 0
                        else:
                            event = True
                    c += 1
                if not event:
                    a = c
                    continue
                y = 0
                for x in range(active):
                    s = held[x]
                    if s + 1 < high and begin[s + 1] == k:
                        if fill:
                            link_of[s - low] = latest[x]
                    else:
                        held[y], cursor[y], latest[y] = held[x], cursor[x], latest[x]
                        y += 1
                active = <i32>y
                self._node(fill, r, k, active, walk)
                while a < c:
                    s = order[a]
                    a += 1
                    if not chosen[s]:
                        continue
                    held[active] = s
                    cursor[active] = after[slot_begin[s]]
                    if slot_begin[s] == slot_end[s]:
                        cursor[active] = slot_end[s]
                    if fill:
                        link = link_at[k]
                        self.state[link] = s
                        if entry[s] >= 0:
                            self.kernel[link] = gain[s] + offset[g]
                        self.link_row[link] = <i32>r
                        self.ends[node_at[k] - 1] |= chosen[s] & (CERTAIN | FINAL)
                        if k == first:
                            self.ends[node_at[k] - 1] |= FIRST
                        elif chosen[s - 1] and not chosen[s] & CERTAIN:
                            self.previous[link] = link_of[s - 1 - low]
                            self.next[self.previous[link]] = link
                        latest[active] = link
                    if cursor[active] < slot_end[s] and slot_step[cursor[active]] == k:
                        if fill:
                            self.constraint[link] = constraint_of[cursor[active]]
                        cursor[active] = after[cursor[active] + 1]
                    link_at[k] += 1
                    active += 1

    cdef void _node(self, bint fill, Py_ssize_t r, i32 k, i32 active, Walk at) noexcept nogil:
        """A node of row r at step k, with a link for each state that goes on."""
        cdef Py_ssize_t x
        cdef i32 link, n = at.node_at[k]
        at.node_at[k] = n + 1
        if fill:
            self.node_row[n] = <i32>r
            self.node_link[n] = at.link_at[k]
        for x in range(active):
            link = at.link_at[k]
            at.link_at[k] = link + 1
            if fill:
                self.state[link] = at.held[x]
                self.link_row[link] = self.node_row[n]
                self.kind[link] |= INSIDE
                self.kind[at.latest[x]] |= GOES_ON
                self.previous[link] = at.latest[x]
                self.next[at.latest[x]] = link
                at.latest[x] = link
            if at.cursor[x] < at.slot_end[at.held[x]] and at.slot_step[at.cursor[x]] == k:
                if fill:
                    self.constraint[link] = at.constraint_of[at.cursor[x]]
                at.cursor[x] = at.after[at.cursor[x] + 1]

    def heat(self, double epsilon):
        """``K = exp((g - v - mu) / epsilon)``, ``K_0 = exp(-mu / epsilon)``, mu the largest or 0."""
        cdef Py_ssize_t n, l, c, k
        cdef double top, value
        with nogil:
            for c in range(FREE, self.constraints + FREE):
                self.u[c] = 1.0
                self.slack[c] = exp(-self.price[c] / epsilon)
                self.cap[c] = exp(min(self.price[c] / epsilon, 230.0))
            for k in range(self.steps):
                self.stay[k] = exp(-self.switch_price[k] / epsilon)
                if self.stay[k] < 1e-60:
                    self.stay[k] = 1e-60
            for n in range(self.nodes):
                top = 0.0
                for l in range(self.node_link[n], self.node_link[n + 1]):
                    value = self.kernel[l] - self.price[self.constraint[l]]
                    self.kernel[l] = value
                    if value > top:
                        top = value
                for l in range(self.node_link[n], self.node_link[n + 1]):
                    value = (self.kernel[l] - top) / epsilon
                    self.kernel[l] = exp(value) if value > -450.0 else 3.7e-196
                self.none_kernel[n] = exp(-top / epsilon) if top < 450.0 * epsilon else 3.7e-196
            self._pass(True, False)

    def sweep(self, int most, double calm=0.0):
        """Sweep forward and backward until no column is violated by as much as `calm`.

        Returns
        -------
        done : int
            How many sweeps it took.
        violation : float
            The largest violation of a column in the last of them.
        """
        cdef double violation = 0.0
        cdef int done = 0
        with nogil:
            while done < most:
                violation = self._pass(False, True)
                violation = fmax(violation, self._pass(True, True))
                done += 1
                if violation < calm:
                    break
        return done, violation

    def cool(self, double epsilon):
        """``v <- max(v - epsilon log u, 0)``: changes of prices out of the messages into `price`."""
        cdef Py_ssize_t c
        with nogil:
            for c in range(FREE, self.constraints + FREE):
                self.price[c] -= epsilon * log(self.u[c])
                if self.price[c] < 0.0:
                    self.price[c] = 0.0
                self.u[c] = 1.0

    def write_prices(self, double[::1] price):
        """Prices of the stretches as prices of their slots: more on the first, or all less."""
        cdef Py_ssize_t c, t
        cdef double total
        with nogil:
            for c in range(FREE, self.constraints + FREE):
                total = 0.0
                for t in range(self.slot_first[c], self.slot_first[c] + self.slot_count[c]):
                    total += price[t]
                if self.price[c] >= total:
                    price[self.slot_first[c]] += self.price[c] - total
                else:
                    for t in range(self.slot_first[c], self.slot_first[c] + self.slot_count[c]):
                        price[t] *= self.price[c] / total

    def write_masses(self, float[::1] mass, u8[::1] flags):
        """Share of the paths of its row that pass each state; set MAJORITY where it is above half."""
        cdef Py_ssize_t n, l
        cdef double total
        cdef i32 s
        with nogil:
            for n in range(self.nodes):
                total = self.none_ahead[n] * self.none_kernel[n] * self.none_behind[n]
                for l in range(self.node_link[n], self.node_link[n + 1]):
                    self.passed[l] = (self.ahead[l] * self.kernel[l]
                                      * self.u[self.constraint[l]] * self.behind[l])
                    total += self.passed[l]
                for l in range(self.node_link[n], self.node_link[n + 1]):
                    if not self.kind[l] & INSIDE:
                        s = self.state[l]
                        mass[s] = 0.0
                        flags[s] = flags[s] & ~MAJORITY
                        if total > 1e-290:
                            mass[s] = <float>(self.passed[l] / total)
                            if self.passed[l] > 0.5 * total:
                                flags[s] |= MAJORITY

    cdef double _pass(self, bint reverse, bint update) noexcept nogil:
        """One direction: renew its messages node by node, and the prices step by step.

        ``A_0' = a_0 + q S'``, ``A_s' = (1 - q^2) a_s + q A_0'``, S' the sum over the states that
        may pass through "none", q = exp(-lambda / epsilon); ``u <- min(u (w_0 u + mass)^-3/2,
        1 / w_0)`` (docs/theory/solvers.md, "Messages"). Scaled by r where they leave 1e-10..1e10.
        """
        cdef Py_ssize_t step, k, n, l, c, low, high, first, last
        cdef i32 row
        cdef double r, q, none, filled, rho, part, violation = 0.0
        cdef double *ahead = &self.ahead[0], *behind = &self.behind[0]
        cdef double *none_ahead = &self.none_ahead[0], *none_behind = &self.none_behind[0]
        cdef double *kernel = &self.kernel[0], *none_kernel = &self.none_kernel[0]
        cdef double *u = &self.u[0], *slack = &self.slack[0], *cap = &self.cap[0]
        cdef double *passed = &self.passed[0], *load = &self.load[0], *stay = &self.stay[0]
        cdef double *share = &self.share[0]  # of the links of a step, times the total of their node
        cdef double *total = &self.total[0]  # of the node of each row, then 1 / total
        cdef AtRow *at = <AtRow*>&self.row[0]
        cdef AtRow *here
        cdef i32 *source = &self.next[0] if reverse else &self.previous[0]
        cdef i32 *constraint = &self.constraint[0], *step_constraint = &self.step_constraint[0]
        cdef i32 *node_link = &self.node_link[0], *node_row = &self.node_row[0]
        cdef i32 *step_node = &self.step_node[0], *link_row = &self.link_row[0]
        cdef u8 *kind = &self.kind[0], *ends = &self.ends[0]
        cdef u8 straight = GOES_ON if reverse else INSIDE  # no "none" between the link and its source
        cdef u8 held = INSIDE if reverse else GOES_ON      # no "none" after it
        cdef u8 start = FINAL if reverse else FIRST | CERTAIN
        cdef u8 sure = FINAL if reverse else CERTAIN
        if reverse:
            ahead, behind, none_ahead, none_behind = behind, ahead, none_behind, none_ahead
        for row in range(self.rows):
            at[row].none, at[row].left[0], at[row].left[1], at[row].price = 1.0, 0.0, 0.0, -1.0
            at[row].added[1] = 0.0
        for step in range(self.steps):
            k = self.steps - 1 - step if reverse else step
            low, high = step_node[k], step_node[k + 1]
            if low == high:
                continue
            # All nodes, then all links: loops over the few links of a node end unforeseeably.
            for n in range(low, high):
                here = &at[node_row[n]]
                q = here.price if reverse else stay[k]
                if q < 0.0 or ends[n] & start:  # nothing to pay
                    none = 0.0 if ends[n] & sure else 1.0
                    here.factor[0], here.added[0], here.factor[1] = 0.0, 1.0, 1.0
                else:
                    r = here.none + here.left[0] + here.left[1]
                    r = 1.0 if 1e-10 < r < 1e10 else 1.0 / r
                    none = r * (here.none + q * here.left[1])
                    here.factor[0], here.added[0], here.factor[1] = r * (1.0 - q * q), q * none, r
                none_ahead[n] = none
                none *= none_kernel[n]
                here.none, here.left[0], here.left[1], here.price = none, 0.0, 0.0, stay[k]
                total[node_row[n]] = none * none_behind[n]
            first, last = node_link[low], node_link[high]
            for l in range(first, last):
                here = &at[link_row[l]]
                c = (kind[l] & straight) != 0
                part = here.factor[c] * passed[source[l]] + here.added[c]
                ahead[l] = part
                part *= kernel[l]
                passed[l] = part
                part = part * u[constraint[l]] * behind[l]
                share[l - first] = part
                total[link_row[l]] += part
            if update:
                for n in range(low, high):  # underflow: such a row has no say until the next kernel
                    part = total[node_row[n]]
                    total[node_row[n]] = 1.0 / part if part > 1e-290 else 0.0
                for c in range(step_constraint[k], step_constraint[k + 1]):
                    load[c] = 0.0
                for l in range(first, last):
                    load[constraint[l]] += share[l - first] * total[link_row[l]]
                for c in range(step_constraint[k], step_constraint[k + 1]):
                    # Exact: u <- 1 / (slack + load / u); over-relaxed to the power 3/2.
                    filled = u[c] * slack[c] + load[c]
                    if fabs(filled - 1.0) > violation:
                        violation = fabs(filled - 1.0)
                    if filled < 1e-40:
                        filled = 1e-40
                    rho = u[c] / (filled * sqrt(filled))
                    # At most 1 / slack, where the price is 0.
                    u[c] = cap[c] if rho > cap[c] else (1e-60 if rho < 1e-60 else rho)
            for l in range(first, last):
                part = passed[l] * u[constraint[l]]
                passed[l] = part
                at[link_row[l]].left[(kind[l] & held) == 0] += part
        return violation


# --- near points, and pairs chosen greedily ------------------------------------------------------
#
# The twins are in distances.pair_search and in points and pairing of evaluation.diagnosis, with
# the same bits.


cdef inline double apart(const double* a, const double* b, const double* scale, Py_ssize_t size,
                         int power, double most) noexcept nogil:
    """Norm of the difference, 0 standing for the largest component; at least `most` if one is."""
    cdef double total = scale[0] * fabs(a[0] - b[0]), other
    cdef Py_ssize_t k
    for k in range(1, size):
        if not total < most:
            return total
        other = scale[k] * fabs(a[k] - b[k])
        if not other < most:
            return other
        if power == 2:
            total = hypot(total, other)
        elif power == 1:
            total = total + other
        else:
            total = fmax(total, other)
    return total


cdef Py_ssize_t widest_axis(const double[:, ::1] states, const int64_t[:, ::1] rows,
                            const double[::1] scale) noexcept nogil:
    """The axis on which the first of the steps are the farthest apart."""
    cdef Py_ssize_t i, k, axis = 0, seen = 0, t = 0
    cdef double low, high, most = -1.0
    for k in range(states.shape[1]):
        low, high, seen, t = INFINITY, -INFINITY, 0, 0
        while t < rows.shape[1] and seen < SEEN:
            for i in range(rows[0, t], rows[1, t]):
                low, high = fmin(low, states[i, k]), fmax(high, states[i, k])
            seen += rows[1, t] - rows[0, t]
            t += 1
        if seen and scale[k] * (high - low) > most:
            axis, most = k, scale[k] * (high - low)
    return axis


cdef enum:
    SEEN = 1000  # states that choose an axis
    FEW = 12     # estimates of a step that are one cell


def near_points(const double[:, ::1] truth, const double[:, ::1] estimate,
                const int64_t[:, ::1] truth_rows, const int64_t[:, ::1] estimate_rows,
                double cutoff, int power, const double[::1] scale, Py_ssize_t most):
    """Near pairs of finite points of some steps, and their distances; None if that took too long.

    The estimates of a step are sorted into cells along one axis, as wide as the cutoff; those of
    three cells are compared. Rows of a step are [begin, end) of (2, steps). Rows of pairs are
    counted from the first of the first step, without those of other steps. `most` is the number of
    pairs that are compared.
    """
    cdef Py_ssize_t T = truth_rows.shape[1], d = truth.shape[1], t, i, j, k, count = 0, n = 0
    cdef Py_ssize_t first = 0, second = 0  # rows of the steps before
    cdef Py_ssize_t own, low, size, cells, truths = 0, estimates = 0, longest = 0
    cdef double value, least, width
    cdef bint near
    for t in range(T):
        truths += truth_rows[1, t] - truth_rows[0, t]
        estimates += estimate_rows[1, t] - estimate_rows[0, t]
        longest = max(longest, estimate_rows[1, t] - estimate_rows[0, t])
    cdef double[::1] room = np.empty(longest + 1)
    cdef i32[::1] places = np.empty(2 * truths + estimates + 3 * longest + 4, np.int32)
    cdef double *rank = &room[0]
    cdef i32 *begin = &places[0], *end = begin + truths, *order = end + truths
    cdef i32 *spare = order + estimates, *cell = spare + longest, *at = cell + longest
    cdef Py_ssize_t axis = widest_axis(estimate, estimate_rows, scale)
    with nogil:
        for t in range(T):
            low, size = estimate_rows[0, t], estimate_rows[1, t] - estimate_rows[0, t]
            least, value = INFINITY, -INFINITY
            for j in range(low, low + size):
                least, value = fmin(least, estimate[j, axis]), fmax(value, estimate[j, axis])
            # Quotients are exact to 2^-20: at most so many cells, and near points differ by 1.
            width = fmax(cutoff / scale[axis] * (1 + 2.0**-10), (value - least) / size)
            cells = 1
            if size > FEW and 1e-290 < width < 1e300:
                cells += <Py_ssize_t>((value - least) / width)
            memset(at, 0, (cells + 1) * sizeof(i32))
            for j in range(size):
                cell[j] = <i32>((estimate[low + j, axis] - least) / width) if cells > 1 else 0
                at[cell[j] + 1] += 1
            for k in range(cells):
                at[k + 1] += at[k]
            for i in range(truth_rows[0, t], truth_rows[1, t]):
                own = first + i - truth_rows[0, t]
                begin[own], end[own] = 0, <i32>size
                if cells > 1:
                    value = floor((truth[i, axis] - least) / width)
                    value = fmin(fmax(value, -2.0), <double>cells + 1)
                    begin[own] = at[min(max(<Py_ssize_t>value - 1, 0), cells)]
                    end[own] = at[min(max(<Py_ssize_t>value + 2, 0), cells)]
                count += end[own] - begin[own]
            for j in range(size):
                order[second + at[cell[j]]] = <i32>j
                at[cell[j]] += 1
            first, second = first + truth_rows[1, t] - truth_rows[0, t], second + size
    if count > most:
        return None
    rows_array, others_array = np.empty(count + 1, np.int32), np.empty(count + 1, np.int32)
    distance_array = np.empty(count + 1)
    cdef i32[::1] rows = rows_array, others = others_array
    cdef double[::1] distance = distance_array
    with nogil:
        first = second = 0
        for j in range(longest):
            rank[j] = -<double>j
        for t in range(T):
            low, size = estimate_rows[0, t], estimate_rows[1, t] - estimate_rows[0, t]
            for i in range(truth_rows[0, t], truth_rows[1, t]):
                own = first + i - truth_rows[0, t]
                # Without a branch, which nobody foresees: what is not near is written over.
                count = n
                for j in range(begin[own], end[own]):
                    near = True
                    for k in range(d):
                        near &= scale[k] * fabs(truth[i, k] - estimate[low + order[second + j], k]
                                                ) < cutoff
                    others[count] = order[second + j]
                    count += near
                if size > FEW:
                    sort_down(rank, &others[n], spare, count - n)
                for k in range(n, count):
                    j = others[k]
                    value = apart(&truth[i, 0], &estimate[low + j, 0], &scale[0], d, power, cutoff)
                    rows[n] = <i32>own
                    others[n] = <i32>(second + j)
                    distance[n] = value
                    n += value < cutoff
            first, second = first + truth_rows[1, t] - truth_rows[0, t], second + size
    return rows_array[:n], others_array[:n], distance_array[:n]


def nearest_points(const double[:, ::1] truth, const double[:, ::1] estimate,
                   const int64_t[:, ::1] truth_rows, const int64_t[:, ::1] estimate_rows,
                   int power, const double[::1] scale, Py_ssize_t sampled):
    """Distances of some truths of some steps, all with estimates, to the nearest estimate.

    Of each step every so many-th truth is looked at that there are up to `sampled` of them.
    """
    cdef Py_ssize_t T = truth_rows.shape[1], d = truth.shape[1], t, i, j, n = 0, count, by
    cdef double value, best
    found_array = np.empty(T * sampled)
    cdef double[::1] found = found_array
    with nogil:
        for t in range(T):
            count = truth_rows[1, t] - truth_rows[0, t]
            by = (count + sampled - 1) // sampled
            i = truth_rows[0, t]
            while i < truth_rows[1, t]:
                best = INFINITY
                for j in range(estimate_rows[0, t], estimate_rows[1, t]):
                    value = apart(&truth[i, 0], &estimate[j, 0], &scale[0], d, power, best)
                    best = value if value < best else best
                found[n] = best
                n += 1
                i += by
    return found_array[:n]


cdef void sort_down(const double* key, i32* at, i32* room, Py_ssize_t n) noexcept nogil:
    """Positions by falling keys, of equal ones in the order in which they come: a merge sort."""
    cdef Py_ssize_t half = n // 2, k, m, left = 0, right = half
    cdef i32 own
    if n <= 16:
        for k in range(1, n):
            own, m = at[k], k
            while m > 0 and key[at[m - 1]] < key[own]:
                at[m] = at[m - 1]
                m -= 1
            at[m] = own
        return
    sort_down(key, at, room, half)
    sort_down(key, at + half, room, n - half)
    if key[at[half - 1]] >= key[at[half]]:
        return
    memcpy(room, at, n * sizeof(i32))
    for k in range(n):
        if right == n or (left < half and key[room[left]] >= key[room[right]]):
            at[k] = room[left]
            left += 1
        else:
            at[k] = room[right]
            right += 1


def largest_gains(const i32[::1] truth_step, const i32[::1] estimate_step, const i32[::1] truth,
                  const i32[::1] estimate, const double[::1] gain, Py_ssize_t steps):
    """As if each truth, or each estimate, had its largest gain: the less of both (steps,)."""
    cdef Py_ssize_t m = truth_step.shape[0], n = estimate_step.shape[0], a
    cdef double[::1] best = np.zeros(m + n)
    cdef double[::1] other = np.zeros(steps)
    found_array = np.zeros(steps)
    cdef double[::1] found = found_array
    with nogil:
        for a in range(gain.shape[0]):
            best[truth[a]] = fmax(best[truth[a]], gain[a])
            best[m + estimate[a]] = fmax(best[m + estimate[a]], gain[a])
        for a in range(m):
            found[truth_step[a]] += best[a]
        for a in range(n):
            other[estimate_step[a]] += best[m + a]
        for a in range(steps):
            found[a] = other[a] if other[a] < found[a] else found[a]
    return found_array


def pair_off(const i32[::1] truth_step, Py_ssize_t estimates, const i32[::1] truth,
             const i32[::1] estimate, const double[::1] gain, Py_ssize_t steps):
    """What a greedy choice of pairs gains at each step, and the round in which each is chosen.

    Pairs (N,) are in order of truth and estimate; 0 is the round of those that are not chosen.
    """
    cdef Py_ssize_t N = gain.shape[0], m = truth_step.shape[0], begin = 0, end, a, count, kept
    cdef i32 t, p, q, turn
    found_array, turn_array = np.zeros(steps), np.zeros(N, np.int32)
    cdef double[::1] found = found_array
    cdef i32[::1] turns = turn_array
    cdef i32[::1] head = np.empty(m + estimates, np.int32)  # best pair that is left of each
    cdef i32[::1] room = np.empty(2 * N + 1, np.int32)
    cdef i32* left = &room[0]
    with nogil:
        while begin < N:
            t = truth_step[truth[begin]]
            end = begin
            while end < N and truth_step[truth[end]] == t:
                left[end - begin] = <i32>end
                end += 1
            count, turn = end - begin, 0
            sort_down(&gain[0], left, left + N, count)
            while count:
                turn += 1
                for a in range(count - 1, -1, -1):
                    head[truth[left[a]]] = head[m + estimate[left[a]]] = left[a]
                for a in range(count):
                    p = left[a]
                    if head[truth[p]] == p and head[m + estimate[p]] == p:
                        turns[p] = turn
                        found[t] += gain[p]
                kept = 0
                for a in range(count):
                    p = head[truth[left[a]]]
                    q = head[m + estimate[left[a]]]
                    if turns[p] == 0 and turns[q] == 0:
                        left[kept] = left[a]
                        kept += 1
                count = kept
            begin = end
    return found_array, turn_array


# --- hashes of rows: the twin is in tracks.judged ------------------------------------------------


def hash_rows(const uint64_t[::1] moments, const uint64_t[:, ::1] ids, const i32[::1] step,
              const i32[::1] track, tables, const uint64_t[:, ::1] lanes):
    """Sums of hashes of all rows, one for each lane; `tables` (R, n) hold what else is hashed."""
    cdef Py_ssize_t R = step.shape[0], first, last, r, c, k
    cdef uint64_t[::1] mixed = np.empty(min(R, 4096), np.uint64)
    cdef const uint64_t[:, :] table
    cdef uint64_t lane, one, total
    sums = []
    for k in range(lanes.shape[0]):
        lane, total, first = lanes[k, 0], 0, 0
        while first < R:
            last = min(first + 4096, R)
            for r in range(first, last):
                one = moments[step[r]] * lane
                mixed[r - first] = ((one ^ (one >> 32)) ^ ids[track[r], k]) * lane
            for table in tables:
                for r in range(first, last):
                    one = mixed[r - first]
                    for c in range(table.shape[1]):
                        one = ((one ^ (one >> 32)) ^ table[r, c]) * lane
                    mixed[r - first] = one
            for r in range(first, last):
                one = mixed[r - first]
                one = (one ^ (one >> 32)) * lane
                one = (one ^ (one >> 32)) * lane
                total += one ^ (one >> 32)
            first = last
        sums.append(total)
    return sums
