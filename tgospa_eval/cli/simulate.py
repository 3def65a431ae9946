"""``tgospa-eval simulate DIR``: a synthetic scene as files, with the command to evaluate it."""

import shlex
from collections.abc import Collection
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.command import PATH, Option, Verb
from tgospa_eval.common.words import counted, parsed_whole
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import visible

if TYPE_CHECKING:
    from tgospa_eval.common.manifest import FileEntry
    from tgospa_eval.reports.files import Kind
    from tgospa_eval.simulation.recordings import RecordedRows
    from tgospa_eval.tracks.trajectories import Trajectories

# Spelled out here, because importing the members costs numpy; a test holds them together.
SCENARIOS = ("crossing", "parallel", "convoy", "dense", "births", "manoeuvring")
PUBLISHED = ("garcia-fernandez-2020", "xia-2019")
RECORDING_KINDS = ("ais", "city")
BESIDE_MODES = ("seed", "force", "quiet", "folder")
"""Parameters that go with whatever is made."""

SCENE_FORMATS = ("csv", "motchallenge", "kitti")

OPTION = "DIR"
"""What messages about the folder begin with."""

DISTANCE_OF_STATE = {"gaussian": "gaussian-wasserstein", "cloud": "cloud-wasserstein"}
"""Distances of states that are more than points."""

FOLDERS = ("truth", "estimate")
"""Of the parts of a recording."""

LARGEST_RECORDING = 10**12
"""Rows of a recording: ids have 40 bits where they are sorted."""


def _lengths(ctx: click.Context, parameter: click.Parameter, text: str) -> tuple[int, int]:  # noqa: ARG001
    """A:B, or one number for both."""
    first, colon, last = text.partition(":")
    least, most = parsed_whole(first), parsed_whole(last if colon else first)
    if least is None or most is None:
        raise click.BadParameter(f"{text!r}: must be A:B or A, in steps")
    return least, most


_scene = partial(Option, section="Scene")
_tracker = partial(Option, section="Tracker")
_output = partial(Option, section="Output")


OPTIONS = (
    _scene(
        "--setting NAME",
        "What a publication simulates, with the measurements for a tracker: garcia-fernandez-2020 "
        "or xia-2019. Only --seed goes with it.",
        type=click.Choice(PUBLISHED),
    ),
    _scene(
        "--partitioned KIND",
        "A recording of any length, as folders of Parquet files by time: ais (many short tracks, "
        "few encounters) or city (dense). Only --rows and --seed go with it.",
        type=click.Choice(RECORDING_KINDS),
    ),
    _scene(
        "--rows N",
        "Rows of the truth with --partitioned, rounded up to whole steps.",
        default=1_000_000,
        type=click.IntRange(1, LARGEST_RECORDING),
    ),
    _scene(
        "--scenario NAME",
        "What the targets do: crossing, parallel, convoy, dense, births or manoeuvring.",
        default="crossing",
        type=click.Choice(SCENARIOS),
    ),
    _scene("--targets N", "Number of targets.", default=5),
    _scene("--steps N", "Number of time steps.", default=60),
    _scene(
        "--area LENGTH",
        "Side of the square in which it happens, in state units.",
        default=200.0,
    ),
    _scene(
        "--state KIND",
        "What a state is. point: x,y; gaussian: the estimates have covariances as well; cloud: "
        "the estimates are weighted particles; box: left,top,width,height.",
        type=click.Choice(("point", "gaussian", "cloud", "box")),
        show_default="box for motchallenge and kitti, else point",
    ),
    _scene(
        "--particles N",
        "Number of particles of each cloud.",
        type=click.IntRange(min=1),
        show_default="100",
    ),
    _scene(
        "--seed N",
        "Seed: the same one makes the same files.",
        default=0,
        type=click.IntRange(min=0),
    ),
    _tracker(
        "--noise SD",
        "Standard deviation of the error in each coordinate.",
        type=float,
        show_default="area / 200",
    ),
    _tracker(
        "--detection P",
        "Probability that a target is reported at a step.",
        default=0.95,
    ),
    _tracker(
        "--confirmation N",
        "Number of steps after its birth at which a target is not yet reported.",
        default=0,
    ),
    _tracker(
        "--swaps P",
        "Probability that two targets that come near exchange their tracks.",
        default=0.25,
    ),
    _tracker(
        "--merges P",
        "Probability that two targets that come near become one track.",
        default=0.0,
    ),
    _tracker(
        "--near LENGTH",
        "Distance below which two targets are near.",
        type=float,
        show_default="area / 20",
    ),
    _tracker(
        "--fragmentation P",
        "Probability that a track is lost, at every step.",
        default=0.01,
    ),
    _tracker(
        "--lost N",
        "Number of steps until the target is found again, under a new id.",
        default=3,
    ),
    _tracker("--latency N", "Number of steps by which reports are late.", default=0),
    _tracker(
        "--false-rate N",
        "Mean number of false tracks that begin at a step.",
        default=0.02,
    ),
    _tracker(
        "--false-length A:B",
        "Length of false tracks, from A to B steps.",
        default="3:10",
        callback=_lengths,
    ),
    _output(
        "--format FORMAT",
        "Format of the files: csv, motchallenge or kitti.",
        name="format_",
        default="csv",
        type=click.Choice(SCENE_FORMATS),
    ),
    _output("--force", "Write into a folder with other files in it."),
    Option("-q, --quiet", "Do not print what was made.", section="General"),
)


