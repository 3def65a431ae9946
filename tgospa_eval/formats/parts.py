"""Tables too large for memory: a folder of Parquet files, written a row group after another."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow.parquet as pq


def check_parquet() -> None:
    """Whether Parquet files can be written.

    Raises
    ------
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow.parquet  # noqa: F401  (here: the extra may be missing)
    except ModuleNotFoundError:
        raise ConfigError(f"Parquet files need the extra parquet: {install('parquet')}") from None


def part_name(number: int) -> str:
    """Name of a part; names sort as numbers do."""
    return f"part-{number:05d}.parquet"


class PartWriter:
    """Writes parts one after another; at the end of a block the last one is complete.

    Parameters
    ----------
    folder : Path
        Which is there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.count = 0
        self._part: pq.ParquetWriter | None = None
        self._file: BinaryIO

    def __enter__(self) -> "PartWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.end_part()

    def add(self, columns: Mapping[str, NDArray[np.generic]]) -> None:
        """Write rows as a row group of the part."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table(columns)
        if self._part is None:
            # A file of Python's, whose errors are those of the system.
            self._file = (self.folder / part_name(self.count)).open("wb")
            # Times and ids are few in a row group, states are all different.
            few = [name for name in columns if columns[name].dtype.kind == "i"]
            self._part = pq.ParquetWriter(
                self._file,
                table.schema,
                compression="zstd",
                compression_level=1,
                use_dictionary=few,
            )
            self.count += 1
        self._part.write_table(table, row_group_size=max(len(table), 1))

    def end_part(self) -> None:
        """Close the part; what is added next is in another."""
        if self._part is not None:
            part, self._part = self._part, None
            with self._file:
                part.close()
