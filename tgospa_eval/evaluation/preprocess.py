"""Rows that benchmarks leave out before the evaluation; on request they are only marked.

MOTChallenge of 2016 and 2017, and KITTI in the image, match boxes of the estimate and the truth one
to one at each step. The matching has the largest sum of IoU; only pairs with an IoU of 1/2 or more
count. An estimate is left out if it is matched with a true object that is not evaluated. KITTI also
leaves out an estimate without a match if it is small, or has more than half of its area in one
`DontCare` region. Rules and their order are those of TrackEval. As in TrackEval, the order of rows
in the file decides between equal sums.

VisDrone leaves out boxes of truth and estimate that are inside the ignored regions of their step. A
box is inside if the regions together cover at least half of its area. The function ``dropObjects``
of the VisDrone toolkit does the same, but it also uses the edge of the image, which is in no file.
UA-DETRAC uses the same rule as VisDrone.

With ``:ignore`` after the name of a benchmark, rows are marked and not left out. True objects that
are not evaluated are ignored. Estimates that are small or in a region are excused. The matching is
not used: the metric decides over all time steps which tracks follow ignored objects.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances.boxes import TRACKEVAL_EPS, overlaps
from tgospa_eval.distances.pair_search import starts_of_steps
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.regions import inside
from tgospa_eval.formats import Reading
from tgospa_eval.formats.reading import Regions
from tgospa_eval.formats.rows import AS_REGIONS
from tgospa_eval.formats.text.table import IGNORED
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.alignment import TimeMatching, align
from tgospa_eval.tracks.coverage import marked
from tgospa_eval.tracks.trajectories import file_order

IGNORE = "ignore"

PEDESTRIAN = "1"
DISTRACTORS = ("2", "7", "8", "12")
"""Classes of a person on a vehicle, a static person, a distractor, and a reflection."""

NEIGHBOURS = {"car": ("Van",), "pedestrian": ("Person", "Person_sitting")}
"""Classes that KITTI evaluates, and classes with which a tracker may confuse them."""

HIDDEN = ("truncated", "occluded")
MAX_OCCLUDED, MIN_HEIGHT = 2, 25
"""Largest occlusion of an evaluated true object; height in pixels that estimates must exceed.

