"""What a particle filter reports: weighted particles around an estimate."""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.tracks.clouds import Clouds

Floats = NDArray[np.float64]

WIDER = 1.5
"""Standard deviation from which particles are drawn, over that of the Gaussian they stand for."""

LARGEST_DEVIATE = 2.6
"""Of the coordinates drawn, in standard deviations: beyond, weights would be next to nothing."""


def particle_clouds(
    centres: Floats, noise: float, count: int, decimals: int, rng: np.random.Generator
) -> Clouds:
    """Clouds that stand for Gaussians around the centres (R, d), with a deviation of `noise`.

    Particles are drawn from a wider Gaussian and weighted with the ratio of the densities.
    Positions are rounded to so many decimals; weights are short decimals that sum to 1.
    """
    rows, size = centres.shape
    drawn = rng.standard_normal((rows, count, size)).clip(-LARGEST_DEVIATE, LARGEST_DEVIATE) * WIDER
    ratio = np.exp(-0.5 * (1 - WIDER**-2) * (drawn**2).sum(axis=-1))
    unit = 10 ** (len(str(count)) + 4)
    shares = np.floor(unit * ratio / ratio.sum(axis=1, keepdims=True))
    # What rounding down left over goes to the heaviest.
    shares[np.arange(rows), shares.argmax(axis=1)] += unit - shares.sum(axis=1)
    points = np.round(centres[:, None] + noise * drawn, decimals)
    return Clouds(
        points=points.reshape(-1, size),
        weights=(shares / unit).ravel(),
        first=np.arange(rows + 1) * count,
    )
