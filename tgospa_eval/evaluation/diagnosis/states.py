"""Warnings about the states: truth and estimate may differ in units, axes or origin.

A trial undoes each suspected fault at some steps of both sides. There is a warning only if the
trial at least halves the per-step GOSPA cost.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, median
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
from tgospa_eval.formats.headers import BOX, ask
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES, Trajectories

SIDES = ("truth", "estimate")
EMPTY_OTHER_SIDE = ("all estimates are false", "all ground-truth objects are missed")


def side_warnings(sides: tuple[Trajectories, Trajectories]) -> list[Notice]:
    """Return warnings about rows and ids of truth and estimate that are probably not intended."""
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
"""If a smaller share of the possible pairs is near, a test says if this is only by chance."""

UNLIKE = 4
"""Largest ratio of the numbers of rows of truth and estimate for the test.

With a larger ratio, most rows of one side have no partner anyway."""

ENOUGH = 100
"""Smallest number of possible pairs for the test."""

HARDLY = 1.5
"""Pairs may be near by chance if they save at most this multiple of the saving by chance.

The saving by chance is measured with displaced estimates. Some displaced estimates are far from all
true states, so wrong pairs of the given estimates can save a little more. Right pairs save more
than this multiple, if the noise of the estimates is below the cutoff."""

LITTLE = 0.005
"""Share of the possible saving that is subtracted from the saving of the pairs in the test.

Two states that move in the same direction can stay near each other by chance."""

MOVES = (3.0, 6.0)
"""Displacements of the estimates along a line, as multiples of the cutoff, in both directions."""


def few_are_near(here: StepCosts) -> bool:
    """Return whether disjoint near pairs are so few that they may be near by chance."""
    if not len(here.taken):
        return True
    rows = sorted(map(len, here.objects))
    return len(here.taken) < SOME * here.possible and rows[1] <= UNLIKE * rows[0]


def nearness_warnings(sample: Sample) -> list[Notice]:
    """Warn if no true state has an estimate within the cutoff, or only some by chance."""
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

    For the saving by chance, all estimates are displaced by a few cutoffs along several lines, far
    from their objects. The line with the largest saving counts. For example, an estimate that is
    displaced along a road can be near another object by chance, but an estimate that is displaced
    across the road cannot. A displacement in time would not do, because objects at rest keep their
    position.
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
    """Return the cost that the greedy choice of pairs saves, in units of c^p."""
    return float((costs.unassigned - costs.upper).sum())


def _lines(sample: Sample) -> Iterator[Floats]:
    """Yield vectors along which estimates are displaced, about as long as the cutoff.

    The vectors are along the first two axes, their diagonals, and the direction in which the truth
    is spread most. A vector has the shape (1, d), or (R, d) if it differs between rows.
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
"""Factors by which coordinates may be wrong, and the units that would explain this."""

FEWEST_PAIRS = 6
"""Smallest number of near pairs after a change that is credible.

A change with a fitted offset needs `FITTED` pairs."""

FITTED = 12

VOTES, EACH = 6_000, 40
"""Limits of the number of differences between states in the search for an offset.

The first is a limit of all differences. The second is multiplied by the largest number of estimates
at a step. The larger limit is used."""

LEVEL = 0.05
"""A unit is credible if the change makes the medians equal up to this share of them.

If not, the change must be clearly better than a constant and an offset in the same columns."""

UPWARD = ("z", HEIGHT)
"""Columns that may have their own unit, such as feet."""

POSITIONS = (("x", "y", "z"), ("lat", "lon"))


@dataclass(frozen=True, kw_only=True)
class _Change:
    """Change of one side that undoes a fault: ``state[:, order] * factor + offset``.

    Parameters
    ----------
    code : str
        Code of the warning.
    text : str
        Suspected fault, and its correction, as the beginning of a sentence.
    remedy : str
        Remedy, as it is proposed to the user.
    order : tuple of int
        New order of the columns: indices of the columns of the side.
    factor, offset : (d,) float arrays
        Factor and offset of each column in the new order.
    place : int, optional
        Place of the changed side: 0 for the truth, 1 for the estimate.
    """

    code: str
    text: str
    remedy: str
    order: tuple[int, ...]
    factor: Floats
    offset: Floats
    place: int = 1

    def __call__(self, side: Trajectories) -> Trajectories:
        """Return the side after the change."""
        return with_state(side, side.state[:, self.order] * self.factor + self.offset)

    def costs(self, sample: Sample) -> StepCosts:
        """Return the costs of a sample after the change."""
        return sample.costs(self((sample.truth, sample.estimate)[self.place]), self.place)


