"""Tests whether runs with other seeds support that a sum has grown."""

import numpy as np
import pytest
from scipy import stats

from tgospa_eval.campaign.gate.groups import Stratum, fewest, noticeable, p_value


def stratum(allowed, now, *, paired: bool = True) -> Stratum:
    return Stratum(allowed=np.array(allowed, float), now=np.array(now, float), paired=paired)


@pytest.mark.parametrize("paired", [True, False])
def test_one_scene_is_as_in_scipy(paired: bool) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        allowed, now = rng.lognormal(size=5), rng.lognormal(0.5, size=5)
        expected = stats.permutation_test(
            (now, allowed),
            lambda x, y, axis: x.sum(axis=axis) - y.sum(axis=axis),
            permutation_type="samples" if paired else "independent",
            alternative="greater",
            vectorized=True,
            n_resamples=9999,
        )
        assert p_value([stratum(allowed, now, paired=paired)]) == pytest.approx(expected.pvalue)


def test_scenes_are_exchanged_by_themselves() -> None:
    """Of two scenes of which one costs a thousand times more, labels of one never mix with it."""
    small, large = stratum([1, 2, 3], [2, 3, 4], paired=False), stratum([1e3] * 3, [1e3] * 3)
    assert p_value([small, large]) == pytest.approx(p_value([small]))


def test_as_often_as_the_confidence_says() -> None:
    rng = np.random.default_rng(1)
    found = []
    for _ in range(300):
        means = rng.lognormal(3, 1, 6)
        sides = means[:, None, None] * rng.lognormal(0, 0.2, (6, 2, 5))
        found.append(p_value([stratum(*side) for side in sides]))
    assert 0.02 < np.mean(np.array(found) <= 0.05) < 0.09


def test_equal_runs_support_nothing() -> None:
    assert p_value([stratum([4, 5, 6, 7, 8], [4, 5, 6, 7, 8])]) == 1.0


def test_how_many_runs_are_needed() -> None:
    assert [fewest(level) for level in (0.5, 0.9, 0.95, 0.99)] == [1, 4, 5, 7]
    one = stratum([1, 1, 1, 1], [9, 9, 9, 9])
    assert p_value([one]) == 1 / 16 > 0.05


def test_the_noticeable_change_is_noticed_four_times_of_five() -> None:
    rng, noticed, sizes = np.random.default_rng(2), [], []
    for _ in range(300):
        old, noise = (rng.normal(100, 10, (4, 6)) for _ in range(2))
        strata = [stratum(*side) for side in zip(old, noise, strict=True)]
        sizes.append(noticeable(strata, 0.95))
    change = 100 * np.mean(sizes)
    for _ in range(300):
        old, noise = (rng.normal(100, 10, (4, 6)) for _ in range(2))
        strata = [stratum(*side) for side in zip(old, noise + change, strict=True)]
        noticed.append(p_value(strata) <= 0.05)
    assert 0.7 < np.mean(noticed) < 0.9
    assert noticeable([stratum([1], [2])], 0.95) == np.inf


def test_the_scatter_of_one_run_against_several() -> None:
    one = stratum([1, 2, 3, 4], [5], paired=False)
    assert one.variance == pytest.approx(5 / 3 * (1 + 1 / 4))
    assert np.isfinite(noticeable([one], 0.95))
