"""``compare a/result.json b/result.json``: saved results in their order; nothing is solved."""

from collections.abc import Sequence
from typing import cast

from tgospa_eval.cli.compare.files import short_names
from tgospa_eval.cli.compare.ranking import ranked, show_ranking
from tgospa_eval.cli.compare.runs import expand, first_file, is_pattern
from tgospa_eval.cli.compare.values import CompareOptions
from tgospa_eval.cli.shared.notices import notifier
from tgospa_eval.common.notices import Notice
from tgospa_eval.comparison.entrants import Entrant, Outcome
from tgospa_eval.comparison.saved import other_parameters, outcomes, shared_metrics
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.records import Metric
from tgospa_eval.results.records import Json
from tgospa_eval.results.saved import MADE_BY, read_result, saved_result
from tgospa_eval.text import quoted

HEAD = ("files", "input", "parameters", "warnings", "with")
"""What is kept of a document beside the costs."""


def are_saved(paths: Sequence[str]) -> bool:
    """Whether these are saved results, or patterns of such, rather than files.

    Raises
    ------
    ConfigError
        Some are and others are not, or it is a single one.
    """
    saved = [_is_saved(path) for path in paths]
    if not any(saved):
        return False
    if not all(saved):
        other, one = paths[saved.index(False)], paths[saved.index(True)]
        raise ConfigError(
            f"{other or quoted(other)}: is no saved result, but {one} is; {MADE_BY}; name results "
            "alone, or the files of truth and estimates alone"
        )
    if len(paths) == 1 and not is_pattern(paths[0]):
        raise ConfigError(f"{paths[0]}: is a single saved result; name those to rank it with")
    return True


def _is_saved(path: str) -> bool:
    name = first_file(path) if is_pattern(path) else path
    return name is not None and saved_result(name) is not None


def compare_saved(paths: tuple[str, ...], options: CompareOptions) -> bool:
    """Rank saved results by their proven brackets; whether all did what was asked of them.

    Raises
    ------
    TgospaError
        A result is wrong, or is of another truth or other parameters than the first.
    """
    options.check_folder()
    runs, names = _runs(paths)
    heads: list[list[Json]] = []
    found: list[list[Outcome]] = []
    for run in runs:
        documents = [read_result(path) for path in run]
        heads.append([{name: item.get(name, {}) for name in HEAD} for item in documents])
        _check(heads[-1], run, heads[0][0], runs[0][0])
        found.append(outcomes(documents, run))
    entrants = [
        Entrant(name=name, paths=[run[k] for run in runs], outcomes=[items[k] for items in found])
        for k, name in enumerate(names)
    ]
    notify = notifier(quiet=options.output.quiet)
    warnings = [
        Notice(**record).about(path)
        for run, items in zip(runs, heads, strict=True)
        for path, item in zip(run, items, strict=True)
        for record in item["warnings"]
    ]
    others, left_out = shared_metrics(heads)
    for notice in (*warnings, *left_out):
        notify(notice)
    parameters = _common([item["parameters"] for items in heads for item in items])
    ranking = ranked(
        entrants, [_truth(items[0]) for items in heads], parameters, [w.record() for w in warnings]
    )
    for item in ranking[0]["estimates"]:
        beside = others[names.index(item["name"])]
        if beside:
            item["with"] = beside
    return show_ranking(ranking, options.output)


def _runs(paths: tuple[str, ...]) -> tuple[list[list[str]], list[str]]:
    """The results of each run, and what each is called.

    Raises
    ------
    ConfigError, InputError
        Patterns do not fit each other, or a result is there twice.
    """
    marked = [is_pattern(path) for path in paths]
    if any(marked) and not all(marked):
        path = paths[marked.index(False)]
        raise ConfigError(f"{path}: has no *, but other results have; it stands for the run")
    runs = [
        [saved_result(path) or path for path in (first, *others)]
        for first, others in expand(paths[0], paths[1:])
    ]
    return runs, short_names(paths if any(marked) else tuple(runs[0]))


def _truth(first: Json) -> str:
    """What the truth of a result is called: its path, or its digest."""
    return first["files"].get("truth") or f"sha256 {first['input']['truth']['sha256']}"


def _check(documents: list[Json], paths: list[str], first: Json, at: str) -> None:
    """Whether results are of the parameters of the first one of all runs.

    Raises
    ------
    ConfigError
        They are not; each that differs with what does.
    """
    faults = [
        f"{path}: cannot be ranked with {at}: {wrong}"
        for path, document in zip(paths, documents, strict=True)
        if (wrong := other_parameters(document, first))
    ]
    if faults:
        raise ConfigError(*faults)


def _common(parameters: list[dict[str, object]]) -> Metric:
    """The parameters that all results have: solvers and units may differ."""
    first, *others = parameters
    shared = {
        name: value
        for name, value in first.items()
        if all(name in other and other[name] == value for other in others)
    }
    return cast("Metric", shared)
