"""The script behind docs/theory/reproduction.md runs, and draws what the page shows."""

import re
import runpy
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from checkout import ROOT

from tgospa_eval.distances import cloud_wasserstein

pytest.importorskip("ot")
Figure = pytest.importorskip("matplotlib.figure").Figure

SCRIPT = ROOT / "docs" / "theory" / "reproduction"
PAGE = ROOT / "docs" / "theory" / "reproduction.md"


def test_quick_run_prints_and_draws_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--quick", "--output", str(tmp_path)])
    monkeypatch.syspath_prepend(SCRIPT)
    # Pictures are made, and not drawn, which takes long.
    monkeypatch.setattr(Figure, "savefig", lambda _, path, **__: path.touch())
    monkeypatch.setattr(import_module("prossel"), "ROUNDS", (1, 2))
    runpy.run_path(str(SCRIPT / "__main__.py"), run_name="__main__")
    printed = capsys.readouterr().out
    page = PAGE.read_text(encoding="utf-8")
    for table in ("bias and root mean square error", "table 1", "right associations", "Cooper-ATL"):
        assert table in printed
    pictures = set(re.findall(r"\(reproduction/(\w+\.png)\)", page))
    assert pictures == {path.name for path in tmp_path.iterdir()}
    assert pictures == {path.name for path in SCRIPT.glob("*.png")}


def test_what_the_script_computes_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SCRIPT)
    import convergence
    import crossing
    import prossel

    rng = np.random.default_rng(0)
    x, points = rng.standard_normal((10, 2)), rng.standard_normal((40, 2))
    squares = [cloud_wasserstein(x @ v, None, points @ v, None) ** 2 for v in prossel.DIRECTIONS.T]
    assert prossel.sliced(x, points) == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-12)
    for scene in crossing.scenes(0):
        for side, means in zip(scene.clouds, scene.means, strict=True):
            for cloud, mean in zip(side, means, strict=True):
                found, covariance = crossing.moments(cloud)
                apart = found - mean
                assert apart @ np.linalg.solve(scene.covariance, apart) < 1
                assert np.trace(covariance) == pytest.approx(np.trace(scene.covariance), rel=0.5)
        pair = [(side[0][0], side[0][1]) for side in scene.clouds]
        for name in ("means", "W2", convergence.TRUE):
            limit = convergence.limit(name, scene, 0)
            few = [crossing.WAYS["sliced"](cloud, 100, rng) for cloud in pair]
            found = convergence.value(name, *few, scene.covariance)
            assert found == pytest.approx(limit, rel=0.35)
