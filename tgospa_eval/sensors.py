"""Association of the states of two sensors, step by step, without files.

The states of one sensor are called a side. At every step, some pairs of states are chosen. Their
states are called associated, or partners. Each pair costs its distance d, and each state without a
partner costs c / 2, where c is the cutoff. The chosen pairs have the smallest sum of these costs. A
pair gains ``c - d``, because its two states would cost c without it. Pairs with ``d >= c`` are not
chosen.
"""

from functools import cached_property
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.common.words import counted
from tgospa_eval.distances import (
    DISTANCES,
    Distance,
    Norm,
    Pairs,
    Reduction,
    Resources,
    cloud_wasserstein,
    near_pairs,
)
from tgospa_eval.distances.base import check_columns, check_states
from tgospa_eval.distances.clouds import reduced
from tgospa_eval.distances.reduction import sliced_wasserstein, spread_directions
from tgospa_eval.distances.sphere import RADIUS
from tgospa_eval.distances.transport import (
    MAX_PARTICLES,
    POT_NEEDED,
    can_transport,
    cross_covariance,
)
from tgospa_eval.errors import ConfigError, InputError, real_number
from tgospa_eval.problem.gospa import assign_pairs
from tgospa_eval.results.records import Columns
from tgospa_eval.tracks.clouds import Cloud, Clouds
from tgospa_eval.tracks.covariances import pack
from tgospa_eval.tracks.trajectories import Trajectories

COLUMN_NAMES = ("t", "id_a", "id_b", "distance", "mean_distance")

NOBODY = -1
"""Value for "no partner" in an array of row indices of partners."""

