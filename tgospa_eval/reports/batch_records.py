"""What the tables of a batch show: sums of groups, a proven order, and a statistical one beside it.

Proven is what holds for these files; statistical is what they say of others like them.
"""

from collections.abc import Hashable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.reports.curves import RmsCurve
from tgospa_eval.results.slices import Slicing

if TYPE_CHECKING:
    import pandas as pd

Verdict = Literal["less", "equal", "not separated"]
Places = tuple[int, int]
"""The best and the worst, counted from 1."""


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One of those that are compared, on the jobs that all of them have.

    Parameters
    ----------
    name : str
        A value of the label.
    place : tuple of int
        Proven: best and worst place in the order of `combined`.
    combined, per_step : Interval
        Brackets of (sum of totals)^(1/p), and of the same by the number of steps, in state units.
    confidence : Interval, optional
        95 % interval of `combined`; None where there are too few pairs.
    statistical_place : tuple of int, optional
        Best and worst place by the tests that are significant.
    """

    name: str
    place: Places
    combined: Interval
    per_step: Interval
    confidence: Interval | None = None
    statistical_place: Places | None = None


@dataclass(frozen=True, kw_only=True)
class Inference:
    """What is concluded of a difference for other truths like these.

    Parameters
    ----------
    confidence : Interval
        95 % interval of the difference, in state units.
    p_value : float
        Of the two-sided permutation test that both are equally good.
    p_holm : float
        The same, adjusted for all pairs of a ranking.
    significant : bool
        Whether that is below the level.
    """

    confidence: Interval
    p_value: float
    p_holm: float
    significant: bool


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two of those that are compared, on the jobs that all have.

    Parameters
    ----------
    first, second : str
        Names; the first has the smaller value.
    verdict : str
        What is proven: ``less`` is the first, ``equal``, or ``not separated``.
    difference : Interval
        Bracket of the second value less the first, in state units.
    inference : Inference, optional
        None where there are too few pairs.
    """

    first: str
    second: str
    verdict: Verdict
    difference: Interval
    inference: Inference | None = None


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """All values of a label in the order of `combined`.

    Parameters
    ----------
    label : str
        Its name.
    entries : tuple of Ranked
        Best first.
    comparisons : tuple of Comparison
        All pairs of them.
    jobs, all_jobs : int
        How many jobs of each are compared; how many there are of which one at least has a value.
    pairs : int
        What statistics are of: truths, or jobs if there is one truth alone.
    truths : int
        How many there are.
    permutations : int
        Of the test; 0 where there are too few pairs.
    seed : int
        Of those, if they are drawn.
    parameters : mapping of str to float or str
        Those that differ in the batch.
    left_out : tuple of str
        Names without any job that has a value.
    """

    label: str
    entries: tuple[Ranked, ...]
    comparisons: tuple[Comparison, ...]
    jobs: int
    all_jobs: int
    pairs: int
    truths: int
    permutations: int
    seed: int
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @property
    def others(self) -> str:
        """What a conclusion by statistics is about."""
        return "other runs on this truth" if self.truths == 1 else "other truths"

    @property
    def equal(self) -> frozenset[str]:
        """Names that share a place, for they are proven to be equal."""
        pairs = [pair for pair in self.comparisons if pair.verdict == "equal"]
        return frozenset(name for pair in pairs for name in (pair.first, pair.second))


@dataclass(frozen=True, kw_only=True, eq=False)
class GroupSlices:
    """Costs of a group of jobs split by attributes.

    Parameters
    ----------
    group : int
        Which row of the groups it is.
    slicings : tuple of Slicing
        Sums over its jobs, one for each attribute.
    """

    group: int
    slicings: tuple[Slicing, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchTables:
    """Everything that is tabulated of a batch.

    Parameters
    ----------
    rows : DataFrame
        A row for each job.
    groups : DataFrame
        A row for each group.
    by : tuple of str
        The labels that make a group; values of the first are compared.
    parameters : tuple of str
        Those in which jobs differ, and with them groups.
    rankings : tuple of Ranking
        One for each set of parameters.
    notes : tuple of str
        Why something is not ranked, and where settings come from.
    slices : tuple of GroupSlices
        Of groups, where costs are split.
    curves : tuple of RmsCurve
        Over the steps of runs, where those are stored.
    """

    rows: "pd.DataFrame"
    groups: "pd.DataFrame"
    by: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    rankings: tuple[Ranking, ...] = ()
    notes: tuple[str, ...] = ()
    slices: tuple[GroupSlices, ...] = ()
    curves: tuple[RmsCurve, ...] = ()

    @property
    def heads(self) -> dict[str, str]:
        """Columns of `groups` that tell them apart, with the names that these are shown by."""
        found = {
            f"label.{name}" if f"label.{name}" in self.groups else name: name for name in self.by
        }
        return found | {name: name for name in self.parameters}

    def named(self, row: "Mapping[Hashable, Any] | pd.Series[Any]") -> tuple[str, ...]:
        """What tells a row of the groups from others, in words."""
        return tuple(value_in_words(row[name]) for name in self.heads)


def value_in_words(value: object) -> str:
    """A label, or the value of a parameter."""
    return f"{value:g}" if isinstance(value, float) else str(value)
