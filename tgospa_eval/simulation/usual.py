"""``simulate`` of Python: the scene that the command makes of the same settings."""

from dataclasses import fields
from typing import Any

import numpy as np

from tgospa_eval.errors import ConfigError
from tgospa_eval.simulation import Scene, Tracker
from tgospa_eval.simulation import simulate as simulate_scene
from tgospa_eval.tracks.trajectories import Trajectories

USUAL_ERRORS = {"detection": 0.95, "swaps": 0.25, "fragmentation": 0.01, "false_rate": 0.02}
"""Errors of a tracker that nobody chose; noise and near depend on the area."""


def usual_tracker(area: float, errors: dict[str, Any]) -> Tracker:
    """A tracker with these errors, the others as usual in a square of this side.

    Raises
    ------
    ConfigError
        There is no such error, or its value has no meaning.
    """
    names = [field.name for field in fields(Tracker)]
    for name in errors:
        if name not in names:
            raise ConfigError(f"no error of a tracker {name!r}; there are {', '.join(names)}")
    return Tracker(**{"noise": area / 200, "near": area / 20} | USUAL_ERRORS | errors)


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
    """A ground truth and a tracker's estimate of it, as ``tgospa-eval simulate`` makes them.

    Parameters
    ----------
    scenario : str
        What the targets do: ``"crossing"``, ``"parallel"``, ``"convoy"``, ``"dense"``,
        ``"births"``, ``"manoeuvring"``.
    targets, steps, area, state, particles
        As of `tgospa_eval.simulation.Scene`.
    seed : int
        The same one makes the same scene.
    **errors
        Of the tracker, as of `tgospa_eval.simulation.Tracker`: ``noise``, ``detection``, ``swaps``
        ... What is not given is that of the command.

    Returns
    -------
    tuple of Trajectories
        Truth and estimate.

    Raises
    ------
    ConfigError
        A value has no meaning.
    """
    scene = Scene(
        scenario=scenario, targets=targets, steps=steps, area=area, state=state, particles=particles
    )
    return simulate_scene(scene, usual_tracker(scene.area, errors), np.random.default_rng(seed))
