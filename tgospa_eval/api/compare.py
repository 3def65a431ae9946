"""``compare`` of Python: estimates of one truth in proven order, or solvers on one estimate."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import PurePath
from typing import TYPE_CHECKING, TypeAlias, cast

from tgospa_eval.campaign.ranking import Entrant, outcome, ranking_document
from tgospa_eval.campaign.solvers import ONCE, check_solvers, compare_solvers, solvers_document
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, spoken_in_python, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.diagnosis import look
from tgospa_eval.evaluation.evaluate import solve
from tgospa_eval.evaluation.prepare import Prepared, fit, prepare
from tgospa_eval.evaluation.request import EvaluationRequest, chosen_parameters
from tgospa_eval.evaluation.sides import (
    StepWeightsLike,
    TrajectoriesLike,
    as_distance,
    as_sides,
    as_solver,
    as_step_weights,
    as_trajectories,
    in_units_of_truth,
)
from tgospa_eval.formats.options import parse_steps
from tgospa_eval.reports.comparison import estimates_columns, pairs_columns, render, solvers_columns
from tgospa_eval.reports.records import Metric, RankingRecord, SolversRecord
from tgospa_eval.results.records import json_text
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.existence import EXISTENCE

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.evaluation.sides import Components


COMMAND = r"; to [a-z ]+: tgospa-eval compare [A-Z ]+"
"""What the table of the command says of another command."""

Estimates: TypeAlias = "Mapping[str, TrajectoriesLike] | Sequence[str | os.PathLike[str]]"
"""Several by name, or paths."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Compared:
    """What `compare` found; printed it is the table of the command.

    Parameters
    ----------
    document : dict
        The document of ``--format json``.
    """

    document: RankingRecord | SolversRecord

    @cached_property
    def table(self) -> "pd.DataFrame":
        """A row for each estimate, the best first, or for each solver."""
        import pandas as pd  # here: slow to import

        if self.document["kind"] == "estimates":
            return pd.DataFrame(estimates_columns(self.document))
        return pd.DataFrame(solvers_columns(self.document))

    @cached_property
    def pairs(self) -> "pd.DataFrame":
        """A row for each pair of estimates: the proven order, and the second less the first."""
        import pandas as pd  # here: slow to import

        if self.document["kind"] != "estimates" or not self.document["pairs"]:
            return pd.DataFrame()
        return pd.DataFrame(pairs_columns(self.document))

    def to_dict(self) -> RankingRecord | SolversRecord:
        """The document as plain Python values."""
        return self.document

    def to_json(self) -> str:
        """The document: sorted keys, no NaN, full doubles."""
        return json_text(self.document)

    def __str__(self) -> str:
        return re.sub(COMMAND, "", render(self.document, "table"))

    __repr__ = __str__


@spoken_in_python(reads=False)
def compare(
    truth: "TrajectoriesLike",
    estimates: "Estimates | TrajectoriesLike",
    cutoff: float | None = None,
    order: float = 2,
    switch_penalty: float | None = None,
    *,
    solvers: Sequence[str | Solver] = (),
    rho: float = 0.5,
    distance: str | Distance = "euclidean",
    solver: str | Solver = "certified",
    unit: str | None = None,
    time_tolerance: float | str = 0.0,
    grid: str = "union",
    interpolate: str | None = None,
    max_gap: "float | str | Sequence[float | str] | None" = None,
    resample: float | str | None = None,
    steps: str | None = None,
    outage: float | str | None = None,
    time_offset: float = 0.0,
    time_scale: float = 1.0,
    unit_scale: float = 1.0,
    step_weights: "StepWeightsLike | None" = None,
    existence: str = "ignore",
    mapping: "Components | None" = None,
) -> Compared:
    """Rank several estimates of a truth by proven order, or compare solvers on one estimate.

    Parameters
    ----------
    truth : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    estimates : mapping from name to estimate, or list of paths
        Estimates to rank, each as for `evaluate`; files are called by their paths. With `solvers`
        a single estimate.
    cutoff, order, switch_penalty, rho, distance, unit, time_tolerance, step_weights, existence
        As for `evaluate`.
    solvers : sequence of str or solver record
        Solvers to compare on one estimate, each in a process of its own.
    solver : str or solver record
        The solver of a ranking.
    grid : {"union", "truth"}
        Steps that count; with `solvers` also ``"estimate"`` and ``"common"``.
    interpolate, max_gap, resample, steps, outage, time_offset, time_scale, unit_scale, mapping
        As for `evaluate`; of all estimates.

    Returns
    -------
    Compared
        Prints as the table of ``tgospa-eval compare``; `Compared.table` is a DataFrame.

    Warns
    -----
    TgospaWarning
        As `evaluate`.

    Raises
    ------
    ConfigError, InputError
        As for `evaluate`; there is no estimate, or a solver is there twice.
    """
    base = as_distance(distance)
    parameters, defaults = chosen_parameters(base, order, cutoff, switch_penalty, rho)
    request = EvaluationRequest(
        parameters=parameters,
        distance=base,
        solver=as_solver(solver),
        time_matching=TimeMatching(
            tolerance=time_tolerance,
            grid=grid,
            interpolate=interpolate,
            max_gap=max_gap,
            resample=resample,
            steps=parse_steps(steps),
            outage=outage,
        ),
        unit=unit,
        defaults=defaults,
        step_weights=as_step_weights(step_weights),
        existence=existence,
    )
    pairs = _Pairs(request, mapping, (time_offset, time_scale, unit_scale))
    if solvers:
        chosen = [as_solver(item) for item in solvers]
        check_solvers(chosen)
        found: RankingRecord | SolversRecord = _of_solvers(
            pairs, truth, cast("TrajectoriesLike", estimates), chosen
        )
    else:
        found = _ranked(pairs, truth, _named(estimates))
    warn_user(pairs.notices)
    return Compared(document=found)


