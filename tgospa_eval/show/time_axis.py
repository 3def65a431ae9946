"""Time axes: positions of steps, ticks at round times, and their names."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.results.records import Json, Time

UNEVEN = 5.0
"""Largest ratio of the mean gap between steps to the typical gap, for an axis to scale. For a
larger ratio, steps are drawn at equal distances."""

TYPICAL_QUANTILE = 0.9
"""Quantile of the gaps between neighbouring steps that counts as the typical gap."""

DAY = 86_400.0
WHOLE = 2.0**53
"""Number below which a browser represents all integers exactly."""


def describe_times(times: Sequence[Time]) -> Json:
    """Describe the time axis for the document of the page.

    Parameters
    ----------
    times : sequence of int, float or str
        Times as they were read.

    Returns
    -------
    dict
        ``values`` has the positions on the axis, or is None for the kinds ``"number"`` and
        ``"step"``. For each ``kind``, the positions are:

        - ``"number"``: the times themselves
        - ``"stamp"``: differences between integer times and the first time, which is ``origin``
        - ``"date"``: seconds since midnight of the day ``origin``
        - ``"step"``: indices of the steps

        The kind is ``"step"`` for texts that are neither integers nor dates, and for times that do
        not increase or are very uneven.
    """
    kind, origin, values = "number", "", None
    if any(isinstance(t, str) or abs(t) >= WHOLE for t in times):
        kind, origin, values = _texts([str(t) for t in times])
    numbers = times if values is None else values
    if kind != "step" and uneven(np.asarray(numbers, float)):
        kind, origin, values = "step", "", None
    return {"kind": kind, "origin": origin, "values": values}


def readable(times: Sequence[Time]) -> list[Time]:
    """Return the times; numbers that a browser cannot represent exactly become texts."""
    return [t if isinstance(t, int | float) and abs(t) < WHOLE else str(t) for t in times]


def _texts(times: list[str]) -> tuple[str, str, list[float] | None]:
    try:
        whole = [int(t) for t in times]
    except ValueError:
        pass
    else:
        return "stamp", times[0], [float(t - whole[0]) for t in whole]
    try:
        dates = [datetime.fromisoformat(t.strip()) for t in times]
        zone = dates[0].tzinfo
        dates = [t.replace(tzinfo=UTC) if zone is None else t.astimezone(zone) for t in dates]
        first = dates[0].replace(hour=0, minute=0, second=0, microsecond=0)
        seconds = [(t - first).total_seconds() for t in dates]
    except (ValueError, TypeError, OverflowError):
        return "step", "", None
    return "date", first.strftime("%Y-%m-%d"), seconds


def _typical_gap(values: Floats) -> tuple[Floats, float]:
    """Return the differences of neighbouring values, and the typical difference."""
    gaps = np.diff(values / 2) * 2 if len(values) > 1 else np.ones(1)
    return gaps, float(np.quantile(gaps, TYPICAL_QUANTILE, method="lower"))


def uneven(values: Floats) -> bool:
    """Check whether times do not increase, or have too large gaps for an axis to scale."""
    gaps, typical = _typical_gap(values)
    if not (np.isfinite(gaps).all() and gaps.min() > 0):
        return True
    return bool(gaps.sum() > UNEVEN * typical * len(gaps))


# -------------------------------------------------------------------------------------------------
# Axes: ticks at round numbers, and room above lines.

ROOM = 1.05
"""Upper end of a vertical axis, relative to the highest value."""

CLOCK = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200)
"""Possible distances of ticks in seconds, if they are shorter than a day."""

DAYS = (1, 2, 5, 7, 14, 28, 91, 182, 364)
FORMS = "%Y-%m-%d", "%Y"


@dataclass(frozen=True, kw_only=True)
class TimeAxis:
    """Time axis: positions of the steps, and ticks.

    Parameters
    ----------
    times : sequence of int, float or str
        Times of all steps, as they were read.
    axis : dict
        Description of these times by `describe_times`.
    """

    times: Sequence[Time]
    axis: Json

    @classmethod
    def of(cls, times: Sequence[Time]) -> "TimeAxis":
        """Return the axis of times as they were read."""
        return cls(times=times, axis=describe_times(times))

    @cached_property
    def labels(self) -> list[str]:
        """Texts of the times."""
        return [f"{t:.12g}" if isinstance(t, float) else str(t) for t in self.times]

    @cached_property
    def at(self) -> Floats:
        """Position of each step on the axis."""
        if self.axis["kind"] == "step":
            return np.arange(len(self.times), dtype=float)
        return np.asarray(self.axis["values"] or self.times, float)

    @cached_property
    def edges(self) -> tuple[Floats, Floats]:
        """Begin and end of each step on the axis: halfway to the steps before and after it.

        If a neighbouring step is more than two typical gaps away, the distance on this side is half
        a typical gap.
        """
        if not len(self.at):
            return self.at, self.at
        gaps, typical = _typical_gap(self.at)
        near = np.where(gaps > 2 * typical, typical, gaps) / 2
        if len(self.at) == 1:
            return self.at - near, self.at + near
        before, after = np.append(near[:1], near), np.append(near, near[-1:])
        return self.at - before, self.at + after

    @cached_property
    def shared(self) -> str:
        """Common beginning of the texts of all times, such as the date; it can be empty."""
        if len(self.labels) < 2:
            return ""
        first, last = self.labels[0], self.labels[-1]
        same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), 0)
        return first[: max(first.rfind("T", 0, same), first.rfind(" ", 0, same)) + 1]

    def ticks(self, low: float, high: float, room: float) -> tuple[list[float], list[str], str]:
        """Return positions of ticks from `low` to `high`, their names, and the name of the axis.

        `room` is the length of the axis in characters, into which the names must fit.
        """
        if len(self.labels) == 1:
            return [(low + high) / 2], list(self.labels), "time"
        make = {"number": _numbers, "stamp": _numbers, "date": self._dates, "step": self._steps}
        for count in range(10, 1, -1):
            places, names, title = make[self.axis["kind"]](low, high, count)
            if len(places) * (max(map(len, names), default=0) + 2) <= room:
                break
        if self.axis["kind"] == "stamp":  # ticks only at integers, and not before the first time
            kept = [(at, f"{at:,.0f}") for at in places if at >= 0 and at == round(at)]
            places, names = [at for at, _ in kept], [name for _, name in kept]
            title = f"time from {self.axis['origin']}"
            names = [f"+{name}" if name != "0" else name for name in names]
        return places, names, title

    def _dates(self, low: float, high: float, count: int) -> tuple[list[float], list[str], str]:
        """Return ticks at round times of day or at days.

        If all ticks have the same day or year, this day or year is written only in the name of the
        axis.
        """
        places, size = _round_times(low, high, count)
        origin = datetime.fromisoformat(self.axis["origin"])
        try:
            times = [origin + timedelta(seconds=at) for at in (*places, low, high)]
        except OverflowError:  # a year after 9999
            return self._steps(low, high, count)
        one_day, one_year = (len({time.strftime(form) for time in times}) == 1 for form in FORMS)
        form = "" if one_day else "%m-%d " if one_year else "%Y-%m-%d "
        form += "" if size % DAY == 0 else "%H:%M" if size % 60 == 0 else "%H:%M:%S"
        digits = 0 if size >= 1 else min(math.ceil(-math.log10(size) - 1e-9), 6)
        names = [
            time.strftime(form).strip() + f".{time.microsecond:06d}"[: digits + 1 if digits else 0]
            for time in times[:-2]
        ]
        suffix = f", {origin:%Y-%m-%d}" if one_day else f", {origin:%Y}" if one_year else ""
        return places, names, f"time{suffix}"

    def _steps(self, low: float, high: float, count: int) -> tuple[list[float], list[str], str]:
        """Return ticks at steps whose indices are round numbers, for an axis of step indices."""
        first, last = max(math.ceil(low), 0), min(math.floor(high), len(self.labels) - 1)
        if last - first < count:
            steps = list(range(first, last + 1))
        else:
            steps = [round(at) for at in nice(first, last, count) if at == round(at)]
        names = [self.labels[step][len(self.shared) :] for step in steps]
        title = f"time {self.shared}…" if self.shared else "time"
        return [float(step) for step in steps], names, f"{title}, steps evenly spaced"


def _numbers(low: float, high: float, count: int) -> tuple[list[float], list[str], str]:
    """Return ticks at round numbers.

    If the numbers are large and close to each other, the ticks show differences to a round number.
    The name of the axis tells this number.
    """
    places, base = nice(low, high, count), 0.0
    if max(abs(low), abs(high)) > max(1e5, 1e3 * (high - low)):
        size = 10.0 ** math.ceil(math.log10(high - low)) if high > low else 1.0
        base = math.floor(low / size) * size
    names = [f"{place - base:.10g}" for place in places]
    return places, names, f"time − {base:.0f}" if base else "time"


def _round_times(low: float, high: float, count: int) -> tuple[list[float], float]:
    """Return positions of about `count` ticks at round times, and their spacing, in seconds."""
    raw = (high - low) / count * (1 - 1e-9)
    if raw <= CLOCK[0] or raw > DAYS[-1] * DAY:
        places = nice(low, high, count)
        return places, places[1] - places[0] if len(places) > 1 else 1e-3
    size = next(size for size in (*CLOCK, *(days * DAY for days in DAYS)) if size >= raw)
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    return [k * size for k in range(first, last + 1)], size


def nice(low: float, high: float, count: int) -> list[float]:
    """Return about `count` round numbers from `low` to `high`."""
    if not high > low:
        return [low]
    raw = (high - low) / max(count, 1)
    size = 10.0 ** math.floor(math.log10(raw))
    size *= next(factor for factor in (1, 2, 5, 10) if factor * size >= raw * (1 - 1e-9))
    first = math.ceil(low / size - 1e-9)
    return [k * size for k in range(first, math.floor(high / size + 1e-9) + 1)]
