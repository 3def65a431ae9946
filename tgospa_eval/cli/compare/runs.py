"""Patterns that stand for several runs, and for several estimates: ``*``, or fields in braces."""

import glob
import itertools
import os
from collections.abc import Iterator, Mapping

from tgospa_eval.common import patterns
from tgospa_eval.common.words import natural
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import runs_inside

Runs = list[tuple[str, list[str]]]
"""The truth of each run, and its estimates."""

AS_FIELD = "{run}"
"""What * is as a field."""


def is_pattern(path: str) -> bool:
    """Whether it stands for several files; the name of a file that exists stands for itself."""
    return ("*" in path or bool(patterns.fields(path))) and not os.path.exists(path)


def first_file(pattern: str) -> str | None:
    """The first that a pattern stands for."""
    if _fields(pattern):
        return next((name for name, _ in patterns.found(pattern, inside=runs_inside)), None)
    before, after = pattern.split("*", 1)
    return min(glob.glob(f"{glob.escape(before)}*{glob.escape(after)}"), default=None)


def each_estimate(
    truth: str, estimates: tuple[str, ...], output: str | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The estimates, one for each value of the fields that the truth does not have, and notices.

    Nothing in the folder of `output` is one.

    Raises
    ------
    InputError
        No file is like a pattern, or a name would be one.
    """
    own = _fields(truth)
    found: list[str] = []
    told = _hidden(truth)
    for path in estimates:
        others = [name for name in _fields(path) if name not in own]
        if not others:
            found.append(path)
            told |= _hidden(path)
            continue
        meant = patterns.meant(path, output=output, truth=(truth, ""), inside=runs_inside)
        told |= {
            why if why == patterns.DOTTED else text: text for why, text in meant.notices.items()
        }
        groups = {tuple(values[name] for name in others) for values in _values(path, meant)}
        for text in itertools.chain(*groups):
            if own and patterns.fields(text):
                raise InputError(f"{path}: fits {text}, which is like a field itself; rename that")
        kept = {name: f"{{{name}}}" for name in own}
        found += [
            patterns.fill(path, kept | dict(zip(others, group, strict=True)))
            for group in sorted(groups, key=lambda group: tuple(map(natural, group)))
        ]
    return tuple(found), tuple(told.values())


def expand(truth: str, estimates: tuple[str, ...]) -> Runs:
    """The files of each run: what ``*``, or a field, stands for in one pattern stands in all.

    A truth without one is that of all runs. Names of existing files are no patterns.

    Raises
    ------
    ConfigError, InputError
        A pattern fits nothing, or patterns do not fit each other.
    """
    paths = (truth, *estimates)
    with_fields = [path for path in paths if _fields(path)]
    marked = [is_pattern(path) and path not in with_fields for path in paths]
    if with_fields and any(marked):
        star = next(path for path, is_marked in zip(paths, marked, strict=True) if is_marked)
        raise ConfigError(f"{star}: has a *, and {with_fields[0]} has fields; choose one of them")
    if with_fields:
        return _of_fields(truth, estimates)
    if not any(marked):
        return [(truth, list(estimates))]
    for path, is_marked in zip(paths, marked, strict=True):
        if path.count("*") > 1 and is_marked:
            raise ConfigError(f"{path}: one * is needed, it stands for the run")
        if not is_marked and path != truth:
            raise ConfigError(f"{path}: has no *, but other files have; it stands for the run")
    keys = [_matches(path) for path, is_marked in zip(paths, marked, strict=True) if is_marked]
    for path, own in zip([p for p, m in zip(paths, marked, strict=True) if m], keys, strict=True):
        lacking = next((key for key in keys[0] if key not in own), None)
        if lacking is not None:
            raise InputError(f"{path.replace('*', lacking)}: no such file; other patterns have it")
        extra = next((key for key in own if key not in keys[0]), None)
        if extra is not None:
            raise InputError(f"{path.replace('*', extra)}: has no counterpart in other patterns")
    return [
        (truth.replace("*", key) if marked[0] else truth, [p.replace("*", key) for p in estimates])
        for key in keys[0]
    ]


def _of_fields(truth: str, estimates: tuple[str, ...]) -> Runs:
    """The files of each run, which is what the fields of the truth stand for."""
    own = _fields(truth)
    for path in estimates:
        lacking = [name for name in own if name not in _fields(path)]
        if lacking:
            raise ConfigError(
                f"{path}: has no {{{lacking[0]}}}, but {truth} has; it stands for the run"
            )
    runs = sorted(_values(truth), key=lambda values: [natural(values[name]) for name in own])
    for path in estimates:
        there = list(_values(path))
        for values in runs:
            if values not in there:
                name = patterns.fill(path, values)
                raise InputError(f"{name}: no such file; other patterns have it")
        for values in there:
            if values not in runs:
                name = patterns.fill(path, values)
                raise InputError(f"{name}: has no counterpart in other patterns")
    return [
        (patterns.fill(truth, values), [patterns.fill(path, values) for path in estimates])
        for values in runs
    ]


def _fields(path: str) -> list[str]:
    """The fields of a pattern; the name of a file that exists has none."""
    return patterns.fields(path) if is_pattern(path) else []


def _hidden(pattern: str) -> dict[str, str]:
    """A notice of the names behind a dot that a pattern passes over: runs are the same in all."""
    if not is_pattern(pattern):
        return {}
    star = not _fields(pattern)
    meant = patterns.meant(pattern.replace("*", AS_FIELD) if star else pattern, inside=runs_inside)
    found = {why: text for why, text in meant.notices.items() if why == patterns.DOTTED}
    return {why: text.replace(AS_FIELD, "*") if star else text for why, text in found.items()}


def _values(pattern: str, meant: patterns.Meant | None = None) -> Iterator[Mapping[str, str]]:
    """What the fields stand for in each file: in all that are like the pattern, or in these.

    Raises
    ------
    InputError
        No file is like the pattern, or one is in two ways.
    """
    found = list(patterns.found(pattern, inside=runs_inside)) if meant is None else meant.files
    if not found:
        raise InputError(f"{pattern}: no such files", *(meant.notices.values() if meant else ()))
    for path, values in found:
        if patterns.is_ambiguous(pattern, path):
            raise InputError(f"{path}: the fields of {pattern} fit it in two ways")
        yield values


def _matches(pattern: str) -> list[str]:
    """What ``*`` stands for, in natural order."""
    before, after = pattern.split("*")
    found = glob.glob(f"{glob.escape(before)}*{glob.escape(after)}")
    if not found:
        raise InputError(f"{pattern}: no such files")
    return sorted((path[len(before) : len(path) - len(after)] for path in found), key=natural)