Truncated true objects are not evaluated."""

MIN_MATCH = 0.5 - TRACKEVAL_EPS
"""Smallest IoU of boxes that match."""

MAX_INSIDE = 0.5 + TRACKEVAL_EPS
"""Largest share of a box in one `DontCare` region; a box with a larger share is left out."""


class RowRoles(NamedTuple):
    """Roles of the rows of both sides in a benchmark.

    Parameters
    ----------
    truth : Reading
        Truth to which the masks belong.
    evaluated, neutral : (R,) bool arrays
        Rows of the truth that a tracker must follow, and rows that it may follow.
    removed, excused : bool arrays
        Rows of the estimate that the benchmark leaves out, and rows that ``:ignore`` excuses.
    """

    truth: Reading
    evaluated: Mask
    neutral: Mask
    removed: Mask
    excused: Mask


def preprocessed(
    rule: str,
    sides: tuple[Reading, ...],
    everything: Callable[[], Reading],
    names: tuple[str, str],
    regions: Regions | None,
) -> tuple[Reading, Reading]:
    """Return truth and estimate as a benchmark evaluates them.

    Parameters
    ----------
    rule : str
        Name of the benchmark; with ``:ignore``, rows are marked instead of left out.
    sides : pair of Reading
        Boxes with their classes. The truth has the classes that are evaluated, and those with which
        they may be confused.
    everything : callable
        Callable that reads all boxes of the truth, with classes and the attribute ``conf``.
    names : pair of str
        Names of the files, for messages.
    regions : Regions, optional
        Regions of the option ``--ignore-regions``.

    Raises
    ------
    ConfigError
        The truth does not mark the boxes that are not evaluated, or the regions of UA-DETRAC are
        missing.
    """
    benchmark, _, how = rule.partition(":")
    chosen = option("preprocess", rule)
    truth, estimate = sides
    if benchmark == "uadetrac":
        if regions is None:
            raise ConfigError(
                f"{chosen}: needs the regions of the sequence; give {option('ignore_regions')}"
            )
    elif truth.format != benchmark:
        raise ConfigError(
            f"{chosen}: {names[0]} is read as {truth.format or 'a table'}; only files of "
            f"{benchmark} say what is not evaluated"
        )
    if benchmark == "motchallenge":
        if truth.klass is None:
            raise ConfigError(f"{chosen}: {names[0]} has no classes in column 8")
        roles = _motchallenge(truth, estimate, everything(), names, whole=how == IGNORE)
    elif benchmark == "kitti":
        roles = _kitti(truth, estimate, names)
    elif benchmark == "visdrone":
        roles = _visdrone(truth, estimate, names)
    else:
        roles = _in_regions(truth, estimate, regions, names)
    if how != IGNORE:
        return kept_rows(roles.truth, roles.evaluated), kept_rows(estimate, ~roles.removed)
    kept = roles.evaluated | roles.neutral
    truth = kept_rows(roles.truth, kept)
    return (
        replace(truth, trajectories=marked(truth.trajectories, roles.neutral[kept])),
        replace(estimate, trajectories=marked(estimate.trajectories, roles.excused)),
    )


def benchmark_warnings(truth: Reading, everything: Callable[[], Reading]) -> Iterator[Notice]:
    """Warn if the numbers include rows that the tables of a benchmark leave out.

    Parameters
    ----------
    truth : Reading
        Truth as it is compared.
    everything : callable
        Callable that reads all boxes of the truth, with the attribute ``class`` if it exists.
    """
    text = ""
    if truth.format == "motchallenge":
        classes = everything().trajectories.attributes.get("class", np.zeros(0)).astype(str)
        count = int(np.isin(classes, [*DISTRACTORS, *map("{}.0".format, DISTRACTORS)]).sum())
        if count:
            text = (
                f"{counted(count, 'box is a distractor', 'boxes are distractors')} (classes "
                f"{', '.join(DISTRACTORS)}), and a tracker is penalised for reporting them"
            )
    elif truth.format == "kitti" and IGNORED in truth.left_out:
        text = (
            f"KITTI's tables are for one class and leave out estimates in {IGNORED} regions, on "
            "neighbouring classes (Van, Person_sitting), or too small; here all of them count"
        )
    elif truth.format == "visdrone" and not truth.left_out.keys().isdisjoint(AS_REGIONS):
        text = (
            "VisDrone's tables leave out estimates in ignored regions and on class others; here "
            "all of them count"
        )
    if text:
        rule = truth.format
        way = f"{option('preprocess', rule)}"
        way += f" {option('class_', 'car')}, or pedestrian," * (rule == "kitti")
        yield Notice(
            code="benchmark-rules",
            text=f"{text}; so HOTA, MOTA and IDF1 differ from the tables",
            remedy=f"{way} leaves out the same rows as the benchmark",
        )


def evaluated_class(classes: tuple[str, ...] | None, rule: str) -> str:
    """Return the requested class of the truth, which must be a class that KITTI evaluates.

    Raises
    ------
    ConfigError
        KITTI does not evaluate the class, or the number of requested classes is not one.
    """
    requested = [name.strip().casefold() for name in classes or ()]
    if len(requested) != 1 or requested[0] not in NEIGHBOURS:
        given = f", not for {quoted(','.join(classes))}" if classes else ""
        raise ConfigError(
            f"{option('preprocess', rule)}: is for one class{given}; use {option('class_', 'car')} "
            f"or {option('class_', 'pedestrian')}"
        )
    return requested[0]


def _motchallenge(
    truth: Reading, estimate: Reading, everything: Reading, names: tuple[str, str], *, whole: bool
) -> RowRoles:
    """Return roles by the rules of MOTChallenge: pedestrians are evaluated, distractors neutral.

    With `whole`, the roles are those of `everything`. Its rows with the flag 0 are not evaluated.
    """
    distractors = _of_classes(everything, DISTRACTORS)
    removed = _on(distractors, _matched(everything, estimate, names))
    if not whole:
        pedestrians = _of_classes(truth, (PEDESTRIAN,))
        return RowRoles(truth, pedestrians, ~pedestrians, removed, removed)
    evaluated = _of_classes(everything, (PEDESTRIAN,))
    evaluated &= everything.trajectories.attributes["conf"] != 0
    return RowRoles(everything, evaluated, distractors, removed, np.zeros_like(removed))


def _kitti(truth: Reading, estimate: Reading, names: tuple[str, str]) -> RowRoles:
    """Return roles by the rules of KITTI: visible objects of the class are evaluated."""
    truncated, occluded = (truth.trajectories.attributes[name] for name in HIDDEN)
    neighbours = sorted(set().union(*NEIGHBOURS.values()), key=str.casefold)
    neutral = _of_classes(truth, tuple(neighbours))
    neutral |= (np.trunc(occluded) > MAX_OCCLUDED) | (np.trunc(truncated) > 0)
    match = _matched(truth, estimate, names)
    boxes = estimate.trajectories
    excused = boxes.state[:, 3] <= MIN_HEIGHT + TRACKEVAL_EPS
    if truth.regions is not None:
        excused |= inside(truth.regions, boxes, 0.0, names[1], MAX_INSIDE)
    removed = np.where(match >= 0, _on(neutral, match), excused)
    return RowRoles(truth, ~neutral, neutral, removed, excused)


def _visdrone(truth: Reading, estimate: Reading, names: tuple[str, str]) -> RowRoles:
    """Return roles by the rule of VisDrone, which is that of UA-DETRAC, but in whole pixels.

    Regions grow by one pixel at the left and at the top.
    """
    wider = np.array([-1.0, -1.0, 1.0, 1.0])
    regions = truth.regions and replace(
        truth.regions,
        shapes=tuple(
            replace(shape, rings=(_pixels(shape.rings[0]) + wider,))
            for shape in truth.regions.shapes
        ),
    )
    first, second = (
        replace(side, trajectories=replace(whole, state=_pixels(whole.state)))
        for side, whole in ((truth, truth.trajectories), (estimate, estimate.trajectories))
    )
    return _in_regions(first, second, regions, names)._replace(truth=truth)


def _pixels(boxes: Floats) -> Floats:
    """Round the numbers of boxes to whole pixels, halves up; numbers below 1 become 1."""
    return np.maximum(np.floor(boxes + 0.5), 1.0)


def _in_regions(
    truth: Reading, estimate: Reading, regions: Regions | None, names: tuple[str, str]
) -> RowRoles:
    """Return roles in which states inside a region do not count."""
    within, excused = (
        np.zeros(side.taken, bool)
        if regions is None
        else inside(regions, side.trajectories, 0.0, name)
        for side, name in zip((truth, estimate), names, strict=True)
    )
    return RowRoles(truth, ~within, within, excused, excused)


def _of_classes(reading: Reading, names: tuple[str, ...]) -> Mask:
    """Return a mask of rows of these classes; upper and lower case are the same."""
    assert reading.klass is not None
    wanted = {name.casefold() for name in names}
    known = [k for k, name in enumerate(reading.classes) if name.casefold() in wanted]
    return np.asarray(np.isin(reading.klass, known))


def _on(neutral: Mask, match: Ints) -> Mask:
    """Return a mask of the estimate rows that match a row of the truth in `neutral`."""
    return np.asarray((match >= 0) & np.append(neutral, False)[match])


def _matched(truth: Reading, estimate: Reading, names: tuple[str, str]) -> Ints:
    """Return the row of the truth that matches each row of the estimate, or -1."""
    from scipy.optimize import linear_sum_assignment  # lazy: slow to import

    aligned = align(truth.trajectories, estimate.trajectories, TimeMatching(), names)
    sides = aligned.truth, aligned.estimate
    matches = np.full(len(aligned.estimate.step), -1)
    starts = [starts_of_steps(side) for side in sides]
    orders = [file_order(side.step, side.attributes) for side in sides]
    for step in range(len(sides[0].times)):
        rows, columns = (
            order[start[step] : start[step + 1]]
            for order, start in zip(orders, starts, strict=True)
        )
        overlap = overlaps(sides[0].state[rows][:, None], sides[1].state[columns])
        overlap[overlap < MIN_MATCH] = 0.0
        i, j = linear_sum_assignment(-overlap)
        some = overlap[i, j] > TRACKEVAL_EPS
        matches[columns[j[some]]] = rows[i[some]]
    return matches


def kept_rows(reading: Reading, keep: Mask, rule: str = "preprocess") -> Reading:
    """Return only the rows of the mask `keep`; all steps of the file stay.

    The number of rows left out is recorded under the name `rule`.
    """
    count = int(np.count_nonzero(~keep))
    if not count:
        return reading
    rows = np.flatnonzero(keep)
    return replace(
        reading,
        trajectories=reading.trajectories.chosen(rows),
        klass=None if reading.klass is None else reading.klass[rows],
        left_out={**reading.left_out, rule: count},
        notices=(*reading.notices, f"{counted(count, 'row')} left out by {option(rule)}"),
    )
