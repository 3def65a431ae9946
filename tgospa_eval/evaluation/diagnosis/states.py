"""Warnings about the states of two sides: other units, other axes, another origin.

Each suspected fault is undone at some common steps. A warning appears only if this at least halves
the per-step GOSPA cost.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, plain
from tgospa_eval.evaluation.diagnosis.costs import (
    FEWEST_TRACKS,
    FIRST_STEPS,
    NOTABLE_COST,
    Sample,
    StepCosts,
    falls,
    saving,
    with_state,
)
from tgospa_eval.formats.headers import BOX
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES, Trajectories

SIDES = ("truth", "estimate")
EMPTY_OTHER_SIDE = ("all estimates are false", "all ground-truth objects are missed")


def side_warnings(sides: tuple[Trajectories, Trajectories]) -> list[Notice]:
    """Warn of values of a side that are probably not intended."""
    warnings = []
    for name, meaning, side in zip(SIDES, EMPTY_OTHER_SIDE, sides, strict=True):
        if not len(side.step):
            warnings.append(
                Notice(
                    code="empty-side",
                    text=f"no row of the {name} is evaluated, so {meaning}",
                    remedy="check that this is the right file, and that options such as "
                    f"{option('time')} or {option('class_')} do not leave out all rows",
                )
            )
        elif len(side.step) == len(side.ids) > 2 and np.count_nonzero(np.diff(side.step)) > 1:
            warnings.append(
                Notice(
                    code="single-rows",
                    text=f"every id of the {name} has a single row, so the rows are detections, "
                    "not tracks; each change from one id to the next costs a switch",
                    remedy="an id must be the same at all steps of a track",
                )
            )
        warnings += _spellings(name, side)
    return warnings


def _spellings(name: str, side: Trajectories) -> list[Notice]:
    """Return warnings of ids that are the same number in different texts: 7, 07 and 7.0."""
    ids = side.ids.tolist()
    known: dict[str, str] = {}
    for text in ids if any("." in text or text[:1] == "0" for text in ids) else ():
        number = re.fullmatch(r"0*([0-9]+)(\.0*)?", text)
        earlier = known.setdefault(number[1], text) if number else text
        if earlier != text:
            return [
                Notice(
                    code="id-types",
                    text=f"ids {quoted(earlier)} and {quoted(text)} of the {name} are one "
                    "number in two spellings, but they count as two tracks",
                    remedy="write each id in one way only",
                )
            ]
    return []


# -------------------------------------------------------------------------------------------------
# Tests whether true states and estimates are near each other more often than by chance.

SOME = 0.35
"""With this share of the possible pairs or more, chance is not tested."""

UNLIKE = 4
"""Ratio of the numbers of rows above which most rows of the larger side have no partner."""

ENOUGH = 100
"""Smallest number of possible pairs with which chance is tested."""

HARDLY = 1.5
"""Pairs that save at most this multiple of the saving by chance may be chance.

