# Kernels of the solvers: best paths, bounds, entropic sweeps.


# --- best paths: the twin is problem.paths.best_values ------------------------------------------


cdef class Layout:
    """The states of some blocks by row and time, their relative gains, and their column slots.

    Parameters
    ----------
    states : States
        The blocks.
    switch_price : (T + 1,) float array
        Result of `Problem.switch_price_at`, maybe lowered to a limit.
    price, prices
        See `relative_gains`.

    Attributes
    ----------
    row_first, order, begin : arrays
        Results of `by_row`, and the first step of each state.
    gain, group_first, offset : arrays
        Results of `relative_gains`.
    rows, columns : (R,), (C,) int arrays
        Nodes of the open blocks, which `keep` chooses.
    """

    cdef readonly object gain, group_first, offset, rows, columns
    cdef const i32[::1] order, row_first, begin, entry, window_end, groups, row, column, block
    cdef const u8[::1] open
    cdef const i32[::1] column_first, slot_step, slot_begin, slot_end
    cdef const double[::1] switch_price, gains, offsets
    cdef Py_ssize_t longest, widest  # largest number of states, and of pairs, of a row
    cdef double[::1] before, lost    # room for intermediate results. It is made only once:
    cdef double[:, ::1] room         # making it takes as long as solving a small problem
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
        """Continue with these blocks, (B,): write their nodes to `rows` and `columns`."""
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
    Py_ssize_t low, high         # range of its states
    const i32 *order             # the states in order of time, and the first step of each state
    const i32 *begin
    const double *switch_price
    const double *offset         # offsets of its groups


