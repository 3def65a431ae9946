"""Memory of an evaluation, and the division of data into parts under a memory limit.

The constants were measured. They are sums over all processes, in which shared memory counts once.
``tests/benchmarks/partitioned.py`` compares the peak with the limit.
"""

import math
import os
import sys
from collections.abc import Sequence

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import MemoryTooSmallError
from tgospa_eval.formats.guess import FORMAT_OF_SUFFIX
from tgospa_eval.formats.loading import TABLE
from tgospa_eval.quoting import option

MB = 10**6

BASE = {
    "whole": (70 * MB, 170 * MB),
    "whole, drawn": (120 * MB, 195 * MB),
    "main": (65 * MB, 145 * MB),
    "worker": (35 * MB, 70 * MB),
    "report": (125 * MB, 155 * MB),
    "report, drawn": (175 * MB, 215 * MB),
}
"""Bytes of interpreter and libraries in each stage: for CSV files, and for Parquet files.

``whole`` is an evaluation in memory. All other stages are for data in parts: the main process, a
worker (without the memory that it shares with the main process), and the report. ``drawn`` means
that pictures are made."""

BYTES_A_ROW, BYTES_AN_ENTRY, OF_DRAWING = 150, 300, 1.5
"""Bytes of a row in memory, bytes of a near pair of data in parts, and a factor.

With pictures, the bytes of rows in memory are multiplied by the factor."""

BYTES_COMPARED = 40, 280
"""Bytes of a row and bytes of a near pair, until the problem is solved.

These are for an evaluation in memory, when the number of near pairs is known."""

PICTURES, OF_PICTURES = 70 * MB, 400
"""Largest number of bytes of the pictures of trajectories, and their bytes for each row."""

HELPERS = 30 * MB
"""Bytes of the processes that manage workers."""

TABLES = 150 * MB
"""Bytes of a worker that writes tables."""

MIN_SHARE, GOOD_SHARE = 16 * MB, 64 * MB
"""Smallest number of bytes for data: of a single process, and of each of several processes."""

MAX_ROWS = 4_000_000
"""Largest number of rows of a block, even with much memory; a block is a part of the data."""

BYTES_OF_BLOCK = 600
"""Bytes that a worker needs for each row of a block."""

SHARD_ENTRIES = 1_000_000
"""Number of near pairs with which a shard is full: some seconds of work, about 200 MB.

A shard is a group of components that are solved together."""

BYTES_OF_SHARD, BYTES_OF_MARKS, BYTES_KEPT = 400, 100, 60
"""Bytes of a near pair of a shard, and two additions to them.

The first number allows for a shard that becomes twice as large by its last component. The second is
added if some states are not evaluated. The third is added with pictures, for assignments."""

TIP = 1 << 16
"""Bytes at the beginning of a text from which the length of its lines is estimated."""


