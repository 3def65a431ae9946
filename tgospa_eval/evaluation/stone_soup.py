"""Tracks and ground-truth paths of Stone Soup, by their attributes, as Trajectories."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.objects import from_rows, numbers_of, times_of
from tgospa_eval.problem.problem import Floats
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from tgospa_eval.tracks.clouds import Cloud


class TrackLike(Protocol):
    """A track or a ground-truth path of Stone Soup.

    Its states have ``timestamp``, ``state_vector`` or ``mean``, and perhaps ``covar``.
    """

    @property
    def id(self) -> object:
        """What it is called."""

    @property
    def states(self) -> Sequence[Any]:
        """Its states, in order."""


Components: TypeAlias = "Sequence[int] | Sequence[Sequence[int]]"
"""Of state vectors those to compare; for both sides, or a pair of such."""


def of_tracks(
    tracks: Iterable[Any],
    name: str,
    columns: tuple[str, ...] | None,
    mapping: Sequence[int] | None,
    kinds: tuple[str, ...],
) -> Trajectories:
    """Tracks and ground-truth paths of Stone Soup, by their attributes.

    Of several states at one time the last counts, as of ``last_timestamp_generator`` there: an
    update after its prediction. What `kinds` names of ``"gaussian"`` and ``"cloud"`` is read:
    ``covar``, or the particles that are the columns of ``state_vector``, with their ``weight``.

    Raises
    ------
    ConfigError
        Components are not chosen, or not there.
    InputError
        A state has no time, or is not of numbers; an id is there twice.
    """
    ids, track, times, states, covariances, clouds = [], [], [], [], [], []
    for number, path in enumerate(tracks):
        ids.append(getattr(path, "id", number))
        where = f"{name}, track {quoted(ids[-1])}"
        if not isinstance(path.states, Iterable):
            raise InputError(f"{where}: states is of the type {type(path.states).__name__}")
        by_time = {getattr(state, "timestamp", None): state for state in path.states}
        for moment, state in by_time.items():
            if moment is None:
                raise InputError(f"{where}: a state without timestamp")
            vector = getattr(state, "mean", None)
            vector = getattr(state, "state_vector", None) if vector is None else vector
            if vector is None:
                raise InputError(f"{where}: a state without state_vector")
            chosen = _components(mapping, np.size(vector), name)
            track.append(number)
            times.append(moment)
            states.append(numbers_of(vector, where).ravel()[chosen])
            if "cloud" in kinds:
                clouds.append(_cloud(state, chosen, where))
            spread = getattr(state, "covar", None) if "gaussian" in kinds else None
            if spread is not None:
                covariances.append(numbers_of(spread, where)[np.ix_(chosen, chosen)])
    if covariances and len(covariances) < len(states):
        raise InputError(f"{name}: some states have a covariance and others not; all or none")
    spreads: Floats | list[Cloud] | None = np.array(covariances) if covariances else None
    if any(len(points) > 1 for points, _ in clouds):
        spreads = clouds
    size = len(states[0]) if states else len(mapping or (0,))
    return from_rows(
        name,
        ids,
        (np.arange(len(track)), np.array(track, np.int64)),
        np.array(states, np.float64).reshape(-1, size),
        times_of(times, name),
        columns,
        spreads,
    )


def _cloud(state: Any, chosen: list[int], where: str) -> "Cloud":
    """Particles of a state (N, d) and their weights; one where it is a point."""
    points = numbers_of(state.state_vector, where)
    points = points.reshape(len(points), -1)[chosen].T
    weights = getattr(state, "weight", None)
    if weights is None:
        return points, np.full(len(points), 1 / len(points))
    weights = numbers_of(weights, where).ravel()
    if len(weights) != len(points) or not (weights >= 0).all() or not weights.sum() > 0:
        raise InputError(
            f"{where}: {len(points)} particles and {len(weights)} weights; one for each, >= 0 and "
            "not all 0"
        )
    return points, weights / weights.sum()


def _components(mapping: Sequence[int] | None, size: int, name: str) -> list[int]:
    """Which components of state vectors of a size are compared."""
    if mapping is None:
        if size == 1:
            return [0]
        raise ConfigError(
            f"{name}: state vectors have {size} components, and do not say which are the position; "
            "choose those to compare, mapping=(0, 2) for x and y of (x, vx, y, vy)"
        )
    chosen = list(mapping)
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(size)):
        raise ConfigError(
            f"mapping is {tuple(mapping)}: must be different components of the state vectors of "
            f"{name}, from 0 to {size - 1}"
        )
    return chosen
