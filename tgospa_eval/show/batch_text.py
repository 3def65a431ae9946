"""Tables of a batch as text, Markdown, LaTeX, CSV and JSON."""

import json
import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import counted, number
from tgospa_eval.results.consistency import NEES, STORED_NEES, NeesSums
from tgospa_eval.results.records import PARTS, Columns, Json, json_text, records
from tgospa_eval.results.slices import Slicing, slices_columns
from tgospa_eval.show.batch import (
    NARROW,
    BatchTables,
    Ranking,
    bracket,
    curves_json,
    interval,
    parameters_in_words,
    value_in_words,
)
from tgospa_eval.show.phrases import (
    MOST_NAMED,
    PART_HEADS,
    best_cells,
    best_of,
    equal_names,
    first_names,
    order_in_words,
    place_in_words,
)
from tgospa_eval.show.rendering import Document, Table, rendered
from tgospa_eval.show.side_tables import (
    about_slices,
    covariances_table,
    direction,
    group_tables,
    grouped_table,
    other_records,
)
from tgospa_eval.text import listed, option

if TYPE_CHECKING:
    import pandas as pd


def slice_tables(tables: BatchTables) -> Iterator[Table]:
    """Costs of the groups split by attributes, where that was asked for."""
    yield from group_tables(list(tables.heads.values()), list(_named_slices(tables)))


def _named_slices(tables: BatchTables) -> Iterator[tuple[tuple[str, ...], Sequence[Slicing]]]:
    """What groups with slices are called, and these."""
    for group, slicings in tables.slices.items():
        yield tables.named(tables.groups.iloc[group]), slicings


def slices_of_groups(tables: BatchTables) -> Columns:
    """The same as columns, with what tells groups apart in front; none if there are no slices."""
    found: Columns = {}
    for names, slicings in _named_slices(tables):
        part = slices_columns(slicings)
        heads = zip(tables.heads.values(), names, strict=True)
        rows = {head: [name] * len(part["by"]) for head, name in heads} | part
        for head, values in rows.items():
            found.setdefault(head, []).extend(values)
    return found


def about_slices_of(tables: BatchTables) -> Iterator[str]:
    """What slices are, where there are some."""
    yield from about_slices([one for slicings in tables.slices.values() for one in slicings])


# -------------------------------------------------------------------------------------------------
# Tables of a batch for programs: CSV and JSON.

STORED = "slices"
"""Column of rows with the slices of each job, as text."""

THRESHOLDS = ".at."
"""In names of columns with a list in each row: a number for each threshold of HOTA."""


def batch_columns(tables: BatchTables) -> Columns:
    """A row for each job."""
    return {
        str(name): [value if value == value else None for value in column.tolist()]
        for name, column in tables.rows.items()
        if THRESHOLDS not in str(name) and name not in (STORED, STORED_NEES)
    }


def batch_json(tables: BatchTables) -> str:
    """Groups, rankings, comparisons, slices, curves and jobs."""
    return json_text(
        {
            "schema": "tgospa-eval/batch/1",
            "by": list(tables.by),
            "groups": _records(tables.groups),
            "ranking": [
                {**row, **_of_jobs(ranking), "of_jobs": ranking.all_jobs}
                for ranking in tables.rankings
                for row in ranking.entries
            ],
            "comparisons": [
                {
                    **row,
                    **_of_jobs(ranking),
                    "pairs": ranking.pairs,
                    "permutations": ranking.permutations,
                    "seed": ranking.seed,
                }
                for ranking in tables.rankings
                for row in ranking.comparisons
            ],
            "notes": list(tables.notes),
            **({"curves": curves_json(tables.curves)} if tables.curves else {}),
            **({"slices": records(slices_of_groups(tables))} if tables.slices else {}),
            "jobs": _records(tables.rows),
        }
    )


def _of_jobs(ranking: Ranking) -> dict[str, object]:
    return {"parameters": dict(ranking.parameters), "jobs": ranking.jobs}


