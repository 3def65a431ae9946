"""From the values of the options to records, and with them to files that fit each other."""

from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.request import Request
from tgospa_eval.cli.shared.distance import DistanceOptions
from tgospa_eval.cli.shared.places import check_places
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.checks import check_columns
from tgospa_eval.errors import ConfigError, InputError, NothingLeftError
from tgospa_eval.evaluation.axis import check_left
from tgospa_eval.evaluation.prepare import Fitted, fit
from tgospa_eval.evaluation.request import (
    OF_TRACKEVAL,
    EvaluationRequest,
    Sliding,
    chosen_metrics,
    chosen_parameters,
)
from tgospa_eval.formats import ROLES, Reading, ReadOptions, read
from tgospa_eval.formats.columns.headers import columns_of_each
from tgospa_eval.formats.options import parse_moments, parse_steps
from tgospa_eval.formats.reading import Known, check_classes
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.results.records import FileInfo
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.existence import EXISTENCE
from tgospa_eval.tracks.step_weights import WeightsByTime

if TYPE_CHECKING:
    from tgospa_eval.evaluation.slicing import SliceBy


@dataclass(frozen=True, kw_only=True, eq=False)
class Settings:
    """The options of everything that reads files and measures distances, checked.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order, switch penalty; those of the distance where none is given.
    measure : DistanceOptions
        The distance, as far as it is known without the columns of the files.
    time_matching : TimeMatching
        Which stamps are one step, and which steps count.
    reading : ReadOptions
        How to read both files.
    each : pair of ReadOptions
        The same, with columns and classes of the truth and of the estimate.
    formats : pair of str or None
        Format of truth and estimate; None is guessed.
    unit : str, optional
        For printing.
    defaults : tuple of str
        Which of cutoff and switch_penalty nobody chose.
    solver : Solver
        Record of settings.
    curve : bool
        Whether the steps up to each step are asked for as well.
    sliding : Sliding, optional
        Which sliding windows are asked for as well.
    with_ : tuple of str
        Other metrics beside it.
    preprocess : str, optional
        Rules of a benchmark by which rows are left out.
    slices : tuple of SliceBy
        Attributes by which costs are split.
    step_weights : WeightsByTime, optional
        What each step counts.
    existence, one_of_many : str, bool
        Whether probabilities of existence count, and whether filters may leave nothing.
    """

    parameters: Parameters
    measure: DistanceOptions
    time_matching: TimeMatching
    reading: ReadOptions
    each: tuple[ReadOptions, ReadOptions]
    formats: tuple[str | None, str | None]
    unit: str | None
    defaults: tuple[str, ...]
    solver: Solver
    curve: bool
    sliding: Sliding | None
    with_: tuple[str, ...]
    preprocess: str | None
    slices: "tuple[SliceBy, ...]" = ()
    step_weights: WeightsByTime | None = None
    existence: str = "ignore"
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
            **dict(self.reading.covariances()),
            **self.each[1].conversion.recorded,
            **({"preprocess": self.preprocess} if self.preprocess else {}),
        }

    def read(self, *paths: str, roles: tuple[str, ...] = ROLES) -> tuple[Reading, ...]:
        """The truth, and the estimate if there is one; or files in other roles.

        Raises
        ------
        InputError
            A path is a folder, a file is wrong, or all lack a header that is mapped; all faults at
            once.
        ConfigError
            No file has a class that was asked for, or the filters leave no row of any.
        """
        check_places(paths)
        sides, faults = [], []
        for side, (path, role) in enumerate(zip(paths, roles, strict=False)):
            try:
                sides.append(self.read_side(path, side, role, paths, roles))
            except (InputError, ConfigError) as error:
                faults.append(error)
        if faults:
            raise type(faults[0])(*dict.fromkeys(line for fault in faults for line in fault.args))
        with suppress(NothingLeftError) if self.one_of_many else nullcontext():
            self.check(tuple(sides), paths)
        return self.preprocessed(tuple(sides), paths) if roles == ROLES else tuple(sides)

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
        in_tables = self.measure.boxes and not {*OF_TRACKEVAL}.isdisjoint(self.with_)
        if len(sides) < len(ROLES) or not (self.preprocess or in_tables):
            return sides
        from tgospa_eval.evaluation.preprocess import (
            benchmark_warnings,
            preprocessed,
        )  # here: for boxes only

        def everything(**changes: Any) -> Reading:
            """As an estimate, of which nothing is left out by a flag."""
            options = replace(self.each[0], **changes)
            return read(paths[0], options, "estimate", self.formats[0])

        if self.preprocess:
            return preprocessed(sides, everything(), (paths[0], paths[1]))
        found = benchmark_warnings(
            sides[0], lambda: everything(classes=None, attributes=("class",))
        )
        return replace(sides[0], warnings=(*sides[0].warnings, *found)), *sides[1:]

    def read_side(
        self,
        path: str,
        side: int,
        role: str,
        paths: tuple[str, ...] = (),
        roles: tuple[str, ...] = ROLES,
    ) -> Reading:
        """One file, the first or second; `paths` are all that are read together, in their roles.

        Raises
        ------
        InputError
            The file cannot be read, or has a row that is wrong.
        """
        options = self.each[side].beside_others(paths, roles)
        if len(paths) == 1:
            options = replace(options, option="--columns")
        return read(path, options, role, self.formats[side])

    def check(self, sides: tuple[Known, ...], paths: tuple[str, ...]) -> None:
        """Whether some file has what was asked of all.

        Raises
        ------
        InputError
            None has a header that is mapped, or classes.
        ConfigError
            None has a class that was asked for, or the filters leave no row of any.
        """
        for name in sides[0].lacking:
            if all(name in side.lacking for side in sides):
                raise InputError(*dict.fromkeys(side.lacking[name] for side in sides))
        check_classes(sides, paths, self.reading.classes, self.each)
        filters = {"time", "class", "region"}
        if not any(side.taken for side in sides) and any(
            filters & side.left_out.keys() for side in sides
        ):
            used = (name.replace("_", "-") for name in self.recorded)
            given = " and ".join(f"--{name}" for name in used if name.split("-")[-1] in filters)
            raise NothingLeftError(f"{given}: no row is left to evaluate")

    def request(self, columns: tuple[str, ...]) -> EvaluationRequest:
        """What is asked of states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that does not enter the distance.
        """
        return EvaluationRequest(
            parameters=self.parameters,
            distance=self.measure.distance(columns),
            solver=self.solver,
            time_matching=self.time_matching,
            unit=self.unit,
            curve=self.curve,
            sliding=self.sliding,
            with_=self.with_,
            recorded=self.recorded,
            defaults=self.defaults,
            slices=self.slices,
            step_weights=self.step_weights,
            existence=self.existence,
        )

    def fit(
        self, sides: tuple[Reading, ...], paths: tuple[str, ...]
    ) -> tuple[Fitted, EvaluationRequest]:
        """Two files on the same steps, and what is asked of them.

        Raises
        ------
        ConfigError
            The options do not fit the files.
        InputError
            The files do not fit each other.
        """
        truth, estimate = (side.trajectories for side in sides)
        names = (paths[0], paths[1])
        check_columns(truth, estimate, names)
        request = self.request(truth.columns)
        fitted = fit(truth, estimate, request, names)
        if not self.one_of_many:
            check_left(fitted.axis, request.time_matching)
        return fitted, request


