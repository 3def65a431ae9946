"""Weights of states (probabilities of existence), and weights of steps.

A side is the truth or the estimate.
"""

import numpy as np

from tgospa_eval.common.arrays import Floats, freeze
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more, parsed
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import CLOCKS, TimeArray, Trajectories


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightsByTime:
    """Weights of steps, given for timestamps.

    Parameters
    ----------
    times : (N,) int64 or float64 array
        Distinct times, in the form of `Trajectories.times`.
    cost : (N,) float array
        Factor of all costs at each time, except of switches.
    switch : (N,) float array
        Factor of the switches from the step before each time to this time.
    clock : {"number", "local", "zoned"}
        Kind of the times.
    name : str
        Source of the weights, for messages.
    """

    times: TimeArray
    cost: Floats
    switch: Floats
    clock: str = "number"
    name: str = "step_weights"

    def __post_init__(self) -> None:
        freeze(self)

    def on(self, side: Trajectories) -> tuple[Floats, Floats]:
        """Return the factors of costs (T,) and of switches (T - 1,) for the T steps of a side.

        Raises
        ------
        InputError
            A step has no weight, or the times are of another kind.
        """
        if not len(side.times):
            return np.zeros(0), np.zeros(0)
        if self.clock != side.clock:
            raise InputError(
                f"{self.name} has {CLOCKS[self.clock]}, the tracks have {CLOCKS[side.clock]}; "
                "write both alike"
            )
        if not len(self.times):
            raise InputError(f"{self.name}: there are no weights; give every step a weight")
        order = np.argsort(self.times, kind="stable")
        times = self.times[order]
        place = np.searchsorted(times, side.times).clip(max=len(times) - 1)
        missing = np.flatnonzero(times[place] != side.times)
        if len(missing):
            raise InputError(
                f"{self.name}: no weight for t = {side.shown[missing[0]]}{more(len(missing))}; "
                "give every step of the two files a weight, 0 if the step does not count"
            )
        at = order[place]
        return self.cost[at], self.switch[at][1:]


def repeated(times: TimeArray) -> tuple[int, int, int] | None:
    """Find repeated times; return None if all times are distinct.

    The result has three numbers: the index of the first element that repeats an earlier time, the
    index of this earlier time, and the number of all elements that repeat an earlier time.
    """
    order = np.argsort(times, kind="stable")
    again = np.flatnonzero(times[order][1:] == times[order][:-1]) + 1
    if not len(again):
        return None
    row = int(order[again].min())
    return row, int(np.flatnonzero(times == times[row])[0]), len(again)


EXISTENCE = "existence"
"""Name of the column, and of the attribute, with probabilities of existence."""


def existence_of(side: Trajectories) -> Floats:
    """Return the probability of existence of each row (R,), by default 1."""
    given = side.attributes.get(EXISTENCE)
    return np.ones(len(side.step)) if given is None else np.asarray(given, np.float64)


def expected(
    truth: Trajectories, estimate: Trajectories, names: tuple[str, str]
) -> tuple[Trajectories, Trajectories]:
    """Check the probabilities of existence of both sides, and leave out rows of probability 0.

    Steps that lose all rows stay. `names` are for messages.

    Raises
    ------
    ConfigError
        Neither side has probabilities of existence.
    InputError
        A value is blank, not a number, or not from 0 to 1.
    """
    sides = truth, estimate
    if not any(EXISTENCE in side.attributes for side in sides):
        raise ConfigError(
            f"{option('existence', 'use')}: neither {names[0]} nor {names[1]} has a column "
            f"{EXISTENCE}"
        )
    possible = [_possible(side, name) for side, name in zip(sides, names, strict=True)]
    return possible[0], possible[1]


def _possible(side: Trajectories, name: str) -> Trajectories:
    given = side.attributes.get(EXISTENCE)
    if given is None:
        return side
    numbers = given.dtype.kind == "f"
    likely = np.asarray(given if numbers else [parsed(text) for text in given.tolist()], np.float64)
    odd = np.flatnonzero(~((likely >= 0) & (likely <= 1)))
    if len(odd):
        row = int(odd[0])
        value = given[row]
        blank = value != value or value == ""
        shown = "blank" if blank else quoted(value) if isinstance(value, str) else f"{value:g}"
        raise InputError(
            f'{name}, column "{EXISTENCE}": id {quoted(side.ids[side.track[row]])} at '
            f"t = {side.shown[side.step[row]]} is {shown}{more(len(odd))}; must be a number from 0 "
            "to 1"
        )
    kept = np.flatnonzero(likely > 0)
    return side if len(kept) == len(given) else side.chosen(kept)
