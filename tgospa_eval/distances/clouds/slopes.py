"""Derivatives of the Wasserstein distance of particle clouds by the particles."""

import numpy as np

from tgospa_eval.distances.base import Floats, Pairs
from tgospa_eval.distances.clouds.transport import plan, whitened
from tgospa_eval.tracks.clouds import Clouds


def slopes_of_particles(
    clouds: tuple[Clouds, Clouds], pairs: Pairs, order: int, factor: Floats | None
) -> Floats:
    """``dW/dy_j = W^(1-q) sum_i pi_ij |x_i - y_j|^(q-2) (y_j - x_i)`` with the optimal plan pi.

    By the envelope theorem: W^q is a minimum over plans. One of the derivatives where several plans
    are optimal; 0 where the distance is 0.

    Parameters
    ----------
    clouds : pair of Clouds
        Of truth and estimate, scaled.
    pairs : Pairs
        Which to compare, with their distances.
    order : {1, 2}
        q.
    factor : (d, d) float array, optional
        L of the covariance L L' of a Mahalanobis distance of particles.

    Returns
    -------
    (M, d) float array
        Of the particles of the estimate of each pair, one pair behind the other.
    """
    found = [np.zeros((0, clouds[1].points.shape[1]))]
    near = zip(
        pairs.truth_row.tolist(), pairs.estimate_row.tolist(), pairs.distance.tolist(), strict=True
    )
    for i, j, distance in near:
        pair = clouds[0][i], clouds[1][j]
        if distance == 0:
            found.append(np.zeros_like(pair[1][0]))
            continue
        a, b = pair if factor is None else whitened(pair, factor)
        share = plan(a, b, order)
        if order == 1:
            apart = np.linalg.norm(a[0][:, None] - b[0], axis=2)
            share = np.divide(share, apart, out=np.zeros_like(share), where=apart > 0)
        # sum_i share_ij (y_j - x_i), from differences to one place
        centre = b[0][0]
        moved = share.sum(axis=0)[:, None] * (b[0] - centre) - share.T @ (a[0] - centre)
        moved *= distance ** (1 - order)
        found.append(moved if factor is None else np.linalg.solve(factor.T, moved.T).T)
    return np.concatenate(found)
