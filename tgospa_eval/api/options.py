"""Options of an evaluation and of a batch: declared once, for the command line and for Python.

This module imports nothing that is slow to import, because the help of the command line needs it.
"""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

from tgospa_eval.common import config
from tgospa_eval.common.config import SettingsFile, Values, setting
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import parsed, parsed_whole
from tgospa_eval.distances import DISTANCES
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats import FORMATS
from tgospa_eval.quoting import quoted

if TYPE_CHECKING:
    from tgospa_eval.show.batch import BandKind

# Copies of names from modules that import numpy, which is slow. Tests compare both.
SOLVERS = ("certified", "exact", "sinkhorn")
EXISTENCES = ("ignore", "use")
BAND_KINDS = ("interval", "bootstrap", "percentiles", "deviation")
LAYOUTS = ("motchallenge", "kitti")
GRIDS = ("union", "truth", "estimate", "common")
INTERPOLATED = ("estimate", "truth")
PREPROCESS = tuple(
    f"{name}{how}"
    for name in ("motchallenge", "kitti", "visdrone", "uadetrac")
    for how in ("", ":delete", ":ignore")
)
ITERATED = ("sliced", "recursive", "atl", "kmeans")
RANDOM = (*ITERATED, "systematic", "stratified", "multinomial")
REDUCTIONS = (*RANDOM, "top")

FITTING = "leave it out, or evaluate a part that fits into memory as one file"
FILTER_FIRST = "write the rows to evaluate to new files first"
RESAMPLE_FIRST = "resample first: write truth and estimate at common times to new files"


_metric = partial(setting, "Metric")
_track_metric = partial(_metric, sensors=False)
_files = partial(setting, "Files")
_filters = partial(setting, "Filters")
_track_filters = partial(_filters, sensors=False)
_solver = partial(setting, "Solver", trusted=False, sensors=False)
_gaussians = partial(setting, "Gaussians", whose="gaussian-wasserstein and NEES")
_particles = partial(setting, "Particles", whose="distances of clouds")
_output = partial(setting, "Output")
_beside = partial(_output, number=False, everywhere=False, stored=False)


def _one_side(
    declare: Callable[..., Any], declaration: str, *, like_truth: bool = False, **about: Any
) -> Any:
    """Declare an option that is for truth or estimate only.

    Its help refers to the option for both, or with `like_truth` to the option for the truth.
    """
    side, _, name = declaration.removeprefix("--").partition(" ")[0].partition("-")
    text = f"--truth-{name} for ESTIMATE." if like_truth else f"--{name} for {side.upper()} alone."
    return declare(declaration, text, **about)


