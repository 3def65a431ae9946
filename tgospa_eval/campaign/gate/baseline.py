"""Baselines: JSON files for git with the values, the options and the data of each pair."""

import glob
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

from tgospa_eval.campaign.gate.rules import PROVEN, SPLIT, Value
from tgospa_eval.campaign.row import ESTIMATE_DIGEST, Row, same_data
from tgospa_eval.common.documents import ANYTHING, COST, NUMBER, TEXT, Maybe, document_of
from tgospa_eval.common.files import is_missing, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import natural
from tgospa_eval.errors import ConfigError, SolverError
from tgospa_eval.quoting import COMMAND, clipped, option, surface, visible
from tgospa_eval.results.consistency import NEES, NeesSums, fits_sums
from tgospa_eval.results.records import Json, json_text
from tgospa_eval.results.saved import EVALUATED_ON, NEES_RECORD, PARAMETERS, contradiction, unlike
from tgospa_eval.results.summary import SUMMARY, names_summary
from tgospa_eval.tracks.coverage import (
    COVERAGE_FIELDS,
    coverage_of,
    incomparable,
    judge_alike,
    refuse_own_marks,
)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One evaluation that a gate judges, made now or read from a store.

    Parameters
    ----------
    values : mapping of str to Value
        Values that rules can name.
    classes : mapping of str to mapping
        Values of each class, if the classes are evaluated separately.
    bounds : pair of float
        Lower and upper bound of TGOSPA, in state units.
    parameters : mapping
        Parameters, as in the JSON of a result.
    evaluated_on : mapping
        Description of the evaluated data, as in the JSON of a result.
    estimate : str
        Digest of the estimate.
    version : str
        Version of the program.
    status : str
        Message with which the solver ended.
    certified : bool
        Whether the requested gap was met.
    nees : NeesSums, optional
        Sums from which NEES is computed, if there are any.
    silent : bool
        Whether no state of the estimate was evaluated.
    stored : bool
        Whether the values are from a store.
    is_new : bool
        Whether the target of the gate lacks the evaluation.
    """

    values: Mapping[str, Value]
    classes: Mapping[str, Mapping[str, Value]]
    bounds: tuple[float, float]
    parameters: Mapping[str, object]
    evaluated_on: Mapping[str, Any]
    estimate: str
    version: str
    status: str
    certified: bool
    nees: NeesSums | None = None
    silent: bool = False
    stored: bool = False
    is_new: bool = False

    @property
    def order(self) -> float:
        """The order p."""
        return float(str(self.parameters["order"]))

    @property
    def relative_gap(self) -> float:
        """Width of the bracket, relative to the total."""
        total = self.values["total"]
        return (total.upper - total.lower) / total.upper if total.upper > 0 else 0.0

    @property
    def remedy(self) -> str:
        """Advice on how to narrow the bracket, depending on how the solver ended."""
        settings, name = self.parameters, self.parameters["solver"]
        if "time limit" in self.status and "time_limit" in settings:
            return f"use a larger {option('time_limit')} than {settings['time_limit']:g}"
        if name == "sinkhorn":
            if "bracket is met" in self.status:
                return (
                    f"use a smaller {option('gap')} than {settings['gap']:g}, or "
                    f"{option('solver', 'certified')}"
                )
            return (
                f"use a smaller {option('epsilon')} than {settings['epsilon']:g}, or "
                f"{option('solver', 'certified')}"
            )
        if name == "exact":
            return f"{option('solver', 'certified')} narrows the bracket"
        if not self.certified:
            return (
                f'the solver ended with "{self.status}"; let the rule allow more, or try '
                f"{option('solver', 'exact')}"
            )
        if float(str(settings["gap"])) <= ROUNDING_GAP:
            return "the bracket is about as narrow as rounding; let the rule allow more"
        return f"use a smaller {option('gap')} than {settings['gap']:g}"


ROUNDING_GAP = 1e-9
"""A relative gap that is about as small as the rounding errors of the solver `certified`."""


def values_of(numbers: Mapping[str, float], scale: float) -> dict[str, Value]:
    """Return the values that rules can name, with their brackets.

    Parameters
    ----------
    numbers : mapping of str to float
        Numbers of a result by path, including ``total_lower`` and ``lower_bound``.
    scale : float
        Unit of costs: c^p, with the cutoff c and the order p.
    """
    normalised, tgospa = numbers["normalised.tgospa"], numbers["tgospa"]
    share = normalised / tgospa if tgospa > 0 else 0.0
    brackets = {
        "total": (numbers["total_lower"], numbers["total"], scale),
        "tgospa": (numbers["lower_bound"], tgospa, 1.0),
        "normalised.tgospa": (share * numbers["lower_bound"] * (1 - 2.0**-50), normalised, 1.0),
    }
    values: dict[str, Value] = {
        path: Value(lower=low, upper=high, proven=True, unit=unit)
        for path, (low, high, unit) in brackets.items()
    }
    for path in SPLIT:
        unit = 1.0 if path.startswith("counts.") else scale
        values[path] = Value.of(numbers[path], unit)
    return values


def measured(row: Row) -> Measured:
    """Return the values of a row that a gate checks.

    Raises
    ------
    ConfigError
        The option `ignore` uses marks in estimates.
    """
    nees, parameters = NeesSums.of_row(row), json.loads(row["parameters"])
    scale = row["cutoff"] ** row["order"]
    refuse_own_marks(parameters.get("ignore", ()), "gate")
    return Measured(
        nees=nees,
        values=values_of(row, scale) | nees_values(nees) | summary_values(row),
        classes={name: values_of(part, scale) for name, part in row.get("classes", {}).items()},
        bounds=(row["lower_bound"], row["upper_bound"]),
        parameters=parameters,
        evaluated_on=coverage_of(row),
        estimate=row.get(ESTIMATE_DIGEST, ""),
        version=row["version"],
        status=row["message"],
        certified=bool(row["certified"]),
        silent=row.get("sizes.estimate_states") == 0,
        stored="stored" in row,
    )


def nees_values(nees: NeesSums | None) -> dict[str, Value]:
    """Return the values of NEES that rules can name, by path; empty without NEES."""
    numbers = {} if nees is None else nees.numbers()
    return {path: Value.of(value) for path, value in numbers.items()}


def summary_values(numbers: Mapping[str, Any]) -> dict[str, Value]:
    """Return the values of the summary by path, without those that are not defined."""
    known = {path: value for path, value in numbers.items() if names_summary(path)}
    return {
        p: Value.of(value) for p, value in known.items() if value is not None and value == value
    }


def _remedy() -> str:
    return f"repair it, or make a new file with {option('update_baseline')}"


SCHEMA = "tgospa-eval/baseline/2"
BOUNDS = ("lower_bound", "upper_bound")
MEASURED = (*PROVEN, *SPLIT)
BASELINE_VALUES = (*MEASURED, *BOUNDS)

Baseline: TypeAlias = dict[str, Json]
"""Entry of each pair, by the name of the pair, as in the JSON.

