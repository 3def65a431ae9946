"""Summary of an evaluation: common numbers about tracking."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted, number
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.records import Columns, Json

Quantity: TypeAlias = Callable[[float], str]
"""Function that formats a number with its unit."""

SUMMARY = "summary"
"""Name of the summary in the JSON. Tables and rules have names such as ``summary.rmse``."""

NUMBERS = (
    *("assigned_states", "truth_states", "estimate_states", "detection_rate", "precision"),
    *("rmse", "mean_error", "median_error", "p95_error", "rmse_along_track", "rmse_across_track"),
    *("latency.shift", "latency.gain", "mostly_tracked", "partly_tracked", "mostly_lost"),
    *("purity", "completeness", "fragments", "longest_stretch", "switches_per_truth"),
    *("never_tracked", "time_to_first", "breaks", "mean_time_between_breaks"),
    *("false_tracks", "false_tracks_per_step", "false_track_length"),
    *("cardinality_error", "cardinality_mean_absolute", "cardinality_rms"),
    *("smoothness.estimate", "smoothness.truth"),
    *("siap.completeness", "siap.ambiguity", "siap.spuriousness", "siap.positional_accuracy"),
    *("siap.velocity_accuracy", "siap.track_number_change_rate", "siap.longest_track_segment"),
)
"""Names of all numbers, except the RMSE of each state column, ``rmse_by_axis.NAME``."""

SHARES = ("detection_rate", "precision", "purity", "completeness", "latency.gain")
"""Names of the numbers that are shares, for which the largest value is best."""

LOWER = (
    *("rmse", "mean_error", "median_error", "p95_error", "rmse_along_track", "rmse_across_track"),
    *("mostly_lost", "fragments", "switches_per_truth", "never_tracked", "time_to_first", "breaks"),
    *("false_tracks", "false_tracks_per_step", "cardinality_mean_absolute", "cardinality_rms"),
)
"""Names of the numbers for which the smallest value is best."""

POOLED = {
    "detection_rate": "truth_states",
    "precision": "estimate_states",
    **dict.fromkeys(("rmse", "mean_error"), "assigned_states"),
}
"""Numbers that are means over states, each with the name of the count of these states."""


def pooled(columns: Mapping[str, Floats]) -> dict[str, float]:
    """Return the numbers of n evaluations together.

    The numbers of `POOLED` are computed over the states of all evaluations. Any other number is the
    mean over the evaluations in which it is defined.

    Parameters
    ----------
    columns : mapping of str to array, shape (n,)
        Values of each number by its name, such as ``summary.rmse``; NaN where it is undefined.
    """
    pools: dict[str, float] = {}
    for name, values in columns.items():
        known = values == values
        weights = np.ones(len(values))
        by = columns.get(f"{SUMMARY}.{POOLED.get(name.removeprefix(f'{SUMMARY}.'))}")
        if by is not None:
            weights = np.where(by == by, by, 0.0)
        if weights[known].sum() > 0:
            power = 2.0 if name == f"{SUMMARY}.rmse" else 1.0
            mean = np.average(values[known] ** power, weights=weights[known])
            pools[name] = float(mean ** (1 / power))
    return pools


def names_summary(path: str) -> bool:
    """Return whether a name such as ``summary.rmse`` is that of a number of the summary."""
    head, _, name = path.partition(".")
    return head == SUMMARY and (name in NUMBERS or name.startswith("rmse_by_axis."))


@dataclass(frozen=True, kw_only=True)
class TrackedShares:
    """Limits between "mostly lost", "partly tracked" and "mostly tracked" objects.

    The followed share of an object is the share of its steps at which it is followed.

    Parameters
    ----------
    lost : float
        An object is mostly lost if its followed share is smaller.
    tracked : float
        An object is mostly tracked if its followed share is at least this.

    Raises
    ------
    ConfigError
        The limits are not 0 <= lost <= tracked <= 1.
    """

    lost: float = 0.2
    tracked: float = 0.8

    def counts(self, followed: Floats) -> Json:
        """Count mostly tracked, partly tracked and mostly lost objects.

        `followed` (k,) has the followed share of each object. Objects with NaN are not counted.
        """
        known = followed[followed == followed]
        tracked, kept = (int((known >= share).sum()) for share in (self.tracked, self.lost))
        return {
            "mostly_tracked": tracked,
            "partly_tracked": kept - tracked,
            "mostly_lost": len(known) - kept,
            "tracked_shares": [self.lost, self.tracked],
        }

    def __post_init__(self) -> None:
        if not 0 <= self.lost <= self.tracked <= 1:
            raise ConfigError(
                f"is {self.lost:g}:{self.tracked:g}: must be two shares from 0 to 1, the lower one "
                "first, such as 0.2:0.8"
            )

    @classmethod
    def parse(cls, text: str) -> "TrackedShares":
        """Parse the two limits in a text such as ``"0.2:0.8"``."""
        try:
            lost, tracked = map(float, text.split(":"))
        except ValueError:
            raise ConfigError(f"is {text}: must be two shares, such as 0.2:0.8") from None
        return cls(lost=lost, tracked=tracked)


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """Summary of one evaluation, or of several on the same steps.

    Parameters
    ----------
    numbers : dict
        Numbers by name as in the JSON document; None for an undefined number.
    per_truth, per_estimate : dict of str to (k,) array
        Columns with a number for each object or for each track; NaN where it is undefined.
    """

    numbers: Json
    per_truth: Mapping[str, Floats | Ints]
    per_estimate: Mapping[str, Floats | Ints]

    def columns(self, table: str) -> Columns:
        """Return the columns of ``per_truth`` or ``per_estimate``; undefined numbers are None."""
        columns: Mapping[str, Floats | Ints] = getattr(self, table)
        return {
            name: [value if math.isfinite(value) else None for value in values.tolist()]
            for name, values in columns.items()
        }


def flat(numbers: Mapping[str, Any], before: str = SUMMARY) -> Iterator[tuple[str, float]]:
    """Yield the defined numbers of a summary with their names, such as ``summary.rmse``."""
    for name, value in numbers.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}.{name}")
        elif value is not None and not isinstance(value, bool | list):
            yield f"{before}.{name}", float(value)


def headline(numbers: Mapping[str, Any], switches: float, false: float, quantity: Quantity) -> str:
    """Return the most important numbers in one line; `quantity` formats an error."""
    states, rate = numbers["truth_states"], numbers["detection_rate"]
    parts = [f"{percent(rate)} of {counted(states, 'object-step')} followed"] if states else []
    if numbers["rmse"] is not None:
        parts.append(f"RMS error {quantity(numbers['rmse'])}")
    for count, noun, ending in ((switches, "switch", "es"), (false, "false estimate-step", "s")):
        parts.append(f"{number(count)} {noun}{ending * (count != 1)}")
    return ", ".join(parts)


def percent(share: float | None) -> str:
    """Format a share in percent; only 1 becomes 100 %, and only 0 becomes 0 %."""
    if share is None:
        return "-"
    share = round(share, 12)  # removes rounding errors of sums of weights
    for digits in range(1, 13):
        text = f"{100 * share:.{digits}f}"
        if 0 < float(text) < 100 or share in (0, 1):
            break
    return f"{text.removesuffix('.0')} %"


def rows(
    numbers: Mapping[str, Any], quantity: Quantity, place: Quantity, time: Quantity
) -> Iterator[tuple[str, str]]:
    """Return the lines of the summary as pairs: a name, and numbers in words.

    Lines without numbers are left out. `quantity` formats errors by the base distance, `place`
    errors of positions, and `time` durations.
    """

    def words(*parts: tuple[str, float | None, Callable[[float], str]]) -> str:
        known = ((text, write(value)) for text, value, write in parts if value is not None)
        return ", ".join(text.format(value) for text, value in known)

    def plain(value: float) -> str:
        return number(value, 4)

    def steps(value: float) -> str:
        return f"{plain(value)} step{'s' * (value != 1)}"

    def late(shift: float) -> str:
        return f"{'late' if shift >= 0 else 'early'} by {time(abs(shift))}"

    n = dict.fromkeys(NUMBERS) | {name.partition(".")[2]: value for name, value in flat(numbers)}
    lost, tracked = numbers["tracked_shares"]
    truths, estimates = numbers["truth_states"], numbers["estimate_states"]
    lines = {
        "followed": words(
            (
                f"{{}} of {counted(truths, 'object-step')}",
                n["detection_rate"],
                percent,
            ),
            (f"precision {{}} of {counted(estimates, 'estimate-step')}", n["precision"], percent),
        ),
        "error": words(
            ("RMS {}", n["rmse"], quantity),
            ("mean {}", n["mean_error"], quantity),
            ("median {}", n["median_error"], quantity),
            ("95 % up to {}", n["p95_error"], quantity),
        ),
        "along track": words(
            ("RMS {}", n["rmse_along_track"], place),
            ("across track {}", n["rmse_across_track"], place),
            ("{}", n["latency.shift"], late),
            ("which explains {} of the squared error", n["latency.gain"], percent),
        ),
        "objects": words(
            (f"{{}} mostly tracked (at least {100 * tracked:g} %)", n["mostly_tracked"], plain),
            ("{} partly tracked", n["partly_tracked"], plain),
            (f"{{}} mostly lost (below {100 * lost:g} %)", n["mostly_lost"], plain),
        )
        if numbers["truth_states"]
        else "",
        "identity": words(
            ("purity {}", n["purity"], percent),
            ("completeness {}", n["completeness"], percent),
            ("{} fragment" + "s" * (n["fragments"] != 1), n["fragments"], plain),
            ("{} switches per object", n["switches_per_truth"], plain),
        ),
        "continuity": words(
            ("longest run {}", n["longest_stretch"], steps),
            ("first followed after {}", n["time_to_first"], time),
            ("mean time between breaks {}", n["mean_time_between_breaks"], time),
        )
        if n["longest_stretch"]
        else "",
        "false tracks": words(
            ("{}", n["false_tracks"], plain),
            ("with {} states per step", n["false_tracks_per_step"], plain),
            ("mean length {}", n["false_track_length"], steps),
        ),
        "cardinality": words(
            ("error {} on average", n["cardinality_error"], plain),
            ("RMS {}", n["cardinality_rms"], plain),
        ),
        "smoothness": words(
            ("RMS second difference {}", n["smoothness.estimate"], place),
            ("of the truth {}", n["smoothness.truth"], place),
        ),
        "SIAP": words(
            ("C {}", n["siap.completeness"], plain),
            ("A {}", n["siap.ambiguity"], plain),
            ("S {}", n["siap.spuriousness"], plain),
            ("PA {}", n["siap.positional_accuracy"], plain),
            ("VA {}", n["siap.velocity_accuracy"], plain),
            ("R {}", n["siap.track_number_change_rate"], plain),
            ("LS {}", n["siap.longest_track_segment"], plain),
        ),
    }
    return ((name, text) for name, text in lines.items() if text)


def finite(numbers: Mapping[str, Any]) -> Json:
    """Replace numbers that are not finite by None, in nested dicts, too."""
    return {
        name: finite(value)
        if isinstance(value, Mapping)
        else None
        if isinstance(value, float) and not math.isfinite(value)
        else value
        for name, value in numbers.items()
    }


def ratio(value: float, by: float) -> float | None:
    """Return the ratio, or None if the divisor is 0."""
    return value / by if by else None


def mean(values: Floats) -> float | None:
    """Return the mean of the values that are not NaN, or None if all are NaN."""
    known = values[values == values]
    return float(known.mean()) if len(known) else None


def root(value: float | None) -> float | None:
    """Return the square root, or None for None."""
    return None if value is None else math.sqrt(value)
