"""The options of everything that evaluates."""

from collections.abc import Callable
from functools import partial
from typing import Any

import click

from tgospa_eval.cli.shared.help import Option
from tgospa_eval.cli.shared.option import KEYS, load_config, option
from tgospa_eval.cli.shared.state_options import COUNT, GAUSSIANS, PARTICLES

# Spelled out here, because importing the members costs numpy; a test holds them together.
DISTANCES = (
    "euclidean",
    "manhattan",
    "chebyshev",
    "mahalanobis",
    "haversine",
    "iou",
    "gaussian-wasserstein",
    "cloud-wasserstein",
)
SOLVERS = ("certified", "exact", "sinkhorn")
GRIDS = ("union", "truth", "estimate", "common")
FORMATS = ("table", "json", "csv", "markdown", "latex")
FILE_FORMATS = ("csv", "parquet", "motchallenge", "kitti", "npz")

_metric = partial(option, section="Metric")
_files = partial(option, section="Files")
_filters = partial(option, section="Filters")
_solver = partial(option, section="Solver")
_output = partial(option, section="Output")
_gate = partial(option, section="Gate")
_general = partial(option, section="General")

METRIC = (
    _metric(
        "-c",
        "--cutoff",
        type=float,
        metavar="C",
        show_default="10.0; 0.5 with iou",
        help="Cutoff c > 0, in state units. A true and an estimated state farther apart than c are "
        "not matched: they are one missed and one false target, which together cost as much as an "
        "error of c.",
    ),
    _metric(
        "-p",
        "--order",
        type=float,
        metavar="P",
        default=2,
        help="Order p >= 1: errors are raised to this power before they are summed. It does not "
        "change the distance between two states.",
    ),
    _metric(
        "-g",
        "--switch-penalty",
        "--gamma",
        type=float,
        metavar="GAMMA",
        show_default="2.0; 0.5 with iou",
        help="Switch penalty gamma >= 0, in state units: what a track switch costs. 0 gives "
        "per-step GOSPA, summed.",
    ),
    _metric(
        "--distance",
        type=click.Choice(DISTANCES),
        default="euclidean",
        metavar="NAME",
        help="Distance between two states: euclidean, manhattan, chebyshev, mahalanobis, "
        "haversine (metres, from lat,lon), iou (1 - IoU of boxes left,top,width,height), "
        "gaussian-wasserstein (means and covariances) or cloud-wasserstein (particles, with a "
        "column weight).",
    ),
    _metric(
        "--covariance",
        metavar="FILE",
        type=click.Path(readable=False),
        help="Covariance matrix for mahalanobis: a CSV file without header, with a row and a "
        "column for each state column.",
    ),
    _metric(
        "--periodic",
        metavar="NAME[=PERIOD]",
        multiple=True,
        help="State columns that wrap around, such as angles: theta (period 2 pi), theta=360. "
        "Several with commas.",
    ),
    _metric(
        "--scale",
        metavar="NAME=FACTOR",
        multiple=True,
        help="State units for one unit of a column: with theta=2 an error of 1 in theta counts "
        "as 2. Several with commas.",
    ),
)

