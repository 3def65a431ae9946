"""Base classes that print and plot results, and the public class of a sweep."""

from abc import abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from tgospa_eval.errors import ConfigError
from tgospa_eval.results.records import Columns
from tgospa_eval.results.sweep import SweepEvaluation

if TYPE_CHECKING:
    from typing import Literal, Unpack

    import pandas as pd
    from matplotlib.figure import Figure

    from tgospa_eval.show.chart_list import Place

    class Drawing(Place, total=False):
        """Keywords of the methods that plot."""

        style: Literal["screen", "paper", "paper-wide"]


def as_frame(columns: Columns) -> "pd.DataFrame":
    """Return a table of columns as a DataFrame."""
    import pandas as pd  # lazy: slow to import

    return pd.DataFrame(columns)


class Reportable:
    """Result that is printed in every format and plotted; a notebook shows its HTML."""

    @property
    @abstractmethod
    def plot_data(self) -> Any:
        """Data of the pictures."""

    @property
    @abstractmethod
    def kind(self) -> str:
        """Kind of the result, a key of `show.chart_list.CHARTS`."""

    @abstractmethod
    def rendered(self, format: str) -> str:
        """Return the report in a format that ``--format`` accepts."""

    def to_json(self) -> str:
        """Return the document of ``--format json``: numbers in full precision, and no NaN."""
        return self.rendered("json")

    def to_markdown(self) -> str:
        """Return the report for a pull request or a lab book."""
        return self.rendered("markdown")

    def to_latex(self, *, siunitx: bool = False) -> str:
        """Return LaTeX tables, which need the package booktabs.

        With `siunitx`, digits are aligned by the package of this name.
        """
        return self.rendered("siunitx" if siunitx else "latex")

    def _repr_html_(self) -> str:
        return self.rendered("html")

    def _plot(self, name: str, **options: Any) -> "Figure":
        """Draw one picture; for an unknown name, raise a ConfigError that lists all names."""
        from tgospa_eval.show.chart_list import CHARTS, plot  # lazy: slow to import

        if name not in CHARTS[self.kind]:
            known = ", ".join(f"plot_{other.replace('-', '_')}" for other in CHARTS[self.kind])
            raise ConfigError(f"plot_{name} is not for {self.kind}; there are {known}")
        return plot(self.plot_data, name, self.kind, **options)


class StudyReport(Reportable):
    """Result with a row for each tracker or group; its tables can have chosen columns."""

    @abstractmethod
    def rendered(self, format: str, columns: Iterable[str] = ()) -> str:
        """Return the report in a format that ``--format`` accepts, with these columns."""

    def to_markdown(self, columns: Iterable[str] = ()) -> str:
        """Return the report for a pull request or a lab book.

        Parameters
        ----------
        columns : iterable of str
            Columns of the table, as for ``--columns-of-table``: ``["tgospa", "rmse"]``.

        Raises
        ------
        ConfigError
            A column is unknown.
        """
        return self.rendered("markdown", columns)

    def to_latex(self, columns: Iterable[str] = (), *, siunitx: bool = False) -> str:
        """Return LaTeX tables as `Reportable.to_latex`, with `columns` as in `to_markdown`."""
        return self.rendered("siunitx" if siunitx else "latex", columns)


class Sweep(SweepEvaluation, Reportable):
    """Evaluations that differ in one parameter; the fields are those of `SweepEvaluation`."""

    @property
    def plot_data(self) -> "Sweep":
        """The sweep itself."""
        return self

    @property
    def kind(self) -> str:
        """``"sweep"``."""
        return "sweep"

    def table(self) -> "pd.DataFrame":
        """Return a row for each point; the first column has the name of the parameter."""
        return as_frame(self.columns())

    def rendered(self, format: str) -> str:
        """Return the report as ``--format`` prints it."""
        from tgospa_eval.show.comparison import sweep_document  # lazy: few sweeps are printed
        from tgospa_eval.show.table_text import rendered

        return rendered(format, self, sweep_document, SweepEvaluation.to_json, Sweep.columns)

    def plot_sweep(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the value, the costs and the counts over the parameter."""
        return self._plot("sweep", **options)
