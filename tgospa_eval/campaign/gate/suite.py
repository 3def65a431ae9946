"""Suites: several pairs to judge, from a TOML file. This module does not read data files."""

import filecmp
import os
import re
import subprocess
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import TypeAlias

from tgospa_eval.campaign.gate.rules import Rule, parse_rules
from tgospa_eval.campaign.pairs import Job, groups_of, match
from tgospa_eval.common import config, patterns
from tgospa_eval.common.files import is_missing, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.patterns import WITH_VARIABLES
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import listed, quoted

# -------------------------------------------------------------------------------------------------
# Files of the target branch: from a git revision, or from a folder next to the working tree.

OPTION = "--against"


class Target:
    """Target of a gate: a git revision or a folder, with the files by which a branch is judged.

    Methods receive the paths that these files have in the working tree.

    Parameters
    ----------
    where : str
        A git revision such as ``origin/main``, or a folder with a checkout of the target. The path
        of a folder must begin with a dot or a slash, or end with a slash: ``./target``,
        ``/target``, ``target/``. A git revision cannot have these forms.

    Raises
    ------
    ConfigError
        The revision or the folder does not exist.
    """

    def __init__(self, where: str) -> None:
        self.where, self.commit = where, ""
        if where.startswith(".") or where.endswith(("/", os.sep)) or os.path.isabs(where):
            if not os.path.isdir(where):
                raise ConfigError(f"{OPTION} {quoted(where)}: there is no such folder")
            return
        commit = _git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{where}^{{commit}}")
        if commit is None:
            folder = f"; write ./{where} for the folder" if os.path.isdir(where) else ""
            why = (
                "this folder is in no git repository, or git is not installed"
                if _git("rev-parse", "--git-dir") is None
                else "is not a git revision in this repository; a CI system may have to fetch it: "
                "git fetch origin BRANCH"
            )
            raise ConfigError(f"{OPTION} {quoted(where)}: {why}{folder}")
        self.commit = commit.decode().strip()

    def name(self, path: str) -> str:
        """Return the name of a file in messages."""
        return f"{self.where}:{path}" if self.commit else os.path.join(self.where, path)

    def read(self, path: str) -> bytes | None:
        """Return the content of a file, with links followed; None if the target lacks the file.

        Raises
        ------
        ConfigError
            The file cannot be read.
        """
        if not self.commit:
            path = os.path.join(self.where, os.path.relpath(path))
            return None if is_missing(path) else read_bytes(path, ConfigError)
        relative = os.path.relpath(path).replace(os.sep, "/")
        name = f"{self.commit}:./{relative}\n".encode("utf-8", "surrogateescape")
        answer = _git("cat-file", "--batch", "--follow-symlinks", given=name) or b""
        head, _, content = answer.partition(b"\n")
        return content[:-1] if re.fullmatch(rb"[0-9a-f]+ blob [0-9]+", head) else None

    def demand(self, path: str) -> bytes:
        """Return the content of a file that must exist.

        Raises
        ------
        ConfigError
            The target lacks the file, or the file cannot be read.
        """
        content = self.read(path)
        if content is None:
            raise ConfigError(f"{self.name(path)}: there is no such file")
        return content

    def has(self, path: str) -> bool:
        """Return whether the target has this file, or files in this folder."""
        return not self._with_folders.isdisjoint(_places(path))

    def has_another(self, path: str) -> bool:
        """Return whether this file, or a file in this folder, differs in the working tree.

        A file that is absent from the working tree differs, too.
        """
        if self.commit:
            return not self._changed.isdisjoint(_places(path))
        file = os.path.join(self.where, os.path.relpath(_file(path)))
        for other in [file] if os.path.isfile(file) else _walk(file):
            mine = os.path.relpath(other, self.where)
            if not os.path.isfile(mine) or not filecmp.cmp(mine, other, shallow=False):
                return True
        return False

    @cached_property
    def missing(self) -> list[str]:
        """Files of the target that the working tree lacks, as paths from the current folder."""
        return [os.path.relpath(file) for file in self._files if not os.path.lexists(file)]

    @cached_property
    def _files(self) -> list[str]:
        """Path that each file of the target has in the working tree."""
        if self.commit:
            tree = ("ls-tree", "-r", "-z", "--name-only", "--full-tree", self.commit)
            return self._listed(*tree)
        return [os.path.abspath(os.path.relpath(path, self.where)) for path in _walk(self.where)]

    @cached_property
    def _with_folders(self) -> set[str]:
        return _with_folders(self._files)

    @cached_property
    def _changed(self) -> set[str]:
        """Files of the target that are changed or absent in the working tree, and their folders.

        git compares the files, because it knows about line ends and large files stored elsewhere.
        """
        return _with_folders(self._listed(*DIFF, self.commit))

    def _listed(self, *arguments: str) -> list[str]:
        """Return the files that a git command lists, by their paths in the working tree.

        Raises
        ------
        ConfigError
            The git command fails.
        """
        top, names = _git("rev-parse", "--show-toplevel"), _git(*arguments)
        if top is None or names is None:
            raise ConfigError(f"{OPTION} {self.where}: git {' '.join(arguments)} fails here")
        folder = os.path.realpath(os.fsdecode(top).rstrip("\n"))
        return [os.path.join(folder, name) for name in map(os.fsdecode, names.split(b"\0")) if name]


