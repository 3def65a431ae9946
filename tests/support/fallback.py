"""The package as it is where there are no compiled kernels."""

import pytest

from tgospa_eval.problem import certificate, merging, paths, slots, states, weights
from tgospa_eval.solvers import block_costs, capacities, far_cutoff


def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make merging, the certificate and what is known by block use their NumPy twins."""
    problem = slots, states, merging, paths, certificate, weights
    for module in (*problem, block_costs, capacities, far_cutoff):
        monkeypatch.setattr(module, "kernels", None)
