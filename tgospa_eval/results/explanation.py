"""Which single repairs of an estimate would save most: what a user holds. Computes nothing."""

from tgospa_eval.common.config import settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.results.records import PARTS, Json, json_text
from tgospa_eval.results.repairs import Repairs
from tgospa_eval.results.summary import Summary

EXPLANATION_SCHEMA = "tgospa-eval/explanation/1"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Explanation(Repairs):
    """The repairs with the evaluation that they are for.

    Parameters
    ----------
    result : Summary
        The evaluation.
    """

    result: Summary

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
