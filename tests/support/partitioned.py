"""Both sides of a scene as files and as folders of tables."""

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from tgospa_eval import Trajectories


def write_sides(sides: tuple[Trajectories, Trajectories], folder: Path) -> tuple[str, str]:
    """Each side as a Parquet file and, by time, as a folder of three; the paths of the folders."""
    for name, side in zip(("truth", "estimate"), sides, strict=True):
        times, (x, y) = side.times[side.step], side.state.T
        table = pa.table({"id": side.ids[side.track].astype(str), "t": times, "x": x, "y": y})
        pq.write_table(table, folder / f"{name}.parquet")
        (folder / name).mkdir()
        part = side.step * 3 // max(len(side.times), 1)
        for k in range(3):
            pq.write_table(table.filter(pa.array(part == k)), folder / name / f"{9 - k}.parquet")
    return str(folder / "truth"), str(folder / "estimate")


OF_SUMMARY = (
    *("followed", "completeness", "rmse", "fragments", "longest_stretch", "time_to_first"),
    *("assigned", "purity"),
)
"""Columns of tracks that tables of data in parts do not have."""


def without_summary(table: pd.DataFrame) -> pd.DataFrame:
    """A table of a result without them."""
    return table.drop(columns=[name for name in OF_SUMMARY if name in table])
