"""What the user should know beside the numbers: notices, and warnings as data that travel."""

from collections.abc import Callable
from dataclasses import dataclass

from tgospa_eval.text import visible

Spelling = Callable[[str, object], str]
"""How a setting is written to whoever reads the remedy: name and value."""


SHORT = {"cutoff": "-c", "switch_penalty": "-g"}
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


def as_option(name: str, value: object = "") -> str:
    """A setting as the command line takes it."""
    option = SHORT.get(name) or f"--{name.replace('_', '-')}"
    return f"{option} {value}".rstrip()


def as_argument(name: str, value: object = "") -> str:
    """A setting as Python takes it."""
    return f"{name}={value!r}" if value != "" else name
