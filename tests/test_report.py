"""The HTML report: what is handed to it, and what a browser does with it."""

import base64
import json
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from browser import Browser

from tgospa_eval import evaluate
from tgospa_eval.evaluation import Result
from tgospa_eval.reports import drawing
from tgospa_eval.reports.drawing import NONE, curves, document, packed
from tgospa_eval.reports.html import page

NASTY = ("<script>alert(1)</script>", "\"quotes' & <b>", "</script><!--", "שלום \u202eabc", "a\\nb")


def unpacked(text: str, arrays: list[tuple[str, int]]) -> dict[str, np.ndarray]:
    """What the script makes of the packed text, written anew from the description of `packed`."""
    flat = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).astype(np.int64)
    found, at = {}, 0
    for name, size in arrays:
        planes = flat[at : at + 4 * size].reshape(4, size)
        code = sum(plane << 8 * k for k, plane in enumerate(planes))
        found[name] = np.cumsum((code >> 1) ^ -(code & 1))
        at += 4 * size
    assert at == len(flat)
    return found


def embedded(html: str) -> dict:
    """The document inside a page."""
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)
    assert text
    return json.loads(text[1])


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


def test_costs_and_tracks_are_those_of_the_result() -> None:
    result = swap()
    data, _ = document(result)
    assert data["times"] == [0, 1, 2, 3]
    for name, costs in data["costs"].items():
        assert costs == pytest.approx(result.per_step_table()[name])
    assert data["costs"]["switch"] == [0, 0, 2, 0]
    assert data["counts"]["missed"] == [0, 0, 0, 1]
    assert data["counts"]["false"] == [0, 1, 0, 0]
    assert data["tracks"]["truth"]["unassigned"] == [1, 0]
    assert data["tracks"]["estimate"]["total"] == pytest.approx([2, 1.5, 1])
    assert data["switches"]["step"] == [2, 2]
    assert data["switches"]["from"] == [0, 1]
    assert data["switches"]["to"] == [1, 0]


def test_lanes_are_runs_of_one_assignment() -> None:
    _, arrays = document(swap())
    runs = [arrays[f"truth/run/{name}"].tolist() for name in ("track", "begin", "end", "other")]
    assert list(zip(*runs, strict=True)) == [
        (0, 0, 1, 0),
        (0, 2, 2, 1),
        (0, 3, 3, NONE),
        (1, 0, 1, 1),
        (1, 2, 3, 0),
    ]
    runs = [arrays[f"estimate/run/{name}"].tolist() for name in ("track", "begin", "end", "other")]
    assert (2, 1, 1, NONE) in list(zip(*runs, strict=True))


def test_a_hole_in_a_trajectory_ends_a_run() -> None:
    truth = np.zeros((5, 1, 2))
    truth[2] = np.nan
    _, arrays = document(evaluate(truth, truth, cutoff=1.0))
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


def test_positions_are_told_to_a_fraction_of_their_range() -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(1e6, 50, (20, 4, 3))
    data, arrays = document(evaluate(truth, truth + 0.1, cutoff=5.0))
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
    full, all_ = document(result)
    monkeypatch.setattr(drawing, "VALUES", 800)
    thin, arrays = document(result)
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


def test_the_curve_ends_at_the_value_per_step() -> None:
    result = swap()
    found = curves(result)
    # cost by step: 0.5, 0.5 + 1, 0.5 + 2, 1
    assert found["total"] == pytest.approx([0.5, 2 / 2, 4.5 / 3, 5.5 / 4])
    assert found["total"][-1] == pytest.approx(result.normalised["tgospa"])


def test_one_page_that_loads_nothing() -> None:
    html = page(swap())
    assert not re.search(r"(src|href)\s*=\s*[\"']?\s*(https?:)?//", html)
    assert "default-src 'none'" in html
    assert "<link" not in html
    assert " src=" not in html


def test_ids_and_paths_do_not_become_markup() -> None:
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame(
        [(name, t, 10.0 * k, 0.0) for k, name in enumerate(NASTY) for t in range(3)],
        columns=["id", "t", "x", "y"],
    )
    html = page(evaluate(rows, rows, cutoff=1.0), (NASTY[0], "\udc80bytes.csv"))
    assert html.count("<script") == html.count("</script") == 3
    assert "alert(1)" in html  # shown as text
    assert sorted(embedded(html)["tracks"]["truth"]["id"]) == sorted(NASTY)
    html.encode()


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


def test_without_the_extra_the_rest_is_written(
    invoke: Callable, quickstart: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    status, _, err = invoke(*quickstart, "-o", "out")
    assert status == 0
    assert "tgospa-eval[report]" in err
    assert (tmp_path / "out" / "result.json").exists()
    assert not (tmp_path / "out" / "report.html").exists()


# --- in a browser ---------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if not browser.PROGRAM:
        pytest.skip("no Chromium on this machine")
    opened = Browser(tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


@pytest.fixture
def shown(chromium: Browser, tmp_path: Path) -> Iterator[Callable[..., Browser]]:
    """Open the page of a result; at the end it must have logged nothing and asked for nothing."""

    def show(result: Result, hash_: str = "", **settings: object) -> Browser:
        path = tmp_path / "report.html"
        path.write_text(page(result), encoding="utf-8")
        chromium.open(path.as_uri() + hash_, **settings)
        return chromium

    yield show
    assert chromium.complaints == []
    asked = [address for address in chromium.requests if not address.startswith("blob:")]
    assert {address.partition("#")[0] for address in asked} <= {
        (tmp_path / "report.html").as_uri(),
        "about:blank",
    }


@pytest.fixture(scope="module")
def sample() -> Result:
    pandas = pytest.importorskip("pandas")
    folder = Path(__file__).parents[1] / "sample_data" / "quickstart"
    truth, estimate = (
        pandas.read_csv(folder / f"{name}.csv", dtype={"id": str}) for name in ("truth", "estimate")
    )
    return evaluate(truth, estimate, cutoff=10.0, switch_penalty=5.0, unit="m")


def address(tab: Browser) -> str:
    return tab.run("decodeURIComponent(location.hash)")


def detail(tab: Browser) -> str:
    return tab.run("document.getElementById('detail').innerText")


def ink(tab: Browser, selector: str) -> int:
    """How many colours a canvas shows."""
    return tab.run(
        f"(() => {{ const c = document.querySelector('{selector}');"
        "const d = new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height)"
        ".data.buffer); return new Set(d).size; })()"
    )


@pytest.mark.parametrize("dark", [False, True])
def test_everything_is_drawn(shown: Callable, sample: Result, dark: bool) -> None:
    tab = shown(sample, dark=dark)
    for name in ("costs", "lanes-canvas", "plane", "curve"):
        assert ink(tab, f"#{name}") > 10
    assert tab.run("document.querySelectorAll('#truth-table tbody tr').length") == 5
    paint = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
    assert tab.run(paint) < 2000


def test_a_click_on_the_costs_selects_a_step_everywhere(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    box = tab.box("#costs")
    wide = (box["width"] - 84) / 56
    before = tab.run("document.getElementById('plane').toDataURL()")
    tab.click(box["x"] + 74 + (37 - 3 + 0.5) * wide, box["y"] + 60)
    assert address(tab) == "#step=37"
    assert "truth 1 from 101 to 103" in detail(tab)
    assert tab.run("document.getElementById('step').value") == "37"
    assert "step 37" in tab.run("document.getElementById('costs').ariaValueText")
    tab.wait("new Promise((done) => requestAnimationFrame(() => done(true)))")
    assert tab.run("document.getElementById('plane').toDataURL()") != before


def test_a_click_on_a_lane_selects_truth_and_step(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    box = tab.box("#lanes-canvas")
    tab.click(box["x"] + 74 + (24 - 3 + 0.5) * (box["width"] - 84) / 56, box["y"] + 30)
    assert address(tab) == "#step=24&truth=1"
    assert "followed by \u2068101\u2069 from 22 to 36" in detail(tab)
    assert tab.run("document.querySelectorAll('tr.chosen[data-side=truth]').length") == 2


def test_a_row_of_a_table_selects_and_sorting_works(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    first = "document.querySelector('#truth-table tbody th').innerText"
    assert tab.run(first) == "5"  # dearest first
    tab.run("document.querySelector('#truth-table thead button').click()")
    assert tab.run(first) == "1"
    assert tab.run("document.querySelector('#truth-table th').ariaSort") == "ascending"
    box = tab.box("#truth-table tbody tr:nth-child(2) td:nth-child(3)")
    tab.click(box["x"] + 5, box["y"] + 5)
    assert address(tab) == "#truth=2"
    assert tab.run("document.querySelector('#truth-table tr.chosen th').innerText") == "2"


def test_a_point_in_the_plane_selects(shown: Callable) -> None:
    truth = np.array([[[0.0, 0.0]], [[10.0, 10.0]], [[20.0, 0.0]]])
    tab = shown(evaluate(truth, truth + 0.1, cutoff=1.0))
    box = tab.box("#plane")
    # The second of three steps is in the middle across, at the top of what is fitted.
    for down in range(20, 300, 8):
        tab.click(box["x"] + (box["width"] + 44) / 2, box["y"] + down)
        if address(tab):
            break
    assert address(tab) in ("#step=1&truth=0", "#step=1&estimate=0")


def test_keys_move_the_selection(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    tab.run("document.getElementById('costs').focus()")
    tab.press("PageDown")
    assert address(tab) == "#step=8"
    tab.press("ArrowRight")
    assert address(tab) == "#step=9"
    tab.run("document.getElementById('lanes-canvas').focus()")
    tab.press("ArrowDown")
    tab.press("ArrowDown")
    assert address(tab) == "#step=9&truth=2"
    tab.press("Escape")
    assert address(tab) == ""
    tab.run("document.querySelector('#worst a').focus()")
    tab.press("Enter")
    assert address(tab) == "#step=8"


def test_every_control_is_reached_by_tab(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    reached = set()
    for _ in range(40):
        tab.press("Tab")
        reached.add(tab.run("document.activeElement.id || document.activeElement.dataset.do"))
    assert {"costs", "lanes-canvas", "plane", "step", "back", "next", "all", "order"} <= reached


def test_the_address_brings_the_selection_back(shown: Callable, sample: Result) -> None:
    tab = shown(sample, "#step=37&truth=3&range=30..40")
    assert "Truth 3" in detail(tab)
    assert "Step 37" in detail(tab)
    assert "Steps 30 to 40" in tab.run("document.getElementById('plane-note').innerText")
    tab.run("location.hash = '#estimate=107'")
    tab.wait("document.getElementById('detail').innerText.includes('Estimate 107')")
    assert "Step 37" not in detail(tab)
    tab.run("location.hash = '#step=nonsense&truth=%E0%A4%A'")
    tab.wait("document.getElementById('detail').innerText.startsWith('Click')")


def test_a_drag_shows_fewer_steps(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    box = tab.box("#costs")
    wide = (box["width"] - 84) / 56
    tab.drag(box["x"] + 74 + 10.5 * wide, box["y"] + 50, box["x"] + 74 + 20.5 * wide)
    assert address(tab) == "#range=13..23"


def test_ids_are_shown_as_they_are(shown: Callable) -> None:
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame(
        [(name, t, 10.0 * k, 0.0) for k, name in enumerate(NASTY) for t in range(3)],
        columns=["id", "t", "x", "y"],
    )
    tab = shown(evaluate(rows, rows.assign(x=rows.x + 0.1), cutoff=1.0))
    names = "[...document.querySelectorAll('#truth-table tbody th')].map((e) => e.textContent)"
    assert sorted(tab.run(names)) == sorted(NASTY)
    for name in NASTY:
        tab.run(f"location.hash = 'truth=' + encodeURIComponent({json.dumps(name)})")
        tab.wait(f"document.getElementById('detail').textContent.includes({json.dumps(name)})")
    assert tab.run("document.querySelectorAll('script').length") == 3


def test_little_is_drawn_too(shown: Callable) -> None:
    tab = shown(evaluate(np.zeros((1, 1, 1)), np.zeros((1, 0, 1)), cutoff=1.0))
    for name in ("forth", "in", "out", "next", "back"):
        tab.run(f"document.querySelector('[data-do={name}]').click()")
    assert address(tab) == "#step=0"
    assert "missed: 0" in detail(tab)


def test_times_and_places_may_be_large(shown: Callable) -> None:
    """Nanoseconds since 1970 and metres of UTM: beyond the digits of a browser, and far away."""
    pandas = pytest.importorskip("pandas")
    first = 1_700_000_000_000_000_000
    rows = pandas.DataFrame({"id": "a", "t": first + np.arange(5), "x": 4e6, "y": 1e17})
    result = evaluate(rows, rows.iloc[:4], cutoff=1.0)
    tab = shown(result, f"#step={first + 3}&truth=a")
    assert f"Step {first + 3}" in detail(tab)
    tab.run("document.querySelector('[data-do=forth]').click()")
    assert address(tab) == f"#step={first + 4}&truth=a"
    assert "missed" in detail(tab)


def test_nothing_is_said_in_words(shown: Callable) -> None:
    nothing = np.zeros((0, 0, 2))
    tab = shown(evaluate(nothing, nothing, cutoff=1.0))
    assert "nothing to draw" in tab.run("document.getElementById('notice').innerText")


def test_narrow_screens_do_not_scroll_sideways(shown: Callable, sample: Result) -> None:
    tab = shown(sample, "#step=37&truth=1", width=400)
    assert tab.run("document.documentElement.scrollWidth") <= 400


def test_prints(shown: Callable, sample: Result, tmp_path: Path) -> None:
    tab = shown(sample, dark=True)
    tab.pdf(tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    assert not tab.run("document.documentElement.classList.contains('printing')")


def test_texts_have_contrast(shown: Callable, sample: Result) -> None:
    """WCAG AA, 4.5 to 1, for the colours that texts have, in both schemes."""
    script = """(() => {
      const rgb = (name) => { const c = document.createElement('canvas').getContext('2d');
        c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
        c.fillRect(0, 0, 1, 1); return [...c.getImageData(0, 0, 1, 1).data].slice(0, 3); };
      return ['ink', 'soft', 'accent', 'missed', 'false', 'paper', 'panel']
        .map((name) => rgb(`--${name}`)); })()"""

    def luminance(colour: list[int]) -> float:
        linear = [
            v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
            for v in np.array(colour) / 255
        ]
        return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))

    for dark in (False, True):
        *texts, paper, panel = map(luminance, shown(sample, dark=dark).run(script))
        for text in texts:
            for ground in (paper, panel):
                low, high = sorted((text, ground))
                assert (high + 0.05) / (low + 0.05) >= 4.5
