"""Warnings about the times of two sides: stamps that miss each other, other clocks, other units.

They cost little beside an evaluation: they look at the stamps, and at some steps that are sampled
evenly, of which bounds settle all but suspicious cases.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import median, places_of
from tgospa_eval.common.figures import number, plain, shortest
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, Spelling
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.costs import (
    Sampler,
    falls,
    saving,
    saving_of_tracks,
    step_costs,
)
from tgospa_eval.evaluation.diagnosis.sample import (
    FEWEST_STEPS,
    FIRST_STEPS,
    SAMPLE,
    StepRows,
    affordable,
    evenly,
    occupied,
)
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.alignment import SECOND, Alignment, TimeMatching, Times, nearest, within
from tgospa_eval.tracks.trajectories import Ints, Trajectories

COMMON_SHARE = 0.9
"""Share of common steps below which something is probably wrong with the clocks."""

NEARLY = 0.01
"""Of the median step: unmatched stamps that are closer are probably meant to be the same."""

STEPS_OFF = 10
"""Steps by which a clock may be off, beside those that make the first or the last stamps equal."""

SAME = 0.1
"""Of the median step: stamps that are so close after a change of the clock are the same moment."""

POWERS = {-3: "milliseconds", -6: "microseconds", -9: "nanoseconds"}
"""What stamps beside seconds may be counted in, by the power of ten that makes seconds of them."""

MORE = 0.1
"""Share of the cost that another clock must save beyond a shift by one step to be named."""

RATES = 3.0
"""Rates of two files differ by no more where only the unit of their stamps does."""


@dataclass(frozen=True, kw_only=True)
class Shift:
    """That the estimate fits much better when its states are moved by one step.

    Parameters
    ----------
    late : bool
        Whether the estimate comes a step too late, rather than too early.
    saving : float
        Share of the per-step GOSPA cost that goes away, at least one half.
    steps : int
        Steps that were looked at.
    of_tracks : bool
        Whether that is of common tracks alone, as of `saving_of_tracks`.
    """

    late: bool
    saving: float
    steps: int
    of_tracks: bool


def clock_warnings(
    sides: tuple[Trajectories, Trajectories],
    aligned: Alignment,
    matching: TimeMatching,
    sampler: Sampler,
    spell: Spelling,
) -> list[Notice]:
    """What looks wrong with the times of the two sides; parameters as of `diagnose`."""
    near = _near_misses((sides[0].times, sides[1].times), aligned, matching, spell)
    found = [_few_common(sides, aligned, matching, spell), near]
    if near is None:  # else the next step is the same moment: no shift
        shift = find_shift(aligned, sampler.parameters, sampler.distance)
        clock = _find_clock(sides, aligned, sampler)
        if clock is not None and (shift is None or clock.saving > shift.saving + MORE):
            found.append(_clock_warning(clock, sides, spell))
        elif shift is not None:
            found.append(_shift_warning(shift, aligned.truth, spell))
    return [notice for notice in found if notice]


def _few_common(
    sides: tuple[Trajectories, Trajectories],
    aligned: Alignment,
    matching: TimeMatching,
    spell: Spelling,
) -> Notice | None:
    steps, meaning = len(aligned.truth.times), "what exists at another is missed or false"
    if matching.grid == "common":  # of two rates the lower one may be wholly in the other
        steps, meaning = min(len(side.times) for side in sides), "the others are left out"
    if not steps or aligned.common >= COMMON_SHARE * steps:
        return None
    share = f"{100 * aligned.common / steps:.0f} %"
    return Notice(
        code="steps-unmatched",
        text=f"only {share} of the steps are in both files, and {meaning}",
        remedy=f"if the clocks differ, see {spell('time_tolerance', '')}, "
        f"{spell('time_offset', '')}, {spell('interpolate', '')} and {spell('grid', '')}",
    )


def _near_misses(
    times: tuple[Times, Times], aligned: Alignment, matching: TimeMatching, spell: Spelling
) -> Notice | None:
    """Stamps that are not the same, and closer than 1 % of the median step."""
    if aligned.common == aligned.union or not all(map(len, times)):
        return None
    steps = [step for step in map(median_step, times) if step is not None]
    if not steps:
        return None
    clock = aligned.truth.clock
    apart = nearest(*times).apart
    is_close = (apart < NEARLY * min(steps)) & ~within(apart, matching.tolerance, times, clock)
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
        remedy=f"{spell('time_tolerance', float(named))} makes each pair one step",
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


def _shift_warning(shift: Shift, truth: Trajectories, spell: Spelling) -> Notice:
    way, cure, where = (
        ("late", "earlier", "backward") if shift.late else ("early", "later", "forward")
    )
    step = median_step(truth.times)
    long = "" if step is None else _step_text(step, truth.clock, truth.times)
    size = f" ({long})" if long else ""
    offset = spell("time_offset", plain(float(f"{'-' * shift.late}{long or 1}".replace(",", ""))))
    of_tracks = ", of tracks that are there before and after, without what is missed or false"
    return Notice(
        code="clock-shift",
        text=f"the estimate seems {way} by a step{size} or more: with its states one step {cure} "
        + falls(shift.saving, shift.steps)
        + of_tracks * shift.of_tracks,
        remedy="check from where the two files count their steps, and what moment a stamp means: "
        f"{offset} moves the estimate by such a step; a constant offset {where} in the direction "
        "of travel looks the same",
    )


def find_shift(aligned: Alignment, parameters: Parameters, distance: Distance) -> Shift | None:
    """Whether moving the estimate by one step at least halves the cost, or that of common tracks.

    Few steps rule that out for most recordings; where they do not, more are asked.
    """
    inside = len(aligned.truth.times) - 2  # each of these has a step before and one after
    count = min(inside, affordable((aligned.truth, aligned.estimate)))
    if count < FEWEST_STEPS:
        return None
    shift = _shift_of(aligned, parameters, distance, min(count, FIRST_STEPS))
    return (
        shift
        if shift is None or count <= FIRST_STEPS
        else _shift_of(aligned, parameters, distance, count)
    )


def _shift_of(
    aligned: Alignment, parameters: Parameters, distance: Distance, count: int
) -> Shift | None:
    """The same, of so many steps."""
    inside = len(aligned.truth.times) - 2
    steps = 1 + np.arange(count) * inside // count
    truth = StepRows.of(aligned.truth, steps)
    estimate = StepRows.of(aligned.estimate, steps)
    here = step_costs(truth, estimate, parameters, distance)
    for late in (True, False):
        moved = StepRows.of(aligned.estimate, steps + (1 if late else -1))
        there = step_costs(truth, moved, parameters, distance)
        saved = saving(here, there)
        of_tracks = not saved
        if of_tracks:
            saved = saving_of_tracks(here, there, (estimate.track, moved.track))
        if saved:
            return Shift(late=late, saving=saved, steps=count, of_tracks=of_tracks)
    return None


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Another clock: time since the first stamp of the estimate, times a factor, plus an offset.

    That is the time since the first stamp of the truth.

    Parameters
    ----------
    factor, offset : float
        In the unit in which the times are held.
    ahead : float
        How far the stamps of the estimate are ahead, where the factor is 1.
    saving : float
        Share of the per-step GOSPA cost that goes away.
    steps : int
        Steps that were looked at.
    """

    factor: float
    offset: float
    ahead: float = 0.0
    saving: float = 0.0
    steps: int = 0


