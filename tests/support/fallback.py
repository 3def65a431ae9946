"""The package as it is where there are no compiled kernels."""

import pytest

from tgospa_eval.problem import merging, slots, states


def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make merging use its NumPy twin."""
    for module in (slots, states, merging):
        monkeypatch.setattr(module, "kernels", None)
