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
from tgospa_eval.quoting import visible

if TYPE_CHECKING:
    from tgospa_eval.show.files import Kind
    from tgospa_eval.tracks.trajectories import Trajectories

# Copies of names from modules that import numpy, which is slow. A test compares both.
SCENARIOS = ("crossing", "parallel", "convoy", "dense", "births", "manoeuvring")
PUBLISHED = ("garcia-fernandez-2020", "xia-2019")
BESIDE_SETTING = ("setting", "seed", "force", "quiet", "folder")
"""Names of the parameters that can be combined with ``--setting``."""

SCENE_FORMATS = ("csv", "motchallenge", "kitti")

OPTION = "DIR"
"""Name of the argument for the folder in messages."""

DISTANCE_OF_STATE = {"gaussian": "gaussian-wasserstein", "cloud": "cloud-wasserstein"}
"""Distance for each kind of state except points."""


def _lengths(ctx: click.Context, parameter: click.Parameter, text: str) -> tuple[int, int]:  # noqa: ARG001
    """Parse the text A:B to two numbers of steps. A single number counts for both."""
    first, colon, last = text.partition(":")
    shortest, longest = parsed_whole(first), parsed_whole(last if colon else first)
    if shortest is None or longest is None:
        raise click.BadParameter(f"{text!r}: must be A:B or A, in steps")
    return shortest, longest


_scene = partial(Option, section="Scene")
_tracker = partial(Option, section="Tracker")
_output = partial(Option, section="Output")


