"""A side in parts has the rows that one file would have."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.partitioned.sides import Side, open_side
from tgospa_eval.partitioned.tasks import run_tasks
from tgospa_eval.tracks.trajectories import Trajectories

IDS: dict[str, Callable[[int], object]] = {
    "integer": lambda k: (10 * k) % 17 - 3,
    "text": lambda k: f"v{k}",
}


def scene(rows: int = 60, ids: str = "integer", seed: int = 0) -> pd.DataFrame:
    """Distinct (id, t) in order of time."""
    rng = np.random.default_rng(seed)
    pairs = np.sort(rng.choice(12 * 14, size=rows, replace=False))
    return pd.DataFrame(
        {
            "t": pairs // 14,
            "id": [IDS[ids](k) for k in (pairs % 14).tolist()],
            "x": rng.normal(size=rows),
            "y": np.where(rng.random(rows) < 0.1, np.nan, rng.normal(size=rows)),
        }
    )


def opened(path: Path, work: Path, rows_together: int = 20, **options: Any) -> Side:
    return open_side(
        path,
        ReadOptions(**options),
        "truth",
        work=work,
        rows_together=rows_together,
        run=run_tasks,
    )


def check_same(found: Trajectories, wanted: Trajectories) -> None:
    for name in ("step", "track", "state", "times", "ids", "labels"):
        one, other = getattr(found, name), getattr(wanted, name)
        if other is None:
            assert one is None, name
            continue
        assert one.dtype == other.dtype, name
        assert one.tolist() == other.tolist(), name
    assert (found.columns, found.clock) == (wanted.columns, wanted.clock)


def check_blocks(side: Side, whole: Trajectories, cuts: Sequence[int] = (0, 3, 4, 9)) -> None:
    """All blocks between these steps, and all at once."""
    assert side.times.tolist() == whole.times.tolist()
    assert side.times.dtype == whole.times.dtype
    check_same(side.block(side.times[0], side.times[-1]), whole)
    for first, last in zip(cuts, [*cuts[1:], len(whole.times)], strict=True):
        rows = np.flatnonzero((whole.step >= first) & (whole.step < last))
        part = whole.chosen(rows, whole.step[rows] - first, whole.times[first:last])
        if whole.labels is not None:
            vars(part)["labels"] = whole.labels[first:last]
        check_same(side.block(side.times[first], side.times[last - 1]), part)


@pytest.mark.parametrize("ids", IDS)
def test_blocks_are_those_of_one_file(tmp_path: Path, ids: str) -> None:
    frame = scene(ids=ids)
    frame.to_parquet(tmp_path / "whole.parquet")
    (tmp_path / "parts").mkdir()
    for k in range(3):
        frame[20 * k : 20 * k + 20].to_parquet(tmp_path / "parts" / f"{k}.parquet")
    side = opened(tmp_path / "parts", tmp_path / "work")
    check_blocks(side, read(tmp_path / "whole.parquet").trajectories)
