"""Suites: several pairs to judge, from a TOML file. Knows names of files, not their content."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import TypeAlias

from tgospa_eval.common import config, patterns
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats import runs_inside
from tgospa_eval.text import quoted

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


def load_suite(path: str, known: Mapping[str, bool]) -> tuple[list[Pair], str | None, list[str]]:
    """The pairs of a suite, its baseline if it names one, and notices of what was passed over.

    Paths are relative to its folder; pairs are in its order, those of one pattern by name.

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
    return pairs, baseline and os.path.join(folder, baseline), list(dict.fromkeys(notices))


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
