"""A result as a proof folder: the two compared tables, prices, assignment, and the claim."""

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
"""Relative tolerance of distances that are computed again, maybe by other library versions."""


WEIGHT, EXCUSED = MARKS = verify_tgospa.MARKS
"""Columns that mark ignored objects and excused estimates."""


def proof_tables(
    compared: ComparedSides, problem: Problem, parameters: Parameters
) -> dict[str, str]:
    """Return the tables of a proof folder by name.

    Parameters
    ----------
    compared : ComparedSides
        States, ids and times of both sides.
    problem : Problem
        Rows and costs.
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
    """Return a list with the column of marks of a table; empty if it has no marks."""
    if unjudged is None:
        return []
    return [map("01".__getitem__, (unjudged ^ (name == WEIGHT)).tolist())]


def times_of(compared: ComparedSides) -> list[str]:
    """Return the time of each step as a text that is read back as the same number."""
    return [repr(moment) for moment in compared.timestamps.tolist()]


def difference(name: str, one: str, other: str, cutoff: float) -> str:
    """Return where two tables first differ, in words; empty if they are the same.

    Distances may differ by DISTANCE_TOLERANCE, and a pair at the cutoff may be in one table only.
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
    """Return `difference` of two tables of distances; a missing pair counts as at the cutoff."""
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
    """Return texts as fields of a CSV file."""
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
    """Return a table of columns of fields, many times faster than by `csv`."""
    lines = [",".join(_fields(header)), *map(",".join, zip(*columns, strict=True))]
    return "\n".join(lines) + "\n"


# -------------------------------------------------------------------------------------------------
# From the prices of the solver to integer prices of using an estimate at a step.
#
# A checker without reductions needs one kind of price: v_j(k) >= 0 of the estimate j at the step k,
# at the requested cutoff. The prices of a `Solution` differ in five ways.
#
# - The price of a slot is paid once, by the object that has the estimate in it. It is put on the
#   first step of the slot: nothing gains within a slot, so nothing enters between two of its steps.
# - Blocks of a single estimate and several true objects have the estimate as their row, and no
#   prices. Prices that make the other form tight follow from the value function. Let V_k(i) be the
#   most that the estimate can gain after the step k if it is then assigned to the object i, and
#   V_k(0) if it is then unassigned. Then v(k) = V_{k-1}(0) - V_k(0), and at the first gain
#   v(k) = max(V_k(0), max_i G_i + V_k(i)) - V_k(0).
#   Proof: G_i(k) + V_k(i) <= V_{k-1}(i). So with a_i(k) = V_k(i) - V_k(0), |a_i| <= L, each object
#   gains at most the sum of G_i(k) - v(k) + a_i(k) - a_i(k-1) <= 0. The prices sum to the optimum.
# - Blocks may be solved at a smaller cutoff price s. With the prices v' there and the vertex cover
#   (y, z) of `problem.certificate`, v = s v' + (1 - s) (A + B) z. Here A + B is 1, or less if all
#   objects are ignored (A = 0) or all estimates excused (B = 0). Proof: each gain has
#   G <= s G' + (1 - s) (A + B) (y + z), so each object gains at most s times its gain there, plus
#   (1 - s) (A + B) y.
# - For some blocks nothing is proven. If the price is B wherever an estimate may be used, no object
#   gains more than its own A, so that these blocks do not lower the bound of the other blocks.
# - A and B of a problem are doubles, those of a checker are exact: see `_of_slots`.

Prices = Counter[tuple[int, int]]
"""Price by estimate and step, in units of 2^-bits c^p."""

SPARE_BITS = 55
"""Rounding lowers all prices together by at most 2^-SPARE_BITS of the lower bound. This leaves half
of the rounding that the bound allows for."""


def price_bits(states: States, lower: float) -> int:
    """Return the binary digits that prices need to prove a lower bound, in units of c^p."""
    many = len(states.begin) + len(states.columns.step)
    return SPARE_BITS + max(math.frexp(many / lower)[1] if lower > 0 else 0, 0)