@dataclass(frozen=True, kw_only=True)
class Request(Values):
    """Options of an evaluation; None for options that were not given.

    The help of an option describes its field. Three fields are no options:

    - `pairwise`: whether a distance can use the covariances of each pair
    - `sides`: first words of the options for a single file, ``truth`` in ``--truth-columns``
    - `summed`: whether slices are added to the slices of other evaluations
    """

    cutoff: float | None = _metric(
        "-c, --cutoff C",
        "Cutoff c > 0, in state units. A true and an estimated state farther apart than c are not "
        "matched: they are one missed and one false target, which together cost as much as an "
        "error of c.",
        shown="10.0; 0.5 with iou",
    )
    order: float = _track_metric(
        "-p, --order P",
        "Order p >= 1: errors are raised to this power before they are summed. It does not change "
        "the distance between two states.",
        default=2.0,
        shown="2",
    )
    switch_penalty: float | None = _track_metric(
        "-g, --switch-penalty, --gamma GAMMA",
        "Switch penalty gamma >= 0, in state units: what a track switch costs. 0 gives per-step "
        "GOSPA, summed.",
        shown="2.0; 0.5 with iou",
    )
    rho: float = _track_metric(
        "--rho RHO",
        "Share of c^p that a false target costs, between 0 and 1; a missed one costs the rest. "
        "Other than 0.5 it is a quasi-metric: truth and estimate cannot be exchanged.",
        default=0.5,
    )
    step_weights: str | None = _track_metric(
        "--step-weights FILE",
        "Weights of the steps: CSV t,weight[,switch_weight]. The costs of a step are multiplied "
        "by its weight, the switches into it by its switch_weight, by default its weight.",
        parts=FITTING,
    )
    existence: str = _track_metric(
        "--existence NAME",
        "use: states exist with the probabilities in the column existence, with 1 in a file "
        "without it (experimental). ignore: all states exist.",
        default="ignore",
        choices=EXISTENCES,
        parts="leave it out: all objects exist then",
    )
    distance: str | None = _metric(
        "--distance NAME",
        "Distance between two states: euclidean, manhattan, chebyshev, mahalanobis, haversine "
        "(metres on a sphere, from lat,lon), geodesic (on the ellipsoid, also with heights, from "
        "lat,lon,alt), iou (1 - IoU of boxes left,top,width,height), "
        "gaussian-wasserstein (means and covariances), cloud-wasserstein (particles, with a column "
        "weight), or, on projections of these, sliced-wasserstein and max-sliced-wasserstein.",
        choices=DISTANCES,
        shown="euclidean; lat,lon need a choice",
    )
    covariance: str | None = _metric(
        "--covariance FILE",
        "Covariance matrix for mahalanobis: a CSV file without header, with a row and a column for "
        "each state column.",
        whose="mahalanobis",
    )
    vertical_weight: float | None = _metric(
        "--vertical-weight W",
        "Weight of a metre of height beside a metre along the surface, with --distance geodesic "
        "of lat,lon,alt.",
        shown="1",
        whose="geodesic",
    )
    periodic: tuple[str, ...] = _metric(
        "--periodic NAME[=PERIOD]",
        "State columns that wrap around, such as angles: theta (period 2 pi), theta=360. Separate "
        "several with commas.",
        default=(),
        whose="the norms and gaussian-wasserstein",
    )
    scale: tuple[str, ...] = _metric(
        "--scale NAME=FACTOR",
        "State units for one unit of a column: with theta=2 an error of 1 in theta counts as 2. "
        "Separate several with commas.",
        default=(),
        whose="the norms, mahalanobis, gaussian-wasserstein and distances of clouds",
    )
    columns: str | None = _files(
        "--columns NAMES",
        "State columns, in order: x,y. NAME=HEADER gives the header of a column: "
        "id=trk,t=clock,x=px,y=py. A file without that header is read by the usual names.",
        shown="x[,y[,z]], else lat,lon, else the centres of boxes",
    )
    truth_columns: str | None = _one_side(_files, "--truth-columns NAMES")
    estimate_columns: str | None = _one_side(_files, "--estimate-columns NAMES")
    truth_format: str | None = _files(
        "--truth-format FORMAT",
        "Format of TRUTH: csv, parquet, feather, motchallenge, visdrone, kitti, npz, npy, mat, "
        "nuscenes, argoverse, json, xlsx, wide, deeplabcut, tum, yolo or csv-per-object.",
        choices=FORMATS,
        shown="found from name and content",
    )
    estimate_format: str | None = _files(
        "--estimate-format FORMAT",
        "Format of ESTIMATE, one of the same.",
        choices=FORMATS,
        shown="found from name and content",
    )
    time_tolerance: str = _files(
        "--time-tolerance DT",
        "Largest difference of times of the two files that are one step: 20ms, or a number "
        "(seconds for ISO times). Times are matched with the nearest.",
        default="0",
        parts="round the times of both sides before, or leave it out",
    )
    grid: str = _files(
        "--grid NAME",
        "Steps that count: those of either file (union), of the truth, of the estimate, or those "
        "of both (common). Rows at other steps are left out.",
        default="union",
        choices=GRIDS,
    )
    on_duplicate: str = _files(
        "--on-duplicate NAME",
        "What to do with several rows of one id and time: report an error, or use the first or "
        "the last.",
        default="error",
        choices=("error", "first", "last"),
    )
    on_invalid: str = _files(
        "--on-invalid NAME",
        "What to do with boxes of negative size and places out of range: report an error, or drop "
        "them.",
        default="error",
        choices=("error", "drop"),
    )
    decimal: str = _files(
        "--decimal [.|,]",
        "Decimal mark in the files.",
        default=".",
        choices=(".", ","),
    )
    max_input: float | None = _files(
        "--max-input GB",
        "Largest memory that reading one file may take; 0 is no limit.",
        low=0,
        shown="what is available",
        number=False,
        trusted=False,
    )
    interpolate: str | None = _files(
        "--interpolate SIDE",
        "Side to interpolate at the times of the other file: on the straight line between two "
        "states of a track that are at most --max-gap apart. By default nothing is interpolated.",
        choices=INTERPOLATED,
        parts=RESAMPLE_FIRST,
    )
    max_gap: str | None = _files(
        "--max-gap DT[,DT]",
        "Longest time between two states of a track across which it is interpolated. With "
        "--resample a second value, as in 200s,10s, is the longest time between two reports of an "
        "estimate that belong to one run. On both sides of a longer gap a report holds for half "
        "a period only.",
    )
    resample: str | None = _files(
        "--resample S",
        "Spacing S of a common clock, for trackers whose times differ: 3s, 200ms, 2min, or a "
        "number if times are numbers. The steps are the multiples of S from the first to the last "
        "time of the truth, which is interpolated within --max-gap. A report of the estimate "
        "holds for its --period and is compared at its own time.",
        parts=RESAMPLE_FIRST,
    )
    period: str | None = _files(
        "--period DT",
        "With --resample: the time for which a report of the estimate holds.",
        shown="the median interval between reports of a track",
    )
    steps: str | None = _files(
        "--steps FIRST:LAST[:EVERY]",
        "Evaluate exactly these steps. Values per step are divided by their number. A step "
        "without states in either file counts and costs nothing. EVERY is 1 for whole numbers. "
        "Rows at other times are left out.",
        shown="the times of both files; values per step divide by the number of times of the truth",
    )
    outage: str | None = _files(
        "--outage DT",
        "Shortest outage of the tracker, with --interpolate truth, --grid estimate or --grid "
        "common. If no estimate is within c of any true object for longer than this, the times of "
        "the truth there are steps too, and its objects are missed. none: the tracker reports "
        "only what it detects.",
        shown="five times the median time between states of the estimate near a truth",
    )
    time_offset: str = _files(
        "--time-offset DT",
        "Time that is added to the times of ESTIMATE, after --time-scale: -4.7, or for "
        "ISO times also 500ms. A number is seconds for ISO times.",
        default="0",
    )
    time_scale: float = _files(
        "--time-scale FACTOR",
        "Factor of the times of ESTIMATE: 0.001 converts milliseconds to seconds.",
        default=1.0,
    )
    unit_scale: float = _files(
        "--unit-scale FACTOR",
        "Factor of the state columns of ESTIMATE, except angles (--periodic, bearing, elevation), "
        "with covariances and particles: 1000 converts kilometres to metres.",
        default=1.0,
    )
    truth_crs: str | None = _files(
        "--truth-crs SYSTEM",
        "Coordinate system of TRUTH: lat,lon[,alt] (degrees, metres); enu (x east, y north, z up, "
        "metres from --origin) or ned (north, east, down), enu:30 if the axes are turned "
        "clockwise; range,bearing[,elevation] from a sensor at --origin; or a projected system, "
        "EPSG:25832. Both files are converted to one system, to local axes if either has them.",
        shown="lat,lon where the other file has one",
        parts=FITTING,
    )
    estimate_crs: str | None = _one_side(
        _files, "--estimate-crs SYSTEM", like_truth=True, parts=FITTING
    )
    origin: str | None = _files(
        "--origin LAT,LON[,ALT]",
        "Origin of local axes, or place of the sensor: degrees, and metres above the ellipsoid.",
    )
    truth_scale: tuple[str, ...] = _files(
        "--truth-scale NAME=FACTOR",
        "Factors of state columns of TRUTH, with covariances and particles: alt=0.3048 converts "
        "feet to metres, alt=30.48 flight levels. Separate several with commas.",
        default=(),
    )
    estimate_scale: tuple[str, ...] = _files(
        "--estimate-scale NAME=FACTOR",
        "--truth-scale for ESTIMATE: x=1000,y=1000 converts kilometres to metres.",
        default=(),
    )
    truth_time_format: str | None = _files(
        "--truth-time-format FORMAT",
        "Format of the times of TRUTH: as of strptime, '%d/%m/%Y %H:%M:%S'; s, ms, us or ns since "
        "1970; gps for week and seconds. --truth-columns t=DATE+TIME joins two columns.",
        shown="numbers or ISO times",
        parts=FITTING,
    )
    estimate_time_format: str | None = _one_side(
        _files, "--estimate-time-format FORMAT", like_truth=True, parts=FITTING
    )
    truth_time_zone: str | None = _files(
        "--truth-time-zone ZONE",
        "Time zone of times of TRUTH that have none: UTC, Europe/Copenhagen.",
        parts=FITTING,
    )
    estimate_time_zone: str | None = _one_side(
        _files, "--estimate-time-zone ZONE", like_truth=True, parts=FITTING
    )
    day_begins: float | None = _files(
        "--day-begins T",
        "For recordings across midnight: times of day before T belong to the next day, in both "
        "files. T is in the unit of the times, in seconds for texts: 43200 is noon.",
        low=0,
        parts=FITTING,
    )
    time: str | None = _filters(
        "--time A:B",
        "Only the steps from A to B, both included: numbers or ISO times, as in the files. A or B "
        "may be left out.",
    )
    class_: str | None = _filters(
        "--class A[,B]",
        "Only rows of these classes, in each file that has classes. Upper and lower case, and 1 "
        "and 01, are alike unless both occur.",
    )
    truth_class: str | None = _one_side(_filters, "--truth-class A[,B]")
    estimate_class: str | None = _one_side(_filters, "--estimate-class A[,B]")
    region: str | None = _filters(
        "--region REGION",
        "Only rows inside ranges of columns, x=-50:50,y=0:100, ends included, of which one may be "
        "left out; inside a circle, circle=LAT,LON,RADIUS, or circle=X,Y,RADIUS if states are not "
        "on the Earth; or inside the regions of a file, as with --ignore-regions.",
    )
    where: tuple[str, ...] = _filters(
        "--where TEST",
        "Only rows that pass a test, such as 'score >= 0.5 and type != van': comparisons (==, !=, "
        "<, <=, >, >=) of columns with a number or a text, joined by and. Names and texts with "
        "blanks need quotes. A blank field passes no comparison with a number. Repeatable.",
        default=(),
        parts=FILTER_FIRST,
    )
    truth_where: tuple[str, ...] = _filters(
        "--truth-where TEST",
        "--where for TRUTH alone, also for columns that only it has.",
        default=(),
        parts=FILTER_FIRST,
    )
    estimate_where: tuple[str, ...] = _one_side(
        _filters, "--estimate-where TEST", default=(), parts=FILTER_FIRST
    )
    by: str | None = _track_filters(
        "--by class",
        "One result for each class, and their sum. States of different classes are never matched.",
        choices=("class",),
        parts="evaluate one class after the other, by --class NAME",
    )
    preprocess: str | None = _track_filters(
        "--preprocess RULES",
        "Rules of a benchmark for boxes that are left out before the evaluation: motchallenge "
        "(2016 and 2017), kitti (with --class), visdrone or uadetrac (with --ignore-regions). "
        "NAME:delete is the same as NAME; NAME:ignore marks these boxes as not judged.",
        choices=PREPROCESS,
        parts="it is for files of benchmarks, which are not read in parts; --ignore and "
        "--ignore-regions say what is not judged",
    )
    ignore: tuple[str, ...] = _track_filters(
        "--ignore SPEC",
        "States of the truth to ignore: an estimate that follows one costs nothing, and neither "
        "does its absence. SPEC is a condition on a column (class=Van,Person, occlusion>1, "
        "height<25), or a word. marked: states with 1 in a column ignored; in-regions: states in "
        "--ignore-regions; truth-gaps: the straight line across gaps longer than --max-gap. Two "
        "words are about estimates, which cost nothing if they follow no object. "
        "outside-truth-steps: estimates at times at which TRUTH has no row; marked-estimates: "
        "estimates with 1 in a column excused, not for compare and gate. Repeatable.",
        default=(),
    )
    ignore_regions: str | None = _track_filters(
        "--ignore-regions FILE",
        "Regions in which a false estimate costs nothing: GeoJSON, or CSV of boxes, circles or "
        "polygons, with t if they are of one step. A point must be inside, of a box half of its "
        "area. Polygons need the extra regions.",
    )
    max_speed: float | None = _track_filters(
        "--max-speed V",
        "With --ignore truth-gaps: largest speed of a true object away from the line across a "
        "gap, in state units per second. An estimate is not judged if it is nearer to the line "
        "than c + V times the time to the nearer end of the gap.",
        shown="0",
    )
    unit: str | None = _output(
        "--unit TEXT",
        "Unit of the states, printed beside values: m. It changes no number.",
        sensors=False,
    )
    solver: str = _solver(
        "--solver NAME",
        "certified: exact, with proven bounds. exact: a slower method, to check it with (CVXPY "
        "and Clarabel). sinkhorn: an approximation with proven bounds.",
        default="certified",
        choices=SOLVERS,
        parts="leave it out: the solver certified is exact",
    )
    gap: float = _solver(
        "--gap G",
        "Relative difference of the proven bounds on the total at which a value counts as exact "
        "(certified), or at which sinkhorn stops early.",
        default=1e-09,
    )
    epsilon: float = _solver(
        "--epsilon E",
        "Temperature of sinkhorn, as a fraction of c^p. A lower temperature is slower and nearer "
        "to the exact value.",
        default=0.03,
    )
    time_limit: float | None = _solver(
        "--time-limit SECONDS",
        "Time after which solving stops. The bounds proven by then are printed, and the exit "
        "status is 4.",
    )
    jobs: int | None = _solver(
        "--jobs N",
        "Number of threads; the result does not depend on it.",
        low=1,
        shown="all cores",
        number=False,
        sensors=True,
    )
    fix_cov: bool = _gaussians(
        "--fix-cov",
        "Replace a matrix that is not a covariance by the nearest one that is. By default such a "
        "matrix is an error.",
    )
    missing_cov: str = _gaussians(
        "--missing-cov NAME",
        "What to do with a row without covariance: report an error, or compare it as a point "
        "(zero).",
        default="error",
        choices=("error", "zero"),
    )
    mixed: str = _gaussians(
        "--mixed NAME",
        "What to do with a particle cloud: report an error, or use its mean and covariance as a "
        "Gaussian (moments).",
        default="error",
        choices=("error", "moments"),
        whose="gaussian-wasserstein",
    )
    cloud_order: int | None = _particles(
        "--cloud-order 1|2",
        "Order of the Wasserstein distance, whatever the order p of the metric is.",
        low=1,
        high=2,
        shown="2",
    )
    inner: str | None = _particles(
        "--inner NAME",
        "Distance between two particles: euclidean or mahalanobis.",
        choices=("euclidean", "mahalanobis"),
        shown="euclidean",
    )
    inner_cov: str | None = _particles(
        "--inner-cov global|FILE",
        "Covariance of --inner mahalanobis. global: the mean over all clouds; or a CSV file with a "
        "matrix. With associate also pair, its default: the mean of the two clouds.",
        shown="global",
    )
    reduce: int | None = _particles(
        "--reduce N",
        "Reduce clouds to N particles first.",
        low=1,
    )
    reduce_method: str | None = _particles(
        "--reduce-method METHOD",
        "How clouds are reduced. sliced, recursive: least squares on projections; atl: transport "
        "and new locations in turn; kmeans: clustering; systematic, stratified, multinomial: "
        "resampling; top: the highest weights.",
        choices=REDUCTIONS,
        shown="sliced",
    )
    directions: int | None = _particles(
        "--directions N",
        "Number of projections, for the sliced distances and the methods sliced and recursive.",
        low=1,
        shown="32 in 2-D; 24 for each dimension from 3-D on",
        methods=ITERATED[:2],
    )
    iterations: int | None = _particles(
        "--iterations N",
        "Largest number of iterations of the methods sliced, recursive, atl and kmeans.",
        low=1,
        shown="25",
        methods=ITERATED,
    )
    restarts: int | None = _particles(
        "--restarts N",
        "Number of starts of the methods sliced, recursive, atl and kmeans; the nearest result is "
        "kept.",
        low=1,
        shown="1",
        methods=ITERATED,
    )
    polish: int | None = _particles(
        "--polish N",
        "Number of atl iterations after the methods sliced and recursive.",
        low=0,
        shown="0",
        methods=ITERATED[:2],
    )
    seed: int | None = _particles(
        "--seed N",
        "Seed of the random choices; equal clouds are reduced alike.",
        low=0,
        shown="0",
        methods=RANDOM,
    )
    no_gating: bool = _particles(
        "--no-gating",
        "Solve all pairs of clouds, also those that bounds show to be far apart. This is slow; "
        "use it to check the bounds.",
        trusted=False,
    )
    memory: int | None = _files(
        "--memory SIZE",
        "Limit of the memory of all processes together: 4GB or 500MB. Folders of Parquet or CSV "
        "files, and files that would take more, are read and evaluated in parts. With --scheduler "
        "it is the limit of each worker.",
        kind="size",
        shown="half of the machine's",
        number=False,
        trusted=False,
        everywhere=False,
    )
    scheduler: str | None = _solver(
        "--scheduler ADDRESS",
        "For data in parts: use the workers of a Dask cluster that is there, tcp://host:8786. "
        "Default: as many processes as --jobs says.",
        number=False,
        everywhere=False,
    )
    with_: str | None = _beside(
        "--with NAMES",
        "Other metrics beside TGOSPA: hota, clear (MOTA), identity (IDF1); gospa, of each step "
        "separately; nees, whether covariances are as large as errors, also if the distance "
        "compares points. Separate several with commas.",
        parts=FITTING,
    )
    slices: tuple[str, ...] = _beside(
        "--slice NAME[=EDGES]",
        "Split costs by an attribute of truth and estimate at each step: a column (class, "
        "visibility=0:0.5:1), range=0:50:100, range@X,Y, speed, size, density, age, or "
        "region=x=-50:50. NAME=weight splits each cost by the value of NAME, a share from 0 to 1. "
        "A*B combines two attributes. Repeatable.",
        default=(),
        parts=FITTING,
    )
    curve: bool = _beside(
        "--curve",
        "Evaluate the steps up to each step as well: the normalised metric over time.",
        parts=FITTING,
    )
    window: str | None = _beside(
        "--window W",
        "Also evaluate each window of W steps, or of a time such as 30min, separately: this shows "
        "where a tracker fails in a long recording. Windows begin at the first step and every S "
        "after it.",
        parts=FITTING,
    )
    every: str | None = _beside(
        "--every S",
        "Distance from the begin of one window to the next, at most W: steps, or a time if W is a "
        "time.",
        shown="half of W",
    )
    similarity: float | None = _beside(
        "--similarity N",
        "Also show a score from 0 to 1 of the value per step: 1 is perfect, and N false targets "
        "at each step score 0.1.",
    )
    tracked_shares: str = _beside(
        "--tracked-shares LOST:TRACKED",
        "Count an object as mostly tracked in the summary if at least the share TRACKED of its "
        "states is followed, and as mostly lost below LOST.",
        default="0.2:0.8",
    )
    explain: bool = _beside(
        "--explain",
        "Show the ten repairs of the estimate that are proven to save most, as the verb explain "
        "does; with -o also as files, and in report.html.",
        parts=FITTING,
    )

    summed: bool = False
    pairwise: bool = False
    sides: tuple[str, str] = ("truth", "estimate")

    @property
    def given(self) -> dict[str, object]:
        """Options that change the value or its bounds and differ from their defaults."""
        return {
            name: getattr(self, name)
            for name, default in OF_THE_NUMBER.items()
            if getattr(self, name) != default
        }


