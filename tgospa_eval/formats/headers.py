"""Headers of a table: search for columns, and suggestions for missing columns.

If each object has columns of its own, the user names them by a pattern, ``x=x{id},y=y{id}``.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.quoting import COMMAND, listed, option, quoted, surface

ID_MARK = "{id}"
"""Part of a pattern that stands for the id of an object."""

PAIRED_NAMES = (("x", "y"), ("X", "Y"))


def objects_in(names: Sequence[str], mapped: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """Return, for each object id, the positions of its columns by name.

    `mapped` has the patterns of the headers by name. An object that lacks the column of a pattern
    is left out.
    """
    patterns = {name: header for name, header in mapped.items() if ID_MARK in header}
    objects: dict[str, dict[str, int]] = {}
    for name, pattern in patterns.items():
        before, _, after = pattern.partition(ID_MARK)
        fits = re.compile(f"{re.escape(before)}(.+){re.escape(after)}", re.IGNORECASE)
        for column, header in enumerate(names):
            if match := fits.fullmatch(header):
                objects.setdefault(match[1], {}).setdefault(name, column)
    return {key: columns for key, columns in objects.items() if len(columns) == len(patterns)}


def shared_columns(names: Sequence[str], objects: Mapping[str, Mapping[str, int]]) -> list[int]:
    """Return the positions of the columns that are shared by all objects.

    A shared column belongs to no single object. Columns with the header ``id``, or with a name in
    `objects` as the header, such as ``x``, are left out.
    """
    used = {k for columns in objects.values() for k in columns.values()}
    taken = {"id", *next(iter(objects.values()))}
    return [k for k, name in enumerate(names) if k not in used and name not in taken]


def pattern_in(names: Sequence[str]) -> list[str]:
    """Return patterns for x and y, if these headers seem to be x and y of several objects.

    Otherwise return an empty list.
    """
    for one, two in PAIRED_NAMES:
        first = [name for name in names if one in name and name.replace(one, two) in names]
        before = _common(first)
        after = _common([name[len(before) :][::-1] for name in first])[::-1]
        pattern = f"{before}{ID_MARK}{after}"
        is_whole = all(len(name) > len(before + after) for name in first)
        if len(first) > 1 and is_whole and one in before + after:
            return [f"x={pattern}", f"y={pattern.replace(one, two)}"]
    return []


def _common(texts: Sequence[str]) -> str:
    """Return the common prefix of texts."""
    first, last = min(texts, default=""), max(texts, default="")
    pairs = enumerate(zip(first, last, strict=False))
    end = next((k for k, (a, b) in pairs if a != b), min(len(first), len(last)))
    return first[:end]


WEIGHT = "weight"
"""Header of the weights of particles."""

NO_STATES = ("id", "t", "class", WEIGHT)
"""Columns that are never part of the state, even if the user names them."""

PREFIXES = ("cov_", "std_", "rho_")
"""Beginnings of the names of entries of covariances."""

SPREAD = re.compile(
    r"(cov|var|std|sigma|rho)_\w+|p_\w+_\w+|p_?(\d_?\d|(?P<axis>[a-z])_?(?P=axis))", re.IGNORECASE
)
"""Pattern of headers that may be entries of covariances."""

BOX = ("left", "top", "width", "height")
CORNERS = ("left", "top", "right", "bottom")
EDGES = (*BOX, "right", "bottom")

SKIPPED = ("-", "_")
"""Names that the user gives to columns to skip, if the table has no header."""


def columns_of_each(
    shared: Sequence[str] | None, *own: Sequence[str] | None, alike: bool = True
) -> list[tuple[tuple[str, ...] | None, tuple[str, ...]]]:
    """Return, for each file, its items of columns, and the names that only `shared` maps.

    If `shared` maps a name to a header, one file is allowed to lack this header.

    Parameters
    ----------
    shared : sequence of str, optional
        Items ``name`` or ``name=header`` for all files.
    own : sequences of str, optional
        Items for each file; they have priority over `shared`.
    alike : bool
        Whether state names that are given for one file are also used for the other files.
    """
    maps, wanted = parse_columns(shared)
    parsed = [parse_columns(items) for items in own]
    # State names given for one file are used for the other file, too. Exceptions: `alike` is false,
    # or the names include t (then they list all columns of a table without a header).
    placed = [not alike or "t" in (items or ()) for items in own]
    each = zip(parsed, placed, strict=True)
    named = wanted or next((states for (_, states), fixed in each if states and not fixed), ())
    answer = []
    for mapped, states in parsed:
        chosen = named if named and set(states) <= set(named) else states
        headers = maps | mapped
        # The names of the states come last, in their order.
        names = [*(name for name in headers if name not in chosen), *chosen]
        items = tuple(f"{name}={headers[name]}" if name in headers else name for name in names)
        answer.append((items or None, tuple(name for name in maps if name not in mapped)))
    return answer


def parse_columns(columns: Sequence[str] | None) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the header of each mapped name, and the names of the state columns in order.

    Edges of boxes and entries of covariances are state columns only if they are named without
    ``=``. Weights are never state columns.
    """
    mapped: dict[str, str] = {}
    wanted: dict[str, None] = {}  # an ordered set
    for item in columns or ():
        name, equals, header = (part.strip() for part in item.partition("="))
        if name in SKIPPED and not equals:
            continue
        if not name or (equals and not header):
            raise ConfigError(f"columns: {quoted(item)} is neither a name nor name=header")
        if name in wanted or name in mapped:
            raise ConfigError(f"columns: {quoted(name)} is given twice")
        if ID_MARK in name and not equals:  # x{id}
            header, equals, name = name, "=", name.replace(ID_MARK, "").strip(" _.-")
        if equals:
            mapped[name] = header
        beside = name in (*EDGES, WEIGHT) or name.startswith(PREFIXES)
        if name not in NO_STATES and not (equals and beside):
            wanted[name] = None
    return mapped, tuple(wanted)


