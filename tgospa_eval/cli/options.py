"""The options of everything that evaluates, and where their values come from."""

from collections.abc import Callable
from typing import Any

import click

from tgospa_eval import config
from tgospa_eval.cli import CONFIG

CUTOFF = 10.0
SWITCH_PENALTY = 2.0
# Spelled out here, because importing the members costs numpy; a test holds them together.
DISTANCES = (
    "euclidean", "manhattan", "chebyshev", "mahalanobis", "haversine", "iou",
    "gaussian-wasserstein", "cloud-wasserstein",
)  # fmt: skip
REDUCTIONS = (
    "sliced", "recursive", "atl", "kmeans", "systematic", "stratified", "multinomial", "top",
)  # fmt: skip
SOLVERS = ("certified", "exact", "sinkhorn")
GRIDS = ("union", "truth", "estimate", "common")
FORMATS = ("table", "json", "csv", "markdown", "latex")
FILE_FORMATS = ("csv", "parquet", "motchallenge", "kitti", "npz")


KEYS: dict[Callable[[Any], Any], tuple[str, bool]] = {}
"""Of each option its key in a configuration file, and whether it is a flag."""


def option(*names: str, **settings: Any) -> Callable[[Any], Any]:
    """Make a click option that also reads the environment variable TGOSPA_EVAL_<OPTION>."""
    long = next(name for name in names if name.startswith("--")).split("/")[0]
    variable = "TGOSPA_EVAL_" + long.lstrip("-").replace("-", "_").upper()
    made = click.option(*names, envvar=variable, **{"show_default": True, **settings})
    KEYS[made] = long.lstrip("-"), settings.get("is_flag", False)
    return made


def _load_config(ctx: click.Context, parameter: click.Parameter, path: str | None) -> str | None:
    """Settings of the options that the verb has; a file may hold those of other verbs as well."""
    taken = {
        item.opts[-1].lstrip("-"): item
        for item in ctx.command.params
        if isinstance(item, click.Option) and item is not parameter and item.envvar
    }
    used, settings = config.load(path, dict(KEYS.values()))
    ctx.meta[CONFIG] = used
    named = {
        taken[key].name: (value,) if taken[key].multiple else value
        for key, value in settings.items()
        if key in taken
    }
    ctx.default_map = {**(ctx.default_map or {}), **named}
    return used


_COUNT = click.IntRange(min=1)
REDUCTION = (
    option(
        "--reduce-method", type=click.Choice(REDUCTIONS), metavar="METHOD", show_default="sliced",
        help="sliced, recursive: least squares on projections; atl: transport and location in "
        "turn; kmeans; systematic, stratified, multinomial: resampling; top: highest weights.",
    ),
    option(
        "--directions", type=_COUNT, metavar="V", show_default="32, from 3-D on 24 each",
        help="Of sliced and recursive: projections.",
    ),
    option(
        "--iterations", type=_COUNT, metavar="K", show_default="25",
        help="Of the first four methods, at most.",
    ),
    option(
        "--restarts", type=_COUNT, metavar="K", show_default="1",
        help="Starts of these, of which the nearest result is kept.",
    ),
    option(
        "--polish", type=click.IntRange(min=0), metavar="K", show_default="0",
        help="Steps of atl after sliced and recursive.",
    ),
    option(
        "--seed", type=click.IntRange(min=0), show_default="0",
        help="Of what is random; equal clouds are reduced alike.",
    ),
)  # fmt: skip
"""How clouds are reduced; without defaults, to see what was given."""

