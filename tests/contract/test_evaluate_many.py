"""Many pairs at once: values, bounds and warnings are those of `evaluate`, to the last bit."""

import warnings
from typing import Any

import numpy as np
import pandas as pd
import pytest
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tgospa_eval import (
    ConfigError,
    InputError,
    TgospaWarning,
    Trajectories,
    evaluate,
    evaluate_many,
)

Pair = tuple[Any, Any]
EQUAL = ("tgospa", "lower_bound", "upper_bound", "total", "certified", "localisation", "missed")


def scene(rng: np.random.Generator) -> Pair:
    """Truth and estimate (T, k, 2): noisy, late, displaced, crowded, or of nothing."""
    steps, objects = int(rng.integers(1, 40)), int(rng.integers(0, 9))
    area, noise = rng.choice([3.0, 10.0, 60.0]), rng.choice([0.0, 1e-9, 0.3, 2.0])
    start = rng.uniform(0, area, (objects, 2))
    truth = start + np.cumsum(rng.normal(0, rng.choice([0.1, 1.0]), (steps, objects, 2)), axis=0)
    estimate = truth + rng.normal(0, 1, truth.shape) * noise
    fault = rng.integers(8)
    if fault == 0:
        estimate += np.array((0.8, -0.5))
    elif fault == 1:
        estimate = np.roll(estimate, 1, axis=0)
    elif fault == 2:
        estimate = estimate[:, :, ::-1]
    elif fault == 3:
        estimate = 1000 * estimate
    elif fault == 4 and objects > 1:
        estimate[steps // 2 :, [0, 1]] = estimate[steps // 2 :, [1, 0]]
    estimate = np.concatenate([estimate, rng.uniform(0, area, (steps, 2, 2))], axis=1)
    for side in (truth, estimate):
        side[rng.random(side.shape[:2]) < rng.choice([0.0, 0.2, 0.6])] = np.nan
    return truth, estimate


def warned(call: Any, *arguments: Any, **options: Any) -> tuple[Any, set[str]]:
    """What a call returns, and the codes of its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TgospaWarning)
        result = call(*arguments, **options)
    return result, {notice.code for notice in result.warnings}


def same(pairs: list[Pair], **options: Any) -> None:
    """Whether many pairs have the numbers and warnings of each by itself."""
    many, codes = warned(evaluate_many, pairs, jobs=1, **options)
    alone = [warned(evaluate, *pair, jobs=1, **options) for pair in pairs]
    assert codes == set().union(*(own for _, own in alone))
    for row, (result, own) in zip(many.rows, alone, strict=True):
        assert {*row["warnings"].split()} == own
        assert {name: row[name] for name in EQUAL} == {n: getattr(result, n) for n in EQUAL}
        assert row["normalised.tgospa"] == result.normalised["tgospa"]
        assert [row[f"counts.{n}"] for n in result.counts] == [*result.counts.values()]
        assert (row["sizes.truth_states"], row["sizes.estimate_states"]) == result.objects
        assert row["sizes.steps"] == result.sizes["steps"]
        assert row["judged.steps"] == result.evaluated_on.steps


OPTIONS: list[dict[str, Any]] = [
    {"cutoff": 5.0, "switch_penalty": 2.0},
    {"cutoff": 1.0, "switch_penalty": 0.0},
    {"cutoff": 1000.0, "switch_penalty": 1e-3, "order": 1.0},
    {"cutoff": 2.0, "switch_penalty": 500.0, "distance": "manhattan"},
    {},
]


@settings(max_examples=examples(5))
@given(seed=st.integers(0, 2**32 - 1), options=st.sampled_from(OPTIONS))
def test_numbers_and_warnings_are_those_of_each_pair(seed: int, options: dict[str, Any]) -> None:
    rng = np.random.default_rng(seed)
    same([scene(rng) for _ in range(8)], **options)


def test_what_cannot_be_joined_is_evaluated_by_itself() -> None:
    rng = np.random.default_rng(5)
    pairs = [scene(rng) for _ in range(4)]
    same(pairs, cutoff=3.0, rho=0.3)
    same(pairs, cutoff=3.0, distance="chebyshev", solver="exact")
    same(pairs, cutoff=3.0, periodic="x=7")
    same([(truth + 2e7, estimate + 2e7) for truth, estimate in pairs], cutoff=3.0)
    same([(truth[:, :, :1], estimate[:, :, :1]) for truth, estimate in pairs], cutoff=3.0)
    mixed = [pairs[0], (pairs[1][0][:, :, :1], pairs[1][1][:, :, :1])]
    same(mixed, cutoff=3.0, switch_penalty=1.0)


def test_sides_in_every_form_are_the_same_runs() -> None:
    rng = np.random.default_rng(0)
    truth, estimate = rng.normal(size=(2, 3, 20, 4, 2))
    options: dict[str, Any] = {"cutoff": 2.0, "switch_penalty": 1.0}
    pairs = list(zip(truth, estimate, strict=True))
    expected = [evaluate(*pair, **options).tgospa for pair in pairs]
    run, t, i = (axis.ravel() for axis in np.indices((3, 20, 4)))
    tables = [
        pd.DataFrame({"run": run, "t": t, "id": i, "x": x.ravel(), "y": y.ravel()})
        for x, y in (np.moveaxis(side, -1, 0) for side in (truth, estimate))
    ]
    made = [tuple(Trajectories.from_array(side) for side in pair) for pair in pairs]
    for sides in ((pairs,), (truth, estimate), ([*truth], [*estimate]), tables, (made,)):
        many = evaluate_many(*sides, **options)
        assert many.table()["tgospa"].tolist() == expected
        assert [result.tgospa for result in many] == expected
    named = evaluate_many({"a": pairs[0], "b": pairs[1]}, **options)
    assert named.runs == ("a", "b")
    assert named["b"].tgospa == named.table().set_index("run")["tgospa"]["b"] == expected[1]
    with pytest.raises(KeyError):
        named["c"]
    one = evaluate_many(truth[0], [*estimate], **options)
    assert one.rows[0]["tgospa"] == expected[0]
    assert "3 pairs, 3 proven exact" in str(one)


def test_processes_give_the_same_table(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    pairs = [tuple(rng.normal(size=(2, 40, 5, 2))) for _ in range(40)]
    here = evaluate_many(pairs, cutoff=2.0, jobs=1)
    monkeypatch.setattr("tgospa_eval.api.evaluate_many.PATIENCE", 0.0)
    assert evaluate_many(pairs, cutoff=2.0, jobs=2).rows == here.rows


def test_errors_name_the_run() -> None:
    good = np.zeros((3, 1, 2))
    with pytest.raises(InputError, match=r'^run "2": '):
        evaluate_many([(good, good), (good, np.zeros((3, 1, 3)))], cutoff=1.0)
    with pytest.raises(InputError, match=r'^run "1": a pair is \(truth, estimate\)'):
        evaluate_many([good], cutoff=1.0)  # type: ignore[list-item]
    with pytest.raises(TypeError, match="did you mean cutoff"):
        evaluate_many([(good, good)], cutof=1.0)  # type: ignore[call-arg]
    for nothing in (([],), ({},), ([], [])):
        with pytest.raises(InputError, match=r"there is no (pair|run) to evaluate"):
            evaluate_many(*nothing)
    with pytest.raises(InputError, match="sequence of"):
        evaluate_many("truth.csv")
    with pytest.raises(InputError, match='called "1"'):
        evaluate_many({1: (good, good), "1": (good, good)})  # type: ignore[dict-item]
    with pytest.raises(ConfigError, match="jobs is -1"):
        evaluate_many([(good, good)], cutoff=1.0, jobs=-1)
    pair = good, good + 1e-5
    with pytest.raises(ConfigError, match=r'^run "a": cutoff 1000'):
        evaluate_many({"a": pair, "b": pair}, cutoff=1e3, switch_penalty=0.0, order=60)


def test_each_warning_is_said_once_of_its_runs() -> None:
    walk = np.random.default_rng(0).normal(size=(40, 4, 2)).cumsum(0) * 3
    nothing = np.full((40, 1, 2), np.nan)
    pairs = {"a": (nothing, walk), "b": (walk, nothing), "c": (nothing, nothing)}
    many, _ = warned(evaluate_many, pairs, cutoff=5.0, switch_penalty=1.0)
    texts = [notice.text for notice in many.warnings]
    assert [text.partition(" is evaluated")[0] for text in texts] == [
        "run a, c: no row of the truth",
        "run b, c: no row of the estimate",
    ]
    assert "b" in many
