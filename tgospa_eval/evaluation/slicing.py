"""Definitions of slices of an evaluation: ``NAME[=EDGES]``, or two of these joined by ``*``."""

import math
from collections.abc import Iterable
from itertools import pairwise

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.fields import floats, is_number
from tgospa_eval.formats.options import parse_region
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.slices import CROSSED

AS_WEIGHT = "weight"
"""Word that is written instead of edges if the values of an attribute are shares."""

OF_REGION = "region"

DERIVED = ("range", "speed", "size", "density", "age", OF_REGION)
"""Attributes that need no column of their own: they follow from states or box columns."""

OF_BOXES = ("left", "top", "width", "height", "right", "bottom", "length")
"""Columns from which the size follows if the states are not boxes."""

MAX_CROSSED = 2


@dataclass(frozen=True, kw_only=True)
class Attribute:
    """One attribute, and how a value decides the slice.

    Parameters
    ----------
    name : str
        Name of a column, or one of `DERIVED`.
    origin : tuple of float
        Point from which ``range`` is measured.
    edges : tuple of float
        Increasing ends of ranges. Each range is a slice. If both outer ends are infinite, no
        value is outside.
    values : tuple of str
        Texts. Each text has its own slice.
    weight : bool
        Whether values are shares from 0 to 1.
    ranges : tuple of (str, float, float)
        Columns with their smallest and largest values inside the ``region``.
    """

    name: str
    origin: tuple[float, ...] = ()
    edges: tuple[float, ...] = ()
    values: tuple[str, ...] = ()
    weight: bool = False
    ranges: tuple[tuple[str, float, float], ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of files that may have the values, or from which values may follow."""
        if self.ranges:
            return tuple(name for name, _, _ in self.ranges)
        if self.name == "size":
            return (self.name, *OF_BOXES)
        return () if self.origin else (self.name,)


@dataclass(frozen=True, kw_only=True)
class SliceBy:
    """One attribute, or two crossed attributes.

    Parameters
    ----------
    text : str
        Request of the attributes, as given.
    attributes : tuple of Attribute
        The attribute, or both.
    summed : bool
        Whether the slices of several evaluations are added up. Then ranges must be given.
    """

    text: str
    attributes: tuple[Attribute, ...]
    summed: bool = False


def parse_slices(texts: str | Iterable[str], *, summed: bool = False) -> tuple[SliceBy, ...]:
    """Parse the texts of slices; `summed` is that of `SliceBy`.

    Raises
    ------
    ConfigError
        A text cannot be understood, or is a duplicate.
    """
    slices_by_text: dict[str, SliceBy] = {}
    several = [texts] if isinstance(texts, str) or not isinstance(texts, Iterable) else texts
    for text in several:
        if not isinstance(text, str):
            raise ConfigError(f"{option('slices')} {text!r}: must be a text such as range=0:50:100")
        parts = [part.strip() for part in text.split(CROSSED.strip())]
        if len(parts) > MAX_CROSSED:
            raise ConfigError(
                f"{option('slices')} {quoted(text)}: at most two attributes can be crossed"
            )
        attributes = tuple(_attribute(part, text) for part in parts)
        by = CROSSED.join(parts)
        if by in slices_by_text:
            raise ConfigError(f"{option('slices')} {quoted(text)}: given twice")
        slices_by_text[by] = SliceBy(text=by, attributes=attributes, summed=summed)
    return tuple(slices_by_text.values())


def requested_columns(slices: Iterable[SliceBy]) -> tuple[str, ...]:
    """Return the columns of files that these slices may need."""
    names = (name for by in slices for part in by.attributes for name in part.columns)
    return tuple(dict.fromkeys(names))


def _attribute(part: str, text: str) -> Attribute:
    """Return one attribute; `text` is the whole given text, for messages."""
    name, equals, rest = (piece.strip() for piece in part.partition("="))
    if not name or (equals and not rest):
        raise ConfigError(
            f"{option('slices')} {quoted(text)}: must be NAME, NAME=EDGES or NAME=weight, such "
            "as range=0:50:100, or two of these joined by *"
        )
    if name == OF_REGION:
        return _region(rest, text)
    base, at, point = name.partition("@")
    origin: tuple[float, ...] = ()
    if at and base == "range":
        origin = _origin(point, text)
    if not equals:
        return Attribute(name=name, origin=origin)
    if rest == AS_WEIGHT:
        return Attribute(name=name, origin=origin, weight=True)
    ends = [end.strip() for end in rest.split(":")]
    if all(not end or is_number(end) for end in ends):
        return Attribute(name=name, origin=origin, edges=_edges(ends, text))
    if not all(ends) or len(set(ends)) < len(ends):
        raise ConfigError(f"{option('slices')} {quoted(text)}: a value is blank or given twice")
    return Attribute(name=name, origin=origin, values=tuple(ends))


def _edges(ends: list[str], text: str) -> tuple[float, ...]:
    given = [end for end in ends if end]
    values = floats(given).tolist()
    if any(not end for end in ends[1:-1]) or not all(map(math.isfinite, values)):
        raise ConfigError(
            f"{option('slices')} {quoted(text)}: edges are finite numbers; the first and the last "
            "may be blank"
        )
    if any(low >= high for low, high in pairwise(values)):
        raise ConfigError(f"{option('slices')} {quoted(text)}: edges must increase")
    if len(ends) == 1:  # makes two slices: below the edge, and from it on
        return -math.inf, *values, math.inf
    low = () if ends[0] else (-math.inf,)
    high = () if ends[-1] else (math.inf,)
    if not values:
        raise ConfigError(f"{option('slices')} {quoted(text)}: no edge is given")
    return (*low, *values, *high)


def _origin(point: str, text: str) -> tuple[float, ...]:
    parts = [part.strip() for part in point.split(",")]
    if not all(map(is_number, parts)):
        raise ConfigError(
            f"{option('slices')} {quoted(text)}: the point behind @ must be numbers, as "
            "range@0,0=0:50:100"
        )
    return tuple(floats(parts).tolist())


def _region(rest: str, text: str) -> Attribute:
    try:
        ranges = parse_region(rest or None)
    except ConfigError:
        ranges = {}
    if not ranges:
        raise ConfigError(
            f"{option('slices')} {quoted(text)}: must name ranges of columns, "
            "region=x=-50:50,y=0:100"
        )
    return Attribute(
        name=OF_REGION, ranges=tuple((name, low, high) for name, (low, high) in ranges.items())
    )
