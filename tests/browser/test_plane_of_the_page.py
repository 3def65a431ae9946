"""What is around states in the report: boxes and ellipses, and moving about in the plane."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser
from pages import embedded, ink, note, pick, picture, texts
from scipy.stats import chi2

from tgospa_eval import Result, Trajectories, evaluate, sensors
from tgospa_eval.api.sensors import Association
from tgospa_eval.common.frozen import recast
from tgospa_eval.distances import CloudWasserstein
from tgospa_eval.show import plot_data as spreads
from tgospa_eval.tracks.clouds import Clouds


def associate(first: Trajectories, second: Trajectories, **options: Any) -> Association:
    return recast(sensors.associate(first, second, **options), Association)


def laws(covariance: np.ndarray, steps: int = 4) -> Result:
    """A truth of points and one estimate with this covariance at every step."""
    truth = np.stack([np.linspace(0, 60, steps), np.linspace(0, 40, steps)], axis=1)[:, None]
    estimate = Trajectories.from_array(truth + 0.5, covariance=covariance)
    return evaluate(
        Trajectories.from_array(truth), estimate, cutoff=50.0, distance="gaussian-wasserstein"
    )


def read(levels: dict[str, np.ndarray], how: dict, size: int) -> np.ndarray:
    """Covariances (K, d, d) from what the page is told, as its script reads them."""
    count = len(levels["row"])
    found = np.zeros((count, size, size))
    deviation = [
        np.where(
            levels[str(i * (i + 3) // 2)] >= how["faint"],
            0,
            how["largest"][i] * np.exp(-levels[str(i * (i + 3) // 2)] / how["fine"]),
        )
        for i in range(size)
    ]
    for i in range(size):
        for j in range(i + 1):
            share = 1.0 if i == j else np.sin(levels[str(i * (i + 1) // 2 + j)] / how["angle"])
            found[:, i, j] = found[:, j, i] = share * deviation[i] * deviation[j]
    return found


def told(result: Result, side: str = "estimate") -> tuple[dict, dict[str, np.ndarray]]:
    made = spreads.plot_data(result)
    data, arrays = made.document, made.arrays
    mark = f"{side}/spread/"
    return data, {key.removeprefix(mark): v for key, v in arrays.items() if key.startswith(mark)}


@pytest.mark.parametrize("size", [2, 3, 6])
def test_covariances_are_told_to_a_few_percent(size: int) -> None:
    rng = np.random.default_rng(size)
    factors = rng.normal(size=(50, 3, size, size)) * 10.0 ** rng.uniform(-3, 3, (50, 3, 1, 1))
    matrices = factors @ factors.transpose(0, 1, 3, 2)
    truth = rng.uniform(0, 100, (50, 3, size))
    columns = tuple(f"s{k}" for k in range(size))
    side = Trajectories.from_array(truth, columns, covariance=matrices)
    points = Trajectories.from_array(truth, columns)
    result = evaluate(points, side, cutoff=1e4, distance="gaussian-wasserstein")
    data, levels = told(result)
    found = read(levels, data["spread"], size)
    exact = matrices.transpose(1, 0, 2, 3).reshape(-1, size, size)[levels["row"]]
    scale = np.sqrt(np.einsum("kii,kjj->kij", exact, exact))
    assert np.abs((found - exact) / scale).max() < 0.05
    assert len(levels["row"]) == 150
    assert told(result, "truth")[1] == {}


@pytest.mark.parametrize(("latitude", "factor"), [(0.0, 1.0), (60.0, 2.0)])
def test_a_map_has_equal_scales(shown: Callable, latitude: float, factor: float) -> None:
    """At 60 degrees a degree of longitude is half as long as one of latitude."""
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame({"id": "a", "t": range(5), "lat": 0.0, "lon": np.linspace(10, 12, 5)})
    rows["lat"] = latitude + np.linspace(-1, 1, 5)
    tab = shown(evaluate(rows, rows, cutoff=1.0, distance="haversine"))
    assert tab.run("document.getElementById('equal').checked")
    assert degrees(tab) == pytest.approx(factor, rel=0.02)
    pick(tab, "#axis-x", "lat")
    pick(tab, "#axis-y", "lon")
    assert degrees(tab) == pytest.approx(1 / factor, rel=0.02)
    pick(tab, "#axis-y", "t")
    assert not tab.run("document.getElementById('equal').checked")


def degrees(tab: Browser) -> float:
    """Pixels of a degree upwards by those of one across, by the labels of the ticks."""
    found = texts(tab, "[data-plane=in]")
    ticks = [(float(text), x, y) for text, x, y in found if re.fullmatch(r"-?[\d.]+", text)]
    across = sorted((value, x) for value, x, y in ticks if y == 460 - 16)
    up = sorted((value, -y) for value, x, y in ticks if x == 52)
    (a, left), (b, right) = across[0], across[-1]
    (c, low), (d, high) = up[0], up[-1]
    return (high - low) / (d - c) / ((right - left) / (b - a))


def test_points_and_what_is_nearly_singular() -> None:
    """No deviation is no ellipse; correlations of 1 stay; nothing is divided by 0."""
    flat = np.array([[[[4.0, 2.0], [2.0, 1.0]]], [[[0.0, 0.0], [0.0, 9.0]]], [np.zeros((2, 2))]])
    data, levels = told(laws(flat, 3))
    assert read(levels, data["spread"], 2) == pytest.approx(flat[:, 0], rel=0.05, abs=1e-12)
    made = spreads.plot_data(evaluate(np.zeros((3, 1, 2)), np.zeros((3, 1, 2)), cutoff=1.0))
    data, arrays = made.document, made.arrays
    assert data["spread"] == {}
    assert not any("spread" in name for name in arrays)


def test_many_covariances_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreads, "NUMBERS", 60)
    data, levels = told(laws(np.eye(2), 100))
    assert data["stride"] == 1
    assert data["spread"]["stride"] == 5  # 300 numbers
    assert levels["row"].tolist() == [*range(0, 100, 5), 99]


def test_a_class_without_estimates_has_no_ellipses(
    invoke: Callable, write: Callable, tmp_path: Path
) -> None:
    truth = write("a.csv", "id,t,x,y,class\n1,0,0,0,car\n1,1,0,0,car\n2,0,9,9,van\n")
    estimate = write("b.csv", "id,t,x,y,cov_xx,cov_yy,class\n7,0,0,0,1,4,car\n7,1,0,0,1,4,car\n")
    distance = ("--distance", "gaussian-wasserstein", "--by", "class", "-o", "out", "-q")
    assert invoke(truth, estimate, *distance).status == 0
    data = embedded((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert data["spread"]["largest"] == [1, 2]
    assert [a for a in data["arrays"] if "spread/row" in a[0]] == [["estimate/spread/row", 2]]


def test_the_plane_shows_what_was_read() -> None:
    """Not what a distance makes of it: scaled and whitened states."""
    points = np.array([[0.0, 0.0], [2.0, 4.0], [10.0, 10.0], [12.0, 14.0]])
    clouds = Clouds(points=points, weights=np.full(4, 0.5), first=np.array([0, 2, 4]))
    side = Trajectories(
        step=np.array([0, 1]),
        track=np.array([0, 0]),
        state=clouds.means,
        ids=np.array(["a"], object),
        times=np.array([0, 1]),
        columns=("x", "y"),
        clouds=clouds,
    )
    distance = CloudWasserstein(
        scale=(3.0, 3.0), inner="mahalanobis", covariance=np.diag([4.0, 9.0])
    )
    result = evaluate(side, side, cutoff=10.0, distance=distance)
    compared = result.proof.compared
    assert compared.truth.tolist() == [[1, 2], [11, 12]]
    assert compared.estimate_covariance == pytest.approx(np.array([[1, 2, 4]] * 2))


# --- in a browser ---------------------------------------------------------------------------------


def test_ellipses_are_drawn_and_can_be_hidden(shown: Callable) -> None:
    tab = shown(laws(np.diag([25.0, 4.0])), "#step=1")
    assert "4 of 4 95 % ellipses. All of the selected step" in note(tab)
    assert tab.run("document.querySelector('#plane-section .legend').innerText").endswith("ellipse")
    drawn = picture(tab)
    tab.run("document.getElementById('shapes').click()")
    assert picture(tab) != drawn
    assert note(tab) == ""


def test_an_ellipse_is_where_it_should_be(shown: Callable) -> None:
    """Its colour lies along the circle in which 95 % of a normal distribution are."""
    truth = np.array([[[0.0, 0.0], [100.0, 100.0]]])
    estimate = Trajectories.from_array(truth[:, :1] + 50, covariance=np.diag([100.0, 100.0]))
    result = evaluate(
        Trajectories.from_array(truth), estimate, cutoff=1.0, distance="gaussian-wasserstein"
    )
    tab = shown(result, "#step=0")
    picture(tab)
    # 100 units are 94 % of the lesser extent, and the estimate is in the middle.
    count = """(() => {
      const canvas = document.getElementById('plane'), wide = canvas.clientWidth, high = 460;
      const scale = Math.min(wide - 70, high - 50) * 0.94 / 100;
      const { data } = canvas.getContext('2d').getImageData(0, 0, wide, high);
      const vivid = (x, y) => {
        const at = 4 * (Math.round(y) * wide + Math.round(x)), rgb = data.slice(at, at + 3);
        return Math.max(...rgb) - Math.min(...rgb) > 60;
      };
      const hits = (radius) => Array.from({ length: 60 }, (_, k) => k * Math.PI / 30).filter((u) =>
        vivid((wide + 44) / 2 + radius * scale * Math.cos(u),
              (high - 22) / 2 + radius * scale * Math.sin(u))).length;
      return [RADIUS, 13, 40].map(hits);
    })()""".replace("RADIUS", str(10 * np.sqrt(chi2.ppf(0.95, 2))))
    on, inside, outside = tab.run(count)
    assert on >= 55
    assert inside + outside < 10


def test_boxes_are_drawn_around_their_centres(shown: Callable) -> None:
    boxes = np.array([[[0.0, 0.0, 10.0, 20.0]], [[30.0, 0.0, 10.0, 20.0]]])
    tab = shown(evaluate(boxes, boxes + 0.5, distance="iou"), "#step=1")
    across = "document.getElementById('axis-x').selectedOptions[0].text"
    assert tab.run(across) == "centre x"
    assert "4 of 4 boxes" in note(tab)
    pick(tab, "#axis-x", "width")
    picture(tab)
    assert note(tab) == ""


def test_one_column_has_intervals(shown: Callable) -> None:
    side = Trajectories.from_array(np.zeros((3, 1, 1)), covariance=np.full((3, 1, 1, 1), 4.0))
    tab = shown(evaluate(side, side, distance="gaussian-wasserstein"), "#step=1")
    assert "6 of 6 95 % intervals" in note(tab)
    drawn = picture(tab)
    tab.run("document.getElementById('shapes').click()")
    assert picture(tab) != drawn


def test_one_column_is_shown_over_time(shown: Callable) -> None:
    truth = np.linspace(0, 9, 10)[:, None, None]
    tab = shown(evaluate(truth, truth + 0.1, cutoff=1.0))
    names = "['x', 'y'].map((a) => document.getElementById('axis-' + a).selectedOptions[0].text)"
    assert tab.run(names) == ["t", "x"]
    assert not tab.run("document.getElementById('equal').checked")


def test_fingers_zoom_where_they_are(shown: Callable) -> None:
    """What is between two fingers stays there; the page is not zoomed, nothing is selected."""
    truth = np.stack([np.arange(21.0), np.arange(21.0) % 2 * 10], axis=1)[:, None]
    tab = shown(evaluate(truth, truth + 0.01, cutoff=1.0), width=390)
    tab.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    box = tab.box("#plane")
    x, y = box["x"] + (box["width"] + 44) / 2, box["y"] + box["height"] / 2
    before = picture(tab)

    def touch(kind: str, *apart: float) -> None:
        points = [{"x": x + side * a, "y": y, "id": k} for k, (side, a) in enumerate(apart)]
        tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    touch("touchStart", (-1, 30), (1, 30))
    for apart in (40, 60, 90):
        touch("touchMove", (-1, apart), (1, apart))
    touch("touchEnd")
    assert picture(tab) != before
    assert tab.run("visualViewport.scale") == 1
    assert tab.run("location.hash") == ""
    tab.call("Emulation.setTouchEmulationEnabled", enabled=False)


def test_keys_of_the_browser_stay_its_own(shown: Callable) -> None:
    """Ctrl + enlarges the page and Alt Left goes back, wherever the focus is."""
    truth = np.zeros((5, 1, 2))
    tab = shown(evaluate(truth, truth, cutoff=1.0), "#step=2")
    for name in ("costs", "lanes-canvas", "plane"):
        before = picture(tab)
        taken = tab.run(
            "['ctrlKey', 'metaKey', 'altKey'].map((held) =>"
            "['+', '-', '0', 'ArrowLeft'].map((key) =>"
            f"document.getElementById('{name}').dispatchEvent(new KeyboardEvent('keydown',"
            "{ key, [held]: true, cancelable: true, bubbles: true })))).flat()"
        )
        assert taken == [True] * 12
        assert picture(tab) == before
        assert tab.run("location.hash") == "#step=2"
    tab.run("document.getElementById('plane').focus()")
    tab.press("=")
    assert picture(tab) != before


def test_a_tap_selects_and_one_finger_scrolls(shown: Callable) -> None:
    truth = np.array([[[0.0, 0.0]], [[10.0, 10.0]], [[20.0, 0.0]]])
    tab = shown(evaluate(truth, truth + 0.1, cutoff=1.0), width=390)
    tab.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    box = tab.box("#plane")
    x = box["x"] + (box["width"] + 44) / 2
    before = picture(tab)
    for down in range(20, 300, 8):
        for kind, points in (("touchStart", [{"x": x, "y": box["y"] + down}]), ("touchEnd", [])):
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        if tab.run("location.hash"):
            break
    assert tab.run("location.hash").startswith("#step=1&")
    assert picture(tab) != before
    assert tab.run("getComputedStyle(document.getElementById('plane')).touchAction") in (
        "pan-x pan-y",
        "pan-y pan-x",
    )
    tab.call("Emulation.setTouchEmulationEnabled", enabled=False)


def particles(count: int, each: int, seed: int = 0, steps: int = 4) -> Result:
    """Clouds of so many tracks around truths, with uneven weights."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0, 100, (steps, count, 2))
    points = (truth[:, :, None] + rng.normal(0, 3, (steps, count, each, 2))).reshape(-1, 2)
    weights = rng.exponential(1, (steps * count, each))
    weights /= weights.sum(axis=1, keepdims=True)
    rows = steps * count
    clouds = Clouds(points=points, weights=weights.ravel(), first=np.arange(rows + 1) * each)
    side = Trajectories(
        step=np.repeat(np.arange(steps), count),
        track=np.tile(np.arange(count), steps),
        state=clouds.means,
        ids=np.array([f"e{k}" for k in range(count)], object),
        times=np.arange(steps),
        columns=("x", "y"),
        clouds=clouds,
    )
    made = Trajectories.from_array(truth, ("x", "y"))
    return evaluate(made, side, cutoff=20.0, distance="cloud-wasserstein")


def test_few_particles_are_all_told_with_their_weights() -> None:
    result = particles(2, 30)
    held, clouds = result.plot_data.estimate.particles, result.proof.compared.estimate_clouds
    by_track = np.argsort(np.tile(np.arange(2), 4), kind="stable")
    rows = [np.flatnonzero(held["row"] == k) for k in range(8)]
    assert [len(row) for row in rows] == [30] * 8
    for row, k in zip(rows, by_track, strict=True):
        np.testing.assert_array_equal(held["state"][row], clouds[int(k)][0])
        np.testing.assert_array_equal(held["weight"][row], clouds[int(k)][1])
    made, grid = result.plot_data, result.plot_data.document
    x = grid["low"][0] + made.arrays["estimate/particles/0"] * grid["quantum"][0]
    assert x == pytest.approx(held["state"][:, 0], abs=grid["quantum"][0])
    assert made.arrays["estimate/particles/weight"] / grid["shares"] == pytest.approx(
        held["weight"], abs=1e-4
    )


def test_many_particles_are_thinned_by_weight_without_chance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each that is told stands for whole slots of the weight, and their mean stays."""
    monkeypatch.setattr(spreads, "MAX_PARTICLES", 50)
    result = particles(1, 400, steps=1)
    held = result.plot_data.estimate.particles
    assert held["weight"].sum() == pytest.approx(1)
    np.testing.assert_allclose(held["weight"] * 50, np.rint(held["weight"] * 50), atol=1e-9)
    points = result.proof.compared.estimate_clouds.points
    assert (held["state"][:, None] == points[None]).all(axis=2).any(axis=1).all()
    # systematic resampling of 50: the mean is within a deviation / sqrt(50)
    mean = held["weight"] @ held["state"]
    assert np.abs(mean - result.proof.compared.estimate[0]).max() < 3 / np.sqrt(50)
    again = particles(1, 400, steps=1).plot_data.estimate.particles
    assert all((again[name] == held[name]).all() for name in held)
    assert result.plot_data.document["particles"]["estimate"] == [len(held["row"]), 400]


def test_beyond_that_fewer_steps_have_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreads, "PARTICLES", 40)
    made = particles(2, 30, steps=8).plot_data
    assert made.document["every"] == 4  # 16 clouds, 4 of at least 10 particles
    held = made.estimate.particles
    assert set(made.estimate.row["step"][held["row"]]) == {0, 4}
    assert len(held["row"]) <= 40


def test_the_page_of_a_particle_filter_is_small() -> None:
    """A million particles: 500 of each of 20 tracks at 100 steps."""
    result = particles(20, 500, steps=100)
    assert len(result.to_html()) < 2_000_000
    assert result.plot_data.document["particles"]["estimate"][1] == 1_000_000
    assert 90_000 < result.plot_data.document["particles"]["estimate"][0] <= 100_000


def test_particles_are_drawn_and_can_be_hidden(shown: Callable) -> None:
    tab = shown(particles(2, 30), "#step=1")
    legend = tab.run("document.querySelector('#plane-section .legend').innerText")
    assert "95 % ellipse" in legend
    assert "particles, area by weight" in legend
    assert "of 240 particles (of 240 in the page), their area by weight" in note(tab)
    drawn = picture(tab)
    tab.run("document.getElementById('particles').click()")
    assert picture(tab) != drawn
    assert "240 particles" not in note(tab)


def test_an_association_has_the_same_views(shown: Callable) -> None:
    """Pairs, what stays alone, and a gate around A; no word of truths."""
    a = np.array([[[0.0, 0.0], [50.0, 50.0], [90.0, 0.0]]] * 2)
    b = np.array([[[1.0, 0.0], [52.0, 50.0], [0.0, 90.0]]] * 2)
    first, second = (Trajectories.from_array(side, ("x", "y")) for side in (a, b))
    tab = shown(associate(first, second, cutoff=6.0), "#step=0&truth=1")
    assert tab.run("document.querySelector('h1').innerText").startswith("4 associated, 2 of A")
    legend = tab.run("document.querySelector('#plane-section .legend').innerText")
    assert "gate of A" in legend
    words = tab.run("document.body.innerText").lower()
    assert not re.search(r"\b(truth|estimate|missed|false|switch|tgospa)", words)
    detail = tab.run("document.getElementById('detail').innerText")
    assert "A alone: 2" in detail
    assert "with 1" in detail
    assert ink(tab, "#plane") > 10


def test_boxes_that_are_associated_by_corners(shown: Callable) -> None:
    """Their gates are not known of the centres that are shown."""
    boxes = np.array([[[0.0, 0.0, 10.0, 20.0]], [[30.0, 0.0, 10.0, 20.0]]])
    side = Trajectories.from_array(boxes, ("left", "top", "width", "height"))
    tab = shown(associate(side, side, cutoff=5.0), "#step=1")
    drawn = picture(tab)
    pick(tab, "#axis-x", "left")
    pick(tab, "#axis-y", "top")
    assert picture(tab) != drawn


def test_a_gate_is_where_pairs_end(shown: Callable) -> None:
    """Half of a wide picture is 100 units; the gate has a radius of 30."""
    a = Trajectories.from_array(np.array([[[0.0, 0.0], [100.0, 100.0], [50.0, 50.0]]]))
    tab = shown(associate(a, a, cutoff=30.0), "#step=0")
    picture(tab)
    count = """(() => {
      const canvas = document.getElementById('plane'), wide = canvas.clientWidth, high = 460;
      const scale = Math.min(wide - 70, high - 50) * 0.94 / 100;
      const { data } = canvas.getContext('2d').getImageData(0, 0, wide, high);
      const red = (x, y) => {
        const at = 4 * (Math.round(y) * wide + Math.round(x));
        return data[at] - data[at + 2] > 60;
      };
      const turns = Array.from({ length: 60 }, (_, k) => k * Math.PI / 30);
      return [30, 24, 36].map((radius) => turns.filter((u) =>
        red((wide + 44) / 2 + radius * scale * Math.cos(u),
            (high - 22) / 2 + radius * scale * Math.sin(u))).length);
    })()"""
    on, inside, outside = tab.run(count)
    assert on >= 15  # of dots
    assert inside + outside < 4


def test_particles_of_classes_stay_with_their_states() -> None:
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(3)
    rows = [
        {"id": f"{kind}{k}", "t": t, "class": kind, "x": 10 * k + t, "y": 5.0}
        for kind, count in (("car", 3), ("van", 2))
        for k in range(count)
        for t in range(4)
    ]
    truth = pandas.DataFrame(rows)
    estimate = truth.loc[truth.index.repeat(5)].reset_index(drop=True)
    estimate["weight"] = rng.uniform(1, 2, len(estimate))
    estimate[["x", "y"]] += rng.normal(0, 1, (len(estimate), 2))
    result = evaluate(truth, estimate, cutoff=50.0, distance="cloud-wasserstein", by="class")
    side = result.plot_data.estimate
    held = side.particles
    for k, state in enumerate(side.row["state"]):
        own = held["row"] == k
        assert own.sum() == 5
        assert held["weight"][own] @ held["state"][own] == pytest.approx(state)


def test_all_that_is_in_a_near_view_has_its_ellipse(shown: Callable) -> None:
    """Of many tracks none along them, until few states are in view."""
    tab = shown(particles(20, 30))
    assert "0 of 80 95 % ellipses; 0 of 2,400 particles" in note(tab)
    for _ in range(3):
        tab.run("document.querySelector('[data-plane=in]').click()")
    picture(tab)
    found = re.search(r"(\d+) of 80 95 % ellipses; ([\d,]+) of 2,400 particles", note(tab))
    assert found
    assert 5 < int(found[1]) <= 60
    assert int(found[2].replace(",", "")) == 30 * int(found[1])
