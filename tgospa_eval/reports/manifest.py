"""What a run wrote into a folder: without ``--force`` nothing else is replaced or removed."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

NAME = ".tgospa-eval.json"
SCHEMA = "tgospa-eval/folder/1"


@dataclass(frozen=True)
class Entry:
    """A file as it was written.

    Parameters
    ----------
    name : str
        Its name in the folder.
    size : int
        Its bytes.
    sha256 : str
        Their hash.
    """

    name: str
    size: int
    sha256: str

    def is_in(self, folder: Path) -> bool:
        """Whether the file is there, as it was written."""
        path = folder / self.name
        return (
            path.is_file()
            and path.stat().st_size == self.size
            and hashlib.sha256(path.read_bytes()).hexdigest() == self.sha256
        )


def entries(files: Mapping[str, bytes]) -> tuple[Entry, ...]:
    """Files by name, as entries."""
    return tuple(
        Entry(name, len(data), hashlib.sha256(data).hexdigest()) for name, data in files.items()
    )


def text_of(kind: str, files: Iterable[Entry]) -> str:
    """The manifest of a folder of this kind; a name may have several entries while it changes."""
    listed = [vars(entry) for entry in files]
    document = {"schema": SCHEMA, "kind": kind, "files": listed}
    return json.dumps(document, indent=2, sort_keys=True) + "\n"


def read_manifest(folder: Path, kind: str) -> tuple[Entry, ...] | None:
    """The entries of a folder of this kind; None if it is none."""
    try:
        document = json.loads((folder / NAME).read_bytes())
        if (document["schema"], document["kind"]) != (SCHEMA, kind):
            return None
        found = tuple(Entry(**entry) for entry in document["files"])
        safe = all(Path(entry.name).name == entry.name for entry in found)
    except (FileNotFoundError, IsADirectoryError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return found if safe else None


def unchanged(folder: Path, listed: Iterable[Entry]) -> set[str]:
    """The names that are there as they were written."""
    return {entry.name for entry in listed if entry.is_in(folder)}
