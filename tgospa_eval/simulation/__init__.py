"""Synthetic scenes: the ground truth of a named scenario, and tracks with known errors."""

import math
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import LARGEST_COUNT, ConfigError, real_number, whole_number
from tgospa_eval.quoting import option, quoted
from tgospa_eval.simulation import tracker as errors
from tgospa_eval.simulation.scenarios import SCENARIOS, encounters
from tgospa_eval.simulation.tracker import particle_clouds
from tgospa_eval.tracks.trajectories import Trajectories

COLUMNS = {
    "point": ("x", "y"),
    "gaussian": ("x", "y"),
    "cloud": ("x", "y"),
    "box": ("left", "top", "width", "height"),
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Settings of the ground truth.

    Parameters
    ----------
    scenario : str
        Name in `tgospa_eval.simulation.SCENARIOS`.
    targets, steps : int
        Numbers of targets (at least 0) and steps (at least 1).
    area : float
        Side A of the square [0, A]^2, in state units; from 1e-6 to 1e12.
    state : {"point", "gaussian", "cloud", "box"}
        Kind of the states. Points have ``x, y``. Gaussians also have the covariance of the error
        of each estimate. With clouds, true states are points, and each estimate is a cloud of
        particles that represents the noise. Boxes have ``left, top, width, height``, and the
        position is their centre. The height of an object is drawn uniformly from [A/20, A/8] and
        kept; its width is 0.4 of the height.
    particles : int
        Number of particles of a cloud, at least 1.

    Raises
    ------
    ConfigError
        A value is not allowed.
    """

    scenario: str = "crossing"
    targets: int = 5
    steps: int = 60
    area: float = 200.0
    state: str = "point"
    particles: int = 100

    def __post_init__(self) -> None:
        for name, value, known in (
            ("scenario", self.scenario, SCENARIOS),
            ("state", self.state, COLUMNS),
        ):
            if value not in known:
                raise ConfigError(f"{name} is {quoted(value)}: must be one of {', '.join(known)}")
        for name, minimum in (("targets", 0), ("steps", 1), ("particles", 1)):
            whole_number(name, getattr(self, name), minimum, LARGEST_COUNT)
        if self.targets * self.steps > LARGEST_COUNT:
            raise ConfigError(
                f"{self.targets} targets in {self.steps} steps are too many: targets times steps "
                f"must be at most {LARGEST_COUNT}"
            )
        _check_ranges(self, {"area": (1e-6, 1e12)})


ERROR_RANGES = {
    **dict.fromkeys(("noise", "near"), (0.0, 1000000000000.0)),
    **dict.fromkeys(("detection", "merges", "swaps", "fragmentation"), (0.0, 1.0)),
    "false_rate": (0.0, 1e6),
}
"""Smallest and largest value of each error that is a real number."""


@dataclass(frozen=True, kw_only=True)
class Tracker:
    """Errors of a tracker; all errors are off by default.

    Parameters
    ----------
    noise : float
        Standard deviation of each coordinate, in state units. For Gaussians it is the scale of
        their errors (`tgospa_eval.simulation.tracker.add_noise_of_a_radar`).
    detection : float
        Probability that a target is reported at a step.
    confirmation : int
        Number of steps after the birth of a target at which it is not reported yet.
    merges : float
        Probability that two targets are one track for as long as they are near.
    swaps : float
        Probability that two near targets exchange their tracks where they are closest.
    near : float
        Distance below which two targets are near, in state units.
    fragmentation : float
        Probability at each step that a track is lost.
    lost : int
        Number of steps until a lost track continues, under a new id.
    latency : int
        Number of steps by which every report is late.
    false_rate : float
        Mean number of false tracks that begin at a step.
    false_length : (int, int)
        Smallest and largest length of false tracks in steps; lengths between are equally likely.

    Raises
    ------
    ConfigError
        A value is out of its range.
    """

    noise: float = 0.0
    detection: float = 1.0
    confirmation: int = 0
    merges: float = 0.0
    swaps: float = 0.0
    near: float = 10.0
    fragmentation: float = 0.0
    lost: int = 3
    latency: int = 0
    false_rate: float = 0.0
    false_length: tuple[int, int] = (3, 10)

    def __post_init__(self) -> None:
        _check_ranges(self, ERROR_RANGES)
        for name in ("confirmation", "lost", "latency"):
            whole_number(name, getattr(self, name), 0, LARGEST_COUNT)
        try:
            shortest, longest = self.false_length
        except (TypeError, ValueError):
            raise ConfigError(
                f"false-length is {self.false_length!r}: must be two numbers, smallest and largest"
            ) from None
        for length in (shortest, longest):
            whole_number("false-length", length, 1, LARGEST_COUNT)
        if shortest > longest:
            raise ConfigError(f"false-length is {shortest}:{longest}: the smallest must be first")


def simulate(
    scene: Scene, tracker: Tracker, rng: np.random.Generator
) -> tuple[Trajectories, Trajectories]:
    """Return the ground truth of a scene, and the tracks that the tracker reports.

    Times and ids of true objects count from 1. The track that begins on object i has the id
    100 + i, or 1000 + i if there are 100 targets or more, and so on. Later tracks have the next
    ids.

    Coordinates are rounded, so that all machines make the same files even if their sines differ in
    the last digit. The unit of the last decimal is about a hundred-thousandth of the side of the
    square. If the noise is not 0, but less than 1/200 of the side, this unit is about 1/500 of the
    noise.

    Every error has its own stream of random numbers, so a change of one error does not change the
    draws of another error.

    Parameters
    ----------
    scene : Scene
        Settings of the ground truth.
    tracker : Tracker
        Errors of the tracker.
    rng : numpy.random.Generator
        Source of random numbers; the same state gives the same result.

    Returns
    -------
    truth, estimate : Trajectories
        Truth and tracks, at the same times.
    """
    streams = rng.spawn(9)
    truth = SCENARIOS[scene.scenario](scene.targets, scene.steps, scene.area, streams[0])
    if scene.state == "box":
        truth = _with_sizes(truth, scene.area, streams[1])
    real = _tracks(truth, scene, tracker, streams[2:7])
    false = errors.false_tracks(
        scene.steps, tracker.false_rate, tracker.false_length, scene.area, streams[7]
    )
    if scene.state == "box":
        false = _with_sizes(false, scene.area, streams[7])
    if scene.state == "gaussian":
        packed = errors.covariance_of_a_radar(false, tracker.noise, scene.area)
        false = np.concatenate((false, packed), axis=-1)
    estimate = np.concatenate((real, false), axis=1)
    scale = min(scene.area, 200 * tracker.noise or np.inf)
    decimals = min(5 - math.floor(math.log10(scale)), 12)
    before = 10 ** max(2, len(str(scene.targets)))
    reported = _trajectories(estimate, scene, tracker, decimals, before)
    if scene.state == "cloud":
        reported = reported.with_clouds(
            particle_clouds(reported.state, tracker.noise, scene.particles, decimals, streams[8])
        )
    return _trajectories(truth, scene, tracker, decimals, 0), reported


def _tracks(
    truth: Floats, scene: Scene, tracker: Tracker, streams: list[np.random.Generator]
) -> Floats:
    """Return the tracks of the targets as the tracker reports them."""
    for_merges, for_noise, for_misses, for_swaps, for_losses = streams
    meetings = encounters(truth, tracker.near if tracker.merges or tracker.swaps else 0.0)
    states = errors.confirm_late(truth, tracker.confirmation)
    states = errors.merge(states, meetings, tracker.merges, for_merges)
    if scene.state == "gaussian":
        states = errors.add_noise_of_a_radar(states, tracker.noise, scene.area, for_noise)
    else:
        states = errors.add_noise(states, tracker.noise, for_noise)
    states = errors.miss(states, tracker.detection, for_misses)
    states = errors.swap(states, meetings, tracker.swaps, for_swaps)
    states = errors.fragment(states, tracker.fragmentation, tracker.lost, for_losses)
    return errors.lag(states, tracker.latency)


def _with_sizes(centres: Floats, area: float, rng: np.random.Generator) -> Floats:
    """Return boxes (T, k, 4) with centre and size, from centres (T, k, 2)."""
    height = rng.uniform(area / 20, area / 8, centres.shape[1])
    size = np.stack((0.4 * height, height), axis=-1)
    return np.concatenate((centres, np.where(np.isnan(centres), np.nan, size)), axis=-1)


def _trajectories(
    states: Floats, scene: Scene, tracker: Tracker, decimals: int, before: int
) -> Trajectories:
    """Return rounded trajectories, with ids from `before` + 1 on.

    For boxes, the centre is replaced by the left upper corner.
    """
    columns = COLUMNS[scene.state]
    covariance = None
    if states.shape[2] == len(columns) + 3:
        states, packed = states[..., :2], states[..., 2:]
        digits = 5 - math.floor(math.log10(tracker.noise or 1.0)) * 2
        covariance = np.round(packed, digits)[..., [[0, 1], [1, 2]]]
    if scene.state == "box":
        size = np.maximum(states[..., 2:], scene.area / 100)  # noise must leave a positive size
        states = np.concatenate((states[..., :2] - size / 2, size), axis=-1)
    existing = np.flatnonzero(~np.isnan(states[..., 0]).all(axis=0))
    tracks = Trajectories.from_array(
        np.round(states[:, existing], decimals),
        columns,
        None if covariance is None else covariance[:, existing],
    )
    ids = np.array([str(before + 1 + k) for k in existing], dtype=object)
    return replace(tracks, ids=ids, times=np.arange(1, scene.steps + 1))


def _check_ranges(record: "Scene | Tracker", ranges: dict[str, tuple[float, float]]) -> None:
    """Check that the fields in `ranges` are real numbers within their limits."""
    for name, (minimum, maximum) in ranges.items():
        value = real_number(option(name), getattr(record, name))
        if not minimum <= value <= maximum:
            raise ConfigError(
                f"{option(name)} is {value:g}: must be from {minimum:g} to {maximum:g}"
            )
