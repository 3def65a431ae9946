"""Repairs that may save something, with what they would save if nothing else changed.

Costs are in units of c^p. What is said here only decides what is tried: `explain.trials` proves.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.explain import edits
from tgospa_eval.explain.assigned import Assigned, Stretch
from tgospa_eval.explain.edits import Edit
from tgospa_eval.problem.problem import Ints

HALVES = 2
"""Halves of a switch from one estimate to another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A repair that may be worth a trial.

    Parameters
    ----------
    kind : str
        One of `results.repairs.KINDS`.
    saving : float
        What it would save at the assignment at hand, in units of c^p.
    edit : Edit
        What it does.
    tracks : tuple of int
        The estimates that it changes; none where it changes all.
    begin, end : int, optional
        The steps that it is about.
    """

    kind: str
    saving: float
    edit: Edit
    tracks: tuple[int, ...] = ()
    begin: int | None = None
    end: int | None = None


def best(candidates: Iterable[Candidate], most: int) -> list[Candidate]:
    """Those that save most, in order; what saves nothing is left out."""
    able = (candidate for candidate in candidates if candidate.saving > 0)
    return sorted(able, key=lambda candidate: -candidate.saving)[:most]


def of_names(assigned: Assigned, names: tuple[str, ...]) -> Iterator[Candidate]:
    """Tracks to merge, to exchange from a step on, and to split; `names` are ids not to repeat."""
    yield from _exchanged(assigned)
    yield from _split(assigned, names)


def _exchanged(assigned: Assigned) -> Iterator[Candidate]:
    """Of each change of a truth from one estimate to another the exchange of the two."""
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    by_truth: dict[int, list[Stretch]] = defaultdict(list)
    truths: dict[int, set[int]] = defaultdict(set)
    for stretch in assigned.stretches:
        by_truth[stretch.truth].append(stretch)
        truths[stretch.estimate].add(stretch.truth)
    seen: set[tuple[int, ...]] = set()
    for own in by_truth.values():
        for before, after in pairwise(own):
            a, b = sorted((before.estimate, after.estimate))
            whole = _together(assigned, a, b) if (a, b) not in seen else None
            seen.add((a, b))
            beside = [by_truth[i] for i in sorted(truths[a] | truths[b])]
            if whole is not None:
                named = [[a if s.estimate == b else s.estimate for s in part] for part in beside]
                saved = sum(_changes([s.estimate for s in part]) for part in beside)
                saved -= sum(map(_changes, named))
                yield _renamed(whole, HALVES * saved * float(prices[after.begin]))
            step = _first_row(assigned, a, b, after.begin)
            if whole is None and step is not None and (a, b, step) not in seen:
                seen.add((a, b, step))
                saved = sum(_exchange_saves(part, a, b, step) for part in beside)
                yield Candidate(
                    kind="exchange",
                    saving=HALVES * saved * float(prices[after.begin]),
                    edit=edits.exchange(a, b, after.begin, steps),
                    tracks=_in_time(assigned, a, b, step),
                    begin=step,
                )


def _renamed(candidate: Candidate, saving: float) -> Candidate:
    return Candidate(**{**vars(candidate), "saving": saving})


def _together(assigned: Assigned, a: int, b: int) -> Candidate | None:
    """Two tracks as one, if they are never at the same step."""
    step = assigned.estimate.side.step
    first, second = (step[assigned.estimate.rows(track)] for track in (a, b))
    if np.isin(first, second).any():
        return None
    into, track = (a, b) if first[0] < second[0] else (b, a)
    later = step[assigned.estimate.rows(track)]
    return Candidate(
        kind="merge",
        saving=0.0,
        edit=edits.merge(track, into, assigned.problem.steps),
        tracks=(into, track),
        begin=int(later[0]),
        end=int(later[-1]),
    )


def _first_row(assigned: Assigned, a: int, b: int, step: int) -> int | None:
    """The first step from this one on at which one of two tracks exists."""
    found = [assigned.estimate.side.step[assigned.estimate.rows(track)] for track in (a, b)]
    later = np.concatenate([own[own >= step] for own in found])
    return int(later.min()) if len(later) else None


def _in_time(assigned: Assigned, a: int, b: int, step: int) -> tuple[int, int]:
    """The two, first the one that ends before the step, if one does."""
    last = int(assigned.estimate.side.step[assigned.estimate.rows(b)][-1])
    return (b, a) if last < step else (a, b)


def _changes(estimates: list[int]) -> int:
    return sum(one != other for one, other in pairwise(estimates))


def _exchange_saves(stretches: list[Stretch], a: int, b: int, step: int) -> int:
    """Changes of a truth at a step that there are, less those after an exchange from it on."""
    before = [s.estimate for s in stretches if s.begin < step]
    after = [s.estimate for s in stretches if s.end >= step]
    if not before or not after:
        return 0
    one, other = before[-1], after[0]
    named = {a: b, b: a}.get(other, other)
    return int(one != other) - int(one != named)


def _split(assigned: Assigned, names: tuple[str, ...]) -> Iterator[Candidate]:
    """Of each change of an estimate from one truth to another its split."""
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    tracks = assigned.problem.estimates
    truths: dict[int, list[Stretch]] = defaultdict(list)
    estimates: dict[int, list[Stretch]] = defaultdict(list)
    for stretch in assigned.stretches:
        truths[stretch.truth].append(stretch)
        estimates[stretch.estimate].append(stretch)
    for track, own in estimates.items():
        own.sort(key=lambda stretch: stretch.begin)
        for before, after in pairwise(own):
            if before.truth == after.truth:
                continue
            halves = int(truths[before.truth][-1] is before) + int(truths[after.truth][0] is after)
            rows = assigned.estimate.side.step[assigned.estimate.rows(track)]
            step = int(rows[np.searchsorted(rows, after.begin)])
            yield Candidate(
                kind="split",
                saving=halves * float(prices[after.begin]),
                edit=edits.split(
                    track, after.begin, steps, tracks, _other_name(names[track], names)
                ),
                tracks=(track,),
                begin=step,
            )


def _other_name(name: str, names: tuple[str, ...]) -> str:
    """A name like this one that there is not."""
    number = 2
    while f"{name}_{number}" in names:
        number += 1
    return f"{name}_{number}"


def of_rows(assigned: Assigned, most: int) -> Iterator[Candidate]:
    """Tracks to drop, and their ends to cut off, where nothing is."""
    problem, side = assigned.problem, assigned.estimate.side
    free = assigned.follows < 0
    partner = assigned.truth.find(assigned.follows, side.step)
    # What follows a truth is worth what the truth costs without it, less the pair.
    worth = -side.price
    worth[~free] = problem.truth_price[partner[~free]] - assigned.cost[~free]
    saved = -np.bincount(side.track, worth, minlength=side.count)
    for stretch in assigned.stretches:
        price = problem.switch_price_at
        saved[stretch.estimate] += float(price[stretch.begin]) if stretch.begin else 0.0
    saved[np.diff(assigned.estimate.first) == 0] = 0.0  # of which no row is left
    for track in np.argsort(-saved, kind="stable")[:most].tolist():
        if saved[track] > 0:
            yield _dropped(assigned, track, float(saved[track]))
    for track in range(side.count):
        rows = assigned.estimate.rows(track)
        used = np.flatnonzero(~free[rows])
        if not len(used):
            continue
        for cut in (rows[: used[0]], rows[used[-1] + 1 :]):
            if len(cut):
                yield _cut(assigned, track, cut)


def _dropped(assigned: Assigned, track: int, saving: float) -> Candidate:
    steps = assigned.estimate.side.step[assigned.estimate.rows(track)]
    return Candidate(
        kind="drop",
        saving=saving,
        edit=edits.drop(track),
        tracks=(track,),
        begin=int(steps[0]),
        end=int(steps[-1]),
    )


def _cut(assigned: Assigned, track: int, rows: Ints) -> Candidate:
    side = assigned.estimate.side
    begin, end = int(side.step[rows[0]]), int(side.step[rows[-1]])
    last = assigned.problem.steps - 1
    kept = (end + 1, last) if rows[0] == assigned.estimate.rows(track)[0] else (0, begin - 1)
    return Candidate(
        kind="trim",
        saving=float(side.price[rows].sum()),
        edit=edits.cut(track, *kept),
        tracks=(track,),
        begin=begin,
        end=end,
    )
