"""Suites: several pairs to judge, from a TOML file. Knows names of files, not their content."""

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from typing import TypeAlias

from tgospa_eval.common import config, patterns
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import parsed
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.formats import runs_inside
from tgospa_eval.results.records import PARTS
from tgospa_eval.text import quoted

PROVEN = ("total", "tgospa", "normalised.tgospa")
"""Values with a proven bracket."""

SPLIT = (*PARTS, "counts.missed", "counts.false", "counts.switch")
"""Values of one optimal assignment; another one may split the same total in another way."""

BY_CLASS = "by_class."
TAILS = tuple(sorted((*PROVEN, *SPLIT), key=len, reverse=True))
"""How a path may end, the longer of two first: ``counts.missed`` before ``missed``."""

Key = str | tuple[str, str]
"""A value: a path, or a class and a path of its own; the name of a class may have dots."""

TOLERANCE = 1e-6
"""Of rules on the split: in counts, or in units of c^p."""

LEAST_SLACK = 1e-9
"""Least slack of the default rule, in units of c^p."""

NO_CHANGE = 1e-9
"""Relative change that is no improvement."""

_RULE = r"(?P<path>.+):\+(?P<slack>[^%]+)(?P<percent>%?)"


class Verdict(StrEnum):
    """What is known of a pair, or of one rule."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"
    INCOMPARABLE = "not comparable"
    ERROR = "error"
    UPDATED = "updated"


STATUS = {
    Verdict.PASS: ExitStatus.DONE,
    Verdict.UPDATED: ExitStatus.DONE,
    Verdict.FAIL: ExitStatus.REGRESSION,
    Verdict.INCOMPARABLE: ExitStatus.WRONG_OPTION,
    Verdict.ERROR: ExitStatus.WRONG_INPUT,
    Verdict.UNDECIDED: ExitStatus.NOT_REACHED,
}
"""Exit status of each verdict; an error may bring its own."""

SEVERITY = (
    ExitStatus.REGRESSION,
    ExitStatus.WRONG_INPUT,
    ExitStatus.WRONG_OPTION,
    ExitStatus.NOT_REACHED,
    ExitStatus.DONE,
)
"""Exit statuses, the worst first.

A proven regression comes before everything: who tolerates 2 or 4 in a pipeline must not thereby let
one pass.
"""


def worst(statuses: Iterable[int]) -> int:
    """The exit status of several."""
    return min(statuses, key=SEVERITY.index, default=0)


@dataclass(frozen=True, kw_only=True)
class Value(Interval):
    """A number and what is known of it.

    Parameters
    ----------
    lower, upper : float
        The bracket; of a value of the split both are the reported number.
    proven : bool
        Whether the bracket is proven.
    unit : float
        c^p for costs, 1 for counts: the scale of tolerances.
    """

    proven: bool
    unit: float

    @property
    def tolerance(self) -> float:
        """What a limit may be exceeded by."""
        return 0.0 if self.proven else TOLERANCE * self.unit


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A limit for one value.

    Parameters
    ----------
    text : str
        As it was given.
    path : str
        Name of the value.
    slack : float
        How much worse than the baseline is allowed; of `maximum` the limit itself.
    relative : bool
        Whether the slack is a share of the baseline.
    floor : float
        Least slack, in units of the value.
    maximum : bool
        Whether the limit does not depend on the baseline.
    warns : bool
        Whether breaking it is a warning only.
    """

    text: str
    path: str
    slack: float
    relative: bool = False
    floor: float = 0.0
    maximum: bool = False
    warns: bool = False

    def limit(self, base: float | None, unit: float) -> float:
        """The largest value that keeps the rule, given that of the baseline."""
        if self.maximum:
            return self.slack
        if base is None:
            raise ConfigError(f"{self.text}: the baseline has no {self.path}")
        slack = base * self.slack if self.relative else self.slack
        limit = base + max(slack, self.floor * unit)
        if math.isinf(limit):
            raise ConfigError(f"{self.text}: allows more than any number; choose a smaller one")
        return limit


