"""Work in a thread, so that Ctrl-C is heard at once and the stage can be shown."""

import sys
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from tgospa_eval.text import visible
from tgospa_eval.timing import Stopwatch

T = TypeVar("T")

STAGES = {
    "read": "reading",
    "distances": "searching near pairs",
    "solve/preparation": "preparing",
    "solve/sweeps": "sweeping",
    "solve/build": "building the programme",
    "solve/lp": "solving",
    "certify": "proving",
    "report": "reporting",
}
PATIENCE = 2.0
"""Seconds before anything is shown."""


def run(work: Callable[[], T], stopwatch: Stopwatch, *, show: bool) -> T:
    """Do the work; after two seconds show its stage on a terminal."""
    answer: list[T] = []
    failure: list[BaseException] = []

    def body() -> None:
        try:
            answer.append(work())
        except BaseException as error:
            failure.append(error)

    worker = threading.Thread(target=body, daemon=True)
    begin = time.monotonic()
    worker.start()
    show = show and sys.stderr.isatty()
    shown = False
    while worker.is_alive():
        worker.join(0.1)
        seconds = time.monotonic() - begin
        if show and seconds > PATIENCE and worker.is_alive():
            stage = visible(STAGES.get(stopwatch.stage, stopwatch.stage))
            sys.stderr.write(f"\r{f'{stage} ... {seconds:.0f} s':<50}")
            sys.stderr.flush()
            shown = True
    if shown:
        sys.stderr.write(f"\r{'':<50}\r")
        sys.stderr.flush()
    if failure:
        raise failure[0]
    return answer[0]