def is_coverage(region: str | None) -> bool:
    """Return whether the text of ``--region`` is a circle or a file, and not ranges of columns."""
    return region is not None and (region.startswith("circle=") or "=" not in region)


def names_file(name: str, value: object) -> bool:
    """Return whether the value of an option is the name of a file."""
    if name == "inner_cov":
        return value not in ("global", "pair")
    if name == "region":
        return is_coverage(str(value)) and not str(value).startswith("circle=")
    return name in OPTION_SPECS and OPTION_SPECS[name].kind == "path"


OPTION_SPECS = Request.settings()
"""Specification of each option, by the name of its field."""

NAMES = {about.key: name for name, about in OPTION_SPECS.items() if about.everywhere}
"""Field of each option that all evaluating commands have, by the name of the option in settings
files."""

OF_EVALUATE = tuple(name for name, about in OPTION_SPECS.items() if not about.everywhere)
"""Names of the fields whose options only `evaluate` has."""

DEFAULTS: dict[str, object] = {field.name: field.default for field in dataclasses.fields(Request)}

TYPES: dict[str, Any] = {field.name: field.type for field in dataclasses.fields(Request)}

FLAGS = {key: DEFAULTS[name] is False for key, name in NAMES.items()}
"""For each option in `NAMES`, whether it is a flag."""

