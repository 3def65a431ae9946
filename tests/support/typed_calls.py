"""Calls that a type checker takes, and calls that it must not: those end in `# wrong`.

Nothing runs them: `tests/contract/test_types.py` gives the file to mypy and pyright.
"""

import datetime
from pathlib import Path

import numpy as np
import pandas as pd

from tgospa_eval import (
    Certified,
    Recorder,
    Sinkhorn,
    associate,
    batch,
    compare,
    evaluate,
    gate,
    read_trajectories,
    reduce,
    sweep,
)
from tgospa_eval.distances import Mahalanobis, Norm

truth = read_trajectories("truth.csv")
estimate = read_trajectories(Path("estimate.csv"))
array = np.zeros((3, 2, 2))
table = pd.DataFrame({"t": [0.0], "weight": [2.0]})


def right() -> None:
    result = evaluate(truth, estimate, cutoff=10.0, order=2, switch_penalty=5.0)
    print(result.tgospa, result.per_step, result.counts["false"])
    evaluate(truth, estimate, 10, 2, 5)
    evaluate("truth.csv", Path("estimate.csv"), cutoff=10, columns="x,y", by="class")
    evaluate(truth, estimate, columns=["x", "y"], class_=("Car", "Van"), periodic="theta")
    evaluate(truth, {"a": ([0, 2], [[0.5, 0.5], [0.5, 0.5]])}, cutoff=5.0)
    evaluate(array, {"a": array[:, 0]}, cutoff=5.0, distance="manhattan", jobs=1)
    evaluate(array, ([0, 1, 2], array), distance=Norm(name="euclidean", power=2), rho=0.3)
    evaluate(array, array, distance=Mahalanobis(covariance=[[4.0, 1.0], [1.0, 2.0]]))
    evaluate(array, array, distance="mahalanobis", covariance=np.eye(2))
    evaluate(array, array, distance="mahalanobis", covariance=[[1.0, 0.0], [0.0, 1.0]])
    evaluate(array, array, covariance=Path("c.csv"), region="x=0:5", origin=(55.0, 12.0))
    evaluate(truth, estimate, solver="sinkhorn", epsilon=0.01, time_limit=None)
    evaluate(truth, estimate, solver=Certified(jobs=1), memory="4GB", scheduler=None)
    evaluate(truth, estimate, solver=Sinkhorn(gap=0.01), mapping=(0, 2))
    evaluate(truth, estimate, step_weights={0: 1.0, 1: 2.0}, with_="hota,clear")
    evaluate(truth, estimate, step_weights=table, with_=["gospa", "nees"], grid="truth")
    evaluate(truth, estimate, step_weights=np.ones(3), slices=["class", "range=0:50:100"])
    evaluate(truth, estimate, window=10, every=5, curve=True, similarity=3, steps="0:9")
    evaluate(truth, estimate, interpolate="estimate", max_gap=1.5, time_tolerance="20ms")
    evaluate(truth, estimate, resample=3, max_gap=(200.0, 10.0), period="7s", time_offset=-4.7)
    evaluate(truth, estimate, where="score >= 0.5", ignore=["marked"], ignore_regions=table)
    evaluate(truth, estimate, preprocess="kitti:ignore", tracked_shares="0.2:0.8", unit="m")
    compare(truth, {"a": estimate, "b": truth}, cutoff=10.0, with_=["nees"])
    compare("gt.csv", ["a.csv", "b.csv"], 10.0, rho=0.5, estimate_format="csv")
    compare(truth, estimate, 10.0, solvers=["certified", Sinkhorn()])
    sweep(truth, estimate, cutoff=[1, 2, 5], switch_penalty=2.0, distance="iou")
    sweep(truth, estimate, 10.0, rho=np.linspace(0, 1, 3), solver=Certified())
    batch("manifest.csv", output="store", cutoff=10, switch_penalty=2.0, distance="iou")
    batch(truth="gt/{a}.csv", estimate="t/{a}.csv", output=Path("store"), with_="hota", by="a")
    batch(truth, {"a": [truth, array], "b": array}, cutoff=10, mapping=(0, 1))
    batch(truth=[truth, "gt.csv"], estimate=([0, 1, 2], array), cutoff=10)
    compare(table, {"a": [truth, estimate], "b": np.stack([array, array])}, 10.0)
    compare([truth, estimate], [truth, array], 10.0)
    gate(truth, estimate, "baseline.json", update_baseline=True, cutoff=10.0, solver="exact")
    assert gate(suite="suite.toml", limits={"tgospa": 50.0}, fail_on=["total:+10%"]).passed
    print(associate(array, estimate, 10.0, a_format="csv", distance="mahalanobis", jobs=2).total)
    after, rows = reduce("clouds.csv", 16, reduce_method="kmeans", seed=3, columns="x,y")
    print(after.ids, rows.columns)
    recorder = Recorder()
    recorder.update(0.0, ["a"], [[0.0, 1.0]], [1, 2], array[0])
    recorder.update(datetime.datetime.now(datetime.UTC), ["a"], array[0], [1], array[0])
    recorder.update(2.0, [1], [array[0]], [1], array, estimate_covariances=array)
    print(recorder.evaluate(cutoff=5.0, switch_penalty=2.0, order=1, rho=0.2).counts)


def wrong(name: str) -> None:
    evaluate(truth, estimate, cutof=10.0)  # wrong
    evaluate(truth, estimate, gamma=5.0)  # wrong
    evaluate(truth, estimate, cutoff="10")  # wrong
    evaluate(truth, estimate, order="two")  # wrong
    evaluate(truth, estimate, steps=3.5j)  # wrong
    evaluate(truth, estimate, rho="half")  # wrong
    evaluate(truth, estimate, grid="unoin")  # wrong
    evaluate(truth, estimate, jobs=2.5)  # wrong
    evaluate(truth, estimate, curve="yes")  # wrong
    evaluate(truth, estimate, where=5)  # wrong
    evaluate(truth, estimate, solver=3)  # wrong
    evaluate(truth, estimate, distance=3)  # wrong
    evaluate(truth, estimate, a_format="csv")  # wrong
    evaluate(truth)  # wrong
    compare(truth, {"a": estimate}, slices="class")  # wrong
    compare(truth, {"a": estimate}, epsilon="small")  # wrong
    sweep(truth, estimate, cutoff=[1, 2], with_="hota")  # wrong
    sweep(truth, estimate, cutoff=[1, 2], order="2")  # wrong
    batch("manifest.csv", cutoff="ten")  # wrong
    batch("manifest.csv", output="store", distance=Norm(name="euclidean", power=2))  # wrong
    batch("manifest.csv", output="store", jobs=2)  # wrong
    gate(truth, estimate, "baseline.json", cutof=10.0)  # wrong
    gate(truth, estimate, "baseline.json", limits="tgospa=5")  # wrong
    associate(array, estimate, 10.0, switch_penalty=2.0)  # wrong
    associate(array, estimate, 10.0, grid=True)  # wrong
    reduce("clouds.csv", 16, reduce_method="best")  # wrong
    reduce("clouds.csv", 16, cutoff=3.0)  # wrong
    Recorder().evaluate(cutof=10.0)  # wrong
    Recorder().evaluate(cutoff=10.0, window=[1])  # wrong
    evaluate(truth, estimate, 10.0).tgopsa  # wrong  # noqa: B018
