"""The pictures of a result: what is handed to the artists, the files, and odd data."""

import io
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from answer import Answer

pytest.importorskip("matplotlib")

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.path import Path as MplPath
from scipy.stats import chi2

from tgospa_eval import ConfigError, Result, Trajectories, evaluate, plots
from tgospa_eval.cli.shared import progress
from tgospa_eval.common.words import install
from tgospa_eval.show import draw_plane, figure_tools, plot_data
from tgospa_eval.show import style as palette
from tgospa_eval.show.chart_list import Pictures
from tgospa_eval.show.draw_over_time import draw_lanes
from tgospa_eval.show.figure_tools import literal, power, written
from tgospa_eval.show.files import result_pictures
from tgospa_eval.show.plot_data import binned
from tgospa_eval.show.style import FILES, styled
from tgospa_eval.show.time_axis import nice

Draw = Callable[..., Answer]
plot_costs, plot_cumulative, plot_lanes = (
    Result.plot_costs,
    Result.plot_cumulative,
    Result.plot_lanes,
)
plot_plane, plot_worst = Result.plot_plane, Result.plot_worst
ALL = (plot_costs, plot_lanes, plot_plane, plot_cumulative, plot_worst)


def swap() -> Result:
    """Two truths that exchange their tracks at step 2; a miss of truth 0, one false estimate.

    c = 2, p = 1, gamma = 1: a miss and a false target cost 1 each, a switch 1, an error 0.5 here.
    """
    truth = np.zeros((4, 2, 2))
    truth[:, 0, 0] = [0, 1, 2, 3]
    truth[:, 1] = 100
    estimate = np.full((4, 3, 2), np.nan)
    estimate[:2, 0] = truth[:2, 0] + [0, 0.5]
    estimate[2, 1] = truth[2, 0] + [0, 0.5]
    estimate[:2, 1], estimate[2:, 0] = [100, 100], [100, 100]
    estimate[1, 2] = [50, 50]
    return evaluate(truth, estimate, cutoff=2.0, order=1, switch_penalty=1.0)


def crowd(steps: int = 30, truths: int = 90, seed: int = 0) -> Result:
    """Many truths far apart, misses and clutter at random."""
    rng = np.random.default_rng(seed)
    truth = (
        np.cumsum(rng.normal(size=(steps, truths, 2)), axis=0) + 1e3 * np.arange(truths)[:, None]
    )
    estimate = truth + rng.normal(0, 0.1, truth.shape)
    estimate[rng.random((steps, truths)) < 0.1] = np.nan
    clutter = np.where(rng.random((steps, 50, 1)) < 0.1, -1e4, np.nan) * np.ones(2)
    return evaluate(truth, np.concatenate([estimate, clutter], axis=1), cutoff=2.0)


def artist(made: Figure, name: str, panel: int = 0):
    """The artist with this label."""
    axis = made.axes[panel]
    found = [item for item in axis.get_children() if item.get_label() == name]
    assert len(found) == 1, (name, [item.get_label() for item in axis.get_children()])
    return found[0]


def labels(made: Figure) -> set[str]:
    return {str(item.get_label()) for axis in made.axes for item in axis.get_children()}


def spans(made: Figure, name: str) -> list[tuple[float, float, float]]:
    """Left and right ends of boxes, and the lane in which they are."""
    corners = [path.vertices[:4] for path in artist(made, name).get_paths()]
    return [(c[:, 0].min(), c[:, 0].max(), float(np.round(c[:, 1].mean()))) for c in corners]


def points(made: Figure, name: str) -> list[list[float]]:
    return artist(made, name).get_xydata().tolist()


def words(made: Figure) -> list[str]:
    """All that is written."""
    import matplotlib.text

    return [text.get_text() for text in made.findobj(matplotlib.text.Text) if text.get_text()]


# --- what is drawn --------------------------------------------------------------------------------


def test_costs_are_stacked() -> None:
    made = plot_costs(swap())
    # cost by step: 0.5; 0.5 and a false one; 0.5 and two switches; a miss
    tops = {part: artist(made, part).get_data() for part in plot_data.PARTS}
    assert tops["localisation"].values[:3].tolist() == [0.5, 0.5, 0.5]
    assert np.isnan(tops["localisation"].values[3])  # nothing has no outline
    assert (tops["false"].values[1], tops["false"].baseline[1]) == (1.5, 0.5)
    assert (tops["switch"].values[2], tops["switch"].baseline[2]) == (2.5, 0.5)
    assert (tops["missed"].values[3], tops["missed"].baseline[3]) == (1.0, 0.0)
    assert tops["missed"].edges.tolist() == [-0.5, 0.5, 1.5, 2.5, 3.5]
    hatches = {artist(made, part).get_hatch() for part in plot_data.PARTS}
    assert len(hatches - {None}) == 2  # told apart without colours


