"""Conversion of the positions of truth and estimate (the two sides) to one frame.

A frame is the Earth, local axes, range and bearing of a sensor, or a projected system. In two
dimensions local axes are azimuthal equidistant: a position is s sin(a) east and s cos(a) north of
the origin. Here s is the length and a the direction of the shortest path from the origin on WGS 84.
Lengths from the origin are those of the ellipsoid. Other lengths are too long by at most the share
(s / R)^2 / 6, with R the radius of the Earth: 0.016 % at 200 km. With heights a position is in
metres east, north and up of the tangent plane at the origin, and lengths are exact.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.earth import ellipsoid, from_crs, topocentric
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import more, parsed
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES, Trajectories

EARTH = (*PLACES, HEIGHT)
LOCAL = ("x", "y", "z")
POLAR = ("range", "bearing", "elevation")

LIMITS = {
    "earth": ((0, "latitude", -90.0, 90.0), (1, "longitude", -360.0, 360.0)),
    "polar": ((0, "range", 0.0, math.inf), (2, "elevation", -90.0, 90.0)),
}
"""Columns with a limited range, by kind of frame: index and name of the column, smallest and
largest value."""

AXES = re.compile(r"(enu|ned)(?::(.+))?")
SYSTEM = re.compile(r"[A-Za-z]+:[0-9]+")

FORMS = (
    "lat,lon[,alt], enu, ned, enu:DEGREES, range,bearing[,elevation] or a code such as EPSG:25832"
)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Coordinates of a side: their kind, and their conversion to local or geodetic coordinates.

    Parameters
    ----------
    text : str
        Frame as it was given.
    kind : {"earth", "local", "polar", "system"}
        ``"earth"`` has latitude and longitude in degrees, ``"local"`` metres along axes at the
        origin, and ``"polar"`` range and angles from the origin. ``"system"`` is a projected
        system, such as UTM.
    columns : tuple of str, optional
        State columns; None means x, y and, if present, z.
    down : bool
        Whether the axes are north, east, down instead of east, north, up.
    turn : float
        Degrees by which the axes are turned clockwise: the bearing of the turned north axis.
    option : str
        Name of the option that gave the frame, for messages.
    """

    text: str
    kind: str
    columns: tuple[str, ...] | None = None
    down: bool = False
    turn: float = 0.0
    option: str

    @property
    def axes(self) -> tuple[str, ...]:
        """Directions of x, y and z; empty if the frame has other columns."""
        if self.kind not in ("local", "system"):
            return ()
        return ("north", "east", "down") if self.down else ("east", "north", "up")

    def fault(self, columns: tuple[str, ...], axes: Floats) -> tuple[Mask, str, str] | None:
        """Return the first fault: a mask (R,) of states out of range, their column and a message.

        None means that there is no fault. `axes` (d, R) has the d state columns of R states.
        """
        for k, _, low, high in LIMITS.get(self.kind, ()):
            if k < len(columns):
                wrong = (axes[k] < low) | (axes[k] > high)
                if wrong.any():
                    value, count = axes[k][int(np.argmax(wrong))], int(np.count_nonzero(wrong))
                    limits = f"from {low:g} to {high:g}" if high < np.inf else f">= {low:g}"
                    return wrong, columns[k], f"{value:g}{more(count)} must be {limits}"
        return None

    def to_local(self, states: Floats) -> Floats:
        """Convert local or polar states to east, north and, if they have three columns, up."""
        if self.kind == "polar":
            bearing = np.radians(states[:, 1])
            flat = states[:, 0]
            up = []
            if states.shape[1] == len(POLAR):
                elevation = np.radians(states[:, 2])
                flat, up = flat * np.cos(elevation), [flat * np.sin(elevation)]
            return np.stack((flat * np.sin(bearing), flat * np.cos(bearing), *up), axis=1)
        if self.down:
            states = np.column_stack((states[:, 1], states[:, 0], -states[:, 2:]))
        cos, sin = math.cos(math.radians(self.turn)), math.sin(math.radians(self.turn))
        if self.turn % 90 == 0:
            cos, sin = float(round(cos)), float(round(sin))
        east = cos * states[:, 0] + sin * states[:, 1]
        north = cos * states[:, 1] - sin * states[:, 0]
        return np.column_stack((east, north, states[:, 2:]))

    def to_earth(self, states: Floats) -> Floats:
        """Convert states on Earth or in a system to latitude, longitude and, if given, height."""
        if self.kind == "earth":
            return states
        x, y = from_crs(self.text, self.option).transform(states[:, 0], states[:, 1])
        return np.column_stack((y, x, states[:, 2:]))


