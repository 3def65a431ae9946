"""What batches, comparisons, sweeps and results have in common: tables, documents, pictures."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tgospa_eval import ConfigError, batch, compare, evaluate, sweep
from tgospa_eval.api.report import Reportable

GIVEN: dict[str, Any] = {"cutoff": 5.0, "switch_penalty": 3.0}
STEPS = 5


def sides() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A truth, and three runs of two trackers, one of which has a name for HTML and LaTeX."""
    rng = np.random.default_rng(2)
    truth = np.cumsum(rng.normal(size=(STEPS, 2, 2)), axis=0)
    noise = rng.normal(size=(2, 3, STEPS, 2, 2))
    return truth, {"a<b>_&": truth + noise[0], "far": truth + 3 * noise[1]}


@pytest.fixture(scope="module")
def studies() -> dict[str, Reportable]:
    pytest.importorskip("pyarrow")
    truth, estimates = sides()
    far = estimates["far"][0]
    solvers: Any = ["certified", "sinkhorn"]
    return {
        "batch": batch(truth, estimates, per_step=True, workers=1, **GIVEN),
        "estimates": compare(truth, estimates, **GIVEN),
        "solvers": compare(truth, far, solvers=solvers, **GIVEN),
        "sweep": sweep(truth, far, cutoff=[1, 2, 5]),
        "result": evaluate(truth, far, **GIVEN),
    }


@pytest.mark.process
@pytest.mark.parametrize(
    ("kind", "rows", "word"),
    [
        ("batch", 2, "RMS-TGOSPA"),
        ("estimates", 2, "localisation"),
        ("solvers", 2, "sinkhorn"),
        ("sweep", 3, "proven exact"),
        ("result", 1, "localisation"),
    ],
)
def test_tables_and_documents(
    studies: dict[str, Reportable], kind: str, rows: int, word: str
) -> None:
    study: Any = studies[kind]
    assert len(study.table()) == rows
    assert study.to_json().startswith("{")
    assert r"\toprule" in study.to_latex()
    assert "|---" in study.to_markdown().replace(" ", "")
    assert all(word in text for text in (study.to_latex(), study.to_markdown()))
    card = study._repr_html_()
    assert word in card
    assert "</table>" in card
    assert "<b>_" not in card
    assert "a<b>" not in card


@pytest.mark.process
def test_comparisons_and_curves(studies: dict[str, Reportable]) -> None:
    for kind in ("batch", "estimates"):
        study: Any = studies[kind]
        assert study.comparisons[["first", "second"]].values.tolist() == [["a<b>_&", "far"]]
    curves: Any = studies["batch"]
    assert len(curves.curves) == 2 * 2 * STEPS  # groups, kinds
    steps: Any = studies["estimates"]
    assert len(steps.curves) == 2 * 3 * STEPS
    total = steps.curves.groupby("estimate")["total"].sum() / 3
    assert total["far"] == pytest.approx(steps.table().set_index("name")["total"]["far"])


PICTURES = {
    "batch": ("parts", "heat", "curve", "curve_parts"),
    "estimates": ("cumulative",),
    "solvers": ("time_over_error",),
    "sweep": ("sweep",),
    "result": ("costs", "cumulative", "lanes", "plane", "worst"),
}
SEVERAL = {"curve", "curve_parts", "sweep", "worst"}


@pytest.mark.process
@pytest.mark.parametrize("kind", PICTURES)
def test_pictures_in_axes_and_figures(studies: dict[str, Reportable], kind: str) -> None:
    figures = pytest.importorskip("matplotlib.figure")
    for name in PICTURES[kind]:
        draw: Callable[..., Any] = getattr(studies[kind], f"plot_{name}")
        assert draw(style="paper").get_axes()
        whole = figures.Figure(layout="constrained")
        part, other = whole.subfigures(1, 2)
        assert draw(figure=part) is part
        assert part.get_axes()
        ax = other.subplots()
        if name in SEVERAL:
            with pytest.raises(ConfigError, match=r"^ax: the picture has \d panels; give figure=$"):
                draw(ax=ax)
            continue
        draw(ax=ax)
        assert ax.has_data() or ax.patches or ax.collections
        assert not ax.get_title(loc="left")
        whole.canvas.draw()


@pytest.mark.process
def test_pictures_that_are_not_there(studies: dict[str, Reportable]) -> None:
    pytest.importorskip("matplotlib")
    study: Any = studies["solvers"]
    with pytest.raises(ConfigError, match="plot_cumulative is not for solvers; there are plot_t"):
        study.plot_cumulative()
    with pytest.raises(ConfigError, match="no errors of sinkhorn to draw"):
        study.plot_error_over_epsilon()