class _Pairs:
    """Pairs of sides, made problems of; what looks wrong with them, each once."""

    def __init__(
        self,
        request: EvaluationRequest,
        mapping: "Components | None",
        units: tuple[float, float, float],
    ) -> None:
        self.request, self.mapping, self.units = request, mapping, units
        self.notices: list[Notice] = []
        self.stopwatch = Stopwatch()

    def prepared(
        self, truth: TrajectoriesLike, estimate: TrajectoriesLike, name: str = ""
    ) -> Prepared:
        """The problem of two sides; its warnings name the estimate, where there are several."""
        request = self.request
        attributes = (EXISTENCE,) if request.probabilistic else ()
        with self.stopwatch.span("read"):
            read = as_sides(truth, estimate, request.distance, attributes, self.mapping)
            sides, recorded = in_units_of_truth(read, request.distance, *self.units)
        request = replace(request, recorded=recorded)
        fitted = fit(*sides, request)
        for notice in look(fitted, request):
            told = notice.about(name) if name and notice.code != "default-parameters" else notice
            if told not in self.notices:
                self.notices.append(told)
        return prepare(fitted, request, stopwatch=self.stopwatch)


def _named(
    estimates: object,
) -> "Mapping[str, TrajectoriesLike]":
    """Estimates by name.

    Raises
    ------
    ConfigError
        They are none.
    """
    found: Mapping[str, TrajectoriesLike] | None = None
    if isinstance(estimates, Mapping):
        found = {str(name): estimate for name, estimate in estimates.items()}
    elif isinstance(estimates, (list, tuple)):
        paths = [os.fspath(p) for p in estimates if isinstance(p, (str, PurePath))]
        if len(set(paths)) == len(estimates):
            found = {path: path for path in paths}
    if not found:
        raise ConfigError(
            "estimates must be a mapping from name to estimate, or a list of different paths, at "
            "least one; of a single estimate solvers are compared, solvers=('certified', 'exact')"
        )
    return found


def _ranked(
    pairs: _Pairs, truth: TrajectoriesLike, estimates: "Mapping[str, TrajectoriesLike]"
) -> RankingRecord:
    """The document of a ranking."""
    request = pairs.request
    path = os.fspath(truth) if isinstance(truth, (str, os.PathLike)) else "truth"
    if isinstance(truth, (str, os.PathLike)):
        attributes = (EXISTENCE,) if request.probabilistic else ()
        truth = as_trajectories(truth, "truth", request.distance, attributes)
    entrants = []
    for name, estimate in estimates.items():
        prepared = pairs.prepared(truth, estimate, name if len(estimates) > 1 else "")
        result = solve(prepared, request.solver, pairs.stopwatch)
        made = outcome(result, prepared.moments, per_step=False)
        entrants.append(Entrant(name=name, paths=[name], outcomes=[made]))
    warned = [notice.record() for notice in pairs.notices]
    return ranking_document(entrants, [path], cast("Metric", result.settings), warned)


def _of_solvers(
    pairs: _Pairs, truth: TrajectoriesLike, estimate: TrajectoriesLike, solvers: list[Solver]
) -> SolversRecord:
    """The document of solvers on one problem."""
    pairs.request = replace(pairs.request, solver=solvers[0])
    prepared = pairs.prepared(truth, estimate)
    found = compare_solvers(prepared, solvers)
    once = {name: pairs.stopwatch.spans.get(span, 0.0) for name, span in ONCE.items()}
    warned = [notice.record() for notice in pairs.notices]
    return solvers_document(found, prepared, {}, once, warned)
