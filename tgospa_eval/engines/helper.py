"""One process beside ours, for compiled code that damaged data may end: it alone ends then.

It begins with the first call and stays as long as this process does.
"""

import atexit
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from tgospa_eval.engines.engine import DiedError
from tgospa_eval.engines.processes import ONE_THREAD, uninterrupted
from tgospa_eval.text import on_surface, surface

SERVE = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from tgospa_eval.engines.helper import serve; serve()"
)

_lock = threading.Lock()


def call(function: Callable[..., Any], *arguments: object) -> Any:
    """Call a function of a module in the process.

    Raises
    ------
    OSError
        No process can be started.
    DiedError
        The process ended; with what is the message.
    Exception
        Whatever the function raises.
    """
    with _lock:
        is_done, result = _answer(
            _started(os.getpid()), (on_surface, (surface.get(), function, *arguments))
        )
    if not is_done:
        raise result
    return result


@cache
def _started(parent: int) -> Any:  # noqa: ARG001  (one that was forked has none)
    """Start the process."""
    with uninterrupted():
        process: Any = subprocess.Popen(
            [sys.executable, "-c", SERVE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD,
        )
    atexit.register(process.__exit__, None, None, None)
    try:
        _answer(process, sys.path)
    except DiedError as error:
        raise OSError(f"it ended as it began, with {error}") from None
    return process


def _answer(process: Any, message: object) -> Any:
    """What the process answers."""
    try:
        pickle.dump(message, process.stdin, pickle.HIGHEST_PROTOCOL)
        process.stdin.flush()
        return pickle.load(process.stdout)
    except BaseException as error:  # Ctrl-C too: what would come later answers nobody
        _started.cache_clear()
        process.kill()
        process.communicate()
        if isinstance(error, OSError | EOFError | pickle.UnpicklingError):
            raise DiedError(f"status {process.returncode}") from None
        raise


def serve() -> None:
    """Answer calls until whoever makes them is gone."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # for whatever a library prints
    result: tuple[bool, object] = True, None
    while True:
        pickle.dump(result, answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()
        try:
            function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            result = True, function(*arguments)
        except Exception as error:
            result = False, error
