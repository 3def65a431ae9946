"""Whether what is called exact is exact: scenes with far cutoffs, each judged by integers.

``python tests/benchmarks/exactness.py FAMILY SEED INDEX`` evaluates one scene again and writes its
files; the family is one of `far_scenes.FAMILIES`.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import click
import numpy as np
from store import Store, Values

sys.path.append(str(Path(__file__).parents[1] / "support"))  # the referee is that of the tests

from claims import GAP, claim, judge, reference_of
from far_scenes import FAMILIES, RANDOM, WALKS, far_scene

from tgospa_eval import Certified

__all__ = ("FAMILIES", "GAP", "LIMIT")

PART = "exactness"

SHARES = {5: 0.05, 10: 0.012, 12: 0.002, 24: 0.002}
"""Scenes of a setting of walks for each scene of a random family, by the number of tracks."""

LIMIT = 20.0
"""Seconds for the certified solver on one scene."""

EVERY = 30.0
"""Seconds between two lines of counts."""


Key = tuple[str, int, int]
"""Family, seed, index."""


@dataclass(frozen=True)
class Plan:
    """`scenes` of each random family, fewer of the walks; `jobs` processes."""

    scenes: int = 500
    seed: int = 0
    jobs: int = 1
    families: tuple[str, ...] = FAMILIES

    def counts(self) -> dict[str, int]:
        """Number of scenes of each family."""
        return {
            family: self.scenes
            if family in RANDOM
            else math.ceil(self.scenes * SHARES[WALKS[family][0]])
            for family in self.families
        }


def examine(family: str, seed: int, index: int) -> Values:
    """Evaluate one scene, and judge what is claimed."""
    scene = far_scene(family, seed, index)
    begin = time.perf_counter()
    try:
        result = claim(scene, Certified(time_limit=LIMIT, jobs=1))
    except Exception as error:  # whatever it is, it is counted and told
        return {"failed": f"{type(error).__name__}: {error}", "scene": str(scene)}
    seconds = time.perf_counter() - begin
    begin = time.perf_counter()
    reference = reference_of(scene)
    judgement = judge(result, scene, reference)
    return {
        "scene": str(scene),
        "seconds": seconds,
        "reference_seconds": time.perf_counter() - begin,
        "certified": judgement.certified,
        "within_rounding": judgement.within_rounding,
        "wrong": judgement.wrong,
        "above": judgement.above,
        "below": judgement.below,
        "gap": judgement.gap,
        "faults": judgement.faults,
        "value": result.tgospa,
        "optimum": reference.metric,
    }


def measure(plan: Plan, store: Store, say: Callable[[str], None]) -> None:
    """Examine what was not yet; faults are told as they are found, earlier ones first."""
    missing = []
    for family, count in plan.counts().items():
        for index in range(count):
            values = stored(family, plan.seed, index, store)
            if values is None:
                missing.append((family, plan.seed, index))
            else:
                _tell((family, plan.seed, index), values)
    told, faulty = time.monotonic(), 0
    for done, (key, values) in enumerate(_examined(missing, plan.jobs), 1):
        store.add(PART, *map(str, key), values=values)
        faulty += _tell(key, values)
        if time.monotonic() - told > EVERY or done == len(missing):
            told = time.monotonic()
            say(f"exactness: {done} of {len(missing)} scenes, {faulty} with faults or open")


def _tell(key: Key, values: Values) -> bool:
    lines = complaints(*key, values)
    for line in lines:
        click.echo(line)
    return bool(lines)


def stored(family: str, seed: int, index: int, store: Store) -> Values | None:
    """What was found before."""
    return store.get(PART, family, str(seed), str(index))


def complaints(family: str, seed: int, index: int, values: Values) -> list[str]:
    """A line for each fault: which scene, and what is wrong."""
    faults = [values["failed"]] if "failed" in values else list(values["faults"])
    if not values.get("certified", True):
        faults.append(f"left open: gap {values['gap']:.3g} after {values['seconds']:.2f} s")
    return [f"{family!r} {seed} {index}: {fault} ({values['scene']})" for fault in faults]


def _examined(keys: list[Key], jobs: int) -> Iterator[tuple[Key, Values]]:
    """Keys and what was found, in the order given."""
    spawn = get_context("spawn")
    pool = ProcessPoolExecutor(jobs, spawn) if jobs > 1 else nullcontext()
    with pool as workers:
        if workers is None:
            yield from ((key, examine(*key)) for key in keys)
            return
        left = iter(keys)
        while batch := list(islice(left, 64 * jobs)):
            found = workers.map(examine, *zip(*batch, strict=True), chunksize=4)
            yield from zip(batch, found, strict=True)


def write(folder: Path, family: str, seed: int, index: int) -> str:
    """The files of a scene, digit for digit, and the command that evaluates them."""
    scene = far_scene(family, seed, index)
    names = []
    for name, states in (("truth", scene.truth), ("estimate", scene.estimate)):
        axes = ["x", "y", "z"][: states.shape[2]]
        lines = [",".join(["id", "t", *axes])]
        for step, track in zip(*np.nonzero(~np.isnan(states[:, :, 0])), strict=True):
            numbers = ",".join(map(repr, states[step, track].tolist()))
            lines.append(f"{name[0]}{track},{step},{numbers}")
        path = folder / f"{name}.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        names.append(str(path))
    options = ["-c", repr(scene.c), "-p", repr(scene.p), "-g", repr(scene.gamma)]
    return " ".join(["tgospa-eval", *names, *options, "--distance", scene.distance])


@click.command()
@click.argument("family", type=click.Choice(FAMILIES))
@click.argument("seed", type=int)
@click.argument("index", type=int)
@click.option("--folder", type=click.Path(file_okay=False, exists=True, path_type=Path))
def main(*, family: str, seed: int, index: int, folder: Path | None) -> None:
    """Judge one scene again; with --folder write its files."""
    for name, value in examine(family, seed, index).items():
        click.echo(f"{name}: {value}")
    if folder:
        click.echo(write(folder, family, seed, index))


if __name__ == "__main__":
    main()
