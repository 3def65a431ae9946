"""Documents of `compare` as pages and as tables. Computes nothing that is not in the document."""

import itertools
import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from tgospa_eval.notices import Notice
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.sheets import Page, Sheet, as_latex, as_markdown, as_text
from tgospa_eval.summary import Table

Document = dict[str, Any]

PARTS = ("localisation", "missed", "false", "switch")
EXACT = 1e-9
"""Relative errors below count as none, and differ from machine to machine."""

RANK = "to rank estimates: tgospa-eval compare TRUTH A B"
STUDY = "to compare solvers on one: tgospa-eval compare TRUTH A"

RULES = {"stone_soup": "Stone Soup", "mathworks": "MathWorks"}


def json_text(document: Document) -> str:
    """The document with sorted keys; no NaN."""
    return json.dumps(document, sort_keys=True, indent=1, allow_nan=False) + "\n"


def render(document: Document, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return json_text(document)
    page, paper, table = PAGES[document["kind"]]
    if format == "csv":
        return csv_text(table(document))
    if format == "latex":
        return as_latex(paper(document))
    return (as_text if format == "table" else as_markdown)(page(document))


# --- solvers --------------------------------------------------------------------------------------


def solvers_page(document: Document) -> Page:
    """One problem through several solvers."""
    runs = document["runs"]
    return Page(
        kind=f"Comparison of solvers; {RANK}",
        title=_agreement(document),
        lines=[_size(document["sizes"]), _parameters(document["parameters"])],
        sheets=[
            Sheet(
                head=("run", "TGOSPA", "lower bound", "error", "bound's error", "iterations"),
                rows=[
                    (
                        run["name"],
                        _number(run["tgospa"], ".9g"),
                        _number(run["lower_bound"], ".9g"),
                        _error(run["error"]),
                        _error(run["lower_error"]),
                        _number(run["iterations"], "d"),
                    )
                    for run in runs
                ],
            ),
            Sheet(
                head=("seconds", "all", "prepare", "sweeps", "programme", "rest", "proof", "MB"),
                rows=[
                    (
                        run["name"],
                        *(_number(s, ".4f") for s in _split(run["seconds"])),
                        _memory(run),
                    )
                    for run in runs
                ],
            ),
        ],
        remarks=list(_solver_remarks(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def solvers_table(document: Document) -> Table:
    """A row for each run, plain numbers."""
    runs = document["runs"]
    names = (
        "name", "solver", "epsilon", "tgospa", "lower_bound", "total", "total_lower", "error",
        "lower_error", *PARTS, "iterations", "status", "finished",
    )  # fmt: skip
    table: Table = {name: [run[name] for run in runs] for name in names}
    split = [_split(run["seconds"]) for run in runs]
    for k, name in enumerate(("all", "prepare", "sweeps", "programme", "rest", "proof")):
        table[f"{name}_seconds"] = [row[k] for row in split]
    for name in ("before", "peak"):
        table[f"{name}_bytes"] = [(run["memory"] or {}).get(name) for run in runs]
    return table


def _agreement(document: Document) -> str:
    referee, unit = document["referee"], _unit(document["parameters"])
    if not document["agree"]:
        pairs = "; ".join(f"{a} and {b}" for a, b in document["contradictions"])
        return (
            f"The brackets of {pairs} do not overlap: one of these proofs is wrong. This is an "
            "error of this program or of its arithmetic, not of your data; please report it"
        )
    if referee is None:
        return "No solver has an answer"
    count = sum(run["total"] is not None for run in document["runs"])
    which = "Both" if count == 2 else f"All {count}"
    told = "The bracket" if count == 1 else f"{which} brackets overlap; together they"
    verb = "says" if count == 1 else "say"
    low, high = (f"{referee[name]:.9g}" for name in ("lower_bound", "upper_bound"))
    if low == high:
        return f"{told} {verb}: TGOSPA = {high}{unit}"
    return f"{told} {verb}: TGOSPA is between {low} and {high}{unit}"


def _solver_remarks(document: Document) -> Iterator[str]:
    once = document["seconds"]
    yield "once for all: " + ", ".join(f"{name} {value:.4f}" for name, value in once.items())
    for run in document["runs"]:
        if run["status"] != "solved":
            yield f"{run['name']}: {run['status']}"
    for name, reason in document["left_out"].items():
        yield f"{name} left out: {reason}"


def _split(seconds: Document | None) -> tuple[float | None, ...]:
    """Solving and proof together, and what they consist of."""
    if seconds is None:
        return (None,) * 6
    stages = seconds["stages"]
    named = [
        stages.get("preparation", 0.0) + stages.get("build", 0.0),
        stages.get("sweeps", 0.0),
        stages.get("lp", 0.0),
    ]
    rest = max(seconds["solve"] - sum(named), 0.0)
    return seconds["solve"] + seconds["certify"], *named, rest, seconds["certify"]


def _memory(run: Document) -> str:
    memory = run["memory"]
    return "-" if memory is None else f"{(memory['peak'] - memory['before']) / 1e6:.1f}"


# --- estimates ------------------------------------------------------------------------------------

SPLIT = (
    "split, not proven: localisation, missed, false and switch are those of the assignment that "
    "was found; the brackets hold for TGOSPA and the total"
)

ORDERS = {"less": "proven", "equal": "equal", "not separated": "open"}
"""Verdicts as the tables have them."""

PROOFS = {
    "less": "proven: the upper bound of the one is below the lower bound of the other",
    "equal": "equal: the same data, or proven to differ by less than 1e-9 of the value",
    "not separated": "open: the bounds of both overlap",
}
"""What the verdicts mean."""

TIES = (
    "where assignments of a step cost the same, SciPy's is taken, with the objects in the order of "
    "their ids; other tie rules may count other switches"
)


def estimates_page(document: Document) -> Page:
    """Several estimates of one truth, or one with per-step GOSPA beside it."""
    estimates, parameters = document["estimates"], document["parameters"]
    return Page(
        kind=_what(document),
        title=_order(document),
        lines=[_runs(document), _parameters(parameters)],
        sheets=[
            _paper_sheet(document, places=True),
            *_pair_sheets(document),
            Sheet(
                head=("costs", "TGOSPA", "total", "local.", "missed", "false", "switch"),
                rows=[
                    (
                        item["name"],
                        _between(item["lower_bound"], item["tgospa"]),
                        _between(item["total_lower"], item["total"]),
                        *(f"{item[name]:.5g}" for name in PARTS),
                    )
                    for item in estimates
                ],
            ),
            *_against_sheets(document),
        ],
        remarks=list(_estimate_remarks(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def estimates_paper(document: Document) -> Page:
    """What goes into a paper: roots per step, RMS over runs."""
    page = estimates_page(document)
    return replace(page, sheets=[_paper_sheet(document)], remarks=())


def estimates_table(document: Document) -> Table:
    """A row for each estimate, plain numbers."""
    items = document["estimates"]
    table: Table = {"name": [item["name"] for item in items]}
    table |= {f"place_{end}": [item["place"][k] for item in items]
              for k, end in enumerate(("best", "worst"))}  # fmt: skip
    for name in items[0]["normalised"]:
        table[f"normalised_{name}"] = [item["normalised"][name] for item in items]
    for name in ("tgospa", "lower_bound", "total", "total_lower", *PARTS):
        table[name] = [item[name] for item in items]
    for name in items[0]["counts"]:
        table[f"count_{name}"] = [item["counts"][name] for item in items]
    if items[0]["per_step_gospa"] is not None:
        steps = [item["per_step_gospa"] for item in items]
        table["gospa_total"] = [step["total"] for step in steps]
        for rule in RULES:
            for name in ("switches", "halves", "total", "mean"):
                table[f"{rule}_{name}"] = [step[rule][name] for step in steps]
    return table


def pairs_table(document: Document) -> Table:
    """A row for each pair of estimates: the second less the first, costs per step."""
    pairs = document["pairs"]
    own = ("first", "second", "verdict", "opposed")
    table: Table = {name: [pair[name] for pair in pairs] for name in own}
    for k, end in enumerate(("lower", "upper")):
        table[f"per_step_total_{end}"] = [pair["per_step"]["total"][k] for pair in pairs]
    table |= {f"per_step_{name}": [pair["per_step"][name] for pair in pairs] for name in PARTS}
    for group, names in (
        ("steps", ("better", "worse")),
        ("per_run", ("mean", "standard_error", "first_less", "second_less")),
    ):
        for name in names:
            table[f"{group}_{name}"] = [pair[group][name] for pair in pairs]
    return table


def _order(document: Document) -> str:
    estimates, unit = document["estimates"], _unit(document["parameters"])
    if len(estimates) == 1:
        item = estimates[0]
        value = _between(item["lower_bound"], item["tgospa"])
        mean = "" if document["runs"] == 1 else f", of the mean total of {document['runs']} runs"
        return f"{item['name']}: TGOSPA = {value}{unit}{mean}"
    names = [item["name"] for item in estimates]
    verdicts = {(pair["first"], pair["second"]): pair["verdict"] for pair in document["pairs"]}
    groups = [names[:1]]
    for pair in itertools.pairwise(names):
        if verdicts[pair] == "equal":
            groups[-1].append(pair[1])
        else:
            groups.append([pair[1]])
    proven = {
        **dict.fromkeys(itertools.combinations(names, 2), "less"),
        **{pair: "equal" for group in groups for pair in itertools.combinations(group, 2)},
    }
    if verdicts == proven and len(groups) == 1:
        return f"Proven to be equal by TGOSPA per step: {' = '.join(names)}"
    if verdicts == proven:
        order = ", ".join(map(" = ".join, groups))
        return f"Proven order by TGOSPA per step, best first: {order}"
    best = _best(document)
    if best:
        return (
            f"Proven best by TGOSPA per step: {' = '.join(names[k] for k in best)}; the order of "
            "the others is not proven throughout"
        )
    tied = [name for name, item in zip(names, estimates, strict=True) if item["place"][0] == 1]
    return f"No estimate is proven best by TGOSPA per step: it may be any of {', '.join(tied)}"


def _best(document: Document) -> list[int]:
    """Which estimates are proven to be better than all others, or equal to such."""
    places = [item["place"] for item in document["estimates"]]
    best = [k for k, place in enumerate(places) if place == [1, 1]]
    return best if len(best) < len(places) else []


def _what(document: Document) -> str:
    """What this is, and what to type for what it is not."""
    count = len(document["estimates"])
    if count > 1:
        return f"Ranking of {count} estimates; {STUDY}"
    if document["estimates"][0]["per_step_gospa"] is not None:
        return f"TGOSPA beside per-step GOSPA for one estimate; {RANK}"
    return f"Mean over the runs of one estimate; {RANK}"


def _runs(document: Document) -> str:
    steps = sorted(set(document["steps"]))
    length = (
        _count(steps[0], "step")
        if len(steps) == 1
        else f"{steps[0]:,} to {_count(steps[-1], 'step')}"
    )
    if document["runs"] == 1:
        return f"truth {document['truth'][0]}; {length} at which something exists"
    return (
        f"{document['runs']} runs, truth {_shortened(document['truth'])}; {length} each at "
        "which something exists; costs are means over runs, roots are taken last"
    )


def _shortened(paths: list[str]) -> str:
    return paths[0] if len(set(paths)) == 1 else f"{paths[0]} to {paths[-1]}"


def _paper_sheet(document: Document, *, places: bool = False) -> Sheet:
    """What is ranked, and its parts; with places where there are several."""
    runs, order = document["runs"], document["parameters"]["order"]
    places = places and len(document["estimates"]) > 1
    mean = "" if runs == 1 else (f", RMS of {runs}" if order == 2 else f", mean of {runs}")
    return Sheet(
        head=(
            f"per step{mean}",
            *(["place"] if places else []),
            *("TGOSPA", "localisation", "missed", "false", "switch"),
        ),
        rows=[
            (
                item["name"],
                *([_place(item, document["pairs"])] if places else []),
                _between(item["normalised"]["lower_bound"], item["normalised"]["tgospa"]),
                *(f"{item['normalised'][name]:.4g}" for name in PARTS),
            )
            for item in document["estimates"]
        ],
        bold=frozenset((row, k) for row in _best(document) for k in range(2 + places)),
    )


def _pair_sheets(document: Document) -> Iterator[Sheet]:
    """Differences to the first estimate, costs per step."""
    first = document["estimates"][0]["name"]
    pairs = [pair for pair in document["pairs"] if pair["first"] == first]
    if not pairs:
        return
    several = document["runs"] > 1
    head = ["cost/step", "order", "local.", "missed", "false", "switch", "steps -/+"]
    yield Sheet(
        head=(f"vs {first}", *head, *(["runs -/+"] if several else [])),
        rows=[
            (
                pair["second"],
                "+0" if pair["verdict"] == "equal" else _between(low, high, "+"),
                ORDERS[pair["verdict"]],
                *(f"{pair['per_step'][name]:+.3g}" for name in PARTS),
                f"{pair['steps']['better']}/{pair['steps']['worse']}",
                *([f"{pair['per_run']['second_less']}/{pair['per_run']['first_less']}"]
                  if several else []),
            )
            for pair in pairs
            for low, high in [pair["per_step"]["total"]]
        ],
    )  # fmt: skip


def opposed(document: Document) -> Iterator[str]:
    """Warnings: pairs whose mean totals are the other way round, for runs differ in length."""
    for pair in document["pairs"]:
        if pair["opposed"]:
            yield (
                f"warning: {pair['first']} is before {pair['second']} by TGOSPA per step, in "
                "which each run counts the same, but has the larger mean total, in which long runs "
                "count more"
            )


def _against_sheets(document: Document) -> Iterator[Sheet]:
    """TGOSPA, per-step GOSPA, and the two rules, for each estimate."""
    order = document["parameters"]["order"]
    rows = []
    for item in document["estimates"]:
        step = item["per_step_gospa"]
        if step is None:
            return
        name = f"{item['name']}: " if len(document["estimates"]) > 1 else ""
        rows.append((f"{name}TGOSPA", item["total"], item["counts"]["switch"], None))
        rows.append((f"{name}GOSPA, summed", step["total"], None, None))
        for rule, title in RULES.items():
            rows.append((
                f"{name}{title}", step[rule]["total"], step[rule]["switches"], step[rule]["mean"]
            ))  # fmt: skip
    yield Sheet(
        head=("sum over steps of values^p", "total", "root", "switches", "mean of steps"),
        rows=[
            (
                name,
                f"{total:.6g}",
                f"{total ** (1 / order):.6g}",
                "" if count is None else f"{count:.6g}",
                "" if mean is None else f"{mean:.5g}",
            )
            for name, total, count, mean in rows
        ],
    )


def _estimate_remarks(document: Document) -> Iterator[str]:
    estimates = document["estimates"]
    for item in estimates:
        for number, made in enumerate(item["runs"], start=1):
            if not made["finished"]:
                run = f" run {number}" if document["runs"] > 1 else ""
                yield f"{item['name']}{run}: {made['status']}"
    if len(estimates) > 1:
        found = {pair["verdict"] for pair in document["pairs"]}
        yield "; ".join(
            [
                *(text for verdict, text in PROOFS.items() if verdict in found),
                "steps -/+: at how many the estimate costs less or more than the first",
            ]
        )
    yield SPLIT
    yield from opposed(document)
    name = f"{estimates[0]['name']}: " if len(estimates) > 1 else ""
    for sentence in estimates[0].get("differences", ()):
        yield name + sentence
    if estimates[0]["per_step_gospa"] is not None:
        yield TIES


def _between(low: float, high: float, sign: str = "") -> str:
    """One number if both are the same as they are shown, else both."""
    texts = [f"{value:{sign}.6g}" for value in (low, high)]
    return texts[1] if texts[0] == texts[1] else " to ".join(texts)


def _place(item: Document, pairs: list[Document]) -> str:
    """The range of places that are possible, or the only one, with = if it is shared."""
    best, worst = item["place"]
    if best < worst:
        return f"{best}-{worst}"
    shared = any(
        pair["verdict"] == "equal" and item["name"] in (pair["first"], pair["second"])
        for pair in pairs
    )
    return f"{best}=" if shared else f"{best}"


# --- study ----------------------------------------------------------------------------------------


def study_page(document: Document) -> Page:
    """Solvers on made-up scenes of many sizes."""
    return Page(
        kind="Scaling study on simulated scenes; on your files: tgospa-eval compare TRUTH A",
        title=_study_title(document),
        lines=list(_study_lines(document)),
        sheets=[_study_sheet(document), _study_rms(document)],
        remarks=list(_study_remarks(document)),
    )


def study_report(document: Document, pictures: list[str]) -> str:
    """The report as Markdown, with its pictures."""
    shown = "\n\n".join(f"![{CAPTIONS[name]}]({name}.png)" for name in pictures)
    return f"# Scaling study\n\n{as_markdown(study_page(document))}" + (
        f"\n{shown}\n" if shown else ""
    )


CAPTIONS = {
    "error_over_epsilon": "Error of sinkhorn by temperature, mean and one standard deviation",
    "scaling": "Time and error over targets and over steps, mean and one standard deviation",
}
"""What the pictures of a study show, by name."""


def study_table(document: Document) -> Table:
    """A row for each size and solver, plain numbers."""
    rows = [(size, made) for size in document["sizes"] for made in size["solvers"]]
    table: Table = {
        "targets": [size["targets"] for size, _ in rows],
        "steps": [size["steps"] for size, _ in rows],
        "states": [size["states"]["mean"] for size, _ in rows],
        "name": [made["name"] for _, made in rows],
        "solver": [made["solver"] for _, made in rows],
        "epsilon": [made["epsilon"] for _, made in rows],
    }
    for name in ("seconds", "error", "lower_error", "iterations"):
        for kind in ("mean", "deviation", "max"):
            table[f"{name}_{kind}"] = [made[name][kind] for _, made in rows]
    for name in ("infinite_errors", "failed", "unfinished"):
        table[name] = [made[name] for _, made in rows]
    return table | {"left_out": [size["left_out"] for size, _ in rows]}


def _study_title(document: Document) -> str:
    sizes, runs = document["sizes"], document["runs"]
    if document["contradictions"]:
        targets, steps, run, a, b = document["contradictions"][0]
        return (
            f"The brackets of {a} and {b} do not overlap in run {run} of {targets} targets and "
            f"{steps} steps, and there may be more: one of these proofs is wrong. This is an error "
            "of this program; please report it"
        )
    done = (
        f"{_count(len(sizes) * runs, 'scene')} of {_count(len(sizes), 'size')}, "
        f"{_count(runs, 'run')}{' each' if len(sizes) > 1 else ''}"
    )
    if any(made["failed"] for size in sizes for made in size["solvers"]):
        return f"{done}: solvers failed, all brackets that there are overlap"
    return f"{done}: all brackets overlap" if len(sizes[0]["solvers"]) > 1 else done


def _study_lines(document: Document) -> Iterator[str]:
    scene, tracker, parameters = (document[name] for name in ("scene", "tracker", "parameters"))
    yield (
        f"scenario {scene['scenario']}, area {scene['area']:g}; noise {tracker['noise']:g}, "
        f"detection {tracker['detection']:g}, swaps {tracker['swaps']:g}, fragmentation "
        f"{tracker['fragmentation']:g}, false tracks {tracker['false_rate']:g} a step; "
        f"seed {document['seed']}"
    )
    yield _parameters(parameters | {"unit": None})
    yield document["machine"]


def _study_sheet(document: Document) -> Sheet:
    """Time and error; mean and standard deviation over the runs."""
    rows = []
    for size in document["sizes"]:
        for k, made in enumerate(size["solvers"]):
            rows.append((
                made["name"],
                *((str(size["targets"]), str(size["steps"])) if not k else ("", "")),
                _number(made["seconds"]["mean"], ".3g"),
                _deviation(made["seconds"], ".2g"),
                _error(made["error"]["mean"]),
                _deviation(made["error"], ".0e"),
                _error(made["lower_error"]["mean"]),
                _number(made["iterations"]["mean"], ".0f"),
            ))  # fmt: skip
    return Sheet(
        head=("solver", "m", "T", "seconds", "+-", "error", "+-", "bound's", "iter."), rows=rows
    )


def _study_rms(document: Document) -> Sheet:
    """The metric itself: roots per step, RMS over runs."""
    mean = "RMS" if document["parameters"]["order"] == 2 else "mean"
    return Sheet(
        head=(f"per step, {mean} of runs", "TGOSPA", "localisation", "missed", "false", "switch"),
        rows=[
            (
                f"m = {size['targets']}, T = {size['steps']}",
                *(_number(size["normalised"][name], ".5g") for name in ("tgospa", *PARTS)),
            )
            for size in document["sizes"]
        ],
    )


def _study_remarks(document: Document) -> Iterator[str]:
    yield (
        "m targets, T steps; seconds of solving and proof; error: the total is at most so much "
        "above the true one, relative; bound's: the lower bound is at most so much below it; "
        "+- one standard deviation over the runs"
    )
    yield SPLIT
    for size in document["sizes"]:
        where = f"{_count(size['targets'], 'target')}, {_count(size['steps'], 'step')}"
        if size["left_out"]:
            yield (
                f"{where}: {_count(size['left_out'], 'scene')} left out of the values per step, "
                "for brackets contradict each other or there is none; contradicting ones are left "
                "out of times and errors too"
            )
        for made in size["solvers"]:
            kinds = (
                ("failed", "failed"),
                ("unfinished", "not finished"),
                ("infinite_errors", "error without bound, not in its mean,"),
            )
            for name, fact in kinds:
                if made[name]:
                    yield f"{made['name']}, {where}: {fact} in {_count(made[name], 'run')}"


def _deviation(values: Document, form: str) -> str:
    value = values["deviation"]
    return "-" if value is None else ("0" if value < EXACT else f"{value:{form}}")


# --- words ----------------------------------------------------------------------------------------


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"


def _error(value: float | None) -> str:
    if value is None:
        return "-"
    return f"<{EXACT:g}" if value < EXACT else f"{value:.1e}"


def _unit(parameters: Document) -> str:
    return f" {parameters['unit']}" if parameters["unit"] else ""


def _size(sizes: Document) -> str:
    return (
        f"{_count(sizes['truth'], 'truth')}, {_count(sizes['estimates'], 'estimate')}, "
        f"{_count(sizes['steps'], 'step')}; {_count(sizes['states'], 'reduced state')} in "
        f"{_count(sizes['components'], 'component')}"
    )


def _parameters(parameters: Document) -> str:
    unit = _unit(parameters)
    return (
        f"c = {parameters['cutoff']:g}{unit}, p = {parameters['order']:g}, "
        f"gamma = {parameters['switch_penalty']:g}{unit}, {parameters['distance']}"
    )


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}" + ("" if number == 1 else "s")


PAGES = {
    "solvers": (solvers_page, solvers_page, solvers_table),
    "estimates": (estimates_page, estimates_paper, estimates_table),
    "study": (study_page, study_page, study_table),
}
"""Page, page for a paper, and main table of each kind of document."""
