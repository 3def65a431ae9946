"""Writing of files and folders, under temporary names until they are complete; locks; manifests."""

import errno
import hashlib
import importlib
import json
import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import IO, Any

from tgospa_eval.common.documents import COUNT, TEXT, Closed, checked, one_of
from tgospa_eval.common.files import named, patience, reason
from tgospa_eval.errors import ConfigError

FRESH = ".tgospa-eval-new-"
"""Prefix of temporary names; the id of the writing process follows."""

OLD = 3600.0
"""Seconds without a change after which a file with a temporary name counts as abandoned."""


def unique() -> str:
    """Return a unique temporary name."""
    return f"{FRESH}{os.getpid()}-{os.urandom(4).hex()}"


def is_left(path: Path) -> bool:
    """Return whether a file with a name by `unique` is abandoned.

    A file is abandoned if the process that made it has ended, or if the file is old.
    """
    number = path.name.removeprefix(FRESH).partition("-")[0]
    try:
        if time.time() - path.stat().st_mtime > OLD:
            return True
        os.kill(int(number), 0)
    except (ProcessLookupError, ValueError, OverflowError):
        return True
    except OSError:  # another user's process, or the path is gone
        return False
    return False


@contextmanager
def writing(output: str | Path, where: str = "", *, shared: bool = False) -> Iterator[Path]:
    """Yield a temporary path. After the block has written a file or folder there, rename it.

    Parameters
    ----------
    output : str or Path
        Final path; folders above it are made.
    where : str
        Begin of the message about a full disk; by default the folder.
    shared : bool
        Whether other processes can write the same folder at the same time. The first complete
        folder stays.

    Raises
    ------
    ConfigError
        The disk is full.
    """
    target = Path(output)
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = target.with_name(unique())
    try:
        yield beside
        try:
            os.replace(beside, target)
        except OSError:
            if not (shared and target.is_dir()):
                raise
    except OSError as error:
        # NumPy's error about a full disk has no errno, only a text with byte counts.
        is_of_numpy = error.errno is None and "requested" in str(error)
        if is_of_numpy or error.errno == errno.ENOSPC:
            why = "no space left on the disk" if is_of_numpy else reason(error)
            raise ConfigError(f"{where or target.parent}: cannot be written: {why}") from None
        raise
    finally:
        if beside.is_dir():
            import shutil  # lazy: it imports compression

            shutil.rmtree(beside, ignore_errors=True)
        else:
            beside.unlink(missing_ok=True)


@contextmanager
def writing_folder(output: str | Path) -> Iterator[Path]:
    """Yield a new temporary folder, and rename it like `writing` with a true `shared`."""
    with writing(output, shared=True) as folder:
        folder.mkdir()
        yield folder


def write_file(path: str, data: str | bytes, option: str) -> None:
    """Write a file under a temporary name, then rename it; `option` begins messages.

    A device or a pipe is written directly.

    Raises
    ------
    ConfigError
        The path is empty, is a folder, or the system refuses to write it.
    """
    if not path:
        raise ConfigError(f"{option} is empty; name a file")
    content = data.encode() if isinstance(data, str) else data
    where = f"{option} {path}"
    with named(where, ConfigError, "cannot be written"):
        target = Path(os.path.realpath(path))  # if the path is a link, its target is replaced
        if target.is_dir():
            raise ConfigError(f"{where}: is a folder; name a file")
        if target.exists() and not target.is_file():  # renaming would remove a device or a pipe
            with patience(path, "a reader of"):
                target.write_bytes(content)
            return
        # The module tempfile is not used. Only one user can read its files, but in CI several users
        # must read them.
        with writing(target, where) as beside:
            beside.write_bytes(content)
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)


# -------------------------------------------------------------------------------------------------
# Locks. The system releases them when the process ends in any way.


def take_lock(
    file: IO[Any] | int, *, shared: bool = False, wait: bool = False, at: int = 0, size: int = 1
) -> bool:
    """Lock an open file. Return True if the whole file is locked.

    On Windows, `size` bytes from the position `at` are locked, and the result is False. `shared`
    and `wait` have no effect on Windows.

    Raises
    ------
    BlockingIOError, PermissionError
        Another process has the lock, and `wait` is false or has no effect.
    OSError
        The file system does not support locks.
    """
    try:
        fcntl: Any = importlib.import_module("fcntl")
    except ModuleNotFoundError:  # on Windows
        windows: Any = importlib.import_module("msvcrt")
        file.seek(at)  # type: ignore[union-attr]
        windows.locking(file.fileno(), windows.LK_NBLCK, size)  # type: ignore[union-attr]
        return False
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    fcntl.flock(file, kind if wait else kind | fcntl.LOCK_NB)
    return True


@contextmanager
def turn(folder: Path) -> Iterator[bool]:
    """Wait while other processes write a folder, then lock it for the block.

    The yielded value is True if the folder is locked. If the system cannot lock folders, the value
    is False, and the block begins without waiting.
    """
    is_locked, at = False, None
    try:
        with suppress(OSError):  # Windows and some network file systems refuse
            at = os.open(folder, os.O_RDONLY)
            is_locked = take_lock(at, wait=True)
        yield is_locked
    finally:
        if at is not None:
            os.close(at)


