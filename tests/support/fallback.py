"""The package as it is where there are no compiled kernels."""

import pytest

from tgospa_eval.problem import certificate, paths, states


def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make merging and the certificate use their NumPy twins."""
    for module in (states, paths, certificate):
        monkeypatch.setattr(module, "kernels", None)
