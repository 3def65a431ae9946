"""Records of a study on disk, one JSON document a line: a study that was killed goes on.

The first line holds the settings. A record is there as a whole or not at all: what was cut off at
the end is taken away.
"""

import json
import os
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import NoReturn, TypeAlias, TypeGuard

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.files import is_regular, named
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.reports.records import SceneRecord
from tgospa_eval.results.records import PARTS

Key = tuple[int, int, int]
Kind: TypeAlias = type | tuple[type, ...]

LOG_SCHEMA = "tgospa-eval/study/1"
LOG_NAME = "runs.jsonl"

LOCKED_BYTE = 1 << 40
"""A byte that no file of ours reaches, for locking."""

NUMBER = (int, float)
LARGEST = 1e100
"""Beyond any cost, count or time; squares of it are finite."""

RECORD: dict[str, Kind] = {
    **dict.fromkeys(("targets", "steps", "run"), int),
    **dict.fromkeys(("occupied", "sizes", "prepare_seconds"), object),
    "runs": list,
}
ONCE_KINDS: dict[str, Kind] = {"occupied": int, "sizes": dict, "prepare_seconds": NUMBER}
RUN: dict[str, Kind] = {
    **dict.fromkeys(("name", "solver", "status"), str),
    "epsilon": (*NUMBER, type(None)),
    "finished": bool,
}
RUN_KINDS: dict[str, Kind] = dict.fromkeys(
    ("lower", "upper", "iterations", "seconds", *PARTS), NUMBER
)
FAILED: dict[str, Kind] = dict.fromkeys(RUN_KINDS, type(None))
"""What a record must hold, that of a scene that could be made, each run, one with a bracket."""


def machine() -> str:
    """On what the times were measured."""
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {KERNEL} kernels"
    )


class Log:
    """The file of a study, locked until it is closed; use it in a ``with``.

    Parameters
    ----------
    folder : str
        Where it is, or shall be.
    settings : dict
        What the records depend on.

    Attributes
    ----------
    known : dict
        Records by targets, steps and number of the run.

    Raises
    ------
    ConfigError
        The file is of another study, or no file of ours, or damaged, or in use by another process,
        or cannot be read or written.
    """

    def __init__(self, folder: str, settings: Mapping[str, object]) -> None:
        self.path = Path(folder) / LOG_NAME
        header = {
            "schema": LOG_SCHEMA,
            "version": __version__,
            "machine": machine(),
            "settings": settings,
        }
        self.header = json.loads(json.dumps(header))
        self.known: dict[Key, SceneRecord] = {}
        with named(str(self.path), ConfigError, "cannot be opened"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+b")
        try:
            with named(str(self.path), ConfigError, "cannot be opened"):
                if not is_regular(str(self.path)):
                    self._refuse()
                self._lock()
                whole = self._read()
                self._file.truncate(whole)
                if not whole:
                    self.keep(self.header)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Log":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let others use the file."""
        with suppress(OSError):  # what could not be written is known
            self._file.close()

    def keep(self, record: Mapping[str, object]) -> None:
        """Add a record; it is on the disk when this returns."""
        line = json.dumps(record, sort_keys=True, allow_nan=False) + "\n"
        with named(str(self.path), ConfigError, "cannot be written"):
            self._file.write(line.encode())
            self._file.flush()
            os.fsync(self._file.fileno())

    def _lock(self) -> None:
        """Two processes would do the same scenes, and write into each other's lines."""
        try:
            if sys.platform == "win32":
                import msvcrt

                self._file.seek(LOCKED_BYTE)  # a locked byte cannot be read
                msvcrt.locking(self._file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            raise ConfigError(
                f"{self.path}: another process is at this study; wait for it, or name another "
                "folder"
            ) from None

    def _read(self) -> int:
        """Take the records that are there; the number of bytes up to the last whole one."""
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        own = json.dumps(self.header, sort_keys=True).encode()
        if not whole and not own.startswith(content):  # not even the begin of our first line
            self._refuse()
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                document = json.loads(line)
            except (ValueError, RecursionError):
                document = None
            if number == 1:
                self._check(document)
            elif is_record(document, len(self.header["settings"]["solvers"])):
                key = document["targets"], document["steps"], document["run"]
                self.known[key] = document
            else:
                raise ConfigError(
                    f"{self.path}, line {number}: no record of this study; remove the line, or "
                    "name another folder"
                )
        return whole

    def _refuse(self) -> NoReturn:
        raise ConfigError(f"{self.path}: not the file of a study; name another folder")

    def _check(self, header: object) -> None:
        """The settings must be the same."""
        if not isinstance(header, dict) or header.get("schema") != LOG_SCHEMA:
            self._refuse()
        own, other = _flat(self.header), _flat(header)
        for name in [*own, *other]:
            if own.get(name) != other.get(name):
                raise ConfigError(
                    f"{self.path}: is of a study with another {name.removeprefix('settings.')} "
                    f"({other.get(name)}, now {own.get(name)}); name another folder"
                )


def is_record(document: object, solvers: int) -> TypeGuard[SceneRecord]:
    """Whether this has everything that a record of so many solvers needs."""
    return (
        isinstance(document, dict)
        and _has(document, RECORD)
        and len(document["runs"]) == solvers
        and all(_has(run, RUN) for run in document["runs"])
        and (
            (
                _has(document, ONCE_KINDS)
                and _has(document["sizes"], {"states": int})
                and all(_has(run, RUN_KINDS) or _has(run, FAILED) for run in document["runs"])
            )
            or (
                all(document[name] is None for name in ONCE_KINDS)
                and all(_has(run, FAILED) for run in document["runs"])
            )
        )
    )


def _has(document: object, fields: Mapping[str, Kind]) -> bool:
    return isinstance(document, dict) and all(
        name in document
        and isinstance(document[name], kind)
        and (not isinstance(document[name], NUMBER) or 0 <= document[name] <= LARGEST)
        for name, kind in fields.items()
    )


def _flat(document: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Values by dotted names."""
    found: dict[str, object] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found
