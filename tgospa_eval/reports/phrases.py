"""Words and numbers that all documents of `compare` share."""

from collections.abc import Iterable, Mapping, Sequence

from tgospa_eval.common.words import counted, sizes_in_words
from tgospa_eval.reports.records import Metric
from tgospa_eval.results.numbers import PROBABILITIES
from tgospa_eval.results.records import Columns

EXACT = 1e-9
"""Relative errors below count as none, and differ from machine to machine."""

TO_RANK = "to rank estimates: tgospa-eval compare TRUTH A B"
TO_STUDY = "to compare solvers on one: tgospa-eval compare TRUTH A"
"""What to type for what a page is not."""

SPLIT_NOTE = (
    "split, not proven: localisation, missed, false and switch are those of the assignment that "
    "was found; the brackets hold for TGOSPA and the total"
)


def or_dash(value: float | None, form: str) -> str:
    """A number, or a dash."""
    return "-" if value is None else f"{value:{form}}"


def error_of(value: float | None) -> str:
    """A relative error, in powers of ten."""
    if value is None:
        return "-"
    return f"<{EXACT:g}" if value < EXACT else f"{value:.1e}"


def columns(
    rows: Sequence[Mapping[str, object]], names: Iterable[str], before: str = ""
) -> Columns:
    """Entries of rows as columns, with something before their names."""
    return {f"{before}{name}": [row[name] for row in rows] for name in names}


def unit_of(parameters: Metric) -> str:
    """The unit behind a number, if there is one."""
    unit = parameters.get("unit")
    return f" {unit}" if unit else ""


def size_of(sizes: Mapping[str, int]) -> str:
    """How large a problem is."""
    return (
        f"{sizes_in_words(sizes)}; {counted(sizes['states'], 'reduced state')} in "
        f"{counted(sizes['components'], 'component')}"
    )


def parameters_of(parameters: Metric) -> str:
    """Parameters of the metric, and the distance."""
    unit = unit_of(parameters)
    rho = f", rho = {parameters['rho']:g}" if "rho" in parameters else ""
    weighted = ", weighted steps" if "step_weights" in parameters else ""
    weighted += f", {PROBABILITIES}" if "existence" in parameters else ""
    return (
        f"c = {parameters['cutoff']:g}{unit}, p = {parameters['order']:g}, "
        f"gamma = {parameters['switch_penalty']:g}{unit}{rho}{weighted}, {parameters['distance']}"
    )
