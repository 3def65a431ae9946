"""Every verb and every output once: what `make test-oldest` and `test-newest` run.

Stdout holds the document alone, whatever the libraries below print; the scene `crowd` needs the
linear programme of HiGHS, which prints a banner when it is made.
"""

import csv
import io
import json
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from answer import Run
from checkout import SAMPLES

PAIR = ("truth.csv", "estimate.csv", "-c", "10", "-g", "5")
CROWD = ("crowd_truth.csv", "crowd_estimate.csv", "-c", "25", "-g", "5")
CROWD_TGOSPA = pytest.approx(97.9907515278866, rel=1e-9)
FORMATS = SAMPLES / "formats"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The folder of the commands, with the quickstart and a crowd."""
    for name in ("truth.csv", "estimate.csv"):
        (tmp_path / name).write_bytes((SAMPLES / "quickstart" / name).read_bytes())
    rng = random.Random(4)
    for name in ("crowd_truth.csv", "crowd_estimate.csv"):
        lines = ["id,t,x,y"]
        for k in range(15):
            x, y = rng.uniform(0, 20), rng.uniform(0, 20)
            for t in range(20):
                x, y = x + rng.gauss(0, 1), y + rng.gauss(0, 1)
                lines.append(f"{k},{t},{x:.3f},{y:.3f}")
        (tmp_path / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tmp_path


def table(text: str) -> None:
    """What a person reads begins with the value, or with what was ordered or found."""
    assert text.strip()
    assert text.isascii()
    assert not text.startswith("Running")
    assert "\nRunning HiGHS" not in text


def rows(text: str) -> None:
    lines = list(csv.reader(io.StringIO(text)))
    assert len({len(line) for line in lines}) == 1
    assert len(lines) > 1


def markdown(text: str) -> None:
    assert text.lstrip().startswith(("**", "|", "#", "TGOSPA"))


def latex(text: str) -> None:
    assert text.lstrip().startswith(("%", "\\begin"))
    assert text.rstrip().endswith("\\end{tabular}")


COMMANDS: dict[str, tuple[tuple[str, ...], Callable[[str], object]]] = {
    "table": (CROWD, table),
    "csv": ((*CROWD, "--format", "csv"), rows),
    "sinkhorn": ((*PAIR, "--solver", "sinkhorn", "--format", "json"), json.loads),
    "exact": ((*PAIR, "--solver", "exact", "--format", "json"), json.loads),
    "far cutoff": ((*CROWD[:2], "-c", "1e9", "-g", "5", "--format", "json"), json.loads),
    "explain": (("explain", *PAIR, "--format", "json"), json.loads),
    "inspect": (("inspect", *PAIR[:4], "--plot", "seen.png"), table),
    "compare": (("compare", "truth.csv", "estimate.csv", "crowd_estimate.csv", *PAIR[2:],
                 "--format", "json"), json.loads),
    "solvers": (("compare", *PAIR, "--format", "latex"), latex),
    "study": (("compare", "--simulate", "--help"), table),
    "associate": (("associate", *PAIR[:4]), table),
    "reduce": (("reduce", str(SAMPLES / "clouds/estimate.csv"), "small.csv", "-n", "10"), table),
    "simulate": (("simulate", "made", "--targets", "3", "--steps", "5"), table),
    "help": (("help", "evaluate"), table),
    "version": (("--version",), table),
    "script": (("verify", "--script"), table),
    "blocks": ((*PAIR, "--slice", "speed=0:1:3", "--curve", "--window", "10", "--explain",
                "--format", "json"), json.loads),
    "sweep": ((*PAIR, "--sweep", "cutoff=5:20:3", "--format", "json"), json.loads),
    "class": ((str(FORMATS / "v1.0-mini"), str(FORMATS / "nuscenes_results.json"), *PAIR[2:],
               "--by", "class"), table),
    "clouds": ((str(SAMPLES / "clouds/truth.csv"), str(SAMPLES / "clouds/estimate.csv"), *PAIR[2:],
                "--distance", "cloud-wasserstein", "--format", "json"), json.loads),
    "gaussians": ((str(SAMPLES / "gaussian/truth.csv"), str(SAMPLES / "gaussian/estimate.csv"),
                   *PAIR[2:], "--distance", "gaussian-wasserstein", "--format", "json"),
                  json.loads),
    "boxes": ((str(SAMPLES / "kitti/gt.txt"), str(SAMPLES / "kitti/res.txt"), "--distance", "iou",
               "--format", "json"), json.loads),
    "mot": ((str(SAMPLES / "motchallenge/gt.txt"), str(SAMPLES / "motchallenge/res.txt"),
             "--distance", "iou", "--preprocess", "motchallenge", "--format", "json"),
            json.loads),
    "mat": ((str(FORMATS / "run.mat"), str(FORMATS / "run.mat"), *PAIR[2:], "--format", "json"),
            json.loads),
    "mat 7.3": ((str(FORMATS / "truth73.mat"), f"{FORMATS / 'run.mat'}:Y", *PAIR[2:], "--format",
                 "json"), json.loads),
    "feather": ((str(FORMATS / "annotations.feather"), str(FORMATS / "argoverse_tracks.feather"),
                 *PAIR[2:], "--format", "json"), json.loads),
    "ais": ((str(FORMATS / "ais.csv"), str(FORMATS / "vessel_tracks.csv"), "-c", "1000", "-g", "50",
             "--distance", "haversine", "--format", "json"), json.loads),
    "interpolated": ((*PAIR, "--interpolate", "estimate", "--max-gap", "3", "--format", "json"),
                     json.loads),
}  # fmt: skip

IN_A_PROCESS = {"table", "exact", "version"}
"""In one each: their imports and what libraries write to stdout are their own."""


@pytest.mark.parametrize("name", COMMANDS)
def test_stdout_holds_the_document_alone(
    name: str, request: pytest.FixtureRequest, files: Path
) -> None:
    arguments, read = COMMANDS[name]
    done = request.getfixturevalue("run" if name in IN_A_PROCESS else "invoke")(*arguments)
    assert (done.status, "Warning" in done.err) == (0, False), done.err
    read(done.out)


def test_the_crowd_needs_the_linear_programme_and_python_prints_nothing(
    files: Path, environment: dict[str, str]
) -> None:
    program = """
