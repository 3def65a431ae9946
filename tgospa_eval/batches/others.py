"""Other metrics of groups of jobs: joined as TrackEval joins sequences, costs of GOSPA added up."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from tgospa_eval.results.records import OtherMetrics

if TYPE_CHECKING:
    import pandas as pd

WITH_PREFIX = "with."
"""What columns of other metrics begin with."""


def metrics_of(columns: Iterable[str]) -> list[str]:
    """The metrics that are stored, in the order of their columns."""
    inside = (name.split(".")[1] for name in columns if name.startswith(WITH_PREFIX))
    return [name for name in dict.fromkeys(inside) if name != "similarity"]


def joined_metrics(rows: "pd.DataFrame") -> dict[str, float]:
    """Numbers of a group of rows, by the names of their columns.

    Matches are counted over all rows, and what is a ratio is one of these sums; costs of GOSPA are
    added. Those of one row are as they are.

    Parameters
    ----------
    rows : DataFrame
        Of a store, each with a value; with the same distance and cutoff.

    Raises
    ------
    ConfigError
        The extra that joins them is not installed.
    """
    from tgospa_eval.evaluation.other_metrics import METRIC_FIELDS, joined, of_sums
    from tgospa_eval.evaluation.request import chosen_metrics

    names = [str(name) for name in rows.columns]
    asked = chosen_metrics(metrics_of(names))
    found = [
        {str(name).removeprefix(WITH_PREFIX): value for name, value in row.items()}
        for row in rows.to_dict("records")
    ]
    numbers: dict[str, float] = {}
    ratios = [name for name in asked if name in METRIC_FIELDS]
    if ratios:
        if len(found) == 1:
            record: OtherMetrics = {
                name: {key: found[0][f"{name}.{key}"] for key in METRIC_FIELDS[name]}
                for name in ratios
            }
        else:
            zero = found[0]["similarity.zero"]
            record = joined([of_sums(row, ratios, zero) for row in found])
        numbers |= {
            f"{WITH_PREFIX}{name}.{key}": float(record[name][key])
            for name in ratios
            for key in METRIC_FIELDS[name]
        }
        numbers |= {
            name: float(rows[name].iloc[0]) for name in names if name.startswith("with.similarity.")
        }
    costs = [name for name in names if name.startswith("with.gospa.")]
    return numbers | {name: float(rows[name].sum()) for name in costs}
