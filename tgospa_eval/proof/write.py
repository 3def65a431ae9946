"""A result as a proof folder: both tables as compared, prices, assignment, and the claim.

What is written is checked before, by the program that anybody may check it with; so a folder that
does not prove its claim is never written.
"""

import decimal
import hashlib
import json
from collections.abc import Iterable, Mapping

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.errors import SolverError
from tgospa_eval.problem.slots import changed
from tgospa_eval.problem.weights import ONE
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.prices import estimate_prices, price_bits
from tgospa_eval.proof.tables import proof_tables, times_of
from tgospa_eval.results.result import Proof

LARGEST_DIFFERENCE = 1e-9
"""Relative to the upper bound: more between the bounds of the certificate and those of the checker
is no rounding of distances, but a fault."""


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
    SolverError
        The proof does not hold, which only a fault of this program can bring about.
    """
    compared = proof.compared
    tables = proof_tables(compared, proof.states.problem, proof.parameters)
    parameters = proof.parameters
    settings = compared.settings
    bits = price_bits(proof.states)
    times = times_of(compared)
    truths, estimates = compared.labels.truths, compared.labels.estimates
    prices = estimate_prices(proof.states, proof.prices, proof.reduced, bits)
    document = {
        "schema": verify_tgospa.SCHEMA,
        "version": __version__,
        "parameters": {
            "cutoff": repr(parameters.cutoff),
            "order": repr(parameters.order),
            "switch_penalty": repr(parameters.switch_penalty),
            "distance": settings["distance"],
            "columns": list(compared.scene.columns),
            **{name: _texts(settings[name]) for name in ("scale", "periodic") if name in settings},
        },
        "price_bits": bits,
        "weight_unit": ONE,
        "prices": [
            [estimates[track], times[step], price]
            for (track, step), price in sorted(prices.items())
            if price
        ],
        "assignment": [
            [truths[truth], estimates[estimate], times[first], times[last], weight]
            for truth, estimate, first, last, weight in _stretches(proof)
        ],
        "sha256": {
            name: hashlib.sha256(text.encode()).hexdigest() for name, text in tables.items()
        },
        **(origin or {}),
    }
    document |= zip(("lower_bound", "upper_bound"), _claim(proof, tables, document), strict=True)
    return {"proof.json": _json(document), **tables}


def _claim(proof: Proof, tables: Mapping[str, str], document: Mapping[str, object]) -> list[str]:
    """The bounds of the total, as printed; wider where the checker finds less.

    That happens where no bound of the rounding of a distance is known: round a circle, of boxes, or
    of those that are computed from costs.
    """
    totals, _ = verify_tgospa.found_bounds(lambda name: tables[name].encode(), document)
    scale = proof.parameters.cutoff**proof.parameters.order
    printed = proof.bounds.lower * scale, proof.bounds.upper * scale
    bounds = [
        min(decimal.Decimal(np.nextafter(printed[0], 0.0)), totals[0]),
        max(decimal.Decimal(np.nextafter(printed[1], np.inf)), totals[1]),
    ]
    widened = float(bounds[1] - bounds[0]) - (printed[1] - printed[0])
    if widened > LARGEST_DIFFERENCE * printed[1] and printed[1] > proof.bounds.rounding * scale:
        raise SolverError(
            f"the proof does not hold: bounds {printed[0]!r} and {printed[1]!r}, found "
            f"{totals[0]:.17g} and {totals[1]:.17g}: please report this as a bug, with the files"
        )
    return verify_tgospa.rounded(bounds)


def _stretches(proof: Proof) -> Iterable[tuple[int, int, int, int, int]]:
    """Truth, estimate, first and last step, and weight of each stretch of equal weights.

    What is held to an end of the window of its block is held to that end of the recording.
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
    return zip(
        states.pair_truth[pair].tolist(),
        states.pair_estimate[pair].tolist(),
        begin.tolist(),
        end.tolist(),
        weights[first].tolist(),
        strict=True,
    )


def _texts(numbers: object) -> dict[str, str]:
    """Numbers by name as texts that are read back as the same doubles."""
    assert isinstance(numbers, Mapping)
    return {name: repr(value) for name, value in numbers.items()}


def _json(document: Mapping[str, object]) -> str:
    """A line for each price and stretch: it can be read, and compared line by line."""
    parts = []
    for name, value in sorted(document.items()):
        if name in ("prices", "assignment") and value:
            assert isinstance(value, list)
            rows = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in value)
            text = f"[\n  {rows}\n ]"
        else:
            text = json.dumps(value, sort_keys=True, ensure_ascii=False)
        parts.append(f' "{name}": {text}')
    return "{\n" + ",\n".join(parts) + "\n}\n"
