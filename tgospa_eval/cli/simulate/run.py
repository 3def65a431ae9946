"""From the options of ``simulate`` to files."""

import shlex
from collections.abc import Collection
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.cli.shared.progress import Display
from tgospa_eval.cli.shared.streams import emit
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.manifest import FileEntry, entry, read_manifest, unchanged
from tgospa_eval.common.progress import Progress, Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.loading import check_parquet
from tgospa_eval.formats.write import WRITERS, PartWriter, csv_text, part_name
from tgospa_eval.reports.files import Kind, probe_folder, write_files, write_texts
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.simulation.recordings import RECORDINGS, Layout, RecordedRows, simulate_recording
from tgospa_eval.simulation.settings import PUBLISHED, SettingRun, run_setting
from tgospa_eval.text import visible
from tgospa_eval.tracks.trajectories import Trajectories

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


def _measurements(run: SettingRun) -> str:
    """CSV ``t,x,y``, a row for each measurement, shuffled within a step."""
    rows = [
        f"{time},{x!r},{y!r}\n"
        for time, found in zip(run.truth.times.tolist(), run.measurements, strict=True)
        for x, y in found.tolist()
    ]
    return "".join(["t,x,y\n", *rows])


DISTANCE_OF_STATE = {"gaussian": "gaussian-wasserstein", "cloud": "cloud-wasserstein"}
"""Distances of states that are more than points."""

OPTION = "DIR"
"""What messages about the folder begin with."""


def make_scene(folder: str, options: SceneOptions) -> None:
    """Make a scene, write it, print what was made.

    Raises
    ------
    ConfigError
        An option has no meaning, or the folder cannot be written.
    """
    names = ("truth.csv", "estimate.csv") if options.format_ == "csv" else ("gt.txt", "res.txt")
    kind = Kind(name="simulate", document=names[0], names=names)
    probe_folder(folder, kind, force=options.force, option=OPTION)
    scene, tracker = settings(options)
    truth, estimate = simulate(scene, tracker, np.random.default_rng(options.seed))
    if options.format_ == "kitti":  # whose frames count from 0
        truth, estimate = (replace(side, times=side.times - 1) for side in (truth, estimate))
    write = WRITERS[options.format_]
    texts = {
        name: write(side, role)
        for name, side, role in zip(names, (truth, estimate), ("truth", "estimate"), strict=True)
    }
    write_texts(texts, folder, kind, force=options.force, option=OPTION)
    if options.quiet:
        return
    lines = (
        f"{folder}: {scene.scenario}, {counted(scene.steps, 'step')}; "
        f"{size_of(truth, 'truth')} in {names[0]}, "
        f"{size_of(estimate, 'estimate')} in {names[1]}",
        _command(folder, names, options, tracker),
    )
    emit("".join(f"{visible(line)}\n" for line in lines))


def settings(options: SceneOptions) -> tuple[Scene, Tracker]:
    """The scene and the tracker that the options of `simulate` ask for."""
    boxes = options.format_ != "csv"
    if boxes and options.state not in (None, "box"):
        raise ConfigError(
            f"--state {options.state}: {options.format_} files hold boxes; leave it out"
        )
    if options.particles is not None and options.state != "cloud":
        raise ConfigError("--particles is for --state cloud")
    scene = Scene(
        state=options.state or ("box" if boxes else "point"),
        particles=options.particles or 100,
        scenario=options.scenario,
        targets=options.targets,
        steps=options.steps,
        area=options.area,
    )
    scaled = {"noise": scene.area / 200, "near": scene.area / 20}
    given: dict[str, Any] = {field.name: getattr(options, field.name) for field in fields(Tracker)}
    given |= {name: value for name, value in scaled.items() if given[name] is None}
    return scene, Tracker(**given)


def size_of(side: Trajectories, what: str) -> str:
    """How many tracks and rows, in words."""
    clouds = "" if side.clouds is None else f" of {counted(len(side.clouds.points), 'particle')}"
    return f"{counted(len(side.ids), what)} with {counted(len(side.step), 'row')}{clouds}"


