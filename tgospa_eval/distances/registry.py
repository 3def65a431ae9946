"""Base distances by name, of this package and of other packages.

This module has no slow imports. docs/architecture.md explains how to add a distance here, and
docs/reference/extend.md how to add one from another package.
"""

from typing import TYPE_CHECKING, Any

from tgospa_eval.common.registry import Registry

if TYPE_CHECKING:
    from tgospa_eval.distances.base import Distance


def _distance(name: str, value: Any) -> "Distance":
    """Return a distance as it is, or an object of a class of distances with default settings."""
    from tgospa_eval.distances.base import Distance  # lazy: imports numpy

    record = value() if isinstance(value, type) else value
    if not isinstance(record, Distance):
        raise TypeError(f"it is {type(record).__name__}, not a Distance")
    if record.name != name:
        raise ValueError(
            f"its record has the name {record.name!r}, not {name!r}: both must be the same"
        )
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
"""Base distances by name; "mahalanobis" has no covariance yet."""


def as_distance(distance: "str | Distance | None") -> "Distance":
    """Return a distance as it is, or the one with this name; euclidean by default."""
    from tgospa_eval.distances.base import Distance  # lazy: imports numpy

    if isinstance(distance, Distance):
        return distance
    return DISTANCES.ours("euclidean") if distance is None else DISTANCES.chosen(distance)
