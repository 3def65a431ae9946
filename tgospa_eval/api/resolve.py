"""Check of the options of an evaluation, and their distribution to dataclasses."""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

from tgospa_eval.api.distance import DistanceOptions, numbers_by_name
from tgospa_eval.api.options import DEFAULTS, Request, is_coverage
from tgospa_eval.common.frozen import dataclass, replace
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.request import (
    EvaluationRequest,
    Sliding,
    chosen_metrics,
    chosen_parameters,
)
from tgospa_eval.formats import ROLES, ReadOptions
from tgospa_eval.formats.headers import HEADER_ALIASES, columns_of_each, parse_columns
from tgospa_eval.formats.objects import as_step_weights
from tgospa_eval.formats.options import parse_steps, parse_time_range, parse_where
from tgospa_eval.formats.roles import OF_HEIGHTS
from tgospa_eval.quoting import option, surface
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import Calibration
from tgospa_eval.results.summary import TrackedShares
from tgospa_eval.solvers import Solver, as_solver, solver_class
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.conversion import Conversion, signed_duration
from tgospa_eval.tracks.trajectories import HEIGHT
from tgospa_eval.tracks.weights import EXISTENCE

if TYPE_CHECKING:
    from tgospa_eval.evaluation.ignoring import Ignoring
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.formats.clocks import TimeForm
    from tgospa_eval.tracks.places import Frames


@dataclass(frozen=True, kw_only=True, eq=False)
class ResolvedRequest:
    """Checked options, sorted into dataclasses: how to read both files, and what to evaluate.

    Parameters
    ----------
    evaluation : EvaluationRequest
        What to evaluate. Its distance is not complete before the state columns of the files are
        known. The method `request` then completes it.
    measure : DistanceOptions
        Options of the distance; with the state columns, they give the complete distance.
    reading : ReadOptions
        How to read truth and estimate, as far as this is the same for both.
    each : pair of ReadOptions
        How to read the truth, and how to read the estimate. Each is `reading` plus the options that
        apply only to this side, such as columns and classes.
    formats : pair of str or None
        Formats of truth and estimate; None for a format that is guessed.
    conversions : pair of Conversion
        Conversions of the timestamps and states of truth and estimate.
    preprocess : str, optional
        Benchmark, such as ``"motchallenge"``. Rows are left out by its rules.
    frames : Frames, optional
        Coordinate frames of truth and estimate, if they are converted to one frame.
    coverage : str, optional
        Text of ``--region`` for a circle or a file of regions; rows outside are left out.
    similarity : Calibration, optional
        How ``--similarity`` turns the value per step into a score from 0 to 1.
    tracked_shares : TrackedShares
        Followed shares at which the summary counts an object as "mostly tracked" or "mostly lost".
    allow_empty : bool
        Whether filters are allowed to leave out all rows. If false, this is an error.
    """

    evaluation: EvaluationRequest
    measure: DistanceOptions
    reading: ReadOptions
    each: tuple[ReadOptions, ReadOptions]
    formats: tuple[str | None, str | None]
    conversions: tuple[Conversion, Conversion]
    preprocess: str | None
    frames: "Frames | None" = None
    coverage: str | None = None
    similarity: Calibration | None = None
    tracked_shares: TrackedShares = TrackedShares()
    allow_empty: bool = False

    @property
    def recorded(self) -> dict[str, object]:
        """Options of reading that can change the number, as the JSON document names them."""
        return {
            "decimal": self.reading.decimal,
            "on_duplicate": self.reading.on_duplicate,
            **({"on_invalid": "drop"} if self.reading.on_invalid == "drop" else {}),
            **dict(self.reading.filters()),
            **{
                f"{role}_class": list(options.classes)
                for role, options in zip(ROLES, self.each, strict=True)
                if options.classes and options.classes != self.reading.classes
            },
            **{
                f"{role}_where": [one.text for one in own]
                for role, options in zip(ROLES, self.each, strict=True)
                if (own := options.where[len(self.reading.where) :])
            },
            **{
                f"{role}_time_{name}": text
                for role, options in zip(ROLES, self.each, strict=True)
                if options.form is not None
                for name, text in vars(options.form).items()
                if name != "role" and text
            },
            **{
                name: value
                for name, value in self.reading.covariances()
                if self.measure.named.kinds or value not in (False, "error")
            },
            **({} if self.frames is None else self.frames.recorded),
            **({} if self.coverage is None else {"region": self.coverage}),
            **{
                name: value
                for role, conversion in zip(ROLES, self.conversions, strict=True)
                for name, value in conversion.recorded_of(role).items()
            },
            **({"preprocess": self.preprocess} if self.preprocess else {}),
            **({} if self.evaluation.ignoring is None else self.evaluation.ignoring.recorded),
        }

    def request(self, columns: tuple[str, ...]) -> EvaluationRequest:
        """Return `evaluation` with the complete distance for states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that is not in `columns`; or states are in degrees and no
            distance is chosen.
        """
        distance, conversion = self.measure.distance(columns), self.conversions[1]
        if self.frames is not None:
            conversion = replace(conversion, unit_scale=1.0, scale=())
        elif conversion.unit_scale != 1:
            angles = tuple(distance.settings(columns).get("periodic", ()))
            conversion = replace(conversion, angles=angles)
        return replace(
            self.evaluation, distance=distance, recorded=self.recorded, conversion=conversion
        )


