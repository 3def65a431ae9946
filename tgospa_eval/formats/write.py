"""Conversion of Trajectories to the content of a file, row by row in order of (step, track)."""

import csv
import io
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import InputError
from tgospa_eval.formats.headers import BOX
from tgospa_eval.formats.loading import check_parquet
from tgospa_eval.formats.spread import entries
from tgospa_eval.quoting import quoted
from tgospa_eval.tracks.trajectories import Trajectories


def csv_text(trajectories: Trajectories, role: str = "truth") -> str:  # noqa: ARG001
    """Format as CSV ``id,t,...``, with covariances after the states; doubles are read back exactly.

    A cloud has a row for each particle, with its ``weight`` before the state.

    Parameters
    ----------
    trajectories : Trajectories
        Trajectories with any columns.
    role : {"truth", "estimate"}
        Role of the trajectories; it has no effect.
    """
    columns = _columns(trajectories)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    # Python writes a float with the fewest digits that are read back exactly.
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    return text.getvalue()


def parquet_bytes(trajectories: Trajectories) -> bytes:
    """Format the table of `csv_text` as Parquet.

    Raises
    ------
    ConfigError
        pyarrow is not installed.
    """
    check_parquet()
    import pyarrow as pa
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(pa.table(_columns(trajectories)), buffer)
    return buffer.getvalue()


def npz_bytes(trajectories: Trajectories) -> bytes:
    """Format the columns of `csv_text` as an npz archive."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {
        name: array.astype(str) if array.dtype == object else array
        for name, array in _columns(trajectories).items()
    }
    np.savez(buffer, **arrays)
    return buffer.getvalue()


TABLES: dict[str, Callable[[Trajectories], bytes]] = {
    ".csv": lambda trajectories: csv_text(trajectories).encode(),
    ".parquet": parquet_bytes,
    ".pq": parquet_bytes,
    ".npz": npz_bytes,
}
"""Writers of tables by the ending of the file."""


def _columns(trajectories: Trajectories) -> dict[str, NDArray[np.generic]]:
    """Return the columns of id, time, state and covariance; a cloud has a row for each particle."""
    clouds = trajectories.clouds
    counts = 1 if clouds is None else clouds.counts
    times = trajectories.shown[trajectories.step]
    columns: dict[str, NDArray[np.generic]] = {
        "id": np.repeat(trajectories.ids[trajectories.track], counts),
        "t": np.repeat(times, counts),
    }
    state = trajectories.state
    if clouds is not None:
        columns["weight"], state = clouds.weights, clouds.points
    names = trajectories.columns
    columns |= dict(zip(names, state.T, strict=True))
    if trajectories.covariance is not None:
        labels = (label for _, _, label in entries(names))
        columns |= dict(zip(labels, trajectories.covariance.T, strict=True))
    for name, values in trajectories.attributes.items():
        columns.setdefault(name, np.repeat(values, counts))
    return columns


def motchallenge_text(trajectories: Trajectories, role: str) -> str:
    """Format as MOTChallenge: ``frame,id,left,top,width,height`` and further fields.

    The truth has flag 1, class 1 (pedestrian) and visibility 1 in further fields. An estimate has
    score 1, and -1 in three unused fields.

    Raises
    ------
    InputError
        States are not boxes, or an id or time is not a whole number.
    """
    tail = ",1,1,1\n" if role == "truth" else ",1,-1,-1,-1\n"
    return "".join(
        ",".join((str(frame), str(name), *map(repr, box))) + tail
        for name, frame, box in _boxes(trajectories, "MOTChallenge")
    )


def kitti_text(trajectories: Trajectories, role: str) -> str:
    """Format as KITTI tracking labels, with class Car and the image box.

    The fields are ``frame id type truncated occluded alpha left top right bottom``, then three
    dimensions, three coordinates of the location, and the rotation. The box has six decimals.
    Fields that are not known have the values that mean "unknown" in KITTI: alpha -10, dimensions
    -1, location -1000 and rotation -10. Truncated and occluded are 0 in the truth, and unknown (-1)
    in an estimate. The last field of an estimate is the score 1.

    Raises
    ------
    InputError
        States are not boxes, or an id or time is not a whole number.
    """
    flags, score = ("0 0", "") if role == "truth" else ("-1 -1", " 1")
    return "".join(
        f"{frame} {name} Car {flags} -10 "
        f"{left:.6f} {top:.6f} {left + width:.6f} {top + height:.6f} "
        f"-1 -1 -1 -1000 -1000 -1000 -10{score}\n"
        for name, frame, (left, top, width, height) in _boxes(trajectories, "KITTI")
    )


WRITERS: dict[str, Callable[[Trajectories, str], str]] = {
    "csv": csv_text,
    "motchallenge": motchallenge_text,
    "kitti": kitti_text,
}


def _boxes(trajectories: Trajectories, name: str) -> Iterator[tuple[int, int, list[float]]]:
    if trajectories.columns != BOX:
        raise InputError(
            f"{name} files hold boxes {','.join(BOX)}, not {','.join(trajectories.columns)}"
        )
    # Python writes a float with the fewest digits that are read back exactly.
    ids, times = trajectories.ids.tolist(), trajectories.shown.tolist()
    for step, track, state in zip(
        trajectories.step.tolist(), trajectories.track.tolist(), trajectories.state, strict=True
    ):
        identity, time = ids[track], times[step]
        try:
            number, frame = int(identity), int(str(time))
        except ValueError:
            raise InputError(
                f"{name} files have whole numbers as ids and frames; id {quoted(identity)} at "
                f"{time} does not fit"
            ) from None
        yield number, frame, state.tolist()
