"""Parquet tables with the columns of the CSV files; needs the extra ``parquet``."""

from dataclasses import replace
from typing import TYPE_CHECKING

from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.assemble import Rows
from tgospa_eval.formats.columns import find_roles
from tgospa_eval.formats.frames import frame_rows

if TYPE_CHECKING:
    from tgospa_eval.formats import ReadOptions


def read_parquet(path: str, data: bytes, options: "ReadOptions", role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a Parquet file, the same in either role; only the columns in use are read.

    Raises
    ------
    InputError
        The file is no Parquet, or see `tgospa_eval.formats.read`. Rows count from 0.
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # here: the extra may be missing, and other formats do without
        import pyarrow.parquet as pq
    except ImportError:
        raise ConfigError(
            f"{path}: Parquet files need the extra parquet: pip install 'tgospa-eval[parquet]'"
        ) from None

    if not data:
        raise InputError(
            f"{path}: the file is empty; a set without objects has a schema and no rows"
        )
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        names = list(file.schema_arrow.names)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{path}: no readable Parquet file: {_first_line(error)}") from None
    roles = find_roles(names, options, path)
    used = {roles.id, roles.time, *roles.numbers}
    if roles.klass is not None:
        used.add(roles.klass)
    subset = [names[column] for column in sorted(used)]
    try:
        table = file.read(columns=subset).select(subset)
        frame = table.to_pandas(split_blocks=True, self_destruct=True, ignore_metadata=True)
    except (pa.ArrowException, OSError, ValueError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: no readable Parquet file: {_first_line(error)}") from None
    del table
    found = replace(find_roles(subset, options, path), unused=roles.unused)
    return frame_rows(frame, found, path)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
