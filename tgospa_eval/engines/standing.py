"""Workers that stay from one list of jobs to the next: to have them anew takes a second each."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future as Ended
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Self

from tgospa_eval.engines.spread import DiedError, Engine, Future, Pool


class Standing:
    """An engine that opens one pool of another, and a new one where a worker of it has died.

    Used in a ``with`` statement, whose end ends the workers.

    Parameters
    ----------
    engine : Engine
        Opens the pools.
    most : int
        Workers that are wanted.
    patience : float
        Seconds of work that are done in this process before there are any: what ends sooner ends
        before workers would have begun.
    """

    def __init__(self, engine: Engine, most: int, patience: float = 0.0) -> None:
        self.engine, self.most, self.patience = engine, most, patience
        self._stack = ExitStack()
        self._pool: Pool | None = None
        self._died = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    @contextmanager
    def open(self, most: int) -> Iterator[Pool]:  # noqa: ARG002  (it has the workers it has)
        """The pool that is there, or this process and that pool later."""
        yield self
        if self._died:
            self._pool, self._died = None, False
            self._stack.close()

    def workers(self) -> int:
        """How many there are."""
        return 1 if self.patience > 0 else self._opened().workers()

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Have a function called, as long as there is patience here and now."""
        if self.patience > 0:
            return self._done_here(function, *arguments)
        with self._watching():
            return self._opened().submit(function, *arguments)

    def answer(self, future: Any) -> Any:
        """What came out."""
        if isinstance(future, _Here):
            return future.result()
        with self._watching():
            return self._opened().answer(future)

    def look(self) -> None:
        """See whether workers are there."""
        self._opened().look()

    def _opened(self) -> Pool:
        if self._pool is None:
            self._pool = self._stack.enter_context(self.engine.open(self.most))
        return self._pool

    def _done_here(self, function: Callable[..., object], *arguments: object) -> Future:
        begin, future = time.monotonic(), _Here()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        self.patience -= time.monotonic() - begin
        return future

    @contextmanager
    def _watching(self) -> Iterator[None]:
        try:
            yield
        except DiedError:
            self._died = True
            raise


class _Here(Ended[object]):
    """Of what was done in this process."""
