"""STATES -> base distance on the pairs of one step that are nearer than the cutoff.

A member is one file here, one line in `DISTANCES` and one line in docs/reference/cli.md.
"""

from tgospa_eval.distances.base import Distance
from tgospa_eval.distances.boxes import IoU
from tgospa_eval.distances.gating import Pairs, near_pairs
from tgospa_eval.distances.gaussian import GaussianWasserstein, gaussian_wasserstein
from tgospa_eval.distances.mahalanobis import Mahalanobis
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.distances.vector import Norm

DISTANCES: dict[str, Distance] = {
    "euclidean": Norm(name="euclidean", power=2.0),
    "manhattan": Norm(name="manhattan", power=1.0),
    "chebyshev": Norm(name="chebyshev", power=float("inf")),
    "mahalanobis": Mahalanobis(),
    "haversine": Haversine(),
    "iou": IoU(),
    "gaussian-wasserstein": GaussianWasserstein(),
}
"""Base distances by name; Mahalanobis without its covariance."""

__all__ = [
    "DISTANCES",
    "Distance",
    "GaussianWasserstein",
    "Haversine",
    "IoU",
    "Mahalanobis",
    "Norm",
    "Pairs",
    "gaussian_wasserstein",
    "near_pairs",
]
