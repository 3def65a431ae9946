"""The naive programme in a process of its own, so that it can be killed after a minute."""

import json
import subprocess
import sys
import time

from scenes import Scene
from yardsticks import naive_programme

SMALLEST = Scene(targets=2, steps=3, area=5.0)


def measure(scene: Scene, seed: int, limit: float) -> tuple[float, float] | None:
    """The metric and the seconds it took, or None after `limit` seconds."""
    with subprocess.Popen(
        [sys.executable, __file__, str(scene), str(seed)], stdout=subprocess.PIPE, text=True
    ) as child:
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
    truth, estimate = Scene.parse(sys.argv[1]).arrays(int(sys.argv[2]))
    naive_programme(*SMALLEST.arrays(0))
    print("ready", flush=True)
    begin = time.perf_counter()
    value = naive_programme(truth, estimate)
    print(json.dumps((value, time.perf_counter() - begin)))


if __name__ == "__main__":
    main()
