"""A result as a proof folder: both tables as compared, prices, assignment, and the claim."""

import csv
import decimal
import hashlib
import json
import math
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.distances.base import Settings
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.problem import Ints, Problem
from tgospa_eval.problem.slots import changed
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.problem.weights import ONE
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.prices import Prices, estimate_prices, price_bits
from tgospa_eval.proof.tables import proof_tables, times_of
from tgospa_eval.proof.verify_tgospa import CLOSED
from tgospa_eval.results.result import Compared, Proof
from tgospa_eval.text import as_unicode, quoted
from tgospa_eval.tracks.existence import EXISTENCE

COLUMN_NUMBERS = "scale", "periodic"
"""Settings of a distance that have a number for some columns."""


def proof_texts(proof: Proof, origin: Mapping[str, object] | None = None) -> dict[str, str]:
    """The files of a proof folder.

    Parameters
    ----------
    proof : Proof
        What was proven.
    origin : mapping of str to object, optional
        Where the tables came from: ``inputs``, ``options``, and the ``class``, if it is one of
        several.

    Raises
    ------
    ConfigError
        A proof folder has no place for what was evaluated.
    """
    compared = proof.compared
    check_provable(compared, proof.parameters)
    tables = proof_tables(compared, proof.states.problem, proof.parameters)
    parameters = proof.parameters
    bits = price_bits(proof.states, proof.bounds.lower)
    there = _steps_of_tables(proof.states.problem)
    prices = _at_steps(there, estimate_prices(proof.states, proof.prices, proof.reduced, bits))
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
        "parameters": proof_parameters(compared, parameters),
        "price_bits": bits,
        "weight_unit": ONE,
        "sha256": {
            name: hashlib.sha256(text.encode()).hexdigest() for name, text in tables.items()
        },
        **(origin or {}),
    }
    document |= zip(("lower_bound", "upper_bound"), _claim(proof), strict=True)
    return {"proof.json": _json(document, lists), **tables}


def check_provable(compared: Compared, parameters: Parameters) -> None:
    """Whether a proof folder has a place for what was evaluated.

    Raises
    ------
    ConfigError
        The steps are weighted, objects exist with probabilities, or distance, order or an id are
        none that checkers know.
    """
    settings = compared.settings
    for name, what in (
        ("step_weights", "weights of steps"),
        (EXISTENCE, "probabilities of existence"),
    ):
        if name in settings:
            raise ConfigError(f"a proof folder has no place for {what}: leave one of them out")
    if settings["distance"] not in verify_tgospa.EXTRAS:
        raise ConfigError(
            f"a proof folder has no place for the distance {quoted(settings['distance'])}: it "
            f"knows {', '.join(verify_tgospa.EXTRAS)}"
        )
    if parameters.order > verify_tgospa.TOP_ORDER:
        raise ConfigError(
            f"a proof folder has no place for the order {parameters.order:g}: at most "
            f"{verify_tgospa.TOP_ORDER} is checked"
        )
    for name in (*compared.labels.truths, *compared.labels.estimates, *compared.scene.columns):
        if len(name) > csv.field_size_limit() or as_unicode(name) != name:
            raise ConfigError(
                f"a proof folder has no place for the name {quoted(name)}: names are UTF-8, of at "
                f"most {csv.field_size_limit():,} characters"
            )


def check_work(written: Sequence[tuple[Proof, Mapping[str, str]]]) -> None:
    """Whether a checker accepts these folders in their order, for all their near pairs.

    It counts them; where it might refuse, it is asked.

    Raises
    ------
    ConfigError
        It does not.
    """
    account = verify_tgospa.Folder("")
    with suppress(ValueError):
        for proof, texts in written:
            account.size += sum(map(len, texts.values()))
            account.spend(_most_work(proof))
        return
    with tempfile.TemporaryDirectory() as home:
        folder = None
        for proof, texts in written:
            for name, text in texts.items():
                Path(home, name).write_bytes(text.encode())
            folder = verify_tgospa.Folder(home, folder)
            try:
                verify_tgospa.verify(folder)
            except ValueError:
                raise ConfigError(
                    f"a proof folder of {len(proof.states.problem.cost):,} near pairs in "
                    f"{folder.size:,} bytes takes too long to check: choose a smaller cutoff, or "
                    "an order that is a whole number"
                ) from None


