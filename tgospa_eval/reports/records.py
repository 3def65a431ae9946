"""What the JSON documents of `compare` are called; docs/reference/json.md says what is in each."""

from typing import Literal, TypeAlias

from tgospa_eval.results.records import Json

Rule = Literal["stone_soup", "mathworks"]

RULES: dict[Rule, str] = {"stone_soup": "Stone Soup", "mathworks": "MathWorks"}
"""How others charge switches after per-step GOSPA."""

Metric: TypeAlias = Json
"""Options that change the numbers; a distance has more of its own."""

SolversRecord: TypeAlias = Json
"""Several solvers on one problem; of each a `SolverRun`."""

RankingRecord: TypeAlias = Json
"""Estimates of one truth in their order: of each an `EstimateRecord`, of two a `PairRecord`."""

StudyRecord: TypeAlias = Json
"""A scaling study: its `StudySettings`, and of each size a `SizeRecord`."""

# Parts of them. Costs are by part; None where a run failed.
SolverRun: TypeAlias = Json
CostParts: TypeAlias = Json
RunCosts: TypeAlias = Json
Seconds: TypeAlias = Json
Memory: TypeAlias = Json
EstimateRecord: TypeAlias = Json
PairRecord: TypeAlias = Json
PerStepRecord: TypeAlias = Json
RuleRecord: TypeAlias = Json
SceneRecord: TypeAlias = Json
SceneRun: TypeAlias = Json
SizeRecord: TypeAlias = Json
SolverSummary: TypeAlias = Json
StudySettings: TypeAlias = Json
Spread: TypeAlias = Json
Comparison: TypeAlias = Json
