"""Which processes work on a store: one on all of it, or one on each shard."""

import errno
import importlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tgospa_eval.common import files
from tgospa_eval.errors import ConfigError

ALL_BYTES = 2**31 - 1
"""Bytes of a lock file that are locked on Windows for all shards; each shard has one byte."""

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
"""Errors of file systems that have none, such as Lustre without the option flock."""


@contextmanager
def locked(folder: Path, shard: tuple[int, int], said: Path | None = None) -> Iterator[None]:
    """Keep other processes from the same jobs; those of other shards may work meanwhile.

    The system gives the locks back when a process ends, however it does.

    Parameters
    ----------
    folder : Path
        Where the lock is.
    shard : pair of int
        Number of the shard, from 0, and how many there are.
    said : Path, optional
        What the user has named, where that is another.

    Raises
    ------
    ConfigError
        A process is at work on them, or the folder cannot be written.
    """
    with ExitStack() as stack:
        try:
            _take(stack, folder, shard)
        except (BlockingIOError, PermissionError):
            raise ConfigError(
                f"-o {said or folder}: another process is at work on it; wait, or name another"
            ) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            files.announce(
                f"-o {said or folder}: no locks there; let nothing else work on it meanwhile"
            )
        yield


def _take(stack: ExitStack, folder: Path, shard: tuple[int, int]) -> None:
    """Take the locks; those of POSIX may be shared, those of Windows are of ranges of bytes."""
    number, count = shard

    def opened(name: str) -> Any:
        with files.named(f"-o {folder}", ConfigError, "cannot be written"):
            return stack.enter_context((folder / name).open("a+"))  # NFS shares what can be read

    whole = opened(".lock")
    try:
        fcntl: Any = importlib.import_module("fcntl")
    except ModuleNotFoundError:  # on Windows
        windows: Any = importlib.import_module("msvcrt")
        whole.seek(0 if count == 1 else (count * (count - 1) // 2 + number) % ALL_BYTES)
        windows.locking(whole.fileno(), windows.LK_NBLCK, ALL_BYTES if count == 1 else 1)
        return
    own = opened(f".lock-{number}-of-{count}")
    fcntl.flock(whole, (fcntl.LOCK_SH if count > 1 else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
