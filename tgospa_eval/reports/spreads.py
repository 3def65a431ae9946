"""What is around the states as the page draws it: small whole numbers that make ellipses.

Of two components with deviations s, t and correlation r the n-sigma outline is
(n s cos u, n t sin(u + arcsin r)), 0 <= u < 2 pi. So a covariance is encoded as a logarithm for
each deviation and an angle for each correlation, in the order of its lower triangle.
"""

from typing import TypedDict

import numpy as np

from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.tracks.covariances import size_of

NUMBERS = 150_000
"""Numbers of covariances that are encoded; beyond, those of every so many steps."""

FINE = 50
"""Levels of a deviation for a factor of e: 2 % each."""

FAINT = 1000
"""The level of what is not seen beside the largest deviation, as 0."""

ANGLE = 64
"""Levels of an angle for a radian."""


class Encoding(TypedDict, total=False):
    """How the numbers of ellipses are to be read; empty where there are none."""

    stride: int
    largest: list[float]
    fine: int
    faint: int
    angle: int


def described(spreads: list[Floats], stride: int) -> Encoding:
    """How the numbers of both sides are to be read; nothing where there are no ellipses.

    Parameters
    ----------
    spreads : list of (R, d (d + 1) / 2) float arrays
        Lower triangles; (R, 0) of points.
    stride : int
        Steps from one encoded position to the next.
    """
    around = [spread for spread in spreads if spread.size]
    if not around or size_of(around[0].shape[1]) < 2:
        return {}
    rows, columns = np.tril_indices(size_of(around[0].shape[1]))
    largest = np.max([_deviations(s[:, rows == columns]).max(axis=0) for s in around], axis=0)
    size = sum(spread.size for spread in around) // stride
    return {
        "stride": stride * max(1, -(-size // NUMBERS)),
        "largest": largest.tolist(),
        "fine": FINE,
        "faint": FAINT,
        "angle": ANGLE,
    }


def encoded(track: Ints, step: Ints, spread: Floats, how: Encoding) -> dict[str, Ints]:
    """Arrays by name: which of these rows, sorted by track, are encoded, and each of the entries.

    Those of every so many steps, and the first and the last of each track.
    """
    if not spread.size:
        return {}
    keep = step % how["stride"] == 0
    ends = np.flatnonzero(np.diff(track, prepend=-1, append=-1))
    keep[ends[:-1]] = True
    keep[ends[1:] - 1] = True
    row = np.flatnonzero(keep)
    entries = levels(spread[row], how["largest"])
    return {"row": row} | {str(entry): level for entry, level in enumerate(entries)}


def concatenated(spreads: list[Floats]) -> Floats:
    """Those of several parts, of which some may be points, which have no spread."""
    wide = max((spread.shape[1] for spread in spreads), default=0)
    parts = [s if s.shape[1] == wide else np.zeros((len(s), wide)) for s in spreads]
    return np.concatenate(parts)


def levels(spread: Floats, largest: list[float]) -> list[Ints]:
    """Lower triangles (K, d (d + 1) / 2) as whole numbers, one array for each of its entries."""
    rows, columns = np.tril_indices(size_of(spread.shape[1]))
    deviation = _deviations(spread[:, rows == columns])
    found = []
    for entry, (i, j) in enumerate(zip(rows, columns, strict=True)):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if i == j:
                level = -FINE * np.log(deviation[:, i] / largest[i])
                top = FAINT
            else:
                share = spread[:, entry] / deviation[:, i] / deviation[:, j]
                level = ANGLE * np.arcsin(np.clip(share, -1, 1))
                top = 0
        # No logarithm or correlation of what has no deviation.
        level = np.nan_to_num(level, nan=top, posinf=top, neginf=top)
        found.append(np.rint(np.minimum(level, FAINT)).astype(np.int64))
    return found


def _deviations(variances: Floats) -> Floats:
    """Roots of what is a variance; of what overflowed there is no picture."""
    return np.sqrt(np.where(np.isfinite(variances), np.maximum(variances, 0.0), 0.0))
