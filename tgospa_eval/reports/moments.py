"""Where steps lie on an axis of time: numbers as they are, dates in seconds, stamps from the first.

Where a few gaps would take most of the axis, or times are no times, steps are evenly spaced.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TypedDict

import numpy as np

from tgospa_eval.problem.problem import Floats
from tgospa_eval.results.records import Time

UNEVEN = 5.0
"""How much longer than its steps a recording may be to be drawn to scale."""

USUAL = 0.9
"""Quantile of the gaps that counts as one between neighbours."""

DAY = 86_400.0
WHOLE = 2.0**53
"""Below this whole numbers differ in a browser."""


class TimeAxis(TypedDict):
    """How times are drawn: a kind, where it begins, and places where they are not the times."""

    kind: str
    origin: str
    values: list[float] | None


def moments(times: Sequence[Time]) -> TimeAxis:
    """How times are drawn, as a part of the document of the page.

    Parameters
    ----------
    times : sequence of int, float or str
        As they were read.

    Returns
    -------
    dict
        ``kind``: ``"number"``; ``"stamp"``, whole numbers from the first, which is ``origin``;
        ``"date"``, seconds since midnight of the day ``origin``; or ``"step"``, numbers of steps.
        ``values``: None for numbers and steps.
    """
    kind, origin, values = "number", "", None
    if any(isinstance(t, str) or abs(t) >= WHOLE for t in times):
        kind, origin, values = _texts([str(t) for t in times])
    numbers = times if values is None else values
    if kind != "step" and uneven(np.asarray(numbers, float)):
        kind, origin, values = "step", "", None
    return {"kind": kind, "origin": origin, "values": values}


def readable(times: Sequence[Time]) -> list[Time]:
    """Times as they were read; what is beyond the whole numbers of a browser is a text to it."""
    return [t if isinstance(t, int | float) and abs(t) < WHOLE else str(t) for t in times]


def placed(times: Sequence[Time], axis: TimeAxis) -> Floats:
    """Where each step is on the axis that `moments` describes."""
    if axis["kind"] == "step":
        return np.arange(len(times), dtype=float)
    return np.asarray(axis["values"] or times, float)


def _texts(times: list[str]) -> tuple[str, str, list[float] | None]:
    try:
        whole = [int(t) for t in times]
    except ValueError:
        pass
    else:
        return "stamp", times[0], [float(t - whole[0]) for t in whole]
    try:
        found = [datetime.fromisoformat(t.strip()) for t in times]
        zone = found[0].tzinfo
        found = [t.replace(tzinfo=UTC) if zone is None else t.astimezone(zone) for t in found]
        first = found[0].replace(hour=0, minute=0, second=0, microsecond=0)
        seconds = [(t - first).total_seconds() for t in found]
    except (ValueError, TypeError, OverflowError):
        return "step", "", None
    return "date", first.strftime("%Y-%m-%d"), seconds


def _usual(values: Floats) -> tuple[Floats, float]:
    """Gaps between steps, and how long they usually are."""
    gaps = np.diff(values / 2) * 2 if len(values) > 1 else np.ones(1)
    return gaps, float(np.quantile(gaps, USUAL, method="lower"))


def uneven(values: Floats) -> bool:
    """Whether gaps would take most of an axis, or values do not grow."""
    gaps, usual = _usual(values)
    if not (np.isfinite(gaps).all() and gaps.min() > 0):
        return True
    return bool(gaps.sum() > UNEVEN * usual * len(gaps))


def edges(values: Floats) -> tuple[Floats, Floats]:
    """Where each step begins and ends on the axis: in the middle between it and its neighbours.

    Beside a gap it ends as beside a neighbour.
    """
    if not len(values):
        return values, values
    gaps, usual = _usual(values)
    near = np.where(gaps > 2 * usual, usual, gaps) / 2
    if len(values) == 1:
        return values - near, values + near
    before, after = np.append(near[:1], near), np.append(near, near[-1:])
    return values - before, values + after
