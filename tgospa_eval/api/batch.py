"""``batch`` of Python: the same store and tables as the command makes."""

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.request import Request
from tgospa_eval.cli.batch.run import BatchOptions, finish_batch, work_batch
from tgospa_eval.cli.shared.options import typed_options
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import in_python, spoken_in_python
from tgospa_eval.reports.batch import BATCH_REPORTS
from tgospa_eval.reports.batch_records import BatchTables

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.reports.curves import BandKind


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Batch:
    """What `batch` found; printed it is the table of the command.

    Parameters
    ----------
    tables : BatchTables
        Sums of groups, and their order.
    faults : tuple of str
        What is wrong with jobs, a line for each.
    """

    tables: BatchTables
    faults: tuple[str, ...]

    @property
    def rows(self) -> "pd.DataFrame":
        """A row for each job, with its labels, value, bounds and parts."""
        return self.tables.rows

    @property
    def groups(self) -> "pd.DataFrame":
        """A row for each group, costs added."""
        return self.tables.groups

    def __str__(self) -> str:
        return BATCH_REPORTS["table"](self.tables).rstrip("\n")

    __repr__ = __str__


@spoken_in_python(reads=False)
def batch(
    *paths: "str | os.PathLike[str]",
    output: "str | os.PathLike[str]",
    truth: str | None = None,
    estimate: str | None = None,
    layout: str | None = None,
    seqmap: "str | os.PathLike[str] | None" = None,
    by: str | Iterable[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    allow_missing: bool = False,
    retry_failed: bool = False,
    reports: bool = False,
    proof: bool = False,
    per_step: bool = False,
    curve: bool = False,
    with_: str | Iterable[str] = (),
    slices: str | Iterable[str] = (),
    mean_of_roots: bool = False,
    band: "BandKind | None" = None,
    force: bool = False,
    **options: Any,
) -> Batch:
    """Evaluate many pairs of files, as ``tgospa-eval batch`` does; what is done is not done again.

    Parameters
    ----------
    *paths : str or path
        A manifest; or the folders of truth and trackers, with `layout`.
    output : str or path
        The store.
    truth, estimate : str, optional
        Patterns with fields in the place of `paths`: ``"gt/{run}.csv"``.
    layout : {"motchallenge", "kitti"}, optional
        How the two folders are laid out.
    seqmap : str or path, optional
        Of a layout only the sequences in this file.
    by : str or iterable of str
        Labels by which tables add up; the first by default.
    workers : int, optional
        Processes; as many as there are cores by default.
    scheduler : str, optional
        Address of a Dask cluster to use instead.
    allow_missing, retry_failed, reports, proof, per_step, curve, mean_of_roots, force : bool
        As the options of the command.
    band : {"interval", "bootstrap", "percentiles", "deviation"}, optional
        Bands around the curves of `per_step`.
    with_, slices : str or iterable of str
        As for `evaluate`.
    **options
        Of the evaluations, by the names of the options: ``cutoff``, ``switch_penalty``,
        ``distance``, ``columns``, ``time``, ``class`` ...

    Returns
    -------
    Batch
        `Batch.rows` and `Batch.groups` are DataFrames.

    Raises
    ------
    ConfigError, InputError
        An option or the manifest is wrong, or files are missing; nothing is begun then.
    """
    asked = {name.rstrip("_").replace("_", "-"): value for name, value in options.items()}
    chosen = Request.of(
        {
            **typed_options(asked, "batch"),
            "summed": True,
            "curve": curve,
            "with_": ",".join(_each(with_)) or None,
            "slices": _each(slices),
        }
    )
    jobs = BatchOptions(
        truth=truth,
        estimate=estimate,
        layout=layout,
        seqmap=None if seqmap is None else os.fspath(seqmap),
        by=_each(by),
        workers=workers,
        scheduler=scheduler,
        allow_missing=allow_missing,
        retry_failed=retry_failed,
        reports=reports,
        proof=proof,
        per_step=per_step,
        mean_of_roots=mean_of_roots,
        band=band,
    )
    target = OutputOptions(output=os.fspath(output), force=force, quiet=True)
    worked = work_batch(tuple(os.fspath(path) for path in paths), jobs, chosen, target)
    faults, _ = finish_batch(worked, jobs, target)
    return Batch(tables=worked.tables, faults=tuple(map(in_python, faults)))


def _each(given: str | Iterable[str]) -> tuple[str, ...]:
    """A text, or several."""
    return (given,) if isinstance(given, str) else tuple(given)
