"""Distances on the surface of the Earth, and on its ellipsoid with heights."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.earth import ellipsoid
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import REACH_ROUNDING, Distance, DistanceSettings, Sides
from tgospa_eval.distances.vector import positive_numbers, shares
from tgospa_eval.errors import InputError
from tgospa_eval.quoting import option
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES

RADIUS = 6371008.8
"""Mean radius of the Earth in metres, (2 a + b) / 3 of GRS 80 (IUGG)."""


@dataclass(frozen=True, kw_only=True)
class Haversine(Distance):
    """Length of the great circle between (lat, lon) in degrees, on a sphere, in metres.

    It is a metric on the points of the sphere. Longitudes that differ by 360 are the same point,
    and at a pole all longitudes are the same point.
    """

    name = "haversine"
    columns = PLACES
    on_earth = True
    limits: ClassVar[dict[str, tuple[float, float, str]]] = {
        "lat": (-90.0, 90.0, "from -90 to 90 degrees"),
        "lon": (-360.0, 360.0, "from -360 to 360 degrees"),
    }

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Check that the columns are places without heights.

        Raises
        ------
        InputError
            The columns are not places, or have heights.
        """
        if columns == (*PLACES, HEIGHT):
            raise InputError(
                f"{name}: {option('distance', 'haversine')} does not use heights; use "
                f"{option('distance', 'geodesic')}, or leave heights out with "
                f"{option('columns', 'lat,lon')}"
            )
        super().check_columns(columns, name)

    @property
    def tree_power(self) -> float:
        """Power of the search tree: 2, because a chord is never longer than its arc."""
        return 2.0

    def last_place(self, sides: Sides) -> float:
        """Return the rounding of angles up to a half turn, in metres: see `Distance.last_place`."""
        return 2.0**-50 * RADIUS

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of points, given as latitudes and longitudes.

        With the differences dlat, dlon and the mean latitude,

            h = sin(dlat / 2)^2 + cos(lat a) cos(lat b) sin(dlon / 2)^2,
            1 - h = sin(mean lat)^2 + cos(lat a) cos(lat b) cos(dlon / 2)^2,

        where 1 - h is the value of h for the antipode of b. With the radius R of the Earth, the
        distance is ``2 R atan2(sqrt(h), sqrt(1 - h))``. h and 1 - h are sums of squares without
        cancellation, so that neither tiny distances nor distances of antipodes lose digits.
        """
        (lat_a, lat_b), (lon_a, lon_b) = components
        turn = np.abs(np.fmod(np.fmod(lon_a, 360.0) - np.fmod(lon_b, 360.0), 360.0))
        turn = np.radians(0.5 * np.minimum(turn, 360.0 - turn))
        width = np.sqrt(_cosine(lat_a) * _cosine(lat_b))
        near = np.hypot(np.sin(np.radians(0.5 * (lat_a - lat_b))), width * np.sin(turn))
        far = np.hypot(np.sin(np.radians(0.5 * (lat_a + lat_b))), width * np.cos(turn))
        return np.asarray(2 * RADIUS * np.arctan2(near, far))

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return derivatives by latitude and longitude, in metres per degree."""
        turn = np.radians(np.fmod(np.fmod(b[1], 360.0) - np.fmod(a[1], 360.0), 360.0))
        lat_a, lat_b = np.radians(a[0]), np.radians(b[0])
        sine = np.sin(0.5 * turn)
        by_latitude = 0.5 * np.sin(lat_b - lat_a) - np.cos(lat_a) * np.sin(lat_b) * sine * sine
        by_longitude = 0.5 * _cosine(a[0]) * _cosine(b[0]) * np.sin(turn)
        angle = self.between(zip(a, b, strict=True)) / RADIUS
        width = 0.5 * np.sin(angle)  # sqrt(h (1 - h)), for h = sin(angle / 2)^2
        slopes = np.radians(RADIUS) * np.array([by_latitude, by_longitude])
        return shares(slopes, width)

    def embed(self, axes: Floats) -> Floats:
        """Return the points on the sphere."""
        latitude, longitude = axes[0], np.radians(np.fmod(axes[1], 360.0))
        across = RADIUS * _cosine(latitude)
        return np.array(
            [
                across * np.cos(longitude),
                across * np.sin(longitude),
                RADIUS * np.sin(np.radians(latitude)),
            ]
        )

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the cutoff plus the rounding of points: a chord is never longer than its arc."""
        return np.full((3, 1), cutoff * (1 + REACH_ROUNDING) + 2.0**-46 * RADIUS)


def _cosine(latitude: Floats) -> Floats:
    """Return the cosine of degrees, exactly 0 at the poles."""
    return np.sin(np.radians(90.0 - np.abs(latitude)))


SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563
"""Semi-major axis in metres, and flattening, of the ellipsoid WGS 84."""

ECCENTRICITY = FLATTENING * (2 - FLATTENING)
"""Square of the first eccentricity of WGS 84."""


@dataclass(frozen=True, kw_only=True)
class Geodesic(Distance):
    """Length of the shortest path on WGS 84 between (lat, lon) in degrees, in metres.

    With heights (lat, lon, alt), alt in metres above the ellipsoid,

        d^2 = s^2 + (W (alt a - alt b))^2,   s the length of the shortest path.

    Lengths of shortest paths are a metric on any surface, and the root of the sum of squares of two
    metrics is a metric on the product of their spaces. The error of lengths is at most 15
    nanometres (Karney, "Algorithms for geodesics", 2013).

    Parameters
    ----------
    vertical_weight : float
        W > 0: weight of a metre of height.

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
        """Power of the search tree: 2, because a chord is never longer than a path."""
        return 2.0

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Check that the columns are places, perhaps with heights.

        Raises
        ------
        InputError
            The columns are not places, or there is a weight but no column of heights.
        """
        if columns not in (PLACES, (*PLACES, HEIGHT)):
            raise InputError(
                f"{name}: the distance geodesic needs the state columns lat,lon or lat,lon,alt, "
                f"not {','.join(columns)}; name or map them with {option('columns', 'lat,lon')}"
            )
        if self.vertical_weight != 1 and HEIGHT not in columns:
            raise InputError(
                f"{name}: {option('vertical_weight')} needs heights, but the state columns are "
                f"lat,lon; name or map heights with {option('columns', 'lat,lon,alt')}"
            )

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return the weight of heights, if there is a column of heights."""
        return {"vertical_weight": self.vertical_weight} if HEIGHT in columns else {}

    def last_place(self, sides: Sides) -> float:
        """Return the rounding of angles up to a half turn, in metres: see `Distance.last_place`."""
        return 2.0**-50 * RADIUS

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of points, given as latitudes, longitudes and perhaps heights."""
        (lat_a, lat_b), (lon_a, lon_b), *heights = components
        path = self._paths((lat_a, lon_a), (lat_b, lon_b))[1]
        if not heights:
            return path
        ((first, second),) = heights
        return np.asarray(np.hypot(path, self.vertical_weight * (first - second)))

    def _paths(self, a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Return directions at b of the shortest paths from a, in degrees, and their lengths."""
        whole = [np.array(x) for x in np.broadcast_arrays(a[1], a[0], b[1], b[0])]
        _, back, length = ellipsoid().inv(*whole)
        return np.asarray(back) + 180.0, np.asarray(length, np.float64)

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return derivatives by latitude, longitude (metres per degree) and height of ``b``.

        Let s be the length of the path, and a its direction at b. The derivative of s by latitude
        is cos a times the radius of the meridian. The derivative by longitude is sin a times the
        radius of the parallel.
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
        """Return the points on the ellipsoid, and weighted heights as a fourth coordinate."""
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
        """Return the cutoff plus the rounding of points: a chord is never longer than a path."""
        height = self.vertical_weight * np.abs(axes[len(PLACES) :]).max(initial=0.0)
        room = cutoff * (1 + REACH_ROUNDING) + 2.0**-46 * RADIUS
        return np.full((len(axes) + 1, 1), room + REACH_ROUNDING * height)
