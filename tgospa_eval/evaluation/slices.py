"""Costs and counts of the reported assignment, split into slices by attributes.

Each cost belongs to a row. Localisation and misses belong to the row of the truth at the step. A
false target belongs to its own row. A switch belongs to the row of its true object at the step
where it is counted.

The values of an attribute are in a column, or follow from the states. The value of a row decides
its slice, or its shares in several slices. Slices add up to the total, because the shares of a row
sum to 1. There are only a few roundings, because numbers are summed pairwise.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.distances import Distance, Resources
from tgospa_eval.distances.pair_search import prepared_pairs
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import EvaluationByClass, PairEvaluation, source_of
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.slicing import DERIVED, Attribute, SliceBy, parse_slices
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.formats.fields import EXACT_BELOW
from tgospa_eval.formats.headers import BOX
from tgospa_eval.problem.problem import Objects, sum_by
from tgospa_eval.problem.solution import evaluated_rows
from tgospa_eval.problem.states import ONE, changes, spare
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.results.records import PARTS, PairProof
from tgospa_eval.results.slices import (
    AND_MORE,
    BETWEEN_EDGES,
    BEYOND_LAST,
    CROSSED,
    NO_ATTRIBUTE,
    NO_VALUE,
    UNDER,
    UNNAMED,
    Slice,
    Slicing,
    added_up,
)
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories, Values

MAX_DISTINCT = 20
"""If no edges are given, and there are at most so many distinct numbers, each gets a slice."""

MAX_SLICES, MAX_CROSSINGS = 200, 5_000
"""Largest number of slices by one attribute; largest number by two attributes."""

NOT_KNOWN = -1.0
"""Number that means an unknown share in MOTChallenge and KITTI files."""

QUARTILES = (0.25, 0.5, 0.75)


SideShare = tuple[Ints, Floats]
"""For the R rows of one side: slice index of each, (R,), and its share there, 0 to 1, (R,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Members:
    """Slices by one or two attributes, and the shares of rows in them.

    Parameters
    ----------
    names : list of str
        Names of all slices.
    shares : tuple of tuple of SideShare
        Shares of the rows of the truth, and of the rows of the estimate. If a row can be in several
        slices, there are several such pairs, over which the shares of a row sum to 1.
    kept : (n,) bool array
        Mask of the slices that are shown even if they are empty.
    """

    names: list[str]
    shares: tuple[tuple[SideShare, ...], ...]
    kept: Mask

    def crossed(self, other: "Members") -> "Members":
        """Return a slice for each pair of a slice here and a slice of `other`."""
        size = len(other.names)
        shares = tuple(
            tuple((a * size + b, x * y) for (a, x), (b, y) in zip(mine, theirs, strict=True))
            for mine in self.shares
            for theirs in other.shares
        )
        names = [f"{first}{CROSSED}{second}" for first in self.names for second in other.names]
        return Members(names=names, shares=shares, kept=np.zeros(len(names), bool))


def members(
    attribute: Attribute,
    values: tuple[Values | None, Values | None],
    rows: tuple[int, int],
    *,
    summed: bool,
) -> Members:
    """Return the slices of one attribute.

    Parameters
    ----------
    attribute : Attribute
        Requested attribute.
    values : pair of (R,) arrays or None
        Values of truth and estimate.
    rows : pair of int
        Number of rows of each side.
    summed : bool
        Whether slices of several evaluations are added up. Then ranges must not depend on data.

    Raises
    ------
    ConfigError
        The values do not fit the request, or the number of slices would be too large.
    """
    there = [side for side in values if side is not None]
    texts = [side for side in there if side.dtype.kind == "O" and any(side.tolist())]
    if attribute.weight:
        return _weighted(attribute, _numbers(attribute, values, texts, "weight"), rows)
    if attribute.edges:
        numbers = _numbers(attribute, values, texts, "edges")
        return _ranged(attribute.edges, numbers, rows)
    if texts or attribute.values:
        return _by_text(attribute, values, rows, summed=summed)
    numbers = _numbers(attribute, values, texts, "edges")
    finite = [side[~np.isnan(side)] for side in numbers if side is not None]
    distinct = np.unique(np.concatenate(finite))
    if len(distinct) <= MAX_DISTINCT:
        names = list(map(_shown, distinct.tolist()))
        inside = [
            None if side is None else np.where(np.isnan(side), -1, np.searchsorted(distinct, side))
            for side in numbers
        ]
        return _numbered(names, inside, rows)
    edges = _quarters(next(side for side in finite if np.isfinite(side).any()))
    if summed:
        shown = ":".join(f"{edge:g}" for edge in edges)
        raise ConfigError(
            f"{option('slices', attribute.name)}: there are {len(distinct):,} values from "
            f"{distinct[0]:g} to {distinct[-1]:g}; slices that are added up need edges, such as "
            f"{attribute.name}=:{shown}:"
        )
    return _ranged((-np.inf, *edges, np.inf), numbers, rows)


def _numbers(
    attribute: Attribute,
    values: Sequence[Values | None],
    texts: Sequence[Values],
    wanted: str,
) -> list[Floats | None]:
    """Return the values as numbers, NaN for a blank.

    `texts` are the columns with texts. They cause an error, which says that texts have no `wanted`.
    """
    if texts:
        given = texts[0][texts[0] != ""]
        shown = listed(sorted(set(given.tolist()))[:5])
        raise ConfigError(
            f"{option('slices')} {quoted(attribute.name)}: has texts ({shown}), which have no "
            f"{wanted}; {option('slices', attribute.name)} makes a slice for each text"
        )
    return [
        None
        if side is None
        else np.full(len(side), np.nan)
        if side.dtype.kind == "O"
        else side.astype(np.float64)
        for side in values
    ]


def _weighted(
    attribute: Attribute, values: Sequence[Floats | None], rows: tuple[int, int]
) -> Members:
    """Return two slices, in which a row with the value w has the shares w and 1 - w.

    A row without a value is in a third slice.
    """
    values = [
        None if side is None else np.where(side == NOT_KNOWN, np.nan, side) for side in values
    ]
    for side, role in zip(values, ("truth", "estimate"), strict=True):
        if side is not None:
            wrong = side[(side < 0) | (side > 1)]
            if len(wrong):
                raise ConfigError(
                    f"{option('slices')} {attribute.name}=weight: {attribute.name} of the {role} "
                    f"is {wrong[0]:g}; a weight must be from 0 to 1"
                )
    names = [attribute.name, f"1 - {attribute.name}"]
    whole = _numbered(
        names, [None if side is None else np.where(np.isnan(side), -1, 0) for side in values], rows
    )
    first = [
        (place, np.ones(len(place)) if side is None else np.where(np.isnan(side), 1.0, side))
        for (place, _), side in zip(whole.shares[0], values, strict=True)
    ]
    second = [(np.where(place == 0, 1, place), 1 - share) for place, share in first]
    return Members(names=whole.names, shares=(tuple(first), tuple(second)), kept=whole.kept)


def _ranged(
    edges: Sequence[float], values: Sequence[Floats | None], rows: tuple[int, int]
) -> Members:
    """Return a slice between any two neighbouring edges, one below all, and one above all.

    A slice includes its lower edge. If the last edge is finite, the last slice between edges
    includes it, too.
    """
    inner = [edge for edge in edges if np.isfinite(edge)]
    low, high = edges[0] == -np.inf, edges[-1] == np.inf
    names = [f"{UNDER}{_shown(inner[0])}"]
    names += [f"{_shown(a)}{BETWEEN_EDGES}{_shown(b)}" for a, b in pairwise(inner)]
    names.append(f"{_shown(inner[-1])}{AND_MORE}" if high else f"{BEYOND_LAST}{_shown(inner[-1])}")
    inside: list[Ints | None] = []
    for side in values:
        if side is None:
            inside.append(None)
            continue
        place = np.searchsorted(inner, side, side="right")
        if not high:
            place[side == inner[-1]] -= 1
        inside.append(np.where(np.isnan(side), -1, place))
    kept = np.ones(len(names), bool)
    kept[0], kept[-1] = low, high
    return _numbered(names, inside, rows, kept)


def _by_text(
    attribute: Attribute,
    values: Sequence[Values | None],
    rows: tuple[int, int],
    *,
    summed: bool,
) -> Members:
    """Return a slice for each text; if the request names texts, one slice has all other texts."""
    sides = [None if side is None else _as_texts(side).tolist() for side in values]
    there = {text for side in sides for text in side or ()} - {""}
    names = list(attribute.values) or sorted(there, key=natural)
    if there and not summed and attribute.values and not there & set(names):
        raise ConfigError(
            f"{option('slices')} {attribute.name}={':'.join(names)}: no such value; the values are "
            f"{listed(sorted(there, key=natural)[:10])}"
        )
    if len(names) > MAX_SLICES:
        raise ConfigError(
            f"{option('slices', attribute.name)}: {len(names):,} different values; name those "
            f"that are of interest, {attribute.name}={names[0]}:{names[1]}"
        )
    number_of = {text: k for k, text in enumerate(names)} | {"": -1}
    if there - set(names):
        names = [*names, UNNAMED]
    last = len(names) - 1
    inside = [
        None
        if side is None
        else np.fromiter((number_of.get(text, last) for text in side), np.int64, len(side))
        for side in sides
    ]
    return _numbered(names, inside, rows)


def _as_texts(values: Values) -> Values:
    """Return numbers as texts, for comparison with the texts of another side."""
    if values.dtype.kind == "O":
        return values
    texts = ["" if value != value else _shown(value) for value in values.tolist()]
    return np.array(texts, dtype=object)


def _numbered(
    names: list[str],
    inside: Sequence[Ints | None],
    rows: tuple[int, int],
    kept: Mask | None = None,
) -> Members:
    """Return slices from the index of the slice of each row; each row is in one slice only.

    Two slices are added: one for rows without a value (index -1), and one for all rows of a side
    without the attribute (None).
    """
    size = len(names)
    truth, estimate = (
        np.full(count, size + 1) if side is None else np.where(side < 0, size, side)
        for side, count in zip(inside, rows, strict=True)
    )
    shown = np.zeros(size + 2, bool)
    shown[:size] = True if kept is None else kept
    return Members(
        names=[*names, NO_VALUE, NO_ATTRIBUTE],
        shares=(tuple((side, np.broadcast_to(1.0, len(side))) for side in (truth, estimate)),),
        kept=shown,
    )


def _shown(value: float) -> str:
    """Format a number for the name of a slice, as short as possible."""
    return str(int(value)) if value.is_integer() and abs(value) < EXACT_BELOW else repr(value)


def _quarters(values: Floats) -> list[float]:
    """Return the quartiles of the finite values, rounded to two digits."""
    finite = np.sort(values[np.isfinite(values)])
    ends = (finite[int(share * (len(finite) - 1))] for share in QUARTILES)
    return sorted({float(f"{end:.2g}") for end in ends})


INSIDE, OUTSIDE = "inside", "outside"
"""Names of the slices of a region."""


def values_of(
    sides: tuple[Trajectories, Trajectories],
    attribute: Attribute,
    distance: Distance,
    cutoff: float,
) -> tuple[Values | None, Values | None]:
    """Return the value of each row of truth and estimate, None for a side without the attribute.

    If a side has a column of this name, values that follow from the states are not used.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate on one grid.
    attribute : Attribute
        Attribute whose values are returned.
    distance : Distance
        Base distance.
    cutoff : float
        Distance below which other objects are neighbours.

    Raises
    ------
    ConfigError
        Neither side has the attribute.
    """
    first, second = (_column(side, attribute.name) for side in sides)
    name = attribute.name.partition("@")[0]
    if first is None and second is None and name in DERIVED:
        makers: dict[str, Callable[[Trajectories], Values | None]] = {
            "range": lambda side: _ranges(side, attribute),
            "speed": _speeds,
            "size": _sizes,
            "age": _ages,
            "density": lambda side: _neighbours(side, distance, cutoff),
            "region": lambda side: _inside(side, attribute),
        }
        first, second = map(makers[name], sides)
    if first is None and second is None:
        raise ConfigError(_unknown(sides, attribute))
    return first, second


def _neighbours(side: Trajectories, distance: Distance, cutoff: float) -> Floats:
    """Return, for each row, the number of other rows of its step nearer than the cutoff."""
    own_side = side.reduced_to(distance.kinds)
    resources = Resources(jobs=1)
    both, distance = distance.prepared((own_side, own_side), resources)
    margin = distance.margin(both, cutoff)
    pairs = prepared_pairs(both, cutoff, distance, resources, margin=margin)
    nearer = distance.nearer(pairs, both, np.full(len(pairs.distance), cutoff))
    pairs = pairs.chosen(np.flatnonzero(nearer))
    neighbours = pairs.truth_row[pairs.truth_row != pairs.estimate_row]
    return np.bincount(neighbours, minlength=len(side.step)).astype(np.float64)


def _unknown(sides: tuple[Trajectories, Trajectories], attribute: Attribute) -> str:
    """Return the message about an attribute that both sides lack."""
    name = attribute.name
    offered = {header for side in sides for header in side.offered}
    for column, _, _ in attribute.ranges:
        if all(_column(side, column) is None for side in sides):
            name = column
            break
    if name in offered:
        return (
            f"{option('slices')} {quoted(name)}: the column was not read; name it where the files "
            "are read"
        )
    known = (("id", "t", *side.columns, *side.attributes) for side in sides)
    there = sorted(offered.union(*known))
    if name == "size":
        return (
            f"{option('slices', 'size')}: neither file has boxes or columns width and height "
            f"(there are {listed(there)})"
        )
    return (
        f"{option('slices')} {quoted(name)}: neither file has such a column (there are "
        f"{listed(there)}); slices without a column are {', '.join(DERIVED)}"
    )


def _column(side: Trajectories, name: str) -> Values | None:
    """Return a column by its name: an attribute, a state column, ids or times."""
    if name in side.attributes:
        given: Values = side.attributes[name]
        return given
    if name in side.columns:
        return np.asarray(side.state[:, side.columns.index(name)], np.float64)
    if name in ("x", "y") and side.columns == BOX:
        return np.asarray(_positions(side)["xy".index(name)], np.float64)
    if name == "id":
        return np.asarray(side.ids[side.track], dtype=object)
    if name == "t":
        if side.labels is None:
            return np.asarray(side.times[side.step], np.float64)
        return np.asarray(side.labels[side.step], dtype=object)
    return None


def _is_earth(side: Trajectories) -> bool:
    return "lat" in side.columns and "lon" in side.columns


def _positions(side: Trajectories) -> Floats:
    """Return the positions of the objects, (d, R), without velocities in the states."""
    if side.columns == BOX:
        left, top, width, height = side.state.T
        return np.stack((left + 0.5 * width, top + 0.5 * height))
    names = [name for name in ("lat", "lon") if _is_earth(side)]
    names = names or [name for name in ("x", "y", "z") if name in side.columns]
    places = [side.columns.index(name) for name in names or side.columns]
    return np.ascontiguousarray(side.state.T[places])


def _distances(side: Trajectories, first: Floats, second: Floats) -> Floats:
    """Return distances between positions (d, N), in metres on the Earth."""
    if _is_earth(side):
        return Haversine().between(zip(first, second, strict=True))
    difference: Floats = first - second
    with np.errstate(over="ignore"):
        return np.asarray(reduce(np.hypot, difference[1:], np.abs(difference[0])))


def _ranges(side: Trajectories, attribute: Attribute) -> Floats:
    """Return the distances of rows from the point of the attribute, by default the origin.

    If the point has fewer coordinates than the states, the other coordinates do not count.
    """
    places = _positions(side)
    origin = np.array(attribute.origin or (0.0,) * len(places))
    if _is_earth(side) and len(origin) != len(places):
        raise ConfigError(
            f"{option('slices', 'range')}: for latitudes and longitudes write range@LAT,LON"
        )
    if len(origin) > len(places):
        raise ConfigError(
            f"{option('slices', attribute.name)}: the point has {len(origin)} numbers, positions "
            f"have {len(places)} ({', '.join(side.columns)})"
        )
    places = places[: len(origin)]
    return _distances(side, places, np.broadcast_to(origin[:, None], places.shape))


def _speeds(side: Trajectories) -> Floats:
    """Return the speed of each row: from the velocity in the states, else from positions.

    A speed from positions is that between the row before and the row after it in its track. At an
    end of the track, the row itself replaces the missing row. A track with one row has no speed.
    Speeds are per second if times are ISO times.
    """
    velocity = [side.columns.index(name) for name in ("vx", "vy", "vz") if name in side.columns]
    if velocity:
        return np.asarray(np.hypot.reduce(side.state[:, velocity].T, axis=0))
    order = np.lexsort((side.step, side.track))
    track = side.track[order]
    same = track[1:] == track[:-1]
    before = np.arange(len(order)) - np.append(False, same)[: len(order)]
    after = np.arange(len(order)) + np.append(same, False)[: len(order)]
    times = side.times[side.step[order]]
    span = (times[after] - times[before]).astype(np.float64)
    places = _positions(side)
    if side.clock != "number":
        span /= SECOND
    speed = np.full(len(order), np.nan)
    moved = np.flatnonzero(span > 0)
    ends = (order[at[moved]] for at in (after, before))
    way = _distances(side, *(places.take(end, axis=1) for end in ends))
    speed[order[moved]] = way / span[moved]
    return speed


def _sizes(side: Trajectories) -> Floats | None:
    """Return the area of each box, from the states or else from columns.

    Columns give the area as width times height or, without heights, as width times length.
    """
    if side.columns == BOX:
        return side.state[:, 2] * side.state[:, 3]
    width = _extent(side, "width", ("left", "right"))
    height = _extent(side, "height", ("top", "bottom"))
    other = _extent(side, "length", ()) if height is None else height
    return None if width is None or other is None else width * other


def _extent(side: Trajectories, name: str, ends: tuple[str, ...]) -> Floats | None:
    """Return a width, height or length, from its column or else from the columns of both ends."""
    columns = [side.attributes.get(column) for column in (name, *ends)]
    numbers = [None if v is None or v.dtype.kind != "f" else v.astype(np.float64) for v in columns]
    if numbers[0] is not None or not ends:
        return numbers[0]
    first, last = numbers[1:]
    return None if first is None or last is None else last - first


def _ages(side: Trajectories) -> Floats:
    """Return, for each row, the number of steps since the first step of its track."""
    first = np.zeros(len(side.ids), side.step.dtype)
    first[side.track[::-1]] = side.step[::-1]
    return (side.step - first[side.track]).astype(np.float64)


def _inside(side: Trajectories, attribute: Attribute) -> Values | None:
    """Return "inside" for rows in all ranges of the region, ends included, else "outside".

    The result is blank for a row with a missing value, and None if a column is missing.
    """
    inside, known = np.ones(len(side.step), bool), np.ones(len(side.step), bool)
    for name, low, high in attribute.ranges:
        values = _column(side, name)
        if values is None:
            return None
        if values.dtype.kind != "f":
            raise ConfigError(
                f"{option('slices', 'region')}: column {quoted(name)} has texts, not numbers"
            )
        known &= ~np.isnan(values.astype(np.float64))
        inside &= (values >= low) & (values <= high)
    names = np.array(["", OUTSIDE, INSIDE], dtype=object)
    place: Ints = np.where(known, 1 + inside, 0)
    return np.asarray(names[place])


RowCosts = tuple[dict[str, Floats], dict[str, Floats]]
"""Costs in units of c^p, and counts: for each row of the truth, and for each row of the estimate.

Rows of the truth have localisation, misses and switches. Rows of the estimate have false targets.
"""


def slice_members(
    fitted: AlignedPair, requested: Sequence[SliceBy], cutoff: float
) -> dict[str, Members]:
    """Return the requested slices, and which rows of truth and estimate are in them.

    Slices do not depend on the assignment.

    Raises
    ------
    ConfigError
        An attribute does not exist, or its values do not fit.
    """
    return {by.text: _members(by, fitted, cutoff) for by in requested}


def slicings(members: dict[str, Members], result: PairEvaluation) -> tuple[Slicing, ...]:
    """Return the costs of a result in each slice; `members` has the rows of each slice."""
    costs = row_costs(result.proof)
    unique = is_unique(result.proof, result.gap, everywhere=True)
    return tuple(
        Slicing(by=by, slices=tuple(_slices(costs, members_of, result.scale)), unique=unique)
        for by, members_of in members.items()
    )


def slices_of(
    result: PairEvaluation | EvaluationByClass, texts: Sequence[str], *, summed: bool = False
) -> tuple[Slicing, ...]:
    """Split a result into the slices that `texts` request.

    `summed` says that the slices are added to those of other results.

    Raises
    ------
    ConfigError
        The attributes do not fit (see `slice_members`), or the result was not made by `evaluate`.
    """
    if isinstance(result, EvaluationByClass):
        parts = [slices_of(part, texts, summed=True) for part in result.results.values()]
        return tuple(added_up(parts))
    sides, _ = source_of(result)
    members = slice_members(
        sides, parse_slices(texts, summed=summed), result.proof.parameters.cutoff
    )
    return slicings(members, result)


def _members(by: SliceBy, fitted: AlignedPair, cutoff: float) -> Members:
    aligned = fitted.alignment
    sides, reports = (aligned.truth, aligned.estimate), aligned.reports
    rows = len(sides[0].step), len(sides[1].step)
    by_attribute = []
    for attribute in by.attributes:
        if reports is None:
            values = values_of(sides, attribute, fitted.distance, cutoff)
        else:  # speeds and neighbours are those of the reports
            at = sides[0], reports.estimate
            first, second = values_of(at, attribute, fitted.distance, cutoff)
            values = first, None if second is None else second[reports.row]
        by_attribute.append(members(attribute, values, rows, summed=by.summed))
    whole = by_attribute[0] if len(by_attribute) == 1 else by_attribute[0].crossed(by_attribute[1])
    if len(whole.names) > MAX_CROSSINGS:
        raise ConfigError(
            f"{option('slices')} {quoted(by.text)}: would make {len(whole.names):,} slices, more "
            f"than {MAX_CROSSINGS:,}"
        )
    return whole


def row_costs(proof: PairProof) -> RowCosts:
    """Return the costs of an assignment by row.

    Errors of assigned states are included. As in the summary, pairs with a state that is not
    evaluated have no error.
    """
    states, weights, metric = proof.states, proof.weights, proof.parameters
    problem = states.problem
    truths, estimates = problem.sides
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    entry, weight = states.entry[used], weights[used]

    paid = weight / ONE * problem.cost[entry]
    missed, false = (spare(side, entry, weight) / ONE for side in problem.sides)
    moved, amount = changes(states, weights)
    pair = np.searchsorted(states.pair_first, moved, side="right") - 1
    step = states.begin[moved]
    row = _row_at(truths, states.pair_truth[pair], step)
    size = len(truths.step)
    price = problem.switch_price_at[step] * amount
    mass = weight / ONE
    if problem.unjudged is not None:
        evaluated = evaluated_rows(states, weights)
        mass = mass * evaluated[0][truths.row[entry]] * evaluated[1][estimates.row[entry]]
    error = metric.cutoff * problem.powers(entry) ** (1 / metric.order)
    return (
        {
            "localisation": sum_by(truths.row[entry], paid, size),
            "missed": missed * truths.price,
            "missed_count": missed,
            "switch": sum_by(row, price, size),
            "switch_count": 0.5 * sum_by(row, amount, size),
            "truth_steps": _evaluated_rows(truths),
            "assigned_steps": sum_by(truths.row[entry], mass, size),
            "squared_error": sum_by(truths.row[entry], mass * error**2, size),
        },
        {
            "false": false * estimates.price,
            "false_count": false,
            "estimate_steps": np.ones(len(estimates.step)),
        },
    )


def _evaluated_rows(truths: Objects) -> Floats:
    """Return 1 for each evaluated row, and 0 for any other row."""
    weights = np.ones(len(truths.step))
    if truths.unjudged is not None:
        weights[truths.unjudged] = 0.0
    return weights


def _row_at(truths: Objects, track: Ints, step: Ints) -> Ints:
    """Return the row of each true object at a step; without one, its next row or its last row."""
    order = np.argsort(truths.track, kind="stable")
    steps = int(truths.step.max(initial=0)) + 2
    key = truths.track[order].astype(np.int64) * steps + truths.step[order]
    place = np.searchsorted(key, track.astype(np.int64) * steps + np.minimum(step, steps - 1))
    last = np.searchsorted(key, (track.astype(np.int64) + 1) * steps) - 1
    row: Ints = order[np.minimum(place, last)]
    return row


def _slices(costs: RowCosts, whole: Members, scale: float) -> list[Slice]:
    """Return the slices with their sums; empty slices only if `whole.kept` marks them."""
    size = len(whole.names)
    sums: dict[str, Floats] = {}
    for side, columns in enumerate(costs):
        for part in whole.shares:
            place, share = part[side]
            order = np.argsort(place.astype(np.min_scalar_type(size)), kind="stable")
            first = np.searchsorted(place[order], np.arange(size + 1))
            for name, value in columns.items():
                parts = _sum_of_parts((value * share)[order], first)
                sums[name] = sums[name] + parts if name in sums else parts
    for name in PARTS:
        sums[name] = sums[name] * scale
    # All sums are tested: a slice in which all states are ignored may still have a switch.
    there = whole.kept | np.logical_or.reduce([value > 0 for value in sums.values()])
    return [
        Slice(name=whole.names[k], **{name: float(value[k]) for name, value in sums.items()})
        for k in np.flatnonzero(there).tolist()
    ]


def _sum_of_parts(value: Floats, first: Ints) -> Floats:
    """Return the sum of each contiguous part; `first` has the begins of the parts, and the end.

    NumPy sums pairwise, so a sum of n terms has about log2(n) rounding errors.
    """
    bounds = first.tolist()
    return np.array([value[low:high].sum() for low, high in pairwise(bounds)], np.float64)
