"""A proven order in words: places, who is best, what verdicts mean."""

import itertools
from collections.abc import Mapping, Sequence

ORDERS = {"less": "proven", "equal": "equal", "not separated": "open"}
"""Verdicts as the tables have them."""

PROOFS = {
    "less": "proven: the upper bound of the one is below the lower bound of the other",
    "equal": "equal: the same data, or proven to differ by less than 1e-9 of the value",
    "not separated": "open: the bounds of both overlap",
}
"""What the verdicts mean."""


MOST_NAMED = 8
"""Names in a sentence; a table has all of them."""


def first_names(groups: Sequence[Sequence[str]]) -> str:
    """The first names with commas, those of a group with ``=``, and how many more there are."""
    left, texts = MOST_NAMED, list[str]()
    for group in groups:
        if left > 0:
            texts.append(" = ".join(group[:left]))
        left -= len(group)
    return ", ".join(texts) + (f" and {-left:,} more, all in the table" if left < 0 else "")


def order_in_words(
    value: str,
    names: Sequence[str],
    places: Sequence[tuple[int, int]],
    verdicts: Mapping[tuple[str, str], str],
) -> str:
    """A sentence.

    Parameters
    ----------
    value : str
        By which they are ordered.
    names : sequence of str
        In the order of the values.
    places : sequence of (int, int)
        The best and the worst that each can have.
    verdicts : mapping
        What is proven of each pair, of which the first comes first in `names`.
    """
    groups = [list(names[:1])]
    for pair in itertools.pairwise(names):
        if verdicts[pair] == "equal":
            groups[-1].append(pair[1])
        else:
            groups.append([pair[1]])
    proven = {
        **dict.fromkeys(itertools.combinations(names, 2), "less"),
        **{pair: "equal" for group in groups for pair in itertools.combinations(group, 2)},
    }
    if verdicts == proven and len(groups) == 1:
        return f"Proven to be equal by {value}: {first_names(groups)}"
    if verdicts == proven:
        return f"Proven order by {value}, best first: {first_names(groups)}"
    best = best_of(places)
    if best:
        return (
            f"Proven best by {value}: {first_names([[names[k] for k in best]])}; the order of "
            "the others is not proven throughout"
        )
    tied = [[name] for name, place in zip(names, places, strict=True) if place[0] == 1]
    return f"None is proven best by {value}: it may be any of {first_names(tied)}"


def best_of(places: Sequence[Sequence[int]]) -> list[int]:
    """Which are proven to be better than all others, or equal to such."""
    best = [k for k, place in enumerate(places) if tuple(place) == (1, 1)]
    return best if len(best) < len(places) else []


def place_in_words(best: int, worst: int, *, shared: bool = False) -> str:
    """The range of places that are possible, or the only one, with = if it is shared."""
    if best < worst:
        return f"{best}-{worst}"
    return f"{best}=" if shared else f"{best}"
