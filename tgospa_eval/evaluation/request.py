"""What is asked of an evaluation, whoever asks: a command line, a suite, or Python."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import TimeMatching


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
    recorded : mapping of str to object
        Further options that change the number, as the result records them in ``parameters``.
    defaults : sequence of str
        Which of cutoff and switch_penalty nobody chose.

    Raises
    ------
    ConfigError
        The curve is asked of a solver that cannot make it.
    """

    parameters: Parameters
    distance: Distance
    solver: Solver
    time_matching: TimeMatching = field(default_factory=TimeMatching)
    unit: str | None = None
    curve: bool = False
    recorded: Mapping[str, object] = field(default_factory=dict)
    defaults: Sequence[str] = ()

    def __post_init__(self) -> None:
        if self.curve and not self.solver.proves:
            raise ConfigError(f"the curve needs the solver certified, not {self.solver.name}")


def chosen_parameters(
    distance: Distance, order: float, cutoff: float | None, switch_penalty: float | None
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
    return Parameters(order=order, **values), unchosen