Wrong pairs may save a little more than displaced estimates, some of which leave the scene. Sound
pairs save more than this multiple if their noise is below the cutoff."""

LITTLE = 0.005
"""Share of the possible saving by pairs that stay near because they move in one direction."""

MOVES = (3.0, 6.0)
"""Displacements of the estimates along a line, in cutoffs, in both directions."""


def few_are_near(here: StepCosts) -> bool:
    """Return whether disjoint near pairs are so few that they may be chance."""
    if not len(here.taken):
        return True
    rows = sorted(map(len, here.objects))
    return len(here.taken) < SOME * here.possible and rows[1] <= UNLIKE * rows[0]


def nearness_warnings(sample: Sample) -> list[Notice]:
    """Warn that no true state has an estimate within the cutoff, or some only by chance."""
    here = sample.here
    within = f"within c = {sample.parameters.cutoff:g}"
    steps = counted(here.steps, "step")
    if not len(here.gain):
        text = f"no ground-truth state has an estimate {within} at {steps}"
    elif few_are_near(here) and _is_chance(sample):
        rows = len(here.objects[0])
        near = np.count_nonzero(np.bincount(here.rows[0], minlength=rows))
        text = (
            f"only {100 * near / rows:.2g} % of the ground-truth states have an estimate {within} "
            f"at {steps}, hardly more than by chance"
        )
    else:
        return []
    return [
        Notice(
            code="nothing-near",
            text=text,
            remedy="check that both files are of one recording, with the same units, axes and "
            "origin; if errors may be that large, choose a larger cutoff",
        )
    ]


def _is_chance(sample: Sample) -> bool:
    """Return whether pairs save hardly more of the cost than they would by chance.

    The saving by chance is that of estimates displaced by a few cutoffs, far from their objects.
    The line with the largest saving counts, because on a road nothing is near an estimate that is
    displaced across it. Exchanged steps would not serve, as objects at rest keep their position.
    """
    possible, estimate = sample.here.possible, sample.estimate
    if possible < ENOUGH:
        return False
    saved = _saved(sample.here) - LITTLE * possible
    for line in _lines(sample):
        displaced = (estimate.state + way * move * line for move in MOVES for way in (1, -1))
        by_chance = [_saved(sample.costs(with_state(estimate, state))) for state in displaced]
        if saved <= HARDLY * sum(by_chance) / len(by_chance):
            return True
    return False


def _saved(costs: StepCosts) -> float:
    """Return the saving relative to the cost without assignments."""
    return float((costs.unassigned - costs.upper).sum())


def _lines(sample: Sample) -> Iterator[Floats]:
    """Yield vectors (R or 1, d) as long as the cutoff on both or one of the first two axes.

    They are the diagonals, the axes, and the direction of the largest spread of the truth.
    """
    truth, estimate, distance = sample.truth, sample.estimate, sample.distance
    columns, cutoff = estimate.columns, sample.parameters.cutoff
    if distance.on_earth:
        from tgospa_eval.distances.sphere import RADIUS  # lazy: rarely needed

        chosen, degrees = [0, 1], np.degrees(cutoff / RADIUS)
        shrunk = np.cos(np.radians(truth.state[:, 0])).mean().clip(0.01)
        reach = np.array([[degrees], [degrees / shrunk]])
    else:
        named = [columns.index(name) for name in ("x", "y") if name in columns]
        chosen = named or list(range(len(columns)))[:2]
        reach = distance.reach(cutoff, distance.axes(estimate, slice(None)))[chosen]
    if not np.isfinite(reach).all():
        return
    units = [(1.0, 1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 1.0)] if len(chosen) > 1 else [(1.0,)]
    scaled = truth.state[:, chosen] / reach.mean(axis=1)
    centred = scaled - scaled.mean(axis=0)
    largest = float(np.abs(centred).max())
    if 0 < largest < np.inf:
        widest = np.linalg.eigh(centred.T / largest @ centred / largest)[1][:, -1]
        units.append(tuple(widest))
    for unit in units:
        line = np.zeros((reach.shape[1], len(columns)))
        line[:, chosen] = reach.T * unit
        yield line


FACTORS = {
    1000.0: ("metres", "kilometres"),
    100.0: ("centimetres", "metres"),
    1 / 0.3048: ("feet", "metres"),
    180 / np.pi: ("degrees", "radians"),
}
"""Factors between units by which the coordinates of one file may be wrong."""

FEWEST_PAIRS = 6
"""Smallest number of near pairs after a credible change; a fitted offset needs more."""

FITTED = 12

VOTES, EACH = 6_000, 40
"""Numbers of differences in the search for an offset: in total; for each estimate of a step.

The limit that allows more differences counts. At most one of those of an estimate is right."""

UPWARD = ("z", HEIGHT)
"""Columns that may have their own unit, such as feet."""

POSITIONS = (("x", "y", "z"), ("lat", "lon"))


@dataclass(frozen=True, kw_only=True)
class _Change:
    """A linear change of the estimate's columns: ``state[:, order] * factor + offset``.

    Parameters
    ----------
    code : str
        Code of the warning.
    text : str
        Suspected fault, and its correction.
    remedy : str
        Remedy for the user.
    order : tuple of int
        Column of the estimate that becomes each column.
    factor, offset : (d,) float arrays
        Factor and offset, applied after the change of order.
    """

    code: str
    text: str
    remedy: str
    order: tuple[int, ...]
    factor: Floats
    offset: Floats

    def __call__(self, estimate: Trajectories) -> Trajectories:
        """Return the estimate without the suspected fault."""
        state = estimate.state[:, self.order] * self.factor + self.offset
        return with_state(estimate, state)


def _saved_by(change: _Change, sample: Sample, fewest: int = FEWEST_PAIRS) -> float:
    """Return the share of the cost that a change saves, or 0 if the change is not credible."""
    there = sample.costs(change(sample.estimate))
    saved = saving(sample.here, there, min(len(sample.steps), 2))
    if not saved or len(there.taken) < fewest:
        return 0.0
    if change.code == "unit-scale" and np.abs(change.factor).min() < 1:
        # Shrinking moves any estimate near to true states at the origin.
        origin = sample.costs(replace(change, factor=0 * change.factor)(sample.estimate))
        if origin.upper.sum() < 2 * there.upper.sum():
            return 0.0
    return saved


def state_warnings(sample: Sample) -> list[Notice]:
    """Warn of units, axes and origin that look wrong, in at most one warning.

    Parameters
    ----------
    sample : Sample
        Sample of few steps.
    """
    if (
        not len(sample.steps)
        or sample.here.upper.sum() < NOTABLE_COST * sample.here.unassigned.sum()
    ):
        return []
    best = _best(sample, _linear(sample)) if sample.is_bad else None
    best = best or _best(sample, _displaced(sample), FITTED)
    suspicious = best is not None or few_are_near(sample.here)
    if suspicious and len(sample.steps) >= FIRST_STEPS:  # more steps must confirm the fault
        sample = sample.larger
        saved = _saved_by(best[1], sample) if best else 0.0
        best = (saved, best[1]) if best and saved else None
    if best is not None:
        saved, change = best
        return [
            Notice(
                code=change.code,
                text=f"{change.text} {falls(saved, len(sample.steps))}",
                remedy=change.remedy,
            )
        ]
    return nearness_warnings(sample)


def _best(
    sample: Sample, changes: Iterator[_Change], fewest: int = FEWEST_PAIRS
) -> tuple[float, _Change] | None:
    """Return the change that saves most, the first of equal ones; None without a credible one."""
    best: tuple[float, _Change] | None = None
    for change in changes:
        saved = _saved_by(change, sample, fewest)
        if saved > (best[0] + 1e-9 if best else 0.0):
            best = saved, change
    return best


def _linear(sample: Sample) -> Iterator[_Change]:
    """Yield changes of units, of the order of columns, and of signs."""
    columns = sample.columns
    size = len(columns)
    same, none = tuple(range(size)), np.zeros(size)
    circular = sample.distance.settings(columns).get("periodic", {})
    angles = [name for name in columns if name in PLACES]
    lengths = [name for name in columns if name not in (*circular, *angles)]
    upward = [name for name in lengths if name in UPWARD]
    groups = [lengths, upward, [name for name in lengths if name not in upward]]
    groups = [names for k, names in enumerate(groups) if names and names not in groups[:k]]
    tried = [
        (factor, units, names)
        for factor, units in FACTORS.items()
        for names in ([angles] * bool(angles) if "degrees" in units else groups)
    ]
    for factor, units, names in tried:
        named = ",".join(names)
        straight = np.array([name in names for name in columns])
        for by, far, (own, other) in ((factor, "small", units[::-1]), (1 / factor, "large", units)):
            value = plain(float(f"{by:.15g}"))
            way = option("unit_scale", value)  # angles lack this option
            if angles or names != lengths:
                way = option("estimate_scale", ",".join(f"{n}={value}" for n in names))
            yield _Change(
                code="unit-scale",
                text=f"coordinates of the estimate seem {factor:.6g} times too {far} for those "
                f"of the truth, as if in {own} instead of {other}; with {named} of the "
                f"estimate multiplied by {by:.6g},",
                remedy="write both files in one unit"
                + f", or use {way}" * ("degrees" not in units),
                order=same,
                factor=np.where(straight, by, 1.0),
                offset=none,
            )
    for order, signs in _turns(columns):
        yield _turned(columns, order, signs)


def _turns(columns: tuple[str, ...]) -> Iterator[tuple[tuple[int, ...], Floats]]:
    """Yield orders and signs of the columns, simple ones first, without the identity."""
    size = len(columns)
    same = tuple(range(size))
    if columns == BOX:
        yield (1, 0, 3, 2), np.ones(size)
        return
    places = next(
        (
            [columns.index(c) for c in names if c in columns]
            for names in POSITIONS
            if names[0] in columns
        ),
        list(same) if size <= 3 else [],
    )
    for k in range(1, len(places) + 1):
        for chosen in combinations(places, k):
            yield same, np.where(np.isin(same, chosen), -1.0, 1.0)
    for turned in list(permutations(places))[1:]:
        order = list(same)
        for place, source in zip(places, turned, strict=True):
            order[place] = source
        for signs in product((1.0, -1.0), repeat=len(places)):
            whole = np.ones(size)
            whole[places] = signs
            yield tuple(order), whole


def _turned(
    columns: tuple[str, ...], order: tuple[int, ...], signs: Floats, offset: Floats | None = None
) -> _Change:
    """Return the change that reorders or negates columns, or both."""
    negated = [name for name, sign in zip(columns, signs, strict=True) if sign < 0]
    moved = [
        (name, columns[source])
        for k, (name, source) in enumerate(zip(columns, order, strict=True))
        if source != k
    ]
    mapping = ",".join(f"{name}=HEADER" for name, _ in moved)
    names = " and ".join(name for name, _ in moved)
    if moved:
        text = f"{names} of the estimate seem swapped"
        text += f", with {' and '.join(negated)} negated" if negated else ""
    else:
        text = f"{' and '.join(negated)} of the estimate {'seem' if len(negated) > 1 else 'seems'}"
        text += " negated"
    named = f", or swap the headers with {option('estimate_columns', mapping)}"

    return _Change(
        code="axis-swap" if moved else "axis-sign",
        text=f"{text}; without this fault,",
        remedy="write both files in the same axes" + named * (bool(moved) and not negated),
        order=order,
        factor=signs,
        offset=np.zeros(len(columns)) if offset is None else offset,
    )


def _displaced(sample: Sample) -> Iterator[_Change]:
    """Yield changes of the origin, also with negated or exchanged axes."""
    columns = sample.columns
    size = len(columns)
    mean = None if sample.is_bad else _mean_difference(sample)
    if mean is None and not sample.is_bad:
        return
    axes = sample.distance.axes(sample.estimate, slice(None))
    reach = sample.distance.reach(sample.parameters.cutoff, axes)
    if reach.shape[0] != size or reach.shape[1] != 1 or columns == BOX:
        return  # such distances are not those of differences
    if sample.distance.settings(columns).get("periodic"):
        return
    same = tuple(range(size))
    if mean is not None:
        yield _moved(columns, mean)
        return
    radius = reach[:, 0]
    for order, signs in ((same, np.ones(size)), *_turns(columns)):
        plain = _turned(columns, order, signs)
        offset = _voted(sample.truth, plain(sample.estimate), radius)
        if offset is None:
            continue
        if order == same and (signs > 0).all():
            yield _moved(columns, offset)
        else:
            text = plain.text.removesuffix("; without this fault,")
            yield replace(
                plain,
                text=f"{text}, and the origin of the estimate differs; without these faults,",
                offset=offset,
                remedy="write both files in the same axes, from the same origin",
            )


def _moved(columns: tuple[str, ...], offset: Floats) -> _Change:
    size = len(columns)
    vector = ", ".join(
        f"{0.0 - value:.0f}" if abs(value) >= 1e4 else f"{0.0 - value:.4g}" for value in offset
    )
    return _Change(
        code="offset",
        text=f"the estimate seems displaced by ({vector}) in {','.join(columns)}; without this "
        "offset,",
        remedy="bring both files to one origin. Do not correct a bias or a latency of the tracker, "
        "because they are errors that should count",
        order=tuple(range(size)),
        factor=np.ones(size),
        offset=offset,
    )


def _mean_difference(sample: Sample) -> Floats | None:
    """Return the common difference of near pairs, if it is most of their distance."""
    here = sample.here
    if len(here.taken) < FITTED:
        return None
    truth, estimate = (
        (side.side, side.row[rows[here.ranked]])
        for side, rows in zip(sample.rows, here.rows, strict=True)
    )
    if np.count_nonzero(np.bincount(truth[0].track[truth[1]])) < FEWEST_TRACKS:
        return None
    differences = truth[0].state[truth[1]] - estimate[0].state[estimate[1]]
    mean = differences.mean(axis=0)
    if 2 * np.square(differences - mean).sum() > np.square(differences).sum():
        return None
    return np.asarray(mean)


def _voted(truth: Trajectories, estimate: Trajectories, radius: Floats) -> Floats | None:
    """Return the difference on which most pairs agree within the radius (d,)."""
    rows = _crossed(truth.step, estimate.step, len(truth.times))
    if rows is None:
        return None
    differences = truth.state[rows[0]] - estimate.state[rows[1]]
    scaled = np.array([column / own for column, own in zip(differences.T, radius, strict=True)])
    if not np.isfinite(scaled).all() or np.abs(scaled).max() > 2.0**52:
        return None
    cell = np.zeros(len(differences), np.int64)
    for column in np.floor(scaled):  # np.unique of rows is ten times slower
        values, place = np.unique(column, return_inverse=True)
        cell = np.unique(cell * len(values) + place, return_inverse=True)[1]
    near = cell == np.bincount(cell).argmax()
    for _ in range(5):
        centre = scaled[:, near].mean(axis=1)
        near = np.abs(scaled - centre[:, None]).max(axis=0) < 1
    centre = scaled[:, near].mean(axis=1)
    return np.asarray(centre * radius)


def _crossed(first: Ints, second: Ints, steps: int) -> tuple[Ints, Ints] | None:
    """Return rows of all pairs of some steps, close to the required number of votes."""
    counts = [np.bincount(side, minlength=steps) for side in (first, second)]
    starts = [np.concatenate(([0], np.cumsum(count))) for count in counts]
    pairs = counts[0] * counts[1]
    chosen = np.flatnonzero(pairs)
    together = int(pairs.sum())
    if not together:
        return None
    votes = max(VOTES, EACH * int(counts[1].max()))
    chosen = chosen[:: -(-together // votes)]
    left, right = [], []
    for step in chosen.tolist():
        thin = -(-int(pairs[step]) // votes)
        i = np.arange(starts[0][step], starts[0][step + 1])[::thin]
        j = np.arange(starts[1][step], starts[1][step + 1])
        left.append(np.repeat(i, len(j)))
        right.append(np.tile(j, len(i)))
    return np.concatenate(left), np.concatenate(right)
