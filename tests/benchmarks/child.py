"""A slow programme in a process of its own, so that it can be killed after a minute."""

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from scenes import Scene
from yardsticks import naive_programme, published_code, stone_soup_gospa

PROGRAMMES = {
    "naive": partial(partial, naive_programme),  # all of it is timed
    "published": published_code,
    "stone soup": stone_soup_gospa,
}
SMALLEST = Scene(targets=2, steps=3, area=5.0)


def measure(
    programme: str, scene: Scene, seed: int, limit: float, folders: Sequence[Path]
) -> tuple[float, float] | None:
    """The metric and the seconds it took, or None after `limit` seconds.

    `folders` are searched for modules first.
    """
    command = [sys.executable, __file__, programme, str(scene), str(seed), *map(str, folders)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()  # imported and warm
        try:
            answer = child.communicate(timeout=limit)[0]
        except subprocess.TimeoutExpired:
            child.kill()
            return None
    value, seconds = json.loads(answer)
    return value, seconds


def main() -> None:
    """Solve the scene of the arguments; print value and seconds."""
    programme, scene, seed, *folders = sys.argv[1:]
    sys.path[:0] = folders
    prepare = PROGRAMMES[programme]
    prepare(*SMALLEST.arrays(0))()
    run = prepare(*Scene.parse(scene).arrays(int(seed)))
    print("ready", flush=True)
    begin = time.perf_counter()
    value = run()
    print(json.dumps((value, time.perf_counter() - begin)))


if __name__ == "__main__":
    main()
