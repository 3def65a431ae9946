"""What the stages of a partitioned evaluation say of themselves while they go on."""

import math
import os
import time
from collections.abc import Mapping

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.partitioned.share import Share
from tgospa_eval.problem.tgospa import Parameters

OUTWARD = 1e-12
"""Relative, by which bounds that are shown are wider: sums of sums are off by less."""


TOLD_FROM = 0.01
"""Of the work has to be done before anyone says how long the rest takes."""


class Stages:
    """The stage, how much of it is done, the time that is left, and what is proven so far.

    Who watches reads it from the stopwatch and its `progress`.

    Parameters
    ----------
    stopwatch : Stopwatch
        Of the work.
    """

    def __init__(self, stopwatch: Stopwatch) -> None:
        self.stopwatch = stopwatch
        self._outer = stopwatch.stage
        self._name = ""
        self._work: dict[str, float] = {}
        self._before = self._done = self._begin = 0.0
        self._left: set[str] = set()
        self._prices = (0.0, 0.0)
        self._proven: dict[str, tuple[float, float]] = {}

    def stage(self, name: str, tasks: Mapping[str, float]) -> None:
        """Begin a stage, which ends the one before.

        Parameters
        ----------
        name : str
            What is done, in a word: ``"solving"``.
        tasks : mapping of str to float
            Outputs of its tasks, and how much work each is in any unit. What is there already is
            known to be done.
        """
        self._name, self._work, self._left = name, dict(tasks), set(tasks)
        there = [task for task in tasks if os.path.exists(task)]
        self._before = self._done = sum(tasks[task] for task in there)
        self._left.difference_update(there)
        self._begin = time.monotonic()
        self.stopwatch.progress.share, self.stopwatch.progress.left = 0.0, None
        self._show()

    def end(self) -> None:
        """All stages are done."""
        self.stopwatch.stage, self.stopwatch.progress.left = self._outer, None

    def done(self, task: str, share: Share | None = None) -> None:
        """A task has ended, or was found done.

        Parameters
        ----------
        task : str
            Its output.
        share : Share, optional
            What it proves.
        """
        if task in self._left:
            self._left.remove(task)
            self._done += self._work[task]
        if share is not None:
            self.prove(share, task)
        self._show()

    def expect(self, parameters: Parameters, objects: tuple[int, int]) -> None:
        """Say what would be paid if nothing were assigned, before shares come.

        Parameters
        ----------
        parameters : Parameters
            Of the metric.
        objects : pair of int
            All states of truth and of estimate.
        """
        self._prices = parameters.unassigned_prices
        self._proven = {"": (0.0, self._unassigned(*objects))}
        self.stopwatch.progress.scale = parameters.root
        self._bracket()

    def _unassigned(self, truths: float, estimates: float) -> float:
        return self._prices[0] * truths + self._prices[1] * estimates

    def prove(self, share: Share, name: str) -> None:
        """Below, shares that are known; above, them and all other objects unassigned.

        Parameters
        ----------
        share : Share
            What is proven.
        name : str
            Of what: it takes the place of what was proven of it before.
        """
        free = self._unassigned(float(share.truths.sum()), float(share.estimates.sum()))
        self._proven[name] = share.bracket[0], share.upper - free
        self._bracket()

    def _bracket(self) -> None:
        lower, upper = map(math.fsum, zip(*self._proven.values(), strict=True))
        self.stopwatch.progress.prove(lower * (1 - OUTWARD), upper * (1 + OUTWARD))

    def _show(self) -> None:
        progress, whole = self.stopwatch.progress, sum(self._work.values())
        count = len(self._work)
        done = f", {count - len(self._left):,} of {count:,}" if count else ""
        self.stopwatch.stage = self._name + done
        if not whole > 0:
            return
        progress.done(self._done / whole)
        fresh = self._done - self._before
        if fresh > TOLD_FROM * whole:
            seconds = time.monotonic() - self._begin
            progress.left = seconds / fresh * (whole - self._done)
