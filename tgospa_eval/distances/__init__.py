"""STATES -> base distance on the pairs of one step that are nearer than the cutoff.

A member is one file here, one line in `DISTANCES` and one line in docs/reference/cli.md.
"""

from tgospa_eval.distances.base import Distance, Effort, Pairs
from tgospa_eval.distances.boxes import IoU
from tgospa_eval.distances.clouds import CloudWasserstein, PairCloudWasserstein
from tgospa_eval.distances.gating import near_pairs
from tgospa_eval.distances.gaussian import GaussianWasserstein, gaussian_wasserstein
from tgospa_eval.distances.mahalanobis import Mahalanobis, PairMahalanobis
from tgospa_eval.distances.reduction import Reduction, reduce_cloud
from tgospa_eval.distances.sampling import resample_cloud, restrict_cloud
from tgospa_eval.distances.sphere import Haversine
from tgospa_eval.distances.transport import cloud_wasserstein, cross_covariance, transport_plan
from tgospa_eval.distances.vector import Norm

DISTANCES: dict[str, Distance] = {
    "euclidean": Norm(name="euclidean", power=2.0),
    "manhattan": Norm(name="manhattan", power=1.0),
    "chebyshev": Norm(name="chebyshev", power=float("inf")),
    "mahalanobis": Mahalanobis(),
    "haversine": Haversine(),
    "iou": IoU(),
    "gaussian-wasserstein": GaussianWasserstein(),
    "cloud-wasserstein": CloudWasserstein(),
}
"""Base distances by name; Mahalanobis without its covariance."""

__all__ = [
    "DISTANCES",
    "CloudWasserstein",
    "Distance",
    "Effort",
    "GaussianWasserstein",
    "Haversine",
    "IoU",
    "Mahalanobis",
    "Norm",
    "PairCloudWasserstein",
    "PairMahalanobis",
    "Pairs",
    "Reduction",
    "cloud_wasserstein",
    "cross_covariance",
    "gaussian_wasserstein",
    "near_pairs",
    "reduce_cloud",
    "resample_cloud",
    "restrict_cloud",
    "transport_plan",
]