DEFAULT = Rule(text="total:+0.001%", path="total", slack=1e-5, relative=True, floor=LEAST_SLACK)
"""The rule that holds where none is given."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a rule found.

    Parameters
    ----------
    rule : Rule
        The rule.
    base : float or None
        Value of the baseline.
    limit : float
        The largest value that keeps the rule.
    now : Value
        Value of this run.
    verdict : Verdict
        Pass, fail or undecided.
    """

    rule: Rule
    base: float | None
    limit: float
    now: Value
    verdict: Verdict

    @property
    def warning(self) -> bool:
        """Whether it is a rule that only warns, and is not proven to hold."""
        return self.rule.warns and self.verdict in (Verdict.FAIL, Verdict.UNDECIDED)

    @property
    def improved(self) -> bool:
        """Whether the value is better than the baseline by more than the rule's slack."""
        if self.base is None or self.rule.maximum:
            return False
        slack = max(self.limit - self.base, NO_CHANGE * self.base, self.now.tolerance)
        return self.now.upper < self.base - slack


def judge(rule: Rule, now: Value, base: float | None) -> Finding:
    """Whether the value keeps the rule, as far as its bracket proves it.

    Raises
    ------
    ConfigError
        The rule needs a value that the baseline does not have.
    """
    limit = rule.limit(base, now.unit)
    if now.lower > limit + now.tolerance:
        verdict = Verdict.FAIL
    elif now.upper <= limit + now.tolerance:
        verdict = Verdict.PASS
    else:
        verdict = Verdict.UNDECIDED
    return Finding(rule=rule, base=base, limit=limit, now=now, verdict=verdict)


def parse_rule(text: str, *, option: str = "fail-on") -> Rule:
    """The rule of ``PATH:+N`` or ``PATH:+N%``.

    Raises
    ------
    ConfigError
        The text has another form, or names a value that cannot be judged.
    """
    found = re.fullmatch(_RULE, text.strip())
    slack = _not_negative(found["slack"]) if found else None
    if found is None or slack is None:
        raise ConfigError(f"--{option} {quoted(text)}: must be PATH:+N or PATH:+N%, as total:+0.1%")
    path = _path(found["path"].strip(), option, text)
    relative = found["percent"] == "%"
    return Rule(
        text=f"{path}:+{found['slack'].strip()}{found['percent']}",
        path=path,
        slack=slack / 100 if relative else slack,
        relative=relative,
        warns=option == "warn-on",
    )


def parse_maximum(text: str) -> Rule:
    """The rule of ``NAME=VALUE``.

    Raises
    ------
    ConfigError
        The text has another form, or names a value that cannot be judged.
    """
    name, equals, number = text.rpartition("=")
    limit = _not_negative(number)
    if not equals or limit is None:
        raise ConfigError(f"--max {quoted(text)}: must be NAME=VALUE, as tgospa=50")
    path = _path(name.strip(), "max", text)
    return Rule(text=f"{path}<={number.strip()}", path=path, slack=limit, maximum=True)


def keys(path: str) -> list[Key]:
    """What a path may name, with the longer tail first: ``counts.missed`` before ``missed``."""
    if not path.startswith(BY_CLASS):
        return [path]
    rest = path[len(BY_CLASS) :]
    return [(rest[: -len(tail) - 1], tail) for tail in TAILS if rest.endswith(f".{tail}")]


def name_of(key: Key) -> str:
    """The path of a value in one text."""
    return key if isinstance(key, str) else f"{BY_CLASS}{key[0]}.{key[1]}"


def split_rules(text: str) -> list[str]:
    """The rules of a list with commas.

    Only a comma after the number ends a rule: the name of a class may have commas itself.
    """
    parts = re.split(r"(:\+[^,]*|=[^,=]*)(?:,|$)", text)
    found = [head + end for head, end in zip(parts[::2], (*parts[1::2], ""), strict=True)]
    return [rule for rule in found if rule.strip()]


