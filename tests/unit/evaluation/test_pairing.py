"""Greedy pairs: the compiled loops against NumPy, bit by bit, and a choice by hand."""

import numpy as np
import pytest

from tgospa_eval.evaluation.diagnosis import costs as pairing
from tgospa_eval.kernels import kernels

compiled_only = pytest.mark.skipif(kernels is None, reason="no compiled kernels here")


@compiled_only
@pytest.mark.parametrize("objects", [(3, 3), (40, 5), (7, 60), (90, 110)])
@pytest.mark.parametrize("values", [3, 10**9])  # few make many equal gains
def test_compiled_loops_are_those_of_numpy(
    objects: tuple[int, int], values: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng([*objects, values])
    steps = 9
    sides = [np.sort(rng.integers(0, steps, size)).astype(np.int32) for size in objects]
    near = (sides[0][:, None] == sides[1]) & (rng.random(objects) < 0.7)
    rows = tuple(axis.astype(np.int32) for axis in np.nonzero(near))
    gain = rng.integers(1, values, len(rows[0]), endpoint=True) / values

    def found() -> list[np.ndarray]:
        chosen = pairing.pair_off(sides, rows, gain, steps)
        return [pairing.largest_gains(sides, rows, gain, steps), *chosen]

    compiled = found()
    monkeypatch.setattr(pairing, "kernels", None)
    for one, other in zip(compiled, found(), strict=True):
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes()


def test_rounds() -> None:
    """Truth 0 wants estimate 0, which has a better pair; of equal pairs the first is chosen."""
    step = np.zeros(3, np.int32)
    rows = tuple(np.array(axis, np.int32) for axis in ([0, 0, 1, 1, 2], [0, 1, 0, 2, 2]))
    gain = np.array([0.8, 0.5, 0.9, 0.4, 0.4])
    total, turn = pairing.pair_off((step, step), rows, gain, 2)
    assert turn.tolist() == [0, 2, 1, 0, 2]
    assert total == pytest.approx([1.8, 0.0])
    assert pairing.ranked(turn, gain).tolist() == [2, 1, 4]