@dataclass(frozen=True)
class Share:
    """Memory that each process may use if data are evaluated in parts.

    Parameters
    ----------
    jobs : int
        Number of processes; 1 means only the process that starts the work.
    data : int
        Bytes that each process may use for data.
    single : int
        Bytes that a process may use for data while no other process runs.
    fixed : int
        Bytes that the main process and the processes that manage workers need without data.
    tables : bool
        Whether there is memory for processes that write tables.
    entry : int
        Bytes for each near pair of a component.
    """

    jobs: int
    data: int
    single: int
    fixed: int
    tables: bool
    entry: int

    @classmethod
    def of(
        cls, limit: int, jobs: int, formats: Sequence[str], *, pictures: bool, cluster: bool
    ) -> "Share":
        """Divide a limit among as many processes as have enough memory each.

        Parameters
        ----------
        limit : int
            Bytes of all processes together; on a cluster, bytes of each worker.
        jobs : int
            Largest number of processes.
        formats : sequence of str
            Formats of the files.
        pictures : bool
            Whether pictures are made.
        cluster : bool
            Whether the processes are workers of a cluster.

        Raises
        ------
        MemoryTooSmallError
            The limit is too small even for one process.
        """
        main, report = base("main", formats), base(f"report{', drawn' * pictures}", formats)
        entry = BYTES_AN_ENTRY + BYTES_KEPT * pictures
        fixed = main + HELPERS
        for count in range(jobs, 1, -1):
            data = (limit - fixed) // count - base("worker", formats)
            if data >= GOOD_SHARE and limit >= report:
                tables = report + HELPERS + count * TABLES <= limit
                return cls(count, data, limit - fixed, fixed, tables, entry)
        minimum = main + MIN_SHARE if cluster else max(main + MIN_SHARE, report)
        if limit < minimum:
            raise MemoryTooSmallError(
                f"data in parts need at least {size_text(minimum)}: set "
                f"{option('memory', size_text(minimum))}"
            )
        return cls(1, limit - main, limit - main, main, tables=True, entry=entry)

    @property
    def rows(self) -> int:
        """Largest number of rows of a block."""
        return max(min(MAX_ROWS, self.data // BYTES_OF_BLOCK), 1)

    @property
    def entries(self) -> int:
        """Number of near pairs with which a shard of many components is full."""
        return max(min(SHARD_ENTRIES, self.data // BYTES_OF_SHARD), 1)

    def fits_component(self, entries: int, *, masked: bool) -> bool:
        """Return whether each process can hold the largest shard.

        Parameters
        ----------
        entries : int
            Number of near pairs of the largest shard. A shard with more than `Share.entries` near
            pairs is mostly one component.
        masked : bool
            Whether the rules can exclude states from the evaluation.

        Raises
        ------
        MemoryTooSmallError
            The component does not fit even in a single process; the message names the needed size.
        """
        needed = entries * (self.entry + BYTES_OF_MARKS * masked)
        if entries <= self.entries or needed <= self.data:
            return True
        if needed > self.single:
            size = size_text(needed + self.fixed)
            raise MemoryTooSmallError(
                f"one component of nearby objects has {entries:,} near pairs and needs {size} at "
                f"once: set {option('memory', size)}, choose a smaller cutoff, or evaluate parts "
                f"of the recording with {option('time')}"
            )
        return False


def base(stage: str, formats: Sequence[str]) -> int:
    """Return the bytes that a stage (see `BASE`) needs without data, for files of these formats."""
    return BASE[stage]["parquet" in formats]


def size_text(size: float) -> str:
    """Return bytes in the form of an option value, rounded up: 110MB, 2.4GB."""
    tens = math.ceil(size / (10 * MB))
    return f"{10 * tens}MB" if tens < 100 else f"{math.ceil(tens / 10) / 10:g}GB"


def format_of(path: str) -> str | None:
    """Return the format that the suffix of a file name stands for, or None."""
    return FORMAT_OF_SUFFIX.get(os.path.splitext(path.lower())[1])


def bytes_in_memory(paths: Sequence[str], *, pictures: bool) -> float:
    """Return about how many bytes an evaluation in memory needs, before the files are read.

    The result allows for one near pair for every two rows. `check_pairs` uses the true number of
    near pairs, once it is known.
    """
    formats = [format_of(path) or "" for path in paths]
    read = [_rows(path, format) for path, format in zip(paths, formats, strict=True)]
    size, rows = map(sum, zip(*read, strict=True))
    if not pictures:
        return base("whole", formats) + size + BYTES_A_ROW * rows
    drawing = min(PICTURES, OF_PICTURES * rows)
    return base("whole, drawn", formats) + drawing + size + OF_DRAWING * BYTES_A_ROW * rows


def left_of_drawing(limit: int, paths: Sequence[str]) -> int:
    """Return the bytes of `limit` that solving the problem may use, so that pictures fit, too."""
    formats = [format_of(path) or "" for path in paths]
    left = (limit - base("whole, drawn", formats)) / OF_DRAWING
    return max(int(base("whole", formats) + left), 0)


def check_pairs(rows: int, pairs: int, limit: int) -> None:
    """Check that a problem can be solved in memory within the limit.

    Parameters
    ----------
    rows : int
        Number of rows of both sides.
    pairs : int
        Number of near pairs.
    limit : int
        Limit in bytes, including interpreter and libraries.

    Raises
    ------
    MemoryTooSmallError
        The problem needs more than the limit; the message says how much.
    """
    formats = ["parquet" if "pyarrow" in sys.modules else "csv"]
    of_row, of_pair = BYTES_COMPARED
    needed = base("whole", formats) + of_row * rows + of_pair * pairs
    if needed > limit:
        raise MemoryTooSmallError(
            f"{pairs:,} near pairs of objects need about {size_text(needed)} of memory, more than "
            f"{option('memory')} allows; allow more, or choose a smaller cutoff"
        )


def _rows(path: str, format: str) -> tuple[int, float]:
    """Return the bytes that the text of a file needs, and its approximate number of rows."""
    if format == "parquet":
        try:
            import pyarrow.parquet as pq  # lazy: for large files only

            metadata = pq.read_metadata(path)
        except (ModuleNotFoundError, OSError, ValueError):
            return 0, 0.0  # the reader of the file reports the error
        return 0, float(metadata.num_rows)
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        tip = file.read(TIP)
    if b"\0" in tip:
        return TABLE * size, 0.0
    return size, size * (tip.count(b"\n") + 1) / max(len(tip), 1)
