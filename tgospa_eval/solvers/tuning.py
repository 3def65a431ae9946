"""Tuned numbers of the certified solver, each with what chose it.

Nothing here decides what is proven: any prices bound the optimum from below and any feasible
weights from above. The numbers decide how soon both meet. Measurements are in the
log of changes; "not measured" says that a round number was taken.
"""

import numpy as np

from tgospa_eval.errors import ConfigError, real_number, whole_number


def check_settings(
    solver: object, *, gap: float = 0.0, time_limit: float | None = None, jobs: int | None = None
) -> None:
    """Check settings that solvers have in common, and make plain numbers of them.

    Raises
    ------
    ConfigError
        The gap is no number, negative or infinite; the limit is no number, infinite, zero or
        negative; or the threads are no whole number of at least 1.
    """
    gap = real_number("gap", gap)
    if not 0 <= gap < np.inf:
        raise ConfigError(f"gap is {gap:g}: must be finite and 0 or more")
    if time_limit is not None:
        time_limit = real_number("time limit", time_limit)
        if not 0 < time_limit < np.inf:
            raise ConfigError(f"time limit is {time_limit:g} s: must be finite and more than 0")
    if jobs is not None:
        jobs = whole_number("jobs", jobs)
    plain = {"gap": gap, "time_limit": time_limit, "jobs": jobs}
    vars(solver).update({name: plain[name] for name in plain.keys() & vars(solver).keys()})


Stage = tuple[float, int]
"""A temperature, as a fraction of c^p, and how many sweeps are made at it."""


class Ascending:
    """Sweeps, before anything is left to programmes."""

    stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 64),
        (0.005, 64),
        (0.002, 64),
        (0.001, 64),
    )
    """64 sweeps at small temperatures cost nearly nothing beside a programme, and bring the dual
    value to 1e-5 of itself; programmes after 16 at 0.02 took 2 to 4 times the whole time."""

    small: int = 10_000
    small_stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 16),
        (0.003, 32),
        (0.001, 64),
    )
    """Of a problem with at most so many states. There a programme costs four stages, whatever its
    size, and the sweeps of a stage hardly more than the rest of it: 10 x 10 x 50 in a square of 100
    with c = 10 takes 0.77, 20,50,20,1 0.9 of the time."""

    resumed: tuple[Stage, ...] = ((0.01, 32), (0.005, 32), (0.002, 64), (0.001, 64))
    """From a warm start nearby: a tenth of the time from afar, on curves."""

    repeats: int = 16
    settled: float = 0.015
    gained: float = 0.001
    """A stage that leaves columns violated by more than `settled`, and took more than the fraction
    `gained` of the cost off the dual value, is repeated with a new working set; without that, more
    sweeps only drive prices to where states that are left out win. At cutoffs of many errors 0.01
    is far from settled after 64 sweeps: 100,60,150,2 with c = 50 takes 2.5 instead of 10 s."""

    free: float = 8.0
    """Where half a switch costs less than the last temperature, all steps are solved apart first.
    If that leaves less than `Programming.nearly` of the cost, temperatures are fractions of this
    times half a switch. Not measured."""

    calm: float = 0.1
    calm_above: float = 0.01
    """Above the temperature, columns violated by less are good enough to go on: a third of the
    sweeps on sparse scenes."""

    skip: float = 0.01
    skip_above: float = 0.02
    skip_above_large: float = 0.05
    """Brackets narrower than this fraction of the cost skip a stage above the temperature; a large
    problem has hard spots however narrow the bracket of the whole is. Not measured."""

    thresholds: tuple[float, ...] = (1.0, 0.0, 3.0)
    """Prices below these multiples of the temperature are tried at 0, where nobody competes. Not
    measured."""


