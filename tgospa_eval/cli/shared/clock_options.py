"""The options that bring the estimate to the clock, the unit and the stamps of the truth."""

from functools import partial

import click

from tgospa_eval.cli.shared.option import option

# Spelled out here, because importing it costs numpy; a test holds them together.
INTERPOLATED = ("estimate", "truth")
_files = partial(option, section="Files")

CLOCK_AND_UNIT = (
    _files(
        "--interpolate SIDE",
        "Bring the estimate, or the truth, to the times of the other file: states on the straight "
        "line between two of a track, at most --max-gap apart. Never done unless asked for.",
        type=click.Choice(INTERPOLATED),
    ),
    _files(
        "--max-gap DT",
        "The longest time between two states of a track to interpolate across.",
        type=float,
    ),
    _files(
        "--time-offset DT",
        "Added to the times of ESTIMATE, after --time-scale; in seconds for ISO times.",
        type=float,
        default=0.0,
    ),
    _files(
        "--time-scale FACTOR",
        "The times of ESTIMATE are multiplied by this: 0.001 makes seconds of milliseconds.",
        type=float,
        default=1.0,
    ),
    _files(
        "--unit-scale FACTOR",
        "The state columns of ESTIMATE, with covariances and particles, are multiplied by this, "
        "but for --periodic ones: 1000 makes metres of kilometres.",
        type=float,
        default=1.0,
    ),
)