def resolve_request(options: Request) -> ResolvedRequest:
    """Check the options of an evaluation, and sort them into dataclasses.

    Raises
    ------
    ConfigError
        A value is out of range, or options contradict each other.
    InputError
        A file that an option names, such as that of a covariance, is missing or wrong.
    """
    # Results are cached, except with options that name a file or have an array: a file may change
    # between two jobs of a batch, and an array cannot be hashed.
    named = options.covariance, options.inner_cov, options.step_weights, options.ignore_regions
    if any(name is not None for name in named):
        return _resolved(options)
    try:
        hash(options)
    except TypeError:
        return _resolved(options)
    return _kept(options, surface.get())


def _resolved(options: Request) -> ResolvedRequest:
    requested = () if options.with_ is None else chosen_metrics(options.with_)
    other_metrics, nees = tuple(name for name in requested if name != NEES), NEES in requested
    if options.by and other_metrics:
        raise ConfigError(
            f"{option('with_')} cannot be combined with {option('by', 'class')}, because "
            "it evaluates all classes together; "
            f"choose one class by {option('class_', metavar='NAME')}"
        )
    if options.similarity is not None and options.step_weights is not None:
        raise ConfigError(
            f"{option('similarity')} is not supported with {option('step_weights')}, "
            "because its score weights all steps equally; leave one of them out"
        )
    measure = DistanceOptions(options, nees=nees)
    slices, columns = _slices(options)
    ignoring = _ignoring(options)
    if ignoring is not None:
        columns = (*columns, *ignoring.columns)
    reading = _reading(options, measure, columns, numbered=bool(other_metrics), nees=nees)
    parameters, defaults = chosen_parameters(
        measure.named, options.order, options.cutoff, options.switch_penalty, options.rho
    )
    frames = _frames(options, measure)
    conversions = _conversions(options, measure, frames)
    if frames is not None and ignoring is not None and ignoring.regions is not None:
        placed = replace(ignoring.regions, origin=frames.begin)
        ignoring = replace(ignoring, regions=placed)
    return ResolvedRequest(
        reading=reading,
        each=_each(options, reading, measure, conversions, frames, ignoring),
        evaluation=EvaluationRequest(
            parameters=parameters,
            distance=measure.named,
            solver=_solver(options),
            time_matching=_time_matching(options),
            unit=options.unit,
            curve=options.curve,
            sliding=Sliding.of_options(options.window, options.every),
            with_=other_metrics,
            nees=nees,
            defaults=defaults,
            slices=slices,
            step_weights=as_step_weights(options.step_weights, options.decimal),
            existence=options.existence,
            ignoring=ignoring,
            memory=None if options.max_input is not None else options.memory,
        ),
        measure=measure,
        formats=(options.truth_format, options.estimate_format),
        conversions=conversions,
        preprocess=(options.preprocess or "").removesuffix(":delete") or None,
        frames=frames,
        coverage=options.region if is_coverage(options.region) else None,
        similarity=_calibration(options),
        tracked_shares=_tracked_shares(options),
    )


@lru_cache(maxsize=8)
def _kept(options: Request, _: str) -> ResolvedRequest:
    """Return the cached result of `_resolved` for the command line or for Python.

    The result contains names of options for messages, and Python spells the names differently.
    """
    return _resolved(options)


