"""Long work: what is shown of it on the way, and how Ctrl-C ends it."""

import io
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from answer import Run

from tgospa_eval import Certified, Exact, Sinkhorn, Trajectories
from tgospa_eval.cli.shared import progress as shown
from tgospa_eval.cli.shared.progress import Display, bracket, line
from tgospa_eval.common.progress import Progress, StoppedError, Stopwatch
from tgospa_eval.distances import as_distance
from tgospa_eval.evaluation.prepare import fit, prepare
from tgospa_eval.evaluation.prove import solve
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.kernels import KERNEL
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.show.chart_list import CHARTS
from tgospa_eval.solvers import Solver, batches, certified
from tgospa_eval.solvers.block_costs import share_of_digits

Pair = tuple[str, str]

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


class Answer(NamedTuple):
    """What a command line left behind."""

    status: int
    out: str
    err: str


# --- what is known on the way ---------------------------------------------------------------------


class Recorded(Progress):
    """Keeps everything that it is told."""

    def __init__(self) -> None:
        super().__init__(watched=True)
        self.brackets: list[tuple[float, float]] = []
        self.shares: list[float] = []

    @property
    def due(self) -> bool:
        return True

    def prove(self, lower: float, upper: float) -> None:
        super().prove(lower, upper)
        self.brackets.append((self.scale(max(lower, 0.0)), self.scale(upper)))

    def done(self, share: float) -> None:
        super().done(share)
        self.shares.append(self.share)


