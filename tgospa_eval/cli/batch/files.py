"""What a batch writes beside its rows: curves as a table."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from tgospa_eval.batch.curves import rms_curves
from tgospa_eval.batch.store import Store
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import Files, write_output
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.curves import curves_csv
from tgospa_eval.reports.folders import BATCH

if TYPE_CHECKING:
    import pandas as pd


def write_batch(
    store: Store, rows: "pd.DataFrame", by: list[str], output: OutputOptions, *, lenient: bool
) -> None:
    """Write the files of a batch to the folder of ``-o``.

    Parameters
    ----------
    store : Store
        Has the steps of the jobs.
    rows : DataFrame
        Of the jobs that are shown.
    by : list of str
        Labels of the groups.
    output : OutputOptions
        Where to write, and what to print.
    lenient : bool
        Whether files of others there are told and no error: the rows are stored in any case.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    curves = rms_curves(rows, store.steps(rows), by)
    if not curves:
        return

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("curve.csv", 0.0)
        return {"curve.csv": curves_csv(curves)}

    try:
        write_output(output, BATCH, make)
    except ConfigError as error:
        if not lenient:
            raise
        print_notice(f"the curves are not written: {error}")
