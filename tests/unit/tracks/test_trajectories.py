"""The flat table: from arrays, and what it refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import ConfigError, InputError, Trajectories, evaluate, read_trajectories
from tgospa_eval.quoting import COMMAND, PYTHON, READER, option, spelled_for


@pytest.mark.parametrize("shape", [(4, 3, 1), (4, 3, 2), (2, 5, 4), (0, 3, 2), (3, 0, 2)])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_from_array_takes_what_is_whole(shape: tuple[int, int, int], layout: str) -> None:
    rng = np.random.default_rng(0)
    states = np.asarray(rng.normal(size=shape), order=layout)
    states[rng.random(shape) < 0.3] = np.nan
    rows = [
        (k, i, states[k, i].tolist())
        for k in range(shape[0])
        for i in range(shape[1])
        if not np.isnan(states[k, i]).any()
    ]
    made = Trajectories.from_array(states)
    assert list(zip(made.step, made.track, made.state.tolist(), strict=True)) == rows
    assert made.step.dtype == made.track.dtype == np.int32
    assert made.state.shape == (len(rows), shape[2])
    before = made.state.copy()
    states[:] = 0.0
    assert np.array_equal(made.state, before)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"step": [0, 0, 2**32]}, "outside the times"),
        ({"step": [0, 0, -1]}, "outside the times"),
        ({"track": [0, 1, 2**32]}, "outside the ids"),
        ({"track": [1, 1, 0]}, "sorted"),
        ({"track": [1, 0, 0]}, "sorted"),
        ({"step": [1, 1, 0]}, "sorted"),
        ({"step": [0.0, 0.0, 1.0]}, "must be integers"),
    ],
)
def test_wrong_rows(changes: dict, message: str) -> None:
    fine = {"step": [0, 0, 1], "track": [0, 1, 0], "state": np.zeros((3, 1))}
    common = {"ids": np.array(["a", "b"]), "times": np.arange(2), "columns": ("x",)}
    Trajectories(**fine, **common)
    with pytest.raises(InputError, match=message):
        Trajectories(**{**fine, **changes}, **common)


def test_rows_may_be_columns_of_a_wider_table() -> None:
    """Arrays whose numbers do not stand side by side in memory."""
    common = {"ids": np.array(["a", "b"]), "times": np.arange(2), "columns": ("x",)}
    wide = np.array([[0, 0], [0, 1], [1, 0]], np.int32)
    given = {"step": wide[:, 0], "track": wide[:, 1], "state": np.zeros((3, 2))[:, :1]}
    assert not any(array.flags["C_CONTIGUOUS"] for array in given.values())
    side = Trajectories(**given, **common)
    plain = Trajectories(**{name: array.copy() for name, array in given.items()}, **common)
    assert (
        evaluate(side, side, 5.0, 2, 1.0).to_dict()["input"]
        == (evaluate(plain, plain, 5.0, 2, 1.0).to_dict()["input"])
    )


# --- what `evaluate` takes --------------------------------------------------------------------


def test_sides_may_be_paths_and_arrow_tables(quickstart: tuple[str, str]) -> None:
    """Polars, pyarrow, DuckDB: whatever hands out its columns by Arrow."""
    pa = pytest.importorskip("pyarrow")
    given = {"cutoff": 10.0, "switch_penalty": 5.0}
    expected = evaluate(*map(read_trajectories, quickstart), **given)
    frames = [pd.read_csv(path, dtype={"id": str}) for path in quickstart]

    class Table:  # as a table of Polars: neither pandas nor pyarrow
        def __arrow_c_stream__(self, requested_schema: object = None) -> object:
            return pa.Table.from_pandas(frames[1]).__arrow_c_stream__(requested_schema)

    for sides in (quickstart, map(Path, quickstart), (frames[0], Table())):
        assert evaluate(*sides, **given).total == expected.total


def test_masked_states_are_absent() -> None:
    """Two of four steps are masked: missed, at c^2 / 2 each."""
    masked = np.ma.array(np.zeros((4, 1, 2)), mask=False)
    masked[2:] = np.ma.masked
    assert evaluate(np.zeros((4, 1, 2)), masked, 10.0).total == 100


def test_arrays_have_one_number_of_steps() -> None:
    with pytest.raises(
        InputError, match=r"truth has 3 steps and estimate has 2: arrays \(T, k, d\)"
    ):
        evaluate(np.zeros((3, 1, 2)), np.zeros((2, 1, 2)), 1.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"z": 0.0}, r"to compare only some, use columns="),
        ({"id": "a", "t": 0}, r"drop_duplicates\(\['id', 't'\]\)"),
    ],
)
def test_messages_name_arguments(change: dict[str, Any], said: str) -> None:
    frame = pd.DataFrame({"id": ["a", "b"], "t": [0, 1], "x": 0.0, "y": 0.0})
    with pytest.raises(InputError, match=said) as raised:
        evaluate(frame.assign(**change), frame, 1.0)
    assert "--" not in str(raised.value)


@pytest.mark.parametrize("levels", [["id"], ["id", "t"]])
def test_columns_in_the_index_are_told(levels: list[str]) -> None:
    frame = pd.DataFrame({"id": ["a", "b"], "t": [0, 1], "x": 0.0}).set_index(levels)
    with pytest.raises(InputError) as raised:
        evaluate(frame, frame, 1.0)
    named = ", ".join(f'"{level}"' for level in levels)
    said = f"{{}}: {named} must be a column but is in the index; call reset_index() first"
    assert str(raised.value).split("\n") == [said.format("truth"), said.format("estimate")]
    with pytest.raises(InputError, match="no column for position"):
        evaluate(frame.drop(columns="x"), frame, 1.0)


def test_a_lazy_frame_is_to_be_collected() -> None:
    lazy: Any = type("LazyFrame", (), {})()
    with pytest.raises(ConfigError, match=r"truth is of the type LazyFrame: call its collect\(\)"):
        evaluate(lazy, lazy, 1.0)


def test_a_frame_is_no_path() -> None:
    frame: Any = pd.DataFrame({"id": ["a"], "t": [0], "x": [0.0]})
    with pytest.raises(ConfigError) as raised:
        read_trajectories(frame)
    said = "path is of the type DataFrame: must be a path; evaluate takes DataFrames themselves"
    assert str(raised.value) == said


def test_options_are_spelled_for_the_surface() -> None:
    for arguments, command, python, reader in (
        (("fix_cov",), "--fix-cov", "fix_cov", "fix_covariance"),
        (("missing_cov", "zero"), "--missing-cov zero", 'missing_cov="zero"', None),
        (("decimal", ","), "--decimal ,", 'decimal=","', 'decimal=","'),
        (("truth_columns", "id=trk,x=px"), "--truth-columns id=trk,x=px", None, None),
        (("columns", "a=B"), "--columns a=B", "columns=('a=B',)", "columns=('a=B',)"),
        (("time_scale", 0.001), "--time-scale 0.001", "time_scale=0.001", "time_scale=0.001"),
        (("time_offset", "-5"), "--time-offset -5", "time_offset=-5", "time_offset=-5"),
        (("resample", "3s"), "--resample 3s", 'resample="3s"', 'resample="3s"'),
        (("class_", "car"), "--class car", 'class_="car"', 'classes="car"'),
        (("slices",), "--slice", "slices", "slices"),
        (("limits",), "--max", "limits", "limits"),
        (("force", True), "--force", "force=True", "force=True"),
    ):
        names = (COMMAND, PYTHON, READER)
        for name, spelled in zip(names, (command, python, reader), strict=True):
            with spelled_for(name):
                assert spelled in (None, option(*arguments))
    with spelled_for(READER):
        assert option("estimate_columns", "x,y") == "columns=('x', 'y')"
    assert option("covariance", metavar="FILE") == "covariance"
    assert option("cutoff", short=True) == "cutoff"
    with spelled_for(COMMAND):
        assert option("covariance", metavar="FILE") == "--covariance FILE"
        assert option("cutoff", short=True) == "-c"
        assert option("cutoff") == "--cutoff"
