"""Run again what the sources of docs/theory/clouds.md claim of clouds: tables and pictures.

``python docs/theory/reproduction [--quick] [--part NAME]... [--output FOLDER]`` prints the tables
and writes the pictures to the folder, by default this one. It needs the extras ``clouds`` and
``plot``.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from convergence import bias, steadiness
from prossel import reduction
from rates import rates
from times import SIZES, tables

PARTS: dict[str, tuple[Callable[[Path], None], Callable[[Path], None]]] = {
    "convergence": (
        lambda folder: bias(24, (50, 100, 300, 600), folder),
        lambda folder: bias(1, (50, 100), folder),
    ),
    "steadiness": (lambda _: steadiness(12, 20, 600), lambda _: steadiness(1, 2, 300)),
    "times": (
        lambda folder: tables(4, SIZES, 200, folder),
        lambda folder: tables(1, SIZES[:2], 50, folder),
    ),
    "rates": (lambda folder: rates(100, 50, folder), lambda folder: rates(1, 1, folder)),
    "reduction": (lambda folder: reduction(100, folder), lambda folder: reduction(1, folder)),
}
"""What to run, in full and quickly."""


def main() -> None:
    """All parts, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python docs/theory/reproduction")
    parser.add_argument("--quick", action="store_true", help="few runs: whether it works")
    parser.add_argument("--part", action="append", choices=PARTS, help="this one only")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent, metavar="FOLDER")
    given = parser.parse_args()
    begin = time.process_time()
    for name in given.part or PARTS:
        PARTS[name][given.quick](given.output)
        print(
            f"# {name}: {time.process_time() - begin:.0f} s of the processor so far\n", flush=True
        )


if __name__ == "__main__":
    main()