cdef struct Paths:
    double* value                # for each state of one row: its gain minus its price,
    double* forward              # and results of `row_forward` and `row_backward`
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
    """Compute the best path up to each state of one row: its value, and its state before (or -1).

    `problem.paths.best_values` has the equations of the values F_s and h. For each state,
    `forward` is F_s - h, and `none` + `rest` is h at this time. Two doubles for h keep all digits
    in long recordings. Return the value of the best path, and write its last state to `final`.
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
    """Add to `at`, for each step, what the assignment of one row loses there against its best path.

    The losses are the reduced costs of the transitions that the assignment uses, computed from the
    values of `row_forward`. Each loss is >= 0, and their sum is the regret of the row. `weight`
    points to the first state of the row, and `at` to the first step.
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
    """Compute ``slack_s = best - (F_s + B_s)``, the loss of the best path through each state.

    B_s is the value of the best way to continue after state s, and h that after "none". Backward in
    time, ``h = max(h, value_s + B_s - lambda)`` and ``B_before = max(value_s + B_s, h - lambda)``.
    On input, `none` is that of `row_forward`, and `forward` is F: the `forward` of `row_forward`
    plus `none`. On output, `none` is the loss of the best path that is at "none" when the state
    begins.
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
    NEEDED = 2   # being at "none" when this state begins costs more than the reach
    LOSES = 4    # slack of more than rounding
    BEST = 8     # on the best path of `row_forward`
    TEMPTED = 16 # hardly any slack
    MAJORITY = 32    # on the best path, or more than half of the row in the last sweeps
cdef double REGRET = SUM_ERROR
cdef double HARDLY = 1e-6
globals().update(NEAR=NEAR, NEEDED=NEEDED, LOSES=LOSES, BEST=BEST, TEMPTED=TEMPTED, MAJORITY=MAJORITY)


cdef void run_up(Layout layout, const double* price) noexcept nogil:
    """Sum the prices before each slot of a column; two doubles keep digits in long recordings."""
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
    """Return the value of the assignment of one row.

    It is the sum of weight times value, minus the cost of changes, and minus the offsets where the
    row is at "none". `value` and `weight` point to the first state of the row.
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
    """Write feasible weights: 1 for MAJORITY states whose row and slots are free, 0 for others.

    `load` (K,) must be zeros at first, and becomes the number of rows on each column slot.
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
    """Give each row in turn its best path through slots without other rows; count improvements.

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
            # Sums in another order differ in the last digit, which is not an improvement.
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
    """The best prices and the best assignment of each block so far, and both bounds.

    A *survey* computes the best path of each row at some prices. Sums by block are 0 in blocks that
    are not open.

    Parameters
    ----------
    layout : Layout
        The blocks, and which of them are open.
    weights, prices : (S,), (K,) float arrays
        Arrays for the best weights and prices.
    rounding : float
        Error of a sum of prices along a path, as a fraction of the sum of all prices.

    Attributes
    ----------
    dual, primal : (B,), (B,) float arrays
        Upper bound of the gain of each block by the prices, and gain of the assignment.
    most : (B,) float array
        Gain at which a block would cost 0: its unassigned cost minus offsets. The caller sets it.
    flags, chosen : (S,), (S,) uint8 arrays
        Marks of each state by the last `mark` or `choose`, and the last working set.
    best, own : (nodes,), (nodes,) float arrays
        Value of the best path of each row, and of an assignment, by the last survey.
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
        """Return the bound of each block at the prices of the last survey, (B,)."""
        with nogil:
            self._bound(&prices[0])
        return np.array(self.found)

    def mark(self, const double[::1] prices, double reach):
        """Set the `flags` of every state, and the values `own` of the best weights, at `prices`."""
        with nogil:
            self._survey(&prices[0], True, reach, NULL)

    def regrets(self, const double[::1] prices, double[::1] lost):
        """Add to `lost` (T + 1,), at each step, what the best weights lose against best paths."""
        with nogil:
            self._survey(&prices[0], False, 0.0, &lost[0])

    def try_prices(self, const double[::1] prices):
        """Keep the prices in those open blocks in which they prove more than the prices so far."""
        with nogil:
            self._take_prices(&prices[0])

    def try_above(self, const double[::1] prices, double least, double gap):
        """Try the prices, with 0 for those up to `least`; return whether a bracket is too wide."""
        cdef Py_ssize_t t
        cdef bint wide
        cdef bint fresh = False
        cdef double price
        with nogil:
            for t in range(prices.shape[0]):
                price = prices[t] if prices[t] > least else 0.0
                fresh = fresh or price != self.trial[t]
                self.trial[t] = price
            if fresh:  # otherwise they were tried before, in the same blocks or more
                self._take_prices(&self.trial[0])
            wide = False
            for t in range(self.duals.shape[0]):
                wide = wide or self._is_wide(t, gap)
        return wide

    def choose(self, const double[::1] prices, double reach):
        """Mark the states, and write the working set within reach to `chosen`."""
        with nogil:
            self._survey(&prices[0], True, reach, NULL)
            memset(&self.choice[0], 0, self.choice.shape[0])
            working_set(self.layout, &self.weight[0], &prices[0], &self.flag[0], &self.choice[0])

    cdef void _survey(self, const double* price, bint judge, double reach,
                      double* regret) noexcept nogil:
        """Compute the value of the best path of each row at the prices.

        The price of a state is the sum over its slots, from running sums in each column. With
        `judge`, also set the `flags` of each state, and the value `own` of the best assignment at
        the prices, minus the cost of its changes. If `regret` is not NULL, the losses of this
        assignment against the best paths are added to it, step by step.
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
        """Write the sum of the prices of each block to `found`; it is rounded as by `sum_parts`."""
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
            if high == K:  # `sum_parts` adds a 0 after the last price
                memcpy(last, price + low, (high - low) * sizeof(double))
                last[high - low] = 0.0
                total[self.layout.block[i]] += last[0] + pairwise(last + 1, high - low)
            else:
                total[self.layout.block[i]] += price[low] + pairwise(price + low + 1, high - low - 1)

    cdef void _bound(self, const double* price) noexcept nogil:
        """Write the bound of each block to `found`, after a survey at the prices."""
        cdef Py_ssize_t b
        self._pay(price)
        for b in range(self.found.shape[0]):  # add the rounding of the values of paths
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
        """Return the gain of a feasible assignment in each block, (B,)."""
        with nogil:
            self._value(&weights[0])
        return np.array(self.found)

    def try_weights(self, const double[::1] weights):
        """Keep the feasible weights in those open blocks in which they gain more than before."""
        with nogil:
            self._value(&weights[0])
            self._take_weights(&weights[0])

    def round(self, int rounds):
        """Try weights 0 and 1: from MAJORITY, then improved row by row up to `rounds` times."""
        cdef u8* rounded = &self.rounded[0]
        cdef i32* load = <i32*>&self.layout.before[0]  # its sums are no longer needed
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
        """Write the gain of an assignment in each block to `found`, by the gains of the layout."""
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
        """Return the open blocks with a bracket wider than the gap, relative to the cost, (B,)."""
        found = np.zeros(self.found.shape[0], bool)
        cdef u8[::1] wider = found.view(np.uint8)
        cdef Py_ssize_t b
        for b in range(wider.shape[0]):
            wider[b] = self._is_wide(b, gap)
        return found

    def only_rounding(self, double gap):
        """Return whether there is a wide bracket whose width is mostly the rounding of prices."""
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
        """Sum of the bounds of the open blocks, added in NumPy's order."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = self.duals[b]
                n += 1
        return pairwise(&self.part[0], n)

    @property
    def open_gap(self):
        """Total width of the brackets of the open blocks."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = self.duals[b] - self.primals[b]
                n += 1
        return pairwise(&self.part[0], n)

    @property
    def open_cost(self):
        """Total cost of the best assignment of the open blocks."""
        cdef Py_ssize_t b, n = 0
        for b in range(self.duals.shape[0]):
            if self.layout.open[b]:
                self.part[n] = fmax(self.mosts[b] - self.primals[b], 0.0)
                n += 1
        return pairwise(&self.part[0], n)


