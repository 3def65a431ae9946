"""Ids and states of both sides, frame by frame, from the loop of a program."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.api.evaluate import evaluate
from tgospa_eval.common.arrays import Floats
from tgospa_eval.distances import as_distance
from tgospa_eval.errors import InputError
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.objects import array_of, from_rows, numbers_of, times_of
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from typing import Unpack

    from tgospa_eval.api.option_types import RecorderOptions
    from tgospa_eval.api.result import Result
    from tgospa_eval.formats.objects import ArrayLike


class Recorder:
    """Keeps what a loop has at each frame, and evaluates it at the end, or in between.

    An update takes time in proportion to its own objects, however many came before.

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
        self._frames: dict[str, list[tuple[list[str], Floats]]] = {name: [] for name in ROLES}

    def __repr__(self) -> str:
        return f"Recorder({len(self._times)} updates)"

    def __len__(self) -> int:
        return len(self._times)

    def update(
        self,
        t: Any,
        truth_ids: "Sequence[object] | ArrayLike",
        truth: "Sequence[Sequence[float]] | ArrayLike",
        estimate_ids: "Sequence[object] | ArrayLike",
        estimate: "Sequence[Sequence[float]] | ArrayLike",
    ) -> None:
        """Keep one frame.

        Parameters
        ----------
        t : number, datetime or ISO text
            Its time, later than that of the update before.
        truth_ids, estimate_ids : sequence of m, of n ids
            Texts or numbers, each at most once.
        truth, estimate : (m, d), (n, d) array or tensor
            States in the order of the ids; they are copied. NaN means absent.

        Raises
        ------
        InputError
            An id is there twice, the time does not increase, there are more or fewer ids than
            states, or states have other numbers of components than before. Nothing is kept then.
        """
        t = t.item() if hasattr(t, "item") and hasattr(t, "__array__") else t  # of a tensor
        where = f"update at t = {t}"
        self._check_time(t, where)
        size = self._size
        found = []
        given = (truth_ids, truth), (estimate_ids, estimate)
        for name, (ids, states) in zip(ROLES, given, strict=True):
            names, array = _frame(ids, states, f"{where}, {name}")
            if array.shape[1]:
                size = size or (array.shape[1], f"{name} at t = {t}")
                if array.shape[1] != size[0]:
                    raise InputError(
                        f"{where}, {name}: states of {array.shape[1]} components, those of "
                        f"{size[1]} have {size[0]}"
                    )
            found.append((names, array))
        self._times.append(t)
        self._size = size
        for frames, frame in zip(self._frames.values(), found, strict=True):
            frames.append(frame)

    def _check_time(self, t: Any, where: str) -> None:
        if t is None or np.ndim(t) or t != t:
            raise InputError(f"{where}: no time; give a number or a datetime")
        for last in self._times[-1:]:
            try:
                later = bool(t > last)
            except (TypeError, ValueError):
                raise InputError(
                    f"{where}: {type(t).__name__} after {type(last).__name__} ({last}); all times "
                    "are of one kind"
                ) from None
            if not later:
                again = "is there already" if t == last else "time goes back"
                raise InputError(f"{where}: {again}, the update before was at {last}")

    @property
    def truth(self) -> Trajectories:
        """The truth up to now."""
        return self._trajectories("truth", None)

    @property
    def estimate(self) -> Trajectories:
        """The estimate up to now."""
        return self._trajectories("estimate", None)

    def evaluate(self, **options: "Unpack[RecorderOptions]") -> "Result":
        """TGOSPA of what was kept.

        Parameters
        ----------
        **options
            As for `tgospa_eval.evaluate`: ``cutoff``, ``order``, ``switch_penalty`` ...

        Returns
        -------
        Result
            As of `tgospa_eval.evaluate`.

        Raises
        ------
        ConfigError, InputError
            As for `tgospa_eval.evaluate`.
        """
        columns = as_distance(options.get("distance")).columns
        truth, estimate = (self._trajectories(name, columns) for name in ROLES)
        return evaluate(truth, estimate, **options)

    def _trajectories(self, name: str, columns: tuple[str, ...] | None) -> Trajectories:
        frames, size = self._frames[name], 2 if self._size is None else self._size[0]
        ids: dict[str, int] = {}
        track = [ids.setdefault(text, len(ids)) for names, _ in frames for text in names]
        step = [k for k, (names, _) in enumerate(frames) for _ in names]
        states = [array for names, array in frames if names]
        return from_rows(
            name,
            list(ids),
            (np.array(step, np.int64), np.array(track, np.int64)),
            np.concatenate([np.zeros((0, size)), *states]),
            times_of(self._times, name),
            columns,
        )


def _frame(ids: object, states: object, where: str) -> tuple[list[str], Floats]:
    """Ids as texts, and a copy of the states (n, d); d = 0 if there are none."""
    from tgospa_eval.formats.frames import id_text  # lazy: as pandas

    listed = ids if isinstance(ids, (list, tuple)) else array_of(ids, f"{where}, ids").tolist()
    if not isinstance(listed, (list, tuple)):
        raise InputError(f"{where}: ids are of the type {type(ids).__name__}; must be a sequence")
    names = [id_text(value, where) for value in listed]
    if len(set(names)) < len(names):
        twice = next(text for k, text in enumerate(names) if text in names[:k])
        raise InputError(f"{where}: id {quoted(twice)} is there twice")
    array = np.array(numbers_of(array_of(states, where), where))
    if not array.size and not names:
        return names, np.zeros((0, 0))
    if array.ndim != 2 or len(array) != len(names) or not array.shape[1]:
        raise InputError(
            f"{where}: {len(names)} ids and states of shape {array.shape}; must be (n, d) with a "
            "row for each id"
        )
    if np.isinf(array).any():
        raise InputError(f"{where}: infinite state; NaN means absent")
    return names, array
