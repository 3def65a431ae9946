"""A scaling study, as a document, a report and a table."""

from collections.abc import Iterator
from typing import Literal, get_args

from tgospa_eval.common.words import counted
from tgospa_eval.reports.phrases import EXACT, SPLIT_NOTE, error_of, or_dash, parameters_of
from tgospa_eval.reports.records import Spread, StudyRecord
from tgospa_eval.reports.tables import Document, Table, as_markdown
from tgospa_eval.results.records import PARTS, Columns


def study_document(document: StudyRecord) -> Document:
    """Solvers on synthetic scenes of many sizes."""
    return Document(
        kind="Scaling study on simulated scenes; on your files: tgospa-eval compare TRUTH A",
        title=_study_title(document),
        lines=list(_study_lines(document)),
        tables=[_times_table(document), _rms_table(document)],
        notes=list(_study_notes(document)),
    )


def study_report(document: StudyRecord, pictures: list[str]) -> str:
    """The report as Markdown, with its pictures."""
    shown = "\n\n".join(f"![{CAPTIONS[name]}]({name}.png)" for name in pictures)
    return f"# Scaling study\n\n{as_markdown(study_document(document))}" + (
        f"\n{shown}\n" if shown else ""
    )


Statistic = Literal["mean", "deviation", "max"]
STATISTICS: tuple[Statistic, ...] = get_args(Statistic)
Measured = Literal["seconds", "error", "lower_error", "iterations"]
SPREADS: tuple[Measured, ...] = get_args(Measured)
Fault = Literal["infinite_errors", "failed", "unfinished"]
FAULTS: tuple[Fault, ...] = get_args(Fault)
FACTS: dict[Fault, str] = {
    "failed": "failed",
    "unfinished": "not finished",
    "infinite_errors": "error without bound, not in its mean,",
}

CAPTIONS = {
    "error_over_epsilon": "Error of sinkhorn by temperature, mean and one standard deviation",
    "scaling": "Time and error over targets and over steps, mean and one standard deviation",
}
"""What the pictures of a study show, by name."""


def study_columns(document: StudyRecord) -> Columns:
    """A row for each size and solver, plain numbers."""
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


def _study_title(document: StudyRecord) -> str:
    sizes, runs = document["sizes"], document["runs"]
    if document["contradictions"]:
        targets, steps, run, a, b = document["contradictions"][0]
        return (
            f"The brackets of {a} and {b} do not overlap in run {run} of {targets} targets and "
            f"{steps} steps, and there may be more: one of these proofs is wrong. This is an error "
            "of this program; please report it"
        )
    done = (
        f"{counted(len(sizes) * runs, 'scene')} of {counted(len(sizes), 'size')}, "
        f"{counted(runs, 'run')}{' each' if len(sizes) > 1 else ''}"
    )
    if any(made["failed"] for size in sizes for made in size["solvers"]):
        return f"{done}: solvers failed, all brackets that there are overlap"
    return f"{done}: all brackets overlap" if len(sizes[0]["solvers"]) > 1 else done


def _study_lines(document: StudyRecord) -> Iterator[str]:
    scene, tracker = document["scene"], document["tracker"]
    yield (
        f"scenario {scene['scenario']}, area {scene['area']:g}; noise {tracker['noise']:g}, "
        f"detection {tracker['detection']:g}, swaps {tracker['swaps']:g}, fragmentation "
        f"{tracker['fragmentation']:g}, false tracks {tracker['false_rate']:g} a step; "
        f"seed {document['seed']}"
    )
    yield parameters_of(document["parameters"])
    yield document["machine"]


def _times_table(document: StudyRecord) -> Table:
    """Time and error; mean and standard deviation over the runs."""
    rows = []
    for size in document["sizes"]:
        for k, made in enumerate(size["solvers"]):
            where = (str(size["targets"]), str(size["steps"])) if not k else ("", "")
            spent = or_dash(made["seconds"]["mean"], ".3g"), _deviation(made["seconds"], ".2g")
            error = error_of(made["error"]["mean"]), _deviation(made["error"], ".0e")
            iterations = or_dash(made["iterations"]["mean"], ".0f")
            below = error_of(made["lower_error"]["mean"])
            rows.append((made["name"], *where, *spent, *error, below, iterations))
    return Table(
        head=("solver", "m", "T", "seconds", "+-", "error", "+-", "bound's", "iter."), rows=rows
    )


def _rms_table(document: StudyRecord) -> Table:
    """The metric itself: roots per step, RMS over runs."""
    mean = "RMS" if document["parameters"]["order"] == 2 else "mean"
    return Table(
        head=(f"per step, {mean} of runs", "TGOSPA", *PARTS),
        rows=[
            (
                f"m = {size['targets']}, T = {size['steps']}",
                *(or_dash(size["normalised"][name], ".5g") for name in ("tgospa", *PARTS)),
            )
            for size in document["sizes"]
        ],
    )


def _study_notes(document: StudyRecord) -> Iterator[str]:
    yield (
        "m targets, T steps; seconds of solving and proof; error: the total is at most so much "
        "above the true one, relative; bound's: the lower bound is at most so much below it; "
        "+- one standard deviation over the runs"
    )
    yield SPLIT_NOTE
    for size in document["sizes"]:
        where = f"{counted(size['targets'], 'target')}, {counted(size['steps'], 'step')}"
        if size["left_out"]:
            yield (
                f"{where}: {counted(size['left_out'], 'scene')} left out of the values per step, "
                "for brackets contradict each other or there is none; contradicting ones are left "
                "out of times and errors too"
            )
        for made in size["solvers"]:
            for name, fact in FACTS.items():
                if made[name]:
                    yield f"{made['name']}, {where}: {fact} in {counted(made[name], 'run')}"


def _deviation(values: Spread, form: str) -> str:
    value = values["deviation"]
    return "-" if value is None else ("0" if value < EXACT else f"{value:{form}}")