def row_potentials(const i32[::1] order, const i32[::1] row, const i32[::1] first,
                   const i32[::1] low, const i32[::1] high, const double[::1] value,
                   const double[::1] leave, const u8[::1] follows):
    """Compute best values of paths through the free states of a programme, forward in time.

    A row has *borders* before, between and after its constraints, numbered row by row: `first`
    (rows + 1,) is the first border of each row. A state reaches from its border `low` to its border
    `high`. The two are equal for a state without a constraint, at the end of the state before it.
    `order` has the states, sorted by (high, index). If `follows` is true, a path can come directly
    from the state before. Return the value of "none" at each border, and for each state its value
    at its end minus that of "none", limited to [-leave, leave].
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


# --- entropic sweeps ------------------------------------------------------------------------------

cdef enum:
    INSIDE = 1   # link: its state continues from the link before, without an entry between them
    GOES_ON = 2  # link: its state continues with the next link, without an exit between them
    FIRST = 4    # node: the window begins
    CERTAIN = 8    # node and state: before it the row was surely in this pair
    FINAL = 16   # node and state: after it the row is surely in this pair
    FREE = 8     # number of constraints that mean "no price"; links use them in turn, to sum faster


cdef void working_set(Layout layout, const double* weight, const double* price, const u8* flags,
                      u8* chosen) noexcept nogil:
    """Choose the states of a chain: write 1, and the bits CERTAIN and FINAL next to gaps.

    States with the flag NEAR or with a weight are chosen, with two exceptions
    (docs/theory/solvers.md, "Working set"):

    - Rows without competition are left out.
    - If a row has only one option for some steps, and no other row competes for it, only the first
      and the last of these states are chosen. Between the two is a *gap*.
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
        # A state is sure (2) if, while it lasts, its row has no other chosen state and cannot be at
        # "none", and its column has no rival.
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
        # A sure state is left out (3) unless a neighbour in time is not sure.
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
    """Return whether leaving the state costs more than the reach, and its column has no rival."""
    return flags[s] & (NEAR | NEEDED) == (NEAR | NEEDED) and (
        rivals[slot_end[s]] == rivals[slot_begin[s]])


cdef struct Walk:
    i32* held                    # states that a row could be in at a step
    i32* cursor                  # next slot for which each of these states competes
    i32* latest                  # latest link of each of these states
    i32* link_of                 # last link of each state of the row, when it ended
    const i32* slot_step
    const i32* slot_end
    const i32* constraint_of
    const i32* after
    i32* node_at                 # next node and link of each step
    i32* link_at


cdef struct AtRow:               # data of a pass on the latest node of a row: one cache line
    double none                  # mass at "none"
    double left[2]               # mass in states that continue, and in all other states
    double price                 # q at this node
    double factor[2]             # factors of the mass of a link: by way of "none", and without
    double added[2]


