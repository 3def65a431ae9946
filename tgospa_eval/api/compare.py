"""``compare`` of Python: estimates of one truth in proven order, or solvers on one estimate."""

import os
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from tgospa_eval.api.evaluate import read_sides
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.settings import Settings, infos, make_settings
from tgospa_eval.api.sweep import ONE_EVALUATION
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.comparison.entrants import Entrant, check_solvers, outcome
from tgospa_eval.comparison.ranking import ranking_document
from tgospa_eval.comparison.solvers import ONCE, compare_solvers, solvers_document
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.evaluate import solve
from tgospa_eval.evaluation.prepare import Prepared, prepare
from tgospa_eval.evaluation.sides import TrajectoriesLike, as_solver, is_path
from tgospa_eval.formats import Reading
from tgospa_eval.reports.comparison import estimates_columns, pairs_columns, render, solvers_columns
from tgospa_eval.reports.records import Metric, RankingRecord, SolversRecord
from tgospa_eval.results.records import json_text
from tgospa_eval.solvers import Solver

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


@with_options(*ONE_EVALUATION)
def compare(
    truth: "TrajectoriesLike",
    estimates: "Estimates | TrajectoriesLike",
    cutoff: float | None = None,
    order: float = 2.0,
    switch_penalty: float | None = None,
    *,
    solvers: Sequence[str | Solver] = (),
    mapping: "Components | None" = None,
    **options: Any,
) -> Compared:
    """Rank several estimates of a truth by proven order, or compare solvers on one estimate.

    Parameters
    ----------
    truth : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    estimates : mapping from name to estimate, or list of paths
        Estimates to rank, each as for `evaluate`; files are called by their paths. With `solvers`
        a single estimate.
    cutoff, order, switch_penalty, mapping
        As for `evaluate`, as all others.
    solvers : sequence of str or solver record
        Solvers to compare on one estimate, each in a process of its own.

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
    ConfigError, InputError, TypeError
        As for `evaluate`; there is no estimate, or a solver is there twice.
    """
    given: dict[str, Any] = {
        "cutoff": cutoff,
        "order": order,
        "switch_penalty": switch_penalty,
        **options,
    }
    chosen = [as_solver(item) for item in solvers]
    if chosen:
        given["solver"] = chosen[0]
    pairs = _Pairs(make_settings(requested(given)), mapping)
    if chosen:
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

    def __init__(self, settings: Settings, mapping: "Components | None") -> None:
        self.settings, self.mapping = settings, mapping
        self.notices: list[Notice] = []
        self.stopwatch = Stopwatch()

    def prepared(
        self, truth: "TrajectoriesLike | Reading", estimate: "TrajectoriesLike", name: str = ""
    ) -> Prepared:
        """The problem of two sides; its warnings name the estimate, where there are several."""
        sides = read_sides(self.settings, truth, estimate, self.stopwatch, mapping=self.mapping)
        for notice in sides.warnings:
            told = notice.about(name) if name and notice.code != "default-parameters" else notice
            if told not in self.notices:
                self.notices.append(told)
        return prepare(
            sides.fitted, sides.request, files=infos(sides.read), stopwatch=self.stopwatch
        )


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
    path = os.fspath(truth) if is_path(truth) else "truth"
    read = pairs.settings.read_side(truth, 0, "truth") if is_path(truth) else None
    entrants = []
    for name, estimate in estimates.items():
        prepared = pairs.prepared(read or truth, estimate, name if len(estimates) > 1 else "")
        result = solve(prepared, pairs.settings.evaluation.solver, pairs.stopwatch)
        made = outcome(result, prepared.moments, per_step=False)
        entrants.append(Entrant(name=name, paths=[name], outcomes=[made]))
    warned = [notice.record() for notice in pairs.notices]
    return ranking_document(entrants, [path], cast("Metric", result.settings), warned)


def _of_solvers(
    pairs: _Pairs, truth: TrajectoriesLike, estimate: TrajectoriesLike, solvers: list[Solver]
) -> SolversRecord:
    """The document of solvers on one problem."""
    prepared = pairs.prepared(truth, estimate)
    found = compare_solvers(prepared, solvers)
    once = {name: pairs.stopwatch.spans.get(span, 0.0) for name, span in ONCE.items()}
    warned = [notice.record() for notice in pairs.notices]
    return solvers_document(found, prepared, {}, once, warned)
