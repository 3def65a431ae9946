"""Values of options as typed records; what a verb has no option for keeps its default here."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Self

from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass

NOT_OF_THE_NUMBER = (
    *("jobs", "max_input", "memory", "scheduler", "sides"),
    *("curve", "explain", "similarity", "window", "every", "with_", "slices", "summed"),
)
"""Options of an evaluation that do not change its number."""


@dataclass(frozen=True, kw_only=True)
class Values:
    """A record of options."""

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Self:
        """From all options of a verb by parameter, those of others left aside."""
        names = {field.name for field in fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in names})


@dataclass(frozen=True, kw_only=True)
class EvaluationOptions(Values):
    """Of everything that reads files and measures distances; None where nothing was given.

    The parameters are those of `cli.shared.options`. `pairwise` lets a distance take the
    covariances of each pair; `sides` are the two files as options name them; `summed` says that
    slices are added to those of other evaluations.
    """

    cutoff: float | None = None
    order: float = 2.0
    switch_penalty: float | None = None
    rho: float = 0.5
    step_weights: str | None = None
    existence: str = "ignore"
    distance: str = "euclidean"
    covariance: str | None = None
    periodic: tuple[str, ...] = ()
    scale: tuple[str, ...] = ()
    columns: str | None = None
    truth_columns: str | None = None
    estimate_columns: str | None = None
    truth_format: str | None = None
    estimate_format: str | None = None
    time_tolerance: str = "0"
    grid: str = "union"
    interpolate: str | None = None
    max_gap: str | None = None
    resample: str | None = None
    steps: str | None = None
    outage: str | None = None
    time_offset: float = 0.0
    time_scale: float = 1.0
    unit_scale: float = 1.0
    on_duplicate: str = "error"
    on_invalid: str = "error"
    decimal: str = "."
    max_input: float | None = None
    time: str | None = None
    class_: str | None = None
    truth_class: str | None = None
    estimate_class: str | None = None
    region: str | None = None
    by: str | None = None
    preprocess: str | None = None
    unit: str | None = None
    solver: str = "certified"
    gap: float = 1e-9
    epsilon: float = 0.03
    time_limit: float | None = None
    jobs: int | None = None
    memory: int | None = None
    scheduler: str | None = None
    curve: bool = False
    window: str | None = None
    every: str | None = None
    explain: bool = False
    similarity: float | None = None
    with_: str | None = None
    slices: tuple[str, ...] = ()
    summed: bool = False
    fix_cov: bool = False
    missing_cov: str = "error"
    mixed: str = "error"
    cloud_order: int | None = None
    inner: str | None = None
    inner_cov: str | None = None
    reduce: int | None = None
    reduce_method: str | None = None
    directions: int | None = None
    iterations: int | None = None
    restarts: int | None = None
    polish: int | None = None
    seed: int | None = None
    no_gating: bool = False
    pairwise: bool = False
    sides: tuple[str, str] = ("truth", "estimate")

    @property
    def given(self) -> dict[str, object]:
        """Those that change the number or its bracket, and are no defaults."""
        return {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name not in NOT_OF_THE_NUMBER
            if getattr(self, field.name) != field.default
        }


@dataclass(frozen=True, kw_only=True)
class OutputOptions(Values):
    """Of everything that prints and writes. The parameters are those of `cli.shared.options`."""

    format_: str = "table"
    output: str | None = None
    force: bool = False
    proof: bool = False
    pictures: str = "none"
    style: str = "screen"
    components: str | None = None
    plane: str | None = None
    config: SettingsFile | None = None
    quiet: bool = False
    verbose: bool = False
