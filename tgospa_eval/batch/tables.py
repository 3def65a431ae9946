"""Tables of a batch: costs of jobs are added, never their roots.

Of a group of jobs COMBINED is ``(sum of totals)^(1/p)``, per step ``(sum of totals / sum of
steps)^(1/p)`` with the steps at which something exists, and RMS ``(mean of totals)^(1/p)``, which
is that of Monte Carlo runs (docs/reference/batch.md). Bounds travel: those of a sum are the sums of
the bounds.
"""

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.batch.others import joined_metrics, metrics_of
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.records import COUNTED_PARTS, PARTS

if TYPE_CHECKING:
    import pandas as pd

PARAMETERS = ("distance", "cutoff", "order", "switch_penalty")
"""Jobs in which these differ are never added up."""

SUMS = (
    "total_lower", "total", "total_upper", *PARTS, *(f"counts.{name}" for name in COUNTED_PARTS),
    "sizes.occupied",
)  # fmt: skip


def labels_of(rows: "pd.DataFrame") -> list[str]:
    """Names of the labels."""
    return [name.removeprefix("label.") for name in rows.columns if name.startswith("label.")]


def check_labels(by: Sequence[str], known: Collection[str]) -> None:
    """Whether there are labels of these names.

    Raises
    ------
    ConfigError
        There is no such label.
    """
    unknown = [name for name in by if name not in known]
    if unknown:
        raise ConfigError(
            f"--by {unknown[0]}: no such label; there are {', '.join(known) or 'none'}"
        )


def combined(rows: "pd.DataFrame", by: Sequence[str] = ()) -> "pd.DataFrame":
    """One row for each group of the jobs that have a value.

    Parameters
    ----------
    rows : DataFrame
        Of a store.
    by : sequence of str
        Labels that make a group; parameters that differ make groups as well.

    Raises
    ------
    ConfigError
        There is no such label.
    """
    check_labels(by, labels_of(rows))
    valued = rows[rows["status"] != "failed"] if len(rows) else rows
    if not len(valued):
        return valued
    differing = [name for name in PARAMETERS if valued[name].nunique() > 1]
    keys = [*(f"label.{name}" for name in by), *differing]
    groups = valued.assign(_all="").groupby(keys or "_all", sort=True, dropna=False)
    summed = groups[list(SUMS)].sum()
    summed["jobs"] = groups.size()
    summed["open"] = summed["jobs"] - groups["certified"].sum().astype(int)
    divisors: dict[str, Any] = {
        "combined": 1.0,
        "per_step": summed["sizes.occupied"],
        "rms": summed["jobs"],
    }
    for name, divisor in divisors.items():
        for end in ("", "_lower", "_upper"):
            summed[name + end] = (summed["total" + end] / divisor) ** (1 / groups["order"].first())
    if metrics_of(valued.columns):
        for name, values in _columns([joined_metrics(group) for _, group in groups]).items():
            summed[name] = values
    summed = summed.reset_index(drop=not keys)
    return summed.rename(columns={f"label.{name}": name for name in by})


def _columns(records: list[dict[str, float]]) -> dict[str, list[float]]:
    """Columns of records with the same names."""
    return {name: [record[name] for record in records] for name in records[0]}
