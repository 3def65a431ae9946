"""Quoted texts and names of options in messages.

Text of a user is shown on one line, and is never a command to a terminal or a CI system. Such text
can contain any character. It is in ids, names of files, columns and classes, units and settings.
Control characters (C0 and C1), line breaks, marks of the writing direction and invisible characters
are escaped as in Python. The first character of a command of a CI system is escaped too.

A message names an option as the user writes it: ``--max-gap`` on the command line, ``max_gap`` in
Python. The place where the user writes options is called the surface. `option` returns the text of
an option for the current surface.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

CLIPPED_LENGTH = 60
"""Largest number of characters that a message quotes."""

LISTED = 12
"""Largest number of names that a message lists."""

_COMMAND = r"(?<!\S):(?=:)|#(?=#\w*\[)"
"""Pattern of the first character of a command of a CI system.

On GitHub (::error), a command begins its line, possibly after blanks. On Azure, TeamCity and older
GitHub (##[error], ##vso[task], ##teamcity[message]), any text can be before it.
"""


def visible(text: str) -> str:
    """Return the text on one line, with escapes for invisible characters and for CI commands."""
    if not text.isprintable():
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if "::" in text or "##" in text:
        text = re.sub(_COMMAND, lambda match: f"\\x{ord(match[0]):02x}", text)
    return text


def as_unicode(text: str) -> str:
    """Return the text with escapes for bytes that are not UTF-8, as in some names of files."""
    return text.encode("utf-8", "backslashreplace").decode()


def visible_lines(text: str) -> str:
    """Return the text with the escapes of `visible`, but keep its line breaks and tabs."""
    return "\n".join("\t".join(map(visible, line.split("\t"))) for line in text.split("\n"))


def clipped(text: str, width: int = CLIPPED_LENGTH) -> str:
    """Return the text with the escapes of `visible`. A long text is cut, and three dots follow."""
    shown = visible(text[: width + 1])
    return shown if len(shown) <= width else f"{shown[: width - 3]}..."


def ending(text: str, width: int) -> str:
    """Return the text. A long text loses its beginning, because most names differ at the end."""
    return text if len(text) <= width else f"...{text[len(text) - width + 3 :]}"


def quoted(text: object) -> str:
    """Return the text, shortened by `clipped`, between double quotes."""
    return f'"{clipped(str(text))}"'


def listed(texts: Iterable[object], shown: int = LISTED) -> str:
    """Join the first `shown` texts, shortened by `clipped`, and add the number of the others."""
    names = list(texts)
    rest = f" and {len(names) - shown} more" if len(names) > shown else ""
    return ", ".join(clipped(str(name)) for name in names[:shown]) + rest


# -------------------------------------------------------------------------------------------------
# Options, as the reader of a message writes them.

COMMAND, PYTHON, READER = "command", "python", "reader"
"""Surfaces: the command line, keywords of Python, and keywords of `read_trajectories`."""

surface = ContextVar("surface", default=PYTHON)
"""Current surface of messages. New threads and processes begin with `PYTHON`. They get the surface
of their parent only if it calls them by `on_surface`."""

FLAGS = {"slices": "--slice", "limits": "--max"}
"""Options whose names on the command line differ from their keywords."""

LETTERS = {"cutoff": "-c", "switch_penalty": "-g", "output": "-o"}

OF_READER = {
    "class_": "classes",
    "fix_cov": "fix_covariance",
    "missing_cov": "missing_covariance",
    "truth_columns": "columns",
    "estimate_columns": "columns",
    "truth_class": "classes",
    "estimate_class": "classes",
    "truth_where": "where",
    "estimate_where": "where",
    "truth_format": "format",
    "estimate_format": "format",
}
"""Names of some options as keywords of `read_trajectories`."""


NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?"
"""Pattern of values that are numbers. A message for Python shows them without quotes."""


def option(name: str, value: object = None, *, metavar: str = "", short: bool = False) -> str:
    """Return an option as the current surface spells it: ``--max-gap 10`` or ``max_gap=10``.

    Parameters
    ----------
    name : str
        Keyword of the option in Python.
    value : object, optional
        Value to show after the option; True for a flag.
    metavar : str
        Text to show instead of a value, such as ``FILE``.
    short : bool
        Whether to use the letter of the option on the command line.
    """
    text = metavar if value is None or value is True else str(value)
    if surface.get() == COMMAND:
        flag = f"--{name.rstrip('_').replace('_', '-')}"
        flag = LETTERS[name] if short else FLAGS.get(name, flag)
        return f"{flag} {text}" if text else flag
    if surface.get() == READER:
        name = OF_READER.get(name, name)
    if value is None:
        return name
    if name.endswith("columns"):
        return f"{name}={tuple(text.split(','))}"
    is_plain = value is True or re.fullmatch(NUMBER, text)
    if is_plain:
        return f"{name}={text or value}"
    return f"{name}={text!r}" if '"' in text else f'{name}="{text}"'


@contextmanager
def spelled_for(name: str) -> Iterator[None]:
    """Set the surface for messages that are made in the block."""
    token = surface.set(name)
    try:
        yield
    finally:
        surface.reset(token)


def on_surface(name: str, function: Callable[..., T], *arguments: object) -> T:
    """Call a function with this surface for its messages. New threads and processes need this."""
    with spelled_for(name):
        return function(*arguments)
