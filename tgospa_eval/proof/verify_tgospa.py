#!/usr/bin/env python3
"""Check a TGOSPA value from its proof folder: ``python verify_tgospa.py FOLDER``.

It needs only Python's standard library, and does not rely on floating-point arithmetic: a state is
the binary64 number nearest to its text, and all further numbers are integers, rounded outward.

The metric (Garcia-Fernandez, Rahmathullah, Svensson, IEEE TSP 2020): true objects i and estimates j
have states at some steps k. An assignment has weights W_ij(k) >= 0; those of each state sum to at
most 1. Its cost in units of c^p (cutoff c, order p) is
    sum of P over all states  -  sum_ijk G_ij(k) W_ij(k)  +  L sum_ijk |W_ij(k+1) - W_ij(k)|
P is the price of an unassigned state: 1 - rho of the truth, rho of the estimate (by default 1/2). G
is the gain of a pair: 1 - (d / c)^p at a distance d < c, else 0. L is the price of half a switch,
(g / c)^p / 2 with the switch penalty g. With masks, P is 0 for truth states of weight w = 0 and for
excused estimate states. G is then P_i + P_j - w (d / c)^p at a distance d < c, but at least 0. The
least cost is (TGOSPA / c)^p. The upper bound is the cost of the assignment in the folder, after its
weights are checked. The lower bound, for any prices v_j(k) >= 0 such as those in the folder, is
    sum of P over all states  -  sum_jk v_j(k)  -  sum_i R_i,   with R_i by dynamic programming.
R_i is the most that object i can gain if it pays v_j(k) for using j at k, L for taking an estimate
and L for leaving it. Proof: adding v_j(k) (sum_i W_ij(k) - 1) <= 0 does not increase the cost.
"""

import bisect, collections, csv, decimal, hashlib, io, itertools, json, math, pathlib, re, sys
from fractions import Fraction

SCHEMA = "tgospa-eval/proof/1"
CLOSED = ("euclidean", "manhattan", "chebyshev", "iou")  # distances whose formula is in this file
MARKS, COUNTED = ("weight", "excused"), ("1", "0")  # columns; values if a state counts
STATES, BOXES = ("truth.csv", "estimate.csv"), ["left", "top", "width", "height"]
MORE_BITS = 120  # bits that costs have in addition to those of prices
DAMAGED = OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError
DAMAGED += csv.Error, RecursionError, MemoryError

# Limits far above the usual sizes, so that any small folder is checked in seconds.
PLAIN_NUMBER = re.compile(r"[-+]?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]{1,3})?")
LENGTH, FIGURES = 60, 1000  # characters of a decimal number, digits of an integer
PRICE_BITS, LARGEST_UNIT, TOP_ORDER, EXACT_BITS = 1200, 2**64, 10**4, 8000
WORK, MEGABYTE, LARGEST_FILE = 5e6, 10**6, 10**9  # about microseconds; bytes; bytes

# All fields of proof.json: [x] means a list of x, (x, y) a row; fields under MAY are optional.
ANY, MAY = type("number or text", (), {}), None  # ANY is also a list or a matrix of these
RECORDED = """cutoff order switch_penalty rho step_weights existence distance covariance periodic
    scale columns truth_columns estimate_columns truth_format estimate_format time_tolerance grid
    interpolate max_gap ignore ignore_regions time_offset time_scale unit_scale on_duplicate
    on_invalid steps resample period outage decimal time class_ truth_class estimate_class region by
    where truth_where estimate_where day_begins preprocess unit solver gap epsilon time_limit
    fix_cov missing_cov mixed cloud_order inner inner_cov reduce reduce_method directions
    iterations restarts polish seed no_gating pairwise vertical_weight truth_scale
    estimate_scale truth_crs estimate_crs origin truth_time_format estimate_time_format
    truth_time_zone estimate_time_zone max_speed"""
