"""The curve of a solution that is not the best."""

import numpy as np
import pytest
from strategies import scene

from tgospa_eval import Certified, evaluate
from tgospa_eval.curve import trace


def test_the_last_point_is_the_solution_however_bad() -> None:
    truth, estimate = scene(4, 4, 5, 20, side=6.0)
    states = evaluate(truth, estimate, 3.0, 2, 1.0).proof.states
    nothing = np.zeros(len(states.begin), np.int64)
    curve = trace(states, nothing, np.zeros(len(states.columns.step)), Certified())
    free = states.problem.truth_price.sum() + states.problem.estimate_price.sum()
    assert curve.upper[-1] == pytest.approx(free, rel=1e-12)
    assert curve.lower[-1] < free
    assert curve.met(1e-9)[:-1].all()
    for k in (0, 9, 18):
        alone = evaluate(truth[: k + 1], estimate[: k + 1], 3.0, 2, 1.0).proof.bounds
        assert curve.upper[k] == pytest.approx(alone.upper, rel=2e-9)
        assert curve.lower[k] <= alone.upper