def _check_alone(ctx: click.Context, mode: str, *also: str) -> None:
    """Whether nothing is asked for that this option says."""
    given = [
        item.opts[-1]
        for item in ctx.command.params
        if item.name not in (mode, *also, *BESIDE_MODES)
        and ctx.get_parameter_source(str(item.name)) is not ParameterSource.DEFAULT
    ]
    if given:
        raise click.UsageError(f"--{mode} says what is made: leave out {', '.join(given)}", ctx)


@click.command("simulate", cls=Verb, params=[*OPTIONS])
@click.argument("folder", metavar="DIR", type=PATH)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    folder: str,
    *,
    setting: str | None,
    partitioned: str | None,
    rows: int,
    seed: int,
    force: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Make a ground truth and a tracker's estimate of it, to try things on.

    Two files are written to the folder DIR. What was made is printed, and the command
    that evaluates it. An error of the tracker is left out with 0, misses with
    --detection 1.

    \b
    Examples:
      tgospa-eval simulate demo
      tgospa-eval simulate crowd --scenario dense --targets 20 --steps 100
      tgospa-eval simulate late --latency 2 --detection 1 --seed 7
      tgospa-eval simulate xia --setting xia-2019 --seed 1
      tgospa-eval simulate coast --partitioned ais --rows 10000000

    Exit status: 0 done, 2 wrong option, or a folder that cannot be written.
    """
    if setting is not None:
        _check_alone(ctx, "setting")
        lines = _make_setting(folder, setting, seed, force=force)
    elif partitioned is not None:
        _check_alone(ctx, "partitioned", "rows")
        lines = _make_recording(folder, partitioned, rows, seed, force=force, quiet=quiet)
    elif ctx.get_parameter_source("rows") is not ParameterSource.DEFAULT:
        raise click.UsageError("--rows is for --partitioned", ctx)
    else:
        lines = _make_scene(folder, seed, force=force, **options)
    if not quiet:
        from tgospa_eval.cli.shared.streams import emit

        emit("".join(f"{visible(line)}\n" for line in lines))


def _kind(names: Collection[str]) -> "Kind":
    from tgospa_eval.reports.files import Kind

    return Kind(name="simulate", document=next(iter(names)), names=names)


def _paths(folder: str, names: tuple[str, ...]) -> str:
    return " ".join(shlex.quote(str(Path(folder) / name)) for name in names)


def _size_of(side: "Trajectories", what: str) -> str:
    """How many tracks and rows, in words."""
    clouds = "" if side.clouds is None else f" of {counted(len(side.clouds.points), 'particle')}"
    return f"{counted(len(side.ids), what)} with {counted(len(side.step), 'row')}{clouds}"


def _make_setting(folder: str, name: str, seed: int, *, force: bool) -> tuple[str, ...]:
    """Write one run of a setting; what was made, and the command that evaluates it."""
    from tgospa_eval.formats.write import csv_text
    from tgospa_eval.reports.files import probe_folder, write_texts
    from tgospa_eval.simulation.settings import PUBLISHED, run_setting

    names = "truth.csv", "estimate.csv", "measurements.csv"
    setting, kind = PUBLISHED[name], _kind(names)
    probe_folder(folder, kind, force=force, option=OPTION)
    truth, estimate, measurements = run_setting(setting, seed)
    # A row for each measurement, shuffled within a step.
    rows = (
        f"{time},{x!r},{y!r}\n"
        for time, found in zip(truth.times.tolist(), measurements, strict=True)
        for x, y in found.tolist()
    )
    texts = csv_text(truth), csv_text(estimate), "".join(["t,x,y\n", *rows])
    files = dict(zip(names, texts, strict=True))
    write_texts(files, folder, kind, force=force, option=OPTION)
    count = sum(map(len, measurements))
    return (
        f"{folder}: {name}, {counted(setting.steps, 'step')}; "
        f"{_size_of(truth, 'truth')} in {names[0]}, {counted(count, 'measurement')} in "
        f"{names[2]}; {_size_of(estimate, 'estimate')} in {names[1]}, the measurements of each "
        "target as they are, until your tracker's takes its place",
        f"source: {setting.source}; random numbers are not those of the source",
        f"tgospa-eval {_paths(folder, names[:2])} -c {setting.cutoff:g} -p {setting.order:g} "
        f"-g {setting.switch_penalty:g}",
    )


def _make_scene(
    folder: str,
    seed: int,
    *,
    force: bool,
    format_: str,
    state: str | None,
    particles: int | None,
    **options: Any,
) -> tuple[str, ...]:
    """Write a scene; what was made, and the command that evaluates it.

    That has a cutoff well above the noise, and the price of a switch a quarter of it squared.
    """
    import numpy as np

    from tgospa_eval.formats.write import WRITERS
    from tgospa_eval.reports.files import probe_folder, write_texts
    from tgospa_eval.simulation import Scene, Tracker, simulate
    from tgospa_eval.simulation.settings import usual_tracker

    names = ("truth.csv", "estimate.csv") if format_ == "csv" else ("gt.txt", "res.txt")
    kind = _kind(names)
    probe_folder(folder, kind, force=force, option=OPTION)
    boxes = format_ != "csv"
    if boxes and state not in (None, "box"):
        raise ConfigError(f"--state {state}: {format_} files hold boxes; leave it out")
    if particles is not None and state != "cloud":
        raise ConfigError("--particles is for --state cloud")
    errors = {field.name: options.pop(field.name) for field in fields(Tracker)}
    scene = Scene(
        state=state or ("box" if boxes else "point"), particles=particles or 100, **options
    )
    tracker = usual_tracker(
        scene.area, {name: value for name, value in errors.items() if value is not None}
    )
    sides = simulate(scene, tracker, np.random.default_rng(seed))
    if format_ == "kitti":  # whose frames count from 0
        sides = (
            replace(sides[0], times=sides[0].times - 1),
            replace(sides[1], times=sides[1].times - 1),
        )
    texts = {
        name: WRITERS[format_](side, role)
        for name, side, role in zip(names, sides, ("truth", "estimate"), strict=True)
    }
    write_texts(texts, folder, kind, force=force, option=OPTION)
    cutoff = max(scene.area / 20, 5 * tracker.noise)
    formats = f" --truth-format {format_} --estimate-format {format_}" if boxes else ""
    if state in DISTANCE_OF_STATE:
        formats += f" --distance {DISTANCE_OF_STATE[state]}"
    return (
        f"{folder}: {scene.scenario}, {counted(scene.steps, 'step')}; "
        f"{_size_of(sides[0], 'truth')} in {names[0]}, "
        f"{_size_of(sides[1], 'estimate')} in {names[1]}",
        f"tgospa-eval {_paths(folder, names)}{formats} -c {cutoff:g} -g {cutoff / 2:g}",
    )


def _make_recording(
    folder: str, name: str, rows: int, seed: int, *, force: bool, quiet: bool
) -> tuple[str, ...]:
    """Write a recording, in memory of a stretch of it; what was made, and how to evaluate it."""
    import numpy as np

    from tgospa_eval.cli.shared.progress import Display
    from tgospa_eval.common.manifest import entry
    from tgospa_eval.common.progress import Progress, Stopwatch
    from tgospa_eval.formats.loading import check_parquet
    from tgospa_eval.formats.write import PartWriter, part_name
    from tgospa_eval.reports.files import probe_folder, write_files
    from tgospa_eval.simulation.recordings import RECORDINGS, Layout, simulate_recording

    check_parquet()
    recording = RECORDINGS[name]
    layout = Layout.of(recording, rows)
    names = [f"{side}/{part_name(k)}" for side in FOLDERS for k in range(layout.parts)]
    kind = _kind(names)
    probe_folder(folder, kind, force=force, option=OPTION)
    _check_strangers(folder, kind)
    counts = [_Count(), _Count()]
    stopwatch = Stopwatch()
    stopwatch.progress = Progress(watched=not quiet)

    def fill(fresh: Path) -> "Collection[FileEntry]":
        counts[:] = _Count(), _Count()
        for side in FOLDERS:
            (fresh / side).mkdir()
        with PartWriter(fresh / FOLDERS[0]) as truth, PartWriter(fresh / FOLDERS[1]) as estimate:
            writers = truth, estimate
            stretches = simulate_recording(recording, layout, np.random.default_rng(seed))
            for number, sides in enumerate(stretches, start=1):
                for writer, count, rows in zip(writers, counts, sides, strict=True):
                    writer.add(rows)
                    count.add(rows)
                    if number * layout.stretch % layout.part == 0:
                        writer.end_part()
                stopwatch.progress.done(min(number * layout.stretch / layout.steps, 1.0))
                if not quiet:
                    display.update()
        return [entry(fresh, name) for name in names]

    with Display(stopwatch) as display, stopwatch.span("simulating"):
        write_files(fill, folder, kind, force=force, option=OPTION)
    return (
        f"{folder}: {name}, {counted(layout.steps, 'step')}; "
        f"{counts[0].text('truth')} in truth/, {counts[1].text('estimate')} in estimate/, "
        f"{counted(layout.parts, 'file')} each",
        f"tgospa-eval evaluate {_paths(folder, FOLDERS)} -c {recording.cutoff:g} "
        f"-g {recording.switch_penalty:g}",
    )


class _Count:
    """How many rows and tracks there are, in a byte for each track."""

    def __init__(self) -> None:
        self.rows, self.seen = 0, bytearray()

    def add(self, rows: "RecordedRows") -> None:
        """Count some."""
        import numpy as np

        self.rows += len(rows["id"])
        most = int(rows["id"].max(initial=0)) + 1
        if most > len(self.seen):
            self.seen.extend(bytes(most))
        np.frombuffer(self.seen, np.uint8)[rows["id"]] = 1

    def text(self, what: str) -> str:
        """In words."""
        return f"{counted(self.seen.count(1), what)} with {counted(self.rows, 'row')}"


def _check_strangers(folder: str, kind: "Kind") -> None:
    """See that the folders of the sides hold nothing that would become part of the data.

    Raises
    ------
    ConfigError
        They do, and it is not of a run before.
    """
    from tgospa_eval.common.manifest import read_manifest, unchanged

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
