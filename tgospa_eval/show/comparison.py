"""Reports and tables from the JSON documents of `compare`, and from sweeps of a parameter."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import nan

from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, number, sizes_in_words
from tgospa_eval.results.consistency import ABOUT_THE_ORDER, NEES
from tgospa_eval.results.evaluation import dotted
from tgospa_eval.results.records import COUNTED_PARTS, MEAN, PARTS, SPREAD, Columns, Json, json_text
from tgospa_eval.results.summary import SUMMARY
from tgospa_eval.results.sweep import Point, SweepEvaluation
from tgospa_eval.show import result_text, study_table, table_text

TIES = (
    "if several assignments of a step cost the same, SciPy's is used, with objects in the order "
    "of their ids; other choices may count other switches"
)


def estimates_document(document: Json, requested: Sequence[str] = ()) -> table_text.Document:
    """Return the report about one or several estimates.

    Several estimates are ranked. For one estimate, TGOSPA is shown next to per-step GOSPA.
    `requested` has the names of the columns of the main table; it is empty for the default.
    """
    return table_text.Document(
        kind=_what(document),
        title=_order(document),
        lines=[
            *_warned(document, of_order=True),
            _runs(document),
            table_text.parameters_of(document["parameters"]),
        ],
        tables=[
            *_study_tables(document, requested),
            *_against_tables(document),
            *_other_tables(document),
        ],
        notes=list(_ranking_notes(document)),
        warnings=[*_warned(document, of_order=False)],
    )


def _warned(document: Json, *, of_order: bool) -> Iterator[str]:
    """Yield the warnings about the ranking if `of_order`; otherwise yield all other warnings."""
    for record in document["warnings"]:
        if (record["code"] in ABOUT_THE_ORDER) is of_order:
            yield str(Notice(**record))


def estimates_columns(document: Json) -> Columns:
    """Return a table of numbers with a row for each estimate."""
    items = document["estimates"]
    table = table_text.columns(items, ["name"])
    for k, end in enumerate(("best", "worst")):
        table[f"place_{end}"] = [item["place"][k] for item in items]
    per_step = [item["normalised"] for item in items]
    table |= table_text.columns(per_step, per_step[0], "normalised_")
    table |= table_text.columns(items, ("tgospa", "lower_bound", "total", "total_lower", *PARTS))
    table |= table_text.columns([item["counts"] for item in items], items[0]["counts"], "count_")
    if all(item.get(NEES) for item in items):
        table |= table_text.columns(
            [item[NEES] for item in items], ("mean", "anees", "inside"), "nees_"
        )
    if all(MEAN in item and SPREAD in item for item in items):
        table |= table_text.columns(items, (MEAN, SPREAD))
    steps = [item["per_step_gospa"] for item in items if item["per_step_gospa"] is not None]
    if steps:
        table["gospa_total"] = [step["total"] for step in steps]
        for rule in table_text.RULES:
            names = ("switches", "halves", "total", "mean")
            table |= table_text.columns([step[rule] for step in steps], names, f"{rule}_")
    return table | result_text.other_columns([item.get("with", {}) for item in items])


def pairs_columns(document: Json) -> Columns:
    """Return a table with a row for each pair of estimates.

    Columns with names like ``per_step_missed`` have a difference of costs per step: the cost of the
    second estimate minus that of the first.
    """
    pairs = document["pairs"]
    table = table_text.columns(pairs, ("first", "second", "verdict"))
    for k, end in enumerate(("lower", "upper")):
        table[f"per_step_total_{end}"] = [pair["per_step"]["total"][k] for pair in pairs]
    table |= table_text.columns([pair["per_step"] for pair in pairs], PARTS, "per_step_")
    table |= table_text.columns([pair["steps"] for pair in pairs], ("better", "worse"), "steps_")
    names = ("mean", "standard_error", "first_less", "second_less")
    return table | table_text.columns([pair["per_run"] for pair in pairs], names, "per_run_")


def _order(document: Json) -> str:
    estimates, unit = document["estimates"], table_text.unit_of(document["parameters"])
    if len(estimates) == 1:
        item = estimates[0]
        value = table_text.between(item["lower_bound"], item["tgospa"], ".6g")
        mean = "" if document["runs"] == 1 else f", of the mean total of {document['runs']} runs"
        return f"{item['name']}: TGOSPA = {value}{unit}{mean}"
    value = study_table.value_name(document["parameters"]["order"], document["runs"])
    return table_text.order_in_words(value, estimates, document["pairs"])


def _what(document: Json) -> str:
    """Return a text on the content of the report, and a command for another comparison."""
    count = len(document["estimates"])
    if count > 1:
        return f"Ranking of {count} estimates; {table_text.TO_STUDY}"
    if document["estimates"][0]["per_step_gospa"] is not None:
        return f"TGOSPA and per-step GOSPA for one estimate; {table_text.TO_RANK}"
    if document["runs"] == 1:
        return f"TGOSPA and other metrics for one estimate; {table_text.TO_RANK}"
    return f"Mean over the runs of one estimate; {table_text.TO_RANK}"


def _runs(document: Json) -> str:
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


def study_rows(document: Json) -> list[study_table.StudyRow]:
    """Return a row for each estimate, best first."""
    items, pairs = document["estimates"], document["pairs"]
    equal, first = table_text.equal_names(pairs), items[0]["name"]
    p_values = {pair["second"]: pair["p_holm"] for pair in pairs if pair["first"] == first}
    return [
        study_table.StudyRow(
            names=(item["name"],),
            jobs=f"{document['runs']:,}",
            steps=sum(document["steps"]) / document["runs"],
            order=document["parameters"]["order"],
            total=Interval(lower=item["total_lower"], upper=item["total"]),
            costs={part: item[part] for part in PARTS},
            confidence=item["confidence"],
            place=table_text.place_in_words(*item["place"], shared=item["name"] in equal)
            if pairs
            else "",
            p=p_values.get(item["name"], nan) if any(p_values.values()) else None,
            numbers=item[SUMMARY] | dotted(item.get("with", {})),
        )
        for item in items
    ]


def _study_tables(document: Json, requested: Sequence[str]) -> Iterator[table_text.Table]:
    """Yield the main table, then tables of differences and of costs."""
    rows, rivals = study_rows(document), [range(len(document["estimates"]))]
    title = study_table.value_name(document["parameters"]["order"], document["runs"])
    caption = study_table.study_caption(title, document["parameters"])
    yield study_table.study_table(rows, ("estimate",), rivals, title, requested, caption)
    yield from _pair_tables(document)
    yield study_table.costs_table(rows, ("costs",), rivals, caption)
    names = [row.names for row in rows]
    yield from result_text.covariances_table(("covariances",), names, document["estimates"])


def _pair_tables(document: Json) -> Iterator[table_text.Table]:
    """Yield a table of differences of costs per step between each estimate and the first one."""
    first = document["estimates"][0]["name"]
    pairs = [pair for pair in document["pairs"] if pair["first"] == first]
    if not pairs:
        return
    head = ("cost/step", "order", *table_text.PART_HEADS, "steps -/+", "runs -/+")
    width = len(head) + (document["runs"] > 1)
    rows = []
    for pair in pairs:
        difference, steps, runs = pair["per_step"], pair["steps"], pair["per_run"]
        low, high = difference["total"]
        cells = (
            "+0" if pair["verdict"] == "equal" else table_text.between(low, high, "+.6g"),
            table_text.ORDERS[pair["verdict"]],
            *(f"{difference[name]:+.3g}" for name in PARTS),
            f"{steps['better']}/{steps['worse']}",
            f"{runs['second_less']}/{runs['first_less']}",
        )
        rows.append((pair["second"], *cells)[:width])
    yield table_text.Table(head=(f"vs {first}", *head)[:width], rows=rows)


def _against_tables(document: Json) -> Iterator[table_text.Table]:
    """Yield a table that compares TGOSPA with per-step GOSPA.

    Switches are added to GOSPA by the rules of two other programs, `table_text.RULES`.
    """
    order = document["parameters"]["order"]
    rows: list[tuple[str, float, float | None, float | None]] = []
    for item in document["estimates"]:
        step = item["per_step_gospa"]
        if step is None:
            return
        name = f"{item['name']}: " if len(document["estimates"]) > 1 else ""
        rows.append((f"{name}TGOSPA", item["total"], item["counts"]["switch"], None))
        rows.append((f"{name}GOSPA, summed", step["total"], None, None))
        for rule, title in table_text.RULES.items():
            gospa = step[rule]
            rows.append((f"{name}{title}", gospa["total"], gospa["switches"], gospa["mean"]))
    names, totals, counts, means = zip(*rows, strict=True)
    yield table_text.table_of(
        {
            "sum over steps of values^p": names,
            "total": [number(total) for total in totals],
            "root": [number(total ** (1 / order)) for total in totals],
            "switches": ["" if count is None else number(count) for count in counts],
            "mean of steps": ["" if mean is None else number(mean, 5) for mean in means],
        }
    )


def _other_tables(document: Json) -> Iterator[table_text.Table]:
    items = document["estimates"]
    names = [(item["name"],) for item in items]
    metrics = [item.get("with", {}) for item in items]
    yield from result_text.grouped_table(("others",), names, metrics, [range(len(items))])


def _ranking_notes(document: Json) -> Iterator[str]:
    estimates = document["estimates"]
    for item in estimates:
        for which, made in enumerate(item["runs"], start=1):
            if not made["finished"]:
                run = f" run {which}" if document["runs"] > 1 else ""
                yield f"{item['name']}{run}: {made['status']}"
    if len(estimates) > 1:
        verdicts = {pair["verdict"] for pair in document["pairs"]}
        title = study_table.value_name(document["parameters"]["order"], document["runs"])
        if any(item["confidence"] for item in estimates):
            once = any(record["code"] == "copies" for record in document["warnings"])
            yield (
                f"{title} and its {study_table.INTERVAL} over {counted(document['runs'], 'run')}"
                f"{', where copies count once' * once}: by Student's t and the jackknife"
                + "; p of the difference to the best: by a two-sided permutation test, adjusted "
                "for all pairs (Holm); significant below 0.05"
                * (document["pairs"][0]["p_holm"] is not None)
            )
        yield "; ".join(
            [
                *(text for verdict, text in table_text.PROOFS.items() if verdict in verdicts),
                "steps -/+: steps at which the estimate costs less (-) and more (+) than the first",
            ]
        )
    yield table_text.SPLIT_NOTE
    yield from table_text.about_periods(
        (item["name"], [run["parameters"] for run in item["runs"]]) for item in estimates
    )
    name = f"{estimates[0]['name']}: " if len(estimates) > 1 else ""
    for sentence in estimates[0].get("differences", ()):
        yield name + sentence
    if estimates[0]["per_step_gospa"] is not None:
        yield TIES
    yield from result_text.direction(estimates[0].get("with", {}))


# -------------------------------------------------------------------------------------------------
# Several solvers that are compared on one truth and one estimate.


def solvers_document(document: Json) -> table_text.Document:
    """Return the report about several solvers."""
    runs = document["runs"]
    return table_text.Document(
        kind=f"Comparison of solvers; {table_text.TO_RANK}",
        title=_agreement(document),
        lines=[
            table_text.size_of(document["sizes"]),
            table_text.parameters_of(document["parameters"]),
        ],
        tables=[
            table_text.table_of(
                {
                    "run": [run["name"] for run in runs],
                    "TGOSPA": [table_text.or_dash(run["tgospa"], ".9g") for run in runs],
                    "lower bound": [table_text.or_dash(run["lower_bound"], ".9g") for run in runs],
                    "error": [table_text.error_of(run["error"]) for run in runs],
                    "bound's error": [table_text.error_of(run["lower_error"]) for run in runs],
                    "iterations": [table_text.or_dash(run["iterations"], "d") for run in runs],
                }
            ),
            *_entropic_tables(runs),
            table_text.table_of(
                {
                    "seconds": [run["name"] for run in runs],
                    **{
                        stage: [table_text.or_dash(value, ".4f") for value in values]
                        for stage, values in _stages(runs).items()
                    },
                    "MB": [
                        table_text.or_dash(used and (used["peak"] - used["before"]) / 1e6, ".1f")
                        for used in (run["memory"] for run in runs)
                    ],
                }
            ),
        ],
        notes=list(_solver_notes(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def solvers_columns(document: Json) -> Columns:
    """Return a table of numbers with a row for each run of a solver."""
    runs = document["runs"]
    names = (
        *("name", "solver", "epsilon", "tgospa", "lower_bound", "total", "total_lower", "error"),
        *("lower_error", *PARTS, "iterations", "status", "finished"),
    )
    table = table_text.columns(runs, names)
    for name in ENTROPIC:
        table[f"entropic_{name}"] = [run["entropic"] and run["entropic"][name] for run in runs]
    table |= {f"{stage}_seconds": values for stage, values in _stages(runs).items()}
    for name in ("before", "peak"):
        table[f"{name}_bytes"] = [run["memory"] and run["memory"][name] for run in runs]
    return table


def _agreement(document: Json) -> str:
    referee, unit = document["referee"], table_text.unit_of(document["parameters"])
    if not document["agree"]:
        pairs = "; ".join(f"{a} and {b}" for a, b in document["contradictions"])
        return (
            f"The brackets of {pairs} do not overlap: one of these proofs is wrong. This is an "
            "error of this program, not of your data; please report it"
        )
    if referee is None:
        return "No solver has a result"
    count = sum(run["total"] is not None for run in document["runs"])
    which = "Both" if count == 2 else f"All {count}"
    subject = "The bracket" if count == 1 else f"{which} brackets overlap; together they"
    verb = "says" if count == 1 else "say"
    low, high = f"{referee['lower_bound']:.9g}", f"{referee['upper_bound']:.9g}"
    if low == high:
        return f"{subject} {verb}: TGOSPA = {high}{unit}"
    return f"{subject} {verb}: TGOSPA is between {low} and {high}{unit}"


def _solver_notes(document: Json) -> Iterator[str]:
    once = document["seconds"]
    spent = ", ".join(f"{name} {value:.4f}" for name, value in once.items())
    yield f"seconds, once for all solvers: {spent}"
    for run in document["runs"]:
        if run["status"] != "solved":
            yield f"{run['name']}: {run['status']}"
    for name, reason in document["left_out"].items():
        yield f"{name} left out: {reason}"


ENTROPIC = ("primal", "dual", "cost", "error", "cost_error", "sweep", "violation")


def _entropic_tables(runs: Sequence[Json]) -> Iterator[table_text.Table]:
    """Yield a table about the values with entropy; none if no run has such a value."""
    named = [(run["name"], run["entropic"]) for run in runs if run["entropic"] is not None]
    if named:
        names, values = zip(*named, strict=True)
        yield table_text.table_of(
            {
                "entropic": names,
                "value": [f"{value['dual']:.7g}" for value in values],
                "error": [table_text.error_of(value["error"]) for value in values],
                "cost alone": [f"{value['cost']:.7g}" for value in values],
                "its error": [table_text.error_of(value["cost_error"]) for value in values],
                "sweeps": [str(value["sweep"]) for value in values],
            }
        )


STAGES = ("all", "prepare", "sweeps", "programme", "rest", "proof")
"""Columns of times. ``all`` is the time of solving and proof. The other columns are its parts."""


def _stages(runs: Sequence[Json]) -> Columns:
    """Return a table of seconds: a row for each run, a column for each of `STAGES`."""
    each = [_split(run["seconds"]) for run in runs]
    return {stage: [row[k] for row in each] for k, stage in enumerate(STAGES)}


def _split(seconds: Json | None) -> tuple[float | None, ...]:
    """Return the seconds of one run for each of `STAGES`; None if the run failed."""
    if seconds is None:
        return (None,) * len(STAGES)
    stages = seconds["stages"]
    named = [
        stages.get("preparation", 0.0) + stages.get("build", 0.0),
        stages.get("sweeps", 0.0),
        stages.get("lp", 0.0),
    ]
    rest = max(seconds["solve"] - sum(named), 0.0)
    return seconds["solve"] + seconds["certify"], *named, rest, seconds["certify"]


# -------------------------------------------------------------------------------------------------
# A scaling study: solvers on scenes (simulated recordings) of several sizes.


def study_document(document: Json) -> table_text.Document:
    """Return the report about a scaling study."""
    return table_text.Document(
        kind="Scaling study on simulated scenes; on your files: tgospa-eval compare TRUTH A",
        title=_study_title(document),
        lines=list(_study_lines(document)),
        tables=[_times_table(document), _rms_table(document)],
        notes=list(_study_notes(document)),
    )


def study_report(document: Json, pictures: Iterable[str]) -> str:
    """Return the report about a scaling study as Markdown.

    The given picture files are shown if Markdown supports their format.
    """
    files = (name.rpartition(".") for name in pictures)
    shown = "\n\n".join(
        f"![{CAPTIONS[name]}]({name}.{form})" for name, _, form in files if form in ("png", "svg")
    )
    return f"# Scaling study\n\n{table_text.as_markdown(study_document(document))}" + (
        f"\n{shown}\n" if shown else ""
    )


STATISTICS = ("mean", "deviation", "max")
ENTROPIC_SPREADS = ("entropic_error", "entropic_cost_error")
SPREADS = ("seconds", "error", "lower_error", *ENTROPIC_SPREADS, "iterations")
FAULTS = ("infinite_errors", "failed", "unfinished")
FACTS = {
    "failed": "failed",
    "unfinished": "not finished",
    "infinite_errors": "unbounded error, not in the mean,",
}

CAPTIONS = {
    "error_over_epsilon": "Error of sinkhorn by temperature, mean and one standard deviation",
    "scaling": "Time and error over targets and over steps, mean and one standard deviation",
}
"""Captions of the pictures of a study, by name."""


def study_columns(document: Json) -> Columns:
    """Return a table of numbers with a row for each size and solver."""
    rows = [(size, made) for size in document["sizes"] for made in size["solvers"]]
    table: Columns = {
        "targets": [size["targets"] for size, _ in rows],
        "steps": [size["steps"] for size, _ in rows],
        "states": [size["states"]["mean"] for size, _ in rows],
        "name": [made["name"] for _, made in rows],
        "solver": [made["solver"] for _, made in rows],
        "epsilon": [made["epsilon"] for _, made in rows],
    }
    for name in SPREADS:
        for kind in STATISTICS:
            table[f"{name}_{kind}"] = [made[name][kind] for _, made in rows]
    for fault in FAULTS:
        table[fault] = [made[fault] for _, made in rows]
    return table | {"left_out": [size["left_out"] for size, _ in rows]}


def _study_title(document: Json) -> str:
    sizes, runs = document["sizes"], document["runs"]
    if document["contradictions"]:
        targets, steps, run, a, b = document["contradictions"][0]
        return (
            f"The brackets of {a} and {b} do not overlap in run {run} of {targets} targets and "
            f"{steps} steps, and maybe in others: one of these proofs is wrong. This is an error "
            "of this program; please report it"
        )
    done = (
        f"{counted(len(sizes) * runs, 'scene')} of {counted(len(sizes), 'size')}, "
        f"{counted(runs, 'run')}{' each' if len(sizes) > 1 else ''}"
    )
    if any(made["failed"] for size in sizes for made in size["solvers"]):
        return f"{done}: some solvers failed; all other brackets overlap"
    return f"{done}: all brackets overlap" if len(sizes[0]["solvers"]) > 1 else done


def _study_lines(document: Json) -> Iterator[str]:
    scene, tracker = document["scene"], document["tracker"]
    yield (
        f"scenario {scene['scenario']}, area {scene['area']:g}; noise {tracker['noise']:g}, "
        f"detection {tracker['detection']:g}, swaps {tracker['swaps']:g}, fragmentation "
        f"{tracker['fragmentation']:g}, false tracks {tracker['false_rate']:g} a step; "
        f"seed {document['seed']}"
    )
    yield table_text.parameters_of(document["parameters"])
    yield document["machine"]


def _times_table(document: Json) -> table_text.Table:
    """Return the table of time and error, as mean and standard deviation over the runs."""
    rows = []
    for size in document["sizes"]:
        for k, made in enumerate(size["solvers"]):
            where = (str(size["targets"]), str(size["steps"])) if not k else ("", "")
            spent = (
                table_text.or_dash(made["seconds"]["mean"], ".3g"),
                _deviation(made["seconds"], ".2g"),
            )
            error = table_text.error_of(made["error"]["mean"]), _deviation(made["error"], ".0e")
            iterations = table_text.or_dash(made["iterations"]["mean"], ".0f")
            below = table_text.error_of(made["lower_error"]["mean"])
            rows.append((made["name"], *where, *spent, *error, below, iterations))
    return table_text.Table(
        head=("solver", "m", "T", "seconds", "+-", "error", "+-", "bound's", "iter."), rows=rows
    )


def _rms_table(document: Json) -> table_text.Table:
    """Return the table of the metric per step, as a root mean square over the runs."""
    mean = "RMS" if document["parameters"]["order"] == 2 else "mean"
    sizes = document["sizes"]
    table = {f"per step, {mean} of runs": [f"m = {s['targets']}, T = {s['steps']}" for s in sizes]}
    for head, name in zip(("TGOSPA", *PARTS), ("tgospa", *PARTS), strict=True):
        table[head] = [table_text.or_dash(size["normalised"][name], ".5g") for size in sizes]
    return table_text.table_of(table)


def _study_notes(document: Json) -> Iterator[str]:
    yield (
        "m targets, T steps; seconds: solving and proof; error: largest possible relative error of "
        "the total; bound's: relative error of the lower bound, likewise; +-: one standard "
        "deviation over the runs"
    )
    yield table_text.SPLIT_NOTE
    for size in document["sizes"]:
        where = f"{counted(size['targets'], 'target')}, {counted(size['steps'], 'step')}"
        if size["left_out"]:
            yield (
                f"{where}: {counted(size['left_out'], 'scene')} left out of the values per step: "
                "no bounds, or bounds that contradict each other; scenes with contradictions are "
                "also left out of times and errors"
            )
        for made in size["solvers"]:
            for name, fact in FACTS.items():
                if made[name]:
                    yield f"{made['name']}, {where}: {fact} in {counted(made[name], 'run')}"


def _deviation(values: Json, form: str) -> str:
    value = values["deviation"]
    return "-" if value is None else ("0" if value < table_text.EXACT else f"{value:{form}}")


COLUMNS = {
    "estimates": estimates_columns,
    "solvers": solvers_columns,
    "study": study_columns,
}
"""Function that makes the table of numbers, for each kind of document."""

DOCUMENTS = {
    "estimates": estimates_document,
    "solvers": solvers_document,
    "study": study_document,
}
"""Function that makes the report, for each kind of document."""


def page(document: Json, requested: Sequence[str] = ()) -> table_text.Document:
    """Return the report of a document, with a line about the settings file if one was used.

    The main table has the `requested` columns.
    """
    made = DOCUMENTS[document["kind"]](document, *([requested] if requested else ()))
    if "settings_file" not in document:
        return made
    used = str(SettingsFile(**document["settings_file"]))
    return replace(made, warnings=[used, *made.warnings])


def render(document: Json, format: str, requested: Sequence[str] = ()) -> str:
    """Return the report of a document in a format; its main table has the `requested` columns."""
    made = partial(page, requested=requested)
    return table_text.rendered(format, document, made, json_text, COLUMNS[document["kind"]])


# -------------------------------------------------------------------------------------------------
# A sweep of a parameter.


def sweep_document(sweep: SweepEvaluation) -> table_text.Document:
    """Return the report about a sweep, with a row for each value of the parameter."""
    points = sweep.points
    table = {table_text.LETTERS[sweep.parameter]: [number(point.value) for point in points]}
    if not sweep.certified:
        table["lower bound"] = [number(point.lower_bound) for point in points]
    table["TGOSPA"] = [number(point.tgospa) for point in points]
    table["localisation"] = [number(point.localisation, 5) for point in points]
    for part in COUNTED_PARTS:
        table[part] = [
            f"{number(getattr(point, part), 5)} ({number(_count(point, part))})" for point in points
        ]
    return table_text.Document(
        title=_sweep_title(sweep),
        lines=[
            f"{table_text.parameters_of(sweep.settings, '; ')}; {sizes_in_words(sweep.sizes)}",
            "costs, with counts in parentheses:",
        ],
        tables=[table_text.table_of(table)],
        notes=list(_sweep_notes(sweep)),
        warnings=sweep.messages,
    )


def _count(point: Point, part: str) -> float:
    count: float = getattr(point, f"{part}_count")
    return count


def _sweep_title(sweep: SweepEvaluation) -> str:
    points = sweep.points
    word, letter = sweep.parameter.replace("_", " "), table_text.LETTERS[sweep.parameter]
    first, last = (_quantity(sweep, k) for k in (0, -1))
    over = f"at {letter} = {first}"
    if len(points) > 1:
        over = f"at {len(points)} values of the {word} from {letter} = {first} to {last}"
    wide = [point for point in points if not point.certified]
    if not wide:
        return f"TGOSPA {over}, all proven exact"
    gap = max(point.relative_gap for point in wide)
    return (
        f"TGOSPA {over}: {len(points) - len(wide)} exact, {len(wide)} between proven bounds (the "
        f"totals differ by up to {number(100 * gap, 2)}%)"
    )


def _quantity(sweep: SweepEvaluation, k: int) -> str:
    """Format the parameter at the k-th point, with its unit if it has one."""
    return number(sweep.points[k].value) + (f" {sweep.unit}" if sweep.unit else "")


def _sweep_notes(sweep: SweepEvaluation) -> Iterator[str]:
    """Yield sentences on the ranges of the parameter over which counts stay the same.

    There are no sentences if TGOSPA at a value is not exact, because its counts can then be wrong.
    """
    letter = table_text.LETTERS[sweep.parameter]
    if len(sweep.points) < 2 or not sweep.certified:
        return
    for names in (COUNTED_PARTS[:2], COUNTED_PARTS[2:]):
        words = " and ".join("switches" if name == "switch" else name for name in names)
        span = sweep.unchanged(*(f"{name}_count" for name in names))
        if span is None:
            yield f"{words}: the counts differ between all neighbouring values"
            continue
        counts = " and ".join(number(_count(sweep.points[span[0]], name)) for name in names)
        low, high = (_quantity(sweep, k) for k in span)
        many = span[1] - span[0] + 1
        yield f"{words}: {counts} at all {many} values from {letter} = {low} to {high}"
