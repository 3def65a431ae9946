"""What is asked of an evaluation, whoever asks: a command line, a suite, or Python."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from importlib.util import find_spec
from typing import TYPE_CHECKING

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import install
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.sliding import Sliding
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.problem.weighting import NEEDS_SYMMETRY
from tgospa_eval.solvers import Solver
from tgospa_eval.text import quoted
from tgospa_eval.tracks.alignment import TimeMatching

if TYPE_CHECKING:
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.tracks.step_weights import WeightsByTime

OF_TRACKEVAL = ("hota", "clear", "identity")
OTHER_METRICS = (*OF_TRACKEVAL, "gospa")
"""What can be evaluated beside TGOSPA, in the order in which it is shown."""


@dataclass(frozen=True, kw_only=True)
class EvaluationRequest:
    """Everything that changes the number, its bracket or what is made of it, resolved.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order and switch penalty.
    distance : Distance
        Base distance.
    solver : Solver
        Record of settings.
    time_matching : TimeMatching
        Which stamps are one step, and which steps count.
    unit : str, optional
        Of the states, for printing.
    curve : bool
        Whether to evaluate the steps up to each step as well.
    sliding : Sliding, optional
        Which sliding windows to evaluate as well.
    with_ : sequence of str
        Other metrics beside it, of `OTHER_METRICS`.
    recorded : mapping of str to object
        Further options that change the number, as the result records them in ``parameters``.
    defaults : sequence of str
        Which of cutoff and switch_penalty nobody chose.
    slices : sequence of SliceBy
        Attributes by which costs are split.
    step_weights : WeightsByTime, optional
        What each step counts; all the same by default.
    existence : {"ignore", "use"}
        Whether probabilities of existence count.

    Raises
    ------
    ConfigError
        The curve or windows are asked of a solver that cannot make them, or probabilities of
        existence beside prices of missed and false targets that differ.
    """

    parameters: Parameters
    distance: Distance
    solver: Solver
    time_matching: TimeMatching = field(default_factory=TimeMatching)
    unit: str | None = None
    curve: bool = False
    sliding: Sliding | None = None
    with_: Sequence[str] = ()
    recorded: Mapping[str, object] = field(default_factory=dict)
    defaults: Sequence[str] = ()
    slices: "Sequence[SliceBy]" = ()
    step_weights: "WeightsByTime | None" = None
    existence: str = "ignore"

    def __post_init__(self) -> None:
        if self.existence not in ("ignore", "use"):
            raise ConfigError(f"--existence {quoted(self.existence)}: must be ignore or use")
        if self.probabilistic and self.parameters.rho != 0.5:
            raise ConfigError(NEEDS_SYMMETRY)
        for asked, what in ((self.curve, "the curve needs"), (self.sliding, "windows need")):
            if asked and not self.solver.proves:
                raise ConfigError(f"{what} the solver certified, not {self.solver.name}")

    @property
    def probabilistic(self) -> bool:
        """Whether probabilities of existence count."""
        return self.existence == "use"


def chosen_parameters(
    distance: Distance,
    order: float,
    cutoff: float | None,
    switch_penalty: float | None,
    rho: float = 0.5,
) -> tuple[Parameters, tuple[str, ...]]:
    """Parameters with the defaults of a distance for None, and the names of those.

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


def chosen_metrics(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names of other metrics in our order; a text has them with commas.

    Raises
    ------
    ConfigError
        A name is not that of a metric, or the extra that it needs is not installed.
    """
    asked = [part.strip() for part in names.split(",")] if isinstance(names, str) else list(names)
    for name in asked:
        if name not in OTHER_METRICS:
            raise ConfigError(f"--with {quoted(name)}: must be of {', '.join(OTHER_METRICS)}")
    lacking = [name for name in OF_TRACKEVAL if name in asked]
    if lacking and find_spec("trackeval") is None:
        raise ConfigError(f"--with {','.join(lacking)}: needs the extra mot: {install('mot')}")
    return tuple(name for name in OTHER_METRICS if name in asked)
