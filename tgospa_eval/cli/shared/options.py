"""The options of everything that evaluates."""

from collections.abc import Container
from functools import partial

import click

from tgospa_eval.cli.shared.clock_options import CLOCK_AND_UNIT
from tgospa_eval.cli.shared.option import PATH, Option, load_config, option
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
EXISTENCES = ("ignore", "use")
GRIDS = ("union", "truth", "estimate", "common")
REPORT_FORMATS = ("table", "json", "csv", "markdown", "latex")
FILE_FORMATS = (
    "csv",
    "parquet",
    "feather",
    "motchallenge",
    "visdrone",
    "kitti",
    "npz",
    "npy",
    "mat",
    "nuscenes",
    "argoverse",
)
NAMED_FORMATS = f"{', '.join(FILE_FORMATS[:-1])} or {FILE_FORMATS[-1]}"

_metric = partial(option, section="Metric")
_files = partial(option, section="Files")
_filters = partial(option, section="Filters")
_solver = partial(option, section="Solver")
_output = partial(option, section="Output")
_gate = partial(option, section="Gate")
_general = partial(option, section="General")

METRIC = (
    _metric(
        "-c, --cutoff C",
        "Cutoff c > 0, in state units. A true and an estimated state farther apart than c are not "
        "matched: they are one missed and one false target, which together cost as much as an "
        "error of c.",
        type=float,
        show_default="10.0; 0.5 with iou",
    ),
    _metric(
        "-p, --order P",
        "Order p >= 1: errors are raised to this power before they are summed. It does not change "
        "the distance between two states.",
        type=float,
        default=2,
    ),
    _metric(
        "-g, --switch-penalty, --gamma GAMMA",
        "Switch penalty gamma >= 0, in state units: what a track switch costs. 0 gives per-step "
        "GOSPA, summed.",
        type=float,
        show_default="2.0; 0.5 with iou",
    ),
    _metric(
        "--rho RHO",
        "Share of c^p that a false target costs, between 0 and 1; a missed one costs the rest. "
        "Other than 0.5 it is a quasi-metric: truth and estimate cannot be exchanged.",
        type=float,
        default=0.5,
    ),
    _metric(
        "--step-weights FILE",
        "What each step counts: CSV t,weight[,switch_weight]. The costs of a step are multiplied "
        "by its weight, the switches into it by its switch_weight, the same by default.",
        type=PATH,
    ),
    _metric(
        "--existence NAME",
        "use: states exist with the probabilities of the column existence, 1 where a file has none "
        "(experimental); ignore: all exist.",
        type=click.Choice(EXISTENCES),
        default="ignore",
    ),
    _metric(
        "--distance NAME",
        "Distance between two states: euclidean, manhattan, chebyshev, mahalanobis, haversine "
        "(metres, from lat,lon), iou (1 - IoU of boxes left,top,width,height), "
        "gaussian-wasserstein (means and covariances) or cloud-wasserstein (particles, with a "
        "column weight).",
        type=click.Choice(DISTANCES),
        default="euclidean",
    ),
    _metric(
        "--covariance FILE",
        "Covariance matrix for mahalanobis: a CSV file without header, with a row and a column "
        "for each state column.",
        type=PATH,
    ),
    _metric(
        "--periodic NAME[=PERIOD]",
        "State columns that wrap around, such as angles: theta (period 2 pi), theta=360. Several "
        "with commas.",
        multiple=True,
    ),
    _metric(
        "--scale NAME=FACTOR",
        "State units for one unit of a column: with theta=2 an error of 1 in theta counts as 2. "
        "Several with commas.",
        multiple=True,
    ),
)