def last_change(path: str) -> Target | None:
    """Return, as a target, the last commit in which a file was changed; None if there is none."""
    commit = _git("log", "-1", "--format=%h", "--", path) if path else None
    return Target(commit.decode().strip()) if commit else None


DIFF = (
    *("-c", "core.fileMode=false", "-c", "diff.relative=false", "diff", "--name-only", "-z"),
    *("--diff-filter=MTD", "--no-ext-diff", "--no-renames", "--ignore-submodules=all"),
)


def _file(path: str) -> str:
    """Return the file of a path: ``FILE.mat`` for the variable ``FILE.mat:X``."""
    named = re.match(WITH_VARIABLES, path)
    return named[1] if named else path


def _places(path: str) -> set[str]:
    """Return both absolute paths of a file: as given, and with links resolved."""
    return {os.path.abspath(_file(path)), os.path.realpath(_file(path))}


def _walk(folder: str) -> Iterator[str]:
    """Yield all files below a folder."""
    for above, inner, names in os.walk(folder):
        inner[:] = sorted(name for name in inner if name != ".git")
        yield from (os.path.join(above, name) for name in sorted(names))


def _with_folders(files: Iterable[str]) -> set[str]:
    """Return the files and all folders above them."""
    paths = set[str]()
    for file in files:
        while file not in paths:
            paths.add(file)
            file = os.path.dirname(file)
    return paths


