"""What is handed to the pictures, and that they are the same bytes each time."""

import pytest

pytest.importorskip("matplotlib")

import itertools

from tgospa_eval.show.chart_list import CHARTS, Pictures, pictures
from tgospa_eval.show.several import FLOOR
from tgospa_eval.show.style import STYLES, styled


def drawn(kind: str, subject: object, name: str = "screen") -> dict:
    """By name all pictures that show something."""
    with styled(name) as style:
        made = {n: Pictures().draw(chart, subject, style) for n, chart in CHARTS[kind].items()}
    return {name: figure for name, figure in made.items() if figure is not None}


def run(solver: str, epsilon: float | None, error: float, seconds: float) -> dict:
    bounds = ((12, 90.0, 120.0), (36, 99.0, 100.0))
    history = [{"sweep": sweep, "lower": low, "upper": high} for sweep, low, high in bounds]
    return {
        "name": solver if epsilon is None else f"{solver} {epsilon:g}",
        "solver": solver,
        "epsilon": epsilon,
        "error": error,
        "lower_error": 2 * error,
        "seconds": {"solve": seconds, "certify": 0.25 * seconds},
        "history": history if epsilon else [],
        "entropic": {"error": 5 * error, "cost_error": 4 * error} if epsilon else None,
    }


DOCUMENT = {
    "referee": {"total": {"lower": 100.0, "upper": 100.0}},
    "runs": [
        run("certified", None, 0.0, 1.0),
        run("sinkhorn", 0.1, 1e-2, 0.5),
        run("sinkhorn", 0.01, 1e-4, 2.0),
    ],
}


def data(axis) -> dict[str, tuple[list[float], list[float]]]:
    return {
        line.get_label(): (list(line.get_xdata()), list(line.get_ydata()))
        for line in axis.get_lines()
    }


def spread(mean: float) -> dict:
    return {"mean": mean, "deviation": 0.1 * mean, "max": 1.1 * mean}


def size(targets: int, steps: int) -> dict:
    return {
        "targets": targets,
        "steps": steps,
        "solvers": [
            {"name": "certified", "epsilon": None, "seconds": spread(targets), "error": spread(0)},
            {"name": "sinkhorn 0.1", "epsilon": 0.1, "seconds": spread(steps),
             "error": spread(1e-3 * targets), "entropic_error": spread(0.25)},
            {"name": "sinkhorn 0.01", "epsilon": 0.01, "seconds": spread(1), "error": spread(1e-5),
             "entropic_error": spread(0.125)},
        ],
    }  # fmt: skip


STUDY = {"sizes": [size(m, t) for m in (20, 10) for t in (100, 50)]}


def test_solver_pictures() -> None:
    made = drawn("solvers", DOCUMENT)
    assert list(made) == ["time_over_error", "error_over_epsilon", "convergence"]
    found = data(made["error_over_epsilon"].axes[0])
    assert found == {
        "upper bound (TGOSPA)": ([0.01, 0.1], [1e-4, 1e-2]),
        "lower bound": ([0.01, 0.1], [2e-4, 2e-2]),
        "entropic value": ([0.01, 0.1], [5e-4, 5e-2]),
        "its cost, without entropy": ([0.01, 0.1], [4e-4, 4e-2]),
    }
    found = data(made["time_over_error"].axes[0])
    assert found["certified"] == ([FLOOR], [1.25])  # no error has no logarithm
    assert found["sinkhorn 0.1"] == ([1e-2], [0.625])
    lines = made["convergence"].axes[0].get_lines()
    assert list(lines[0].get_ydata()) == pytest.approx([0.2, FLOOR])
    assert list(lines[1].get_ydata()) == pytest.approx([0.1, 0.01])


def test_study_pictures() -> None:
    made = drawn("study", STUDY)
    time, error, time_steps, _ = made["scaling"].axes
    assert data(time)["certified"] == ([10, 20], [10, 20])  # at the most steps
    assert data(time_steps)["sinkhorn 0.1"] == ([50, 100], [50, 100])
    assert "certified" not in data(error)  # named below the threshold instead
    assert "certified: below 1e-09" in error.get_title(loc="left")
    found = data(made["error_over_epsilon"].axes[0])
    assert found["m = 20"] == ([0.01, 0.1], [1e-5, 2e-2])
    assert found["m = 20, entropic value"] == ([0.01, 0.1], [0.125, 0.25])


