"""The result as files: JSON, CSV tables, the report; whole or absent."""

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tgospa_eval.common.files import named, patience
from tgospa_eval.common.manifest import unique
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.escape import csv_cell
from tgospa_eval.results.explanation import Explanation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import Columns
from tgospa_eval.results.slices import slices_columns
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from tgospa_eval.reports.drawn import Drawn


ENDS_OF_LINES = "\r\n"
"""Characters of which a text in a CSV file is quoted that has one."""


def csv_text(table: Columns) -> str:
    """A table as CSV; None is an empty field, numbers are full doubles, no text is a formula."""
    columns = [_cells(column) for column in table.values()]
    text = io.StringIO(newline="")
    _write(text, table, columns)
    written = text.getvalue()
    if written.count(ENDS_OF_LINES) == 1 + len(columns[0] if columns else ()):
        return written.replace(ENDS_OF_LINES, "\n")
    lines = _Lines()  # a text has such an end inside
    _write(lines, table, columns)
    return "".join(lines)


def _write(target: "io.StringIO | _Lines", table: Columns, columns: list[Sequence[object]]) -> None:
    writer = csv.writer(target, lineterminator=ENDS_OF_LINES)
    writer.writerow(map(csv_cell, table))
    writer.writerows(zip(*columns, strict=True))


def _cells(column: Sequence[object]) -> Sequence[object]:
    """A column of a table: each text is looked at once, numbers not at all."""
    if not any(issubclass(kind, str) for kind in set(map(type, column))):
        return column
    cells = {text: csv_cell(text) for text in set(column) if isinstance(text, str)}
    if all(cell is text for text, cell in cells.items()):
        return column
    return [cells[value] if isinstance(value, str) else value for value in column]


class _Lines(list[str]):
    """Lines as a writer makes them, which quotes no ends of lines but those that it writes."""

    def write(self, line: str) -> None:
        """Add one with an end of our kind."""
        self.append(f"{line[: -len(ENDS_OF_LINES)]}\n")


def result_texts(
    result: Summary, names: tuple[str, str] = ("truth", "estimate"), drawn: "Drawn | None" = None
) -> dict[str, str | Path]:
    """The files of a result folder: texts by name, and files that are taken as they are.

    Parameters
    ----------
    result : Summary
        What they show.
    names : pair of str
        What truth and estimate are called in the report.
    drawn : Drawn, optional
        What `page_data.document` makes of the result, where it is known.
    """
    from tgospa_eval.reports.html import page  # here: for folders only

    texts: dict[str, str | Path] = {
        "result.json": result.to_json(),
        "timings.csv": csv_text(_timings(result)),
        **_tables(result),
    }
    if result.traced is not None:
        texts["curve.csv"] = csv_text(result.curve_table())
    if result.slid is not None:
        texts["windows.csv"] = csv_text(result.windows_table())
    if result.sliced:
        texts["slices.csv"] = csv_text(slices_columns(result.sliced))
    if result.per_class_table():
        texts["per_class.csv"] = csv_text(result.per_class_table())
    if isinstance(result.explained, Explanation):
        texts["explanation.json"] = result.explained.to_json()
        texts["explanation.csv"] = csv_text(result.explained.columns())
    return texts | {"report.html": page(result, names, drawn)}


def _tables(result: Summary) -> dict[str, str | Path]:
    """The tables that every result has."""
    if isinstance(result, PartitionedResult):
        return {**result.tables.names()}
    return {
        "per_step.csv": csv_text(result.per_step_table()),
        "assignments.csv": csv_text(result.assignments_table()),
        "switches.csv": csv_text(result.switches_table()),
        "per_truth.csv": csv_text(result.per_truth_table()),
        "per_estimate.csv": csv_text(result.per_estimate_table()),
    }


def check_file(path: str, *, force: bool, option: str) -> None:
    """Whether a file may be written there.

    Raises
    ------
    ConfigError
        A folder or, without `force`, a file of the name is there, or its folder is not.
    """
    with named(f"{option} {path}", ConfigError, "cannot be written"):
        if Path(path).is_dir():
            raise ConfigError(f"{option} {path}: is a folder; name a file")
        if not force and Path(path).exists():
            raise ConfigError(f"{option} {path}: exists; name another file, or --force")
        if not Path(path).absolute().parent.is_dir():
            raise ConfigError(f"{option} {path}: there is no such folder; make it first")


def write_file(path: str, data: str | bytes, option: str) -> None:
    """Write a file beside first, then rename it; `option` is for messages.

    Raises
    ------
    ConfigError
        The path is empty, is a folder, or the system refuses to write it.
    """
    if not path:
        raise ConfigError(f"{option} is empty; name a file")
    content = data.encode() if isinstance(data, str) else data
    with named(f"{option} {path}", ConfigError, "cannot be written"):
        target = Path(os.path.realpath(path))  # what a link points to is replaced, not the link
        beside = target.with_name(unique())
        if target.is_dir():
            raise ConfigError(f"{option} {path}: is a folder; name a file")
        if target.exists() and not target.is_file():  # a device or a pipe: nothing to rename over
            with patience(path, "a reader of"):
                target.write_bytes(content)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            # Not by tempfile, whose files nobody else may read: CI has many users.
            with beside.open("xb") as file:
                file.write(content)
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)


def _timings(result: Summary) -> Columns:
    flat = {k: v for k, v in result.timings.items() if k not in ("solve", "nanoseconds_per_state")}
    flat |= {f"solve/{name}": seconds for name, seconds in result.timings["solve"].items()}
    return {"stage": list(flat), "seconds": list(flat.values())}
