"""Assignments of single steps: kernel and NumPy take the same of equal ones, at the same prices."""

import numpy as np
import pytest

from tgospa_eval.kernels import kernels
from tgospa_eval.solvers.trivial import _assign


@pytest.mark.skipif(kernels is None, reason="no compiled kernels")
@pytest.mark.parametrize("levels", [2, 4, 10**6])
def test_kernel_and_scipy_take_the_same(levels: int) -> None:
    rng = np.random.default_rng(levels)
    for _ in range(200):
        gains = [
            rng.integers(0, levels, rng.integers(1, 9, 2)) / levels
            for _ in range(rng.integers(1, 5))
        ]
        pairs = [np.nonzero(gain) for gain in gains]
        first = np.cumsum([0, *(len(row) for row, _ in pairs)])
        row, column = (np.concatenate(axis) for axis in zip(*pairs, strict=True))
        rows, columns = np.transpose([gain.shape for gain in gains])
        parts = (part.astype(np.int32) for part in (first, row, rows, column, columns))
        taken, price = kernels.assign(
            *parts, np.concatenate([gain[pair] for gain, pair in zip(gains, pairs, strict=True)])
        )
        for k, (gain, (i, j)) in enumerate(zip(gains, pairs, strict=True)):
            assigned, least = _assign(gain)
            own = slice(*first[k : k + 2])
            assert np.array_equal(taken[own], assigned[i] == j)
            assert np.array_equal(price[own], least[j])
