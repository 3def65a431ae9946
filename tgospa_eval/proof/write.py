"""A result as a proof folder: the two compared tables, prices, assignment, and claimed bounds.

"The checker" is `verify_tgospa`. Symbols (A, B, c, D, G, p, v) are those of
docs/theory/notation.md.
"""

import csv
import decimal
import hashlib
import io
import itertools
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from fractions import Fraction

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.errors import ConfigError, SolverError
from tgospa_eval.problem.certificate import fair_prices, lower_bounds, of_whole, vertex_cover
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Reduced
from tgospa_eval.problem.states import ONE, States
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.verify_tgospa import CLOSED
from tgospa_eval.quoting import as_unicode, quoted
from tgospa_eval.results.records import ComparedSides, PairProof
from tgospa_eval.solvers.warm_start import save_solution
from tgospa_eval.tracks.weights import EXISTENCE

DISTANCE_TOLERANCE = 1e-9
"""Relative tolerance of distances that are computed again, perhaps with other library versions."""


WEIGHT, EXCUSED = MARKS = verify_tgospa.MARKS
"""Columns that mark ignored states of the truth and excused states of the estimate."""


def proof_tables(
    compared: ComparedSides, problem: Problem, parameters: Parameters
) -> dict[str, str]:
    """Return the texts of the tables of a proof folder, by file name.

    Parameters
    ----------
    compared : ComparedSides
        States, ids and times of both sides.
    problem : Problem
        Steps and tracks of the states, and costs of pairs.
    parameters : Parameters
        Cutoff and order, which turn costs into distances.
    """
    labels, times = compared.labels, times_of(compared)
    marks = MARKS if problem.unjudged is not None else ("", "")
    ids = [_fields(names) for names in (labels.truths, labels.estimates)]
    tables = {
        f"{name}.csv": _csv(
            ("id", "t", *compared.columns, *filter(None, [mark])),
            _chosen(names, side.track),
            _chosen(times, side.step),
            *(map(repr, column) for column in states.T.tolist()),
            *_marks(mark, side.unjudged),
        )
        for name, names, side, states, mark in zip(
            ("truth", "estimate"),
            ids,
            problem.sides,
            (compared.truth, compared.estimate),
            marks,
            strict=True,
        )
    }
    if compared.settings["distance"] not in CLOSED or compared.reports is not None:
        distance = parameters.cutoff * problem.powers(slice(None)) ** (1 / parameters.order)
        np.minimum(distance, math.nextafter(parameters.cutoff, 0.0), out=distance)  # all are near
        tracks = (side.track[side.row] for side in problem.sides)
        tables["distances.csv"] = _csv(
            ("truth", "estimate", "t", "distance"),
            *itertools.starmap(_chosen, zip(ids, tracks, strict=True)),
            _chosen(times, problem.entry_step),
            map(repr, distance.tolist()),
        )
    return tables


def _marks(name: str, unjudged: Mask | None) -> list[Iterable[str]]:
    """Return the column of marks of a table as a list of one column; empty without marks."""
    if unjudged is None:
        return []
    return [map("01".__getitem__, (unjudged ^ (name == WEIGHT)).tolist())]


def times_of(compared: ComparedSides) -> list[str]:
    """Return the time of each step as a text that is read back as the same number."""
    return [repr(moment) for moment in compared.timestamps.tolist()]


def difference(name: str, one: str, other: str, cutoff: float) -> str:
    """Describe the first difference of two texts of the table `name`; empty if they agree.

    Distances agree if they differ by at most DISTANCE_TOLERANCE. A pair at the cutoff, up to this
    tolerance, is allowed to be in only one of the two texts.
    """
    if name == "distances.csv":
        return _difference_of_distances(one, other, cutoff)
    for line, (a, b) in enumerate(itertools.zip_longest(one.split("\n"), other.split("\n")), 1):
        if a != b:
            return f"line {line} is {_shown(a)}, must be {_shown(b)}"
    return ""


def _shown(line: str | None) -> str:
    return repr(line) if line else "missing"