def has_patterns(options: ReadOptions) -> bool:
    """Return whether columns are named by pattern."""
    return any(ID_MARK in item for item in options.columns or ())


def ask(name: str, items: Sequence[str]) -> str:
    """Return the option or argument that names these columns, ready to be pasted.

    `items` have the form ``name=header``. `name` is the name of the option; it is blank for a
    DataFrame. For a DataFrame, the result is a call of ``rename``, except if an item joins several
    headers by ``+``.
    """
    if name or any("+" in item for item in items):
        from shlex import quote  # lazy: needed only for messages

        value = ",".join(items)
        return option(name or "columns", quote(value) if surface.get() == COMMAND else value)
    headers = {
        f"HEADER of {name}" if header == "HEADER" else header: name
        for name, _, header in (item.partition("=") for item in items)
        if header not in ("", name)
    }
    return f"rename(columns={headers!r})"


Mix = tuple[tuple[int, float], ...]
"""Quantity that is a weighted sum of columns: pairs (position of a column, weight of the column).

For example, the x of the centre of a box is left + 0.5 width."""

FIRST_ALIASES = {
    "id": ("id", "track_id", "target_id", "object_id"),
    "t": ("t", "time", "timestamp", "frame", "step"),
    "weight": ("weight", "w"),
}
"""Aliases that are tried before all other aliases, in this order; case does not matter."""

COORDINATE = (
    "{0} pos_{0} {0}_pos position_{0} {0}_position {0}_coord coord_{0} {0}_coordinate "
    "coordinate_{0} utm_{0} {0}_utm center_{0} {0}_center centre_{0} {0}_centre c{0} {0}c "
    "pose_position_{0} pose_pose_position_{0}"
)
"""Template of the aliases of a coordinate; {0} is its name."""

EDGE = "{0}{1} bb_{0}{1} bbox_{0}{1} box_{0}{1}"
"""Template of the aliases of the edges of a box that is given by two corners.

{0} is the axis, and {1} is the number of the corner."""

BEGIN, END = (
    " ".join(f"{{0}}_{corner} {corner}_{{0}}" for corner in corners.split())
    for corners in (
        "min ul tl lu lt upper_left top_left",
        "max lr br rl rb lower_right bottom_right",
    )
)
"""Templates of further aliases of the edges at the first and at the second corner."""

