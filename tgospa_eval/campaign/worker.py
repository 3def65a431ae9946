"""The process that runs one solver: ``python -m tgospa_eval.campaign.worker``.

Reads a pickled (problem, solver) from stdin. Writes pickles to stdout: what is known on the way,
and in the end a run. A byte after the question asks it to stop with what it has. It ends when
stdin is closed, so that it does not outlive the one who asked.
"""

import contextlib
import os
import pickle
import sys
import threading
from pathlib import Path
from typing import BinaryIO

from tgospa_eval.campaign.solvers import reason, run_here, warm_up
from tgospa_eval.common.progress import BackgroundTask, Progress, Stopwatch
from tgospa_eval.errors import SolverError, TgospaError
from tgospa_eval.evaluation.prepare import Prepared
from tgospa_eval.solvers import Solver

PROC_STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")
BEAT = 0.2
"""Seconds from one word to the next."""


def main() -> None:
    """Answer one question, and report progress until then."""
    source, target = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # nothing else may write into the answer
    prepared, solver = pickle.load(source)
    stopwatch = Stopwatch()
    progress = stopwatch.progress = Progress(watched=True)
    threading.Thread(target=_listen, args=(source, progress), daemon=True).start()
    task = BackgroundTask(lambda: _answer(prepared, solver, stopwatch))
    while not task.wait(BEAT):
        _send(target, (progress.share, progress.bracket))
    _send(target, task.answer())
    target.close()
    os._exit(0)


def _answer(prepared: Prepared, solver: Solver, stopwatch: Stopwatch) -> object:
    """The run, or what went wrong."""
    try:
        warm_up(solver)
        with contextlib.suppress(OSError):
            RESET.write_text("5", encoding="ascii")  # the peak from here on
        before = memory("VmRSS")
        run = run_here(prepared, solver, stopwatch)
        peak = memory("VmHWM")
        if before is not None and peak is not None:
            run["memory"] = {"before": before, "peak": peak}
    except TgospaError as error:
        return type(error), str(error)
    except Exception as error:
        return SolverError, reason(error)
    return run


def _send(target: BinaryIO, message: object) -> None:
    pickle.dump(message, target, protocol=pickle.HIGHEST_PROTOCOL)
    target.flush()


def memory(field: str) -> int | None:
    """Bytes of this process, as Linux counts them: VmRSS now, VmHWM at most; else None."""
    try:
        lines = PROC_STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    found = next((line for line in lines if line.startswith(f"{field}:")), None)
    return None if found is None else 1024 * int(found.split()[1])


def _listen(source: BinaryIO, progress: Progress) -> None:
    """A byte asks it to stop; the end, that nobody waits any more."""
    if source.read(1):
        progress.stop.set()
        source.read()
    os._exit(1)


if __name__ == "__main__":
    main()
