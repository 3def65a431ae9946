"""What a run wrote into a folder, and what stands there while it writes.

Without ``--force`` nothing else is replaced or removed.
"""

import hashlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from tgospa_eval.common.documents import COUNT, TEXT, Closed, checked, one_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.writing import FRESH, writing

NAME = ".tgospa-eval.json"
SCHEMA = "tgospa-eval/folder/1"

MANIFEST = {
    "schema": one_of(SCHEMA),
    "kind": TEXT,
    "files": [Closed({"name": TEXT, "size": COUNT, "sha256": TEXT})],
}
"""Description of the fields."""

STORE, STORE_SCHEMA = "batch.json", "tgospa-eval/batch/2"
"""The file by which the store of a batch is known, and its schema."""

OF_DATA = ("simulate", "proof")
"""Kinds of folders whose files are truths and estimates."""


@dataclass(frozen=True)
class FileEntry:
    """A file as it was written.

    Parameters
    ----------
    name : str
        Its path in the folder, with slashes.
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
            and entry(folder, self.name).sha256 == self.sha256
        )


def entries(files: Mapping[str, bytes]) -> tuple[FileEntry, ...]:
    """Files by name, as entries."""
    return tuple(
        FileEntry(name, len(data), hashlib.sha256(data).hexdigest()) for name, data in files.items()
    )


def entry(folder: Path, name: str) -> FileEntry:
    """A file that is there, as an entry."""
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return FileEntry(name, (folder / name).stat().st_size, digest)


def text_of(kind: str, files: Iterable[FileEntry]) -> str:
    """The manifest of a folder of this kind; a name may have several entries while it changes."""
    listed = [vars(entry) for entry in files]
    document = {"schema": SCHEMA, "kind": kind, "files": listed}
    return json.dumps(document, indent=2, sort_keys=True) + "\n"


def read_manifest(folder: Path, kind: str) -> tuple[FileEntry, ...] | None:
    """The entries of a folder of this kind; None if it is none."""
    own, found = _read(folder)
    return found if own == kind else None


def _read(folder: Path) -> tuple[str | None, tuple[FileEntry, ...]]:
    """The kind of a folder, if it has a manifest, and its entries."""
    try:
        document = checked((folder / NAME).read_bytes(), MANIFEST)
    except (FileNotFoundError, IsADirectoryError, ValueError):
        return None, ()
    listed = tuple(FileEntry(**entry) for entry in document["files"])
    safe = all(_is_below(PurePosixPath(entry.name)) for entry in listed)
    return (document["kind"] if safe else None), listed


def results_in(folder: Path) -> Callable[[str], bool]:
    """Which files of a folder, by their paths in it, are results: those of a store all are."""
    with suppress(OSError, ValueError):
        checked((folder / STORE).read_bytes(), {"schema": one_of(STORE_SCHEMA)})
        return lambda _: True
    with suppress(OSError):  # of a folder that is not to be looked into
        kind, listed = _read(folder)
        return {entry.name for entry in listed if kind not in OF_DATA}.__contains__
    return lambda _: False


def unchanged(folder: Path, listed: Iterable[FileEntry]) -> set[str]:
    """The names that are there as they were written."""
    return {entry.name for entry in listed if entry.is_in(folder)}


def others(path: Path) -> Iterator[Path]:
    """What is in a folder but for what an interrupted run has left."""
    return (item for item in path.iterdir() if not item.name.startswith(FRESH))


def replace_files(
    fresh: Path, path: Path, files: Collection[FileEntry], kind: str, document: str
) -> int:
    """Files of a folder by fresh ones; while that is going on, the manifest lists both.

    Returns how many of an older run were taken away. The document goes first and comes last.
    """
    names = {entry.name for entry in files}
    for name in names:  # what cannot be shows before anything is taken away
        (path / name).parent.mkdir(parents=True, exist_ok=True)
    old = read_manifest(path, kind) or ()
    stale = unchanged(path, old) - names
    with writing(path / NAME) as both:
        both.write_text(text_of(kind, {*old, *files}), encoding="utf-8")
    (path / document).unlink(missing_ok=True)
    for name in stale:
        (path / name).unlink()
        for folder in PurePosixPath(name).parents[:-1]:
            with suppress(OSError):  # not empty
                (path / folder).rmdir()
    for name in sorted(names, key=lambda name: (name == document, name)):
        (path / name).parent.mkdir(parents=True, exist_ok=True)  # if it has become empty
        os.replace(fresh / name, path / name)
    os.replace(fresh / NAME, path / NAME)
    return len(stale)


def _is_below(path: PurePosixPath) -> bool:
    """Whether a path, taken from a folder, stays in it."""
    return not path.is_absolute() and path.name != "" and ".." not in path.parts
