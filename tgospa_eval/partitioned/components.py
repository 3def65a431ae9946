"""Tracks of all blocks: global numbers, components, and the shard of each."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints, Mask, in_batches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.partitioned.scan import Scanned
from tgospa_eval.problem.states import connected_components

SHARD_ENTRIES = 1_000_000
"""Entries of a shard of many components: some seconds of work in some 300 MB. Of the data alone,
so that results do not depend on the machine."""


FEW_PAIRS = 1 << 20
"""Pairs of blocks wait until they are so many: each batch of them is a pass over all tracks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """The tracks of one side.

    Parameters
    ----------
    ids : (k,) array of str
        In the order in which reading one file numbers them.
    rows, judged : (k,) int arrays
        How many rows they have, and how many of these are judged.
    numbers : tuple of int arrays
        Of each block the numbers of its tracks.
    """

    ids: NDArray[np.str_]
    rows: Ints
    judged: Ints
    numbers: tuple[Ints, ...]


def number_tracks(blocks: Sequence[Scanned], side: int) -> Tracks:
    """The tracks of a side over all blocks, in natural order of their ids."""
    parts = [block.ids[side] for block in blocks]
    ids, found = np.unique(np.concatenate(parts or [np.zeros(0, "U1")]), return_inverse=True)
    order = _natural_order(ids)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    number = rank[found]
    rows, unjudged = (
        np.bincount(
            number, np.concatenate(counts or [np.zeros(0, np.int64)]), minlength=len(ids)
        ).astype(np.int64)
        for counts in (
            [block.rows[side] for block in blocks],
            [block.unjudged_rows[side] for block in blocks],
        )
    )
    ends = np.cumsum([0, *map(len, parts)]).tolist()
    numbers = tuple(number[slice(*span)] for span in itertools.pairwise(ends))
    return Tracks(ids=ids[order], rows=rows, judged=rows - unjudged, numbers=numbers)


def _natural_order(ids: NDArray[np.str_]) -> Ints:
    """Order of distinct ids, 2 before 10; plain numbers need no look at each."""
    try:
        numbers = ids.astype(np.int64)
    except (ValueError, OverflowError):
        numbers = np.zeros(0, np.int64)
    if len(numbers) and (numbers >= 0).all() and (numbers.astype(np.str_) == ids).all():
        return np.argsort(numbers)
    texts = ids.tolist()
    return np.array(sorted(range(len(texts)), key=lambda k: natural(texts[k])), np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shards:
    """Which components are solved together.

    Parameters
    ----------
    of_truth : (m,) int array
        Shard of each truth, -1 for those without a near pair.
    entries : (N,) int array
        Entries of each shard.
    components, pairs : int
        How many there are in all.
    """

    of_truth: Ints
    entries: Ints
    components: int
    pairs: int


def make_shards(blocks: Sequence[Scanned], truths: Tracks, estimates: Tracks) -> Shards:
    """Components in the order of their first truths, in shards of some `SHARD_ENTRIES`."""
    m, n = len(truths.ids), len(estimates.ids)
    several = [_in_several(side) for side in (truths, estimates)]
    root: Ints = np.arange(m + n, dtype=np.int32)
    by_truth = np.zeros(m, np.int64)
    once, often = 0, np.zeros(0, np.int64)
    near = _near_tracks(blocks, truths, estimates)
    for batch in in_batches(near, lambda pairs: len(pairs[0]), FEW_PAIRS):
        truth, estimate, entries = (np.concatenate(column) for column in zip(*batch, strict=True))
        by_truth += np.bincount(truth, entries, minlength=m).astype(np.int64)
        # The root of a component is its least node, also of those made of components.
        root = connected_components(root[truth], root[estimate + m], m + n)[root]
        again = several[0][truth] & several[1][estimate]
        once += len(again) - int(np.count_nonzero(again))
        key = truth[again].astype(np.int64) * max(n, 1) + estimate[again]
        often = np.unique(np.concatenate((often, key)))
    paired = np.flatnonzero(by_truth)
    _, component = np.unique(root[paired], return_inverse=True)  # roots are the first truths
    entries = np.bincount(component, by_truth[paired]).astype(np.int64)
    group = (np.cumsum(entries) - entries) // SHARD_ENTRIES
    _, shard = np.unique(group, return_inverse=True)
    of_truth = np.full(m, -1, np.int32)
    of_truth[paired] = shard.astype(np.int32)[component]
    return Shards(
        of_truth=of_truth,
        entries=np.bincount(shard, entries).astype(np.int64),
        components=len(entries),
        pairs=once + len(often),
    )


def _in_several(side: Tracks) -> Mask:
    """Which tracks are in more than one block: only pairs of these may be as well."""
    count = np.zeros(len(side.ids), np.int32)
    for numbers in side.numbers:
        count[numbers] += 1
    return count > 1


def _near_tracks(
    blocks: Sequence[Scanned], truths: Tracks, estimates: Tracks
) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Truths, estimates and entries of the pairs of each block."""
    for block, *numbers in zip(blocks, truths.numbers, estimates.numbers, strict=True):
        pairs = block.pairs
        yield numbers[0][pairs["truth"]], numbers[1][pairs["estimate"]], pairs["entries"]
