"""From the options of ``compare`` to a document, and the document to stdout and files."""

import glob
import os
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from tgospa_eval import plots
from tgospa_eval.cli.evaluate.run import about, infos, pair_notices, slow_notice, teller
from tgospa_eval.cli.shared.interrupts import undisturbed
from tgospa_eval.cli.shared.places import find_place
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.settings import Settings, make_settings
from tgospa_eval.cli.shared.streams import emit, say
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.cli.shared.writing import Files, write_output
from tgospa_eval.cli.simulate.command import command as simulate
from tgospa_eval.cli.simulate.run import settings as scene_settings
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import counted, natural
from tgospa_eval.comparison.log import Log, machine
from tgospa_eval.comparison.ranking import Entrant, Outcome, outcome, steps_columns, steps_costs
from tgospa_eval.comparison.ranking import document as ranking
from tgospa_eval.comparison.runs import called, check_solvers, takes_long
from tgospa_eval.comparison.solvers import compare_solvers, document
from tgospa_eval.comparison.study import Study, carry_out
from tgospa_eval.comparison.study import document as summary
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.evaluate import solve
from tgospa_eval.evaluation.prepare import Prepared, prepare
from tgospa_eval.formats import ROLES, Reading
from tgospa_eval.plots.comparison import estimate_pictures, solver_pictures, study_pictures
from tgospa_eval.reports.comparison import json_text, render
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.folders import COMPARISON, STUDY, probe_folder
from tgospa_eval.reports.phrases import Json
from tgospa_eval.reports.ranking import opposed, pairs_columns
from tgospa_eval.reports.study import study_report
from tgospa_eval.simulation import COLUMNS
from tgospa_eval.solvers import SOLVERS, Solver, solver_class
from tgospa_eval.solvers.sinkhorn import Sinkhorn
from tgospa_eval.text import quoted

OWN_STEPS = ("estimate", "common")
"""Grids that depend on the estimate. With the others every row of the truth counts for all."""


def compare_files(truth: str, estimate: str, options: dict[str, Any], given: set[str]) -> bool:
    """One pair through several solvers; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    names = options["solvers"]
    solvers = make_solvers(options, ",".join(SOLVERS) if names is None else names)
    check_files([truth, estimate])
    settings = _settings(options)
    stopwatch = Stopwatch()

    def work() -> Json:
        pairs = Pairs(settings, stopwatch, quiet=options["quiet"])
        prepared = pairs.prepared(truth, estimate)
        chosen, left_out = list(solvers), {}
        states = takes_long(prepared)
        if "solvers" not in given and states is not None:
            chosen = [solver for solver in solvers if solver.name != "exact"]
            left_out["exact"] = (
                f"{states:,} reduced states, it would take minutes; --solvers "
                f"{','.join(SOLVERS)} runs it all the same"
            )

        stopwatch.stage = "solve/lp"
        stopwatch.progress.begin(settings.parameters.root)
        found = compare_solvers(prepared, chosen, progress=stopwatch.progress)
        for solver in chosen[len(found.runs) :]:
            name = called(solver.name, getattr(solver, "epsilon", None))
            left_out[name] = "interrupted before its turn"
        once = {
            name: stopwatch.spans.get(span, 0.0)
            for name, span in (
                ("read", "read"),
                ("distances", "distances"),
                ("preparation", "solve/preparation"),
            )
        }
        return document(found, prepared, left_out, once) | {"warnings": pairs.warnings}

    answer = run(work, stopwatch, show=not options["quiet"])
    show(answer, options, {}, solver_pictures)
    if not answer["agree"]:
        say("brackets do not overlap: " + "; ".join(map(" and ".join, answer["contradictions"])))
    unfinished = [made for made in answer["runs"] if not made["finished"]]
    for made in unfinished:
        missed = "" if made["total"] is None else "accuracy not reached: "
        say(f"{missed}{made['name']}: {made['status']}")
    return bool(answer["agree"]) and not unfinished


def compare_estimates(
    truth: str, estimates: tuple[str, ...], options: dict[str, Any], given: set[str]
) -> bool:
    """Rank estimates of one truth, or of that of each run; whether all did what was asked.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    if "epsilon" not in given:
        options = options | {"epsilon": Sinkhorn.epsilon}
    asked = options["solvers"]
    solvers = make_solvers(options, "certified" if asked is None else asked)
    if len(solvers) > 1:
        raise ConfigError(
            "estimates are compared by one solver: name one, --solvers certified, or sinkhorn with "
            "one --epsilon; several solvers are compared on one estimate, without --against"
        )
    if len(estimates) > 1 and options["grid"] in OWN_STEPS:
        raise ConfigError(
            f"--grid {options['grid']}: gives each estimate steps of its own, and one that stops "
            "early leaves out what it misses; to rank estimates choose --grid truth or union"
        )
    runs = expand(truth, estimates)
    check_files([path for of_truth, paths in runs for path in (of_truth, *paths)])
    names = short_names(estimates)
    settings = _settings(options)
    stopwatch = Stopwatch()

    def work() -> tuple[Json, dict[str, str], tuple[list[Any], dict[str, list[float]]]]:
        pairs = Pairs(settings, stopwatch, quiet=options["quiet"])
        found: list[list[Outcome]] = [[] for _ in estimates]
        count = len(estimates) * len(runs)
        for done, (k, of_truth, path) in enumerate(
            (k, of_truth, path) for of_truth, paths in runs for k, path in enumerate(paths)
        ):
            if done and stopwatch.progress.stop.is_set():
                break
            with stopwatch.progress.part(path, done, count):
                prepared = pairs.prepared(of_truth, path, named=count > 1)
                result = solve(prepared, solvers[0], stopwatch)
                found[k].append(
                    outcome(result, prepared.moments, per_step=options["against"] is not None)
                )
        # If it was interrupted: the runs that are whole, or what there is of the first.
        whole = max(min(map(len, found)), 1)
        entrants = [
            Entrant(name=name, paths=[paths[k] for _, paths in runs[:whole]], outcomes=mine[:whole])
            for k, (name, mine) in enumerate(zip(names, found, strict=True))
            if mine
        ]
        if len(found[-1]) < len(runs):
            say(
                f"interrupted: {whole} of {len(runs)} runs and {len(entrants)} of {len(names)} "
                "estimates are compared"
            )
        answer = ranking(entrants, [of_truth for of_truth, _ in runs[:whole]], result.settings)
        answer["warnings"] = pairs.warnings
        best = answer["estimates"][0]["name"]
        tables = {"per_step.csv": csv_text(steps_columns(entrants, best))}
        return answer, tables, steps_costs(entrants)

    answer, tables, (times, costs) = run(work, stopwatch, show=not options["quiet"])
    if answer["pairs"]:
        tables["pairs.csv"] = csv_text(pairs_columns(answer))
    ranked = {item["name"]: costs[item["name"]] for item in answer["estimates"] if costs}
    show(answer, options, tables, lambda _: estimate_pictures(ranked, times))
    unfinished = [
        (path, made["status"])
        for item in answer["estimates"]
        for path, made in zip(item["paths"], item["runs"], strict=True)
        if not made["finished"]
    ]
    for text in () if options["quiet"] else opposed(answer):
        say(text)
    for path, status in unfinished:
        say(f"accuracy not reached: {path}: {status}")
    return not unfinished


