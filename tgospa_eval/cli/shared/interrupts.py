"""Ctrl-C: the first ends long work with what is known so far, the second ends the process."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_heard = threading.Event()


def heard() -> bool:
    """Whether there was any in this process."""
    return _heard.is_set()


@contextmanager
def answering(take: Callable[[], bool]) -> Iterator[None]:
    """Ask `take` at each Ctrl-C; unless it takes it, KeyboardInterrupt is raised as ever.

    Where interrupts are ignored, or somebody else answers them, nothing changes.
    """
    if not are_heard():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def answer(number: int, frame: FrameType | None) -> None:
        _heard.set()
        if not take():
            signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def undisturbed() -> Iterator[None]:
    """The first Ctrl-C waits: what is begun is brought to its end."""
    waiting: list[int] = []

    def take() -> bool:
        waiting.append(1)
        return len(waiting) == 1

    with answering(take):
        yield


def are_heard() -> bool:
    """Whether a Ctrl-C would raise KeyboardInterrupt here; not in a worker, which ignores it."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
