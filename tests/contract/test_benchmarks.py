"""The benchmarks can be run: who changes the package or the tests does not see them otherwise."""

import subprocess
import sys

import pytest
from checkout import ROOT

LOADS = """
import runpy, sys
sys.path.insert(0, sys.argv[1])
names = runpy.run_path(sys.argv[1] + "/__main__.py")
import machine, page
page.ROUNDS = 1
import against, pathlib
assert len(against.cases(pathlib.Path("x"))) > 5
once = against.EVALUATION.replace("+ 2.0", "")
assert against.seconds(against.ROOT, once, str(against.ROOT), "2,8,20", "{}") > 0
assert len(machine.fingerprint()) == 16
assert page.measure(page.SMALL[0])["bytes"] > 10_000
from methods import Instance
assert Instance(page.SMALL[0], 0).methods["stone soup"]().complete
print(*names["PARTS"])
"""


@pytest.mark.process
def test_benchmarks_load_and_measure(environment: dict[str, str]) -> None:
    folder = str(ROOT / "tests" / "benchmarks")
    done = subprocess.run(
        [sys.executable, "-c", LOADS, folder],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[:2] == ["grid", "growth"]
