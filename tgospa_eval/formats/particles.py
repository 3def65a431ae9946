"""Particles: rows with a weight. All rows with the same id and time (id, t) are one cloud."""

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import BLANK
from tgospa_eval.formats.rows import Rows
from tgospa_eval.quoting import option
from tgospa_eval.tracks.clouds import LARGEST_COORDINATE, UNEVEN_SUM, Clouds, are_normalised

RULE = "weights must be >= 0 and not all zero"


@dataclass(frozen=True, kw_only=True, eq=False)
class Particles:
    """Rows of a file that are particles, with the cloud of each row.

    Parameters
    ----------
    weights : (R,) float array
        Weight of each row, with the sum 1 in each cloud; 0 for rows that do not take part.
    cloud : (R,) int array
        Index of the cloud of each row; it has no meaning for rows that do not take part.
    uneven : int
        Number of clouds whose weights in the file do not sum to 1.
    worst : float
        Sum of the weights of one cloud of the file: the cloud whose sum is farthest from 1.
    idle : int
        Number of rows that take part and have weight 0.
    """

    weights: Floats
    cloud: Ints
    uneven: int
    worst: float
    idle: int

    def means(self, values: Floats) -> Floats:
        """Return, for each row, the weighted means of the values of its cloud.

        `values` (R, n) has n values for each of R rows, and so has the result.
        """
        sums = [np.bincount(self.cloud, self.weights * np.nan_to_num(v)) for v in values.T]
        return np.asarray(np.column_stack(sums)[self.cloud], np.float64)

    def clouds(
        self, rows: Rows, state: Floats, taken: Ints, ordered: Ints
    ) -> tuple[Clouds, Ints, Ints]:
        """Return the clouds of the rows `taken`, and the first row and the key of each cloud.

        `taken` is in the order of the keys of the rows, and `ordered` has these keys. Equal keys
        mean the same cloud. Particles of weight 0 are left out.

        Raises
        ------
        InputError
            A coordinate of a particle is so large that its square is not a double.
        """
        weighs = self.weights[taken] > 0
        taken, ordered = taken[weighs], ordered[weighs]
        far = taken[(np.abs(state[taken]) > LARGEST_COORDINATE).any(axis=1)]
        if len(far):
            row = int(far.min())
            raise InputError(
                f"{rows.where(row)}: a particle of {_name(rows, row)} is beyond "
                f"{LARGEST_COORDINATE:g}{more(len(far))}; use another unit"
            )
        begin = np.flatnonzero(np.diff(ordered, prepend=-1))
        clouds = Clouds(
            points=state.take(taken, axis=0),
            weights=self.weights[taken],
            first=np.append(begin, len(taken)),
        )
        return clouds, taken[begin], ordered[begin]

    def notices(self, clouds: Clouds, *, compared: bool) -> list[str]:
        """Return notices about the clouds; `compared` says if the distance compares particles."""
        texts = []
        if not compared:
            one = "cloud of {} particles is compared by its mean"
            many = "clouds of {} particles are compared by their means"
            what = (one if len(clouds) == 1 else many).format(len(clouds.points))
            texts.append(
                f"{len(clouds)} {what}; "
                f"{option('distance', 'cloud-wasserstein')} compares all particles"
            )
        if self.uneven:
            have = counted(self.uneven, "cloud has", "clouds have")
            texts.append(
                f"{have} weights that do not sum to 1 (the farthest to {self.worst:g}): normalised"
            )
        if self.idle:
            texts.append(f"{counted(self.idle, 'particle')} of weight 0 left out")
        return texts


def gather(rows: Rows, key: Ints, mask: Mask, *, always: bool) -> Particles | None:
    """Build the clouds of the rows where `mask` is True; rows with the same key are one cloud.

    The result is None if `always` is False and no cloud would have two particles.

    Raises
    ------
    InputError
        A weight is blank, infinite, negative or not a number, or all weights of a cloud are zero.
    """
    used = np.flatnonzero(mask)
    distinct, number = np.unique(key[used], return_inverse=True)
    if len(distinct) == len(used) and not always:
        return None
    if rows.weight_fault is not None:
        raise InputError(*rows.weight_fault.replace(BLANK, RULE).split("\n"))
    roles = rows.roles
    given = rows.numbers[:, roles.numbers.index(roles.weight or 0)]
    weights = np.zeros(len(given))
    weights[used] = given[used]
    wrong = np.flatnonzero(~(weights >= 0))
    if len(wrong):
        row = int(wrong[0])
        text = "blank" if np.isnan(weights[row]) else f"negative: {weights[row]:g}"
        raise InputError(
            f"{rows.where(row)}: the weight of a particle of {_name(rows, row)} is {text}"
            f"{more(len(wrong))}; {RULE}"
        )
    largest = np.zeros(len(distinct))
    np.maximum.at(largest, number, weights[used])
    empty = np.flatnonzero(largest[number] == 0)
    if len(empty):
        row = int(used[empty[0]])
        clouds = int(np.count_nonzero(largest == 0))
        raise InputError(
            f"{rows.where(row)}: all weights of {_name(rows, row)} are zero{more(clouds)}; {RULE}; "
            "leave out the rows of absent objects"
        )
    cloud = np.zeros(len(given), np.int64)
    cloud[used] = number
    # The largest weight becomes 1 before the sum, which could overflow for huge weights.
    scaled = weights[used] / largest[number]
    totals = np.bincount(number, scaled, minlength=len(distinct))
    with np.errstate(over="ignore"):
        sums = totals * largest
    normalised = are_normalised(sums, np.bincount(number, minlength=len(distinct)))[number]
    weights[used] = np.where(normalised, weights[used], scaled / totals[number])
    off = np.abs(sums - 1)
    return Particles(
        weights=weights,
        cloud=cloud,
        uneven=int(np.count_nonzero(off > UNEVEN_SUM)),
        worst=float(sums[off.argmax()]) if len(sums) else 1.0,
        idle=int(np.count_nonzero(weights[used] == 0)),
    )


def _name(rows: Rows, row: int) -> str:
    return f"id {rows.quoted_id(row)}, t {rows.moment(row)}"
