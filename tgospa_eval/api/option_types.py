"""Keywords of the functions with their types, for editors and type checkers.

Made by ``python docs/option_types.py`` from the options: change those. Nothing imports it when a
program runs, as ``**options: "Unpack[EvaluateOptions]"`` is for people and for type checkers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias, TypedDict

import numpy.typing as npt

from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.regions import RegionsLike
from tgospa_eval.formats.objects import ArrayLike, StepWeightsLike
from tgospa_eval.solvers import Solver

Matrix: TypeAlias = "npt.ArrayLike | ArrayLike"

ReduceMethod: TypeAlias = Literal[
    "sliced",
    "recursive",
    "atl",
    "kmeans",
    "systematic",
    "stratified",
    "multinomial",
    "top",
]

Preprocess: TypeAlias = Literal[
    "motchallenge",
    "motchallenge:delete",
    "motchallenge:ignore",
    "kitti",
    "kitti:delete",
    "kitti:ignore",
    "visdrone",
    "visdrone:delete",
    "visdrone:ignore",
    "uadetrac",
    "uadetrac:delete",
    "uadetrac:ignore",
]


class _Cutoff(TypedDict, total=False):
    """Keywords of `batch`, `gate`."""

    cutoff: float | None
    order: float
    switch_penalty: float | None


class _Rho(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `compare`, `batch`, `gate`."""

    rho: float


class _PlainStepWeights(TypedDict, total=False):
    """Texts that `batch` keeps."""

    step_weights: str | os.PathLike[str] | None
    distance: str | None
    covariance: str | os.PathLike[str] | None
    ignore_regions: str | os.PathLike[str] | None
    solver: Literal["certified", "exact", "sinkhorn"]
    inner_cov: str | os.PathLike[str] | None


class _StepWeights(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `compare`, `sweep`, `gate`."""

    step_weights: str | os.PathLike[str] | StepWeightsLike | None
    ignore_regions: str | os.PathLike[str] | RegionsLike | None
    solver: Literal["certified", "exact", "sinkhorn"] | Solver


class _Existence(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `compare`, `sweep`, `batch`, `gate`."""

    existence: Literal["ignore", "use"]
    truth_columns: str | Iterable[str] | None
    estimate_columns: str | Iterable[str] | None
    truth_format: str | None
    estimate_format: str | None
    truth_crs: str | None
    estimate_crs: str | None
    truth_scale: str | Iterable[str]
    estimate_scale: str | Iterable[str]
    truth_time_format: str | None
    estimate_time_format: str | None
    truth_time_zone: str | None
    estimate_time_zone: str | None
    truth_class: str | Iterable[str] | None
    estimate_class: str | Iterable[str] | None
    truth_where: str | Iterable[str]
    estimate_where: str | Iterable[str]
    ignore: str | Iterable[str]
    max_speed: float | None
    unit: str | None
    gap: float
    epsilon: float
    time_limit: float | None


class _Distance(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `compare`, `sweep`, `gate`, `associate`."""

    distance: str | Distance | None
    covariance: str | os.PathLike[str] | Matrix | None
    inner_cov: str | os.PathLike[str] | Matrix | None


class _VerticalWeight(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `compare`, `sweep`, `batch`, `gate`, `associate`."""

    vertical_weight: float | None
    periodic: str | Iterable[str]
    scale: str | Iterable[str]
    time_tolerance: str | float
    grid: Literal["union", "truth", "estimate", "common"]
    on_duplicate: Literal["error", "first", "last"]
    on_invalid: Literal["error", "drop"]
    interpolate: Literal["estimate", "truth"] | None
    max_gap: str | float | list[float] | tuple[float, float] | None
    resample: str | float | None
    period: str | float | None
    steps: str | None
    outage: str | float | None
    time_offset: str | float
    time_scale: float
    unit_scale: float
    origin: str | Sequence[float] | None
    day_begins: float | None
    fix_cov: bool
    missing_cov: Literal["error", "zero"]
    mixed: Literal["error", "moments"]
    cloud_order: int | None
    inner: Literal["euclidean", "mahalanobis"] | None
    reduce: int | None
    no_gating: bool


class _Columns(TypedDict, total=False):
    """Keywords of all functions."""

    columns: str | Iterable[str] | None
    decimal: Literal[".", ","]
    max_input: float | None
    time: str | None
    class_: str | Iterable[str] | None
    region: str | os.PathLike[str] | None
    where: str | Iterable[str]
    reduce_method: ReduceMethod | None
    directions: int | None
    iterations: int | None
    restarts: int | None
    polish: int | None
    seed: int | None


class _By(TypedDict, total=False):
    """Keywords of `evaluate`, `gate`."""

    by: Literal["class"] | None
    slices: str | Iterable[str]
    curve: bool
    window: str | int | None
    every: str | int | None
    similarity: float | None
    tracked_shares: str


class _Preprocess(TypedDict, total=False):
    """Keywords of `evaluate`, `evaluate_many`, `batch`, `gate`."""

    preprocess: Preprocess | None


class _Jobs(TypedDict, total=False):
    """Keywords of `evaluate`, `compare`, `sweep`, `gate`, `associate`, `reduce`."""

    jobs: int | None


class _With(TypedDict, total=False):
    """Keywords of `evaluate`, `compare`, `gate`."""

    with_: str | Iterable[str] | None


class ReduceOptions(_Columns, _Jobs):
    """Keywords of `reduce` beside its own parameters."""


class AssociateOptions(_Distance, _VerticalWeight, ReduceOptions):
    """Keywords of `associate` beside its own parameters."""


class SweepOptions(_StepWeights, _Existence, AssociateOptions):
    """Keywords of `sweep` beside its own parameters."""


class EvaluateManyOptions(
    _Rho, _StepWeights, _Existence, _Distance, _VerticalWeight, _Columns, _Preprocess
):
    """Keywords of `evaluate_many` beside its own parameters."""


class BatchEvaluationOptions(
    _Cutoff, _Rho, _PlainStepWeights, _Existence, _VerticalWeight, _Columns, _Preprocess
):
    """Keywords of `batch` beside its own parameters."""


class CompareOptions(_Rho, _With, SweepOptions):
    """Keywords of `compare` beside its own parameters."""


class EvaluateOptions(_By, _Preprocess, CompareOptions):
    """Keywords of `evaluate` beside its own parameters."""


class GateEvaluationOptions(_Cutoff, EvaluateOptions):
    """Keywords of `gate` beside its own parameters."""


class RecorderOptions(_Cutoff, EvaluateOptions):
    """Keywords of `Recorder.evaluate`."""
