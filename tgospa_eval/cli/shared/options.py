"""The options of everything that evaluates."""

import re
from collections.abc import Container, Mapping
from functools import partial
from typing import Any

import click

from tgospa_eval.cli.shared.option import PATH, Option, load_config, option
from tgospa_eval.common import config
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import quoted

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


# -------------------------------------------------------------------------------------------------
# The options of states that are more than points: Gaussians, and clouds of particles.

REDUCTIONS = (
    "sliced",
    "recursive",
    "atl",
    "kmeans",
    "systematic",
    "stratified",
    "multinomial",
    "top",
)

COUNT = click.IntRange(min=1)
_gaussians = partial(option, section="Gaussians")
_particles = partial(option, section="Particles")

GAUSSIANS = (
    _gaussians(
        "--fix-cov",
        "Replace a matrix that is no covariance by the nearest one that is. Without it such a "
        "matrix is an error.",
    ),
    _gaussians(
        "--missing-cov NAME",
        "A row without covariance is an error, or a point (zero).",
        type=click.Choice(("error", "zero")),
        default="error",
    ),
    _gaussians(
        "--mixed NAME",
        "A particle cloud is an error, or a Gaussian with its mean and covariance (moments).",
        type=click.Choice(("error", "moments")),
        default="error",
    ),
)

REDUCTION = (
    _particles(
        "--reduce-method METHOD",
        "How clouds are reduced. sliced, recursive: least squares on projections; atl: transport "
        "and new locations in turn; kmeans: clustering; systematic, stratified, multinomial: "
        "resampling; top: the highest weights.",
        type=click.Choice(REDUCTIONS),
        show_default="sliced",
    ),
    _particles(
        "--directions N",
        "Number of projections of sliced and recursive.",
        type=COUNT,
        show_default="32; 24 each from 3-D on",
    ),
    _particles(
        "--iterations N",
        "Most iterations of sliced, recursive, atl and kmeans.",
        type=COUNT,
        show_default="25",
    ),
    _particles(
        "--restarts N",
        "Number of starts of these four; the nearest result is kept.",
        type=COUNT,
        show_default="1",
    ),
    _particles(
        "--polish N",
        "Number of atl iterations after sliced and recursive.",
        type=click.IntRange(min=0),
        show_default="0",
    ),
    _particles(
        "--seed N",
        "Seed of the random choices; equal clouds are reduced alike.",
        type=click.IntRange(min=0),
        show_default="0",
    ),
)
"""How clouds are reduced; without defaults, to see what was given."""

PARTICLES = (
    _particles(
        "--cloud-order 1|2",
        "Order of the Wasserstein distance, whatever the order p of the metric is.",
        type=click.IntRange(1, 2),
        show_default="2",
    ),
    _particles(
        "--inner NAME",
        "Distance between two particles: euclidean or mahalanobis.",
        type=click.Choice(("euclidean", "mahalanobis")),
        show_default="euclidean",
    ),
    _particles(
        "--inner-cov global|FILE",
        "Covariance of --inner mahalanobis. global: the mean over all clouds; or a CSV file with "
        "a matrix. With associate also pair, its default: the mean of the two clouds.",
        show_default="global",
    ),
    _particles("--reduce N", "Reduce clouds to N particles first.", type=COUNT),
    *REDUCTION,
    _particles(
        "--no-gating",
        "Solve all pairs of clouds, also those that bounds show to be far apart. Slow; to check "
        "the bounds.",
    ),
)
"""Of clouds as states."""


# -------------------------------------------------------------------------------------------------
# Options for data that are larger than memory.

BYTES_OF = {"": 10**9, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
BYTES_OF |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}

LEAST_MEMORY = 100 * 10**6
"""Bytes with which a process can work at all."""


class Size(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4
    """Bytes as people write them: 4GB, 500MB, 1.5GiB; a number alone is of GB."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """The bytes."""
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            self.fail(f"{value!r} is no size; write 4GB or 500MB", param, ctx)
        found = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([A-Za-z]*)\s*", str(value))
        unit = BYTES_OF.get(found[2].upper()) if found else None
        if found is None or unit is None:
            self.fail(
                f"{str(value)!r} is no size; write 4GB or 500MB, a number alone is of GB",
                param,
                ctx,
            )
        size = float(found[1]) * unit
        if not LEAST_MEMORY <= size < 2**60:
            self.fail(f"{value} is less than 100MB, or more than there is", param, ctx)
        return int(size)


MEMORY_OPTION = option(
    "--memory SIZE",
    "Memory that the evaluation may take, 4GB or 500MB. Folders of Parquet or CSV files, and files "
    "that would take more, are read and evaluated in parts. With --scheduler that of each worker.",
    section="Files",
    type=Size(),
    show_default="half of the machine's",
)
SCHEDULER_OPTION = option(
    "--scheduler ADDRESS",
    "For data in parts: use the workers of a Dask cluster that is there, tcp://host:8786. Default: "
    "as many processes as --jobs says.",
    section="Solver",
)
IN_PARTS_OPTIONS = (MEMORY_OPTION, SCHEDULER_OPTION)


# -------------------------------------------------------------------------------------------------
# The options of everything that evaluates.

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


# -------------------------------------------------------------------------------------------------
# Settings of files as click would have made them of the same options.


def typed_options(
    context: click.Context, settings: Mapping[str, object], where: str
) -> dict[str, object]:
    """Values of options of an evaluation, by parameter; `where` begins the messages.

    Raises
    ------
    ConfigError
        An option is unknown, or its value has no meaning.
    """
    values: dict[str, object] = {}
    for key, value in config.settings_of(settings, where, KNOWN).items():
        item = BY_KEY[key]
        try:
            values[str(item.name)] = item.type_cast_value(
                context, (value,) if item.multiple else value
            )
        except click.BadParameter as error:
            raise ConfigError(f"{where}: {quoted(key)}: {error.message}") from None
        except (ValueError, OverflowError) as error:
            raise ConfigError(f"{where}: {quoted(key)}: {error}") from None
    return values
