"""Which jobs belong together: those that differ in nothing but the labels that are compared."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

LABEL = "label."
"""What the names of columns with labels begin with."""

TRUTH_DIGEST, ESTIMATE_DIGEST = (f"input.{role}.sha256" for role in ("truth", "estimate"))
"""Columns with digests of ids, times and states."""


def labels_of(rows: "pd.DataFrame") -> list[str]:
    """Names of the labels."""
    return [name.removeprefix(LABEL) for name in rows.columns if name.startswith(LABEL)]


def truths(rows: "pd.DataFrame") -> "pd.Series[str]":
    """What truth each job has: the digest of its data, or its path where there is none."""
    import pandas as pd

    paths = rows["truth"]
    if TRUTH_DIGEST not in rows:
        return paths
    digests = rows[TRUTH_DIGEST]
    # A job that failed has no digest; others with the same file may.
    known = pd.Series(digests.to_numpy(), index=paths).dropna()
    known = known[~known.index.duplicated(keep="last")]
    return digests.fillna(paths.map(known)).fillna(paths)


def pair_numbers(
    rows: "pd.DataFrame",
    compared: Sequence[str],
    parameters: Sequence[str] = (),
    *,
    truth: bool = True,
) -> "pd.Series[int]":
    """A number for each job, the same for those that agree in truth, parameters and other labels.

    Parameters
    ----------
    rows : DataFrame
        Of a store.
    compared : sequence of str
        Labels in which they may differ.
    parameters : sequence of str
        Columns in which they may not.
    truth : bool
        Whether they need the same truth.
    """
    rest = [LABEL + name for name in labels_of(rows) if name not in compared]
    same = rows[[*rest, *parameters]].assign(_truth=truths(rows) if truth else "")
    numbers = same.groupby(list(same), dropna=False).ngroup()
    own = rows[[LABEL + name for name in compared]].assign(_pair=numbers)
    if own.duplicated().any():  # options of their own tell them apart
        same = same.assign(_options=rows["options"])
        numbers = same.groupby(list(same), dropna=False).ngroup()
    return numbers
