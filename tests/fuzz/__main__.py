"""Property tests with new seeds, for a given time: ``make fuzz SECONDS=600``.

One file of tests after another, each as a process with a seed of its own. The first failure ends
it, with what pytest says and the command that says it again.
"""

import argparse
import itertools
import os
import random
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

TESTS = Path(__file__).parents[1]


def command(file: str, seed: int) -> list[str]:
    """What runs one file; in a shell it does the same again."""
    return [
        *(sys.executable, "-m", "pytest", file, "-m", "hypothesis"),
        *("--hypothesis-profile=fuzz", f"--hypothesis-seed={seed}"),
    ]


def explore(take: Callable[[], str], end: float, failed: list[str]) -> None:
    """Files until the time is up or one has failed."""
    while time.monotonic() < end and not failed:
        words = command(take(), random.getrandbits(32))
        begin = time.monotonic()
        done = subprocess.run(words, capture_output=True, text=True, cwd=TESTS.parent, check=False)
        seconds = time.monotonic() - begin
        if done.returncode:
            failed.append(shlex.join(words))
            print(done.stdout, done.stderr, sep="\n", flush=True)
        else:
            print(f"{words[3]}: {words[-1]}, {seconds:.0f} s, nothing found", flush=True)


def main() -> int:
    """0 if nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    end = time.monotonic() + parser.parse_args().seconds
    files = [
        str(path.relative_to(TESTS.parent))
        for path in sorted(TESTS.rglob("test_*.py"))
        if "@given" in path.read_text(encoding="utf-8")
    ]
    random.shuffle(files)
    take = itertools.cycle(files).__next__
    failed: list[str] = []
    processes = os.cpu_count() or 1
    with ThreadPoolExecutor(processes) as pool:
        running = [pool.submit(explore, take, end, failed) for _ in range(processes)]
    for future in running:
        future.result()
    for line in failed:
        print(f"FOUND A FAULT; once more: {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
