"""Evaluations of which every result goes through a proof folder that a third party could check.

A test file that uses the fixture `proven` has all its values proven.
"""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.write import proof_texts


def proving(evaluate: Callable[..., Any]) -> Callable[..., Any]:
    """An evaluation whose result goes through a proof folder, as its files would be written."""

    def evaluated(*arguments: Any, **options: Any) -> Any:
        result = evaluate(*arguments, **options)
        texts = {name: text.encode() for name, text in proof_texts(result.proof).items()}
        assert verify_tgospa.verify(texts.__getitem__)
        return result

    return evaluated


@pytest.fixture(scope="module")
def proven(request: pytest.FixtureRequest) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if hasattr(request.module, "evaluate"):
            patch.setattr(request.module, "evaluate", proving(request.module.evaluate))
        yield
