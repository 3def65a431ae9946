"""What the fixtures that run a command line, or write a file, are and hand back."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Answer(NamedTuple):
    """What a command line left behind."""

    status: int
    out: str
    err: str


Invoke = Run = Callable[..., Any]
"""Give arguments, get an `Answer`; the first in this process, the other in one of its own."""

Write = Callable[[str, str | bytes], str]
"""Give a name and what is in the file, get its path."""
