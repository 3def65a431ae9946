"""``Recorder``: a program passes truth and estimate frame by frame, and evaluates them."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tgospa_eval.api.evaluate import evaluate
from tgospa_eval.common.arrays import Floats
from tgospa_eval.distances import as_distance
from tgospa_eval.errors import InputError
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.objects import array_of, from_rows, numbers_of, times_of
from tgospa_eval.quoting import quoted
from tgospa_eval.tracks.clouds import Cloud, Clouds
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from typing import Unpack

    from tgospa_eval.api.option_types import RecorderOptions
    from tgospa_eval.api.result import Result
    from tgospa_eval.formats.objects import ArrayLike

    States: TypeAlias = "Sequence[Sequence[float]] | Sequence[ArrayLike] | ArrayLike"


Frame: TypeAlias = "tuple[list[str], Floats, Floats | Clouds | None]"
"""One side of a frame, truth or estimate: ids; states; covariances, particles or None."""

PARTICLES = 3
"""Number of axes of an array of particles (n, N, d): n objects with N particles of d columns."""


class Recorder:
    """Recorder that collects truth and estimate frame by frame, and evaluates them at any time.

    A frame is truth and estimate at one time. The time that `update` takes to add a frame does not
    depend on the number of earlier frames.

    Examples
    --------
    >>> recorder = Recorder()
    >>> for t, position in enumerate([[0.0, 0.0], [1.0, 0.0]]):
    ...     recorder.update(t, ["a"], [position], [7], [position])
    >>> recorder.evaluate(cutoff=10.0, switch_penalty=5.0).total
    0.0
    """

    def __init__(self) -> None:
        self._times: list[Any] = []
        self._size: tuple[int, str] | None = None
        self._kinds: dict[str, str] = {}
        self._frames: dict[str, list[Frame]] = {name: [] for name in ROLES}

    def __repr__(self) -> str:
        return f"Recorder({len(self._times)} updates)"

    def __len__(self) -> int:
        return len(self._times)

    def update(
        self,
        t: Any,
        truth_ids: "Sequence[object] | ArrayLike",
        truth: "States",
        estimate_ids: "Sequence[object] | ArrayLike",
        estimate: "States",
        *,
        truth_covariances: "ArrayLike | None" = None,
        estimate_covariances: "ArrayLike | None" = None,
        truth_weights: "States | None" = None,
        estimate_weights: "States | None" = None,
    ) -> None:
        """Add one frame.

        Parameters
        ----------
        t : number, datetime or ISO text
            Time of the frame. It must be later than the time of the frame before.
        truth_ids, estimate_ids : sequence
            Ids of the n true objects, or of the n tracks: texts or numbers, without duplicates.
        truth, estimate : (n, d) array or tensor
            States with d columns, in the order of the ids; they are copied. NaN means that the
            object is absent. For particles, give an array (N, d) of N particles for each id. N can
            differ between ids.
        truth_covariances, estimate_covariances : (n, d, d) array, optional
            Covariances of the states.
        truth_weights, estimate_weights : (n, N) array, optional
            Weights of the particles. They need not sum to 1; by default they are equal.

        Raises
        ------
        InputError
            The frame is wrong, and is not added. Examples:

            - an id is a duplicate, or the time does not increase
            - there are not as many states, covariances or weights as ids
            - states have another number of components than before
            - states are of another kind than before (points, Gaussians, particles)
        """
        t = t.item() if hasattr(t, "item") and hasattr(t, "__array__") else t  # array or tensor
        where = f"update at t = {t}"
        self._check_time(t, where)
        size = self._size
        sides = []
        given = (
            (truth_ids, truth, truth_covariances, truth_weights),
            (estimate_ids, estimate, estimate_covariances, estimate_weights),
        )
        for name, side in zip(ROLES, given, strict=True):
            names, array, spread = _frame(*side, f"{where}, {name}")
            kind, before = _kind(spread), self._kinds.get(name)
            if names and before not in (None, kind):
                raise InputError(
                    f"{where}, {name}: {kind}, but {before} in earlier updates; all must be of one "
                    "kind"
                )
            if array.shape[1]:
                size = size or (array.shape[1], f"{name} at t = {t}")
                if array.shape[1] != size[0]:
                    raise InputError(
                        f"{where}, {name}: states have {array.shape[1]} components, but those of "
                        f"{size[1]} have {size[0]}"
                    )
            sides.append((names, array, spread))
        self._times.append(t)
        self._size = size
        self._kinds |= {
            name: _kind(spread) for name, (ids, _, spread) in zip(ROLES, sides, strict=True) if ids
        }
        for frames, frame in zip(self._frames.values(), sides, strict=True):
            frames.append(frame)

    def _check_time(self, t: Any, where: str) -> None:
        if t is None or np.ndim(t) or t != t:
            raise InputError(f"{where}: no time; give a number or a datetime")
        for last in self._times[-1:]:
            try:
                later = bool(t > last)
            except (TypeError, ValueError):
                raise InputError(
                    f"{where}: the time has the type {type(t).__name__}, but the previous one "
                    f"({last}) has {type(last).__name__}; all times must have one type"
                ) from None
            if not later:
                again = "this time was already given" if t == last else "time goes back"
                raise InputError(f"{where}: {again}; the previous update was at {last}")

    @property
    def truth(self) -> Trajectories:
        """The truth of all frames up to now."""
        return self._trajectories("truth", None)

    @property
    def estimate(self) -> Trajectories:
        """The estimate of all frames up to now."""
        return self._trajectories("estimate", None)

    def evaluate(self, **options: "Unpack[RecorderOptions]") -> "Result":
        """Compute TGOSPA of the recorded frames.

        Parameters
        ----------
        **options
            Options of `tgospa_eval.evaluate`: ``cutoff``, ``order``, ``switch_penalty`` ...

        Returns
        -------
        Result
            Result of `tgospa_eval.evaluate`.

        Raises
        ------
        ConfigError, InputError
            An option or the recorded data are wrong, as for `tgospa_eval.evaluate`.
        """
        columns = as_distance(options.get("distance")).columns
        truth, estimate = (self._trajectories(name, columns) for name in ROLES)
        return evaluate(truth, estimate, **options)

    def _trajectories(self, name: str, columns: tuple[str, ...] | None) -> Trajectories:
        frames, size = self._frames[name], 2 if self._size is None else self._size[0]
        ids: dict[str, int] = {}
        there = [frame for frame in frames if frame[0]]
        track = [ids.setdefault(text, len(ids)) for names, *_ in there for text in names]
        step = [k for k, (names, *_) in enumerate(frames) for _ in names]
        states = [array for _, array, _ in there]
        covariances = [spread for *_, spread in there if isinstance(spread, np.ndarray)]
        clouds = [spread for *_, spread in there if isinstance(spread, Clouds)]
        return from_rows(
            name,
            list(ids),
            (np.array(step, np.int64), np.array(track, np.int64)),
            np.concatenate([np.zeros((0, size)), *states]),
            times_of(self._times, name),
            columns,
            np.concatenate(covariances) if covariances else None,
            _clouds(own[k] for own in clouds for k in range(len(own))) if clouds else None,
        )


def _kind(spread: object) -> str:
    return {type(None): "points", Clouds: "particles"}.get(type(spread), "states with covariances")


def _clouds(clouds: Iterable[Cloud]) -> Clouds:
    """Join the particles of one or more objects."""
    points, weights = zip(*clouds, strict=True)
    first = np.cumsum([0, *map(len, points)])
    return Clouds(points=np.concatenate(points), weights=np.concatenate(weights), first=first)


def _frame(ids: object, states: Any, covariances: object, weights: Any, where: str) -> Frame:
    """Return ids as texts, a copy of the states (n, d), and their covariances or particles.

    Messages begin with `where`. Without ids and states, d is 0.
    """
    from tgospa_eval.formats.frames import id_text  # lazy: imports pandas

    listed = ids if isinstance(ids, (list, tuple)) else array_of(ids, f"{where}, ids").tolist()
    if not isinstance(listed, (list, tuple)):
        raise InputError(f"{where}: ids are of the type {type(ids).__name__}; must be a sequence")
    names = [id_text(value, where) for value in listed]
    if len(set(names)) < len(names):
        twice = next(text for k, text in enumerate(names) if text in names[:k])
        raise InputError(f"{where}: id {quoted(twice)} is a duplicate")
    if names and hasattr(states, "__len__") and len(states) == len(names):
        first = states if hasattr(states, "__array__") else [array_of(states[0], where)]
        if np.ndim(first) == PARTICLES:
            if covariances is not None:
                raise InputError(f"{where}: give particles or covariances, not both")
            clouds = _particles(states, weights, where)
            return names, clouds.means, clouds
    if weights is not None and names:
        raise InputError(
            f"{where}: weights are only for particles, which are an array (N, d) for each id"
        )
    array = np.array(numbers_of(array_of(states, where), where))
    if not array.size and not names:
        return names, np.zeros((0, 0)), None
    if array.ndim != 2 or len(array) != len(names) or not array.shape[1]:
        raise InputError(
            f"{where}: states of shape {array.shape} for {len(names)} ids; the shape must be "
            "(n, d), with a row for each id"
        )
    if np.isinf(array).any():
        raise InputError(f"{where}: infinite state; NaN means absent")
    if covariances is None:
        return names, array, None
    spread = np.array(numbers_of(array_of(covariances, where), where))
    if spread.shape != (*array.shape, array.shape[1]):
        raise InputError(
            f"{where}: covariances of shape {spread.shape}; for states of shape {array.shape} it "
            f"must be {(*array.shape, array.shape[1])}"
        )
    return names, array, spread


def _particles(states: Any, weights: Any, where: str) -> Clouds:
    """Return the particles of each object. Their weights are scaled to the sum 1."""
    clouds = []
    for k, each in enumerate(states):
        points = np.array(numbers_of(array_of(each, where), where))
        own = np.ones(points.shape[:1]) if weights is None else numbers_of(weights[k], where)
        if not (own >= 0).all():
            raise InputError(f"{where}: weights of particles must be at least 0")
        if points.ndim != PARTICLES - 1 or own.shape != points.shape[:1] or not own.sum() > 0:
            raise InputError(
                f"{where}: particles of shape {points.shape} and weights {own.shape}; must be "
                "(N, d) and (N,), with weights that are not all 0"
            )
        clouds.append((points, own / own.sum()))
    try:
        return _clouds(clouds)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except ValueError:
        raise InputError(f"{where}: particles have different numbers of components") from None
