"""Files and folders that get their names once they are complete, and locks on them."""

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
"""Prefix of temporary names during writing; a process id follows."""

OLD = 3600.0
"""Seconds after which a temporary name is abandoned."""


def unique() -> str:
    """Return a unique temporary name."""
    return f"{FRESH}{os.getpid()}-{os.urandom(4).hex()}"


def is_left(path: Path) -> bool:
    """Return whether the process that made a name by `unique` has ended."""
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
    """Yield a path to write a file or a folder to, which is renamed when it is complete.

    Parameters
    ----------
    output : str or Path
        Final name; folders above it are made.
    where : str
        Begin of the message about a full disk; by default the folder.
    shared : bool
        Whether another process may finish the same folder at the same time.

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
        # NumPy's error has no errno, only the count of bytes not written.
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
    """Make a folder like `writing`, where several processes may write."""
    with writing(output, shared=True) as folder:
        folder.mkdir()
        yield folder


def write_file(path: str, data: str | bytes, option: str) -> None:
    """Write a temporary file, then rename it; `option` is used in messages.

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
        target = Path(os.path.realpath(path))  # replaces the target of a link, not the link
        if target.is_dir():
            raise ConfigError(f"{where}: is a folder; name a file")
        if target.exists() and not target.is_file():  # a device or a pipe cannot be renamed over
            with patience(path, "a reader of"):
                target.write_bytes(content)
            return
        # tempfile makes files private, but CI has many users.
        with writing(target, where) as beside:
            beside.write_bytes(content)
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)


# -------------------------------------------------------------------------------------------------
# Locks. The system releases them when the process ends in any way.


def take_lock(
    file: IO[Any] | int, *, shared: bool = False, wait: bool = False, at: int = 0, size: int = 1
) -> bool:
    """Lock an open file, on Windows some bytes of it; return whether it is a POSIX lock.

    Raises
    ------
    BlockingIOError, PermissionError
        Another process has the lock, and `wait` is false.
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
    """Wait while other processes write a folder; yield whether the system can wait."""
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
# The manifest: what a run wrote into a folder, and what it is writing.
#
# Without ``--force`` nothing else is replaced or removed.

NAME = ".tgospa-eval.json"
SCHEMA = "tgospa-eval/folder/1"

MANIFEST = {
    "schema": one_of(SCHEMA),
    "kind": TEXT,
    "files": [Closed({"name": TEXT, "size": COUNT, "sha256": TEXT})],
}
"""Description of the fields of a manifest."""

STORE, STORE_SCHEMA = "batch.json", "tgospa-eval/batch/2"
"""File that identifies the store of a batch, and its schema."""

OF_DATA = ("simulate", "proof")
"""Kinds of folders whose files are truth and estimate."""


FileEntry = tuple[str, int, str]
"""Written file: path in the folder with slashes, number of bytes, and SHA-256."""


def entry(folder: Path, name: str) -> FileEntry:
    """Return the entry of a file in the manifest."""
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return name, (folder / name).stat().st_size, digest


def text_of(kind: str, files: Iterable[FileEntry]) -> str:
    """Return the manifest of a folder; a name is repeated while its file is replaced."""
    listed = [dict(zip(("name", "size", "sha256"), entry, strict=True)) for entry in files]
    document = {"schema": SCHEMA, "kind": kind, "files": listed}
    return json.dumps(document, indent=2, sort_keys=True) + "\n"


def read_manifest(folder: Path, kind: str) -> tuple[FileEntry, ...] | None:
    """Return the entries of a folder of this kind; None for any other folder."""
    own, entries = _read(folder)
    return entries if own == kind else None


def _read(folder: Path) -> tuple[str | None, tuple[FileEntry, ...]]:
    """Return the kind of a folder with a manifest, and its entries."""
    try:
        document = checked((folder / NAME).read_bytes(), MANIFEST)
    except (FileNotFoundError, IsADirectoryError, ValueError):
        return None, ()
    listed = tuple((one["name"], one["size"], one["sha256"]) for one in document["files"])
    safe = all(_is_below(PurePosixPath(name)) for name, *_ in listed)
    return (document["kind"] if safe else None), listed


def results_in(folder: Path) -> Callable[[str], bool]:
    """Return a function that tells whether a path in a folder is a result; in a store all are."""
    with suppress(OSError, ValueError):
        checked((folder / STORE).read_bytes(), {"schema": one_of(STORE_SCHEMA)})
        return lambda _: True
    with suppress(OSError):  # the folder may be unreadable
        kind, listed = _read(folder)
        return {name for name, *_ in listed if kind not in OF_DATA}.__contains__
    return lambda _: False


def unchanged(folder: Path, listed: Iterable[FileEntry]) -> set[str]:
    """Return the names of files that were not changed since they were written."""
    return {
        known[0]
        for known in listed
        if (folder / known[0]).is_file()
        and (folder / known[0]).stat().st_size == known[1]
        and entry(folder, known[0]) == known
    }


def visible(path: Path) -> Iterator[Path]:
    """Iterate over a folder without temporary files of an interrupted run."""
    return (item for item in path.iterdir() if not item.name.startswith(FRESH))


def replace_files(
    fresh: Path, path: Path, files: Collection[FileEntry], kind: str, document: str
) -> int:
    """Replace the files of a folder; during this time the manifest lists old and new files.

    Return the number of removed files of an older run. The document is removed first and written
    last.
    """
    names = {name for name, *_ in files}
    for name in names:  # errors appear before anything is removed
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
        (path / name).parent.mkdir(parents=True, exist_ok=True)  # the folder may be removed above
        os.replace(fresh / name, path / name)
    os.replace(fresh / NAME, path / NAME)
    return len(stale)


def _is_below(path: PurePosixPath) -> bool:
    """Return whether a path that is relative to a folder stays inside it."""
    return not path.is_absolute() and path.name != "" and ".." not in path.parts
