"""``tgospa-eval simulate DIR``: a synthetic scene as files, with the command to evaluate it."""

from functools import partial

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, Option
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.words import parsed_whole

# Spelled out here, because importing the members costs numpy; a test holds them together.
SCENARIOS = ("crossing", "parallel", "convoy", "dense", "births", "manoeuvring")
PUBLISHED = ("garcia-fernandez-2020", "xia-2019")
RECORDING_KINDS = ("ais", "city")
BESIDE_MODES = ("seed", "force", "quiet", "folder")
"""Parameters that go with whatever is made."""

SCENE_FORMATS = ("csv", "motchallenge", "kitti")

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
        default=SceneOptions.rows,
        type=click.IntRange(1, LARGEST_RECORDING),
    ),
    _scene(
        "--scenario NAME",
        "What the targets do: crossing, parallel, convoy, dense, births or manoeuvring.",
        default=SceneOptions.scenario,
        type=click.Choice(SCENARIOS),
    ),
    _scene("--targets N", "Number of targets.", default=SceneOptions.targets),
    _scene("--steps N", "Number of time steps.", default=SceneOptions.steps),
    _scene(
        "--area LENGTH",
        "Side of the square in which it happens, in state units.",
        default=SceneOptions.area,
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
        default=SceneOptions.seed,
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
        default=SceneOptions.detection,
    ),
    _tracker(
        "--confirmation N",
        "Number of steps after its birth at which a target is not yet reported.",
        default=SceneOptions.confirmation,
    ),
    _tracker(
        "--swaps P",
        "Probability that two targets that come near exchange their tracks.",
        default=SceneOptions.swaps,
    ),
    _tracker(
        "--merges P",
        "Probability that two targets that come near become one track.",
        default=SceneOptions.merges,
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
        default=SceneOptions.fragmentation,
    ),
    _tracker(
        "--lost N",
        "Number of steps until the target is found again, under a new id.",
        default=SceneOptions.lost,
    ),
    _tracker(
        "--latency N", "Number of steps by which reports are late.", default=SceneOptions.latency
    ),
    _tracker(
        "--false-rate N",
        "Mean number of false tracks that begin at a step.",
        default=SceneOptions.false_rate,
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
        default=SceneOptions.format_,
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
def command(ctx: click.Context, /, folder: str, **options: object) -> None:
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
    if options["setting"] is not None:
        _check_alone(ctx, "setting")
        from tgospa_eval.cli.simulate.run import make_setting

        make_setting(folder, SceneOptions.of(options))
        return
    if options["partitioned"] is not None:
        _check_alone(ctx, "partitioned", "rows")
        from tgospa_eval.cli.simulate.run import make_partitioned

        make_partitioned(folder, SceneOptions.of(options))
        return
    if ctx.get_parameter_source("rows") is not ParameterSource.DEFAULT:
        raise click.UsageError("--rows is for --partitioned", ctx)
    from tgospa_eval.cli.simulate.run import make_scene

    make_scene(folder, SceneOptions.of(options))