def study_sizes(options: dict[str, Any]) -> bool:
    """The scaling study; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        Something is wrong with the options or with the folder.
    """
    folder = options["output"]
    if folder is not None:
        probe_folder(folder, STUDY, force=options["force"])
    names = options["solvers"]
    settings = _make_settings(options)
    chosen = ["--scenario", options["scenario"], "--area", str(options["area"])]
    scene, tracker = scene_settings(simulate.make_context("simulate", ["DIR", *chosen]).params)
    study = Study(
        scene=scene,
        tracker=tracker,
        seed=options["seed"],
        parameters=settings.parameters,
        distance=settings.measure.distance(COLUMNS[scene.state]),
        solvers=make_solvers(options, "certified,sinkhorn" if names is None else names),
        targets=numbers("targets", options["targets"], int),
        steps=numbers("steps", options["steps"], int),
        runs=options["runs"],
    )
    stopwatch = Stopwatch()
    for notice in slow_notice():
        teller(quiet=options["quiet"])(notice)
    with nullcontext() if folder is None else Log(folder, study.settings) as log:

        def work() -> Json:
            def notify(text: str, share: float) -> None:
                stopwatch.stage = text
                stopwatch.progress.done(share)

            known = {} if log is None else log.known
            keep = (lambda _: None) if log is None else log.keep
            return summary(study, carry_out(study, known, keep, notify), machine())

        if not options["quiet"] and log is not None and log.known:
            scenes = counted(len(log.known), "scene is", "scenes are")
            say(f"{log.path}: {scenes} there, going on")
        answer = run(work, stopwatch, show=not options["quiet"])
        show(answer, options, {}, study_pictures)
    for targets, steps, number, *pair in answer["contradictions"]:
        say(
            f"brackets do not overlap: {' and '.join(pair)}, run {number} of {targets} targets, "
            f"{steps} steps"
        )
    made = [made for size in answer["sizes"] for made in size["solvers"]]
    late = sum(item["unfinished"] + item["failed"] for item in made)
    if late:
        say(f"failed, or accuracy not reached: {counted(late, 'run')} of solvers")
    return not answer["contradictions"] and not late