def _saved_by(change: _Change, sample: Sample, fewest: int = FEWEST_PAIRS) -> float:
    """Return the share of the cost that a change saves, or 0 if the change is not credible."""
    there = change.costs(sample)
    saved = saving(sample.here, there, min(len(sample.steps), 2))
    if not saved or len(there.taken) < fewest:
        return 0.0
    if change.code == "unit-scale":
        other, own = (
            np.array([median(column) for column in side.state.T])
            for side in (sample.truth, sample.estimate)[:: 2 * change.place - 1]
        )
        same = change.factor == 1
        if (same | (np.abs(change.factor * own - other) < LEVEL * np.abs(other))).all():
            return saved
        for kept in (0.0, 1.0):
            factor, offset = np.where(same, 1.0, kept), np.where(same, 0.0, other - kept * own)
            rival = replace(change, factor=factor, offset=offset).costs(sample)
            if rival.upper.sum() <= 2 * there.upper.sum():
                return 0.0
    return saved


SURE = 0.95
"""Share of the cost that feet must save if the cost is not bad.

A change from metres to feet shrinks the errors of heights near 0, and saves 91 % at most."""


def _is_of_feet(change: _Change, columns: Sequence[str]) -> bool:
    """Return whether a change only converts heights between feet and metres."""
    heights = np.array([name in UPWARD for name in columns])
    feet = np.isclose(np.abs(np.log(change.factor[heights])), -np.log(0.3048))
    is_scale = change.code == "unit-scale" and (change.factor[~heights] == 1).all()
    return bool(is_scale and len(feet) and feet.all())


def state_warnings(
    sample: Sample, frames: Sequence[str] = ("", ""), headers: Mapping[str, str] | None = None
) -> list[Notice]:
    """Return at most one warning, about units, axes or origin that look wrong.

    Parameters
    ----------
    sample : Sample
        Sample of `FIRST_STEPS` steps at most; if it looks wrong, more steps are sampled.
    frames : pair of str
        Declared coordinate frames of truth and estimate, or blanks.
    headers : mapping of str to str, optional
        Header of each column of the estimate, if it is a table.
    """
    if (
        not len(sample.steps)
        or sample.here.upper.sum() < NOTABLE_COST * sample.here.unassigned.sum()
    ):
        return []
    trials: Iterable[_Change] = ()
    if sample.is_bad or {*sample.columns} & {*UPWARD}:
        trials = _linear(sample, frames, headers or {})
    if not sample.is_bad:  # heights in feet have errors below a large cutoff
        trials = (one for one in trials if _is_of_feet(one, sample.columns))
    best = _best(sample, trials)
    best = best if best and (sample.is_bad or best[0] > SURE) else None
    best = best or _best(sample, _displaced(sample), FITTED)
    suspicious = best is not None or few_are_near(sample.here)
    if suspicious and len(sample.steps) >= FIRST_STEPS:  # a fault is tested again with more steps
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
    sample: Sample, changes: Iterable[_Change], fewest: int = FEWEST_PAIRS
) -> tuple[float, _Change] | None:
    """Return the change that saves most, with its saving, or None if none is credible.

    Of equal changes, the first one is returned.
    """
    best: tuple[float, _Change] | None = None
    for change in changes:
        saved = _saved_by(change, sample, fewest)
        if saved > (best[0] + 1e-9 if best else 0.0):
            best = saved, change
    return best


def _linear(sample: Sample, frames: Sequence[str], headers: Mapping[str, str]) -> Iterator[_Change]:
    """Yield changes of units, and changes of the order and the signs of columns."""
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
    in_metres = sample.distance.on_earth or any(frames)
    for factor, units, names in tried:
        straight = np.array([name in names for name in columns])
        for by, unit in ((factor, units[1]), (1 / factor, units[0])):
            both = [_own_columns(names, frame, whole=names == lengths) for frame in frames]
            # Metres are right if states are compared in metres, or if only heights differ.
            stays = unit == "metres" and (in_metres or names == upward != lengths)
            wrong = int(not both[0] or (bool(both[1]) and not stays))
            own = both[wrong]
            scale = by if wrong else 1 / by
            value = plain(float(f"{scale:.15g}"))
            way = option("unit_scale", value)  # only if all columns are lengths of the estimate
            if angles or names != lengths or not wrong:
                way = option(f"{SIDES[wrong]}_scale", ",".join(f"{n}={value}" for n in own))
            what, other = units if scale < 1 else units[::-1]
            yield _Change(
                code="unit-scale",
                text=f"coordinates of the {SIDES[wrong]} seem {factor:.6g} times too "
                f"{'large' if scale < 1 else 'small'} for those of the {SIDES[1 - wrong]}, as if "
                f"in {what} instead of {other}; with {','.join(own or names)} of the "
                f"{SIDES[wrong]} multiplied by {scale:.6g},",
                remedy="write both files in one unit"
                + f", or use {way}" * bool(own and "degrees" not in units),
                order=same,
                factor=np.where(straight, scale, 1.0),
                offset=none,
                place=wrong,
            )
    for order, signs in _turns(columns):
        change = _turned(columns, order, signs)
        yield replace(change, remedy=_swap(columns, order, signs, frames, headers) or change.remedy)