def infos(sides: tuple[Reading, ...]) -> tuple[FileInfo, FileInfo]:
    """What the result records of both files."""
    truth, estimate = (
        FileInfo(rows=side.rows, format=side.format, left_out=side.left_out) for side in sides
    )
    return truth, estimate


def make_settings(options: Request) -> Settings:
    """The records that the options ask for.

    Raises
    ------
    ConfigError
        A value is out of range, or options do not fit each other.
    InputError
        The file of a covariance is missing or wrong.
    """
    # A file may change from one job of a batch to the next; options do not.
    named = options.covariance, options.inner_cov, options.step_weights
    return _settings(options) if any(named) else _kept(options)


@lru_cache(maxsize=8)
def _kept(options: Request) -> Settings:
    return _settings(options)


def _settings(options: Request) -> Settings:
    measure = DistanceOptions(options)
    slices, columns = _slices(options)
    reading = ReadOptions(
        decimal=options.decimal,
        on_duplicate=options.on_duplicate,
        on_invalid=options.on_invalid,
        boxes=measure.boxes,
        time=options.time,
        classes=_list(options.class_),
        region=options.region,
        by_class=options.by == "class",
        covariance=bool(measure.named.kinds),
        fix_covariance=options.fix_cov,
        missing_covariance=options.missing_cov,
        clouds="cloud" in measure.named.kinds,
        fault=measure.fault,
        attributes=(*columns, *((EXISTENCE,) if options.existence == "use" else ())),
        max_input=options.max_input,
    )
    parameters, defaults = chosen_parameters(
        measure.named, options.order, options.cutoff, options.switch_penalty, options.rho
    )
    each = _each(reading, measure, options)
    if options.preprocess:
        if not measure.boxes:
            raise ConfigError("--preprocess motchallenge: looks at boxes; choose --distance iou")
        if options.by:
            raise ConfigError("--preprocess motchallenge: leaves pedestrians alone, not --by class")
        # Distractors are classes of the truth.
        each = replace(each[0], by_class=True, class_for="--preprocess"), each[1]
    return Settings(
        parameters=parameters,
        defaults=defaults,
        measure=measure,
        time_matching=TimeMatching(
            tolerance=options.time_tolerance,
            grid=options.grid,
            interpolate=options.interpolate,
            max_gap=options.max_gap,
            resample=options.resample,
            steps=parse_steps(options.steps, parse_moments(options.time)),
            outage=options.outage,
        ),
        reading=reading,
        each=each,
        formats=(options.truth_format, options.estimate_format),
        unit=options.unit,
        solver=_solver(options),
        curve=options.curve,
        sliding=Sliding.asked(options.window, options.every),
        preprocess=options.preprocess,
        with_=() if options.with_ is None else chosen_metrics(options.with_),
        slices=slices,
        step_weights=_step_weights(options),
        existence=options.existence,
    )


