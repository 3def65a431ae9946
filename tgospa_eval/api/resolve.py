"""A checked request as records: how to read both sides, and what to evaluate."""

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
from tgospa_eval.tracks.conversion import Conversion, signed_seconds
from tgospa_eval.tracks.trajectories import HEIGHT
from tgospa_eval.tracks.weights import EXISTENCE

if TYPE_CHECKING:
    from tgospa_eval.evaluation.ignoring import Ignoring
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.formats.clocks import TimeForm
    from tgospa_eval.tracks.places import Frames


@dataclass(frozen=True, kw_only=True, eq=False)
class ResolvedRequest:
    """A checked request as records: how to read both sides, and what to evaluate.

    Parameters
    ----------
    evaluation : EvaluationRequest
        What to evaluate; the distance may be incomplete without the columns of the sides.
    measure : DistanceOptions
        Options of the distance, which needs the columns of the sides.
    reading : ReadOptions
        How to read both sides.
    each : pair of ReadOptions
        How to read truth and estimate, with their own columns and classes.
    formats : pair of str or None
        Formats of truth and estimate; None for a format that is guessed.
    conversions : pair of Conversion
        Conversions of the timestamps and states of truth and estimate.
    preprocess : str, optional
        Benchmark whose rules omit rows.
    frames : Frames, optional
        Coordinate frames of truth and estimate, if they are converted to one frame.
    coverage : str, optional
        Circle, or file of regions: only rows inside are evaluated.
    similarity : Calibration, optional
        Calibration of the score of similarity.
    tracked_shares : TrackedShares
        Thresholds of mostly tracked and mostly lost in the summary.
    allow_empty : bool
        Whether filters may leave no row.
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
        """Options of reading that change the number, by the names of the JSON document."""
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
        """Return the request for states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that the distance does not use.
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
    """Return the records of the options.

    Raises
    ------
    ConfigError
        A value is out of range, or options contradict each other.
    InputError
        The file of a covariance is missing or wrong.
    """
    # A file may change from one job of a batch to the next; options do not, if they are texts.
    named = options.covariance, options.inner_cov, options.step_weights, options.ignore_regions
    if any(name is not None for name in named):
        return _resolved(options)
    try:
        hash(options)
    except TypeError:  # arrays cannot be hashed
        return _resolved(options)
    return _kept(options, surface.get())


