"""Distance of boxes in an image: the share of their union that they do not have in common."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import REACH_ROUNDING, Distance, Pairs, Sides, exactly_nearer

if TYPE_CHECKING:
    from fractions import Fraction

SMALLEST_EDGE, LARGEST_EDGE = 1e-100, 1e150
"""Limits of widths and heights, so that areas neither overflow nor underflow."""

MAX_BLUR = 2.0**-20
"""Largest value of `IoU.margin`."""

TRACKEVAL_EPS = 2.0**-52
"""Tolerance in TrackEval: areas up to this size count as 0, and thresholds of the IoU are shifted
by it."""


@dataclass(frozen=True, kw_only=True)
class IoU(Distance):
    """1 - intersection over union of boxes (left, top, width, height): the Jaccard distance.

    Areas are width times height, without an additional pixel. The distance is a metric on boxes
    [Kosub 2019]. It is at most 1, and exactly 1 for boxes without overlap.
    """

    name = "iou"
    columns = ("left", "top", "width", "height")
    defaults = (0.5, 0.5)
    largest = 1.0
    limits: ClassVar[dict[str, tuple[float, float, str]]] = dict.fromkeys(
        columns[2:],
        (SMALLEST_EDGE, LARGEST_EDGE, f"> 0 (from {SMALLEST_EDGE:g} to {LARGEST_EDGE:g})"),
    )

    def margin(self, sides: Sides, cutoff: float) -> float:
        """Return the margin (see `Distance.margin`) around the cutoff.

        It covers the rounding of a ratio near 1, and that of edges written as decimals.
        """
        corners = (np.abs(side.state[:, :2]).max(initial=0.0) for side in sides)
        smallest = min(side.state[:, 2:].min(initial=np.inf) for side in sides)
        blur = 2.0**-46 + 2.0**-50 * max(corners) / max(smallest, SMALLEST_EDGE)
        return float(min(blur, MAX_BLUR))

    def nearer(self, pairs: Pairs, sides: Sides, cutoff: Floats) -> Mask:
        """Return, exactly, for each of N pairs whether it is nearer than its own cutoff, (N,)."""
        from fractions import Fraction  # lazy: slow to import, and few pairs are at the cutoff

        def decide(a: "list[Fraction]", b: "list[Fraction]", cutoff: "Fraction") -> bool:
            shared = Fraction(1)
            for k in (0, 1):
                end = min(a[k] + a[k + 2], b[k] + b[k + 2])
                shared *= max(end - max(a[k], b[k]), Fraction(0))
            union = a[2] * a[3] + b[2] * b[3] - shared
            return union - shared < cutoff * union

        begins, ends = [], []
        for side, row in zip(sides, (pairs.truth_row, pairs.estimate_row), strict=True):
            begins.append(side.state[row, :2])
            ends.append(begins[-1] + side.state[row, 2:])
        gap = np.maximum(*begins) - np.minimum(*ends)
        size = np.maximum(*map(np.abs, begins)) + np.maximum(*map(np.abs, ends))
        far = (gap > REACH_ROUNDING * size).any(axis=1)  # surely no overlap: distance 1
        nearer: Mask = pairs.distance < cutoff
        rest = np.flatnonzero(~far)
        nearer[rest] = exactly_nearer(self, pairs.chosen(rest), sides, cutoff[rest], decide)
        return nearer

    def last_place(self, sides: Sides) -> float:
        """Return roughly the rounding error of 1 minus a ratio near 1."""
        return 2.0**-50

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of boxes, given as lefts, tops, widths and heights."""
        left, top, width, height = components
        shared = _overlap(left, width) * _overlap(top, height)
        union = width[0] * height[0] + width[1] * height[1] - shared
        return np.asarray((union - shared) / union)

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return the derivatives by left, top, width and height of the second box.

        The distance is ``1 - I / U``, with the areas I of the intersection and U of the union.
        """
        shared = [_overlap((a[k], b[k]), (a[k + 2], b[k + 2])) for k in (0, 1)]
        both = shared[0] * shared[1]
        union = a[2] * a[3] + b[2] * b[3] - both
        slopes = np.zeros_like(b)
        for k in (0, 1):
            inside = b[k] + b[k + 2] < a[k] + a[k + 2]  # its right or lower edge bounds the overlap
            moved = np.where(inside, 1.0, 0.0) - np.where(b[k] > a[k], 1.0, 0.0)
            for place, change, of_area in (
                (k, moved, 0.0),
                (k + 2, np.where(inside, 1.0, 0.0), b[3 - k]),
            ):
                by = np.where(both > 0, change * shared[1 - k], 0.0)
                slopes[place] = -(by * union - both * (of_area - by)) / union**2
        return slopes

    def embed(self, axes: Floats) -> Floats:
        """Return left, top and the logarithms of width and height."""
        return np.concatenate((axes[:2], np.log(axes[2:])))

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of left, top and the logarithms of width and height.

        It is infinite if the cutoff c > 1. Let q = 1 - c be the least IoU of near boxes. The union
        is at least the larger width w times the overlap in height. So the overlap in width is at
        least q w, the left sides differ by at most w - q w = c w, and the smaller width is at least
        q w. The same holds for heights.
        """
        if cutoff > 1:
            return np.full((4, 1), np.inf)
        near = cutoff + 2.0**-48  # the rounding of a distance
        ratio = -np.log1p(-near) if near < 1 else np.inf
        sizes = axes[2:]
        return np.concatenate(
            (near * (1 + REACH_ROUNDING) * sizes, np.full_like(sizes, ratio + REACH_ROUNDING))
        )


# Differences of huge coordinates may overflow to infinity; the results are right all the same.
@np.errstate(over="ignore")
def overlaps(a: Floats, b: Floats) -> Floats:
    """Return the IoU of boxes `a` and `b`, bit for bit as TrackEval computes it.

    First the right and lower edges are computed, with rounding. Then widths and heights are the
    differences between opposite edges. The IoU of a box without area is 0.

    Parameters
    ----------
    a, b : array, shape (..., 4)
        Left, top, width, height; shapes are broadcast.

    Returns
    -------
    array, shape (...)
    """
    (begin_a, end_a), (begin_b, end_b) = (
        (box[..., :2], box[..., :2] + box[..., 2:]) for box in (a, b)
    )
    area_a, area_b = (end_a - begin_a).prod(axis=-1), (end_b - begin_b).prod(axis=-1)
    edges = np.minimum(end_a, end_b) - np.maximum(begin_a, begin_b)
    shared = np.maximum(edges, 0.0).prod(axis=-1)
    union = area_a + area_b - shared
    some = (area_a > TRACKEVAL_EPS) & (area_b > TRACKEVAL_EPS) & (union > TRACKEVAL_EPS)
    ratio: Floats = np.divide(shared, union, out=np.zeros_like(shared), where=some)
    return ratio


def _overlap(begin: tuple[Floats, Floats], size: tuple[Floats, Floats]) -> Floats:
    """Return the shared length of two intervals; for equal intervals it is exactly their length."""
    offset = begin[0] - begin[1]
    shorter = np.minimum(*size)
    return np.maximum(np.minimum(shorter, np.minimum(offset + size[0], size[1] - offset)), 0.0)
