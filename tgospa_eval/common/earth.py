"""Coordinates on the Earth by pyproj: paths on WGS 84, and projected systems."""

import functools
from typing import Any

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import option, quoted


def _pyproj(what: str) -> Any:
    try:
        import pyproj  # lazy: not always installed
    except ImportError:
        raise ConfigError(f"{what} needs the extra geo: {install('geo')}") from None
    return pyproj


@functools.cache
def ellipsoid() -> Any:
    """Return the WGS 84 ellipsoid as a ``pyproj.Geod``, which computes shortest paths.

    Raises
    ------
    ConfigError
        The extra is not installed.
    """
    return _pyproj(option("distance", "geodesic")).Geod(ellps="WGS84")


@functools.lru_cache(maxsize=8)
def from_crs(text: str, option: str) -> Any:
    """Return the transformation from a projected system to longitude and latitude.

    The first coordinate of the projected system increases to the east. `text` names this system.
    `option` is the option that has the text, for messages.

    Raises
    ------
    ConfigError
        The system is unknown, or is not projected.
    """
    pyproj = _pyproj(option)
    try:
        crs = pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.CRSError:
        raise ConfigError(
            f"{option} {quoted(text)}: pyproj does not know this system; write a code such as "
            "EPSG:32632"
        ) from None
    if not crs.is_projected:
        raise ConfigError(
            f"{option} {quoted(text)}: is not projected; for latitudes and longitudes write lat,lon"
        )
    return pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)


@functools.lru_cache(maxsize=8)
def topocentric(latitude: float, longitude: float, height: float) -> Any:
    """Return the transformation to metres east, north and up, measured from a point.

    The arguments are latitude, longitude and height of this point. The transformation receives its
    coordinates in another order: longitude, latitude and height.
    """
    return _pyproj(option("origin")).Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
        " +step +proj=cart +ellps=WGS84"
        f" +step +proj=topocentric +ellps=WGS84 +lat_0={latitude!r} +lon_0={longitude!r}"
        f" +h_0={height!r}"
    )
