"""Where the values of a gate come from: defaults, baseline, files, environment, flags."""

import os
from collections.abc import Mapping
from typing import Self

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.options import BY_KEY, EVALUATION
from tgospa_eval.cli.shared.typed import typed_options
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions, Values
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.regression.baseline import Entry
from tgospa_eval.regression.rules import DEFAULT, Rule, parse_maximum, parse_rule, split_rules
from tgospa_eval.regression.suite import Pair
from tgospa_eval.results.saved import ACCURACY
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import clipped, quoted

WITHOUT_EFFECT = ("jobs", "max-input")
"""Options of an evaluation that change neither the number nor its bracket."""

PATHS_GIVEN = ("covariance", "step_weights")
"""Options that name a file, by parameter."""

RULE_PARAMETERS = {"fail-on": "fail_on", "warn-on": "warn_on", "max": "maximum"}
"""Rules by their names in a suite and as parameters."""

ACCURACY_KEYS = tuple(name.replace("_", "-") for name in ACCURACY)

STRONG = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)


@dataclass(frozen=True, kw_only=True)
class GateOptions(Values):
    """What to judge by, and what to write beside stdout."""

    suite: str | None
    baseline: str | None
    update_baseline: bool
    fail_on: tuple[str, ...]
    warn_on: tuple[str, ...]
    maximum: tuple[str, ...]
    junit: str | None
    proof: str | None
    github: bool

    def prefix(self, pair: Pair) -> str:
        """What a line about a pair begins with: its name, where there are several."""
        return f"{clipped(pair.name)}: " if self.suite else ""


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """The options of the evaluation of a pair, and the names of those that are no defaults."""

    options: EvaluationOptions
    given: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Given:
    """The options of the command line, with where they come from.

    A default yields to the baseline, that to a configuration file, that to the suite, that to the
    environment, that to a flag.

    Parameters
    ----------
    context : Context
        Knows where a value comes from.
    evaluation, gate, output : EvaluationOptions, GateOptions, OutputOptions
        Those of the evaluation, of the gate itself, and of printing.
    """

    context: click.Context
    evaluation: EvaluationOptions
    gate: GateOptions
    output: OutputOptions

    @classmethod
    def of(cls, context: click.Context, values: Mapping[str, object]) -> Self:
        """From all options of the verb by parameter."""
        return cls(
            context=context,
            evaluation=EvaluationOptions.of(values),
            gate=GateOptions.of(values),
            output=OutputOptions.of(values),
        )

    def strong(self, name: str) -> bool:
        """Whether it is a flag or from the environment."""
        return self.context.get_parameter_source(name) in STRONG

    def typed(self, name: str) -> bool:
        """Whether it is a flag."""
        return self.context.get_parameter_source(name) is ParameterSource.COMMANDLINE

    def weak(self, name: str) -> bool:
        """Whether it is from a configuration file."""
        return self.context.get_parameter_source(name) is ParameterSource.DEFAULT_MAP

    def resolve(self, pair: Pair, entry: Entry | None, path: str) -> Chosen:
        """The options of a pair."""
        own = {str(i.name): getattr(self.evaluation, str(i.name)) for i in EVALUATION}
        given = (
            {}
            if entry is None
            else typed_options(self.context, dict(entry.options), f"{path}, options")
        )
        for name in (name for name in PATHS_GIVEN if given.get(name)):
            given[name] = os.path.join(os.path.dirname(path), str(given[name]))
        given |= {name: value for name, value in own.items() if self.weak(name)}
        given |= typed_options(
            self.context, dict(pair.options), f"pair {quoted(pair.name)}, options"
        )
        given |= {name: value for name, value in own.items() if self.strong(name)}
        return Chosen(options=EvaluationOptions.of(given), given=tuple(given))

    def recorded(
        self, chosen: Chosen, result: Summary, path: str, *, finished: bool
    ) -> dict[str, object]:
        """What the baseline records of the options: those given, and c and gamma in any case.

        Those of a solver that did not reach its accuracy are left out, a later run would inherit
        them; the path of a file is relative to the folder of the baseline.
        """
        keys = {str(item.name): key for key, item in BY_KEY.items()}
        values = {name: getattr(chosen.options, name) for name in chosen.given}
        recorded: dict[str, object] = {
            keys[name]: ",".join(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if keys[name] not in WITHOUT_EFFECT and value not in (None, ())
            if finished or keys[name] not in ACCURACY_KEYS
        }
        for key in (keys[name] for name in PATHS_GIVEN if keys[name] in recorded):
            recorded[key] = relative_path(str(recorded[key]), os.path.dirname(path))
        used = result.proof.parameters
        return {**recorded, "cutoff": used.cutoff, "switch-penalty": used.switch_penalty}

    def rules(self, pair: Pair, *, baseline: bool = True) -> list[Rule]:
        """The rules of a pair.

        Raises
        ------
        ConfigError
            One is wrong; or there is no baseline, and they are not all absolute limits.
        """
        found: list[Rule] = []
        for key, name in RULE_PARAMETERS.items():
            own = [part for text in getattr(self.gate, name) for part in split_rules(text)]
            suite = [
                part for text in pair.rules.get(key, ()) for part in split_rules(text) or [text]
            ]
            if key == "fail-on":
                texts = own if own and (self.strong(name) or not suite) else suite
                found += [parse_rule(text) for text in texts] or [DEFAULT][:baseline]
            elif key == "warn-on":
                found += [parse_rule(text, option=key) for text in (*suite, *own)]
            else:
                found += [parse_maximum(text) for text in (*suite, *own)]
        relative = [rule for rule in found if not rule.maximum]
        if not baseline and (relative or not found):
            why = f"{relative[0].text} needs one" if relative else "limits of --max need none"
            raise ConfigError(
                f"{self.gate.prefix(pair)}no baseline: name it with --baseline FILE; {why}"
            )
        return found


def relative_path(path: str, folder: str) -> str:
    """The path from a folder, with slashes; from another drive there is none but the whole."""
    try:
        return os.path.relpath(path, folder or os.curdir).replace(os.sep, "/")
    except ValueError:
        return os.path.abspath(path)
