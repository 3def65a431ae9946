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
    from tgospa_eval.show.chart_list import Place
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
    """Evaluation with its pictures, pages and slices."""

    def __dir__(self) -> list[str]:
        return [name for name in PUBLIC if name in self.__dict__ or hasattr(type(self), name)]

    def slices(self, *by: str) -> tuple[Slicing, ...]:
        """Split costs and counts by attributes of truth and estimate at each step.

        Localisation errors and missed targets are split by the attribute of the true object at the
        step, false targets by the attribute of the estimate, and switches by the attribute of the
        true object at the later of the two steps. Slices add up to the whole. If several
        assignments are optimal, another one may give other slices; `Slicing.unique` is true if the
        assignment is proven to be the only one.

        Parameters
        ----------
        *by : str
            Slices as for ``--slice``: ``"range=0:50:100"``, ``"class"``, ``"visibility=weight"``,
            ``"class * speed=0:5:20"``. By default the slices of ``evaluate(..., slices=)``. A
            further column of the files, such as visibility, must be named there.

        Returns
        -------
        tuple of Slicing
            One for each argument, with `Slicing.frame`.

        Raises
        ------
        ConfigError
            The attribute is unknown, or its values do not fit the request.
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

        If there are more steps than can be drawn, each bar is the costliest of several steps; the
        axis shows how many.

        Parameters
        ----------
        style : {"screen", "paper"}
            ``"screen"`` has a title; ``"paper"`` fits one column of a journal.
        components : sequence of str, optional
            Parts of the cost to plot, of ``"localisation"``, ``"missed"``, ``"false"``,
            ``"switch"``; all by default.
        ax, figure : Axes, Figure or SubFigure of matplotlib, optional
            Axes for a picture of one panel, which then has no title; or an empty figure. The
            default is a new figure.

        Returns
        -------
        matplotlib.figure.Figure
            Figure without a window.

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
        """Plot, for each step, the root of the mean cost of all steps up to this one.

        The assignment is that of the whole recording. With ``evaluate(..., curve=True)`` the steps
        up to each step have an assignment of their own. The last
        value of the total is ``normalised["tgospa"]``. Parameters, errors and return value are
        those of `plot_costs`; the total is always drawn.
        """
        return self._plot("cumulative", style=style, components=components, **place)

    def plot_lanes(self, *, style: str = "screen", **place: "Unpack[Place]") -> "Figure":
        """Plot a lane for each true object with its estimates, and lanes of false tracks.

        A framed gap is a missed target, a triangle is a switch, and the darker lower part of a bar
        is the error as a share of the cutoff. If there are too many trajectories, the costliest
        have lanes. The others share one lane, whose height is the number of missed or false
        targets. Parameters, errors and return value are those of `plot_costs`.
        """
        return self._plot("lanes", style=style, **place)

    def plot_plane(
        self,
        *,
        columns: tuple[str, str] | None = None,
        style: str = "screen",
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot trajectories in two state columns, with missed and false targets and switches.

        Boxes, 95 % ellipses of normal distributions, and particles are drawn at some steps of a few
        trajectories, if the states have them and the two columns show them. A second panel shows
        all such shapes near the assigned pair with the largest distance.

        Parameters
        ----------
        columns : pair of str, optional
            Columns of the horizontal and the vertical axis: state columns, ``"t"`` for the time,
            and for boxes ``"centre x"`` and ``"centre y"``. By default the first two state columns,
            the centres of boxes, or ``lon`` and ``lat``; a single column is drawn over time.
        style : {"screen", "paper"}
            ``"screen"`` has a title; ``"paper"`` fits one column of a journal.

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
        """Plot the NEES of each step, with its 95 % band.

        NEES is the squared error in units of the covariance. For particle clouds a second panel
        shows the rank of the truth among the particles.

        Parameters, further errors and return value are those of `plot_costs`.

        Raises
        ------
        ConfigError
            The result has no NEES.
        """
        return self._plot("nees", style=style, **place)

    def plot_windows(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot the root of the mean cost of each sliding window at its middle, as in `windows`.

        Parameters, errors and return value are those of `plot_costs`; the total is always drawn.

        Raises
        ------
        ConfigError
            Windows were not requested.
        """
        return self._plot("windows", style=style, components=components, **place)

    def plot_worst(
        self,
        *,
        style: str = "screen",
        components: Sequence[str] | None = None,
        **place: "Unpack[Place]",
    ) -> "Figure":
        """Plot the costliest steps, true objects and estimates, and their costs.

        Parameters, errors and return value are those of `plot_costs`; only the costs of
        `components` count.
        """
        return self._plot("worst", style=style, components=components, **place)

    @property
    def plot_data(self) -> "PlotData":
        """Data of page and pictures: `show.plot_data.PlotData`."""
        from tgospa_eval.show.plot_data import plot_data  # lazy: slow to import

        return plot_data(self)

    @property
    def kind(self) -> str:
        """Name of the kind of result."""
        return "result"

    @overload
    def table(self) -> "pd.DataFrame": ...

    @overload
    def table(self, name: str) -> Columns: ...

    def table(self, name: str | None = None) -> "pd.DataFrame | Columns":
        """Return one row with all numbers, as in a batch; or the columns of a table by its name.

        Names are those of the DataFrames, and ``"per_class"``. A table that was not requested has
        no columns.

        Raises
        ------
        ConfigError
            The table is unknown.
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
        """Return the report as one HTML page that loads no other files."""
        from tgospa_eval.show.html import page  # lazy: jinja2 is slow to import

        return page(self)

    def to_geojson(self) -> str:
        """Return tracks, missed and false targets, errors and switches as GeoJSON, for maps.

        Raises
        ------
        ConfigError
            The states are not positions on the Earth, or the result is a sum of evaluations.
        """
        from tgospa_eval.show.files import geojson  # lazy: slow to import

        return geojson(self)

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the result folder of ``-o``: JSON, tables, the page and the pictures.

        The pictures are written with the extra ``plot``.

        Parameters
        ----------
        folder : str or path
            Folder to write. An earlier result in it is replaced.
        force : bool
            Whether the folder may have other files.

        Raises
        ------
        ConfigError
            The folder cannot be written, or has other files.
        """
        from tgospa_eval.show.files import save  # lazy: jinja2 is slow to import

        save(self, folder, force=force)


