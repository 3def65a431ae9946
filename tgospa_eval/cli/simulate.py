"""``tgospa-eval simulate DIR``: a made-up scene as files, with the command to evaluate it."""

from collections.abc import Callable
from typing import Any

import click

# Spelled out here, because importing the members costs numpy; a test holds them together.
SCENARIOS = ("crossing", "parallel", "convoy", "dense", "births", "manoeuvring")
FORMATS = ("csv", "motchallenge", "kitti")


def _lengths(ctx: click.Context, parameter: click.Parameter, text: str) -> tuple[int, int]:  # noqa: ARG001
    """A:B, or one number for both."""
    try:
        least, most = map(int, text.split(":") if ":" in text else (text, text))
    except ValueError:
        raise click.BadParameter(f"{text!r}: must be A:B or A, in steps") from None
    return least, most


def _option(name: str, default: Any, text: str, **settings: Any) -> Callable[[Any], Any]:
    return click.option(name, default=default, show_default=True, help=text, **settings)


@click.command("simulate", context_settings={"max_content_width": 80})
@click.argument("folder", metavar="DIR", type=click.Path())
@_option("--scenario", "crossing", "What the targets do.", type=click.Choice(SCENARIOS))
@_option("--targets", 5, "Number of targets.", type=int)
@_option("--steps", 60, "Length of the recording.", type=int)
@_option("--area", 200.0, "Side of the square in which it happens; in state units.")
@click.option(
    "--state", type=click.Choice(("point", "gaussian", "cloud", "box")),
    help="x,y; x,y with covariances of the estimates; x,y of weighted particles in the estimate; "
    "left,top,width,height.  [default: box for motchallenge and kitti, else point]",
)  # fmt: skip
@click.option(
    "--particles", type=click.IntRange(min=1), help="Of each cloud.  [default: 100]",
)  # fmt: skip
@click.option(
    "--noise", type=float,
    help="Standard deviation of each estimated coordinate.  [default: area / 200]",
)  # fmt: skip
@_option("--detection", 0.95, "Probability that a target is reported at a step.")
@_option("--confirmation", 0, "Steps after its birth at which a target is not yet reported.")
@_option("--swaps", 0.25, "Probability that two near targets exchange their tracks.")
@_option("--merges", 0.0, "Probability that two near targets are one track.")
@click.option(
    "--near", type=float,
    help="Distance below which two targets are near.  [default: area / 20]",
)  # fmt: skip
@_option("--fragmentation", 0.01, "Probability, for every step, that a track is lost.")
@_option("--lost", 3, "Steps until it is found again, under a new number.")
@_option("--latency", 0, "Steps by which every report is late.")
@_option("--false-rate", 0.02, "Mean number of false tracks that begin at a step.")
@_option("--false-length", "3:10", "Their lengths in steps.", callback=_lengths, metavar="A:B")
@_option("--seed", 0, "The same seed makes the same files.", type=click.IntRange(min=0))
@_option("--format", "csv", "What is written.", type=click.Choice(FORMATS))
@click.option("--force", is_flag=True, help="Write into a folder that is not empty.")
def command(folder: str, **options: Any) -> None:
    """Write a made-up ground truth and a tracker's estimate of it to the folder DIR.

    It prints what was made, and the command to evaluate it. To leave an error out
    set it to 0, --detection to 1.

    Exit status: 0 done, 2 wrong option, or a folder that cannot be written.
    """
    from tgospa_eval.cli.scene import make_scene

    make_scene(folder, options)
