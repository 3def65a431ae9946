"""Sums of the jobs of a batch: costs are added, never their roots.

A group of jobs has three values (docs/reference/batch.md). All are roots with the order p:

- combined value: ``(sum of totals)^(1/p)``
- value per step: ``(sum of totals / sum of steps)^(1/p)``, with the steps of the horizon
- RMS value: ``(mean of totals)^(1/p)``, as for Monte Carlo runs

The bounds of a sum are the sums of the bounds.
"""

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.campaign import statistics, store
from tgospa_eval.campaign.ranking import rankings
from tgospa_eval.campaign.row import (
    LABEL,
    STORED_SLICES,
    about_copies,
    covariances_of,
    in_words,
    job_in_words,
    label_names,
    pair_numbers,
    run_ids,
    shown_labels,
    truths,
    with_parameters,
)
from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, natural
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.fields import TimeError, floats, parse_times, places
from tgospa_eval.formats.options import ROLES
from tgospa_eval.problem.states import connected_components
from tgospa_eval.quoting import listed, option
from tgospa_eval.results.consistency import NEES, STORED_NEES
from tgospa_eval.results.records import (
    COUNTED_PARTS,
    MEAN,
    PARTS,
    OtherMetrics,
    Time,
    frame_records,
)
from tgospa_eval.results.slices import Slicing, added_up
from tgospa_eval.results.summary import SUMMARY, pooled
from tgospa_eval.show.batch import (
    KIND_COLUMN,
    POINT_COLUMNS,
    Band,
    BandKind,
    BatchTables,
    CurveKind,
    Ranking,
    RmsCurve,
)
from tgospa_eval.tracks.conversion import SECOND

if TYPE_CHECKING:
    import pandas as pd


WITH_PREFIX = "with."
"""Columns with values of other metrics have names with this prefix: ``with.hota.HOTA``."""


def metrics_of(columns: Iterable[str]) -> list[str]:
    """Return the names of the other metrics that have stored values, in the order of `columns`."""
    inside = (name.split(".")[1] for name in columns if name.startswith(WITH_PREFIX))
    return [name for name in dict.fromkeys(inside) if name != "similarity"]


def joined_metrics(rows: "pd.DataFrame") -> dict[str, Any]:
    """Return the values of other metrics for a group of rows, by the name of the column.

    Counts of matches are added over the rows, and ratios are computed from these sums. Costs of
    GOSPA are added. Parts of the localisation cost and NEES are added, too, if all rows have them.
    The values of a single row stay as they are.

    Parameters
    ----------
    rows : DataFrame
        Rows of a store that have a value. All have the same distance and cutoff.

    Raises
    ------
    ConfigError
        The extra that computes these metrics is not installed.
    """
    from tgospa_eval.evaluation.other_metrics import METRIC_FIELDS, joined, of_sums
    from tgospa_eval.evaluation.request import chosen_metrics

    names = [str(name) for name in rows.columns]
    metrics = chosen_metrics(metrics_of(names))
    records = [
        {str(name).removeprefix(WITH_PREFIX): value for name, value in row.items()}
        for row in frame_records(rows)
    ]
    numbers: dict[str, Any] = {}
    ratios = [name for name in metrics if name in METRIC_FIELDS]
    if ratios:
        if len(records) == 1:
            record: OtherMetrics = {
                name: {key: records[0][f"{name}.{key}"] for key in METRIC_FIELDS[name]}
                for name in ratios
            }
        else:
            zero = records[0]["similarity.zero"]
            record = joined([of_sums(row, ratios, zero) for row in records])
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

ENDS = ("", "_lower", "_upper")
"""Suffixes of the names of a value and its bounds."""


def check_labels(by: Sequence[str], known: Collection[str]) -> None:
    """Check that labels with these names exist.

    Raises
    ------
    ConfigError
        A name is not a label.
    """
    unknown = [name for name in by if name not in known]
    if unknown:
        raise ConfigError(
            f"{option('by', unknown[0])}: no such label; there are {', '.join(known) or 'none'}"
            + f"; {option('slices', 'class')} splits costs by class" * (unknown[0] == "class")
        )


