"""How many examples a property gets: few in every run, the same; new and more by `make fuzz`."""

from hypothesis import settings

THOROUGH = 20
"""Of the profile to which numbers of examples refer; that of every run has half as many."""


def examples(number: int) -> int:
    """In proportion to the profile, but not below 3, or below the number itself."""
    share = number * settings.default.max_examples // THOROUGH
    return max(share, min(number, 3))
