"""Parquet tables with the columns of the CSV files; needs the extra ``parquet``."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.room import TABLE, check_room
from tgospa_eval.formats.rows import Rows

if TYPE_CHECKING:
    import pyarrow as pa


def read_parquet(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a Parquet file, the same in either role; only the columns in use are read.

    Raises
    ------
    InputError
        The file is no Parquet, or see `formats.read`. Rows count from 0.
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # here: the extra may be missing, and other formats do without
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        raise ConfigError(
            f"{path}: Parquet files need the extra parquet: {install('parquet')}"
        ) from None
    from tgospa_eval.formats.arrow import arrow_rows, damaged

    if not data:
        raise InputError(
            f"{path}: the file is empty; a set without objects has a schema and no rows"
        )
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        schema = file.schema_arrow
    except (pa.ArrowException, OSError, ValueError) as error:
        raise damaged(path, "Parquet", error) from None

    def read(subset: Sequence[str]) -> "pa.Table":
        rows = file.metadata.num_rows
        what = f"{rows:,} rows of {len(subset)} columns"
        check_room(path, TABLE * 8 * rows * len(subset), len(data), options.max_input, what)
        return file.read(columns=subset)

    return arrow_rows(path, "Parquet", schema, read, options)
