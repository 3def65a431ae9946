"""``compare TRUTH A B``: estimates of one truth, or of that of each run, in their order."""

from collections.abc import Sequence
from typing import cast

from tgospa_eval.cli.compare.files import Pairs, check_files, short_names
from tgospa_eval.cli.compare.runs import Runs, each_estimate, expand
from tgospa_eval.cli.compare.show import show
from tgospa_eval.cli.compare.values import CompareOptions
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.comparison.entrants import Entrant, Outcome, outcome
from tgospa_eval.comparison.ranking import ranking_document
from tgospa_eval.comparison.steps import StepCosts, steps_columns, steps_costs
from tgospa_eval.distances import Effort
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.evaluate import solve
from tgospa_eval.evaluation.other_metrics import other_metrics
from tgospa_eval.plots.comparison import estimate_pictures
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.ranking import opposed, pairs_columns
from tgospa_eval.reports.records import Metric, RankingRecord
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.sinkhorn import Sinkhorn

Ranked = tuple[RankingRecord, dict[str, str], StepCosts]
"""The document, tables by the names of their files, and the costs of the steps."""


def compare_estimates(truth: str, estimates: tuple[str, ...], options: CompareOptions) -> bool:
    """Rank estimates of one truth, or of that of each run; whether all did what was asked.

    Raises
    ------
    TgospaError
        An option has no meaning, or a file cannot be read.
    """
    solver = _solver(options)
    estimates, notices = each_estimate(truth, estimates, options.output.output)
    for text in () if options.output.quiet else notices:
        print_notice(text)
    runs = expand(truth, estimates)
    check_files([path for of_truth, paths in runs for path in (of_truth, *paths)])
    names = short_names(estimates)
    settings = options.checked_settings()
    stopwatch, quiet = Stopwatch(), options.output.quiet

    def work() -> Ranked:
        pairs = Pairs(settings, stopwatch, quiet=quiet)
        found, parameters = _outcomes(pairs, runs, solver, per_step=options.per_step)
        # If it was interrupted: the runs that are whole, or what there is of the first.
        whole = max(min(map(len, found)), 1)
        entrants = [
            Entrant(name=name, paths=[paths[k] for _, paths in runs[:whole]], outcomes=mine[:whole])
            for k, (name, mine) in enumerate(zip(names, found, strict=True))
            if mine
        ]
        if len(found[-1]) < len(runs):
            print_notice(
                f"interrupted: {whole} of {len(runs)} runs and {len(entrants)} of {len(names)} "
                "estimates are compared"
            )
        truths = [of_truth for of_truth, _ in runs[:whole]]
        return ranked(entrants, truths, parameters, pairs.warnings)

    return show_ranking(run(work, stopwatch, show=not quiet), options.output)


def ranked(
    entrants: Sequence[Entrant],
    truths: Sequence[str],
    parameters: Metric,
    warnings: list[dict[str, str]],
) -> Ranked:
    """The document of a ranking, its tables, and the costs of the steps."""
    answer = ranking_document(entrants, truths, parameters, warnings)
    best = answer["estimates"][0]["name"]
    tables = {"per_step.csv": csv_text(steps_columns(entrants, best))}
    if answer["pairs"]:
        tables["pairs.csv"] = csv_text(pairs_columns(answer))
    return answer, tables, steps_costs(entrants)


def show_ranking(found: Ranked, output: OutputOptions) -> bool:
    """Print and write a ranking; whether all evaluations did what was asked."""
    answer, tables, (times, costs) = found
    in_order = {item["name"]: costs[item["name"]] for item in answer["estimates"] if costs}
    show(answer, output, tables, lambda: estimate_pictures(in_order, times))
    unfinished = [
        (path, made["status"])
        for item in answer["estimates"]
        for path, made in zip(item["paths"], item["runs"], strict=True)
        if not made["finished"]
    ]
    for text in () if output.quiet else opposed(answer):
        print_notice(text)
    for path, status in unfinished:
        print_notice(f"accuracy not reached: {path}: {status}")
    return not unfinished


def _solver(options: CompareOptions) -> Solver:
    """The one solver of all estimates."""
    solvers = options.make_solvers("certified", str(Sinkhorn.epsilon))
    if len(solvers) > 1:
        raise ConfigError(
            "estimates are compared by one solver: name one, --solvers certified, or sinkhorn with "
            "one --epsilon; several solvers are compared on one estimate, without --against"
        )
    return solvers[0]


def _outcomes(
    pairs: Pairs, runs: Runs, solver: Solver, *, per_step: bool
) -> tuple[list[list[Outcome]], Metric]:
    """Of each estimate what came of its runs, as many as were done; and the parameters."""
    stopwatch, (_, first) = pairs.stopwatch, runs[0]
    found: list[list[Outcome]] = [[] for _ in first]
    count = len(first) * len(runs)
    for done, (k, truth, path) in enumerate(
        (k, truth, path) for truth, paths in runs for k, path in enumerate(paths)
    ):
        if done and stopwatch.progress.stop.is_set():
            break
        with stopwatch.progress.part(path, done, count):
            prepared = pairs.prepared(truth, path, named=count > 1)
            others = None
            if pairs.settings.with_:
                effort = Effort(jobs=solver.jobs, stopwatch=stopwatch)
                others = other_metrics(prepared, pairs.settings.with_, effort)
            result = solve(prepared, solver, stopwatch)
            found[k].append(outcome(result, prepared.moments, per_step=per_step, others=others))
    return found, cast("Metric", result.settings)