import sys
from tgospa_eval import evaluate
result = evaluate("crowd_truth.csv", "crowd_estimate.csv", cutoff=25, switch_penalty=5)
assert "highspy" in sys.modules
assert result.certified
print(result.tgospa, file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        check=True,
        cwd=files,
        env=environment,
        encoding="utf-8",
    )
    assert done.stdout == ""
    assert float(done.stderr.splitlines()[-1]) == CROWD_TGOSPA


def test_a_result_with_proof_pictures_and_page(run: Run, invoke: Run, files: Path) -> None:
    done = run(*CROWD, "-o", "result", "--proof", "--format", "json",
               env={"TGOSPA_EVAL_PICTURES": "png"})  # fmt: skip
    assert done.status == 0, done.err
    assert json.loads(done.out)["tgospa"] == CROWD_TGOSPA
    assert (files / "result/report.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert list((files / "result").rglob("*.png"))
    checked = invoke("verify", "result/proof", *CROWD[:2])
    assert checked.status == 0
    assert ": verified: " in checked.out
    (files / "verify.py").write_text(invoke("verify", "--script").out, encoding="utf-8")
    alone = subprocess.run(
        [sys.executable, "-I", "verify.py", "result/proof"],
        capture_output=True,
        check=True,
        cwd=files,
        encoding="utf-8",
    )
    assert ": verified: " in alone.stdout


def test_tables_as_parquet_and_back(invoke: Run, files: Path) -> None:
    import pandas as pd

    for name in ("crowd_truth", "crowd_estimate"):
        pd.read_csv(files / f"{name}.csv").to_parquet(files / f"{name}.parquet")
    done = invoke("crowd_truth.parquet", "crowd_estimate.parquet", *CROWD[2:], "--format", "json")
    assert json.loads(done.out)["tgospa"] == CROWD_TGOSPA


def test_a_gate(invoke: Run, files: Path) -> None:
    gate = ("gate", *CROWD[:2], "--baseline", "baseline.json")
    assert invoke(*gate, *CROWD[2:], "--update-baseline").status == 0
    done = invoke(*gate, "--junit", "report.xml", "--format", "json")
    assert (done.status, json.loads(done.out)["verdict"]) == (0, "pass"), done.err
    done = invoke(*gate, "--max", "tgospa=1", "--format", "markdown")
    assert done.status == 1
    markdown(done.out)


def test_a_batch(run: Run, invoke: Run, files: Path) -> None:
    for k in range(3):
        for kind in ("truth", "estimate"):
            (files / kind).mkdir(exist_ok=True)
            (files / kind / f"{k}.csv").write_bytes((files / f"crowd_{kind}.csv").read_bytes())
    batch = ("batch", "--truth", "truth/{run}.csv", "--estimate", "estimate/{run}.csv",
             "-o", "results", "--workers", "2")  # fmt: skip
    done = run(*batch, *CROWD[2:])
    assert done.status == 0, done.err
    table(done.out)
    report = invoke("batch", "report", "results", "--format", "json")
    json.loads(report.out)


def test_data_in_parts(invoke: Run, files: Path) -> None:
    import pandas as pd

    for side in ("crowd_truth", "crowd_estimate"):
        (files / side).mkdir()
        whole = pd.read_csv(files / f"{side}.csv")
        for part, (first, last) in enumerate([(0, 9), (10, 19)]):
            chosen = whole[whole["t"].between(first, last)]
            chosen.to_parquet(files / side / f"{part}.parquet")
    done = invoke("evaluate", "crowd_truth", "crowd_estimate", *CROWD[2:], "--memory", "1GB",
                  "--format", "json", "-o", "result")  # fmt: skip
    assert done.status == 0, done.err
    assert json.loads(done.out)["tgospa"] == CROWD_TGOSPA
    tables = [pd.read_parquet(path) for path in (files / "result").glob("*.parquet")]
    assert tables
    assert all(len(read) for read in tables)
