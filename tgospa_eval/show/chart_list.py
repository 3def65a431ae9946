"""List of all pictures that can be drawn of a result, a comparison, a batch and so on.

The subject of a picture is the object that it shows, such as a result. matplotlib is imported when
the first picture is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.registry import load
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import quoted
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import PARTS
from tgospa_eval.sensors import Pairing
from tgospa_eval.show import style as looks
from tgospa_eval.show.style import FILES, STYLES, Style, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


class Chart(NamedTuple):
    """One kind of picture, and the function that draws it.

    The function receives the subject and a `Style`. It returns None if there is nothing to draw.
    """

    draw: str
    """The function, as ``module:function`` with a module of this folder."""
    options: tuple[str, ...] = ()
    """Names of fields of `Pictures` that the function receives as well."""
    absent: str = ""
    """Message if there is nothing to draw: the reason and what to do."""


_PARTS = ("parts",)
_PLANE = Chart("draw_plane:draw_plane", ("columns",))
_RESULT = {
    "costs": Chart("draw_over_time:draw_costs", _PARTS),
    "lanes": Chart("draw_over_time:draw_lanes"),
    "plane": _PLANE,
    "cumulative": Chart("draw_over_time:draw_cumulative", _PARTS),
    "worst": Chart("draw_over_time:draw_worst", _PARTS),
    "nees": Chart(
        "draw_over_time:draw_nees",
        absent="there is no NEES: evaluate with with_='nees', and states that have covariances",
    ),
    "windows": Chart(
        "draw_over_time:draw_windows",
        _PARTS,
        "there are no windows: evaluate with window=, the steps of each",
    ),
}
_NO_SWEEPS = "no errors of sinkhorn to draw: compare it at several temperatures"
_NO_STEPS = "no steps of runs are stored: evaluate with per_step=True"
_CURVES = {
    "curve": Chart("several:draw_curves", absent=_NO_STEPS),
    "curve-parts": Chart("several:draw_curve_parts", absent=_NO_STEPS),
    "over-time": Chart("several:draw_over_time", absent=_NO_STEPS),
}

CHARTS: Mapping[str, Mapping[str, Chart]] = {
    "result": _RESULT,
    "result in parts": {name: _RESULT[name] for name in ("costs", "cumulative", "nees")},
    "associate": {"plane": _PLANE},
    "inspect": {"inspection": Chart("draw_plane:draw_inspection")},
    "sweep": {"sweep": Chart("several:draw_sweep")},
    "estimates": {
        "cumulative": Chart("several:draw_cumulative", absent="runs differ in number of steps")
    },
    "solvers": {
        "time_over_error": Chart("several:draw_time_over_error", absent="no solver has a value"),
        "error_over_epsilon": Chart("several:draw_errors", absent=_NO_SWEEPS),
        "convergence": Chart("several:draw_convergence", absent=_NO_SWEEPS),
    },
    "study": {
        "error_over_epsilon": Chart("several:draw_study_errors"),
        "scaling": Chart("several:draw_scaling"),
    },
    "batch": {
        "parts": Chart("several:draw_parts", absent="no job has a value"),
        "heat": Chart("several:draw_heat", absent="there is nothing to compare with"),
        **_CURVES,
    },
    "page of a batch": _CURVES,
    "page of a gate": {"runs": Chart("several:draw_runs")},
}
"""Pictures of each kind of subject, by the name of the file. A result of data in parts lacks the
pictures of single tracks and windows."""


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Options of pictures.

    Parameters
    ----------
    formats : tuple of str
        Formats of files, keys of `FILES`; empty for no pictures.
    style : str
        Style, a key of `STYLES`.
    components : sequence of str, optional
        Parts of the cost to draw; all by default.
    columns : pair of str, optional
        State columns of the horizontal and the vertical axis in the picture ``plane``.

    Raises
    ------
    ConfigError
        A format, the style or a component has an unknown name.
    """

    formats: tuple[str, ...] = ("png",)
    style: str = "screen"
    components: Sequence[str] | None = None
    columns: Sequence[str] | None = None

    def __post_init__(self) -> None:
        odd = [name for name in self.formats if name not in FILES]
        if odd:
            raise ConfigError(f"pictures {quoted(odd[0])}: must be {', '.join(FILES)}, or none")
        if self.style not in STYLES:
            raise ConfigError(f"style {quoted(self.style)}: must be one of {', '.join(STYLES)}")
        chosen = PARTS if self.components is None else self.components
        if isinstance(chosen, str) or not chosen or set(chosen) - set(PARTS):
            text = chosen if isinstance(chosen, str) else ", ".join(map(str, chosen))
            raise ConfigError(f"components {quoted(text)}: must be of {', '.join(PARTS)}")

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the cost that are drawn, in the order of `PARTS`."""
        return tuple(name for name in PARTS if self.components is None or name in self.components)

    def names(self, *kinds: str) -> tuple[str, ...]:
        """Return the names of all picture files that subjects of these kinds can have."""
        charts = (name for kind in kinds for name in CHARTS[kind])
        return tuple(f"{name}.{form}" for name in charts for form in self.formats)

    def check(self, known: Sequence[str]) -> None:
        """Check that these state columns can be drawn in the plane, before any work is done.

        Raises
        ------
        ConfigError
            `columns` has a name that the states do not have.
        """
        from tgospa_eval.show.plot_data import plane_columns  # lazy: slow to import

        plane_columns(known, self.columns)

    def draw(self, chart: Chart, subject: Any, style: Style) -> "Figure | None":
        """Draw one picture, or return None if it has no content."""
        if isinstance(subject, Evaluation | Pairing):
            from tgospa_eval.show.plot_data import plot_data  # lazy: slow to import

            subject = plot_data(subject)
        options = {name: getattr(self, name) for name in chart.options}
        made: Figure | None = load(f"tgospa_eval.show.{chart.draw}")(subject, style, **options)
        return made


def pictures(
    kind: str,
    subject: Any,
    wanted: Pictures | None = None,
    notify: Callable[[str, float], None] = lambda name, share: None,  # noqa: ARG005
) -> dict[str, bytes]:
    """Draw all pictures of a subject, and return the content of each file by its name.

    `kind` is the kind of the subject, a key of `CHARTS`. Each picture has a file in each format.
    The result is empty if matplotlib is not installed. Before the files of a picture are made,
    `notify` receives the name of a file and the share of pictures that are done. Only one figure is
    in memory at a time.
    """
    wanted, charts, files = wanted or Pictures(), CHARTS[kind], dict[str, bytes]()
    for at, (name, chart) in enumerate(
        charts.items() if wanted.formats and looks.available() else ()
    ):
        with styled(wanted.style) as style:
            from tgospa_eval.show.figure_tools import written  # lazy: matplotlib is slow to import

            made = wanted.draw(chart, subject, style)
            if made is not None:
                notify(f"{name}.{wanted.formats[0]}", at / len(charts))
                files |= {f"{name}.{k}": written(made, k, style.dots) for k in wanted.formats}
    return files


class Place(TypedDict, total=False):
    """Axes or figure of the user, in which a picture is drawn. By default, a new figure is used."""

    ax: "Axes"
    figure: "Figure | SubFigure"


def plot(
    subject: Any,
    name: str,
    kind: str = "result",
    *,
    ax: "Axes | None" = None,
    figure: "Figure | SubFigure | None" = None,
    **options: Any,
) -> "Figure":
    """Draw the picture `name` of a subject in the given axes or figure, or in a new figure.

    `kind` is the kind of the subject, a key of `CHARTS`. `options` are fields of `Pictures`.

    Raises
    ------
    ConfigError
        A name is unknown, matplotlib is not installed, or there is nothing to draw. Or `ax` is
        given for a picture with several panels.
    """
    wanted, chart = Pictures(**options), CHARTS[kind][name]
    with styled(wanted.style) as style:
        from tgospa_eval.show.figure_tools import PLACE  # lazy: matplotlib is slow to import

        token = PLACE.set(figure if ax is None else ax)
        try:
            made = wanted.draw(chart, subject, style)
        finally:
            PLACE.reset(token)
    if made is None:
        raise ConfigError(chart.absent)
    return made
