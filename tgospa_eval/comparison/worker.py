"""The process that runs one solver: ``python -m tgospa_eval.comparison.worker``.

Reads a pickled (problem, solver) from stdin, writes a pickled `Run` to stdout. Ends when stdin is
closed, so that it does not outlive the one who asked.
"""

import contextlib
import os
import pickle
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path

from tgospa_eval.comparison.runs import reason, run_here, warm_up
from tgospa_eval.errors import SolverError, TgospaError

STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")


def main() -> None:
    """Answer one question."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # at once, also in compiled code
    source, target = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # nothing else may write into the answer
    prepared, solver = pickle.load(source)
    threading.Thread(target=_end_with, args=(source,), daemon=True).start()
    try:
        warm_up(solver)
        with contextlib.suppress(OSError):
            RESET.write_text("5", encoding="ascii")  # the peak from here on
        before = memory("VmRSS")
        run = run_here(prepared, solver)
        peak = memory("VmHWM")
        if before is not None and peak is not None:
            run = replace(run, memory={"before": before, "peak": peak})
        answer: object = run
    except TgospaError as error:
        answer = type(error), str(error)
    except Exception as error:
        answer = SolverError, reason(error)
    pickle.dump(answer, target, protocol=pickle.HIGHEST_PROTOCOL)
    target.close()
    os._exit(0)


def memory(field: str) -> int | None:
    """Bytes of this process, as Linux counts them: VmRSS now, VmHWM at most; else None."""
    try:
        lines = STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    found = next((line for line in lines if line.startswith(f"{field}:")), None)
    return None if found is None else 1024 * int(found.split()[1])


def _end_with(source: object) -> None:
    source.read()  # type: ignore[attr-defined]
    os._exit(1)


if __name__ == "__main__":
    main()
