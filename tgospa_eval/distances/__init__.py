"""Base distances of states, and the search for the pairs that are nearer than the cutoff at a step.

Public names are imported when they are used, so that a run loads only the distance that it needs.
"""

from typing import TYPE_CHECKING

from tgospa_eval.common.registry import lazy
from tgospa_eval.distances.registry import DISTANCES as DISTANCES
from tgospa_eval.distances.registry import as_distance as as_distance

if TYPE_CHECKING:  # `import x as x` makes a name public
    from tgospa_eval.distances.base import Distance as Distance
    from tgospa_eval.distances.base import Pairs as Pairs
    from tgospa_eval.distances.base import Resources as Resources
    from tgospa_eval.distances.boxes import IoU as IoU
    from tgospa_eval.distances.clouds import CloudWasserstein as CloudWasserstein
    from tgospa_eval.distances.clouds import PairCloudWasserstein as PairCloudWasserstein
    from tgospa_eval.distances.clouds import SlicedWasserstein as SlicedWasserstein
    from tgospa_eval.distances.gaussian import GaussianWasserstein as GaussianWasserstein
    from tgospa_eval.distances.gaussian import gaussian_wasserstein as gaussian_wasserstein
    from tgospa_eval.distances.mahalanobis import Mahalanobis as Mahalanobis
    from tgospa_eval.distances.mahalanobis import PairMahalanobis as PairMahalanobis
    from tgospa_eval.distances.pair_search import near_pairs as near_pairs
    from tgospa_eval.distances.reduction import Reduction as Reduction
    from tgospa_eval.distances.reduction import reduce_cloud as reduce_cloud
    from tgospa_eval.distances.sphere import Geodesic as Geodesic
    from tgospa_eval.distances.sphere import Haversine as Haversine
    from tgospa_eval.distances.transport import cloud_wasserstein as cloud_wasserstein
    from tgospa_eval.distances.transport import cross_covariance as cross_covariance
    from tgospa_eval.distances.transport import resample_cloud as resample_cloud
    from tgospa_eval.distances.transport import restrict_cloud as restrict_cloud
    from tgospa_eval.distances.transport import transport_plan as transport_plan
    from tgospa_eval.distances.vector import Norm as Norm

_HOME = {
    "CloudWasserstein": "clouds",
    "Distance": "base",
    "Resources": "base",
    "GaussianWasserstein": "gaussian",
    "Geodesic": "sphere",
    "Haversine": "sphere",
    "IoU": "boxes",
    "Mahalanobis": "mahalanobis",
    "Norm": "vector",
    "PairCloudWasserstein": "clouds",
    "PairMahalanobis": "mahalanobis",
    "Pairs": "base",
    "Reduction": "reduction",
    "SlicedWasserstein": "clouds",
    "cloud_wasserstein": "transport",
    "cross_covariance": "transport",
    "gaussian_wasserstein": "gaussian",
    "near_pairs": "pair_search",
    "reduce_cloud": "reduction",
    "resample_cloud": "transport",
    "restrict_cloud": "transport",
    "transport_plan": "transport",
}


__getattr__ = lazy(__name__, _HOME)

__all__ = ["DISTANCES", *_HOME]


def __dir__() -> list[str]:
    return __all__
