"""``python tests/benchmarks/against.py COMMIT``: this version beside another, in turn, in one run.

The other is built from the repository into a temporary folder, with the libraries of this one.
"""

import compileall
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
from tables import Table

ROOT = Path(__file__).parents[2]
ROUNDS, QUICK = (3, 7), 10.0
"""Rounds, and those of cases of which one takes less than so many seconds: on shared machines three
may all be slow."""

EVALUATION = """
import json, sys, time
sys.path[:0] = [sys.argv[1] + "/tests/benchmarks", sys.argv[1] + "/tests/support"]
from scenes import Scene
import tgospa_eval
scene = Scene.parse(sys.argv[2])
asked = {"cutoff": 5.0, "switch_penalty": 2.0, "jobs": 1, **json.loads(sys.argv[3])}
scenes = asked.pop("scenes", 1)
pairs = [scene.arrays(seed) for seed in range(scenes)]
many = scenes > 1 and getattr(tgospa_eval, "evaluate_many", None)
def run(steps=None):
    cut = [(truth[:steps], estimate[:steps]) for truth, estimate in pairs]
    if many:
        many(cut, **asked)
    else:
        [tgospa_eval.evaluate(*pair, **asked) for pair in cut]
run(5)
best, until = float("inf"), time.monotonic() + 2.0
while best == float("inf") or time.monotonic() < until:
    begin = time.process_time()
    run()
    best = min(best, time.process_time() - begin)
print(best)
"""
"""Least seconds of an evaluation, or of several scenes, in a warm process."""

COMMAND = """
import sys, time
begin = time.process_time()
from tgospa_eval.cli import main
sys.argv[0] = "tgospa-eval"
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print(time.process_time() - begin)
"""
"""Seconds of a command, its imports included."""

CROWD = (
    *("--scenario", "dense", "--state", "box", "--targets", "40", "--steps", "300"),
    *("--area", "600", "--noise", "8", "--detection", "0.7", "--fragmentation", "0.05"),
)
"""Boxes as of pedestrians that hide one another: many misses, tracks that are lost and found."""


def cases(folder: Path) -> dict[str, tuple[str, ...]]:
    """What is measured: a program, and its arguments."""
    files = [str(folder / "crowd" / f"{side}.csv") for side in ("truth", "estimate")]
    small = [str(ROOT / "sample_data/quickstart" / f"{side}.csv") for side in ("truth", "estimate")]
    small += ["-c", "10", "-g", "5", "-q"]
    scenes: dict[str, tuple[str, dict[str, object]]] = {
        scene: (scene, {})
        for scene in (
            *("10,50,20", "20,50,20,1", "50,100,20,2", "100,300,150,2", "100,100,300"),
            *("100,100,20,2", "100,20,20,2", "50,100,10,2", "200,30,30,2"),  # crowds
        )
    }
    scenes |= {
        "curve of 20,200,60": ("20,200,60", {"curve": True}),
        "10,50,20 without switches": ("10,50,20", {"switch_penalty": 0.0}),
        "60,50,20,2 with c = 10": ("60,50,20,2", {"cutoff": 10.0}),
        "100,25,20,2 with c = 20": ("100,25,20,2", {"cutoff": 20.0}),
        "200 scenes 5,56,60": ("5,56,60", {"scenes": 200}),
        "200 scenes 10,50,100": ("10,50,100", {"scenes": 200}),
        "200 scenes 10,50,20": ("10,50,20", {"scenes": 200}),
    }
    found = {
        name: (EVALUATION, str(ROOT), scene, json.dumps(asked))
        for name, (scene, asked) in scenes.items()
    }
    return found | {
        "centres of boxes, c = 100": (COMMAND, *files, "-c", "100", "-g", "10", "-q"),
        "boxes, iou": (COMMAND, *files, "--distance", "iou", "-q"),
        "the same with HOTA, CLEAR, Identity": (
            *(COMMAND, *files, "--distance", "iou", "-q", "--with", "hota,clear,identity"),
        ),
        "start and two small files": (COMMAND, *small),
        "the same with pictures": (COMMAND, *small, "-o", str(folder / "out"), "--force"),
    }


def seconds(path: Path, program: str, *arguments: str) -> float:
    """What a program in a new process says of itself, with the package found at a path."""
    found = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "PYTHONPATH": str(path)},
        cwd=path,  # where no settings are
        capture_output=True,
        text=True,
        check=True,
    )
    return float(found.stdout.split()[-1])


def install(commit: str, folder: Path) -> Path:
    """Build a version into a folder."""
    source, target = folder / "source", folder / "base"
    source.mkdir()
    archive = subprocess.run(
        ["git", "-C", str(ROOT), "archive", commit], capture_output=True, check=True
    )
    subprocess.run(["tar", "x", "-C", str(source)], input=archive.stdout, check=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--target", str(target), str(source)], check=True)
    return target


@click.command()
@click.argument("commit")
def main(commit: str) -> None:
    """Seconds of the processor with COMMIT and with this version, the least of rounds in turn."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        base = install(commit, folder)
        compileall.compile_dir(str(ROOT / "tgospa_eval"), quiet=1)  # as pip did with the other
        seconds(ROOT, COMMAND, "simulate", str(folder / "crowd"), *CROWD)
        rows = []
        for case, given in cases(folder).items():
            best = [float("inf")] * 2
            begin = time.monotonic()
            for done in range(ROUNDS[1]):
                if done >= ROUNDS[0] and time.monotonic() - begin > done * QUICK:
                    break
                for number, path in enumerate((base, ROOT)):
                    best[number] = min(best[number], seconds(path, *given))
            rows.append([case, f"{best[0]:.4f}", f"{best[1]:.4f}", f"{best[0] / best[1]:.2f}"])
            click.echo(case, err=True)
    notes = ("scenes: targets, steps, side of the square, errors, as in docs/performance.md",)
    click.echo(
        Table("This version beside another", ("what", commit, "this", "ratio"), rows, notes).plain()
    )


if __name__ == "__main__":
    main()