PARTICLES = (
    option(
        "--cloud-order", type=click.IntRange(1, 2), show_default="2",
        help="Order of cloud-wasserstein, whatever the order p.",
    ),
    option(
        "--inner", type=click.Choice(("euclidean", "mahalanobis")), show_default="euclidean",
        help="Of cloud-wasserstein: distance of particles.",
    ),
    option(
        "--inner-cov", metavar="global|FILE", show_default="global",
        help="Of --inner mahalanobis: its covariance, global: mean of all clouds; or a CSV matrix; "
        "associate also pair, its default: mean of the two.",
    ),
    option(
        "--reduce", type=_COUNT, metavar="N",
        help="Of cloud-wasserstein: clouds are reduced to N particles first.",
    ),
    *REDUCTION,
    option(
        "--no-gating", is_flag=True,
        help="Of cloud-wasserstein: solve all pairs, to check the bounds.",
    ),
)  # fmt: skip
"""Of clouds as states."""

EVALUATION = (
    option(
        "-c", "--cutoff", type=float, default=CUTOFF, show_default="10.0, of iou 0.5",
        help="Cutoff c > 0: an error counts at most c; in state units.",
    ),
    option(
        "-p", "--order", type=float, default=2,
        help="Order p >= 1 of the sum (never the norm of the distance).",
    ),
    option(
        "-g", "--switch-penalty", type=float, default=SWITCH_PENALTY,
        show_default="2.0, of iou 0.5",
        help="gamma >= 0, price of a track switch in state units; 0 sums per-step GOSPA.",
    ),
    option(
        "--distance", type=click.Choice(DISTANCES), default="euclidean", metavar="NAME",
        help="Base distance between two states: euclidean, manhattan, chebyshev, mahalanobis, "
        "haversine (metres from lat,lon), iou (boxes left,top,width,height), "
        "gaussian-wasserstein (means and covariances), cloud-wasserstein (particles with a "
        "column weight).",
    ),
    *PARTICLES,
    option(
        "--covariance", metavar="FILE", type=click.Path(),
        help="Of mahalanobis: CSV file with a matrix d x d, without header.",
    ),
    option(
        "--periodic", metavar="NAME[=PERIOD]", multiple=True,
        help="State columns on a circle: theta, theta=360.  [default period: 2 pi]",
    ),
    option(
        "--scale", metavar="NAME=FACTOR", multiple=True,
        help="State units per unit of a column: theta=2.0.",
    ),
    option(
        "--columns", metavar="NAMES",
        help="State columns in order, x,y; id=HEADER and x=HEADER map headers.  "
        "[default: x[,y[,z]], else lat,lon, else centres of boxes]",
    ),
    option(
        "--fix-cov", is_flag=True,
        help="Of gaussian-wasserstein: replace what is no covariance by the nearest matrix that "
        "is.",
    ),
    option(
        "--missing-cov", type=click.Choice(("error", "zero")), default="error",
        help="Of gaussian-wasserstein: a row with blank covariance is wrong, or a point.",
    ),
    option(
        "--mixed", type=click.Choice(("error", "moments")), default="error",
        help="Of gaussian-wasserstein: clouds are wrong, or taken by mean and covariance.",
    ),
    option(
        "--solver", type=click.Choice(SOLVERS), default="certified",
        help="certified: exact with proof; exact: CVXPY + Clarabel, the slow referee; "
        "sinkhorn: approximation with a proven bracket.",
    ),
    option(
        "--gap", type=float, default=1e-9,
        help="Relative gap of the total that counts as exact (certified), or at which to stop "
        "early (sinkhorn).",
    ),
    option(
        "--epsilon", type=float, default=0.03,
        help="Temperature of sinkhorn, as a fraction of c^p.",
    ),
    option(
        "--time-limit", type=float, metavar="SECONDS",
        help="Stop solving after so long; the bracket reached is printed, exit 4.",
    ),
    option(
        "--jobs", type=click.IntRange(min=1), metavar="N",
        help="Threads; the result does not depend on it.  [default: all cores]",
    ),
    option(
        "--time-tolerance", type=float, default=0.0,
        help="Stamps of the two files at most so far apart are one step (nearest, one to one); "
        "seconds for ISO times.",
    ),
    option(
        "--grid", type=click.Choice(GRIDS), default="union",
        help="Steps that count: those of either file, of one, of both; rows at others are left "
        "out.",
    ),
    option(
        "--on-duplicate", type=click.Choice(("error", "first", "last")), default="error",
        help="What to do with a repeated (id, t).",
    ),
    option(
        "--decimal", type=click.Choice((".", ",")), default=".",
        help="Decimal mark in the files.",
    ),
    option(
        "--truth-format", type=click.Choice(FILE_FORMATS),
        help="Format of TRUTH.  [default: guessed by name and content]",
    ),
    option(
        "--estimate-format", type=click.Choice(FILE_FORMATS),
        help="Format of ESTIMATE, likewise.",
    ),
    option(
        "--time", metavar="A:B",
        help="Steps from A to B, both included, numbers or ISO times; either may be blank.",
    ),
    option("--class", "class_", metavar="A[,B]", help="Rows of these classes."),
    option(
        "--region", metavar="RANGES",
        help="Rows inside, x=-50:50,y=0:100; either end may be blank.",
    ),
    option(
        "--by", type=click.Choice(("class",)),
        help="One result per class and their sum; pairs never cross classes.",
    ),
    option("--unit", help="Unit of the states, for printing: m."),
)  # fmt: skip