@pytest.mark.parametrize("solver", [Certified(jobs=1), Sinkhorn(jobs=1), Exact()])
@pytest.mark.parametrize(
    ("area", "cutoff", "size"), [(10.0, 8.0, 20_000), (60.0, 8.0, 20), (30.0, 1e4, 20_000)]
)
def test_brackets_on_the_way_hold(
    solver: Solver, area: float, cutoff: float, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one component and of many in batches, with trivial ones, and with a cutoff far above."""
    monkeypatch.setattr(batches, "BATCH_STATES", size)
    # small programmes: sweeps are seen
    monkeypatch.setattr(certified.PROGRAMMES, "early_states", 0)
    rng = np.random.default_rng(3)
    paths = rng.uniform(0, area, (1, 12, 2)) + rng.normal(0, 1, (15, 12, 2)).cumsum(axis=0)
    sides = [Trajectories.from_array(paths + rng.normal(0, 1.5, paths.shape)) for _ in range(2)]
    stopwatch = Stopwatch()
    request = EvaluationRequest(
        parameters=Parameters(cutoff=cutoff, order=2, switch_penalty=2.0),
        distance=as_distance("euclidean"),
        solver=solver,
    )
    prepared = prepare(fit(*sides, request), request, stopwatch=stopwatch)
    recorded = stopwatch.progress = Recorded()
    result = solve(prepared, solver, stopwatch)
    assert recorded.brackets or cutoff > 1e3 or size == 20_000
    for lower, upper in recorded.brackets:
        assert lower <= result.upper_bound
        assert upper >= result.lower_bound
    assert recorded.shares == sorted(recorded.shares)
    assert recorded.stoppable


@pytest.mark.parametrize(
    ("width", "cost", "gap", "share"),
    [(0, 0, 0, 1), (1, 0, 1e-9, 0), (2, 1, 1e-9, 0), (1e-3, 1, 1e-9, 1 / 3), (1e-30, 1, 0, 1),
     (1, 1, 1.5, 1), (3, 1, 1.5, 0)],
)  # fmt: skip
def test_the_way_to_the_gap(width: float, cost: float, gap: float, share: float) -> None:
    assert share_of_digits(width, cost, gap) == pytest.approx(share)


def test_what_cannot_be_stopped_is_left_behind() -> None:
    progress = Progress(watched=True)
    assert progress.in_thread(lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        progress.in_thread(lambda: 1 // 0)
    progress.stop.set()
    with pytest.raises(StoppedError):
        progress.in_thread(lambda: progress.stop.wait() and Progress().stop.wait())


def test_parts_are_shares_of_the_whole() -> None:
    progress = Progress(watched=True)
    progress.begin(math.sqrt)
    with progress.part("cutoff 5", 1, 4):
        assert progress.name == "cutoff 5, 2 of 4"
        progress.done(0.5)
        assert progress.share == 0.375
        progress.prove(4.0, 16.0)
        progress.prove(1.0, 9.0)
        assert progress.bracket == (2.0, 3.0)  # what was proven before still holds
    assert (progress.share, progress.bracket, progress.name) == (0.5, None, "")


# --- the line -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bounds", "text"),
    [
        ((12.34567, 15.0), "12.345 <= TGOSPA <= 15"),
        ((617.934531, 617.934869), "617.93453 <= TGOSPA <= 617.93487"),
        ((0.0, 0.00123456), "0 <= TGOSPA <= 0.0012346"),
        ((3.0, 3.0), "3 <= TGOSPA <= 3"),
        ((1.0, math.inf), "1 <= TGOSPA <= inf"),
    ],
)
def test_bounds_are_rounded_outward(bounds: tuple[float, float], text: str) -> None:
    assert bracket(*bounds) == text


def test_the_line() -> None:
    stopwatch = Stopwatch()
    stopwatch.progress = progress = Progress(watched=True)
    stopwatch.stage = "distances"
    assert line(stopwatch, 3.2) == "searching near pairs, 3 s so far"
    stopwatch.stage = "solve/lp"
    progress.prove(9.0, 16.0)
    assert line(stopwatch, 3000.0) == "solving, 9 <= TGOSPA <= 16, 50 min so far"
    with progress.part("cutoff 5", 0, 2):
        progress.prove(9.0, 16.0)
        assert line(stopwatch, 8000.0) == "cutoff 5, 1 of 2: 9 <= TGOSPA <= 16, 2.2 h so far"
    progress.done(0.75)
    assert line(stopwatch, 9.0) == "solving, 75 % done, 9 s so far"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_is_written_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    stopwatch, screen = Stopwatch(), Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.delenv("TERM", raising=False)
    monkeypatch.setattr(shown, "SILENT", 0.0)
    with Display(stopwatch) as display:
        stopwatch.stage = "drawing " + "x" * 200
        display.update()
        stopwatch.stage = "certify"
        display.update()
    parts = screen.getvalue().split("\r")
    assert all(len(part) == 79 for part in parts if part)
    assert [part.strip() for part in parts][2:] == ["proving, 0 s so far", "", ""]


def test_elsewhere_lines_come_seldom(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stopwatch = Stopwatch()
    stopwatch.stage = "read"
    with Display(stopwatch) as display:
        for display.begin in [display.begin - k for k in range(100)]:
            display.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"reading, {k} s so far" for k in (10, 20, 40, 80)]


@pytest.mark.parametrize("show", [False, True])
@pytest.mark.parametrize("heard", [False, True])
def test_only_who_is_watched_or_interrupted_works_in_a_thread(show: bool, heard: bool) -> None:
    handler = signal.default_int_handler if heard else signal.SIG_IGN  # as in workers of a batch
    before = signal.signal(signal.SIGINT, handler)
    try:
        thread = shown.run(threading.current_thread, Stopwatch(), show=show)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (thread is threading.main_thread()) is not (show or heard)


def test_a_narrow_bracket_of_long_work_is_worth_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    stopwatch = Stopwatch()
    said = []
    with Display(stopwatch) as display:
        display.next = math.inf
        for seconds, lower in ((99, 9.0), (0, 15.9), (99, 15.9), (99, 15.9)):
            stopwatch.progress.bracket = lower, 16.0
            display.begin = time.monotonic() - seconds
            display.update()
            said.append(capsys.readouterr().err)
    assert said[0] == said[1] == said[3] == ""
    assert "--gap and --time-limit" in said[2]


WATCHED = """
import sys, threading
from tgospa_eval.cli.shared import progress
from tgospa_eval.show import figure_tools as drawing

waiting, update = [], progress.Display.update

def updated(display):
    named = [*waiting]  # a picture that begins meanwhile is not on the line yet
    update(display)
    for shown in named:
        shown.set()

def when_shown(*_):
    waiting.append(threading.Event())
    waiting[-1].wait(60)
    return b""

progress.SILENT = 0.0
progress.Display.update, drawing.written = updated, when_shown
from tgospa_eval.cli import main
main(sys.argv[1:])
"""
"""Shows at once how far the work is; a picture is empty, and takes until that is shown."""


@POSIX
@pytest.mark.process
def test_pictures_are_named_while_they_are_drawn(
    tmp_path: Path, environment: dict[str, str], quickstart: Pair
) -> None:
    """On a terminal, on a line that is gone at the end; `test_folder` sees none elsewhere."""
    pytest.importorskip("matplotlib")
    ours, theirs = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", WATCHED, *quickstart, "-c", "5", "-g", "2", "-o", "out"],
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        cwd=tmp_path,
        env=environment | {"TGOSPA_EVAL_PICTURES": "png"},
    ) as process:
        os.close(theirs)
        err = "".join(iter(lambda: some(ours), ""))
    os.close(ours)
    assert process.returncode == 0, err
    *shown, last = [part.strip() for part in err.strip().split("\r")]
    drawing = [part for part in shown if ".png" in part]
    names = list(dict.fromkeys(part.partition(",")[0] for part in drawing))
    assert names == [f"drawing {name}.png" for name in [*CHARTS["result"]][:5]]
    assert drawing[-1].startswith("drawing worst.png, 57 % done, ")
    assert shown[-1] == ""  # over the last one
    assert "wrote 8 files and 5 pictures to out" in last


def some(stream: int) -> str:
    """What comes next; nothing at the end, which a terminal tells as an error."""
    with suppress(OSError):
        return os.read(stream, 4096).decode()
    return ""


# --- Ctrl-C ---------------------------------------------------------------------------------------


INTERRUPTS = """
import os, signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background of a shell

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)