def _slices(options: Request) -> "tuple[tuple[SliceBy, ...], tuple[str, ...]]":
    """What costs are split by, and the columns that this may need."""
    if not options.slices:
        return (), ()
    from tgospa_eval.evaluation.slicing import columns_asked, parse_slices  # here: as weights

    slices = parse_slices(options.slices, summed=options.summed or options.by is not None)
    return slices, columns_asked(slices)


def _step_weights(options: Request) -> WeightsByTime | None:
    if options.step_weights is None:
        return None
    from tgospa_eval.formats.text.small import read_step_weights  # here: few want it

    return read_step_weights(options.step_weights, options.decimal)


def _each(
    reading: ReadOptions, measure: DistanceOptions, options: Request
) -> tuple[ReadOptions, ReadOptions]:
    """How to read truth and estimate: columns and classes of one go before those of both."""
    own = (
        (options.sides[0], _list(options.truth_columns), _list(options.truth_class)),
        (options.sides[1], _list(options.estimate_columns), _list(options.estimate_class)),
    )
    columns_of = columns_of_each(_list(options.columns), *(columns for _, columns, _ in own))
    truth, estimate = (
        replace(
            reading,
            columns=measure.columns(columns),
            classes=classes or reading.classes,
            shared=shared if classes else (*shared, "class"),
            option=f"--{side}-columns",
        )
        for (side, _, classes), (columns, shared) in zip(own, columns_of, strict=True)
    )
    conversion = Conversion(
        time_offset=options.time_offset,
        time_scale=options.time_scale,
        unit_scale=options.unit_scale,
        angles=tuple(measure.period),
    )
    return truth, replace(estimate, conversion=conversion)


def _list(text: str | None) -> tuple[str, ...] | None:
    """The parts of a list with commas."""
    return None if text is None else tuple(part.strip() for part in text.split(","))


def _solver(options: Request) -> Solver:
    """The solver that the options ask for."""
    settings: dict[str, float | None] = {"time_limit": options.time_limit}
    if options.solver != "exact":
        settings |= {"gap": options.gap, "jobs": options.jobs}
    if options.solver == "sinkhorn":
        settings["epsilon"] = options.epsilon
    return solver_class(options.solver)(**settings)
