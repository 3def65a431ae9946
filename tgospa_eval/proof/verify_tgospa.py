#!/usr/bin/env python3
"""Check a TGOSPA value from its proof folder: ``python verify_tgospa.py FOLDER``.

It needs Python's standard library alone, and trusts no floating-point number: a state is the
binary64 number nearest to its text, and from there on all are integers, rounded to stay true.

The metric (Garcia-Fernandez, Rahmathullah, Svensson, IEEE TSP 2020): truths i and estimates j exist
at some steps k. An assignment has weights W_ij(k) >= 0; at each step those of a truth, and those of
an estimate, sum to at most 1. It costs, in units of c^p (cutoff c, order p, switch penalty g),
    sum over existing objects of P  -  sum_ijk G_ij(k) W_ij(k)  +  L sum_ijk |W_ij(k+1) - W_ij(k)|
where P = 1/2, or 1 - rho of truths, rho of estimates, G = 1 - (d / c)^p if both exist with d < c,
else 0, L = (g / c)^p / 2. The least cost is (TGOSPA / c)^p. The folder has an assignment, which is
checked and of which the cost is an upper bound, and prices v_j(k) >= 0. For any such prices
    sum over existing objects of P  -  sum_jk v_j(k)  -  sum_i R_i
is a lower bound, where R_i is the most that truth i can gain when it pays v_j(k) for using j at k,
L for taking an estimate and L for leaving it. (Add the prices times sum_i W_ij(k) - 1 <= 0 to the
cost: it does not grow, and has one part for each truth.) R_i comes from dynamic programming.
"""

import bisect, collections, csv, decimal, hashlib, io, itertools, json, math, pathlib, sys
from fractions import Fraction

SCHEMA = "tgospa-eval/proof/1"
CLOSED = ("euclidean", "manhattan", "chebyshev", "iou")  # distances with a formula here
STATES = ("truth.csv", "estimate.csv")
MORE_BITS = 120  # of costs, beyond those of prices
DAMAGED = OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError
DAMAGED += csv.Error, RecursionError, MemoryError


class Wrong(Exception):
    """The folder does not prove what it claims."""


def number(text):
    """The binary64 number nearest to a text."""
    return Fraction(float(text))


def whole(value):
    """A value that must be an integer >= 0."""
    if not isinstance(value, int) or value < 0:
        raise Wrong(f"{value!r} must be a whole number, not below 0")
    return value


def read_table(read, proof, name, *header):
    """The rows of a table, which must be the one that was proven and have these columns."""
    if hashlib.sha256(data := read(name)).hexdigest() != proof["sha256"][name]:
        raise Wrong(f"{name} was changed after the proof was written")
    top, *rows = csv.reader(io.StringIO(data.decode("utf-8"), newline=""), strict=True)
    if top != list(header) or any(len(row) != len(header) for row in rows):
        raise ValueError(f"{name} must have the columns {', '.join(header)}, in each row")
    return rows


