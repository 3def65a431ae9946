"""The index of a side, stored: its steps, and the units that blocks are read of."""

import pickle
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.partitioned.input.index import Index, Unit
from tgospa_eval.tracks.trajectories import Floats, Ints, TimeArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """Steps of a side within the range of time that is asked for, and what they are read of.

    Parameters
    ----------
    raw, times : (T,) int64 or float64 arrays
        Distinct times as the files have them, and on the clock of the evaluation.
    counts : (T,) int64 array
        Rows at each.
    labels : (T,) array of bytes, optional
        Times as they are shown, in UTF-8, where they are no numbers.
    texts : (T,) array of bytes, optional
        Likewise as they were read, if they are shown otherwise.
    converted : bool
        Whether `times` are others than `raw`.
    units : list of Unit
        In the order of the files.
    lows, highs : (U,) arrays
        First and last time of each.
    roles : Roles
        Of the columns of the first file.
    """

    raw: TimeArray
    times: TimeArray
    counts: Ints
    labels: NDArray[np.bytes_] | None
    texts: NDArray[np.bytes_] | None
    converted: bool
    units: list[Unit]
    lows: Floats | Ints
    highs: Floats | Ints
    roles: Roles

    @property
    def shown(self) -> "Texts | TimeArray":
        """Times as they are shown."""
        return self.times if self.labels is None else Texts(self.labels)

    def read_as(self, time: float) -> str | float:
        """What the files have for a time."""
        at = int(np.searchsorted(self.times, time))
        texts = self.labels if self.texts is None else self.texts
        if texts is not None:
            return Texts(texts)[at]
        found: float = self.raw[at].item()
        return found


class Texts(Sequence[str]):
    """Texts in UTF-8, which are read where they are looked at."""

    def __init__(self, content: NDArray[np.bytes_]) -> None:
        self.content = content

    def __len__(self) -> int:
        return len(self.content)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> "Texts": ...
    def __getitem__(self, place: int | slice) -> "str | Texts":
        if isinstance(place, slice):
            return Texts(self.content[place])
        text: bytes = self.content[place]
        return text.decode()


def store_steps(index: Index, options: ReadOptions, store: Path, name: str) -> int:
    """Write the steps of a side into a folder; the answer is how many rows --time leaves out.

    Raises
    ------
    ConfigError
        Times cannot be converted, or are of another kind than --time.
    """
    moments = index.moments
    labels = None
    if moments.label is not None:
        labels = np.empty(len(moments.label), dtype=object)
        labels[:] = list(Texts(moments.label))
    times, shown = options.conversion.times(moments.value, moments.clock, labels, name)
    inside = np.ones(len(times), bool)
    if options.moments is not None:
        inside = options.moments.inside(times, moments.clock, name)
    kept: dict[str, NDArray[np.generic]] = {
        "raw": moments.value[inside],
        "times": times[inside],
        "counts": moments.count[inside],
    }
    if shown is not None and moments.label is not None:
        texts = [text.encode() for text in shown[inside].tolist()]
        kept["labels"] = np.array(texts, dtype=np.bytes_)
        if times is not moments.value:
            kept["texts"] = moments.label[inside]
    store.mkdir(parents=True, exist_ok=True)
    for key, array in kept.items():
        np.save(store / f"{key}.npy", array)
    (store / "units").write_bytes(
        pickle.dumps((index.units, index.roles, times is not moments.value))
    )
    return int(moments.count[~inside].sum())


@lru_cache(maxsize=4)
def steps_of(store: str) -> Steps:
    """What `store_steps` wrote; arrays stay in their files."""
    folder = Path(store)
    units, roles, converted = pickle.loads((folder / "units").read_bytes())
    arrays = {
        key: np.load(folder / f"{key}.npy", mmap_mode="r") for key in ("raw", "times", "counts")
    }

    def texts(key: str) -> NDArray[np.bytes_] | None:
        path = folder / f"{key}.npy"
        found: NDArray[np.bytes_] | None = np.load(path, mmap_mode="r") if path.exists() else None
        return found

    return Steps(
        **arrays,
        labels=texts("labels"),
        texts=texts("texts"),
        converted=converted,
        units=units,
        lows=np.array([unit.low for unit in units]),
        highs=np.array([unit.high for unit in units]),
        roles=roles,
    )
