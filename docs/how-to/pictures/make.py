"""The pictures of the gallery, from the sample data: ``make pictures``, in a checkout."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
SAMPLE = HERE.parents[2] / "sample_data"
QUICK = "sample_data/quickstart/truth.csv sample_data/quickstart/estimate.csv -c 10 -g 5 --unit m"
MANY = "simulate many --scenario parallel --targets 60 --steps 200 --area 3000 --noise 3 --seed 3"
DENSE = "--scenario dense --targets 12 --steps 60 --area 100 --seed 4"
RUNS = "sample_data/batch/montecarlo"
NIGHTS = f"batch --truth {RUNS}/{{run}}/truth.csv --estimate {RUNS}/{{run}}/{{tracker}}.csv"
COMMANDS = {
    QUICK: {f"result_{name}": name for name in ("costs", "lanes", "plane", "worst")},
    f"{MANY} --detection 1 --swaps 0 --fragmentation 0.0008": {},
    "many/truth.csv many/estimate.csv -c 50 -g 5 --unit m": {"many_lanes": "lanes"},
    f"{QUICK} --sweep cutoff=2,3,4,6,10,15,25,40": {"sweep": "sweep"},
    f"simulate careful {DENSE} --detection 0.85 --swaps 0.1": {},
    f"simulate eager {DENSE} --detection 0.99 --swaps 0.6 --false-rate 0.3": {},
    f"simulate lagging {DENSE} --detection 0.97 --latency 2": {},
    "compare careful/truth.csv careful/estimate.csv eager/estimate.csv lagging/estimate.csv -c 5 "
    "-g 3 --unit m": {"cumulative": "cumulative"},
    "simulate scene --scenario dense --targets 20 --steps 60 --area 60 --seed 6": {},
    "compare scene/truth.csv scene/estimate.csv -c 8 -g 3 --solvers certified,sinkhorn": {
        name: name for name in ("error_over_epsilon", "time_over_error")
    },
    f"{NIGHTS} --per-step --curve --by tracker -c 10 -g 5": {
        "batch_curve": "curve",
        "batch_parts": "parts",
    },
    "compare --simulate --targets 10,20,40 --steps 50,100 --runs 5 -c 10 -g 3": {
        "scaling": "scaling"
    },
}
"""By command the pictures of its folder that are kept, by the names that they get here."""


def main() -> None:
    """Make all, with few colours: they are a third as large."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        shutil.copytree(SAMPLE, "sample_data")
        for k, (command, names) in enumerate(COMMANDS.items()):
            output = ["-o", f"out{k}"] if names else []
            program = [sys.executable, "-m", "tgospa_eval", *command.split(), *output, "-q"]
            subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
            for name, picture in names.items():
                image = Image.open(f"out{k}/{picture}.png").convert("RGB")
                few = image.quantize(255, dither=Image.Dither.NONE)
                few.save(HERE / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