class Proof(PairProof):
    """Proof of a result that can be saved for others; the fields are those of `PairProof`."""

    def __repr__(self) -> str:
        low, high = self.bounds.lower, self.bounds.upper
        return f"Proof({low:.17g} <= total / c^p <= {high:.17g}, {self.parameters.in_words()})"

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the proof folder: what a third party needs to check the bounds again.

        Parameters
        ----------
        folder : str or path
            Folder to write. An earlier proof in it is replaced.
        force : bool
            Whether the folder may have other files.

        Raises
        ------
        ConfigError
            The folder cannot be written, or has other files.
        SolverError
            The checker does not confirm the bounds.
        """
        from tgospa_eval.show.files import save_proof  # lazy: slow to import

        save_proof(self, folder, force=force)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result(Showable, PairEvaluation):
    """Result of one evaluation.

    Attributes have the names of the JSON document; tables are built when they are read.

    Parameters
    ----------
    proof : Proof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        `labels` has times and ids, and `gap` is the relative difference of the bounds that counts
        as exact. `settings` and `solver` are options; the others tell where the result is from.
    source : pair of AlignedPair and EvaluationRequest, optional
        Data and request of the evaluation.
    assigned : mapping of str to (N,) float array
        More values of the N assigned pairs, in the order of the table of assignments: parts of the
        cost by name, and ``nees``.
    explained : Explanation, optional
        Repairs with the largest savings, if requested.
    """

    proof: Proof

    def explain(self, top: int = 10) -> Explanation:
        """Return the repairs of the estimate with the largest savings, with proven bounds.

        A repair merges, exchanges, splits, drops, cuts, fills or extends tracks, or moves the whole
        estimate in time or space. Bounds before and after a repair prove its saving. Savings of
        several repairs do not add up.

        Parameters
        ----------
        top : int
            Largest number of repairs to list; up to twice as many are tried.

        Returns
        -------
        Explanation
            Repairs, best first; `Explanation.repaired` makes the repaired estimate.

        Raises
        ------
        ConfigError
            `top` is less than 1, or the result was not made by `evaluate`.
        """
        from tgospa_eval.explain import explain  # lazy: slow to import

        return explain(self, top)

    def gradient(self) -> "Gradient":
        """Return the derivative of the cost by estimated states, cutoff and switch penalty.

        States are those that are evaluated, after scales, conversions and interpolation.

        The reported assignment is fixed (envelope theorem). If the optimal assignment is unique,
        this is the derivative of the metric. Otherwise it is one of several directional
        derivatives. `Gradient.unique` is true if the assignment is proven to be unique.

        Returns
        -------
        Gradient
            Derivatives of ``total`` and of ``tgospa``.

        Raises
        ------
        ConfigError
            The derivative of the base distance is not known.
        """
        from tgospa_eval.evaluation.gradient import gradient  # lazy: slow to import

        return gradient(self)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ByClass(Showable, EvaluationByClass):
    """One result for each class, and their sum: totals, bounds, counts and parts add up.

    Parameters
    ----------
    results : dict of str to Result
        Results by class, in order; at least one.
    """

    results: dict[str, Result]


def result_of(evaluation: PairEvaluation) -> Result:
    """Return the public result of an evaluation."""
    return recast(evaluation, Result, proof=recast(evaluation.proof, Proof))


class ResultInParts(Showable, PartitionedResult):
    """Result of data in parts: sums in memory, and tables in files that are removed with it."""

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
