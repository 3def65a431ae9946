"""Want of memory: said as such, with the status of a solver that failed."""

import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import PATIENCE

from tgospa_eval import InputError
from tgospa_eval.formats import ReadOptions, read

LARGE = 64 << 30


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


def test_a_limit_changes_no_status(
    quickstart: tuple[str, str], environment: dict[str, str]
) -> None:
    done = limited(LARGE, "-m", "tgospa_eval", *quickstart, "-q", env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "TGOSPA" in done.stdout
    done = limited(LARGE, "-m", "tgospa_eval", "none.csv", "none.csv", env=environment)
    assert (done.returncode, done.stdout) == (3, "")
    assert "none.csv: no such file" in done.stderr


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
        f"import os, sys, time; from tgospa_eval.cli import guarded; sys.exit(guarded({work}, 130))"
    )
    done = limited(LARGE, "-c", script, env=environment)
    assert done.returncode == status
    assert done.stderr.startswith("out of memory: 65536 MiB") == (status == 4)


@pytest.mark.parametrize("most", [370, 400])
def test_exact_where_threads_find_no_memory(
    quickstart: tuple[str, str], environment: dict[str, str], most: int
) -> None:
    """It ends, with an answer or for want of memory, and is not taken for interrupted."""
    command = ["-m", "tgospa_eval", *quickstart, "-q", "--solver", "exact"]
    done = limited(most * 1_000_000, *command, env=environment)
    assert (done.returncode, bool(done.stdout)) in ((0, True), (4, False)), done.stderr
    assert done.stderr.startswith("out of memory") == (done.returncode == 4)


def test_a_second_interrupt_ends_what_answers_none(environment: dict[str, str]) -> None:
    script = (
        "import os, signal, sys, time\n"
        "from tgospa_eval.cli import guarded\n"
        "def work():\n"
        "    signal.signal(signal.SIGINT, lambda *_: os.kill(os.getppid(), signal.SIGINT))\n"
        "    os.kill(os.getppid(), signal.SIGINT)\n"
        "    while True:\n"
        "        time.sleep(30)\n"
        "sys.exit(guarded(work, 130))\n"
    )
    assert limited(LARGE, "-c", script, env=environment).returncode == 130


def _packed(folder: Path, suffix: str) -> str:
    """A small file with 100,000 rows."""
    rows = 100_000
    columns = {"id": np.zeros(rows, np.int64), "t": np.arange(rows), "x": np.zeros(rows)}
    path = folder / f"packed.{suffix}"
    if suffix == "npz":
        np.savez_compressed(path, **columns)
    elif suffix == "parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
        import pyarrow as pa

        parquet.write_table(pa.table(columns), path)
    else:
        lines = [f"1,{k},0" for k in range(rows)]
        path.write_text("\n".join(["id,t,x", *lines]) + "\n", encoding="ascii")
    return str(path)


@pytest.mark.parametrize(
    ("suffix", "what"),
    [
        ("npz", r"arrays of 2,400,\d+ bytes: reading it needs about 0\.014 GB"),
        ("parquet", r"100,000 rows of 3 columns: reading it needs about 0\.014 GB"),
        ("csv", r"988,897 bytes of text: reading it needs about 0\.003 GB"),
    ],
)
def test_files_that_unpack_to_more_than_is_allowed(tmp_path: Path, suffix: str, what: str) -> None:
    path = _packed(tmp_path, suffix)
    message = rf"packed\.{suffix}: {what}, but 0\.002 GB are allowed; .* max_input"
    with pytest.raises(InputError, match=message):
        read(path, ReadOptions(max_input=0.002))
    for allowed in (None, 0, 0.1):
        assert read(path, ReadOptions(max_input=allowed)).rows == 100_000


def test_a_file_that_is_larger_than_what_is_allowed(tmp_path: Path, invoke: Any) -> None:
    path = _packed(tmp_path, "csv")
    answer = invoke(path, path, "--max-input", "0.0001")
    assert (answer.status, answer.out) == (3, "")
    assert "larger than 0 MiB; allow more with --max-input GB" in answer.err
    assert invoke("inspect", path, "--max-input", "1").status == 0
