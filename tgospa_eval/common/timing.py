"""Where the time went: a stopwatch that adds up named, nestable spans."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tgospa_eval.common.progress import Progress


class Stopwatch:
    """Adds up the seconds spent under each name; a name may be a path, ``"solve/lp"``.

    Parameters
    ----------
    clock : callable, optional
        Returns seconds; replaced in tests.

    Attributes
    ----------
    spans : dict
        Seconds by name.
    work : int
        States times half sweeps that were done.
    busy : float
        Seconds of all threads together that the sweeps took.
    stage : str
        Name of the innermost span that is open, for progress.
    notify : callable
        Takes a sentence for the user, before work that takes long; does nothing by default.
    progress : Progress
        Of the work that is timed.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._start = clock()
        self.spans: dict[str, float] = {}
        self.work = 0
        self.busy = 0.0
        self.stage = ""
        self.notify: Callable[[str], None] = lambda _: None
        self.progress = Progress()

    @contextmanager
    def span(self, name: str) -> Iterator[None]:
        """Add the time until the end of the block to `name`, also when the block raises."""
        begin = self._clock()
        outer, self.stage = self.stage, name
        try:
            yield
        finally:
            self.stage = outer
            self.add(name, self._clock() - begin)

    def add(self, name: str, seconds: float) -> None:
        """Add seconds that were measured elsewhere."""
        self.spans[name] = self.spans.get(name, 0.0) + seconds

    def beside(self) -> "Stopwatch":
        """A fresh one for a part of the work, which notifies and stops as this one does."""
        part = Stopwatch(self._clock)
        part.notify, part.progress = self.notify, self.progress
        return part

    def absorb(self, other: "Stopwatch") -> None:
        """Add what another one measured."""
        for name, seconds in other.spans.items():
            self.add(name, seconds)
        self.work += other.work
        self.busy += other.busy

    @property
    def nanoseconds(self) -> float:
        """Time of a state in half a sweep."""
        return 1e9 * self.busy / self.work if self.work else 0.0

    def elapsed(self) -> float:
        """Seconds since this stopwatch was made."""
        return self._clock() - self._start