def _not_negative(text: str) -> float | None:
    number = parsed(text)
    return None if number is None or number < 0 else number


def _path(path: str, option: str, text: str) -> str:
    name = path
    if path.startswith(BY_CLASS):
        name = next((key[1] for key in keys(path)), "")
    if name not in PROVEN and name not in SPLIT:
        raise ConfigError(
            f"--{option} {quoted(text)}: {quoted(path)} cannot be judged; there are "
            f"{', '.join((*PROVEN, *SPLIT))}, and with --by class {BY_CLASS}NAME.total and so on"
        )
    return path


RULE_KEYS = ("fail-on", "warn-on", "max")
PAIR_KEYS = ("name", "truth", "estimate", "options", *RULE_KEYS)
SUITE_KEYS = ("baseline", "pair", "options", *RULE_KEYS)
ONLY_PAIR = "pair"
"""Name of the pair in a baseline that holds one pair only."""

Table: TypeAlias = dict[str, object]
"""A table of TOML that was read."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two files to evaluate against each other.

    Parameters
    ----------
    name : str
        Under which the baseline knows it.
    truth, estimate : str
        Paths.
    options : dict
        Options of the evaluation that the suite sets, by their names in a configuration file.
    rules : dict of str to tuple of str
        Of ``fail-on``, ``warn-on`` and ``max`` those that the suite sets.
    fault : str
        Why there are no such files: the pattern finds none.
    """

    name: str
    truth: str
    estimate: str
    options: Mapping[str, object] = field(default_factory=dict)
    rules: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    fault: str = ""


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Pairs, and the baseline if the file names one.

    Parameters
    ----------
    pairs : tuple of Pair
        In the order of the file, those of one pattern by name; at least one.
    baseline : str or None
        Path.
    notices : tuple of str
        What patterns passed over.
    """

    pairs: tuple[Pair, ...]
    baseline: str | None
    notices: tuple[str, ...] = ()


def load(path: str, known: Mapping[str, bool]) -> Suite:
    """Read a suite; its paths are relative to its folder.

    Parameters
    ----------
    path : str
        The TOML file.
    known : mapping of str to bool
        Options that it may set, and whether each is a flag.

    Raises
    ------
    ConfigError
        It cannot be read, has an unknown key, no pair, or two of one name.
    """
    document = config.read_toml(path)
    folder = os.path.dirname(path)
    _check(document, SUITE_KEYS, path)
    tables = document.get("pair", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(f'{path}: "pair" must be a list of tables; write [[pair]]')
    common = _options(document, path, known, folder), _rules(document, path)
    notices: list[str] = []
    pairs = [
        pair
        for number, table in enumerate(tables, start=1)
        for pair in _pairs(table, f"{path}, pair {number}", known, folder, common, notices)
    ]
    if not pairs:
        raise ConfigError(f"{path}: no pair to judge; add [[pair]] with truth and estimate")
    seen: dict[str, Pair] = {}
    for pair in pairs:
        if pair.fault:
            continue
        if pair.name in seen:
            raise ConfigError(
                f"{path}: the name {quoted(pair.name)} is there twice, for "
                f"{seen[pair.name].truth} and {pair.truth}; give every [[pair]] a name of its own"
            )
        seen[pair.name] = pair
    baseline = _text(document, "baseline", path) if "baseline" in document else None
    return Suite(
        pairs=tuple(pairs),
        baseline=None if baseline is None else os.path.join(folder, baseline),
        notices=tuple(dict.fromkeys(notices)),
    )


def _pairs(
    table: Table,
    where: str,
    known: Mapping[str, bool],
    folder: str,
    common: tuple[Table, dict[str, tuple[str, ...]]],
    notices: list[str],
) -> Iterator[Pair]:
    """The pairs of one table: one, or one for each file that its pattern finds; more notices."""
    _check(table, PAIR_KEYS, where)
    truth, estimate = (_text(table, key, where) for key in ("truth", "estimate"))
    words = patterns.fields(truth)
    others = [word for word in patterns.fields(estimate) if word not in words]
    of_all = (*others, *words)
    name = _text(table, "name", where) if "name" in table else "/".join(f"{{{w}}}" for w in of_all)
    unknown = [word for word in patterns.fields(name) if word not in of_all]
    if unknown:
        raise ConfigError(
            f"{where}: {quoted(name)}: {{{unknown[0]}}} is not in {quoted(truth)}, nor in "
            f"{quoted(estimate)}"
        )
    options = common[0] | _options(table, where, known, folder)
    rules = dict(common[1])
    for key, own in _rules(table, where).items():
        rules[key] = own if key == "fail-on" else (*rules.get(key, ()), *own)
    truths = patterns.meant(truth, folder, inside=runs_inside)
    estimates = patterns.meant(estimate, folder, truth=(truth, folder), inside=runs_inside)
    notices += (truths.notices | estimates.notices).values()
    found = [values for _, values in truths.files] if words else [{}]
    groups = _groups([values for _, values in estimates.files], others) if others else [{}]
    if not found or not groups:
        pattern, theirs = os.path.join(folder, truth), os.path.join(folder, estimate)
        fault = f"{where}: no file is like {quoted(theirs if found else pattern)}"
        yield Pair(name=name, truth=pattern, estimate=theirs, fault=fault)
    for file, _ in estimates.files if others else ():
        if patterns.is_ambiguous(estimate, file):
            fault = f"{where}: the fields of {quoted(estimate)} fit {file} in two ways"
            yield Pair(name=file, truth=os.path.join(folder, truth), estimate=file, fault=fault)
            return
    for values in (group | own for group in groups for own in found):
        yield Pair(
            name=patterns.fill(name, values) or ONLY_PAIR,
            truth=os.path.join(folder, patterns.fill(truth, values)),
            estimate=os.path.join(folder, patterns.fill(estimate, values)),
            options=options,
            rules=rules,
        )


def _groups(files: Sequence[Mapping[str, str]], others: list[str]) -> list[dict[str, str]]:
    """What the fields stand for that the estimates have alone, such as the name of a tracker."""
    found = dict.fromkeys(tuple(values[word] for word in others) for values in files)
    return [dict(zip(others, group, strict=True)) for group in found]


def _options(table: Table, where: str, known: Mapping[str, bool], folder: str) -> Table:
    options = table.get("options", {})
    if not isinstance(options, dict):
        raise ConfigError(f'{where}: "options" must be a table of options')
    settings = config.settings_of(options, where, known)
    for name in (name for name in ("covariance", "step-weights") if name in settings):
        settings[name] = os.path.join(folder, str(settings[name]))
    return {**settings}


def _rules(table: Table, where: str) -> dict[str, tuple[str, ...]]:
    rules = {}
    for key in RULE_KEYS:
        texts = table.get(key, ())
        texts = [texts] if isinstance(texts, str) else texts
        if not isinstance(texts, list | tuple) or not all(isinstance(t, str) for t in texts):
            raise ConfigError(f"{where}: {quoted(key)} must be a text or a list of texts")
        if key in table:
            rules[key] = tuple(texts)
    return rules


def _check(table: Table, known: tuple[str, ...], where: str) -> None:
    unknown = [key for key in table if key not in known]
    if unknown:
        raise ConfigError(
            f"{where}: unknown key {quoted(unknown[0])}; known are {', '.join(known)}; options of "
            "the evaluation go under options"
        )


def _text(table: Table, key: str, where: str) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise ConfigError(f"{where}: {quoted(key)} must be a text")
    return value
