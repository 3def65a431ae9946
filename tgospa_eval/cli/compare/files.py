"""The files of a comparison: patterns that stand for runs, short names, pairs as problems."""

import glob
import os
from collections.abc import Sequence
from pathlib import Path

from tgospa_eval.cli.shared.notices import about, notifier, pair_notices, slow_notice
from tgospa_eval.cli.shared.places import find_place
from tgospa_eval.cli.shared.settings import Settings, infos
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import natural
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.prepare import Prepared, prepare
from tgospa_eval.formats import ROLES, Reading
from tgospa_eval.text import quoted


def expand(truth: str, estimates: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """The files of each run: what ``*`` stands for in one pattern stands in all.

    A truth without ``*`` is that of all runs. Names of existing files are no patterns.

    Raises
    ------
    ConfigError, InputError
        A pattern fits nothing, or patterns do not fit each other.
    """
    paths = (truth, *estimates)
    marked = list(map(is_pattern, paths))
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


def is_pattern(path: str) -> bool:
    """Whether ``*`` stands for runs; in the name of a file that exists it stands for itself."""
    return "*" in path and not os.path.exists(path)


def check_files(paths: Sequence[str]) -> None:
    """See that all are there before any is read.

    Raises
    ------
    InputError
        One is missing, or a folder.
    """
    for path in paths:
        place = find_place(path)
        if place is not None:
            raise InputError(place.message)
        if not os.path.lexists(path):
            raise InputError(f"{path or quoted(path)}: no such file")


def _matches(pattern: str) -> list[str]:
    """What ``*`` stands for, in natural order."""
    before, after = pattern.split("*")
    found = glob.glob(f"{glob.escape(before)}*{glob.escape(after)}")
    if not found:
        raise InputError(f"{pattern}: no such files")
    return sorted((path[len(before) : len(path) - len(after)] for path in found), key=natural)


def short_names(paths: tuple[str, ...]) -> list[str]:
    """What each file is called: that part of its path in which it differs from the others.

    Raises
    ------
    ConfigError
        A file is there twice.
    """
    seen: dict[str, str] = {}
    for path in paths:
        other = seen.setdefault(os.path.realpath(path), path)
        if other != path:
            raise ConfigError(f"{path}: is the same as {other}; name each estimate once")
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ConfigError(f"{twice}: is given twice")
    parts = [Path(path).with_suffix("").parts for path in paths]
    if len(paths) == 1:
        return [parts[0][-1]]
    names = ["/".join(part) for part in _without_common(_without_common(parts, 1), -1)]
    return names if len(set(names)) == len(names) and all(names) else list(paths)


def _without_common(parts: list[tuple[str, ...]], step: int) -> list[tuple[str, ...]]:
    """Without what is the same in all, at the beginning (1) or at the end (-1)."""
    turned = [part[::step] for part in parts]
    same = 0
    for level in zip(*turned, strict=False):
        if len(set(level)) > 1:
            break
        same += 1
    return [part[same:][::step] for part in turned]


class Pairs:
    """Pairs of files, read and made problems of; a truth is read once.

    Parameters
    ----------
    settings : Settings
        How to read, and the metric.
    quiet : bool
        Whether notices are left out.
    stopwatch : Stopwatch
        Gets the time by stage.
    """

    def __init__(self, settings: Settings, stopwatch: Stopwatch, *, quiet: bool) -> None:
        self.settings, self.stopwatch = settings, stopwatch
        self.notify = notifier(quiet=quiet)
        self.shown: set[Notice] = set()
        self.last: tuple[str, Reading] | None = None
        self.warnings: list[dict[str, str]] = []
        if not quiet:
            stopwatch.notify = print_notice
        for notice in slow_notice():
            self._notify_once(notice)

    def prepared(self, truth: str, estimate: str, *, named: bool = False) -> Prepared:
        """The problem of two files; `named` notices name the estimate they are about."""
        with self.stopwatch.span("read"):
            if self.last is None or self.last[0] != truth:
                self.last = truth, self._read(truth, 0)
            sides: tuple[Reading, ...] = (self.last[1], self._read(estimate, 1))
        settings, paths = self.settings, (truth, estimate)
        settings.check(sides, paths)
        if settings.preprocess:
            sides = settings.preprocessed(sides, paths)
            for path, side in zip(paths, sides, strict=True):
                for notice in about(path, side):
                    self._notify_once(notice)
        fitted, request = settings.fit(sides, paths)
        for notice in pair_notices(fitted, request, pixels=any(side.pixels for side in sides)):
            is_default = notice.text.startswith("default ") and not notice.code
            self._notify_once(notice.about(estimate) if named and not is_default else notice)
        return prepare(fitted, request, files=infos(sides), stopwatch=self.stopwatch)

    def _read(self, path: str, side: int) -> Reading:
        found = self.settings.read_side(path, side, ROLES[side])
        for notice in about(path, found):
            self._notify_once(notice)
        return found

    def _notify_once(self, notice: Notice) -> None:
        if notice not in self.shown:
            self.shown.add(notice)
            self.notify(notice)
            if notice.code:
                self.warnings.append(notice.record())