HEADER_ALIASES = {
    name: tuple(aliases.split())
    for name, aliases in {
        "id": f"{' '.join(FIRST_ALIASES['id'])} obj_id trk_id tid track uuid track_uuid "
        "object_uuid "
        "track_no track_num track_number target_number track_name target_name track_token "
        "instance_id instance_token entity_id agent_id vehicle_id person_id pedestrian_id actor_id "
        "tracker_id tracking_id player_id ship_id taxi_id individual_id "
        "individual_local_identifier particle mmsi icao24",
        "t": f"header_stamp {' '.join(FIRST_ALIASES['t'])} ts stamp datetime utc utc_time "
        "time_utc timestep frame_id frame_idx frame_index frame_no frame_num frame_number "
        "base_date_time",
        "x": COORDINATE.format("x") + " easting utm_easting east",
        "y": COORDINATE.format("y") + " northing utm_northing north",
        "z": f"{COORDINATE.format('z')} up down",
        "lat": "lat latitude gps_lat gps_latitude pos_lat location_lat",
        "lon": "lon lng long longitude gps_lon gps_lng gps_longitude pos_lon location_lon "
        "location_long",
        "alt": "alt altitude geo_altitude hae ellipsoidal_height height_above_ellipsoid gps_alt "
        "gps_altitude elevation elev height hgt baro_altitude z",
        "range": "range",
        "bearing": "bearing",
        "elevation": "elevation elev",
        "left": f"left bb_left bbox_left {EDGE.format('x', 1)} {BEGIN.format('x')}",
        "top": f"top bb_top bbox_top {EDGE.format('y', 1)} {BEGIN.format('y')}",
        "width": "width bb_width bbox_width box_width w bb_w bbox_w box_w",
        "height": "height bb_height bbox_height box_height h bb_h bbox_h box_h",
        "right": f"right bb_right bbox_right {EDGE.format('x', 2)} {END.format('x')}",
        "bottom": f"bottom bb_bottom bbox_bottom {EDGE.format('y', 2)} {END.format('y')}",
        "weight": " ".join(FIRST_ALIASES["weight"]),
    }.items()
}
"""Aliases of each column; case, blanks, punctuation and a unit at the end do not matter."""

METRES = ("m", "meter", "meters", "metre", "metres", "km", "ft", "feet")
MICRONS = ("um", "µm", "μm", "micron", "microns", "micrometer", "micrometers")
LENGTHS = {
    **dict.fromkeys(METRES, 1.0),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("in", "inch", "inches"), 0.0254),
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1e3),
    "cm": 1e-2,
    "mm": 1e-3,
    "nm": 0.0,
    **dict.fromkeys(MICRONS, 1e-6),
    **dict.fromkeys(("px", "pixel", "pixels"), 0.0),
}
"""Metres of each unit of length; 0 for pixels, and for nm (nanometres or nautical miles)."""

TIMES = (
    *("s", "sec", "secs", "second", "seconds", "ms", "msec", "us", "usec", "ns", "nsec"),
    *("nanoseconds", "microseconds", "milliseconds", "utc", "unix", "frame", "frames"),
)
SECONDS = ("s", "sec", "secs", "second", "seconds")
FRACTIONS = {
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"), 9),
    **dict.fromkeys(("us", "usec", "usecs", "microsec", "microsecs", "microseconds"), 6),
    **dict.fromkeys(("ms", "msec", "msecs", "millisec", "millisecs", "milliseconds"), 3),
}
"""Last words of the headers of fractions of a second, and the decimal places of the fractions."""

DEGREES = ("deg", "degs", "degree", "degrees", "wgs84")
ANGLES = {
    **dict.fromkeys(DEGREES, 1.0),
    **dict.fromkeys(("rad", "rads", "radians"), 57.295779513082323),
}
"""Degrees of each unit of angles."""

UNITS = {
    "t": TIMES,
    **dict.fromkeys(("x", "y", "z", "left", "top", "width", "height", "right", "bottom"), LENGTHS),
    "range": LENGTHS,
    **dict.fromkeys(("lat", "lon", "bearing", "elevation"), ANGLES),
    "alt": ("m", "meter", "meters", "metre", "metres"),
}
"""Units that may follow the name in a header, by name.

For example, ``lat_deg`` is read as ``lat``. Heights ``alt`` must be in metres."""

