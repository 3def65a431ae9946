"""What the page and the pictures of a result draw, as records; of many steps, thinned."""

from typing import TypeAlias

import numpy as np

from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.clock import moments, readable
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, Json
from tgospa_eval.results.summary import Summary
from tgospa_eval.tracks.covariances import size_of

NUMBERS = 150_000
"""Numbers of covariances that are encoded; beyond, those of every so many steps."""

FINE = 50
"""Levels of a deviation for a factor of e: 2 % each."""

FAINT = 1000
"""The level of what is not seen beside the largest deviation, as 0."""

ANGLE = 64
"""Levels of an angle for a radian."""


Drawn: TypeAlias = tuple[Json, dict[str, Ints]]
"""What page and pictures draw, by `page_data.document`: a document, and whole numbers by name.

Where the document has `together`, each of its `times` begins a stretch of so many steps, of which
`costs` and `counts` are means, and `curve` is that of its last step. `stretch` is that of a map.
`spread` says how the numbers of ellipses are to be read; it is empty where there are none.
"""


def described(spreads: list[Floats], stride: int) -> Json:
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


def encoded(track: Ints, step: Ints, spread: Floats, how: Json) -> dict[str, Ints]:
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


MOST_STRETCHES = 600
"""Stretches of steps that are drawn of a recording of any length."""


def curves(result: Summary) -> dict[str, list[float]]:
    """Normalised cumulative cost: at step k the root of the mean cost of the steps up to it.

    (sum_{l <= k} cost(l) / n(k)) ^ (1/p), n(k) the number of steps of the horizon up to k; the
    last value of ``total`` is `normalised`. Where the curve was asked for, costs are
    those of the steps 1..k; else of the assignment of the whole recording, which bound the metric
    of the steps 1..k from above.
    """
    split, steps = result.proof.breakdown, np.maximum(result.judged_on.so_far, 1)
    if result.traced is not None:
        parts = dict(zip(PARTS, result.traced.parts, strict=True))
    else:
        parts = {name: np.cumsum(getattr(split, name)) for name in PARTS}
    parts["total"] = sum(parts.values(), np.zeros(len(steps)))
    parameters = result.proof.parameters
    return {
        name: (parameters.cutoff * (cost / steps) ** (1 / parameters.order)).tolist()
        for name, cost in parts.items()
    }


def rounded(values: list[float]) -> list[float]:
    """Seven digits, which is more than is shown."""
    exact = np.array(values, float)
    size = np.where(exact == 0, 1.0, np.abs(exact))
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are hardly any
        factor = 10.0 ** (6 - np.floor(np.log10(size)))
        rounded = np.rint(exact * factor) / factor
    shortest: list[float] = np.where(np.isfinite(rounded), rounded, exact).tolist()
    return shortest


def over_time(result: Summary, together: int = 1) -> Json:
    """What is drawn over time, of so many steps at a time: means, and the curve at the last."""
    steps = len(result.labels.times)
    first = np.arange(0, steps, together)
    last = np.minimum(first + together, steps) - 1
    times = readable([result.labels.times[k] for k in first.tolist()])
    split, parameters = result.proof.breakdown, result.proof.parameters

    def mean(values: Floats) -> list[float]:
        sums = np.add.reduceat(values, first) if steps else values
        return rounded((sums / (last - first + 1)).tolist())

    return {
        "times": times,
        "axis": moments(times),
        "costs": {name: mean(result.scale * getattr(split, name)) for name in PARTS},
        "counts": {name: mean(getattr(split, f"{name}_count")) for name in COUNTED_PARTS},
        "curve": {
            name: rounded([values[k] for k in last.tolist()])
            for name, values in curves(result).items()
        },
        "cutoff": parameters.cutoff,
        "order": parameters.order,
        "unit": result.labels.unit or "",
    }


def thinned(result: PartitionedResult) -> Drawn:
    """What is drawn of a result of data in parts: its costs over time, and no tracks."""
    together = max(1, -(-len(result.labels.times) // MOST_STRETCHES))
    names = ("run/track", "run/begin", "run/end", "run/other", "row/track", "row/step", "row/error")
    data = over_time(result, together) | {
        "together": together,
        "tracks": {"truth": {"id": []}, "estimate": {"id": []}},
        "switches": {},
        "columns": [],
        "boxes": False,
        "spread": {},
        "errors": 1,
    }
    none = np.zeros(0, np.int64)
    return data, {f"{side}/{name}": none for side in ("truth", "estimate") for name in names}