def _difference_of_distances(one: str, other: str, cutoff: float) -> str:
    """Return `difference` of tables of distances; a missing pair has the distance `cutoff`."""
    given, made = (
        {
            (truth, estimate, t): float(d)
            for truth, estimate, t, d in list(csv.reader(io.StringIO(text)))[1:]
        }
        for text in (one, other)
    )
    for pair in (*made, *given):
        a, b = given.get(pair, cutoff), made.get(pair, cutoff)
        if abs(a - b) > DISTANCE_TOLERANCE * max(a, b):
            return f"{pair[0]}, {pair[1]} at t = {pair[2]} is {a!r}, must be {b!r}"
    return ""


def _fields(names: Iterable[str]) -> list[str]:
    """Quote texts as fields of a CSV file, where necessary."""
    text = io.StringIO()
    writer = csv.writer(text)  # quotes fields with \r or \n
    fields = []
    for name in names:
        writer.writerow((name,))
        fields.append(text.getvalue().removesuffix("\r\n"))
        text.seek(0)
        text.truncate()
    return fields


def _chosen(fields: list[str], which: Ints) -> Iterable[str]:
    return map(fields.__getitem__, which.tolist())


def _csv(header: Iterable[str], *columns: Iterable[str]) -> str:
    """Join columns of fields to the text of a table, many times faster than `csv`."""
    lines = [",".join(_fields(header)), *map(",".join, zip(*columns, strict=True))]
    return "\n".join(lines) + "\n"


# -------------------------------------------------------------------------------------------------
# From the prices of the solver to integer prices of using an estimate at a step.
#
# The checker knows no reductions. It needs one kind of price: v_j(k) >= 0 of the estimate j at the
# step k, at the requested cutoff. The prices of a `Solution` differ in five ways. In the following,
# a block is a component, and L is the price of half a switch.
#
# - The price of a slot is paid once, by the object that has the estimate in it. The whole price is
#   put on the first step of the slot. At its later steps no pair gains, so no object needs to take
#   the estimate there.
# - In a block of a single estimate and several true objects, the estimate is the row, and there are
#   no prices. Prices follow from the value function: let V_k(i) be the most that the estimate can
#   gain after the step k if it is then assigned to the object i, and V_k(0) if it is then
#   unassigned. Then v(k) = V_{k-1}(0) - V_k(0). At the first step with a gain, however,
#   v(k) = max(V_k(0), max_i G_i + V_k(i)) - V_k(0). These prices prove the optimum of the block.
#   Proof: G_i(k) + V_k(i) <= V_{k-1}(i). Let a_i(k) = V_k(i) - V_k(0), then |a_i| <= L. So each
#   object gains at most the sum of G_i(k) - v(k) + a_i(k) - a_i(k-1) <= 0. The prices sum to the
#   optimum.
# - A block can be solved at a smaller cutoff, with c^p times a factor s < 1. Let v' and G' be the
#   prices and gains there, and (y, z) the vertex cover of `problem.certificate`. Then
#   v = s v' + (1 - s) (A + B) z. Here A + B is 1, or less if all objects are ignored (A = 0) or all
#   estimates excused (B = 0). Proof: each gain is G <= s G' + (1 - s) (A + B) (y + z), so each
#   object gains at most s times its gain there, plus (1 - s) (A + B) y.
# - For some blocks nothing is proven. Their price is B wherever a pair has a gain. Then no object
#   gains more than its own A, and these blocks do not lower the bound of the other blocks.
# - A and B are doubles in a `Problem`, but exact in the checker: see `_of_slots`.

Prices = Counter[tuple[int, int]]
"""Price by estimate and step, in units of 2^-bits c^p."""

SPARE_BITS = 55
"""Bits of prices in addition to those for the size of the lower bound. Rounding then lowers the sum
of all prices by at most 2^-SPARE_BITS of the bound, half as much as the bound allows."""


def price_bits(states: States, lower: float) -> int:
    """Return how many binary digits prices need, so that they prove the bound `lower`.

    Prices and the bound are in units of c^p.
    """
    many = len(states.begin) + len(states.columns.step)
    return SPARE_BITS + max(math.frexp(many / lower)[1] if lower > 0 else 0, 0)


