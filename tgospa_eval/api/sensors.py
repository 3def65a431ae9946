"""Association of the states of two sensors, and reduction of particle clouds."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.distance import REDUCTION_NAMES, reduction
from tgospa_eval.api.keywords import requested, taken, with_options
from tgospa_eval.api.options import OPTION_SPECS, Request
from tgospa_eval.api.reading import align_sides, display_names, read_pair
from tgospa_eval.api.report import as_frame
from tgospa_eval.api.resolve import ResolvedRequest, resolve_request
from tgospa_eval.common.frozen import recast, replace
from tgospa_eval.common.notices import warn_user
from tgospa_eval.distances import Reduction, Resources
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import Reading
from tgospa_eval.quoting import quoted
from tgospa_eval.results.evaluation import frame_of
from tgospa_eval.results.records import Columns
from tgospa_eval.sensors import Pairing, reduce_trajectories
from tgospa_eval.sensors import associate as associate_states
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    import os
    from typing import Unpack

    import pandas as pd
    from matplotlib.figure import Figure

    from tgospa_eval.api.option_types import AssociateOptions, ReduceOptions
    from tgospa_eval.formats.objects import Components, TrajectoriesLike
    from tgospa_eval.show.plot_data import PlotData


FIRST_ROWS = 10
"""Number of rows of the table of associations that ``print`` shows."""


class Association(Pairing):
    """Result of `associate`: the states of two sensors, associated step by step.

    Parameters
    ----------
    first, second : Trajectories
        States of the first and of the second sensor, on the same time steps.
    pairs : Pairs
        N pairs of states of the same step, with measured distances: the pairs nearer than the
        cutoff, or all pairs if requested.
    apart : (N,) float array
        Distance between the means of the two states of each pair.
    chosen : (N,) bool array
        Whether each pair was associated.
    cutoff : float
        The cutoff c.
    distance : Distance
        Distance between two states.
    """

    def __repr__(self) -> str:
        count, (a, b) = int(self.chosen.sum()), self.unassigned
        return f"Association(associated={count}, alone={(a, b)}, total={self.total:.6g})"

    def __str__(self) -> str:
        from tgospa_eval.show.result_text import association_text  # lazy: slow to import

        return association_text(self, limit=FIRST_ROWS, rest="associations").rstrip("\n")

    def table(self, name: str) -> Columns:
        """Return a table as plain columns.

        `name` is ``"associations"``, ``"costs"`` or ``"cross_covariances"``.

        Raises
        ------
        ConfigError
            The table is unknown.
        InputError
            Cross-covariances are requested, but neither sensor has particles.
        """
        tables = {
            "associations": self.associations_table,
            "costs": self.costs_table,
            "cross_covariances": self.cross_covariances_table,
        }
        if name not in tables:
            raise ConfigError(f"no table {quoted(name)}; there are {', '.join(tables)}")
        return tables[name]()

    associations = frame_of(
        "associations",
        "A row for each associated pair, and for each state without a partner.",
    )
    costs = frame_of("costs", "All pairs that were measured, and whether they were associated.")
    cross_covariances = frame_of(
        "cross_covariances", "Cross-covariances of the particles of each associated pair."
    )

    def frame(self, name: str) -> "pd.DataFrame":
        """Return a table as a DataFrame; `name` as for `table`."""
        return as_frame(self.table(name))

    @property
    def plot_data(self) -> "PlotData":
        """Data of the HTML page and of the picture."""
        from tgospa_eval.show.plot_data import plot_data  # lazy: slow to import

        return plot_data(self)

    def plot_plane(
        self, *, columns: tuple[str, str] | None = None, style: str = "screen"
    ) -> "Figure":
        """Plot the states of both sensors in two state columns.

        The picture also shows which states are associated, and which have no partner. Around each
        state of the first sensor it shows the gate: the region within the cutoff. Parameters,
        errors and return value are those of `Result.plot_plane`.
        """
        from tgospa_eval.show.chart_list import plot  # lazy: slow to import

        return plot(self, "plane", columns=columns, style=style)

    def to_html(self, names: tuple[str, str] = ("A", "B")) -> str:
        """Return an HTML page that loads no other files; `names` are names of the two sensors."""
        from tgospa_eval.show.html import association_page  # lazy: jinja2 is slow to import

        return association_page(self, names)

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the HTML page and the table to a folder; with the extra ``plot``, also the picture.

        Raises
        ------
        ConfigError
            The folder has other files and `force` is false, or the folder cannot be written.
        """
        from tgospa_eval.show.files import save  # lazy: slow to import

        save(self, folder, force=force)


OF_REDUCE = ("columns", "decimal", "max_input", "time", "class_", "region", "where", "jobs")


def of_pairs(options: dict[str, Any]) -> dict[str, Any]:
    """Add the fields of a `Request` that users of `associate` cannot set."""
    return options | {"pairwise": True, "sides": ("a", "b"), "switch_penalty": 0.0}


def associate_sides(
    resolved: ResolvedRequest,
    sides: tuple[Reading, ...],
    names: tuple[str, ...],
    resources: Resources,
    *,
    all_pairs: bool,
) -> Association:
    """Associate the states of two sensors; `names` are their names in messages."""
    fitted, _ = align_sides(resolved, sides, names)
    pairing = associate_states(
        fitted.alignment.truth,
        fitted.alignment.estimate,
        cutoff=resolved.evaluation.parameters.cutoff,
        distance=fitted.distance,
        all_pairs=all_pairs,
        resources=resources,
    )
    return recast(pairing, Association)