def expand(truth: str, estimates: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """The files of each run: what ``*`` stands for in one pattern stands in all.

    A truth without ``*`` is that of all runs. Names of existing files are no patterns.

    Raises
    ------
    ConfigError, InputError
        A pattern fits nothing, or patterns do not fit each other.
    """
    paths = (truth, *estimates)
    marked = list(map(is_pattern, paths))
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


def is_pattern(path: str) -> bool:
    """Whether ``*`` stands for runs; in the name of a file that exists it stands for itself."""
    return "*" in path and not os.path.exists(path)


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
            raise InputError(place.said)
        if not os.path.lexists(path):
            raise InputError(f"{path or quoted(path)}: no such file")


def _matches(pattern: str) -> list[str]:
    """What ``*`` stands for, in natural order."""
    before, after = pattern.split("*")
    found = glob.glob(f"{glob.escape(before)}*{glob.escape(after)}")
    if not found:
        raise InputError(f"{pattern}: no such files")
    return sorted((path[len(before) : len(path) - len(after)] for path in found), key=natural)


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


def _settings(options: dict[str, Any]) -> Settings:
    """The records that the options ask for; the folder is looked at before any work is done."""
    if options["output"] is not None:
        probe_folder(options["output"], COMPARISON, force=options["force"])
    return _make_settings(options)


def _make_settings(options: dict[str, Any]) -> Settings:
    """Solvers, temperatures and --seed are of other kinds here."""
    shared = {name: value for name, value in options.items() if name not in ("epsilon", "seed")}
    return make_settings(EvaluationOptions.of(shared), OutputOptions.of(options))


class Pairs:
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
        self.notify = teller(quiet=quiet)
        self.shown: set[Notice] = set()
        self.last: tuple[str, Reading] | None = None
        self.warnings: list[dict[str, str]] = []
        if not quiet:
            stopwatch.tell = say
        for notice in slow_notice():
            self._notify_once(notice)

    def prepared(self, truth: str, estimate: str, *, named: bool = False) -> Prepared:
        """The problem of two files; `named` notices say which estimate they are about."""
        with self.stopwatch.span("read"):
            if self.last is None or self.last[0] != truth:
                self.last = truth, self._read(truth, 0)
            sides = self.last[1], self._read(estimate, 1)
        settings, paths = self.settings, (truth, estimate)
        settings.check(sides, paths)
        fitted, request = settings.fit(sides, paths)
        for notice in pair_notices(fitted, request, pixels=any(side.pixels for side in sides)):
            is_default = notice.text.startswith("default ") and not notice.code
            self._notify_once(notice.about(estimate) if named and not is_default else notice)
        return prepare(fitted, request, files=infos(sides), stopwatch=self.stopwatch)

    def _read(self, path: str, side: int) -> Reading:
        found = self.settings.read_side(path, side, ROLES[side])
        for notice in about(path, found):
            self._notify_once(notice)
        return found

    def _notify_once(self, notice: Notice) -> None:
        if notice not in self.shown:
            self.shown.add(notice)
            self.notify(notice)
            if notice.code:
                self.warnings.append(notice.record())


def make_solvers(options: dict[str, Any], names: str) -> list[Solver]:
    """The solvers of a list of names, `sinkhorn` once for each temperature.

    Raises
    ------
    ConfigError
        A name or a number is not known, or one is there twice.
    """
    limits = {"time_limit": options["time_limit"]}
    sweeping = {"gap": options["gap"], "jobs": options["jobs"], **limits}
    solvers: list[Solver] = []
    for name in (part.strip() for part in names.split(",")):
        if name not in SOLVERS:
            raise ConfigError(f"--solvers {quoted(name)}: must be of {', '.join(SOLVERS)}")
        make: Any = solver_class(name)
        if name == "sinkhorn":
            temperatures = numbers("epsilon", str(options["epsilon"]), float)
            solvers += [make(epsilon=epsilon, **sweeping) for epsilon in temperatures]
        else:
            solvers.append(make(**(limits if name == "exact" else sweeping)))
    check_solvers(solvers)
    return solvers


def numbers(option: str, text: str, kind: Any) -> list[Any]:
    """The numbers of a list with commas.

    Raises
    ------
    ConfigError
        One is none.
    """
    found = []
    for part in map(str.strip, text.split(",")):
        try:
            found.append(kind(part))
        except ValueError:
            what = "whole numbers" if kind is int else "numbers"
            raise ConfigError(f"--{option} {quoted(part)}: must be {what} with commas") from None
    return found


def show(
    answer: Json,
    options: dict[str, Any],
    tables: dict[str, str],
    draw: Callable[[Json], dict[str, Any]],
) -> None:
    """Print the document, and write the folder if one was asked for.

    Parameters
    ----------
    answer : dict
        The document.
    options : dict
        Values of the options.
    tables : dict
        Further files by name.
    draw : callable
        Makes figures by name of the document; it is called where matplotlib is there.
    """

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("the pictures", 0.0)
        pictures: dict[str, bytes] = {}
        if plots.available():
            pictures = plots.pictures(draw, answer)
        elif not options["quiet"]:
            say(plots.MISSING)
        files: dict[str, str | bytes] = {
            "compare.json": json_text(answer),
            "compare.csv": render(answer, "csv"),
            **tables,
            **pictures,
        }
        if kind is STUDY:
            names = [name.removesuffix(".png") for name in pictures]
            files["report.md"] = study_report(answer, names)
        return files

    kind = STUDY if answer["kind"] == "study" else COMPARISON
    try:
        with undisturbed():
            emit(render(answer, options["format_"]), options["format_"])
    finally:  # the one is not lost where the other fails
        write_output(OutputOptions.of(options), kind, make)