PLAIN: dict[type, tuple[Callable[[str], float | None], str]] = {
    int: (parsed_whole, "whole number; write it as 10"),
    float: (parsed, "plain, finite number; write it as 2.5 or 1e-3"),
}


def typed(settings: Mapping[str, object], where: str) -> dict[str, Any]:
    """Convert the settings of a settings file to values of fields; messages begin with `where`.

    Raises
    ------
    ConfigError
        A setting is unknown, or its value is wrong.
    """
    values = config.settings_of(settings, where, FLAGS)
    return {NAMES[key]: _typed(NAMES[key], value, where, key) for key, value in values.items()}


def _typed(name: str, value: str | float, where: str, key: str) -> Any:
    about, fault = OPTION_SPECS[name], ""
    kinds = get_args(TYPES[name]) or (TYPES[name],)
    kind = next((kind for kind in (bool, int, float) if kind in kinds), str)
    made: Any = value
    if kind in PLAIN:
        parse, right = PLAIN[kind]
        made = parse(value) if isinstance(value, str) else kind(value)
        if made is None:
            fault = f"{value!r} is no {right}"
        elif (about.low is not None and made < about.low) or (
            about.high is not None and made > about.high
        ):
            ends = f"{about.low}<=x<={about.high}" if about.high else f"x>={about.low}"
            fault = f"{made} is not in the range {ends}."
    elif kind is str:
        made = str(value)
        if about.choices and made not in about.choices:
            fault = f"{made!r} is not one of {', '.join(map(repr, about.choices))}."
    if fault:
        raise ConfigError(f"{where}: {quoted(key)}: {fault}")
    return (made,) if DEFAULTS[name] == () else made


