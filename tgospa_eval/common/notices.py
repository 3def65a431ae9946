"""Notices and warnings about an evaluation, as data that travel with the numbers."""

import sys
import warnings
from collections.abc import Iterable

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import TgospaWarning
from tgospa_eval.quoting import visible


@dataclass(frozen=True, kw_only=True)
class Notice:
    """Sentence for the user. A notice with a code is a warning; every output shows warnings.

    Invisible characters in a notice are escaped, as in messages of errors.

    Parameters
    ----------
    text : str
        The sentence, without a full stop.
    code : str
        Code of the warning, such as ``"unit-scale"`` (docs/reference/json.md). Blank if the notice
        is not a warning.
    remedy : str
        Advice on what to do.
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
        """Return the notice as an object of JSON documents."""
        return {"code": self.code, "text": self.text, "remedy": self.remedy}

    def about(self, name: str) -> "Notice":
        """Return a copy whose text begins with the name of a file or pair of files."""
        return Notice(text=f"{name}: {self.text}", code=self.code, remedy=self.remedy)


def messages_of(settings_file: object | None, warnings: Iterable[Notice]) -> list[str]:
    """Return a text about the settings file if one is in use, then the texts of the warnings."""
    return [str(one) for one in (settings_file, *warnings) if one is not None]


NOT_OF_THE_USER = ("tgospa_eval", "contextlib")
"""Packages that are not code of the user. Frames in them are skipped to find the user's line for a
warning."""


def warn_user(notices: Iterable[Notice]) -> None:
    """Issue a Python warning for each notice, for the line of the user's code that led to it."""
    level, frame = 2, sys._getframe(1).f_back
    while frame and str(frame.f_globals.get("__name__")).partition(".")[0] in NOT_OF_THE_USER:
        level, frame = level + 1, frame.f_back
    for notice in notices:
        warnings.warn(notice.sentence, TgospaWarning, stacklevel=level + 1)
