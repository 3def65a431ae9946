"""Costs of groups of jobs split by attributes: tables and columns."""

from collections.abc import Iterator

from tgospa_eval.reports.batch_records import BatchTables
from tgospa_eval.reports.slices import about_slices, group_tables
from tgospa_eval.reports.tables import Table
from tgospa_eval.results.records import Columns
from tgospa_eval.results.slices import slices_columns


def slice_tables(tables: BatchTables) -> Iterator[Table]:
    """Costs of the groups split by attributes, where that was asked for."""
    groups = [(_names_of(tables, one.group), one.slicings) for one in tables.slices]
    yield from group_tables(list(tables.heads.values()), groups)


def _names_of(tables: BatchTables, group: int) -> tuple[str, ...]:
    return tables.named(tables.groups.iloc[group])


def slices_of_groups(tables: BatchTables) -> Columns:
    """The same as columns, with what tells groups apart in front; none if there are no slices."""
    parts = [(_names_of(tables, one.group), slices_columns(one.slicings)) for one in tables.slices]
    if not parts:
        return {}
    heads: Columns = {
        name: [names[k] for names, part in parts for _ in part["by"]]
        for k, name in enumerate(tables.heads.values())
    }
    joined = {name: [v for _, part in parts for v in part[name]] for name in parts[0][1]}
    return {name: heads[name] for name in heads if name not in joined} | joined


def about_slices_of(tables: BatchTables) -> Iterator[str]:
    """What slices are, where there are some."""
    yield from about_slices([one for group in tables.slices for one in group.slicings])
