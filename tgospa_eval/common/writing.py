"""Files and folders that have their names once they are whole, and locks on them."""

import errno
import importlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from tgospa_eval.common.files import named, patience, reason
from tgospa_eval.errors import ConfigError

FRESH = ".tgospa-eval-new-"
"""What names begin with that are there only while something is written; a process id follows."""

OLD = 3600.0
"""Seconds after which nobody writes any more."""


def unique() -> str:
    """A name that nobody else has, of what is there only while something is written."""
    return f"{FRESH}{os.getpid()}-{os.urandom(4).hex()}"


def is_left(path: Path) -> bool:
    """Whether nobody is at work any more on what has a name of `unique`."""
    number = path.name.removeprefix(FRESH).partition("-")[0]
    try:
        if time.time() - path.stat().st_mtime > OLD:
            return True
        os.kill(int(number), 0)
    except (ProcessLookupError, ValueError, OverflowError):
        return True
    except OSError:  # it is there, and somebody else's; or the path is gone
        return False
    return False


@contextmanager
def writing(output: str | Path, where: str = "", *, shared: bool = False) -> Iterator[Path]:
    """Where to write a file or a folder, which is renamed when it is whole.

    Parameters
    ----------
    output : str or Path
        Its name then; folders above it are made.
    where : str
        What the message about a full disk begins with; by default the folder.
    shared : bool
        Whether another process may have finished the same folder meanwhile.

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
        # NumPy has no number of the system for it, and counts what it could not write.
        is_of_numpy = error.errno is None and "requested" in str(error)
        if is_of_numpy or error.errno == errno.ENOSPC:
            why = "no space left on the disk" if is_of_numpy else reason(error)
            raise ConfigError(f"{where or target.parent}: cannot be written: {why}") from None
        raise
    finally:
        if beside.is_dir():
            import shutil  # lazy: it brings compression

            shutil.rmtree(beside, ignore_errors=True)
        else:
            beside.unlink(missing_ok=True)


@contextmanager
def writing_folder(output: str | Path) -> Iterator[Path]:
    """As `writing`, of a folder that several processes may write, which is made."""
    with writing(output, shared=True) as folder:
        folder.mkdir()
        yield folder


def write_file(path: str, data: str | bytes, option: str) -> None:
    """Write a file beside first, then rename it; `option` is for messages.

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
        target = Path(os.path.realpath(path))  # what a link points to is replaced, not the link
        if target.is_dir():
            raise ConfigError(f"{where}: is a folder; name a file")
        if target.exists() and not target.is_file():  # a device or a pipe: nothing to rename over
            with patience(path, "a reader of"):
                target.write_bytes(content)
            return
        # Not by tempfile, whose files nobody else may read: CI has many users.
        with writing(target, where) as beside:
            beside.write_bytes(content)
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)


# -------------------------------------------------------------------------------------------------
# Locks. The system gives them back when the process ends, however it does.


def take_lock(
    file: IO[Any] | int, *, shared: bool = False, wait: bool = False, at: int = 0, size: int = 1
) -> bool:
    """Lock an open file, of Windows so many bytes from there on; whether it is that of POSIX.

    Raises
    ------
    BlockingIOError, PermissionError
        Another process has it, and nobody waits.
    OSError
        The file system has none.
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
    """Wait while others write a folder; yields whether they do, as not all systems can."""
    is_locked, at = False, None
    try:
        with suppress(OSError):  # of Windows, and of some network file systems
            at = os.open(folder, os.O_RDONLY)
            is_locked = take_lock(at, wait=True)
        yield is_locked
    finally:
        if at is not None:
            os.close(at)
