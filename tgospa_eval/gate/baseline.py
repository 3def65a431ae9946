"""Baselines: values, options and the truth's digest of each pair, as JSON made for git."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation import Summary
from tgospa_eval.gate.rules import BY_CLASS, PROVEN, SPLIT, TAILS, Value

SCHEMA = "tgospa-eval/baseline/1"
SOLVING = ("solver", "gap", "epsilon", "time_limit")
"""Parameters that change the bracket and not the metric: those of two runs may differ."""

BOUNDS = ("lower_bound", "upper_bound")
VALUES = (*PROVEN, *SPLIT, *BOUNDS)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What a baseline keeps of one pair.

    Parameters
    ----------
    values : dict of str to float
        By path: `upper_bound` and what follows from it, the split, `lower_bound`.
    options : dict
        Options that were given, by their names in a configuration file.
    parameters : dict
        Every option that changes the number, as in the JSON of a result.
    truth : str
        Digest of the truth.
    version : str
        Version of the program that made it.
    """

    values: Mapping[str, float]
    options: Mapping[str, Any]
    parameters: Mapping[str, Any]
    truth: str
    version: str


Baseline = dict[str, Entry]
"""By name of the pair."""


def measure(result: Summary) -> dict[str, Value]:
    """The values of a result that rules can name, with what is known of them."""
    found = _measure(result)
    if result.per_class_table():
        from tgospa_eval.by_class import ByClass  # here: few evaluate classes apart

        assert isinstance(result, ByClass)
        for name, part in result.results.items():
            found |= {f"{BY_CLASS}{name}.{path}": value for path, value in _measure(part).items()}
    return found


def _measure(result: Summary) -> dict[str, Value]:
    lower = result.scale * result.proof.bounds.lower
    normalised = result.normalised["tgospa"]
    share = normalised / result.upper_bound if result.upper_bound > 0 else 0.0
    brackets = {
        "total": (lower, result.total, result.scale),
        "tgospa": (result.lower_bound, result.upper_bound, 1.0),
        "normalised.tgospa": (min(share * result.lower_bound, normalised), normalised, 1.0),
    }
    found = {
        path: Value(lower=low, upper=high, proven=True, unit=unit)
        for path, (low, high, unit) in brackets.items()
    }
    for path in SPLIT:
        kind, _, count = path.partition(".")
        number = result.counts[count] if count else getattr(result, kind)
        unit = 1.0 if count else result.scale
        found[path] = Value(lower=number, upper=number, proven=False, unit=unit)
    return found


def make_entry(result: Summary, options: Mapping[str, Any]) -> Entry:
    """What a baseline keeps of a result that was made with these options."""
    values = {path: value.upper for path, value in measure(result).items()}
    values |= {"lower_bound": result.lower_bound, "upper_bound": result.upper_bound}
    return Entry(
        values=values,
        options=dict(options),
        parameters=_plain(result.parameters),
        truth=result.input["truth"]["sha256"],
        version=result.version,
    )


def differences(entry: Entry, result: Summary) -> list[str]:
    """Why a result cannot be compared with an entry; empty if it can."""
    ours, theirs = _plain(result.parameters), entry.parameters
    found = [
        f"{name} is {_shown(ours, name)}, in the baseline {_shown(theirs, name)}"
        for name in sorted({*ours, *theirs} - {*SOLVING})
        if ours.get(name) != theirs.get(name)
    ]
    if result.input["truth"]["sha256"] != entry.truth:
        found.append("the truth is not that of the baseline (sha256 of ids, times, states)")
    return found


