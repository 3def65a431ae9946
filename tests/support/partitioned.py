"""A result in memory as that of partitioned data: its tables as files, made of shards."""

from pathlib import Path

import numpy as np

from tgospa_eval import Result
from tgospa_eval.partitioned.shards import ASSIGNED_PAIR
from tgospa_eval.partitioned.tables import write_tables
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.solution import PerTrack
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import Columns, Costs, Labels

SWITCHED = np.dtype(
    [("step", "<i4"), ("truth", "<i4"), ("before", "<i4"), ("after", "<i4"), ("variation", "<f8")]
)


def partitioned(result: Result, work: Path, shards: int = 3) -> PartitionedResult:
    """The same with its tables in a folder of files; truths are dealt out to shards."""
    proof, labels = result.proof, result.labels
    costs = Costs(parameters=proof.parameters, bounds=proof.bounds, breakdown=proof.breakdown)
    names = {name: np.array(getattr(labels, name)) for name in ("times", "truths", "estimates")}
    folders = []
    for shard in range(shards):
        folders.append(work / f"shard-{shard}")
        folders[-1].mkdir(parents=True)
        for name, table in (
            ("assigned", _assigned(result, proof.parameters)),
            ("switched", _switched(result, proof.parameters)),
        ):
            np.save(folders[-1] / f"{name}.npy", table[table["truth"] % shards == shard])
    tables = write_tables(
        str(work / "tables"),
        names,
        costs,
        (
            _sums(result.table("per_truth"), "missed", result.scale),
            _sums(result.table("per_estimate"), "false", result.scale),
        ),
        folders,
        assigned=[folder / "assigned.npy" for folder in folders],
        further={name: {} for name in ("step", "truth", "estimate")},
    )
    return PartitionedResult(
        notices=result.notices,
        proof=costs,
        labels=Labels(times=labels.times, truths=[], estimates=[], unit=labels.unit),
        gap=result.gap,
        settings=result.settings,
        solver=result.solver,
        timings=result.timings,
        input=result.input,
        version=result.version,
        warnings=result.warnings,
        files=result.files,
        evaluated_on=result.evaluated_on,
        sizes=result.sizes,
        objects=result.objects,
        tables=tables,
    )


def _numbers(column: list[object], names: list[str] | list[object]) -> list[int]:
    number = {name: k for k, name in enumerate(names)} | {None: -1}
    return [number[name] for name in column]


def _assigned(result: Result, parameters: Parameters) -> np.ndarray:
    table, labels = result.table("assignments"), result.labels
    rows = np.zeros(len(table["t"]), ASSIGNED_PAIR)
    rows["step"] = _numbers(table["t"], list(labels.times))
    rows["truth"] = _numbers(table["truth"], labels.truths)
    rows["estimate"] = _numbers(table["estimate"], labels.estimates)
    rows["weight"] = table["weight"]
    rows["cost"] = np.array(table["cost"]) / result.scale / rows["weight"]
    return rows


def _switched(result: Result, parameters: Parameters) -> np.ndarray:
    table, labels = result.table("switches"), result.labels
    rows = np.empty(len(table["t"]), SWITCHED)
    rows["step"] = _numbers(table["t"], list(labels.times))
    rows["truth"] = _numbers(table["truth"], labels.truths)
    rows["before"] = _numbers(table["from"], labels.estimates)
    rows["after"] = _numbers(table["to"], labels.estimates)
    rows["variation"] = 2 * np.array(table["mass"])
    return rows


def _sums(table: Columns, kind: str, scale: float) -> tuple[np.ndarray, PerTrack]:
    return (
        np.array(table["steps"], np.int64),
        PerTrack(
            localisation=np.array(table["localisation"], float) / scale,
            unassigned=np.array(table[kind], float) / scale,
            switch=np.array(table["switch"], float) / scale,
            unassigned_count=np.array(table[f"{kind}_count"], float),
            switch_count=np.array(table["switch_count"], float),
        ),
    )