def _clock_warning(
    clock: Clock, sides: tuple[Trajectories, Trajectories], spell: Spelling
) -> Notice:
    kind = sides[0].clock
    return Notice(
        code="clock-shift",
        text=f"the clock of the estimate seems to {_clock_text(clock, kind)}: without that "
        + falls(clock.saving, clock.steps),
        remedy=f"write the stamps of both files by one clock{_cure(clock, sides, spell)}; "
        "a latency of the tracker is rightly an error",
    )


def _cure(clock: Clock, sides: tuple[Trajectories, Trajectories], spell: Spelling) -> str:
    """The settings that make the stamps of the estimate those of the truth."""
    from fractions import Fraction  # here: as in `_clocks`

    truth, estimate = sides
    unit = 1 if truth.clock == "number" else SECOND
    starts = (Fraction(side.times[0].item()) for side in (truth, estimate))
    factor = Fraction(f"{clock.factor:.12g}")  # a power of ten, not the double next to it
    offset = next(starts) + Fraction(clock.offset) - factor * next(starts)
    step = median_step(truth.times) or 0.0
    cures = [] if factor == 1 else [spell("time_scale", plain(float(factor)))]
    if abs(offset) > SAME * step:
        cures.append(spell("time_offset", plain(float(f"{float(offset / unit):.12g}"))))
    return f", or use {' '.join(cures)}" if cures else ""