def _records(frame: "pd.DataFrame") -> list[dict[str, object]]:
    """The rows as plain values, None for what is not there."""
    return [
        {
            str(name): _plain(str(name), value)
            for name, value in row.items()
            if THRESHOLDS in str(name) or value == value
        }
        for row in frame.to_dict("records")
    ]


def _plain(name: str, value: Any) -> Any:
    if name in (STORED, STORED_NEES):
        return json.loads(value)
    return list(value) if THRESHOLDS in name else value


INTERVAL = "95 % interval"
"""Head of columns with confidence intervals of the value before them."""

LEAST_P = 1e-4
"""P values below are shown as such."""


def document(tables: BatchTables) -> Document:
    """The tables by groups and the rankings, with what they are."""
    rows, groups = tables.rows, tables.groups
    failed = int((rows["status"] == "failed").sum()) if len(rows) else 0
    return Document(
        title=f"{counted(len(rows), 'job')}, {failed} failed",
        lines=[
            *(line for ranking in tables.rankings for line in _orders(ranking)),
            *filter(_warns, tables.notes),
        ],
        tables=[
            *([_sums_table(tables), _parts_table(tables)] if len(groups) else []),
            *(table for ranking in tables.rankings for table in _ranking_tables(ranking)),
            *other_tables(tables),
            *slice_tables(tables),
        ],
        notes=list(_notes(tables)),
    )


def _warns(note: str) -> bool:
    """Whether a note stands beside the order."""
    return note.startswith("warning:")


def of_expected(jobs: int, expected: int) -> str:
    """How many jobs have a value, and of how many if one is missing."""
    return f"{jobs:,} of {expected:,}" if jobs < expected else f"{jobs:,}"


def _sums_table(tables: BatchTables) -> Table:
    groups, rows = tables.groups, tables.groups.to_dict("records")
    values = {"combined": "combined", "per_step": "per step", "rms": "RMS"}
    if "mean_of_roots" in groups:
        values["mean_of_roots"] = "mean of roots"
    heads = [*tables.heads.values(), "jobs"]
    columns = [
        *zip(*map(tables.named, rows), strict=True),
        [of_expected(int(row["jobs"]), int(row["expected"])) for row in rows],
    ]
    compared: dict[int, list[Interval]] = {}
    for name, title in values.items():
        compared[len(heads)] = [interval(row, name) for row in rows]
        columns.append([_between(value) for value in compared[len(heads)]])
        heads.append(title)
        if name == "combined" and groups["confidence_upper"].notna().any():
            ends = zip(groups["confidence_lower"], groups["confidence_upper"], strict=True)
            columns.append([_interval(*both) for both in ends])
            heads.append(INTERVAL)
    return Table(
        head=heads,
        rows=list(zip(*columns, strict=True)),
        labels=len(tables.heads),
        bold=best_cells(compared, _rivals(tables, rows)),
    )


def _rivals(tables: BatchTables, rows: Sequence[Mapping[Hashable, Any]]) -> list[list[int]]:
    """Rows that have the same jobs, and differ in nothing but in the label that is ranked."""
    ranked = [item.parameters for item in tables.rankings if item.jobs == item.all_jobs]
    found: dict[tuple[Any, ...], list[int]] = {}
    for k, row in enumerate(rows):
        if row["jobs"] and {name: row[name] for name in tables.parameters} in ranked:
            found.setdefault(tuple(row[name] for name in [*tables.heads][1:]), []).append(k)
    return [alike for alike in found.values() if len({rows[k]["jobs"] for k in alike}) == 1]


def _parts_table(tables: BatchTables) -> Table:
    heads, rows = tables.heads, tables.groups.to_dict("records")
    totals = [interval(row, "combined") for row in rows]  # in the same order
    numbers = [[_value(row[name], 5) for name in ("total", *PARTS)] for row in rows]
    return Table(
        head=(*heads.values(), "total", *PART_HEADS),
        rows=[(*tables.named(row), *own) for row, own in zip(rows, numbers, strict=True)],
        labels=len(heads),
        bold=best_cells({len(heads): totals}, _rivals(tables, rows)),
    )


