"""Tuned numbers of the certified solver, each with its reason.

These numbers do not affect the validity of the bounds: any prices bound the optimum from below, and
any feasible weights from above. They affect the time until both bounds meet. A docstring is for all
numbers since the docstring before it. "Not measured" means that a round number was chosen. Scenes
such as 50,100,20,2 are settings m,T,area,noise of docs/performance.md: targets, steps, side of the
square, and standard deviation of the errors. Words: `tgospa_eval.solvers`. Temperatures and reaches
are in c^p.
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
    """Stages from hot to cold. 64 sweeps at a small temperature cost little compared with a
    programme. After them, the error is 1e-5 of the dual value. With programmes directly after 16
    sweeps at 0.02, solving took 2 to 4 times as long."""

    small: int = 10_000
    small_stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 16),
        (0.003, 32),
        (0.001, 64),
    )
    """Stages of a problem with at most `small` states. In such a problem, even the smallest
    programme costs as much as four stages, and the sweeps of a stage cost hardly more than the rest
    of the stage. Compared with `stages`, 10 objects and 10 tracks at 50 steps in a square of 100
    with c = 10 take 0.77 of the time, and 20,50,20,1 takes 0.9 of it."""

    resumed: tuple[Stage, ...] = ((0.01, 32), (0.005, 32), (0.002, 64), (0.001, 64))
    """Stages from a near warm start. For `--curve` they take a tenth of the time of all stages."""

    repeats: int = 16
    settled: float = 0.015
    gained: float = 0.001
    """A stage is repeated with a new working set, up to `repeats` stages, while two conditions are
    true: columns are violated by more than `settled`, and the stage lowered the dual value by more
    than the fraction `gained` of the cost. With the old set, more sweeps would only lead to prices
    at which states outside the set are better. With cutoffs far above the errors, the stage at 0.01
    is far from settled after 64 sweeps: 100,60,150,2 with c = 50 takes 2.5 instead of 10 s."""

    free: float = 8.0
    """If half a switch costs less than the last temperature, all steps are solved separately first.
    If the gap is then below the fraction `Programming.nearly` of the cost, the unit of temperatures
    is `free` times the cost of half a switch. Not measured."""

    calm: float = 0.1
    calm_above: float = 0.01
    """Above the temperature `calm_above`, a stage ends when columns are violated by less than
    `calm`. Sparse scenes then take a third of the sweeps."""

    skip: float = 0.01
    skip_above: float = 0.02
    skip_above_large: float = 0.05
    """If a stage above the temperature `skip_above` makes the gaps smaller than the fraction `skip`
    of the cost, the next stage is skipped. For large problems the temperature is
    `skip_above_large`, because they have hard spots even if the gap of the whole is small. Not
    measured."""

    thresholds: tuple[float, ...] = (1.0, 0.0, 3.0)
    """After a stage, prices up to each of these multiples of the temperature are replaced by 0, and
    the result is tried. 0 is the best price in slots without competition. Not measured."""


class Programming:
    """Settings of programmes on states that sweeps leave undecided, with slack up to a reach."""

    early: tuple[float, ...] = (0.1, 0.3, 0.3, 0.5, 1.0)
    afar: float = 0.3
    nearly: float = 1e-4
    early_from: float = 0.01
    early_from_small: float = 0.003
    early_gap: float = 0.1
    early_states: int = 50_000
    """`early` are the reaches of programmes after a stage, under two conditions. The temperature of
    the stage is at most `early_from` (small problems: `early_from_small`), and the gap is smaller
    than the fraction `early_gap` of the cost. Only components of up to `early_states` states have
    such programmes. After the stage at 0.01 or later ones, a programme takes as long as the sweeps
    that would be needed instead of its iterations: 50,100,20,2 takes 0.37 instead of 0.57 s, and
    crowds with wide cutoffs take 0.8 of the time. After the stage at 0.02, or with a reach of 0.05,
    a programme is often in vain. Reaches above `afar` are only used if the gap is smaller than the
    fraction `nearly` of the cost. In this case only a few paths are missing, and stages do not find
    them: 300,500,300,5 with c = 10 takes 4.3 instead of 8.8 s. The second programme with the reach
    0.3 is for the states that became attractive. It reduces the time of 50,100,31.6 to 0.4 of the
    time without it. The programme with the reach 0.5 then reduces it to 0.75 of that, because the
    reach 1.0 would join half of all states there."""

    crowd: int = 20_000
    crowded: float = 0.5
    """If a component has more than `crowd` states, the reach of early programmes is multiplied by
    `crowded`. The centres of MOT17-02 with c = 300 take 1.2 instead of 1.9 s, and 100,110,150,2
    with c = 50 takes 1.9 instead of 2.7 s. But 50,100,20,2, with only 12,000 near states, would
    take 0.40 instead of 0.33 s."""

    resumed: tuple[float, ...] = (0.05, 0.05, 0.2, 0.2)
    """Reaches after the stages of a warm start, where a few prices may be far off. Not measured."""

    rounds: tuple[float, ...] = (0.1, 0.3, 0.3, 0.4, 1.0, np.inf)
    """Reaches of the programmes after all stages. The first closes nearly all gaps if the sweeps
    have settled. The last is the programme of all states, so that the method ends."""

    sure: float = 40.0
    """The unit of reaches and tolerances is c^p, or `sure` times the gap if that is less. In the
    second case the first reach is four times the gap. With the unit c^p, no reduced cost would show
    a switch that costs 1e-9 c^p. With the smaller unit, 20 objects and 21 tracks at 20 steps on a
    line with p = 1 take 0.8 instead of 23 s."""

    stuck: float = 0.5
    stuck_gap: float = 0.005
    """A second programme with the same reach is skipped if, after the first one, the gap is more
    than the share `stuck` of the gap before it, and more than the fraction `stuck_gap` of the cost.
    This rule is for programmes after all stages. Not measured."""

    group: int = 3000
    """Approximate number of states of a programme that several components share. The time of the
    simplex method grows faster than the size of the programme, so many components in one programme
    take longer than one after the other."""

    after: int = 10
    """Losses from new prices of a group are counted up to this number of steps after the begin of
    its last state. Not measured."""

    quick: int = 500
    build: float = 1e-5
    """A programme of up to `quick` states needs no thread, because it takes hardly any time.
    `build` is the time, in seconds per state, for building a programme and starting HiGHS: 3 to 10
    us measured."""

    tolerance: float = 1e-9
    """Error of the dual value that the tolerance of HiGHS may cause for each state. If the open gap
    is not larger than the sum of these errors, duals are refined."""

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
    """The interior point method is used for problems of more than `size` states; the simplex method
    solves smaller ones in a tenth of a second. It comes after the last stage if, at the temperature
    `coldest` or below, the mean of 1 - m over the masses m exceeds `undecided`. Up to `large`
    states the temperature must also be at most the fraction `of_located` of the mean cost of
    assigned pairs: at higher temperatures everything looks undecided, and 60,50,20,2 with c = 10
    takes 1.4 instead of 1 s. `large` is less than the 134,000 states of a scene of 60 objects at
    100 steps with an ignored class, which the simplex method did not finish. The mean is 0.22 in
    50,100,20,2 and 100,100,30,2, which the simplex method solves twice as fast, and 0.35 in
    100,100,20,2."""

    min_states: int = 2000
    reach: float = 0.02
    min_reach: float = 0.001
    each: float = 3.0
    helped: float = 0.7
    widest: float = 4.0
    nearly: float = 1e-4
    """Groups of fewer than `min_states` states do not use this method. The `reach` is halved, down
    to `min_reach`, while on average more than `each` states are near at a slot of a row, because
    time grows with the cube of their number. If more than the share `helped` of the gap remains
    after a round, the reach is doubled, up to the factor `widest` (8 took the same time in all
    cases). If the gap is below the fraction `nearly` of the cost, a round is solved up to rounding.
    In crowds the gap is 2e-4 to 5e-4 of the cost after the first round, and 1e-5 to 1e-4 after the
    second one, whether this is solved up to rounding or not."""


class Windowing:
    """Settings of programmes around steps that keep gaps open, for many undecided states.

    They were chosen on recordings in which one component had a million undecided states. The time
    of one model of HiGHS for all these states grows faster than the size of the model.
    """

    undecided: int = 50_000
    """Number of undecided states above which windows are used. Not measured."""

    span: int = 25
    widen: int = 4
    shrink: float = 0.3
    """A window has `span` steps before and after each step that keeps gaps open. If more than the
    share `shrink` of the gap remains, the reach rises to `farther`. If more than this share remains
    again, the reach falls to its first value, and `span` is multiplied by `widen`. Not measured."""

    farther: float = 1.0
    """Reach after a window that did not help."""

    spared: float = 0.25
    """Steps with the smallest losses are left out of windows, if these losses sum to at most this
    share of the allowed gap. Not measured."""

    large: int = 200_000
    share: float = 0.02
    """A problem of at least `large` states is also solved in windows between stages, while at most
    the share `share` of its states is near in a window. Such a window takes about as long as a
    stage of sweeps."""


class TimeWindowing:
    """Settings of large components in windows of time (`solvers.batches`)."""

    min_states: int = 400_000
    steps: int = 300
    """Components of fewer than `min_states` states or `steps` steps are solved whole. Half a
    million states take a second or more. For 310,000 states in 300 steps, windows with 10 steps of
    overlap took 1.2 times as long."""

    size: int = 50_000
    shortest: int = 50
    overlap: int = 5
    """The core of a window has about `size` states and at least `shortest` steps. The window has
    `overlap` more steps on either side, and the additional steps of `fading`. 100,3000,100 with
    740,000 states takes 1.5 instead of 1.9 s on one core; the hard 60,600,60,2 with c = 20 and
    670,000 states takes 5.9 instead of 8.5 s. If `size` is 100,000, the hard scene takes 5.5 s, but
    the first scene takes 2.5 s, and there are fewer windows for the threads. If prices are not
    unique, windows do not agree at more seams if they overlap more, and all steps of the overlap
    are solved twice."""

    fading: float = 4.0
    highest_price: float = 10.0
    """On either side of a window, `fading` steps are added for each c^p that half a switch costs.
    If half a switch costs 2 c^p, gaps of 1e-3 remain with an overlap of 5 steps, and no gaps with
    10 steps. If half a switch costs more than `highest_price` c^p, the assignment depends on steps
    far away, and components are not divided (not measured)."""


ASCENT, PROGRAMMES, CROWDS, WINDOWS = Ascending(), Programming(), Crowding(), Windowing()
TIME_WINDOWS = TimeWindowing()
