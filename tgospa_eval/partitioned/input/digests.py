"""A digest of what takes part that is the same however the rows are partitioned."""

import hashlib
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.tracks.trajectories import TimeArray, Trajectories

MODULUS = 1 << 256
"""Digests of steps are added up modulo this."""

ROWS_DIGESTED = 1 << 18
"""Rows that are laid out for their digests at a time."""


def block_digest(block: Trajectories) -> int:
    """Sum of the SHA-256 of the steps of a block, whole steps with all their rows.

    Sums of blocks that share no step add up: they do not depend on where a side is cut, nor on the
    order of the blocks. They tell data apart that differ by accident; somebody who looks for other
    data with the same sum may find some.
    """
    names = [hashlib.sha256(name.encode("utf-8", "surrogatepass")) for name in block.ids.tolist()]
    ids = np.frombuffer(b"".join(sha.digest()[:16] for sha in names), np.uint64).reshape(-1, 2)
    moments = _bits(block.times)
    begins = np.flatnonzero(np.append(True, block.step[1:] > block.step[:-1])[: len(block.step)])
    ends = np.append(begins[1:], len(block.step))
    total = 0
    first = 0
    while first < len(begins):
        last = int(np.searchsorted(ends, begins[first] + ROWS_DIGESTED, side="right"))
        last = max(last, first + 1)
        row, stop = int(begins[first]), int(ends[last - 1])
        columns = [moments[block.step[row:stop], None], ids[block.track[row:stop]]]
        columns.append(np.ascontiguousarray(block.state[row:stop]).view(np.uint64))
        if block.covariance is not None:
            columns.append(np.ascontiguousarray(block.covariance[row:stop]).view(np.uint64))
        table = np.concatenate(columns, axis=1)
        content = table.reshape(-1)
        places = (np.append(begins[first], ends[first:last]) - row) * table.shape[1]
        for begin, end in pairwise(places.tolist()):
            total += int.from_bytes(hashlib.sha256(content[begin:end].data).digest(), "little")
        first = last
    return total % MODULUS


def combined_digest(columns: tuple[str, ...], clock: str, blocks: Iterable[int]) -> str:
    """SHA-256 of a side in hexadecimal, of the digests of its blocks."""
    sha = hashlib.sha256(repr((columns, clock)).encode())
    sha.update((sum(blocks) % MODULUS).to_bytes(32, "little"))
    return sha.hexdigest()


def _bits(times: TimeArray) -> NDArray[np.uint64]:
    """Times as 64 bits each: whole ones as integers, for the stamps 0 and 0.0 are the same."""
    if times.dtype.kind == "i":
        return times.astype(np.int64).view(np.uint64)
    answer = times.astype(np.float64).view(np.uint64).copy()
    whole = (np.floor(times) == times) & (np.abs(times) < 2.0**63)
    answer[whole] = times[whole].astype(np.int64).view(np.uint64)
    return answer
