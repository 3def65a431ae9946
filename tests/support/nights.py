"""Simulated nights of a team's gate: 48 runs of trackers, judged by a baseline.

The pool of values is real: each run is a scene of `simulate`, reported by a tracker with other
random numbers and evaluated, and so are runs that crashed. A night draws one of each run from the
pool. A worse tracker is a factor on costs; so `python tests/support/nights.py` has thousands of
nights in minutes. It prints more rows and columns than the table of docs/reference/gate.md.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tgospa_eval import Trajectories, evaluate
from tgospa_eval.campaign.gate.baseline import Baseline, Measured, make_entry, measured, with_nights
from tgospa_eval.campaign.gate.groups import judge_groups
from tgospa_eval.campaign.gate.jumps import FALSE_ALARMS as FALSE_ALARMS
from tgospa_eval.campaign.gate.outcome import PairOutcome
from tgospa_eval.campaign.gate.rules import PARTS, Verdict
from tgospa_eval.campaign.gate.suite import GroupTable, make_group
from tgospa_eval.campaign.row import row_to_judge
from tgospa_eval.simulation import Scene, Tracker, simulate

SCENES = {
    **{name: Scene(scenario=name) for name in ("crossing", "parallel", "convoy", "dense")},
    **{name: Scene(scenario=name) for name in ("births", "manoeuvring")},
    "few": Scene(scenario="crossing", targets=2),
    "many": Scene(scenario="dense", targets=10),
}
SEEDS = 6
TRACKER = Tracker(
    noise=1.5, detection=0.95, swaps=0.3, merges=0.1, fragmentation=0.01, false_rate=0.05
)
NAMES = [f"{scene}/{seed}" for scene in SCENES for seed in range(SEEDS)]
LABELS = {name: dict(zip(("scene", "seed"), name.split("/"), strict=True)) for name in NAMES}
CONFIDENCE = GroupTable.confidence
TABLE = make_group("{scene}", [["total:+2%"], [], []], CONFIDENCE, "seed", {*LABELS[NAMES[0]]}, "")


class Streams:
    """Random numbers whose first streams make the truth, the others what the tracker reports."""

    def __init__(self, truth: Sequence[int], tracker: Sequence[int]) -> None:
        self.seeds = truth, tracker

    def spawn(self, count: int) -> list[np.random.Generator]:
        first, others = map(np.random.default_rng, self.seeds)
        return [*first.spawn(2), *others.spawn(count - 2)]


@dataclass(frozen=True)
class Pool:
    """Values of runs by name: of many nights, without a row, and of runs that crashed midway."""

    nights: Mapping[str, Sequence[Measured]]
    empty: Mapping[str, Measured]
    crashed: Mapping[str, Sequence[Measured]]


def judged(truth: Trajectories, estimate: Trajectories) -> Measured:
    with warnings.catch_warnings():  # nothing, or half of it, is there on purpose
        warnings.simplefilter("ignore")
        return measured(row_to_judge(evaluate(truth, estimate, cutoff=10, switch_penalty=5)))


def until(estimate: Trajectories, share: float) -> Trajectories:
    """What a tracker wrote before it crashed."""
    kept = estimate.step < share * len(estimate.times)
    return replace(
        estimate, step=estimate.step[kept], track=estimate.track[kept], state=estimate.state[kept]
    )


def pool(nights: int) -> Pool:
    found: dict[str, list[Measured]] = {name: [] for name in NAMES}
    empty, crashed = {}, {}
    for place, (scene, made) in enumerate(SCENES.items()):
        for seed in range(SEEDS):
            name = f"{scene}/{seed}"
            for night in range(nights):
                streams = Streams([place, seed], [place, seed, night, 7])
                truth, estimate = simulate(made, TRACKER, streams)  # type: ignore[arg-type]
                found[name].append(judged(truth, estimate))
            empty[name] = judged(truth, until(estimate, 0.0))
            crashed[name] = [judged(truth, until(estimate, share)) for share in (0.1, 0.3, 0.5)]
    return Pool(found, empty, crashed)


def worse(one: Measured, factor: float) -> Measured:
    """The same with costs that many times as large."""
    values = {
        path: replace(value, lower=factor * value.lower, upper=factor * value.upper)
        if path in ("total", *PARTS)
        else value
        for path, value in one.values.items()
    }
    return replace(one, values=values)


def with_failures(runs: Pool, seed: int = 1) -> Pool:
    """The same of a tracker that now and then fails: one run of fifty costs three times as much."""
    rng = np.random.default_rng(seed)
    nights = {
        name: [worse(one, 3.0 if rng.random() < 0.02 else 1.0) for one in found]
        for name, found in runs.nights.items()
    }
    return replace(runs, nights=nights)


Change = Callable[[dict[str, Measured], Pool, np.random.Generator], None]


def tracker(factor: float) -> Change:
    def change(now: dict[str, Measured], _: Pool, __: np.random.Generator) -> None:
        now |= {name: worse(one, factor) for name, one in now.items()}

    return change


def scene(factor: float, which: str | None = None) -> Change:
    def change(now: dict[str, Measured], _: Pool, rng: np.random.Generator) -> None:
        chosen = which or str(rng.choice([*SCENES]))
        own = {name: one for name, one in now.items() if LABELS[name]["scene"] == chosen}
        now |= {name: worse(one, factor) for name, one in own.items()}

    return change


def silent(now: dict[str, Measured], pool: Pool, rng: np.random.Generator) -> None:
    name = str(rng.choice(NAMES))
    now[name] = pool.empty[name]


def crash(share: int) -> Change:
    def change(now: dict[str, Measured], pool: Pool, rng: np.random.Generator) -> None:
        name = str(rng.choice(NAMES))
        now[name] = pool.crashed[name][share]

    return change


def night(
    pool: Pool, rng: np.random.Generator, change: Change, *, before: int
) -> list[PairOutcome]:
    """The groups of one night, against a baseline of so many others."""
    now: dict[str, Measured] = {}
    old: Baseline = {}
    for name, runs in pool.nights.items():
        first, *others = rng.choice(len(runs), 1 + before, replace=False)
        now[name] = runs[first]
        for other in others:
            old[name] = with_nights(make_entry(runs[other], {}, LABELS[name]), old.get(name))
    change(now, pool, rng)
    return judge_groups([TABLE], now, old, LABELS)


def red(
    pool: Pool, change: Change, *, before: int, nights: int, seed: int = 0
) -> tuple[float, float]:
    """Shares of nights that fail, and that fail by a jump or a dead run."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(nights):
        failed = [
            one
            for outcome in night(pool, rng, change, before=before)
            for one in outcome.findings
            if one.verdict is Verdict.FAIL
        ]
        jumps = any(one.inference is None or one.inference.jump for one in failed)
        found.append((bool(failed), jumps))
    shares = np.mean(found, axis=0)
    return float(shares[0]), float(shares[1])


