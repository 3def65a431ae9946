"""``tgospa-eval simulate DIR``: a synthetic scene as files, with the command to evaluate it."""

from functools import partial
from typing import Any

import click

from tgospa_eval.cli.shared.help import Option, Verb

# Spelled out here, because importing the members costs numpy; a test holds them together.
SCENARIOS = ("crossing", "parallel", "convoy", "dense", "births", "manoeuvring")
SCENE_FORMATS = ("csv", "motchallenge", "kitti")


def _lengths(ctx: click.Context, parameter: click.Parameter, text: str) -> tuple[int, int]:  # noqa: ARG001
    """A:B, or one number for both."""
    try:
        least, most = map(int, text.split(":") if ":" in text else (text, text))
    except ValueError:
        raise click.BadParameter(f"{text!r}: must be A:B or A, in steps") from None
    return least, most


_scene = partial(click.option, cls=Option, section="Scene", show_default=True)
_tracker = partial(click.option, cls=Option, section="Tracker", show_default=True)
_output = partial(click.option, cls=Option, section="Output", show_default=True)


@click.command("simulate", cls=Verb)
@click.argument("folder", metavar="DIR", type=click.Path(readable=False))
@_scene(
    "--scenario",
    default="crossing",
    type=click.Choice(SCENARIOS),
    metavar="NAME",
    help="What the targets do: crossing, parallel, convoy, dense, births or manoeuvring.",
)
@_scene("--targets", default=5, metavar="N", help="Number of targets.")
@_scene("--steps", default=60, metavar="N", help="Number of time steps.")
@_scene(
    "--area",
    default=200.0,
    metavar="LENGTH",
    help="Side of the square in which it happens, in state units.",
)
@_scene(
    "--state",
    type=click.Choice(("point", "gaussian", "cloud", "box")),
    metavar="KIND",
    show_default="box for motchallenge and kitti, else point",
    help="What a state is. point: x,y; gaussian: the estimates have covariances as well; cloud: "
    "the estimates are weighted particles; box: left,top,width,height.",
)
@_scene(
    "--particles",
    type=click.IntRange(min=1),
    metavar="N",
    show_default="100",
    help="Number of particles of each cloud.",
)
@_scene(
    "--seed",
    default=0,
    type=click.IntRange(min=0),
    metavar="N",
    help="Seed: the same one makes the same files.",
)
@_tracker(
    "--noise",
    type=float,
    metavar="SD",
    show_default="area / 200",
    help="Standard deviation of the error in each coordinate.",
)
@_tracker(
    "--detection",
    default=0.95,
    metavar="P",
    help="Probability that a target is reported at a step.",
)
@_tracker(
    "--confirmation",
    default=0,
    metavar="N",
    help="Number of steps after its birth at which a target is not yet reported.",
)
@_tracker(
    "--swaps",
    default=0.25,
    metavar="P",
    help="Probability that two targets that come near exchange their tracks.",
)
@_tracker(
    "--merges",
    default=0.0,
    metavar="P",
    help="Probability that two targets that come near become one track.",
)
@_tracker(
    "--near",
    type=float,
    metavar="LENGTH",
    show_default="area / 20",
    help="Distance below which two targets are near.",
)
@_tracker(
    "--fragmentation",
    default=0.01,
    metavar="P",
    help="Probability that a track is lost, at every step.",
)
@_tracker(
    "--lost",
    default=3,
    metavar="N",
    help="Number of steps until the target is found again, under a new id.",
)
@_tracker("--latency", default=0, metavar="N", help="Number of steps by which reports are late.")
@_tracker(
    "--false-rate",
    default=0.02,
    metavar="N",
    help="Mean number of false tracks that begin at a step.",
)
@_tracker(
    "--false-length",
    default="3:10",
    callback=_lengths,
    metavar="A:B",
    help="Length of false tracks, from A to B steps.",
)
@_output(
    "--format",
    default="csv",
    type=click.Choice(SCENE_FORMATS),
    metavar="FORMAT",
    help="Format of the files: csv, motchallenge or kitti.",
)
@_output("--force", is_flag=True, help="Write into a folder with other files in it.")
@click.option(
    "-q", "--quiet", cls=Option, section="General", is_flag=True, help="Do not print what was made."
)
def command(folder: str, **options: Any) -> None:
    """Make a ground truth and a tracker's estimate of it, to try things on.

    Two files are written to the folder DIR. What was made is printed, and the command
    that evaluates it. An error of the tracker is left out with 0, misses with
    --detection 1.

    \b
    Examples:
      tgospa-eval simulate demo
      tgospa-eval simulate crowd --scenario dense --targets 20 --steps 100
      tgospa-eval simulate late --latency 2 --detection 1 --seed 7

    Exit status: 0 done, 2 wrong option, or a folder that cannot be written.
    """
    from tgospa_eval.cli.simulate.run import make_scene

    make_scene(folder, options)
