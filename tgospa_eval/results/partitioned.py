"""The result of an evaluation of partitioned data: sums in memory, tables as files."""

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.records import Columns, Json, records
from tgospa_eval.results.slices import Slicing
from tgospa_eval.results.stored_tables import STORED_TABLES, StoredTables, name_of
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd

MOST_RECORDS = 100_000
"""Steps, or switches, of which the JSON document has a record each; of more it names the table."""

OF_TRACKS = ("plot_lanes", "plot_plane", "plot_windows")


@dataclass(frozen=True, kw_only=True, eq=False)
class Extent:
    """How much was evaluated.

    Parameters
    ----------
    sizes : mapping of str to int
        ``truth``, ``estimates``, ``steps``, ``candidate_pairs``, ``pair_steps``, ``components``.
    objects : pair of int
        States of the truth and of the estimate.
    """

    sizes: Mapping[str, int]
    objects: tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PartitionedResult(Summary):
    """One evaluation of data larger than memory; ids are in the tables, not in `labels`.

    Parameters
    ----------
    extent : Extent
        Sizes, numbers of states.
    tables : StoredTables
        Where the tables are.
    """

    extent: Extent
    tables: StoredTables

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of trajectories, steps, near pairs, their steps, and components."""
        return dict(self.extent.sizes)

    @property
    def objects(self) -> tuple[int, int]:
        """States of the truth and of the estimate."""
        return self.extent.objects

    def slices(self, *by: str) -> tuple[Slicing, ...]:  # noqa: D102  (as of Summary)
        if by:
            raise ConfigError(
                "slices: of an evaluation of partitioned data there are none, as its states are "
                "not in memory; evaluate a part of it that is, by time or region"
            )
        return self.sliced

    def assignments_table(self) -> Columns:
        """Pairs that both exist, are nearer than the cutoff, and are assigned."""
        return self.tables.columns("assignments")

    def switches_table(self) -> Columns:
        """Changes of each truth's assignment, from its largest loss to its largest gain."""
        return self.tables.columns("switches")

    def first_switches(self, most: int) -> tuple[Columns, int]:
        """The first rows of `switches_table`, so many at most, and how many it has."""
        return self.tables.columns("switches", most), self.tables.rows("switches")

    def per_truth_table(self) -> Columns:
        """Steps, costs and counts of each truth."""
        return self.tables.columns("per_truth")

    def per_estimate_table(self) -> Columns:
        """Steps, costs and counts of each estimate."""
        return self.tables.columns("per_estimate")

    def costliest_tracks(self, kind: str, count: int) -> list[Json]:
        """Rows of the costliest truths, of kind ``"missed"``, or estimates, of ``"false"``."""
        table = "per_truth" if kind == "missed" else "per_estimate"
        return self.tables.costliest(table, ("localisation", kind, "switch"), count)

    def _worst_tracks(self, kind: str, count: int) -> list[str]:
        return [row["id"] for row in self.costliest_tracks(kind, count)]

    def _records(self) -> Json:
        """The tables by their names in the result folder, and those records that are not many."""
        found: Json = {"tables": {name: name_of(name) for name in STORED_TABLES}}
        if len(self.labels.times) <= MOST_RECORDS:
            found["per_step"] = records(self.per_step_table())
        if self.tables.rows("switches") <= MOST_RECORDS:
            found["switches"] = records(self.switches_table())
        return found

    @cached_property
    def switches(self) -> "pd.DataFrame":
        """`switches_table` as a DataFrame."""
        return self.tables.frame("switches")

    @cached_property
    def assignments(self) -> "pd.DataFrame":
        """`assignments_table` as a DataFrame."""
        return self.tables.frame("assignments")

    @cached_property
    def per_truth(self) -> "pd.DataFrame":
        """`per_truth_table` as a DataFrame."""
        return self.tables.frame("per_truth")

    @cached_property
    def per_estimate(self) -> "pd.DataFrame":
        """`per_estimate_table` as a DataFrame."""
        return self.tables.frame("per_estimate")

    def _check_drawn(self, name: str) -> None:
        if name in OF_TRACKS:
            raise ConfigError(
                f"{name}: an evaluation of partitioned data has no such picture, as its states are "
                "not in memory; evaluate a part of it that is, by time or region"
            )
