"""Warnings about the times of two sides: stamps that miss each other, other clocks, other units.

They cost little beside an evaluation of sound data: they look at the stamps and at some steps that
are sampled evenly. Only where these do not fit is the offset of the clock searched for.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, median
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, number, plain, shortest
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.costs import (
    Sample,
    StepRows,
    step_costs,
)
from tgospa_eval.evaluation.diagnosis.offset import Fit, Search, sharpest, significance
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.text import option
from tgospa_eval.tracks.alignment import Alignment, TimeMatching, Times, nearest, within
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from fractions import Fraction

    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest

COMMON_SHARE = 0.9
"""Share of common steps below which something is probably wrong with the clocks."""

NEARLY = 0.01
"""Of the median step: unmatched stamps that are closer are probably meant to be the same."""

POWERS = {-3: "milliseconds", -6: "microseconds", -9: "nanoseconds"}
"""What stamps beside seconds may be counted in, by the power of ten that makes seconds of them."""

WORTH = 0.5
"""Share of the cost that another clock must save to be warned of."""

SUSPICIOUS = 3.0
"""Standard errors by which a step earlier or later fits better where the clock is looked at."""

MOVES = np.array([[1], [-1]])
"""Steps by which the estimate is moved to see that."""

PREFERRED = 2.0
"""Times the uncertainty, within which an offset that makes stamps equal, or a whole hour, is it."""

MINUTE = 60
"""Seconds: an offset that is less certain is not taken for whole hours."""

HOURS = 14
"""By which time zones differ, at most."""

RATES = 3.0
"""Rates of two files differ by no more where only the unit of their stamps does."""


def clock_warnings(
    sides: "AlignedPair", request: "EvaluationRequest", sample: Sample
) -> list[Notice]:
    """What looks wrong with the times of the two sides; parameters as of `diagnose`."""
    found = [_few_common(sides, request.time_matching)]
    clock = None
    if not _looks_sound(sample):
        clock = find_clock(sides.given, sample.parameters, sample.distance, request.recorded)
    if clock is not None and clock.saving >= WORTH:
        found.append(_clock_warning(clock, sides.given[0].clock))
    elif unit := _unit_of_time(sides.given):
        return [unit]
    else:
        times = sides.read[0].times, sides.read[1].times
        found.append(_near_misses(times, sides.alignment, request.time_matching))
    return [notice for notice in found if notice]


def _unit_of_time(sides: "tuple[Trajectories, Trajectories]") -> Notice | None:
    """Stamps of no common stretch of time, but for a power of ten."""
    truth, estimate = (side.times for side in sides)
    if sides[0].clock != "number" or not len(truth) or not len(estimate):
        return None
    first, last = float(truth[0]), float(truth[-1])
    begin, end = float(estimate[0]), float(estimate[-1])
    if begin <= last and first <= end:
        return None
    for power in (*POWERS, *(-power for power in POWERS)):
        low, high = (moment * 10.0**power for moment in (begin, end))
        shared = min(last, high) - max(first, low)
        if first > 0 and shared >= 0.5 * min(last - first, high - low) > 0:
            scale = float(f"1e{power}")
            return Notice(
                code="clock-shift",
                text="the stamps of both files have no time in common, and those of the estimate "
                f"are of the same stretch of time if they are multiplied by {plain(scale)}",
                remedy=option("time_scale", plain(scale)),
            )
    return None


def _few_common(sides: "AlignedPair", matching: TimeMatching) -> Notice | None:
    aligned, outages = sides.alignment, sides.axis.outages
    steps, meaning = len(aligned.truth.times), "what exists at another is missed or false"
    if matching.grid == "common":  # of two rates the lower one may be wholly in the other
        steps, meaning = min(len(side.times) for side in sides.read), "the others are left out"
    if outages is not None and outages.charged:  # which has a warning of its own
        steps -= len(outages.ticks)
    if not steps or aligned.common >= COMMON_SHARE * steps:
        return None
    share = f"{100 * aligned.common / steps:.0f} %"
    return Notice(
        code="steps-unmatched",
        text=f"only {share} of the steps are in both files, and {meaning}",
        remedy=f"if the clocks differ, see {option('time_tolerance')}, {option('time_offset')} and "
        f"{option('resample')}",
    )


def _near_misses(
    times: tuple[Times, Times], aligned: Alignment, matching: TimeMatching
) -> Notice | None:
    """Stamps that are not the same, and closer than 1 % of the median step."""
    if aligned.common == aligned.union or not all(map(len, times)):
        return None
    steps = [step for step in map(median_step, times) if step is not None]
    if not steps:
        return None
    clock = aligned.truth.clock
    _, _, apart = nearest(*times)
    is_close = (apart < NEARLY * min(steps)) & ~within(apart, matching.near, times, clock)
    close = apart[is_close & (apart > 0)]
    if not len(close):
        return None
    unit = SECOND if clock != "number" else 1
    most = float(close.max())
    if close.dtype.kind == "f":  # `within` allows for the rounding of the stamps
        most = max(most - max(float(np.spacing(np.abs(side).max())) for side in times), 0.5 * most)
    named = _rounded_up(most / unit)
    pairs = counted(len(close), "pair of stamps is", "pairs of stamps are")
    others = aligned.union - aligned.common
    return Notice(
        code="stamps-near",
        text=f"{pairs} nearly the same, of {counted(others, 'stamp')} that one file only has, at "
        f"most {named} apart where the median step is {_step_text(min(steps), clock, *times)}",
        remedy=f"{option('time_tolerance', float(named))} makes each pair one step",
    )


def median_step(times: Times) -> float | None:
    """Median distance of consecutive times, in the unit in which they are held."""
    if len(times) < 2:
        return None
    return median(np.diff(times.astype(np.float64) if times.dtype.kind == "f" else times))


def _step_text(step: float, clock: str, *times: Times) -> str:
    """A step between stamps, in their unit or in seconds, without what rounding them adds to it."""
    floats = [side for side in times if side.dtype.kind == "f"]
    noise = 2 * max((float(np.spacing(np.abs(side).max())) for side in floats), default=0.0)
    return number(shortest(step if clock == "number" else step / SECOND, noise))


def _rounded_up(value: float) -> str:
    """Two digits, not below the value but for the last digit of a double."""
    from decimal import ROUND_CEILING, Context

    rounded = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{value:.15g}")
    return f"{float(rounded):.15g}"


@dataclass(frozen=True, kw_only=True)
class ClockError:
    """What makes the stamps of the estimate those of the truth.

    Parameters
    ----------
    time_scale, time_offset : float
        What they are to be multiplied by, and what is to be added then; the offset in the unit of
        the stamps, seconds for ISO times.
    ahead : float
        How far they are ahead, where only that is wrong; 0 otherwise.
    uncertainty : float
        Two standard errors of the offset.
    saving : float
        Share of the per-step GOSPA cost that goes away, without what is missed or false either way.
    steps : int
        Steps that were looked at.
    """

    time_scale: float
    time_offset: float
    ahead: float
    uncertainty: float
    saving: float
    steps: int


def _looks_sound(sample: Sample) -> bool:
    """Whether a few steps that both sides have fit, and no better one step earlier or later."""
    here = Fit(0.0, sample.here)
    if not here.is_close:
        return False
    estimate, (truth, _), count = sample.sides[1], sample.rows, len(sample.steps)
    moved = (sample.steps + MOVES).clip(0, len(estimate.times) - 1)
    truths = StepRows(side=truth.side, bounds=np.tile(truth.bounds, len(MOVES)))
    estimates = StepRows.of(estimate, moved.ravel())
    both = step_costs(truths, estimates, sample.parameters, sample.distance)
    cut = int(both.step[both.taken].searchsorted(count))
    sharp = max(here.sharpest, *map(sharpest, np.split(both.lost, [cut])))
    here, others = (Fit(0.0, costs, sharp=sharp) for costs in (sample.here, both))
    gains = others.gain.reshape(len(MOVES), count)
    return all(significance(gain - here.gain) <= SUSPICIOUS for gain in gains)


def find_clock(
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    distance: Distance,
    given: Mapping[str, object],
) -> ClockError | None:
    """Another clock of the estimate, where that fits better than all others; else None.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as read.
    parameters, distance
        Cutoff and order; base distance of states without covariances.
    given : mapping of str to object
        A `time_scale` and a `time_offset` with which the estimate was read.
    """
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    truth, estimate = sides
    steps = [median_step(side.times) or 0.0 for side in sides]
    if not all(steps):
        return None
    own = _since(truth.times, Fraction(1), Fraction(truth.times[0].item()))
    plain: Search | None = None
    for power in (0, *POWERS, *(-power for power in POWERS)):
        factor = Fraction(10) ** power
        if power and not 1 / RATES <= steps[1] * float(factor) / steps[0] <= RATES:
            continue
        theirs = _since(estimate.times, factor, Fraction(truth.times[0].item()))
        search = Search(sides, (own, theirs), parameters, distance)
        if not search.is_possible:
            return None
        unit = 1 if truth.clock == "number" else SECOND
        ends = own[0] - theirs[0], own[-1] - theirs[-1]
        zones = (3600.0 * unit * hours for hours in range(-HOURS, HOURS + 1) if hours)
        found = search.offset((*ends, *zones), plain)
        if found is not None:
            return _clock(search, *found, factor, given)
        plain = plain or search
    return None


def _since(times: Times, factor: "Fraction", begin: "Fraction") -> Floats:
    """Times, multiplied, since a moment; exact before they are rounded to doubles."""
    from fractions import Fraction  # lazy: as in `find_clock`

    first = times[0].item()
    if times.dtype.kind == "i":
        whole = times.astype(np.int64).view(np.uint64)
        apart = np.asarray(whole - whole[0], np.float64)
    else:
        apart = np.asarray(times - times[0], np.float64)
    return apart * float(factor) + float(Fraction(first) * factor - begin)


def _clock(
    search: Search,
    shift: float,
    uncertainty: float,
    saving: float,
    factor: "Fraction",
    given: Mapping[str, object],
) -> ClockError:
    """The offset as it is to be written: of such that fit as well the plainest one."""
    from fractions import Fraction  # lazy: as in `find_clock`

    unit = 1 if search.truth.clock == "number" else SECOND
    hour, near = 3600 * unit, PREFERRED * uncertainty
    hours = round(shift / hour)
    if 0 < abs(hours) <= HOURS and abs(hours * hour - shift) <= near < MINUTE * unit:
        offset = Fraction(hours * hour)
    else:
        offset = _same_moments(search, shift, uncertainty, factor) or Fraction(
            _rounded(shift, uncertainty)
        )
    uncertainty += abs(float(offset) - shift)
    scaled, added = (
        Fraction(repr(given.get(name, neutral)))
        for name, neutral in (("time_scale", 1.0), ("time_offset", 0.0))
    )
    return ClockError(
        time_scale=float(f"{float(scaled * factor):.12g}"),
        time_offset=float(f"{float(added * factor + offset / unit):.12g}"),
        ahead=-float(f"{float(offset / unit):.12g}") if factor == 1 else 0.0,
        uncertainty=float(f"{uncertainty / unit:.2g}"),
        saving=saving,
        steps=len(search.steps),
    )


def _same_moments(
    search: Search, shift: float, uncertainty: float, factor: "Fraction"
) -> "Fraction | None":
    """The offset that makes the stamps those of the truth, if one within the uncertainty does."""
    from fractions import Fraction  # lazy: as in `find_clock`

    own, theirs = search.moments[0], search.moments[1][search.steps] + shift
    after = np.searchsorted(own, theirs).clip(1, len(own) - 1)
    at = after - (theirs - own[after - 1] <= own[after] - theirs)
    apart = own[at] - theirs
    k = int(np.argsort(apart, kind="stable")[len(apart) // 2])
    step = median_step(own) or 0.0
    same = np.abs(apart - apart[k]) <= NEARLY * step
    if abs(apart[k]) > PREFERRED * uncertainty or np.count_nonzero(same) < COMMON_SHARE * len(
        apart
    ):
        return None
    first, second = search.truth.times[at[k]], search.estimate.times[search.steps[k]]
    return Fraction(first.item()) - factor * Fraction(second.item())


def _rounded(value: float, noise: float) -> float:
    """Without digits that are far below the noise."""
    digits = math.ceil(-math.log10(noise / 2))
    return round(value, digits)


def _clock_warning(clock: ClockError, kind: str) -> Notice:
    cures = [] if clock.time_scale == 1 else [option("time_scale", plain(clock.time_scale))]
    if clock.time_offset:
        cures.append(option("time_offset", plain(clock.time_offset)))
    return Notice(
        code="clock-shift",
        text=f"the clock of the estimate seems to {_clock_text(clock, kind)}: without that the "
        f"per-step GOSPA cost of {counted(clock.steps, 'step')}, but for what is missed or false "
        f"either way, falls by {min(100 * clock.saving, 99):.0f} %",
        remedy=f"write the stamps of both files by one clock, or use {' '.join(cures)}; a latency "
        "of the tracker is rightly an error, and a constant offset in the direction of travel "
        "looks the same",
    )


def _clock_text(clock: ClockError, kind: str) -> str:
    if clock.ahead:
        way = "ahead" if clock.ahead > 0 else "behind"
        name = "" if kind == "number" else " s"
        return f"be {abs(clock.ahead):.10g}{name} {way} (+/- {clock.uncertainty:g}{name})"
    power = round(math.log10(clock.time_scale))
    small, times = POWERS[-abs(power)], f"{10 ** abs(power):,} times"
    if power < 0:
        return f"run {times} as fast as that of the truth, like {small} beside seconds"
    return f"run {times} slower than that of the truth, like seconds beside {small}"
