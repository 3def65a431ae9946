"""The base distances by name.

A new one is a file here with a record that derives from `distances.base.Distance`, a line in
`DISTANCES`, its name in the options and a line in docs/reference/cli.md.
"""

from collections.abc import Iterator, Mapping
from importlib import import_module

from tgospa_eval.distances.base import Distance


class _Members(Mapping[str, Distance]):
    """Records by name, made when they are asked for."""

    def __init__(self, members: dict[str, tuple[str, dict[str, str | float]]]) -> None:
        self._members = members

    def __getitem__(self, name: str) -> Distance:
        place, settings = self._members[name]
        module, _, record = place.rpartition(".")
        make = getattr(import_module(f"tgospa_eval.distances.{module}"), record)
        found: Distance = make(**settings)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)


DISTANCES: Mapping[str, Distance] = _Members(
    {
        "euclidean": ("vector.Norm", {"name": "euclidean", "power": 2.0}),
        "manhattan": ("vector.Norm", {"name": "manhattan", "power": 1.0}),
        "chebyshev": ("vector.Norm", {"name": "chebyshev", "power": float("inf")}),
        "mahalanobis": ("mahalanobis.Mahalanobis", {}),
        "haversine": ("sphere.Haversine", {}),
        "geodesic": ("geodesic.Geodesic", {}),
        "iou": ("boxes.IoU", {}),
        "gaussian-wasserstein": ("gaussian.GaussianWasserstein", {}),
        "cloud-wasserstein": ("clouds.distance.CloudWasserstein", {}),
        "sliced-wasserstein": ("clouds.sliced.SlicedWasserstein", {}),
        "max-sliced-wasserstein": ("clouds.sliced.SlicedWasserstein", {"maximum": True}),
    }
)
"""Base distances by name; Mahalanobis without its covariance."""

ON_EARTH = ("haversine", "geodesic")
"""Those of latitudes and longitudes in degrees; they are in metres."""