FILES = (
    _files(
        "--columns",
        metavar="NAMES",
        show_default="x[,y[,z]], else lat,lon, else the centres of boxes",
        help="State columns, in order: x,y. NAME=HEADER says what a column is called in the files: "
        "id=trk,t=clock,x=px,y=py. A file without that header is read by the usual names.",
    ),
    _files("--truth-columns", metavar="NAMES", help="--columns for TRUTH alone."),
    _files("--estimate-columns", metavar="NAMES", help="--columns for ESTIMATE alone."),
    _files(
        "--truth-format",
        type=click.Choice(FILE_FORMATS),
        metavar="FORMAT",
        show_default="found from name and content",
        help="Format of TRUTH: csv, parquet, motchallenge, kitti or npz.",
    ),
    _files(
        "--estimate-format",
        type=click.Choice(FILE_FORMATS),
        metavar="FORMAT",
        show_default="found from name and content",
        help="Format of ESTIMATE, one of the same.",
    ),
    _files(
        "--time-tolerance",
        type=float,
        metavar="DT",
        default=0.0,
        help="Times of the two files that differ by at most DT are one step, nearest to nearest; "
        "in seconds for ISO times.",
    ),
    _files(
        "--grid",
        type=click.Choice(GRIDS),
        metavar="NAME",
        default="union",
        help="Steps that count: those of either file (union), of the truth, of the estimate, or "
        "those of both (common). Rows at other steps are left out.",
    ),
    _files(
        "--on-duplicate",
        type=click.Choice(("error", "first", "last")),
        metavar="NAME",
        default="error",
        help="What to do with two rows of one id at one time: error, or keep the first or last.",
    ),
    _files(
        "--decimal",
        type=click.Choice((".", ",")),
        default=".",
        help="Decimal mark in the files.",
    ),
    _files(
        "--max-input",
        type=click.FloatRange(min=0),
        metavar="GB",
        show_default="what is available",
        help="Memory that reading one file may take; 0 for any.",
    ),
)

FILTERS = (
    _filters(
        "--time",
        metavar="A:B",
        help="Only the steps from A to B, both included; numbers or ISO times, as in the files. "
        "A or B may be left out.",
    ),
    _filters(
        "--class",
        "class_",
        metavar="A[,B]",
        help="Only rows with these values in column class, in each file that has one.",
    ),
    _filters("--truth-class", metavar="A[,B]", help="--class for TRUTH alone."),
    _filters("--estimate-class", metavar="A[,B]", help="--class for ESTIMATE alone."),
    _filters(
        "--region",
        metavar="RANGES",
        help="Only rows inside ranges of columns, ends included: x=-50:50,y=0:100. Either end may "
        "be left out.",
    ),
    _filters(
        "--by",
        type=click.Choice(("class",)),
        metavar="class",
        help="One result for each class, and their sum. States of different classes are never "
        "matched.",
    ),
)

SOLVER = (
    _solver(
        "--solver",
        type=click.Choice(SOLVERS),
        metavar="NAME",
        default="certified",
        help="certified: exact, with proven bounds; exact: another, slower method to check it "
        "with (CVXPY and Clarabel); sinkhorn: an approximation with proven bounds.",
    ),
    _solver(
        "--gap",
        type=float,
        metavar="G",
        default=1e-9,
        help="Relative difference of the proven bounds on the total that counts as exact "
        "(certified), or at which to stop early (sinkhorn).",
    ),
    _solver(
        "--epsilon",
        type=float,
        metavar="E",
        default=0.03,
        help="Temperature of sinkhorn, as a fraction of c^p. A lower one is slower and nearer to "
        "the exact value.",
    ),
    _solver(
        "--time-limit",
        type=float,
        metavar="SECONDS",
        help="Stop solving after so long: the bounds proven by then are printed, and the exit "
        "status is 4.",
    ),
    _solver(
        "--jobs",
        type=COUNT,
        metavar="N",
        show_default="all cores",
        help="Number of threads; the result does not depend on it.",
    ),
)

UNIT = _output("--unit", help="Unit of the states, printed beside values: m. No number changes.")

EVALUATION = (*METRIC, *FILES, *FILTERS, UNIT, *SOLVER, *GAUSSIANS, *PARTICLES)

CONFIG_FILE = click.option(
    "--config",
    cls=Option,
    section="General",
    is_eager=True,
    callback=load_config,
    metavar="FILE",
    type=click.Path(readable=False),
    envvar="TGOSPA_EVAL_CONFIG",
    show_default="tgospa-eval.toml, else [tool.tgospa-eval] in pyproject.toml, in this folder",
    help="Read settings from a TOML file; the keys are the names of these options.",
)
QUIET = _general("-q", "--quiet", is_flag=True, help="Print no notices; warnings stay.")

