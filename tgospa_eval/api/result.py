"""Public classes of results, with methods that show, plot, save, split and explain them."""

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
"""Attributes that ``dir`` lists: values of the JSON document, tables, and public methods."""


class Showable(Evaluation, Reportable):
    """Evaluation with methods that make pictures, reports and slices."""

    def __dir__(self) -> list[str]:
        return [name for name in PUBLIC if name in self.__dict__ or hasattr(type(self), name)]

    def slices(self, *by: str) -> tuple[Slicing, ...]:
        """Split costs and counts by an attribute, such as the class or the range at each step.

        The attribute is read as follows:

        - for a localisation error or a missed target: from the true object at the step
        - for a false target: from the estimate at the step
        - for a switch: from the true object at the later of the two steps

        Slices add up to the whole. Another optimal assignment could give other slices.
        `Slicing.unique` is true if the assignment is proven to be the only optimal one.

        Parameters
        ----------
        *by : str
            Slices as for ``--slice``: ``"range=0:50:100"``, ``"class"``, ``"visibility=weight"``,
            ``"class * speed=0:5:20"``. By default the slices of ``evaluate(..., slices=)``. Columns
            such as ``visibility`` are read from the files only if ``slices=`` names them.

        Returns
        -------
        tuple of Slicing
            One for each argument; `Slicing.frame` makes a DataFrame.

        Raises
        ------
        ConfigError
            The attribute is unknown, or its values do not allow the requested slices.
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
        """Plot the cost of each step as a bar, stacked: localisation, missed, false, switch.

        If there are too many steps, a bar shows the costliest of several successive steps. The
        label of the axis gives the number of steps of a bar.

        Parameters
        ----------
        style : {"screen", "paper"}
            ``"screen"`` has a title; ``"paper"`` fits one column of a journal.
        components : sequence of str, optional
            Parts of the cost to plot: some of ``"localisation"``, ``"missed"``, ``"false"``,
            ``"switch"``; all by default.
        ax, figure : Axes, Figure or SubFigure of matplotlib, optional
            Where to draw: in an empty figure, or in Axes if the picture has only one panel. A
            picture in Axes has no title. The default is a new figure.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. It is not opened in a window.

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
        """Plot, for each step k, the p-th root of the mean cost of the steps up to k.

        The costs are those of the assignment of the whole recording. With
        ``evaluate(..., curve=True)``, the steps up to each k are evaluated by themselves. The line
        of the total ends at ``normalised["tgospa"]``. Parameters, errors and return value are those
        of `plot_costs`; the total is always drawn.
        """
        return self._plot("cumulative", style=style, components=components, **place)

    def plot_lanes(self, *, style: str = "screen", **place: "Unpack[Place]") -> "Figure":
        """Plot a lane (a row over time) for each true object, and for each track with false steps.

        The lane of an object shows its tracks as bars. The darker lower part of a bar is the error
        as a share of the cutoff. A framed gap is a missed target, and a triangle is a switch.

        If there are too many trajectories, some share the last lane: first those without missed
        steps, false steps and switches, then those with low costs. The height in this lane shows
        how many targets are missed or false. Parameters, errors and return value are those of
        `plot_costs`.
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

        Shapes of states are drawn at some steps of a few trajectories: boxes, or 95 % ellipses of
        normal distributions and particle clouds. A second panel shows all ellipses near the
        assigned pair with the largest distance. None are drawn if the columns cannot show them.

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
            The figure. It is not opened in a window.

        Raises
        ------
        ConfigError
            A column or the style is unknown, or matplotlib is not installed.
        """
        return self._plot("plane", columns=columns, style=style, **place)

    def plot_nees(self, *, style: str = "screen", **place: "Unpack[Place]") -> "Figure":
        """Plot the NEES of each step, and the 95 % band of a calibrated filter.

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
        """Plot, at the middle of each sliding window, the p-th root of the mean cost of its steps.

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
        """Plot the costs of the costliest steps, true objects and estimates.

        Parameters, errors and return value are those of `plot_costs`. With `components`, only these
        parts of the cost count.
        """
        return self._plot("worst", style=style, components=components, **place)

    @property
    def plot_data(self) -> "PlotData":
        """Data of the HTML page and of the pictures."""
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
        """Return a DataFrame of one row with all numbers, like a row of `Batch.rows`.

        With `name`, return a table as plain columns instead: ``"per_class"``, or a DataFrame of the
        result, such as ``"per_step"``. A table that was not requested has no columns.

        Raises
        ------
        ConfigError
            The table is unknown.
        """
        if name is not None:
            return super().table(name)
        from tgospa_eval.campaign.row import row_of  # lazy: few programs read this row

        return as_frame({key: [value] for key, value in row_of(self).items()})

    def rendered(self, format: str) -> str:
        """Return the report as ``--format`` prints it."""
        from tgospa_eval.show.result_text import REPORTS  # lazy: slow to import

        return REPORTS[format](self)

    def _repr_html_(self) -> str:
        from tgospa_eval.show.html import card  # lazy: jinja2 is slow to import

        return card(self)

    def to_html(self) -> str:
        """Return the report as an HTML page that loads no other files."""
        from tgospa_eval.show.html import page  # lazy: jinja2 is slow to import

        return page(self)

    def to_geojson(self) -> str:
        """Return tracks, missed and false targets, errors and switches as GeoJSON for a map.

        Raises
        ------
        ConfigError
            The states are not positions on the Earth, or the result is a sum of evaluations.
        """
        from tgospa_eval.show.files import geojson  # lazy: slow to import

        return geojson(self)

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write a result folder, as ``-o`` does: JSON, tables, the HTML page and the pictures.

        Pictures are written if the extra ``plot`` is installed.

        Parameters
        ----------
        folder : str or path
            Folder to write. An earlier result in it is replaced.
        force : bool
            Whether to write although the folder has other files.

        Raises
        ------
        ConfigError
            The folder cannot be written, or it has other files and `force` is false.
        """
        from tgospa_eval.show.files import save  # lazy: jinja2 is slow to import

        save(self, folder, force=force)


class Proof(PairProof):
    """Proof of a result, which can be saved for others to check. Its fields are in `PairProof`."""

    def __repr__(self) -> str:
        low, high = self.bounds.lower, self.bounds.upper
        return f"Proof({low:.17g} <= total / c^p <= {high:.17g}, {self.parameters.in_words()})"

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write a proof folder: all that others need to check the bounds.

        Parameters
        ----------
        folder : str or path
            Folder to write. An earlier proof in it is replaced.
        force : bool
            Whether to write although the folder has other files.

        Raises
        ------
        ConfigError
            The folder cannot be written, or it has other files and `force` is false.
        SolverError
            The checker does not confirm the bounds.
        """
        from tgospa_eval.show.files import save_proof  # lazy: slow to import

        save_proof(self, folder, force=force)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result(Showable, PairEvaluation):
    """Result of one evaluation.

    Attributes have the names of the JSON document; a table is built when it is read.

    Parameters
    ----------
    proof : Proof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        `labels` has times and ids. `gap` is the largest relative gap between the bounds that counts
        as exact. `settings` has every option that changes the number. `solver` has the name, status
        and progress of the solver, and `timings` has the seconds of each stage. `input` has rows
        and digests of both files, and `version` is that of this package.
    source : pair of AlignedPair and EvaluationRequest, optional
        Data of the evaluation, and what was requested.
    assigned : mapping of str to (N,) float array
        More values of the N assigned pairs, in the order of the rows of `assignments`. The keys are
        the names of parts of the cost, and ``nees``.
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
            Largest number of repairs to list. Up to twice as many are tried.

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
        """Return the derivatives of the cost by estimated states, cutoff and switch penalty.

        States are those that are evaluated, after scales, conversions and interpolation.

        The assignment is kept fixed (envelope theorem). If it is the only optimal one, these are
        the derivatives of the metric. If there are other optimal assignments, each derivative is
        one of several directional derivatives. `Gradient.unique` is true if the assignment is
        proven to be the only optimal one.

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
    """Result for each class, and their sum: totals, bounds, counts and parts are added up.

    Parameters
    ----------
    results : dict of str to Result
        Results by class, at least one, in the order of the output.
    """

    results: dict[str, Result]


def result_of(evaluation: PairEvaluation) -> Result:
    """Return an evaluation as a `Result`, whose proof is a `Proof`."""
    return recast(evaluation, Result, proof=recast(evaluation.proof, Proof))


class ResultInParts(Showable, PartitionedResult):
    """Result of data in parts: sums are in memory, and tables are in temporary files.

    `evaluate` removes these files when the result is deleted.
    """

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
