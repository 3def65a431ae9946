"""What solvers propose and what is proven of it: solutions, bounds, breakdowns, brackets."""

from dataclasses import field

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.progress import Status
from tgospa_eval.problem.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """What a solver proposes; nothing in it is trusted.

    Parameters
    ----------
    weights : (S,) float array
        Assignment of each state, between 0 and 1.
    prices : (K,) float array
        Price of each column slot.
    status : Status
        How it ended, for the user.
    detail : str
        More of that.
    unsolved : pair of int, optional
        Components that were not solved, of how many that were not trivial.
    iterations : int
        Sweeps or simplex iterations.
    finished : bool
        False if a limit or a failure stopped the solver early.
    history : tuple of dict
        Convergence, one record per check.
    disposable : bool
        Whether the weights are handed over with it: whoever gets it may write over them.
    missing : (B,) bool array
        Blocks that are not known to be solved.
    reduced : tuple of Reduced
        Blocks of which prices at a smaller cutoff prove more.
    """

    weights: Floats
    prices: Floats
    status: Status
    detail: str = ""
    unsolved: tuple[int, int] | None = None
    iterations: int = 0
    finished: bool = True
    history: tuple[dict[str, float], ...] = field(default=())
    disposable: bool = False
    missing: Mask = field(default_factory=lambda: np.zeros(0, bool))
    reduced: "tuple[Reduced, ...]" = ()

    @property
    def sentence(self) -> str:
        """The status with what belongs to it."""
        text = f"{self.status} ({self.detail})" if self.detail else str(self.status)
        if self.unsolved is None:
            return text
        return f"{text} ({self.unsolved[0]} of {self.unsolved[1]} components)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """Some blocks of a problem at a smaller cutoff, and what is proposed for that.

    Parameters
    ----------
    states : States
        The problem of these blocks at the smaller cutoff, from `problem.certificate`.
    blocks : (B,) bool array
        Which blocks of the whole they are.
    scale : float
        The smaller cutoff to the power p, as a fraction of that of the whole; a power of 2.
    solution : Solution
        Of `states`.
    """

    states: States
    blocks: Mask
    scale: float
    solution: Solution


@dataclass(frozen=True, kw_only=True)
class Bounds(Interval):
    """Proven: ``lower <= optimum <= upper``, in units of c^p, rounded outward.

    Parameters
    ----------
    lower, upper : float
        The bracket; `upper` is the cost of a feasible assignment.
    rounding : float
        An `upper` below this may come from the last places of the states alone.
    """

    rounding: float = 0.0

    @property
    def relative_gap(self) -> float:
        """(upper - lower) / upper, 0 if upper is 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0 else 0.0

    def within_rounding(self, gap: float) -> bool:
        """Whether a wider bracket says no less, since the cost itself is one of rounding."""
        return self.upper - self.lower > gap * self.upper and self.upper <= self.rounding

    def met(self, gap: float) -> bool:
        """Whether the bracket is as narrow as `gap`, relative, or the cost is one of rounding."""
        return self.upper - self.lower <= gap * self.upper or self.upper <= self.rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakdown:
    """Where the cost of a feasible assignment comes from, in units of c^p.

    Parameters
    ----------
    localisation, missed, false, switch : (T,) float arrays
        Cost at each step; a switch between two steps is booked at the later one.
    missed_count, false_count, switch_count : (T,) float arrays
        Unassigned existing objects, and half the total variation of the assignment.
    total : float
        The whole cost: of its terms, not of those of each step.
    """

    localisation: Floats
    missed: Floats
    false: Floats
    switch: Floats
    missed_count: Floats
    false_count: Floats
    switch_count: Floats
    total: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Brackets:
    """Costs of N stretches of steps, each by itself, in units of c^p: of a curve, of windows.

    Parameters
    ----------
    lower, upper : (N,) float arrays
        Proven bounds.
    parts : (4, N) float array
        Localisation, missed, false and switch cost of the assignment that `upper` is the cost of.
    rounding : (N,) float array
        As of `Bounds`.
    """

    lower: Floats
    upper: Floats
    parts: Floats
    rounding: Floats

    def met(self, gap: float) -> Mask:
        """As of `Bounds`, (N,)."""
        narrow = self.upper - self.lower <= gap * self.upper
        met: Mask = narrow | (self.upper <= self.rounding)
        return met


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows(Brackets):
    """Costs of sliding windows.

    Parameters
    ----------
    first, last : (N,) int arrays
        The first and the last step of each, of the T steps.
    size, every : str
        Length of each, and from one to the next, in words; blank until they are known. The last
        may be nearer to the one before.
    """

    first: Ints
    last: Ints
    size: str = ""
    every: str = ""