def _resolved(options: Request) -> ResolvedRequest:
    requested = () if options.with_ is None else chosen_metrics(options.with_)
    other_metrics, nees = tuple(name for name in requested if name != NEES), NEES in requested
    if options.by and other_metrics:
        raise ConfigError(
            f"{option('with_')} evaluates all classes together, not {option('by', 'class')}; "
            f"choose one class by {option('class_', metavar='NAME')}"
        )
    if options.similarity is not None and options.step_weights is not None:
        raise ConfigError(
            f"{option('similarity')} is not supported with {option('step_weights')}: the "
            "score is for the plain mean over steps"
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
    """Return the records. Readers keep names of options, so each surface has its own records."""
    return _resolved(options)


def _reading(
    options: Request,
    measure: DistanceOptions,
    columns: tuple[str, ...],
    *,
    numbered: bool,
    nees: bool,
) -> ReadOptions:
    """Return how to read both sides, with these columns in addition to the states."""
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
        time_offset=signed_seconds(options.time_offset, option("time_offset")),
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
    """Return how the times of both sides are matched."""
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
    """Return the slices of costs, and the columns that they may need."""
    if not options.slices:
        return (), ()
    from tgospa_eval.evaluation.slicing import parse_slices, requested_columns  # lazy: as weights

    slices = parse_slices(options.slices, summed=options.summed or options.by is not None)
    return slices, requested_columns(slices)


def _ignoring(options: Request) -> "Ignoring | None":
    """Return the rules for ignored states, if there are any."""
    speed = options.max_speed or 0.0
    marks = (options.preprocess or "").endswith(":ignore")
    has_more = options.max_speed is not None or options.ignore_regions is not None
    if not (options.ignore or marks or has_more):
        return None
    from tgospa_eval.evaluation.ignoring import (  # lazy: as weights
        GAPS,
        IN_REGIONS,
        OUTSIDE,
        parse_ignoring,
    )
    from tgospa_eval.evaluation.regions import as_regions

    if options.existence == "use":
        raise ConfigError(
            f"{option('existence', 'use')} cannot be combined with {option('ignore')}, "
            f"{option('ignore_regions')} and {option('preprocess')} NAME:ignore"
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
            f"{option('max_speed', f'{speed:g}')}: must be >= 0 and finite, and is for "
            f"{option('ignore', 'truth-gaps')}"
        )
    if rules.classes and options.by:
        raise ConfigError(
            f"{option('ignore', 'class=NAME')}: {option('by', 'class')} evaluates each class "
            f"separately; choose one by {option('class_', metavar='NAME')}"
        )
    made = options.interpolate == "truth" or options.resample is not None
    if made and OUTSIDE in rules.texts:
        raise ConfigError(
            f"{option('ignore', OUTSIDE)}: the truth is interpolated to other times; "
            f"{option('ignore', GAPS)} leaves its gaps out"
        )
    if GAPS in rules.texts and not made:
        raise ConfigError(
            f"{option('ignore', GAPS)}: is for {option('interpolate', 'truth')} and "
            f"{option('resample')}, whose {option('max_gap')} says what a gap is"
        )
    return rules


def _of_benchmark(options: Request, measure: DistanceOptions, truth: ReadOptions) -> ReadOptions:
    """Return how to read a truth with all columns that the rules of a benchmark need."""
    # lazy: as above
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
    """Return the declared format of the times of a side, if any."""
    given = [getattr(options, f"{role}_time_{name}") for name in ("format", "zone")]
    if given == [None, None]:
        return None
    from tgospa_eval.formats.clocks import TimeForm  # lazy: as weights

    return TimeForm(format=given[0] or "", zone=given[1] or "", role=role)


def _frames(options: Request, measure: DistanceOptions) -> "Frames | None":
    """Return the coordinate frames of both sides, if any is declared."""
    given = options.truth_crs, options.estimate_crs
    if given == (None, None):
        if options.origin is not None:
            raise ConfigError(
                f"{option('origin')} is for {option('truth_crs')} and {option('estimate_crs')}; "
                "say which is local"
            )
        return None
    from tgospa_eval.tracks.places import Frames, parse_frame, parse_origin  # lazy: as weights

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
    """Return an option of one side that only files and tables support, if one is in use."""
    of_both = (
        *("columns", "decimal", "on_duplicate", "on_invalid", "day_begins"),
        *("time", "class_", "region", "where", "by"),
    )
    own = ("columns", "class", "where", "format", "time_format", "time_zone")
    names = (*(f"{side}_{name}" for name in own), *of_both)
    used = (name for name in names if getattr(options, name) != DEFAULTS[name])
    return next(used, "")


def _calibration(options: Request) -> Calibration | None:
    """Return the calibration of the score of ``--similarity``, if it was requested."""
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
    """Return how to read truth and estimate; options of one side override common ones."""
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
            columns=measure.columns(columns, needed),
            placed=(names if "t" in (names or ()) else shared_columns) or (),
            classes=classes or reading.classes,
            where=(*reading.where, *parse_where(where, option(f"{side}_where"))),
            shared=shared if classes else (*shared, "class"),
            option=f"{side}_columns",
            form=_form(options, role),
            of_tables=_of_tables(options, role),
            conversion=Conversion() if measure.is_record else conversion,  # else angles are known
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
    """Return the parts of a list, or of a text with commas."""
    if names is None:
        return None
    return tuple(part.strip() for part in (names.split(",") if isinstance(names, str) else names))


def _solver(options: Request) -> Solver:
    """Return the solver of the options."""
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
