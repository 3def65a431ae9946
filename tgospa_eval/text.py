"""What came from a user, as it is shown: on its line, and no command to whatever shows it.

Ids, names of files, columns and classes, units, settings and messages may hold anything. Control
characters (C0 and C1), line breaks, marks that turn the direction of writing and what cannot be
seen are written as Python would, and what CI systems take for a command loses its first character
to such an escape.
"""

import re
from collections.abc import Iterable

CLIPPED_LENGTH = 60
"""Characters of a text that a message quotes."""

LISTED = 12
"""Names of a list that a message shows."""

_COMMAND = r"(?<!\S):(?=:)|#(?=#\w*\[)"
"""Where a workflow command begins: after blanks alone on GitHub (::error), anywhere on Azure,
TeamCity and older GitHub (##[error], ##vso[task], ##teamcity[message])."""


def visible(text: str) -> str:
    """The text on one line, all of it to be seen."""
    if not text.isprintable():
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if "::" in text or "##" in text:
        text = re.sub(_COMMAND, lambda found: f"\\x{ord(found[0]):02x}", text)
    return text


def as_unicode(text: str) -> str:
    """The text with bytes that are no UTF-8, as names of files may have them, in hexadecimal."""
    return text.encode("utf-8", "backslashreplace").decode()


def visible_lines(text: str) -> str:
    """The same for a text of several lines, which remain lines; tabs remain too."""
    return "\n".join("\t".join(map(visible, line.split("\t"))) for line in text.split("\n"))


def clipped(text: str, most: int = CLIPPED_LENGTH) -> str:
    """The beginning of the text, all of it to be seen, with dots for what is left out."""
    shown = visible(text[: most + 1])
    return shown if len(shown) <= most else f"{shown[: most - 3]}..."


def ending(text: str, most: int) -> str:
    """The end of the text, in which names and paths differ, with dots for what is left out."""
    return text if len(text) <= most else f"...{text[len(text) - most + 3 :]}"


def quoted(text: object) -> str:
    """A text in quotes, as messages show what they were given: visible, at most 60 characters."""
    return f'"{clipped(str(text))}"'


def listed(texts: Iterable[object], most: int = LISTED) -> str:
    """Names with commas between them, each as in `quoted` but for the quotes."""
    names = list(texts)
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(clipped(str(name)) for name in names[:most]) + rest
