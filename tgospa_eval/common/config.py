"""Declarations of options, and settings files: ``tgospa-eval.toml`` or ``pyproject.toml``."""

import dataclasses
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeAlias

from tgospa_eval.common.files import read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import option, quoted

FILE = "tgospa-eval.toml"
TOOL_TABLE = "tgospa-eval"
LARGEST_NUMBER = sys.float_info.max
ALIASES = {"gamma": "switch-penalty"}
"""Other names for options in a settings file, each with the name of the option."""

Settings: TypeAlias = dict[str, str | int | float | bool]
"""Values of options, by their names on the command line without leading dashes: ``max-gap``."""


@dataclass(frozen=True, kw_only=True)
class SettingsFile:
    """Path and content of the settings file in use.

    Parameters
    ----------
    path : str
        Path of the file.
    named : bool
        Whether the user named the file; otherwise it was found in the current folder.
    options : dict
        Its settings.
    """

    path: str
    named: bool
    options: Settings

    def __str__(self) -> str:
        shown = ", ".join(f"{name} = {_shown(value)}" for name, value in self.options.items())
        return f"settings from {self.path}: {shown}" if shown else f"no setting from {self.path}"

    def only(self, names: Collection[str]) -> "SettingsFile":
        """Return a copy with only the settings of these options."""
        kept = {name: value for name, value in self.options.items() if name in names}
        return replace(self, options=kept)


def settings_field(used: SettingsFile | None) -> dict[str, Any]:
    """Return the field of JSON documents about the settings file; no field without a file."""
    return {} if used is None else {"settings_file": dict(vars(used))}


def read_here(path: str) -> bytes | None:
    """Read the content of a file; return None if it is missing.

    Raises
    ------
    ConfigError
        The file cannot be read.
    """
    return read_bytes(path, ConfigError) if os.path.isfile(path) else None


def load(
    path: str | None,
    known: Callable[[], Mapping[str, bool]],
    trusted: Collection[str],
    read: Callable[[str], bytes | None] = read_here,
) -> SettingsFile | None:
    """Read the settings file.

    Parameters
    ----------
    path : str, optional
        Path of the file that the user named. By default, it is ``tgospa-eval.toml`` in the current
        folder, or ``pyproject.toml`` if this has a table of this program.
    known : callable
        Function without arguments. It returns a mapping with the name of each option, as in
        `Settings`. The value is true if the option is a flag.
    trusted : collection of str
        Options that a file in the current folder can set. Other options in such a file are refused,
        because somebody else may have written the file.
    read : callable
        Function that receives a path and returns the content of the file, or None without a file.

    Returns
    -------
    SettingsFile or None
        The file in use.

    Raises
    ------
    ConfigError
        The file cannot be read, is not TOML, or has a key that is unknown or not allowed.
    """
    named = path is not None
    if path is None:
        path, table = _search(read)
        if path is None:
            return None
    else:
        table = read_toml(path, read(path))
        if Path(path).name == "pyproject.toml":
            table = section(table) or {}
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: [tool.{TOOL_TABLE}] must be a table")
    options = settings_of(table, path, known())
    refused = [quoted(name) for name in options if name not in trusted]
    if refused and not named:
        raise ConfigError(
            f"{path}: only a file that you name may set {', '.join(refused)}; if you trust this "
            f"file, use {option('config', path)}"
        )
    return SettingsFile(path=path, named=named, options=options)


def settings_of(table: Mapping[str, object], path: str, known: Mapping[str, bool]) -> Settings:
    """Check the table of a settings file, and return its settings; `path` begins messages.

    Raises
    ------
    ConfigError
        A key is unknown, or a value is of the wrong kind.
    """
    settings: Settings = {}
    for key, value in table.items():
        name = key.replace("_", "-")
        name = ALIASES.get(name, name)
        if name not in known:
            raise ConfigError(f"{path}: unknown key {quoted(key)}; {_suggestion(name, known)}")
        for number in value if isinstance(value, list) else [value]:
            if isinstance(number, int | float) and abs(number) > LARGEST_NUMBER:
                raise ConfigError(
                    f"{path}: {quoted(key)} is not a finite number in the range of a double"
                )
        if isinstance(value, list):
            value = ",".join(map(str, value))
        if not isinstance(value, str | int | float):
            kind = (
                "nothing" if value is None else "a table" if isinstance(value, dict) else "a date"
            )
            raise ConfigError(f"{path}: {quoted(key)} is {kind}; must be a number or a text")
        if name in settings:
            raise ConfigError(f"{path}: {quoted(name)} is given twice, under two names")
        if isinstance(value, bool) != known[name]:
            needed = "true or false" if known[name] else "a value, not true or false"
            raise ConfigError(f"{path}: {quoted(key)} is {value!r}; must be {needed}")
        settings[name] = value
    return settings


