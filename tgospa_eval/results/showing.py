"""What a result can show of itself: pictures, the page, a folder. Imports them when asked."""

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError

if TYPE_CHECKING:
    import os

    from matplotlib.figure import Figure

PUBLIC = (
    *("tgospa", "total", "lower_bound", "upper_bound", "relative_gap", "certified"),
    *("within_rounding", "localisation", "localisation_mean", "localisation_spread", "missed"),
    *("false", "switch", "counts", "normalised", "parameters", "sizes", "worst", "solver"),
    *("timings", "input", "version", "warnings", "files", "results"),
    *("per_step", "switches", "assignments", "per_truth", "per_estimate", "curve"),
    *("to_dict", "to_json", "to_html", "save"),
    *("plot_costs", "plot_cumulative", "plot_lanes", "plot_plane", "plot_worst"),
)
"""What ``dir`` lists: the names of the JSON, the tables, and what can be made of them."""


class Shown:
    """Pictures and files of a result."""

    def __dir__(self) -> list[str]:
        return [name for name in PUBLIC if name in self.__dict__ or hasattr(type(self), name)]

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

    def plot_worst(
        self, *, style: str = "screen", components: Sequence[str] | None = None
    ) -> "Figure":
        """The dearest steps, truths and estimates: `tgospa_eval.plots.plot_worst`."""
        return self._plot("plot_worst", style=style, components=components)

    def _plot(self, name: str, **options: Any) -> "Figure":
        made: Figure = getattr(import_module("tgospa_eval.plots"), name)(self, **options)
        return made

    def to_html(self) -> str:
        """The report as one page that loads nothing.

        Raises
        ------
        ConfigError
            The extra ``report`` is not installed.
        """
        from importlib.util import find_spec

        if find_spec("jinja2") is None:
            raise ConfigError(f"no page: it needs the extra report: {install('report')}")
        return str(import_module("tgospa_eval.reports.html").page(self))

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the result folder of ``-o``: JSON, tables, the page and the pictures.

        The page is written with the extra ``report``, the pictures with ``plot``.

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
        import_module("tgospa_eval.plots.report").save(self, folder, force=force)