HINTS = {
    "id": "id$|mmsi|hex|icao|trac?k|trk|traj|obj|target|call_?sign|flight|name|who",
    "t": "time|stamp|frame|image|date|sec|scan|epoch|clock|when",
}
"""Patterns of headers that may be ids or times, although they are no aliases; for suggestions."""

AXIS_NAMES = {
    ("x", "y", "z"): ("x", "y", "z"),
    ("east", "north", "up", "down"): ("x", "y", "z", "z"),
    ("lat", "lon", "alt"): ("lat", "lon", "alt"),
}
"""Names for the columns of a position, by the parts in which the headers differ.

For example, ``pos_east`` and ``pos_north`` are x and y. The third column may be missing."""

NO_HINT = (
    "conf|score|prob|exist|quality|class|ness|"
    "^d?v|vel|speed|acc|size|std|cov|var|rho|sigma|err|min|max|width|height"
)
"""Pattern of headers of quantities other than ids, times and positions."""

NO_ID = (
    r"categor|label|type|camera|sensor|team|detect|^det_|image|file|valid|grid|heading|course|"
    r"(true|mag).?track|track.?(\W?deg|angle|rate)"
)
NO_PLACE = (
    r"^([adfgjsqw]_?[xyz]([\W_]|$)|m[xyz]$)|quat|rot|orient|omega|angle|angular|roll|pitch|yaw|(^|_)mag|gyro|"
    "left|right|top|bottom|upper|lower|force|torque|length|goal|dim|extent|norm|scale|offset|shift|delta|wind_"
)
PLACE = "pos|cent|trans|utm|loc|coord|east|^[pt]_?x"
"""Patterns of headers.

`NO_ID` has headers that are never proposed as ids, and `NO_PLACE` those that are never proposed as
positions. `PLACE` has headers of likely positions."""

SIDES = {
    "truth": {"gt", "truth", "groundtruth", "true", "ref", "reference", "actual"},
    "estimate": {"est", "estimate", "estimated", "pred", "predicted", "hat", "tracker"},
}
"""Words in headers that tell true from estimated positions, if a table has both."""

AIRCRAFT_OR_SHIP = re.compile(
    "hex|icao(24)?([ _]?(address|code|hex))?|mmsi|imo([ _]?(no|number))?|call.?sign|"
    "flight([ _]?(id|no|number))?|registration|tail[ _]?(no|number)|squawk",
    re.IGNORECASE,
)
SPEEDS = re.compile("speed|(ground.?)?speed.*|gs|sog|velocity|.*knots", re.IGNORECASE)
COURSES = re.compile("heading|course|cog|direction|bearing", re.IGNORECASE)
"""Patterns of headers of a table that tell if its column ``track`` is a direction in degrees."""


GROUP = re.compile(
    r"cid|(cluster|video|clip|movie|seq|sequence|camera|cam|recording|session|scene|scenario|"
    r"episode|run|trial|experiment|mission|game|play|match)(_?(id|no|name|key|token))?",
    re.IGNORECASE,
)
"""Pattern of headers of groups of rows, such as recordings. Ids may restart in each group."""


