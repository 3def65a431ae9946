"""The estimate on the clock and in the unit of the truth, as arguments ask for."""

from dataclasses import replace

from tgospa_eval.distances import Distance
from tgospa_eval.distances.checks import check_columns, check_states
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Trajectories


def in_units_of_truth(
    sides: tuple[Trajectories, Trajectories],
    distance: Distance,
    time_offset: float,
    time_scale: float,
    unit_scale: float,
) -> tuple[tuple[Trajectories, Trajectories], dict[str, object]]:
    """Both sides, the estimate with other stamps and states, and what of that is recorded.

    Raises
    ------
    ConfigError
        A number is out of range, or not for such times or columns.
    InputError
        The two sides do not fit each other.
    """
    conversion = Conversion(time_offset=time_offset, time_scale=time_scale, unit_scale=unit_scale)
    if not conversion.recorded:
        return sides, {}
    truth, estimate = sides
    if conversion.unit_scale != 1:
        check_columns(truth, estimate, ("truth", "estimate"))
        check_states(truth, estimate, distance, ("truth", "estimate"))
        angles = tuple(distance.settings(truth.columns).get("periodic", ()))
        conversion = replace(conversion, angles=angles)
    return (truth, conversion(estimate, "estimate")), dict(conversion.recorded)
