"""Single changes of an estimate, and what each is proven to save. Computes nothing."""

from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.config import settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.records import PARTS, Columns, Json, Time, json_text
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    import pandas as pd

EXPLANATION_SCHEMA = "tgospa-eval/explanation/1"

KINDS = ("merge", "exchange", "split", "drop", "trim", "fill", "extend", "shift", "offset")
"""What a repair does."""

NOT_ADDITIVE = (
    "savings do not add up: each is that of its repair alone; apply one, then explain what is left"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Repair:
    """One change of the estimate, and what is proven of it.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    text : str
        What it does, in words with ids and times.
    estimates : tuple of str
        Ids of the tracks that it changes; none where it changes all.
    tracks : tuple of int
        Their numbers.
    begin, end : int, float or str, optional
        From which time to which.
    shift : int
        Steps by which it moves the estimate.
    offset : dict
        What it takes from each column.
    rows : Columns
        The rows that it adds, ``t`` and the state columns.
    total, tgospa : float
        The cost, and the metric, afterwards.
    lower_bound, upper_bound : float
        Proven bounds of the metric afterwards.
    saving_lower, saving_upper : float
        Proven bounds of what it saves of the total, in the unit of the total.
    edit : object
        For `Explanation.repaired`.
    """

    kind: str
    text: str
    estimates: tuple[str, ...]
    tracks: tuple[int, ...]
    begin: Time | None
    end: Time | None
    shift: int
    offset: dict[str, float]
    rows: Columns
    total: float
    tgospa: float
    lower_bound: float
    upper_bound: float
    saving_lower: float
    saving_upper: float
    edit: object

    def record(self, rank: int, total: float) -> Json:
        """Its part of the JSON document; `total` is the cost before."""
        return {
            "rank": rank,
            "kind": self.kind,
            "text": self.text,
            "estimates": list(self.estimates),
            "from": self.begin,
            "to": self.end,
            "shift": self.shift,
            "offset": self.offset,
            "rows": self.rows,
            "total": self.total,
            "tgospa": self.tgospa,
            "lower_bound": self.lower_bound,
            "upper_bound": self.upper_bound,
            "saving": {"lower": self.saving_lower, "upper": self.saving_upper},
            "share": max(self.saving_lower, 0.0) / total if total > 0 else 0.0,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """What an evaluation would gain by repairs of the estimate, each done alone.

    Parameters
    ----------
    result : Summary
        The evaluation, which may hold this in turn.
    repairs : tuple of Repair
        By what they are proven to save, the most first.
    candidates, tried : int
        Repairs that may save something, and how many of them were tried.
    seconds : float
        How long that took.
    estimate : Trajectories
        The estimate on the steps that count.
    """

    result: Any
    repairs: tuple[Repair, ...]
    candidates: int
    tried: int
    seconds: float
    estimate: Trajectories

    @property
    def before(self) -> float:
        """The cost without any repair."""
        return float(self.result.total)

    def __repr__(self) -> str:
        first = f", best={self.repairs[0].text!r}" if self.repairs else ""
        return f"{type(self).__name__}(repairs={len(self.repairs)}{first})"

    @cached_property
    def table(self) -> "pd.DataFrame":
        """A row for each repair, the first saves most."""
        import pandas as pd  # here: not needed to compute, and slow to import

        return pd.DataFrame(self.columns())

    def columns(self) -> Columns:
        """The repairs as columns."""
        repairs = self.repairs
        return {
            "rank": list(range(1, len(repairs) + 1)),
            "kind": [repair.kind for repair in repairs],
            "repair": [repair.text for repair in repairs],
            "estimates": [" ".join(repair.estimates) for repair in repairs],
            "from": [repair.begin for repair in repairs],
            "to": [repair.end for repair in repairs],
            "saving_lower": [repair.saving_lower for repair in repairs],
            "saving_upper": [repair.saving_upper for repair in repairs],
            "share": [repair.record(0, self.result.total)["share"] for repair in repairs],
            "total": [repair.total for repair in repairs],
            "tgospa": [repair.tgospa for repair in repairs],
            "lower_bound": [repair.lower_bound for repair in repairs],
            "upper_bound": [repair.upper_bound for repair in repairs],
        }

    def record(self) -> Json:
        """Their part of a JSON document."""
        return {
            "repairs": [
                repair.record(rank, self.result.total)
                for rank, repair in enumerate(self.repairs, 1)
            ],
            "candidates": self.candidates,
            "tried": self.tried,
            "additive": False,
            "notes": [NOT_ADDITIVE],
        }

    def repaired(self, rank: int = 1) -> Trajectories:
        """The estimate after the repair of this rank; it has the rows that count.

        Raises
        ------
        ConfigError
            No repair has the rank.
        """
        if not 1 <= rank <= len(self.repairs):
            there = f"there are {len(self.repairs)}" if self.repairs else "there is none"
            raise ConfigError(f"repair {rank}: {there}")
        edits = import_module("tgospa_eval.explain.edits")
        made: Trajectories = edits.edited(self.estimate, self.repairs[rank - 1].edit)
        return made

    def to_dict(self) -> Json:
        """The JSON document as plain Python values."""
        result = self.result
        lower, upper = result.total_bounds
        return {
            **self.record(),
            "schema": EXPLANATION_SCHEMA,
            "version": result.version,
            "tgospa": result.tgospa,
            "lower_bound": result.lower_bound,
            "upper_bound": result.upper_bound,
            "total": result.total,
            "total_bounds": {"lower": lower, "upper": upper},
            "certified": result.certified,
            "parts": {name: getattr(result, name) for name in PARTS},
            "worst": result.worst(),
            "parameters": result.parameters,
            "files": result.files,
            **settings_field(result.settings_file),
            "input": result.input,
            "warnings": [notice.record() for notice in result.warnings],
            "timings": {**result.timings, "explain": self.seconds},
        }

    def to_json(self) -> str:
        """The JSON document: sorted keys, no NaN, full doubles."""
        return json_text(self.to_dict())
