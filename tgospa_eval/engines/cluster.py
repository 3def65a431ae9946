"""Workers of a cluster: that of a Dask scheduler which is there already.

Whatever Dask raises and prints stays in this module.
"""

import logging
import math
import pickle
import socket
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from tgospa_eval._version import __version__
from tgospa_eval.common import files
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import install
from tgospa_eval.engines.engine import POLL, DiedError, Future
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import on_surface, option, surface

CONNECT = 10.0
"""Seconds in which a scheduler must answer."""


@dataclass(frozen=True)
class Cluster:
    """The workers of a scheduler.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``.
    """

    address: str

    @contextmanager
    def open(self, most: int) -> Iterator["Remote"]:  # noqa: ARG002  (it has the workers it has)
        """A connection; what is under way is cancelled when the work is broken off.

        Raises
        ------
        ConfigError
            The extra is missing, the scheduler does not answer or is lost.
        """
        try:
            from distributed import Client
            from distributed.versions import VersionMismatchWarning
        except ModuleNotFoundError:
            raise ConfigError(
                f"{option('scheduler')} needs the extra cluster: {install('cluster')}"
            ) from None
        self._reach()
        with _silent_logs():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", VersionMismatchWarning)
                client = Client(self.address, timeout=CONNECT, set_as_default=False)
            pool = Remote(self.address, client)
            try:
                yield pool
            finally:
                pool.close()

    def _reach(self) -> None:
        """Whether the scheduler answers.

        Raises
        ------
        ConfigError
            It does not.
        """
        import asyncio

        from distributed.comm import connect

        async def reach() -> None:
            comm = await connect(self.address, timeout=CONNECT)
            await comm.close()

        try:
            asyncio.run(reach())  # a client that finds none would complain long after
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"{option('scheduler', self.address)}: no Dask scheduler answers: "
                f"{files.reason(error)}"
            ) from None


@contextmanager
def _silent_logs() -> Iterator[None]:
    """What Dask logs of losses is said by us, in one line."""
    logs = [logging.getLogger(name) for name in logging.root.manager.loggerDict if _is_dask(name)]
    before = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, before, strict=True):
            log.setLevel(level)


def _is_dask(name: str) -> bool:
    return name.partition(".")[0] == "distributed"


class Remote:
    """A connection to the workers; Dask itself tries elsewhere what was with one that died."""

    def __init__(self, address: str, client: Any) -> None:
        self.address, self.client = address, client
        self._threads, self._counted = 0, -math.inf
        self._told = self.died = False

    def workers(self) -> int:
        """Threads of all workers, as of the last second."""
        if time.monotonic() - self._counted > POLL:
            with self._lost_told():
                self._threads = sum(self.client.nthreads().values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Have a function called; the scheduler sees bytes alone."""
        with self._lost_told():
            content = pickle.dumps((on_surface, (surface.get(), function, *arguments)))
            # Not pure: the same job twice is meant.
            future: Future = self.client.submit(call, content, __version__, pure=False)
            return future

    def answer(self, future: Any) -> Any:
        """What came out.

        Raises
        ------
        DiedError
            Every worker that tried died.
        ConfigError
            The scheduler is lost, or workers have another version or none.
        """
        from distributed import KilledWorker

        try:
            with self._lost_told():
                return future.result()
        except KilledWorker:
            self.died = True
            raise DiedError from None
        except ImportError as error:
            raise self._lacking(error) from None
        except RuntimeError as error:  # on the scheduler, which looks at what it passes on
            if isinstance(error.__cause__, ImportError):
                raise self._lacking(error.__cause__) from None
            raise

    def look(self) -> None:
        """Tell once if there are no workers."""
        if not self.workers() and not self._told:
            self._told = True
            files.announce(f"waiting for workers of {self.address}")

    def _lacking(self, error: ImportError) -> ConfigError:
        return ConfigError(
            f"{option('scheduler', self.address)}: {error}; install tgospa-eval {__version__} "
            "with what it needs where the scheduler and its workers run"
        )

    @contextmanager
    def _lost_told(self) -> Iterator[None]:
        """Raise losses of the connection as one error."""
        from concurrent.futures import CancelledError

        try:
            yield
        except (OSError, CancelledError):
            raise ConfigError(
                f"{option('scheduler', self.address)}: the connection was lost; what is stored "
                "stays, and the same command goes on from there"
            ) from None

    def close(self) -> None:
        """Leave; what is not begun is begun no more."""
        with suppress(OSError, RuntimeError):
            self.client.close()


def call(content: bytes, version: str) -> Any:
    """Call a function in a worker.

    Raises
    ------
    ConfigError
        The worker has another version.
    """
    if version != __version__:
        raise ConfigError(
            f"the worker on {socket.gethostname()} has tgospa-eval {__version__}, this is "
            f"{version}: install the same"
        )
    function, arguments = pickle.loads(content)
    return function(*arguments)
