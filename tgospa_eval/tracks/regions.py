"""Regions of the plane, of an image or of the Earth, in which estimates are not judged.

Knows no file, and of shapes no more than that they have an area.
"""

import hashlib

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.tracks.coverage import unsigned_zeros, whole
from tgospa_eval.tracks.trajectories import PLACES

BOX, CIRCLE, CAP, POLYGON, GEOJSON = "box", "circle", "cap", "polygon", "geojson"

SHAPES = {
    BOX: ("left", "top", "width", "height"),
    CIRCLE: ("x", "y", "radius"),
    CAP: (*PLACES, "radius"),
    POLYGON: ("polygon",),
}
"""Columns of each shape; a polygon of GeoJSON has its corners as x, y or lon, lat."""


FARTHEST = 1e150
"""Of coordinates and sizes, so that areas are doubles."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One region.

    Parameters
    ----------
    kind : str
        One of `SHAPES`, or ``"geojson"``.
    rings : tuple of array
        Of a polygon the corners (n, 2) of its edge and of its holes; otherwise the numbers of the
        columns, one array.
    where : str
        Where it was read, for messages.
    moment : int or float, optional
        Its time, as in `Trajectories`; None is all.

    Raises
    ------
    InputError
        It has no area, or a number is too large for one.
    """

    kind: str
    rings: tuple[Floats, ...]
    where: str
    moment: int | float | None = None

    def __post_init__(self) -> None:
        if not all((np.abs(ring) <= FARTHEST).all() for ring in self.rings):
            raise InputError(f"{self.where}: a number beyond {FARTHEST:g}, or none")
        if self.kind in (POLYGON, GEOJSON):
            for ring in self.rings:
                if np.linalg.matrix_rank(ring - ring[0]) < 2:
                    raise InputError(
                        f"{self.where}: a polygon without area; it needs three corners or more "
                        "that are not on one line"
                    )
        else:
            sizes = dict(zip(SHAPES[self.kind], self.rings[0], strict=True))
            for name in ("width", "height", "radius"):
                if sizes.get(name, 1.0) <= 0:
                    raise InputError(
                        f"{self.where}: a {name} of {sizes[name]:g}, a region without area; it "
                        "must be > 0"
                    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Regions:
    """Regions of all steps, or of one each.

    Parameters
    ----------
    shapes : tuple of Shape
        What they are.
    clock : {"number", "local", "zoned"}
        What their times are.
    name : str
        Where they come from, for messages.
    origin : tuple of float, optional
        Of states along local axes the place, latitude, longitude and height, where they begin:
        circles on the Earth and GeoJSON are looked at there.
    """

    shapes: tuple[Shape, ...]
    clock: str = "number"
    name: str = "ignore_regions"
    origin: tuple[float, float, float] | None = None

    @property
    def sha256(self) -> str:
        """A digest of where and when they are."""
        sha = hashlib.sha256(self.clock.encode())
        for shape in self.shapes:
            rings = [unsigned_zeros(ring).tolist() for ring in shape.rings]
            time = None if shape.moment is None else whole(np.array([shape.moment])).tolist()
            sha.update(f"{shape.kind} {time} {rings}".encode())
        return sha.hexdigest()
