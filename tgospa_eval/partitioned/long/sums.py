"""Sums that are kept exact when they are added up later."""

import math

import numpy as np

from tgospa_eval.problem.problem import Floats


def expansion(terms: list[float]) -> Floats:
    """Three numbers whose exact sum is at most that of the terms, and as near as doubles tell."""
    parts: list[float] = []
    for _ in range(2):
        parts.append(math.fsum((*terms, *(-part for part in parts))))
    rest = math.fsum((*terms, *(-part for part in parts)))
    return np.array([*parts, math.nextafter(rest, -math.inf)])
