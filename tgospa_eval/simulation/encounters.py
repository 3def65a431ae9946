"""Encounters: for which steps two targets are near each other."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def encounters(truth: Floats, near: float) -> Ints:
    """All encounters of two targets, as long as each lasts.

    Parameters
    ----------
    truth : (T, m, d) array
        States, the first two coordinates the position; NaN where absent.
    near : float
        Two targets meet while their distance is less; in state units.

    Returns
    -------
    (E, 5) array
        First and second target, step of the begin and after the end, step at which they are
        closest; sorted by (begin, first, second).
    """
    from scipy.spatial import cKDTree  # memory and time as the near pairs, not as all pairs

    pairs = [np.zeros((0, 2), np.int64)]
    for position in truth[..., :2]:
        present = np.flatnonzero(~np.isnan(position[:, 0]))
        # Made in half the time of a balanced one, and searched as fast.
        tree = cKDTree(position[present], balanced_tree=False, compact_nodes=False)
        pairs.append(present[tree.query_pairs(near, output_type="ndarray")])
    first, second = np.sort(np.concatenate(pairs), axis=1).T
    step = np.repeat(np.arange(len(truth)), [len(found) for found in pairs[1:]])
    apart = np.hypot(*np.moveaxis(truth[step, first, :2] - truth[step, second, :2], -1, 0))
    first, second, step, apart = (a[apart < near] for a in (first, second, step, apart))
    order = np.lexsort((step, second, first))
    first, second, step = first[order], second[order], step[order]
    fresh = np.ones(len(step), bool)
    fresh[1:] = (np.diff(first) != 0) | (np.diff(second) != 0) | (np.diff(step) != 1)
    begin = np.flatnonzero(fresh)
    run = np.cumsum(fresh) - 1
    by_distance = np.lexsort((step, apart[order], run))
    last = np.append(begin, len(step))[1:] - 1
    found = np.stack(
        (first[begin], second[begin], step[begin], step[last] + 1, step[by_distance[begin]]), axis=1
    )
    return found[np.lexsort((found[:, 1], found[:, 0], found[:, 2]))]