CHANGES: dict[str, Change] = {
    "equal": tracker(1.0),
    "3 % worse": tracker(1.03),
    "8 % worse": tracker(1.08),
    "20 % worse": tracker(1.2),
    "a scene worse by 2": scene(2.0),
    "the noisiest scene worse by 2": scene(2.0, "few"),
    "a scene worse by 3": scene(3.0),
    "a seed without a row": silent,
    "a seed that crashed after 10 %": crash(0),
    "a seed that crashed after 30 %": crash(1),
    "a seed that crashed half way": crash(2),
}


def main(nights: int = 400) -> None:
    runs = pool(60)
    failing = with_failures(runs)
    print("| night | baseline of 1 night | of 5 nights |\n|---|---|---|")
    for name, change in CHANGES.items():
        count = nights * (10 if name == "equal" else 1)
        cells = [red(runs, change, before=before, nights=count) for before in (1, 5)]
        texts = (f"{100 * share:.2f} % ({100 * jumps:.2f} %)" for share, jumps in cells)
        print(f"| {name} | {' | '.join(texts)} |", flush=True)
    cells = [red(failing, tracker(1.0), before=before, nights=4 * nights) for before in (1, 5)]
    print(f"| equal, one run of fifty costs 3 times as much | {cells}")


if __name__ == "__main__":
    main()