def parse_frame(text: str, option: str) -> Frame:
    """Parse a text such as ``lat,lon``, ``enu``, ``ned:30`` or ``EPSG:25832``.

    Raises
    ------
    ConfigError
        The text is not one of these forms.
    """
    plain = ",".join(part.strip() for part in text.split(","))
    for kind, names in (("earth", EARTH), ("polar", POLAR)):
        for columns in (names[:2], names):
            if plain == ",".join(columns):
                return Frame(text=plain, kind=kind, columns=columns, option=option)
    match = AXES.fullmatch(plain)
    turn = parsed(match[2]) if match and match[2] else 0.0
    if match and turn is not None:
        return Frame(text=plain, kind="local", down=match[1] == "ned", turn=turn, option=option)
    if SYSTEM.fullmatch(plain):
        from_crs(plain, option)
        return Frame(text=plain, kind="system", option=option)
    raise ConfigError(f"{option} {quoted(text)}: must be {FORMS}")


def parse_origin(text: str) -> tuple[float, float, float]:
    """Parse the latitude, longitude and height of the origin, ``LAT,LON[,ALT]``.

    Raises
    ------
    ConfigError
        The text is not an origin.
    """
    numbers = [parsed(part) for part in text.split(",")]
    known = [number for number in numbers if number is not None]
    if (
        len(known) != len(numbers)
        or len(known) not in (2, 3)
        or not all(abs(known[k]) <= limit for k, _, _, limit in LIMITS["earth"])
    ):
        raise ConfigError(
            f"{option('origin')} {quoted(text)}: must be LAT,LON or LAT,LON,ALT, degrees and "
            "metres, such as 55.7,12.6"
        )
    latitude, longitude, *height = known
    return latitude, longitude, height[0] if height else 0.0


def on_earth(states: Floats, origin: Sequence[float]) -> Floats:
    """Convert east, north and, if given, up to latitude, longitude and height."""
    latitude, longitude, height = origin
    if states.shape[1] > 2:
        earth = topocentric(latitude, longitude, height).transform(*states.T, direction="INVERSE")
        return np.column_stack((earth[1], earth[0], earth[2]))
    centre = np.full(len(states), longitude), np.full(len(states), latitude)
    direction = np.degrees(np.arctan2(states[:, 0], states[:, 1]))
    east, north, _ = ellipsoid().fwd(*centre, direction, np.hypot(*states.T))
    return np.column_stack((north, east))


