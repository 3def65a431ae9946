"""Baselines: values, options and what was judged of each pair, as JSON made for git."""

import json
import math
from collections.abc import Mapping
from typing import Any, TypeAlias

from tgospa_eval.campaign.row import Row, row_of
from tgospa_eval.campaign.rules import PROVEN, SPLIT, Key, Value
from tgospa_eval.common.files import is_missing, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, SolverError
from tgospa_eval.results.records import json_text
from tgospa_eval.results.saved import contradiction, strict_json, unlike
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import quoted
from tgospa_eval.tracks.judged import JUDGE_ALIKE, JUDGED_FIELDS, fault_of, incomparable, judged_of


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One evaluation, of this run or stored.

    Parameters
    ----------
    values : mapping of str, or of class and str, to Value
        Those that rules can name.
    bounds : pair of float
        Of the metric, in state units.
    parameters : mapping
        As in the JSON of a result.
    judged : mapping
        What it was judged on, as in the JSON of a result.
    version : str
        Of the program.
    status : str
        How the solver ended.
    certified : bool
        Whether the asked gap was met.
    """

    values: Mapping[Key, Value]
    bounds: tuple[float, float]
    parameters: Mapping[str, object]
    judged: Mapping[str, Any]
    version: str
    status: str
    certified: bool

    @property
    def order(self) -> float:
        """The order p."""
        return float(str(self.parameters["order"]))

    @property
    def relative_gap(self) -> float:
        """Of the total."""
        total = self.values["total"]
        return (total.upper - total.lower) / total.upper if total.upper > 0 else 0.0

    @property
    def remedy(self) -> str:
        """Which option makes the bracket narrower, by how the solver ended."""
        settings, name = self.parameters, self.parameters["solver"]
        if "time limit" in self.status and "time_limit" in settings:
            return f"a larger --time-limit than {settings['time_limit']:g}"
        if name == "sinkhorn":
            if "bracket is met" in self.status:
                return f"a smaller --gap than {settings['gap']:g}, or --solver certified"
            return f"a smaller --epsilon than {settings['epsilon']:g}, or --solver certified"
        if name == "exact":
            return "--solver certified narrows the bracket"
        if not self.certified:
            return (
                f'the solver ended with "{self.status}"; let the rule allow more, or try --solver '
                "exact"
            )
        if float(str(settings["gap"])) <= ROUNDING_GAP:
            return "the bracket is about as narrow as rounding; let the rule allow more"
        return f"a smaller --gap than {settings['gap']:g}"


ROUNDING_GAP = 1e-9
"""Relative gap of certified that is about as narrow as rounding."""


def measured(result: Summary) -> Measured:
    """What a gate judges of a result."""
    found = values_of(row_of(result), result.scale)
    if result.table("per_class"):
        from tgospa_eval.results.by_class import ByClass  # here: few evaluate classes apart

        assert isinstance(result, ByClass)
        for name, part in result.results.items():
            values = values_of(row_of(part), part.scale)
            found |= {(name, str(path)): value for path, value in values.items()}
    settings = json.loads(json.dumps(result.parameters, allow_nan=False))  # as they come back
    return Measured(
        values=found,
        bounds=(result.lower_bound, result.upper_bound),
        parameters=settings,
        judged={name: result.judged[name] for name in JUDGED_FIELDS},
        version=result.version,
        status=str(result.solver["status"]),
        certified=result.certified,
    )


def values_of(numbers: Mapping[str, float], scale: float) -> dict[Key, Value]:
    """Values that rules can name, with their brackets.

    Parameters
    ----------
    numbers : mapping of str to float
        Each by its path, and the bounds `total_lower` and `lower_bound`.
    scale : float
        c^p.
    """
    normalised, tgospa = numbers["normalised.tgospa"], numbers["tgospa"]
    share = normalised / tgospa if tgospa > 0 else 0.0
    brackets = {
        "total": (numbers["total_lower"], numbers["total"], scale),
        "tgospa": (numbers["lower_bound"], tgospa, 1.0),
        "normalised.tgospa": (share * numbers["lower_bound"] * (1 - 2.0**-50), normalised, 1.0),
    }
    found: dict[Key, Value] = {
        path: Value(lower=low, upper=high, proven=True, unit=unit)
        for path, (low, high, unit) in brackets.items()
    }
    for path in SPLIT:
        unit = 1.0 if path.startswith("counts.") else scale
        found[path] = Value(lower=numbers[path], upper=numbers[path], proven=False, unit=unit)
    return found


def measured_row(row: Row) -> Measured:
    """What a gate judges of a row of a store."""
    return Measured(
        values=values_of(row, row["cutoff"] ** row["order"]),
        bounds=(row["lower_bound"], row["upper_bound"]),
        parameters=json.loads(row["parameters"]),
        judged=judged_of(row),
        version=row["version"],
        status=row["message"],
        certified=bool(row["certified"]),
    )


SCHEMA = "tgospa-eval/baseline/2"
BOUNDS = ("lower_bound", "upper_bound")
MEASURED = (*PROVEN, *SPLIT)
BASELINE_VALUES = (*MEASURED, *BOUNDS)
MADE = "the JSON that --update-baseline makes"


@dataclass(frozen=True, kw_only=True)
class BaselineEntry:
    """What a baseline keeps of one pair.

    Parameters
    ----------
    values : dict of str, or of class and str, to float
        By path: `upper_bound` and what follows from it, the split, `lower_bound`.
    options : dict
        Options that were given, by their names in a configuration file.
    parameters : dict
        Every option that changes the number, as in the JSON of a result.
    judged : mapping
        What it was judged on, as in the JSON of a result.
    version : str
        Version of the program that made it.
    """

    values: Mapping[Key, float]
    options: Mapping[str, object]
    parameters: Mapping[str, object]
    judged: Mapping[str, Any]
    version: str


Table: TypeAlias = dict[str, object]
"""An object of JSON that was read."""

Baseline: TypeAlias = dict[str, BaselineEntry]
"""By name of the pair."""


def make_entry(now: Measured, options: Mapping[str, object]) -> BaselineEntry:
    """What a baseline keeps of a result that was made with these options.

    Raises
    ------
    SolverError
        A value is not finite.
    """
    values = {key: value.upper for key, value in now.values.items()}
    values |= dict(zip(BOUNDS, now.bounds, strict=True))
    if not all(map(math.isfinite, values.values())):
        raise SolverError("the bracket is not finite; no baseline can be made of it")
    return BaselineEntry(
        values=values,
        options=dict(options),
        parameters=now.parameters,
        judged=now.judged,
        version=now.version,
    )


def differences(entry: BaselineEntry, now: Measured) -> list[str]:
    """Why a result cannot be compared with an entry; empty if it can."""
    found = [
        f"{name} is {own}, in the baseline {other}"
        for name, own, other in unlike(now.parameters, entry.parameters)
    ]
    wrong = incomparable({"now": now.judged, "the baseline": entry.judged})
    return [*found, f"{wrong}; {JUDGE_ALIKE}"] if wrong else found


def dump(baseline: Baseline) -> str:
    """The baseline as JSON: sorted, a line for each number, full doubles."""
    document = {
        "schema": SCHEMA,
        "pairs": {
            name: {
                "values": _nested(entry.values),
                "options": entry.options,
                "parameters": entry.parameters,
                "judged": entry.judged,
                "version": entry.version,
            }
            for name, entry in baseline.items()
        },
    }
    return json_text(document)


def load(path: str) -> Baseline | None:
    """Read a baseline; None if there is no such file.

    Raises
    ------
    ConfigError
        It cannot be read, or is no baseline of this version.
    """
    if is_missing(path):
        return None
    try:
        text = read_bytes(path, ConfigError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not UTF-8 text; a baseline is JSON") from None
    _check_json(text, path)
    try:
        document = strict_json(text)
    except json.JSONDecodeError as error:
        line = (text.splitlines() or [""])[error.lineno - 1 : error.lineno]
        mark = " (a merge conflict)" if line and line[0].startswith(("<<<<<<<", "=======")) else ""
        raise ConfigError(
            f"{path}, line {error.lineno}: not valid JSON{mark}: {error.msg}; is this "
            "the baseline? If so, mend it, or delete it and make it anew with --update-baseline"
        ) from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: {error}") from None
    return _read(document, path)


def _check_json(text: str, path: str) -> None:
    """Whether the text is meant as JSON, and not another file that was named by mistake.

    Raises
    ------
    ConfigError
        The text begins like another kind of file.
    """
    begin = text.lstrip()
    if begin and begin[0] not in "{[<":
        what = f"text that begins with {quoted(begin.splitlines()[0])}"
    elif begin[:1] == "<" and not begin.startswith("<<<<<<<"):
        what = "HTML or XML"
    else:
        return
    raise ConfigError(f"{path}: is no baseline but {what}; a baseline is {MADE}")


def _read(document: object, path: str) -> Baseline:
    table: Table = document if isinstance(document, dict) else {}
    schema = table.get("schema")
    family = SCHEMA.rpartition("/")[0]
    if schema != SCHEMA:
        if isinstance(schema, str) and schema.rpartition("/")[0] == family:
            raise ConfigError(
                f'{path}: has the schema {quoted(schema)}, this version reads "{SCHEMA}"; use the '
                "version that made it, or delete the file and make it anew with --update-baseline"
            )
        what = f"has the schema {quoted(schema)}" if schema else 'has no "schema"'
        raise ConfigError(f"{path}: is no baseline, it {what}; a baseline is {MADE}")
    pairs = _table(table, "pairs", path)
    return {
        name: _entry(_table(pairs, name, path), f"{path}, pair {quoted(name)}") for name in pairs
    }


def _entry(table: Table, where: str) -> BaselineEntry:
    groups = _values(_table(table, "values", where), where)
    order = _table(table, "parameters", where).get("order")
    for name, group in groups.items():
        about = where if name is None else f"{where}, class {quoted(name)}"
        missing = [
            path for path in (BASELINE_VALUES if name is None else MEASURED) if path not in group
        ]
        if missing:
            raise ConfigError(f"{about}: values.{missing[0]} is missing; {REMEDY}")
        wrong = contradiction(group, order)
        if wrong is not None:
            raise ConfigError(f"{about}: values contradict each other: {wrong}; {REMEDY}")
    values: dict[Key, float] = {}
    for name, group in groups.items():
        values |= {(path if name is None else (name, path)): v for path, v in group.items()}
    version = table.get("version")
    if "judged" not in table:
        raise ConfigError(
            f"{where}: made before version 0.2.0, without what it was judged on; renew it with "
            "--update-baseline"
        )
    judged = _table(table, "judged", where)
    if not isinstance(version, str):
        raise ConfigError(f"{where}: version is no text; {REMEDY}")
    if wrong := fault_of(judged):
        raise ConfigError(f"{where}: {wrong}; {REMEDY}")
    return BaselineEntry(
        values=values,
        options=_table(table, "options", where),
        parameters=_table(table, "parameters", where),
        judged=judged,
        version=version,
    )


REMEDY = "mend it, or make it anew with --update-baseline"


def _table(parent: Table, name: str, where: str) -> Table:
    table = parent.get(name)
    if not isinstance(table, dict):
        raise ConfigError(f"{where}: {quoted(name)} must be an object; {REMEDY}")
    return table


def _values(table: Table, where: str) -> dict[str | None, dict[str, float]]:
    """The values by class and path; of all classes together under None."""
    groups: dict[str | None, dict[str, float]] = {
        None: _flat({name: value for name, value in table.items() if name != "by_class"}, where)
    }
    classes = _table(table, "by_class", where) if "by_class" in table else {}
    for name in classes:
        groups[name] = _flat(_table(classes, name, where), where, f"by_class.{name}.")
        groups[name] = {k[len(f"by_class.{name}.") :]: v for k, v in groups[name].items()}
    return groups


def _flat(values: Table, where: str, prefix: str = "") -> dict[str, float]:
    """Numbers by path."""
    found: dict[str, float] = {}
    for name, value in values.items():
        path = f"{prefix}{name}"
        if "." in name:
            raise ConfigError(f"{where}: {quoted(name)} among the values has a dot; {REMEDY}")
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


def _nested(values: Mapping[Key, float]) -> Table:
    """The values as in the JSON of a result."""
    nested: dict[str, Any] = {}
    for key, value in values.items():
        inner, path = nested, key
        if isinstance(path, tuple):
            inner = nested.setdefault("by_class", {}).setdefault(path[0], {})
            path = path[1]
        head, dot, rest = path.partition(".")
        if dot:
            inner.setdefault(head, {})[rest] = value
        else:
            inner[head] = value
    return nested