FILE_OPTIONS = (
    _files(
        "--columns NAMES",
        "State columns, in order: x,y. NAME=HEADER says what a column is called in the files: "
        "id=trk,t=clock,x=px,y=py. A file without that header is read by the usual names.",
        show_default="x[,y[,z]], else lat,lon, else the centres of boxes",
    ),
    _files("--truth-columns NAMES", "--columns for TRUTH alone."),
    _files("--estimate-columns NAMES", "--columns for ESTIMATE alone."),
    *(
        _files(
            f"--{side}-format FORMAT",
            f"Format of {side.upper()}{which}.",
            type=click.Choice(FILE_FORMATS),
            show_default="found from name and content",
        )
        for side, which in (("truth", f": {NAMED_FORMATS}"), ("estimate", ", one of the same"))
    ),
    _files(
        "--time-tolerance DT",
        "Times of the two files that differ by at most DT are one step, nearest to nearest; 20ms, "
        "or a number, of seconds for ISO times.",
        default="0",
    ),
    _files(
        "--grid NAME",
        "Steps that count: those of either file (union), of the truth, of the estimate, or those "
        "of both (common). Rows at other steps are left out.",
        type=click.Choice(GRIDS),
        default="union",
    ),
    *(
        _files(f"--on-{fault} NAME", text, type=click.Choice(("error", *ways)), default="error")
        for fault, text, *ways in (
            ("duplicate", "Rows of one id and time: error, first or last.", "first", "last"),
            ("invalid", "Boxes of negative size, places out of range: error, or drop it.", "drop"),
        )
    ),
    _files(
        "--decimal [.|,]", "Decimal mark in the files.", type=click.Choice((".", ",")), default="."
    ),
    _files(
        "--max-input GB",
        "Memory that reading one file may take; 0 for any.",
        type=click.FloatRange(min=0),
        show_default="what is available",
    ),
)

FILTERS = (
    _filters(
        "--time A:B",
        "Only the steps from A to B, both included; numbers or ISO times, as in the files. A or B "
        "may be left out.",
    ),
    _filters(
        "--class A[,B]",
        "Only rows of these classes, in each file that has classes. Upper and lower case are alike "
        "where that is unambiguous.",
        name="class_",
    ),
    _filters("--truth-class A[,B]", "--class for TRUTH alone."),
    _filters("--estimate-class A[,B]", "--class for ESTIMATE alone."),
    _filters(
        "--region RANGES",
        "Only rows inside ranges of columns, ends included: x=-50:50,y=0:100. Either end may be "
        "left out.",
    ),
    _filters(
        "--by class",
        "One result for each class, and their sum. States of different classes are never matched.",
        type=click.Choice(("class",)),
    ),
    _filters(
        "--preprocess motchallenge",
        "With boxes: leave out estimates that match a distractor, and truths that are no "
        "pedestrians, as MOTChallenge 2016 and 2017 do before they evaluate.",
        type=click.Choice(("motchallenge",)),
    ),
)

SOLVER = (
    _solver(
        "--solver NAME",
        "certified: exact, with proven bounds; exact: another, slower method to check it with "
        "(CVXPY and Clarabel); sinkhorn: an approximation with proven bounds.",
        type=click.Choice(SOLVERS),
        default="certified",
    ),
    _solver(
        "--gap G",
        "Relative difference of the proven bounds on the total that counts as exact (certified), "
        "or at which to stop early (sinkhorn).",
        type=float,
        default=1e-9,
    ),
    _solver(
        "--epsilon E",
        "Temperature of sinkhorn, as a fraction of c^p. A lower one is slower and nearer to the "
        "exact value.",
        type=float,
        default=0.03,
    ),
    _solver(
        "--time-limit SECONDS",
        "Stop solving after so long: the bounds proven by then are printed, and the exit status "
        "is 4.",
        type=float,
    ),
    _solver(
        "--jobs N",
        "Number of threads; the result does not depend on it.",
        type=COUNT,
        show_default="all cores",
    ),
)

UNIT = _output("--unit TEXT", "Unit of the states, printed beside values: m. No number changes.")

EVALUATION = (
    *METRIC,
    *FILE_OPTIONS,
    *CLOCK_AND_UNIT,
    *FILTERS,
    UNIT,
    *SOLVER,
    *GAUSSIANS,
    *PARTICLES,
)
BY_KEY = {item.key: item for item in EVALUATION}
KNOWN = {key: item.is_flag for key, item in BY_KEY.items()}
"""Options of an evaluation by their names in a configuration file, and whether they are flags."""

WITH = Option(
    "--with NAMES",
    "Other metrics beside TGOSPA: hota, clear (MOTA), identity (IDF1), which need the extra mot; "
    "gospa, of each step by itself. Several with commas.",
    name="with_",
    section="Output",
)

SLICE = Option(
    "--slice NAME[=EDGES]",
    "Split costs by an attribute of truth and estimate at each step: a column (class, "
    "visibility=0:0.5:1), range=0:50:100, range@X,Y, speed, size, density, age, "
    "region=x=-50:50; visibility=weight for shares; two crossed with *. Repeatable.",
    name="slices",
    section="Output",
    multiple=True,
)

