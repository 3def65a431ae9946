"""A comparison to stdout, and to the folder that was asked for."""

import glob
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Self, TypeVar, cast

from tgospa_eval import plots
from tgospa_eval.api.notices import about, pair_notices, slow_notice
from tgospa_eval.api.places import find_place
from tgospa_eval.api.request import Request, Values
from tgospa_eval.api.settings import Settings, infos, make_settings
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import emit, notifier, print_notice, undisturbed
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import write_output
from tgospa_eval.common import patterns
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted, natural, parsed, parsed_whole
from tgospa_eval.comparison.entrants import (
    Entrant,
    EntrantOutcome,
    check_solvers,
    name_of,
    outcome,
    takes_long,
)
from tgospa_eval.comparison.ranking import (
    StepCosts,
    other_parameters,
    outcomes,
    ranking_document,
    shared_metrics,
    steps_columns,
    steps_costs,
)
from tgospa_eval.comparison.solvers import ONCE, compare_solvers, solvers_document
from tgospa_eval.comparison.study import Log, Study, carry_out, machine, study_document
from tgospa_eval.distances import Effort
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.evaluate import solve
from tgospa_eval.evaluation.other_metrics import other_metrics
from tgospa_eval.evaluation.prepare import Prepared, prepare
from tgospa_eval.formats import ROLES, Reading, runs_inside
from tgospa_eval.formats.guess import file_of
from tgospa_eval.plots.comparison import estimate_pictures, solver_pictures, study_pictures
from tgospa_eval.reports.comparison import opposed, pairs_columns, render, study_report
from tgospa_eval.reports.files import COMPARISON, STUDY, Files, csv_text, probe_folder
from tgospa_eval.reports.records import (
    Comparison,
    Metric,
    RankingRecord,
    SolversRecord,
    StudyRecord,
)
from tgospa_eval.results.records import Json, json_text
from tgospa_eval.results.saved import MADE_BY, read_result, saved_result
from tgospa_eval.simulation import COLUMNS, Scene
from tgospa_eval.simulation.settings import usual_tracker
from tgospa_eval.solvers import SOLVERS, Solver, solver_class
from tgospa_eval.solvers.sinkhorn import Sinkhorn
from tgospa_eval.text import quoted


def show(
    answer: Comparison, output: OutputOptions, tables: Mapping[str, str], draw: plots.Draw
) -> None:
    """Print the document, and write the folder if one was asked for.

    Parameters
    ----------
    answer : dict
        The document.
    output : OutputOptions
        What to print, and where to write.
    tables : mapping of str to str
        Further files by name.
    draw : callable
        Makes figures by name; it is called where matplotlib is there.
    """
    kind = STUDY if answer["kind"] == "study" else COMPARISON
    if output.config is not None:
        answer["settings_file"] = output.config.record()

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("the pictures", 0.0)
        pictures: dict[str, bytes] = {}
        if plots.available():
            pictures = plots.pictures(draw)
        elif not output.quiet:
            print_notice(plots.MISSING)
        files: dict[str, str | bytes] = {
            "compare.json": json_text(answer),
            "compare.csv": render(answer, "csv"),
            **tables,
            **pictures,
        }
        if answer["kind"] == "study":
            names = [name.removesuffix(".png") for name in pictures]
            files["report.md"] = study_report(answer, names)
        return files

    try:
        with undisturbed():
            emit(render(answer, output.format_), output.format_)
    finally:  # the one is not lost where the other fails
        write_output(output, kind, make)


# -------------------------------------------------------------------------------------------------
# Patterns that stand for several runs, and for several estimates: ``*``, or fields in braces.

Runs = list[tuple[str, list[str]]]
"""The truth of each run, and its estimates."""

AS_FIELD = "{run}"
"""What * is as a field."""


def is_pattern(path: str) -> bool:
    """Whether it stands for several files; the name of a file that exists stands for itself."""
    return ("*" in path or bool(patterns.fields(path))) and not os.path.exists(path)


def first_file(pattern: str) -> str | None:
    """The first that a pattern stands for."""
    if _fields(pattern):
        return next((name for name, _ in patterns.found(pattern, inside=runs_inside)), None)
    before, after = pattern.split("*", 1)
    return min(glob.glob(f"{glob.escape(before)}*{glob.escape(after)}"), default=None)


