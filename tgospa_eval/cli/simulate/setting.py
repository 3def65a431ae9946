"""From a setting of the literature to files."""

import shlex
from pathlib import Path

from tgospa_eval.cli.shared.streams import emit
from tgospa_eval.cli.simulate.run import OPTION, size_of
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.words import counted
from tgospa_eval.formats.write import csv_text
from tgospa_eval.reports.folders import Kind, probe_folder, write_texts
from tgospa_eval.simulation.settings import PUBLISHED, Run, run_setting
from tgospa_eval.text import visible

NAMES = ("truth.csv", "estimate.csv", "measurements.csv")


def make_setting(folder: str, options: SceneOptions) -> None:
    """Make one run of a setting, write it, print what was made.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    setting = PUBLISHED[str(options.setting)]
    kind = Kind(name="simulate", document=NAMES[0], names=NAMES)
    probe_folder(folder, kind, force=options.force, option=OPTION)
    run = run_setting(setting, options.seed)
    sides = run.truth, run.estimate
    texts = dict(zip(NAMES, (*map(csv_text, sides), _measurements(run)), strict=True))
    write_texts(texts, folder, kind, force=options.force, option=OPTION)
    if options.quiet:
        return
    count = sum(map(len, run.measurements))
    paths = " ".join(shlex.quote(str(Path(folder) / name)) for name in NAMES[:2])
    metric = f"-c {setting.cutoff:g} -p {setting.order:g} -g {setting.switch_penalty:g}"
    lines = (
        f"{folder}: {options.setting}, {counted(setting.steps, 'step')}; "
        f"{size_of(run.truth, 'truth')} in {NAMES[0]}, {counted(count, 'measurement')} in "
        f"{NAMES[2]}; {size_of(run.estimate, 'estimate')} in {NAMES[1]}, the measurements of each "
        "target as they are, until your tracker's takes its place",
        f"source: {setting.source}; random numbers are not those of the source",
        f"tgospa-eval {paths} {metric}",
    )
    emit("".join(f"{visible(line)}\n" for line in lines))


def _measurements(run: Run) -> str:
    """CSV ``t,x,y``, a row for each measurement, shuffled within a step."""
    rows = [
        f"{time},{x!r},{y!r}\n"
        for time, found in zip(run.truth.times.tolist(), run.measurements, strict=True)
        for x, y in found.tolist()
    ]
    return "".join(["t,x,y\n", *rows])
