"""RESULT -> pictures, by matplotlib (extra ``plot``): a function for each of a result."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.results.evaluation import Evaluation

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_costs(
    result: Evaluation, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Cost of each step, stacked: localisation, missed, false, switch.

    Where there are more steps than can be distinguished each bar is the costliest of several,
    and the axis says of how many.

    Parameters
    ----------
    style : {"screen", "paper"}
        With a title; or small, for one column of a journal.
    components : sequence of str, optional
        Parts of the cost that are drawn, of ``"localisation"``, ``"missed"``, ``"false"``,
        ``"switch"``; all by default.

    Returns
    -------
    matplotlib.figure.Figure
        Belongs to no window.

    Raises
    ------
    ConfigError
        A name is unknown, or matplotlib is not installed.
    """
    return _plot(result, "costs", style=style, components=components)


def plot_cumulative(
    result: Evaluation, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Normalised cumulative cost: at each step the root of the mean cost of the steps up to it.

    The assignment is that of the whole recording, unless the curve was asked for; the last
    value of the total is ``normalised["tgospa"]``. Parameters, errors and return value are
    those of `plot_costs`; the total is always drawn.
    """
    return _plot(result, "cumulative", style=style, components=components)


def plot_lanes(result: Evaluation, *, style: str = "screen") -> "Figure":
    """A lane for each truth with the estimates that follow it, and lanes of false tracks below.

    A gap with a frame is missed, a triangle is a switch, the darker foot of a bar is the error
    as a share of the cutoff. Of more trajectories than have room the costliest have lanes, and
    the others share one, in which a height says how many of them are missed, or false.
    Parameters, errors and return value are those of `plot_costs`.
    """
    return _plot(result, "lanes", style=style)


def plot_plane(
    result: Evaluation, *, columns: tuple[str, str] | None = None, style: str = "screen"
) -> "Figure":
    """Trajectories in two of the state columns, with misses, false targets and switches.

    Boxes, ellipses that hold 95 % of a normal distribution, and particles are drawn here and
    there along few trajectories where the states have such and the two columns show them. A
    second panel shows all of those around the assigned pair that is farthest apart.

    Parameters
    ----------
    columns : pair of str, optional
        What is across and up: state columns, ``"t"`` for the time, of boxes ``"centre x"`` and
        ``"centre y"``. By default the first two columns, the centres of boxes, ``lon`` and
        ``lat``; of a single column it over the time.
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
    return _plot(result, "plane", columns=columns, style=style)


def plot_nees(result: Evaluation, *, style: str = "screen") -> "Figure":
    """NEES of each step with its 95 % band; of particles also the ranks of the truth.

    Errors and return value are those of `plot_costs`.

    Raises
    ------
    ConfigError
        There is no NEES.
    """
    return _plot(result, "nees", style=style)


def plot_windows(
    result: Evaluation, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Sliding windows: at the middle of each the root of its mean cost, as `windows` has it.

    Parameters, errors and return value are those of `plot_costs`; the total is always drawn.

    Raises
    ------
    ConfigError
        Windows were not asked for.
    """
    return _plot(result, "windows", style=style, components=components)


def plot_worst(
    result: Evaluation, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """The costliest steps, truths and estimates, and what they cost.

    Parameters, errors and return value are those of `plot_costs`; only `components` count.
    """
    return _plot(result, "worst", style=style, components=components)


def _plot(result: Evaluation, name: str, **options: Any) -> "Figure":
    from tgospa_eval.plots.result_pictures import plot  # lazy: slow to import

    return plot(result, name, **options)
