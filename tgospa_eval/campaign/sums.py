"""Sums of the jobs of a batch: costs are added, never their roots.

Of a group of jobs COMBINED is ``(sum of totals)^(1/p)``, per step ``(sum of totals / sum of
steps)^(1/p)`` with the steps of the horizon, and RMS ``(mean of totals)^(1/p)``, which
is that of Monte Carlo runs (docs/reference/batch.md). Bounds travel: those of a sum are the sums of
the bounds.
"""

import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.campaign.ranking import rankings
from tgospa_eval.campaign.row import (
    LABEL,
    STORED_SLICES,
    covariances_of,
    job_name,
    label_names,
    pair_numbers,
    shown_labels,
    truths,
    with_parameters,
)
from tgospa_eval.campaign.statistics import confidence
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, natural
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.states import connected_components
from tgospa_eval.results.consistency import STORED_NEES
from tgospa_eval.results.numbers import MEAN
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, OtherMetrics
from tgospa_eval.results.slices import Slicing, added_up
from tgospa_eval.show.batch import BatchTables, Ranking
from tgospa_eval.text import option

if TYPE_CHECKING:
    import pandas as pd

WITH_PREFIX = "with."
"""What columns of other metrics begin with."""


def metrics_of(columns: Iterable[str]) -> list[str]:
    """The metrics that are stored, in the order of their columns."""
    inside = (name.split(".")[1] for name in columns if name.startswith(WITH_PREFIX))
    return [name for name in dict.fromkeys(inside) if name != "similarity"]


def joined_metrics(rows: "pd.DataFrame") -> dict[str, Any]:
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
    numbers: dict[str, Any] = {}
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
    parts, nees = covariances_of(rows)
    numbers |= {name: float(rows[name].sum()) for name in costs} | parts
    return numbers | (nees.row() if nees else {})


SUMS = (
    "total_lower", "total", "total_upper", *PARTS, *(f"counts.{name}" for name in COUNTED_PARTS),
    "judged.steps",
)  # fmt: skip

OF_INTERVALS = ("confidence_lower", "confidence_upper")
"""Columns of the intervals of groups."""

ENDS = ("", "_lower", "_upper")
"""Of the names of a value and its bounds."""


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
            f"{option('by', unknown[0])}: no such label; there are {', '.join(known) or 'none'}"
            + f"; {option('slices', 'class')} splits costs by class" * (unknown[0] == "class")
        )


def tabulated(rows: "pd.DataFrame", by: Sequence[str], *, roots: bool = False) -> BatchTables:
    """All tables of a batch: groups, and the order of the values of the first label.

    A group has labels (one that is called like another column keeps its ``label.``), parameters
    that differ, sums, roots of them; ``jobs`` with a value, and ``expected``: as many as there are
    of groups with which it shares a truth.

    Parameters
    ----------
    rows : DataFrame
        Of a store.
    by : sequence of str
        Labels that make a group; values of the first are compared.
    roots : bool
        Whether with means of roots.

    Raises
    ------
    ConfigError
        There is no such label.
    """
    check_labels(by, label_names(rows))
    if not len(rows) or (rows["status"] == "failed").all():
        return BatchTables(rows=rows, groups=rows.iloc[:0], by=tuple(by))
    import pandas as pd

    rows, parameters = with_parameters(rows)
    filled = rows.fillna({LABEL + name: "" for name in label_names(rows)})
    having = filled[filled["status"] != "failed"]
    # Of a job without value the parameters are not known.
    heads, numbers = _groups(having if parameters else filled, by, parameters)
    own = numbers.loc[having.index]
    orders = having["order"].groupby(own).first()
    orders = orders.reindex(heads.index, fill_value=float(orders.iloc[0]))
    table = _summed(having, own, orders)
    table["expected"] = _expected(having if parameters else filled, numbers, by, parameters)
    if metrics_of(having.columns) or STORED_NEES in having or MEAN in having:
        found = {name: joined_metrics(group) for name, group in having.groupby(own)}
        table = table.join(pd.DataFrame.from_dict(found, orient="index"))
    if roots:
        for end in ENDS:
            values = having["total" + end] ** (1 / having["order"])
            table["mean_of_roots" + end] = values.groupby(own).mean()
    taken = {*table, *OF_INTERVALS, *parameters}
    shown = zip(by, shown_labels(by, taken), strict=True)
    heads = heads.rename(columns={LABEL + name: head for name, head in shown})
    items: list[Ranking | str] = []
    if by:
        items = list(rankings(having, by[0], parameters, filled[LABEL + by[0]].unique()))
    return BatchTables(
        rows=rows,
        groups=pd.concat([heads, table, confidence(having, own, orders)], axis=1),
        by=tuple(by),
        parameters=tuple(parameters),
        rankings=tuple(item for item in items if isinstance(item, Ranking)),
        notes=tuple(dict.fromkeys(item for item in items if isinstance(item, str))),
        slices=sliced_groups(having, numbers),
    )


