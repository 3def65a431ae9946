"""Options of ``compare`` as records, and the solvers that they name."""

from collections.abc import Callable, Mapping
from typing import Self, TypeVar

from tgospa_eval.cli.shared.settings import Settings, make_settings
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions, Values
from tgospa_eval.common.figures import parsed, parsed_whole
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.comparison.runs import check_solvers
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.folders import COMPARISON, probe_folder
from tgospa_eval.solvers import SOLVERS, Solver, solver_class
from tgospa_eval.text import quoted

Number = TypeVar("Number", int, float)

TEMPERATURES = "0.1,0.05,0.03,0.01"
"""Of sinkhorn where none are given."""


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Values):
    """What to compare, how to evaluate it, and where to write.

    Parameters
    ----------
    evaluation, output : EvaluationOptions, OutputOptions
        As of everything that evaluates.
    solvers : str, optional
        Names with commas; None where none were given.
    epsilon : str, optional
        Temperatures with commas; None where none were given.
    against : str, optional
        The metric that is shown beside TGOSPA.
    """

    evaluation: EvaluationOptions
    output: OutputOptions
    solvers: str | None
    epsilon: str | None
    against: str | None

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Self:
        """From all options of the verb; temperatures and --seed are of other kinds here."""
        shared = {name: value for name, value in values.items() if name not in ("epsilon", "seed")}
        evaluation, output = EvaluationOptions.of(shared), OutputOptions.of(values)
        return super().of({**values, "evaluation": evaluation, "output": output})

    @property
    def per_step(self) -> bool:
        """Whether per-step GOSPA is shown beside TGOSPA."""
        return self.against is not None

    @property
    def beside(self) -> bool:
        """Whether anything is shown beside TGOSPA."""
        return self.per_step or self.evaluation.with_ is not None

    def settings(self) -> Settings:
        """The records that the options ask for."""
        return make_settings(self.evaluation)

    def check_folder(self) -> None:
        """See that the folder can be written, before any work is done."""
        if self.output.output is not None:
            probe_folder(self.output.output, COMPARISON, force=self.output.force)

    def checked_settings(self) -> Settings:
        """The records that the options ask for; the folder can be written."""
        self.check_folder()
        return self.settings()

    def make_solvers(self, names: str, temperatures: str = TEMPERATURES) -> list[Solver]:
        """The solvers that were asked for, by default these; `sinkhorn` once a temperature.

        Raises
        ------
        ConfigError
            A name is not that of a solver, a temperature is no number, or one is there twice.
        """
        chosen = self.evaluation
        limits = {"time_limit": chosen.time_limit}
        sweeping = {"gap": chosen.gap, "jobs": chosen.jobs, **limits}
        solvers: list[Solver] = []
        asked = names if self.solvers is None else self.solvers
        for name in (part.strip() for part in asked.split(",")):
            if name not in SOLVERS:
                raise ConfigError(f"--solvers {quoted(name)}: must be of {', '.join(SOLVERS)}")
            make: Callable[..., Solver] = solver_class(name)
            if name == "sinkhorn":
                given = temperatures if self.epsilon is None else self.epsilon
                solvers += [make(epsilon=e, **sweeping) for e in numbers("epsilon", given, parsed)]
            else:
                solvers.append(make(**(limits if name == "exact" else sweeping)))
        check_solvers(solvers)
        return solvers


@dataclass(frozen=True, kw_only=True)
class StudyOptions(Values):
    """Of the scaling study; lists of numbers are texts with commas, `numbers` those of steps."""

    targets: str
    numbers: str
    runs: int
    scenario: str
    area: float
    seed: int


def numbers(option: str, text: str, parse: Callable[[str], Number | None]) -> list[Number]:
    """The numbers of a list with commas.

    Raises
    ------
    ConfigError
        A part between commas is no number of this kind.
    """
    found: list[Number] = []
    for part in map(str.strip, text.split(",")):
        number = parse(part)
        if number is None:
            what = "whole numbers" if parse is parsed_whole else "numbers"
            raise ConfigError(f"--{option} {quoted(part)}: must be {what} with commas")
        found.append(number)
    return found
