"""The files of a comparison: short names, pairs as problems."""

import os
from collections.abc import Sequence
from pathlib import Path

from tgospa_eval.cli.shared.notices import about, notifier, pair_notices, slow_notice
from tgospa_eval.cli.shared.places import find_place
from tgospa_eval.cli.shared.settings import Settings, infos
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.prepare import Prepared, prepare
from tgospa_eval.formats import ROLES, Reading
from tgospa_eval.formats.guess import file_of
from tgospa_eval.text import quoted


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
        if path != STDIN and not os.path.lexists(file_of(path)):
            raise InputError(f"{path or quoted(path)}: no such file")


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
        settings, paths = self.settings, (truth, estimate)
        with self.stopwatch.span("read"):
            if self.last is None or self.last[0] != truth:
                self.last = truth, self._read(truth, 0, paths)
            sides: tuple[Reading, ...] = (self.last[1], self._read(estimate, 1, paths))
        settings.check(sides, paths)
        if settings.preprocess or settings.with_:
            sides = settings.preprocessed(sides, paths)
            for path, side in zip(paths, sides, strict=True):
                for notice in about(path, side):
                    self._notify_once(notice)
        fitted, request = settings.fit(sides, paths)
        for notice in pair_notices(fitted, request, sides):
            is_default = notice.text.startswith("default ") and not notice.code
            self._notify_once(notice.about(estimate) if named and not is_default else notice)
        return prepare(fitted, request, files=infos(sides), stopwatch=self.stopwatch)

    def _read(self, path: str, side: int, paths: tuple[str, str]) -> Reading:
        found = self.settings.read_side(path, side, ROLES[side], paths)
        for notice in about(path, found):
            self._notify_once(notice)
        return found

    def _notify_once(self, notice: Notice) -> None:
        if notice not in self.shown:
            self.shown.add(notice)
            self.notify(notice)
            if notice.code:
                self.warnings.append(notice.record())