def _groups(
    rows: "pd.DataFrame", by: Sequence[str], differing: Sequence[str]
) -> tuple["pd.DataFrame", "pd.Series[int]"]:
    """What tells groups apart, digits in labels in the order of numbers; the group of each row."""
    import pandas as pd

    keys = [*(LABEL + name for name in by), *differing]
    if not keys:
        return pd.DataFrame(index=[0]), pd.Series(0, index=rows.index)
    found = rows[keys].drop_duplicates()
    heads = list(found.itertuples(index=False, name=None))

    def place(k: int) -> tuple[Any, ...]:
        head = heads[k]
        return (*(natural(str(value)) for value in head[: len(by)]), *head[len(by) :])

    found = found.iloc[sorted(range(len(heads)), key=place)].reset_index(drop=True)
    numbers = rows[keys].merge(found.reset_index(names="_group"), "left", keys)["_group"]
    return found, numbers.set_axis(rows.index)


def _summed(
    having: "pd.DataFrame", numbers: "pd.Series[int]", orders: "pd.Series[float]"
) -> "pd.DataFrame":
    """Sums over the jobs of each group, and their roots."""
    own = having.groupby(numbers)
    table = own[list(SUMS)].sum().reindex(orders.index)
    table["jobs"] = own.size().reindex(orders.index, fill_value=0)
    table["open"] = table["jobs"] - own["certified"].sum().reindex(orders.index, fill_value=0)
    table = table.astype({"jobs": int, "open": int})
    divisors: dict[str, Any] = {
        "combined": 1.0,
        "per_step": table["judged.steps"],
        "rms": table["jobs"],
    }
    for name, divisor in divisors.items():
        for end in ENDS:
            table[name + end] = (table["total" + end] / divisor) ** (1 / orders)
    return table


def _expected(
    rows: "pd.DataFrame", numbers: "pd.Series[int]", by: Sequence[str], differing: Sequence[str]
) -> Any:
    """How many jobs each group would have, had it what those have that are like it.

    These are groups with a truth in common, or all groups where each has one truth alone.

    Returns
    -------
    array of int, shape (groups,)
    """
    import numpy as np

    counts = np.bincount(numbers)
    alone = truths(rows).groupby(numbers).nunique().max() == 1
    pairs = pair_numbers(rows, by, differing, truth=not alone).to_numpy()
    size = len(counts) + int(pairs.max()) + 1
    parts = connected_components(numbers.to_numpy(), len(counts) + pairs, size)
    alike = np.bincount(parts[len(counts) :], minlength=size)[parts[: len(counts)]]
    return np.maximum(alike, counts)


def data_warnings(rows: "pd.DataFrame") -> Iterator[str]:
    """What looks wrong with the data of jobs: a line a kind, with how many jobs and the first."""
    if "warnings" not in rows:
        return
    told: dict[str, list[tuple[str, Notice]]] = {}
    having = rows[rows["warnings"].notna()]
    for row in having[having["warnings"] != "[]"].to_dict("records"):
        notices = {record["code"]: Notice(**record) for record in json.loads(row["warnings"])[::-1]}
        for code, notice in notices.items():
            told.setdefault(code, []).append((job_name(row), notice))
    for jobs in told.values():
        name, notice = jobs[0]
        others = f" and {len(jobs) - 1:,} more of {counted(len(having), 'job')}"
        yield f"warning: {name}{others if len(jobs) > 1 else ''}: {notice.sentence}"


def sliced_groups(having: "pd.DataFrame", numbers: "pd.Series[int]") -> dict[int, list[Slicing]]:
    """The sums of each group that has slices, by its number.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    numbers : Series of int
        The group of each row, by the index of the rows.
    """
    if STORED_SLICES not in having:
        return {}
    stored = having[STORED_SLICES].dropna()
    return {
        int(number): list(added_up([[*map(Slicing.of, json.loads(text))] for text in texts]))
        for number, texts in stored.groupby(numbers[stored.index])
    }