class Headers:
    """Headers of one table.

    Parameters
    ----------
    names : sequence of str
        Headers, without blanks at the ends.
    mapped : dict of str to str
        Headers that the user has mapped, by the name of the column.
    option : str
        Option with which the user names columns, for messages; blank for a DataFrame.
    where : str
        Beginning of messages.
    hidden : sequence of str
        Headers that are only used if they are mapped.
    axes : sequence of str
        Directions of x, y and z; by default x is to the east, and y to the north.
    """

    def __init__(
        self,
        names: Sequence[str],
        mapped: dict[str, str],
        option: str,
        where: str,
        hidden: Sequence[str] = (),
        axes: Sequence[str] = (),
    ) -> None:
        self.names, self.mapped, self.option, self.where = names, mapped, option, where
        self.axes = axes or ("east", "north", "up")
        self.exact = {name: k for k, name in enumerate(names)}
        first = names[0].lstrip("#% ") if names else ""
        for name, header in mapped.items():
            if header == first and first not in self.exact:  # the header begins like a comment
                mapped[name] = names[0]
        self.folded: dict[str, list[int]] = {}
        self.keyed: dict[str, list[tuple[int, str]]] = {}
        self.hidden = {k for k, name in enumerate(names) if name in hidden}
        for k, name in enumerate(names):
            self.folded.setdefault(name.casefold(), []).append(k)
            for key, unit in _keys(name):
                if self.axes[0] == "north":  # read east as y, and north as x
                    key = re.sub("east|north", lambda m: OTHER_AXIS[m[0]], key)
                self.keyed.setdefault(key, []).append((k, unit))
        for stem in ("", "bb", "bbox", "box"):  # if corners are numbered 0 and 1, then as 1 and 2
            keys = [f"{stem}{axis}{number}" for number in "210" for axis in "xy"]
            if self.keyed.keys().isdisjoint(keys[:2]) and self.keyed.keys() >= {*keys[2:]}:
                for new, old in zip(keys, keys[2:], strict=False):
                    self.keyed[new] = self.keyed.pop(old)
        self.directions = [names[k] for k in self.folded.get("track", ()) if self._has_directions]
        self.hidden |= {names.index(name) for name in self.directions}

    @property
    def _has_directions(self) -> bool:
        """True if a column ``track`` is a direction, as in data of aircraft and ships."""

        def any_is(pattern: re.Pattern[str]) -> bool:
            return any(map(pattern.fullmatch, self.names))

        on_earth = bool(self.places("lat") and self.places("lon"))
        return on_earth and (any_is(AIRCRAFT_OR_SHIP) or (any_is(SPEEDS) and not any_is(COURSES)))

    def spelt(self, header: str, name: str) -> int | None:
        """Return the position of a header, or None if it is missing.

        If no header is exactly equal, upper and lower case do not matter. `name` is the name of the
        column, for messages.
        """
        if header in self.exact:
            return self.exact[header]
        places = self.folded.get(header.casefold())
        return self._only(places, name) if places else None

    def find(self, name: str, *, plainly: bool = False) -> int | None:
        """Find the position of a column, or return None.

        A column that the user has mapped is found by its header only. For any other column, its
        name is tried, and then its aliases; with `plainly`, aliases are not tried.

        Raises
        ------
        InputError
            Several headers may be this column.
        """
        if name in self.mapped:
            return self.spelt(self.mapped[name], name)
        taken = self.taken
        for alias in (name,) if plainly else FIRST_ALIASES.get(name, (name,)):
            position = self.spelt(alias, name)
            if position is not None and position not in taken:
                return position
        return None if plainly else self._only(self.places(name), name)

    def compared(self, name: str, keyword: str) -> int:
        """Return the position of a column that a filter compares.

        `name` is a header, or a name of a role such as ``id`` or ``x``. `keyword` is the option of
        the filter.

        Raises
        ------
        InputError
            The table does not have the column.
        """
        column = None if name in self.mapped else self.spelt(name, name)
        column = self.find(name) if column is None else column
        if column is None:
            way = f"; {self.way_of_one_side}" if keyword == option("where") else ""
            raise InputError(
                f"{self.where}: no column {quoted(name)} for {keyword} (found: {self.shown}); "
                f"name one of these{way}"
            )
        return column

    @property
    def way_of_one_side(self) -> str:
        """Remedy for a filter by a column that only one file has, for messages."""
        first, second = ("a", "b") if self.option[:2] in ("a_", "b_") else ("truth", "estimate")
        ways = f"{option(f'{first}_where')} or {option(f'{second}_where')}"
        return f"for a column of one file use {ways}, such as {ways.split()[0]} 'score >= 0.5'"

    @property
    def taken(self) -> set[int]:
        """Positions of columns that are mapped or hidden."""
        mapped = {self.spelt(header, name) for name, header in self.mapped.items()}
        return self.hidden | {k for k in mapped if k is not None}

    def passed_over(self, name: str, unused: Sequence[str]) -> Iterator[str]:
        """Yield a notice if other headers would also fit the column `name`.

        There is no notice if the user mapped the column. If a header is equal to `name`, there is a
        notice only for ``id``, because another column may have better ids. `unused` has the headers
        of unused columns, and the notice names only these.
        """
        if name in self.mapped or (name != "id" and self.spelt(name, name) is not None):
            return
        position = self.find(name)
        candidates = [self.names[k] for k in self.places(name) if k != position]
        header = "" if position is None else self.names[position]
        if name == "id" and not AIRCRAFT_OR_SHIP.fullmatch(header):
            candidates += self.directions
        candidates = [header for header in candidates if header in unused]
        stamp = two_parts_of_a_stamp(unused) if name == "t" else None
        if stamp is not None:
            candidates = ["+".join(stamp)]
        if header and candidates:
            passed = " or ".join(map(quoted, candidates))
            remedy = ask(self.option, [f"{name}={candidates[0]}"])
            yield f"{name} is read from {quoted(header)}, not from {passed}; {remedy} reads that"

    def places(self, name: str) -> list[int]:
        """Return the positions of headers that are aliases of a column, the usual alias first."""
        units = UNITS.get(name, ())
        places = (
            k
            for key in _aliases(name)
            for k, unit in self.keyed.get(key, ())
            if not unit or unit in units
        )
        taken = self.taken
        return [k for k in dict.fromkeys(places) if k not in taken]

    def _only(self, places: list[int], name: str) -> int | None:
        if len(places) > 1:
            alike = " and ".join(quoted(self.names[k]) for k in sorted(places))
            both = "both" if len(places) == 2 else "all"
            remedy = ask(self.option, [f"{name}={self.names[places[0]]}"])
            raise InputError(f"{self.where}: {alike} may {both} be {name}; choose one, {remedy}")
        return places[0] if places else None

    @property
    def shown(self) -> str:
        """List of the headers, shortened if there are many."""
        return listed(self.names)

    def guess(self, wanted: Sequence[str], used: set[int]) -> dict[str, str]:
        """Guess the headers of missing columns by words in the headers; return a header by name.

        `wanted` has the names of the missing columns. In it, ``position`` stands for the two
        coordinates of a position, such as x and y or lat and lon. `used` has the positions of
        headers with another role.
        """
        free = self.free(used)
        guesses: dict[str, str] = {}
        for name, hint in HINTS.items():
            candidates = [header for header in free if re.search(hint, header, re.IGNORECASE)]
            if name == "id":
                candidates = [h for h in candidates if not re.search(NO_ID, h, re.IGNORECASE)]
                candidates = [header for header in candidates if not GROUP.fullmatch(header)]
            if name in wanted and candidates:
                guesses[name] = candidates[0]
        pairs = self.pairs(used)
        places = {"position", "lat", "lon"} & {*wanted}
        return guesses | pairs[0] if places and len(pairs) == 1 else guesses

    def free(self, used: set[int], other: str = NO_HINT) -> list[str]:
        """Return the headers without a role, except those that the pattern `other` matches."""
        return [
            name
            for k, name in enumerate(self.names)
            if k not in used | self.hidden
            and name.isprintable()
            and "," not in name
            and not re.search(other, name, re.IGNORECASE)
        ]

    def pairs(self, used: set[int]) -> list[dict[str, str]]:
        """Return the likeliest headers of a position, two or three, without the `used` columns."""
        free = {name.casefold(): name for name in self.free(used, f"{NO_HINT}|{NO_PLACE}")}
        pairs = []
        for parts, names in AXIS_NAMES.items():
            if {*parts} >= {*self.axes}:
                parts = (*self.axes[:2], *parts[2:])
            for header in free:
                keys = [header.replace(parts[0], part) for part in parts]
                if parts[0] in header and keys[1] in free:
                    each = zip(names, map(free.get, keys), strict=True)
                    pairs.append({name: own for name, own in each if own})
        own = (self.option or self.where).split("_")[0]
        foreign = set().union(*(words for side, words in SIDES.items() if side != own))
        for is_likely in (
            lambda header: own not in SIDES or foreign.isdisjoint(words_of(header)),
            lambda header: re.search(PLACE, header, re.IGNORECASE),
        ):
            pairs = [pair for pair in pairs if is_likely(next(iter(pair.values())))] or pairs
        return pairs


