"""One problem through several solvers: do they agree, how near are they, what do they cost."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import cast

from tgospa_eval._version import __version__
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval, excess, narrowest, overlap, shortfall
from tgospa_eval.common.progress import Progress
from tgospa_eval.comparison import SCHEMA
from tgospa_eval.comparison.entrants import NO_COSTS, SolvedRun, failed, name_of, run_apart
from tgospa_eval.evaluation.prepare import Prepared
from tgospa_eval.reports.records import Metric, SolverRun, SolversRecord
from tgospa_eval.solvers import Solver

ONCE = {"read": "read", "distances": "distances", "preparation": "solve/preparation"}
"""What is done once for all solvers, and the span of the stopwatch that has its time."""


@dataclass(frozen=True, kw_only=True)
class SolverComparison:
    """Runs of several solvers on one problem.

    Parameters
    ----------
    runs : sequence of SolvedRun
        At least one.
    """

    runs: Sequence[SolvedRun]

    @property
    def contradictions(self) -> list[tuple[SolvedRun, SolvedRun]]:
        """Pairs of runs whose brackets do not overlap: one of their proofs is wrong."""
        return [
            (first, second)
            for k, first in enumerate(self.runs)
            for second in self.runs[k + 1 :]
            if first.bracket and second.bracket and not overlap(first.bracket, second.bracket)
        ]

    @cached_property
    def referee(self) -> Interval | None:
        """What all runs together prove of the total: nothing where they contradict each other."""
        proven = [run.bracket for run in self.runs if run.bracket is not None]
        return narrowest(proven) if proven and not self.contradictions else None

    def error(self, run: SolvedRun) -> float | None:
        """Proven: the run's total is at most so much, relative, above the true one."""
        if self.referee is None or run.bracket is None:
            return None
        return excess(run.bracket.upper, self.referee.lower)

    def lower_error(self, run: SolvedRun) -> float | None:
        """Proven: the run's lower bound of the total is at most so much, relative, below it."""
        if self.referee is None or run.bracket is None:
            return None
        return shortfall(run.bracket.lower, self.referee.upper)


def compare_solvers(
    prepared: Prepared,
    solvers: Sequence[Solver],
    run: Callable[[Prepared, Solver], SolvedRun] | None = None,
    progress: Progress | None = None,
) -> SolverComparison:
    """Run all solvers, one after the other; one that fails leaves the others their results.

    Those that are not begun when the work is to stop are left out.

    Parameters
    ----------
    prepared : Prepared
        The problem; made once.
    solvers : sequence of Solver
        With their settings.
    run : callable, optional
        `run_here`, or else `run_apart`.
    progress : Progress, optional
        Gets which of them runs, and how far that is.
    """
    progress = progress or Progress()
    run = run or partial(run_apart, progress=progress)
    runs: list[SolvedRun] = []
    for number, solver in enumerate(solvers):
        if runs and progress.stop.is_set():
            break
        with progress.part(name_of(solver), number, len(solvers)):
            try:
                runs.append(run(prepared, solver))
            except Exception as error:  # whatever it is, it must not cost what others have found
                runs.append(failed(solver, error))
    return SolverComparison(runs=tuple(runs))


def solvers_document(
    comparison: SolverComparison,
    prepared: Prepared,
    left_out: dict[str, str],
    seconds: dict[str, float],
    warnings: list[dict[str, str]],
) -> SolversRecord:
    """The JSON document.

    Parameters
    ----------
    comparison : SolverComparison
        What was found.
    prepared : Prepared
        The problem.
    left_out : dict
        Solvers that did not run, and why.
    seconds : dict
        What was done once for all, and how long it took.
    warnings : list of dict
        What looks wrong with the data.
    """
    referee = comparison.referee
    order = prepared.parameters.order
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "solvers",
        "agree": not comparison.contradictions,
        "contradictions": [[a.name, b.name] for a, b in comparison.contradictions],
        "referee": None
        if referee is None
        else {
            "lower_bound": referee.lower ** (1 / order),
            "upper_bound": referee.upper ** (1 / order),
            "total": {"lower": referee.lower, "upper": referee.upper},
        },
        "runs": [run_document(comparison, run) for run in comparison.runs],
        "left_out": left_out,
        "parameters": cast("Metric", prepared.settings),
        "sizes": {**prepared.sizes, "states": len(prepared.states.begin)},
        "input": prepared.input,
        "seconds": seconds,
        "warnings": warnings,
    }


def run_document(comparison: SolverComparison, run: SolvedRun) -> SolverRun:
    """One run, with its errors against what all of them prove."""
    error, bracket = comparison.error(run), run.bracket
    return {
        "name": run.name,
        "solver": run.solver,
        "epsilon": run.epsilon,
        "tgospa": run.tgospa,
        "lower_bound": run.lower_bound,
        "total": None if bracket is None else bracket.upper,
        "total_lower": None if bracket is None else bracket.lower,
        "error": error if error is not None and math.isfinite(error) else None,
        "lower_error": comparison.lower_error(run),
        **(run.parts or NO_COSTS),
        "counts": run.counts,
        "status": run.status,
        "finished": run.finished,
        "iterations": run.iterations,
        "seconds": run.seconds,
        "memory": run.memory,
        "history": list(run.history),
    }
