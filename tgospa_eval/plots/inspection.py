"""What was read, before anything is compared: the plane, and who is there when."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.plots import figure
from tgospa_eval.plots.plane import unit_scale
from tgospa_eval.plots.style import FALSE, INK, SOFT, legend, literal, styled
from tgospa_eval.plots.views import TIME, is_box, plane_columns
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.page_data import is_map, map_stretch
from tgospa_eval.tracks.durations import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = (
    {"color": SOFT, "linewidth": 2.2, "alpha": 0.55},
    {"color": FALSE, "linewidth": 0.9},
)
"""Of truth and estimate: what is above lets what is below be seen."""

NAMED = 30
"""Most trajectories that are named beside their lines."""

INCHES_ACROSS, INCHES_UP = 9.0, 4.2
"""Of the picture."""


def plot_inspection(
    sides: Sequence[tuple[str, Trajectories]], *, unit: str = "", style: str = "screen"
) -> "Figure":
    """Trajectories in the plane, and a line for each over the times at which it has states.

    Parameters
    ----------
    sides : sequence of (str, Trajectories)
        Name and content of the truth, and of an estimate.
    unit : str
        Of the states.
    style : {"screen", "paper"}
        As of other pictures.

    Raises
    ------
    ConfigError
        matplotlib is not installed.
    """
    columns = sides[0][1].columns
    boxes = is_box(columns)
    across, up = plane_columns(columns, None, boxes=boxes)
    begin = min((side.times[0] for _, side in sides if len(side.times)), default=0)
    clock = next((side.clock for _, side in sides if len(side.times)), "number")
    with styled(style):
        made, ((plane, presence),) = figure(INCHES_ACROSS, INCHES_UP, 1, 2)
        handles: dict[str, Artist] = {}
        below = 0
        for (name, side), looks in zip(sides, LOOKS, strict=False):
            order, breaks = _runs(side)
            moments = _moments(side, begin)
            axes = {TIME: moments, **_places(side)}
            drawn = plane.plot(
                *(_broken(axes[key][order], breaks) for key in (across, up)),
                marker=".",
                markersize=2,
                **looks,
            )
            handles[literal(name)] = drawn[0]
            presence.plot(
                _broken(moments[order], breaks),
                _broken(below + side.track[order].astype(float), breaks),
                marker="|",
                markersize=3,
                **looks,
            )
            below += len(side.ids)
        _name(plane, *(_named(name, unit) for name in (across, up)))
        seconds = clock != "number"
        _name(presence, f"s since {literal(_first(sides))}" if seconds else "t", "trajectory")
        presence.invert_yaxis()
        if below <= NAMED:
            ids = [str(name) for _, side in sides for name in side.ids.tolist()]
            presence.set_yticks(range(below), [literal(name) for name in ids], parse_math=False)
        scale = unit_scale(across, up, _stretch(sides))
        if scale is not None:
            plane.set_aspect(scale, adjustable="datalim")
        if boxes:
            plane.invert_yaxis()
        legend(made, list(handles.values()), list(handles), 2)
        return made


def _runs(side: Trajectories) -> tuple[Ints, Ints]:
    """Rows by track, and where a track ends or has a hole."""
    order = np.argsort(side.track, kind="stable")
    track, step = side.track[order], side.step[order]
    return order, np.flatnonzero((np.diff(track) != 0) | (np.diff(step) > 1)) + 1


def _broken(values: Floats, breaks: Ints) -> Floats:
    return np.insert(values.astype(float), breaks, np.nan)


def _moments(side: Trajectories, begin: float) -> Floats:
    times = side.times if side.clock == "number" else (side.times - begin) / SECOND
    return np.asarray(times, np.float64)[side.step]


def _places(side: Trajectories) -> dict[str, Floats]:
    """State columns by name; of boxes the centres as well."""
    found = dict(zip(side.columns, side.state.T, strict=True))
    if is_box(side.columns):
        found["centre x"] = found["left"] + found["width"] / 2
        found["centre y"] = found["top"] + found["height"] / 2
    return found


def _stretch(sides: Sequence[tuple[str, Trajectories]]) -> float:
    """Of a map, by the states of all sides; else 1."""
    if not is_map(sides[0][1].columns):
        return 1.0
    return map_stretch(np.concatenate([_places(side)["lat"] for _, side in sides]))


def _first(sides: Sequence[tuple[str, Trajectories]]) -> str:
    """The first time, as read."""
    firsts = [(side.times[0], side.shown[0]) for _, side in sides if len(side.times)]
    return str(min(firsts)[1])


def _named(column: str, unit: str) -> str:
    inside = f" ({literal(unit)})" if unit and column not in ("lat", "lon", TIME) else ""
    return literal(column) + inside


def _name(axis: "Axes", across: str, up: str) -> None:
    axis.xaxis.set_label_text(across, parse_math=False)
    axis.yaxis.set_label_text(up, parse_math=False)
    for spine in ("left", "bottom"):
        axis.spines[spine].set_color(INK)
