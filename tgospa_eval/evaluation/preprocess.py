"""What MOTChallenge leaves out before it evaluates, in its benchmarks of 2016 and 2017.

At each step boxes of the estimate are matched with all boxes of the truth, whatever their class and
flag: one to one, the sum of their IoU is largest, and only pairs with an IoU of 1/2 or more count.
A box that is matched with a distractor is left out. Of the truth the pedestrians remain whose flag
is not 0. The rules, and the order of its steps, are those of TrackEval.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances.boxes import TRACKEVAL_EPS, overlaps
from tgospa_eval.distances.pair_search import starts_of_steps
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats import Reading
from tgospa_eval.formats.options import Flags
from tgospa_eval.formats.text.table import IGNORED
from tgospa_eval.tracks.alignment import TimeMatching, align

PEDESTRIAN = "1"
DISTRACTORS = ("2", "7", "8", "12")
"""A person on a vehicle, a static person, a distractor, a reflection."""

LEAST_MATCH = 0.5 - TRACKEVAL_EPS
"""IoU from which boxes match."""

PREPROCESS = "--preprocess motchallenge"


def preprocessed(
    sides: tuple[Reading, ...], everything: Reading, names: tuple[str, str]
) -> tuple[Reading, Reading]:
    """Truth and estimate as MOTChallenge evaluates them.

    Parameters
    ----------
    sides : pair of Reading
        Boxes; of the truth those whose flag is not 0, with their classes.
    everything : Reading
        All boxes of the truth, with their classes.
    names : pair of str
        Of the files, for messages.

    Raises
    ------
    ConfigError
        The truth does not say what is a distractor.
    """
    truth, estimate = sides
    if everything.format != "motchallenge":
        raise ConfigError(
            f"{PREPROCESS}: {names[0]} is read as {everything.format}; only MOTChallenge text says "
            "which boxes are distractors"
        )
    if everything.klass is None:
        raise ConfigError(f"{PREPROCESS}: {names[0]} has no classes, column 8")
    return (
        _left(truth, _of_classes(truth, (PEDESTRIAN,))),
        _left(estimate, ~_on_distractors(everything, estimate, names)),
    )


def benchmark_warnings(truth: Reading, everything: Callable[[], Reading]) -> Iterator[Notice]:
    """That numbers which tables of a benchmark have are made of more here than there.

    Parameters
    ----------
    truth : Reading
        As it is compared.
    everything : callable
        Reads all boxes of the truth, with the attribute ``class`` if there is one.
    """
    if truth.format == "motchallenge":
        classes = everything().trajectories.attributes.get("class", np.zeros(0))
        count = int(
            np.isin(classes.astype(str), [*DISTRACTORS, *map("{}.0".format, DISTRACTORS)]).sum()
        )
        if count:
            yield Notice(
                code="benchmark-rules",
                text=f"{counted(count, 'box is a distractor', 'boxes are distractors')} "
                f"(classes {', '.join(DISTRACTORS)}), and a tracker that has them is charged for "
                "them: HOTA, MOTA and IDF1 are not those of the tables",
                remedy=f"{PREPROCESS} leaves out what they leave out",
            )
    elif truth.format == "kitti" and IGNORED in truth.left_out:
        yield Notice(
            code="benchmark-rules",
            text="tables of KITTI are of one class, without what a tracker has in regions "
            f"{IGNORED}, on neighbours of the class (Van, Person_sitting), or too small: here it "
            "is charged for all, and HOTA, MOTA and IDF1 are not those of the tables",
            remedy="compare these numbers with one another; TrackEval makes those of the tables",
        )


def _of_classes(reading: Reading, names: tuple[str, ...]) -> Flags:
    """Rows of these classes."""
    assert reading.klass is not None
    return np.isin(reading.klass, [k for k, name in enumerate(reading.classes) if name in names])


def _on_distractors(everything: Reading, estimate: Reading, names: tuple[str, str]) -> Flags:
    """Rows of the estimate that match a distractor."""
    from scipy.optimize import linear_sum_assignment  # here: slow to import

    aligned = align(everything.trajectories, estimate.trajectories, TimeMatching(), names)
    sides = aligned.truth, aligned.estimate
    wrong = _of_classes(everything, DISTRACTORS)
    found = np.zeros(len(aligned.estimate.step), bool)
    starts = [starts_of_steps(side) for side in sides]
    for step in range(len(sides[0].times)):
        rows, columns = (slice(start[step], start[step + 1]) for start in starts)
        overlap = overlaps(sides[0].state[rows], sides[1].state[columns])
        overlap[overlap < LEAST_MATCH] = 0.0
        i, j = linear_sum_assignment(-overlap)
        matched = overlap[i, j] > 0
        found[columns][j[matched]] = wrong[rows][i[matched]]
    return found


def _left(reading: Reading, keep: Flags) -> Reading:
    """The rows that stay, at the steps of the whole file, and how many do not."""
    count = int(np.count_nonzero(~keep))
    if not count:
        return reading
    rows = np.flatnonzero(keep)
    return replace(
        reading,
        trajectories=reading.trajectories.chosen(rows),
        klass=None if reading.klass is None else reading.klass[rows],
        left_out={**reading.left_out, "preprocess": count},
        notices=(*reading.notices, f"{counted(count, 'row')} left out by --preprocess"),
    )
