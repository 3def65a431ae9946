"""What is said of a partitioned evaluation while it goes on."""

import math
from pathlib import Path

import numpy as np

from tgospa_eval.cli.shared.progress import line
from tgospa_eval.common.progress import Progress, Stopwatch
from tgospa_eval.partitioned.run import Stages
from tgospa_eval.partitioned.shards import PartialSums
from tgospa_eval.problem.metric_family import Parameters

NOTHING = np.zeros(1)


def share(objects: tuple[int, int], lower: float, upper: float) -> PartialSums:
    return PartialSums(
        first=0,
        localisation=NOTHING,
        missed=NOTHING,
        false=NOTHING,
        switch=NOTHING,
        missed_count=NOTHING,
        false_count=NOTHING,
        switch_count=NOTHING,
        truths=np.array([objects[0]]),
        estimates=np.array([objects[1]]),
        lower=np.array([lower / 2, lower / 2]),
        total=upper,
    )


def test_a_stage_tells_its_share_its_bracket_and_the_time_left(tmp_path: Path) -> None:
    stopwatch = Stopwatch()
    stopwatch.progress = progress = Progress(watched=True)
    stages = Stages(stopwatch)
    stages.run("scanning", {})
    assert stopwatch.stage == "scanning"
    stages.expect(Parameters(cutoff=2.0, order=1.0, switch_penalty=1.0, rho=0.25), (8, 4))
    assert progress.bracket is not None
    assert np.allclose(progress.bracket, (0.0, 2 * (8 * 0.75 + 4 * 0.25)), rtol=1e-9)
    a, b, c = (str(tmp_path / name) for name in "abc")
    Path(a).touch()  # done by the run before
    proven = {a: share((4, 4), 1.0, 1.5), b: share((2, 0), 0.25, 0.25)}

    def first(output: str) -> None:
        assert (stopwatch.stage, progress.share, progress.left) == ("solving, 1 of 3", 0.5, None)
        Path(output).touch()

    def second(output: str) -> None:
        assert np.allclose(progress.bracket, (2 * 1.25, 2 * (7 - 4 - 1.5 + 1.75)), rtol=1e-9)
        assert progress.bracket is not None
        assert progress.bracket[0] <= 2.5
        assert progress.bracket[1] >= 6.5
        assert progress.share == 0.75
        assert progress.left is not None
        assert math.isfinite(progress.left)
        progress.left = 125.0
        assert line(stopwatch, 60.0) == (
            "solving, 2 of 3, 2.4999 <= TGOSPA <= 6.5001, 75 % done, 60 s so far, 2 min left"
        )
        Path(output).touch()

    stages.run("solving", {a: fail, b: first, c: second}, [2.0, 1.0, 1.0], proven.get)
    assert progress.share == 1.0
    assert "left" not in line(stopwatch, 60.0)  # further stages follow
    stages.end()
    assert progress.left is None
    assert stopwatch.stage == ""


def fail(output: str) -> None:
    raise AssertionError(output)
