"""What verdicts of a gate are worth: simulated nights of 48 runs, by `tests/support/nights.py`."""

import numpy as np
import pytest

from tests.support import nights
from tgospa_eval.campaign.gate.jumps import Rises, jumps

pytestmark = pytest.mark.slow

LIMIT = 1.02


@pytest.fixture(scope="module")
def pool() -> nights.Pool:
    return nights.pool(40)


@pytest.mark.parametrize("before", [1, 5])
def test_an_equal_tracker_jumps_in_one_gate_of_500_at_most(pool: nights.Pool, before: int) -> None:
    totals = np.array(
        [[one.values["total"].upper for one in pool.nights[name]] for name in nights.NAMES]
    )
    totals = totals.reshape(len(nights.SCENES), nights.SEEDS, -1)
    rng, count, found = np.random.default_rng(1), 5000, 0
    for _ in range(count):
        order = np.argsort(rng.random(totals.shape), axis=-1)[..., : 1 + before]
        drawn = np.take_along_axis(totals, order, axis=-1)
        scenes = [
            Rises.of_costs(runs[:, 0], [*(runs[:, 1:] * LIMIT)], paired=True) for runs in drawn
        ]
        least = min(min(p, *each) for p, each in jumps(scenes))
        found += least <= nights.FALSE_ALARMS
    assert found / count <= 0.002


RARELY, USUALLY, ALWAYS = (0.0, 0.01), (0.95, 1.0), (1.0, 1.0)


@pytest.mark.parametrize(
    ("what", "before", "count", "expected"),
    [
        ("equal", 1, 600, RARELY),
        ("equal", 5, 600, RARELY),
        ("20 % worse", 1, 200, (0.9, 1.0)),
        ("20 % worse", 5, 200, ALWAYS),
        ("a scene worse by 2", 1, 200, (0.68, 1.0)),
        ("a scene worse by 2", 5, 200, USUALLY),
        ("a scene worse by 3", 1, 200, USUALLY),
        ("a seed without a row", 1, 100, ALWAYS),
        ("a seed without a row", 5, 100, ALWAYS),
        ("a seed that crashed after 30 %", 1, 100, ALWAYS),
        ("a seed that crashed half way", 1, 100, USUALLY),
    ],
)
def test_nights_that_fail(
    pool: nights.Pool, what: str, before: int, count: int, expected: tuple[float, float]
) -> None:
    share, _ = nights.red(pool, nights.CHANGES[what], before=before, nights=count)
    assert expected[0] <= share <= expected[1]
