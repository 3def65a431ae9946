"""Runs of two trackers, as files of a batch; what is told of two sides."""

from pathlib import Path

from tgospa_eval import Certified, Trajectories
from tgospa_eval.common.notices import Notice
from tgospa_eval.distances import DISTANCES
from tgospa_eval.evaluation.diagnosis import diagnose
from tgospa_eval.evaluation.prepare import fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.metric_family import Parameters

PATTERNS = ("--truth", "gt/{run}.csv", "--estimate", "out/{tracker}/{run}.csv", "-c", "10")


def write_runs(count: int) -> None:
    """Write them here: the error of tracker b is 2 at each of five steps, that of tracker a 1."""
    for name, error in (("gt", 0), ("out/a", 1), ("out/b", 2)):
        Path(name).mkdir(parents=True)
        for run in range(count):
            rows = "".join(f"1,{k},{k + error},{run}\n" for k in range(5))
            Path(name, f"{run}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")


def warnings_of(
    truth: Trajectories, estimate: Trajectories, parameters: Parameters
) -> list[Notice]:
    """What is told of two sides that are compared by the euclidean distance."""
    request = EvaluationRequest(
        parameters=parameters, distance=DISTANCES["euclidean"], solver=Certified()
    )
    return diagnose(fit(truth, estimate, request), request)