def _reading(
    options: Request,
    measure: DistanceOptions,
    columns: tuple[str, ...],
    *,
    numbered: bool,
    nees: bool,
) -> ReadOptions:
    """Return the options of reading that truth and estimate share.

    Parameters
    ----------
    options : Request
        The options.
    measure : DistanceOptions
        Options of the distance.
    columns : tuple of str
        Columns to read in addition to those of the states.
    numbered : bool
        Whether to keep the position of each row in its file.
    nees : bool
        Whether to read covariances or particles for NEES.
    """
    return ReadOptions(
        decimal=options.decimal,
        on_duplicate=options.on_duplicate,
        on_invalid=options.on_invalid,
        boxes=measure.boxes,
        day_begins=options.day_begins,
        time=options.time,
        classes=_list(options.class_),
        region=None if is_coverage(options.region) else options.region,
        where=parse_where(options.where, option("where")),
        by_class=options.by == "class",
        covariance=nees or bool(measure.named.kinds),
        fix_covariance=options.fix_cov,
        missing_covariance=options.missing_cov,
        clouds="cloud" in measure.named.kinds or (nees and not measure.named.kinds),
        fault=measure.fault,
        attributes=(*columns, *((EXISTENCE,) if options.existence == "use" else ())),
        numbered=numbered or bool(options.preprocess),
        max_input=options.max_input,
    )


def _conversions(
    options: Request, measure: DistanceOptions, frames: "Frames | None"
) -> tuple[Conversion, Conversion]:
    """Return the conversions of timestamps and states of truth and estimate."""
    on_earth = [measure.named.on_earth] * 2
    if frames is not None:
        on_earth = [frame.kind == "earth" for frame in frames.frames]
    scales = [
        tuple(
            (HEIGHT if known and name.casefold() in HEADER_ALIASES[HEIGHT] else name, value)
            for name, value in numbers_by_name(f"{role}_scale", given).items()
        )
        for role, given, known in zip(
            ROLES, (options.truth_scale, options.estimate_scale), on_earth, strict=True
        )
    ]
    of_estimate = Conversion(
        time_offset=signed_duration(options.time_offset, option("time_offset")),
        time_scale=options.time_scale,
        unit_scale=options.unit_scale,
        angles=tuple(measure.period),
        scale=scales[1],
    )
    of_truth = Conversion(scale=scales[0], scale_option="truth_scale")
    if measure.is_record and of_estimate.recorded_of(ROLES[1]) and (options.time or options.region):
        raise ConfigError(
            f"{option('time')} and {option('region')} do not work with a converted estimate and a "
            "distance that is a record: give the name of the distance"
        )
    return of_truth, of_estimate


def _time_matching(options: Request) -> TimeMatching:
    """Return how to match the times of the truth with those of the estimate."""
    return TimeMatching(
        tolerance=options.time_tolerance,
        grid=options.grid,
        interpolate=options.interpolate,
        max_gap=options.max_gap,
        resample=options.resample,
        period=options.period,
        steps=parse_steps(options.steps, parse_time_range(options.time)),
        outage=options.outage,
    )


def _slices(options: Request) -> "tuple[tuple[SliceBy, ...], tuple[str, ...]]":
    """Return the requested slices of costs, and the columns of files by which they slice."""
    if not options.slices:
        return (), ()
    # lazy: few evaluations have slices
    from tgospa_eval.evaluation.slicing import parse_slices, requested_columns

    slices = parse_slices(options.slices, summed=options.summed or options.by is not None)
    return slices, requested_columns(slices)