def _shown(value: str | float | bool) -> str:
    """Format a value as TOML."""
    return quoted(value) if isinstance(value, str) else str(value).lower()


def _suggestion(name: str, known: Iterable[str]) -> str:
    """Return advice on an unknown key: the most similar known key, or all known keys."""
    from difflib import get_close_matches  # lazy: for mistakes only

    near = get_close_matches(name, known, 1)
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(sorted(known))}"


def _search(read: Callable[[str], bytes | None]) -> tuple[str | None, object]:
    content = read(FILE)
    if content is not None:
        return FILE, read_toml(FILE, content)
    try:
        content = read("pyproject.toml") or b""
        # Parsing takes 15 ms at each start, and is done only if the file has the name of the table.
        has_table = TOOL_TABLE.encode() in content and read_toml("pyproject.toml", content)
    except ConfigError:
        return None, {}  # a broken pyproject.toml is not reported: other programs use it, too
    table = section(has_table) if has_table else None
    return (None, {}) if table is None else ("pyproject.toml", table)


def section(document: Mapping[str, object]) -> object:
    """Return the table of this program in ``pyproject.toml``; None without one."""
    tool = document.get("tool")
    return tool.get(TOOL_TABLE) if isinstance(tool, dict) else None


def read_toml(path: str, content: bytes | None = None) -> dict[str, object]:
    """Parse a TOML file, or its `content` if this was read before.

    Raises
    ------
    ConfigError
        The file cannot be read, or is not TOML.
    """
    import tomllib  # lazy: most runs have no such file

    if content is None:
        content = read_bytes(path, ConfigError)
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except RecursionError:
        raise ConfigError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # errors of TOML, UTF-8 or huge integers
        raise ConfigError(f"{path}: not valid TOML: {error}") from None


# -------------------------------------------------------------------------------------------------
# Declarations of options. The options of a command are fields of dataclasses, one for each option.


@dataclass(frozen=True)
class OptionSpec:
    """Properties of an option, kept in the metadata of its field.

    Parameters
    ----------
    section : str
        Section of the help in which the option is listed.
    declaration : str
        Names and placeholder of the value in the help: ``-c, --cutoff C``. An option without a
        placeholder is a flag.
    help : str
        Explanation in the help.
    choices : collection of str
        Allowed values, if they are few. It is a registry if other packages can add values.
    kind : str
        Kind of the text: ``"path"``, or ``"size"`` of memory; blank for any text.
    low, high : int, optional
        Smallest and largest allowed value of a number.
    shown : str
        Default in words.
    number : bool
        Whether the option can change TGOSPA or its bracket.
    trusted : bool
        Whether a settings file in the current folder can set the option, although the user did not
        name the file. Somebody else may have written this file. Therefore, an option is not trusted
        if it writes files, connects to other machines, takes resources, judges results, sets the
        accuracy or suppresses output.
    everywhere : bool
        Whether all commands that evaluate have the option; otherwise only `evaluate` has it.
    stored : bool
        Whether the option is also read from the environment and from settings files.
    sensors : bool
        Whether the command `associate` has the option.
    whose : str
        Names of the distances that have the option; blank if all have it. Only messages use these
        names. Checks use `Distance.options`.
    methods : sequence of str
        Methods of reduction that have the option; empty if all have it.
    parts : str
        Advice if the option does not work for data in parts; blank if it works.
    """

    section: str
    declaration: str
    help: str
    choices: Collection[str] = ()
    kind: str = ""
    low: int | None = None
    high: int | None = None
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
        """Name of the option in a settings file: the first long name in `declaration`."""
        names = self.declaration.split(" ")
        return next(name for name in names if name.startswith("--"))[2:].rstrip(",")


def setting(section: str, declaration: str, text: str, *, default: Any = None, **about: Any) -> Any:
    """Declare an option as a field of a subclass of `Values`.

    Flags are off by default. Options with the placeholder FILE or DIR are paths.
    """
    metavar = declaration.split(", ")[-1].partition(" ")[2]
    if metavar in ("FILE", "DIR"):
        about["kind"] = "path"
    spec = OptionSpec(section, declaration, text, **about)
    return dataclasses.field(default=default if metavar else False, metadata={"setting": spec})


@dataclass(frozen=True, kw_only=True)
class Values:
    """Base class of the values of some options of a command."""

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Self:
        """Build an object from all options of a command; options without a field are ignored."""
        names = {field.name for field in dataclasses.fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in names})

    @classmethod
    def settings(cls) -> dict[str, OptionSpec]:
        """Return the `OptionSpec` of each field that is an option, by name of the field."""
        fields = dataclasses.fields(cls)
        return {one.name: one.metadata["setting"] for one in fields if one.metadata}