def other_tables(tables: BatchTables) -> Iterator[Table]:
    """Other metrics of the groups, where they were asked for."""
    heads, rows = tables.heads, _with_values(tables)
    names = [tables.named(row) for row in rows]
    found = list(other_records(rows))
    yield from grouped_table(tuple(heads.values()), names, found, _rivals(tables, rows))
    nees = [NeesSums.of_row(row) for row in rows]
    items = [{**row, NEES: own and own.record()} for row, own in zip(rows, nees, strict=True)]
    yield from covariances_table(tuple(heads.values()), names, items)


def _with_values(tables: BatchTables) -> list[dict[Hashable, Any]]:
    """The groups of which a job has a value."""
    return [row for row in tables.groups.to_dict("records") if row["jobs"]]


def _orders(ranking: Ranking) -> Iterator[str]:
    """Both orders in a sentence each."""
    entries, where = ranking.entries, _where(ranking)
    jobs = f"{counted(ranking.jobs, 'job')} each"
    if ranking.jobs < ranking.all_jobs:
        all_have = f"over the {counted(ranking.jobs, 'job')} that all {len(entries)} have"
        jobs = f"{all_have}, of {ranking.all_jobs:,}"
    yield f"{where}{order_in_words('combined', entries, ranking.comparisons)} ({jobs})"
    begin = f"{where}Statistical order, {counted(ranking.pairs, 'pair')}"
    if not ranking.permutations:
        yield f"{begin}: fewer than 6, nothing can be concluded about {ranking.others}"
        return
    first = [item["name"] for item in entries if item["statistical_place"][0] == 1]
    if len(first) == 1 and entries[0]["statistical_place"] == (1, 1):
        yield f"{begin}: {first[0]} is significantly better than all others"
    else:
        top = first_names([[name] for name in first])
        yield f"{begin}: no significant difference at the top between {top}"


def _where(ranking: Ranking) -> str:
    """For which parameters a ranking is, if there are several."""
    return f"{parameters_in_words(ranking.parameters)}: " if ranking.parameters else ""


def _ranking_tables(ranking: Ranking) -> Iterator[Table]:
    """The proven order, and below it the statistical one."""
    of = [value_in_words(value) for value in ranking.parameters.values()]
    entries, equal = ranking.entries, equal_names(ranking.comparisons)
    per_step = [bracket(item, "per_step") for item in entries]
    yield Table(
        head=(ranking.label, *ranking.parameters, "proven place", "combined", "per step"),
        labels=1 + len(of),
        rows=[
            (
                item["name"],
                *of,
                place_in_words(*item["place"], shared=item["name"] in equal),
                _between(bracket(item, "combined")),
                _between(each),
            )
            for item, each in zip(entries, per_step, strict=True)
        ],
        bold=frozenset(
            (row, k)
            for row in best_of([item["place"] for item in entries])
            for k in range(3 + len(of))
        )
        | best_cells({3 + len(of): per_step}, [range(len(entries))]),
    )
    if ranking.permutations:
        places = {item["name"]: place_in_words(*item["statistical_place"]) for item in entries}
        best = entries[0]["name"]
        yield Table(
            head=(
                f"vs {best}",
                *ranking.parameters,
                *("difference", INTERVAL, "p (Holm)", "statistical place"),
            ),
            labels=1 + len(of),
            rows=[
                (best, *of, "", "", "", places[best]),
                *(
                    (pair["second"], *of, *_tested(pair), places[pair["second"]])
                    for pair in ranking.comparisons
                    if pair["first"] == best
                ),
            ],
        )


