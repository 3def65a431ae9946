"""Solvers of a problem; each has a file and a line in `SOLVERS`, and returns a `Solution`.

A solver chooses weights between 0 and 1 for the states of a problem, so that the total cost is
small. It also chooses prices >= 0 for the columns. The price of a column slot is what a row must
pay to use the slot. Any prices prove a lower bound of the cost (docs/theory/certificate.md).

`problem.states` defines state, run, slot, block and the letters of array sizes. In addition, (N,)
is the size of an array with an element for each entry. docs/theory/notation.md has the other
letters. The following words are used in all files of this folder.

A *node* is a row or a column. An *entry* is a near pair at a step. The *place* of a row at a step
is a column or "none". A *path* of a row has one place at each step. Its *value* is the sum of its
gains, minus its switch prices. Its value *at the prices* v is less by the prices of the slots on
its way. The *load* of a slot is the sum of the weights of its states. Weights are *feasible* if no
load is above 1. A slot is *full* if its load is 1. Its *room* is 1 minus its load. The *best*
weights and prices are those with the best bounds so far. A block is *open* until it is solved.
*Trivial* blocks are solved by `solvers.trivial`.

The *slack of a state* is the value of the best path of its row, minus the value of the best path
through the state, both at the same prices. States with a small slack may be part of the optimum.
A *programme* is a linear programme that chooses the weights of some states. These are states with a
slack up to its *reach*, and states that have a weight.

A *sweep* is one pass over all steps forward and one backward (two *half sweeps*), which improves
prices. It works with *masses*: each row is divided among its paths, and better paths get larger
shares. The mass of a state is the share of the paths through it. At a high *temperature* many paths
get similar shares, at a low temperature the best path gets nearly everything. A *stage* is a
sequence of sweeps at one temperature. Its *working set* has the states that its sweeps use.
docs/theory/solvers.md has the formulas.
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
    """Return a solver as it is; for a name, return the solver with default settings."""
    if isinstance(solver, str):
        return solver_class(solver)()
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver
