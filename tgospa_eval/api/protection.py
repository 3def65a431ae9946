"""``gate --against``: judged by the rules and the baseline of the target branch.

Whoever opens a pull request may edit what it is judged by. So the suite, the baseline and the
configuration of the target decide, on the data of the working tree; where those of the working tree
let more pass, that is reported.
"""

import os
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any

from tgospa_eval.api.options import FLAGS, NAMES, OF_THE_NUMBER, SETTINGS
from tgospa_eval.campaign.baseline import Baseline
from tgospa_eval.campaign.rules import NO_CHANGE, OF_NEES, Rule
from tgospa_eval.campaign.suite import GroupTable, Pair
from tgospa_eval.campaign.target import Target
from tgospa_eval.common import config
from tgospa_eval.common.files import is_missing
from tgospa_eval.common.words import number
from tgospa_eval.results.records import Json
from tgospa_eval.text import listed, quoted

RULE_KEYS = ("fail-on", "warn-on", "max")
WEAKENING = {
    *RULE_KEYS,
    *("suite", "baseline"),
    *(key for key, name in NAMES.items() if name in OF_THE_NUMBER),
}
"""Options that may weaken a gate: by what is judged, and what changes the number or its bracket."""

TRUSTED = {key for key, name in NAMES.items() if SETTINGS[name].trusted}
"""Those that a file may set which is only found."""

SHOWN = 5
"""Names of pairs in a sentence."""

PREFIX = "TGOSPA_EVAL_"


def of_environment() -> Iterator[str]:
    """Variables that might weaken the gate, were they not passed over."""
    for key in sorted({*WEAKENING, *config.ALIASES, "config"}):
        name = PREFIX + key.replace("-", "_").upper()
        if os.environ.get(name):
            yield f"the variable {name} is set, to {quoted(os.environ[name])}; it is passed over"


def configurations(target: Target, named: str | None) -> tuple[config.Settings, config.Settings]:
    """What a configuration file sets of all this, in the target and in the working tree.

    `named` is the file of ``--config``; without it those are looked for that would be found.
    """
    files = (named,) if named else (config.FILE, "pyproject.toml")
    theirs, mine = (
        next((found for path in files if (found := _settings(path, read(path)))), {})
        for read in (target.read, lambda path: None if is_missing(path) else _content(path))
    )
    if named is None:
        theirs, mine = (
            {key: value for key, value in side.items() if key in TRUSTED} for side in (theirs, mine)
        )
    return theirs, mine


def _content(path: str) -> bytes:
    with open(path, "rb") as file:
        return file.read()


def _settings(path: str, content: bytes | None) -> config.Settings:
    if content is None:
        return {}
    table: Any = config.read_toml(path, content)
    if os.path.basename(path) == "pyproject.toml":
        table = config.section(table) or {}
    known = FLAGS | dict.fromkeys(WEAKENING - FLAGS.keys(), False)
    kept = {key: value for key, value in table.items() if key.replace("_", "-") in known}
    return config.settings_of(kept, path, known)


def of_settings(theirs: Mapping[str, object], mine: Mapping[str, object]) -> Iterator[str]:
    """Settings that are others than in the target."""
    for key in sorted({*theirs, *mine}):
        if key in WEAKENING and theirs.get(key) != mine.get(key):
            yield f"{key} is {_shown(mine.get(key))}, in the target {_shown(theirs.get(key))}"


def of_pairs(
    theirs: Mapping[str, tuple[Pair, Sequence[Rule]]],
    mine: Mapping[str, tuple[Pair, Sequence[Rule]]],
) -> Iterator[str]:
    """Pairs of the target that this branch lacks, reads otherwise, or judges by weaker rules."""
    found: dict[str, list[str]] = {}
    for name, (pair, rules) in theirs.items():
        if name not in mine:
            found.setdefault("the pair is removed", []).append(name)
            continue
        own, own_rules = mine[name]
        for what in ("truth", "estimate"):
            if os.path.normpath(getattr(own, what)) != os.path.normpath(getattr(pair, what)):
                yield f"{name}: {what} is {getattr(own, what)}, in the target {getattr(pair, what)}"
        for text in (*of_rules(rules, own_rules), *of_settings(pair.options, own.options)):
            found.setdefault(text, []).append(name)
    yield from (f"{listed(names, SHOWN)}: {text}" for text, names in found.items())


def of_groups(theirs: Sequence[GroupTable], mine: Sequence[GroupTable]) -> Iterator[str]:
    """Groups of the target that this branch lacks, or judges by weaker rules."""
    for table in theirs:
        others = [one for one in mine if one.name == table.name]
        if not others:
            yield f"group {table.name}: is removed"
            continue
        rules = [rule for one in others for rule in one.rules]
        yield from (f"group {table.name}: {text}" for text in of_rules(table.rules, rules))
        for other in others:
            if other.confidence > table.confidence:
                yield (
                    f"group {table.name}: confidence is {other.confidence:g}, in the target "
                    f"{table.confidence:g}"
                )
            if other.seed != table.seed:
                yield f"group {table.name}: seed is {other.seed}, in the target {table.seed}"
    counts = [sum(len(one.rules) for one in side) for side in (theirs, mine)]
    if theirs and counts[1] > counts[0]:
        yield (
            f"groups have {counts[1]} rules, in the target {counts[0]}: each of more rules needs "
            "more support"
        )


