"""Particle clouds: what bounds save, and what reduction costs and changes. Ratios within one run.

``python tests/benchmarks/clouds.py [STEPS]``: 20 x 20 clouds of 200 particles at so many steps.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from tgospa_eval.distances import (
    CloudWasserstein,
    SlicedWasserstein,
    cloud_wasserstein,
    near_pairs,
    reduce_cloud,
)
from tgospa_eval.tracks.clouds import Clouds
from tgospa_eval.tracks.trajectories import Trajectories

TRACKS, PARTICLES, CUTOFF = 20, 200, 10.0


def scene(
    centres: np.ndarray, rng: np.random.Generator, particles: int = PARTICLES
) -> Trajectories:
    """Weighted clouds around the centres (T, m, 2), with two modes each."""
    steps, tracks, _ = centres.shape
    rows = steps * tracks
    modes = rng.choice((-3.0, 3.0), (rows, particles, 1)) * (1, 0.5)
    points = centres.reshape(rows, 1, 2) + modes + rng.standard_normal((rows, particles, 2))
    weights = rng.random((rows, particles))
    weights /= weights.sum(axis=1, keepdims=True)
    clouds = Clouds(
        points=points.reshape(-1, 2),
        weights=weights.ravel(),
        first=np.arange(rows + 1) * particles,
    )
    return Trajectories(
        step=np.repeat(np.arange(steps), tracks),
        track=np.tile(np.arange(tracks), steps),
        state=clouds.means,
        ids=np.array([str(k) for k in range(tracks)], dtype=object),
        times=np.arange(steps),
        columns=("x", "y"),
        clouds=clouds,
    )


def timed(work: Callable[[], object]) -> tuple[object, float]:
    """The answer, and the seconds of all processors: others may use the machine too."""
    begin = time.process_time()
    answer = work()
    return answer, time.process_time() - begin


def gating(steps: int) -> None:
    """All pairs solved, and those that the bounds leave."""
    rng = np.random.default_rng(0)
    centres = rng.uniform(0, 100, (steps, TRACKS, 2))
    truth = scene(centres, rng)
    estimate = scene(centres + 2 * rng.standard_normal(centres.shape), rng)
    near_pairs(truth, estimate, 1e-3, CloudWasserstein())  # imports
    gated, quick = timed(lambda: near_pairs(truth, estimate, CUTOFF, CloudWasserstein()))
    whole, slow = timed(lambda: near_pairs(truth, estimate, CUTOFF, CloudWasserstein(gating=False)))
    same = np.array_equal(gated.truth_row, whole.truth_row)
    apart = np.abs(gated.distance - whole.distance).max() if same else np.nan
    print(
        f"{TRACKS} x {TRACKS} x {steps} clouds of {PARTICLES}: gated {quick:.1f} s, ungated "
        f"{slow:.1f} s, ratio 1/{slow / quick:.1f}; {len(gated.distance)} near pairs, largest "
        f"difference {apart:.1e}"
    )


def slicing(steps: int, particles: int) -> None:
    """The sliced distances, beside a transport of clouds of as many particles."""
    rng = np.random.default_rng(0)
    centres = rng.uniform(0, 100, (steps, TRACKS, 2))
    truth = scene(centres, rng, particles)
    estimate = scene(centres + 2 * rng.standard_normal(centres.shape), rng, particles)
    some = [truth.clouds[row] + estimate.clouds[row] for row in range(0, 400, 50)]
    _, one = timed(lambda: [cloud_wasserstein(*pair) for pair in some])
    for distance in (SlicedWasserstein(), SlicedWasserstein(maximum=True)):
        near, spent = timed(lambda d=distance: near_pairs(truth, estimate, CUTOFF / 2**0.5, d))
        count = len(near.distance)
        print(
            f"{distance.name}, {TRACKS} x {TRACKS} x {steps} clouds of {particles}: {spent:.1f} s, "
            f"{count} near pairs; transports of as many pairs about {count * one / len(some):.0f} s"
        )


def reduction(pairs: int = 8) -> None:
    """1,000 particles to 50: what it costs for a pair of clouds, and the error of W2."""
    rng = np.random.default_rng(1)
    shapes = {
        "normal": lambda: rng.standard_normal((1000, 2)),
        "correlated": lambda: rng.standard_normal((1000, 2)) @ [[2, 1.5], [0, 0.7]],
        "two modes": lambda: rng.standard_normal((1000, 2)) + rng.choice((-3, 3), (1000, 1)),
    }
    for name, draw in shapes.items():
        errors, exact, reduced, once = [], 0.0, 0.0, 0.0
        for _ in range(pairs):
            clouds = [(draw() + shift, rng.dirichlet(np.ones(1000))) for shift in (0, (2, 1))]
            value, seconds = timed(lambda c=clouds: cloud_wasserstein(*c[0], *c[1]))
            exact += seconds
            small, seconds = timed(lambda c=clouds: [reduce_cloud(*each, 50) for each in c])
            once += seconds
            near, seconds = timed(lambda s=small: cloud_wasserstein(*s[0], *s[1]))
            reduced += seconds
            errors.append(near / value - 1)
        print(
            f"1000 -> 50, {name}: W2 off by {100 * np.sqrt(np.mean(np.square(errors))):.2f} % "
            f"(root mean square), {exact / reduced:.0f} times cheaper for a pair; a pair takes "
            f"{1e3 * exact / pairs:.0f} ms, reducing a cloud {500 * once / pairs:.1f} ms"
        )


if __name__ == "__main__":
    cloud_wasserstein([(0, 0), (1, 0)], None, [(0, 0), (2, 2), (3, 1)], None)  # imports
    slicing(100, 500)
    reduction()
    gating(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
