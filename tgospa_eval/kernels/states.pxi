# Reduced states: merging, slots, exact sums, gains, and the certificate.


# --- sums in NumPy's order ---------------------------------------------------------------------


cdef double pairwise(const double* value, Py_ssize_t size) noexcept nogil:
    """Return the sum in the order of NumPy, in which rounding hardly grows.

    Both halves are summed separately, and short pieces by eight parallel sums.
    """
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


# --- merging of runs: the twins are in problem.states ---------------------------------------------


cdef void sort_by(const i32[::1] key, i32[::1] at, i32[::1] order) noexcept nogil:
    """Write the positions, sorted by (key, position), to `order`: a counting sort.

    `at` must be zeros at first, with one entry more than there are keys. Afterwards its entry k is
    the end of the key k in `order`.
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
    """Return the pair of each entry, and the truth and the estimate of each pair.

    Pairs are numbered by truth, then by their first entry. The entries of one true object are
    visited together, so that each estimate needs one mark only.
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
    """Return, for each node, the smallest node of its component (union-find, path halving)."""
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
    """Return pairs, nodes and blocks from truth, estimate and step of each entry, in time order.

    The result is the pair of each entry, then the fields of `problem.states.GRAPH`, in their order.
    `transpose` is that of `problem.states.merge_runs`.
    """
    pair_of, tracks, others = number_pairs(truth, estimate, truths, estimates)
    cdef const i32[::1] root = components(tracks, others + np.int32(truths), truths + estimates)
    cdef i32[::1] of_entry = pair_of
    cdef const i32[::1] pt = tracks, pe = others
    cdef Py_ssize_t P = pt.shape[0], p, i, e, nodes = truths + estimates, count = 0
    cdef i32 b, blocks = 0, total = 0
    cdef bint is_row
    cdef i32[::1] number = full_of(nodes, -1)    # index of the block with this root
    cdef i32[::1] block_of = full_of(nodes, -1)  # block of each node
    with nogil:
        for p in range(P):  # by truth, so that blocks are numbered by their first truth
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
        for b in range(blocks):  # a single estimate with several true objects is the row
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
    """Return the states, sorted by pair and time: `pair_first`, `begin`, `entry` (-1 for a run).

    `first` and `last` (P,) are the first and the last step of the window of each pair. With
    `single`, a run is divided into one state for each step. Entries must be in order of time.
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
    """Return the states, sorted by (begin, number): a stable counting sort."""
    order = np.empty(begin.shape[0], np.int32)
    cdef i32[::1] out = order
    cdef i32[::1] at = np.zeros(steps + 1, np.int32)
    with nogil:
        sort_by(begin, at, out)
    return order


def slots(const i32[::1] order, const i32[::1] begin, const i32[::1] pair_first,
          const i32[::1] pair_node, const u8[::1] shared):
    """Return the first slot of each node, the step of each slot, and the first slot of each state.

    `order` has the states in order of time. Only nodes that are `shared` by several pairs have
    slots. For other nodes, the first slot of a state is the index where slots of the node would be.
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
    """Return the states, sorted by (row, begin, number), and where each node begins.

    The shapes are (S,) and (nodes + 1,).
    """
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


# --- exact sums over slots: the twins are in problem.states, with the same bits -------------------
#
# Sums over all slots may overflow, but their differences are right: arithmetic is unsigned.


def slot_sums(const i32[::1] first, const i32[::1] begin, const i32[::1] pair_first,
              const i32[::1] pair_node, const int64_t[::1] weight):
    """Return the sum of integer weights (S,) of the states over each slot, (K,): `Slots.sums`."""
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
    """Return the sum of the weights (S,) of the states over each slot, (K,): `Slots.loads`."""
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
    """Return sums of rounded ``value / unit`` before each slot, (K + 1,): `exact_running`."""
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
    """Return the sum over the slots of each state, (S,), from running sums: `Slots.spans`."""
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
    """Add a part to the sum `total` + `rest`; `rest` receives the rounding of `total` (Knuth)."""
    cdef double new = total[0] + part
    cdef double got = new - total[0]
    rest[0] += (total[0] - (new - got)) + (part - got)
    total[0] = new


