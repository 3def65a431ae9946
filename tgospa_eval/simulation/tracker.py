"""Errors of trackers, one function each, without scenarios and files.

Each function receives states (T, n, d) of T steps and n tracks, NaN where a track is absent, and
returns new states. Before `swap` and `fragment`, track i follows target i. The argument `meetings`
has the result of `tgospa_eval.simulation.scenarios.encounters`.
"""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats
from tgospa_eval.tracks.clouds import Clouds

WIDER = 1.5
"""Standard deviation of drawn particles, as a multiple of that of the represented Gaussian."""

LARGEST_DEVIATE = 2.6
"""Largest deviation of a drawn particle, in standard deviations of drawn particles. Farther away,
weights would be close to 0."""


def particle_clouds(
    centres: Floats, noise: float, count: int, decimals: int, rng: np.random.Generator
) -> Clouds:
    """Return clouds that represent Gaussians around the centres (R, d), with deviation `noise`.

    Particles are drawn from a wider Gaussian and weighted with the ratio of the densities.
    Positions are rounded to `decimals`; weights are short decimals that sum to 1.
    """
    rows, size = centres.shape
    deviates = (
        rng.standard_normal((rows, count, size)).clip(-LARGEST_DEVIATE, LARGEST_DEVIATE) * WIDER
    )
    ratio = np.exp(-0.5 * (1 - WIDER**-2) * (deviates**2).sum(axis=-1))
    unit = 10 ** (len(str(count)) + 4)
    shares = np.floor(unit * ratio / ratio.sum(axis=1, keepdims=True))
    # The heaviest particle gets the remainder of rounding down.
    shares[np.arange(rows), shares.argmax(axis=1)] += unit - shares.sum(axis=1)
    points = np.round(centres[:, None] + noise * deviates, decimals)
    return Clouds(
        points=points.reshape(-1, size),
        weights=(shares / unit).ravel(),
        first=np.arange(rows + 1) * count,
    )


Ints = NDArray[np.int64]


def confirm_late(states: Floats, delay: int) -> Floats:
    """Leave out the first `delay` steps of every track."""
    age = np.cumsum(~np.isnan(states[..., 0]), axis=0)
    return np.where((age > delay)[..., None], states, np.nan)


def merge(states: Floats, meetings: Ints, probability: float, rng: np.random.Generator) -> Floats:
    """Merge the tracks of two targets in an encounter, with this probability.

    During the encounter, the first track is at the mean of both, and the second is silent. A
    track merges with one track at a time, in the encounter that begins first.
    """
    merged = states.copy()
    busy = np.zeros(states.shape[:2], bool)
    chosen = meetings[rng.random(len(meetings)) < probability]
    for first, second, begin, end, _ in chosen.tolist():
        pair = (slice(begin, end), [first, second])
        if busy[pair].any():
            continue
        busy[pair] = True
        a, b = states[begin:end, first], states[begin:end, second]
        merged[begin:end, first] = np.where(np.isnan(a), b, np.where(np.isnan(b), a, (a + b) / 2))
        merged[begin:end, second] = np.nan
    return merged


def add_noise(states: Floats, deviation: float, rng: np.random.Generator) -> Floats:
    """Add independent N(0, deviation^2) to every coordinate."""
    return states + rng.normal(0, deviation, states.shape)


def covariance_of_a_radar(states: Floats, deviation: float, area: float) -> Floats:
    """Return covariances (T, n, 3), xx, xy, yy, of the errors of a radar at the origin.

    C = S^2 (0.5^2 u u' + (0.5 + r / A)^2 v v') with S = `deviation`, A = `area` and the range r.
    The unit vector u is along the line of sight, and v is across it. The standard deviation along
    the line of sight is S / 2; across it, the deviation grows with the range.
    """
    x, y = states[..., 0], states[..., 1]
    distance = np.sqrt(x * x + y * y)
    far = np.where(distance > 0, distance, 1.0)
    x, y = np.where(distance > 0, x, 1.0) / far, y / far
    along, across = 0.25, (0.5 + distance / area) ** 2
    entries = (
        along * x * x + across * y * y,
        (along - across) * x * y,
        along * y * y + across * x * x,
    )
    return deviation**2 * np.stack(entries, axis=-1)


