"""Fixtures: files, the command line as a process, the command line in this process."""

import gc
import importlib
import math
import os
import pkgutil
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import browser
import pytest
from answer import Answer
from browser import PATIENCE, Browser
from checkout import SAMPLES
from hypothesis import HealthCheck, settings
from proven import proven as proven  # a fixture of all tests
from standing_pool import StandingPool

import tgospa_eval
from tgospa_eval.cli.shared import progress
from tgospa_eval.engines import Processes

# What a shell or a CI may set, and tables would look otherwise.
for name in ("FORCE_COLOR", "NO_COLOR", "COLORTERM", "COLUMNS", "LINES"):
    os.environ.pop(name, None)
os.environ["TERM"] = "xterm-256color"

# Hundreds of processes begin with the package: to compile it anew takes most of their start.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The same examples in every run, however busy the machine; new and more ones by `make fuzz`.
settings.register_profile(
    "steady",
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=10,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "fuzz", settings.get_profile("steady"), derandomize=False, max_examples=200, print_blob=True
)
settings.load_profile("steady")

# Hypothesis draws constants of the modules that it finds imported. All are, so that it draws the
# same whichever tests ran before.
for module in pkgutil.walk_packages(tgospa_eval.__path__, "tgospa_eval."):
    if module.name != "tgospa_eval.__main__":
        with suppress(ImportError):  # of an extra
            importlib.import_module(module.name)

QUICKSTART = SAMPLES / "quickstart"

NO_PICTURES = {"TGOSPA_EVAL_PICTURES": "none"}
"""They take longer than what most tests are about; tests/unit/show draws them."""


FEW_DOTS = 30
"""Of a picture, per inch."""

NEW_OBJECTS = 50_000
"""New objects from which on cycles are looked for, as in the command: Python's 700 cost a sixth."""


def pytest_collection_finish() -> None:
    """Leave out what is there for good when cycles are looked for: a million objects of modules."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(NEW_OBJECTS)


OWN_PROCESSES = {"engines", "partitioned", "test_batch_is_killed", "test_progress_and_interrupts"}
"""Folders and modules of tests that are about processes."""

NEEDS = {"chromium": "browser", "environment": "process", "unmeasured": "process"}
"""Marks that follow from the fixtures of a test."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give every test the marks of what it needs."""
    for item in items:
        for fixture, mark in NEEDS.items():
            if fixture in getattr(item, "fixturenames", ()):
                item.add_marker(mark)


@pytest.fixture(scope="session")
def standing_pool() -> Iterator[StandingPool]:
    pool = StandingPool()
    yield pool
    pool.close()


@pytest.fixture(autouse=True)
def workers_that_stay(
    request: pytest.FixtureRequest, standing_pool: StandingPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Batches of all tests but those of processes themselves share theirs."""
    if not OWN_PROCESSES & {*request.path.parts, request.path.stem}:
        monkeypatch.setattr(Processes, "open", lambda self, most: standing_pool.open(self, most))


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures with few dots, which take half the time; who looks at dots calls `written`."""
    tools = sys.modules.get("tgospa_eval.show.figure_tools")
    if tools is None:  # matplotlib is an extra
        return
    fine = tools.written

    def coarse(made: Any, kind: str = "png", _dots: int = 0) -> bytes:
        return fine(made, kind, FEW_DOTS)

    monkeypatch.setattr(tools, "written", coarse)


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str | bytes], str]:
    """Write a file byte for byte and return its path."""

    def write(name: str, content: str | bytes) -> str:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return str(path)

    return write


@pytest.fixture
def environment() -> dict[str, str]:
    """An environment for a process: without settings of ours, with an encoding that is known."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("TGOSPA_EVAL_")}
    return kept | {"PYTHONIOENCODING": "utf-8"} | NO_PICTURES


@pytest.fixture
def unmeasured(environment: dict[str, str]) -> dict[str, str]:
    """The same where coverage is not measured: that imports modules, and writes a file."""
    return {k: v for k, v in environment.items() if not k.startswith("COVERAGE")}


@pytest.fixture
def run(tmp_path: Path, environment: dict[str, str]) -> Callable[..., Answer]:
    """Run the command line as a process in an empty folder; no failure may be a traceback."""

    def run(*arguments: str, env: dict[str, str] | None = None, encoding: str = "utf-8") -> Answer:
        done = subprocess.run(
            [sys.executable, "-m", "tgospa_eval", *arguments],
            capture_output=True,
            timeout=PATIENCE,
            check=False,
            cwd=tmp_path,
            env=environment | (env or {}),
            encoding=encoding,
        )
        assert "Traceback" not in done.stderr
        return Answer(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def invoke(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Answer]:
    """Run the command line in this process (no start-up time), in an empty folder."""
    from tgospa_eval.cli import main

    monkeypatch.setattr(progress, "FIRST", math.inf)  # a busy machine would show how far it is
    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.startswith("TGOSPA_EVAL_")]:
        monkeypatch.delenv(name)
    for name, value in NO_PICTURES.items():
        monkeypatch.setenv(name, value)

    def invoke(*arguments: str) -> Answer:
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_:
            main(arguments)
        captured = capsys.readouterr()
        status = exit_.value.code
        assert isinstance(status, int)
        return Answer(status, captured.out, captured.err)

    return invoke


@pytest.fixture(scope="session")
def quickstart() -> tuple[str, str]:
    """Truth and estimate of the sample data."""
    return str(QUICKSTART / "truth.csv"), str(QUICKSTART / "estimate.csv")


@pytest.fixture(scope="session")
def crowd(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A scene so dense that the referee takes half a minute for it with -c 25."""
    rng = random.Random(1)
    folder = tmp_path_factory.mktemp("crowd")
    paths = []
    for name in ("truth", "estimate"):
        lines = ["id,t,x,y"]
        for k in range(30):
            x, y = rng.uniform(0, 40), rng.uniform(0, 40)
            for t in range(60):
                x, y = x + rng.gauss(0, 1), y + rng.gauss(0, 1)
                lines.append(f"{k},{t},{x:.3f},{y:.3f}")
        path = folder / f"{name}.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        paths.append(str(path))
    return paths[0], paths[1]


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

    from tgospa_eval.api.sensors import Association
    from tgospa_eval.results.evaluation import Evaluation

    def show(result: Evaluation | Association, hash_: str = "", **settings: object) -> Browser:
        path = tmp_path / "report.html"
        path.write_text(result.to_html(), encoding="utf-8")
        chromium.open(path.as_uri() + hash_, **settings)
        return chromium

    yield show
    assert chromium.complaints == []
    asked = [address for address in chromium.requests if not address.startswith("blob:")]
    assert {address.partition("#")[0] for address in asked} <= {
        (tmp_path / "report.html").as_uri(),
        "about:blank",
    }
