"""PROBLEM -> Solution. A member is one file here, one line in `SOLVERS` and a docs line."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.text import quoted

if TYPE_CHECKING:
    from tgospa_eval.solvers.warm_start import WarmStart


@runtime_checkable
class Solver(Protocol):
    """A frozen record of settings that can be called."""

    @property
    def name(self) -> str:
        """As on the command line."""

    @property
    def proves(self) -> bool:
        """True if it goes on until the proven bracket is within `gap`; it takes a warm start."""
        return False

    @property
    def referee(self) -> bool:
        """True if it checks the others: it is slow, and uses none of their kernels."""
        return False

    @property
    def epsilon(self) -> float | None:
        """Temperature, if it has one."""
        return None

    @property
    def gap(self) -> float:
        """Relative gap of the total that counts as exact."""
        return 1e-9

    @property
    def time_limit(self) -> float | None:
        """Seconds after which it stops with what it has."""
        return None

    @property
    def jobs(self) -> int | None:
        """Threads; None is all cores."""
        return None

    def __call__(
        self, states: States, stopwatch: Stopwatch, warm_start: "WarmStart | None" = None
    ) -> Solution:
        """Propose an assignment and prices; a warm start may save work, or is passed over."""


SOLVERS = {
    "certified": "tgospa_eval.solvers.certified:Certified",
    "exact": "tgospa_eval.solvers.exact:Exact",
    "sinkhorn": "tgospa_eval.solvers.sinkhorn:Sinkhorn",
}
"""Place of each solver, which is imported when it is used."""


def solver_class(name: str) -> type[Solver]:
    """Return the class of a solver.

    Raises
    ------
    ConfigError
        No solver has that name.
    """
    from importlib import import_module

    if name not in SOLVERS:
        raise ConfigError(f"no solver {quoted(name)}; there are {', '.join(SOLVERS)}")
    module, _, attribute = SOLVERS[name].partition(":")
    solver: type[Solver] = getattr(import_module(module), attribute)
    return solver


def as_solver(solver: str | Solver) -> Solver:
    """Return a record of settings, or that of a name with default settings."""
    if isinstance(solver, str):
        return solver_class(solver)()
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver
