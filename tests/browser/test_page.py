"""The HTML report in a browser."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checkout import SAMPLES
from pages import NASTY, address, detail, ink, labels, texts
from partitioned import write_sides

from tgospa_eval import Result, Sinkhorn, evaluate, read_trajectories
from tgospa_eval.show import plot_data
from tgospa_eval.show import style as palette


@pytest.fixture(scope="module")
def sample() -> Result:
    pandas = pytest.importorskip("pandas")
    folder = SAMPLES / "quickstart"
    truth, estimate = (
        pandas.read_csv(folder / f"{name}.csv", dtype={"id": str}) for name in ("truth", "estimate")
    )
    return evaluate(truth, estimate, cutoff=10.0, switch_penalty=5.0, unit="m")


@pytest.mark.parametrize("dark", [False, True])
def test_everything_is_drawn(shown: Callable, sample: Result, dark: bool) -> None:
    tab = shown(sample, dark=dark)
    for name in ("costs", "lanes-canvas", "plane", "curve"):
        assert ink(tab, f"#{name}") > 10
    assert tab.run("document.querySelectorAll('#truth-table tbody tr').length") == 5


def test_of_data_in_parts_there_are_costs_over_time_and_the_costliest(
    shown: Callable, sample: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(plot_data, "MAX_STRETCHES", 7)
    files = (SAMPLES / "quickstart" / f"{name}.csv" for name in ("truth", "estimate"))
    folders = write_sides(tuple(map(read_trajectories, files)), tmp_path)
    tab = shown(evaluate(*folders, 10.0, 2, 5.0, memory="200MB", jobs=1))
    assert ink(tab, "#costs") > 10
    assert ink(tab, "#curve") > 10
    assert tab.run("document.getElementById('costs-note').textContent").endswith("mean of 8 steps")
    assert not tab.run("document.getElementById('lanes-canvas').clientWidth")
    assert not tab.run("document.getElementById('plane').clientWidth")
    assert tab.run("document.querySelectorAll('#truth-table tbody tr').length") == 5
    worst = tab.run("document.querySelector('#worst tbody th').innerText")
    assert worst == str(sample.worst(1)["steps"][0])


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
    assert tab.run("document.querySelectorAll('tr.chosen[data-side=truth]').length") == 1


def test_a_row_of_a_table_selects_and_sorting_works(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    first = "document.querySelector('#truth-table tbody th').innerText"
    assert tab.run(first) == "5"  # highest cost first
    tab.run("document.querySelector('#truth-table thead button').click()")
    assert tab.run(first) == "1"
    assert tab.run("document.querySelector('#truth-table th').ariaSort") == "ascending"
    box = tab.box("#truth-table tbody tr:nth-child(2) td:nth-child(3)")
    tab.click(box["x"] + 5, box["y"] + 5)
    assert address(tab) == "#truth=2"
    assert tab.run("document.querySelector('#truth-table tr.chosen th').innerText") == "2"


def test_a_row_of_a_repair_selects_the_lanes_that_it_is_about(
    shown: Callable, sample: Result
) -> None:
    found = sample.explain(8)
    rank = [repair.kind for repair in found.repairs].index("exchange") + 1
    tab = shown(replace(sample, explained=found))
    drawn = "document.getElementById('lanes-canvas').toDataURL()"
    frame = "new Promise((done) => requestAnimationFrame(() => done(true)))"
    before = tab.run(drawn)
    box = tab.box(f"#repairs tbody tr:nth-child({rank}) td:nth-child(2)")
    tab.click(box["x"] + 5, box["y"] + 5)
    assert address(tab) == f"#repair={rank}&step=37"
    assert "estimate: 101, 103\ntruth: 1, 3\n" in detail(tab)
    chosen = "[...document.querySelectorAll('#truth-table tr.chosen th')].map((e) => e.innerText)"
    assert sorted(tab.run(chosen)) == ["1", "3"]
    tab.wait(frame)
    both = tab.run(drawn)
    assert both != before
    tab.run("location.hash = '#step=37&truth=1'")  # one of the two lanes
    tab.wait("!document.querySelector('#repairs tr.chosen')")
    tab.wait(frame)
    assert tab.run(drawn) not in (before, both)
    tab.run(f"location.hash = '#repair={rank}'")
    tab.wait("document.querySelector('#repairs tr.chosen') !== null")
    assert "exchange estimates 101 and 103 from t = 37 on" in detail(tab)
    assert "savings do not add up" in tab.run("document.body.innerText.toLowerCase()")


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
    assert {"0", "+1", "+4", f"time from {first}"} <= labels(tab)


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


def luminance(colour: list[int]) -> float:
    """Relative luminance of WCAG of bytes in sRGB."""
    share = np.array(colour) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def contrast(one: list[int], other: list[int]) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


MIXED = """(paints) => {
  const pen = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  for (const paint of paints) { pen.fillStyle = paint; pen.fillRect(0, 0, 1, 1); }
  return [...pen.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""
"""The bytes of colours on top of one another."""

VALUE = "(name) => getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim()"


@pytest.mark.parametrize("dark", [False, True])
def test_texts_have_contrast(shown: Callable, sample: Result, dark: bool) -> None:
    """WCAG AA, 4.5 to 1, for the colours that texts have; 3 to 1 for parts of pictures."""
    tab = shown(sample, dark=dark)
    names = ("ink", "soft", "accent", "missed", "false", "localisation", "paper", "panel")
    *texts, picture, paper, panel = (tab.run(f"({MIXED})([({VALUE})('{name}')])") for name in names)
    assert all(contrast(text, ground) >= 4.5 for text in texts for ground in (paper, panel))
    assert contrast(picture, paper) >= 3


@pytest.mark.parametrize("dark", [False, True])
def test_names_on_bars_have_contrast(shown: Callable, sample: Result, dark: bool) -> None:
    """Of every track, also where the foot of a bar is darker."""
    tab = shown(sample, dark=dark)
    text = tab.run(f"({MIXED})([({VALUE})('label')])")
    for track in range(len(palette.TRACK_COLOURS)):
        bar = tab.run(f"({VALUE})('track-{track}')")
        for paints in ([bar], [bar, "rgb(0 0 0 / 0.25)"]):
            assert contrast(text, tab.run(f"({MIXED})({json.dumps(paints)})")) >= 4.5


def test_colours_are_those_of_all_pictures(shown: Callable, sample: Result) -> None:
    for dark, colours in ((False, palette.LIGHT), (True, palette.DARK)):
        tab = shown(sample, dark=dark)
        names = json.dumps(list(colours))
        assert tab.run(f"{names}.map({VALUE})") == list(colours.values())


def test_charts_name_their_axes(shown: Callable, sample: Result) -> None:
    names = labels(shown(sample))
    assert {"time", "cost (m²)", "per step, so far (m)"} <= names


@pytest.mark.parametrize("size", [5, 16, 90])
def test_names_of_lanes_have_the_room_that_they_need(shown: Callable, size: int) -> None:
    """Up to a quarter of the width; clicks know where the lanes begin."""
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame({"id": "t" * size, "t": range(20), "x": 0.0, "y": 0.0})
    tab = shown(evaluate(rows, rows.assign(id="e"), cutoff=1.0))
    names = {text for text in labels(tab) if set(text) <= {"t", "…"} and "t" in text}
    assert (names == {"t" * size}) == (size < 90)
    assert all(len(name) > 20 for name in names if "…" in name)
    box = tab.box("#lanes-canvas")
    first = max(x for text, x, _ in texts(tab) if text == "0")  # of the axis of time
    tab.click(box["x"] + first - 30, box["y"] + 30)
    assert address(tab) == f"#truth={'t' * size}"
    tab.click(box["x"] + first, box["y"] + 30)
    assert address(tab) == f"#step=0&truth={'t' * size}"


def test_large_costs_leave_room_for_the_name_of_their_axis(shown: Callable) -> None:
    truth = np.zeros((5, 1, 2))
    tab = shown(evaluate(truth, truth[:, :0], cutoff=8e3, unit="m"))
    assert "30,000,000" in labels(tab)
    at = {text: x for text, x, _ in texts(tab)}
    assert at["30,000,000"] > 24 + 10 * 6  # numbers end there; the name is around 0 + 9


def test_steps_are_to_scale(shown: Callable) -> None:
    """A click in the middle between steps 2 and 10 chooses the nearer one."""
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame({"id": "a", "t": [0, 1, 2, 10, 11, 12], "x": 0.0, "y": 0.0})
    tab = shown(evaluate(rows, rows, cutoff=1.0))
    box = tab.box("#costs")
    for t, step in ((1, 1), (5.7, 2), (6.4, 10), (12, 12)):
        tab.click(box["x"] + 74 + (t + 0.5) / 13 * (box["width"] - 84), box["y"] + 100)
        assert address(tab) == f"#step={step}"


def test_links_are_not_known_by_colour_alone(shown: Callable, sample: Result) -> None:
    tab = shown(sample)
    line = "getComputedStyle(document.querySelector('#truth-table a bdi')).textDecorationLine"
    assert tab.run(line) == "underline"


def test_a_wide_bracket_is_said_in_words(shown: Callable) -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, 10, (40, 12, 2))
    result = evaluate(truth, truth + rng.normal(0, 2, truth.shape), 5.0, solver=Sinkhorn(epsilon=1))
    tab = shown(result)
    assert not result.certified
    words = tab.run("document.querySelector('.proof').innerText")
    assert words.startswith("bounds")
    assert "best assignment found" in words
    assert "is the cheapest" not in tab.run("document.querySelector('.how').textContent")


def test_axes_of_long_times_have_several_labels(shown: Callable) -> None:
    """On 360 pixels labels leave out what all times share."""
    pandas = pytest.importorskip("pandas")
    times = [f"2024-03-0{1 + k // 24}T{k % 24:02}:15:00.500Z" for k in range(30)]
    rows = pandas.DataFrame({"id": "a", "t": times, "x": 0.0, "y": 0.0})
    result = evaluate(rows, rows, cutoff=1.0)
    assert {"03-01", "03-02", "time, 2024"} <= labels(shown(result, width=360))


def test_times_with_rounding_are_labelled_without(shown: Callable) -> None:
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame({"id": "a", "t": np.arange(100) * 0.1, "x": 0.0, "y": 0.0})
    assert 0.30000000000000004 in rows.t.to_numpy()
    found = labels(shown(evaluate(rows, rows, cutoff=1.0)))
    assert {"2", "4"} <= found
    assert max(map(len, found)) < 40


def test_a_table_says_what_it_leaves_out(shown: Callable) -> None:
    truth = np.zeros((2, 60, 2))
    truth[:, :, 0] = np.arange(60) * 100
    tab = shown(evaluate(truth, truth, cutoff=1.0))
    rows = "document.querySelectorAll('#truth-table tbody tr').length"
    assert tab.run(rows) == 50
    assert "The first 50 of 60" in tab.run("document.getElementById('truth-table').innerText")
    tab.run("document.querySelector('#truth-table button.more').click()")
    assert tab.run(rows) == 60


def test_pictures_follow_the_width(shown: Callable, sample: Result) -> None:
    """Also where a scroll bar comes or goes and the window stays."""
    tab = shown(sample)
    tab.run("document.getElementById('plane-section').style.width = '300px'")
    tab.wait("document.getElementById('plane').width === 300")


def test_a_click_on_the_dearest_of_several_steps_selects_that(shown: Callable) -> None:
    truth = np.zeros((3000, 1, 2))
    estimate = truth.copy()
    estimate[1501] = np.nan
    tab = shown(evaluate(truth, estimate, cutoff=1.0), width=700)
    assert "costliest of" in tab.run("document.getElementById('costs-note').innerText")
    box = tab.box("#costs")
    each = (box["width"] - 84) / 3000
    for step in (1500, 1502):  # within a pixel
        tab.run("document.querySelector('[data-do=clear]').click()")
        tab.click(box["x"] + 74 + (step + 0.5) * each, box["y"] + 60)
        if address(tab) == "#step=1501":
            break
    assert address(tab) == "#step=1501"
