"""Workers that stay from one list of jobs to the next: to have them anew takes a second each."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Self

from tgospa_eval.engines.spread import DiedError, Engine, Future, Pool


class Standing:
    """An engine that opens one pool of another, and a new one where a worker of it has died.

    Used in a ``with`` statement, whose end ends the workers.
    """

    def __init__(self, engine: Engine, most: int) -> None:
        self.engine, self.most = engine, most
        self._stack = ExitStack()
        self._pool: _Watched | None = None

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
        """The pool that is there."""
        if self._pool is None:
            self._pool = _Watched(self._stack.enter_context(self.engine.open(self.most)))
        yield self._pool
        if self._pool.died:
            self._pool = None
            self._stack.close()


class _Watched:
    """A pool of which it is known whether a worker has died."""

    def __init__(self, pool: Pool) -> None:
        self.pool, self.died = pool, False

    def workers(self) -> int:
        return self.pool.workers()

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        with self._watching():
            return self.pool.submit(function, *arguments)

    def answer(self, future: Any) -> Any:
        with self._watching():
            return self.pool.answer(future)

    def look(self) -> None:
        self.pool.look()

    @contextmanager
    def _watching(self) -> Iterator[None]:
        try:
            yield
        except DiedError:
            self.died = True
            raise