ORIGIN = {"class": str, "classes": [str], "options": {MAY: dict.fromkeys(RECORDED.split(), ANY)}}
ORIGIN |= {"inputs": {side: {"path": str, "sha256": str} for side in ("truth", "estimate")}}
ORIGIN["judged"] = dict.fromkeys(("steps", "truth_states", "truth_steps"), int)
ORIGIN["judged"] |= {"steps_sha256": str, "truth_sha256": str, "first": ANY, "last": ANY}
DOCUMENT = {"schema": str, "version": str, "lower_bound": str, "upper_bound": str, "sha256": dict}
DOCUMENT |= {"parameters": dict, "price_bits": int, "weight_unit": int, "prices": [(str, str, int)]}
DOCUMENT |= {"assignment": [(str, str, str, str, int)], MAY: ORIGIN}
ALWAYS = dict.fromkeys(("cutoff", "order", "switch_penalty", "distance"), str) | {"columns": [str]}
EXTRAS = dict.fromkeys(CLOSED[:3], "scale periodic") | {"iou": "", "haversine": ""}
EXTRAS |= {"geodesic": "vertical_weight"}
EXTRAS |= {"mahalanobis": "scale covariance", "gaussian-wasserstein": "scale periodic mixed"}
EXTRAS["cloud-wasserstein"] = """scale cloud_order inner inner_cov reduce reduce_method seed
    iterations restarts directions polish"""
EXTRAS |= dict.fromkeys(
    ("sliced-wasserstein", "max-sliced-wasserstein"), EXTRAS["cloud-wasserstein"]
)


class Wrong(Exception):
    """The folder does not prove what it claims."""


class BeyondLimits(ValueError):
    """The folder would take too much time or memory."""


