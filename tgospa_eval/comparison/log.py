"""Records of a study on disk, one JSON document a line: a study that was killed goes on.

The first line holds the settings. A record is there as a whole or not at all: what was cut off at
the end is taken away.
"""

import json
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval import __version__
from tgospa_eval.compiled import KERNEL
from tgospa_eval.errors import ConfigError

Document = dict[str, Any]
Key = tuple[int, int, int]

SCHEMA = "tgospa-eval/study/1"
NAME = "runs.jsonl"


def machine() -> str:
    """On what the times were measured."""
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {KERNEL} kernels"
    )


class Log:
    """The file of a study.

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
        The file is of another study, or damaged, or cannot be read or written.
    """

    def __init__(self, folder: str, settings: Document) -> None:
        self.path = Path(folder) / NAME
        header = {
            "schema": SCHEMA,
            "version": __version__,
            "machine": machine(),
            "settings": settings,
        }
        self.header = json.loads(json.dumps(header))
        self.known: dict[Key, Document] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            whole = self._read()
            with self.path.open("ab") as file:
                file.truncate(whole)
        except OSError as error:
            raise ConfigError(f"{self.path}: {error.strerror or error}") from None
        if not whole:
            self._append(self.header)

    def keep(self, record: Document) -> None:
        """Add a record; it is on the disk when this returns."""
        self._append(record)

    def _append(self, document: Document) -> None:
        line = json.dumps(document, sort_keys=True, allow_nan=False) + "\n"
        try:
            with self.path.open("ab") as file:
                file.write(line.encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be written: {error.strerror}") from None

    def _read(self) -> int:
        """Take the records that are there; the number of bytes up to the last whole one."""
        content = self.path.read_bytes() if self.path.exists() else b""
        whole = content.rfind(b"\n") + 1
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                document = json.loads(line)
                if number > 1:
                    key = document["targets"], document["steps"], document["run"]
                    self.known[key] = document
            except (ValueError, KeyError, TypeError):
                raise ConfigError(
                    f"{self.path}, line {number}: no record of a study; remove the line, or name "
                    "another folder"
                ) from None
            if number == 1:
                self._check(document)
        return whole

    def _check(self, header: Any) -> None:
        """The settings must be the same."""
        if not isinstance(header, dict) or header.get("schema") != SCHEMA:
            raise ConfigError(f"{self.path}: not the file of a study; name another folder")
        own, other = _flat(self.header), _flat(header)
        for name in [*own, *other]:
            if own.get(name) != other.get(name):
                raise ConfigError(
                    f"{self.path}: is of a study with another {name.removeprefix('settings.')} "
                    f"({other.get(name)}, now {own.get(name)}); name another folder"
                )


def _flat(document: Document, prefix: str = "") -> Document:
    """Values by dotted names."""
    found: Document = {}
    for name, value in document.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found
