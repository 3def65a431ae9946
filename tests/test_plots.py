"""What is handed to the pictures, and that they are the same bytes each time."""

import pytest

pytest.importorskip("matplotlib")

from tgospa_eval import plots
from tgospa_eval.plots import comparison


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
             "error": spread(1e-3 * targets)},
            {"name": "sinkhorn 0.01", "epsilon": 0.01, "seconds": spread(1), "error": spread(1e-5)},
        ],
    }  # fmt: skip


STUDY = {"sizes": [size(m, t) for m in (20, 10) for t in (100, 50)]}


def test_solver_pictures() -> None:
    made = comparison.solver_pictures(DOCUMENT)
    assert list(made) == ["time_over_error", "error_over_epsilon", "convergence"]
    found = data(made["error_over_epsilon"].axes[0])
    assert found == {
        "upper bound (TGOSPA)": ([0.01, 0.1], [1e-4, 1e-2]),
        "lower bound": ([0.01, 0.1], [2e-4, 2e-2]),
    }
    found = data(made["time_over_error"].axes[0])
    assert found["certified"] == ([comparison.FLOOR], [1.25])  # no error has no logarithm
    assert found["sinkhorn 0.1"] == ([1e-2], [0.625])
    lines = made["convergence"].axes[0].get_lines()
    assert list(lines[0].get_ydata()) == pytest.approx([0.2, comparison.FLOOR])
    assert list(lines[1].get_ydata()) == pytest.approx([0.1, 0.01])


def test_study_pictures() -> None:
    made = comparison.study_pictures(STUDY)
    time, error, time_steps, _ = made["scaling"].axes
    assert data(time)["certified"] == ([10, 20], [10, 20])  # at the most steps
    assert data(time_steps)["sinkhorn 0.1"] == ([50, 100], [50, 100])
    assert "certified" not in data(error)  # named below the threshold instead
    assert any("certified: below" in text.get_text() for text in error.texts)
    assert data(made["error_over_epsilon"].axes[0])["m = 20"] == ([0.01, 0.1], [1e-5, 2e-2])


def test_what_failed_is_not_drawn() -> None:
    """Where all failed there is no picture; where the largest size did it has no line."""
    none = {"mean": None, "deviation": None, "max": None}
    failed = [
        {**size, "solvers": [{**s, "seconds": none, "error": none} for s in size["solvers"]]}
        for size in STUDY["sizes"]
    ]
    assert comparison.study_pictures({"sizes": failed}) == {}
    mixed = {"sizes": [STUDY["sizes"][3], *failed[:3]]}
    assert len(plots.pictures(comparison.study_pictures, mixed)) == 2


def test_estimates() -> None:
    made = comparison.estimate_pictures({"_a$b": [1.0, 2.0, 0.0], "c": [0.0, 5.0, 1.0]})
    lines = made["cumulative"].axes[0].get_lines()
    assert [list(line.get_ydata()) for line in lines] == [[1, 3, 3], [0, 5, 6]]
    assert [text.get_text() for text in made["cumulative"].legends[0].get_texts()] == [
        r"_a\$b: 3", "c: 6",
    ]  # fmt: skip
    assert plots.pictures(comparison.estimate_pictures, {"_a$b": [1.0]})
    assert not comparison.estimate_pictures({})
    assert not comparison.estimate_pictures({"nothing": []})


def test_pictures_are_the_same_bytes() -> None:
    import matplotlib as mpl

    once = plots.pictures(comparison.study_pictures, STUDY)
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 9}):
        again = plots.pictures(comparison.study_pictures, STUDY)
        assert mpl.rcParams["font.size"] == 20
    assert once == again
    assert list(once) == ["error_over_epsilon.png", "scaling.png"]
    assert b"Software" not in once["scaling.png"]
