"""The flat table: from arrays, and what it refuses."""

import numpy as np
import pytest

from tgospa_eval.errors import InputError
from tgospa_eval.trajectories import Trajectories


@pytest.mark.parametrize("shape", [(4, 3, 1), (4, 3, 2), (2, 5, 4), (0, 3, 2), (3, 0, 2)])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_from_array_takes_what_is_whole(shape: tuple[int, int, int], layout: str) -> None:
    rng = np.random.default_rng(0)
    states = np.asarray(rng.normal(size=shape), order=layout)
    states[rng.random(shape) < 0.3] = np.nan
    rows = [
        (k, i, states[k, i].tolist())
        for k in range(shape[0])
        for i in range(shape[1])
        if not np.isnan(states[k, i]).any()
    ]
    made = Trajectories.from_array(states)
    assert list(zip(made.step, made.track, made.state.tolist(), strict=True)) == rows
    assert made.step.dtype == made.track.dtype == np.int32
    assert made.state.shape == (len(rows), shape[2])
    before = made.state.copy()
    states[:] = 0.0
    assert np.array_equal(made.state, before)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"step": [0, 0, 2**32]}, "outside the times"),
        ({"step": [0, 0, -1]}, "outside the times"),
        ({"track": [0, 1, 2**32]}, "outside the ids"),
        ({"track": [1, 1, 0]}, "sorted"),
        ({"track": [1, 0, 0]}, "sorted"),
        ({"step": [1, 1, 0]}, "sorted"),
        ({"step": [0.0, 0.0, 1.0]}, "must be integers"),
    ],
)
def test_wrong_rows(changes: dict, message: str) -> None:
    fine = {"step": [0, 0, 1], "track": [0, 1, 0], "state": np.zeros((3, 1))}
    common = {"ids": np.array(["a", "b"]), "times": np.arange(2), "columns": ("x",)}
    Trajectories(**fine, **common)
    with pytest.raises(InputError, match=message):
        Trajectories(**{**fine, **changes}, **common)