The fields of an entry are:

- `values`: upper ends of brackets, `lower_bound` and `upper_bound`, parts and counts of the cost,
  NEES and the summary if known, and the values of classes under `by_class`
- `nights`: the values of earlier runs of the tracker (nights), the newest first
- `options`: the options that were given
- `parameters`: the parameters that change the number
- `judged`: description of the evaluated data
- `estimate_sha256`, `version`, `labels`: digest of the estimate, version of the program, and labels
"""

MAX_NIGHTS = 10
"""Largest number of nights that an entry keeps, including the newest."""


def make_entry(
    now: Measured, options: Mapping[str, object], labels: Mapping[str, str] | None = None
) -> Json:
    """Return the entry of a baseline for a result that was made with these options.

    Raises
    ------
    SolverError
        A value is not finite.
    """
    values = upper_ends({path: one for path, one in now.values.items() if path in MEASURED}) | dict(
        zip(BOUNDS, now.bounds, strict=True)
    )
    if not all(math.isfinite(value.upper) for value in now.values.values()):
        raise SolverError("the bracket is not finite, so it cannot be a baseline")
    if now.nees is not None:
        record = now.nees.record()
        values[NEES] = {name: record[name] for name in ("mean", "anees", "inside", "sums")}
    own = {path: value.upper for path, value in now.values.items() if names_summary(path)}
    if own:
        values[SUMMARY] = {path.removeprefix(f"{SUMMARY}."): value for path, value in own.items()}
    if now.classes:
        values["by_class"] = {name: upper_ends(group) for name, group in now.classes.items()}
    return {
        "values": values,
        "options": dict(options),
        "parameters": now.parameters,
        "judged": now.evaluated_on,
        "estimate_sha256": now.estimate,
        "version": now.version,
        **({"labels": dict(labels)} if labels else {}),
    }


def with_nights(entry: Json, before: Json | None) -> Json:
    """Add the values of the entry `before` to a new entry, as earlier nights.

    Nothing is added if the parameters or the data of the two entries differ. Nights of `before` are
    left out if they have the values of the new entry. If both entries have the same estimate, so is
    the newest night of `before`.
    """
    if before is None or [*unlike(entry["parameters"], before["parameters"])]:
        return entry
    if incomparable({"now": entry["judged"], "before": before["judged"]}):
        return entry
    same = entry["estimate_sha256"] and entry["estimate_sha256"] == before.get("estimate_sha256")
    nights = [one for one in nights_of(before)[1 if same else 0 :] if one != entry["values"]]
    nights = nights[: MAX_NIGHTS - 1]
    return entry | ({"nights": nights} if nights else {})


def nights_of(entry: Json) -> list[Json]:
    """Return the values of each night that an entry keeps, the newest first."""
    return [entry["values"], *entry.get("nights", ())]


def typical(entry: Json) -> Json:
    """Return the values of an entry as means over its nights.

    Roots, such as TGOSPA, are averaged as costs: the root is taken of the mean cost.
    """
    nights, order = nights_of(entry), float(str(entry["parameters"]["order"]))
    if len(nights) == 1:
        values: Json = entry["values"]
        return values

    def mean(path: str, name: str | None = None) -> float:
        power = order if path in (*PROVEN[1:], *BOUNDS) else 1.0
        numbers = [number_in(values, name, path) ** power for values in nights]
        return float((math.fsum(numbers) / len(numbers)) ** (1 / power))

    names = {name for values in nights for name in values.get("by_class", ())}
    sums = NeesSums.joined(filter(None, map(NeesSums.of_values, nights)))
    return {
        **nested({path: mean(path) for path in BASELINE_VALUES}),
        **({} if sums is None else {NEES: sums.record()}),
        SUMMARY: {
            path: mean(f"{SUMMARY}.{path}")
            for path in nights[0].get(SUMMARY, {})
            if all(path in values.get(SUMMARY, {}) for values in nights)
        },
        "by_class": {
            name: nested({path: mean(path, name) for path in MEASURED}) for name in sorted(names)
        },
    }


def number_in(values: Json, name: str | None, path: str) -> float:
    """Return the value at `path`; 0 if it is absent.

    It is the value of the class `name`, or that of all classes if `name` is None.
    """
    own = values if name is None else values.get("by_class", {}).get(name, {})
    return float(value_at(own, path) or 0.0)


def lowest_in(values: Json, order: float, name: str | None, path: str) -> float:
    """Return the proven lower bound of a value, or the value if it has no bounds.

    The bounds of a class are not stored. The difference between its bounds is at most that of all
    classes together. The lower bound of a class is computed from this larger difference.
    """
    value, total = number_in(values, name, path), number_in(values, name, "total")
    if path not in PROVEN or not total:
        return value
    lower, upper = (values[bound] ** order for bound in BOUNDS)
    gap = values["total"] * (1 - lower / upper)
    return float(value * max(1 - gap / total, 0.0) ** (1.0 if path == "total" else 1 / order))


def nested(values: Mapping[str, Any]) -> Json:
    """Return values by path, such as ``counts.missed``, as nested tables as in the JSON."""
    table: Json = {}
    for path, value in values.items():
        head, _, rest = path.partition(".")
        if rest:
            table.setdefault(head, {})[rest] = value
        else:
            table[head] = value
    return table


def upper_ends(values: Mapping[str, Value]) -> Json:
    """Return the upper ends of values, as nested tables as in the JSON."""
    return nested({path: value.upper for path, value in values.items()})


def value_at(values: Json, path: str) -> Any:
    """Return the value at a path such as ``counts.missed``; None if the path does not exist."""
    if names_summary(path):
        return values.get(SUMMARY, {}).get(path.removeprefix(f"{SUMMARY}."))
    value: Any = values
    path = f"{NEES}.mean" if path == NEES else path
    for part in path.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


CHANGED = "not judged on the same"
"""Beginning of notes about a changed ground truth."""


def differences(entry: Json, now: Measured) -> list[str]:
    """Return the reasons why a result cannot be compared with an entry; empty if it can."""
    reasons = [
        f"{name} is {own}, in the baseline {other}"
        for name, own, other in unlike(now.parameters, entry["parameters"])
    ]
    old = entry["judged"]
    wrong = incomparable({"now": now.evaluated_on, "the baseline": old})
    # With the grids "union" and "truth", the estimate does not change which steps of the truth
    # count. A difference therefore means that the truth itself was changed.
    if wrong and now.parameters["grid"] in ("union", "truth"):
        if all(
            old[name] == now.evaluated_on[name]
            for name in COVERAGE_FIELDS
            if name != "truth_sha256"
        ):
            wrong = f"{CHANGED} truth: states of the truth changed, but not their number or steps"
        return [*reasons, f"{wrong}; if you intended this, renew the baseline"]
    return [*reasons, f"{wrong}; {judge_alike()}"] if wrong else reasons


def check_equal(entry: Json, now: Measured) -> None:
    """Check that bounds overlap, if a result and an entry have the same estimate.

    Raises
    ------
    SolverError
        The estimate is the same, but the bounds do not overlap.
    """
    own, old = (
        [Interval(lower=low, upper=high)]
        for low, high in (now.bounds, [entry["values"][name] for name in BOUNDS])
    )
    names = f"now, version {now.version}", f"the baseline, version {entry['version']}"
    same_data(names, ([now.estimate], [entry.get("estimate_sha256", "")]), (own, old))


def dump(baseline: Baseline) -> str:
    """Return the baseline as sorted JSON, with each number on its own line and as a full double."""
    return json_text({"schema": SCHEMA, "pairs": baseline})


def load(path: str, renewed: Callable[[str], bool] | None = None) -> Baseline | None:
    """Read a baseline; None if the file does not exist. `parse` describes `renewed`.

    Raises
    ------
    ConfigError
        The file cannot be read, or is not a baseline of this version.
    """
    return None if is_missing(path) else parse(read_bytes(path, ConfigError), path, renewed)


CONFLICT = rb"(?ms)^<{7}[^\n]*\n(.*?)(?:^\|{7}[^\n]*\n.*?)?^={7}[^\n]*\n(.*?)^>{7}[^\n]*\n?"
"""Pattern of a merge conflict of git. Its two groups are the lines of each branch."""

MARK = rb"(?m)^(?:<{7}|\|{7}|={7}|>{7})[^\n]*\n?"


def in_conflict(path: str) -> bool:
    """Return whether a file has marks of a merge conflict."""
    return bool(re.search(MARK, read_bytes(path, ConfigError)))


def parse(content: bytes, path: str, renewed: Callable[[str], bool] | None = None) -> Baseline:
    """Read a baseline from the text of a file; messages name it by `path`.

    A merge conflict is accepted if `renewed` returns True for the name of each entry in conflict.
    An update of the baseline makes these entries again.

    Raises
    ------
    ConfigError
        The text is not a baseline of this version, or has a merge conflict that is not accepted.
    """
    name = f"{path}: is not a baseline"
    pairs: Baseline
    open_ = set[str]()
    if re.search(MARK, content):
        name = f"{path}: has a merge conflict"
        texts = (re.sub(MARK, b"", re.sub(CONFLICT, side, content)) for side in (rb"\1", rb"\2"))
        pairs, other = (
            document_of(text, name, SCHEMA, BASELINE, ConfigError, remedy=_remedy())["pairs"]
            for text in texts
        )
        open_ = {pair for pair in {*pairs, *other} if pairs.get(pair) != other.get(pair)}
        pairs = other | pairs
        if renewed is None or not all(map(renewed, open_)):
            from shlex import join  # lazy: conflicts are rare

            some = [*patterns_of(open_, {*pairs})]
            way = f"update_baseline=True, only={some}"
            if surface.get() == COMMAND:
                only = [text for one in some for text in ("--only", one)]
                way = join(["--update-baseline", *only])
            remedy = f"{way} renews only the entries in conflict"
            if visible(way) != way:
                remedy = f"{option('update_baseline')} renews all entries"
            if not open_:
                remedy = "delete the conflict markers: the lines with <<<<<<<, ======= and >>>>>>>"
            raise ConfigError(f"{name}; {remedy}")
    else:
        pairs = document_of(content, name, SCHEMA, BASELINE, ConfigError, remedy=_remedy())["pairs"]
    for pair, entry in pairs.items():
        wrong = None if pair in open_ else _contradiction(entry)
        if wrong:
            raise ConfigError(f"{name}: pairs.{clipped(pair)}.{wrong}; {_remedy()}")
    return pairs


def _values(paths: Iterable[str]) -> Json:
    """Return the expected form of a JSON with a cost or a count at each of these paths."""
    return nested(dict.fromkeys(paths, COST))


VALUES = {
    **_values(BASELINE_VALUES),
    NEES: Maybe(NEES_RECORD),
    SUMMARY: Maybe({...: NUMBER}),
    "by_class": Maybe({...: _values(MEASURED)}),
}

BASELINE = {
    "pairs": {
        ...: {
            "values": VALUES,
            "nights": Maybe([VALUES]),
            "options": {...: ANYTHING},
            "parameters": PARAMETERS,
            "judged": EVALUATED_ON,
            "estimate_sha256": Maybe(TEXT),
            "version": TEXT,
            "labels": Maybe({...: TEXT}),
        }
    }
}
"""Fields of a baseline, and the kinds of their values."""


def _contradiction(entry: Json) -> str | None:
    """Describe the first value of an entry that contradicts the others; None if all fit."""
    for night, values in enumerate(nights_of(entry)):
        place = f"nights.{night - 1}" if night else "values"
        classes = values.get("by_class", {})
        groups = [(place, values, BASELINE_VALUES)]
        groups += [(f"{place}.by_class.{clipped(n)}", classes[n], MEASURED) for n in classes]
        for where, group, paths in groups:
            numbers = {path: value_at(group, path) for path in paths}
            wrong = contradiction(
                numbers | {"judged.steps": entry["judged"]["steps"]}, entry["parameters"]
            )
            if wrong:
                return f"{where}.{wrong}"
        if NEES in values and not fits_sums(values[NEES]):
            return f"{place}.{NEES} does not follow from its sums"
    return None


def patterns_of(names: set[str], everything: set[str]) -> list[str]:
    """Return patterns that match all of `names`, and no other names of `everything`.

    If several names begin with ``slow/``, and `names` has all of them, their pattern is ``slow/*``.
    """
    all_of, chosen_of = (
        Counter(name.partition("/")[0] for name in some if "/" in name)
        for some in (everything, names)
    )
    patterns = dict[str, None]()  # in order, each once
    for name in sorted(names, key=natural):
        head, slash, _ = name.partition("/")
        whole = slash and 1 < all_of[head] == chosen_of[head]
        patterns[f"{glob.escape(head)}/*" if whole else glob.escape(name)] = None
    return [*patterns]
