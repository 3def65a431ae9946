"""Request of an evaluation, from a command line, a suite, or Python."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.metric_family import Parameters, needs_symmetry
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.consistency import NEES
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.conversion import MAX_STEPS, SECOND, TIME_UNITS, Conversion, Duration
from tgospa_eval.tracks.trajectories import TimeArray

if TYPE_CHECKING:
    from tgospa_eval.evaluation.ignoring import Ignoring
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.tracks.weights import WeightsByTime


@dataclass(frozen=True, kw_only=True)
class Sliding:
    """Sliding windows of length `size`; the next window always begins `every` later.

    The first window begins at the first step.

    Parameters
    ----------
    size : int or Duration
        Length of each window, more than 0, in steps or as a time.
    every : int or Duration
        Spacing of windows, more than 0 and at most `size`, so that each step is in a window.

    Raises
    ------
    ConfigError
        A length is out of its range, or one length is in steps and the other is a time.
    """

    size: int | Duration
    every: int | Duration

    def __post_init__(self) -> None:
        if isinstance(self.size, Duration) != isinstance(self.every, Duration):
            raise ConfigError(
                f"window is {in_words(self.size)} and every is {in_words(self.every)}: give both "
                "in steps, or both as times"
            )
        if self.every > self.size:
            raise ConfigError(
                f"every is {in_words(self.every)}: must be at most the {in_words(self.size)} of a "
                "window, or some steps would be in no window"
            )

    @classmethod
    def of_options(cls, window: int | str | None, every: int | str | None) -> "Sliding | None":
        """Return the windows that two options request, or None if `window` is None.

        By default, `every` is half of `window`.

        Raises
        ------
        ConfigError
            `every` is given without a window, or a length is out of its range.
        """
        if window is None:
            if every is not None:
                raise ConfigError("every needs window, the length of a window")
            return None
        size = _length(window, "window")
        if every is not None:
            return cls(size=size, every=_length(every, "every"))
        if not isinstance(size, Duration):
            return cls(size=size, every=max(size // 2, 1))
        half = float(size) * SECOND / TIME_UNITS[size.unit] / 2
        return cls(size=size, every=_length(f"{half:.15g}{size.unit}", "every"))

    def check(self, clock: str) -> None:
        """Check that the unit of the timestamps is known, if the lengths are times.

        `clock` is the kind of the timestamps.

        Raises
        ------
        ConfigError
            The lengths are times, but the timestamps are plain numbers.
        """
        for value, name in ((self.size, option("window")), (self.every, option("every"))):
            if isinstance(value, Duration):
                value.check(clock, name, "give a number of steps")

    def shown(self, steps: int) -> str:
        """Format the length of a window; a length in steps is limited to `steps`, all steps."""
        return in_words(self.size if isinstance(self.size, Duration) else min(self.size, steps))

    def spans(self, times: TimeArray) -> tuple[Ints, Ints]:
        """Return the first steps and the last steps of K windows, (K,) each.

        `times` are the times of all steps. If the last regular window ends before the last step,
        one more window ends at the last step. So all windows have the same length, and each step is
        in a window. Windows without a step are left out.

        Raises
        ------
        ConfigError
            The number of windows is too large.
        """
        if isinstance(self.size, Duration) and isinstance(self.every, Duration):
            return _spans_of_time(times, self.size, self.every)
        steps = len(times)
        size = min(int(self.size), steps)
        every = min(int(self.every), size)  # a huge number would overflow in NumPy
        first = np.arange(0, steps - size + 1, every) if steps else np.zeros(0, np.int64)
        if len(first) and first[-1] + size < steps:
            first = np.append(first, steps - size)
        return first, first + size - 1


def in_words(length: int | Duration) -> str:
    """Format the length of a window, such as "30 steps" or "2min"."""
    return length.text if isinstance(length, Duration) else counted(length, "step")


def _length(given: object, name: str) -> int | Duration:
    """Parse a length in steps, or a time with a unit."""
    if isinstance(given, str) and re.fullmatch(r"\s*[0-9]{1,99}\s*", given):
        given = int(given)
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if given >= 1:
            return int(given)
    elif isinstance(given, str):
        duration = Duration.of(given, name)
        if duration.unit and duration.nanoseconds >= 1:
            return duration
    shown = quoted(given) if isinstance(given, str) else repr(given)
    raise ConfigError(
        f"{name} is {shown}: must be a whole number of steps, 1 or more, or a time with a unit, "
        "such as 30min"
    )


def _spans_of_time(times: TimeArray, size: Duration, every: Duration) -> tuple[Ints, Ints]:
    """Return the first and the last steps of windows that are spans of time.

    A window that begins at a time t has the steps before t + `size`. The last window ends at the
    last step. A window is left out if it has no step, or the same steps as the window before.
    """
    if not len(times):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    begin, end = int(times[0]), int(times[-1])
    length = min(size.nanoseconds, end - begin + 1)  # a huge number would overflow in NumPy
    spacing = min(every.nanoseconds, length)
    count = max((end - length - begin) // spacing + 1, 0)
    if count > MAX_STEPS:
        raise ConfigError(
            f"{option('every', every.text)}: makes {count:,} windows, more than {MAX_STEPS:,}"
        )
    opens = np.append(begin + spacing * np.arange(count, dtype=np.int64), end - length + 1)
    first = np.searchsorted(times, opens)
    last = np.searchsorted(times, opens + length) - 1
    other = (np.diff(first, prepend=-1) != 0) | (np.diff(last, prepend=-1) != 0)
    kept = (first <= last) & other
    return first[kept], last[kept]


MOT_METRICS = ("hota", "clear", "identity")
OTHER_METRICS = (*MOT_METRICS, "gospa", NEES)
"""Metrics that can be evaluated in addition to TGOSPA, in the order of display."""


@dataclass(frozen=True, kw_only=True)
class EvaluationRequest:
    """Resolved options that change the number, its bracket, or further results.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order and switch penalty.
    distance : Distance
        Base distance.
    solver : Solver
        Solver with its settings.
    time_matching : TimeMatching
        Rules that decide which timestamps are one step, and which steps count.
    unit : str, optional
        Unit of the states, for display.
    curve : bool
        Whether the cost of the steps 1 to k is evaluated too, for each k.
    sliding : Sliding, optional
        Sliding windows to evaluate as well.
    with_ : sequence of str
        Other metrics: names from `OTHER_METRICS`, except NEES.
    nees : bool
        Whether NEES is requested. Without a request, it is computed only if the distance compares
        covariances or particles.
    recorded : mapping of str to object
        Further options that change the number, as the result records them in ``parameters``.
    defaults : sequence of str
        Parameters that have their default value: names among cutoff and switch_penalty.
    slices : sequence of SliceBy
        Attributes by which costs are split.
    step_weights : WeightsByTime, optional
        Weight of each step; all steps have the same weight by default.
    existence : {"ignore", "use"}
        Whether probabilities of existence count.
    ignoring : Ignoring, optional
        Rules for states that are not evaluated.
    conversion : Conversion
        Conversion of the timestamps and states of the estimate, from its file to the comparison.
        A change of the frame of coordinates is not included.
    memory : int, optional
        Largest memory of the process in bytes, until the problem is solved.

    Raises
    ------
    ConfigError
        `existence` has another value, or the solver cannot make the requested curve or windows.
        Or probabilities of existence count, but a missed and a false target cost differently.
    """

    parameters: Parameters
    distance: Distance
    solver: Solver
    time_matching: TimeMatching = field(default_factory=TimeMatching)
    unit: str | None = None
    curve: bool = False
    sliding: Sliding | None = None
    with_: Sequence[str] = ()
    nees: bool = False
    recorded: Mapping[str, object] = field(default_factory=dict)
    defaults: Sequence[str] = ()
    slices: "Sequence[SliceBy]" = ()
    step_weights: "WeightsByTime | None" = None
    existence: str = "ignore"
    ignoring: "Ignoring | None" = None
    conversion: Conversion = field(default_factory=Conversion)
    memory: int | None = None

    def __post_init__(self) -> None:
        if self.existence not in ("ignore", "use"):
            raise ConfigError(
                f"{option('existence')} {quoted(self.existence)}: must be ignore or use"
            )
        if self.probabilistic and self.parameters.rho != 0.5:
            raise ConfigError(needs_symmetry())
        for of_options, what in ((self.curve, "the curve needs"), (self.sliding, "windows need")):
            if of_options and not self.solver.proves:
                raise ConfigError(f"{what} the solver certified, not {self.solver.name}")

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of states, besides points, that the evaluation needs.

        These are the kinds that the distance compares. If the distance compares only points, but
        NEES is requested, all kinds are needed.
        """
        return self.distance.kinds or (("gaussian", "cloud") if self.nees else ())

    @property
    def probabilistic(self) -> bool:
        """True if probabilities of existence count."""
        return self.existence == "use"


