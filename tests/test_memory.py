"""Want of memory: said as such, with the status of a solver that failed."""

import resource
import subprocess
import sys

import pytest
from browser import PATIENCE

SMALL, LARGE = 150 << 20, 64 << 30


def limited(most: int, *command: str, env: dict[str, str]) -> "subprocess.CompletedProcess[str]":
    """Run Python in so much address space."""
    return subprocess.run(
        [sys.executable, *command],
        env=env,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


@pytest.mark.parametrize("options", [[], ["--solver", "exact"]], ids=["certified", "exact"])
def test_out_of_memory(
    quickstart: tuple[str, str], environment: dict[str, str], options: list[str]
) -> None:
    command = ["-m", "tgospa_eval", *quickstart, "-q", *options]
    done = limited(SMALL, *command, env=environment)
    assert (done.returncode, done.stdout) == (4, "")
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("out of memory")
    assert limited(LARGE, *command, env=environment).returncode == 0


def test_a_library_that_finds_no_memory_is_not_missing(
    quickstart: tuple[str, str], environment: dict[str, str]
) -> None:
    script = (
        "import sys\n"
        "class Loader:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'clarabel':\n"
        "            raise ImportError('clarabel.so: failed to map segment from shared object')\n"
        "sys.meta_path.insert(0, Loader())\n"
        "from tgospa_eval.cli import main\n"
        "main(sys.argv[1:])\n"
    )
    command = ["-c", script, *quickstart, "-q", "--solver", "exact"]
    done = limited(LARGE, *command, env=environment)
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr.startswith("out of memory")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("work", "status"),
    [
        ("lambda: 3", 3),
        ("os.abort", 4),
        ("lambda: os._exit(1)", 4),
        ("lambda: os._exit(130)", 130),
        ("lambda: os.kill(os.getpid(), 9)", -9),
        ("lambda: os.kill(os.getppid(), 15) or time.sleep(30)", -15),
    ],
)
def test_ends_under_a_limit(environment: dict[str, str], work: str, status: int) -> None:
    script = (
        "import os, sys, time; from tgospa_eval.cli.guard import guarded; "
        f"sys.exit(guarded({work}, 130))"
    )
    done = limited(LARGE, "-c", script, env=environment)
    assert done.returncode == status
    assert done.stderr.startswith("out of memory: 65536 MiB") == (status == 4)