def tabulated(rows: "pd.DataFrame", by: Sequence[str], *, roots: bool = False) -> BatchTables:
    """Return all tables of a batch: its groups, and rankings of the values of the first label.

    The table of groups has a row for each group: its labels, the parameters in which jobs differ,
    sums of costs, and roots of these sums. A label with the name of another column keeps the prefix
    ``label.``. ``jobs`` is the number of jobs with a value. ``expected`` is the number of jobs that
    the group should have, estimated from similar groups.

    Parameters
    ----------
    rows : DataFrame
        Rows of a store.
    by : sequence of str
        Labels that define the groups. Values of the first label are compared.
    roots : bool
        Whether to add the mean of the values of the jobs, in columns ``mean_of_roots...``.

    Raises
    ------
    ConfigError
        A name in `by` is not a label.
    """
    check_labels(by, label_names(rows))
    if not len(rows) or (rows["status"] == "failed").all():
        return BatchTables(rows=rows, groups=rows.iloc[:0], by=tuple(by))
    import pandas as pd

    rows, parameters = with_parameters(rows)
    filled = rows.fillna({LABEL + name: "" for name in label_names(rows)})
    having = filled[filled["status"] != "failed"]
    # A failed job has no parameters. If jobs have different parameters, it is in no group.
    heads, numbers = _groups(having if parameters else filled, by, parameters)
    own = numbers.loc[having.index]
    orders = having["order"].groupby(own).first()
    orders = orders.reindex(heads.index, fill_value=float(orders.iloc[0]))
    table = _summed(having, own, orders)
    table["expected"] = _expected(having if parameters else filled, numbers, by, parameters)
    names = [name for name in having.columns if str(name).startswith(f"{SUMMARY}.")]
    if names:
        numbers_of = {
            key: pooled({name: group[name].to_numpy(float) for name in names})
            for key, group in having.groupby(own)
        }
        table = table.join(pd.DataFrame.from_dict(numbers_of, orient="index"))
    if metrics_of(having.columns) or STORED_NEES in having or MEAN in having:
        numbers_of = {name: joined_metrics(group) for name, group in having.groupby(own)}
        table = table.join(pd.DataFrame.from_dict(numbers_of, orient="index"))
    if roots:
        for end in ENDS:
            values = having["total" + end] ** (1 / having["order"])
            table["mean_of_roots" + end] = values.groupby(own).mean()
    taken = {*table, *statistics.OF_INTERVALS, *parameters}
    shown = zip(by, shown_labels(by, taken), strict=True)
    heads = heads.rename(columns={LABEL + name: head for name, head in shown})
    items: list[Ranking | str] = []
    for number, runs in run_ids(having).groupby(own):
        items += map(str, about_copies("/".join(map(in_words, heads.loc[number])), runs))
    if by:
        items += rankings(having, by[0], parameters, filled[LABEL + by[0]].unique())
    return BatchTables(
        rows=rows,
        groups=pd.concat([heads, table, statistics.confidence(having, own, orders)], axis=1),
        by=tuple(by),
        parameters=tuple(parameters),
        rankings=tuple(item for item in items if isinstance(item, Ranking)),
        notes=tuple(dict.fromkeys(item for item in items if isinstance(item, str))),
        slices=slices_of_groups(having, numbers),
    )


def _groups(
    rows: "pd.DataFrame", by: Sequence[str], differing: Sequence[str]
) -> tuple["pd.DataFrame", "pd.Series[int]"]:
    """Return the groups, in natural order of labels, and the index of the group of each row."""
    import pandas as pd

    keys = [*(LABEL + name for name in by), *differing]
    if not keys:
        return pd.DataFrame(index=[0]), pd.Series(0, index=rows.index)
    groups = rows[keys].drop_duplicates()
    heads = list(groups.itertuples(index=False, name=None))

    def place(k: int) -> tuple[Any, ...]:
        head = heads[k]
        return (*(natural(str(value)) for value in head[: len(by)]), *head[len(by) :])

    groups = groups.iloc[sorted(range(len(heads)), key=place)].reset_index(drop=True)
    numbers = rows[keys].merge(groups.reset_index(names="_group"), "left", keys)["_group"]
    return groups, numbers.set_axis(rows.index)


def _summed(
    having: "pd.DataFrame", numbers: "pd.Series[int]", orders: "pd.Series[float]"
) -> "pd.DataFrame":
    """Return a row for each group: sums over its jobs, and roots of these sums."""
    own = having.groupby(numbers)
    table = own[list(SUMS)].sum().reindex(orders.index)
    table["jobs"] = own.size().reindex(orders.index, fill_value=0)
    opened = (having["status"] == "open").groupby(numbers).sum()
    table["open"] = opened.reindex(orders.index, fill_value=0)
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
    """Return the number of jobs that each group would have if no job were missing.

    Jobs of two groups correspond if they have the same truth, the same parameters and the same
    labels except those in `by`. If each group has only one truth, the truths of the groups can
    differ. Groups are similar if some of their jobs correspond, or if both are similar to a third
    group. A group should have every job that a similar group has.

    Returns
    -------
    array of int, shape (groups,)
    """
    import numpy as np

    counts = np.bincount(numbers)
    one_truth = truths(rows).groupby(numbers).nunique().max() == 1
    of_labels = pair_numbers(rows, by, differing, truth=False)
    pairs = of_labels if one_truth else pair_numbers(rows, by, differing)
    size = len(counts) + int(pairs.max()) + 1
    parts = connected_components(numbers.to_numpy(), len(counts) + pairs.to_numpy(), size)
    alike = of_labels.groupby(parts[numbers]).nunique().reindex(parts[: len(counts)])
    return np.maximum(alike.to_numpy(), counts)


def data_messages(rows: "pd.DataFrame") -> Iterator[str]:
    """Yield a line for each kind of warning about the data, then for each kind of notice.

    Each line names the first job with this message, and the number of other jobs.
    """
    for column, texts_of in (("warnings", _warnings), ("notices", _notices)):
        having = rows[rows[column].notna()] if column in rows else rows[:0]
        by_kind: dict[str, list[tuple[str, str]]] = {}
        for row in frame_records(having[having[column] != "[]"]) if len(having) else ():
            for kind, text in texts_of(row).items():
                by_kind.setdefault(kind, []).append((job_in_words(row), text))
        for jobs in by_kind.values():
            name, text = jobs[0]
            rest = f" and {len(jobs) - 1:,} more of {counted(len(having), 'job')}"
            mark = "warning: " * (column == "warnings")
            yield f"{mark}{name}{rest if len(jobs) > 1 else ''}: {text}"


def _warnings(row: Mapping[Any, Any]) -> dict[str, str]:
    """Return the warnings of a job by code; if several have the same code, the first of them."""
    records = json.loads(row["warnings"])[::-1]
    return {record["code"]: Notice(**record).sentence for record in records}


def _notices(row: Mapping[Any, Any]) -> dict[str, str]:
    """Return the notices about the files of a job; the keys are their texts without numbers."""
    notices: dict[str, str] = {}
    for text in json.loads(row["notices"]):
        for role in ROLES:
            _, path, said = text.partition(f"{row[role]}: ")
            if path and not said.startswith(BATCH_SAYS):
                notices.setdefault(f"{role} {re.sub('[0-9]+', '', said)}", f"{role}: {said}")
    return notices


BATCH_SAYS = "boxes are compared by their centres"
"""Beginning of a notice that a batch prints once."""


def slices_of_groups(having: "pd.DataFrame", numbers: "pd.Series[int]") -> dict[int, list[Slicing]]:
    """Return the slices of each group by its index, with costs added over its jobs.

    Groups without slices are left out.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    numbers : Series of int
        Index of the group of each row.
    """
    if STORED_SLICES not in having:
        return {}
    stored = having[STORED_SLICES].dropna()
    return {
        int(number): list(added_up([[*map(Slicing.of, json.loads(text))] for text in texts]))
        for number, texts in stored.groupby(numbers[stored.index])
    }


# -------------------------------------------------------------------------------------------------
# Root mean squares over runs at each time: docs/reference/batch.md has the definitions.
#
# By default, every run of a group counts at each time, with cost 0 at times without a step. A run
# is under way from its first to its last step. In two cases a run counts only while it is under
# way:
#
# - The time axis is given (`over`).
# - At no time are more than half of the runs under way.
#
# Sums over time and over runs are computed from left to right, with runs in the order of the jobs.
# Powers are computed by Python. A script that adds up single results therefore gets the same
# doubles.

BAND_RESAMPLES, BAND_SEED = 1000, 1
"""Number of resamples of the bootstrap, and its seed."""

BAND_LEVELS = ((1 - statistics.CONFIDENCE) / 2, (1 + statistics.CONFIDENCE) / 2)
"""Quantile levels of the lower and the upper end of a band."""

BAND_TAIL = round(BAND_RESAMPLES * BAND_LEVELS[0])
"""Number of resamples at or beyond each end of a band."""

MAX_BANDED = 20_000
"""Largest number of times for which runs get bands, if they have few times in common."""

Bounds = tuple[Sequence[float], Sequence[float]]

Line = tuple[list[float], Band | None]
"""Root mean squares at each time, and their band.

With too few runs or too many times, the band is None.
"""

MIN_RUNS: Mapping[BandKind, int] = {
    "interval": statistics.MIN_PAIRS,
    "bootstrap": statistics.MIN_PAIRS,
    "percentiles": 2,
    "deviation": 2,
}
"""Smallest number of runs for which a band is computed, by kind of band."""


def rms_curves(
    rows: "pd.DataFrame",
    steps: "pd.DataFrame | None",
    by: Sequence[str],
    band: BandKind = "interval",
    over: str | None = None,
) -> tuple[list[RmsCurve], list[str]]:
    """Return RMS curves for each group of jobs with stored steps, and messages about them.

    Parameters
    ----------
    rows : DataFrame
        Rows of a store, in the order of the jobs.
    steps : DataFrame, optional
        Steps of these rows, as returned by `read_steps`.
    by : sequence of str
        Labels that define the groups. Jobs with different parameters are in different groups.
    band : str
        Kind of the bands around the curves.
    over : {"start", "stamps"}, optional
        Time axis: time since the start of each run, or timestamps. The default is timestamps, with
        one exception. If at every time at most half of the runs of a group are between their first
        and their last step, the default is the time since the start.
    """
    if steps is None:
        return [], []
    rows, differing = with_parameters(rows)
    valued = rows[rows["status"] != "failed"]
    there = [name for name in by if name in label_names(rows)]
    keys = [*(LABEL + name for name in there), *differing]
    heads = [*shown_labels(there, {KIND_COLUMN, *POINT_COLUMNS, *differing}), *differing]
    grouped = valued.assign(_all="").groupby(keys or "_all", sort=True, dropna=False)
    number = np.full(int(rows.index.max()) + 1, -1)
    number[valued.index] = grouped.ngroup()
    parts: dict[Any, pd.DataFrame] = dict(iter(steps.groupby(number[steps["job"]])))
    curves: list[RmsCurve] = []
    notes: dict[str, list[str]] = {}
    for k, (_, group) in enumerate(grouped):
        if k not in parts:
            if lost := int((group.reindex(columns=[store.STORED_STEPS]) > 0).sum().sum()):
                text = f"not available: the stored steps of {counted(lost, 'run')} are lost"
                name = "/".join(map(in_words, group.iloc[0][keys])) or "all jobs"
                notes.setdefault(text, []).append(name)
            continue
        first = group.iloc[0]
        labels = {head: in_words(first[key]) for head, key in zip(heads, keys, strict=True)}
        about: list[str] = []
        # Runs with stored steps count. Runs that have no steps count, too, with cost 0.
        counts = group.index.isin(parts[k]["job"]) | (group["sizes.steps"] == 0).to_numpy()
        try:
            jobs = group.index[counts].to_numpy()
            shown = band, over, run_ids(group[counts]).nunique()
            made = _curves(parts[k], jobs, float(first["order"]), shown, about)
            for kind, runs, lines, means, bounds in made:
                curves.append(
                    RmsCurve(
                        group=labels,
                        kind=kind,
                        times=runs.times,
                        runs=runs.present.tolist(),
                        rms={name: rms for name, (rms, _) in lines.items()},
                        bands={name: band for name, (_, band) in lines.items() if band},
                        means=means,
                        bounds=bounds,
                        band=band,
                    )
                )
        except TimeError as error:
            about.append(f"not available: {error}")
        if not counts.all():
            missing = f"{np.count_nonzero(~counts):,} of {counted(len(counts), 'run')}"
            about.append(f"{missing} have no stored steps, and do not count")
        for text in about:
            notes.setdefault(text, []).append("/".join(labels.values()) or "all jobs")
    return curves, [f"curves of {listed(names)}: {text}" for text, names in notes.items()]


def _curves(
    steps: "pd.DataFrame",
    jobs: Ints,
    order: float,
    shown: tuple[BandKind, str | None, int],
    notes: list[str],
) -> Iterator[tuple[CurveKind, "_Runs", dict[str, Line], dict[str, list[float]], Bounds | None]]:
    """Yield the curves of these jobs, and add messages to `notes`.

    A curve is a tuple of its kind, its runs, lines by name, means by name, and bounds of the total
    (or None). `shown` has the arguments `band` and `over` of `rms_curves`, and the number of
    runs without copies.
    """
    runs = _Runs(steps, jobs, order, *shown)
    if shown[1] is None and runs.over == "start":
        notes.append(
            "at most half of the runs are under way at any one time: t is the time since "
            "the start of each run, and a run counts up to its last step; "
            f"{option('over', 'stamps')} keeps the timestamps"
        )
    elif runs.is_scattered:
        bands = f"; bands are only for up to {MAX_BANDED:,} times" if runs.many else ""
        notes.append(
            "usually half of the runs or fewer have a step at a time; the other runs count with "
            f"cost 0{bands}; {option('resample')} gives all runs the same times"
        )
    else:
        inside = _running(runs.place, runs.slices, len(runs.times))[-1]
        if not runs.own_span and 2 * inside < runs.count:
            notes.append(
                f"at the last time only {inside} of {runs.count} runs have not ended: the others "
                f"count with cost 0, without objects; {option('over', 'stamps')} counts each run "
                "from its first step to its last"
            )
    if runs.nees is not None:
        lacking = np.isin(jobs, steps["job"][steps[store.NEES_COLUMNS[0]].isna()])
        if lacking.any():
            notes.append(
                f"NEES over time lacks {np.count_nonzero(lacking):,} of "
                f"{counted(len(jobs), 'run')}, which have no covariances"
            )
    costs = runs.columns(store.COST_COLUMNS)
    each, so_far = (
        {
            name: runs.line(row, carried=carried)
            for name, row in zip(store.COST_COLUMNS, rows, strict=True)
        }
        for rows, carried in ((costs, False), (runs.so_far(costs), True))
    )
    each |= {
        name: (runs.rms(row, carried=False), None) for name, row in runs.known(store.GOSPA_COLUMNS)
    }
    yield "step", runs, each, _means(runs), None
    yield "cumulative", runs, so_far, {}, None
    with_curve = steps[steps[store.CURVE_COLUMNS[0]].notna()]
    if not len(with_curve):
        return
    having = np.isin(jobs, with_curve["job"]) | ~np.isin(jobs, steps["job"])
    if not having.all():
        missing = f"{np.count_nonzero(~having):,} of {counted(len(having), 'run')}"
        notes.append(f"{missing} have no stored values of the steps up to each step")
    runs = _Runs(with_curve, jobs[having], order, *shown)
    powers = [[value**order for value in own] for own in runs.columns(store.CURVE_COLUMNS).tolist()]
    value, lower, upper = np.array(powers)
    lines = {"total": runs.line(value, (lower, upper), carried=True)}
    for name, row in runs.known(store.CURVE_PARTS):
        lines[name.removeprefix("curve.")] = runs.line(row, carried=True)
    ends = runs.rms(lower, carried=True), runs.rms(upper, carried=True)
    yield "growing", runs, lines, {}, ends


def _means(runs: "_Runs") -> dict[str, list[float]]:
    """Return the mean numbers of objects and estimates, the detection rate and NEES at each time.

    The detection rate is NaN at times without objects, and NEES at times without pairs.
    """
    sums = {name: runs.sums(row, carried=False) for name, row in runs.known(store.STATE_COLUMNS)}
    means: dict[str, Floats] = {}
    with np.errstate(invalid="ignore", divide="ignore"):
        if len(sums) >= len(store.STATE_COLUMNS):
            truth, _, assigned = (sums[name] for name in store.STATE_COLUMNS)
            means = {name: sums[name] / runs.present for name in store.STATE_COLUMNS[:2]}
            means["detection_rate"] = assigned / truth
        if runs.nees is not None:
            means[NEES] = runs.nees[0] / runs.nees[1]
    return {name: values.tolist() for name, values in means.items()}


def _band(kind: BandKind, lower: Floats, upper: Floats, order: float, typical: float) -> Floats:
    """Return the two ends (2, K) of the band around the root mean square of N runs at K times.

    `lower` and `upper` (N, K) are bounds of the costs. `rare_intervals` describes `typical`.
    """
    root = 1 / order
    if kind == "interval":
        return np.stack(statistics.rare_intervals(lower.T, upper.T, order, typical))
    if kind == "bootstrap":
        low_end = _resampled(lower)
        high_end = low_end if upper is lower else _resampled(upper)
        return np.stack([low_end[BAND_TAIL - 1], high_end[-BAND_TAIL]]) ** root
    low, high = lower**root, upper**root
    if kind == "percentiles":
        levels = zip((low, high), BAND_LEVELS, strict=True)
        return np.stack([np.quantile(values, level, axis=0) for values, level in levels])
    low_end, high_end = (side.mean(axis=0) ** root for side in (lower, upper))
    low_end, high_end = low_end - low.std(axis=0, ddof=1), high_end + high.std(axis=0, ddof=1)
    return np.stack([np.maximum(low_end, 0.0), high_end])