def each_estimate(
    truth: str, estimates: tuple[str, ...], output: str | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The estimates, one for each value of the fields that the truth does not have, and notices.

    Nothing in the folder of `output` is one.

    Raises
    ------
    InputError
        No file is like a pattern, or a name would be one.
    """
    own = _fields(truth)
    found: list[str] = []
    told = _hidden(truth)
    for path in estimates:
        others = [name for name in _fields(path) if name not in own]
        if not others:
            found.append(path)
            told |= _hidden(path)
            continue
        meant = patterns.meant(path, output=output, truth=(truth, ""), inside=runs_inside)
        told |= {
            why if why == patterns.DOTTED else text: text for why, text in meant.notices.items()
        }
        groups = {tuple(values[name] for name in others) for values in _values(path, meant)}
        for text in itertools.chain(*groups):
            if own and patterns.fields(text):
                raise InputError(f"{path}: fits {text}, which is like a field itself; rename that")
        kept = {name: f"{{{name}}}" for name in own}
        found += [
            patterns.fill(path, kept | dict(zip(others, group, strict=True)))
            for group in sorted(groups, key=lambda group: tuple(map(natural, group)))
        ]
    return tuple(found), tuple(told.values())


def expand(truth: str, estimates: tuple[str, ...]) -> Runs:
    """The files of each run: what ``*``, or a field, stands for in one pattern stands in all.

    A truth without one is that of all runs. Names of existing files are no patterns.

    Raises
    ------
    ConfigError, InputError
        A pattern fits nothing, or patterns do not fit each other.
    """
    paths = (truth, *estimates)
    with_fields = [path for path in paths if _fields(path)]
    marked = [is_pattern(path) and path not in with_fields for path in paths]
    if with_fields and any(marked):
        star = next(path for path, is_marked in zip(paths, marked, strict=True) if is_marked)
        raise ConfigError(f"{star}: has a *, and {with_fields[0]} has fields; choose one of them")
    if with_fields:
        return _of_fields(truth, estimates)
    if not any(marked):
        return [(truth, list(estimates))]
    for path, is_marked in zip(paths, marked, strict=True):
        if path.count("*") > 1 and is_marked:
            raise ConfigError(f"{path}: one * is needed, it stands for the run")
        if not is_marked and path != truth:
            raise ConfigError(f"{path}: has no *, but other files have; it stands for the run")
    keys = [_matches(path) for path, is_marked in zip(paths, marked, strict=True) if is_marked]
    for path, own in zip([p for p, m in zip(paths, marked, strict=True) if m], keys, strict=True):
        lacking = next((key for key in keys[0] if key not in own), None)
        if lacking is not None:
            raise InputError(f"{path.replace('*', lacking)}: no such file; other patterns have it")
        extra = next((key for key in own if key not in keys[0]), None)
        if extra is not None:
            raise InputError(f"{path.replace('*', extra)}: has no counterpart in other patterns")
    return [
        (truth.replace("*", key) if marked[0] else truth, [p.replace("*", key) for p in estimates])
        for key in keys[0]
    ]


def _of_fields(truth: str, estimates: tuple[str, ...]) -> Runs:
    """The files of each run, which is what the fields of the truth stand for."""
    own = _fields(truth)
    for path in estimates:
        lacking = [name for name in own if name not in _fields(path)]
        if lacking:
            raise ConfigError(
                f"{path}: has no {{{lacking[0]}}}, but {truth} has; it stands for the run"
            )
    runs = sorted(_values(truth), key=lambda values: [natural(values[name]) for name in own])
    for path in estimates:
        there = list(_values(path))
        for values in runs:
            if values not in there:
                name = patterns.fill(path, values)
                raise InputError(f"{name}: no such file; other patterns have it")
        for values in there:
            if values not in runs:
                name = patterns.fill(path, values)
                raise InputError(f"{name}: has no counterpart in other patterns")
    return [
        (patterns.fill(truth, values), [patterns.fill(path, values) for path in estimates])
        for values in runs
    ]


def _fields(path: str) -> list[str]:
    """The fields of a pattern; the name of a file that exists has none."""
    return patterns.fields(path) if is_pattern(path) else []


def _hidden(pattern: str) -> dict[str, str]:
    """A notice of the names behind a dot that a pattern passes over: runs are the same in all."""
    if not is_pattern(pattern):
        return {}
    star = not _fields(pattern)
    meant = patterns.meant(pattern.replace("*", AS_FIELD) if star else pattern, inside=runs_inside)
    found = {why: text for why, text in meant.notices.items() if why == patterns.DOTTED}
    return {why: text.replace(AS_FIELD, "*") if star else text for why, text in found.items()}


def _values(pattern: str, meant: patterns.Meant | None = None) -> Iterator[Mapping[str, str]]:
    """What the fields stand for in each file: in all that are like the pattern, or in these.

    Raises
    ------
    InputError
        No file is like the pattern, or one is in two ways.
    """
    found = list(patterns.found(pattern, inside=runs_inside)) if meant is None else meant.files
    if not found:
        raise InputError(f"{pattern}: no such files", *(meant.notices.values() if meant else ()))
    for path, values in found:
        if patterns.is_ambiguous(pattern, path):
            raise InputError(f"{path}: the fields of {pattern} fit it in two ways")
        yield values


def _matches(pattern: str) -> list[str]:
    """What ``*`` stands for, in natural order."""
    before, after = pattern.split("*")
    found = glob.glob(f"{glob.escape(before)}*{glob.escape(after)}")
    if not found:
        raise InputError(f"{pattern}: no such files")
    return sorted((path[len(before) : len(path) - len(after)] for path in found), key=natural)


# -------------------------------------------------------------------------------------------------
# Options of ``compare`` as records, and the solvers that they name.

Number = TypeVar("Number", int, float)

TEMPERATURES = "0.1,0.05,0.03,0.01"
"""Of sinkhorn where none are given."""


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Values):
    """What to compare, how to evaluate it, and where to write.

    Parameters
    ----------
    evaluation, output : Request, OutputOptions
        As of everything that evaluates.
    solvers : str, optional
        Names with commas; None where none were given.
    epsilon : str, optional
        Temperatures with commas; None where none were given.
    against : str, optional
        The metric that is shown beside TGOSPA.
    """

    evaluation: Request
    output: OutputOptions
    solvers: str | None
    epsilon: str | None
    against: str | None

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Self:
        """From all options of the verb; temperatures and --seed are of other kinds here."""
        shared = {name: value for name, value in values.items() if name not in ("epsilon", "seed")}
        evaluation, output = Request.of(shared), OutputOptions.of(values)
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


# -------------------------------------------------------------------------------------------------
# The files of a comparison: short names, pairs as problems.


def check_files(paths: Sequence[str]) -> None:
    """See that all are there before any is read.

    Raises
    ------
    InputError
        One is missing, or a folder.
    """
    for path in paths:
        place = find_place(path)
        if place is not None:
            raise InputError(place.message)
        if path != STDIN and not os.path.lexists(file_of(path)):
            raise InputError(f"{path or quoted(path)}: no such file")


def short_names(paths: tuple[str, ...]) -> list[str]:
    """What each file is called: that part of its path in which it differs from the others.

    Raises
    ------
    ConfigError
        A file is there twice.
    """
    seen: dict[str, str] = {}
    for path in paths:
        other = seen.setdefault(os.path.realpath(path), path)
        if other != path:
            raise ConfigError(f"{path}: is the same as {other}; name each estimate once")
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ConfigError(f"{twice}: is given twice")
    parts = [Path(path).with_suffix("").parts for path in paths]
    if len(paths) == 1:
        return [parts[0][-1]]
    names = ["/".join(part) for part in _without_common(_without_common(parts, 1), -1)]
    return names if len(set(names)) == len(names) and all(names) else list(paths)


def _without_common(parts: list[tuple[str, ...]], step: int) -> list[tuple[str, ...]]:
    """Without what is the same in all, at the beginning (1) or at the end (-1)."""
    turned = [part[::step] for part in parts]
    same = 0
    for level in zip(*turned, strict=False):
        if len(set(level)) > 1:
            break
        same += 1
    return [part[same:][::step] for part in turned]


class FilePairs:
    """Pairs of files, read and made problems of; a truth is read once.

    Parameters
    ----------
    settings : Settings
        How to read, and the metric.
    quiet : bool
        Whether notices are left out.
    stopwatch : Stopwatch
        Gets the time by stage.
    """

    def __init__(self, settings: Settings, stopwatch: Stopwatch, *, quiet: bool) -> None:
        self.settings, self.stopwatch = settings, stopwatch
        self.notify = notifier(quiet=quiet)
        self.shown: set[Notice] = set()
        self.last: tuple[str, Reading] | None = None
        self.warnings: list[dict[str, str]] = []
        if not quiet:
            stopwatch.notify = print_notice
        for notice in slow_notice():
            self._notify_once(notice)

    def prepared(self, truth: str, estimate: str, *, named: bool = False) -> Prepared:
        """The problem of two files; `named` notices name the estimate they are about."""
        settings, paths = self.settings, (truth, estimate)
        with self.stopwatch.span("read"):
            if self.last is None or self.last[0] != truth:
                self.last = truth, self._read(truth, 0, paths)
            sides: tuple[Reading, ...] = (self.last[1], self._read(estimate, 1, paths))
        settings.check(sides, paths)
        if settings.preprocess or settings.evaluation.with_:
            sides = settings.preprocessed(sides, paths)
            for path, side in zip(paths, sides, strict=True):
                for notice in about(path, side):
                    self._notify_once(notice)
        fitted, request = settings.fit(sides, paths)
        for notice in pair_notices(fitted, request, sides):
            is_default = notice.text.startswith("default ") and not notice.code
            self._notify_once(notice.about(estimate) if named and not is_default else notice)
        return prepare(fitted, request, files=infos(sides), stopwatch=self.stopwatch)

    def _read(self, path: str, side: int, paths: tuple[str, str]) -> Reading:
        found = self.settings.read_side(path, side, ROLES[side], paths)
        for notice in about(path, found):
            self._notify_once(notice)
        return found

    def _notify_once(self, notice: Notice) -> None:
        if notice not in self.shown:
            self.shown.add(notice)
            self.notify(notice)
            if notice.code:
                self.warnings.append(notice.record())


# -------------------------------------------------------------------------------------------------
# ``compare TRUTH A B``: estimates of one truth, or of that of each run, in their order.

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
        pairs = FilePairs(settings, stopwatch, quiet=quiet)
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
    pairs: FilePairs, runs: Runs, solver: Solver, *, per_step: bool
) -> tuple[list[list[EntrantOutcome]], Metric]:
    """Of each estimate what came of its runs, as many as were done; and the parameters."""
    stopwatch, (_, first) = pairs.stopwatch, runs[0]
    found: list[list[EntrantOutcome]] = [[] for _ in first]
    count = len(first) * len(runs)
    for done, (k, truth, path) in enumerate(
        (k, truth, path) for truth, paths in runs for k, path in enumerate(paths)
    ):
        if done and stopwatch.progress.stop.is_set():
            break
        with stopwatch.progress.part(path, done, count):
            prepared = pairs.prepared(truth, path, named=count > 1)
            others = None
            if pairs.settings.evaluation.with_:
                effort = Effort(jobs=solver.jobs, stopwatch=stopwatch)
                others = other_metrics(prepared, pairs.settings.evaluation.with_, effort)
            result = solve(prepared, solver, stopwatch)
            found[k].append(outcome(result, prepared.moments, per_step=per_step, others=others))
    return found, cast("Metric", result.settings)


# -------------------------------------------------------------------------------------------------
# ``compare a/result.json b/result.json``: saved results in their order; nothing is solved.

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
    found: list[list[EntrantOutcome]] = []
    for group in runs:
        documents = [read_result(path) for path in group]
        heads.append([{name: item.get(name, {}) for name in HEAD} for item in documents])
        _check(heads[-1], group, heads[0][0], runs[0][0])
        found.append(outcomes(documents, group))
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


# -------------------------------------------------------------------------------------------------
# ``compare TRUTH ESTIMATE``: one pair of files through several solvers.


def compare_files(truth: str, estimate: str, options: CompareOptions) -> bool:
    """One pair through several solvers; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        An option has no meaning, or a file cannot be read.
    """
    solvers = options.make_solvers(",".join(SOLVERS))
    check_files([truth, estimate])
    settings = options.checked_settings()
    stopwatch, quiet = Stopwatch(), options.output.quiet

    def work() -> SolversRecord:
        pairs = FilePairs(settings, stopwatch, quiet=quiet)
        prepared = pairs.prepared(truth, estimate)
        chosen, left_out = list(solvers), {}
        states = takes_long(prepared)
        if options.solvers is None and states is not None:
            chosen = [solver for solver in solvers if not solver.referee]
            reason = f"{states:,} reduced states, it would take minutes; --solvers "
            reason += f"{','.join(SOLVERS)} runs it all the same"
            left_out = {solver.name: reason for solver in solvers if solver.referee}
        stopwatch.stage = "solve/lp"
        stopwatch.progress.begin(settings.evaluation.parameters.root)
        found = compare_solvers(prepared, chosen, progress=stopwatch.progress)
        for solver in chosen[len(found.runs) :]:
            left_out[name_of(solver)] = "interrupted before its turn"
        once = {name: stopwatch.spans.get(span, 0.0) for name, span in ONCE.items()}
        return solvers_document(found, prepared, left_out, once, pairs.warnings)

    answer = run(work, stopwatch, show=not quiet)
    show(answer, options.output, {}, lambda: solver_pictures(answer))
    if not answer["agree"]:
        print_notice(
            "brackets do not overlap: " + "; ".join(map(" and ".join, answer["contradictions"]))
        )
    unfinished = [made for made in answer["runs"] if not made["finished"]]
    for made in unfinished:
        missed = "" if made["total"] is None else "accuracy not reached: "
        print_notice(f"{missed}{made['name']}: {made['status']}")
    return answer["agree"] and not unfinished


# -------------------------------------------------------------------------------------------------
# ``compare --simulate``: the scaling study, solvers on simulated scenes of many sizes.


def study_sizes(options: CompareOptions, sizes: StudyOptions) -> bool:
    """The scaling study; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        An option has no meaning, or the folder is of another study or cannot be written.
    """
    folder, quiet = options.output.output, options.output.quiet
    if folder is not None:
        probe_folder(folder, STUDY, force=options.output.force)
    study = _study(options, sizes)
    stopwatch = Stopwatch()
    for notice in slow_notice():
        notifier(quiet=quiet)(notice)
    with nullcontext() if folder is None else Log(folder, study.settings) as log:

        def work() -> StudyRecord:
            def notify(text: str, share: float) -> None:
                stopwatch.stage = text
                stopwatch.progress.done(share)

            known = {} if log is None else log.known
            keep = (lambda _: None) if log is None else log.keep
            return study_document(study, carry_out(study, known, keep, notify), machine())

        if not quiet and log is not None and log.known:
            scenes = counted(len(log.known), "scene is", "scenes are")
            print_notice(f"{log.path}: {scenes} there, going on")
        answer = run(work, stopwatch, show=not quiet)
        show(answer, options.output, {}, lambda: study_pictures(answer))
    for targets, steps, number, *pair in answer["contradictions"]:
        print_notice(
            f"brackets do not overlap: {' and '.join(pair)}, run {number} of {targets} targets, "
            f"{steps} steps"
        )
    made = [made for size in answer["sizes"] for made in size["solvers"]]
    late = sum(item["unfinished"] + item["failed"] for item in made)
    if late:
        print_notice(f"failed, or accuracy not reached: {counted(late, 'run')} of solvers")
    return not answer["contradictions"] and not late


def _study(options: CompareOptions, sizes: StudyOptions) -> Study:
    """What is to be done; the tracker is the one that ``simulate`` has by default."""
    settings = options.settings()
    scene = Scene(scenario=sizes.scenario, area=sizes.area)
    return Study(
        scene=scene,
        tracker=usual_tracker(scene.area, {}),
        seed=sizes.seed,
        parameters=settings.evaluation.parameters,
        distance=settings.measure.distance(COLUMNS[scene.state]),
        solvers=options.make_solvers("certified,sinkhorn"),
        targets=numbers("targets", sizes.targets, parsed_whole),
        steps=numbers("steps", sizes.numbers, parsed_whole),
        runs=sizes.runs,
    )
