"""What the fixtures that run a command line hand back."""

from typing import NamedTuple


class Answer(NamedTuple):
    """What a command line left behind."""

    status: int
    out: str
    err: str
