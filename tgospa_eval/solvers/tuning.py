"""Tuned numbers of the certified solver, each with its reason.

These numbers do not affect the validity of the bounds: any prices bound the optimum from below, and
any feasible weights from above. They affect the time until both meet. "Not measured" means a round
number. Scenes such as 50,100,20,2 are settings m,T,area,noise of docs/performance.md: targets,
steps, side of the square, and standard deviation of the errors.
"""

import numpy as np

from tgospa_eval.errors import ConfigError, real_number, whole_number


def check_settings(
    solver: object, *, gap: float = 0.0, time_limit: float | None = None, jobs: int | None = None
) -> None:
    """Check the common settings of solvers, and replace them by plain numbers.

    Raises
    ------
    ConfigError
        The gap is not a number, negative or infinite; the time limit is not a number, infinite,
        zero or negative; or the number of threads is not a whole number of at least 1.
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
"""A temperature, as a fraction of c^p, and the number of sweeps at it."""


class Ascending:
    """Settings of the sweeps, which come before the programmes."""

    stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 64),
        (0.005, 64),
        (0.002, 64),
        (0.001, 64),
    )
    """Stages from hot to cold. 64 sweeps at small temperatures cost little compared with a
    programme, and bring the dual value to 1e-5 of itself. Programmes after 16 sweeps at 0.02 took 2
    to 4 times the whole time."""

    small: int = 10_000
    small_stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 16),
        (0.003, 32),
        (0.001, 64),
    )
    """Stages of a problem with at most `small` states. There a programme of any size costs as much
    as four stages, and the sweeps of a stage hardly more than the rest of it. 10 x 10 x 50 in a
    square of 100 with c = 10 takes 0.77 of the time, 20,50,20,1 takes 0.9."""

    resumed: tuple[Stage, ...] = ((0.01, 32), (0.005, 32), (0.002, 64), (0.001, 64))
    """Stages from a near warm start. For a curve they take a tenth of the time of all stages."""

    repeats: int = 16
    settled: float = 0.015
    gained: float = 0.001
    """A stage that leaves columns violated by more than `settled`, and lowered the dual value by
    more than the fraction `gained` of the cost, is repeated with a new working set. In the old
    set, more sweeps only drive prices to where states outside the set are better. With cutoffs far
    above the errors, 0.01 is far from settled after 64 sweeps: 100,60,150,2 with c = 50 takes 2.5
    instead of 10 s."""

    free: float = 8.0
    """If half a switch costs less than the last temperature, all steps are solved separately first.
    If the gap that is left is below `Programming.nearly` of the cost, temperatures are fractions of
    `free` times half a switch. Not measured."""

    calm: float = 0.1
    calm_above: float = 0.01
    """Above the temperature `calm_above`, a stage ends when columns are violated by less than
    `calm`. Sparse scenes then take a third of the sweeps."""

    skip: float = 0.01
    skip_above: float = 0.02
    skip_above_large: float = 0.05
    """If gaps are smaller than the fraction `skip` of the cost, the stage after a stage above this
    temperature is skipped. The temperature is higher for large problems, which have hard spots even
    if the gap of the whole is small. Not measured."""

    thresholds: tuple[float, ...] = (1.0, 0.0, 3.0)
    """Multiples of the temperature: prices up to these are tried as 0, as in slots without
    competition. Not measured."""


class Programming:
    """Settings of programmes on states that sweeps leave undecided, with slack up to a reach."""

    early: tuple[float, ...] = (0.1, 0.3, 0.3, 0.5, 1.0)
    afar: float = 0.3
    nearly: float = 1e-4
    early_from: float = 0.01
    early_from_small: float = 0.003
    early_gap: float = 0.1
    early_states: int = 50_000
    """Reaches of programmes after each stage from the temperature `early_from` on (small problems:
    `early_from_small`), if gaps are smaller than the fraction `early_gap` of the cost. Only
    components of up to `early_states` states have such programmes. From prices at 0.01 on a
    programme takes as long as the sweeps that would save its iterations: 50,100,20,2 takes 0.37
    instead of 0.57 s, crowds with wide cutoffs 0.8 of the time. After 0.02, or with a reach of
    0.05, it is often in vain. The reach is above `afar` only if gaps are smaller than `nearly`:
    then a few paths are missing, which stages do not find. 300,500,300,5 with c = 10 takes 4.3
    instead of 8.8 s. A second programme at 0.3 with the states that became attractive, and then one
    at 0.5, take 0.4 and 0.75 of the time of 50,100,31.6, where 1.0 would join half of all
    states."""

    crowd: int = 20_000
    crowded: float = 0.5
    """If a component has more than `crowd` states, the reach of early programmes is multiplied by
    `crowded`. MOT17-02 by centres with c = 300 takes 1.2 instead of 1.9 s, 100,110,150,2 with c =
    50 1.9 instead of 2.7 s; but 50,100,20,2, with 12,000 near states, 0.40 instead of 0.33 s."""

    resumed: tuple[float, ...] = (0.05, 0.05, 0.2, 0.2)
    """Reaches after the stages of a warm start, where a few prices may be far off. Not measured."""

    rounds: tuple[float, ...] = (0.1, 0.3, 0.3, 0.4, 1.0, np.inf)
    """Reaches of the rounds at the end. The first closes nearly all gaps that sweeps have
    settled; the last is the plain programme, so that the method ends."""

    sure: float = 40.0
    """If the gap is below c^p / `sure`, reaches and tolerances are fractions of `sure` times the
    gap; the first reach is four times the gap. Otherwise no reduced cost shows a switch that costs
    1e-9 c^p: 20 x 21 x 20 on a line with p = 1 takes 0.8, not 23 s."""

    stuck: float = 0.5
    stuck_gap: float = 0.005
    """After a round at the end that leaves more than the share `stuck` of a gap, and more than the
    fraction `stuck_gap` of the cost, the next round has a larger reach. Not measured."""

    group: int = 3000
    """States of components that share a programme. The time of the simplex method grows faster than
    its size: components in one programme take longer than one after the other."""

    after: int = 10
    """Number of steps after the last state of a group in which its losses may still appear. Not
    measured."""

    quick: int = 500
    build: float = 1e-5
    """Up to `quick` states, a programme needs no thread, because it is solved at once. `build` are
    the seconds per state for building a programme and starting HiGHS: 3 to 10 us measured."""

    tolerance: float = 1e-9
    """Tolerance of HiGHS, for each state: if the open gap is less, duals are refined."""

    met: float = 1e-13
    """Fraction of the cost below which a gap is as small as doubles allow, so that no more prices
    are tried."""

    snap: float = 1e-9
    overfull: float = 1e-15
    """Weights within `snap` of 0 or 1 are set to 0 or 1. Weights are scaled if their sum exceeds 1
    by more than `overfull`."""


class Crowding:
    """Settings for problems with mostly fractional weights (`solvers.interior_point`)."""

    size: int = 30_000
    undecided: float = 0.28
    coldest: float = 0.01
    of_located: float = 0.08
    large: int = 120_000
    """Above `size` states the interior point method pays: fewer take the simplex method a tenth of
    a second. It follows the last stage if, at the temperature `coldest` or below, the mean of 1 - m
    over the masses m exceeds `undecided`. Up to `large` states the temperature must also be at most
    the fraction `of_located` of the mean cost of assigned pairs. At higher temperatures everything
    looks undecided, and 60,50,20,2 with c = 10 takes 1.4 instead of 1 s. But 60 x 100 with a class
    ignored, 134,000 states, is left open by the simplex method. The mean is 0.22 in 50,100,20,2 and
    100,100,30,2, which the simplex method solves twice as fast, and 0.35 in 100,100,20,2."""

    min_states: int = 2000
    reach: float = 0.02
    min_reach: float = 0.001
    each: float = 3.0
    helped: float = 0.7
    widest: float = 4.0
    nearly: float = 1e-4
    """Groups of fewer than `min_states` states do not use this method. The `reach` is halved, down
    to `min_reach`, while more than `each` states are near at each slot of a row, because time grows
    with the cube of their number. After a round that leaves more than the share `helped` of the
    gap, the reach is doubled, up to the factor `widest` (8 took the same time in all cases). Below
    the fraction `nearly` of the cost rounds are solved up to rounding. The first round leaves 2e-4
    to 5e-4 in crowds, the second 1e-5 to 1e-4, exact or not."""


class Windowing:
    """Settings of programmes around steps that keep gaps open, for many undecided states.

    Chosen on recordings in which one component had a million undecided states: the time of one
    model of HiGHS for all of them grows faster than its size.
    """

    undecided: int = 50_000
    """Number of undecided states above which windows are used. Not measured."""

    span: int = 25
    widen: int = 4
    shrink: float = 0.3
    """A window has `span` steps before and after each of these steps. If more than the share
    `shrink` of the gap remains, the reach rises to `farther`, and then `span` is multiplied by
    `widen`. Not measured."""

    farther: float = 1.0
    """Reach after a window that did not help. If this reach does not help, the span grows."""

    spared: float = 0.25
    """Steps of least loss are left out up to this share of the allowed gap. Not measured."""

    large: int = 200_000
    share: float = 0.02
    """A problem of more than `large` states is also solved in windows between stages, while at most
    the share `share` of them is undecided there: a stage of sweeps takes about as long."""


class TimeWindowing:
    """Settings of large components in windows of time (`solvers.batches`)."""

    min_states: int = 400_000
    steps: int = 300
    """Components of fewer states or steps are solved whole. Half a million states take a second or
    more; for 310,000 states in 300 steps, windows with 10 steps of overlap took 1.2 of the time."""

    size: int = 50_000
    shortest: int = 50
    overlap: int = 5
    """The core of a window has about `size` states and at least `shortest` steps. The window has
    `overlap` more steps on either side, and those of `fading`. 100,3000,100 with 740,000 states
    takes 1.5 instead of 1.9 s on one core, the hard 60,600,60,2 with c = 20 and 670,000 states 5.9
    instead of 8.5 s. If `size` is 100,000, the latter takes 5.5 s, but the former 2.5 s, and there
    are fewer windows for the threads. If prices are not unique, more overlap does not close more
    seams, and the steps in it are solved twice."""

    fading: float = 4.0
    highest_price: float = 10.0
    """`fading` steps are added on either side for each c^p that half a switch costs: if it costs 2
    c^p, 5 steps leave gaps of 1e-3, and 10 steps leave no gaps. If it costs more than
    `highest_price` c^p, the assignment depends on steps far away, and components are not divided
    (not measured)."""


ASCENT, PROGRAMMES, CROWDS, WINDOWS = Ascending(), Programming(), Crowding(), Windowing()
TIME_WINDOWS = TimeWindowing()
