"""Settings of simulations in the literature, each named after its source.

Targets have nearly constant velocity. All targets meet at half time: their states at half time are
drawn near to each other. From half time, the motion is simulated forward and backward in time.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.simulation import Scene, Tracker
from tgospa_eval.simulation import simulate as simulate_scene
from tgospa_eval.tracks.trajectories import Trajectories

DECIMALS = 5
"""Number of decimals of positions. With so few decimals, all machines have the same positions."""


@dataclass(frozen=True, kw_only=True)
class StudySetting:
    """Settings of the simulation in a publication, and the parameters of its evaluation.

    Parameters
    ----------
    source : str
        Publication and code.
    cutoff, order, switch_penalty : float
        Parameters of the metric.
    alive : tuple of (int, int)
        First and last step of each target, from 1. The recording ends with the last target, and has
        an odd number of steps.
    centre : float
        Both coordinates of the point where the targets meet.
    spread : float
        Variance of positions and velocities at this point.
    motion : float
        Intensity q of the white acceleration. In a step of 1 s, position and velocity have random
        changes with the covariance q (1/3, 1/2; 1/2, 1) in each coordinate.
    noise : float
        Variance of each coordinate of a measurement.
    detection : float
        Probability that a target is measured at a step.
    clutter : float
        Mean number of false measurements at a step, uniform in the square.
    square : (float, float)
        Smallest and largest coordinate of false measurements.
    one_truth : bool
        Whether all runs of the source have the same truth.
    """

    source: str
    cutoff: float
    order: float
    switch_penalty: float
    alive: tuple[tuple[int, int], ...]
    centre: float
    spread: float
    motion: float
    noise: float
    detection: float
    clutter: float
    square: tuple[float, float]
    one_truth: bool

    @property
    def steps(self) -> int:
        """Number of steps of the recording."""
        return max(last for _, last in self.alive)


PUBLISHED = {
    "garcia-fernandez-2020": StudySetting(
        source="Garcia-Fernandez, Svensson, Williams, Xia, Granstrom, Trajectory Poisson "
        "multi-Bernoulli filters, IEEE Trans. Signal Processing 2020; code: "
        "github.com/Agarciafernandez/MTT, ScenarioWilliams15.m",
        cutoff=10,
        order=2,
        switch_penalty=1,
        alive=((1, 40), (1, 81), (1, 81), (1, 81)),
        centre=150,
        spread=0.1,
        motion=0.01,
        noise=1,
        detection=0.9,
        clutter=10,
        square=(0, 300),
        one_truth=True,
    ),
    "xia-2019": StudySetting(
        source="Xia, Granstrom, Svensson, Garcia-Fernandez, Williams, Multi-scan implementation of "
        "the trajectory Poisson multi-Bernoulli mixture filter, J. Advances in Information Fusion "
        "2019; code: github.com/yuhsuansia/Multi-scan-trajectory-PMBM-filter, gentruth.m, case 2",
        cutoff=10,
        order=2,
        switch_penalty=2,
        alive=((1, 51), (11, 61), (21, 71), (31, 81)),
        centre=0,
        spread=1e-6,
        motion=0.04,
        noise=0.04,
        detection=0.9,
        clutter=10,
        square=(-100, 100),
        one_truth=False,
    ),
}


def run_setting(
    setting: StudySetting, seed: int
) -> tuple[Trajectories, Trajectories, list[Floats]]:
    """Simulate one run; the truth depends on the seed only if `setting.one_truth` is False.

    The random numbers differ from those of the source.

    Returns
    -------
    truth : Trajectories
        Trajectories of the targets.
    estimate : Trajectories
        Measurements of each target as a separate track, without clutter and without errors of
        association.
    measurements : list of (M, 2) arrays
        Measurements at each step, of targets and false ones, shuffled.
    """
    truth_rng, rng = (
        np.random.default_rng(key) for key in (0 if setting.one_truth else [seed, 1], [seed, 2])
    )
    states = np.round(_paths(setting, truth_rng), DECIMALS)
    exists = ~np.isnan(states[..., 0])
    noisy = states + np.sqrt(setting.noise) * rng.standard_normal(states.shape)
    noisy[rng.random(exists.shape) >= setting.detection] = np.nan
    noisy = np.round(noisy, DECIMALS)
    measurements = []
    for step in noisy:
        false = rng.uniform(*setting.square, size=(rng.poisson(setting.clutter), 2))
        scan = np.concatenate((step[~np.isnan(step[:, 0])], np.round(false, DECIMALS)))
        measurements.append(rng.permutation(scan))
    return _named(states, 1), _named(noisy, 101), measurements


def _paths(setting: StudySetting, rng: np.random.Generator) -> Floats:
    """Return positions (T, m, 2), NaN where a target does not exist."""
    count, middle = len(setting.alive), (setting.steps + 1) // 2
    motion = np.array([[1.0, 1.0], [0.0, 1.0]])
    back = np.linalg.inv(motion)
    root = np.sqrt(setting.motion) * np.linalg.cholesky(np.array([[1 / 3, 1 / 2], [1 / 2, 1]]))

    def sample() -> Floats:
        """Return random changes of position and velocity of each target, (m, 2, 2)."""
        return np.asarray(rng.standard_normal((count, 2, 2)) @ root.T)

    start = np.sqrt(setting.spread) * rng.standard_normal((count, 2, 2))
    start[..., 0] += setting.centre
    forward, backward = [start], [start]
    for _ in range(setting.steps - middle):
        forward.append(forward[-1] @ motion.T + sample())
        backward.append((backward[-1] + sample()) @ back.T)
    states: Floats = np.array(backward[:0:-1] + forward)[..., 0]
    for target, (first, last) in enumerate(setting.alive):
        states[: first - 1, target] = states[last:, target] = np.nan
    return states


def _named(states: Floats, first: int) -> Trajectories:
    tracks = Trajectories.from_array(states)
    ids = np.array([str(first + k) for k in range(states.shape[1])], dtype=object)
    return replace(tracks, ids=ids, times=np.arange(1, len(states) + 1))


# -------------------------------------------------------------------------------------------------
# The function `simulate` makes the same scene as ``tgospa-eval simulate`` with the same settings.

DEFAULT_ERRORS = {"detection": 0.95, "swaps": 0.25, "fragmentation": 0.01, "false_rate": 0.02}
"""Default errors of a tracker; the defaults of `noise` and `near` depend on the area."""


def default_tracker(area: float, errors: dict[str, Any]) -> Tracker:
    """Return a tracker with these errors, and defaults for a square of this side.

    Raises
    ------
    ConfigError
        An error is unknown, or its value is out of its range.
    """
    names = [field.name for field in fields(Tracker)]
    for name in errors:
        if name not in names:
            raise ConfigError(f"{name!r} is not an error of a tracker; use {', '.join(names)}")
    return Tracker(**{"noise": area / 200, "near": area / 20} | DEFAULT_ERRORS | errors)


def simulate(
    scenario: str = "crossing",
    *,
    targets: int = 5,
    steps: int = 60,
    area: float = 200.0,
    state: str = "point",
    particles: int = 100,
    seed: int = 0,
    **errors: Any,
) -> tuple[Trajectories, Trajectories]:
    """Return a ground truth and a tracker's estimate of it, like ``tgospa-eval simulate``.

    Parameters
    ----------
    scenario : str
        Motion of the targets: ``"crossing"``, ``"parallel"``, ``"convoy"``, ``"dense"``,
        ``"births"``, ``"manoeuvring"``.
    targets, steps, area, state, particles
        Parameters of `tgospa_eval.simulation.Scene`.
    seed : int
        Seed of the random numbers; the same seed makes the same scene.
    **errors
        Errors of the tracker, by the names in `tgospa_eval.simulation.Tracker`: ``noise``,
        ``detection``, ``swaps`` ... Defaults are those of the command.

    Returns
    -------
    tuple of Trajectories
        Truth and estimate.

    Raises
    ------
    ConfigError
        A value is unknown or out of its range.
    """
    scene = Scene(
        scenario=scenario, targets=targets, steps=steps, area=area, state=state, particles=particles
    )
    return simulate_scene(scene, default_tracker(scene.area, errors), np.random.default_rng(seed))
