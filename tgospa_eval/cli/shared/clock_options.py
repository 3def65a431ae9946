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
        "--max-gap DT[,DT]",
        "The longest time between two states of a track to interpolate across; of truth and "
        "estimate, if they differ: 200s,10s.",
    ),
    _files(
        "--resample S",
        "A common clock: both files are interpolated at every multiple of S (3s, 200ms, 2min; "
        "without unit where times are numbers), from the truth's first time to its last, each "
        "within its --max-gap. The way to compare trackers whose times differ.",
    ),
    _files(
        "--steps FIRST:LAST[:EVERY]",
        "Exactly these steps are evaluated, and values per step divide by their number; empty "
        "ones cost nothing and count. EVERY is 1 for whole numbers. Rows at other times are left "
        "out.  [default: the times of either file; per step of the truth's]",
    ),
    _files(
        "--outage DT",
        "With --interpolate truth: where the estimate has no time for longer than this, the "
        "truth's own times are steps, and what is there is missed. none says that the tracker "
        "reports only when it sees something.  [default: five times its median interval]",
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