def of_rules(theirs: Sequence[Rule], mine: Sequence[Rule]) -> Iterator[str]:
    """Rules of the target that no rule of this branch implies."""
    for rule in theirs:
        alike = [
            own
            for own in mine
            if (own.path, own.absolute, own.least, own.relative, own.last)
            == (rule.path, rule.absolute, rule.least, rule.relative, rule.last)
            and own.warns <= rule.warns
        ]
        sign = -1 if rule.absolute and rule.least else 1  # a higher lower limit is stricter
        least = min(alike, key=lambda own: sign * own.slack, default=None)
        if least is None:
            yield f"the rule {rule.text} is removed"
        elif sign * least.slack > sign * rule.slack:
            yield f"the rule {rule.text} is loosened to {least.text}"


def of_runs(
    baseline: Baseline, pairs: Sequence[Pair], groups: Sequence[GroupTable]
) -> Iterator[str]:
    """Runs of the target's baseline whose files are gone, while others of their scene are there.

    Where all runs of a scene have other seeds, none is gone.
    """
    there = {pair.name for pair in pairs}
    seeds = {table.seed for table in groups}
    kept = {_scene(entry, seeds) for name, entry in baseline.items() if name in there}
    gone = [
        name
        for name, entry in baseline.items()
        if name not in there and _scene(entry, seeds) in kept
    ]
    if gone:
        yield f"{listed(gone, SHOWN)}: in the baseline of the target, and there are no such files"


def _scene(entry: Json, seeds: Container[str]) -> tuple[tuple[str, str], ...]:
    """Labels of a run but for its seed."""
    labels = entry.get("labels", {})
    return tuple(sorted((key, text) for key, text in labels.items() if key not in seeds))


def of_baselines(theirs: Baseline, mine: Baseline) -> Iterator[str]:
    """Entries of the target that are removed, or whose values are larger in this branch."""
    gone = [name for name in theirs if name not in mine]
    if gone:
        yield f"{listed(gone, SHOWN)}: removed from the baseline"
    found: dict[str, list[str]] = {}
    for name, entry in theirs.items():
        if name in gone:
            continue
        for path, old, new in _raised(entry["values"], mine[name]["values"]):
            yield f"the baseline of {name} is raised: {path} {number(old, 7)} -> {number(new, 7)}"
            break
        if entry["judged"] != mine[name]["judged"]:
            found.setdefault("the baseline is of another truth, or of other steps", []).append(name)
        for part in ("options", "parameters", "labels"):
            if entry.get(part) != mine[name].get(part):
                found.setdefault(f"{part} in the baseline are others", []).append(name)
    yield from (f"{listed(names, SHOWN)}: {text}" for text, names in found.items())


def _raised(old: Json, new: Json, prefix: str = "") -> Iterator[tuple[str, float, float]]:
    """Values that are larger, or a share inside that is less; with paths, of classes as well."""

    def looser(new: float, old: float, path: str) -> bool:
        return new < old * (1 - NO_CHANGE) if path == OF_NEES[-1] else new > old * (1 + NO_CHANGE)

    for name in sorted(old.keys() - {"sums"}, key=lambda name: (name != "total", name)):
        value, other = old[name], new.get(name)
        if isinstance(value, dict):
            yield from _raised(value, other if isinstance(other, dict) else {}, f"{prefix}{name}.")
        elif isinstance(other, int | float) and looser(other, value, f"{prefix}{name}"):
            yield f"{prefix}{name}", value, other


def of_truths(
    target: Target, pairs: Sequence[Pair], baseline: Baseline, groups: Sequence[GroupTable]
) -> Iterator[str]:
    """Truths that are changed; and those of other seeds that the target does not have."""
    files = dict.fromkeys(pair.truth for pair in pairs if not pair.fault)
    changed = target.changed([*files])
    if changed:
        yield f"{listed(changed, SHOWN)}: the truth is changed"
    new = [
        pair.truth
        for pair in pairs
        if pair.name not in baseline and any(table.has(pair.labels) for table in groups)
        if not pair.fault and target.read(pair.truth) is None
    ]
    if new and baseline:
        yield f"{listed(dict.fromkeys(new), SHOWN)}: not in the target, nor in its baseline"


def of_history(target: Target, path: str) -> Iterator[str]:
    """Whether lines of a history are gone."""
    theirs = target.read(path)
    mine = b"" if is_missing(path) else _content(path)
    if theirs and not {*theirs.splitlines()} <= {*mine.splitlines()}:
        yield f"{path}: lines of the target are gone"


def _shown(value: object) -> str:
    return "not set" if value is None else quoted(str(value))
