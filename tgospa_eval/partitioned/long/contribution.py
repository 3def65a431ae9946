"""What the parts of a long component contribute, in folders as those of shards."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.partitioned.shards import ASSIGNED_PAIR, SWITCHED
from tgospa_eval.partitioned.share import PARTS_OF_TRACKS, Share
from tgospa_eval.problem.solution import Breakdown

Arrays = Mapping[str, NDArray[Any]]


def contribute(
    folder: Path,
    *,
    tables: Arrays | None = None,
    truths: Arrays | None = None,
    estimates: Arrays | None = None,
    share: Share | None = None,
) -> None:
    """Write what `partitioned.add_up` and `by_time` read of a shard; what is not given is nothing.

    Parameters
    ----------
    folder : Path
        It is there.
    tables : mapping, optional
        ``assigned`` and ``switched``.
    truths, estimates : mapping, optional
        Parts of tracks, with ``track`` and ``rows``.
    share : Share, optional
        Sums.
    """
    none = {"assigned": np.zeros(0, ASSIGNED_PAIR), "switched": np.zeros(0, SWITCHED)}
    for name, table in (tables or none).items():
        np.save(folder / f"{name}.npy", table)
    track = np.zeros(0, np.int64)
    nobody: Arrays = {"track": track, "rows": track, **dict.fromkeys(PARTS_OF_TRACKS, np.zeros(0))}
    for name, parts in (("truths", truths), ("estimates", estimates)):
        with (folder / f"{name}.npz").open("wb") as file:
            np.savez(file, **_named(parts or nobody))
    (share or _no_share()).save(folder / "share.npz")


def _named(parts: Arrays) -> dict[str, Any]:
    return dict(parts)


def _no_share() -> Share:
    parts: dict[str, Any] = {
        name: np.zeros(0) for name in Breakdown.__annotations__ if name != "total"
    }
    count = np.zeros(0, np.int64)
    return Share(**parts, first=0, truths=count, estimates=count, lower=np.zeros(0), upper=0.0)