Shares = tuple[Fraction, Fraction]
"""Exact prices A and B of a missed and of a false target; a `Problem` has them rounded."""


def estimate_prices(
    states: States, prices: Floats, reduced: tuple[Reduced, ...], shares: Shares, bits: int
) -> Prices:
    """Return prices for the checker that prove the lower bound of the certificate."""
    problem = states.problem
    own = int(shares[1] * (1 << bits))
    part_of = np.full(len(states.block_begin), -1)
    best = lower_bounds(states, prices)
    for number, part in enumerate(reduced):
        inner = lower_bounds(part.states, part.solution.prices, part.solution.reduced)
        bound = np.where(part.blocks, of_whole(states, part, inner), -np.inf)
        part_of[bound > best] = number
        best = np.maximum(best, bound)
    direct, useless = (part_of < 0) & (best > 0), best <= 0
    whole = _of_slots(states, prices, direct, shares, bits)
    first = states.block_first
    for block in np.flatnonzero(states.transposed & direct).tolist():
        entry = states.entry[first[block] : first[block + 1]]
        whole.update(_of_single_estimate(problem, entry[entry >= 0], shares, bits))
    entry = states.entry[states.states_of(useless) & (states.entry >= 0)]
    whole.update(dict.fromkeys(_priced_places(problem, entry), own))
    home = states.track_blocks[1]
    for number, part in enumerate(reduced):
        chosen = (part_of == number) & ~useless
        below = bits + int(np.log2(part.scale))  # a power of 2
        inner_prices = (
            estimate_prices(part.states, part.solution.prices, part.solution.reduced, shares, below)
            if below > 0
            else Counter()
        )
        priced = (share for share, side in zip(shares, problem.sides, strict=True) if side.price[0])
        both = sum(priced, Fraction(0))
        rest = int(both * ((1 << bits) - (1 << max(below, 0))))
        for row in np.flatnonzero(vertex_cover(states, chosen)[1]).tolist():
            place = problem.estimate_track[row], problem.estimate_step[row]
            inner_prices[int(place[0]), int(place[1])] += rest
        whole.update({place: v for place, v in inner_prices.items() if chosen[home[place[0]]]})
    return whole


def _priced_places(problem: Problem, entry: Ints) -> set[tuple[int, int]]:
    """Return (estimate, step) of the entries whose estimate costs something if unassigned."""
    row = problem.estimate_row[entry]
    row = np.unique(row[problem.estimate_price[row] > 0])
    columns = problem.estimate_track[row], problem.estimate_step[row]
    return set(zip(*(column.tolist() for column in columns), strict=True))


def _of_slots(states: States, prices: Floats, chosen: Mask, shares: Shares, bits: int) -> Prices:
    """Return the prices of the slots of `chosen` blocks, at the first steps of the slots.

    They are the prices of the certificate, adjusted to the exact A and B.
    """
    columns, problem = states.columns, states.problem
    unit, running = columns.running(fair_prices(prices))
    whole = np.diff(running)
    estimate = np.zeros(states.nodes, np.int64)
    estimate[states.pair_column] = states.pair_estimate
    node = columns.node
    used = np.flatnonzero((whole > 0) & (chosen & ~states.transposed)[states.node_block[node]])
    exponent = np.frexp(unit[node[used]])[1] - 1 + bits
    priced = Counter(
        {
            (track, step): value << shift if shift >= 0 else value >> -shift
            for track, step, value, shift in zip(
                estimate[node[used]].tolist(),
                columns.step[used].tolist(),
                whole[used].tolist(),
                exponent.tolist(),
                strict=True,
            )
        }
    )
    # The problem has rounded A and B. Let u be B - v where a pair has a gain, and -v elsewhere. The
    # lower bound is the sum of all u, plus the least cost of each object with the costs D - u and
    # A. If all costs and all u are multiplied by the factor `less`, the bound is, too. So prices
    # are multiplied by `less`, and increased by the exact B minus `less` times the rounded B.
    rounded = [Fraction(float(np.max(side.price, initial=0.0))) for side in problem.sides]
    ratios = [one / two for one, two in zip(shares, rounded, strict=True) if two]
    if any(ratio != 1 for ratio in ratios):
        less = min(Fraction(1), *ratios)
        own = int((shares[1] - less * rounded[1]) * (1 << bits))
        priced = Counter({place: int(less * value) for place, value in priced.items()})
        direct = states.states_of(chosen & ~states.transposed) & (states.entry >= 0)
        priced.update(dict.fromkeys(_priced_places(problem, states.entry[direct]), own))
    return priced


