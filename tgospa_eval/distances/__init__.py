"""STATES -> base distance on the pairs of one step that are nearer than the cutoff.

The public names are imported when they are used: a run needs one distance, and no other pays for
it. How to add one: docs/architecture.md, from outside docs/reference/extend.md.
"""

from typing import TYPE_CHECKING, Any

from tgospa_eval.common.registry import Registry, lazy

if TYPE_CHECKING:  # with `as`, which makes a name public
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


def _distance(name: str, value: Any) -> "Distance":
    """A record, or one of a class with the default settings."""
    from tgospa_eval.distances.base import Distance  # lazy: imports numpy

    record = value() if isinstance(value, type) else value
    if not isinstance(record, Distance):
        raise TypeError(f"it is {type(record).__name__}, not a Distance")
    if record.name != name:
        raise ValueError(f"its record has the name {record.name!r}, which must be the same")
    return record


DISTANCES: "Registry[Distance]" = Registry(
    "distance",
    "tgospa_eval.distances",
    {
        "euclidean": "tgospa_eval.distances.vector:EUCLIDEAN",
        "manhattan": "tgospa_eval.distances.vector:MANHATTAN",
        "chebyshev": "tgospa_eval.distances.vector:CHEBYSHEV",
        "mahalanobis": "tgospa_eval.distances.mahalanobis:Mahalanobis",
        "haversine": "tgospa_eval.distances.sphere:Haversine",
        "geodesic": "tgospa_eval.distances.sphere:Geodesic",
        "iou": "tgospa_eval.distances.boxes:IoU",
        "gaussian-wasserstein": "tgospa_eval.distances.gaussian:GaussianWasserstein",
        "cloud-wasserstein": "tgospa_eval.distances.clouds:CloudWasserstein",
        "sliced-wasserstein": "tgospa_eval.distances.clouds:SlicedWasserstein",
        "max-sliced-wasserstein": "tgospa_eval.distances.clouds:MAX_SLICED",
    },
    _distance,
)
"""Base distances by name; Mahalanobis without its covariance."""


def as_distance(distance: "str | Distance | None") -> "Distance":
    """A record of settings, of a name that with the default ones; euclidean if none is chosen."""
    from tgospa_eval.distances.base import Distance  # lazy: imports numpy

    if isinstance(distance, Distance):
        return distance
    return DISTANCES.ours("euclidean") if distance is None else DISTANCES.chosen(distance)


def __dir__() -> list[str]:
    return __all__