def power(a, b, exponent, bits):
    """(a / b)^exponent in units of 2^-bits, rounded down and rounded up."""
    double = 2 * exponent
    if a == 0:
        return 0, 0
    if double.denominator == 1 and double <= 128:
        top, base = a**double.numerator << 2 * bits, b**double.numerator
        low = math.isqrt(top // base)
        return low, low + (low * low * base < top)
    digits = 30 + (bits + max(a.bit_length() - b.bit_length() + 1, 0) * math.ceil(exponent)) // 3
    with decimal.localcontext(prec=digits, Emin=decimal.MIN_EMIN, Emax=decimal.MAX_EMAX):
        e = decimal.Decimal(float(exponent))  # exact
        value = (e * (decimal.Decimal(a) / b).ln()).exp() * 2**bits  # each step rounded correctly
        margin = decimal.Decimal("0.001")  # far above what the steps are off by
        return math.floor(value - margin), math.ceil(value + margin)


class Scene:
    """What exists when, and the cost of each pair that is nearer than the cutoff."""

    def __init__(self, read, proof):
        given = proof["parameters"]
        self.kind, self.bits = given["distance"], whole(proof["price_bits"]) + MORE_BITS
        self.cutoff, self.order = number(given["cutoff"]), number(given["order"])
        names, change = given["columns"], number(given["switch_penalty"]) / self.cutoff
        scale = [number(given.get("scale", {}).get(name, 1)) for name in names]
        turn = [s * number(given.get("periodic", {}).get(n, 0)) for n, s in zip(names, scale)]
        low = min(self.cutoff, *scale, rho := number(given.get("rho", 0.5)), 1 - rho)
        if low <= 0 or min(change, *turn) < 0 or not 1 <= self.order <= 10**4:
            raise ValueError("parameters are out of range")
        self.change = power(*change.as_integer_ratio(), self.order, self.bits - 1)  # L
        tables = [read_table(read, proof, name, "id", "t", *names) for name in STATES]
        times = [row[1] for row in itertools.chain(*tables, proof["prices"])]
        times += [t for row in proof["assignment"] for t in row[2:4]]
        self.times = sorted(set(times), key=decimal.Decimal)
        self.step = {t: k for k, t in enumerate(self.times)}
        sides, spelt = [{}, {}], set(map(decimal.Decimal, self.times))
        for side, table in zip(sides, tables):
            for name, t, *state in table:
                side[name, self.step[t]] = [s * number(x) for s, x in zip(scale, state)]
        self.all = (len(sides[0]) * (1 - rho) + len(sides[1]) * rho) * 2**self.bits
        if sum(map(len, sides)) < sum(map(len, tables)) or len(spelt) < len(self.times):
            raise ValueError("an object is there twice, or one time is spelt in two ways")
        # truth -> estimate -> [(step, cost rounded down, cost rounded up)]
        self.near = collections.defaultdict(lambda: collections.defaultdict(list))
        if self.kind in CLOSED:
            self._measure(sides, turn)
        else:
            header = ("truth", "estimate", "t", "distance")
            for truth, estimate, t, d in read_table(read, proof, "distances.csv", *header):
                k, ratio = self.step[t], number(d) / self.cutoff
                sides[0][truth, k], sides[1][estimate, k]  # both must exist
                self._add(truth, estimate, k, *ratio.as_integer_ratio(), 1)
        for costs in itertools.chain(*map(dict.values, self.near.values())):
            costs.sort()
            if any(one[0] == two[0] for one, two in itertools.pairwise(costs)):
                raise ValueError("distances.csv has a pair twice at one time")

    def _add(self, truth, estimate, k, a, b, root):
        """A pair with (d / c)^root = a / b, if that is below 1."""
        if whole(a) < b:
            self.near[truth][estimate].append((k, *power(a, b, self.order / root, self.bits)))

    def _measure(self, sides, turn):
        """All pairs of each step; points by cells as large as the cutoff."""
        every = itertools.chain(turn, [self.cutoff], *sides[0].values(), *sides[1].values())
        unit = max(x.denominator for x in every)  # powers of 2, as of all binary64 numbers
        cutoff, *turn = (int(x * unit) for x in (self.cutoff, *turn))

        def ratio(x, y):  # two integers, and what _add calls the root
            if self.kind == "iou":
                (a, b, w, h), (e, f, v, g) = x, y
                both = max(min(a + w, e + v) - max(a, e), 0) * max(min(b + h, f + g) - max(b, f), 0)
                union = whole(w) * whole(h) + whole(v) * whole(g) - both
                return (union - both) * unit, union * cutoff, 1
            d = [min((a - b) % p, (b - a) % p) if p else abs(a - b) for a, b, p in zip(x, y, turn)]
            if self.kind == "euclidean":
                return sum([a * a for a in d]), cutoff * cutoff, 2
            return (sum if self.kind == "manhattan" else max)(d), cutoff, 1

        cells = [] if self.kind == "iou" else [n for n, p in enumerate(turn) if not p][:2]
        around, room = list(itertools.product((-1, 0, 1), repeat=len(cells))), {}
        for side in (1, 0):
            for (name, k), row in sides[side].items():
                row = [x.numerator * (unit // x.denominator) for x in row]
                home = [row[n] // cutoff for n in cells]
                if side == 1:
                    room.setdefault((k, *home), []).append((name, row))
                for shift in around if side == 0 else ():
                    for other, place in room.get((k, *[a + b for a, b in zip(home, shift)]), ()):
                        self._add(name, other, k, *ratio(row, place))


def lower_bound(scene, proof):
    """From the prices, in units of 2^-bits c^p."""
    paid = collections.defaultdict(lambda: ([], [0]))  # steps with a price, sums of prices so far
    prices = ((scene.step[t], name, whole(price)) for name, t, price in proof["prices"])
    for k, name, price in sorted(prices):
        paid[name][0].append(k)
        paid[name][1].append(paid[name][1][-1] + (price << MORE_BITS))
    one, leave = 1 << scene.bits, scene.change[0]
    bound = math.floor(scene.all) - sum(sums[-1] for _, sums in paid.values())
    for costs in scene.near.values():
        # Most gained so far, without the prices, by who is with an estimate; it is there from the
        # first step at no cost but the prices. Prices are >= 0: nobody enters before a gain.
        held, free = dict.fromkeys(costs, 0), 0
        gains = sorted((k, name, one - cost) for name, of in costs.items() for k, cost, _ in of)
        for _, group in itertools.groupby(gains, lambda gain: gain[0]):
            best = free
            for k, name, gain in group:
                steps, sums = paid[name]
                before, now = sums[bisect.bisect_left(steps, k)], sums[bisect.bisect(steps, k)]
                value = gain + max(held[name] - now, free - leave - (now - before))
                held[name] = value + now
                best = max(best, value - leave)
            free = best
        bound -= max(free, *(value - paid[name][1][-1] for name, value in held.items()))
    return max(bound, 0)


def upper_bound(scene, proof):
    """The cost of the assignment, in units of 2^-bits c^p / weight_unit."""
    unit, one, saved = whole(proof["weight_unit"]), 1 << scene.bits, 0
    loads, changes = (collections.defaultdict(collections.Counter) for _ in range(2))
    for truth, estimate, first, last, weight in proof["assignment"]:
        begin, end = scene.step[first], scene.step[last] + 1
        whole(end - begin - 1)
        for k, change in ((begin, whole(weight)), (end, -weight)):
            for key in (("truth", truth), ("estimate", estimate)):
                loads[key][k] += change  # of the sum of its weights
            changes[truth, estimate][k] += change
        costs = scene.near[truth][estimate]
        for place in range(bisect.bisect_left(costs, (begin,)), bisect.bisect_left(costs, (end,))):
            saved += (one - costs[place][2]) * weight
    for (side, name), load in loads.items():
        for k, total in zip(sorted(load), itertools.accumulate(load[k] for k in sorted(load))):
            if not 0 <= total <= unit:
                raise Wrong(f"{side} {name} is assigned more than once at t = {scene.times[k]}")
    moved = sum(abs(of[k]) for of in changes.values() for k in of if 0 < k < len(scene.times))
    return math.ceil(scene.all) * unit - saved + scene.change[1] * moved


def found_bounds(read, proof):
    """Proven bounds of the total cost, and of TGOSPA, as decimals widened by 1e-45."""
    scene = Scene(read, proof)
    bounds = (lower_bound(scene, proof), 1), (upper_bound(scene, proof), proof["weight_unit"])
    with decimal.localcontext(prec=80, Emin=decimal.MIN_EMIN, Emax=decimal.MAX_EMAX):
        cutoff, order = decimal.Decimal(float(scene.cutoff)), decimal.Decimal(float(scene.order))
        scale = (order * cutoff.ln()).exp() / 2**scene.bits
        wide = 1 - decimal.Decimal("1e-45"), 1 + decimal.Decimal("1e-45")
        totals = [scale * bound / unit * w for (bound, unit), w in zip(bounds, wide)]
        roots = [total and (total.ln() / order).exp() * w for total, w in zip(totals, wide)]
    return totals, roots


def rounded(bounds):
    """Two bounds as texts of 17 digits, rounded outward."""
    down, up = (decimal.Context(17, way) for way in (decimal.ROUND_FLOOR, decimal.ROUND_CEILING))
    return [str(down.plus(bounds[0] or 0)), str(up.plus(bounds[1] or 0))]


def verify(read):
    """What was found, in a line; raises `Wrong` if the claim does not hold."""
    text = read("proof.json")  # an object with a name twice is none: which of the two counts?
    proof = json.loads(text, object_pairs_hook=lambda o: dict(o) if len(dict(o)) == len(o) else 0)
    if proof["schema"] != SCHEMA:
        raise ValueError(f"the schema {proof['schema']!r} is not {SCHEMA!r}")
    totals, roots = found_bounds(read, proof)
    found = "{} <= TGOSPA <= {}, {} <= total <= {}".format(*rounded(roots), *rounded(totals))
    lower, upper = (decimal.Decimal(proof[name]) for name in ("lower_bound", "upper_bound"))
    if not (lower <= totals[0] and totals[1] <= upper):
        raise Wrong(f"the claim {lower} <= total <= {upper} is not proven, only {found}")
    given = "" if proof["parameters"]["distance"] in CLOSED else ", given the distances"
    metric = ", ".join(f"{name} {value}" for name, value in proof["parameters"].items())
    return f"verified{given}: {found}; {metric}"


def main(arguments):
    """Exit status: 0 the claim holds, 1 it does not, 2 wrong usage, 3 no whole proof folder."""
    if len(arguments) != 1:
        sys.stderr.write(f"{__doc__.splitlines()[0]}\n")
        return 2
    try:
        text, status = verify(lambda name: pathlib.Path(arguments[0], name).read_bytes()), 0
    except Wrong as error:
        text, status = error, 1
    except DAMAGED as error:
        text, status = f"no whole proof folder: {type(error).__name__}: {error}", 3
    print(f"{arguments[0]}: {text}", file=sys.stderr if status else sys.stdout)
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