def _git(*arguments: str, given: bytes = b"") -> bytes | None:
    """Return the output of a git command that only reads; None if the command fails."""
    try:
        done = subprocess.run(("git", *arguments), input=given, capture_output=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout if done.returncode == 0 else None


RULE_KEYS = ("fail-on", "warn-on", "max")
PAIR_KEYS = ("name", "truth", "estimate", "options", *RULE_KEYS)
SUITE_KEYS = ("baseline", "pair", "group", "limits", "options", *RULE_KEYS)
GROUP_KEYS = ("name", "confidence", "seed", *RULE_KEYS)
LIMITS_KEYS = ("match", *RULE_KEYS)
SEED = "seed"
"""Default name of the label in which runs of one scene differ."""

ONLY_PAIR = "pair"
"""Name of the pair in a baseline with a single pair."""

Table: TypeAlias = dict[str, object]
"""Table of a TOML document."""

Rules: TypeAlias = Mapping[str, tuple[str, ...]]
"""Texts of rules, by the keys of `RULE_KEYS`."""


@dataclass(frozen=True, kw_only=True)
class GroupTable:
    """Groups of pairs that one pattern defines, with their rules.

    Parameters
    ----------
    name : str
        Pattern with labels in braces, such as ``"{scenario}"``. If it has no labels, all pairs are
        one group.
    rules : tuple of Rule
        Rules of each group.
    confidence : float
        Confidence of the tests.
    seed : str
        Label in which runs of one scene differ.
    """

    name: str
    rules: tuple[Rule, ...]
    confidence: float = 0.975
    seed: str = SEED

    def has(self, labels: Mapping[str, str]) -> bool:
        """Return whether a pair with these labels is in one of the groups."""
        return labels.keys() >= {*patterns.fields(self.name)}

    def group_of(self, labels: Mapping[str, str]) -> str | None:
        """Return the name of the group of a pair with these labels; None without a group."""
        return patterns.fill(self.name, labels) if self.has(labels) else None


def load_suite(
    path: str, known: Mapping[str, bool], target: Target | None = None
) -> tuple[list[Job], list[GroupTable], str | None, list[str]]:
    """Return the pairs and groups of a suite, its baseline or None, and notices of skipped files.

    Paths are relative to the folder of the suite. Pairs are in the order of the suite, and the
    pairs of one pattern are sorted by name.

    Parameters
    ----------
    path : str
        The TOML file.
    known : mapping of str to bool
        Options that a suite can set, and whether each is a flag.
    target : Target, optional
        Target from which the suite is read. A pair gets a fault if the target has a file of the
        pair, but the working tree does not.

    Raises
    ------
    ConfigError
        The file cannot be read, has an unknown key or no pairs, or two pairs have the same name.
    """
    content, folder = None if target is None else target.demand(path), os.path.dirname(path)
    path = path if target is None else target.name(path)
    document = config.read_toml(path, content)
    _check(document, SUITE_KEYS, path)
    tables = _tables(document, "pair", path)
    common = _options(document, path, known, folder), _rules(document, path)
    notices: list[str] = []
    pairs = [
        pair
        for number, table in enumerate(tables, start=1)
        for pair in _pairs(table, f"{path}, pair {number}", known, folder, common, notices)
    ]
    if not pairs:
        raise ConfigError(f"{path}: no pairs; add [[pair]] with truth and estimate")
    if target is not None:
        pairs += [pair for table in tables for pair in _lost(table, folder, target)]
    for number, table in enumerate(_tables(document, "limits", path), start=1):
        pairs = _limited(pairs, table, f"{path}, limits {number}")
    groups = _tables(document, "group", path)
    named: dict[str, Job] = {}
    for pair in pairs:
        if pair.fault:
            continue
        if pair.name in named:
            raise ConfigError(
                f"{path}: the name {quoted(pair.name)} is a duplicate, for "
                f"{named[pair.name].truth} and {pair.truth}; give every [[pair]] its own name"
            )
        named[pair.name] = pair
    baseline = _text(document, "baseline", path) if "baseline" in document else None
    made = [_group(table, pairs, f"{path}, group {k}") for k, table in enumerate(groups, start=1)]
    where = None if baseline is None else os.path.join(folder, baseline)
    return pairs, made, where, list(dict.fromkeys(notices))


def _tables(document: Table, key: str, path: str) -> list[Table]:
    """Return the list of tables of a key, after a check that the value is such a list."""
    tables = document.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(f"{path}: {quoted(key)} must be a list of tables; write [[{key}]]")
    return tables


def _limited(pairs: Sequence[Job], table: Table, where: str) -> list[Job]:
    """Add the rules of a table of limits to the pairs that match it, and return all pairs."""
    _check(table, LIMITS_KEYS, where)
    match, own = _text(table, "match", where), _rules(table, where)
    if not any(fnmatchcase(pair.name, match) for pair in pairs):
        raise ConfigError(f"{where}: no pair has a name that matches {quoted(match)}")
    return [
        replace(pair, rules=_merged(pair.rules, own)) if fnmatchcase(pair.name, match) else pair
        for pair in pairs
    ]


def _merged(rules: Rules, own: Rules) -> dict[str, tuple[str, ...]]:
    """Add the rules `own` to `rules`. Rules ``fail-on`` in `own` replace those in `rules`."""
    merged = dict(rules)
    for key, texts in own.items():
        merged[key] = texts if key == "fail-on" else (*merged.get(key, ()), *texts)
    return merged


def _group(table: Table, pairs: Sequence[Job], where: str) -> GroupTable:
    """Return the groups that a table of a suite defines.

    Each label in the pattern of the groups must be a label of some pair.
    """
    _check(table, GROUP_KEYS, where)
    name = _text(table, "name", where) if "name" in table else "all"
    texts, confidence = _rules(table, where), table.get("confidence", GroupTable.confidence)
    if isinstance(confidence, bool) or not isinstance(confidence, int | float):
        raise ConfigError(f'{where}: "confidence" must be a number')
    seed = _text(table, "seed", where) if "seed" in table else SEED
    labels = {label for pair in pairs for label in pair.labels}
    return make_group(
        name, [texts.get(key, ()) for key in RULE_KEYS], confidence, seed, labels, where
    )


def make_group(
    name: str,
    rules: Sequence[Sequence[str]],
    confidence: float,
    seed: str,
    labels: Container[str],
    where: str,
) -> GroupTable:
    """Return the groups of a pattern, after a check of the pattern, the rules and the settings.

    Raises
    ------
    ConfigError
        The confidence is out of range, the pattern is wrong, or a label or a rule is unknown.
    """
    if not 0.5 <= confidence < 1:
        raise ConfigError(f"{where}: confidence is {confidence}: must be from 0.5 to below 1")
    if set("{}") & {*re.sub(patterns.FIELD, "", name)}:
        raise ConfigError(f"{where}: {quoted(name)} has a brace without a label")
    check_labels(name, seed, labels, where)
    rules_of_group = tuple(parse_rules(*rules))
    return GroupTable(name=name, rules=rules_of_group, confidence=float(confidence), seed=seed)


def check_labels(name: str, seed: str, labels: Container[str], where: str) -> None:
    """Check the label of the seeds, and the labels of the pattern of a group.

    Raises
    ------
    ConfigError
        A label is unknown, or the pattern has the label of the seeds.
    """
    if seed != SEED and seed not in labels:
        raise ConfigError(f"{where}: no pattern of a pair has {{{seed}}}, which tells runs apart")
    for label in patterns.fields(name):
        if label not in labels:
            raise ConfigError(f"{where}: {quoted(name)}: {{{label}}} is in no pattern of a pair")
        if label == seed:
            raise ConfigError(
                f"{where}: {quoted(name)} must not have {{{seed}}}, which tells its runs apart"
            )


def _pairs(
    table: Table,
    where: str,
    known: Mapping[str, bool],
    folder: str,
    common: tuple[Table, dict[str, tuple[str, ...]]],
    notices: list[str],
) -> Iterator[Job]:
    """Yield the pairs of a table.

    Some fields, such as ``{tracker}``, are only in the pattern of the estimates. Each truth makes a
    pair with each combination of values of these fields. `common` has options and rules for all
    pairs. Notices of skipped files are added to `notices`.
    """
    _check(table, PAIR_KEYS, where)
    truth, estimate = (_text(table, key, where) for key in ("truth", "estimate"))
    words = patterns.fields(truth)
    own_fields = [word for word in patterns.fields(estimate) if word not in words]
    of_all = (*own_fields, *words)
    name = _text(table, "name", where) if "name" in table else "/".join(f"{{{w}}}" for w in of_all)
    unknown = [word for word in patterns.fields(name) if word not in of_all]
    if unknown:
        raise ConfigError(
            f"{where}: {quoted(name)}: {{{unknown[0]}}} is not in {quoted(truth)}, nor in "
            f"{quoted(estimate)}"
        )
    options = common[0] | _options(table, where, known, folder)
    rules = _merged(common[1], _rules(table, where))
    truths, estimates, skipped = match(truth, estimate, (folder, folder))
    notices += skipped
    groups = groups_of((values for _, values in estimates), own_fields) if own_fields else [{}]
    if not truths or not groups:
        pattern, theirs = os.path.join(folder, truth), os.path.join(folder, estimate)
        role, missing = ("estimate", theirs) if truths else ("truth", pattern)
        fault = f"{where}, {role}: no file matches {quoted(missing)}"
        yield Job(name=name, truth=pattern, estimate=theirs, fault=fault)
    known_truths = {tuple(values.items()) for values in truths}
    unmatched = [
        file
        for file, values in estimates
        if words and tuple((word, values.get(word)) for word in words) not in known_truths
    ]
    if unmatched:
        which = listed([os.path.join(folder, file) for file in unmatched], 3)
        notices.append(f"{which}: not judged: no truth matches {quoted(truth)}")
    for file, _ in estimates if own_fields else ():
        if patterns.is_ambiguous(estimate, file):
            fault = f"{where}: the fields of {quoted(estimate)} match {file} in two ways"
            yield Job(name=file, truth=os.path.join(folder, truth), estimate=file, fault=fault)
            return
    for values in (group | own for group in groups for own in truths):
        yield Job(
            name=patterns.fill(name, values) or ONLY_PAIR,
            truth=os.path.join(folder, patterns.fill(truth, values)),
            estimate=os.path.join(folder, patterns.fill(estimate, values)),
            options=options,
            rules=rules,
            labels=values,
        )


def _lost(table: Table, folder: str, target: Target) -> Iterator[Job]:
    """Yield a pair with a fault for each file that matches a pattern, but is only in the target."""
    truth, estimate = str(table["truth"]), str(table["estimate"])
    needed, given = ({*patterns.fields(text)} for text in (truth, estimate))
    for path in target.missing if needed | given else ():
        own = patterns.values_of(truth, folder, path)
        # If estimates have no fields of their own, each truth has a pair, even without an estimate.
        # A missing estimate is then reported by this pair.
        other = patterns.values_of(estimate, folder, path) if given > needed else None
        of_truth = os.path.join(folder, patterns.fill(truth, other)) if other else None
        if own is not None or (of_truth and target.has(of_truth)):
            fault = f"this branch lacks the file, but {target.where} has it"
            yield Job(name=path, truth=truth, estimate=estimate, fault=fault)


def _options(table: Table, where: str, known: Mapping[str, bool], folder: str) -> Table:
    options = table.get("options", {})
    if not isinstance(options, dict):
        raise ConfigError(f'{where}: "options" must be a table of options')
    settings = config.settings_of(options, where, known)
    for name in (
        name for name in ("covariance", "step-weights", "ignore-regions") if name in settings
    ):
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