def _tested(pair: Json) -> tuple[str, str, str]:
    """The difference, its interval and its p value."""
    ends = dict.fromkeys(_value(end, 4, "+") for end in pair["difference"])
    difference = "+0" if pair["verdict"] == "equal" else " to ".join(ends)
    p_value = f"<{LEAST_P:g}" if pair["p_holm"] < LEAST_P else f"{pair['p_holm']:.2g}"
    return difference, _interval(pair["lower"], pair["upper"], "+"), p_value


def _notes(tables: BatchTables) -> Iterator[str]:
    if not len(tables.groups):
        return
    sums = (
        "combined: (sum of the totals)^(1/p); per step: (that sum / steps)^(1/p); RMS: (mean "
        "of the totals)^(1/p), as of Monte Carlo runs; "
    )
    if "mean_of_roots" in tables.groups:
        yield sums + "mean of roots: the plain mean of the values, which is none of these"
    else:
        yield sums + "no mean of roots is taken"
    steps = tables.rows["judged.steps"].dropna() if "judged.steps" in tables.rows else ()
    lengths = sorted(set(map(int, steps)))
    if len(lengths) > 1:
        yield (
            f"the jobs have {lengths[0]:,} to {counted(lengths[-1], 'step')}: long ones "
            "weigh more, and per step each step weighs the same"
        )
    for row in tables.groups[tables.groups["jobs"] < tables.groups["expected"]].to_dict("records"):
        yield (
            f"{of_expected(row['jobs'], row['expected'])} jobs: of the others there is no value; "
            "sums, and with them combined, are without their costs and look better than they are"
        )
        break
    opened = int(tables.groups["open"].sum())
    if opened:
        yield (
            f"{counted(opened, 'job')} did not reach the accuracy that was asked for: values are "
            "between the proven bounds"
        )
    yield from (note for note in tables.notes if not _warns(note))
    if tables.rankings:
        yield "proven place: by the brackets of combined, on these files"
    for others in dict.fromkeys(item.others for item in tables.rankings if item.permutations):
        yield (
            f"statistical place, for {others} drawn as these were: by a two-sided permutation "
            "test, p adjusted for all pairs (Holm), significant below 0.05"
        )
    if tables.groups["confidence_upper"].notna().any():
        yield f"{INTERVAL}: of the value before it, by Student's t and the jackknife"
    for ranking in tables.rankings:
        if ranking.left_out:
            names = listed(ranking.left_out, MOST_NAMED)
            yield f"{_where(ranking)}{names}: no job with a value, and no place"
    texts = tables.rows["parameters"].dropna().unique() if "parameters" in tables.rows else ()
    for name in sorted({str(json.loads(text).get("preprocess") or "") for text in texts} - {""}):
        done = "are not judged" if name.endswith(":ignore") else "were left out before all metrics"
        yield f"by {option('preprocess', name)} boxes {done}"
    yield from about_others(tables)
    yield from about_slices_of(tables)


def about_others(tables: BatchTables) -> Iterator[str]:
    """What other metrics are, where they were asked for."""
    found = next(other_records(_with_values(tables)), {})
    if found:
        yield "other metrics are joined as TrackEval joins sequences: counts over all jobs of a row"
        yield from direction(found)


def _value(value: float, digits: int, sign: str = "") -> str:
    if not math.isfinite(value):
        return "-"
    return f"{sign if value > 0 else ''}{number(value, digits)}"


def _between(bounds: Interval) -> str:
    """The upper end, or the bracket where that is wide."""
    if not math.isfinite(bounds.upper) or bounds.upper - bounds.lower <= NARROW * bounds.upper:
        return _value(bounds.upper, 6)
    return f"{number(bounds.lower)} to {number(bounds.upper)}"


def _interval(lower: float, upper: float, sign: str = "") -> str:
    """An interval of statistics, which has few digits."""
    if not math.isfinite(upper):
        return "-"
    return f"{_value(lower, 4, sign)} to {_value(upper, 4, sign)}"


def batch_report(tables: BatchTables, format: str) -> str:
    """What ``--format`` prints."""
    return rendered(format, tables, document, batch_json, batch_columns)