def _most_work(proof: Proof) -> float:
    """At most what checking takes: as if all pairs of a step were in neighbouring cells."""
    parameters, problem, compared = proof.parameters, proof.states.problem, proof.compared
    settings, scene = compared.settings, compared.scene
    given = [list(_numbers(settings, name).values()) for name in COLUMN_NUMBERS]
    numbers = np.concatenate(
        [scene.truth.ravel(), scene.estimate.ravel(), [parameters.cutoff, 1.0], *given]
    )
    exponents = np.frexp(numbers[numbers != 0])[1]
    size = 4 * (int(np.ptp(exponents)) + 54)  # of a product of four of them
    if settings["distance"] not in CLOSED:
        size = max(size, 2400)  # of a distance, which may be any double
    truths, estimates = (np.bincount(side.step, minlength=1) for side in problem.sides)
    steps = min(len(truths), len(estimates))
    pairs = float(truths[:steps] @ estimates[:steps].astype(np.float64))
    exponent = Fraction(parameters.order) / (2 if settings["distance"] == "euclidean" else 1)
    bits = price_bits(proof.states, proof.bounds.lower) + verify_tgospa.MORE_BITS
    return pairs * verify_tgospa.pair_work(len(scene.columns) + 1, size) + len(
        problem.cost
    ) * verify_tgospa.power_work(exponent, size, bits)


def proof_parameters(compared: Compared, parameters: Parameters) -> dict[str, object]:
    """The parameters of the metric, as texts of the doubles used."""
    settings = compared.settings
    return {
        "cutoff": repr(parameters.cutoff),
        "order": repr(parameters.order),
        "switch_penalty": repr(parameters.switch_penalty),
        **({} if parameters.rho == 0.5 else {"rho": repr(parameters.rho)}),
        "distance": settings["distance"],
        "columns": list(compared.scene.columns),
        **{
            name: {column: repr(value) for column, value in _numbers(settings, name).items()}
            for name in COLUMN_NUMBERS
            if name in settings
        },
        **{
            name: settings[name]
            for name in Settings.__annotations__
            if name in settings and name not in COLUMN_NUMBERS
        },
    }


def _claim(proof: Proof) -> list[str]:
    """The printed bounds of the total; wider by the rounding of distances that have no proven one.

    Relative, (d / c)^p of a distance that `proof_tables` computes from a cost; absolute, d of boxes
    (a ratio near 1 taken from 1) and round a circle (a difference taken from the period), of which
    an assignment has as many as the smaller side has states.
    """
    parameters, settings = proof.parameters, proof.compared.settings
    order, problem = parameters.order, proof.states.problem
    relative = absolute = 0.0
    if settings["distance"] not in CLOSED:
        least = float(problem.cost.min(initial=1.0, where=problem.cost > 0))
        relative = order * 2.0**-49 + abs(math.log(least)) * 2.0**-52
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
    """The steps at which something exists: a checker knows no others."""
    return np.unique(np.concatenate([side.step for side in problem.sides]))


def _at_steps(there: Ints, prices: Prices) -> Prices:
    """The same prices at such steps alone: at the next one, or the last.

    Whoever uses an estimate there may as well use it from before, or to the end, and pays once.
    """
    found: Prices = Counter()
    steps = np.array([step for _, step in prices], np.int64)
    moved = there[np.minimum(np.searchsorted(there, steps), len(there) - 1)].tolist()
    for ((track, _), price), step in zip(prices.items(), moved, strict=True):
        found[track, step] += price
    return found


def _stretches(proof: Proof, there: Ints) -> Iterable[tuple[int, int, int, int, int]]:
    """Truth, estimate, first and last step, and weight of each stretch of equal weights.

    What is held to an end of the window of its block is held to that end of the recording. Ends
    are among the steps `there`; between two of them nothing is gained, so the cost does not grow.
    """
    states, weights = proof.states, proof.weights
    opens = changed(states.pair_first, weights)
    opens[states.pair_first[:-1]] = True
    first = np.flatnonzero(opens)
    ends = states.end
    last = np.append(first[1:], len(weights))[: len(first)] - 1
    used = weights[first] > 0
    first, last = first[used], last[used]
    pair = states.pair[first]
    block = states.pair_block[pair]
    begin, end = states.begin[first].astype(np.int64), ends[last].astype(np.int64)
    begin[begin == states.block_begin[block]] = 0
    end[end == states.block_end[block]] = states.problem.steps - 1
    begin, end = np.searchsorted(there, begin), np.searchsorted(there, end, "right") - 1
    kept = np.flatnonzero(begin <= end)
    return zip(
        states.pair_truth[pair[kept]].tolist(),
        states.pair_estimate[pair[kept]].tolist(),
        there[begin[kept]].tolist(),
        there[end[kept]].tolist(),
        weights[first[kept]].tolist(),
        strict=True,
    )


def _numbers(settings: Mapping[str, object], name: str) -> dict[str, float]:
    """A setting that has a number for some columns."""
    found = settings.get(name, {})
    assert isinstance(found, Mapping)
    return dict(found)


def _json(document: Mapping[str, object], lists: Mapping[str, Iterable[str]]) -> str:
    """A line for each field, and for each element of the lists."""
    texts = {
        name: json.dumps(value, sort_keys=True, ensure_ascii=False)
        for name, value in document.items()
    }
    texts |= {name: "[\n  " + ",\n  ".join(rows) + "\n ]" for name, rows in lists.items()}
    return "{\n" + ",\n".join(f' "{name}": {texts[name]}' for name in sorted(texts)) + "\n}\n"