def add_noise_of_a_radar(
    states: Floats, deviation: float, area: float, rng: np.random.Generator
) -> Floats:
    """Add errors of a radar to positions (T, n, 2), and return Gaussians (T, n, 5).

    The errors of the means are drawn from the covariances.
    """
    packed = covariance_of_a_radar(states, deviation, area)
    xx, xy, yy = np.moveaxis(packed, -1, 0)
    draw = rng.normal(0, 1, states.shape)
    first = np.sqrt(xx)
    below = np.divide(xy, first, out=np.zeros_like(xy), where=first > 0)
    error = np.stack(
        (
            first * draw[..., 0],
            below * draw[..., 0] + np.sqrt(np.maximum(yy - below * below, 0)) * draw[..., 1],
        ),
        axis=-1,
    )
    return np.concatenate((states + error, packed), axis=-1)


def miss(states: Floats, detection: float, rng: np.random.Generator) -> Floats:
    """Keep each state with the probability `detection`, independently."""
    return np.where((rng.random(states.shape[:2]) < detection)[..., None], states, np.nan)


def swap(states: Floats, meetings: Ints, probability: float, rng: np.random.Generator) -> Floats:
    """Exchange, with this probability, the two tracks of an encounter from its closest step on."""
    chosen = meetings[rng.random(len(meetings)) < probability]
    chosen = chosen[np.argsort(chosen[:, 4], kind="stable")]
    track = np.arange(states.shape[1])  # track of each target, up to the next swap
    target = track.copy()  # target of each track
    swapped = np.empty_like(states)
    done = 0
    for first, second, _, _, closest in chosen.tolist():
        swapped[done:closest] = states[done:closest, target]
        done = closest
        track[[first, second]] = track[[second, first]]
        target[track[[first, second]]] = first, second
    swapped[done:] = states[done:, target]
    return swapped


def fragment(states: Floats, probability: float, gap: int, rng: np.random.Generator) -> Floats:
    """Lose the track at each reported step, with this probability.

    The track is silent from that step for `gap` steps. It continues as a new track, in a new column
    at the end. The first step of a track is never lost.
    """
    states = states.copy()
    present = ~np.isnan(states[..., 0])
    lost = (rng.random(present.shape) < probability) & present
    lost &= np.cumsum(present, axis=0) > 1
    fresh = []
    for column in range(states.shape[1]):
        track, free = states[:, column], 0
        for step in np.flatnonzero(lost[:, column]):
            if step < free:
                continue
            free = int(step) + gap
            if np.isnan(track[free:]).all():
                track[step:free] = np.nan
                break
            rest = np.full_like(track, np.nan)
            rest[free:] = track[free:]
            track[step:] = np.nan
            # The first report of the new track cannot be lost either.
            free += int(np.flatnonzero(~np.isnan(rest[free:, 0]))[0]) + 1
            fresh.append(rest)
            track = rest
    return np.concatenate((states, *(track[:, None] for track in fresh)), axis=1)


def lag(states: Floats, steps: int) -> Floats:
    """Report at step k the state of step k - `steps`."""
    late = np.full_like(states, np.nan)
    late[steps:] = states[: max(len(states) - steps, 0)]
    return late


def false_tracks(
    steps: int, rate: float, length: tuple[int, int], area: float, rng: np.random.Generator
) -> Floats:
    """Return the positions (T, f, 2) of f false tracks.

    Poisson(`rate`) tracks begin at every step. Lengths are uniform in
    {length[0], ..., length[1]}, and tracks end with the recording at the latest. The start is
    uniform in the square, and the path is a straight line with steps N(0, (A/100)^2).
    """
    begin = np.repeat(np.arange(steps), rng.poisson(rate, steps))
    long = rng.integers(*length, len(begin), endpoint=True)
    start = rng.uniform(0, area, (len(begin), 2))
    velocity = rng.normal(0, area / 100, (len(begin), 2))
    age = np.arange(steps)[:, None] - begin
    alive = (age >= 0) & (age < long)
    return np.where(alive[..., None], start + velocity * age[..., None], np.nan)