def reducing(request: Request, size: int) -> tuple[Reduction, ResolvedRequest]:
    """Return how to reduce clouds to `size` particles, and how to read them."""
    how = reduction(request, size) or Reduction(size=size)
    fixed: dict[str, Any] = {"reduce": size, "cutoff": 1.0, "switch_penalty": 0.0}
    return how, resolve_request(replace(request, distance="cloud-wasserstein", **fixed))


def reduce_side(
    side: Reading, how: Reduction, name: str, resources: Resources
) -> tuple[Trajectories, Columns]:
    """Reduce particle clouds. Also return a table that says what changed in each cloud.

    Raises
    ------
    InputError
        `side` has no clouds.
    """
    if side.trajectories.clouds is None:
        raise InputError(
            f"{name}: no particles; with a column weight, the rows of one id and t are a cloud"
        )
    return reduce_trajectories(side.trajectories, how, resources)


def _read(
    resolved: ResolvedRequest,
    given: Sequence["TrajectoriesLike"],
    names: tuple[str, ...],
    mapping: "Components | None",
) -> tuple[Reading, ...]:
    """Read the data of all sensors; issue a Python warning if they look wrong."""
    roles = ("estimate",) * len(given)
    sides = read_pair(resolved, *given, roles=roles, names=names, mapping=mapping)
    for side in sides:
        warn_user(side.warnings)
    return sides


@with_options(
    *(name for name, about in OPTION_SPECS.items() if not (about.sensors and about.everywhere)),
    *(name for name in OPTION_SPECS if name.startswith(("truth_", "estimate_"))),
)
def associate(
    a: "TrajectoriesLike",
    b: "TrajectoriesLike",
    cutoff: float,
    *,
    mapping: "Components | None" = None,
    all_pairs: bool = False,
    a_format: str | None = None,
    b_format: str | None = None,
    a_columns: "str | Sequence[str] | None" = None,
    b_columns: "str | Sequence[str] | None" = None,
    a_where: "str | Sequence[str]" = (),
    b_where: "str | Sequence[str]" = (),
    **options: "Unpack[AssociateOptions]",
) -> Association:
    """Associate the states of two sensors, step by step.

    Every option of ``tgospa-eval associate`` is also a keyword.

    Parameters
    ----------
    a, b : path, Trajectories, DataFrame, array, mapping or set of tracks
        States of the first and of the second sensor, in any form that `evaluate` accepts.
    cutoff : float
        Cutoff c > 0, in the unit of the distance.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.
    all_pairs : bool
        Whether to measure all pairs of each step. By default, pairs that cannot be nearer than the
        cutoff are not measured. The association is the same.
    a_format, b_format : str, optional
        Formats of the files `a` and `b`, if these are paths.
    a_columns, b_columns : str or sequence of str, optional
        As the option `columns`, but only for `a` or `b`.
    a_where, b_where : str or sequence of str
        As the option `where`, but only for `a` or `b`.

    Returns
    -------
    Association
        Pairs, costs and states without partner.

    Raises
    ------
    ConfigError, InputError, TypeError
        An option or a sensor's data are wrong, as for `evaluate`.
    """
    of_sides = {
        "truth_format": a_format,
        "estimate_format": b_format,
        "truth_columns": a_columns,
        "estimate_columns": b_columns,
        "truth_where": a_where,
        "estimate_where": b_where,
    }
    request = requested(of_pairs({"cutoff": cutoff, **of_sides, **options}))
    resolved, names = resolve_request(request), display_names((a, b), request.sides)
    sides = _read(resolved, (a, b), request.sides, mapping)
    resources = Resources(jobs=request.jobs)
    return associate_sides(resolved, sides, names, resources, all_pairs=all_pairs)


@with_options(*(name for name in taken() if name not in (*OF_REDUCE, *REDUCTION_NAMES)))
def reduce(
    side: "TrajectoriesLike",
    size: int,
    *,
    mapping: "Sequence[int] | None" = None,
    in_format: str | None = None,
    **options: "Unpack[ReduceOptions]",
) -> tuple[Trajectories, "pd.DataFrame"]:
    """Reduce particle clouds to fewer particles.

    Every option of ``tgospa-eval reduce`` is also a keyword.

    Parameters
    ----------
    side : path, Trajectories, DataFrame, array, mapping or set of tracks
        Particle clouds, in any form that `evaluate` accepts.
    size : int
        Number of particles of each cloud; smaller clouds stay as they are.
    mapping : sequence of int, optional
        Indices of the state components to keep.
    in_format : str, optional
        Format of `side`, if it is a path.

    Returns
    -------
    Trajectories
        The data with reduced clouds.
    DataFrame
        What changed: a row for each cloud, with the columns of ``reduce --format csv``.

    Raises
    ------
    ConfigError, InputError, TypeError
        An option or `side` is wrong, as for `evaluate`; or `side` has no particles.
    """
    request = requested({**options, "truth_format": in_format})
    how, resolved = reducing(request, size)
    names = display_names((side,), ("side",))
    (read,) = _read(resolved, (side,), ("side",), mapping)
    after, table = reduce_side(read, how, names[0], Resources(jobs=request.jobs))
    return after, as_frame(table)
