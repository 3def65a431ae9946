"""The tables of what is stored."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from statistics import median

import batch
import curve
import exactness
import gaussian
import grid
import growth
import kernel
import limits
import memory
import page
import partitioned
import scale
import startup
from grid import stored
from machine import commit, describe
from methods import (
    BRACKET,
    COLDEST,
    EXACT_MOST,
    LP_LIMIT,
    NAIVE_MOST,
    PUBLISHED_MOST,
    SLOW_LIMIT,
    Reading,
    naive_size,
)
from scenes import Scene
from store import Store, Values
from tables import Table

from tgospa_eval.common.words import parsed_size

TWICE = 2.0
"""The certified solver is to take at most so many times what the bracket takes."""

MEGA = 1e6
ABSENT = "-"

SHORT = {
    "certified": "certified",
    "bracket": "1 %",
    "lp": "LP",
    "lp without presolve": "LP plain",
    "exact": "exact",
    "naive": "naive",
    "published": "published",
    "stone soup": "Stone Soup",
    "floor": "floor",
}


@dataclass(frozen=True)
class Number:
    """A number that may be known only to be above or below."""

    value: float
    above: bool = False
    below: bool = False

    def __str__(self) -> str:
        sign = "? " if self.above and self.below else "> " * self.above + "< " * self.below
        digits = max(0, 2 - math.floor(math.log10(self.value))) if self.value > 0 else 0
        return f"{sign}{self.value:.{digits}f}"


def machine() -> Table:
    """What was measured on what."""
    rows = [*describe().items(), ("commit", commit() or "unknown")]
    return Table("Machine", ("part", "value"), rows)


def of_grid(scenes: Sequence[Scene], seeds: int, store: Store) -> list[Table]:
    """Seconds, ratios, and the comparison of certified and bracket from the problem."""
    return [
        _seconds(scenes, seeds, store),
        _ratios(scenes, seeds, store),
        _from_problem(scenes, seeds, store),
    ]


def _seconds(scenes: Sequence[Scene], seeds: int, store: Store) -> Table:
    rows = []
    for scene in scenes:
        count = sum(stored(scene, seed, "certified", store) is not None for seed in range(seeds))
        cells = (_middle(_times(scene, seeds, method, store)) for method in SHORT)
        rows.append((str(scene), str(count), *cells))
    return Table(
        "Seconds for a whole evaluation, medians over seeds",
        ("m,T,area,noise", "seeds", *SHORT.values()),
        rows,
        (
            "certified: tgospa_eval.evaluate with its defaults, exact with proof",
            f"1 %: Sinkhorn(epsilon={COLDEST:g}, gap={BRACKET:g}), to a proven bracket",
            "LP: the unmerged gain form by scipy.optimize.linprog(method='highs-ds'), "
            f"{LP_LIMIT:g} s at most",
            "LP plain: the same with presolve off",
            "exact: evaluate with solver='exact' (CVXPY, Clarabel), not started above "
            f"{EXACT_MOST:,} gains, {SLOW_LIMIT:g} s at most",
            "naive: the dense programme of the definition in CVXPY, by Clarabel, killed after "
            f"{SLOW_LIMIT:g} s; above {NAIVE_MOST:,} variables it is not even started",
            "published: the Python code of the authors of the metric, given by --published, killed "
            f"after {SLOW_LIMIT:g} s; not started above {PUBLISHED_MOST:,} variables",
            "Stone Soup: its GOSPA, per step, no switches: a lower bound; killed after "
            f"{SLOW_LIMIT:g} s",
            "floor: the table of all distances, numpy.linalg.norm(x[:, :, None] - y[:, None])",
            f"Best of up to {grid.ROUNDS} runs, as many as begin within {grid.QUICK:g} s; above "
            f"{grid.SLOW:g} s on the first seed only.",
        ),
    )


def _ratios(scenes: Sequence[Scene], seeds: int, store: Store) -> Table:
    others = ("lp", "lp without presolve", "exact", "naive", "published", "stone soup")
    pairs = [(method, "certified") for method in others]
    pairs += [("certified", "bracket"), ("certified", "floor")]
    rows = [
        (str(scene), *(_middle(_quotients(scene, seeds, *pair, store)) for pair in pairs))
        for scene in scenes
    ]
    header = [f"{SHORT[a]}/{SHORT[b]}".replace("certified", "cert") for a, b in pairs]
    return Table(
        "Ratios of the seconds above, medians over seeds", ("m,T,area,noise", *header), rows
    )


def _from_problem(scenes: Sequence[Scene], seeds: int, store: Store) -> Table:
    rows = []
    within = 0
    for scene in scenes:
        methods = ("certified from problem", "bracket from problem")
        quotients = _quotients(scene, seeds, *methods, store)
        if quotients and median(number.value for number in quotients) <= TWICE:
            within += 1
        gaps = [
            (reading.upper - reading.lower) / reading.upper
            for seed in range(seeds)
            if (reading := stored(scene, seed, methods[1], store))
        ]
        times = (_middle(_times(scene, seeds, method, store)) for method in methods)
        gap = f"{max(gaps):.2%}" if gaps else ABSENT
        rows.append((str(scene), *times, _middle(quotients), gap))
    return Table(
        "From the same Problem, preparation and proof included",
        ("m,T,area,noise", "certified s", "1 % bracket s", "ratio", "widest bracket"),
        rows,
        (
            f"Certified takes at most {TWICE:g} x what the bracket takes in {within} of "
            f"{len(rows)} settings.",
        ),
    )


def _times(scene: Scene, seeds: int, method: str, store: Store) -> list[Number]:
    readings = (_known(scene, seed, method, store) for seed in range(seeds))
    return [Number(r.seconds, above=not r.complete) for r in readings if r is not None]


def _known(scene: Scene, seed: int, method: str, store: Store) -> Reading | None:
    """What was measured; a naive programme that is too large to be started counts as too slow."""
    if method == "naive" and seed == 0 and naive_size(scene) > NAIVE_MOST:
        return Reading(SLOW_LIMIT, complete=False)
    return stored(scene, seed, method, store)


def _quotients(scene: Scene, seeds: int, over: str, under: str, store: Store) -> list[Number]:
    """Ratios on the seeds on which both were measured."""
    found = []
    for seed in range(seeds):
        a, b = _known(scene, seed, over, store), _known(scene, seed, under, store)
        if a is not None and b is not None:
            ratio = a.seconds / b.seconds
            found.append(Number(ratio, above=not a.complete, below=not b.complete))
    return found


def _middle(numbers: Sequence[Number]) -> str:
    """Median; a bound if any of the numbers is one."""
    if not numbers:
        return ABSENT
    return str(
        Number(
            median(number.value for number in numbers),
            above=any(number.above for number in numbers),
            below=any(number.below for number in numbers),
        )
    )


def of_growth(series: dict[str, tuple[Scene, ...]], store: Store) -> list[Table]:
    """Seconds of all methods over targets and steps, and how much longer others take."""
    rows = []
    for scene in dict.fromkeys(chain(*series.values())):
        found = [growth.known(scene, method, store) for method in growth.METHODS]
        own = found[0]
        if own is None:
            continue
        numbers = [
            ABSENT if r is None else str(Number(r.seconds, above=not r.complete)) for r in found
        ]
        ratios = [
            ABSENT if r is None else str(Number(r.seconds / own.seconds, above=not r.complete))
            for r in found[2:]
        ]
        each = Number(own.seconds / own.states * 1e9) if own.states else ABSENT
        rows.append((str(scene), f"{own.states:,}", str(each), *numbers, *ratios))
    labels = list(growth.METHODS.values())
    header = (
        *("m,T,area,noise", "states", "ns a state"),
        *(f"{label} s" for label in labels),
        *(f"{label} / certified" for label in labels[2:]),
    )
    notes = (
        "ns a state: of the whole evaluation from arrays, proof included, by certified",
        ">: stopped before the end, or the bracket is wider than 1 % at the end",
    )
    return [Table("Growth, first draws", header, rows, notes)] if rows else []


def of_kernel(scenes: Sequence[Scene], store: Store) -> list[Table]:
    """Nanoseconds of the sweeps."""
    rows = [
        (str(scene), f"{found['nanoseconds']:.1f}", f"{kernel.TARGET:g}")
        for scene in scenes
        if (found := store.get(kernel.PART, str(scene))) is not None
    ]
    header = ("m,T,area,noise", "ns per state and half sweep", "target")
    return [Table("Kernel", header, rows)] if rows else []


def of_gaussian(cases: Sequence[str], store: Store) -> list[Table]:
    """Seconds by either distance, and their ratio."""
    rows = [
        (
            case,
            f"{found['pairs']:,}",
            *(f"{found[name]:.2f}" for name in ("euclidean", "gaussian-wasserstein")),
            f"{found['gaussian-wasserstein'] / found['euclidean']:.2f}",
            f"{gaussian.TARGET:g}",
        )
        for case in cases
        if (found := store.get(gaussian.PART, case)) is not None
    ]
    header = ("scene", "near pairs", "means s", "laws s", "ratio", "at most")
    return [Table("Normal laws in the plane", header, rows)] if rows else []


def of_memory(cases: Sequence[memory.Case], store: Store) -> list[Table]:
    """Bytes per gain or run."""
    found = [(str(case), store.get(memory.PART, str(case))) for case in cases]
    rows = [_memory_row(name, values) for name, values in found if values is not None]
    header = (
        *("truths x steps, area", "components", "gains and runs", "input MB"),
        *("peak MB", "bytes each", "s"),
    )
    return [
        Table(
            "Memory",
            header,
            rows,
            (
                "Bytes each: peak of an evaluation beyond what the process holds with the input "
                f"read, for each gain or run; target {memory.TARGET}. Killed after "
                f"{memory.LIMIT:g} s.",
            ),
        )
    ][: len(rows)]


def _memory_row(name: str, found: Values) -> list[str]:
    if not found["complete"]:
        return [name, *[ABSENT] * 5, str(Number(memory.LIMIT, above=True))]
    beyond = found["peak_bytes"] - found["input_bytes"]
    return [
        name,
        f"{found['components']:,}",
        f"{found['states']:,}",
        f"{found['input_bytes'] / MEGA:,.0f}",
        f"{found['peak_bytes'] / MEGA:,.0f}",
        f"{beyond / found['states']:.0f}",
        str(Number(found["seconds"])),
    ]


def of_page(scenes: Sequence[Scene], store: Store) -> list[Table]:
    """Seconds and size of the HTML report."""
    found = [(scene, store.get(page.PART, str(scene))) for scene in scenes]
    header = ("m,T,area,noise", "page s", "evaluation s", "ratio", "plotly s", "allowed s", "MB")
    return [
        Table(
            "HTML report",
            header,
            [_page_row(scene, values) for scene, values in found if values is not None],
            (
                f"Allowed: {page.SHARE:g} of the evaluation or {page.IMPORTS:g} imports of "
                "plotly.graph_objects in a new process, if it is installed, whichever is more; "
                f"{page.BYTES / MEGA:g} MB. Best of {page.ROUNDS} runs in turn.",
            ),
        )
    ]


def _page_row(scene: Scene, found: Values) -> list[str]:
    plotly = found["plotly"]
    allowed = max(page.SHARE * found["evaluation"], page.IMPORTS * (plotly or 0.0))
    return [
        str(scene),
        str(Number(found["page"])),
        str(Number(found["evaluation"])),
        f"{found['page'] / found['evaluation']:.2f}",
        str(Number(plotly)) if plotly else ABSENT,
        str(Number(allowed)),
        f"{found['bytes'] / MEGA:.2f}",
    ]


def of_curve(scenes: Sequence[Scene], store: Store) -> list[Table]:
    """The curve in single evaluations."""
    found = [(scene, store.get(curve.PART, str(scene))) for scene in scenes]
    return [
        Table(
            "Normalised curve",
            ("m,T,area,noise", "evaluation s", "curve s", "ratio", "not exact"),
            [
                [
                    str(scene),
                    str(Number(values["evaluation"])),
                    str(Number(values["curve"])),
                    f"{values['curve'] / values['evaluation']:.1f}",
                    str(values["wide"]),
                ]
                for scene, values in found
                if values is not None
            ],
            (
                f"The curve is what it takes beyond the evaluation; asked are {curve.MOST:g} "
                f"evaluations. Best of {curve.ROUNDS} runs in turn, all cores.",
            ),
        )
    ]


def of_scale(scenes: Sequence[Scene], store: Store) -> list[Table]:
    """Wall time and memory of the command."""
    found = [(scene, store.get(scale.PART, str(scene))) for scene in scenes]
    header = ("truths x steps, area", "rows", "MB", "wall s", "peak MB")
    stages = ("gains", "read s", "solve s", "proof s", "gap")
    return [
        Table(
            "The command on large files",
            (*header, *stages),
            [_scale_row(scene, values) for scene, values in found if values is not None],
            (
                "tgospa-eval truth.csv estimate.csv -c 5 -g 2 --format json -q, killed after "
                f"{scale.LIMIT:g} s",
            ),
        )
    ]


def _scale_row(scene: Scene, found: Values) -> list[str]:
    row = [
        f"{scene.targets:,} x {scene.steps:,}, {scene.area:g}",
        f"{found['rows']:,}",
        f"{found['bytes'] / MEGA:.0f}",
        str(Number(found["seconds"], above=not found["complete"])),
        f"{found['peak_bytes'] / MEGA:,.0f}",
    ]
    if not found["complete"]:
        return [*row, *[ABSENT] * 5]
    stages = (str(Number(found[stage])) for stage in ("read", "solve", "certify"))
    return [*row, f"{found['pair_steps']:,}", *stages, f"{found['relative_gap']:.0e}"]


def of_batch(cases: Sequence[batch.Case], store: Store) -> list[Table]:
    """A batch against a loop."""
    rows = []
    for case in cases:
        found = store.get(batch.PART, str(case))
        if found is None:
            continue
        loop, spent = case.pairs * found["loop"], found["batch"]
        rows.append(
            (
                str(case),
                f"{loop:.0f}",
                f"{spent:.1f}",
                f"{loop / spent:.1f}",
                f"{1 - found['jobs'] / batch.WORKERS / spent:.0%}",
                f"{found['again']:.1f}",
                f"{found['peak'] / 1e6:.0f}",
            )
        )
    return [
        Table(
            "Many small evaluations",
            ("pairs", "loop s", "batch s", "loop/batch", "overhead", "again s", "MB"),
            rows,
            (
                f"loop: one command after the other, from {2 * batch.LOOPED} of them, half before "
                f"and half after the batch; batch: {batch.WORKERS} processes; overhead: what is "
                "not work on jobs, of the time on the wall; again: the same command when all is "
                "done, and the memory of its process.",
            ),
        )
    ]


def of_partitioned(cases: Sequence[partitioned.Recording], store: Store) -> list[Table]:
    """Recordings in parts."""
    rows = []
    for case in cases:
        found = store.get(partitioned.PART, str(case))
        if found is None:
            continue
        smallest = min((c for c in cases if c.kind == case.kind), key=lambda c: c.rows)
        least = store.get(partitioned.PART, str(smallest)) or found
        growth = "-"
        if smallest != case:
            times = found["parts"] / least["parts"]
            growth = f"{math.log(times) / math.log(case.rows / smallest.rows):.2f}"
        whole = "whole" in found
        rows.append(
            (
                str(case),
                f"{found['simulate']:.1f}",
                f"{found['parts']:.1f}",
                growth,
                f"{found['parts_peak'] / 1e6:.0f}",
                f"{found['parts'] / found['whole']:.2f}" if whole else "-",
                f"{found['parts_alone'] / found['parts']:.2f}",
                f"{found['whole_alone'] / found['whole']:.2f}" if whole else "-",
            )
        )
    return [
        Table(
            "Recordings in parts",
            ("rows", "simulate s", "s", "growth", "MB", "/whole", "1/2 jobs", "1/2 jobs, whole"),
            rows,
            (
                f"s: evaluated in parts by {partitioned.JOBS} processes with --memory "
                f"{partitioned.MEMORY}; growth: exponent of that time from the fewest rows on; MB: "
                "peak of the largest process; /whole: against the same rows in memory; 1/2 jobs: "
                "time with one job over time with two.",
            ),
        )
    ]


def of_limits(cases: Sequence[partitioned.Recording], store: Store) -> list[Table]:
    """Peaks against limits of memory."""
    rows = []
    for case in cases:
        found = store.get(limits.PART, str(case)) or {}
        for kind in limits.INPUTS if found else ():
            row = [f"{case}, {' '.join(kind)}"]
            for limit in limits.LIMITS:
                peak = found[" ".join((*kind, limit))]
                refused = isinstance(peak, str)
                ratio = peak.split()[-1] if refused else f"{peak / parsed_size(limit):.2f}"
                row.append(ratio)
            rows.append(row)
    return [
        Table(
            "Peak memory of all processes over --memory",
            ("rows a side, files", *limits.LIMITS),
            rows,
            (f"{limits.JOBS} jobs at most; a size: what the limit is refused with.",),
        )
    ]


def of_startup(store: Store) -> list[Table]:
    """Seconds in a new process."""
    found = store.get(startup.PART)
    if found is None:
        return []
    needs, gate_needs = (", ".join(found[name]) for name in ("needs", "gate_needs"))
    rows = [
        (f"tgospa-eval on {found['rows']} rows", found["evaluate"], found["imports"]),
        (
            f"tgospa-eval gate on {startup.GATED.targets} x {startup.GATED.estimates} x "
            f"{startup.GATED.steps}",
            found["gate"],
            found["gate_imports"],
        ),
        *(
            [("the same with --junit and --github", found["gate_reports"], found["gate_imports"])]
            if "gate_reports" in found
            else []
        ),
        ("tgospa-eval --help", found["help"], found["python"]),
    ]
    return [
        Table(
            "Start-up",
            ("command", "s", "base s", "ratio"),
            [(name, f"{a:.3f}", f"{b:.3f}", f"{a / b:.2f}") for name, a, b in rows],
            (
                f"Base: python -c 'import {needs}', 'import {gate_needs}', and pass. Medians of "
                f"{startup.RUNS} runs in turn.",
            ),
        )
    ]


def of_exactness(plan: exactness.Plan, store: Store) -> list[Table]:
    """Counts of faults of each family."""
    rows, totals = [], [0] * len(EXACTNESS)
    slowest, worst = 0.0, [0.0, 0.0]
    for family, count in plan.counts().items():
        found = [
            values
            for index in range(count)
            if (values := exactness.stored(family, plan.seed, index, store))
        ]
        done = [values for values in found if "failed" not in values]
        counts = [
            len(found),
            sum(values["certified"] for values in done),
            sum(values["within_rounding"] for values in done),
            sum(values["wrong"] for values in done),
            sum(values["above"] > 0 for values in done),
            sum(values["below"] > 0 for values in done),
            sum(not values["certified"] for values in done),
            len(found) - len(done),
        ]
        seconds = max((values["seconds"] for values in done), default=0.0)
        beyond = [max((v[name] for v in done), default=0.0) for name in ("above", "below")]
        rows.append((family, *_exactness_cells(counts, beyond, seconds)))
        totals = [a + b for a, b in zip(totals, counts, strict=True)]
        slowest, worst = max(slowest, seconds), [*map(max, worst, beyond)]
    rows.append(("all", *_exactness_cells(totals, worst, slowest)))
    return [
        Table(
            f"Exactness, seed {plan.seed}",
            ("family", *EXACTNESS, "worst above", "worst below", "slowest s"),
            rows,
            (
                "exact: called exact; rounding: those of them that are excused by rounding",
                f"off: called exact, and off by more than {float(exactness.GAP):g} of the cost",
                "above: the lower bound is above the exact optimum, by whatever little, as cost or "
                "as printed; below: the upper bound is below it; worst: relative to the cost",
                f"open: not proven within {exactness.LIMIT:g} s; failed: no result at all",
                "tiny: 2 to 3 tracks, 1 to 4 steps; small: 2 to 5 tracks, 1 to 20 steps, c 2 to "
                "10^6 times the largest distance; wild: every kind, unit and order, c to 10^100 "
                "distances",
            ),
        )
    ]


EXACTNESS = ("scenes", "exact", "rounding", "off", "above", "below", "open", "failed")


def _exactness_cells(counts: list[int], worst: list[float], seconds: float) -> list[str]:
    return [*map(str, counts), *(f"{x:.1e}" if x else "0" for x in worst), f"{seconds:.2f}"]