Shares = tuple[Fraction, Fraction]
"""Exact prices A and B of a missed and of a false target; those of a `Problem` are rounded."""


def estimate_prices(
    states: States, prices: Floats, reduced: tuple[Reduced, ...], shares: Shares, bits: int
) -> Prices:
    """Return prices, in units of 2^-bits c^p, that prove the bound of the certificate."""
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
    """Return (estimate, step) of the entries whose estimate costs something if it is unassigned."""
    row = problem.estimate_row[entry]
    row = np.unique(row[problem.estimate_price[row] > 0])
    columns = problem.estimate_track[row], problem.estimate_step[row]
    return set(zip(*(column.tolist() for column in columns), strict=True))


def _of_slots(states: States, prices: Floats, chosen: Mask, shares: Shares, bits: int) -> Prices:
    """Return prices of slots at their first steps, as in the certificate, for exact A and B."""
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
    # Let u = B - v where an estimate may be used, -v elsewhere. The bound is the sum of u and of
    # the least cost of each object, from D - u and A. If all costs and u are multiplied by `less`,
    # so is the bound.
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
    """Return prices of the only estimate of a block, from its value function."""
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
    value: dict[int, int] = {}  # V of each object, if it is above V of "none" less `change`
    unassigned = 0
    for step, group in itertools.groupby(zip(steps, truths, gains, strict=True), lambda at: at[0]):
        best = unassigned
        for _, truth, gain in group:
            value[truth] = gain + max(value.get(truth, 0), unassigned - change)
            best = max(best, value[truth] - change)
        if step == steps[-1]:  # the first gain: being assigned before it costs nothing
            best = max(best, *value.values())
        priced[estimate, step] = best - unassigned
        unassigned = best
    return priced


def _whole(value: float, bits: int) -> int:
    """Return a double in units of 2^-bits, rounded down."""
    numerator, denominator = value.as_integer_ratio()
    return (numerator << bits) // denominator


COLUMN_NUMBERS = "scale", "periodic"
"""Settings of a distance that have a number for each of some columns."""


def proof_texts(proof: PairProof, origin: Mapping[str, object] | None = None) -> dict[str, str]:
    """Return the files of a proof folder.

    Parameters
    ----------
    proof : PairProof
        The proven result.
    origin : mapping of str to object, optional
        Origin of the tables: ``inputs``, ``options``, and the ``class`` if there are several.

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
        The steps are weighted, objects exist with probabilities, the reach grows with time, or the
        checker does not support the distance, the order or a name.
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
    """Check with the checker that these folders, in their order, prove their claims.

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
    """Return the parameters of the metric; numbers are texts of the doubles that were used."""
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
    """Return the printed bounds of the total, widened by the rounding of unproven distances.

    The relative part is for (d / c)^p of distances that `proof_tables` computes from costs. The
    absolute part is for d of boxes (1 minus a ratio near 1) and for d around a circle (the period
    minus a difference). An assignment has at most as many pairs as the smaller table has states.
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
    """Return the steps at which an object exists, which are the only steps of a checker."""
    return np.unique(np.concatenate([side.step for side in problem.sides]))


def _at_steps(there: Ints, prices: Prices) -> Prices:
    """Return the prices at the steps `there`: each moves to the next of these steps, or the last.

    A path that uses the estimate at the new step may as well use it since the old step, or from the
    last step to the end: it gains nothing between these steps, and pays the price once.
    """
    priced: Prices = Counter()
    steps = np.array([step for _, step in prices], np.int64)
    moved = there[np.minimum(np.searchsorted(there, steps), len(there) - 1)].tolist()
    for ((track, _), price), step in zip(prices.items(), moved, strict=True):
        priced[track, step] += price
    return priced


def _stretches(proof: PairProof, there: Ints) -> Iterable[tuple[int, int, int, int, int]]:
    """Return true object, estimate, first step, last step and weight of each assignment in time.

    An assignment lasts while its weight is constant. If it reaches an end of the window of its
    block, it is extended to that end of the recording. It begins and ends at steps in `there`: no
    pair gains between these, so the cost does not grow.
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
    """Return a setting that has a number for each of some columns."""
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
