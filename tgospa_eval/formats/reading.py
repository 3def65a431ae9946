"""What a file gave: its trajectories, and what the user should know about how they were read."""

from collections.abc import Collection, Mapping
from dataclasses import field, replace
from typing import Protocol

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, in_python, warn_user
from tgospa_eval.tracks.trajectories import Ints, Trajectories


class Known(Protocol):
    """What is known of a side when its rows are read, as of `Reading`."""

    @property
    def lacking(self) -> Mapping[str, str]:
        """What it lacks, and the message if every side does."""

    @property
    def left_out(self) -> Mapping[str, int]:
        """How many rows take no part, by rule."""

    @property
    def named(self) -> Collection[str]:
        """Classes of all rows, if they were asked for."""

    @property
    def taken(self) -> int:
        """Rows that take part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What was read from a file, and what the user should know about it.

    Parameters
    ----------
    trajectories : Trajectories
        What takes part in the evaluation.
    rows : int
        Rows of the file, the header not counted.
    notices : tuple of str
        One sentence each.
    warnings : tuple of Notice
        What was repaired.
    left_out : dict
        How many rows do not take part, by the rule or option that left them out.
    format : str
        How the file was read.
    classes : tuple of str
        Names of the classes that take part, if `ReadOptions.by_class` asks for them.
    klass : (R,) int array, optional
        Position in `classes` of each row of the trajectories.
    named : tuple of str
        Classes of all rows of the file, if they were asked for.
    lacking : dict of str to str
        Of `ReadOptions.shared` what the file lacks, and the message if every file does.
    headers : dict of str to str
        Headers of the columns whose names are others.
    pixels : bool
        The states are centres of boxes in an image, by the rules of the format.
    """

    trajectories: Trajectories
    rows: int
    notices: tuple[str, ...] = field(default=())
    warnings: tuple[Notice, ...] = ()
    left_out: dict[str, int] = field(default_factory=dict)
    format: str = "csv"
    classes: tuple[str, ...] = ()
    klass: Ints | None = None
    named: tuple[str, ...] = ()
    lacking: dict[str, str] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    pixels: bool = False

    @property
    def taken(self) -> int:
        """Rows that take part."""
        return len(self.trajectories.step)

    def warn(self) -> Trajectories:
        """The trajectories, with a Python warning for each of its own."""
        warn_user(self.warnings, in_python)
        return self.trajectories

    def of_class(self, name: str) -> Trajectories:
        """The rows of one class, on the times of the whole file."""
        whole = self.trajectories
        if self.klass is None or name not in self.classes:
            rows = np.zeros(0, np.int64)
        else:
            rows = np.flatnonzero(self.klass == self.classes.index(name))
        part = whole.chosen(rows, whole.step[rows], whole.times)
        return replace(part, labels=whole.labels)