def _of_single_estimate(problem: Problem, entry: Ints, shares: Shares, bits: int) -> Prices:
    """Return the prices of the only estimate of a block; `entry` has its pairs with a gain.

    The equations are in the comment above `Prices`.
    """
    entry = entry[np.argsort(-problem.entry_step[entry], kind="stable")]
    steps = problem.entry_step[entry].tolist()
    truths = problem.truth_track[problem.truth_row[entry]].tolist()
    full = [int(share * (1 << bits)) for share in shares]
    counted = ((side.price[side.row[entry]] > 0).tolist() for side in problem.sides)
    gains = [
        sum(itertools.compress(full, both)) - _whole(cost, bits)
        for *both, cost in zip(*counted, problem.cost[entry].tolist(), strict=True)
    ]
    change = _whole(float(np.max(problem.switch_price, initial=0.0)), bits)
    estimate = int(problem.estimate_track[problem.estimate_row[entry[0]]])
    priced: Prices = Counter()
    value: dict[int, int] = {}  # V(i) is the larger of this and V(0) - L
    unassigned = 0
    for step, group in itertools.groupby(zip(steps, truths, gains, strict=True), lambda at: at[0]):
        best = unassigned
        for _, truth, gain in group:
            value[truth] = gain + max(value.get(truth, 0), unassigned - change)
            best = max(best, value[truth] - change)
        if step == steps[-1]:  # the first gain in time: an assignment before it costs nothing
            best = max(best, *value.values())
        priced[estimate, step] = best - unassigned
        unassigned = best
    return priced


def _whole(value: float, bits: int) -> int:
    """Return a double in units of 2^-bits, rounded down."""
    numerator, denominator = value.as_integer_ratio()
    return (numerator << bits) // denominator


COLUMN_NUMBERS = "scale", "periodic"
"""Settings of a distance that have a number for each of several columns."""


def proof_texts(proof: PairProof, origin: Mapping[str, object] | None = None) -> dict[str, str]:
    """Return the texts of the files of a proof folder, by file name.

    Parameters
    ----------
    proof : PairProof
        The proven result.
    origin : mapping of str to object, optional
        Further fields of proof.json about the origin of the tables: ``inputs``, ``options``, and
        the ``class`` if there are several.

    Raises
    ------
    ConfigError
        A proof folder cannot represent the evaluation.
    """
    compared = proof.compared
    check_provable(compared, proof.parameters)
    tables = proof_tables(compared, proof.states.problem, proof.parameters)
    parameters = proof.parameters
    bits = price_bits(proof.states, proof.bounds.lower)
    there = _steps_of_tables(proof.states.problem)
    rho = Fraction(parameters.rho)
    priced = estimate_prices(proof.states, proof.prices, proof.reduced, (1 - rho, rho), bits)
    prices = _at_steps(there, priced)
    times, truths, estimates = (
        [json.dumps(text, ensure_ascii=False) for text in texts]
        for texts in (times_of(compared), compared.labels.truths, compared.labels.estimates)
    )
    lists = {
        "prices": [
            f"[{estimates[track]}, {times[step]}, {price}]"
            for (track, step), price in sorted(prices.items())
            if price
        ],
        "assignment": [
            f"[{truths[i]}, {estimates[j]}, {times[first]}, {times[last]}, {weight}]"
            for i, j, first, last, weight in _stretches(proof, there)
        ],
    }
    document = {
        "schema": verify_tgospa.SCHEMA,
        "version": __version__,
        "parameters": proof_parameters(compared, parameters, proof.states.problem),
        "price_bits": bits,
        "weight_unit": ONE,
        "sha256": {
            name: hashlib.sha256(text.encode()).hexdigest() for name, text in tables.items()
        },
        **(origin or {}),
    }
    document |= zip(("lower_bound", "upper_bound"), _claim(proof), strict=True)
    return {"proof.json": _json(document, lists), **tables}