def two_parts_of_a_stamp(names: Sequence[str]) -> tuple[str, str] | None:
    """Return the two headers of a time that is split into seconds and their fraction.

    An example is secs and nsecs. Return None if there are no such headers.
    """
    words = {name: words_of(name) for name in names}
    whole = {tuple(parts[:-1]): name for name, parts in words.items() if parts[-1] in SECONDS}
    for name, (*stem, unit) in words.items():
        first = whole.get(tuple(stem))
        if unit in FRACTIONS and first is not None:
            return first, name
    return None


def words_of(header: str) -> list[str]:
    """Split a header into its words, in lower case."""
    return re.findall(r"[^\W_]+", header.casefold()) or [""]


OTHER_AXIS = {"east": "north", "north": "east"}
DIRECTIONS = {
    **dict.fromkeys(("east", "easting"), "east"),
    **dict.fromkeys(("north", "northing"), "north"),
    **dict.fromkeys(("up", "alt", "altitude", "elev", "elevation", "hae", "height", "hgt"), "up"),
    "down": "down",
}
"""Direction of an axis, by a word in its header."""


def direction_of(header: str) -> str:
    """Return the direction of an axis by the words of its header; blank if they do not say it."""
    return next((DIRECTIONS[word] for word in words_of(header) if word in DIRECTIONS), "")


