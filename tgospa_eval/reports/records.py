"""The JSON documents of `compare`, as types: docs/reference/json.md has them in words."""

from collections.abc import Mapping, Sequence
from typing import Literal, NotRequired, TypedDict

from tgospa_eval.common.config import WithSettings
from tgospa_eval.results.records import OtherMetrics

Warnings = list[dict[str, str]]
Rule = Literal["stone_soup", "mathworks"]

RULES: dict[Rule, str] = {"stone_soup": "Stone Soup", "mathworks": "MathWorks"}
"""How others charge switches after per-step GOSPA."""


class Metric(TypedDict):
    """Options that change the numbers; a distance has more of its own."""

    cutoff: float
    order: float
    switch_penalty: float
    distance: str
    unit: NotRequired[str | None]
    rho: NotRequired[float]
    step_weights: NotRequired[str]
    existence: NotRequired[str]


class CostParts(TypedDict):
    """The parts of a cost."""

    localisation: float
    missed: float
    false: float
    switch: float


class RunCosts(TypedDict):
    """The parts of the cost of a run; None where it failed."""

    localisation: float | None
    missed: float | None
    false: float | None
    switch: float | None


class Spread(TypedDict):
    """Of the values of several runs; None where there are too few."""

    mean: float | None
    deviation: float | None
    max: float | None


# --- solvers --------------------------------------------------------------------------------------


class Seconds(TypedDict):
    """Solving, its stages, and the proof."""

    solve: float
    certify: float
    stages: dict[str, float]


class Memory(TypedDict):
    """Bytes of a process before solving, and at most until the proof was done."""

    before: int
    peak: int


class SolverRun(RunCosts):
    """What one solver made of a problem; None where it failed."""

    name: str
    solver: str
    epsilon: float | None
    tgospa: float | None
    lower_bound: float | None
    total: float | None
    total_lower: float | None
    error: float | None
    lower_error: float | None
    counts: dict[str, float]
    status: str
    finished: bool
    iterations: int | None
    seconds: Seconds | None
    memory: Memory | None
    history: list[dict[str, float]]


class Ends(TypedDict):
    """Bounds of a total."""

    lower: float
    upper: float


class Referee(TypedDict):
    """What all solvers together prove."""

    lower_bound: float
    upper_bound: float
    total: Ends


class SolversRecord(WithSettings):
    """Several solvers on one problem."""

    schema: str
    version: str
    kind: Literal["solvers"]
    agree: bool
    contradictions: list[list[str]]
    referee: Referee | None
    runs: list[SolverRun]
    left_out: dict[str, str]
    parameters: Metric
    sizes: dict[str, int]
    input: Mapping[str, object]
    seconds: dict[str, float]
    warnings: Warnings


# --- estimates ------------------------------------------------------------------------------------


class EstimateRun(CostParts):
    """One estimate in one run."""

    total: float
    total_lower: float
    status: str
    finished: bool
    input: Mapping[str, object]


class RuleRecord(TypedDict):
    """Per-step GOSPA with switches charged afterwards."""

    switches: float
    halves: float
    total: float
    mean: float


class PerStepRecord(TypedDict):
    """Per-step GOSPA, summed over the steps."""

    total: float
    localisation: float
    missed: float
    false: float
    steps_differing: float
    stone_soup: RuleRecord
    mathworks: RuleRecord


Beside = TypedDict("Beside", {"with": NotRequired[OtherMetrics]})
"""Of one estimate: other metrics, over all its runs."""


class EstimateRecord(CostParts, Beside):
    """One estimate, mean over its runs."""

    name: str
    paths: list[str]
    place: list[int]
    tgospa: float
    lower_bound: float
    total: float
    total_lower: float
    counts: dict[str, float]
    normalised: dict[str, float]
    runs: list[EstimateRun]
    per_step_gospa: PerStepRecord | None
    differences: NotRequired[list[str]]


class Difference(CostParts):
    """Costs per step of one estimate less those of another; bounds of the total."""

    total: list[float]


class StepCounts(TypedDict):
    """At how many steps the second costs less, or more."""

    better: int
    worse: int


class RunCounts(TypedDict):
    """The difference over runs, and in how many it is proven."""

    mean: float
    standard_error: float | None
    first_less: int
    second_less: int


class PairRecord(TypedDict):
    """Two estimates, the one that is ranked before the other first."""

    first: str
    second: str
    verdict: str
    opposed: bool
    per_step: Difference
    steps: StepCounts
    per_run: RunCounts


class RankingRecord(WithSettings):
    """Estimates of one truth in their order."""

    schema: str
    version: str
    kind: Literal["estimates"]
    runs: int
    steps: list[int]
    truth: list[str]
    ranked_by: str
    estimates: list[EstimateRecord]
    pairs: list[PairRecord]
    parameters: Metric
    warnings: Warnings


# --- study ----------------------------------------------------------------------------------------


class SceneRun(RunCosts):
    """What the log of a study keeps of one solver on one scene; None where it failed."""

    name: str
    solver: str
    epsilon: float | None
    lower: float | None
    upper: float | None
    iterations: int | None
    finished: bool
    status: str
    seconds: float | None


class SceneRecord(TypedDict):
    """What the log of a study keeps of one scene; None where it could not be made."""

    targets: int
    steps: int
    run: int
    occupied: int | None
    sizes: dict[str, int] | None
    prepare_seconds: float | None
    runs: list[SceneRun]


class SolverSummary(TypedDict):
    """One solver on all scenes of one size."""

    name: str
    solver: str
    epsilon: float | None
    seconds: Spread
    error: Spread
    infinite_errors: int
    lower_error: Spread
    iterations: Spread
    failed: int
    unfinished: int


class SizeRecord(TypedDict):
    """All scenes of one size."""

    targets: int
    steps: int
    left_out: int
    states: Spread
    prepare_seconds: Spread
    normalised: dict[str, float | None]
    solvers: list[SolverSummary]


class StudySettings(TypedDict):
    """What the records of a study depend on."""

    scene: dict[str, object]
    tracker: dict[str, object]
    seed: int
    parameters: Metric
    solvers: list[dict[str, object]]


class StudyRecord(StudySettings, WithSettings):
    """A scaling study."""

    schema: str
    version: str
    kind: Literal["study"]
    machine: str
    runs: int
    sizes: list[SizeRecord]
    contradictions: Sequence[tuple[int, int, int, str, str]]


Comparison = SolversRecord | RankingRecord | StudyRecord
