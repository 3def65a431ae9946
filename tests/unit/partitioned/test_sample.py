"""What looks wrong is seen in a stretch of the recording."""

from dataclasses import replace

import numpy as np
import pytest
from held_sides import plan

from tgospa_eval.partitioned import evaluate as sample
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.tracks.alignment import align


def test_a_clock_that_is_ahead_is_seen_in_the_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, estimate = simulate(
        Scene(targets=6, steps=120), Tracker(noise=0.5), np.random.default_rng(0)
    )
    late = replace(estimate, times=estimate.times + 4)
    parameters = Parameters(cutoff=6, switch_penalty=2)
    monkeypatch.setattr(sample, "LOOKED_AT", 400)
    for side, codes in ((estimate, []), (late, ["clock-shift"])):
        asked = plan((truth, side), parameters)
        notices = sample.look(asked, align(truth, side))
        assert [notice.code for notice in notices if notice.code] == codes
        assert "steps" in notices[0].text
    assert "from step 46 to 79: the clock of the estimate seems to be 4 ahead" in str(notices[-1])


def test_the_middle_of_the_rows() -> None:
    rows = np.array([5, 1, 1, 50, 1, 1, 1])
    assert sample.middle(rows, 4) == (3, 3)
    assert sample.middle(np.full(10, 2), 8) == (3, 6)
    assert sample.middle(rows, 10**6) == (0, 6)