CLOSING = tuple(")]>}")
IN_BRACKETS = re.compile(r"(.+?)[(\[<{]([^()\[\]<>{}]+).")
"""Pattern of a header with a name and a unit in brackets."""


def _joined(header: str) -> str:
    """Return a header as one word in lower case, without blanks and punctuation."""
    return "".join(re.findall(r"[^\W_]+", header)).casefold()


@cache
def _aliases(name: str) -> tuple[str, ...]:
    """Return the aliases of a column, each as one word, the most usual first."""
    return tuple(dict.fromkeys(map(_joined, HEADER_ALIASES.get(name, ()))))


def _keys(header: str) -> Iterator[tuple[str, str]]:
    """Yield the ways to read a header, as pairs of a name in one word and a unit.

    In the first pair, the name has all words, and the unit is blank. In the second pair, the last
    word or the text in brackets is the unit.
    """
    header = header.removeprefix("field.")  # rostopic echo -p writes this prefix
    words = [header] if header.isalnum() else re.findall(r"[^\W_]+", header)
    yield "".join(words).casefold(), ""
    if header.endswith(CLOSING) and (within := IN_BRACKETS.fullmatch(header)):
        yield _joined(within[1]), within[2].strip().casefold()
    elif len(words) > 1:
        yield "".join(words[:-1]).casefold(), words[-1].casefold()


def unit_of(text: str) -> str:
    """Return the unit of length or angle at the end of a header or text; blank if there is none."""
    units = (unit for key, unit in _keys(text) if unit in LENGTHS or unit in ANGLES)
    return next(units, "")


DETECTIONS = "rows without ids are detections, which TGOSPA cannot evaluate: it compares tracks"


def without_maps(headers: Headers, options: ReadOptions) -> dict[str, str]:
    """Remove mappings to missing headers that another file may have; return a message by name.

    Two kinds of mappings are removed: those for all files (`ReadOptions.shared`), and those of
    entries of covariances if the file has none of these entries. The message of a removed mapping
    is raised later, if all files lack its header.

    Raises
    ------
    InputError
        The header of any other mapping is missing.
    """
    missing = {}
    spreads = [name for name in headers.mapped if name.startswith(PREFIXES)]
    points = all(headers.spelt(headers.mapped[name], name) is None for name in spreads)
    lost = {n: header for n, header in headers.mapped.items() if headers.spelt(header, n) is None}
    if not lost:
        return {}
    from difflib import get_close_matches  # lazy: needed only for a message

    near = {
        name: next(iter(get_close_matches(header, headers.names, n=1)), "HEADER")
        for name, header in lost.items()
    }
    items = ["=".join(map(str.strip, item.split("=", 1))) for item in options.columns or ()]
    for name, header in lost.items():
        wrong = re.compile(rf"^({re.escape(name)}=(?:.*\+)?){re.escape(header)}(?=$|\+)")
        right = near[name].replace("\\", r"\\")
        items = [wrong.sub(rf"\g<1>{right}", item) for item in items]
    remedy = ask(headers.option, items)
    for name, header in lost.items():
        fault = (
            f"{headers.where}: no header {quoted(header)} for {name} (found: {headers.shown}); "
            + (
                f"name one of these, {remedy}"
                if "HEADER" in near.values()
                else f"did you mean {remedy}?"
            )
        )
        if name not in options.shared and not (points and name in spreads):
            raise InputError(fault)
        missing[name] = fault
        del headers.mapped[name]
    return missing