def test_what_failed_is_not_drawn() -> None:
    """Where all failed there is no picture; where the largest size did it has no line."""
    none = {"mean": None, "deviation": None, "max": None}
    failed = [
        {
            **size,
            "solvers": [
                {**s, "seconds": none, "error": none, "entropic_error": none}
                for s in size["solvers"]
            ],
        }
        for size in STUDY["sizes"]
    ]
    assert drawn("study", {"sizes": failed}) == {}
    mixed = {"sizes": [STUDY["sizes"][3], *failed[:3]]}
    assert len(pictures("study", mixed)) == 2


def test_lines_differ_in_grey() -> None:
    """By their dashes, in pictures as wide as the style says; a legend lies beside the axes."""
    for style in STYLES:
        for made in (drawn("solvers", DOCUMENT, style), drawn("study", STUDY, style)):
            for name, picture in made.items():
                lines = [ln for ln in picture.axes[0].get_lines() if ln.get_label()[0] != "_"]
                dashes = [str(line._unscaled_dash_pattern) for line in lines]
                assert name == "time_over_error" or len({*dashes}) == len(dashes) > 1
                assert picture.get_size_inches()[0] == STYLES[style].width
                assert picture.axes[0].get_legend() is None


def test_estimates() -> None:
    made = drawn("estimates", ([7, 8, 9], {"_a$b": [1.0, 2.0, 0.0], "c": [0.0, 5.0, 1.0]}))
    lines = made["cumulative"].axes[0].get_lines()
    assert [list(line.get_ydata()) for line in lines] == [[1, 3, 3], [0, 5, 6]]
    assert lines[0].get_xdata().tolist() == [7, 8, 9]  # times, not numbers of steps
    assert [text.get_text() for text in made["cumulative"].legends[0].get_texts()] == [
        "_a$b: 3", "c: 6",
    ]  # fmt: skip
    assert not drawn("estimates", ([], {}))
    assert not drawn("estimates", ([], {"nothing": []}))


def test_no_panel_is_empty() -> None:
    """Where nobody errs there is no picture of errors, and times are drawn as bars."""
    none = {"error": 0.0, "lower_error": 0.0, "history": [], "entropic": None}
    runs = [run | none for run in DOCUMENT["runs"]]
    made = drawn("solvers", {**DOCUMENT, "runs": runs})
    assert list(made) == ["time_over_error"]
    texts = [text.get_text() for text in made["time_over_error"].axes[0].texts]
    assert texts == [" 1.25", " 0.625", " 2.5"]
    exact = [
        {
            **size,
            "solvers": [
                {**s, "error": spread(0), "entropic_error": spread(0)} for s in size["solvers"]
            ],
        }
        for size in STUDY["sizes"]
    ]
    made = drawn("study", {"sizes": exact})
    assert list(made) == ["scaling"]
    assert [len(axis.get_lines()) for axis in made["scaling"].axes] == [3, 3]


@pytest.mark.parametrize(("low", "high"), [(2e-3, 6e-3), (3e-3, 4e-2), (1e-2, 80.0)])
def test_names_of_ticks_do_not_overlap(low: float, high: float) -> None:
    runs = [run("certified", None, 0.0, low), run("sinkhorn", 0.1, 3e-9, high)]
    made = drawn("solvers", {**DOCUMENT, "runs": runs})["time_over_error"]
    made.draw_without_rendering()
    for which, side in ((made.axes[0].xaxis, "x"), (made.axes[0].yaxis, "y")):
        texts = [*which.get_ticklabels(), *which.get_ticklabels(minor=True)]
        boxes = [text.get_window_extent() for text in texts if text.get_text()]
        ends = sorted((getattr(box, f"{side}0"), getattr(box, f"{side}1")) for box in boxes)
        assert len(ends) >= 2
        assert all(a[1] < b[0] for a, b in itertools.pairwise(ends))


def test_pictures_are_the_same_bytes() -> None:
    import matplotlib as mpl

    estimates = ([7, 8, 9], {"a": [1.0, 2.0, 0.0], "c": [0.0, 5.0, 1.0]})
    once = pictures("estimates", estimates)
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 9}):
        again = pictures("estimates", estimates)
        assert mpl.rcParams["font.size"] == 20
    assert once == again
    assert list(once) == ["cumulative.png"]
    assert b"Software" not in once["cumulative.png"]