def check_provable(compared: ComparedSides, parameters: Parameters) -> None:
    """Check that a proof folder can represent the evaluation.

    Raises
    ------
    ConfigError
        Steps are weighted, objects exist with probabilities, a reach grows with time
        (``max_speed``), or the checker does not support the distance, the order or a name.
    """
    settings = compared.settings
    for name, what in (
        ("step_weights", "weights of steps"),
        (EXISTENCE, "probabilities of existence"),
        ("max_speed", "a reach that grows with time"),
    ):
        if name in settings:
            raise ConfigError(f"a proof folder cannot hold {what}: leave out the proof or {what}")
    if settings["distance"] not in verify_tgospa.EXTRAS:
        raise ConfigError(
            f"a proof folder cannot hold the distance {quoted(settings['distance'])}: it "
            f"can hold {', '.join(verify_tgospa.EXTRAS)}"
        )
    if parameters.order > verify_tgospa.TOP_ORDER:
        raise ConfigError(
            f"a proof folder cannot hold the order {parameters.order:g}: the largest is "
            f"{verify_tgospa.TOP_ORDER}"
        )
    for name in (*compared.labels.truths, *compared.labels.estimates, *compared.columns):
        if len(name) > csv.field_size_limit() or as_unicode(name) != name:
            raise ConfigError(
                f"a proof folder cannot hold the name {quoted(name)}: names are UTF-8, of at "
                f"most {csv.field_size_limit():,} characters"
            )


def check_proofs(written: Iterable[Mapping[str, str]]) -> None:
    """Run the checker on folders in memory, in their order: each must prove its claim.

    Raises
    ------
    ConfigError
        The check would take too long.
    SolverError
        A folder does not prove its claim.
    """
    folder = None
    for texts in written:
        folder = _Written(texts, folder)
        try:
            verify_tgospa.verify(folder)
        except verify_tgospa.BeyondLimits as error:
            raise ConfigError(
                f"{error}; the proof folder takes too long to check: choose a smaller "
                "cutoff, or an order that is a whole number"
            ) from None
        except (verify_tgospa.Wrong, *verify_tgospa.DAMAGED) as error:
            if isinstance(error, MemoryError):
                raise
            raise SolverError(
                f"the proof folder does not prove the bounds of this result, {error}: no proof is "
                "written; please report this as a bug, with the two files"
            ) from None


class _Written(verify_tgospa.Folder):
    """A proof folder in memory, before it is written."""

    def __init__(self, texts: Mapping[str, str], before: verify_tgospa.Folder | None) -> None:
        super().__init__("", before)
        self.texts = texts

    def read(self, name: str) -> bytes:
        """Return the bytes of a file."""
        return self.texts[name].encode()


def proof_parameters(
    compared: ComparedSides, parameters: Parameters, problem: Problem
) -> dict[str, object]:
    """Return the parameters of the metric; numbers are texts that are read as the same doubles."""
    settings = compared.settings
    return {
        "cutoff": repr(parameters.cutoff),
        "order": repr(parameters.order),
        "switch_penalty": repr(parameters.switch_penalty),
        **({} if parameters.rho == 0.5 else {"rho": repr(parameters.rho)}),
        **({} if problem.unjudged is None else {"masked": ", ".join(MARKS)}),
        **({} if compared.reports is None else {"held": repr(compared.reports.period)}),
        "distance": settings["distance"],
        "columns": list(compared.columns),
        **{
            name: {column: repr(value) for column, value in _numbers(settings, name).items()}
            for name in COLUMN_NUMBERS
            if name in settings
        },
        **{
            name: settings[name]
            for name in verify_tgospa.EXTRAS[str(settings["distance"])].split()
            if name in settings and name not in COLUMN_NUMBERS
        },
    }


