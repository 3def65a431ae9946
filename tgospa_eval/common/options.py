"""Options: what is known of them, beside the fields of the records that hold their values."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Self

from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True)
class OptionSpec:
    """What is known of a field that is an option.

    Parameters
    ----------
    section : str
        Of the help.
    declaration : str
        As the help shows the option: ``-c, --cutoff C``; without a metavar it is a flag.
    help : str
        What it does.
    choices : collection of str
        Its values, if they are few; or members, which other packages may add to.
    kind : str
        Of the text: ``"path"``, or ``"size"`` of memory; blank for any.
    least, most : int, optional
        Of a number.
    shown : str
        The default in words.
    number : bool
        Whether it changes the number or its bracket.
    trusted : bool
        Whether a settings file may set it that was only found. Somebody else may have written it:
        nothing is trusted that writes, connects, takes resources, judges, says how exact is exact,
        or keeps quiet.
    everywhere : bool
        Whether all verbs that evaluate have it; otherwise `evaluate` alone.
    stored : bool
        Whether it is read from the environment and from settings files as well.
    sensors : bool
        Whether `associate` has it, which knows no trajectories.
    whose : str
        Which of our distances have it, for messages, if not all; `Distance.options` decides.
    methods : sequence of str
        The reductions that it is for, if not all.
    parts : str
        What to do instead where data are read in parts and it has no place; blank if it has.
    """

    section: str
    declaration: str
    help: str
    choices: Collection[str] = ()
    kind: str = ""
    least: int | None = None
    most: int | None = None
    shown: str = ""
    number: bool = True
    trusted: bool = True
    everywhere: bool = True
    stored: bool = True
    sensors: bool = True
    whose: str = ""
    methods: Sequence[str] = ()
    parts: str = ""

    @property
    def key(self) -> str:
        """Its name in a settings file: the first long one."""
        names = self.declaration.split(" ")
        return next(name for name in names if name.startswith("--"))[2:].rstrip(",")


def setting(section: str, declaration: str, text: str, *, default: Any = None, **about: Any) -> Any:
    """Declare a field of a record of options."""
    return dataclasses.field(
        default=default, metadata={"setting": OptionSpec(section, declaration, text, **about)}
    )


@dataclass(frozen=True, kw_only=True)
class Values:
    """A record of options."""

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Self:
        """From all options of a verb by parameter, those of others left aside."""
        names = {field.name for field in dataclasses.fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in names})

    @classmethod
    def settings(cls) -> dict[str, OptionSpec]:
        """What is known of the fields that have an option."""
        fields = dataclasses.fields(cls)
        return {one.name: one.metadata["setting"] for one in fields if one.metadata}
