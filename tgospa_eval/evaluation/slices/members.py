"""Which slice, or with which share, each state of both sides belongs to."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.slicing import Attribute
from tgospa_eval.formats.fields import EXACT_BELOW
from tgospa_eval.results.slices import (
    AND_MORE,
    BETWEEN_EDGES,
    BEYOND_LAST,
    CROSSED,
    NO_ATTRIBUTE,
    NO_VALUE,
    UNDER,
    UNNAMED,
)
from tgospa_eval.text import listed, option, quoted
from tgospa_eval.tracks.trajectories import Values

MOST_DISTINCT = 20
"""Different numbers that have a slice each where no edges are given."""

MOST_SLICES, MOST_CROSSINGS = 200, 5_000
"""By one attribute, and by two."""

NOT_KNOWN = -1.0
"""How MOTChallenge and KITTI write a share that is not known."""

QUARTILES = (0.25, 0.5, 0.75)


SideShare = tuple[Ints, Floats]
"""A slice for each row of a side (R,), and how much of the row is in it, 0 to 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Members:
    """The slices by one attribute or two, and what is in them.

    Parameters
    ----------
    names : list of str
        Of all slices.
    shares : tuple of tuple of SideShare
        Of truth and estimate; of each row they sum to 1.
    kept : (n,) bool array
        Slices that are shown even if nothing is in them.
    """

    names: list[str]
    shares: tuple[tuple[SideShare, ...], ...]
    kept: Mask

    def crossed(self, other: "Members") -> "Members":
        """The slices by both attributes."""
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
    """The slices of one attribute.

    Parameters
    ----------
    attribute : Attribute
        What is asked for.
    values : pair of (R,) arrays or None
        Of truth and estimate.
    rows : pair of int
        How many each side has.
    summed : bool
        Whether ranges must not depend on the data.

    Raises
    ------
    ConfigError
        The values do not fit what is asked for, or there would be too many slices.
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
    found = [side[~np.isnan(side)] for side in numbers if side is not None]
    distinct = np.unique(np.concatenate(found))
    if len(distinct) <= MOST_DISTINCT:
        names = list(map(_shown, distinct.tolist()))
        inside = [
            None if side is None else np.where(np.isnan(side), -1, np.searchsorted(distinct, side))
            for side in numbers
        ]
        return _numbered(names, inside, rows)
    edges = _quarters(next(side for side in found if np.isfinite(side).any()))
    if summed:
        shown = ":".join(f"{edge:g}" for edge in edges)
        raise ConfigError(
            f"{option('slices', attribute.name)}: {len(distinct):,} different values from "
            f"{distinct[0]:g} to {distinct[-1]:g}; slices that are added up need edges: "
            f"{attribute.name}=:{shown}:"
        )
    return _ranged((-np.inf, *edges, np.inf), numbers, rows)


def _numbers(
    attribute: Attribute,
    values: Sequence[Values | None],
    texts: Sequence[Values],
    wanted: str,
) -> list[Floats | None]:
    """The values as numbers; a column of blanks alone is one of missing numbers."""
    if texts:
        given = texts[0][texts[0] != ""]
        shown = listed(sorted(set(given.tolist()))[:5])
        raise ConfigError(
            f"{option('slices')} {quoted(attribute.name)}: has texts ({shown}), for which there "
            f"is no {wanted}; by value: {option('slices', attribute.name)}"
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
    """Two slices, with the share w and 1 - w of each row; a third for rows without a value."""
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
    """A slice from each edge to before the next, the last with its end, and what is outside."""
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
    """A slice for each text, or for those that are named and one for all others."""
    sides = [None if side is None else _as_texts(side).tolist() for side in values]
    there = {text for side in sides for text in side or ()} - {""}
    names = list(attribute.values) or sorted(there, key=natural)
    if there and not summed and attribute.values and not there & set(names):
        raise ConfigError(
            f"{option('slices')} {attribute.name}={':'.join(names)}: there is none of these, but "
            f"{listed(sorted(there, key=natural)[:10])}"
        )
    if len(names) > MOST_SLICES:
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
    """Numbers beside the texts of another side, as texts."""
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
    """With slices for rows without a value, -1, and for a side without the attribute, None."""
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
    """A number of a name: as short as it can be."""
    return str(int(value)) if value.is_integer() and abs(value) < EXACT_BELOW else repr(value)


def _quarters(values: Floats) -> list[float]:
    """Quartiles, rounded to two digits."""
    finite = np.sort(values[np.isfinite(values)])
    ends = (finite[int(share * (len(finite) - 1))] for share in QUARTILES)
    return sorted({float(f"{end:.2g}") for end in ends})
