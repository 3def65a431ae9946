"""From a request to records, and with them to two sides that fit each other."""

import math
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext, suppress
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.distance import DistanceOptions, numbers_by_name
from tgospa_eval.api.options import DEFAULTS, Request, is_coverage
from tgospa_eval.api.places import check_places
from tgospa_eval.common.files import is_regular
from tgospa_eval.common.frozen import dataclass, replace
from tgospa_eval.distances.checks import check_columns, check_states
from tgospa_eval.errors import ConfigError, InputError, NothingLeftError, TgospaError
from tgospa_eval.evaluation.axis import check_left
from tgospa_eval.evaluation.prepare import Fitted, fit
from tgospa_eval.evaluation.request import (
    OF_TRACKEVAL,
    EvaluationRequest,
    Sliding,
    chosen_metrics,
    chosen_parameters,
)
from tgospa_eval.evaluation.sides import (
    TrajectoriesLike,
    as_frame,
    as_solver,
    as_step_weights,
    check_as_long,
    components_of,
    filled,
    has_rows,
    is_empty,
    is_path,
    of_object,
    rows_of,
)
from tgospa_eval.formats import ROLES, Reading, ReadOptions, read
from tgospa_eval.formats.columns.headers import columns_of_each, parse_columns
from tgospa_eval.formats.options import parse_moments, parse_steps
from tgospa_eval.formats.reading import by_one_place, by_place, check_classes, with_heights
from tgospa_eval.formats.rows import NOT_CONSIDERED
from tgospa_eval.formats.where import parse_where
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.numbers import Calibration
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import option
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.durations import signed_seconds
from tgospa_eval.tracks.existence import EXISTENCE
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from tgospa_eval.evaluation.ignoring import Ignoring
    from tgospa_eval.evaluation.sides import Components
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.formats.clocks import TimeForm
    from tgospa_eval.tracks.places import Frames


def _stays(side: object) -> bool:
    """Whether a side can be read a second time: what a pipe had is gone, and waiting is forever."""
    if isinstance(side, Reading):
        return False
    return not is_path(side) or not os.path.exists(side) or is_regular(os.fsdecode(side))


def raise_all(faults: Sequence[TgospaError]) -> None:
    """Raise several errors as one, each line once; nothing where there is none."""
    if faults:
        raise type(faults[0])(*dict.fromkeys(line for fault in faults for line in fault.args))


@dataclass(frozen=True, kw_only=True, eq=False)
class Settings:
    """A request, checked, as records: how to read both sides, and what to evaluate.

    Parameters
    ----------
    evaluation : EvaluationRequest
        What to evaluate; its distance as far as it is known without the columns of the sides.
    measure : DistanceOptions
        The distance of states with given columns.
    reading : ReadOptions
        How to read both sides.
    each : pair of ReadOptions
        The same, with columns and classes of the truth and of the estimate.
    formats : pair of str or None
        Format of truth and estimate; None is guessed.
    conversions : pair of Conversion
        From the stamps and states of truth and estimate to those that are compared.
    of_tables : pair of tuple of str
        Options for truth and estimate that only what has rows and headers can follow.
    preprocess : str, optional
        Rules of a benchmark by which rows are left out.
    frames : Frames, optional
        What the coordinates of truth and estimate are, if they are to be brought to one frame.
    coverage : str, optional
        A circle, or a file of regions: only rows inside take part.
    similarity : Calibration, optional
        Of the score that is shown.
    one_of_many : bool
        Whether filters may leave nothing.
    """

    evaluation: EvaluationRequest
    measure: DistanceOptions
    reading: ReadOptions
    each: tuple[ReadOptions, ReadOptions]
    formats: tuple[str | None, str | None]
    conversions: tuple[Conversion, Conversion]
    of_tables: tuple[tuple[str, ...], tuple[str, ...]]
    preprocess: str | None
    frames: "Frames | None" = None
    coverage: str | None = None
    similarity: Calibration | None = None
    one_of_many: bool = False

    @property
    def recorded(self) -> dict[str, object]:
        """Options of reading that change the number, by the names of the JSON."""
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

    def read(
        self,
        *given: "TrajectoriesLike | Reading",
        roles: tuple[str, ...] = ROLES,
        names: tuple[str, ...] | None = None,
        mapping: "Components | None" = None,
        advise: bool = True,
        known: dict[str, Reading] | None = None,
    ) -> tuple[Reading, ...]:
        """The truth, and the estimate if there is one; or sides in other roles.

        Parameters
        ----------
        *given : path, Trajectories, DataFrame, array, mapping, set of tracks, or Reading
            Each side; or what `read_side` made of it.
        roles : tuple of str
            What they are.
        names : tuple of str, optional
            What messages call those that are no files; by default their roles.
        mapping : sequence of int, or pair of such, optional
            Of tracks with state vectors the components to compare.
        advise : bool
            Whether a folder gets a message with what to type.
        known : dict, optional
            The last truth by its path, for several estimates of it: it is read once.

        Raises
        ------
        InputError
            A path is a folder, a side is wrong, or all lack a header that is mapped; all faults at
            once.
        ConfigError
            No side has a class that was asked for, the filters leave no row of any, or are not for
            what a side is.
        """
        names = called(given, names or roles)
        if advise:
            check_places(names)
        components = components_of(given, mapping)
        paths = tuple(os.fsdecode(side) for side in given if is_path(side))
        sides: list[Reading | None] = []
        again: list[Callable[[ReadOptions], Reading] | None] = []
        faults: list[TgospaError] = []
        for k, (side, role) in enumerate(zip(given, roles, strict=False)):
            about = side, k, role, paths, roles, components[k], names[k]
            again.append(partial(self.read_side, *about) if _stays(side) else None)
            if is_empty(side):
                sides.append(None)
                continue
            found = known.get(names[0]) if known and k == 0 else None
            try:
                sides.append(found or self.read_side(*about))
            except (InputError, ConfigError) as error:
                faults.append(error)
        raise_all(faults)
        if known is not None and is_path(given[0]) and sides[0]:
            known.clear()
            known[names[0]] = sides[0]  # not as one estimate alone needs it
        sides = by_one_place(sides, self.each, again)
        if len(sides) == len(ROLES):
            named = self.evaluation.distance.name
            is_local = self.frames is not None and self.frames.begin is not None
            sides = with_heights(sides, self.each, again, names, local=is_local, distance=named)
        read = filled(sides, self.evaluation.distance)
        check_as_long(given, read, names)
        if len(read) == len(ROLES):
            read = self._converted(read, 0, given), read[1]
            read = read[0], self._converted(read, 1, given)
            read = _in_one_clock(read)
            if self.frames is not None:
                *pair, warning = self.frames.joined(
                    (read[0].trajectories, read[1].trajectories), names
                )
                read = tuple(
                    replace(one, trajectories=made) for one, made in zip(read, pair, strict=True)
                )
                if warning is not None:
                    read = read[0], replace(read[1], warnings=(*read[1].warnings, warning))
        if self.coverage is not None:
            read = self._covered(read, names)
        with suppress(NothingLeftError) if self.one_of_many else nullcontext():
            self.check(read, names)
        if roles != ROLES:
            return read
        read = self.preprocessed(read, names)
        ignoring = self.evaluation.ignoring
        return read if ignoring is None or len(read) < len(ROLES) else ignoring.mark(read, names)

    def read_side(
        self,
        given: "TrajectoriesLike | Reading",
        side: int,
        role: str,
        paths: tuple[str, ...] = (),
        roles: tuple[str, ...] = ROLES,
        components: "Sequence[int] | None" = None,
        name: str | None = None,
        options: ReadOptions | None = None,
    ) -> Reading:
        """One side, the first or second.

        `paths` are all that are read together, in their roles; `name` is for messages; `options`
        take the place of those of the side.

        Raises
        ------
        InputError
            The side cannot be read, or has a row that is wrong.
        """
        options, name = options or self.each[side], name or role
        if isinstance(given, Reading):
            return given
        if is_path(given):
            options = options.beside_others(paths, roles)
            if len(paths) == 1:
                options = replace(options, option="columns")
            return read(given, options, role, self.formats[side])
        frame = as_frame(given, name)
        if frame is not None:
            from tgospa_eval.formats.frames import from_frame  # here: pandas

            return by_place(
                lambda options: replace(from_frame(frame, options, name=name), format=""), options
            )
        if self._has_rows(given, side):
            from tgospa_eval.formats.assemble import assemble

            columns = self.evaluation.distance.columns
            rows = rows_of(given, name, options, columns, components)
            if rows is not None:
                return assemble(rows, options, "")
        if self.of_tables[side]:
            raise ConfigError(
                f"{option(self.of_tables[side][0])} is for files and tables, and {name} is none: "
                "choose its rows and columns before"
            )
        return of_object(given, name, self.evaluation, components)

    def _has_rows(self, given: object, side: int) -> bool:
        """Whether options of reading are followed row by row."""
        if isinstance(given, Trajectories):
            return False
        is_table = is_path(given) or as_frame(given, ROLES[side]) is not None
        return is_table or has_rows(given) or bool(self.of_tables[side])

    def _converted(self, read: tuple[Reading, ...], side: int, given: Sequence[object]) -> Reading:
        """A side with the stamps and states that are asked for, if reading left that open."""
        conversion, distance = self.conversions[side], self.evaluation.distance
        role, found = ROLES[side], read[side]
        if not conversion.recorded_of(role):
            return found
        if self.each[side].conversion.recorded_of(role) and self._has_rows(given[side], side):
            return found
        if conversion.unit_scale != 1:
            truth, estimate = (one.trajectories for one in read)
            check_columns(truth, estimate)
            check_states(truth, estimate, distance)
            settings = self.measure.distance(truth.columns).settings(truth.columns)
            conversion = replace(conversion, angles=tuple(settings.get("periodic", ())))
        return replace(found, trajectories=conversion(found.trajectories, role))

    def _covered(self, read: tuple[Reading, ...], names: tuple[str, ...]) -> tuple[Reading, ...]:
        """The rows of all sides that are inside the regions of --region."""
        from tgospa_eval.evaluation.preprocess import kept_rows  # here: few have regions
        from tgospa_eval.evaluation.regions import coverage, inside

        assert self.coverage is not None
        found, origin = [], None if self.frames is None else self.frames.begin
        for side, name in zip(read, names, strict=True):
            earth = origin is not None or "lat" in side.trajectories.columns
            regions = coverage(self.coverage, self.reading.decimal, earth=earth)
            regions = replace(regions, origin=origin)
            near = self.evaluation.time_matching.near
            rows = inside(regions, side.trajectories, near, name)
            found.append(kept_rows(side, rows, "region"))
        return tuple(found)

    def preprocessed(
        self, sides: tuple[Reading, ...], paths: tuple[str, ...]
    ) -> tuple[Reading, ...]:
        """Both files without what the rules of a benchmark leave out, if that is asked for.

        Where it is not, and numbers are asked for that tables have, a warning says so.

        Raises
        ------
        ConfigError
            The truth does not say what that is.
        """
        in_tables = self.measure.boxes and not {*OF_TRACKEVAL}.isdisjoint(self.evaluation.with_)
        if len(sides) < len(ROLES) or not (self.preprocess or in_tables):
            return sides
        from tgospa_eval.evaluation.preprocess import (  # here: for boxes only
            benchmark_warnings,
            preprocessed,
        )

        def everything(**changes: Any) -> Reading:
            """With the rows that a flag leaves out, of all classes."""
            options = replace(self.each[0], classes=None, kept=(NOT_CONSIDERED,), **changes)
            return read(paths[0], options, "truth", self.formats[0])

        if self.preprocess:
            ignoring = self.evaluation.ignoring
            return preprocessed(
                self.preprocess,
                sides,
                lambda: everything(attributes=(*self.each[0].attributes, "conf")),
                (paths[0], paths[1]),
                None if ignoring is None else ignoring.regions,
            )
        found = benchmark_warnings(sides[0], lambda: everything(attributes=("class",)))
        return replace(sides[0], warnings=(*sides[0].warnings, *found)), *sides[1:]

    def check(self, sides: tuple[Reading, ...], paths: tuple[str, ...]) -> None:
        """Whether some file has what was asked of all.

        Raises
        ------
        InputError
            None has a header that is mapped, or classes.
        ConfigError
            None has a class that was asked for, or the filters leave no row of any.
        """
        for name in sides[0].missing:
            if all(name in side.missing for side in sides):
                raise InputError(*dict.fromkeys(side.missing[name] for side in sides))
        check_classes(sides, paths, self.reading.classes, self.each)
        filters = {"time", "class", "region", "where"}
        if not any(side.taken for side in sides) and any(
            filters & side.left_out.keys() for side in sides
        ):
            used = (name for name in self.recorded if name.split("_")[-1] in filters)
            given = " and ".join(option("class_" if name == "class" else name) for name in used)
            raise NothingLeftError(f"{given}: no row is left to evaluate")

    def request(self, columns: tuple[str, ...]) -> EvaluationRequest:
        """What is asked of states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that does not enter the distance.
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

    def fit(
        self, sides: tuple[Reading, ...], names: tuple[str, ...]
    ) -> tuple[Fitted, EvaluationRequest]:
        """Two sides on the same steps, and what is asked of them.

        Raises
        ------
        ConfigError
            The options do not fit the sides.
        InputError
            The sides do not fit each other.
        """
        truth, estimate = (side.trajectories for side in sides)
        check_columns(truth, estimate, (names[0], names[1]))
        request = self.request(truth.columns)
        fitted = fit(truth, estimate, request, (names[0], names[1]))
        if not self.one_of_many:
            kept = sum(len(side.step) for side in fitted.axis.sides)
            check_left(request.time_matching, kept, fitted.axis.left_out)
        return fitted, request


def called(given: Sequence[object], roles: Sequence[str] = ROLES) -> tuple[str, ...]:
    """What sides are called in messages: files by their paths, others by what they are."""
    return tuple(
        os.fsdecode(side) if is_path(side) else role
        for side, role in zip(given, roles, strict=False)
    )


def make_settings(options: Request) -> Settings:
    """The records that the options ask for.

    Raises
    ------
    ConfigError
        A value is out of range, or options do not fit each other.
    InputError
        The file of a covariance is missing or wrong.
    """
    # A file may change from one job of a batch to the next; options do not, if they are texts.
    named = options.covariance, options.inner_cov, options.step_weights, options.ignore_regions
    if any(name is not None for name in named):
        return _settings(options)
    try:
        hash(options)
    except TypeError:  # arrays of Python
        return _settings(options)
    return _kept(options)


@lru_cache(maxsize=8)
def _kept(options: Request) -> Settings:
    return _settings(options)


def _settings(options: Request) -> Settings:
    asked = () if options.with_ is None else chosen_metrics(options.with_)
    others, nees = tuple(name for name in asked if name != NEES), NEES in asked
    if options.by and others:
        raise ConfigError(
            f"{option('with_')} takes all rows together, not {option('by', 'class')}; choose one "
            f"class by {option('class_', metavar='NAME')}"
        )
    if options.similarity is not None and options.step_weights is not None:
        raise ConfigError(
            f"{option('similarity')} is of the mean over steps, not for {option('step_weights')}"
        )
    region, coverage = options.region, None
    if is_coverage(region):
        region, coverage = None, region
    measure = DistanceOptions(options, nees=nees)
    slices, columns = _slices(options)
    ignoring = _ignoring(options)
    if ignoring is not None:
        columns = (*columns, *ignoring.columns)
    reading = ReadOptions(
        decimal=options.decimal,
        on_duplicate=options.on_duplicate,
        on_invalid=options.on_invalid,
        boxes=measure.boxes,
        day_begins=options.day_begins,
        time=options.time,
        classes=_list(options.class_),
        region=region,
        where=parse_where(options.where, option("where")),
        by_class=options.by == "class",
        covariance=nees or bool(measure.named.kinds),
        fix_covariance=options.fix_cov,
        missing_covariance=options.missing_cov,
        clouds="cloud" in measure.named.kinds or (nees and not measure.named.kinds),
        fault=measure.fault,
        attributes=(*columns, *((EXISTENCE,) if options.existence == "use" else ())),
        numbered=bool(others or options.preprocess),
        max_input=options.max_input,
    )
    parameters, defaults = chosen_parameters(
        measure.named, options.order, options.cutoff, options.switch_penalty, options.rho
    )
    conversion = Conversion(
        time_offset=signed_seconds(options.time_offset, option("time_offset")),
        time_scale=options.time_scale,
        unit_scale=options.unit_scale,
        angles=tuple(measure.period),
        scale=tuple(numbers_by_name("estimate_scale", options.estimate_scale).items()),
    )
    of_truth = Conversion(
        scale=tuple(numbers_by_name("truth_scale", options.truth_scale).items()),
        scale_option="truth_scale",
    )
    if measure.is_record and conversion.recorded_of(ROLES[1]) and (options.time or options.region):
        raise ConfigError(
            f"{option('time')} and {option('region')} are in the units of the truth: choose the "
            "distance by its name"
        )
    frames = _frames(options)
    if frames is not None and frames.begin and measure.named.on_earth:
        raise ConfigError(
            f"{option('distance', measure.named.name)} compares places on the Earth, and "
            f"{option('origin')} brings both sides to local metres: leave {option('distance')} out"
        )
    if frames is not None and ignoring is not None and ignoring.regions is not None:
        placed = replace(ignoring.regions, origin=frames.begin)
        ignoring = replace(ignoring, regions=placed)
    each = _each(reading, measure, options, frames)
    if not measure.is_record:  # whose angles are known when the columns are
        each = (
            replace(each[0], conversion=of_truth),
            replace(each[1], conversion=conversion),
        )
    if ignoring is not None and ignoring.classes:
        each = (
            replace(each[0], by_class=True, class_for=option("ignore"), also=ignoring.classes),
            each[1],
        )
    if options.preprocess:
        each = _of_benchmark(options, measure, each[0]), each[1]
    return Settings(
        evaluation=EvaluationRequest(
            parameters=parameters,
            distance=measure.named,
            solver=_solver(options),
            time_matching=TimeMatching(
                tolerance=options.time_tolerance,
                grid=options.grid,
                interpolate=options.interpolate,
                max_gap=options.max_gap,
                resample=options.resample,
                period=options.period,
                steps=parse_steps(options.steps, parse_moments(options.time)),
                outage=options.outage,
            ),
            unit=options.unit,
            curve=options.curve,
            sliding=Sliding.asked(options.window, options.every),
            with_=others,
            nees=nees,
            defaults=defaults,
            slices=slices,
            step_weights=as_step_weights(options.step_weights, options.decimal),
            existence=options.existence,
            ignoring=ignoring,
        ),
        measure=measure,
        reading=reading,
        each=each,
        formats=(options.truth_format, options.estimate_format),
        conversions=(of_truth, conversion),
        of_tables=(_of_tables(options, "truth"), _of_tables(options, "estimate")),
        preprocess=(options.preprocess or "").removesuffix(":delete") or None,
        frames=frames,
        coverage=coverage,
        similarity=_calibration(options),
    )


def _slices(options: Request) -> "tuple[tuple[SliceBy, ...], tuple[str, ...]]":
    """What costs are split by, and the columns that this may need."""
    if not options.slices:
        return (), ()
    from tgospa_eval.evaluation.slicing import columns_asked, parse_slices  # here: as weights

    slices = parse_slices(options.slices, summed=options.summed or options.by is not None)
    return slices, columns_asked(slices)


def _ignoring(options: Request) -> "Ignoring | None":
    """What is not judged, if there is such."""
    speed = options.max_speed or 0.0
    marks = (options.preprocess or "").endswith(":ignore")
    asked = options.max_speed is not None or options.ignore_regions is not None
    if not (options.ignore or marks or asked):
        return None
    from tgospa_eval.evaluation.ignoring import (  # here: as weights
        GAPS,
        IN_REGIONS,
        OUTSIDE,
        parse_ignoring,
    )
    from tgospa_eval.evaluation.regions import as_regions

    if options.existence == "use":
        raise ConfigError(
            f"{option('existence', 'use')} does not go together with {option('ignore')}, "
            f"{option('ignore_regions')} and {option('preprocess')} NAME:ignore; leave one of "
            "them out"
        )
    texts = (options.ignore,) if isinstance(options.ignore, str) else options.ignore
    found = replace(
        parse_ignoring(texts, speed), regions=as_regions(options.ignore_regions, options.decimal)
    )
    if IN_REGIONS in found.texts and found.regions is None:
        raise ConfigError(
            f"{option('ignore', IN_REGIONS)}: needs {option('ignore_regions', metavar='FILE')}, "
            "which has them"
        )
    if options.max_speed is not None and not (found.gaps and 0 <= speed < math.inf):
        raise ConfigError(
            f"{option('max_speed', f'{speed:g}')}: must be >= 0 and finite, and is for "
            f"{option('ignore', 'truth-gaps')}"
        )
    if found.classes and options.by:
        raise ConfigError(
            f"{option('ignore', 'class=NAME')}: with {option('by', 'class')} each class is judged "
            f"by itself; choose one by {option('class_', metavar='NAME')}"
        )
    made = options.interpolate == "truth" or options.resample is not None
    if made and OUTSIDE in found.texts:
        raise ConfigError(
            f"{option('ignore', OUTSIDE)}: the truth is interpolated to other times; "
            f"{option('ignore', GAPS)} leaves its gaps out"
        )
    if GAPS in found.texts and not made:
        raise ConfigError(
            f"{option('ignore', GAPS)}: is for {option('interpolate', 'truth')} and "
            f"{option('resample')}, whose {option('max_gap')} says what a gap is"
        )
    return found


def _of_benchmark(options: Request, measure: DistanceOptions, truth: ReadOptions) -> ReadOptions:
    """How to read a truth with all that the rules of a benchmark look at."""
    from tgospa_eval.evaluation.preprocess import HIDDEN, NEIGHBOURS, judged_class  # here: as above

    rule = str(options.preprocess)
    if not measure.boxes:
        raise ConfigError(
            f"{option('preprocess', rule)}: looks at boxes; choose {option('distance', 'iou')}"
        )
    if rule.startswith("uadetrac"):
        return truth
    truth = replace(truth, regions=True)
    if rule.startswith("visdrone"):
        return truth
    if options.by:
        raise ConfigError(
            f"{option('preprocess', rule)}: is of one class, not {option('by', 'class')}"
        )
    truth = replace(truth, by_class=True, class_for=option("preprocess"))
    if rule.startswith("motchallenge"):
        return truth
    return replace(
        truth,
        also=(*truth.also, *NEIGHBOURS[judged_class(truth.classes, rule)]),
        attributes=(*truth.attributes, *HIDDEN),
    )


def _in_one_clock(read: tuple[Reading, ...]) -> tuple[Reading, ...]:
    """Both sides with times of one kind, where numbers are seen to count since 1970."""
    first, second = (side.trajectories for side in read)
    if first.clock == second.clock:
        return read
    from tgospa_eval.formats.clocks import in_one_clock  # here: as weights

    sides, told = in_one_clock((first, second))
    return tuple(
        replace(one, trajectories=side, notices=(*one.notices, *filter(None, [text])))
        for one, side, text in zip(read, sides, told, strict=True)
    )


def _form(options: Request, role: str) -> "TimeForm | None":
    """How the times of a side are written, if that is said."""
    given = [getattr(options, f"{role}_time_{name}") for name in ("format", "zone")]
    if given == [None, None]:
        return None
    from tgospa_eval.formats.clocks import TimeForm  # here: as weights

    return TimeForm(format=given[0] or "", zone=given[1] or "", role=role)


def _frames(options: Request) -> "Frames | None":
    """What the coordinates of both sides are, if any is said to be."""
    given = options.truth_crs, options.estimate_crs
    if given == (None, None):
        if options.origin is not None:
            raise ConfigError(
                f"{option('origin')} is for {option('truth_crs')} and {option('estimate_crs')}; "
                "say which is local"
            )
        return None
    from tgospa_eval.tracks.places import Frames, parse_frame, parse_origin  # here: as weights

    truth, estimate = (
        parse_frame(text or "lat,lon", option(f"{role}_crs"))
        for text, role in zip(given, ROLES, strict=True)
    )
    origin = options.origin
    if origin is not None and not isinstance(origin, str):
        values = tuple(origin) if isinstance(origin, Iterable) else (origin,)
        origin = ",".join(map(str, values))
    return Frames(frames=(truth, estimate), origin=None if origin is None else parse_origin(origin))


def _of_tables(options: Request, side: str) -> tuple[str, ...]:
    """Options of one side that are for files and tables."""
    of_both = (
        *("columns", "decimal", "on_duplicate", "on_invalid", "day_begins"),
        *("time", "class_", "region", "where", "by"),
    )
    own = ("columns", "class", "where", "format", "time_format", "time_zone")
    names = (*(f"{side}_{name}" for name in own), *of_both)
    return tuple(name for name in names if getattr(options, name) != DEFAULTS[name])


def _calibration(options: Request) -> Calibration | None:
    """Of the score of ``--similarity``, if it was asked for."""
    if options.similarity is None:
        return None
    try:
        return Calibration(false_targets=options.similarity)
    except ConfigError as error:
        raise ConfigError(f"{option('similarity')}: {error}") from None


def _each(
    reading: ReadOptions, measure: DistanceOptions, options: Request, frames: "Frames | None"
) -> tuple[ReadOptions, ReadOptions]:
    """How to read truth and estimate: columns and classes of one go before those of both."""
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
    truth, estimate = (
        replace(
            reading,
            heights="tell" if on_earth and not is_named else "",
            fault=reading.fault if frame is None else frame.fault,
            columns=measure.columns(columns, needed),
            placed=(names if "t" in (names or ()) else shared_columns) or (),
            classes=classes or reading.classes,
            where=(*reading.where, *parse_where(where, option(f"{side}_where"))),
            shared=shared if classes else (*shared, "class"),
            option=f"{side}_columns",
            form=_form(options, role),
        )
        for (names, classes, where), (columns, shared), needed, side, role, frame in zip(
            own, columns_of, needs, options.sides, ROLES, framed, strict=True
        )
    )
    return truth, estimate


def _list(names: str | Iterable[str] | None) -> tuple[str, ...] | None:
    """The parts of a list, of a text those between commas."""
    if names is None:
        return None
    return tuple(part.strip() for part in (names.split(",") if isinstance(names, str) else names))


def _solver(options: Request) -> Solver:
    """The solver that the options ask for."""
    if not isinstance(options.solver, str):
        for name in ("gap", "epsilon", "time_limit", "jobs"):
            if getattr(options, name) != DEFAULTS[name]:
                raise ConfigError(
                    f"{option(name)} is for a solver by its name, not for a record with "
                    "settings of its own"
                )
        return as_solver(options.solver)
    settings: dict[str, float | None] = {"time_limit": options.time_limit}
    if options.solver != "exact":
        settings |= {"gap": options.gap, "jobs": options.jobs}
    if options.solver == "sinkhorn":
        settings["epsilon"] = options.epsilon
    return solver_class(options.solver)(**settings)
