# Searches: near points, pairs chosen greedily, hashes of rows.


# --- near points, and pairs chosen greedily ------------------------------------------------------
#
# The NumPy twins are in distances.pair_search, and in points and pairing of evaluation.diagnosis.
# Their results have the same bits.


cdef inline double apart(const double* a, const double* b, const double* scale, Py_ssize_t size,
                         int power, double most) noexcept nogil:
    """Return a norm of the scaled difference of two points (power 0: the largest component).

    If the norm is `most` or more, the result is the norm, or another number of at least `most`.
    """
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
    """Return the axis on which the states of the first steps are spread the most."""
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
    SEEN = 1000  # number of states by which an axis is chosen
    FEW = 12     # number of estimates of a step up to which they are one cell


def near_points(const double[:, ::1] truth, const double[:, ::1] estimate,
                const int64_t[:, ::1] truth_rows, const int64_t[:, ::1] estimate_rows,
                double cutoff, int power, const double[::1] scale, Py_ssize_t most):
    """Return near pairs of points at some steps, and their distances. All points must be finite.

    The estimates of a step are sorted into cells along one axis. The cells are at least as wide as
    the cutoff. Each true object is compared with the estimates in three cells. The result is None
    if that takes more than `most` comparisons. `truth_rows` and `estimate_rows` (2, steps) have the
    first row of each step, and the row after its last row. The rows of the result are counted from
    0 among the rows of these steps.
    """
    cdef Py_ssize_t T = truth_rows.shape[1], d = truth.shape[1], t, i, j, k, count = 0, n = 0
    cdef Py_ssize_t first = 0, second = 0  # counts of rows at earlier steps
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
            # Quotients are exact to 2^-20. So there are at most `size` + 1 cells, and the cells of
            # near points differ by at most 1.
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
                # A branch would be unpredictable, so the next pair overwrites one that is not near.
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
    """Return the distances of some truth rows to the nearest estimate of their step.

    At most `sampled` truth rows of each step are used, at equal intervals. Each step must have
    estimates.
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
    """Sort positions by falling keys; equal keys keep their order: a merge sort."""
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
    """Return, for each step, the smaller of two sums of largest gains, (steps,).

    One sum has the largest gain of each truth row, the other the largest gain of each estimate row.
    """
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
    """Return the gain of a greedy choice of pairs at each step, and the round of each pair.

    A round chooses every pair whose gain is the largest one left for both its rows. Then it leaves
    out all pairs of these rows. Pairs (N,) are in order of truth and estimate; the round of pairs
    that are not chosen is 0.
    """
    cdef Py_ssize_t N = gain.shape[0], m = truth_step.shape[0], begin = 0, end, a, count, kept
    cdef i32 t, p, q, turn
    found_array, turn_array = np.zeros(steps), np.zeros(N, np.int32)
    cdef double[::1] found = found_array
    cdef i32[::1] turns = turn_array
    cdef i32[::1] head = np.empty(m + estimates, np.int32)  # best remaining pair of each row
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


# --- hashes of rows: the twin is in tracks.coverage ------------------------------------------------


def hash_rows(const uint64_t[::1] moments, const uint64_t[:, ::1] ids, const i32[::1] step,
              const i32[::1] track, tables, const uint64_t[:, ::1] lanes):
    """Return the sum of the hashes of all R rows, for each of several hash functions (lanes).

    The hash of a row covers the time of its step (`moments`), the id of its track, and its values
    in `tables`, each (R, n). `lanes` has the multiplier of each function, and `ids` a number for
    each track and function.
    """
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
