"""``compare`` ranks estimates of one truth, or compares solvers; ``sweep`` varies a parameter."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from tgospa_eval.api.evaluate import Notify, read_sides
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.options import OF_EVALUATE, Request
from tgospa_eval.api.reading import display_names
from tgospa_eval.api.report import StudyReport, Sweep, as_frame
from tgospa_eval.api.resolve import ResolvedRequest, resolve_request
from tgospa_eval.campaign import ranking, solver_runs
from tgospa_eval.campaign.pairs import (
    expand,
    first_file,
    is_pattern,
    named_sides,
    runs_in_memory,
    short_names,
)
from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass, recast
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Resources
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.other_metrics import ComputedMetrics, joined, other_metrics
from tgospa_eval.evaluation.prepare import PreparedPair, prepare
from tgospa_eval.evaluation.prove import solve
from tgospa_eval.evaluation.sweep import in_order, sweep_fitted
from tgospa_eval.formats import Reading
from tgospa_eval.formats.objects import Runs, TrajectoriesLike, is_path, runs_of
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.consistency import ABOUT_THE_ORDER
from tgospa_eval.results.records import Columns, Json
from tgospa_eval.results.saved import (
    MADE_BY,
    OF_THE_ESTIMATE,
    read_result,
    saved_result,
    unlike,
)
from tgospa_eval.show.comparison import COLUMNS, pairs_columns, render
from tgospa_eval.show.study_table import checked_columns
from tgospa_eval.solvers import SOLVERS, Solver, as_solver
from tgospa_eval.tracks.coverage import refuse_own_marks

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd
    from matplotlib.figure import Figure

    from tgospa_eval.api.option_types import CompareOptions, SweepOptions
    from tgospa_eval.api.report import Drawing
    from tgospa_eval.formats.objects import Components, TrajectoriesLike


# -------------------------------------------------------------------------------------------------
# Evaluations over a range of one parameter.

Values: TypeAlias = float | Sequence[float] | Floats

ONE_EVALUATION = ("by", "preprocess", *OF_EVALUATE)
"""Options that `sweep` does not have."""


def swept_parameters(
    request: Request, name: str, values: Sequence[float]
) -> tuple[ResolvedRequest, tuple[Parameters, ...]]:
    """Return the checked options of a sweep, and the parameters at each value.

    `name` is the parameter that takes the `values`. The options have the middle one of the values.
    The parameters are sorted by value.

    Raises
    ------
    ConfigError, InputError
        An option is wrong, as for `evaluate`. Or there is no value, a value is repeated, or a value
        is out of range.
    """
    middle: dict[str, Any] = {name: sorted(values)[len(values) // 2]} if values else {}
    resolved = resolve_request(replace(request, by=None, **middle))
    rest = {k: v for k, v in vars(resolved.evaluation.parameters).items() if k != name}
    return resolved, in_order(name, values, rest)


def sweep_sides(
    resolved: ResolvedRequest,
    name: str,
    parameters: tuple[Parameters, ...],
    sides: "tuple[TrajectoriesLike, TrajectoriesLike]",
    stopwatch: Stopwatch,
    notify: Notify | None = None,
    *,
    mapping: "Components | None" = None,
) -> Sweep:
    """Read truth and estimate once, and evaluate them with the parameters of each point.

    A point is the evaluation with one value of the parameter `name`. `sides` are truth and
    estimate. `read_sides` describes the other arguments.
    """
    read = read_sides(resolved, *sides, stopwatch, notify, mapping=mapping)
    points = sweep_fitted(
        read.fitted, read.request, name, parameters, files=read.records, stopwatch=stopwatch
    )
    return replace(recast(points, Sweep), warnings=read.warnings)


@with_options(*ONE_EVALUATION)
def sweep(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    cutoff: "Values | None" = None,
    order: "Values" = 2.0,
    switch_penalty: "Values | None" = None,
    *,
    rho: "Values" = 0.5,
    mapping: "Components | None" = None,
    **options: "Unpack[SweepOptions]",
) -> Sweep:
    """Compute TGOSPA for several values of one parameter, each with proven bounds.

    Exactly one of `cutoff`, `order`, `switch_penalty` and `rho` is a sequence of values. All other
    arguments are those of `evaluate`. Each value gives a point, which equals a result of
    `evaluate`. Near pairs are searched once for all points. A time limit holds for each point. If
    no state is ignored, `rho` does not change the optimal assignment. Then the problem is solved
    once for all values of `rho`.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    cutoff, order, switch_penalty, rho : float or sequence of float
        Exactly one is a sequence, in any order, without repetitions.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.

    Returns
    -------
    Sweep
        Points, sorted by value.

    Warns
    -----
    TgospaWarning
        The data look wrong. They are checked once, with the middle one of the values.

    Raises
    ------
    ConfigError, InputError, TypeError
        An option or the data are wrong, as for `evaluate`; a value is repeated; or none or several
        of the four parameters are sequences.
    """
    given: dict[str, Any] = {
        "cutoff": cutoff,
        "order": order,
        "switch_penalty": switch_penalty,
        "rho": rho,
    }
    swept = [name for name, value in given.items() if np.ndim(value)]
    if len(swept) != 1:
        raise ConfigError(
            "exactly one of cutoff, order, switch_penalty and rho must be a sequence of values; "
            f"sequences here: {' and '.join(swept) or 'none'}"
        )
    name = swept[0]
    values = [float(value) for value in given.pop(name)]
    resolved, parameters = swept_parameters(requested({**given, **options}), name, values)
    points = sweep_sides(
        resolved, name, parameters, (truth, estimate), Stopwatch(), mapping=mapping
    )
    warn_user(points.warnings)
    return points


COMMAND = r"; to [a-z ]+: tgospa-eval compare [A-Z ]+"
"""Pattern of a hint in the printed table: a command to type. In Python, such hints are removed."""

Estimates: TypeAlias = "Mapping[str, Any] | Runs"
"""Estimates to compare: a mapping from names to estimates or to their runs, a sequence of paths, or
the runs of a single estimate."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Compared(StudyReport):
    """Result of `compare`; ``print`` shows the table of ``tgospa-eval compare``.

    Parameters
    ----------
    document : dict
        Document of ``--format json``.
    entrants : mapping of str to sequence of RunOutcome
        Outcomes of each ranked estimate, one for each run, with the costs per step. Empty if
        solvers are compared.
    """

    document: Json
    entrants: ranking.Entrants = field(default_factory=dict)

    def table(self) -> "pd.DataFrame":
        """Return a row for each estimate, best first, or for each solver."""
        return as_frame(COLUMNS[self.document["kind"]](self.document))

    @property
    def comparisons(self) -> "pd.DataFrame":
        """A row for each pair of estimates: which is proven better, and the difference of values.

        The difference is the value of the second estimate minus that of the first.
        """
        return as_frame(pairs_columns(self.document) if self.document.get("pairs") else {})

    @property
    def curves(self) -> "pd.DataFrame":
        """A row for each estimate, run and step: costs, and their excess over the best estimate.

        The table is empty if solvers are compared.
        """
        return as_frame(self.curves_columns() if self.entrants else {})

    def curves_columns(self) -> Columns:
        """Return the columns of ``per_step.csv``, with a row for each estimate, run and step."""
        return ranking.steps_columns(self.entrants, self.document["estimates"][0]["name"])

    @property
    def plot_data(self) -> object:
        """Data of the pictures.

        For solvers, this is the document. For estimates, these are times and costs, with the best
        estimate first.
        """
        if not self.entrants:
            return self.document
        times, costs = ranking.steps_costs(self.entrants)
        names = [item["name"] for item in self.document["estimates"]]
        return times, {name: costs[name] for name in names if costs}

    @property
    def kind(self) -> str:
        """``"estimates"`` or ``"solvers"``."""
        return str(self.document["kind"])

    def to_dict(self) -> Json:
        """Return the document as plain Python values."""
        return self.document

    def __str__(self) -> str:
        return self.rendered("table")

    __repr__ = __str__

    def rendered(self, format: str, columns: Iterable[str] = ()) -> str:
        """Return the report in a format that ``--format`` accepts, with these columns."""
        return re.sub(COMMAND, "", render(self.document, format, checked_columns(columns)))

    def plot_cumulative(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot a line for each estimate: its cumulative cost, averaged over the runs."""
        return self._plot("cumulative", **options)

    def plot_time_over_error(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the time of each solver over its error."""
        return self._plot("time_over_error", **options)

    def plot_error_over_epsilon(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the error of the solver ``sinkhorn`` over its temperature."""
        return self._plot("error_over_epsilon", **options)

    def plot_convergence(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the errors of both bounds over the sweeps (iterations) of the solvers."""
        return self._plot("convergence", **options)


@with_options(*(name for name in ONE_EVALUATION if name != "with_"))
def compare(
    truth: "Runs",
    estimates: "Estimates",
    cutoff: float | None = None,
    order: float = 2.0,
    switch_penalty: float | None = None,
    *,
    solvers: Sequence[str | Solver] = (),
    mapping: "Components | None" = None,
    **options: "Unpack[CompareOptions]",
) -> Compared:
    """Rank several estimates of one truth in proven order, or compare solvers on one estimate.

    Parameters
    ----------
    truth : path, Trajectories, DataFrame, array, mapping or set of tracks
        Truth as for `evaluate`. If the estimates have runs: one truth for all runs, or one for each
        run.
    estimates : mapping from name to estimate or runs, list of paths, or runs of one estimate
        Estimates to rank, each as for `evaluate`. In a list of paths, each path is also the name.
        Runs are given as for `batch`. With `solvers`, give a single estimate.
    cutoff, order, switch_penalty, mapping
        Parameters of `evaluate`, like all other options.
    solvers : sequence of str or solver
        Solvers to compare on one estimate, one after the other: names, or objects such as
        `Sinkhorn`.

    Returns
    -------
    Compared
        The ranking, which ``print`` shows as the table of ``tgospa-eval compare``.
        `Compared.table` makes a DataFrame.

    Warns
    -----
    TgospaWarning
        The data look wrong, as for `evaluate`.

    Raises
    ------
    ConfigError, InputError, TypeError
        An option or the data are wrong, as for `evaluate`; there is no estimate; or a solver is
        given twice.
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
    settings, stopwatch = resolve_request(requested(given)), Stopwatch()
    solver_runs.check_solvers(chosen)
    notices: list[Notice] = []
    pairs = PairReader(settings, stopwatch, notices.append, mapping=mapping, warnings_only=True)
    document: Json
    entrants: ranking.Entrants = {}
    if chosen:
        if options.get("with_"):
            raise ConfigError(
                f"{option('with_')} is for ranking estimates, not for comparing solvers"
            )
        document = solvers_on(pairs, cast("Any", truth), cast("Any", estimates), chosen)
    else:
        named = _named(estimates)
        _, truths, own = runs_in_memory(truth, named)
        runs = list(zip(truths, zip(*own.values(), strict=True), strict=True))
        request = settings.evaluation
        document, entrants = ranked(pairs, runs, list(named), request.solver, with_=request.with_)
        warnings = (Notice(**record) for record in document["warnings"])
        notices += (notice for notice in warnings if notice.code in ABOUT_THE_ORDER)
    warn_user(notices)
    return Compared(document=document, entrants=entrants)


def _named(estimates: object) -> "Mapping[str, Any]":
    """Return the estimates, or the runs of each estimate, by name.

    Raises
    ------
    ConfigError
        `estimates` has another type, is empty, or repeats a path.
    """
    named: Mapping[str, Any] | None = None
    if isinstance(estimates, Mapping):
        named = named_sides(estimates)
    elif isinstance(estimates, (list, tuple)) and any(map(is_path, estimates)):
        paths = [os.fspath(path) for path in estimates if is_path(path)]
        if len(set(paths)) == len(estimates):
            named = {path: path for path in paths}
    elif runs_of(estimates, "estimates"):
        named = {"estimate": cast("Runs", estimates)}
    if not named:
        raise ConfigError(
            "estimates must be a mapping from name to estimate, or a list of different paths; "
            "solvers=('certified', 'exact') compares solvers on a single estimate"
        )
    return named


# -------------------------------------------------------------------------------------------------
# Reading of sides, and rankings of their evaluations.


class PairReader:
    """Reader of pairs of truth and estimate, which also builds the problem of each pair.

    Each notice is given once. If successive pairs have the same file as truth, that file is read
    once.

    Parameters
    ----------
    settings : ResolvedRequest
        How to read and evaluate.
    stopwatch : Stopwatch
        Clock that adds up the time of each stage.
    notify : callable
        Function that receives each notice.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.
    warnings_only : bool
        Whether `notify` receives only the warnings.
    """

    def __init__(
        self,
        settings: ResolvedRequest,
        stopwatch: Stopwatch,
        notify: Notify,
        *,
        mapping: "Components | None" = None,
        warnings_only: bool = False,
    ) -> None:
        if settings.evaluation.ignoring is not None:
            refuse_own_marks(settings.evaluation.ignoring.texts, "compare")
        self.settings, self.stopwatch, self.notify = settings, stopwatch, notify
        self.mapping, self.warnings_only = mapping, warnings_only
        self.known: dict[str, Reading] = {}
        self.shown: list[Notice] = []

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Warnings about the pairs that were read so far."""
        return [notice.record() for notice in self.shown if notice.code]

    def prepared(
        self, truth: TrajectoriesLike, estimate: TrajectoriesLike, name: str = ""
    ) -> PreparedPair:
        """Return the problem of truth and estimate; notices begin with `name`, if it is given."""
        of_file = tuple(f"{path}: " for path in display_names((truth, estimate), ("", "")))

        def tell(notice: Notice) -> None:
            is_default = notice.text.startswith("default ") and (
                self.warnings_only or not notice.code
            )
            if name and not is_default and not notice.text.startswith(of_file):
                notice = notice.about(name)
            if notice not in self.shown:
                self.shown.append(notice)
                self.notify(notice)

        sides = read_sides(
            self.settings,
            truth,
            estimate,
            self.stopwatch,
            None if self.warnings_only else tell,
            mapping=self.mapping,
            known=self.known,
        )
        for notice in sides.warnings if self.warnings_only else ():
            tell(notice)
        files = sides.records
        return prepare(sides.fitted, sides.request, files=files, stopwatch=self.stopwatch)


Ranked = tuple[Json, ranking.Entrants]
"""The JSON document of a ranking, and the outcomes of each estimate from which it was made."""


def ranked(
    pairs: PairReader,
    runs: Sequence[tuple[TrajectoriesLike, Sequence[TrajectoriesLike]]],
    names: Sequence[str],
    solver: Solver,
    *,
    per_step: bool = False,
    with_: Sequence[str] = (),
) -> Ranked:
    """Evaluate and rank several estimates of one truth, or of a truth for each run.

    Parameters
    ----------
    pairs : PairReader
        Reader of the pairs.
    runs : sequence of (truth, sequence of estimates)
        Truth and estimates of each run. Each run has the estimates in the order of `names`.
    names : sequence of str
        Names of the estimates.
    solver : Solver
        Solver of all problems.
    per_step : bool
        Whether to show per-step GOSPA too.
    with_ : sequence of str
        Names of other metrics to show.

    Returns
    -------
    tuple
        The JSON document, and the outcomes of each estimate by its name. After an interruption, the
        ranking uses only complete runs, in which all estimates are evaluated. If there is no
        complete run, it uses the evaluated estimates of the first run.
    """
    stopwatch = pairs.stopwatch
    outcomes: dict[str, list[ranking.RunOutcome]] = {}
    computed: dict[str, list[ComputedMetrics]] = {}
    count = len(names) * len(runs)
    for done, (name, truth, estimate) in enumerate(
        (name, truth, estimate)
        for truth, estimates in runs
        for name, estimate in zip(names, estimates, strict=True)
    ):
        if done and stopwatch.progress.stop.is_set():
            break
        (path,) = display_names([estimate], [name])
        with stopwatch.progress.part(path, done, count):
            prepared = pairs.prepared(truth, estimate, path if count > 1 else "")
            result = solve(prepared, solver, stopwatch)
            if with_:
                resources = Resources(jobs=solver.jobs, stopwatch=stopwatch)
                beside = other_metrics(prepared, with_, resources, result.proof)
                computed.setdefault(name, []).append(beside)
            made = ranking.outcome(path, result, prepared.timestamps, per_step=per_step)
            outcomes.setdefault(name, []).append(made)
    whole = len(outcomes[names[-1]]) if names[-1] in outcomes else 1
    entrants = {name: own[:whole] for name, own in outcomes.items()}
    metrics = {name: joined(own[:whole]) for name, own in computed.items()}
    truths = display_names([truth for truth, _ in runs[:whole]], ["truth"] * whole)
    metric = dict(result.settings)
    return ranking.ranking_document(entrants, truths, metric, pairs.warnings, metrics), entrants


def solvers_on(
    pairs: PairReader,
    truth: TrajectoriesLike,
    estimate: TrajectoriesLike,
    solvers: Sequence[Solver],
    *,
    spare: bool = False,
) -> Json:
    """Run several solvers on one pair, and return the JSON document of the comparison.

    With `spare`, the solver ``exact`` is left out if it may take minutes.
    """
    stopwatch, prepared = pairs.stopwatch, pairs.prepared(truth, estimate)
    chosen, left_out = list(solvers), {}
    states = solver_runs.takes_long(prepared) if spare else None
    if states is not None:
        chosen = [solver for solver in solvers if not solver.referee]
        reason = f"with {states:,} reduced states, it may take minutes; "
        reason += f"{option('solvers', ','.join(SOLVERS))} runs it all the same"
        left_out = {solver.name: reason for solver in solvers if solver.referee}
    stopwatch.stage = "solve/lp"
    stopwatch.progress.begin(prepared.parameters.root)
    solver_runs.warm_up(chosen)
    runs = [made for made, _ in solver_runs.compare_solvers(prepared, chosen, stopwatch.progress)]
    for solver in chosen[len(runs) :]:
        left_out[solver_runs.name_of(solver)] = "not started: interrupted"
    once = {name: stopwatch.spans.get(span, 0.0) for name, span in solver_runs.ONCE.items()}
    return solver_runs.solvers_document(runs, prepared, left_out, once, pairs.warnings)


# -------------------------------------------------------------------------------------------------
# Rankings of saved results.

HEAD = ("files", "input", "parameters", "warnings", "with")
"""Fields of the document of a saved result that a ranking uses in addition to the costs."""


def are_saved(paths: Sequence[str]) -> bool:
    """Return true if paths, or patterns of paths, name saved results, not data files.

    Raises
    ------
    ConfigError
        Some paths are of results and others of data files; or there is only one result.
    """
    first = [first_file(path) if is_pattern(path) else path for path in paths]
    saved = [name is not None and saved_result(name) is not None for name in first]
    if not any(saved):
        return False
    if not all(saved):
        other, one = paths[saved.index(False)], paths[saved.index(True)]
        raise ConfigError(
            f"{other or quoted(other)}: is not a saved result, but {one} is; {MADE_BY}; name only "
            "results, or only files of truth and estimates"
        )
    if len(paths) == 1 and not is_pattern(paths[0]):
        raise ConfigError(
            f"{paths[0]}: is a single saved result; name other results to rank it with"
        )
    return True


def rank_saved(paths: Sequence[str], notify: Notify) -> Ranked:
    """Rank saved results by their proven brackets. Nothing is solved.

    Raises
    ------
    TgospaError
        - Only some paths are patterns, or the patterns do not fit each other.
        - A result is wrong or a duplicate, or has another truth or other parameters than the first.
    """
    marked = [is_pattern(path) for path in paths]
    if any(marked) and not all(marked):
        path = paths[marked.index(False)]
        raise ConfigError(f"{path}: has no * in place of the run, but other results have one")
    runs = [
        [saved_result(path) or path for path in (first, *rest)]
        for first, rest in expand(paths[0], paths[1:])
    ]
    names = short_names(paths if any(marked) else runs[0])
    heads: list[list[Json]] = []
    outcomes: list[list[ranking.RunOutcome]] = []
    for group in runs:
        documents = [read_result(path) for path in group]
        for document in documents:
            refuse_own_marks(document["parameters"].get("ignore", ()), "compare")
        heads.append([{name: item.get(name, {}) for name in HEAD} for item in documents])
        faults = []
        for path, document in zip(group, documents, strict=True):
            wrong = unlike(document["parameters"], heads[0][0]["parameters"])
            texts = [
                f"{name} is {one}, but {other} there"
                for name, one, other in wrong
                if name not in OF_THE_ESTIMATE
            ]
            if texts:
                which = f"{path}: cannot be ranked with {runs[0][0]}"
                faults.append(f"{which}: {'; '.join(texts)}")
        if faults:
            raise ConfigError(*faults)
        outcomes.append(ranking.saved_outcomes(documents, group))
    entrants = dict(zip(names, zip(*outcomes, strict=True), strict=True))
    warnings = [
        Notice(**record).about(path)
        for run, items in zip(runs, heads, strict=True)
        for path, item in zip(run, items, strict=True)
        for record in item["warnings"]
    ]
    shared_metrics, left_out = ranking.shared_metrics(heads)
    for notice in (*warnings, *left_out):
        notify(notice)
    first, *rest = [item["parameters"] for items in heads for item in items]
    shared = {  # a parameter that differs, such as solver or unit, is left out
        name: value
        for name, value in first.items()
        if all(name in other and other[name] == value for other in rest)
    }
    truths = [
        first["files"].get("truth") or f"sha256 {first['input']['truth']['sha256']}"
        for first, *_ in heads
    ]
    records = [warning.record() for warning in warnings]
    beside = {name: own for name, own in zip(names, shared_metrics, strict=True) if own}
    return ranking.ranking_document(entrants, truths, shared, records, beside), entrants
