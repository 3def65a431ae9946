"""What a user does with an evaluation, or with a sum of several: read, show and save it.

What draws and writes is imported when it is asked for.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING

from tgospa_eval.common.config import settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import number, sizes_in_words
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.numbers import SPLIT_PARTS, USUAL_SCORE, Calibration, Numbers, Similarity
from tgospa_eval.results.records import PARTS, Columns, Json, json_text, records
from tgospa_eval.results.repairs import Repairs
from tgospa_eval.results.slices import Slicing

if TYPE_CHECKING:
    import os

    import pandas as pd
    from matplotlib.figure import Figure

RESULT_SCHEMA = "tgospa-eval/result/1"

BRACKET = ("tgospa", "total", "lower_bound", "upper_bound", "relative_gap", "certified")
LOGGED = (*BRACKET, *PARTS)
"""What every result has one number of."""

PUBLIC = (
    *(*LOGGED, *SPLIT_PARTS, "within_rounding"),
    *("metric", "counts", "normalised", "parameters", "sizes", "judged", "worst", "solver"),
    *("timings", "input", "version", "warnings", "files", "results"),
    *("per_step", "switches", "assignments", "per_truth", "per_estimate", "curve"),
    *("windows", "with_", "slices"),
    *("metrics", "similarity", "gradient", "proof", "explain"),
    *("to_dict", "to_json", "to_html", "save"),
    *("plot_costs", "plot_cumulative", "plot_lanes", "plot_plane", "plot_windows"),
    "plot_worst",
)
"""What ``dir`` lists: the names of the JSON, the tables, and what can be made of them."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Summary(Numbers, ABC):
    """The numbers with all that can be made of them; attributes bear the names of the JSON.

    Parameters
    ----------
    explained : Repairs, optional
        Single repairs that would save most, if they were asked for.
    """

    explained: Repairs | None = None

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(tgospa={self.tgospa:.6g}, lower_bound={self.lower_bound:.6g}, "
            f"certified={self.certified})"
        )

    def __dir__(self) -> list[str]:
        return [name for name in PUBLIC if name in self.__dict__ or hasattr(type(self), name)]

    def to_dict(self) -> Json:
        """The JSON document as plain Python values."""
        curve = {} if self.traced is None else {"curve": records(self.curve_table())}
        if self.slid is not None:
            curve["windows"] = records(self.windows_table())
        return {
            **self.split_parts,
            **curve,
            **({"with": self.with_} if self.with_ else {}),
            **({} if self.calibration is None else {"similarity": self.similarity().record()}),
            **({"slices": [one.record() for one in self.sliced]} if self.sliced else {}),
            **({} if self.explained is None else {"explanation": self.explained.record()}),
            "schema": RESULT_SCHEMA,
            "metric": self.metric,
            "tgospa": self.tgospa,
            "total": self.total,
            "lower_bound": self.lower_bound,
            "upper_bound": self.upper_bound,
            "relative_gap": self.relative_gap,
            "certified": self.certified,
            "within_rounding": self.within_rounding,
            "localisation": self.localisation,
            "missed": self.missed,
            "false": self.false,
            "switch": self.switch,
            "counts": self.counts,
            "normalised": self.normalised,
            "parameters": self.parameters,
            "sizes": self.sizes,
            "judged": self.judged,
            **self._records(),
            "worst": self.worst(),
            "solver": self.solver,
            "timings": self.timings,
            "input": self.input,
            "version": self.version,
            "warnings": [notice.record() for notice in self.warnings],
            "files": self.files,
            **settings_field(self.settings_file),
        }

    def _records(self) -> Json:
        """What has a record for each step, and for each switch."""
        return {
            "per_step": records(self.per_step_table()),
            "switches": records(self.switches_table()),
        }

    @property
    def split_parts(self) -> dict[str, float]:
        """Those parts of localisation that there are."""
        found = {name: getattr(self, name) for name in SPLIT_PARTS}
        return {name: part for name, part in found.items() if part is not None}

    def metrics(self) -> dict[str, float]:
        """The numbers as a flat dict of floats, for loggers of experiments.

        Names are those of the JSON, with a dot between levels: ``tgospa``, ``total``,
        ``lower_bound``, ``upper_bound``, ``relative_gap``, ``certified`` (1 or 0),
        ``localisation``, ``missed``, ``false``, ``switch``, ``counts.missed``, ``counts.false``,
        ``counts.switch``, ``normalised.tgospa``; where the distance has such parts also
        ``localisation_mean`` and ``localisation_spread``, with probabilities of existence
        ``expected_localisation`` and ``existence_mismatch``; other metrics that were asked for as
        ``with.hota.HOTA``, and ``similarity``.
        """
        scored = {} if self.calibration is None else {"similarity": self.similarity().score}
        names = [*LOGGED, *self.split_parts]
        groups = {"counts": self.counts, "normalised": self.normalised}
        return {
            **{name: float(getattr(self, name)) for name in names},
            **scored,
            **_dotted(groups),
            **self.other_numbers,
        }

    @property
    def other_numbers(self) -> dict[str, float]:
        """Those of them that are of other metrics."""
        return _dotted({f"with.{name}": numbers for name, numbers in self.with_.items()})

    @abstractmethod
    def slices(self, *by: str) -> tuple[Slicing, ...]:
        """Costs and counts split by attributes of truth and estimate at each step.

        Localisation errors and misses go by the truth's attribute at the step, false targets by
        the estimate's own, switches by the truth's at the later of the two steps. Slices add up to
        the whole. Where several assignments are best, another may be split otherwise:
        `Slicing.unique` says whether that is ruled out.

        Parameters
        ----------
        *by : str
            As of ``--slice``: ``"range=0:50:100"``, ``"class"``, ``"visibility=weight"``,
            ``"class * speed=0:5:20"``. Without any, those that ``evaluate(..., slices=)`` was asked
            for. Columns of files must have been asked for there.

        Returns
        -------
        tuple of Slicing
            One for each, with `Slicing.frame`.

        Raises
        ------
        ConfigError
            There is no such attribute, or its values do not fit what is asked for.
        """

    def similarity(
        self, false_targets: float | None = None, score: float = USUAL_SCORE
    ) -> Similarity:
        """A score from 0 to 1 of the value per step: 1 is perfect.

        Parameters
        ----------
        false_targets : float
            How many false targets at each step, and nothing else, get `score`.
        score : float
            What they get.

        Returns
        -------
        Similarity
            The score with proven bounds.

        Raises
        ------
        ConfigError
            A number is out of its range, or the steps are weighted: a value per step has no
            meaning then.
        """
        calibration = self.calibration
        if false_targets is not None:
            calibration = Calibration(false_targets=false_targets, score=score)
        if calibration is None:
            raise ConfigError("similarity: say how many false targets at each step score 0.1")
        if "step_weights" in self.settings:
            raise ConfigError(
                "similarity: the steps are weighted, and the score is of the mean over steps that "
                "all count the same; leave the weights out"
            )
        bounds, each = self.proof.bounds, self.judged_on.each
        return calibration.similarity(
            self.normalised["tgospa"],
            (self.outward_root(bounds.lower / each, -1), self.outward_root(bounds.upper / each, 1)),
            self.proof.parameters,
        )

    def to_json(self) -> str:
        """The JSON document: sorted keys, no NaN, full doubles."""
        return json_text(self.to_dict())

    def quantity(self, value: float) -> str:
        """A value in words, with the unit of the states."""
        return number(value) + (f" {self.labels.unit}" if self.labels.unit else "")

    def share(self, part: float) -> str:
        """A cost in percent of the total, in words."""
        return f"{100 * part / self.total:.1f} %" if self.total > 0 else "-"

    @property
    def proven(self) -> str:
        """How the value is known, in words."""
        if self.within_rounding:
            lower, upper = self.quantity(self.lower_bound), self.quantity(self.upper_bound)
            return f"within the rounding of the distances: proven to be between {lower} and {upper}"
        if self.certified:
            # No more than 12 digits: the last ones are rounding and differ between machines.
            digits = math.floor(-math.log10(max(self.relative_gap, 1e-12)) + 1e-9)
            return f"exact: proven lower and upper bound agree to {digits} digits"
        return f"proven (the totals differ by {number(100 * self.relative_gap, 2)}%)"

    @property
    def claim(self) -> str:
        """The value, or the bracket, in words."""
        value = self.quantity(self.tgospa)
        if self.certified:
            return f"TGOSPA = {value}"
        return f"TGOSPA is between {self.quantity(self.lower_bound)} and {value}"

    def _repr_html_(self) -> str:
        from tgospa_eval.results.notebook import card

        per_step = self.per_step_table()
        cost = {name: getattr(self, name) for name in PARTS} | {"total": self.total}
        times = per_step["t"] or [""]
        return card(
            title=self.claim,
            proof=self.proven,
            notes=(
                *self.told,
                sizes_in_words(self.sizes),
                self.parameters_in_words(self.labels.unit),
            ),
            parts=[
                (name, number(value), self.share(value), _count(self.counts.get(name)))
                for name, value in cost.items()
            ],
            costs={name: per_step[name] for name in PARTS},
            ends=(str(times[0]), str(times[-1])),
        )

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """`per_step_table` as a DataFrame."""
        return _frame(self.per_step_table())

    @cached_property
    def curve(self) -> "pd.DataFrame":
        """`curve_table` as a DataFrame."""
        return _frame(self.curve_table())

    @cached_property
    def windows(self) -> "pd.DataFrame":
        """`windows_table` as a DataFrame."""
        return _frame(self.windows_table())

    @cached_property
    def switches(self) -> "pd.DataFrame":
        """`switches_table` as a DataFrame."""
        return _frame(self.switches_table())

    @cached_property
    def assignments(self) -> "pd.DataFrame":
        """`assignments_table` as a DataFrame."""
        return _frame(self.assignments_table())

    @cached_property
    def per_truth(self) -> "pd.DataFrame":
        """`per_truth_table` as a DataFrame."""
        return _frame(self.per_truth_table())

    @cached_property
    def per_estimate(self) -> "pd.DataFrame":
        """`per_estimate_table` as a DataFrame."""
        return _frame(self.per_estimate_table())

    def plot_costs(
        self, *, style: str = "screen", components: Sequence[str] | None = None
    ) -> "Figure":
        """Cost of each step, stacked: `tgospa_eval.plots.plot_costs`."""
        return self._plot("plot_costs", style=style, components=components)

    def plot_cumulative(
        self, *, style: str = "screen", components: Sequence[str] | None = None
    ) -> "Figure":
        """Normalised cumulative cost: `tgospa_eval.plots.plot_cumulative`."""
        return self._plot("plot_cumulative", style=style, components=components)

    def plot_lanes(self, *, style: str = "screen") -> "Figure":
        """Who followed whom: `tgospa_eval.plots.plot_lanes`."""
        return self._plot("plot_lanes", style=style)

    def plot_plane(
        self, *, columns: tuple[str, str] | None = None, style: str = "screen"
    ) -> "Figure":
        """Trajectories in two of the state columns: `tgospa_eval.plots.plot_plane`."""
        return self._plot("plot_plane", columns=columns, style=style)

    def plot_windows(
        self, *, style: str = "screen", components: Sequence[str] | None = None
    ) -> "Figure":
        """Sliding windows, if they were asked for: `tgospa_eval.plots.plot_windows`."""
        return self._plot("plot_windows", style=style, components=components)

    def plot_worst(
        self, *, style: str = "screen", components: Sequence[str] | None = None
    ) -> "Figure":
        """The costliest steps, truths and estimates: `tgospa_eval.plots.plot_worst`."""
        return self._plot("plot_worst", style=style, components=components)

    def _plot(self, name: str, **options: object) -> "Figure":
        self._check_drawn(name)
        made: Figure = getattr(import_module("tgospa_eval.plots"), name)(self, **options)
        return made

    def _check_drawn(self, name: str) -> None:
        """Whether there is such a picture, as there is of most results; else ConfigError."""

    def to_html(self) -> str:
        """The report as one page that loads nothing."""
        return str(import_module("tgospa_eval.reports.html").page(self))

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the result folder of ``-o``: JSON, tables, the page and the pictures.

        The pictures are written with the extra ``plot``.

        Parameters
        ----------
        folder : str or path
            Where; a folder that an earlier result was saved to is written anew.
        force : bool
            Whether it may hold files of others.

        Raises
        ------
        ConfigError
            The folder cannot be written, or holds files of others.
        """
        import_module("tgospa_eval.plots.result_pictures").save(self, folder, force=force)


def _dotted(groups: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Numbers of several groups in one dict, with a dot between the names."""
    return {
        f"{group}.{name}": float(x) for group, found in groups.items() for name, x in found.items()
    }


def _count(amount: float | None) -> str:
    return "" if amount is None else number(amount)


def _frame(table: Columns) -> "pd.DataFrame":
    import pandas as pd  # here: importing it takes longer than most evaluations

    return pd.DataFrame(table)
