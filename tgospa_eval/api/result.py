"""Evaluations as users hold them: records with methods that show, save, split and explain."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn, overload

from tgospa_eval.api.report import Reportable, as_frame
from tgospa_eval.common.frozen import dataclass, recast
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import EvaluationByClass, PairEvaluation
from tgospa_eval.results.evaluation import DOCUMENTED, Evaluation
from tgospa_eval.results.explanation import Explanation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import SPLIT_PARTS, Columns, PairProof
from tgospa_eval.results.slices import Slicing

if TYPE_CHECKING:
    import os
    from typing import Unpack

    import pandas as pd
    from matplotlib.figure import Figure

    from tgospa_eval.results.gradient import Gradient
    from tgospa_eval.show.charts import Place
    from tgospa_eval.show.plot_data import PlotData

PUBLIC = (
    *(*DOCUMENTED, *SPLIT_PARTS, "worst", "warnings", "notices", "results"),
    *("per_step", "switches", "assignments", "per_truth", "per_estimate", "curve"),
    *("windows", "with_", "slices", "nees", "ignored"),
    *("metrics", "similarity", "gradient", "proof", "explain"),
    *("table", "to_dict", "to_json", "to_markdown", "to_latex", "to_html", "to_geojson", "save"),
    *("plot_costs", "plot_cumulative", "plot_lanes", "plot_nees", "plot_plane"),
    *("plot_windows", "plot_worst"),
)
"""Names that ``dir`` lists: those of the JSON, the tables, and what can be made of them."""


class Showable(Evaluation, Reportable):
    """An evaluation with its pictures, pages and slices."""

    def __dir__(self) -> list[str]:
        return [name for name in PUBLIC if name in self.__dict__ or hasattr(type(self), name)]

    def slices(self, *by: str) -> tuple[Slicing, ...]:
        """Split costs and counts by attributes of truth and estimate at each step.

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
        if not by:
            return self.slicings
        from tgospa_eval.evaluation.slices import slices_of  # lazy: slow to import

        assert isinstance(self, (PairEvaluation, EvaluationByClass))
        return slices_of(self, by)

    def plot_costs(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot the cost of each step, stacked: localisation, missed, false, switch.

        If there are too many steps to tell apart, each bar is the costliest of several steps, and
        the axis says of how many.

        Parameters
        ----------
        style : {"screen", "paper"}
            With a title; or small, for one column of a journal.
        components : sequence of str, optional
            Parts of the cost to plot, of ``"localisation"``, ``"missed"``, ``"false"``,
            ``"switch"``; all by default.
        ax, figure : Axes, Figure or SubFigure of matplotlib, optional
            Where to draw: axes, for a picture of one panel, which gets no title then; or an empty
            figure. By default in a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure
            Belongs to no window.

        Raises
        ------
        ConfigError
            A name is unknown, or matplotlib is not installed.
        """
        return self._plot("costs", style=style, components=components, **place)

    def plot_cumulative(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot the normalised cumulative cost: the root of the mean cost of the steps up to each.

        The assignment is that of the whole recording, unless the curve was asked for; the last
        value of the total is ``normalised["tgospa"]``. Parameters, errors and return value are
        those of `plot_costs`; the total is always drawn.
        """
        return self._plot("cumulative", style=style, components=components, **place)

    def plot_lanes(self, *, style: str = "screen", **place: "Unpack[Place]") -> "Figure":
        """Plot a lane for each truth with the estimates that follow it, and lanes of false tracks.

        A gap with a frame is missed, a triangle is a switch, and the darker foot of a bar is the
        error as a share of the cutoff. If there are too many trajectories, the costliest have lanes
        and the others share one, in which the height is the number of missed or false ones.
        Parameters, errors and return value are those of `plot_costs`.
        """
        return self._plot("lanes", style=style, **place)

    def plot_plane(
        self,
        *,
        columns: tuple[str, str] | None = None,
        style: str = "screen",
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot trajectories in two of the state columns, with misses, false targets and switches.

        Boxes, ellipses that hold 95 % of a normal distribution, and particles are drawn here and
        there along few trajectories where the states have such and the two columns show them. A
        second panel shows all of those around the assigned pair that is farthest apart.

        Parameters
        ----------
        columns : pair of str, optional
            Columns of the horizontal and the vertical axis: state columns, ``"t"`` for the time,
            for boxes also ``"centre x"`` and ``"centre y"``. By default the first two state
            columns, the centres of boxes, or ``lon`` and ``lat``; a single column over time.
        style : {"screen", "paper"}
            With a title; or small, for one column of a journal.

        Returns
        -------
        matplotlib.figure.Figure
            Belongs to no window.

        Raises
        ------
        ConfigError
            A column or the style is unknown, or matplotlib is not installed.
        """
        return self._plot("plane", columns=columns, style=style, **place)

    def plot_nees(self, *, style: str = "screen", **place: "Unpack[Place]") -> "Figure":
        """Plot NEES of each step with its 95 % band; of particles also the ranks of the truth.

        Errors and return value are those of `plot_costs`.

        Raises
        ------
        ConfigError
            There is no NEES.
        """
        return self._plot("nees", style=style, **place)

    def plot_windows(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot sliding windows: at the middle of each the root of its mean cost, as in `windows`.

        Parameters, errors and return value are those of `plot_costs`; the total is always drawn.

        Raises
        ------
        ConfigError
            Windows were not asked for.
        """
        return self._plot("windows", style=style, components=components, **place)

    def plot_worst(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot the costliest steps, truths and estimates, and their costs.

        Parameters, errors and return value are those of `plot_costs`; only `components` count.
        """
        return self._plot("worst", style=style, components=components, **place)

    @property
    def plot_data(self) -> "PlotData":
        """Data of page and pictures: `show.plot_data.PlotData`."""
        from tgospa_eval.show.plot_data import plot_data  # lazy: slow to import

        return plot_data(self)

    @property
    def kind(self) -> str:
        """A result."""
        return "result"

    @overload
    def table(self) -> "pd.DataFrame": ...

    @overload
    def table(self, name: str) -> Columns: ...

    def table(self, name: str | None = None) -> "pd.DataFrame | Columns":
        """Return one row with all numbers, as of a batch; or a table by its name, as plain columns.

        Names are those of the DataFrames, and ``"per_class"``; those that were not asked for have
        no columns.

        Raises
        ------
        ConfigError
            There is no such table.
        """
        if name is not None:
            return super().table(name)
        from tgospa_eval.campaign.row import row_of  # lazy: few ask for it

        return as_frame({key: [value] for key, value in row_of(self).items()})

    def rendered(self, format: str) -> str:
        """Return the report as ``--format`` prints it."""
        from tgospa_eval.show.result_text import REPORTS  # lazy: slow to import

        return REPORTS[format](self)

    def _repr_html_(self) -> str:
        from tgospa_eval.show.html import card  # lazy: jinja2 is slow to import

        return card(self)

    def to_html(self) -> str:
        """Return the report as one page that loads nothing."""
        from tgospa_eval.show.html import page  # lazy: jinja2 is slow to import

        return page(self)

    def to_geojson(self) -> str:
        """Return tracks, misses, false targets, errors and switches as GeoJSON, for maps.

        Raises
        ------
        ConfigError
            The states are not on the Earth, or it is a sum of several evaluations.
        """
        from tgospa_eval.show.files import geojson  # lazy: slow to import

        return geojson(self)

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
        from tgospa_eval.show.files import save  # lazy: jinja2 is slow to import

        save(self, folder, force=force)


class Proof(PairProof):
    """The proof of a result, to be saved for others; fields are those of `PairProof`."""

    def __repr__(self) -> str:
        low, high = self.bounds.lower, self.bounds.upper
        return f"Proof({low:.17g} <= total / c^p <= {high:.17g}, {self.parameters.in_words()})"

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the proof folder: what a third party needs to check the bounds again.

        Parameters
        ----------
        folder : str or path
            Where; a folder that an earlier proof was saved to is written anew.
        force : bool
            Whether it may hold files of others.

        Raises
        ------
        ConfigError
            The folder cannot be written, or holds files of others.
        SolverError
            A checker finds that it does not prove what it claims.
        """
        from tgospa_eval.show.files import save_proof  # lazy: slow to import

        save_proof(self, folder, force=force)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result(Showable, PairEvaluation):
    """Result of one evaluation. Attributes have the names of the JSON; tables are built when read.

    Parameters
    ----------
    proof : Proof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        Times and ids, the gap that counts as exact, options, and how it was made.
    source : pair of AlignedPair and EvaluationRequest, optional
        What was evaluated, and how.
    assigned : mapping of str to (N,) float array
        Further values of each assigned pair, in the order of the table of assignments: parts of
        the cost by name, and ``nees``.
    explained : Explanation, optional
        Repairs that would save the most, if requested.
    """

    proof: Proof

    def explain(self, top: int = 10) -> Explanation:
        """Return the single repairs of the estimate that would save the most, with proven bounds.

        A repair merges, exchanges, splits, drops, cuts, fills or extends tracks, or moves the whole
        estimate in time or space. Its saving is proven by bounds before and after it. Savings of
        several repairs do not add up.

        Parameters
        ----------
        top : int
            How many repairs to list at most; up to twice as many are tried.

        Returns
        -------
        Explanation
            Repairs, the best first; `Explanation.repaired` makes the repaired estimate.

        Raises
        ------
        ConfigError
            `top` is less than 1, or the result was not made by `evaluate`.
        """
        from tgospa_eval.explain import explain  # lazy: slow to import

        return explain(self, top)

    def gradient(self) -> "Gradient":
        """Return how the cost changes with each state of the estimate, cutoff and switch penalty.

        This is the derivative of the cost with the reported assignment fixed (envelope theorem).
        If the best assignment is unique, it is the derivative of the metric, else one of several
        directional derivatives; `Gradient.unique` says which is known.

        Returns
        -------
        Gradient
            Of ``total`` and of ``tgospa``.

        Raises
        ------
        ConfigError
            No derivative is known of the base distance.
        """
        from tgospa_eval.evaluation.gradient import gradient  # lazy: slow to import

        return gradient(self)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ByClass(Showable, EvaluationByClass):
    """One result for each class, and their sum: totals, bounds, counts and parts add up.

    Parameters
    ----------
    results : dict of str to Result
        By class, in order; at least one.
    """

    results: dict[str, Result]


def result_of(evaluation: PairEvaluation) -> Result:
    """Return the result that a user holds of an evaluation."""
    return recast(evaluation, Result, proof=recast(evaluation.proof, Proof))


class ResultInParts(Showable, PartitionedResult):
    """Result of data in parts: sums in memory, tables as files that are removed with it."""

    def slices(self, *by: str) -> tuple[Slicing, ...]:  # noqa: D102  (as of Showable)
        if by:
            self._refuse("slices")
        return self.slicings

    def plot_lanes(self, **_: object) -> NoReturn:  # noqa: D102
        self._refuse("plot_lanes")

    def plot_plane(self, *_: object, **__: object) -> NoReturn:  # noqa: D102
        self._refuse("plot_plane")

    def plot_windows(self, **_: object) -> NoReturn:  # noqa: D102
        self._refuse("plot_windows")

    def _refuse(self, name: str) -> NoReturn:
        raise ConfigError(
            f"{name}: not supported for data in parts; evaluate a part of the data that fits into "
            "memory, by time or region"
        )
