"""Tuned numbers of the certified solver, each with its reason.

They affect the time until both bounds meet, but not whether the bounds are right: any prices bound
the optimum from below, and any feasible weights from above. A docstring explains all numbers
between it and the docstring before it. "Not measured" means that a round number was chosen.

Problems are named by four numbers m,T,area,noise of docs/performance.md: objects, steps, side of
the square, and standard deviation of the errors. `solvers` explains sweep, stage, temperature,
programme and reach; `solvers.lp_rounds` explains near, undecided, component and crowd. Temperatures
and reaches are in c^p.
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
    """Stages from high to low temperatures. 64 sweeps at a low temperature take little time
    compared with a programme. After all stages, the error of the dual value is 1e-5 of it. With
    programmes directly after 16 sweeps at 0.02, solving took 2 to 4 times as long."""

    small: int = 10_000
    small_stages: tuple[Stage, ...] = (
        (0.1, 16),
        (0.05, 16),
        (0.02, 16),
        (0.01, 16),
        (0.003, 32),
        (0.001, 64),
    )
    """Stages of a problem with at most `small` states. In such a problem even the smallest
    programme takes as long as four stages, and the sweeps of a stage take hardly longer than its
    other work. 10 objects and 10 tracks at 50 steps in a square of 100 with c = 10 take 0.77 of the
    time that they take with `stages`. 20,50,20,1 takes 0.9 of it."""

    resumed: tuple[Stage, ...] = ((0.01, 32), (0.005, 32), (0.002, 64), (0.001, 64))
    """Stages after a warm start with prices near the best ones. For `--curve` they take a tenth of
    the time of `stages`."""

    repeats: int = 16
    settled: float = 0.015
    gained: float = 0.001
    """When a stage is repeated with a new working set, up to `repeats` stages in all. Two
    conditions must be true: the largest violation (`Ascent.stage`) is at least `settled` and `calm`
    (if `calm` is used), and the stage lowered the dual value by at least the fraction `gained` of
    the cost. More sweeps with the old working set would only lead to prices at which states outside
    it are better. The rule helps with cutoffs far above the errors: 100,60,150,2 with c = 50 takes
    2.5 instead of 10 s."""

    free: float = 8.0
    """Rule for nearly free switches. If half a switch costs less than the last temperature, all
    steps are solved separately first. If the gap is then below the fraction `Programming.nearly` of
    the cost, the unit of temperatures is `free` times the cost of half a switch. Not measured."""

    calm: float = 0.1
    calm_above: float = 0.01
    """Above the temperature `calm_above`, a stage ends when the largest violation is less than
    `calm`. Sparse scenes then take a third of the sweeps."""

    skip: float = 0.01
    skip_above: float = 0.02
    skip_above_large: float = 0.05
    """When a stage is skipped. If the gap after a stage is less than the fraction `skip` of the
    cost, and the temperature of this stage is above `skip_above`, the next stage is skipped. For
    large problems the limit is `skip_above_large`: they have hard parts even if the whole gap is
    small. Not measured."""

    thresholds: tuple[float, ...] = (1.0, 0.0, 3.0)
    """After a stage, its prices are tried with small ones replaced by 0, which is the best price in
    slots without competition. A price is small if it is at most the temperature times one of these
    numbers, which are tried one after the other. Not measured."""


class Programming:
    """Settings of the programmes on states that sweeps leave undecided."""

    early: tuple[float, ...] = (0.1, 0.3, 0.3, 0.5, 1.0)
    afar: float = 0.3
    nearly: float = 1e-4
    early_from: float = 0.01
    early_from_small: float = 0.003
    early_gap: float = 0.1
    early_states: int = 50_000
    """Programmes between stages, one for each reach in `early`. They run only if the temperature of
    the stage before is at most `early_from` (small problems: `early_from_small`), and the gap is
    smaller than the fraction `early_gap` of the cost. Only components of up to `early_states`
    states have such programmes. 50,100,20,2 takes 0.37 instead of 0.57 s, and crowds with wide
    cutoffs take 0.8 of the time. After the stage at 0.02, or with a reach of 0.05, a programme is
    often in vain.

    Reaches above `afar` are only used if the gap is smaller than the fraction `nearly` of the cost.
    Then only a few paths are missing, and stages do not find them: 300,500,300,5 with c = 10 takes
    4.3 instead of 8.8 s. The second programme with the reach 0.3 includes states that became
    attractive at the prices of the first one: 50,100,31.6 takes 0.4 of the time. With the reach 0.5
    in between it takes 0.75 of this time, because the reach 1.0 would connect half of all its
    states."""

    crowd: int = 20_000
    crowded: float = 0.5
    """If a component has more than `crowd` states, the reach of programmes between stages is
    multiplied by `crowded`. The centres of MOT17-02 with c = 300 take 1.2 instead of 1.9 s, and
    100,110,150,2 with c = 50 takes 1.9 instead of 2.7 s. For smaller components this does not help:
    50,100,20,2, with 12,000 near states, would take 0.40 instead of 0.33 s."""

    resumed: tuple[float, ...] = (0.05, 0.05, 0.2, 0.2)
    """Reaches after the stages of a warm start, where a few prices may be far off. Not measured."""

    rounds: tuple[float, ...] = (0.1, 0.3, 0.3, 0.4, 1.0, np.inf)
    """Reaches of the programmes after all stages. The first one closes nearly all gaps if the
    sweeps have settled. The last one has all states, so the method always ends."""

    sure: float = 40.0
    """The unit of reaches and tolerances is c^p, or, if that is less, `sure` times the gap, rounded
    up to a power of 2. In the second case the first reach is four to eight times the gap. With the
    unit c^p, the tolerances would hide a switch that costs 1e-9 c^p. With the smaller unit, 20
    objects and 21 tracks at 20 steps on a line with p = 1 take 0.8 instead of 23 s."""

    stuck: float = 0.5
    stuck_gap: float = 0.005
    """When a second programme with the same reach after all stages is skipped: if the first one
    leaves more than the share `stuck` of the gap, and more than the fraction `stuck_gap` of the
    cost. Not measured."""

    group: int = 3000
    """Approximate number of states of a programme that several components share. The time of the
    simplex method grows faster than the size of the programme, so one large programme takes longer
    than several small ones."""

    after: int = 10
    """Steps after the begin of the last state of a group in which the losses from its new prices
    are counted, too. Not measured."""

    quick: int = 500
    build: float = 1e-5
    """A programme of up to `quick` states needs no thread, because it takes hardly any time.
    `build` is the time in seconds per state for building a programme and starting HiGHS. Measured
    were 3 to 10 microseconds."""

    tolerance: float = 1e-9
    """Error of the dual value for each state that the tolerance of HiGHS may cause. If the open gap
    is not larger than the sum of these errors, prices are refined."""

    met: float = 1e-13
    """Fraction of the cost below which a gap is as small as doubles allow. No more prices are tried
    then."""

    snap: float = 1e-9
    overfull: float = 1e-15
    """Weights that differ from 0 or 1 by less than `snap` become 0 or 1. Weights are made feasible
    if their sum in a slot exceeds 1 by more than `overfull`."""


class Crowding:
    """Settings for crowds, which `solvers.interior_point` solves."""

    size: int = 30_000
    undecided: float = 0.28
    coldest: float = 0.01
    of_located: float = 0.08
    large: int = 120_000
    """Conditions for running the interior point method after the last stage. All three must be
    true.

    1. The problem has more than `size` states. The simplex method solves smaller problems in a
       tenth of a second.
    2. After a stage at the temperature `coldest` or below, `Ascent.undecidedness` exceeds
       `undecided`. It is 0.35 in 100,100,20,2. It is 0.22 in 50,100,20,2 and 100,100,30,2, which
       the simplex method solves twice as fast.
    3. The temperature of this stage is at most the fraction `of_located` of the mean cost of
       assigned pairs. At higher temperatures everything looks undecided: without this condition,
       60,50,20,2 with c = 10 takes 1.4 instead of 1 s. Problems of more than `large` states do not
       need this condition. One of them has 60 objects at 100 steps with an ignored class, and
       134,000 states; the simplex method did not finish it."""

    min_states: int = 2000
    reach: float = 0.02
    min_reach: float = 0.001
    each: float = 3.0
    helped: float = 0.7
    widest: float = 4.0
    nearly: float = 1e-4
    """Groups of fewer than `min_states` states do not use this method. Its time grows with the cube
    of the number of near states at a row slot. So the `reach` is halved, down to `min_reach`, while
    the mean of this number is above `each`. If more than the share `helped` of the gap remains
    after a round, the reach is doubled, up to the factor `widest`. (With 8 as `widest`, all cases
    took the same time.)

    If the gap is below the fraction `nearly` of the cost, a round is solved up to rounding. In
    crowds the gap is 2e-4 to 5e-4 of the cost after the first round, and 1e-5 to 1e-4 after the
    second one. The second gap is the same if the second round is solved up to rounding."""


class Windowing:
    """Settings of programmes in windows around the steps that keep gaps open.

    `Programmes._run_windows` explains these windows. The settings were chosen on recordings in
    which one component had a million undecided states. The time of HiGHS grows faster than the size
    of a model, so one model of all these states would take long.
    """

    undecided: int = 50_000
    """Number of near states above which windows are used. Not measured."""

    span: int = 25
    widen: int = 4
    shrink: float = 0.3
    """A window has `span` steps before and after each step that keeps gaps open. If more than the
    share `shrink` of the gap remains, the windows did not help, and the reach becomes `farther`. If
    this does not help either, the reach is the first one again, and `span` is multiplied by
    `widen`. Not measured."""

    farther: float = 1.0
    """Reach after windows that did not help."""

    spared: float = 0.25
    """The steps with the smallest losses are left out of windows, if their losses sum to at most
    this share of the allowed gap. Not measured."""

    large: int = 200_000
    share: float = 0.02
    """Problems of at least `large` states have programmes in windows also between stages, while at
    most the share `share` of all states is near and in a window. Such programmes take about as long
    as a stage."""


class TimeWindowing:
    """Settings of the division of large blocks into windows in time (`solvers.batches`)."""

    min_states: int = 400_000
    steps: int = 300
    """Blocks of fewer than `min_states` states or `steps` steps are not divided. Half a million
    states take a second or more. For 310,000 states in 300 steps, windows with 10 steps of overlap
    took 1.2 times as long."""

    size: int = 50_000
    shortest: int = 50
    overlap: int = 5
    """The core of a window has about `size` states and at least `shortest` steps on average. The
    window has `overlap` more steps on either side, and the steps of `fading`. 100,3000,100 with
    740,000 states takes 1.5 instead of 1.9 s on one core; the hard 60,600,60,2 with c = 20 and
    670,000 states takes 5.9 instead of 8.5 s. If `size` is 100,000, the hard scene takes 5.5 s, but
    the first one takes 2.5 s, and there are fewer windows for the threads. All steps of an overlap
    are solved twice. If the best prices are not unique, a longer overlap does not make the windows
    agree at more seams."""

    fading: float = 4.0
    highest_price: float = 10.0
    """On either side of a window, `fading` steps are added for each c^p that half a switch costs.
    If half a switch costs 2 c^p, gaps of 1e-3 remain with an overlap of 5 steps, and no gaps with
    10 steps. If half a switch costs more than `highest_price` c^p, the assignment depends on steps
    far away, and blocks are not divided (not measured)."""


ASCENT, PROGRAMMES, CROWDS, WINDOWS = Ascending(), Programming(), Crowding(), Windowing()
TIME_WINDOWS = TimeWindowing()