def test_components_are_chosen() -> None:
    made = plot_costs(swap(), components=["switch", "missed"])
    assert not labels(made) & {"localisation", "false"}
    assert artist(made, "switch").get_data().baseline[2] == 0
    assert labels(plot_cumulative(swap(), components=["false"])) >= {"false", "total"}
    worst = plot_worst(swap(), components=["missed"])
    assert [text.get_text() for text in worst.axes[1].get_yticklabels()] == ["0"]
    for wrong in ((), ("total",), "missed"):
        with pytest.raises(ConfigError, match="must be of localisation, missed, false, switch"):
            plot_costs(swap(), components=wrong)


def test_of_too_many_steps_the_dearest_are_drawn() -> None:
    total = np.zeros(1000)
    total[[3, 501, 999]] = 5.0, 7.0, 9.0
    first, dearest = binned(total, 300)
    assert len(first) == 250
    assert {3, 501, 999} <= set(dearest.tolist())
    assert binned(np.zeros(0), 5)[0].tolist() == []
    assert binned(np.ones(3), 5)[0].tolist() == [0, 1, 2]


def test_lanes() -> None:
    made = plot_lanes(swap())
    # lanes of the truths are at 1 and 2 below their title, that of the false estimate at 4
    assert spans(made, "truth/assigned") == [
        (-0.5, 1.5, 1.0), (1.5, 2.5, 1.0), (-0.5, 1.5, 2.0), (1.5, 3.5, 2.0),
    ]  # fmt: skip
    colours = artist(made, "truth/assigned").get_facecolor().tolist()
    assert colours[0] == colours[3] != colours[1] == colours[2]  # of the estimates
    assert spans(made, "truth/missed") == [(2.5, 3.5, 1.0)]
    assert spans(made, "estimate/false") == [(0.5, 1.5, 4.0)]
    assert artist(made, "switch").get_offsets()[:, 0].tolist() == [1.5, 1.5]
    ticks = [text.get_text() for text in made.axes[0].get_yticklabels()]
    assert ticks == ["0", "1", "2"]
    assert {"2 objects", "1 estimate with false steps"} <= set(words(made))
    # the error of truth 0 is a quarter of the cutoff, a fifth of the lane
    heights = [np.ptp(path.vertices[:, 1]) for path in artist(made, "truth/error").get_paths()]
    assert heights == pytest.approx([0.2, 0.2, 0.2, 0, 0, 0, 0])


def test_lanes_that_have_no_room_share_one() -> None:
    result = crowd()
    made = plot_lanes(result)
    ticks = [text.get_text() for text in made.axes[0].get_yticklabels()]
    false = sum(count > 0 for count in result.table("per_estimate")["false_count"])
    assert "31 others" in ticks
    assert f"{false - 29} others" in ticks
    assert len(ticks) == 60 + 30
    shown = [text for text in ticks[:59] if "others" not in text]
    table = result.table("per_truth")
    rest = [n for k, n in zip(table["id"], table["missed_count"], strict=True) if k not in shown]
    stairs = artist(made, "truth/others").get_data()
    height = stairs.baseline - stairs.values
    assert (height > 0).sum() <= sum(rest)
    assert height.max() == pytest.approx(0.8)


def test_quiet_truths_share_a_lane() -> None:
    truth = np.zeros((5, 45, 2))
    truth[..., 0] = 100 * np.arange(45)
    estimate = truth.copy()
    estimate[2, 7] = np.nan
    made = plot_lanes(evaluate(truth, estimate, cutoff=2.0, switch_penalty=1.0))
    ticks = [text.get_text() for text in made.axes[0].get_yticklabels()]
    assert ticks == ["7", "44 quiet"]
    words = [text.get_text() for text in made.axes[0].texts]
    assert "45 objects, 44 of them without miss or switch" in words


def test_ids_and_directions_in_the_plane() -> None:
    """Truths are named where they begin, estimates where they end; heads point onwards."""
    texts = plot_plane(swap()).axes[0].texts
    named = {text.get_text(): text.xy for text in texts if text.get_text()}
    assert named["0"] == pytest.approx((0, 0), abs=0.01)
    assert {"1", "2"} <= {*named}
    heads = [(text.xyann, text.xy) for text in texts if not text.get_text()]
    assert any(end == pytest.approx((3, 0), abs=0.01) and begin[0] < 3 for begin, end in heads)
    assert not [
        text for text in plot_plane(swap(), columns=("t", "y")).axes[0].texts if text.arrow_patch
    ]


def test_of_more_steps_than_dots_lanes_show_shares() -> None:
    truth = np.zeros((2000, 1, 2))
    estimate = truth.copy()
    estimate[1000, 0] = estimate[500:520, 0] = np.nan
    made = plot_lanes(evaluate(truth, estimate, cutoff=1.0))
    boxes = [path.vertices[:4] for path in artist(made, "truth/share").get_paths()]
    heights = [np.ptp(box[:, 1]) for box in boxes]
    assert len(boxes) == 7  # 20 steps in 6 columns, and one that is alone
    assert max(heights) == pytest.approx(0.8)
    assert min(heights) >= 0.16  # a single miss is seen
    assert any(box[:, 0].min() <= 1000 <= box[:, 0].max() for box in boxes)


def test_of_switches_that_lie_on_each_other_one_is_drawn() -> None:
    # two truths whose estimates change places at every step of two short stretches
    truth = np.zeros((2000, 2, 1))
    truth[:, 1] = 1.0
    estimate = truth.copy()
    for begin in (500, 1500):
        estimate[begin : begin + 8 : 2] = truth[begin : begin + 8 : 2, ::-1]
    result = evaluate(truth, estimate, cutoff=10.0, switch_penalty=0.01)
    marks = artist(plot_lanes(result), "switch").get_offsets()
    assert len(result.table("switches")["t"]) == 32
    lanes = sorted({float(place) for place in marks[:, 1]})
    assert len(lanes) == 2
    steps = [np.round(marks[marks[:, 1] == lane, 0] + 0.5).astype(int) for lane in lanes]
    for found in steps:  # the first of each of the columns, which are of three or four steps
        assert 4 <= len(found) <= 8
        assert {500, 1500} <= set(found.tolist())


def test_plane() -> None:
    made = plot_plane(swap())
    assert points(made, "missed") == [pytest.approx([3, 0], abs=0.01)]
    assert points(made, "false") == [pytest.approx([50, 50], abs=0.01)]
    assert points(made, "switch") == pytest.approx(np.array([[2, 0], [100, 100]]), abs=0.01)
    truth = artist(made, "truth/0").get_xydata()
    assert truth[:4] == pytest.approx(np.array([[0, 0], [1, 0], [2, 0], [3, 0]]), abs=0.01)
    assert np.isnan(truth[4]).all()  # a hole between tracks
    assert made.axes[0].get_aspect() == 1
    across = plot_plane(swap(), columns=("t", "y"))
    assert points(across, "false") == [pytest.approx([1, 50], abs=0.01)]
    assert across.axes[0].get_xlabel() == "time"
    for wrong in (("x", "z"), ("x",), "xy"):
        with pytest.raises(ConfigError, match="must be two of x, y, t"):
            plot_plane(swap(), columns=wrong)


@pytest.mark.parametrize(("size", "style"), [(1.0, "screen"), (1e4, "paper"), (123456.0, "paper")])
@pytest.mark.parametrize("draw", [plot_worst, plot_plane], ids=["worst", "plane"])
def test_labels_of_ticks_do_not_touch(draw: Callable[..., Figure], size: float, style: str) -> None:
    rng = np.random.default_rng(1)
    truth = size * (1e3 + rng.normal(size=(6, 4, 2)))
    made = draw(evaluate(truth, truth[:, :3] + size, cutoff=30 * size), style=style)
    made.canvas.draw()
    for axis in made.axes:
        low, high = sorted(axis.get_xlim())
        ticks = zip(axis.get_xticks(), axis.get_xticklabels(), strict=True)
        found = [text.get_window_extent() for at, text in ticks if low <= at <= high]
        assert len(found) > 1
        assert all(left.x1 < right.x0 for left, right in pairwise(found))


def on_map(latitude: float) -> Result:
    """A track that goes about a kilometre to the north, and one as far to the east."""
    way = np.linspace(0, 1 / 111.0, 5)
    rows = pd.DataFrame({"id": np.repeat(["n", "e"], 5), "t": [*range(5)] * 2})
    rows["lat"] = latitude + np.concatenate([way, 0 * way]) - 0.5 / 111
    rows["lon"] = 10 + np.concatenate([0 * way, way / np.cos(np.radians(latitude))])
    return evaluate(rows, rows, cutoff=100.0, distance="haversine")


@pytest.mark.parametrize("columns", [None, ("lat", "lon")])
@pytest.mark.parametrize("latitude", [0.0, -33.0, 60.0])
def test_maps_have_equal_scales(latitude: float, columns: tuple[str, str] | None) -> None:
    made = plot_plane(on_map(latitude), columns=columns)
    made.canvas.draw()
    shown = made.axes[0].transData.transform(points(made, "truth/0"))
    legs = [np.ptp(part, axis=0).max() for part in (shown[:5], shown[-5:])]
    assert legs[0] == pytest.approx(legs[1], rel=5e-3)


def test_no_map_is_stretched_beyond_measure() -> None:
    for latitude in (89.9, 500.0):  # the second is no latitude, whatever the column is called
        rows = pd.DataFrame({"id": "a", "t": [0, 1], "lat": latitude, "lon": [0.0, 1.0]})
        made = plot_plane(evaluate(rows, rows, cutoff=1.0, distance="euclidean"))
        assert made.axes[0].get_aspect() in (1.0, "auto")


def test_a_state_that_is_alone_is_seen() -> None:
    truth = np.zeros((3, 1, 2))
    truth[1] = np.nan
    made = plot_plane(evaluate(truth, truth, cutoff=1.0))
    dots = [line for line in made.axes[0].get_lines() if line.get_label() == "truth/single"]
    assert [len(line.get_xdata()) for line in dots] == [2]


def test_thinning_keeps_every_event(monkeypatch: pytest.MonkeyPatch) -> None:
    result = crowd(steps=120, truths=8)
    full = plot_plane(result)
    monkeypatch.setattr(plot_data, "VALUES", 700)
    result = replace(result)  # what is drawn is made once for each
    thin = plot_plane(result)
    assert len(artist(thin, "truth/0").get_xdata()) < len(artist(full, "truth/0").get_xdata())
    for name in ("missed", "false"):
        assert points(thin, name) == points(full, name)
        assert len(points(full, name)) == result.counts[name]


def test_events_that_are_near_to_each_other_share_a_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    result = crowd(steps=120, truths=20)
    apart = plot_plane(result)
    monkeypatch.setattr(draw_plane, "GROUPED", 100)
    made = plot_plane(result)
    marks = {name: artist(made, name) for name in ("missed", "false")}
    assert len(marks["false"].get_offsets()) == 1  # all clutter is at one place
    assert len(marks["missed"].get_offsets()) < len(points(apart, "missed"))
    legend = [text.get_text() for text in made.legends[0].get_texts()]
    assert f"false, {result.counts['false']:,.0f}" in " ".join(legend)


def test_boxes() -> None:
    boxes = np.array([[[10.0, 20, 4, 8]], [[40, 20, 4, 8]]])
    made = plot_plane(evaluate(boxes, boxes, distance="iou"))
    corners = artist(made, "truth/shapes").get_paths()[0].vertices[:4]
    assert corners.min(axis=0) == pytest.approx([10, 20], abs=0.01)
    assert corners.max(axis=0) == pytest.approx([14, 28], abs=0.01)
    low, high = made.axes[0].get_ylim()
    assert low > high  # rows of an image count downwards
    assert points(made, "truth/0")[0] == pytest.approx([12, 24], abs=0.01)


def gaussian() -> Result:
    truth = pd.DataFrame({"id": 1, "t": range(3), "x": [0.0, 30, 60], "y": 0.0})
    covariance = {"cov_xx": 4.0, "cov_xy": 1.2, "cov_yy": 1.0}
    return evaluate(truth, truth.assign(**covariance), distance="gaussian-wasserstein")


def test_ellipses() -> None:
    made = plot_plane(gaussian())
    assert "truth/shapes" not in labels(made)  # points have none
    outline = artist(made, "estimate/shapes").get_paths()[1].vertices[:-1] - [30, 0]
    inverse = np.linalg.inv([[4.0, 1.2], [1.2, 1.0]])
    radius = np.sqrt(np.einsum("ni,ij,nj->n", outline, inverse, outline))
    assert radius == pytest.approx(np.full(len(outline), chi2.ppf(0.95, 2) ** 0.5), rel=1e-9)
    assert "95 % ellipse, estimate" in words(made)
    assert "estimate: 3 of 3 ellipses" in words(made)


def test_an_interval_over_the_time() -> None:
    truth = pd.DataFrame({"id": 1, "t": range(3), "x": [0.0, 30, 60]})
    result = evaluate(truth, truth.assign(cov_xx=4.0), distance="gaussian-wasserstein")
    outline = artist(plot_plane(result), "estimate/shapes").get_paths()[1].vertices
    assert np.ptp(outline[:, 0]) == 0
    reach = outline[:, 1] - 30
    assert [reach.min(), reach.max()] == pytest.approx(np.array([-2, 2]) * chi2.ppf(0.95, 1) ** 0.5)


def test_what_is_around_the_farthest_pair_is_enlarged() -> None:
    """All states of its steps near it, with lines to their partners; others are beyond."""
    truth = np.stack([np.arange(20.0) * 3, np.zeros(20)], axis=1)[:, None] + [[0, 0], [0, 500]]
    estimate = truth.copy()
    estimate[7, 0, 1] += 2
    covariance = np.tile(np.diag([4.0, 1.0]), (20, 2, 1, 1))
    side = Trajectories.from_array(estimate, covariance=covariance)
    result = evaluate(Trajectories.from_array(truth), side, distance="gaussian-wasserstein")
    made = plot_plane(result)
    below = made.axes[1]
    shapes = [c for c in below.collections if c.get_label() == "estimate/shapes"]
    assert len(shapes[0].get_paths()) == 5  # steps 5 to 9 of one track
    assert "estimate: 5 of 40 ellipses" in words(made)
    assert "Around the farthest pair, t = 5 to 9" in [below.get_title(loc="left")]
    (low, high), (left, right) = below.get_ylim(), below.get_xlim()
    assert low < -2 < 4 < high < 100
    assert left < 15 < 27 < right < 60


def test_particles() -> None:
    """Their areas are their weights, at the states whose ellipses are drawn."""
    rows = [(1, t, w, 10.0 * t + x, y) for t in range(3) for w, x, y in CLOUD]
    estimate = pd.DataFrame(rows, columns=["id", "t", "weight", "x", "y"])
    truth = pd.DataFrame({"id": 1, "t": range(3), "x": [0.0, 10, 20], "y": 0.0})
    made = plot_plane(evaluate(truth, estimate, distance="cloud-wasserstein"))
    dots = next(c for c in made.axes[0].collections if c.get_label() == "estimate/particles")
    assert dots.get_offsets()[:3].tolist() == [[0, 0], [2, 0], [0, 3]]
    assert dots.get_sizes()[:3] / dots.get_sizes()[0] == pytest.approx([1, 0.6, 0.4])
    assert "particles, estimate" in words(made)
    assert any("of 9 particles, area by weight" in text for text in words(made))


CLOUD = ((0.5, 0.0, 0.0), (0.3, 2.0, 0.0), (0.2, 0.0, 3.0))


def test_a_result_without_ellipses_has_one_panel() -> None:
    assert len(plot_plane(swap()).axes) == 1


def test_cumulative() -> None:
    result = swap()
    made = plot_cumulative(result)
    assert points(made, "total")[-1] == pytest.approx([3, result.normalised["tgospa"]])
    dashes = [line.get_linestyle() for line in made.axes[0].get_lines()]
    assert len(made.axes[0].get_lines()) == 5
    assert dashes.count("-") == 2  # total and localisation; the others are dashed


def corners(path: MplPath) -> list[np.ndarray]:
    """Of the boxes in a path, across and up."""
    return [box[:-1].T for box in path.vertices.reshape(-1, 5, 2)]


def test_worst() -> None:
    made = plot_worst(swap())
    assert [text.get_text() for text in made.axes[0].get_yticklabels()] == ["2", "1", "3", "0"]
    bars = {patch.get_label(): patch.get_path() for patch in made.axes[0].patches}
    spans = {
        name: sorted(np.round((x.min(), x.max(), y.mean()), 9).tolist() for x, y in corners(path))
        for name, path in bars.items()
    }
    # from where to where, and in which row: steps 2, 1, 3, 0 from above
    assert spans == {
        "localisation": [[0, 0.5, 0], [0, 0.5, 1], [0, 0.5, 3]],
        "missed": [[0, 1, 2]],
        "false": [[0.5, 1.5, 1]],
        "switch": [[0.5, 2.5, 0]],
    }
    assert [text.get_text() for text in made.axes[1].get_yticklabels()] == ["0", "1"]
    assert [text.get_text() for text in made.axes[2].get_yticklabels()] == ["0", "1", "2"]
    none = plot_worst(evaluate(np.zeros((2, 1, 2)), np.zeros((2, 1, 2))), style="paper")
    assert words(none).count("none") == 3


# --- in a notebook --------------------------------------------------------------------------------


def test_a_result_shows_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib as mpl
    from matplotlib.image import imread

    result = swap()
    for draw in ALL:
        made = getattr(result, draw.__name__)(style="paper")
        assert labels(made) == labels(draw(result, style="paper"))
    data, size = made._repr_png_()
    tall, wide, _ = imread(io.BytesIO(data)).shape
    assert (wide, tall) == pytest.approx((2 * size["width"], 2 * size["height"]), abs=1)
    with mpl.rc_context({"font.size": 30, "hatch.linewidth": 9}):
        assert made._repr_png_()[0] == data  # the settings of the user are not those of the picture
    assert labels(result.plot_costs(components=["missed"])) >= {"missed"}
    assert result.plot_plane(columns=("t", "y")).axes[0].get_xlabel() == "time"
    assert "<canvas" in result.to_html()
    result.save(tmp_path / "saved")
    names = {path.name for path in (tmp_path / "saved").iterdir()}
    assert names >= {"result.json", "report.html", "lanes.png", "per_step.csv"}
    monkeypatch.setattr("tgospa_eval.show.style.available", lambda: False)
    result.save(tmp_path / "saved")  # its own folder
    assert (tmp_path / "saved" / "report.html").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").touch()
    with pytest.raises(ConfigError, match=r"^folder .*mine: is not empty; .* force=True$"):
        result.save(tmp_path / "mine")


def test_dir_shows_what_is_public() -> None:
    result = swap()
    names = dir(result)
    assert set(result.to_dict()) - {"schema"} <= set(names)
    assert {"per_truth", "plot_lanes", "proof", "to_json", "save"} <= set(names)
    assert not [name for name in names if name.startswith("_") or name.endswith("_table")]
    assert not {"scene", "labels", "settings", "gap", "traced"} & set(names)
    assert all(hasattr(result, name) for name in names)


# --- odd data -------------------------------------------------------------------------------------

NASTY = ["$x$", "$\\frac{", "<script>alert(1)</script>", "שלום \u202e", "a\nb", "車両", "_", "$"]


def test_ids_are_drawn_as_they_are() -> None:
    names = [name for name in NASTY for _ in range(6)]
    truth = pd.DataFrame({"id": names, "t": [*range(6)] * 8, "x": np.repeat(range(8), 6) * 90.0})
    estimate = truth.assign(x=truth["x"] + np.where(truth["t"] == 3, 50, 0.1))
    result = evaluate(truth, estimate, cutoff=3.0, unit="$m^2$_{<b>}")
    assert all(result_pictures(result, Pictures()).values())
    made = plot_lanes(result)
    assert all(written(made, kind) for kind in ("svg", "pdf"))
    found = set(words(made))
    assert {"$x$", "$\\frac{", "_", "$", "車両", "a\\nb", "שלום \\u202e"} <= found
    assert literal("<script>alert(1)</script>", 14) in found
    assert "x ($m^2$_{<b>})" in words(plot_plane(result))


def nothing() -> pd.DataFrame:
    return pd.DataFrame({"id": [], "t": [], "x": [], "y": []})


def stamped(times: list) -> Result:
    truth = pd.DataFrame({"id": "a", "t": times, "x": 0.0, "y": np.arange(len(times))})
    return evaluate(truth, truth.iloc[:-1])


@pytest.mark.parametrize(
    "make",
    [
        lambda: evaluate(nothing(), nothing()),
        lambda: evaluate(np.zeros((3, 1, 2)), np.zeros((3, 0, 2))),
        lambda: evaluate(np.zeros((3, 0, 2)), np.zeros((3, 1, 2))),
        lambda: evaluate(np.zeros((1, 1, 2)), np.ones((1, 1, 2))),
        lambda: evaluate(np.zeros((3, 1, 1)), np.ones((3, 1, 1))),
        lambda: evaluate(np.full((3, 1, 2), 50.0), np.full((3, 1, 2), 50.0), distance="haversine"),
        lambda: evaluate(np.full((3, 1, 2), 1e300), np.full((3, 1, 2), 1e300)),
        lambda: stamped([f"2026-03-01T12:00:{k:02d}.5" for k in range(40)]),
    ],
    ids=["empty", "no-estimate", "no-truth", "one-step", "1-D", "globe", "huge", "ISO"],
)
def test_there_is_always_a_picture(make: Callable[[], Result]) -> None:
    assert len(result_pictures(make(), Pictures(style="paper"))) == 5


def named(times: list, room: float = 80) -> tuple[list[float], list[str], str]:
    seen = plot_data.plot_data(stamped(times))
    return seen.time.ticks(seen.time.edges[0][0], seen.time.edges[1][-1], room)