class Programming:
    """Linear programmes of what the sweeps leave undecided: the states with slack up to a reach."""

    early: tuple[float, ...] = (0.1, 0.3, 0.3, 0.5, 1.0)
    afar: float = 0.3
    nearly: float = 1e-4
    early_from: float = 0.01
    early_from_small: float = 0.003
    early_gap: float = 0.1
    early_states: int = 50_000
    """After each stage from the temperature on, of small problems from the lower one, if brackets
    are narrower than that fraction of the cost, of components of so many states. From prices at
    0.01 on a programme takes as long as the sweeps that would save it the iterations: 50,100,20,2
    takes 0.37 instead of 0.57 s, crowds with wide cutoffs 0.8 of the time. After 0.02, or with a
    reach of 0.05, it is often in vain. Farther than `afar` they reach if brackets are narrower than
    `nearly`: a few paths are missing, which stages do not find. 300,500,300,5 with c = 10 takes 4.3
    instead of 8.8 s. Again at 0.3 with what has become attractive, then at 0.5, takes 0.4 and 0.75
    of the time of 50,100,31.6, where 1.0 would join half of all states."""

    crowd: int = 20_000
    crowded: float = 0.5
    """Where a component has more states than this, the reach of those is less by the factor:
    MOT17-02 by centres with c = 300 takes 1.2 instead of 1.9 s, 100,110,150,2 with c = 50 1.9
    instead of 2.7 s; but 50,100,20,2, with 12,000 states near, 0.40 instead of 0.33 s."""

    resumed: tuple[float, ...] = (0.05, 0.05, 0.2, 0.2)
    """After the stages of a warm start, of which a few prices may be far off. Not measured."""

    rounds: tuple[float, ...] = (0.1, 0.3, 0.3, 0.4, 1.0, np.inf)
    """At the end: the first closes nearly all that sweeps have settled; the last is the plain
    programme, so the method ends."""

    sure: float = 40.0
    """Where brackets are narrower than 1 / `sure` of c^p, reaches and tolerances are fractions of
    `sure` times their width, the first reach four times that. A switch that costs 1e-9 of c^p shows
    in no reduced cost otherwise: 20 x 21 x 20 on a line with p = 1 takes 0.8 instead of 23 s."""

    stuck: float = 0.5
    stuck_gap: float = 0.005
    """A round at the end that leaves more than this of a gap, and more than this fraction of the
    cost, is followed by one that reaches farther. Not measured."""

    group: int = 3000
    """States of components that share a programme: the time of the simplex method grows faster than
    its size, so that components in one programme cost more than one after the other."""

    after: int = 10
    """Steps after the last state of a group in which what it loses may still show. Not measured."""

    quick: int = 500
    build: float = 1e-5
    """States of a programme that is solved before anyone waits; seconds for each state that
    building one takes, and HiGHS to begin: 3 to 10 us measured."""

    tolerance: float = 1e-9
    """What HiGHS takes for zero, for each state: what is open by less has its duals refined."""

    met: float = 1e-13
    """Brackets narrower than this fraction of the cost are as narrow as doubles allow: nothing more
    is tried."""

    snap: float = 1e-9
    overfull: float = 1e-15
    """Weights this near to 0 or 1 are meant to be; sums of them that exceed 1 by more than rounding
    are scaled."""


class Crowding:
    """Settings where most weights are fractional (`solvers.interior_point`)."""

    size: int = 30_000
    undecided: float = 0.28
    coldest: float = 0.01
    of_located: float = 0.08
    large: int = 120_000
    """States from which on this pays: fewer take the simplex method a tenth of a second. Mean of 1
    - m over the masses m at the temperature or below, from which on sweeps go on to the end and the
    interior point method follows; up to the second number of states the temperature also is at most
    the fraction of the mean cost of what is assigned: hotter all looks undecided, and 60,50,20,2
    with c = 10 takes 1.4 instead of 1 s; but 60 x 100 with a class ignored, 134,000 states, is left
    open by the simplex method. 0.22 in 50,100,20,2 and 100,100,30,2, which the simplex method
    solves twice as fast; 0.35 in 100,100,20,2."""

    min_states: int = 2000
    reach: float = 0.02
    min_reach: float = 0.001
    each: float = 3.0
    helped: float = 0.7
    widest: float = 4.0
    nearly: float = 1e-4
    """States of a group that is worth it; the reach, halved down to the second while more states
    than so many are near at each slot of a row, for time grows with the cube of what is near; the
    share of the gap that a round may leave before the reach is doubled, and how wide it may become
    so (8 took the same time in all cases); and the fraction of the cost from which on rounds are
    solved up to rounding: of the 2e-4 to 5e-4 that the first leaves of crowds the second leaves
    1e-5 to 1e-4, exact or not."""


class Windowing:
    """Programmes around what keeps brackets open, where very much is undecided.

    Chosen on recordings of which one component had a million undecided states: one model of HiGHS
    for all took time that grows faster than its size.
    """

    undecided: int = 50_000
    """More states than this are looked at in windows. Not measured."""

    span: int = 25
    widen: int = 4
    shrink: float = 0.3
    """Steps to both sides; by how much they grow where more than this share of the gap stays. Not
    measured."""

    farther: float = 1.0
    """Reach in a window that did not help, before the span grows: more states before more steps."""

    spared: float = 0.25
    """Steps of least loss are left out up to this share of what is allowed. Not measured."""

    large: int = 200_000
    share: float = 0.02
    """A problem of more states is searched in windows between stages too, as long as no more than
    this share of them is undecided there: a stage of sweeps takes about as long."""


class TimeWindowing:
    """Large components in windows of time (`solvers.batches`)."""

    min_states: int = 400_000
    steps: int = 300
    """Components of fewer states or steps are solved whole: half a million states take a second or
    more; of 310,000 states in 300 steps windows with 10 steps of overlap took 1.2 of the time."""

    size: int = 50_000
    shortest: int = 50
    overlap: int = 5
    """States of the core of a window, its least steps, and the steps that it has more to either
    side, but for `fading`. 100,3000,100 with 740,000 states takes 1.5 instead of 1.9 s of one core,
    the hard 60,600,60,2 with c = 20 and 670,000 states 5.9 instead of 8.5 s; with 100,000 states
    each 5.5 s, but the other 2.5 s, and there are fewer for the threads. More overlap closes no
    more seams where prices are not unique, and is solved twice."""

    fading: float = 4.0
    highest_price: float = 10.0
    """More steps to either side for each c^p that half a switch costs: where that is 2 c^p, 5 steps
    leave gaps of 1e-3, 10 none. Where it costs more than the second number what is assigned
    depends on what is far away, and nothing is divided (not measured)."""


ASCENT, PROGRAMMES, CROWDS, WINDOWS = Ascending(), Programming(), Crowding(), Windowing()
TIME_WINDOWS = TimeWindowing()