def and_never_end(*_, **__):
    interrupt()
    threading.Event().wait()

def once(work):
    def interrupted(*arguments, **settings):
        once.heard or interrupt()
        once.heard = True
        return work(*arguments, **settings)
    return interrupted

once.heard = False
"""


@pytest.fixture
def interrupted(tmp_path: Path, environment: dict[str, str]) -> Run:
    """Run the command line in an empty folder, after lines of Python that interrupt it."""

    def interrupted(lines: str, *arguments: str) -> Answer:
        code = f"{INTERRUPTS}\n{lines}\nfrom tgospa_eval.cli import main\nmain(sys.argv[1:])"
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            capture_output=True,
            timeout=60,
            check=False,
            cwd=tmp_path,
            env=environment,
            encoding="utf-8",
        )
        assert "Traceback" not in done.stderr
        assert list(tmp_path.iterdir()) == []
        return Answer(done.returncode, done.stdout, done.stderr)

    return interrupted


SWEEPS = "from tgospa_eval.solvers.dual_ascent import Ascent; Ascent.stage = once(Ascent.stage)"
CLARABEL = "from tgospa_eval.solvers import exact; exact._build = and_never_end"
PROGRAMMES = (
    "from tgospa_eval.solvers import restricted_lp; "
    "restricted_lp.solve_restricted_lp = and_never_end"
)
PROOF = f"{SWEEPS}; from tgospa_eval.evaluation import prove; prove.certify = and_never_end"
READING = "from tgospa_eval.api import evaluate; evaluate.read_pair = and_never_end"
DRAWING = "from tgospa_eval.show import html; html.page = and_never_end"
HARD = ("-c", "25", "-g", "2", "--time", "0:15")
"""Of a crowd: what no solver settles without work."""

HEARD = "stopping: the bounds proven so far follow; Ctrl-C again ends at once"


@POSIX
@pytest.mark.parametrize(
    ("lines", "solver"), [(SWEEPS, "certified"), (SWEEPS, "sinkhorn"), (CLARABEL, "exact")]
)
def test_interrupt(interrupted: Run, invoke: Run, crowd: Pair, lines: str, solver: str) -> None:
    """What is proven by then is printed, and the folder is left as it was."""
    if KERNEL == "numpy" and lines == SWEEPS:
        pytest.skip("without kernels this is solved without sweeps")
    given = (*crowd, *HARD, "--format", "json")
    status, out, err = interrupted(lines, *given, "--solver", solver, "-o", "out")
    assert status == 130
    document = json.loads(out)
    assert document["solver"]["status"].startswith("interrupted (1 of ")
    assert not document["certified"]
    value = json.loads(invoke(*given).out)
    assert value["certified"]
    assert document["lower_bound"] <= value["upper_bound"]
    assert document["upper_bound"] >= value["lower_bound"]
    assert HEARD in err
    assert "interrupted: nothing was written to out" in err


@POSIX
@pytest.mark.parametrize("lines", [PROOF, READING])
def test_interrupt_at_once(interrupted: Run, crowd: Pair, lines: str) -> None:
    """The second one; and the first where there is no bracket yet."""
    status, out, err = interrupted(lines, *crowd, *HARD, "-o", "out")
    assert (status, out) == (130, "")
    assert err.endswith("interrupted\n")


@POSIX
def test_interrupt_of_the_pictures(interrupted: Run, quickstart: Pair) -> None:
    status, out, err = interrupted(DRAWING, *quickstart, "-c", "5", "-g", "2", "-o", "out")
    assert status == 130
    assert out.startswith("TGOSPA = ")
    assert "interrupted: nothing was written to out" in err


@POSIX
def test_an_interrupted_gate_never_passes(
    interrupted: Run, crowd: Pair, tmp_path_factory: pytest.TempPathFactory, invoke: Run
) -> None:
    brief = (*HARD[:-1], "0:3")  # the baseline is solved to the end
    given = ("gate", *crowd, *brief, "--solver", "exact", "--baseline")
    baseline = tmp_path_factory.mktemp("gate") / "baseline.json"
    assert invoke(*given, str(baseline), "--update-baseline").status == 0
    status, out, err = interrupted(CLARABEL, *given, str(baseline), "--junit", "junit.xml")
    assert (status, out) == (130, "")
    assert "TGOSPA is between " in err
    assert "; nothing is judged" in err


@POSIX
def test_an_interrupted_sweep_has_the_points_so_far(interrupted: Run, crowd: Pair) -> None:
    given = ("--sweep", "cutoff=10,20,40", "--solver", "exact", "--format", "json")
    status, out, err = interrupted(CLARABEL, *crowd, *HARD[2:], *given)
    assert status == 130
    assert [point["value"] for point in json.loads(out)["points"]] == [10]
    assert "interrupted: 1 of 3 points are finished" in err


@POSIX
def test_an_interrupted_comparison(interrupted: Run, crowd: Pair) -> None:
    """The solver stops with what it has; those after it are left out."""
    lines = (
        "from tgospa_eval.campaign import solver_runs; run_here = solver_runs.run_here\n"
        "def stopped(prepared, solver, progress):\n"
        "    interrupt(); progress.stop.wait()\n"
        "    return run_here(prepared, solver, progress)\n"
        "solver_runs.run_here = stopped"
    )
    given = ("compare", *crowd, *HARD, "--solvers", "certified,exact")
    status, out, err = interrupted(lines, *given, "--format", "json")
    document = json.loads(out)
    assert status == 130
    assert [made["name"] for made in document["runs"]] == ["certified"]
    assert document["left_out"] == {"exact": "not started: interrupted"}
    assert HEARD in err
