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

    pairs, apart = [np.zeros((0, 3), np.int64)], [np.zeros(0)]
    for step, position in enumerate(truth[..., :2]):
        present = np.flatnonzero(~np.isnan(position[:, 0]))
        pair = np.sort(
            present[cKDTree(position[present]).query_pairs(near, output_type="ndarray")], axis=1
        )
        distance = np.hypot(*(position[pair[:, 0]] - position[pair[:, 1]]).T)
        pairs.append(np.insert(pair, 2, step, axis=1)[distance < near])
        apart.append(distance[distance < near])
    first, second, step = np.concatenate(pairs).T
    order = np.lexsort((step, second, first))
    first, second, step = first[order], second[order], step[order]
    fresh = np.ones(len(step), bool)
    fresh[1:] = (np.diff(first) != 0) | (np.diff(second) != 0) | (np.diff(step) != 1)
    begin = np.flatnonzero(fresh)
    run = np.cumsum(fresh) - 1
    by_distance = np.lexsort((step, np.concatenate(apart)[order], run))
    last = np.append(begin, len(step))[1:] - 1
    found = np.stack(
        (first[begin], second[begin], step[begin], step[last] + 1, step[by_distance[begin]]), axis=1
    )
    return found[np.lexsort((found[:, 1], found[:, 0], found[:, 2]))]