def visible(text):
    """Return a text on one line, with line ends and control characters made visible."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def number(text):
    """Return the binary64 number nearest to a plain decimal, as numerator and denominator."""
    if len(text) > LENGTH or not PLAIN_NUMBER.fullmatch(text) or math.isinf(value := float(text)):
        raise ValueError(f"{text!r:.80} is not a plain decimal number in the range of binary64")
    return value.as_integer_ratio()


def whole(value, limit=10**FIGURES):
    """Return a value that must be an integer >= 0."""
    if not isinstance(value, int) or not 0 <= value <= limit:
        raise Wrong(f"{value!r:.80} must be a whole number, not below 0 and not too large")
    return value


def check(value, kind, where):
    """Check that a value of proof.json is of a kind in DOCUMENT; `where` names it in messages."""
    if isinstance(kind, dict):
        check(value, dict, where)
        known = kind | kind.get(MAY, {})
        if wrong := value.keys() - known or kind.keys() - value.keys() - {MAY}:
            what = "an unknown" if wrong <= value.keys() else "no"
            raise ValueError(f"{where} has {what} {min(wrong)!r:.80}")
        for name, inner in value.items():
            check(inner, known[name], f"{where}, {name:.80}")
    elif isinstance(kind, list):
        check(value, list, where)
        for inner in value:
            check(inner, kind[0], where)
    elif isinstance(kind, tuple):
        if not isinstance(value, list) or tuple(map(type, value)) != kind:
            raise ValueError(f"{where} has {value!r:.80} in place of a row")
    elif kind is ANY and isinstance(value, list) and where.count("[") < 2:
        check(value, [ANY], f"{where}[]")
    elif isinstance(value, (dict, list)) if kind is ANY else type(value) is not kind:
        raise ValueError(f"{where} has {value!r:.80} in place of a {kind.__name__}")


class Folder:
    """Files of a proof folder, and the work so far, including that of folders `before` it."""

    def __init__(self, path, before=None):
        self.path = pathlib.Path(path)
        self.size, self.work = (before.size, before.work) if before else (0, 0)

    def read(self, name):
        """Return the bytes of a file that lies in the folder itself."""
        if not (path := self.path / name).is_file():  # a device can be endless
            raise FileNotFoundError(f"{name} is missing, or is not a file")
        if path.resolve().parent != self.path.resolve():  # messages must not show files elsewhere
            raise ValueError(f"{name} is a link out of the folder: must be a file in it")
        if path.stat().st_size > LARGEST_FILE:
            raise BeyondLimits(f"{name} is too large: at most {LARGEST_FILE} bytes are read")
        return path.read_bytes()

    def text(self, name, digest=None):
        """Return the text of a file: UTF-8 without a byte order mark; check its digest if given."""
        self.size += len(data := self.read(name))
        if digest not in (None, hashlib.sha256(data).hexdigest()):
            raise Wrong(f"{name} was changed after the proof was written")
        if data.startswith(b"\xef\xbb\xbf"):
            raise ValueError(f"{name} begins with a byte order mark: must be UTF-8 without one")
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"{name} is not UTF-8, as of byte {error.start}") from None

    def table(self, name, proof, *header):
        """Return the rows of a table, which must have its digest in the proof and these columns."""
        text = self.text(name, proof["sha256"][name])
        top, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
        if top != list(header) or any(len(row) != len(header) for row in rows):
            raise ValueError(f"{name} must have the columns {', '.join(header)}, in each row")
        return rows

    def proof(self):
        """Return the document of proof.json, which must have exactly the fields of the schema."""
        proof = json.loads(
            self.text("proof.json"),
            object_pairs_hook=lambda o: dict(o) if len(dict(o)) == len(o) else {"name twice": 0},
            parse_float=lambda text: number(text) and float(text),
            parse_constant=number,
        )
        if not isinstance(proof, dict) or proof.get("schema") != SCHEMA:
            raise ValueError(f"proof.json is not an object with the schema {SCHEMA!r}")
        check(proof, DOCUMENT, "proof.json")
        given = proof["parameters"]
        if (distance := given.get("distance")) not in EXTRAS:
            raise ValueError(f"the distance {distance!r:.80} is unknown")
        check(columns := given.get("columns"), [str], "columns")
        if len(set(columns)) < len(columns) or (distance == "iou" and columns != BOXES):
            raise ValueError(f"the distance {distance} cannot have the columns {columns!r:.80}")
        each = {MAY: dict.fromkeys(columns, str)}
        kinds = {x: each if x in ("scale", "periodic") else ANY for x in EXTRAS[distance].split()}
        kinds |= dict.fromkeys(("rho", "masked", "held"), str)
        check(given, ALWAYS | {MAY: kinds}, "parameters")
        if given.get("masked", ", ".join(MARKS)) != ", ".join(MARKS):
            raise ValueError(f"masked is {given['masked']!r:.80}: must be {', '.join(MARKS)}")
        tables = STATES if is_closed(given) else (*STATES, "distances.csv")
        check(proof["sha256"], dict.fromkeys(tables, str), "sha256")
        return proof

    def spend(self, work):
        """Count work up to a limit; in large folders, the limit grows faster than the pairs."""
        self.work += work
        if self.work > WORK * max(1, self.size / MEGABYTE) ** 3:
            raise BeyondLimits("there are too many near pairs for a folder of this size")


def is_closed(given):
    """Return True if distances are computed from the states; False if reports hold on a clock."""
    return given["distance"] in CLOSED and "held" not in given


def pair_work(columns, size):
    """Estimate the work for the distance of a pair whose columns are integers of `size` bits."""
    return 2.5 + columns * (0.5 + size / 500)


def power_work(exponent, size, bits):
    """Estimate the work for the cost of a near pair: `power` with integers of `size` bits."""
    if exponent.denominator <= 16 and (top := exponent.numerator * size) <= EXACT_BITS:
        return 10 + bits / 50 + (top + exponent.denominator * bits) ** 2 / 10**6
    return 40 + size / 20 + (30 + bits / 3) ** 2 / 80


def power(a, b, exponent, bits):
    """Return (a / b)^exponent in units of 2^-bits, rounded down and rounded up."""
    if a == 0:
        return 0, 0
    n, root = exponent.as_integer_ratio()
    if root <= 16 and n * max(a.bit_length(), b.bit_length()) <= EXACT_BITS:
        low = (top := a**n << root * bits) // (base := b**n)
        for _ in range(root.bit_length() - 1):  # root is a power of 2
            low = math.isqrt(low)
        return low, low + (low**root * base < top)
    digits = 30 + (bits + (math.ceil(math.log2(a / b) * exponent) if a > b else 0)) // 3
    with decimal.localcontext(prec=digits, Emin=decimal.MIN_EMIN, Emax=decimal.MAX_EMAX):
        value = (decimal.Decimal(float(exponent)) * (decimal.Decimal(a) / b).ln()).exp() * 2**bits
        margin = decimal.Decimal("0.001")  # far above the error of correctly rounded steps
        return math.floor(value - margin), math.ceil(value + margin)


class Known(dict):
    """Values of the texts (ids or times) in the tables; other texts raise `Wrong`."""

    def __missing__(self, text):
        raise Wrong(f"no table has {text!r:.80}")


class ClaimedScene:
    """States of the tables, and the cost of each pair of states nearer than the cutoff."""

    def __init__(self, folder, proof):
        given = proof["parameters"]
        self.kind, names = given["distance"], given["columns"]
        self.bits = whole(proof["price_bits"], PRICE_BITS) + MORE_BITS
        self.cutoff, self.order = (Fraction(*number(given[name])) for name in ("cutoff", "order"))
        scale = [number(given.get("scale", {}).get(name, "1")) for name in names]
        turn = [number(given.get("periodic", {}).get(name, "0")) for name in names]
        rho, change = Fraction(*number(given.get("rho", "0.5"))), number(given["switch_penalty"])
        low = min(self.cutoff, rho, 1 - rho, *(x for x, _ in scale))
        if low <= 0 or min(x for x, _ in (change, *turn)) < 0 or not 1 <= self.order <= TOP_ORDER:
            raise ValueError("parameters are out of range")
        limit = 2 ** math.ceil(128 / self.order) if self.order < 128 else 1 + 128 / self.order
        self.never = (change := Fraction(*change) / self.cutoff) > limit  # see `upper_bound`
        self.change = power(*min(change, limit).as_integer_ratio(), self.order, self.bits - 1)  # L
        marks = [[mark] if "masked" in given else [] for mark in MARKS]
        tables = [
            folder.table(name, proof, "id", "t", *names, *mark) for name, mark in zip(STATES, marks)
        ]
        self.truths, self.estimates = (Known((x, x) for x, *_ in rows) for rows in tables)
        times = {x[1]: decimal.Decimal(x[1]) for x in itertools.chain(*tables) if number(x[1])}
        self.times, sides = sorted(times, key=times.get), [{}, {}]
        self.step = Known((t, k) for k, t in enumerate(self.times))
        one, price = 1 << self.bits, [{}, {}]
        for of, full in enumerate((1 - rho, rho)):
            for name, t, *state in tables[of]:
                mark = state.pop() if marks[of] else COUNTED[of]
                if mark not in COUNTED:
                    raise ValueError(f"{MARKS[of]} is {mark!r:.80}: must be 0 or 1")
                sides[of][name, self.step[t]] = list(map(number, state))
                price[of][name, self.step[t]] = full * one * (mark == COUNTED[of])
        self.all = sum(itertools.chain(*map(dict.values, price)))
        self.unjudged = [f"{[*of.values()].count(0)} of {len(of)}" for of in price]
        if sum(map(len, sides)) < sum(map(len, tables)) or len({*times.values()}) < len(times):
            raise ValueError("an object is a duplicate, or one time is written in two ways")
        # truth -> estimate -> [(step, cost rounded down, cost rounded up)]
        self.near = collections.defaultdict(lambda: collections.defaultdict(list))
        if is_closed(given):
            pairs = self._measured(folder, sides, scale, turn)
        else:
            rows = folder.table("distances.csv", proof, "truth", "estimate", "t", "distance")
            pairs = self._listed(sides, rows)
        exponent = self.order / (2 if self.kind == "euclidean" and is_closed(given) else 1)
        for truth, estimate, k, a, b in pairs:  # a / b is (d / c)^2 or d / c
            if a < b:
                folder.spend(power_work(exponent, b.bit_length(), self.bits))
                both = price[0][truth, k], price[1][estimate, k]
                low, high = self._lost(*power(a, b, exponent, self.bits), *both)
                if low < one:
                    self.near[truth][estimate].append((k, low, high))
        for costs in itertools.chain(*map(dict.values, self.near.values())):
            costs.sort()
            if any(one[0] == two[0] for one, two in itertools.pairwise(costs)):
                raise ValueError("distances.csv has a duplicate pair at one time")

    def _lost(self, low, high, missed, false):
        """Return integers below and above 1 - (P_i + P_j - w (d / c)^p), the cost of a pair."""
        rest = (1 << self.bits) - missed - false
        cost = [rest + (power if missed else 0) for power in (low, high)]
        return math.floor(cost[0]), min(math.ceil(cost[1]), 1 << self.bits)

    def _listed(self, sides, rows):
        """Yield the pairs of distances.csv, each with two integers whose ratio is d / c."""
        top, base = self.cutoff.as_integer_ratio()
        for truth, estimate, t, distance in rows:
            k, (a, b) = self.step[t], number(distance)
            if a < 0 or (truth, k) not in sides[0] or (estimate, k) not in sides[1]:
                raise ValueError(f"distances.csv has a pair that the tables lack at t = {t!r:.80}")
            yield truth, estimate, k, a * base, b * top

    def _measured(self, folder, sides, scale, turn):
        """Yield the pairs of each step in equal or adjacent cells of width c, with `_ratio`."""
        every = itertools.chain([turn], sides[0].values(), sides[1].values())
        units = {b * d for row in every for (_, b), (_, d) in zip(row, scale)}
        unit = max(units | {self.cutoff.denominator})  # all are powers of 2

        def integers(row):
            return [a * c * (unit // (b * d)) for (a, b), (c, d) in zip(row, scale)]

        cutoff, turn, boxes = int(self.cutoff * unit), integers(turn), self.kind == "iou"
        cells = [] if boxes else [n for n, p in enumerate(turn) if not p][:2]
        around, room = list(itertools.product((-1, 0, 1), repeat=len(cells))), {}
        for side in (1, 0):
            for (name, k), row in sides[side].items():
                row = integers(row)
                if boxes:
                    a, b, w, h = row
                    row = [a, b, a + whole(w), b + whole(h), w * h]
                each = pair_work(len(row), max(map(int.bit_length, row), default=0))
                home = [row[n] // cutoff for n in cells]
                if side == 1:
                    room.setdefault((k, *home), []).append((name, row))
                for shift in around if side == 0 else ():
                    near = room.get((k, *[a + b for a, b in zip(home, shift)]), ())
                    folder.spend(len(near) / 2)
                    for other, place in near:
                        if not boxes or cutoff > unit or (row[0] < place[2] and place[0] < row[2]):
                            folder.spend(each)
                            yield name, other, k, *self._ratio(row, place, cutoff, unit, turn)

    def _ratio(self, x, y, cutoff, unit, turn):
        """Return two integers whose ratio is (d / c)^2 for euclidean, d / c for other distances."""
        if self.kind == "iou":  # left, top, right, bottom, area
            wide, high = min(x[2], y[2]) - max(x[0], y[0]), min(x[3], y[3]) - max(x[1], y[1])
            both = max(wide, 0) * max(high, 0)
            union = x[4] + y[4] - both
            return (union - both) * unit, union * cutoff
        d = [min((a - b) % p, (b - a) % p) if p else abs(a - b) for a, b, p in zip(x, y, turn)]
        if self.kind == "euclidean":
            return sum([a * a for a in d]), cutoff * cutoff
        return (sum(d) if self.kind == "manhattan" else max(d, default=0)), cutoff


def lower_bound(scene, proof):
    """Return the lower bound from the prices, in units of 2^-bits c^p."""
    paid = collections.defaultdict(lambda: ([], [0]))  # steps with a price, sums of prices so far
    prices = ((scene.step[t], scene.estimates[j], whole(v)) for j, t, v in proof["prices"])
    for k, name, price in sorted(prices):
        paid[name][0].append(k)
        paid[name][1].append(paid[name][1][-1] + (price << MORE_BITS))
    one, leave = 1 << scene.bits, scene.change[0]
    bound = math.floor(scene.all) - sum(sums[-1] for _, sums in paid.values())
    for costs in scene.near.values():
        # assigned[j]: the largest gain if j is assigned now, plus all prices of j so far. It begins
        # at 0, as an assignment from the first step on costs no L. free: the same if unassigned.
        assigned, free = dict.fromkeys(costs, 0), 0
        gains = sorted((k, name, one - cost) for name, of in costs.items() for k, cost, _ in of)
        for _, group in itertools.groupby(gains, lambda gain: gain[0]):
            best = free
            for k, name, gain in group:
                steps, sums = paid[name]
                before, now = sums[bisect.bisect_left(steps, k)], sums[bisect.bisect(steps, k)]
                value = gain + max(assigned[name] - now, free - leave - (now - before))
                assigned[name] = value + now
                best = max(best, value - leave)
            free = best
        bound -= max(free, *(value - paid[name][1][-1] for name, value in assigned.items()))
    return max(bound, 0)


def upper_bound(scene, proof):
    """Return the cost of the assignment, in units of 2^-bits c^p / weight_unit."""
    unit, one, saved, moved = whole(proof["weight_unit"], LARGEST_UNIT), 1 << scene.bits, 0, 0
    loads, changes = (collections.defaultdict(collections.Counter) for _ in range(2))
    for i, j, first, last, weight in proof["assignment"]:
        truth, estimate = scene.truths[i], scene.estimates[j]
        begin, end = scene.step[first], scene.step[last] + 1
        whole(end - begin - 1)
        for k, change in ((begin, whole(weight)), (end, -weight)):
            for key in (("truth", truth), ("estimate", estimate)):
                loads[key][k] += change  # change at step k of the sum of its weights
            changes[truth, estimate][k] += change
    for (side, name), load in loads.items():
        for k, total in zip(sorted(load), itertools.accumulate(load[k] for k in sorted(load))):
            if not 0 <= total <= unit:
                raise Wrong(f"{side} {name!r} is assigned more than once at t = {scene.times[k]}")
    for (truth, estimate), of in changes.items():
        costs = scene.near[truth][estimate]
        sums = list(itertools.accumulate((one - high for _, _, high in costs), initial=0))
        for k, change in of.items():  # from step k on the weight is larger by change
            saved += change * (sums[-1] - sums[bisect.bisect_left(costs, (k,))])
            moved += abs(change) if 0 < k < len(scene.times) else 0
    if moved and scene.never:  # weights change by >= 2^-64, and a switch costs > 2^128 c^p
        raise Wrong("the assignment has switches, where one costs more than all objects")
    return math.ceil(scene.all) * unit - saved + scene.change[1] * moved


def proven_bounds(scene, proof):
    """Return bounds of the total cost and of TGOSPA, as decimals widened by 1e-45 (relative)."""
    bounds = (lower_bound(scene, proof), 1), (upper_bound(scene, proof), proof["weight_unit"])
    with decimal.localcontext(prec=80, Emin=decimal.MIN_EMIN, Emax=decimal.MAX_EMAX):
        cutoff, order = decimal.Decimal(float(scene.cutoff)), decimal.Decimal(float(scene.order))
        scale = (order * cutoff.ln()).exp() / 2**scene.bits
        wide = 1 - decimal.Decimal("1e-45"), 1 + decimal.Decimal("1e-45")
        totals = [scale * bound / unit * w for (bound, unit), w in zip(bounds, wide)]
        roots = [total and (total.ln() / order).exp() * w for total, w in zip(totals, wide)]
    return totals, roots


def rounded(bounds):
    """Return two bounds as texts with 17 digits, rounded outward."""
    down, up = (decimal.Context(17, way) for way in (decimal.ROUND_FLOOR, decimal.ROUND_CEILING))
    return [str(down.plus(bounds[0] or 0)), str(up.plus(bounds[1] or 0))]


def verify(folder):
    """Return the proven bounds in a line; raise `Wrong` if the claim does not hold."""
    proof = folder.proof()
    lower, upper = (proof[name] for name in ("lower_bound", "upper_bound") if number(proof[name]))
    scene = ClaimedScene(folder, proof)
    totals, roots = proven_bounds(scene, proof)
    bounds = "{} <= TGOSPA <= {}, {} <= total <= {}".format(*rounded(roots), *rounded(totals))
    if not (decimal.Decimal(lower) <= totals[0] and totals[1] <= decimal.Decimal(upper)):
        raise Wrong(f"the claim {lower} <= total <= {upper} is not proven, only {bounds}")
    named = proof["parameters"]
    given = "" if is_closed(named) else ", given the distances"
    metric = [f"{k} {v if k in {*ALWAYS, 'rho'} else repr(v)}" for k, v in named.items()]
    if "masked" in named:
        bounds += "; not judged: {} truth states, {} estimate states".format(*scene.unjudged)
    return visible(f"verified{given}: {bounds}; {', '.join(metric)}")


def main(arguments):
    """Return the exit status: 0 the claim holds, 1 it does not, 2 wrong usage, 3 no proof."""
    if len(arguments) != 1:
        sys.stderr.write(f"{__doc__.splitlines()[0]}\n")
        return 2
    try:
        text, status = verify(Folder(arguments[0])), 0
    except Wrong as error:
        text, status = error, 1
    except DAMAGED as error:
        text, status = f"not a complete proof folder: {type(error).__name__}: {error}", 3
    print(visible(f"{arguments[0]}: {text}"), file=sys.stderr if status else sys.stdout)
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
