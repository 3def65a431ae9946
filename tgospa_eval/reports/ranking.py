"""A ranking of estimates, or one beside per-step GOSPA, as a document and as tables."""

from collections.abc import Iterator
from dataclasses import replace

from tgospa_eval.common.figures import number
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.reports.order import (
    ORDERS,
    PROOFS,
    best_cells,
    best_of,
    order_in_words,
    place_in_words,
)
from tgospa_eval.reports.other_metrics import compared_table, direction, other_columns
from tgospa_eval.reports.phrases import (
    SPLIT_NOTE,
    TO_RANK,
    TO_STUDY,
    columns,
    parameters_of,
    unit_of,
)
from tgospa_eval.reports.records import RULES, EstimateRecord, PairRecord, RankingRecord
from tgospa_eval.reports.tables import Document, Table
from tgospa_eval.results.records import PARTS, Columns

TIES = (
    "where assignments of a step cost the same, SciPy's is taken, with the objects in the order of "
    "their ids; other tie rules may count other switches"
)


def estimates_document(document: RankingRecord) -> Document:
    """Several estimates of one truth, or one with per-step GOSPA beside it."""
    return Document(
        kind=_what(document),
        title=_order(document),
        lines=[_runs(document), parameters_of(document["parameters"])],
        tables=[
            _normalised_table(document, places=True),
            *_pair_tables(document),
            _costs_table(document["estimates"]),
            *_against_tables(document),
            *_other_tables(document),
        ],
        notes=list(_ranking_notes(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def estimates_paper(document: RankingRecord) -> Document:
    """What goes into a paper: roots per step, RMS over runs."""
    page = estimates_document(document)
    return replace(page, tables=[_normalised_table(document), *_other_tables(document)], notes=())


def estimates_columns(document: RankingRecord) -> Columns:
    """A row for each estimate, plain numbers."""
    items = document["estimates"]
    table = columns(items, ["name"])
    for k, end in enumerate(("best", "worst")):
        table[f"place_{end}"] = [item["place"][k] for item in items]
    per_step = [item["normalised"] for item in items]
    table |= columns(per_step, per_step[0], "normalised_")
    table |= columns(items, ("tgospa", "lower_bound", "total", "total_lower", *PARTS))
    table |= columns([item["counts"] for item in items], items[0]["counts"], "count_")
    steps = [item["per_step_gospa"] for item in items if item["per_step_gospa"] is not None]
    if steps:
        table["gospa_total"] = [step["total"] for step in steps]
        for rule in RULES:
            names = ("switches", "halves", "total", "mean")
            table |= columns([step[rule] for step in steps], names, f"{rule}_")
    return table | other_columns([item.get("with", {}) for item in items])


def pairs_columns(document: RankingRecord) -> Columns:
    """A row for each pair of estimates: the second less the first, costs per step."""
    pairs = document["pairs"]
    table = columns(pairs, ("first", "second", "verdict", "opposed"))
    for k, end in enumerate(("lower", "upper")):
        table[f"per_step_total_{end}"] = [pair["per_step"]["total"][k] for pair in pairs]
    table |= columns([pair["per_step"] for pair in pairs], PARTS, "per_step_")
    table |= columns([pair["steps"] for pair in pairs], ("better", "worse"), "steps_")
    names = ("mean", "standard_error", "first_less", "second_less")
    return table | columns([pair["per_run"] for pair in pairs], names, "per_run_")


def _order(document: RankingRecord) -> str:
    estimates, unit = document["estimates"], unit_of(document["parameters"])
    if len(estimates) == 1:
        item = estimates[0]
        value = _between(item["lower_bound"], item["tgospa"])
        mean = "" if document["runs"] == 1 else f", of the mean total of {document['runs']} runs"
        return f"{item['name']}: TGOSPA = {value}{unit}{mean}"
    return order_in_words(
        "TGOSPA per step",
        [item["name"] for item in estimates],
        [(item["place"][0], item["place"][1]) for item in estimates],
        {(pair["first"], pair["second"]): pair["verdict"] for pair in document["pairs"]},
    )


def _what(document: RankingRecord) -> str:
    """What this is, and what to type for what it is not."""
    count = len(document["estimates"])
    if count > 1:
        return f"Ranking of {count} estimates; {TO_STUDY}"
    if document["estimates"][0]["per_step_gospa"] is not None:
        return f"TGOSPA beside per-step GOSPA for one estimate; {TO_RANK}"
    if document["runs"] == 1:
        return f"TGOSPA beside other metrics for one estimate; {TO_RANK}"
    return f"Mean over the runs of one estimate; {TO_RANK}"


def _runs(document: RankingRecord) -> str:
    steps = sorted(set(document["steps"]))
    length = (
        counted(steps[0], "step")
        if len(steps) == 1
        else f"{steps[0]:,} to {counted(steps[-1], 'step')}"
    )
    if document["runs"] == 1:
        return f"truth {document['truth'][0]}; {length}"
    paths = document["truth"]
    shown = paths[0] if len(set(paths)) == 1 else f"{paths[0]} to {paths[-1]}"
    return (
        f"{document['runs']} runs, truth {shown}; {length} each; costs "
        "are means over runs, roots are taken last"
    )


def _normalised_table(document: RankingRecord, *, places: bool = False) -> Table:
    """What is ranked, and its parts; with places where there are several."""
    runs, order = document["runs"], document["parameters"]["order"]
    places = places and len(document["estimates"]) > 1
    mean = "" if runs == 1 else (f", RMS of {runs}" if order == 2 else f", mean of {runs}")
    return Table(
        head=(f"per step{mean}", *(["place"] if places else []), "TGOSPA", *PARTS),
        rows=[
            (
                item["name"],
                *([_place(item, document["pairs"])] if places else []),
                _between(item["normalised"]["lower_bound"], item["normalised"]["tgospa"]),
                *(number(item["normalised"][name], 4) for name in PARTS),
            )
            for item in document["estimates"]
        ],
        bold=frozenset(
            (row, k)
            for row in best_of([item["place"] for item in document["estimates"]])
            for k in range(2 + places)
        ),
    )


def _costs_table(estimates: list[EstimateRecord]) -> Table:
    """Value, total and its parts, each in its own unit."""
    roots = [Interval(lower=item["lower_bound"], upper=item["tgospa"]) for item in estimates]
    totals = [Interval(lower=item["total_lower"], upper=item["total"]) for item in estimates]
    return Table(
        head=("costs", "TGOSPA", "total", "local.", "missed", "false", "switch"),
        rows=[
            (
                item["name"],
                _between(root.lower, root.upper),
                _between(total.lower, total.upper),
                *(number(item[name], 5) for name in PARTS),
            )
            for item, root, total in zip(estimates, roots, totals, strict=True)
        ],
        bold=best_cells({1: roots, 2: totals}, [range(len(estimates))]),
    )


def _pair_tables(document: RankingRecord) -> Iterator[Table]:
    """Differences to the first estimate, costs per step."""
    first = document["estimates"][0]["name"]
    pairs = [pair for pair in document["pairs"] if pair["first"] == first]
    if not pairs:
        return
    head = ("cost/step", "order", "local.", "missed", "false", "switch", "steps -/+", "runs -/+")
    columns = len(head) + (document["runs"] > 1)
    rows = []
    for pair in pairs:
        difference, steps, runs = pair["per_step"], pair["steps"], pair["per_run"]
        low, high = difference["total"]
        cells = (
            "+0" if pair["verdict"] == "equal" else _between(low, high, "+"),
            ORDERS[pair["verdict"]],
            *(f"{difference[name]:+.3g}" for name in PARTS),
            f"{steps['better']}/{steps['worse']}",
            f"{runs['second_less']}/{runs['first_less']}",
        )
        rows.append((pair["second"], *cells)[:columns])
    yield Table(head=(f"vs {first}", *head)[:columns], rows=rows)


def opposed(document: RankingRecord) -> Iterator[str]:
    """Warnings: pairs whose mean totals are the other way round, for runs differ in length."""
    for pair in document["pairs"]:
        if pair["opposed"]:
            yield (
                f"warning: {pair['first']} is before {pair['second']} by TGOSPA per step, in "
                "which each run counts the same, but has the larger mean total, in which long runs "
                "count more"
            )


def _against_tables(document: RankingRecord) -> Iterator[Table]:
    """TGOSPA, per-step GOSPA, and the two rules, for each estimate."""
    order = document["parameters"]["order"]
    rows: list[tuple[str, float, float | None, float | None]] = []
    for item in document["estimates"]:
        step = item["per_step_gospa"]
        if step is None:
            return
        name = f"{item['name']}: " if len(document["estimates"]) > 1 else ""
        rows.append((f"{name}TGOSPA", item["total"], item["counts"]["switch"], None))
        rows.append((f"{name}GOSPA, summed", step["total"], None, None))
        for rule, title in RULES.items():
            found = step[rule]
            rows.append((f"{name}{title}", found["total"], found["switches"], found["mean"]))
    yield Table(
        head=("sum over steps of values^p", "total", "root", "switches", "mean of steps"),
        rows=[
            (
                name,
                number(total),
                number(total ** (1 / order)),
                "" if count is None else number(count),
                "" if mean is None else number(mean, 5),
            )
            for name, total, count, mean in rows
        ],
    )


def _other_tables(document: RankingRecord) -> Iterator[Table]:
    items = document["estimates"]
    return compared_table(
        [item["name"] for item in items], [item.get("with", {}) for item in items]
    )


def _ranking_notes(document: RankingRecord) -> Iterator[str]:
    estimates = document["estimates"]
    for item in estimates:
        for which, made in enumerate(item["runs"], start=1):
            if not made["finished"]:
                run = f" run {which}" if document["runs"] > 1 else ""
                yield f"{item['name']}{run}: {made['status']}"
    if len(estimates) > 1:
        found = {pair["verdict"] for pair in document["pairs"]}
        yield "; ".join(
            [
                *(text for verdict, text in PROOFS.items() if verdict in found),
                "steps -/+: at how many the estimate costs less or more than the first",
            ]
        )
    yield SPLIT_NOTE
    yield from opposed(document)
    name = f"{estimates[0]['name']}: " if len(estimates) > 1 else ""
    for sentence in estimates[0].get("differences", ()):
        yield name + sentence
    if estimates[0]["per_step_gospa"] is not None:
        yield TIES
    yield from direction(estimates[0].get("with", {}))


def _between(low: float, high: float, sign: str = "") -> str:
    """One number if both are the same as they are shown, else both."""
    texts = [f"{value:{sign}.6g}" for value in (low, high)]
    return texts[1] if texts[0] == texts[1] else " to ".join(texts)


def _place(item: EstimateRecord, pairs: list[PairRecord]) -> str:
    best, worst = item["place"]
    shared = any(
        pair["verdict"] == "equal" and item["name"] in (pair["first"], pair["second"])
        for pair in pairs
    )
    return place_in_words(best, worst, shared=shared)
