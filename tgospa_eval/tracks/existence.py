"""Probabilities of existence: an attribute of the rows, 1 where a side has none."""

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import more, parsed
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.text import option, quoted
from tgospa_eval.tracks.trajectories import Trajectories

EXISTENCE = "existence"
"""The column, and the attribute."""


def existence_of(side: Trajectories) -> Floats:
    """The probability of each row (R,)."""
    found = side.attributes.get(EXISTENCE)
    return np.ones(len(side.step)) if found is None else np.asarray(found, np.float64)


def expected(
    truth: Trajectories, estimate: Trajectories, names: tuple[str, str]
) -> tuple[Trajectories, Trajectories]:
    """Both sides with probabilities that are some, without the rows whose probability is 0.

    What exists with probability 0 does not exist; the steps stay. `names` are for messages.

    Raises
    ------
    ConfigError
        Neither side has such an attribute.
    InputError
        A value is blank, no number, or not from 0 to 1.
    """
    sides = truth, estimate
    if not any(EXISTENCE in side.attributes for side in sides):
        raise ConfigError(
            f"{option('existence', 'use')}: neither {names[0]} nor {names[1]} has a column "
            f"{EXISTENCE}"
        )
    found = [_possible(side, name) for side, name in zip(sides, names, strict=True)]
    return found[0], found[1]


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
