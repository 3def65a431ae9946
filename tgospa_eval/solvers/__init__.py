"""Solvers, which turn a problem into a `Solution`: each needs a file and a line in `SOLVERS`."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.quoting import quoted

if TYPE_CHECKING:
    from tgospa_eval.solvers.warm_start import WarmStart


@runtime_checkable
class Solver(Protocol):
    """Frozen record of settings that can be called to solve a problem."""

    @property
    def name(self) -> str:
        """Name as on the command line."""

    @property
    def proves(self) -> bool:
        """True if it continues until the proven gap is at most `gap`, and uses warm starts."""
        return False

    @property
    def referee(self) -> bool:
        """True if it checks other solvers: it is slow, and does not use their kernels."""
        return False

    @property
    def epsilon(self) -> float | None:
        """Temperature as a fraction of c^p; None if it has no temperature."""
        return None

    @property
    def gap(self) -> float:
        """Relative gap of the total that counts as exact."""
        return 1e-9

    @property
    def time_limit(self) -> float | None:
        """Seconds after which it stops with its best solution."""
        return None

    @property
    def jobs(self) -> int | None:
        """Number of threads; None means all cores."""
        return None

    def __call__(
        self, states: States, stopwatch: Stopwatch, warm_start: "WarmStart | None" = None
    ) -> Solution:
        """Propose an assignment and prices; a warm start may save work."""


SOLVERS = {
    "certified": "tgospa_eval.solvers.certified:Certified",
    "exact": "tgospa_eval.solvers.exact:Exact",
    "sinkhorn": "tgospa_eval.solvers.sinkhorn:Sinkhorn",
}
"""Module and class of each solver, which is imported when it is used."""


def solver_class(name: str) -> type[Solver]:
    """Return the class of a solver.

    Raises
    ------
    ConfigError
        No solver has this name.
    """
    from importlib import import_module

    if name not in SOLVERS:
        raise ConfigError(f"no solver {quoted(name)}; there are {', '.join(SOLVERS)}")
    module, _, attribute = SOLVERS[name].partition(":")
    solver: type[Solver] = getattr(import_module(module), attribute)
    return solver


def as_solver(solver: str | Solver) -> Solver:
    """Return the record of settings, or the default record of a named solver."""
    if isinstance(solver, str):
        return solver_class(solver)()
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver
