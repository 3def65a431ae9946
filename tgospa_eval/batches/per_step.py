"""Costs of the steps of jobs: what a worker hands over, what is stored, what is read again.

A table in parts beside those of the jobs. Its rows belong to the row of a job with the same `key`
and `finished`; others are of a run that was killed in between, or of an older one, and do not
count.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.files import named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

STEP_FOLDER = "per_step"

STEPS = "per_step"
"""Where the row of a job has a `JobSteps` on its way from a worker to the store."""

STORED_STEPS, STORED_CURVE = "per_step.rows", "per_step.curve"
"""Columns of the row of a job: how many rows of steps it has, and whether with the curve."""

COST_COLUMNS = ("total", *PARTS)
"""Columns of costs."""

CURVE_COLUMNS = ("tgospa", "lower_bound", "upper_bound")


@dataclass(frozen=True, kw_only=True, eq=False)
class JobSteps:
    """Of one job, T steps.

    Parameters
    ----------
    times : list of str
        Steps as they were read.
    steps : (T,) int array
        How many of the horizon are no later than each.
    parts : (4, T) float array
        Localisation, missed, false and switch cost, in state units to the power p.
    curve : (3, T) float array, optional
        Value of the steps up to each by themselves, and its bounds, as in `Result.curve`.
    """

    times: list[str]
    steps: Ints
    parts: Floats
    curve: Floats | None = None

    @classmethod
    def of(cls, result: Summary) -> "JobSteps":
        """Those of a result."""
        table, curve = result.table("per_step"), result.table("curve")
        return cls(
            times=list(map(str, table["t"])),
            steps=result.judged_on.so_far.astype(np.int32),
            parts=np.array([table[name] for name in PARTS]),
            curve=np.array([curve[name] for name in CURVE_COLUMNS]) if curve else None,
        )

    def __len__(self) -> int:
        return len(self.times)

    @property
    def stored(self) -> dict[str, object]:
        """What the row of the job says of it."""
        return {STORED_STEPS: len(self), STORED_CURVE: self.curve is not None}


def step_table(rows: Sequence[Mapping[str, Any]]) -> "pa.Table | None":
    """The steps of all jobs that have some, one job below the other."""
    import pyarrow as pa

    having = [(row, row[STEPS]) for row in rows if len(row.get(STEPS) or ())]
    if not having:
        return None
    lengths = [len(steps) for _, steps in having]
    which = np.repeat(np.arange(len(having), dtype=np.int32), lengths)
    parts = np.concatenate([steps.parts for _, steps in having], axis=1)
    curves = [
        np.full((3, len(steps)), np.nan) if steps.curve is None else steps.curve
        for _, steps in having
    ]
    curve = np.concatenate(curves, axis=1)
    columns: dict[str, Any] = {
        "key": pa.DictionaryArray.from_arrays(which, [row["key"] for row, _ in having]),
        "finished": np.repeat(np.array([row["finished"] for row, _ in having]), lengths),
        "step": np.concatenate([np.arange(1, size + 1, dtype=np.int32) for size in lengths]),
        "t": pa.array([t for _, steps in having for t in steps.times], pa.string()),
        "steps": np.concatenate([one.steps for _, one in having]),
        **dict(zip(PARTS, parts, strict=True)),
        "total": parts.sum(axis=0),
        **{
            f"curve.{name}": pa.array(values, from_pandas=True)
            for name, values in zip(CURVE_COLUMNS, curve, strict=True)
        },
    }
    return pa.table(columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSteps:
    """Steps of several jobs, N in all.

    Parameters
    ----------
    job : (N,) int array
        Whose each is: the number of its row.
    steps : (N,) int array
        How many of the horizon are no later.
    times : (N,) array of str
        As read.
    costs : (5, N) float array
        The whole, and its parts.
    curve : (3, N) float array
        As of `JobSteps`; NaN where it was not asked for.
    """

    job: Ints
    steps: Ints
    times: "np.ndarray[Any, Any]"
    costs: Floats
    curve: Floats


def read_steps(folder: Path, rows: "pd.DataFrame") -> StoredSteps | None:
    """The steps of the jobs of these rows; None if none has any.

    Raises
    ------
    InputError
        A part is damaged.
    """
    parts = list(_parts(folder, rows))
    if not parts:
        return None
    joined = {name: np.concatenate([np.asarray(part[name]) for part in parts]) for name in parts[0]}
    return StoredSteps(
        job=joined["job"],
        steps=joined["steps"],
        times=joined["t"],
        costs=np.array([joined[name] for name in COST_COLUMNS]),
        curve=np.array([joined[f"curve.{name}"] for name in CURVE_COLUMNS]),
    )


def _parts(folder: Path, rows: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    import pandas as pd
    import pyarrow.parquet as pq

    if STORED_STEPS not in rows:
        return
    wanted = rows[rows[STORED_STEPS] > 0]
    known = pd.Series(wanted.index, index=pd.MultiIndex.from_frame(wanted[["key", "finished"]]))
    columns = ["key", "finished", "step", "t", "steps", *COST_COLUMNS]
    columns += [f"curve.{name}" for name in CURVE_COLUMNS]
    for path in sorted(folder.glob("part-*.parquet")):
        with named(str(path), InputError):
            table = pq.read_table(path, columns=columns).to_pandas()
        # A job is looked up once, where it begins.
        first = table["step"] == 1
        jobs = known.reindex(
            pd.MultiIndex.from_frame(table.loc[first, ["key", "finished"]].astype({"key": str}))
        )
        table["job"] = jobs.to_numpy()[np.cumsum(first.to_numpy()) - 1]
        kept = table[table["job"].notna()].astype({"job": np.int64})
        if len(kept):
            yield {name: kept[name].to_numpy() for name in kept.columns if name != "key"}