def _find_clock(
    sides: tuple[Trajectories, Trajectories],
    aligned: Alignment,
    sampler: Sampler,
) -> Clock | None:
    """Another unit of time, or another start of the clock, where that explains the cost."""
    truth, estimate = sides
    if len(truth.times) < 2 or len(estimate.times) < 2:
        return None
    filled = places_of(occupied(truth))
    for most, times in ((FIRST_STEPS, 4), (SAMPLE, 2)):  # what few steps rule out is not asked more
        steps = evenly(filled, sides, most)
        if len(steps) < FEWEST_STEPS:
            return None
        own = np.searchsorted(aligned.truth.times, truth.times[steps])
        if own[-1] >= len(aligned.truth.times) or aligned.truth.step.shape != truth.step.shape:
            return None  # a grid that leaves out steps of the truth
        here = sampler.costs(own, keep=True)
        if times * here.upper.sum() < here.unassigned.sum():
            return None
    here = replace(here)  # what is kept is not changed
    chosen = StepRows.of(truth, steps)
    step = median_step(truth.times) or 0.0
    moments, theirs = map(_from_first, (truth.times, estimate.times))
    firsts = truth.times[0].item(), estimate.times[0].item()
    best: Clock | None = None
    for clock in _clocks((moments, theirs), firsts, step):
        at, is_there = _same_moments(moments[steps], theirs * clock.factor + clock.offset, step)
        if np.count_nonzero(is_there) < FEWEST_STEPS / 2:
            continue
        moved = StepRows.of(estimate, at).only(is_there)
        there = step_costs(chosen, moved, sampler.parameters, sampler.distance)
        saved = saving(here, there)
        if saved > (best.saving if best else 0.0):
            best = replace(clock, saving=saved, steps=len(steps))
    return best


def _from_first(times: Times) -> Floats:
    """Times since the first; exact before they are rounded to doubles, however far apart."""
    if times.dtype.kind == "i":
        unsigned = times.astype(np.int64).view(np.uint64)
        return np.asarray(unsigned - unsigned[0], np.float64)
    return np.asarray(times - times[0], np.float64)


def _clocks(
    times: tuple[Floats, Floats], firsts: tuple[float, float], step: float
) -> Iterator[Clock]:
    """What may be wrong: times of both sides since their first stamps, and these stamps."""
    from fractions import Fraction  # here: slow to import, and most clocks agree

    starts = Fraction(firsts[0]), Fraction(firsts[1])
    moments, theirs = times
    own = median_step(theirs) or step
    for power in (*POWERS, *(-power for power in POWERS)):
        factor = Fraction(10) ** power
        if 1 / RATES <= own * float(factor) / step <= RATES:
            since = float(starts[1] * factor - starts[0])  # both count from one moment
            yield from (Clock(factor=float(factor), offset=offset) for offset in (since, 0.0))
    apart = float(starts[1] - starts[0])
    ends = (0.0, float(moments[-1] - theirs[-1]))
    moves = [apart + sign * k * step for k in range(1, STEPS_OFF + 1) for sign in (1, -1)]
    for offset in (*ends, *moves):
        if offset != apart:
            yield Clock(factor=1.0, offset=offset, ahead=apart - offset)


def _same_moments(wanted: Floats, theirs: Floats, step: float) -> tuple[Ints, NDArray[np.bool_]]:
    """The step of the estimate nearest to each moment, and whether it is the same moment."""
    after = np.searchsorted(theirs, wanted).clip(1, len(theirs) - 1)
    at = after - (wanted - theirs[after - 1] <= theirs[after] - wanted)
    return at, np.asarray(np.abs(theirs[at] - wanted) <= SAME * step)


def _clock_text(clock: Clock, kind: str) -> str:
    if clock.factor == 1.0:
        way = "ahead" if clock.ahead > 0 else "behind"
        unit, name = (1, "") if kind == "number" else (SECOND, " s")
        return f"be {abs(clock.ahead) / unit:.10g}{name} {way}"
    power = round(math.log10(clock.factor))
    small, times = POWERS[-abs(power)], f"{10 ** abs(power):,} times"
    if power < 0:
        return f"run {times} as fast as that of the truth, like {small} beside seconds"
    return f"run {times} slower than that of the truth, like seconds beside {small}"