OPTIONS = (
    _scene(
        "--setting NAME",
        "Scene of a publication, with measurements for your tracker: garcia-fernandez-2020 or "
        "xia-2019. It leaves only the seed to choose.",
        type=click.Choice(PUBLISHED),
    ),
    _scene(
        "--scenario NAME",
        "Motion of the targets: crossing, parallel, convoy, dense, births or manoeuvring.",
        default="crossing",
        type=click.Choice(SCENARIOS),
    ),
    _scene("--targets N", "Number of targets.", default=5),
    _scene("--steps N", "Number of time steps.", default=60),
    _scene(
        "--area LENGTH",
        "Side of the square with the targets, in state units.",
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
        "Seed: the same seed makes the same files.",
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
        "Number of steps after the birth of a target before it is reported.",
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
        "Mean number of new false tracks per step.",
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
    Option("-q, --quiet", "Print no summary.", section="General"),
)


def _check_setting(ctx: click.Context) -> None:
    """Check that no option is given that ``--setting`` fixes."""
    given = [
        item.opts[-1]
        for item in ctx.command.params
        if item.name not in BESIDE_SETTING
        and ctx.get_parameter_source(str(item.name)) is not ParameterSource.DEFAULT
    ]
    if given:
        raise click.UsageError(f"--setting fixes the scene: leave out {', '.join(given)}", ctx)


@click.command("simulate", cls=Verb, params=[*OPTIONS])
@click.argument("folder", metavar="DIR", type=PATH)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    folder: str,
    *,
    setting: str | None,
    seed: int,
    force: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Make a ground truth and a tracker's estimate of it, to try things on.

    Two files are written to the folder DIR. A summary and the command that evaluates
    the files are printed. The value 0 leaves out an error of the tracker; --detection 1
    leaves out misses.

    \b
    Examples:
      tgospa-eval simulate demo
      tgospa-eval simulate crowd --scenario dense --targets 20 --steps 100
      tgospa-eval simulate late --latency 2 --detection 1 --seed 7
      tgospa-eval simulate xia --setting xia-2019 --seed 1

    Exit status: 0 done, 2 wrong option, or a folder that cannot be written.
    """
    if setting is not None:
        _check_setting(ctx)
        lines = _make_setting(folder, setting, seed, force=force)
    else:
        lines = _make_scene(folder, seed, force=force, **options)
    if not quiet:
        from tgospa_eval.cli.shared.streams import emit

        emit("".join(f"{visible(line)}\n" for line in lines))


def _kind(names: Collection[str]) -> "Kind":
    from tgospa_eval.show.files import Kind

    return Kind(name="simulate", document=next(iter(names)), names=names)


def _paths(folder: str, names: tuple[str, ...]) -> str:
    return " ".join(shlex.quote(str(Path(folder) / name)) for name in names)


def _size_of(side: "Trajectories", what: str) -> str:
    """Describe how many objects or tracks, rows and particles there are; `what` is their name."""
    clouds = "" if side.clouds is None else f" of {counted(len(side.clouds.points), 'particle')}"
    return f"{counted(len(side.ids), what)} with {counted(len(side.step), 'row')}{clouds}"


def _make_setting(folder: str, name: str, seed: int, *, force: bool) -> tuple[str, ...]:
    """Write one run of a published setting; return a description and the command to evaluate it."""
    from tgospa_eval.formats.write import csv_text
    from tgospa_eval.show.files import probe_folder, write_texts
    from tgospa_eval.simulation.settings import PUBLISHED, run_setting

    names = "truth.csv", "estimate.csv", "measurements.csv"
    setting, kind = PUBLISHED[name], _kind(names)
    probe_folder(folder, kind, force=force, subject=OPTION)
    truth, estimate, measurements = run_setting(setting, seed)
    # Each measurement has a row. The measurements of a step are in random order.
    rows = (
        f"{time},{x!r},{y!r}\n"
        for time, points in zip(truth.times.tolist(), measurements, strict=True)
        for x, y in points.tolist()
    )
    texts = csv_text(truth), csv_text(estimate), "".join(["t,x,y\n", *rows])
    files = dict(zip(names, texts, strict=True))
    write_texts(files, folder, kind, force=force, subject=OPTION)
    count = sum(map(len, measurements))
    return (
        f"{folder}: {name}, {counted(setting.steps, 'step')}; "
        f"{_size_of(truth, 'ground-truth object')} in {names[0]}, "
        f"{counted(count, 'measurement')} in {names[2]}; "
        f"{_size_of(estimate, 'estimate')} in {names[1]}, the raw measurements of each target; "
        "replace it with your tracker's estimate",
        f"source: {setting.source}; the random numbers differ from those of the source",
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
    """Write a scene; return a description, and the command to evaluate it.

    The cutoff in this command is well above the noise. The switch penalty is half of the cutoff.
    """
    import numpy as np

    from tgospa_eval.formats.write import WRITERS
    from tgospa_eval.show.files import probe_folder, write_texts
    from tgospa_eval.simulation import Scene, Tracker, simulate
    from tgospa_eval.simulation.settings import default_tracker

    names = ("truth.csv", "estimate.csv") if format_ == "csv" else ("gt.txt", "res.txt")
    kind = _kind(names)
    probe_folder(folder, kind, force=force, subject=OPTION)
    boxes = format_ != "csv"
    if boxes and state not in (None, "box"):
        raise ConfigError(f"--state {state}: {format_} files hold boxes; leave --state out")
    if particles is not None and state != "cloud":
        raise ConfigError("--particles needs --state cloud")
    errors = {field.name: options.pop(field.name) for field in fields(Tracker)}
    scene = Scene(
        state=state or ("box" if boxes else "point"), particles=particles or 100, **options
    )
    tracker = default_tracker(
        scene.area, {name: value for name, value in errors.items() if value is not None}
    )
    sides = simulate(scene, tracker, np.random.default_rng(seed))
    if format_ == "kitti":  # in KITTI, the first frame is 0
        sides = (
            replace(sides[0], times=sides[0].times - 1),
            replace(sides[1], times=sides[1].times - 1),
        )
    texts = {
        name: WRITERS[format_](side, role)
        for name, side, role in zip(names, sides, ("truth", "estimate"), strict=True)
    }
    write_texts(texts, folder, kind, force=force, subject=OPTION)
    cutoff = max(scene.area / 20, 5 * tracker.noise)
    formats = f" --truth-format {format_} --estimate-format {format_}" if boxes else ""
    if state in DISTANCE_OF_STATE:
        formats += f" --distance {DISTANCE_OF_STATE[state]}"
    return (
        f"{folder}: {scene.scenario}, {counted(scene.steps, 'step')}; "
        f"{_size_of(sides[0], 'ground-truth object')} in {names[0]}, "
        f"{_size_of(sides[1], 'estimate')} in {names[1]}",
        f"tgospa-eval {_paths(folder, names)}{formats} -c {cutoff:g} -g {cutoff / 2:g}",
    )
