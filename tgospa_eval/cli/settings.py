"""From the values of the options to records, and with them to files that fit each other."""

from dataclasses import dataclass
from typing import Any

from tgospa_eval.alignment import Alignment, Stamps, align
from tgospa_eval.cli.distance import DistanceOptions
from tgospa_eval.cli.streams import say
from tgospa_eval.distances import Distance
from tgospa_eval.distances.checks import check_columns, check_states
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import ROLES, Reading, ReadOptions, read
from tgospa_eval.formats.columns import PREFIXES
from tgospa_eval.problem import Parameters
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import quoted


@dataclass(frozen=True, kw_only=True, eq=False)
class Settings:
    """The options of everything that reads files and measures distances, checked.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order, switch penalty; those of the distance where none is given.
    measure : DistanceOptions
        The distance, as far as it is known without the columns of the files.
    stamps : Stamps
        Which stamps are one step, and which steps count.
    reading : ReadOptions
        How to read.
    formats : pair of str or None
        Format of truth and estimate; None is guessed.
    unit : str, optional
        For printing.
    """

    parameters: Parameters
    measure: DistanceOptions
    stamps: Stamps
    reading: ReadOptions
    formats: tuple[str | None, str | None]
    unit: str | None

    @property
    def recorded(self) -> dict[str, Any]:
        """Options of reading that change the number, by the names of the JSON."""
        return {
            "decimal": self.reading.decimal,
            "on_duplicate": self.reading.on_duplicate,
            **dict(self.reading.filters()),
            **dict(self.reading.covariances()),
        }

    def read(self, *paths: str, roles: tuple[str, ...] = ROLES) -> tuple[Reading, ...]:
        """The truth, and the estimate if there is one; or files in other roles.

        Raises
        ------
        InputError
            A file is wrong.
        ConfigError
            No file has a class that was asked for, or the filters leave no row of any.
        """
        sides = tuple(
            read(path, self.reading, role, format)
            for path, role, format in zip(paths, roles, self.formats, strict=False)
        )
        there = {name for side in sides for name in side.named}
        for name in self.reading.classes or ():
            if name not in there:
                known = ", ".join(map(quoted, sorted(there)[:10])) or "none"
                raise ConfigError(
                    f"--class {quoted(name)}: no row is of that class; there are {known}"
                )
        filters = {"time", "class", "region"}
        if not any(len(side.trajectories.step) for side in sides) and any(
            filters & side.left_out.keys() for side in sides
        ):
            given = " and ".join(f"--{name}" for name in self.recorded if name in filters)
            raise ConfigError(f"{given}: no row is left to evaluate")
        return sides

    def fit(self, sides: tuple[Reading, ...], paths: tuple[str, ...]) -> tuple[Distance, Alignment]:
        """The distance between the states of two files, and both on the same steps.

        Raises
        ------
        ConfigError, InputError
            They do not fit each other, or the options do not fit them.
        """
        truth, estimate = (side.trajectories for side in sides)
        names = (paths[0], paths[1])
        check_columns(truth, estimate, names)
        mapped = (item.strip() for item in self.reading.columns or () if "=" in item)
        spreads = [item for item in mapped if item.startswith(PREFIXES)]
        if self.reading.covariance and truth.kind == estimate.kind == "point" and spreads:
            raise InputError(
                f"--columns {','.join(spreads)}: neither {names[0]} nor {names[1]} has such "
                "columns; name headers of the covariances"
            )
        distance = self.measure.distance(truth.columns)
        check_states(truth, estimate, distance, names)
        aligned = align(truth, estimate, self.stamps, names)
        if aligned.union and not len(aligned.truth.times):
            raise ConfigError(
                f"--grid {self.stamps.grid}: no step is left, none of {aligned.union} counts; "
                "if the clocks differ, see --time-tolerance"
            )
        return distance.fitted(aligned.truth, aligned.estimate), aligned


def make_settings(options: dict[str, Any], given: dict[str, bool]) -> Settings:
    """The records that the options ask for.

    Parameters
    ----------
    options : dict
        Values of the options; the switch penalty is 0 where a verb has none.
    given : dict
        Whether cutoff and switch penalty were given, or are defaults.

    Raises
    ------
    TgospaError
        Something is wrong with them.
    """
    if options["config"] and not options["quiet"]:
        say(f"settings from {options['config']}")
    measure = DistanceOptions(options)
    metric = {"cutoff": options["cutoff"], "switch_penalty": options.get("switch_penalty", 0.0)}
    defaults = dict(zip(metric, measure.named.defaults, strict=True))
    metric |= {name: defaults[name] for name, is_given in given.items() if not is_given}
    columns, classes = options["columns"], options["class_"]
    return Settings(
        parameters=Parameters(order=options["order"], **metric),
        measure=measure,
        stamps=Stamps(tolerance=options["time_tolerance"], grid=options["grid"]),
        reading=ReadOptions(
            columns=measure.columns(None if columns is None else tuple(columns.split(","))),
            decimal=options["decimal"],
            on_duplicate=options["on_duplicate"],
            boxes=measure.boxes,
            time=options["time"],
            classes=None if classes is None else tuple(map(str.strip, classes.split(","))),
            region=options["region"],
            by_class=options["by"] == "class",
            covariance=bool(measure.named.kinds),
            fix_covariance=options["fix_cov"],
            missing_covariance=options["missing_cov"],
            clouds="cloud" in measure.named.kinds,
            fault=measure.fault,
        ),
        formats=(options["truth_format"], options["estimate_format"]),
        unit=options["unit"],
    )


def make_solver(options: dict[str, Any]) -> Solver:
    """The solver that the options ask for."""
    name = options["solver"]
    settings: dict[str, Any] = {"time_limit": options["time_limit"]}
    if name != "exact":
        settings |= {"gap": options["gap"], "jobs": options["jobs"]}
    if name == "sinkhorn":
        settings["epsilon"] = options["epsilon"]
    return solver_class(name)(**settings)
