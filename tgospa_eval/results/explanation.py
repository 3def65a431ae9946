"""Records of repairs, which are single changes of an estimate, with their proven savings."""

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

from tgospa_eval.common.config import settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import PARTS, Columns, Json, Time, json_text
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    import pandas as pd

EXPLANATION_SCHEMA = "tgospa-eval/explanation/1"

OF_THE_RESULT = ("certified", "parameters", "files", "input", "version")
"""Attributes of the result that are fields of the JSON without a change, besides `VALUES`."""

KINDS = ("merge", "exchange", "split", "drop", "trim", "fill", "extend", "shift", "offset")
"""Kinds of repairs."""

EDIT = ("kind", "text", "shift", "offset", "rows")
VALUES = ("total", "tgospa", "lower_bound", "upper_bound")
"""Numbers after a repair, and of the unrepaired result, that are fields of the JSON."""

NOT_ADDITIVE = "savings do not add up: apply one repair, then run explain again"


@dataclass(frozen=True, kw_only=True, eq=False)
class Repair:
    """Change of the estimate with its proven saving.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    text : str
        Description of the change, with ids and times.
    estimates : tuple of str
        Ids of the tracks that the repair changes; empty if it changes all.
    tracks : tuple of int
        Indices of the tracks in `estimates` among all ids of the estimate.
    begin, end : int, float or str, optional
        First and last time of the change.
    shift : int
        Number of steps by which the repair moves the estimate in time.
    offset : dict
        Values that the repair subtracts from each column.
    rows : Columns
        Rows that the repair adds: ``t`` and the state columns.
    total, tgospa : float
        Cost and metric after the repair.
    lower_bound, upper_bound : float
        Proven bounds of the metric after the repair.
    saving_lower, saving_upper : float
        Proven bounds of the saving, in the unit of the total.
    edit : callable
        Function that receives the estimate and returns it repaired, for `Explanation.repaired`.
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
    edit: Callable[[Trajectories], Trajectories]

    def __repr__(self) -> str:
        saved = f"tgospa={self.tgospa:.6g}, saving={self.saving_lower:.6g}"
        return f"Repair({self.text!r}, {saved})"

    def record(self, rank: int, total: float) -> Json:
        """Return the record of the repair for the JSON document; `total` is the cost before."""
        return {
            "rank": rank,
            "estimates": list(self.estimates),
            "from": self.begin,
            "to": self.end,
            **{name: getattr(self, name) for name in (*EDIT, *VALUES)},
            "saving": {"lower": self.saving_lower, "upper": self.saving_upper},
            "share": max(self.saving_lower, 0.0) / total if total > 0 else 0.0,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Repairs of an estimate, each evaluated without the others.

    Parameters
    ----------
    result : Evaluation
        Evaluation of the unrepaired estimate.
    repairs : tuple of Repair
        Repairs, the largest proven saving first.
    candidates, tried : int
        Number of repairs that could save something, and number of repairs that were tried.
    seconds : float
        Duration of the search.
    estimate : Trajectories
        Estimate on the evaluated steps.
    conversion : Conversion
        Conversion from times and states of the file to those of `estimate`.
    """

    result: Evaluation
    repairs: tuple[Repair, ...]
    candidates: int
    tried: int
    seconds: float
    estimate: Trajectories
    conversion: Conversion

    @property
    def before(self) -> float:
        """Cost of the unrepaired estimate."""
        return self.result.total

    def __repr__(self) -> str:
        first = f", best={self.repairs[0].text!r}" if self.repairs else ""
        return f"{type(self).__name__}(repairs={len(self.repairs)}{first})"

    @cached_property
    def table(self) -> "pd.DataFrame":
        """A row for each repair, the largest saving first."""
        import pandas as pd  # lazy: pandas is slow to import

        return pd.DataFrame(self.columns())

    def columns(self) -> Columns:
        """Return the repairs as columns."""
        rows = [
            record
            | {"repair": record["text"], "estimates": " ".join(record["estimates"])}
            | {f"saving_{end}": value for end, value in record["saving"].items()}
            for record in self._records()
        ]
        names = ("rank", "kind", "repair", "estimates", "from", "to")
        numbers = ("saving_lower", "saving_upper", "share", *VALUES)
        return {name: [row[name] for row in rows] for name in (*names, *numbers)}

    def _records(self) -> list[Json]:
        total = self.result.total
        return [repair.record(rank, total) for rank, repair in enumerate(self.repairs, 1)]

    def record(self) -> Json:
        """Return the fields of the JSON document about the repairs."""
        return {
            "repairs": self._records(),
            "candidates": self.candidates,
            "tried": self.tried,
            "additive": False,
            "notes": [NOT_ADDITIVE],
        }

    def repaired(self, rank: int = 1) -> Trajectories:
        """Return the estimate after the repair of this rank, in the units of its file.

        It has only the rows that were evaluated, and only the columns that the evaluation needed.

        Raises
        ------
        ConfigError
            No repair has this rank.
        """
        if not 1 <= rank <= len(self.repairs):
            there = f"there are {len(self.repairs)}" if self.repairs else "there is none"
            raise ConfigError(f"repair {rank}: {there}")
        return self.conversion.undone(self.repairs[rank - 1].edit(self.estimate))

    def to_dict(self) -> Json:
        """Return the JSON document as plain Python values."""
        result = self.result
        lower, upper = result.total_bounds
        return {
            **self.record(),
            "schema": EXPLANATION_SCHEMA,
            **{name: getattr(result, name) for name in (*VALUES, *OF_THE_RESULT)},
            "total_bounds": {"lower": lower, "upper": upper},
            "parts": {name: getattr(result, name) for name in PARTS},
            "worst": result.worst(),
            **settings_field(result.settings_file),
            "warnings": [notice.record() for notice in result.warnings],
            "timings": {**result.timings, "explain": self.seconds},
        }

    def to_json(self) -> str:
        """Return the JSON document, with sorted keys, without NaN, with full doubles."""
        return json_text(self.to_dict())
