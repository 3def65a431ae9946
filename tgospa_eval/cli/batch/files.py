"""What a batch writes beside its rows: the page, curves as a table, pictures."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from tgospa_eval import plots
from tgospa_eval.batches.store import Store
from tgospa_eval.cli.evaluate.folder import wanted_pictures
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import write_output
from tgospa_eval.common.manifest import read_manifest, unchanged
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.batch_records import BatchTables
from tgospa_eval.reports.batch_slices import slices_of_groups
from tgospa_eval.reports.batch_view import BatchView
from tgospa_eval.reports.curves import curves_csv
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.folders import BATCH, Files
from tgospa_eval.reports.proofs import folder_name
from tgospa_eval.text import as_unicode

if TYPE_CHECKING:
    import pandas as pd

REPORT_FOLDER = "reports"


def folder_of(store: str, labels: Mapping[str, str], options: Mapping[str, str]) -> str:
    """Where the result folder of a job is, of labels and options of its own."""
    parts = [folder_name(as_unicode(value)) for value in labels.values()]
    parts += [f"{key}={folder_name(value)}" for key, value in options.items()]
    return os.path.join(store, REPORT_FOLDER, *parts)


def write_batch(store: Store, tables: BatchTables, output: OutputOptions, *, lenient: bool) -> None:
    """Write the files of a batch to the folder of ``-o``.

    Parameters
    ----------
    store : Store
        Has the settings, and the reports of jobs.
    tables : BatchTables
        What is shown.
    output : OutputOptions
        Where to write, and what to print.
    lenient : bool
        Whether files of others there are told and no error: the rows are stored in any case.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    if output.output is None or not len(tables.rows):
        return
    wanted = wanted_pictures(output)
    if wanted is not None and not plots.available():
        wanted = None
        if not output.quiet:
            print_notice(plots.MISSING)
    view = BatchView(
        tables=tables,
        settings=store.settings(),
        link=_link(store, output.output, tables.rows),
    )

    def make(notify: Callable[[str, float], None]) -> Files:
        from tgospa_eval.reports.batch_page import batch_page  # here: only where it is written

        notify("report.html", 0.0)
        files: dict[str, str | bytes] = {"report.html": batch_page(view)}
        if tables.curves:
            files["curve.csv"] = curves_csv(tables.curves)
        if tables.slices:
            files["slices.csv"] = csv_text(slices_of_groups(tables))
        if wanted is None:
            return files
        from tgospa_eval.plots.batch import batch_pictures  # here: it draws

        return files | batch_pictures(view, wanted, notify)

    try:
        write_output(output, BATCH, make)
    except ConfigError as error:
        if not lenient:
            raise
        print_notice(f"the page is not written: {error}")


def is_written(store: Store) -> bool:
    """Whether the folder of a store has its page and pictures."""
    listed = read_manifest(store.folder, BATCH.name) or ()
    return bool(listed) and unchanged(store.folder, listed) == {entry.name for entry in listed}


def _link(store: Store, target: str, rows: "pd.DataFrame") -> "Callable[[pd.Series[Any]], str]":
    """Where the report of a job is, seen from the folder of the page; nothing if there is none."""
    names = [name.removeprefix("label.") for name in rows.columns if name.startswith("label.")]

    def link(row: "pd.Series[Any]") -> str:
        labels = {name: str(row[f"label.{name}"]) for name in names}
        folder = folder_of(str(store.folder), labels, json.loads(str(row["options"])))
        found = Path(folder, "report.html")
        if not found.is_file():
            return ""
        return quote(os.fsencode(Path(os.path.relpath(found, target)).as_posix()))

    return link