def _claim(proof: PairProof) -> list[str]:
    """Return the claimed bounds of the total as texts, widened by the rounding of distances.

    The checker computes distances exactly, or reads them from a table. The `relative` widening is
    for distances d in a table, which `proof_tables` computes from costs (d / c)^p. The `absolute`
    widening is for boxes, where d is 1 minus a ratio near 1, and for periodic columns, where d is
    the period minus a difference. It is multiplied by the number of states of the smaller table:
    the largest possible number of assigned pairs.
    """
    parameters, settings = proof.parameters, proof.compared.settings
    order, problem = parameters.order, proof.states.problem
    relative = absolute = 0.0
    if settings["distance"] not in CLOSED or proof.compared.reports is not None:
        smallest = float(problem.cost.min(initial=1.0, where=problem.cost > 0))
        relative = order * 2.0**-49 + abs(math.log(smallest)) * 2.0**-52
    elif settings["distance"] == "iou":
        absolute = 2.0**-50
    else:
        scales, periods = _numbers(settings, "scale"), _numbers(settings, "periodic")
        absolute = 2.0**-50 * sum(periods[name] * scales.get(name, 1.0) for name in periods)
    pairs = min(len(side.step) for side in problem.sides)
    absolute *= pairs * order / parameters.cutoff
    scale = decimal.Decimal(parameters.cutoff) ** decimal.Decimal(order)
    return verify_tgospa.rounded(
        [
            scale * decimal.Decimal(max(proof.bounds.lower * (1 - relative) - absolute, 0.0)),
            scale * decimal.Decimal(proof.bounds.upper * (1 + relative) + absolute),
        ]
    )


def _steps_of_tables(problem: Problem) -> Ints:
    """Return the steps at which any object or estimate exists; the checker has no other steps."""
    return np.unique(np.concatenate([side.step for side in problem.sides]))


def _at_steps(there: Ints, prices: Prices) -> Prices:
    """Move each price to the next step of `there`; if no such step follows, to the last one.

    The moved prices prove the same bound, because no pair gains between the old and the new step. A
    path that uses the estimate at the new step pays the price once, also if it uses the estimate at
    the old step.
    """
    priced: Prices = Counter()
    steps = np.array([step for _, step in prices], np.int64)
    moved = there[np.minimum(np.searchsorted(there, steps), len(there) - 1)].tolist()
    for ((track, _), price), step in zip(prices.items(), moved, strict=True):
        priced[track, step] += price
    return priced


def _stretches(proof: PairProof, there: Ints) -> Iterable[tuple[int, int, int, int, int]]:
    """Return true object, estimate, first step, last step and weight of each stretch of time.

    In a stretch, the weight of a pair is constant. A stretch that reaches an end of the window of
    its block is extended to this end of the recording. The ends of stretches are moved to steps in
    `there`. This does not increase the cost, because no pair gains at other steps.
    """
    saved = save_solution(proof.states, proof.weights, proof.prices)
    begin = np.searchsorted(there, saved.begin)
    end = np.searchsorted(there, saved.end, "right") - 1
    kept = np.flatnonzero(begin <= end)
    weight = np.rint(saved.weight[kept] * ONE).astype(np.int64)
    spans = there[begin[kept]], there[end[kept]]
    columns = saved.truth[kept], saved.estimate[kept], *spans, weight
    return zip(*(column.tolist() for column in columns), strict=True)


def _numbers(settings: Mapping[str, object], name: str) -> dict[str, float]:
    """Return a setting of `COLUMN_NUMBERS`, by column; empty if it is not set."""
    numbers = settings.get(name, {})
    assert isinstance(numbers, Mapping)
    return dict(numbers)


def _json(document: Mapping[str, object], lists: Mapping[str, Iterable[str]]) -> str:
    """Return JSON with one line for each field and for each element of the lists."""
    texts = {
        name: json.dumps(value, sort_keys=True, ensure_ascii=False)
        for name, value in document.items()
    }
    texts |= {name: "[\n  " + ",\n  ".join(rows) + "\n ]" for name, rows in lists.items()}
    return "{\n" + ",\n".join(f' "{name}": {texts[name]}' for name in sorted(texts)) + "\n}\n"