def chosen_parameters(
    distance: Distance,
    order: float,
    cutoff: float | None,
    switch_penalty: float | None,
    rho: float = 0.5,
) -> tuple[Parameters, tuple[str, ...]]:
    """Return the parameters, and the names of those that have their default value.

    A cutoff or switch penalty of None is replaced by the default of the distance.

    Raises
    ------
    ConfigError
        A parameter is out of range.
    """
    given = {"cutoff": cutoff, "switch_penalty": switch_penalty}
    defaults = dict(zip(given, distance.defaults, strict=True))
    values = {name: defaults[name] if value is None else value for name, value in given.items()}
    unchosen = tuple(name for name, value in given.items() if value is None)
    return Parameters(order=order, rho=rho, **values), unchosen


NUMBERS_OF = {"mota": "clear", "motp": "clear", "idf1": "identity"}
"""Numbers that a user can request by name, and the metric that computes each of them."""


def chosen_metrics(names: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the requested metrics, in the order of display.

    `names` are the requested names, or a text in which commas separate them. A name in `NUMBERS_OF`
    is replaced by that of its metric.

    Raises
    ------
    ConfigError
        A name is not the name of a metric.
    """
    chosen = [part.strip() for part in names.split(",")] if isinstance(names, str) else list(names)
    chosen = [NUMBERS_OF.get(name, name) for name in chosen]
    for name in chosen:
        if name not in OTHER_METRICS:
            raise ConfigError(
                f"{option('with_')} {quoted(name)}: must be of {', '.join(OTHER_METRICS)}"
            )
    return tuple(name for name in OTHER_METRICS if name in chosen)