def _ignoring(options: Request) -> "Ignoring | None":
    """Return the rules by which states are ignored; None if no option ignores states."""
    speed = options.max_speed or 0.0
    marks = (options.preprocess or "").endswith(":ignore")
    has_more = options.max_speed is not None or options.ignore_regions is not None
    if not (options.ignore or marks or has_more):
        return None
    from tgospa_eval.evaluation.ignoring import (  # lazy: few evaluations ignore states
        GAPS,
        IN_REGIONS,
        OUTSIDE,
        parse_ignoring,
    )
    from tgospa_eval.evaluation.regions import as_regions

    if options.existence == "use":
        raise ConfigError(
            f"{option('existence', 'use')} cannot be combined with {option('ignore')}, "
            f"{option('ignore_regions')} or {option('preprocess')} NAME:ignore"
        )
    texts = (options.ignore,) if isinstance(options.ignore, str) else options.ignore
    rules = replace(
        parse_ignoring(texts, speed), regions=as_regions(options.ignore_regions, options.decimal)
    )
    if IN_REGIONS in rules.texts and rules.regions is None:
        raise ConfigError(
            f"{option('ignore', IN_REGIONS)}: needs {option('ignore_regions', metavar='FILE')}"
        )
    if options.max_speed is not None and not (rules.gaps and 0 <= speed < math.inf):
        raise ConfigError(
            f"{option('max_speed', f'{speed:g}')}: must be >= 0 and finite, and needs "
            f"{option('ignore', 'truth-gaps')}"
        )
    if rules.classes and options.by:
        raise ConfigError(
            f"{option('ignore', 'class=NAME')} cannot be combined with {option('by', 'class')}; "
            f"choose one class by {option('class_', metavar='NAME')}"
        )
    made = options.interpolate == "truth" or options.resample is not None
    if made and OUTSIDE in rules.texts:
        raise ConfigError(
            f"{option('ignore', OUTSIDE)} cannot be used with an interpolated truth; "
            f"{option('ignore', GAPS)} leaves out the gaps of the truth"
        )
    if GAPS in rules.texts and not made:
        raise ConfigError(
            f"{option('ignore', GAPS)} needs {option('interpolate', 'truth')} or "
            f"{option('resample')}, whose {option('max_gap')} says what a gap is"
        )
    return rules


def _of_benchmark(options: Request, measure: DistanceOptions, truth: ReadOptions) -> ReadOptions:
    """Add the columns that the rules of a benchmark need to `truth`, the options of its reading."""
    # lazy: few evaluations follow the rules of a benchmark
    from tgospa_eval.evaluation.preprocess import HIDDEN, NEIGHBOURS, evaluated_class

    rule = str(options.preprocess)
    if not measure.boxes:
        raise ConfigError(
            f"{option('preprocess', rule)}: needs boxes; choose {option('distance', 'iou')}"
        )
    if rule.startswith("uadetrac"):
        return truth
    truth = replace(truth, regions=True)
    if rule.startswith("visdrone"):
        return truth
    if options.by:
        raise ConfigError(
            f"{option('preprocess', rule)}: evaluates a single class; leave out "
            f"{option('by', 'class')}"
        )
    truth = replace(truth, by_class=True, class_for=option("preprocess"))
    if rule.startswith("motchallenge"):
        return truth
    return replace(
        truth,
        also=(*truth.also, *NEIGHBOURS[evaluated_class(truth.classes, rule)]),
        attributes=(*truth.attributes, *HIDDEN),
    )


def _form(options: Request, role: str) -> "TimeForm | None":
    """Return the declared format and zone of the times of a side; None if options declare none."""
    given = [getattr(options, f"{role}_time_{name}") for name in ("format", "zone")]
    if given == [None, None]:
        return None
    from tgospa_eval.formats.clocks import TimeForm  # lazy: few evaluations declare a format

    return TimeForm(format=given[0] or "", zone=given[1] or "", role=role)


def _frames(options: Request, measure: DistanceOptions) -> "Frames | None":
    """Return the coordinate frames of truth and estimate; None if no option declares a frame."""
    given = options.truth_crs, options.estimate_crs
    if given == (None, None):
        if options.origin is not None:
            raise ConfigError(
                f"{option('origin')} needs {option('truth_crs')} or {option('estimate_crs')}, such "
                "as enu for local axes"
            )
        return None
    # lazy: few evaluations convert coordinates
    from tgospa_eval.tracks.places import Frames, parse_frame, parse_origin

    truth, estimate = (
        parse_frame(text or "lat,lon", option(f"{role}_crs"))
        for text, role in zip(given, ROLES, strict=True)
    )
    origin = options.origin
    if origin is not None and not isinstance(origin, str):
        values = tuple(origin) if isinstance(origin, Iterable) else (origin,)
        origin = ",".join(map(str, values))
    begin = None if origin is None else parse_origin(origin)
    frames = Frames(frames=(truth, estimate), origin=begin)
    if frames.begin and measure.named.on_earth:
        raise ConfigError(
            f"{option('distance', measure.named.name)} compares lat,lon, but {option('origin')} "
            f"converts both files to local metres: leave {option('distance')} out"
        )
    return frames


