"""Which jobs belong together: those that differ in nothing but the labels that are compared."""

import json
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from tgospa_eval.campaign.row import LABEL, PARAMETER_COLUMNS
from tgospa_eval.common.interval import Interval, equal, overlap
from tgospa_eval.errors import SolverError
from tgospa_eval.results.saved import ACCURACY
from tgospa_eval.text import quoted

if TYPE_CHECKING:
    import pandas as pd

TRUTH_DIGEST, ESTIMATE_DIGEST = (f"input.{role}.sha256" for role in ("truth", "estimate"))
"""Columns with digests of the sides (`tracks.judged.digest`)."""


READ_AS_GIVEN = (
    *("time", "class", "region", "truth_class", "estimate_class", "time_tolerance"),
    *("where", "truth_where", "estimate_where", "day_begins"),
    *("time_offset", "time_scale", "unit_scale", "max_gap"),
    *("on_duplicate", "on_invalid", "fix_cov", "missing_cov", "inner_cov", "decimal", "steps"),
    "ignore_regions",
)
"""Parameters that say how a file is read, or come from what is in it: each job may have its own."""


def labels_of(rows: "pd.DataFrame") -> list[str]:
    """Names of the labels."""
    return [name.removeprefix(LABEL) for name in rows.columns if name.startswith(LABEL)]


def shown_labels(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """Names of labels as columns beside others: one that is called like these keeps ``label.``."""
    return [LABEL + name if name in taken or name.startswith(LABEL) else name for name in names]


def with_parameters(rows: "pd.DataFrame") -> tuple["pd.DataFrame", list[str]]:
    """The rows, and names of columns with parameters in which jobs that have a value differ.

    Jobs in which these differ are never added up, nor compared. A parameter that a job does not
    have is a dash, and so is any of a job without a value.
    """
    having = rows[rows["status"] != "failed"]
    differing = [name for name in PARAMETER_COLUMNS if having[name].nunique() > 1]
    if "parameters" not in having:
        return rows, differing
    found = {text: json.loads(text) for text in having["parameters"].dropna().unique()}
    names = {name for settings in found.values() for name in settings}
    for name in sorted(names - {*PARAMETER_COLUMNS, *ACCURACY, *READ_AS_GIVEN}):
        shown = {text: in_words(settings.get(name)) for text, settings in found.items()}
        if len(set(shown.values())) > 1:
            rows = rows.assign(**{name: rows["parameters"].map(shown).fillna("-")})
            differing.append(name)
    return rows, differing


def in_words(value: object) -> str:
    """A parameter, as a table shows it."""
    if isinstance(value, list):
        return ",".join(map(in_words, value))
    if isinstance(value, dict):
        return ",".join(f"{name}={in_words(item)}" for name, item in value.items())
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, str):
        return value
    return "-" if value is None else json.dumps(value)


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


def same_data(
    names: tuple[str, str],
    digests: tuple[Sequence[str], Sequence[str]],
    brackets: tuple[Sequence[Interval], Sequence[Interval]],
) -> bool:
    """Whether two results that are judged alike are of the same estimates, so that both are equal.

    Parameters
    ----------
    names : pair of str
        What they are called, for the message.
    digests : pair of sequence of str
        Of the estimate of each run; blank where there is none.
    brackets : pair of sequence of Interval
        Of the value of each run, in one unit.

    Raises
    ------
    SolverError
        The values of a run are proven to differ, and yet its data are the same.
    """
    alike = [bool(own) and own == other for own, other in zip(*digests, strict=True)]
    for same, own, other in zip(alike, *brackets, strict=True):
        if same and not (overlap(own, other) or equal(own, other)):
            shown = " and ".join(f"[{one.lower:.12g}, {one.upper:.12g}]" for one in (own, other))
            raise SolverError(
                f"{' and '.join(map(quoted, names))} have the same data, and their brackets "
                f"{shown} have no value in common: one of them is wrong; evaluate both again with "
                "this version"
            )
    return bool(alike) and all(alike)


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