PICTURES = (
    _output(
        "--pictures",
        metavar="FORMATS",
        default="png",
        help="Formats of the pictures of -o: png, svg, pdf, several with commas; or none.",
    ),
    _output(
        "--style",
        type=click.Choice(("screen", "paper")),
        metavar="NAME",
        default="screen",
        help="Style of the pictures: screen, or paper for one column of a journal, without titles.",
    ),
    _output(
        "--components",
        metavar="PARTS",
        show_default="all four",
        help="Parts of the cost in the pictures: localisation, missed, false, switch; several "
        "with commas.",
    ),
    _output(
        "--plane",
        metavar="X,Y",
        show_default="the first two columns",
        help="Axes of the picture of trajectories: two state columns, or one and t.",
    ),
)
"""Of the pictures in a folder."""

OUTPUT = (
    _output(
        "--format",
        "format_",
        type=click.Choice(FORMATS),
        metavar="FORMAT",
        default="table",
        help="What to print: table, json, csv (the costs of each step), markdown or latex.",
    ),
    _output(
        "-o",
        "--output",
        metavar="DIR",
        type=click.Path(readable=False),
        help="Write result.json, CSV tables, report.html and pictures to this folder.",
    ),
    *PICTURES,
    _output("--force", is_flag=True, help="Write into a folder with other files in it."),
    CONFIG_FILE,
    QUIET,
    _general("-v", "--verbose", is_flag=True, help="Print stages and their times on stderr."),
)

VERBOSE = OUTPUT[-1]
OF_PICTURES = tuple(KEYS[add][0] for add in PICTURES)

GATE = (
    _gate(
        "--baseline",
        metavar="FILE",
        type=click.Path(readable=False),
        help="Baseline to judge by, a JSON file that --update-baseline makes. A suite may name "
        "its own.",
    ),
    _gate(
        "--suite",
        metavar="FILE",
        type=click.Path(readable=False),
        help="TOML file that lists several pairs of files, instead of TRUTH ESTIMATE.",
    ),
    _gate(
        "--fail-on",
        metavar="RULE",
        multiple=True,
        show_default="total:+0.001%",
        help="Fail if a value is worse than in the baseline by more than this: total:+1%, "
        "counts.switch:+2. Values have the names of the JSON. Repeatable.",
    ),
    _gate(
        "--warn-on",
        metavar="RULE",
        multiple=True,
        help="The same, but only warn. Repeatable.",
    ),
    _gate(
        "--max",
        "maximum",
        metavar="NAME=VALUE",
        multiple=True,
        help="Fail if a value is above this, whatever the baseline says: tgospa=45. Repeatable. "
        "Without other rules no baseline is needed.",
    ),
    _gate(
        "--junit",
        metavar="FILE",
        type=click.Path(readable=False),
        help="Write a JUnit XML report.",
    ),
    _gate(
        "--github",
        is_flag=True,
        help="Write annotations to stderr, and a summary to the file that GITHUB_STEP_SUMMARY "
        "names.",
    ),
)


def evaluation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of everything that evaluates."""
    for add in reversed((*EVALUATION, *OUTPUT)):
        command = add(command)
    return command


def gate_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the gate, and of what it evaluates."""
    for add in reversed((*GATE, *EVALUATION, CONFIG_FILE, QUIET, VERBOSE)):
        command = add(command)
    return command


SOLVING = {"switch-penalty", "solver", "gap", "epsilon", "time-limit", "jobs"}
"""What a verb that solves nothing does without."""


def chosen_options(
    command: Callable[..., Any], keys: tuple[str, ...], more: tuple[Callable[[Any], Any], ...] = ()
) -> Callable[..., Any]:
    """Add some of the options of everything that evaluates, and more."""
    shared = [add for add in EVALUATION if KEYS[add][0] in keys]
    for add in reversed((*shared, *more, CONFIG_FILE, QUIET)):
        command = add(command)
    return command


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of everything that reads two files and measures distances."""
    shared = [add for add in EVALUATION if KEYS[add][0] not in SOLVING and add not in PARTICLES]
    for add in reversed((*shared, CONFIG_FILE, QUIET)):
        command = add(command)
    return command