CONFIG_FILE = Option(
    "--config FILE",
    "Read settings from a TOML file, by the names of these options. One that is only found sets "
    "what is evaluated, and nothing else.",
    section="General",
    is_eager=True,
    callback=load_config,
    type=PATH,
    envvar="TGOSPA_EVAL_CONFIG",
    show_default="tgospa-eval.toml, else [tool.tgospa-eval] in pyproject.toml, in this folder",
)
QUIET = _general("-q, --quiet", "Print no notices; warnings stay.")

VERBOSE = _general("-v, --verbose", "Print stages and their times on stderr.")

PICTURE_OPTIONS = (
    _output(
        "--pictures FORMATS",
        "Formats of the pictures of -o: png, svg, pdf, several with commas; or none.",
        default="png",
    ),
    _output(
        "--style NAME",
        "Style of the pictures: screen, or paper for one column of a journal, without titles.",
        type=click.Choice(("screen", "paper")),
        default="screen",
    ),
    _output(
        "--components PARTS",
        "Parts of the cost in the pictures: localisation, missed, false, switch; several with "
        "commas.",
        show_default="all four",
    ),
    _output(
        "--plane X,Y",
        "Axes of the picture of trajectories: two state columns, or one and t.",
        show_default="the first two columns",
    ),
)
"""Of the pictures in a folder."""

OUTPUT = (
    _output(
        "--format FORMAT",
        "What to print: table, json, csv (the costs of each step), markdown or latex.",
        name="format_",
        type=click.Choice(REPORT_FORMATS),
        default="table",
    ),
    _output(
        "-o, --output DIR",
        "Write result.json, CSV tables, report.html and pictures to this folder.",
        type=PATH,
    ),
    *PICTURE_OPTIONS,
    _output("--force", "Write into a folder with other files in it."),
    CONFIG_FILE,
    QUIET,
    VERBOSE,
)

OF_PICTURES = tuple(item.key for item in PICTURE_OPTIONS)

GATE = (
    _gate(
        "--baseline FILE",
        "Baseline to judge by, a JSON file that --update-baseline makes. A suite may name its own.",
        type=PATH,
    ),
    _gate(
        "--suite FILE",
        "TOML file that lists several pairs of files, instead of TRUTH ESTIMATE.",
        type=PATH,
    ),
    _gate(
        "--fail-on RULE",
        "Fail if a value is worse than in the baseline by more than this: total:+1%, "
        "counts.switch:+2. Values have the names of the JSON. Repeatable.",
        multiple=True,
        show_default="total:+0.001%",
    ),
    _gate("--warn-on RULE", "The same, but only warn. Repeatable.", multiple=True),
    _gate(
        "--max NAME=VALUE",
        "Fail if a value is above this, whatever the baseline says: tgospa=45. Repeatable. "
        "Without other rules no baseline is needed.",
        name="maximum",
        multiple=True,
    ),
    _gate("--junit FILE", "Write a JUnit XML report.", type=PATH),
    _gate(
        "--github",
        "Write annotations to stderr, and a summary to the file that GITHUB_STEP_SUMMARY names.",
    ),
)

SOLVING_KEYS = (
    *("switch-penalty", "rho", "step-weights", "existence"),
    *("solver", "gap", "epsilon", "time-limit", "jobs"),
)
"""What a verb that solves nothing does without."""

GATE_OPTIONS = (*GATE, *EVALUATION, CONFIG_FILE, QUIET, VERBOSE)
READING = (
    *(item for item in EVALUATION if item.key not in SOLVING_KEYS and item not in PARTICLES),
    CONFIG_FILE,
    QUIET,
)
"""Of everything that reads two files and measures distances."""


def chosen_options(keys: Container[str], *more: Option) -> tuple[Option, ...]:
    """Some of the options of everything that evaluates, and more."""
    return (*(item for item in EVALUATION if item.key in keys), *more, CONFIG_FILE, QUIET)


def format_option(*names: str) -> Option:
    """``--format`` of a verb with formats of its own, which no settings file chooses."""
    return Option(
        f"--format [{'|'.join(names)}]",
        "What to print.",
        name="format_",
        section="Output",
        type=click.Choice(names),
        default="table",
    )