def _of_tables(options: Request, side: str) -> str:
    """Return the name of the first given option that needs a file or table; ``""`` for none.

    The options for `side` (``"truth"`` or ``"estimate"``) come first, then those for both.
    """
    of_both = (
        *("columns", "decimal", "on_duplicate", "on_invalid", "day_begins"),
        *("time", "class_", "region", "where", "by"),
    )
    own = ("columns", "class", "where", "format", "time_format", "time_zone")
    names = (*(f"{side}_{name}" for name in own), *of_both)
    used = (name for name in names if getattr(options, name) != DEFAULTS[name])
    return next(used, "")


def _calibration(options: Request) -> Calibration | None:
    """Return how ``--similarity`` makes a score; None if the option is not given."""
    if options.similarity is None:
        return None
    try:
        return Calibration(false_targets=options.similarity)
    except ConfigError as error:
        raise ConfigError(f"{option('similarity')}: {error}") from None


def _tracked_shares(options: Request) -> TrackedShares:
    try:
        return TrackedShares.parse(options.tracked_shares)
    except ConfigError as error:
        raise ConfigError(f"{option('tracked_shares')} {error}") from None


def _each(
    options: Request,
    reading: ReadOptions,
    measure: DistanceOptions,
    conversions: tuple[Conversion, Conversion],
    frames: "Frames | None",
    ignoring: "Ignoring | None",
) -> tuple[ReadOptions, ReadOptions]:
    """Return how to read the truth, and how to read the estimate.

    `reading` has what both share. An option for one of them, such as ``--truth-class``, has
    priority over the option for both. Conditions of ``--truth-where`` are added to those of
    ``--where``.
    """
    own = (
        (_list(options.truth_columns), _list(options.truth_class), options.truth_where),
        (_list(options.estimate_columns), _list(options.estimate_class), options.estimate_where),
    )
    shared_columns = _list(options.columns)
    columns_of = columns_of_each(
        shared_columns, *(columns for columns, _, _ in own), alike=frames is None
    )
    needs = (
        (measure.needed, measure.needed)
        if frames is None
        else [frame.columns for frame in frames.frames]
    )
    is_named = any(parse_columns(names)[1] for names in (shared_columns, own[0][0], own[1][0]))
    on_earth = measure.named.on_earth or frames is not None
    framed = (None, None) if frames is None else frames.frames
    scaled = {name for conversion in conversions for name, _ in conversion.scale}
    heights = "tell" if scaled.isdisjoint(OF_HEIGHTS.values()) else "use"
    truth, estimate = (
        replace(
            reading,
            heights=heights if on_earth and not is_named else "",
            fault=reading.fault if frame is None else frame.fault,
            axes=() if frame is None else frame.axes,
            columns=measure.columns(columns, needed),
            placed=(names if "t" in (names or ()) else shared_columns) or (),
            classes=classes or reading.classes,
            where=(*reading.where, *parse_where(where, option(f"{side}_where"))),
            shared=shared if classes else (*shared, "class"),
            option=f"{side}_columns",
            form=_form(options, role),
            of_tables=_of_tables(options, role),
            # Angles must not be scaled like lengths. If the distance is an object, only the read
            # file tells which columns are angles, and `read_pair` converts the states later.
            conversion=Conversion() if measure.is_record else conversion,
        )
        for (names, classes, where), (
            columns,
            shared,
        ), needed, side, role, frame, conversion in zip(
            own, columns_of, needs, options.sides, ROLES, framed, conversions, strict=True
        )
    )
    if ignoring is not None and ignoring.classes:
        truth = replace(truth, by_class=True, class_for=option("ignore"), also=ignoring.classes)
    if options.preprocess:
        truth = _of_benchmark(options, measure, truth)
    return truth, estimate


def _list(names: str | Iterable[str] | None) -> tuple[str, ...] | None:
    """Return the names in a text with commas, or in an iterable; None for None."""
    if names is None:
        return None
    return tuple(part.strip() for part in (names.split(",") if isinstance(names, str) else names))


def _solver(options: Request) -> Solver:
    """Return the solver that the options choose, with its settings."""
    if not isinstance(options.solver, str):
        for name in ("gap", "epsilon", "time_limit", "jobs"):
            if getattr(options, name) != DEFAULTS[name]:
                raise ConfigError(f"{option(name)} is for a solver given by name, not for a record")
        return as_solver(options.solver)
    settings: dict[str, float | None] = {"time_limit": options.time_limit}
    if options.solver != "exact":
        settings |= {"gap": options.gap, "jobs": options.jobs}
    if options.solver == "sinkhorn":
        settings["epsilon"] = options.epsilon
    return solver_class(options.solver)(**settings)