MAX_STATES = 3000
"""Largest number of states of one side at one step. A state counts only if it is nearer than the
cutoff to a state of the other side. A matrix of 3000 x 3000 gains has 72 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairing:
    """Association of the states of two sides.

    Parameters
    ----------
    first, second : Trajectories
        Both sides, on the same times.
    pairs : Pairs
        The N measured pairs. A pair has a row of each side, at the same step. All pairs nearer than
        the cutoff are measured, and other pairs on request.
    mean_distances : (N,) float array
        Distance between the means of both states of each pair.
    chosen : (N,) bool array
        Mask of the associated pairs.
    cutoff : float
        Cutoff c.
    distance : Distance
        Distance with which the pairs were measured.
    """

    first: Trajectories
    second: Trajectories
    pairs: Pairs
    mean_distances: Floats
    chosen: Mask
    cutoff: float
    distance: Distance

    @property
    def unassigned(self) -> tuple[int, int]:
        """Number of states without a partner, on the first and on the second side."""
        count = int(self.chosen.sum())
        return len(self.first.step) - count, len(self.second.step) - count

    @property
    def total(self) -> float:
        """Sum of the distances of associated pairs, plus half a cutoff per unassigned state."""
        near = self.pairs.distance[self.chosen].sum()
        return float(near + 0.5 * self.cutoff * sum(self.unassigned))

    @property
    def sides(self) -> tuple[Trajectories, Trajectories]:
        """Both sides."""
        return self.first, self.second

    @cached_property
    def partners(self) -> tuple[Ints, Ints]:
        """Row of the partner of each row, or `NOBODY`; one array per side."""
        a, b = (np.full(len(side.step), NOBODY) for side in self.sides)
        rows = self.pairs.truth_row[self.chosen], self.pairs.estimate_row[self.chosen]
        a[rows[0]], b[rows[1]] = rows[1], rows[0]
        return a, b

    @cached_property
    def partings(self) -> tuple[Floats, Floats]:
        """Distance of each row to its partner, or 0 without a partner; one array per side."""
        a, b = (np.zeros(len(side.step)) for side in self.sides)
        near = self.pairs.distance[self.chosen]
        a[self.pairs.truth_row[self.chosen]] = b[self.pairs.estimate_row[self.chosen]] = near
        return a, b

    @cached_property
    def gates(self) -> Floats | None:
        """Gates of the states of the first side; None for distances without scales, as of boxes.

        A gate is an ellipse around a state, in which its partner can be. It is given by a matrix G:
        two states whose means differ by z are not associated if z' G^-1 z >= 1. With d state
        columns, the result has the d (d + 1) / 2 entries of the lower triangle of G as columns, and
        a row for each state.

        The entries of G are c^2 C_ij / (s_i s_j):

        - c is the cutoff.
        - s has the scales of the columns.
        - C is the covariance of the distance, by default the unit matrix. Some distances take C
          from both states of a pair. Then C is the mean of the covariances of the state and its
          partner, or the covariance of a state without partner.

        On the Earth, G is valid only near the state.
        """
        side, distance, size = self.first, self.distance, len(self.first.columns)
        settings = distance.settings(side.columns)
        given = settings.get("covariance", settings.get("inner_cov", np.eye(size)))
        if not distance.on_earth and "scale" not in distance.options:
            return None
        if isinstance(given, str):  # each pair has its own covariance
            own, other = (np.zeros((len(s.step) + 1, size * (size + 1) // 2)) for s in self.sides)
            for spread_of_side, one in ((own, side), (other, self.second)):
                spread_of_side[:-1] = 0.0 if one.spread is None else one.spread
            unpaired = (self.partners[0] == NOBODY)[:, None]
            partner = np.where(unpaired, own[:-1], other[self.partners[0]])
            return np.asarray(self.cutoff**2 * (own[:-1] + partner) / 2)
        scale = np.ones((len(side.step), size)) * (distance.scale or 1.0)
        if distance.on_earth:
            scale[:, :2] *= np.radians(RADIUS)
            scale[:, 1] *= np.cos(np.radians(side.state[:, 0]))
            scale[:, 2:] = getattr(distance, "vertical_weight", 1.0)
        with np.errstate(divide="ignore", over="ignore"):
            return pack(self.cutoff**2 * np.asarray(given) / (scale[:, :, None] * scale[:, None])).T

    def associations_table(self) -> Columns:
        """Return a table with a row for each associated pair, and for each state without partner.

        In the row of a state without partner, the partner and the distances are None.
        """
        pairs = np.flatnonzero(self.chosen)
        both = self.pairs.truth_row[pairs], self.pairs.estimate_row[pairs]
        unpaired = [np.flatnonzero(partner == NOBODY) for partner in self.partners]
        kind = np.repeat((0, 1, 2), (len(pairs), len(unpaired[0]), len(unpaired[1])))
        a, b, pair = np.full((3, len(kind)), NOBODY)
        a[kind < 2] = np.concatenate((both[0], unpaired[0]))
        b[kind != 1] = np.concatenate((both[1], unpaired[1]))
        pair[kind == 0] = pairs
        order = np.lexsort((np.where(kind < 2, a, b), kind, self._steps(a, b)))
        return self._table(a[order], b[order], pair[order])

    def costs_table(self) -> Columns:
        """Return a table with a row for each of the `pairs`. In it, ``associated`` is 0 or 1."""
        pairs = np.arange(len(self.chosen))
        table = self._table(self.pairs.truth_row, self.pairs.estimate_row, pairs)
        return {**table, "associated": self.chosen.astype(int).tolist()}

    def cross_covariances_table(self) -> Columns:
        """Return a table with the cross-covariance of the particles of each associated pair.

        Raises
        ------
        InputError
            Neither side has clouds, or one side has Gaussians.
        """
        kinds = {self.first.kind, self.second.kind}
        if "cloud" not in kinds or "gaussian" in kinds:
            lacks = "one file has covariances" if "cloud" in kinds else "neither file has any"
            raise InputError(f"cross-covariances need particles, but {lacks}; add a column weight")
        pairs = np.flatnonzero(self.chosen)
        names = self.first.columns
        matrices = np.zeros((len(pairs), len(names), len(names)))
        if self.first.clouds is not None and self.second.clouds is not None:
            for k, pair in enumerate(pairs.tolist()):
                a = self.first.clouds[int(self.pairs.truth_row[pair])]
                b = self.second.clouds[int(self.pairs.estimate_row[pair])]
                matrices[k] = cross_covariance(*a, *b)
        entries = {
            f"cov_{one}_{other}": matrices[:, r, s].tolist()
            for r, one in enumerate(names)
            for s, other in enumerate(names)
        }
        rows = self.pairs.truth_row[pairs], self.pairs.estimate_row[pairs]
        return {**self._table(*rows, pairs), **entries}

    def _steps(self, a: Ints, b: Ints) -> Ints:
        """Return the step of each pair of rows `a` and `b`. One of both can be `NOBODY`."""
        steps = [np.append(side.step, 0) for side in (self.first, self.second)]
        return np.where(a == NOBODY, steps[1][b], steps[0][a])

    def _table(self, a: Ints, b: Ints, pair: Ints) -> Columns:
        """Return a table of pairs, with None for `NOBODY`.

        `a` and `b` are rows of the first and of the second side, `pair` has indices of `pairs`.
        """
        values = (
            (self.first.shown, self._steps(a, b)),
            (self.first.ids[self.first.track], a),
            (self.second.ids[self.second.track], b),
            (self.pairs.distance, pair),
            (self.mean_distances, pair),
        )
        table: Columns = {}
        for name, (column, at) in zip(COLUMN_NAMES, values, strict=True):
            padded = [*column.tolist(), None]
            table[name] = [padded[k] for k in at.tolist()]
        return table


def associate(
    first: Trajectories,
    second: Trajectories,
    *,
    cutoff: float,
    distance: str | Distance = "euclidean",
    all_pairs: bool = False,
    resources: Resources | None = None,
) -> Pairing:
    """Associate the states of two sides on the same times.

    Parameters
    ----------
    first, second : Trajectories
        Both sides, on the same times and with the same state columns.
    cutoff : float
        Cutoff c > 0, in the unit of the distance.
    distance : str or Distance
        Distance of states: a key of `tgospa_eval.distances.DISTANCES`, or a `Distance`.
    all_pairs : bool
        Whether to measure all pairs of each step, also those farther apart than the cutoff. The
        association stays the same.
    resources : Resources, optional
        Number of threads, and progress.

    Raises
    ------
    ConfigError
        The cutoff is not finite and > 0, or the distance does not exist.
    InputError
        The sides have different times or columns. Their states do not fit the distance. A step has
        too many states.
    """
    cutoff = real_number("cutoff", cutoff)
    if not 0 < cutoff < np.inf:
        raise ConfigError(f"cutoff is {cutoff:g}: must be finite and > 0")
    measure = _fitting(first, second, distance)
    pairs = near_pairs(first, second, np.inf if all_pairs else cutoff, measure, resources)
    near = np.flatnonzero(pairs.distance < cutoff)
    rows = pairs.truth_row[near], pairs.estimate_row[near]
    chosen = np.zeros(len(pairs.distance), bool)
    step = first.step[rows[0]]
    begins = np.flatnonzero(np.diff(step, prepend=-1)).tolist()
    for begin, end in pairwise((*begins, len(step))):
        i, j = (side[begin:end] for side in rows)
        states = max(len(np.unique(i)), len(np.unique(j)))
        if states > MAX_STATES:
            raise InputError(
                f"t {first.shown[step[begin]]}: {states} states have a partner within the cutoff, "
                f"more than the limit of {MAX_STATES}; take a smaller cutoff"
            )
        own = near[begin:end]
        chosen[own[assign_pairs(i, j, pairs.distance[own] - cutoff, 0.0)]] = True
    return Pairing(
        first=first,
        second=second,
        pairs=pairs,
        mean_distances=_mean_distances(first, second, pairs, measure),
        chosen=chosen,
        cutoff=cutoff,
        distance=measure,
    )


def _fitting(first: Trajectories, second: Trajectories, distance: str | Distance) -> Distance:
    """Check that both sides and the distance fit, and return the distance for these sides."""
    if isinstance(distance, str):
        distance = DISTANCES.chosen(distance)
    names = ("first", "second")
    check_columns(first, second, names)
    check_states(first, second, distance, names)
    if not np.array_equal(first.times, second.times) or first.clock != second.clock:
        raise InputError(
            "first and second have different times; join them with tracks.alignment.align"
        )
    return distance.fitted((first, second))


def _mean_distances(
    first: Trajectories, second: Trajectories, pairs: Pairs, distance: Distance
) -> Floats:
    """Return the distances between the means of the pairs.

    If `distance` has scales, the distances are Euclidean, with its scales and periods. If it has
    none, as on the Earth and for boxes, `distance` itself measures the means.
    """
    means: Distance = Norm(
        name="euclidean",
        power=2.0,
        scale=distance.scale,
        period=distance.period,
    )
    if "scale" not in distance.options:
        means = distance
    return means(first.state[pairs.truth_row], second.state[pairs.estimate_row])


# -------------------------------------------------------------------------------------------------
# Reduction of all clouds of a recording, and measures of their change.

CloudChange = tuple[int, int, float | None, float, float | None, float]
"""Values of one cloud with the names in `CHANGES`. An unknown or undefined value is None."""

CHANGES = ("particles", "kept", "wasserstein", "sliced_wasserstein", "trace_kept", "mean_shift")
HISTORY = "history"
"""Column with a list for each cloud: its distances to its reduction, one before each iteration."""


def reduce_trajectories(
    side: Trajectories, reduction: Reduction, resources: Resources | None = None
) -> tuple[Trajectories, Columns]:
    """Reduce all clouds to fewer particles, and measure the change of each cloud.

    Parameters
    ----------
    side : Trajectories
        Side with clouds; other states count as one particle and do not change.
    reduction : Reduction
        Settings of the reduction.
    resources : Resources, optional
        Number of threads, and progress.

    Returns
    -------
    Trajectories
        Side with the reduced clouds and their means.
    dict of lists
        Columns with a value for each cloud:

        - ``id``, ``t``: track and time
        - ``particles``, ``kept``: number of particles before and after the reduction
        - ``wasserstein``: distance of order 2 between the cloud and its reduction
        - ``sliced_wasserstein``: sliced distance of order 2 between both
        - ``trace_kept``: trace of the covariance after the reduction, as a share of that before
        - ``mean_shift``: distance between the means
        - ``history``: distances of `Reduction.trace`

        ``wasserstein`` is None if both clouds are too large for the exact distance, or if POT is
        not installed. ``trace_kept`` is None if the cloud has no spread.
    """
    resources = resources or Resources()
    if side.clouds is None:
        return side, _table(side, [(1, 1, 0.0, 0.0, None, 0.0)] * len(side.step), [])
    histories: list[list[float]] = []
    after = reduced(side.clouds, reduction, resources, histories)
    return side.with_clouds(after), _table(side, _changes(side.clouds, after, resources), histories)


def _table(side: Trajectories, changes: list[CloudChange], histories: list[list[float]]) -> Columns:
    table = {"id": side.ids[side.track].tolist(), "t": side.shown[side.step].tolist()}
    table |= {name: [change[k] for change in changes] for k, name in enumerate(CHANGES)}
    return table | {HISTORY: histories or [[] for _ in changes]}


def _changes(before: Clouds, after: Clouds, resources: Resources) -> list[CloudChange]:
    """Compare each cloud with its reduction. Threads are used, because this takes long."""
    directions = spread_directions(before.points.shape[1], None, np.random.default_rng(0))
    is_exact = can_transport()

    def change(row: int) -> CloudChange:
        return _compared(before[row], after[row], directions, is_exact=is_exact)

    is_changed = before.counts > after.counts
    if is_changed.any() and not is_exact:
        resources.stopwatch.notify(f"no exact distances to the original clouds: {POT_NEEDED}")
    what = f"{counted(int(np.count_nonzero(is_changed)), 'cloud')} to compare with the original"
    works = (is_changed * (before.counts * after.counts.astype(float)) ** 1.05).tolist()
    changes = in_order(change, range(len(before)), resources.jobs or cores())
    with resources.stopwatch.showing("comparing clouds with the original ones"):
        return list(resources.stopwatch.paced(changes, works, what))


def _compared(before: Cloud, after: Cloud, directions: Floats, *, is_exact: bool) -> CloudChange:
    sizes = len(before[1]), len(after[1])
    if sizes[0] == sizes[1]:
        return *sizes, 0.0, 0.0, 1.0, 0.0
    means = [weights @ points for points, weights in (before, after)]
    traces = [
        float(weights @ ((points - mean) ** 2).sum(axis=1))
        for (points, weights), mean in zip((before, after), means, strict=True)
    ]
    # Weights in single precision may not sum to 1. No warning is needed, because they were
    # normalised when they were read.
    exact = (
        cloud_wasserstein(*before, *after)
        if is_exact and sizes[0] * sizes[1] <= MAX_PARTICLES**2
        else None
    )
    return (
        *sizes,
        exact,
        sliced_wasserstein(before, after, directions),
        traces[1] / traces[0] if traces[0] else None,
        float(np.linalg.norm(means[1] - means[0])),
    )