CORNER_OR_BOX = r"(?i)b?box(\.0)?|.*(left|upper).*"


def absent(
    headers: Headers,
    needed: tuple[int | None, int | None],
    states: dict[str, Mix | None],
) -> str:
    """Return the message about missing columns, with options that map them.

    `needed` has the positions of id and t, and `states` has the state columns by name. None means
    that the column is missing.
    """
    missing = [name for name, place in zip(("id", "t"), needed, strict=True) if place is None]
    missing += [name for name, mix in states.items() if mix is None] if states else ["position"]
    lost = f"{headers.where}: no column for {listed(missing)} (found: {headers.shown})"
    used = {k for k in needed if k is not None}
    used |= {k for mix in states.values() for k, _ in mix or ()}
    guesses = headers.guess(missing, used)
    if "position" in missing and guesses.keys().isdisjoint(("x", "lat")):
        guesses |= {axis: axis if axis in headers.names else "HEADER" for axis in "xy"}
    x, y, right, bottom = (headers.find(name) for name in ("x", "y", "right", "bottom"))
    if "left" in missing and None not in (x, y, right, bottom):
        missing, states = [name for name in missing if name not in BOX], {}
        guesses |= {n: headers.names[k] for n, k in (("left", x), ("top", y)) if k is not None}
    named = {name: guesses.get(name, "HEADER") for name in missing if name != "position"} | guesses
    # The suggestion keeps the columns and states that the user has named.
    named |= headers.mapped
    pattern = pattern_in(headers.free(set(), f"{NO_HINT}|{NO_PLACE}")) if "id" in missing else []
    if pattern:
        times = [f"t={named['t']}"] if "t" in named else []
        remedy = ask(headers.option or "columns", [*times, *pattern])
        return f"{lost}; if each object has its own columns, {remedy}; else {DETECTIONS}"
    items = [f"{name}={header}" for name, header in named.items()]
    if set(states) & set(missing):
        items += [name for name in states if name not in named]
    also = f"; {DETECTIONS}" if named.get("id") == "HEADER" else ""
    if also and missing == ["id"]:
        also = f"; if each file has one object, add a column id with the name of the object{also}"
    if "id" in missing and headers.directions:
        also += f"; if {quoted(headers.directions[0])} is not a direction, id=track reads it"
    side = (headers.option or headers.where).partition("_")[0].partition(",")[0]
    if side in SIDES and {"lat", "lon"} <= {*missing} and headers.places("x"):
        crs = option(f"{side}_crs", "EPSG:CODE")
        also += f"; if x,y are coordinates of a map, such as UTM, give {crs}"
    if "width" in missing:
        also += "; if the box has two corners, map right and bottom instead of width and height"
    pairs = headers.pairs(used) if "position" in missing else []
    if len(pairs) > 1:
        also += f"; positions may be {' or '.join(','.join(pair.values()) for pair in pairs)}"
    boxes = [name for name in headers.names if re.fullmatch(CORNER_OR_BOX, name)]
    if "position" in missing and boxes:
        if boxes[0].endswith(".0"):
            corners = [f"{name}={boxes[0][:-1]}{k}" for k, name in enumerate(CORNERS)]
            sizes = [f"{name}={boxes[0][:-1]}{k}" for k, name in enumerate(BOX)]
            own = [f"{name}={header}" for name, header in named.items() if name not in ("x", "y")]
            own = [item for item in own if item.partition("=")[0] != "position"]
            both = [ask(headers.option, [*own, *four]) for four in (corners, sizes)]
            return (
                f"{lost}; map the box with {both[0]} if it has two corners, or with "
                f"{both[1]} if it has a corner and a size"
            )
        also += f"; {boxes[0]} is read from columns left, top and width, height or right, bottom"
    how = "rename the columns, or map them with " if headers.option else "use "
    return f"{lost}; {how}{ask(headers.option, items)}{also}"
