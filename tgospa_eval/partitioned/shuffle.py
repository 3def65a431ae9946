"""Entries of blocks of time to shards of components: each shard reads its stretch of each block."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.share import ENTRY
from tgospa_eval.partitioned.tasks import writing
from tgospa_eval.problem.problem import Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class Sort:
    """The task to sort the entries of a block by shard.

    Parameters
    ----------
    output : str
        The folder that is written.
    scanned : str
        That of the block.
    numbers : pair of int arrays
        Global numbers of its truths and estimates.
    shard : (k,) int array
        Shard of each of its truths.
    long : (N,) bool array
        Which shards are a long component, with a file of its own; these are the first.
    """

    output: str
    scanned: str
    numbers: tuple[Ints, Ints]
    shard: Ints
    long: NDArray[np.bool_]


def sort_entries(task: Sort) -> None:
    """Write the entries of a block with global numbers, by shard and then by time."""
    entry = np.load(Path(task.scanned) / "entries.npy")
    shard = task.shard[entry["truth"]]
    entry["truth"] = task.numbers[0][entry["truth"]]
    entry["estimate"] = task.numbers[1][entry["estimate"]]
    # Blocks number their tracks in the order of the whole, so entries of a step stay sorted.
    order = np.argsort(shard, kind="stable")
    first = np.zeros(len(task.long) + 1, np.int64)
    np.cumsum(np.bincount(shard, minlength=len(task.long)), out=first[1:])
    entry = entry[order]
    others = int(first[np.count_nonzero(task.long)])  # long ones are the first
    with writing(task.output) as folder:
        folder.mkdir()
        np.save(folder / "first.npy", first - others)
        for number in np.flatnonzero(task.long).tolist():
            np.save(folder / long_name(number), entry[first[number] : first[number + 1]])
        np.save(folder / "entries.npy", entry[others:])


def long_name(number: int) -> str:
    """The file of the entries of a long component in the folder of a block."""
    return f"long-{number:06d}.npy"


def entries_of(folders: tuple[str, ...], shard: int) -> NDArray[np.void]:
    """All entries of a shard, by time."""
    parts = [stretch(folder, shard) for folder in folders]
    return np.concatenate(parts) if parts else np.zeros(0, ENTRY)


def stretch(folder: str, shard: int) -> NDArray[np.void]:
    """Those of one block."""
    place = Path(folder)
    first = np.load(place / "first.npy", mmap_mode="r")
    low, high = int(first[shard]), int(first[shard + 1])
    if low == high:
        return np.zeros(0, ENTRY)
    found = np.load(place / "entries.npy", mmap_mode="r")[low:high]
    return np.asarray(found)
