"""Which side is interpolated at the stamps of the other, and along which way angles go."""

from dataclasses import replace

from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.interpolation import Interpolated, interpolated
from tgospa_eval.tracks.trajectories import Trajectories

TURN = 360.0
"""Degrees of longitude."""


def periods_of(distance: Distance, columns: tuple[str, ...]) -> dict[str, float]:
    """Periods of the state columns that wrap around."""
    periods = dict(distance.settings(columns).get("periodic", {}))
    if distance.name == "haversine":
        periods["lon"] = TURN
    return periods


def interpolate(
    sides: tuple[Trajectories, Trajectories],
    matching: TimeMatching,
    distance: Distance,
    names: tuple[str, str],
) -> tuple[tuple[Trajectories, Trajectories], Interpolated]:
    """Both sides, the one that is asked for at the stamps of the other, and what that took.

    Raises
    ------
    ConfigError, InputError
        See `tracks.interpolation.interpolated`.
    """
    which = ("truth", "estimate").index(str(matching.interpolate))
    made = interpolated(
        sides[which].seen_as(distance.kinds),
        sides[1 - which],
        max_gap=float(matching.max_gap or 0),
        tolerance=matching.tolerance,
        periods=periods_of(distance, sides[0].columns),
        names=(names[which], names[1 - which]),
    )
    return ((made.side, sides[1]) if which == 0 else (sides[0], made.side)), made


def as_interpolated(request: EvaluationRequest) -> EvaluationRequest:
    """The same of sides that were interpolated before."""
    matching = replace(request.time_matching, interpolate=None, max_gap=None)
    return replace(request, time_matching=matching)
