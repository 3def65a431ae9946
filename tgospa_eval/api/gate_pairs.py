"""Pairs of a gate to values, in this process or in several."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from tgospa_eval.api.evaluate import evaluate_sides, read_sides
from tgospa_eval.api.notices import about_run
from tgospa_eval.api.options import Request
from tgospa_eval.api.resolve import make_settings
from tgospa_eval.campaign.gate.baseline import Measured, measured
from tgospa_eval.campaign.gate.suite import Pair
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.engines.engine import spread
from tgospa_eval.engines.processes import Processes
from tgospa_eval.errors import SolverError, TgospaError
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.show.files import PROOF, write_texts

PATIENCE = 2.0
"""Seconds of work before processes are started, which takes about as long."""

SHOWN = 10.0
"""Seconds between two lines of progress."""

Work = Callable[[], Evaluation]
Run = Callable[[Work, Stopwatch], Evaluation]
"""Runs the work of one pair; the command line shows how far it is, and lets Ctrl-C stop it."""


@dataclass(frozen=True, kw_only=True)
class PairTask:
    """A pair of files with everything that a worker needs.

    Parameters
    ----------
    pair : Pair
        The files.
    options : Request
        Options of the evaluation.
    proof : str, optional
        Folder to which the proof is written.
    page : bool
        Whether a page is made.
    prefix : str
        First words of each line for the user.
    quiet, verbose : bool
        Which lines there are for the user.
    """

    pair: Pair
    options: Request
    proof: str | None
    page: bool
    prefix: str
    quiet: bool
    verbose: bool


Answer = tuple[str, Measured | TgospaError, bool, Mapping[str, Any], Sequence[str]]
"""Name of the pair, its values, whether the accuracy is reached, more for the outcome, lines."""


def evaluate_pair(
    task: PairTask, run: Run = lambda work, _: work(), say: Callable[[str], None] | None = None
) -> Answer:
    """The answer of a pair; `say` gets lines for the user at once, else the answer has them."""
    begin, lines = time.monotonic(), list[str]()
    say = say or lines.append

    def notify(notice: Notice) -> None:
        if notice.code or not task.quiet:
            say(str(notice))

    now: Measured | TgospaError
    about: dict[str, Any] = {}
    finished, files = False, (task.pair.truth, task.pair.estimate)
    try:
        settings, stopwatch = make_settings(task.options), Stopwatch()
        if not task.quiet:
            stopwatch.notify = say

        def work() -> Evaluation:
            sides = read_sides(settings, *files, stopwatch, notify)
            return evaluate_sides(settings, sides, stopwatch, notify)

        result = run(work, stopwatch)
        for text in about_run(result, settings, stopwatch, verbose=task.verbose):
            say(text)
        now, finished, about["warnings"] = measured(result), result.finished, result.warnings
        if task.proof is not None:
            from tgospa_eval.show.files import proof_files  # here: few ask for proofs

            texts = proof_files(result, task.options.given)
            write_texts(texts, task.proof, PROOF, force=False, option="--proof")
        if task.page:
            from tgospa_eval.show.html import page  # here: for folders only

            about["page"] = page(result, files)
    except TgospaError as error:
        now = error
    return task.pair.name, now, finished, about | {"seconds": time.monotonic() - begin}, lines


def lost_pair(task: PairTask) -> Answer:
    """The answer of a pair whose process died, also when nothing else was worked on."""
    return task.pair.name, SolverError("its process died"), False, {}, ()


def answers_of(
    tasks: Sequence[PairTask], notify: Callable[[str], None], run: Run
) -> Iterator[Answer]:
    """Answers as they are ready: of this process at first, and of several if that takes long."""
    begin = shown = time.monotonic()
    done = 0
    for task in tasks:
        if done and len(tasks) - done > 1 and time.monotonic() - begin > PATIENCE:
            break
        yield evaluate_pair(task, run, lambda text, prefix=task.prefix: notify(prefix + text))  # type: ignore[misc]
        done += 1
    rest = [replace(task, options=replace(task.options, jobs=1)) for task in tasks[done:]]
    engine = Processes(tasks[0].options.jobs if tasks else None)
    for answer in spread(evaluate_pair, rest, lost_pair, engine) if rest else ():
        yield answer
        done += 1
        now = time.monotonic()
        if not tasks[0].quiet and now - shown > SHOWN:
            left = (now - begin) / done * (len(tasks) - done)
            shown = now
            notify(f"{done} of {len(tasks)} pairs, about {left:.0f} s left")
