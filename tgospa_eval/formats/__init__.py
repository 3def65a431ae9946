"""FILES -> Trajectories. Reading a format is one file here; so far that is the CSV table."""

import os
from dataclasses import dataclass, field

from tgospa_eval.errors import ConfigError
from tgospa_eval.trajectories import Trajectories


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What was read from a file, and what the user should know about it.

    Parameters
    ----------
    trajectories : Trajectories
        What takes part in the evaluation.
    rows : int
        Rows of the file, the header not counted.
    notices : tuple of str
        One sentence each.
    left_out : dict
        How many rows do not take part, by the rule that left them out: ``"absent"``,
        ``"duplicate"``.
    """

    trajectories: Trajectories
    rows: int
    notices: tuple[str, ...] = field(default=())
    left_out: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How to read a file.

    Parameters
    ----------
    columns : tuple of str, optional
        State columns in order; an item ``"name=header"`` says under which header a name is found
        (``"id=trk"``, ``"t=time_s"``, ``"x=px"``). By default x, y, z as far as present, else
        lat, lon.
    decimal : {".", ","}
        Decimal mark.
    on_duplicate : {"error", "first", "last"}
        What to do with a repeated (id, t).

    Raises
    ------
    ConfigError
        A value is none of these.
    """

    columns: tuple[str, ...] | None = None
    decimal: str = "."
    on_duplicate: str = "error"

    def __post_init__(self) -> None:
        if isinstance(self.columns, str):
            raise ConfigError(f"columns is {self.columns!r}: must be a tuple of names")
        for name, allowed in (
            ("decimal", (".", ",")),
            ("on_duplicate", ("error", "first", "last")),
        ):
            value = getattr(self, name)
            if value not in allowed:
                options = ", ".join(f'"{item}"' for item in allowed)
                raise ConfigError(
                    f'{name.replace("_", "-")} is "{value}": must be one of {options}'
                )


def read(path: str | os.PathLike[str], options: ReadOptions | None = None) -> Reading:
    """Read a file of trajectories, with its notices.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    """
    from tgospa_eval.formats.table import read_table

    try:
        name = os.fsdecode(path)
    except TypeError:
        raise ConfigError(f"path is {path!r}: must be a path") from None
    return read_table(name, options or ReadOptions())


def read_trajectories(
    path: str | os.PathLike[str],
    *,
    columns: tuple[str, ...] | None = None,
    decimal: str = ".",
    on_duplicate: str = "error",
) -> Trajectories:
    """Read a CSV file of trajectories: ``id,t,x[,y[,z]]``, one row per object and step.

    Parameters
    ----------
    path : path
        The file.
    columns, decimal, on_duplicate
        As in `tgospa_eval.formats.ReadOptions`.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is none of those allowed.
    """
    options = ReadOptions(columns=columns, decimal=decimal, on_duplicate=on_duplicate)
    return read(path, options).trajectories