def test_round_times_are_named_and_what_they_share_is_said_once() -> None:
    assert nice(0, 100, 5) == [0, 20, 40, 60, 80, 100]
    assert nice(3, 3, 5) == [3]
    assert named([0.5 * k for k in range(100)], 35) == (
        [0, 10, 20, 30, 40], ["0", "10", "20", "30", "40"], "time",
    )  # fmt: skip
    seconds = [f"2026-03-01T12:00:{k:02d}.5" for k in range(40)]
    _, names, title = named(seconds)
    assert (names[:3], title) == (["12:00:00", "12:00:10", "12:00:20"], "time, 2026-03-01")
    days = [f"2026-03-{1 + k:02d}T06:00:00Z" for k in range(9)]
    assert named(days)[1:] == ([f"03-{k:02d}" for k in range(1, 10)], "time, 2026")
    night = [f"2026-12-31T{20 + k}:00" for k in range(4)] + ["2027-01-01T00:00"]
    _, names, title = named(night)
    assert (names[0], names[-1], title) == ("2026-12-31 20:00", "2027-01-01 00:00", "time")
    places, names, title = named([1_700_000_000.5 + 0.1 * k for k in range(60)])
    assert names == ["1", "2", "3", "4", "5", "6"]
    assert (places[0], title) == (1_700_000_001, "time − 1700000000")
    _, names, title = named([1_700_000_000_000_000_007 + 40 * k for k in range(30)])
    assert (names[:2], title) == (["0", "+200"], "time from 1700000000000000007")


def test_pictures_over_time_are_to_scale() -> None:
    times = [*range(3, 20), *range(46, 59)]
    result = stamped(times)
    line = artist(plot_cumulative(result), "total")
    assert line.get_xdata().tolist() == times
    seen = plot_data.plot_data(result)
    assert seen.time.edges[0][[0, 16, 17]].tolist() == [2.5, 18.5, 45.5]
    assert seen.time.edges[1][[16, 17, -1]].tolist() == [19.5, 46.5, 58.5]
    bars = artist(plot_costs(result), "missed").get_data()
    assert 19.5 in bars.edges
    assert 45.5 in bars.edges
    # a pause that would take most of the picture is left out, and the axis says so
    parted = stamped([0, 1, 2, 3, 1000, 1001, 1002])
    assert artist(plot_cumulative(parted), "total").get_xdata().tolist() == [*range(7)]
    assert plot_costs(parted).axes[0].get_xlabel() == "time, steps evenly spaced"


def test_units_of_costs() -> None:
    assert [power("m", p) for p in (1, 2, 3, 1.5)] == [" (m)", " (m²)", " (m³)", " (m^1.5)"]
    assert power("", 2) == ""


def seen_by(colour: str, sight: np.ndarray) -> np.ndarray:
    """Oklab of a colour for eyes that see this much of red, green and blue."""
    share = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    cones = np.array([
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ])  # fmt: skip
    return np.array([
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]) @ np.cbrt(cones @ np.clip(sight @ linear, 0, 1))  # fmt: skip


