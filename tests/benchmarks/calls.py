"""``python tests/benchmarks/calls.py``: how many functions and files of ours five stories run.

Counted in one process, by `sys.setprofile`: a function once, however often it runs; its depth is
that of calls of ours on the stack. Modules, classes and comprehensions are no functions.
"""

import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType

import click
import numpy as np

import tgospa_eval
from tgospa_eval.cli import main as command

OURS = str(Path(tgospa_eval.__file__).parent)
SAMPLES = Path(OURS).parent / "sample_data"
METRIC = ("--cutoff", "10", "--switch-penalty", "5")


class Trace:
    """The functions of ours that a call runs.

    Attributes
    ----------
    functions : set of code
        Functions, methods and lambdas.
    depth : int
        Most calls of ours on the stack at once.
    """

    def __init__(self, call: Callable[[], object]) -> None:
        self.functions: set[CodeType] = set()
        self.depth = 0
        stacks = threading.local()

        def note(frame: FrameType, event: str, _: object) -> None:
            code = frame.f_code
            if not code.co_filename.startswith(OURS) or code.co_name in ("<module>", "<genexpr>"):
                return
            if not code.co_flags & 1:  # the body of a class has no fast locals
                return
            stacks.depth = getattr(stacks, "depth", 0) + {"call": 1, "return": -1}.get(event, 0)
            self.functions.add(code)
            self.depth = max(self.depth, stacks.depth)

        threading.setprofile(note)
        sys.setprofile(note)
        try:
            with suppress(SystemExit), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                call()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]

    @property
    def files(self) -> int:
        """Files that these functions are in."""
        return len({code.co_filename for code in self.functions})


def run(*words: object) -> Callable[[], object]:
    """A command line, in this process."""
    return lambda: command([str(word) for word in words])


def in_parts(folder: Path) -> None:
    """Both sides of the first sample, each as a folder of two tables."""
    for side in ("truth", "estimate"):
        header, *rows = (SAMPLES / f"quickstart/{side}.csv").read_text().splitlines(keepends=True)
        rows.sort(key=lambda row: float(row.split(",")[header.split(",").index("t")]))
        middle = len(rows) // 2
        (folder / side).mkdir()
        for name, part in (("part-0.csv", rows[:middle]), ("part-1.csv", rows[middle:])):
            (folder / side / name).write_text(header + "".join(part))


def stories(folder: Path) -> dict[str, Callable[[], object]]:
    """Five things that users do, by name."""
    truth, estimate = (SAMPLES / f"quickstart/{side}.csv" for side in ("truth", "estimate"))
    rng = np.random.default_rng(1)
    arrays = rng.normal(0, 20, (10, 3, 2)), rng.normal(0, 20, (10, 4, 2))
    runs = folder / "runs"
    for tracker in "abc":
        (runs / tracker).mkdir(parents=True)
        for number in range(60):
            (runs / tracker / f"{number}.csv").write_text(estimate.read_text())
    suite = folder / "suite.toml"
    suite.write_text(
        f'[options]\ncutoff = 10\nswitch-penalty = 5\n[[pair]]\ntruth = "{truth}"\n'
        f'estimate = "{estimate}"\nmax = ["tgospa=100"]\n'
    )
    in_parts(folder)
    return {
        "two files": run(truth, estimate, *METRIC),
        "arrays": lambda: tgospa_eval.evaluate(*arrays, cutoff=10, switch_penalty=5),
        "batch of 3 x 60": lambda: run(
            *("batch", "--truth", truth, "--estimate", runs / "{tracker}/{run}.csv", *METRIC),
            *("--workers", "1", "-o", tempfile.mkdtemp(dir=folder)),
        )(),
        "gate with a suite": run("gate", "--suite", suite),
        "two folders in parts": run(
            folder / "truth", folder / "estimate", *METRIC, "--jobs", "1", "--memory", "1GB"
        ),
    }


@click.command(help=__doc__)
@click.option("--list", "story", help="Print the functions of this story.")
def main(story: str | None) -> None:
    """Print a line for each story."""
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        for name, call in stories(Path(folder)).items():
            Trace(call)  # imports
            traced = Trace(call)
            if name == story:
                lines += sorted(
                    f"{code.co_filename.removeprefix(OURS)}: {code.co_qualname}"
                    for code in traced.functions
                )
            functions = len(traced.functions)
            lines.append(
                f"{name:22}{functions:5} functions{traced.files:5} files, depth {traced.depth}"
            )
    click.echo("\n".join(lines))


if __name__ == "__main__":
    main()