CONFIG_FILE = click.option(
    "--config", is_eager=True, callback=_load_config, metavar="FILE",
    type=click.Path(), envvar="TGOSPA_EVAL_CONFIG",
    help="Settings, keys as these options.  "
    "[default: tgospa-eval.toml, else [tool.tgospa-eval] in pyproject.toml]",
)  # fmt: skip
QUIET = option("-q", "--quiet", is_flag=True, help="No notices.")

PICTURES = (
    option(
        "--pictures", metavar="FORMATS", default="png",
        help="Of -o: png, svg, pdf, with commas, or none.",
    ),
    option(
        "--style", type=click.Choice(("screen", "paper")), default="screen",
        help="Of the pictures: with titles; or small, for a column of a journal.",
    ),
    option(
        "--components", metavar="PARTS", show_default="all four",
        help="Of the pictures of costs: localisation, missed, false, switch, with commas.",
    ),
    option(
        "--plane", metavar="X,Y", show_default="the first two columns",
        help="Of the picture in the plane: two state columns, or t.",
    ),
)  # fmt: skip
"""Of the pictures in a folder."""

OUTPUT = (
    option(
        "--format", "format_", type=click.Choice(FORMATS), default="table",
        help="What to print: csv is per step.",
    ),
    option(
        "-o", "--output", metavar="DIR", type=click.Path(),
        help="Write result.json, CSV tables, report.html and pictures to this folder.",
    ),
    *PICTURES,
    option("--force", is_flag=True, help="Write into a folder with other files in it."),
    CONFIG_FILE,
    QUIET,
    option("-v", "--verbose", is_flag=True, help="Stages and timings on stderr."),
)  # fmt: skip

VERBOSE = OUTPUT[-1]
OF_PICTURES = tuple(KEYS[add][0] for add in PICTURES)

GATE = (
    option(
        "--baseline", metavar="FILE", type=click.Path(),
        help="Values to judge against; a suite may name it itself.",
    ),
    option(
        "--suite", metavar="FILE", type=click.Path(),
        help="TOML file with several pairs, instead of TRUTH ESTIMATE.",
    ),
    option(
        "--fail-on", metavar="RULE", multiple=True,
        help="PATH:+N or PATH:+N%, how much worse PATH may be than in the baseline; repeatable.  "
        "[default: total:+0.001%]",
    ),
    option(
        "--warn-on", metavar="RULE", multiple=True, help="The same, for a warning only.",
    ),
    option(
        "--max", "maximum", metavar="NAME=VALUE", multiple=True,
        help="The most that a value may be, whatever the baseline says; repeatable.",
    ),
    option(
        "--junit", metavar="FILE", type=click.Path(), help="Write a JUnit XML report.",
    ),
    option(
        "--github", is_flag=True,
        help="Annotations on stderr, and Markdown to the file that GITHUB_STEP_SUMMARY names.",
    ),
)  # fmt: skip


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
