"""Evaluations of which every result goes through a proof folder that a third party could check.

A test file that uses the fixture `proven` has all its values proven.
"""

import tempfile
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import tgospa_eval


def proving(evaluate: Callable[..., Any]) -> Callable[..., Any]:
    """An evaluation whose result goes through a proof folder."""

    def evaluated(*arguments: Any, **options: Any) -> Any:
        result = evaluate(*arguments, **options)
        with tempfile.TemporaryDirectory() as folder:
            result.proof.save(folder)
            assert tgospa_eval.verify(folder)
        return result

    return evaluated


@pytest.fixture(scope="module")
def proven(request: pytest.FixtureRequest) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if hasattr(request.module, "evaluate"):
            patch.setattr(request.module, "evaluate", proving(request.module.evaluate))
        yield
