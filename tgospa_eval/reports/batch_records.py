"""What the tables of a batch show: sums of groups, a proven order, and a statistical one beside it.

Proven is what holds for these files; statistical is what they say of others like them.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.reports.curves import RmsCurve
from tgospa_eval.results.records import Json
from tgospa_eval.results.slices import Slicing

if TYPE_CHECKING:
    import pandas as pd

Places = tuple[int, int]
"""The best and the worst, counted from 1."""


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """All values of a label in the order of `combined`.

    Parameters
    ----------
    label : str
        Its name.
    entries : list of dict
        Best first: ``name``, ``place`` (proven: best and worst), brackets of ``combined`` and
        ``per_step``; ``confidence``, the 95 % interval of combined, and ``statistical_place``,
        both None where there are too few pairs.
    comparisons : list of dict
        All pairs of them, the ``first`` has the smaller value: ``verdict`` (proven), bounds of the
        ``difference`` of combined; ``lower`` and ``upper`` end of its 95 % interval, ``p_value``,
        ``p_holm``, ``significant``, all None where there are too few pairs.
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
    entries: list[Json]
    comparisons: list[Json]
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
        pairs = [pair for pair in self.comparisons if pair["verdict"] == "equal"]
        return frozenset(pair[name] for pair in pairs for name in ("first", "second"))


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
    slices : mapping of int to list of Slicing
        Costs split by attributes, sums over the jobs of a group, by the number of its row.
    curves : tuple of RmsCurve
        Over the steps of runs, where those are stored.
    """

    rows: "pd.DataFrame"
    groups: "pd.DataFrame"
    by: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    rankings: tuple[Ranking, ...] = ()
    notes: tuple[str, ...] = ()
    slices: Mapping[int, Sequence[Slicing]] = field(default_factory=dict)
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