def _plain(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """As they come back from JSON."""
    plain: dict[str, Any] = json.loads(json.dumps(parameters, allow_nan=False))
    return plain


def _shown(parameters: Mapping[str, Any], name: str) -> str:
    return json.dumps(parameters[name], ensure_ascii=False) if name in parameters else "not set"


def dump(baseline: Baseline) -> str:
    """The baseline as JSON: sorted, a line for each number, full doubles."""
    document = {
        "schema": SCHEMA,
        "pairs": {
            name: {
                "values": _nested(entry.values),
                "options": entry.options,
                "parameters": entry.parameters,
                "truth": {"sha256": entry.truth},
                "version": entry.version,
            }
            for name, entry in baseline.items()
        },
    }
    return json.dumps(document, sort_keys=True, allow_nan=False, indent=1) + "\n"


def load(path: str) -> Baseline | None:
    """Read a baseline; None if there is no such file.

    Raises
    ------
    ConfigError
        It cannot be read, or is no baseline of this version.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        return None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not UTF-8 text; a baseline is JSON") from None
    except (OSError, ValueError) as error:
        reason = "is a folder" if Path(path).is_dir() else getattr(error, "strerror", error)
        raise ConfigError(f"{path}: cannot be read: {reason}") from None
    try:
        document = json.loads(text, parse_constant=_no_number, object_pairs_hook=_once)
    except json.JSONDecodeError as error:
        line = (text.splitlines() or [""])[error.lineno - 1 : error.lineno]
        mark = " (a merge conflict)" if line and line[0].startswith(("<<<<<<<", "=======")) else ""
        raise ConfigError(
            f"{path}, line {error.lineno}: not valid JSON{mark}: {error.msg}; mend it, or "
            "delete the file and make it anew with --update-baseline"
        ) from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: {error}") from None
    return _read(document, path)


def _no_number(text: str) -> Any:
    raise ValueError(f"{text} is no number of JSON; every value must be finite")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose names are all different: JSON would take the last of two."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f'"{name}" is there twice in one object; delete one')
        found[name] = value
    return found


def _read(document: Any, path: str) -> Baseline:
    schema = document.get("schema") if isinstance(document, dict) else None
    family = SCHEMA.rpartition("/")[0]
    if schema != SCHEMA:
        if isinstance(schema, str) and schema.rpartition("/")[0] == family:
            raise ConfigError(
                f'{path}: has the schema "{schema}", this version reads "{SCHEMA}"; use the '
                "version that made it, or delete the file and make it anew with --update-baseline"
            )
        raise ConfigError(f'{path}: is no baseline: its "schema" is not "{SCHEMA}"')
    pairs = _table(document, "pairs", path)
    return {name: _entry(_table(pairs, name, path), f'{path}, pair "{name}"') for name in pairs}


def _entry(table: dict[str, Any], where: str) -> Entry:
    values = _flat(_table(table, "values", where), where)
    missing = [path for path in VALUES if path not in values]
    if missing:
        raise ConfigError(f"{where}: values.{missing[0]} is missing; {REMEDY}")
    truth = _table(table, "truth", where).get("sha256")
    if not isinstance(truth, str) or not isinstance(table.get("version"), str):
        raise ConfigError(f"{where}: truth.sha256 or version is no text; {REMEDY}")
    return Entry(
        values=values,
        options=_table(table, "options", where),
        parameters=_table(table, "parameters", where),
        truth=truth,
        version=table["version"],
    )


REMEDY = "mend it, or make it anew with --update-baseline"


def _table(parent: dict[str, Any], name: str, where: str) -> dict[str, Any]:
    table = parent.get(name)
    if not isinstance(table, dict):
        raise ConfigError(f'{where}: "{name}" must be an object; {REMEDY}')
    return table


def _flat(values: dict[str, Any], where: str, prefix: str = "") -> dict[str, float]:
    """Numbers by path."""
    found: dict[str, float] = {}
    for name, value in values.items():
        path = f"{prefix}{name}"
        if isinstance(value, dict):
            found |= _flat(value, where, f"{path}.")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise ConfigError(
                f"{where}: values.{path} is {json.dumps(value)}: must be a number, finite "
                f"and >= 0; {REMEDY}"
            )
        else:
            found[path] = float(value)
    return found


def _finite(value: float) -> bool:
    try:
        return value >= 0 and math.isfinite(value)
    except OverflowError:  # an integer of JSON that no double holds
        return False


def _nested(values: Mapping[str, float]) -> dict[str, Any]:
    """The values as in the JSON of a result."""
    nested: dict[str, Any] = {}
    for path, value in values.items():
        inner, name = nested, path
        if path.startswith(BY_CLASS):
            # The name of a class may have dots itself.
            tail = next(tail for tail in TAILS if path.endswith(f".{tail}"))
            klass = path[len(BY_CLASS) : -len(tail) - 1]
            inner = nested.setdefault("by_class", {}).setdefault(klass, {})
            name = tail
        head, dot, rest = name.partition(".")
        if dot:
            inner.setdefault(head, {})[rest] = value
        else:
            inner[name] = value
    return nested
