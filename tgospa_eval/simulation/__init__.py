"""Synthetic scenes: a ground truth by name, and the tracks of a tracker with known errors."""

import math
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import LARGEST_COUNT, ConfigError, real_number, whole_number
from tgospa_eval.simulation import tracker as errors
from tgospa_eval.simulation.scenarios import SCENARIOS, encounters
from tgospa_eval.simulation.tracker import particle_clouds
from tgospa_eval.text import option, quoted
from tgospa_eval.tracks.trajectories import Trajectories

COLUMNS = {
    "point": ("x", "y"),
    "gaussian": ("x", "y"),
    "cloud": ("x", "y"),
    "box": ("left", "top", "width", "height"),
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The ground truth to make.

    Parameters
    ----------
    scenario : str
        A name of `tgospa_eval.simulation.SCENARIOS`.
    targets, steps : int
        How many; at least 0 and 1.
    area : float
        Side A of the square [0, A]^2, in state units; from 1e-6 to 1e12.
    state : {"point", "gaussian", "cloud", "box"}
        ``x, y``; the same with the covariance of its error for each estimate; points in the truth,
        and every report a cloud of particles around the point that it would be, as wide as the
        noise; or ``left, top, width, height`` of a box around that point; its height is uniform in
        [A/20, A/8] and constant, its width 0.4 of that.
    particles : int
        Of a cloud; at least 1.

    Raises
    ------
    ConfigError
        A value is none of these.
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
"""Limits of errors that are real numbers."""


@dataclass(frozen=True, kw_only=True)
class Tracker:
    """The errors of a tracker; one without any by default.

    Parameters
    ----------
    noise : float
        Standard deviation of each coordinate, in state units; of Gaussians the scale of their
        errors (`tgospa_eval.simulation.tracker.add_noise_of_a_radar`).
    detection : float
        Probability that a target is reported at a step.
    confirmation : int
        Steps after its birth at which a target is not reported yet.
    merges : float
        Probability that two targets are one track for as long as they are near.
    swaps : float
        Probability that two near targets exchange their tracks where they are closest.
    near : float
        Distance below which two targets are near, in state units.
    fragmentation : float
        Probability, for every step, that a track is lost.
    lost : int
        Steps until it is found again, under a new number.
    latency : int
        Steps by which every report is late.
    false_rate : float
        Mean number of false tracks that begin at a step.
    false_length : (int, int)
        Their lengths in steps: least and most, each as likely as any between.

    Raises
    ------
    ConfigError
        A value has no meaning.
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
                f"false-length is {self.false_length!r}: must be two numbers, least and most"
            ) from None
        for length in (shortest, longest):
            whole_number("false-length", length, 1, LARGEST_COUNT)
        if shortest > longest:
            raise ConfigError(f"false-length is {shortest}:{longest}: the least comes first")


def simulate(
    scene: Scene, tracker: Tracker, rng: np.random.Generator
) -> tuple[Trajectories, Trajectories]:
    """Make a scene and the tracks that the tracker reports.

    Times count from 1, ids of truths too; the track that begins on truth i is number 100 + i
    (1000 + i from 100 targets on, and so on), later tracks follow. Values are rounded to about a
    hundred-thousandth of the area, or of 200 times the noise if that is less: machines whose sines
    differ in the last digit still make the same files.

    Every error has a stream of random numbers of its own: changing one leaves the draws of the
    others as they are.

    Parameters
    ----------
    scene : Scene
        The ground truth to make.
    tracker : Tracker
        The errors of the tracker.
    rng : numpy.random.Generator
        The same state gives the same result.

    Returns
    -------
    truth, estimate : Trajectories
        On the same times.
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
    """Return tracks that the tracker reports of the targets."""
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
    """Turn centres (T, k, 2) into boxes (T, k, 4) as centre and size."""
    height = rng.uniform(area / 20, area / 8, centres.shape[1])
    size = np.stack((0.4 * height, height), axis=-1)
    return np.concatenate((centres, np.where(np.isnan(centres), np.nan, size)), axis=-1)


def _trajectories(
    states: Floats, scene: Scene, tracker: Tracker, decimals: int, before: int
) -> Trajectories:
    """Round and name trajectories; boxes go from centre and size to corner and size."""
    columns = COLUMNS[scene.state]
    covariance = None
    if states.shape[2] == len(columns) + 3:
        states, packed = states[..., :2], states[..., 2:]
        digits = 5 - math.floor(math.log10(tracker.noise or 1.0)) * 2
        covariance = np.round(packed, digits)[..., [[0, 1], [1, 2]]]
    if scene.state == "box":
        size = np.maximum(states[..., 2:], scene.area / 100)  # a box keeps a size in spite of noise
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
    """Check that these fields are real numbers within their limits."""
    for name, (minimum, maximum) in ranges.items():
        value = real_number(option(name), getattr(record, name))
        if not minimum <= value <= maximum:
            raise ConfigError(
                f"{option(name)} is {value:g}: must be from {minimum:g} to {maximum:g}"
            )