@dataclass(frozen=True, kw_only=True)
class Frames:
    """Frames of truth and estimate, and the origin of local axes.

    Parameters
    ----------
    frames : pair of Frame
        Frames of truth and estimate.
    origin : tuple of float, optional
        Latitude, longitude and height of the origin.

    Raises
    ------
    ConfigError
        The origin is missing, although only one side is relative to it (local or polar).
    """

    frames: tuple[Frame, Frame]
    origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if len(self.is_local) == 2 and self.origin is None:
            raise ConfigError(
                f"{option('truth_crs', self.frames[0].text)} and "
                f"{option('estimate_crs', self.frames[1].text)} need "
                f"{option('origin', metavar='LAT,LON')}, where the local axes begin"
            )

    @property
    def is_local(self) -> set[bool]:
        """Set of answers for both sides: True for a local or polar side, False for any other."""
        return {frame.kind in ("local", "polar") for frame in self.frames}

    @property
    def begin(self) -> tuple[float, float, float] | None:
        """Origin of the common frame, if this frame is local and the origin is known."""
        return self.origin if True in self.is_local else None

    @property
    def recorded(self) -> dict[str, object]:
        """Settings that change the number, by their JSON names."""
        truth, estimate = self.frames
        origin = {} if self.origin is None else {"origin": list(self.origin)}
        return {"truth_crs": truth.text, "estimate_crs": estimate.text, **origin}

    def joined(
        self, sides: tuple[Trajectories, Trajectories], names: tuple[str, ...]
    ) -> tuple[Trajectories, Trajectories, Notice | None]:
        """Convert both sides to one frame, and return a warning if heights are left out.

        The frame is local metres if a side is local or polar, otherwise latitude and longitude.
        Heights are part of the states if both sides have them, and are left out if one side lacks
        them. This can change horizontal positions; the warning then states the largest error.

        Raises
        ------
        InputError
            States have other columns, covariances, or positions out of range.
        """
        for side, frame, name in zip(sides, self.frames, names, strict=True):
            self._check(side, frame, name)
        size = min(len(side.columns) for side in sides)
        columns = (LOCAL if True in self.is_local else EARTH)[:size]
        first, second = (
            self._moved(side, frame, columns)
            for side, frame in zip(sides, self.frames, strict=True)
        )
        return first, second, self._loss(sides, names) if size == 2 else None

    def _loss(
        self, sides: tuple[Trajectories, Trajectories], names: Sequence[str]
    ) -> Notice | None:
        """Return a warning if one side has heights and the other has none."""
        for k, (side, frame) in enumerate(zip(sides, self.frames, strict=True)):
            local = self.frames[1 - k]
            if len(side.columns) < 3 or not len(side.state):
                continue
            if self.begin is None or frame.kind != "earth" or local.kind not in ("local", "polar"):
                return Notice(
                    code="heights-left-out",
                    text=f"heights are not compared: only {names[k]} has them ({side.columns[2]})",
                )
            flat = self._converted(side.state[:, :2], frame, 2)
            true = self._converted(side.state, frame, 3)
            compared = true if local.kind == "polar" else true[:, :2]
            loss = np.abs(np.linalg.norm(compared, axis=1) - np.linalg.norm(flat, axis=1)).max()
            what = "ranges" if local.kind == "polar" else "x and y"
            need = "elevation" if local.kind == "polar" else "z"
            return Notice(
                code="heights-left-out",
                text=f"heights of {names[k]} are left out, as {names[1 - k]} has none, and {what} "
                f"are taken along the ground: places are off by up to {loss:.4g} m",
                remedy=f"give {names[1 - k]} a column {need}",
            )
        return None

    def _check(self, side: Trajectories, frame: Frame, name: str) -> None:
        names = {"earth": EARTH, "polar": POLAR}.get(frame.kind, LOCAL)
        wanted = names[: max(len(side.columns), len(frame.columns or ()))]
        if side.columns != wanted or len(wanted) < 2:
            shown = ",".join(frame.columns or LOCAL[:2])
            raise InputError(
                f"{name}: {frame.option} {frame.text} needs the state columns {shown}, not "
                f"{','.join(side.columns)}; name or map them with "
                f"{frame.option.replace('crs', 'columns')}"
            )
        if side.covariance is not None:
            raise InputError(
                f"{name}: has covariances, which are not converted to other coordinates; compare "
                f"means with another {option('distance')}, or write both "
                "files in one coordinate system"
            )
        for k, what, low, high in LIMITS.get(frame.kind, ()):
            if k >= len(wanted) or not len(side.state):
                continue
            value = side.state[:, k]
            off = (value < low) | (value > high)
            if off.any():
                row = int(np.argmax(off))
                limits = f"from {low:g} to {high:g}" if high < np.inf else f">= {low:g}"
                raise InputError(
                    f"{name}: id {quoted(side.ids[side.track[row]])} at t = "
                    f"{side.shown[side.step[row]]} has the {what} {value[row]:g}; must be {limits}"
                )

    def _moved(self, side: Trajectories, frame: Frame, columns: tuple[str, ...]) -> Trajectories:
        def moved(states: Floats) -> Floats:
            places = self._converted(states, frame, len(columns))
            if not np.isfinite(places).all():
                raise InputError(
                    f"{frame.option} {frame.text}: some positions are outside of its area"
                )
            return places

        if side.clouds is None:
            return replace(side, columns=columns, state=moved(side.state))
        clouds = side.clouds.moved(moved(side.clouds.points))
        return replace(side, columns=columns, state=clouds.means, clouds=clouds)

    def _converted(self, states: Floats, frame: Frame, size: int) -> Floats:
        """Convert states of a frame to the common frame with `size` columns."""
        if frame.kind in ("local", "polar"):
            local = frame.to_local(states)
            if size == local.shape[1] or self.begin is None or len(self.is_local) == 1:
                return np.ascontiguousarray(local[:, :size])
            earth = on_earth(local, self.begin)[:, :size]  # without its height
        else:
            earth = frame.to_earth(states)[:, :size]
        if self.begin is None:
            return np.ascontiguousarray(earth)
        latitude, longitude, _ = self.begin
        if size > 2:
            places = topocentric(*self.begin).transform(earth[:, 1], earth[:, 0], earth[:, 2])
            return np.column_stack(places)
        centre = np.full(len(earth), longitude), np.full(len(earth), latitude)
        direction, _, length = ellipsoid().inv(*centre, earth[:, 1].copy(), earth[:, 0].copy())
        direction = np.radians(direction)
        return np.column_stack((length * np.sin(direction), length * np.cos(direction)))
