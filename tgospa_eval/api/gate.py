"""``gate`` of Python: one evaluation against a baseline."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tgospa_eval._version import __version__
from tgospa_eval.api.evaluate import evaluate
from tgospa_eval.api.keywords import KEYWORDS, with_options
from tgospa_eval.api.request import OF_THE_NUMBER
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import in_python
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.sides import TrajectoriesLike
from tgospa_eval.regression.baseline import Measured, dump, load, make_entry, measured
from tgospa_eval.regression.outcome import PairOutcome, Report, change, compare, update_notes
from tgospa_eval.regression.report import GATE_REPORTS
from tgospa_eval.regression.suite import (
    DEFAULT,
    ONLY_PAIR,
    Finding,
    Pair,
    Rule,
    Verdict,
    parse_maximum,
    parse_rule,
    split_rules,
)
from tgospa_eval.reports.files import write_file

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.results.result import Result

INHERITED = {key: name for key, name in KEYWORDS.items() if name in OF_THE_NUMBER}
"""Keywords by the names of their options, as a baseline has these."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GateResult:
    """What `gate` found; true if it passed, printed it is the table of the command.

    Parameters
    ----------
    report : Report
        Verdict, findings and notes.
    result : Result
        What was judged.
    """

    report: Report
    result: "Result"

    @property
    def verdict(self) -> str:
        """``"pass"``, ``"fail"``, ``"undecided"``, ``"not comparable"`` or ``"updated"``."""
        return str(self.report.verdict)

    @property
    def passed(self) -> bool:
        """Whether it is proven that all rules hold, or the baseline was made."""
        return self.report.status == 0

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: reasons, remedies."""
        return self.report.outcomes[0].notes

    @cached_property
    def findings(self) -> "pd.DataFrame":
        """A row for each rule: value, limit, verdict."""
        import pandas as pd  # here: slow to import

        return pd.DataFrame([_row(found) for found in self.report.outcomes[0].findings])

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        return GATE_REPORTS["table"](self.report).rstrip("\n")

    __repr__ = __str__


def _row(found: Finding) -> dict[str, object]:
    return {
        "rule": found.rule.text,
        "baseline": found.base,
        "limit": found.limit,
        "lower_bound": found.now.lower,
        "upper_bound": found.now.upper,
        "proven": found.now.proven,
        "verdict": str(found.verdict),
    }


@with_options()
def gate(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    baseline: "str | os.PathLike[str]",
    *,
    fail_on: str | Iterable[str] = (),
    warn_on: str | Iterable[str] = (),
    limits: Mapping[str, float] | None = None,
    update_baseline: bool = False,
    **options: Any,
) -> GateResult:
    """Judge an estimate against a baseline, as ``tgospa-eval gate`` does.

    It fails only if the proven lower bound breaks a rule, and passes only if the proven upper bound
    keeps it.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    baseline : str or path
        The JSON file that an update makes; the command reads and makes the same.
    fail_on : str or iterable of str
        Rules, ``"total:+2%"`` or ``"counts.switch:+1"``; ``"total:+0.001%"`` by default.
    warn_on : str or iterable of str
        Rules that only warn.
    limits : mapping of str to float, optional
        Largest values that do not depend on the baseline: ``{"tgospa": 50.0}``.
    update_baseline : bool
        Whether to make the baseline, or to replace it, instead.

    What is not given is that of the baseline, and else as for `evaluate`.

    Returns
    -------
    GateResult
        True if it passed; `GateResult.verdict`, `GateResult.findings`, `GateResult.result`.

    Raises
    ------
    ConfigError, InputError
        As for `evaluate`; a rule is wrong, or the baseline cannot be read.
    """
    path = os.fspath(baseline)
    old = load(path)
    if old and ONLY_PAIR not in old:
        raise ConfigError(f"{path}: is the baseline of a suite ({', '.join(old)}); name another")
    entry = (old or {}).get(ONLY_PAIR)
    rules = _rules(fail_on, warn_on, limits or {})
    kept = {} if entry is None else entry.options
    inherited = {name: kept[key] for key, name in INHERITED.items() if key in kept}
    given: dict[str, Any] = {**inherited, **options}
    result = evaluate(truth, estimate, **given)
    now = measured(result)
    pair = Pair(name=ONLY_PAIR, truth=_called(truth, "truth"), estimate=_called(estimate, ""))
    if update_baseline:
        outcome = _updated(path, pair, now, given)
    elif entry is None:
        outcome = PairOutcome.of(pair, Verdict.INCOMPARABLE, f"no such file: {path}")
    else:
        verdict, findings, notes = compare(now, entry, rules)
        outcome = replace(PairOutcome.of(pair, verdict, *notes), findings=findings)
    outcome = replace(
        outcome,
        notes=tuple(in_python(note, reads=False) for note in outcome.notes),
        warnings=result.warnings,
    )
    report = Report(baseline=path, outcomes=(outcome,), version=__version__)
    return GateResult(report=report, result=result)


def _rules(
    fail_on: str | Iterable[str], warn_on: str | Iterable[str], limits: Mapping[str, float]
) -> list[Rule]:
    """All rules; the usual one where none says when to fail."""

    def texts(given: str | Iterable[str]) -> list[str]:
        each = [given] if isinstance(given, str) else given
        return [part for text in each for part in split_rules(text)]

    return [
        *([parse_rule(text) for text in texts(fail_on)] or [DEFAULT]),
        *(parse_rule(text, option="warn-on") for text in texts(warn_on)),
        *(parse_maximum(f"{name}={value!r}") for name, value in limits.items()),
    ]


def _updated(path: str, pair: Pair, now: Measured, given: Mapping[str, object]) -> PairOutcome:
    """Make the baseline anew, with the options that the command has names for."""
    old = (load(path) or {}).get(ONLY_PAIR)
    plain = {
        key: given[name]
        for key, name in INHERITED.items()
        if isinstance(given.get(name), (str, float, int))
    }
    used = {name: now.parameters[name.replace("-", "_")] for name in ("cutoff", "switch-penalty")}
    entry = make_entry(now, plain | used)
    if old != entry:
        write_file(path, dump({ONLY_PAIR: entry}), "--baseline")
    outcome = PairOutcome.of(pair, Verdict.UPDATED, *update_notes(old, entry, now))
    return replace(outcome, changes=change(old, entry))


def _called(side: object, otherwise: str) -> str:
    """The path of a file."""
    return os.fspath(side) if isinstance(side, (str, os.PathLike)) else otherwise