OF_THE_NUMBER: dict[str, object] = {
    name: default
    for name, default in DEFAULTS.items()
    if name == "pairwise" or (name in OPTION_SPECS and OPTION_SPECS[name].number)
}
"""Fields that change the value or its bounds, with their defaults."""


_batch = partial(setting, "Batch", stored=False)


@dataclass(frozen=True, kw_only=True)
class BatchOptions(Values):
    """Options of ``batch``: which jobs there are, which processes do them, and what is shown."""

    truth: str | None = _batch(
        "--truth PATTERN", "Path of the truth, with fields: gt/{sequence}/gt/gt.txt.", kind="path"
    )
    estimate: str | None = _batch(
        "--estimate PATTERN",
        "Paths of the estimates, with fields: runs/{tracker}/{sequence}.txt. Each file that "
        "matches is a job.",
        kind="path",
    )
    layout: str | None = _batch(
        "--layout NAME",
        "Layout of the folders GT and TRACKERS of a benchmark: motchallenge or kitti.",
        choices=LAYOUTS,
    )
    seqmap: str | None = _batch(
        "--seqmap FILE",
        "With --layout: file that lists the sequences to evaluate, for kitti with their frames.",
    )
    output: str = _batch(
        "-o, --output DIR",
        "Folder of the store. The same command continues it. For batch report: folder of the "
        "files that it writes.",
    )
    allow_missing: bool = _batch("--allow-missing", "Go on if a file of a pair is missing.")
    retry_failed: bool = _batch("--retry-failed", "Run jobs again that failed before.")
    shard: str | None = _batch(
        "--shard K/N",
        "Only every N-th job, from the K-th on: for N processes on one store, as in a job array.",
    )
    workers: int | None = _batch(
        "--workers N", "Processes; by default as many as there are cores.", low=1
    )
    scheduler: str | None = _batch(
        "--scheduler ADDRESS", "Use the workers of a Dask cluster that is there: tcp://host:8786."
    )
    reports: bool = _batch("--reports", "Write the result folder of each job, DIR/reports/LABELS.")
    proof: bool = _batch("--proof", "With --reports: with the proof of each value.")
    per_step: bool = _batch(
        "--per-step", "Store the costs of each step as well, for curves over time."
    )
    curve: bool = _batch(
        "--curve",
        "With --per-step: also evaluate the steps up to each step, as evaluate --curve does.",
    )
    by: tuple[str, ...] = _batch(
        "--by LABELS",
        "Labels by which tables add up, with commas or this option again; values of the first are "
        "ranked.",
        default=(),
        shown="the first",
    )
    mean_of_roots: bool = _batch(
        "--mean-of-roots",
        "Also show the plain mean of the values of the jobs.",
    )
    band: "BandKind | None" = _batch(
        "--band KIND",
        "Kind of bands around curves over time: interval or bootstrap, of the RMS; percentiles or "
        "deviation, of the runs.",
        choices=BAND_KINDS,
        shown="interval",
    )
    over: str | None = _batch(
        "--over CLOCK",
        "Time axis of curves: start is the time since the start of each run, stamps are the "
        "timestamps. If it is given, a run counts from its first step to its last.",
        choices=("start", "stamps"),
        shown="stamps, or start if at most half of the runs are under way at once",
    )

    evaluation: Request = Request()
    config: SettingsFile | None = None
    quiet: bool = False
