"""The HTML report: what is handed to it, and how it is written."""

from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pages import embedded, unpacked

from tgospa_eval import Result, evaluate
from tgospa_eval.show import plot_data
from tgospa_eval.show.html import packed, page
from tgospa_eval.show.plot_data import NONE


def swap() -> Result:
    """Two truths that exchange their tracks at step 2; a miss of truth 0, one false estimate.

    c = 2, p = 1, gamma = 1: a miss and a false target cost 1 each, a switch 1, an error 0.5 here.
    """
    truth = np.zeros((4, 2, 2))
    truth[:, 1] = 100
    estimate = np.full((4, 3, 2), np.nan)
    estimate[:2, 0], estimate[2:, 1] = [0, 0.5], [0, 0.5]
    estimate[:2, 1], estimate[2:, 0] = [100, 100], [100, 100]
    estimate[3, 1] = np.nan  # truth 0 is missed at step 3
    estimate[1, 2] = [50, 50]
    return evaluate(truth, estimate, cutoff=2.0, order=1, switch_penalty=1.0)


# --- data -----------------------------------------------------------------------------------------


def test_a_hole_in_a_trajectory_ends_a_run() -> None:
    truth = np.zeros((5, 1, 2))
    truth[2] = np.nan
    arrays = plot_data.plot_data(evaluate(truth, truth, cutoff=1.0)).arrays
    assert arrays["truth/run/begin"].tolist() == [0, 3]
    assert arrays["truth/run/end"].tolist() == [1, 4]


def test_packing_is_undone() -> None:
    arrays = {
        "a": np.array([5, -3, 2**30, -(2**30), 0]),
        "empty": np.zeros(0, int),
        "b": np.ones(3),
    }
    back = unpacked(packed(arrays), [(name, len(values)) for name, values in arrays.items()])
    for name, values in arrays.items():
        assert back[name].tolist() == values.tolist()
    many = np.arange(200_000)
    text = packed({"many": many})
    assert len(text) < 4 * len(many) / 10
    assert unpacked(text, [("many", len(many))])["many"].tolist() == many.tolist()


def test_positions_are_told_to_a_fraction_of_their_range() -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(1e6, 50, (20, 4, 3))
    made = plot_data.plot_data(evaluate(truth, truth + 0.1, cutoff=5.0))
    data, arrays = made.document, made.arrays
    back = unpacked(packed(arrays), data["arrays"])
    for axis in range(3):
        told = data["low"][axis] + back[f"truth/row/{axis}"] * data["quantum"][axis]
        truth_axis = truth[back["truth/row/step"], back["truth/row/track"], axis]
        assert np.abs(told - truth_axis).max() <= 0.51 * data["quantum"][axis]
    assert len(back["truth/row/0"]) == 80


def test_thinning_keeps_every_event(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    truth = np.cumsum(rng.normal(size=(300, 6, 2)), axis=0)
    estimate = truth + rng.normal(0, 0.1, truth.shape)
    estimate[rng.random((300, 6)) < 0.05] = np.nan
    estimate[rng.random((300, 6)) < 0.03] += 500
    result = evaluate(truth, estimate, cutoff=2.0)
    made = plot_data.plot_data(result)
    full, all_ = made.document, made.arrays
    monkeypatch.setattr(plot_data, "VALUES", 800)
    made = plot_data.plot_data(replace(result))
    thin, arrays = made.document, made.arrays
    assert thin["stride"] > 1
    assert thin["rows"]["truth"][0] < full["rows"]["truth"][0] == thin["rows"]["truth"][1] == 1800
    for side in ("truth", "estimate"):
        for field in ("track", "begin", "end", "other"):  # lanes are complete
            assert (arrays[f"{side}/run/{field}"] == all_[f"{side}/run/{field}"]).all()
        kept = set(zip(arrays[f"{side}/row/track"], arrays[f"{side}/row/step"], strict=True))
        for track, begin, end, other in zip(
            *(arrays[f"{side}/run/{field}"] for field in ("track", "begin", "end", "other")),
            strict=True,
        ):
            needed = range(begin, end + 1) if other == NONE else (begin, end)
            assert all((track, step) in kept for step in needed)


def test_marks_of_direction_end_with_the_path_in_the_title() -> None:
    html = page(swap(), ("truth.csv", "\u202efdp.csv"))
    assert "<title>TGOSPA = 5.5: \u2068\u202efdp.csv\u2069 against" in unescape(html)


def test_classes_count_their_tracks_through(
    invoke: Callable, write: Callable, tmp_path: Path
) -> None:
    lines = "".join(
        f"{k},{t},{k * 50},0,{'car' if k < 2 else 'van'}\n" for t in range(3) for k in range(4)
    )
    path = write("a.csv", "id,t,x,y,class\n" + lines)
    assert invoke(path, path, "--by", "class", "-o", "out", "-q").status == 0
    data = embedded((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert data["tracks"]["truth"]["class"] == ["car", "car", "van", "van"]
    assert data["rows"]["truth"] == [12, 12]


def test_the_head_has_the_value_per_object_and_step() -> None:
    truth = pd.DataFrame({"id": "a", "t": [0, 1], "x": [0.0, 0.0]})
    page = evaluate(truth, truth.assign(x=2.0), cutoff=5, switch_penalty=1).to_html()
    assert "Per step 2, per object and step 2." in " ".join(page.split())
