"""JSON documents: read strictly, and checked against a description of their fields.

A text, number, flag or null is described by a `FieldKind`. A list is described by a list with one
item, which describes all items. An object is described by a dict with the description of each field
by name. The object can have other fields; if the dict has the key ``...``, all other fields must
fit the description at this key. `Maybe` describes a field that can be missing. `Closed` describes
an object without other fields.
"""

import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

from tgospa_eval.common.files import SETTINGS, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError, TgospaError
from tgospa_eval.quoting import clipped, quoted


@dataclass(frozen=True)
class FieldKind:
    """Kind of the values of a field.

    Parameters
    ----------
    name : str
        Name of the kind, for messages.
    fits : callable
        Function that returns whether a value is of this kind.
    """

    name: str
    fits: Callable[[Any], bool]


@dataclass(frozen=True)
class Maybe:
    """Description of a field that can be missing.

    Parameters
    ----------
    description : FieldKind, dict or list
        Description of the value, if the field exists.
    """

    description: Any


class Closed(dict[Any, Any]):
    """Description of an object that has no other fields than the described ones."""


def _is_number(value: object) -> bool:
    return type(value) in (int, float) and abs(value) <= sys.float_info.max  # type: ignore[arg-type]


ANYTHING = FieldKind("a value", lambda _: True)
TEXT = FieldKind("a text", lambda value: isinstance(value, str))
FLAG = FieldKind("true or false", lambda value: isinstance(value, bool))
NUMBER = FieldKind("a finite number", _is_number)
COST = FieldKind("a finite number >= 0", lambda value: _is_number(value) and value >= 0)
POSITIVE = FieldKind("a finite number > 0", lambda value: _is_number(value) and value > 0)
COUNT = FieldKind("a whole number >= 0", lambda value: type(value) is int and 0 <= value < 2**63)
TIME = FieldKind(
    "a finite number or a text", lambda value: isinstance(value, str) or _is_number(value)
)


def or_null(kind: FieldKind) -> FieldKind:
    """Return a kind that also allows null."""
    return FieldKind(f"{kind.name}, or null", lambda value: value is None or kind.fits(value))


NULL = FieldKind("null", lambda value: value is None)


def one_of(*values: str) -> FieldKind:
    """Return the kind of values that are one of these texts."""
    return FieldKind(f"one of {', '.join(values)}", lambda value: value in values)


def fault(value: object, description: Any, place: str = "") -> str | None:
    """Return the first error of a value, with place, value and expected kind; None if it fits.

    Parameters
    ----------
    value : object
        Value of plain Python types.
    description : FieldKind, dict or list
        Description of the expected value, as explained at the top of this module.
    place : str
        Path of the value in its document, such as ``parts.localisation``.
    """
    if isinstance(description, FieldKind):
        fits = description.fits(value)
        return None if fits else f"{place or 'it'} is {shown(value)}; expected {description.name}"
    if not isinstance(value, list if isinstance(description, list) else dict):
        return f"{place or 'it'} is {shown(value)}; expected {_expected(description)}"
    if isinstance(value, list):
        items = enumerate(value)
        faults = (fault(item, description[0], f"{place}[{number}]") for number, item in items)
        return next(filter(None, faults), None)
    return next(_object_faults(value, description, f"{place}." if place else ""), None)


def _object_faults(value: dict[str, Any], description: dict[Any, Any], begin: str) -> Iterator[str]:
    """Yield the errors of the fields of an object."""
    any_other = description.get(...)
    for name, own in description.items():
        if name is not ... and name not in value and not isinstance(own, Maybe):
            yield f"{begin}{name}: is missing; expected {_expected(own)}"
    for name, item in value.items():
        own = description.get(name, any_other)
        place = f"{begin}{clipped(name)}"
        if own is not None:
            wrong = fault(item, own.description if isinstance(own, Maybe) else own, place)
            if wrong:
                yield wrong
        elif isinstance(description, Closed):
            yield f"{place}: is an unknown field"


def _expected(description: Any) -> str:
    """Format a description in words."""
    if isinstance(description, FieldKind):
        return description.name
    return "a list" if isinstance(description, list) else "an object"


def shown(value: object) -> str:
    """Format a value for a message: "a list", "an object", or JSON of limited length."""
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    return clipped(json.dumps(value, ensure_ascii=False, default=str))


def strict_json(text: str | bytes) -> Any:
    """Parse a JSON text; refuse NaN, infinities and repeated names.

    Raises
    ------
    ValueError
        The text is not JSON, or has NaN, an infinity or a repeated name.
    """
    if isinstance(text, bytes):
        text = text.decode("utf-8-sig")
    try:
        return json.loads(text, parse_constant=_no_number, object_pairs_hook=_once)
    except RecursionError:
        raise ValueError("lists are nested too deeply") from None


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a JSON number; every value must be finite")


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Build an object. Refuse a repeated name, of which the parser would keep the last value."""
    members: dict[str, object] = {}
    for name, value in pairs:
        if name in members:
            raise ValueError(f"{quoted(name)} is a duplicate key; delete one")
        members[name] = value
    return members


def checked(text: str | bytes, description: Any, place: str = "") -> Any:
    """Parse a JSON text, and check that it fits a description.

    Raises
    ------
    ValueError
        The text is not JSON, or does not fit.
    """
    try:
        value = strict_json(text)
    except ValueError as error:
        raise ValueError(f"{place}: {error}" if place else error) from None
    wrong = fault(value, description, place)
    if wrong:
        raise ValueError(wrong)
    return value


def read_document(
    path: str,
    schema: str,
    description: Any,
    kind: type[TgospaError] = InputError,
    *,
    remedy: str,
    size: int = SETTINGS,
) -> dict[str, Any]:
    """Read a JSON document from a file.

    Parameters
    ----------
    path : str
        Path of the file.
    schema : str
        Required text in the field ``schema``: name and version.
    description : dict
        Description of the fields of the document.
    kind : type
        Class of the error that is raised.
    remedy : str
        Advice at the end of the error message.
    size : int
        Largest allowed number of bytes.

    Raises
    ------
    kind
        The file cannot be read, or is not such a document.
    """
    return document_of(read_bytes(path, kind, size), path, schema, description, kind, remedy=remedy)


def document_of(
    content: bytes,
    path: str,
    schema: str,
    description: Any,
    kind: type[TgospaError] = InputError,
    *,
    remedy: str,
) -> dict[str, Any]:
    """Parse a JSON document that was read from `path`; see `read_document` for the rest."""
    try:
        document: dict[str, Any] = strict_json(content)
        own = document.get("schema") if isinstance(document, dict) else None
        if own != schema:
            raise ValueError(f'its schema is {shown(own)}, this version reads "{schema}"')
        wrong = fault(document, description)
    except ValueError as error:
        wrong = str(error)
    if wrong:
        raise kind(f"{path}: {wrong}; {remedy}")
    return document