def _command(folder: str, names: tuple[str, str], options: SceneOptions, tracker: Tracker) -> str:
    """With a cutoff well above the noise, and the price of a switch a quarter of it squared."""
    paths = " ".join(shlex.quote(str(Path(folder) / name)) for name in names)
    cutoff = max(options.area / 20, 5 * tracker.noise)
    format_ = options.format_
    formats = f" --truth-format {format_} --estimate-format {format_}" if format_ != "csv" else ""
    if options.state in DISTANCE_OF_STATE:
        formats += f" --distance {DISTANCE_OF_STATE[options.state]}"
    return f"tgospa-eval {paths}{formats} -c {cutoff:g} -g {cutoff / 2:g}"


# -------------------------------------------------------------------------------------------------
# From a kind of long recording to two folders of Parquet files, in memory of a stretch of it.

FOLDERS = ("truth", "estimate")


def make_partitioned(folder: str, options: SceneOptions) -> None:
    """Make a recording, write it, print what was made.

    Raises
    ------
    ConfigError
        The extra is missing, or the folder cannot be written.
    """
    check_parquet()
    recording = RECORDINGS[str(options.partitioned)]
    layout = Layout.of(recording, options.rows)
    names = [f"{side}/{part_name(k)}" for side in FOLDERS for k in range(layout.parts)]
    kind = Kind(name="simulate", document=names[0], names=names)
    probe_folder(folder, kind, force=options.force, option=OPTION)
    _check_strangers(folder, kind)
    counts = [_Count(), _Count()]
    stopwatch = Stopwatch()
    stopwatch.progress = Progress(watched=not options.quiet)

    def fill(fresh: Path) -> Collection[FileEntry]:
        counts[:] = _Count(), _Count()
        for side in FOLDERS:
            (fresh / side).mkdir()
        with PartWriter(fresh / FOLDERS[0]) as truth, PartWriter(fresh / FOLDERS[1]) as estimate:
            writers = truth, estimate
            stretches = simulate_recording(recording, layout, np.random.default_rng(options.seed))
            for number, sides in enumerate(stretches, start=1):
                for writer, count, rows in zip(writers, counts, sides, strict=True):
                    writer.add(vars(rows))
                    count.add(rows)
                    if number * layout.stretch % layout.part == 0:
                        writer.end_part()
                stopwatch.progress.done(min(number * layout.stretch / layout.steps, 1.0))
                if not options.quiet:
                    display.update()
        return [entry(fresh, name) for name in names]

    with Display(stopwatch) as display, stopwatch.span("simulating"):
        write_files(fill, folder, kind, force=options.force, option=OPTION)
    if options.quiet:
        return
    paths = " ".join(shlex.quote(str(Path(folder) / side)) for side in FOLDERS)
    lines = (
        f"{folder}: {options.partitioned}, {counted(layout.steps, 'step')}; "
        f"{counts[0].text('truth')} in truth/, {counts[1].text('estimate')} in estimate/, "
        f"{counted(layout.parts, 'file')} each",
        f"tgospa-eval evaluate {paths} -c {recording.cutoff:g} -g {recording.switch_penalty:g}",
    )
    emit("".join(f"{visible(line)}\n" for line in lines))


class _Count:
    """How many rows and tracks there are, in a byte for each track."""

    def __init__(self) -> None:
        self.rows = 0
        self.seen = np.zeros(0, bool)

    def add(self, rows: RecordedRows) -> None:
        """Count some."""
        self.rows += len(rows.id)
        most = int(rows.id.max(initial=0)) + 1
        if most > len(self.seen):
            self.seen = np.append(self.seen, np.zeros(most, bool))
        self.seen[rows.id] = True

    def text(self, what: str) -> str:
        """In words."""
        return f"{counted(int(self.seen.sum()), what)} with {counted(self.rows, 'row')}"


def _check_strangers(folder: str, kind: Kind) -> None:
    """See that the folders of the sides hold nothing that would become part of the data.

    Raises
    ------
    ConfigError
        They do, and it is not of a run before.
    """
    path = Path(folder)
    own = {*kind.names, *unchanged(path, read_manifest(path, kind.name) or ())}
    for side in FOLDERS:
        if (path / side).is_file():
            raise ConfigError(f"{OPTION} {folder}: {side} in it is a file; name another folder")
        for item in sorted((path / side).glob("*")):
            if f"{side}/{item.name}" not in own:
                raise ConfigError(
                    f"{OPTION} {folder}: {side}/{item.name} in it would be part of the data; "
                    "remove it, or name another folder"
                )