def _resampled(costs: Floats) -> Floats:
    """Return the means of all bootstrap resamples (`BAND_RESAMPLES`, K), sorted at each time.

    A resample draws N runs with replacement. `costs` (N, K) are those of the runs at K times.
    """
    runs, rng = len(costs), np.random.default_rng(BAND_SEED)
    draws = max(1, statistics.NUMBERS_AT_ONCE // runs)
    means = np.concatenate(
        [
            rng.multinomial(runs, [1 / runs] * runs, min(draws, BAND_RESAMPLES - done)) @ costs
            for done in range(0, BAND_RESAMPLES, draws)
        ]
    )
    means /= runs
    means.sort(axis=0)
    return means


class _Runs:
    """Steps of N runs: R steps in all, sorted by run and time, at T different times.

    Raises
    ------
    TimeError
        The times are of several kinds, such as numbers and dates.
    """

    def __init__(
        self,
        steps: "pd.DataFrame",
        jobs: Ints,
        order: float,
        band: BandKind,
        over: str | None,
        different: int,
    ) -> None:
        import pandas as pd

        codes, texts = pd.factorize(steps["t"].to_numpy())
        read = [_as_read(text) for text in texts]
        (place,) = places([read])
        run, place = np.searchsorted(jobs, steps["job"]), place[codes]
        self.over, self.own_span = over, over is not None
        by_run = np.lexsort((place, run))
        begins = np.flatnonzero(np.diff(run[by_run], prepend=-1)).tolist()
        self.slices = [slice(*ends) for ends in pairwise([*begins, len(steps)])]
        at_once = _running(place[by_run], self.slices, len(read))
        if over is None and 2 * at_once.max() <= len(begins):
            self.over, self.own_span = "start", True
        if self.over == "start":  # the steps of a run stay in the same order
            since = _since_start(read, codes, run, len(jobs))
            values, place = np.unique(since, return_inverse=True)
            read, codes = values.tolist(), place
        self.order, self.band, self.different = order, band, different
        self.count, self.steps = len(jobs), steps.iloc[by_run]
        self.run, self.place = run[by_run], place[by_run]
        # Equal times such as 1 and 1.0 are shown in the form of the first run.
        first = by_run[np.unique(self.place, return_index=True)[1]]
        self.times: list[Time] = [read[code] for code in codes[first].tolist()]
        self.divisor = np.maximum(self.columns(["steps"])[0], 1)
        size = len(self.times)
        self.present = np.full(size, self.count)
        if self.own_span:
            self.present = _running(self.place, self.slices, size)

    def columns(self, names: Sequence[str]) -> Floats:
        """Return M columns of the table of steps, as an array (M, R)."""
        return np.ascontiguousarray(self.steps[list(names)].to_numpy(float).T)

    def known(self, names: Sequence[str]) -> Iterator[tuple[str, Floats]]:
        """Yield name and values (R,) of each named column in which every step has a value."""
        for name in names:
            if name in self.steps and self.steps[name].notna().all():
                yield name, self.columns([name])[0]

    @cached_property
    def nees(self) -> tuple[Floats, Floats] | None:
        """Sum of NEES at each time (T,), and number of pairs (T,), over the runs with NEES."""
        if store.NEES_COLUMNS[0] not in self.steps:
            return None
        total, pairs = np.nan_to_num(self.columns(store.NEES_COLUMNS))
        return self.sums(total, carried=False), self.sums(pairs, carried=False)

    @cached_property
    def is_scattered(self) -> bool:
        """True if the runs have few times in common.

        This means: at more than half of the times, at most half of the runs have a step. A run
        counts only from its first to its last step. A time counts only if several runs count.
        """
        size = len(self.times)
        inside = _running(self.place, self.slices, size)
        having = np.bincount(self.place, minlength=size)[inside > 1]
        few = 2 * having <= inside[inside > 1]
        return bool(2 * np.count_nonzero(few) > len(few))

    @property
    def many(self) -> bool:
        """True if bands would take too long: the runs are scattered over too many times."""
        return self.is_scattered and len(self.times) > MAX_BANDED

    def so_far(self, costs: Floats) -> Floats:
        """Return running sums of costs (M, R), divided by the steps of the horizon so far."""
        sums = np.empty_like(costs)
        for own in self.slices:
            np.cumsum(costs[:, own], axis=1, out=sums[:, own])
        sums /= self.divisor
        return sums

    def sums(self, costs: Floats, *, carried: bool) -> Floats:
        """Return the sum of costs (R,) over the runs at each time (T,), in the order of the runs.

        If costs are `carried`, a run without a step at a time keeps the cost of its previous step.
        Otherwise its cost at this time is 0.
        """
        size = len(self.times)
        totals = np.zeros(size)
        for own in self.slices:
            place = self.place[own]
            if carried:
                end = place[-1] + 1 if self.own_span else size
                totals[place[0] : end] += np.repeat(costs[own], np.diff(place, append=end))
            else:
                totals[place] += costs[own]
        return totals

    def rms(self, costs: Floats, *, carried: bool) -> list[float]:
        """Return the root mean square over the runs at each time, from the costs (R,) of steps."""
        means = self.sums(costs, carried=carried) / np.maximum(self.present, 1)
        return [cost ** (1 / self.order) for cost in means.tolist()]

    def line(
        self, costs: Floats, bounds: tuple[Floats, Floats] | None = None, *, carried: bool
    ) -> Line:
        """Return the root mean square of costs (R,) over the runs at each time, and its band.

        `bounds` are lower and upper bounds of the costs, if the costs are not exact.
        """
        band = None
        if self.different >= MIN_RUNS[self.band] and not self.many:
            ends, costly = [], (bounds or (costs,))[-1]
            typical = float(costly[costly > 0].mean()) if (costly > 0).any() else np.nan
            for row, there, within in self.cells(carried=carried):
                cells = [np.where(there, side[row], 0.0) for side in bounds or (costs,)]
                ends_of_cells = np.full((2, row.shape[1]), np.nan)
                cuts = np.flatnonzero((within[:, 1:] != within[:, :-1]).any(axis=0)) + 1
                for begin, end in pairwise([0, *cuts.tolist(), row.shape[1]]):
                    own = within[:, begin]
                    if np.count_nonzero(own) >= MIN_RUNS[self.band]:
                        some = [side[own, begin:end] for side in cells]
                        ends_of_cells[:, begin:end] = _band(
                            self.band, some[0], some[-1], self.order, typical
                        )
                ends.append(ends_of_cells)
            low, high = (
                [None if value != value else value for value in side]
                for side in np.concatenate(ends, axis=1).tolist()
            )
            band = low, high
        return self.rms(costs, carried=carried), band

    def cells(self, *, carried: bool) -> Iterator[tuple[Ints, Mask, Mask]]:
        """Yield the steps of all N runs in batches of K times: indices and two masks, each (N, K).

        The first mask is true where a run has a step. If steps are `carried`, it is also true at
        later times, and the index is that of the last step so far. The second mask is true where a
        run counts.
        """
        ends = np.array([[0, len(self.times)]] * self.count)
        if self.own_span:
            ends[:] = (1, 0)  # an empty range, for runs without steps
            for own in self.slices:
                ends[self.run[own.start]] = self.place[[own.start, own.stop - 1]]
        size = len(self.times)
        keys = self.run * size + self.place
        width = max(1, statistics.NUMBERS_AT_ONCE // max(self.count, BAND_RESAMPLES))
        for low in range(0, size, width):
            first = size * np.arange(self.count)[:, None]
            wanted = first + np.arange(low, min(low + width, size))
            row = np.searchsorted(keys, wanted, side="right") - 1
            there = (row >= 0) & (keys[row] >= (first if carried else wanted))
            at = wanted - first
            yield row, there, (at >= ends[:, :1]) & (at <= ends[:, 1:])


def _running(place: Ints, runs: Sequence[slice], size: int) -> Ints:
    """Return the number of runs that are under way at each of `size` times.

    A run is under way from its first to its last step.

    `place` has the index of the time of each step, in order within each run. `runs` has the range
    of the steps of each run.
    """
    change = np.zeros(size + 1, np.int64)
    for own in runs:
        change[place[own.start]] += 1
        change[place[own.stop - 1] + 1] -= 1
    return np.cumsum(change)[:-1]


def _since_start(read: Sequence[Time], codes: Ints, run: Ints, runs: int) -> Floats:
    """Return the time of each step since the first step of its run.

    The unit is seconds, or the unit of the times if they are plain numbers. `read` has each time
    once. For each step, `codes` has the index of its time, and `run` the index of its run. `runs`
    is the number of runs.
    """
    times = parse_times(list(map(str, read)), floats)
    value = times.value[codes]
    first = np.full(runs, value.max(), value.dtype)
    np.minimum.at(first, run, value)
    since = (value - first[run]) / (1 if times.clock == "number" else SECOND)
    return np.asarray(np.round(since, DIGITS_OF_TIMES) + 0.0)


DIGITS_OF_TIMES = 9
"""Number of decimals to which times since a start are rounded."""


def _as_read(text: str) -> Time:
    """Return a stored time as it was read: as an integer or a float if possible, else as text."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text
