"""``compare --simulate``: the scaling study, solvers on simulated scenes of many sizes."""

from contextlib import nullcontext

from tgospa_eval.cli.compare.show import show
from tgospa_eval.cli.compare.values import CompareOptions, StudyOptions, numbers
from tgospa_eval.cli.shared.notices import notifier, slow_notice
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.simulate.run import settings as scene_settings
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.figures import parsed_whole
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.comparison.log import Log, machine
from tgospa_eval.comparison.study import Study, carry_out, study_document
from tgospa_eval.plots.comparison import study_pictures
from tgospa_eval.reports.folders import STUDY, probe_folder
from tgospa_eval.reports.records import StudyRecord
from tgospa_eval.simulation import COLUMNS


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
    scene, tracker = scene_settings(SceneOptions(scenario=sizes.scenario, area=sizes.area))
    return Study(
        scene=scene,
        tracker=tracker,
        seed=sizes.seed,
        parameters=settings.parameters,
        distance=settings.measure.distance(COLUMNS[scene.state]),
        solvers=options.make_solvers("certified,sinkhorn"),
        targets=numbers("targets", sizes.targets, parsed_whole),
        steps=numbers("steps", sizes.numbers, parsed_whole),
        runs=sizes.runs,
    )
