"""``evaluate`` of data in parts: what has no place there, progress, Ctrl-C, the result."""

import os
from dataclasses import replace

from tgospa_eval.api.notices import about_defaults
from tgospa_eval.api.options import DEFAULTS, FITTING, SETTINGS, Request
from tgospa_eval.api.resolve import make_settings
from tgospa_eval.cli.evaluate.in_parts import memory_of
from tgospa_eval.cli.evaluate.run import about_run, show
from tgospa_eval.cli.evaluate.work import identity_of, work_folder
from tgospa_eval.cli.shared.click_options import OutputOptions
from tgospa_eval.cli.shared.progress import bracket, new_stopwatch, shown
from tgospa_eval.cli.shared.streams import notifier, print_notice
from tgospa_eval.cli.shared.writing import probed_folder
from tgospa_eval.common.machine import cores
from tgospa_eval.common.progress import Progress
from tgospa_eval.engines.processes import engine_of
from tgospa_eval.errors import ConfigError
from tgospa_eval.partitioned.evaluate import evaluate_partitioned
from tgospa_eval.reports.files import WORK_FOLDER
from tgospa_eval.results.partitioned import IN_PARTS, STORED_TABLES, name_of

TABLE_FILES = (*map(name_of, STORED_TABLES[:-1]), f"{IN_PARTS}/part-00000.parquet")
"""Names in the folder of -o that must not be of others."""

UNKNOWN_MEMORY = 2 * 10**9
"""Bytes that are taken where the system does not say how much there is."""


def check_parts(options: Request, output: OutputOptions, why: str, *, sweep: bool) -> None:
    """See that nothing is asked for that needs all data in memory.

    Parameters
    ----------
    options, output : Request, OutputOptions
        What is asked for.
    why : str
        Why the data are read in parts.
    sweep : bool
        Whether several values of a parameter are asked for.

    Raises
    ------
    ConfigError
        Something is.
    """
    asked = [
        (about.key, about.parts)
        for name, about in SETTINGS.items()
        if about.parts and getattr(options, name) != DEFAULTS[name]
    ]
    if output.proof:
        asked.append(("proof", FITTING))
    if output.plane is not None:
        asked.append(("plane", "leave it out: there is no picture of trajectories"))
    if sweep:
        asked.append(("sweep", "evaluate for one value after the other"))
    if options.distance == "cloud-wasserstein":
        asked.append(("distance cloud-wasserstein", "compare means, by another --distance"))
    for name, advice in asked[:1]:
        raise ConfigError(f"--{name} has no place where data are read in parts, as {why}: {advice}")


def evaluate_parts(
    paths: tuple[str, str], options: Request, output: OutputOptions, why: str
) -> bool:
    """Evaluate data in parts, print and write; whether the asked accuracy was reached.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate.
    options, output : Request, OutputOptions
        What is asked for; `check_parts` found it possible.
    why : str
        Why the data are read in parts.

    Raises
    ------
    TgospaError
        Something is wrong with options or data.
    """
    settings = make_settings(options)
    if output.output is not None:
        probed_folder(output.output, options, output, TABLE_FILES)
    stopwatch = new_stopwatch(quiet=output.quiet)
    if not output.quiet:
        print_notice(f"{why}: it is read in parts")
        for text in about_defaults(options, boxes=False):
            print_notice(text)
    jobs = 1 if options.scheduler else options.jobs or cores()
    spread = bool(options.scheduler) or jobs > 1
    with work_folder(output, identity_of(paths, options)) as work:
        try:
            with shown(stopwatch, show=not output.quiet):
                result = evaluate_partitioned(
                    paths,
                    settings.each,
                    settings.request,
                    work=work,
                    memory=memory_of(options.memory) or UNKNOWN_MEMORY,
                    jobs=jobs,
                    engine=engine_of(options.scheduler, jobs) if spread else None,
                    kept=output.output is not None,
                    stopwatch=stopwatch,
                    check=settings.check,
                )
        except KeyboardInterrupt:
            print_notice(_interrupted(stopwatch.progress, output))
            raise
        result = replace(result, calibration=settings.similarity, settings_file=output.config)
        notify = notifier(quiet=output.quiet)
        for notice in result.warnings:
            notify(notice)
        for text in about_run(result, settings, stopwatch, verbose=output.verbose):
            print_notice(text)
        show(result, options, output, paths)
        return result.finished


def _interrupted(progress: Progress, output: OutputOptions) -> str:
    """What is known, and how to go on."""
    proven = "" if progress.bracket is None else f"proven so far: {bracket(*progress.bracket)}; "
    if output.output is None:
        return f"{proven}with -o DIR what is done is kept, and the same command goes on"
    kept = os.path.join(output.output, WORK_FOLDER)
    return f"{proven}what is done is in {kept}, and the same command goes on from there"
