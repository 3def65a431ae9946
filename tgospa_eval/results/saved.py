"""Saved results: their JSON read strictly, and whether two can be compared. Solves nothing."""

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import NoReturn

from tgospa_eval.common.files import read_bytes
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import InputError
from tgospa_eval.results.consistency import NEES, right_record
from tgospa_eval.results.numbers import SPLIT_PARTS
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.summary import BRACKET, RESULT_SCHEMA
from tgospa_eval.text import quoted
from tgospa_eval.tracks.judged import fault_of

ACCURACY = ("solver", "gap", "epsilon", "time_limit")
"""Parameters that change the bracket and not the metric: those of two runs may differ."""

NEUTRAL = ("unit", "decimal")
"""Parameters that change neither: how the files are written, and what is printed."""

AGREE, ADD_UP = 1e-9, 1e-6
"""Relative tolerances of values that are the same, and of parts that were summed."""

LARGEST_RESULT = 1 << 32
"""Bytes that no saved result has."""

RESULT_FILE = "result.json"
"""The result in a folder of ``-o``."""

FAMILY = RESULT_SCHEMA.rpartition("/")[0] + "/"
MADE_BY = f"a saved result is the {RESULT_FILE} of -o, or what --format json prints"


def of_metric(parameters: Mapping[str, object]) -> dict[str, object]:
    """Those that change the number."""
    return {n: value for n, value in parameters.items() if n not in (*ACCURACY, *NEUTRAL)}


def unlike(
    own: Mapping[str, object], other: Mapping[str, object]
) -> Iterator[tuple[str, str, str]]:
    """Parameters of the metric, as JSON has them, in which two differ: name and both values."""

    def shown(parameters: Mapping[str, object], name: str) -> str:
        there = name in parameters
        return json.dumps(parameters[name], ensure_ascii=False) if there else "not set"

    for name in sorted(of_metric({**own, **other})):
        if own.get(name) != other.get(name):
            yield name, shown(own, name), shown(other, name)


def contradiction(values: Mapping[str, float], order: object) -> str | None:
    """In what tgospa, its bounds, total and parts do not fit each other; None if they do."""
    total = values["total"]
    upper = values.get("upper_bound", values["tgospa"])
    if not math.isclose(values["tgospa"], upper, rel_tol=AGREE):
        return "tgospa is not upper_bound"
    if values.get("lower_bound", 0.0) > upper:
        return "lower_bound is above upper_bound"
    if not _is_power(total, upper, order):
        return "total is not tgospa to the power of the order"
    if not math.isclose(sum(values[part] for part in PARTS), total, rel_tol=ADD_UP):
        return f"{', '.join(PARTS)} do not add up to total"
    return None


def _is_power(total: float, value: float, order: object) -> bool:
    """Whether the total is the value to the power of the order, as far as that is a number."""
    if isinstance(order, bool) or not isinstance(order, int | float):
        return True  # which makes the pair not comparable
    try:
        return math.isclose(total, value**order, rel_tol=AGREE * max(order, 1), abs_tol=1e-300)
    except (OverflowError, ZeroDivisionError):
        return False


def strict_json(text: str) -> object:
    """What JSON says, without NaN, infinities and repeated names.

    Raises
    ------
    ValueError
        It is no JSON, or has one of these.
    """
    return json.loads(text, parse_constant=_no_number, object_pairs_hook=_once)


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number of JSON; every value must be finite")


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """An object whose names are all different: JSON would take the last of two."""
    found: dict[str, object] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"{quoted(name)} is there twice in one object; delete one")
        found[name] = value
    return found


def saved_result(path: str) -> str | None:
    """The JSON of a result at a path, which may be its folder; None if there is none."""
    if os.path.isdir(path):
        path = os.path.join(path, RESULT_FILE)
    if not os.path.isfile(path):  # a pipe can be read once only
        return None
    with suppress(OSError), open(path, "rb") as file:  # who reads it says what is wrong
        begin = file.read(64)
        is_object = begin.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"
        if is_object and f'"{FAMILY}'.encode() in begin + file.read():
            return path
    return None


def read_result(path: str) -> Json:
    """The document of a saved result, as far as rankings need it checked.

    Raises
    ------
    InputError
        It is no result, or was changed by hand.
    """
    try:
        document = strict_json(read_bytes(path, InputError, LARGEST_RESULT).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}; {MADE_BY}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(document, dict) or schema != RESULT_SCHEMA:
        raise InputError(
            f'{path}: has the schema {quoted(str(schema))}, this version reads "{RESULT_SCHEMA}"; '
            f"{MADE_BY}"
        )
    if "per_step" not in document and "tables" in document:
        raise InputError(
            f"{path}: of data in parts, with more steps than a ranking takes; evaluate parts of "
            "the recording, by --time"
        )
    try:
        wrong = _fault(document)
    except KeyError as error:
        wrong = f"{error} is missing"
    except (TypeError, AttributeError, ValueError, ArithmeticError):
        wrong = "not as this program wrote it"
    if wrong is not None:
        raise InputError(f"{path}: {wrong}; evaluate again and save the result anew")
    return document


def _fault(document: Json) -> str | None:
    """What is wrong with the numbers; other exceptions tell what is missing."""
    parameters, steps = document["parameters"], document["per_step"]
    values = {name: document[name] for name in (*BRACKET[:4], *PARTS)}
    values |= {f"counts.{name}": value for name, value in document["counts"].items()}
    values |= {"normalised.tgospa": document["normalised"]["tgospa"]}
    values |= {
        f"per_step.{name}": math.fsum(step[name] for step in steps) for name in (*PARTS, "total")
    }
    values |= {name: parameters[name] for name in ("cutoff", "order", "switch_penalty")}
    values |= {name: document[name] for name in SPLIT_PARTS if name in document}
    if NEES in document and not right_record(document[NEES]):
        return f"{NEES} is not as this program wrote it, or its sums are of other numbers"
    for name, value in values.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not 0 <= float(value) < math.inf:
            return f"{name} is {json.dumps(value)}: must be a number, finite and >= 0"
    others = [value for found in document.get("with", {}).values() for value in found.values()]
    if not all(math.isfinite(value) for value in others):
        return "other metrics must be finite numbers"
    for name in (*PARTS, "total"):
        if not math.isclose(values[f"per_step.{name}"], values[name], rel_tol=ADD_UP):
            return f"values contradict each other: per_step.{name} does not add up to {name}"
    texts = (
        parameters["distance"],
        document["solver"]["status"],
        *(document["input"][side]["sha256"] for side in ("truth", "estimate")),
        *(text for notice in document["warnings"] for text in asdict(Notice(**notice)).values()),
    )
    times = [step["t"] for step in steps]
    if not all(isinstance(t, int | float | str) and not isinstance(t, bool) for t in times):
        return "t of a step is neither number nor text"
    if not all(isinstance(text, str) for text in texts):
        return "not as this program wrote it"
    found = contradiction(values, parameters["order"])
    judged = document["judged"]
    each = (values["total"] / max(judged["steps"], 1)) ** (1 / max(parameters["order"], 1))
    if parameters["order"] < 1 or not math.isclose(
        each, values["normalised.tgospa"], rel_tol=ADD_UP
    ):
        found = "normalised.tgospa, judged.steps or the order"
    return fault_of(judged) or (found and f"values contradict each other: {found}")
