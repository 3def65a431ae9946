"""STATES -> base distance on the pairs of one step that are nearer than the cutoff.

A member is one file here, one line in `DISTANCES` and one line in docs/reference/cli.md.
"""

from tgospa_eval.distances.gating import Pairs, near_pairs
from tgospa_eval.distances.vector import Norm

DISTANCES = {
    "euclidean": Norm(name="euclidean", power=2.0),
    "manhattan": Norm(name="manhattan", power=1.0),
    "chebyshev": Norm(name="chebyshev", power=float("inf")),
}
"""Base distances by name."""

__all__ = ["DISTANCES", "Norm", "Pairs", "near_pairs"]