def _own_columns(names: list[str], frame: str, *, whole: bool) -> list[str]:
    """Return the columns of a side in `frame` that are in proportion to the columns `names`.

    `whole` says that `names` are all lengths. The result is empty if there are no such columns.
    """
    if frame.startswith("range"):
        return ["range"] * whole
    if frame.startswith("lat") and names[0] not in PLACES:
        return [HEIGHT] if names in (["z"], [HEIGHT]) else []
    return names


def _swap(
    columns: tuple[str, ...],
    order: tuple[int, ...],
    signs: Floats,
    frames: Sequence[str],
    headers: Mapping[str, str],
) -> str:
    """Return the remedy for columns that are exchanged; blank if no option exchanges them."""
    is_ned = order[:2] == (1, 0) and order[2:] == (2,) * (len(order) - 2)
    if is_ned and (signs == [1, 1, -1][: len(order)]).all():
        for role, frame in list(zip(SIDES, frames, strict=True))[::-1]:
            if frame in ("enu", "ned"):
                return option(f"{role}_crs", "ned" if frame == "enu" else "enu")
    # In any other frame, the file does not have the columns that are compared.
    is_own = frames[1] in ("", "enu", "ned", ",".join(columns))
    if not is_own or list(order) == sorted(order) or (signs < 0).any() or {*columns} - {*headers}:
        return ""
    swapped = [headers[columns[k]] for k in order]
    items = [
        name if header.casefold() == name else f"{name}={header}"
        for name, header in zip(columns, swapped, strict=True)
    ]
    return (
        "write both files in the same axes, or swap the headers with "
        f"{ask('estimate_columns', items)}"
    )


def _turns(columns: tuple[str, ...]) -> Iterator[tuple[tuple[int, ...], Floats]]:
    """Yield new orders of the columns with new signs, simple ones first.

    The present order with the present signs is left out.
    """
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
    """Return the change to a new order and new signs of the columns."""
    negated = [name for name, sign in zip(columns, signs, strict=True) if sign < 0]
    moved = [name for k, name in enumerate(columns) if order[k] != k]
    names = " and ".join(moved)
    if moved:
        text = f"{names} of the estimate seem swapped"
        text += f", with {' and '.join(negated)} negated" if negated else ""
    else:
        text = f"{' and '.join(negated)} of the estimate {'seem' if len(negated) > 1 else 'seems'}"
        text += " negated"
    return _Change(
        code="axis-swap" if moved else "axis-sign",
        text=f"{text}; without this fault,",
        remedy="write both files in the same axes",
        order=order,
        factor=signs,
        offset=np.zeros(len(columns)) if offset is None else offset,
    )


def _displaced(sample: Sample) -> Iterator[_Change]:
    """Yield changes of the origin, and of the origin together with order and signs of axes."""
    columns = sample.columns
    size = len(columns)
    mean = None if sample.is_bad else _mean_difference(sample)
    if mean is None and not sample.is_bad:
        return
    axes = sample.distance.axes(sample.estimate, slice(None))
    reach = sample.distance.reach(sample.parameters.cutoff, axes)
    if reach.shape[0] != size or reach.shape[1] != 1 or columns == BOX:
        return  # the distance does not depend on differences of columns
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
    """Return the mean difference of near pairs if it explains most of their distances, or None."""
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
    """Return the most frequent difference of a true state and an estimate at the same step.

    Differences within `radius` (d,) of the result count as equal, and the result is their mean. It
    is None if there are no pairs, or if numbers are too large.
    """
    rows = _crossed(truth.step, estimate.step, len(truth.times))
    if rows is None:
        return None
    differences = truth.state[rows[0]] - estimate.state[rows[1]]
    scaled = np.array([column / own for column, own in zip(differences.T, radius, strict=True)])
    if not np.isfinite(scaled).all() or np.abs(scaled).max() > 2.0**52:
        return None
    cell = np.zeros(len(differences), np.int64)
    for column in np.floor(scaled):  # by column, as np.unique of rows is ten times slower
        values, place = np.unique(column, return_inverse=True)
        cell = np.unique(cell * len(values) + place, return_inverse=True)[1]
    near = cell == np.bincount(cell).argmax()
    for _ in range(5):
        centre = scaled[:, near].mean(axis=1)
        near = np.abs(scaled - centre[:, None]).max(axis=0) < 1
    centre = scaled[:, near].mean(axis=1)
    return np.asarray(centre * radius)


def _crossed(first: Ints, second: Ints, steps: int) -> tuple[Ints, Ints] | None:
    """Return the rows of truth and estimate of pairs at the same step, or None if there are none.

    Steps and rows are thinned out evenly, so that the pairs are about as many as `VOTES` allows.
    """
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