def relative_gains(const i32[::1] row_first, const i32[::1] order, const i32[::1] begin,
                   const i32[::1] entry, const double[::1] cost, double price,
                   const double[::1] prices=None):
    """Return gains relative to the cheapest pair of each group, and the gain r of this pair.

    A *group* is the set of states of a row that begin together. "best" is its cheapest pair, and
    its *offset* is the gain ``r = (A + B - D)_best``. The relative gain of a state is computed as
    ``G - r = (D_best - D) + (A + B) - (A + B)_best``, because these differences keep digits that
    gains near 1 lose. The relative gain of a run is minus the sum of the offsets of all its steps.
    `row_forward` subtracts the offsets also from the value of "none".

    Parameters
    ----------
    price : float
        Cost of leaving both objects of an entry unassigned, if it is the same for all entries.
    prices : (N,) float array, optional
        The same cost for each entry, used instead of `price`.

    Returns
    -------
    gain : (S,) float array
        The gain G - r of each state.
    group_first : (nodes + 1,) int array
        The first group of each row.
    offset : (G,) float array
        The offset r of each group.
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
    # Sum of the offsets before the group of a state, in two parts.
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


# --- assignments of one step: the twin is solvers.trivial._assign, with the same choice of equals --


cdef void cheapest(const double* cost, Py_ssize_t rows, Py_ssize_t columns, double* work,
                   i32* index) noexcept nogil:
    """Assign every row to a column at the least cost, by shortest augmenting paths.

    There must be at least as many columns as rows. The operations are those of
    scipy.optimize.linear_sum_assignment (Crouse, 2016). Afterwards `index` begins with the column
    of each row. `work` has room for rows + 2 columns, `index` for 2 (rows + columns).
    """
    cdef double* u = work
    cdef double* v = work + rows
    cdef double* distance = v + columns
    cdef i32* column_of = index
    cdef i32* row_of = index + rows
    cdef i32* path = row_of + columns
    cdef i32* left = path + columns
    cdef i32* through = left + columns
    cdef Py_ssize_t i, j, n, row, count, best, visited
    cdef double least, lowest, length
    memset(work, 0, (rows + columns) * sizeof(double))
    for n in range(rows + columns):
        index[n] = -1
    for row in range(rows):
        for n in range(columns):
            left[n] = <i32>(columns - n - 1)
            distance[n] = INFINITY
        count, i, j, least, visited = columns, row, -1, 0.0, 0
        while True:
            through[visited] = <i32>i
            visited += 1
            best, lowest = -1, INFINITY
            for n in range(count):
                j = left[n]
                length = least + cost[i * columns + j] - u[i] - v[j]
                if length < distance[j]:
                    path[j], distance[j] = <i32>i, length
                if distance[j] < lowest or (distance[j] == lowest and row_of[j] == -1):
                    lowest, best = distance[j], n
            least, j = lowest, left[best]
            count -= 1
            left[best], left[count] = left[count], <i32>j  # used columns come last
            if row_of[j] == -1:
                break
            i = row_of[j]
        u[row] += least
        for n in range(1, visited):
            i = through[n]
            u[i] += least - distance[column_of[i]]
        for n in range(count, columns):
            v[left[n]] -= least - distance[left[n]]
        while True:
            i = path[j]
            row_of[j] = <i32>i
            n, column_of[i] = column_of[i], <i32>j
            j = n
            if i == row:
                break


def assign(const i32[::1] first, const i32[::1] row, const i32[::1] rows,
           const i32[::1] column, const i32[::1] columns, const double[::1] gain):
    """Return whether each pair is assigned, and the lowest price of its column.

    Component b has rows[b] rows, columns[b] columns, and the pairs from first[b] on. `row` and
    `column` of a pair are counted from 0 in its component.
    """
    cdef Py_ssize_t b, e, i, j, m, n, turn, fewer
    cdef bint turned, moves
    cdef double have
    sizes = np.asarray(rows, np.int64), np.asarray(columns, np.int64)
    cdef Py_ssize_t most = max(sum(sizes), default=0)
    dense = np.empty((2, max(sizes[0] * sizes[1], default=0)))
    cdef double[:, ::1] matrix = dense
    cdef double[::1] work = np.empty(3 * most)
    cdef i32[::1] index = np.empty(4 * most, np.int32)
    cdef i32[::1] own = np.empty(most, np.int32), owner = np.empty(most, np.int32)
    taken, price = np.zeros(len(gain), np.uint8), np.zeros(len(gain))
    cdef u8[::1] t = taken
    cdef double[::1] p = price
    cdef double* at
    cdef double* new
    with nogil:
        for b in range(rows.shape[0]):
            m, n = rows[b], columns[b]
            turned = n < m
            fewer = n if turned else m
            at = &matrix[0, 0]
            memset(at, 0, m * n * sizeof(double))
            for e in range(first[b], first[b + 1]):
                at[row[e] * n + column[e]] = gain[e]
            for i in range(m):
                for j in range(n):
                    matrix[1, j * m + i if turned else i * n + j] = -at[i * n + j]
            cheapest(&matrix[1, 0], fewer, m + n - fewer, &work[0], &index[0])
            for i in range(m):
                own[i] = -1
            for j in range(n):
                owner[j] = -1
            for e in range(fewer):
                i = index[e] if turned else e
                j = e if turned else index[e]
                if at[i * n + j] > 0:
                    own[i], owner[j] = <i32>j, <i32>i
            new = &work[n]
            memset(&work[0], 0, n * sizeof(double))
            for turn in range(m + 1):
                moves = False
                memset(new, 0, n * sizeof(double))
                for i in range(m):
                    have = at[i * n + own[i]] - work[own[i]] if own[i] >= 0 else 0.0
                    for j in range(n):
                        if at[i * n + j] - have > new[j] and owner[j] != i:
                            new[j] = at[i * n + j] - have
                for j in range(n):
                    moves |= owner[j] >= 0 and new[j] > work[j] + 1e-15
                if not moves:
                    break
                for j in range(n):
                    if owner[j] >= 0 and new[j] > work[j]:
                        work[j] = new[j]
            for e in range(first[b], first[b + 1]):
                t[e] = own[row[e]] == column[e]
                p[e] = work[column[e]]
    return taken.view(bool), price


# --- the certificate: the twins are in problem.paths and problem.certificate, with the same bits --
#
# No solver calls these functions. Of the functions above, they call only `sort_by` and `pairwise`.


cdef inline double up(double value) noexcept nogil:
    """Return the next larger double; `nextafter` of the library is several times slower."""
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
    """Return `problem.paths.Gains`, except for runs (see `run_gains`), if all A + B are `base`.

    `group` (S,) is the index of the group of each state: its row and the step at which it begins.
    `price` (S,) is the price of each state.
    """
    cdef Py_ssize_t S = entry.shape[0], s, b, g
    cdef double loss, d
    relative_array, offset_array = np.empty(S), np.empty(groups)
    best_array = np.empty(groups, np.int64)
    cdef double[::1] relative = relative_array, offset = offset_array
    cdef int64_t[::1] best = best_array
    with nogil:
        for g in range(groups):
            best[g], offset[g] = -1, 0.0  # until the next loop, `offset` has the least loss
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
    """Return an upper bound of the value of the best path of each row, (nodes,): `best_values`.

    `group` (S,) is the index of the group of each state (row and begin), and `group_first`
    (nodes + 1,) the first group of each row. `switch_price` has one number, or one for each step.
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
    """Fill in the relative gains of runs, ``-v - sum r``, as `problem.paths.relative_gains`.

    `first` and `begin` are those of the slots of rows. `sums` has the running sums of the offsets r
    over these slots, in the `unit` of each node.
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
    """Return the cost of the best pair of each group, or 0; lower `left` by 1 at its column slot.

    `best` (G,) is that of `Gains`, and `group` (S,) comes from `row_steps`. `first`, `begin`,
    `pair_first` and `pair_node` are those of the columns.
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
    """Return ``-sum (left v)`` of the slots of each node, rounded down, in two halves, (2, nodes).

    Prices are `unit` times the differences of `sums`; the halves prevent overflow.
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
    """Terms of a cost, added in groups of 64: `problem.certificate._in_chunks`."""

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


def break_down(states, const int64_t[::1] weight, int64_t one, bounds):
    """Return the sums of `problem.certificate.break_down`, for parts without a common pair.

    `bounds` has three arrays: the first pair, the first truth row and the first estimate row of
    each part, and at the end their numbers.

    Returns
    -------
    costs : (6, T) float array
        Localisation, missed, false, missed count, false count, variation.
    terms : list of lists of float
        Partial sums of the total of each part.
    """
    problem = states.problem
    cdef const i32[::1] begin = states.begin, entry = states.entry, pair_first = states.pair_first
    cdef const double[::1] cost = problem.cost
    cdef const double[::1] switch_price = problem.switch_price_at
    cdef const i32[::1] pairs = bounds[0], rows
    cdef const i32[::1] row, step
    cdef const double[:] price
    cdef Py_ssize_t s, e, p, steps = problem.steps, side, i, part
    cdef double whole = one, share, paid
    cdef int64_t rise
    cdef int64_t[::1] free
    costs = np.zeros((6, steps))
    cdef double[:, ::1] at = costs
    cdef Terms terms = Terms(2 * begin.shape[0] + len(problem.truth_step)
                             + len(problem.estimate_step) + 256 * len(pairs))
    ends = []
    sides = []
    for objects in problem.sides:
        left = full_of(len(objects.step), one, np.int64)
        row, free = objects.row.astype(np.int32, copy=False), left
        with nogil:
            for s in range(begin.shape[0]):
                e = entry[s]
                if e >= 0 and weight[s]:
                    free[row[e]] -= weight[s]
        if objects.unjudged is not None:
            left[objects.unjudged] = 0
        sides.append((left, objects.step.astype(np.int32, copy=False), objects.price))
    for part in range(pairs.shape[0] - 1):
        with nogil:
            for s in range(pair_first[pairs[part]], pair_first[pairs[part + 1]]):
                e = entry[s]
                if e >= 0 and weight[s]:
                    paid = <double>weight[s] / whole * cost[e]
                    at[0, begin[s]] += paid
                    terms.add(paid)
            terms.close()
        for side in range(2):
            free, step, price = sides[side]
            rows = bounds[1 + side]
            with nogil:
                for i in range(rows[part], rows[part + 1]):
                    if free[i]:
                        share = <double>free[i] / whole
                        at[3 + side, step[i]] += share
                        paid = share * price[i]
                        at[1 + side, step[i]] += paid
                        terms.add(paid)
                terms.close()
        with nogil:
            for p in range(pairs[part], pairs[part + 1]):
                for s in range(pair_first[p] + 1, pair_first[p + 1]):
                    rise = weight[s] - weight[s - 1]
                    if rise:
                        share = <double>(rise if rise > 0 else -rise) / whole
                        at[5, begin[s]] += share
                        terms.add(switch_price[begin[s]] * share)
            terms.close()
        ends.append(terms.count)
    sums = np.asarray(terms.sums[:terms.count]).tolist()
    return costs, [sums[low:high] for low, high in zip([0, *ends], ends)]
