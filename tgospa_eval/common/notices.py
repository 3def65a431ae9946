"""What the user should know beside the numbers: notices, and warnings as data that travel."""

import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import PLAIN_DECIMAL
from tgospa_eval.errors import TgospaError, TgospaWarning
from tgospa_eval.text import visible

SHORT_OPTIONS = {"cutoff": "-c", "switch_penalty": "-g"}
"""Options that are known by a letter."""


@dataclass(frozen=True, kw_only=True)
class Notice:
    """A sentence for the user; with a code it is a warning, which every output shows.

    What it quotes is made visible, as in an error.

    Parameters
    ----------
    text : str
        What was seen, without a full stop.
    code : str
        Of a warning, for scripts: ``"unit-scale"``; see docs/reference/json.md. Blank otherwise.
    remedy : str
        What would be right.
    """

    text: str
    code: str = ""
    remedy: str = ""

    def __post_init__(self) -> None:
        for name in ("text", "remedy"):
            object.__setattr__(self, name, visible(getattr(self, name)))

    def __str__(self) -> str:
        return f"warning: {self.sentence}" if self.code else self.sentence

    @property
    def sentence(self) -> str:
        """Text and remedy."""
        return f"{self.text}; {self.remedy}" if self.remedy else self.text

    def record(self) -> dict[str, str]:
        """As in the JSON."""
        return {"code": self.code, "text": self.text, "remedy": self.remedy}

    def about(self, name: str) -> "Notice":
        """The same, with the name of a file or a pair in front."""
        return Notice(text=f"{name}: {self.text}", code=self.code, remedy=self.remedy)


def told(settings_file: object | None, warnings: Iterable[Notice]) -> list[str]:
    """What is said beside numbers: where settings come from, and what looks wrong."""
    return [str(one) for one in (settings_file, *warnings) if one is not None]


NOT_OF_THE_USER = ("tgospa_eval", "contextlib")
"""Packages whose frames are between a warning and the line of the user."""


def warn_user(notices: Iterable[Notice], spoken: Callable[[str], str] = str) -> None:
    """A Python warning for each, at the line of the user that led to it."""
    level, frame = 2, sys._getframe(1).f_back
    while frame and str(frame.f_globals.get("__name__")).partition(".")[0] in NOT_OF_THE_USER:
        level, frame = level + 1, frame.f_back
    for notice in notices:
        warnings.warn(spoken(notice.sentence), TgospaWarning, stacklevel=level + 1)


RENAMED = {"class": "class_", "max": "limits", "slice": "slices", "with": "with_"}
"""Keywords that are not called as their options."""

OF_READING = {
    "class": "classes",
    "fix-cov": "fix_covariance",
    "missing-cov": "missing_covariance",
    "truth-columns": "columns",
    "estimate-columns": "columns",
    "truth-class": "classes",
    "estimate-class": "classes",
    "truth-where": "where",
    "estimate-where": "where",
    "truth-format": "format",
    "estimate-format": "format",
}
"""What `read_trajectories` calls options."""

WORD_OPTIONS = ("distance", "grid", "missing-cov", "mixed", "on-duplicate", "on-invalid", "outage")
"""Options whose value in messages is a word."""

NO_VALUE = r"(?!(?:is|for|of)\b)"
"""What follows an option is a word of the sentence."""

_OPTION = (
    rf"--(?:(?P<columns>(?:truth-|estimate-)?columns) {NO_VALUE}(?P<names>[\w=]+(?:,[\w=]+)*)"
    r"|(?P<decimal>decimal) (?P<mark>,)"
    rf"|(?P<named>{'|'.join(WORD_OPTIONS)}) {NO_VALUE}(?P<word>[\w-]+)"
    rf"|(?P<sized>[a-z][a-z-]*) (?P<number>{PLAIN_DECIMAL})(?=[;:,)]?(?:\s|$))"
    r"|(?P<alone>[a-z][a-z-]*)(?: (?:FILE|NAME|N)\b)?)"
)


def in_python(text: str, *, reads: bool = True) -> str:
    """A message with the names of keywords where it has those of options.

    `reads`: of `read_trajectories`, whose keywords have other names.
    """
    if "-" not in text:
        return text

    def keyword(found: re.Match[str]) -> str:
        kinds = ("columns", "decimal", "named", "sized", "alone")
        option: str = next(filter(None, map(found.group, kinds)))
        name = (OF_READING if reads else {}).get(option) or RENAMED.get(option)
        name = name or option.replace("-", "_")
        if found["columns"]:
            return f"{name}={tuple(found['names'].split(','))}"
        if found["number"]:
            return f"{name}={found['number']}"
        value = found["mark"] or found["word"]
        return name if value is None else f'{name}="{value}"'

    spelt = re.sub(_OPTION, keyword, text.replace("--covariance FILE, or ", ""))
    for name, option in (*SHORT_OPTIONS.items(), ("output", "-o")):
        spelt = re.sub(rf"(?<!\S){option}(?= |$)", name, spelt)
    return spelt


@contextmanager
def spoken_in_python(*, reads: bool = True) -> Iterator[None]:
    """What is raised inside names arguments, see `in_python`.

    Raises
    ------
    TgospaError
        One is raised inside; its message names arguments now.
    """
    try:
        yield
    except TgospaError as error:
        text = in_python(str(error), reads=reads)
        if text == str(error):
            raise
        raise type(error)(text) from None
