"""How many examples a test gets: few in every run, the same; the others in the long runs."""

from typing import Any

import pytest
from hypothesis import settings

THOROUGH = 20
"""Of the profile to which numbers of examples refer; that of every run has half as many."""


def examples(number: int) -> int:
    """Of a property, in proportion to the profile, but not below 3, or below the number itself."""
    share = number * settings.default.max_examples // THOROUGH
    return max(share, min(number, 3))


def seeds(few: int, every: int) -> list[Any]:
    """The first few in every run, the others with `-m slow`."""
    return [
        *range(few),
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(few, every)),
    ]
