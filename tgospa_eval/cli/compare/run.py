"""``compare``: rankings, comparisons of solvers and scaling studies, with their output."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, TypeVar

from tgospa_eval.api.compare import Compared, PairReader, Ranked, rank_saved, ranked, solvers_on
from tgospa_eval.api.notices import slow_notice
from tgospa_eval.api.options import Request
from tgospa_eval.api.reading import find_place
from tgospa_eval.api.resolve import resolve_request
from tgospa_eval.campaign import solver_runs
from tgospa_eval.campaign.pairs import compared_runs, short_names
from tgospa_eval.cli.shared.click_builder import OutputOptions
from tgospa_eval.cli.shared.progress import new_stopwatch, run
from tgospa_eval.cli.shared.streams import emit, notifier, print_notice, shielded
from tgospa_eval.cli.shared.writing import drawable_pictures, probed, write_output
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted, parsed, parsed_whole
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.guess import file_of
from tgospa_eval.quoting import quoted
from tgospa_eval.results.records import Json, json_text
from tgospa_eval.show.chart_list import pictures
from tgospa_eval.show.comparison import page, pairs_columns, render, study_report
from tgospa_eval.show.files import COMPARISON, STUDY, Files
from tgospa_eval.show.html import document_page
from tgospa_eval.show.table_text import csv_text
from tgospa_eval.simulation import COLUMNS, Scene
from tgospa_eval.simulation.settings import default_tracker
from tgospa_eval.solvers import SOLVERS, Solver, solver_class
from tgospa_eval.solvers.sinkhorn import Sinkhorn

Number = TypeVar("Number", int, float)

MakeSolvers = Callable[..., list[Solver]]
"""Function that calls `make_solvers` with the options of the user. Its arguments are `names` and
`temperatures`, the defaults."""

TEMPERATURES = "0.1,0.05,0.03,0.01"
"""Default temperatures of the solver ``sinkhorn``."""


def show(
    answer: Json,
    output: OutputOptions,
    subject: Any = None,
    tables: Callable[[], Mapping[str, str]] = dict,
) -> None:
    """Print a comparison, and write the folder of ``-o`` if requested.

    Parameters
    ----------
    answer : dict
        JSON document of the comparison.
    output : OutputOptions
        What to print, and where to write.
    subject : object, optional
        Data of the pictures; by default the document.
    tables : callable
        Function that returns the content of further files by name.
    """
    kind = STUDY if answer["kind"] == "study" else COMPARISON
    answer |= settings_field(output.config)

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("the pictures", 0.0)
        of, wanted = (
            (answer["kind"], answer if subject is None else subject),
            drawable_pictures(output),
        )
        shown = {} if wanted is None else pictures(*of, wanted)
        files: dict[str, str | bytes] = {
            "compare.json": json_text(answer),
            "compare.csv": render(answer, "csv"),
            "report.html": document_page(
                page(answer, output.columns_of_table), *of, draws=wanted is not None
            ),
            **tables(),
            **shown,
        }
        if answer["kind"] == "study":
            files["report.md"] = study_report(answer, shown)
        return files

    try:
        with shielded():
            emit(render(answer, output.format_, output.columns_of_table), output.format_)
    finally:  # the folder is written even if stdout cannot be written
        write_output(output, kind, make)


def make_solvers(
    request: Request,
    requested: str | None,
    epsilon: str | None,
    names: str,
    temperatures: str = TEMPERATURES,
) -> list[Solver]:
    """Return the requested solvers, by default those in `names`.

    The solver ``sinkhorn`` is returned once for each temperature. Temperatures are those in
    `epsilon`, by default those in `temperatures`. All arguments but the first are texts with
    commas.

    Raises
    ------
    ConfigError
        A solver is unknown, a temperature is not a number, or a solver or temperature is repeated.
    """
    limits = {"time_limit": request.time_limit}
    sweeping = {"gap": request.gap, "jobs": request.jobs, **limits}
    solvers: list[Solver] = []
    for name in (part.strip() for part in (names if requested is None else requested).split(",")):
        if name not in SOLVERS:
            raise ConfigError(f"--solvers {quoted(name)}: must be of {', '.join(SOLVERS)}")
        make: Callable[..., Solver] = solver_class(name)
        if name == "sinkhorn":
            given = numbers("epsilon", temperatures if epsilon is None else epsilon, parsed)
            solvers += [make(epsilon=temperature, **sweeping) for temperature in given]
        else:
            solvers.append(make(**(limits if name == "exact" else sweeping)))
    solver_runs.check_solvers(solvers)
    return solvers


def numbers(option: str, text: str, parse: Callable[[str], Number | None]) -> list[Number]:
    """Parse a text of numbers with commas; `option` is the name of the option, for messages.

    Raises
    ------
    ConfigError
        `parse` does not accept a part between commas.
    """
    values: list[Number] = []
    for part in map(str.strip, text.split(",")):
        number = parse(part)
        if number is None:
            what = "whole numbers" if parse is parsed_whole else "numbers"
            raise ConfigError(f"--{option} {quoted(part)}: must be {what} with commas")
        values.append(number)
    return values


def pair_reader(request: Request, output: OutputOptions, paths: Iterable[str]) -> PairReader:
    """Check that all files exist and that the folder can be written; return the reader of pairs.

    Raises
    ------
    TgospaError
        A file is missing or is a folder, the folder cannot be written, or an option does not apply.
    """
    for path in paths:
        place = find_place(path)
        if place is not None:
            raise InputError(place[0])
        if path != STDIN and not os.path.lexists(file_of(path)):
            raise InputError(f"{path or quoted(path)}: no such file")
    probed(output, COMPARISON, "solvers", "estimates")
    stopwatch = new_stopwatch(quiet=output.quiet)
    return PairReader(resolve_request(request), stopwatch, notifier(quiet=output.quiet))


# -------------------------------------------------------------------------------------------------
# Rankings: of estimates of one truth, of several runs, and of saved results.


def compare_estimates(
    files: Sequence[str],
    request: Request,
    output: OutputOptions,
    make: MakeSolvers,
    *,
    per_step: bool,
) -> bool:
    """Rank estimates of one truth, or of a truth for each run.

    Return whether all evaluations reached the requested accuracy.

    Raises
    ------
    TgospaError
        An option does not apply, or a file cannot be read.
    """
    solver, *rest = make("certified", str(Sinkhorn.epsilon))
    if rest:
        raise ConfigError(
            "estimates are ranked with one solver: give --solvers certified, or sinkhorn with one "
            "--epsilon; to compare several solvers, name one estimate and leave out --against"
        )
    runs, estimates, notices = compared_runs(files[0], files[1:], output.output)
    for text in () if output.quiet else notices:
        print_notice(text)
    pairs = pair_reader(request, output, (path for truth, own in runs for path in (truth, *own)))
    names = short_names(estimates)

    def work() -> Ranked:
        with_ = pairs.settings.evaluation.with_
        ranking = ranked(pairs, runs, names, solver, per_step=per_step, with_=with_)
        whole, some = ranking[0]["runs"], len(ranking[1])
        if whole < len(runs) or some < len(names):
            print_notice(
                f"interrupted: {whole} of {len(runs)} runs and {some} of {len(names)} "
                "estimates are compared"
            )
        return ranking

    return show_ranking(run(work, pairs.stopwatch, show=not output.quiet), output)


def compare_saved(files: Sequence[str], output: OutputOptions) -> bool:
    """Rank saved results by their proven brackets; return whether all had reached the accuracy."""
    probed(output, COMPARISON, "estimates")
    return show_ranking(rank_saved(files, notifier(quiet=output.quiet)), output)


def show_ranking(ranking: Ranked, output: OutputOptions) -> bool:
    """Print and write a ranking; return whether all evaluations reached the requested accuracy."""
    answer, entrants = ranking
    compared = Compared(document=answer, entrants=entrants)

    def tables() -> dict[str, str]:
        files = {"per_step.csv": csv_text(compared.curves_columns())}
        return files | ({"pairs.csv": csv_text(pairs_columns(answer))} if answer["pairs"] else {})

    show(answer, output, compared.plot_data, tables)
    unfinished = [
        f"{path}: {made['status']}"
        for item in answer["estimates"]
        for path, made in zip(item["paths"], item["runs"], strict=True)
        if not made["finished"]
    ]
    for text in unfinished:
        print_notice(f"accuracy not reached: {text}")
    return not unfinished


# -------------------------------------------------------------------------------------------------
# ``compare TRUTH ESTIMATE``: several solvers on one pair of files.


def compare_files(
    files: Sequence[str],
    request: Request,
    output: OutputOptions,
    make: MakeSolvers,
    *,
    spare: bool,
) -> bool:
    """Compare several solvers on one pair of files.

    Return whether all reached the requested accuracy and their brackets overlap. With `spare`, the
    solver ``exact`` is left out if it may take minutes.

    Raises
    ------
    TgospaError
        An option does not apply, or a file cannot be read.
    """
    chosen = make(",".join(SOLVERS))
    pairs = pair_reader(request, output, files)
    answer = run(
        lambda: solvers_on(pairs, files[0], files[1], chosen, spare=spare),
        pairs.stopwatch,
        show=not output.quiet,
    )
    show(answer, output)
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
# ``compare --simulate``: the scaling study, which runs solvers on simulated scenes of many sizes.


def study_sizes(
    request: Request,
    output: OutputOptions,
    make: MakeSolvers,
    *,
    targets: str,
    steps: str,
    runs: int,
    scenario: str,
    area: float,
    seed: int,
) -> bool:
    """Run the scaling study, print and write it.

    Return whether all evaluations reached the requested accuracy and their brackets overlap.
    `targets` and `steps` are texts of numbers with commas. The simulated tracker has the default
    errors of ``simulate``.

    Raises
    ------
    TgospaError
        An option does not apply, or the folder has another study or cannot be written.
    """
    folder, quiet = output.output, output.quiet
    probed(output, STUDY, "study")
    settings = resolve_request(request)
    scene = Scene(scenario=scenario, area=area)
    study = solver_runs.Study(
        scene=scene,
        tracker=default_tracker(scene.area, {}),
        seed=seed,
        parameters=settings.evaluation.parameters,
        distance=settings.measure.distance(COLUMNS[scene.state]),
        solvers=make("certified,sinkhorn"),
        targets=numbers("targets", targets, parsed_whole),
        steps=numbers("steps", steps, parsed_whole),
        runs=runs,
    )
    stopwatch = Stopwatch()
    for notice in slow_notice():
        notifier(quiet=quiet)(notice)
    nothing = nullcontext[tuple[solver_runs.Scenes, solver_runs.Keep]](({}, lambda _: None))
    with nothing if folder is None else solver_runs.opened(folder, study) as (known, keep):

        def work() -> Json:
            def notify(text: str, share: float) -> None:
                stopwatch.stage = text
                stopwatch.progress.done(share)

            return solver_runs.study_document(
                study, solver_runs.carry_out(study, known, keep, notify), solver_runs.machine()
            )

        if not quiet and known:
            print_notice(
                f"{folder}: {counted(len(known), 'scene is', 'scenes are')} finished, resuming"
            )
        answer = run(work, stopwatch, show=not quiet)
        show(answer, output)
    for size, length, number, *pair in answer["contradictions"]:
        print_notice(
            f"brackets do not overlap: {' and '.join(pair)}, run {number} of {size} targets, "
            f"{length} steps"
        )
    made = [made for size in answer["sizes"] for made in size["solvers"]]
    late = sum(item["unfinished"] + item["failed"] for item in made)
    if late:
        print_notice(f"failed, or accuracy not reached: {counted(late, 'run')} of solvers")
    return not answer["contradictions"] and not late
