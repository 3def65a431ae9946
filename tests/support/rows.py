"""States of a file as rows, and the words with which a file is refused."""

from typing import Any

import pytest

from tgospa_eval import InputError, Trajectories
from tgospa_eval.formats import ReadOptions, read

Rows = dict[tuple[str, Any], tuple[float, ...]]

PLAIN = "id,t,x,y\na,1,1.5,2\nb,2,3,-4.25\n"
SAME = {("a", 1): (1.5, 2.0), ("b", 2): (3.0, -4.25)}


def rows_of(trajectories: Trajectories) -> Rows:
    """States by id and time."""
    return {
        (trajectories.ids[track], trajectories.times[step].item()): tuple(state.tolist())
        for step, track, state in zip(
            trajectories.step, trajectories.track, trajectories.state, strict=True
        )
    }


def refusal(path: str, **options: Any) -> list[str]:
    """The lines of the message with which a file is refused."""
    with pytest.raises(InputError) as caught:
        read(path, ReadOptions(**options))
    return str(caught.value).split("\n")
