"""The page of a batch in a browser: it fits, is legible, and loads nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest
from browser import Browser

RUNS = 7

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SHADE = "getComputedStyle(document.querySelector('table.heat td.h8')).backgroundColor"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the page that all tests look at is written by the first."""
    return tmp_path_factory.mktemp("batch")


@pytest.fixture
def page(invoke: Callable, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs of two trackers with names of many letters; steps are stored."""
    page = folder / "r" / "report.html"
    if page.exists():
        return page
    monkeypatch.chdir(folder)
    for run in range(RUNS):
        for name, error in (("gt", 0), ("out/a" + "b" * 40, 1), ("out/" + "long name " * 4, 2)):
            Path(name).mkdir(parents=True, exist_ok=True)
            rows = "".join(f"1,{k},{k + error},{run}\n" for k in range(5))
            Path(name, f"{run}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")
    patterns = ("--truth", "gt/{run}.csv", "--estimate", "out/{tracker}/{run}.csv", "-c", "10")
    steps = ("--per-step", "--curve", "--reports", "--workers", "1", "--pictures", "png")
    assert invoke("batch", *patterns, "-o", "r", *steps).status == 0
    return page


@pytest.mark.parametrize("width", [420, 1400])
def test_it_fits_and_loads_nothing(chromium: Browser, page: Path, width: int) -> None:
    shades = set()
    for dark in (False, True):
        chromium.open(page.as_uri(), width=width, dark=dark)
        assert chromium.run(OVERFLOW) <= 0
        shades.add(chromium.run(SHADE))
        assert chromium.complaints == []
        loaded = {url for url in chromium.requests if not url.startswith("data:image/svg+xml;")}
        assert loaded <= {page.as_uri(), "about:blank"}
    assert len(shades) == 2
    pytest.importorskip("matplotlib")
    assert chromium.run("[...document.images].map(image => image.naturalWidth > 500)") == [True] * 3
    assert chromium.box("img")["width"] > 0.6 * min(width, 600)


def test_a_cell_leads_to_its_report(chromium: Browser, page: Path) -> None:
    chromium.open(page.as_uri())
    chromium.open(chromium.run("document.querySelector('table.heat td a').href"))
    assert chromium.run("document.title").startswith("TGOSPA = ")