# -------------------------------------------------------------------------------------------------
# The manifest lists the files that a run wrote into a folder, or is writing.
#
# Files that are not listed are never replaced or removed without ``--force``.

NAME = ".tgospa-eval.json"
SCHEMA = "tgospa-eval/folder/1"

MANIFEST = {
    "schema": one_of(SCHEMA),
    "kind": TEXT,
    "files": [Closed({"name": TEXT, "size": COUNT, "sha256": TEXT})],
}
"""Description of the fields of a manifest, as in `documents`."""

STORE, STORE_SCHEMA = "batch.json", "tgospa-eval/batch/2"
"""Name and schema of the file by which the store of a batch is recognised."""

OF_DATA = ("simulate", "proof")
"""Kinds of folders that contain a truth and an estimate. Their files can be evaluated, and do not
count as results."""


FileEntry = tuple[str, int, str]
"""Entry of a file in the manifest: path in the folder (with slashes), size in bytes, SHA-256."""


def entry(folder: Path, name: str) -> FileEntry:
    """Return the entry for a file of a folder."""
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return name, (folder / name).stat().st_size, digest


def text_of(kind: str, files: Iterable[FileEntry]) -> str:
    """Return the text of a manifest.

    While `replace_files` runs, a path can have two entries: for the old and for the new file.
    """
    listed = [dict(zip(("name", "size", "sha256"), entry, strict=True)) for entry in files]
    document = {"schema": SCHEMA, "kind": kind, "files": listed}
    return json.dumps(document, indent=2, sort_keys=True) + "\n"


def read_manifest(folder: Path, kind: str) -> tuple[FileEntry, ...] | None:
    """Return the entries of the manifest of a folder; None if the folder is not of this kind."""
    own, entries = _read(folder)
    return entries if own == kind else None


def _read(folder: Path) -> tuple[str | None, tuple[FileEntry, ...]]:
    """Return kind and entries from the manifest of a folder.

    The kind is None if there is no valid manifest.
    """
    try:
        document = checked((folder / NAME).read_bytes(), MANIFEST)
    except (FileNotFoundError, IsADirectoryError, ValueError):
        return None, ()
    listed = tuple((one["name"], one["size"], one["sha256"]) for one in document["files"])
    safe = all(_is_below(PurePosixPath(name)) for name, *_ in listed)
    return (document["kind"] if safe else None), listed


def results_in(folder: Path) -> Callable[[str], bool]:
    """Return a function that tells whether a path in this folder is a result of this program.

    If the folder is the store of a batch, all files in it are results.
    """
    with suppress(OSError, ValueError):
        checked((folder / STORE).read_bytes(), {"schema": one_of(STORE_SCHEMA)})
        return lambda _: True
    with suppress(OSError):  # the folder may be unreadable
        kind, listed = _read(folder)
        return {name for name, *_ in listed if kind not in OF_DATA}.__contains__
    return lambda _: False


def unchanged(folder: Path, listed: Iterable[FileEntry]) -> set[str]:
    """Return the paths of the listed files that have not changed since they were written."""
    return {
        known[0]
        for known in listed
        if (folder / known[0]).is_file()
        and (folder / known[0]).stat().st_size == known[1]
        and entry(folder, known[0]) == known
    }


def visible(path: Path) -> Iterator[Path]:
    """Yield the content of a folder, without temporary files that an interrupted run left."""
    return (item for item in path.iterdir() if not item.name.startswith(FRESH))


def replace_files(
    fresh: Path, path: Path, files: Collection[FileEntry], kind: str, document: str
) -> int:
    """Move the files of the folder `fresh` into the folder `path`.

    1. The manifest is written with the old and the new files. The file `document` is removed.
    2. Files of the older run are removed if they are unchanged and have no new version.
    3. The new files are moved, the document last.

    The result is the number of files that step 2 removed.
    """
    names = {name for name, *_ in files}
    for name in names:  # first, so that an error comes before any file is removed
        (path / name).parent.mkdir(parents=True, exist_ok=True)
    old = read_manifest(path, kind) or ()
    stale = unchanged(path, old) - names
    with writing(path / NAME) as both:
        both.write_text(text_of(kind, {*old, *files}), encoding="utf-8")
    (path / document).unlink(missing_ok=True)
    for name in stale:
        (path / name).unlink()
        for folder in PurePosixPath(name).parents[:-1]:
            with suppress(OSError):  # the folder is not empty
                (path / folder).rmdir()
    for name in sorted(names, key=lambda name: (name == document, name)):
        # The folder of a new file may have been removed with the last old file.
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(fresh / name, path / name)
    os.replace(fresh / NAME, path / NAME)
    return len(stale)


def _is_below(path: PurePosixPath) -> bool:
    """Return whether a path that is relative to a folder stays inside it."""
    return not path.is_absolute() and path.name != "" and ".." not in path.parts
