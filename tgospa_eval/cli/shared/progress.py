"""Work in a thread, so that Ctrl-C acts at once and progress can be shown."""

import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeVar

from tgospa_eval.cli.shared.streams import handles_interrupts, on_interrupt, print_notice
from tgospa_eval.common.progress import BackgroundTask, Progress, Stopwatch
from tgospa_eval.quoting import visible

T = TypeVar("T")

STAGES = {
    "read": "reading",
    "distances": "searching near pairs",
    "solve/preparation": "preparing",
    "solve/sweeps": "solving",
    "solve/build": "solving",
    "solve/lp": "solving",
    "certify": "proving",
    "report": "reporting",
    "curve": "solving the steps up to each",
    "windows": "solving windows",
    "other_metrics": "other metrics",
}
SILENT = 2.0
"""Seconds of work before progress is shown on a terminal."""

LINE_WIDTH = 79
"""Width of the line of progress, which must not wrap."""

MIN_DIGITS, MAX_DIGITS = 5, 9
"""Smallest and largest number of digits of a bound."""

FIRST, SELDOM = 10.0, 600.0
"""Times of lines of progress without a terminal, in seconds. The first line is shown after `FIRST`.
The time between two lines then doubles until it is `SELDOM`."""


LONG, NEAR = 10.0, 0.01
"""After `LONG` seconds of work, a relative gap of at most `NEAR` gives a hint that the user can
stop."""

ADVICE = (
    "the bounds are within 1 %: Ctrl-C stops and keeps them; --gap and --time-limit stop "
    "automatically"
)


def new_stopwatch(*, quiet: bool) -> Stopwatch:
    """Return a stopwatch that prints its messages for the user, unless `quiet`."""
    stopwatch = Stopwatch()
    if not quiet:
        stopwatch.notify = print_notice
    return stopwatch


def run(work: Callable[[], T], stopwatch: Stopwatch, *, show: bool) -> T:
    """Do the work in a thread, show its progress if it takes long, and handle Ctrl-C.

    Work that can be stopped, such as solving, stops at the first Ctrl-C, and its result so far is
    returned. A thread is not needed if progress is not shown and Ctrl-C is not handled, as in the
    workers of a batch. Then the work is done without one.
    """
    if not show and not handles_interrupts():
        return work()
    progress = stopwatch.progress = Progress(watched=True)

    def take() -> bool:
        if not progress.stoppable or progress.stop.is_set():
            return False
        progress.stop.set()
        return True

    announced = False

    def announce() -> None:
        display.clear()
        if show:
            print_notice("stopping: the bounds proven so far follow; Ctrl-C again ends at once")

    say = stopwatch.notify

    def notify(text: str) -> None:
        display.clear()
        say(text)

    stopwatch.notify = notify
    with on_interrupt(take), Display(stopwatch) as display:
        task = BackgroundTask(work)
        while not task.wait(0.1):
            if progress.stop.is_set() and not announced:
                announced = True
                announce()
            elif show and not announced:
                display.update()
        if progress.stop.is_set() and not announced:
            announce()
    return task.answer()


@contextmanager
def shown(stopwatch: Stopwatch, *, show: bool) -> Iterator[None]:
    """Show progress while the block runs. Ctrl-C raises KeyboardInterrupt in the block."""
    stopwatch.progress = Progress(watched=True)
    if not show:
        yield
        return
    ended = threading.Event()
    with Display(stopwatch) as display:

        def poll() -> None:
            while not ended.wait(0.2):
                display.update()

        polling = BackgroundTask(poll)
        try:
            yield
        finally:
            ended.set()
            polling.wait(1.0)


class Display:
    """Progress on stderr: one line that is overwritten on a terminal, new lines elsewhere."""

    def __init__(self, stopwatch: Stopwatch) -> None:
        self.stopwatch, self.begin = stopwatch, time.monotonic()
        self.lively = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
        self.next = SILENT if self.lively else FIRST
        self.shown = self.advised = False

    def __enter__(self) -> "Display":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def update(self) -> None:
        """Show the progress, if it is time for it."""
        seconds = time.monotonic() - self.begin
        if seconds >= LONG and not self.advised and _is_near(self.stopwatch.progress):
            self.advised = True
            self.clear()
            print_notice(ADVICE)
        if seconds < self.next:
            return
        text = visible(line(self.stopwatch, seconds))
        if not self.lively:
            print_notice(text)
            self.next += min(self.next, SELDOM)
            return
        self._write(f"\r{text[:LINE_WIDTH]:<{LINE_WIDTH}}")
        self.shown = True

    def clear(self) -> None:
        """Clear the line of progress on a terminal."""
        if self.shown:
            self._write(f"\r{'':<{LINE_WIDTH}}\r")
            self.shown = False

    def _write(self, text: str) -> None:
        with suppress(OSError, ValueError):  # a closed stderr is no error
            sys.stderr.write(text)
            sys.stderr.flush()


def line(stopwatch: Stopwatch, seconds: float) -> str:
    """Describe the progress in a line: stage, proven bracket, share that is done, and times."""
    progress = stopwatch.progress
    stage, name = STAGES.get(stopwatch.stage, stopwatch.stage) or "working", progress.name
    bounds = [] if progress.bracket is None else [bracket(*progress.bracket)]
    parts = [f"{name}: {(bounds or [stage])[0]}"] if name else [stage, *bounds]
    if progress.share > 0:
        parts.append(f"{100 * progress.share:.0f} % done")
    parts.append(f"{_span(seconds)} so far")
    if progress.left is not None and progress.left >= 0.5:
        parts.append(f"{_span(progress.left)} left")
    return ", ".join(parts)


def _is_near(progress: Progress) -> bool:
    """Return whether the bounds are so close that they could be enough for the user."""
    lower, upper = progress.bracket or (0.0, math.inf)
    return not progress.name and lower < upper < math.inf and upper - lower <= NEAR * upper


def bracket(lower: float, upper: float) -> str:
    """Format both bounds, rounded outward, with enough digits to tell them apart.

    The number of digits is limited by `MAX_DIGITS`.
    """
    digits = MIN_DIGITS
    if 0 < lower < upper < math.inf:
        digits = min(
            max(MIN_DIGITS, 2 + math.floor(math.log10(upper / (upper - lower)))), MAX_DIGITS
        )
    return (
        f"{_rounded(lower, digits, math.floor)} <= TGOSPA <= {_rounded(upper, digits, math.ceil)}"
    )


def _rounded(value: float, digits: int, outward: Callable[[float], int]) -> str:
    if not (0 < value < math.inf):
        return f"{value:g}"
    places = digits - 1 - math.floor(math.log10(value))
    unit = 10.0**-places
    return f"{outward(value / unit) * unit:.{digits}g}"


def _span(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
