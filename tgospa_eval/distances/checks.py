"""Whether two sides can be compared at all, and by a distance: columns, kinds of states, ranges."""

import numpy as np

from tgospa_eval.distances.base import Distance
from tgospa_eval.errors import InputError
from tgospa_eval.text import option, quoted
from tgospa_eval.tracks.trajectories import PLACES, Trajectories


def check_columns(
    truth: Trajectories, estimate: Trajectories, names: tuple[str, str] = ("truth", "estimate")
) -> None:
    """Both sides must have the same state columns.

    Raises
    ------
    InputError
        A state column is on one side only, or they are in another order.
    """
    for own, other, name, missing in ((truth, estimate, *names), (estimate, truth, *names[::-1])):
        extra = [column for column in own.columns if column not in other.columns]
        if extra:
            common = [column for column in own.columns if column in other.columns]
            remedy = f"choose what to compare with {option('columns', ','.join(common) or 'x,y')}"
            if {*PLACES} <= {*truth.columns} ^ {*estimate.columns}:
                local = "truth" if "lat" in estimate.columns else "estimate"
                remedy = (
                    f"{option(f'{local}_crs')} enu (or ned) and "
                    f"{option('origin', metavar='LAT,LON')} bring local axes and places on the "
                    "Earth together"
                )
            raise InputError(
                f"{name} has a column {quoted(extra[0])} that {missing} lacks; {remedy}"
            )
    if truth.columns != estimate.columns:
        orders = f"{names[0]} {','.join(truth.columns)}, {names[1]} {','.join(estimate.columns)}"
        raise InputError(f"state columns are in different orders: {orders}; take one order")


def check_states(
    truth: Trajectories,
    estimate: Trajectories,
    distance: Distance,
    names: tuple[str, str] = ("truth", "estimate"),
) -> None:
    """The distance must be able to compare the states of both sides.

    Raises
    ------
    ConfigError
        Its settings do not fit the state columns.
    InputError
        It needs other columns, does not compare states of that kind, or a state is out of range.
    """
    _check_kinds((truth, estimate), distance, names)
    for side, name in zip((truth, estimate), names, strict=True):
        distance.check_columns(side.columns, name)
        fault = distance.fault(side.state.T)
        if fault is not None:
            wrong, column, message = fault
            row = int(np.argmax(wrong))
            time = side.shown[side.step[row]]
            identity = side.ids[side.track[row]]
            raise InputError(f"{name}: at t = {time}, id {quoted(identity)}: {column} is {message}")


def _check_kinds(
    sides: tuple[Trajectories, Trajectories], distance: Distance, names: tuple[str, str]
) -> None:
    """Whether a distance that compares more than points does so with these states."""
    named = {side.kind: name for side, name in zip(sides[::-1], names[::-1], strict=True)}
    refused = set(named) - {"point", *distance.kinds}
    if not distance.kinds or not refused:
        return
    if {"gaussian", "cloud"} <= set(named):
        raise InputError(
            f"{named['gaussian']} has covariances, {named['cloud']} particles: the distance of a "
            "normal law from a cloud has no closed form; "
            f"{option('distance', 'gaussian-wasserstein')} {option('mixed', 'moments')} takes a "
            "cloud as the normal law of its mean and covariance"
        )
    if "cloud" in refused:
        raise InputError(
            f"{named['cloud']} has particles: clouds are no normal laws; take "
            f"{option('distance', 'cloud-wasserstein')}, or {option('mixed', 'moments')}, the "
            "normal law of their means and covariances"
        )
    raise InputError(
        f"{named['gaussian']} has covariances, not particles; take "
        f"{option('distance', 'gaussian-wasserstein')}, or leave the columns out to compare it as "
        "points"
    )