SIGHT = {  # Machado, Oliveira and Fernandes 2009, severity 1
    "all": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


@pytest.mark.parametrize("colours", [palette.LIGHT, palette.DARK], ids=["light", "dark"])
@pytest.mark.parametrize("sight", SIGHT)
def test_parts_are_told_apart_by_all_eyes(colours: dict[str, str], sight: str) -> None:
    shown = [seen_by(colours[part], np.array(SIGHT[sight])) for part in plot_data.PARTS]
    apart = [np.linalg.norm(a - b) for k, a in enumerate(shown) for b in shown[:k]]
    assert min(apart) > 0.12


# --- files ----------------------------------------------------------------------------------------


def test_the_same_bytes() -> None:
    import matplotlib as mpl

    def made() -> dict[str, bytes]:
        with styled("paper") as style:
            seen = plot_data.plot_data(swap())
            return {kind: written(draw_lanes(seen, style), kind) for kind in FILES}

    once = made()
    with mpl.rc_context({"font.size": 20, "svg.hashsalt": "other", "pdf.fonttype": 3}):
        assert made() == once
        assert mpl.rcParams["font.size"] == 20
    assert list(once) == ["png", "svg", "pdf"]
    assert b"CreationDate" not in once["pdf"]
    assert b"dc:date" not in once["svg"]
    assert b"Software" not in once["png"]


def test_large_collections_are_dots_in_vector_files() -> None:
    with styled("paper") as style:
        made = draw_lanes(plot_data.plot_data(crowd(steps=400, truths=50)), style)
    assert artist(made, "truth/error").get_rasterized()
    assert not artist(made, "estimate/share").get_rasterized()


def test_figures_belong_to_no_window() -> None:
    for plot in ALL:
        made = plot(swap(), style="paper")
        assert isinstance(made, Figure)
        assert made.get_size_inches()[0] == 3.5
    with pytest.raises(ConfigError, match='style "poster": must be one of screen, paper'):
        plot_costs(swap(), style="poster")


@pytest.fixture
def draw(
    invoke: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, quickstart: tuple[str, str]
) -> Callable[..., Answer]:
    """Evaluate the sample data, with pictures, as users do."""
    monkeypatch.delenv("TGOSPA_EVAL_PICTURES")
    return lambda *options: invoke(*quickstart, "-c", "10", "-g", "5", *options)


def kinds(folder: Path) -> list[str]:
    return sorted(path.suffix for path in folder.iterdir() if path.stem in PICTURES)


PICTURES = ("costs", "lanes", "plane", "cumulative", "worst")


def test_folder(draw: Draw, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SILENT", 0.0)
    answer = draw("-o", "a")
    assert (answer.status, "plot" in answer.err, "drawing" in answer.err) == (0, False, False)
    assert kinds(tmp_path / "a") == [".png"] * 5
    monkeypatch.setattr(figure_tools, "written", lambda *_: b"")  # which takes most of the time
    answer = draw(
        "-o", "b", "--pictures", "pdf", "--style", "paper", "--components", "missed,switch",
        "--plane", "t,x",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert kinds(tmp_path / "b") == [".pdf"] * 5
    assert draw("-o", "c", "--pictures", "none").status == 0
    assert kinds(tmp_path / "c") == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--pictures", "gif"], '--pictures "gif": must be png, svg, pdf, or none'),
        (["--components", "cost"], '--components "cost": must be of localisation'),
        (["--plane", "x,z"], '--plane "x,z": must be two of x, y, t'),
        (["--style", "poster"], "--style"),
    ],
)
def test_what_is_wrong_is_said_before_any_work(
    draw: Draw, tmp_path: Path, options: list[str], message: str
) -> None:
    answer = draw("-o", "a", *options)
    assert (answer.status, answer.out) == (2, "")
    assert message in answer.err
    assert not (tmp_path / "a").exists()


def test_options_of_pictures_need_a_folder(draw: Draw) -> None:
    answer = draw("--style", "paper")
    assert answer.status == 2
    assert "--style needs -o DIR" in answer.err
    answer = draw("--pictures", "png")
    assert (answer.status, "--pictures needs -o DIR" in answer.err) == (2, True)
    assert draw("--pictures", "none").status == 0  # nothing is drawn


def test_without_matplotlib_one_notice(
    draw: Draw, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tgospa_eval.show.style.available", lambda: False)
    answer = draw("-o", "a")
    assert answer.status == 0
    notice = f"no pictures: they need the extra plot: {install('plot')}"
    assert answer.err.count("tgospa-eval[") == answer.err.count(notice) == 1
    assert (tmp_path / "a" / "result.json").exists()
    assert "tgospa-eval[" not in draw("-o", "b", "--pictures", "none").err
    assert "tgospa-eval[" not in draw("-o", "c", "-q").err


def test_who_wants_no_pictures_does_not_pay(
    tmp_path: Path, quickstart: tuple[str, str], environment: dict[str, str]
) -> None:
    """Without a folder, and without pictures in it, nothing of them is imported."""
    code = (
        "import sys\n"
        "from tgospa_eval.cli import main\n"
        "for more in ([], ['-o', 'out', '--pictures', 'none']):\n"
        "    try: main([*sys.argv[1:], '-q', *more])\n"
        "    except SystemExit as end: assert not end.code\n"
        "    assert not [m for m in sys.modules if 'plotlib' in m or '.show.draw_plane' in m]\n"
    )
    subprocess.run(
        [sys.executable, "-c", code, *quickstart, "-c", "10", "-g", "5"],
        stdout=subprocess.DEVNULL, cwd=tmp_path, check=True, env=environment,
    )  # fmt: skip


def test_classes(invoke: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, write) -> None:
    """Lanes of all classes, each with its class in front."""
    monkeypatch.delenv("TGOSPA_EVAL_PICTURES")
    rows = [f"{k},{t},{9 * k},{t},{'car' if k else 'man'}\n" for k in range(2) for t in range(4)]
    path = write("gt.csv", "id,t,x,y,class\n" + "".join(rows))
    answer = invoke(
        path, path, "-c", "5", "-g", "1", "--by", "class", "-o", "a", "--pictures", "svg"
    )
    assert answer.status == 0, answer.err
    assert "car: 1" in Path("a/lanes.svg").read_text(encoding="utf-8")  # as a remark of the path


def test_functions_are_the_methods() -> None:
    result = swap()
    for name in plots.PICTURES[:3]:
        assert type(getattr(plots, name)(result)) is type(getattr(result, name)())
    assert not hasattr(plots, "plot_nothing")
