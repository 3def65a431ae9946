"""What is on either side of the gaps of a truth, however long: of each block the states beyond it.

A state in a gap is on the line between two of its track that may be any number of blocks apart. So
each block tells the first and the last state of every track, and on the way through all blocks,
forward and backward, one state of each track that is in a gap is held.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from tgospa_eval.common.writing import writing_folder
from tgospa_eval.partitioned.steps import (
    BlockPiece,
    Resampled,
    load_states,
    merged,
    outermost,
    save_states,
)
from tgospa_eval.partitioned.tasks import Run, Task
from tgospa_eval.tracks.trajectories import Trajectories

HELD = ("last", "before"), ("first", "after")
"""Of the states of a block those that are held on the way, and what others call these."""


def write_ends(output: str, stretch: Resampled) -> None:
    """Write the first and the last state of every track of a block of the truth."""
    found = stretch.own()
    with writing_folder(output) as folder:
        for name in ("first", "last"):
            save_states(outermost(found, last=name == "last"), folder / f"{name}.npz")


def with_states_beyond(pieces: Sequence[BlockPiece], work: Path, run: Run) -> list[BlockPiece]:
    """The pieces of a truth whose gaps are not judged, with what is beyond each.

    Parameters
    ----------
    pieces : sequence of BlockPiece
        All, in the order of time.
    work : Path
        Folder for what is beyond them; what is there is not done again.
    run : callable
        Does tasks.
    """
    truths = [cast(Resampled, piece.stretches[0]) for piece in pieces]
    folders = [work / f"{number:08d}" for number in range(len(pieces))]
    tasks: dict[str, Task] = {
        str(folder): partial(write_ends, stretch=truth)
        for folder, truth in zip(folders, truths, strict=True)
    }
    run(tasks)
    for own, beyond in HELD:
        _carry(folders, own, beyond, truths[0].nothing())
    return [
        replace(piece, stretches=(replace(truth, beyond=str(folder)), piece.stretches[1]))
        for piece, truth, folder in zip(pieces, truths, folders, strict=True)
    ]


def _carry(folders: Sequence[Path], own: str, beyond: str, nothing: Trajectories) -> None:
    """Write what is before each block, or after it, of the tracks that are on its other side."""
    ways = folders if own == "last" else folders[::-1]

    def moments(side: Trajectories) -> list[tuple[str, float]]:
        columns = side.ids[side.track].tolist(), side.times[side.step].tolist()
        return list(zip(*columns, strict=True))

    final: dict[str, float] = {}  # the time of each track that is the last on the way
    for folder in ways:
        final.update(moments(load_states(folder / f"{own}.npz", nothing)))
    held = nothing
    for folder in ways:
        save_states(held, folder / f"{beyond}.npz")
        ends = load_states(folder / f"{own}.npz", nothing)
        held = outermost(merged([held, ends]), last=own == "last")
        goes_on = [time != final[name] for name, time in moments(held)]
        held = held.chosen(np.flatnonzero(goes_on))
