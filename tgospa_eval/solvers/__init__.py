"""Solvers of a problem; each has a file and a line in `SOLVERS`, and returns a `Solution`.

All files here use the letters of docs/theory/notation.md, the words of `problem.states` (state,
run, slot, block), and those of docs/theory/solvers.md (sweep, stage, temperature, working set,
slack of a state, programme, reach). A *node* is a row or a column. A slot is *full* if the weights
of its states sum to 1. Its *room* is 1 minus this sum. A block is *open* until it is solved. An
*entry* is a near pair at a step. Shapes are (S,) for states, (K,) for column slots, (B,) for
blocks, (N,) for entries and (T,) for steps.
"""

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
    """Settings of a solver, in an object that cannot be changed; call it to solve a problem."""

    @property
    def name(self) -> str:
        """Name as on the command line."""

    @property
    def proves(self) -> bool:
        """True if the solver works until its proven gap is at most `gap`, and uses warm starts."""
        return False

    @property
    def referee(self) -> bool:
        """True if the solver serves to check others: it is slow, and does not use their kernels."""
        return False

    @property
    def epsilon(self) -> float | None:
        """Temperature as a fraction of c^p; None if the solver has no temperature."""
        return None

    @property
    def gap(self) -> float:
        """Relative gap of the total that counts as exact."""
        return 1e-9

    @property
    def time_limit(self) -> float | None:
        """Seconds after which the solver stops with its best solution; None for no limit."""
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
"""Module and class of each solver. A module is imported when its solver is used."""


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
    """Return a solver as it is, or the solver with this name and default settings."""
    if isinstance(solver, str):
        return solver_class(solver)()
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver
