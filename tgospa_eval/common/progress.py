"""Progress of long work, and ways to stop it before its end.

Work writes to a `Progress`, and a display reads from it.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import field
from enum import StrEnum
from typing import Generic, TypeVar

from tgospa_eval.common.frozen import dataclass


class Status(StrEnum):
    """Reasons why a solver stopped."""

    SOLVED = "solved"
    NOT_SOLVED = "not solved"
    LATE = "stopped by the time limit"
    INTERRUPTED = "interrupted"
    MET = "the bracket is met"
    SETTLED = "the bracket has stopped narrowing"
    FULL = "columns are full to 1e-06"
    SWEPT = "reached 2,000 sweeps"
    HIGHS_FAILED = "HiGHS failed"
    CLARABEL_FAILED = "failed"

    @property
    def good(self) -> bool:
        """True if the solver finished its work."""
        return self in (Status.SOLVED, Status.MET)


T = TypeVar("T")

SOON, PACE = 1.0, 0.5
"""Seconds before proven bounds are displayed first, and seconds between two displays of bounds."""


class StoppedError(Exception):
    """Error after a request to stop: the work could not be stopped and was abandoned."""


class Progress:
    """Progress of some work, and the request to stop it.

    Parameters
    ----------
    watched : bool
        Whether the progress is displayed.
    stop : Event, optional
        Event to share with other work. If it is set, all work that shares it stops. By default, a
        new event.

    Attributes
    ----------
    stop : Event
        Event that is set when the work must stop.
    stoppable : bool
        Whether the work gives a result even if it is stopped.
    name : str
        Name of the current part of the work.
    share : float
        Share of the work that is done, 0 to 1.
    bracket : pair of float, optional
        Proven bounds of TGOSPA. If the work has several parts, they are those of the current part.
    left : float, optional
        Estimated seconds until all pieces of work of `Stopwatch.paced` are done.
    """

    def __init__(self, *, watched: bool = False, stop: threading.Event | None = None) -> None:
        self.watched = watched
        self.stop = stop or threading.Event()
        self.stoppable = False
        self.name = ""
        self.share = 0.0
        self.bracket: tuple[float, float] | None = None
        self.left: float | None = None
        self.scale: Callable[[float], float] = lambda total: total
        self._span = (0.0, 1.0)
        self._due = time.monotonic() + SOON

    @property
    def due(self) -> bool:
        """True if it is time to compute and show proven bounds."""
        return self.watched and time.monotonic() > self._due

    def silent(self) -> "Progress":
        """Return a progress that no display reads, but with the same event to stop."""
        return Progress(watched=self.watched, stop=self.stop)

    def begin(self, scale: Callable[[float], float]) -> None:
        """Report that solving begins.

        `scale` converts a total cost to TGOSPA. The cost is in units of cutoff^p.
        """
        self.scale, self.bracket, self.stoppable = scale, None, True

    @contextmanager
    def part(self, name: str, number: int, count: int) -> Iterator[None]:
        """Report that the block does one of `count` parts of the work; `number` is its index."""
        outer, around = self._span, self.name
        self._span = (outer[0] + outer[1] * number / count, outer[1] / count)
        self.name, self.bracket = f"{name}, {number + 1} of {count}", None
        self.done(0.0)
        try:
            yield
        finally:
            self.done(1.0)
            self._span, self.name, self.bracket = outer, around, None

    def done(self, share: float) -> None:
        """Report the share of the part that is done."""
        share = self._span[0] + self._span[1] * share
        if self.watched:
            self.share = max(share, self.share)

    def again(self, name: str, share: float) -> None:
        """Report the share of the part `name` that is done. A new name begins a new part at 0."""
        if self.name != name:
            self.name, self.share = name, 0.0
        self.done(share)

    def prove(self, lower: float, upper: float) -> None:
        """Report proven bounds of the total cost, in units of cutoff^p."""
        bracket = self.scale(max(lower, 0.0)), self.scale(max(upper, 0.0))
        if self.bracket is not None:  # bounds that were proven before may be nearer
            bracket = max(bracket[0], self.bracket[0]), min(bracket[1], self.bracket[1])
        self.bracket = bracket
        self._due = max(self._due, time.monotonic() + PACE)

    def in_thread(self, work: Callable[[], T]) -> T:
        """Do work in a thread, which the caller can leave behind if a stop is requested.

        If the progress is not displayed, the work is done in the calling thread.

        Raises
        ------
        StoppedError
            A stop is requested. The thread continues, but nobody uses its result.
        """
        if not self.watched:
            return work()
        task = BackgroundTask(work)
        while not task.wait(0.1):
            if self.stop.is_set():
                raise StoppedError
        return task.answer()


class BackgroundTask(Generic[T]):
    """Work in a daemon thread: the process can end before the thread does."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._answer: list[T] = []
        self._failure: list[BaseException] = []
        self._thread = threading.Thread(target=copy_context().run, args=(self._body,), daemon=True)
        self._thread.start()

    def _body(self) -> None:
        try:
            self._answer.append(self._work())
        except BaseException as error:
            self._failure.append(error)

    def wait(self, seconds: float) -> bool:
        """Wait at most this many seconds; return whether the task has ended."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def answer(self) -> T:
        """Return the answer of the task, or raise its error."""
        if self._failure:
            raise self._failure[0]
        return self._answer[0]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Time limit of the solver. After a request to stop, no time is left either.

    Parameters
    ----------
    deadline : float, optional
        End of the time, on the clock of `time.monotonic`; None for no limit.
    progress : Progress
        Progress of the work; its event `stop` is the request to stop.
    """

    deadline: float | None = None
    progress: Progress = field(default_factory=Progress)

    @classmethod
    def of(cls, seconds: float | None, progress: Progress) -> "Limit":
        """Return a limit of this many seconds from now; None means no limit."""
        deadline = None if seconds is None else time.monotonic() + seconds
        return cls(deadline=deadline, progress=progress)

    def left(self) -> float | None:
        """Return the seconds left, at least 0; None means no limit."""
        if self.progress.stop.is_set():
            return 0.0
        return None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0)

    def late(self) -> bool:
        """Return whether no time is left."""
        return self.progress.stop.is_set() or (
            self.deadline is not None and time.monotonic() > self.deadline
        )

    @property
    def status(self) -> Status:
        """Reason to stop when no time is left."""
        return Status.INTERRUPTED if self.progress.stop.is_set() else Status.LATE


# -------------------------------------------------------------------------------------------------
# A stopwatch for named blocks of code, which can be nested.


PACED_FROM, ANNOUNCED_FROM = 2.0, 5.0
"""Seconds of work before the first estimate of the remaining time, and the smallest estimate, in
seconds, that the user is told."""


class Stopwatch:
    """Clock that adds up seconds by name. A name can be a path such as ``"solve/lp"``.

    Parameters
    ----------
    clock : callable, optional
        Function that returns the time in seconds; tests replace it.

    Attributes
    ----------
    spans : dict
        Seconds by name.
    work : int
        Number of states that half sweeps of the solver process. A half sweep goes through all steps
        once, forwards or backwards. A state counts once in each half sweep.
    busy : float
        Seconds that the sweeps took, added over all threads.
    stage : str
        Name of the innermost block of `span` or `showing` that is running, for displays.
    notify : callable
        Function that receives a sentence for the user about long work. The default does nothing.
    progress : Progress
        Progress of the timed work.
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
        """Add the time of the block to the seconds of `name`, also if the block raises an error."""
        begin, outer = self._clock(), self.stage
        self.stage = name
        try:
            yield
        finally:
            self.stage = outer
            self.add(name, self._clock() - begin)

    @contextmanager
    def showing(self, stage: str = "") -> Iterator[None]:
        """Set `stage` for the block. At the end of the block, its old value is restored."""
        outer, self.stage = self.stage, stage or self.stage
        try:
            yield
        finally:
            self.stage = outer

    def paced(
        self, pieces: Iterable[T], works: Iterable[float], what: str, hint: str = ""
    ) -> Iterator[T]:
        """Yield pieces of work as they are done, and estimate the time for the remaining pieces.

        The estimate uses the time of the finished pieces. `works` has the amount of work of each
        piece, in any unit. The message to the user begins with `what`, the name of the work, and
        ends with `hint`.
        """
        works = list(works)
        begin, first, done, whole, announced = -1.0, 0.0, 0.0, sum(works), False
        try:
            for piece, work in zip(pieces, works, strict=True):
                done += work
                # Time is measured from the end of the first piece, when all threads are busy.
                if begin < 0:
                    begin, first = self._clock(), done
                spent = self._clock() - begin
                if spent > PACED_FROM and done > first:
                    left = self.progress.left = spent / (done - first) * (whole - done)
                    if not announced and left > ANNOUNCED_FROM:
                        shown = f"{left:.0f} s" if left < 120 else f"{left / 60:.0f} min"
                        self.notify(f"{what}, about {shown} left{hint}")
                    announced = True
                yield piece
        finally:
            self.progress.left = None

    def add(self, name: str, seconds: float) -> None:
        """Add seconds that another clock measured."""
        self.spans[name] = self.spans.get(name, 0.0) + seconds

    def beside(self) -> "Stopwatch":
        """Return a new stopwatch for a part of the work, with the same `notify` and `progress`."""
        part = Stopwatch(self._clock)
        part.notify, part.progress = self.notify, self.progress
        return part

    def absorb(self, other: "Stopwatch") -> None:
        """Add the seconds and the work that another stopwatch has measured."""
        for name, seconds in other.spans.items():
            self.add(name, seconds)
        self.work += other.work
        self.busy += other.busy

    @property
    def nanoseconds(self) -> float:
        """Nanoseconds that a half sweep takes for each state."""
        return 1e9 * self.busy / self.work if self.work else 0.0

    def elapsed(self) -> float:
        """Return the seconds since this stopwatch was made."""
        return self._clock() - self._start