cdef class Chain:
    """The working set as a chain of links, and messages along it (docs/theory/solvers.md).

    A *node* is a row at a step with an event: a state of the working set begins or has just ended,
    or a stretch of slots begins for which one of its states competes. A node has a *link* for each
    state that the row could be in. Nodes are sorted by (step, row), links by node. Link 0 means
    "none before" and "none after" and has the value 0. The first constraints mean "no price".

    Parameters
    ----------
    layout : Layout
        The rows and columns that take part.
    chosen : (S,) uint8 array
        The working set, from `working_set`.
    price : (K,) float array
        Prices at the start, which `heat` subtracts from the gains.
    most : int
        Largest number of links. If more are needed, nothing is built, and `links` is their number.
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
        # One array for all intermediate results makes small chains fast.
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
        """Make all arrays, with zeros, as parts of three arrays, which makes small chains fast.

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
        """Write the stretches of slots that need a price, sorted by step.

        A *stretch* is a sequence of slots with the same chosen states. It needs a price if two
        states compete for it, or if it has a price that may fall.
        `opens` is room for 2 (K + 1) numbers; these and `constraint_of` must be zeros at first.
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
        for fill in (False, True):  # first count the stretches of each step, then write them
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
                at += 1  # below, each place advances to that of the next step
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
        """Add a node of row r at step k, with a link for each state that goes on."""
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
        """Compute K of each link and K_0 of each node at a temperature.

        ``K = exp((g - v - mu) / epsilon)`` for the gain g and the price v of a link, and ``K_0 =
        exp(-mu / epsilon)``. mu is the largest g - v of the links of a node, but at least 0.
        """
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
        """Sweep forward and backward until the violation of each column is less than `calm`.

        Returns
        -------
        done : int
            Number of sweeps.
        violation : float
            The largest violation of a column in the last sweep.
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
        """Set ``v <- max(v - epsilon log u, 0)``: move changes from factors u to prices v."""
        cdef Py_ssize_t c
        with nogil:
            for c in range(FREE, self.constraints + FREE):
                self.price[c] -= epsilon * log(self.u[c])
                if self.price[c] < 0.0:
                    self.price[c] = 0.0
                self.u[c] = 1.0

    def write_prices(self, double[::1] price):
        """Write the price of each stretch to its slots: raise the first, or lower all of them."""
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
        """Write the share of a row's paths through each state; set MAJORITY if it is above 1/2."""
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
        """Update the messages of one direction node by node, and the prices step by step.

        The equations are in docs/theory/solvers.md, "Messages": ``A_0' = a_0 + q S'`` and
        ``A_s' = (1 - q^2) a_s + q A_0'``, where S' is the sum over the states that can pass through
        "none", and q = exp(-lambda / epsilon). Factors of prices become
        ``u <- min(u (w_0 u + mass)^-3/2, 1 / w_0)``. If the messages of a node sum to a number
        outside 1e-10..1e10, they are scaled by r.
        """
        cdef Py_ssize_t step, k, n, l, c, low, high, first, last
        cdef i32 row
        cdef double r, q, none, filled, rho, part, violation = 0.0
        cdef double *ahead = &self.ahead[0], *behind = &self.behind[0]
        cdef double *none_ahead = &self.none_ahead[0], *none_behind = &self.none_behind[0]
        cdef double *kernel = &self.kernel[0], *none_kernel = &self.none_kernel[0]
        cdef double *u = &self.u[0], *slack = &self.slack[0], *cap = &self.cap[0]
        cdef double *passed = &self.passed[0], *load = &self.load[0], *stay = &self.stay[0]
        cdef double *share = &self.share[0]  # of the links of a step, times their node's total
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
            # All nodes, then all links: short loops over the links of a node are unpredictable.
            for n in range(low, high):
                here = &at[node_row[n]]
                q = here.price if reverse else stay[k]
                if q < 0.0 or ends[n] & start:  # no switch price here
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
                for n in range(low, high):  # after underflow a row is ignored until `heat`
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
                    # At most 1 / slack, at which the price is 0.
                    u[c] = cap[c] if rho > cap[c] else (1e-60 if rho < 1e-60 else rho)
            for l in range(first, last):
                part = passed[l] * u[constraint[l]]
                passed[l] = part
                at[link_row[l]].left[(kind[l] & held) == 0] += part
        return violation
