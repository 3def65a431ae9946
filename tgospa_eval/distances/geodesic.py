"""Distance on the ellipsoid of the Earth, with heights."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.earth import ellipsoid
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import REACH_ROUNDING, Distance, DistanceSettings, Sides
from tgospa_eval.distances.sphere import RADIUS, Haversine
from tgospa_eval.distances.vector import positive_numbers, shares
from tgospa_eval.errors import InputError
from tgospa_eval.text import option
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563
"""Of WGS 84, in metres."""

ECCENTRICITY = FLATTENING * (2 - FLATTENING)
"""The square of the first one."""


@dataclass(frozen=True, kw_only=True)
class Geodesic(Distance):
    """Length of the shortest path on WGS 84 between (lat, lon) in degrees, in metres.

    With heights (lat, lon, alt), alt in metres above the ellipsoid,

        d^2 = s^2 + (W (alt a - alt b))^2,   s the length of the shortest path.

    Shortest paths make a metric on any surface, and the root of the squares of two metrics is one
    on pairs. Lengths are right within 15 nanometres (Karney, "Algorithms for geodesics", 2013).

    Parameters
    ----------
    vertical_weight : float
        W > 0: how much a metre of height counts.

    Raises
    ------
    ConfigError
        The weight is not > 0 and finite.
    """

    vertical_weight: float = 1.0

    name = "geodesic"
    columns = PLACES
    options = ("vertical_weight",)
    on_earth = True
    limits: ClassVar[dict[str, tuple[float, float, str]]] = Haversine.limits

    def __post_init__(self) -> None:
        positive_numbers("vertical weight", (self.vertical_weight,))

    @property
    def tree_power(self) -> float:
        """A chord is no longer than any path on the surface."""
        return 2.0

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Whether they are places, or places with heights.

        Raises
        ------
        InputError
            They are none, or heights count and there are none.
        """
        if columns not in (PLACES, (*PLACES, HEIGHT)):
            raise InputError(
                f"{name}: the distance geodesic needs the state columns lat,lon or lat,lon,alt, "
                f"not {','.join(columns)}; name or map them with {option('columns', 'lat,lon')}"
            )
        if self.vertical_weight != 1 and HEIGHT not in columns:
            raise InputError(
                f"{name}: {option('vertical_weight')} is for heights, and the state columns are "
                f"lat,lon; name or map them with {option('columns', 'lat,lon,alt')}"
            )

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """The weight of heights, where there are any."""
        return {"vertical_weight": self.vertical_weight} if HEIGHT in columns else {}

    def last_place(self, sides: Sides) -> float:
        """Of angles up to a half turn."""
        return 2.0**-50 * RADIUS

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of points that are given as latitudes, longitudes, and perhaps heights."""
        (lat_a, lat_b), (lon_a, lon_b), *heights = components
        path = self._paths((lat_a, lon_a), (lat_b, lon_b))[1]
        if not heights:
            return path
        ((first, second),) = heights
        return np.asarray(np.hypot(path, self.vertical_weight * (first - second)))

    def _paths(self, a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Direction at b of the shortest paths from a, in degrees, and their lengths."""
        whole = [np.array(x) for x in np.broadcast_arrays(a[1], a[0], b[1], b[0])]
        _, back, length = ellipsoid().inv(*whole)
        return np.asarray(back) + 180.0, np.asarray(length, np.float64)

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Derivative by latitude, longitude (metres per degree) and height, of ``d`` by ``b``.

        That of s is the cosine of the direction at b times the radius of the meridian, and the sine
        times that of the parallel.
        """
        direction, path = self._paths((a[0], a[1]), (b[0], b[1]))
        direction, latitude = np.radians(direction), np.radians(b[0])
        curve = 1 - ECCENTRICITY * np.sin(latitude) ** 2
        meridian = SEMI_MAJOR * (1 - ECCENTRICITY) / curve**1.5
        parallel = SEMI_MAJOR * np.cos(latitude) / np.sqrt(curve)
        slopes = np.radians([np.cos(direction) * meridian, np.sin(direction) * parallel])
        slopes[:, path == 0] = 0.0
        if len(a) == len(PLACES):
            return slopes
        rise = self.vertical_weight**2 * (b[2] - a[2])
        whole = np.hypot(path, self.vertical_weight * (b[2] - a[2]))
        return shares(np.vstack((path * slopes, rise)), whole)

    def embed(self, axes: Floats) -> Floats:
        """Points of the ellipsoid, and weighted heights as a fourth coordinate."""
        latitude, longitude = np.radians(axes[0]), np.radians(np.fmod(axes[1], 360.0))
        normal = SEMI_MAJOR / np.sqrt(1 - ECCENTRICITY * np.sin(latitude) ** 2)
        across = normal * np.cos(latitude)
        points = [
            across * np.cos(longitude),
            across * np.sin(longitude),
            (1 - ECCENTRICITY) * normal * np.sin(latitude),
        ]
        return np.array([*points, *(self.vertical_weight * axes[len(PLACES) :])])

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """The cutoff, and the rounding of the points: no chord is longer than a path."""
        height = self.vertical_weight * np.abs(axes[len(PLACES) :]).max(initial=0.0)
        room = cutoff * (1 + REACH_ROUNDING) + 2.0**-46 * RADIUS
        return np.full((len(axes) + 1, 1), room + REACH_ROUNDING * height)
