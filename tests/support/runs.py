"""Runs of two trackers, as files of a batch."""

from pathlib import Path

PATTERNS = ("--truth", "gt/{run}.csv", "--estimate", "out/{tracker}/{run}.csv", "-c", "10")


def write_runs(count: int) -> None:
    """Write them here: the error of tracker b is 2 at each of five steps, that of tracker a 1."""
    for name, error in (("gt", 0), ("out/a", 1), ("out/b", 2)):
        Path(name).mkdir(parents=True)
        for run in range(count):
            rows = "".join(f"1,{k},{k + error},{run}\n" for k in range(5))
            Path(name, f"{run}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")
