"""Components in windows: the bracket of the whole, whatever the windows, or an honest one."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.partitioned.long.run import ComponentBounds, solve_long
from tgospa_eval.partitioned.long.windows import solve_window
from tgospa_eval.partitioned.shards import (
    ENTRY,
    EXCUSED_ESTIMATE,
    IGNORED_TRUTH,
    PARTS_OF_TRACKS,
    PartialSums,
    problem_of,
)
from tgospa_eval.partitioned.tasks import Run, Task, run_tasks
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Bounds, Breakdown
from tgospa_eval.problem.states import connected_components
from tgospa_eval.problem.weights import ONE
from tgospa_eval.solvers.certified import Certified

Entries = NDArray[np.void]


def walkers(seed: int, steps: int, *, masked: bool = False) -> tuple[Entries, Parameters]:
    """The largest component of random walks and estimates of them that change whom they follow.

    `masked`: some states are not judged.
    """
    rng = np.random.default_rng(seed)
    truths, estimates = (int(number) for number in rng.integers(2, 9, 2))
    truth = np.cumsum(rng.normal(0, 0.2, (truths, steps, 2)), axis=1) + rng.normal(
        0, 1, (truths, 1, 2)
    )
    whom = np.cumsum(rng.random((estimates, steps)) < 0.03, axis=1) + np.arange(estimates)[:, None]
    estimate = np.moveaxis(truth, 0, 1)[np.arange(steps), whom % truths]
    estimate = estimate + rng.normal(0, rng.choice([0.1, 0.4]), (estimates, steps, 2))
    there = [rng.random((number, steps)) < 0.8 for number in (truths, estimates)]
    for life in itertools.chain(*there):  # ids come and go
        if rng.random() < 0.5:
            begin, end = np.sort(rng.integers(0, steps, 2))
            life[:begin] = life[end:] = False
    cutoff = float(rng.choice([0.5, 2.0, 10.0]))
    order = float(rng.choice([1, 2, 3]))
    distance = np.linalg.norm(truth[:, None] - estimate[None], axis=-1)
    cost = (distance / cutoff) ** order
    near = (cost < 1) & there[0][:, None] & there[1][None]
    parameters = Parameters(
        cutoff=cutoff,
        order=order,
        switch_penalty=float(rng.choice([0, 0.5, 1])) * cutoff,
        rho=float(rng.choice([0.5, 0.5, 0.2])),
    )
    ignored, excused = (masked & (rng.random(one.shape) < 0.3) for one in there)
    ignored, excused = ignored[:, None], excused[None]
    near &= ~(ignored & excused)  # pairs that gain nothing are none
    near &= ~(excused & (cost >= parameters.unassigned_prices[0]))
    step, i, j = np.nonzero(np.moveaxis(near, 2, 0))
    root = connected_components(
        i.astype(np.int32), (j + truths).astype(np.int32), truths + estimates
    )[i]
    kept = root == np.bincount(root, minlength=1).argmax()
    entries = np.zeros(int(kept.sum()), ENTRY)
    # Numbers of the whole have gaps, and there is a time without any of these.
    entries["step"] = 5 + step[kept] + 40 * (step[kept] > steps // 2) * (seed % 2)
    entries["truth"], entries["estimate"] = 3 * i[kept] + 4, 2 * j[kept] + 1
    entries["cost"] = cost[i, j, step][kept]
    marks = IGNORED_TRUTH * ignored + EXCUSED_ESTIMATE * excused
    entries["marks"] = marks[i, j, step][kept]
    return entries, parameters


def component(
    work: Path, entries: Entries, parameters: Parameters, together: int, overlap: int
) -> Callable[..., ComponentBounds]:
    """Solves it, from files of which none has whole steps only."""
    work.mkdir()
    files = []
    for number, part in enumerate(np.array_split(entries, 3)):
        files.append((str(work / f"{number}.npy"), number, number + len(part)))
        np.save(files[-1][0], np.concatenate((part[:number], part, part[:2])))  # beside others
    return partial(
        solve_long, files, parameters, str(work / "work"), together=together, overlap=overlap
    )


def whole(entries: Entries, parameters: Parameters) -> tuple[Problem, Bounds, Breakdown]:
    numbers = np.unique(entries["truth"]), np.unique(entries["estimate"])
    problem = problem_of(entries, int(entries["step"][0]), numbers, parameters)
    states = merge_runs(problem)
    bounds, _, breakdown = certify(states, Certified(jobs=1)(states, Stopwatch()))
    return problem, bounds, breakdown


def check_parts(
    joined: ComponentBounds, problem: Problem, entries: Entries, parameters: Parameters
) -> None:
    """Cost and constraints of what is held, step by step and pair by pair; sums by track."""
    truths, estimates = np.unique(entries["truth"]), np.unique(entries["estimate"])
    first = int(entries["step"][0])
    held = np.concatenate(
        [np.load(path) for folder in joined.folders for path in Path(folder).glob("by_est*te.npy")]
    )
    weight = np.zeros((len(truths), len(estimates), problem.steps), np.int64)
    for row in held:
        i, j = np.searchsorted(truths, row["truth"]), np.searchsorted(estimates, row["estimate"])
        weight[i, j, row["begin"] - first : row["end"] - first + 1] += row["weight"]
    assert weight.sum(axis=0).max() <= ONE
    assert weight.sum(axis=1).max() <= ONE
    near, ignored, excused = np.zeros((3, *weight.shape), bool)
    at = (
        np.searchsorted(truths, entries["truth"]),
        np.searchsorted(estimates, entries["estimate"]),
        entries["step"] - first,
    )
    near[at] = True
    ignored[at] = entries["marks"] & IGNORED_TRUTH > 0
    excused[at] = entries["marks"] & EXCUSED_ESTIMATE > 0
    judged = near & ~ignored, near & ~excused
    used = weight * near / ONE
    missed, false = parameters.unassigned_prices
    share = joined.share
    switch = np.abs(np.diff(weight / ONE, axis=2, prepend=weight[:, :, :1] / ONE)).sum((0, 1))
    cost = np.zeros(weight.shape)
    cost[at] = entries["cost"] * ~ignored[at]
    expected = {
        "localisation": (used * cost).sum((0, 1)),
        "missed": missed * (judged[0].any(1) - (judged[0] * used).sum(1)).sum(0),
        "false": false * (judged[1].any(0) - (judged[1] * used).sum(0)).sum(0),
        "switch": parameters.switch_price * switch,
        "switch_count": 0.5 * switch,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(share, name), value, rtol=1e-12, atol=1e-11)
    for name, number, price in (("truths", truths, missed), ("estimates", estimates, false)):
        parts = {part: np.zeros(number[-1] + 1) for part in (*PARTS_OF_TRACKS, "rows")}
        for path in (Path(folder) / f"{name}.npz" for folder in joined.folders):
            if not path.exists():
                continue
            with np.load(path) as found:
                for part, values in parts.items():
                    np.add.at(values, found["track"], found[part])
        axis = 1 if name == "truths" else 0
        of = judged[1 - axis]
        rows = of.any(axis).sum(1)
        assert (parts["rows"][number] == rows).all()
        free = rows - (of * used).sum((axis, 2))
        np.testing.assert_allclose(parts["unassigned"][number], price * free, atol=1e-11)
        assert parts["localisation"].sum() == pytest.approx(share.localisation.sum(), rel=1e-12)
        assert parts["switch_count"].sum() == pytest.approx(share.switch_count.sum(), rel=1e-12)
    paths = [Path(folder) / "assigned.npy" for folder in joined.folders]
    assigned = np.concatenate([np.load(path) for path in paths if path.exists()])
    assert assigned["weight"].sum() == pytest.approx(used.sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("seed", "masked"), [*((seed, False) for seed in (0, 2, 5, 7, 9)), (0, True), (5, True)]
)
def test_the_bracket_is_that_of_the_whole(seed: int, masked: bool, tmp_path: Path) -> None:
    entries, parameters = walkers(seed, 160, masked=masked)
    problem, bounds, _ = whole(entries, parameters)
    overlap = (10, 20)[seed % 2]
    together = 120 * len(entries) // problem.steps
    long = component(tmp_path / "long", entries, parameters, together, overlap)
    joined = long(run_tasks)
    lower, upper = joined.share.bracket
    rounding = 1e-12 * bounds.upper
    assert len(joined.pieces) > 1
    assert joined.share.solved
    assert lower == pytest.approx(bounds.lower, abs=rounding + 1e-9 * upper)
    assert upper == pytest.approx(bounds.upper, abs=rounding + 1e-9 * upper)
    assert lower <= upper
    check_parts(joined, problem, entries, parameters)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("seed", [5, 14])
def test_windows_that_are_too_short_leave_an_honest_bracket(
    seed: int, masked: bool, tmp_path: Path
) -> None:
    entries, parameters = walkers(seed, 30, masked=masked)
    problem, bounds, _ = whole(entries, parameters)
    joined = component(tmp_path / "long", entries, parameters, len(entries) // 3, 1)(run_tasks)
    lower, upper = joined.share.bracket
    rounding = 1e-12 * bounds.upper
    assert lower <= bounds.upper + rounding
    assert upper >= bounds.lower - rounding
    assert joined.share.solved == (upper - lower <= 1e-9 * upper)
    check_parts(joined, problem, entries, parameters)


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class KilledError(Exception):
    pass


def killed_after(most: int) -> Run:
    """Runs the tasks from the last to the first, and so many in all."""

    def run(tasks: Mapping[str, Task]) -> None:
        def one(output: str) -> None:
            if next(left, None) is None:
                raise KilledError
            tasks[output](output)

        run_tasks(dict.fromkeys(reversed(tasks), one))

    left: Iterator[int] = iter(range(most))
    return run


def test_a_killed_run_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    entries, parameters = walkers(3, 60)
    together = len(entries) // 2
    once = component(tmp_path / "once", entries, parameters, together, 5)
    straight = once(run_tasks)
    again = component(tmp_path / "again", entries, parameters, together, 5)
    for most in (5, 1):
        with pytest.raises(KilledError):
            again(killed_after(most))
    joined = again(run_tasks)
    assert joined.share.bracket == straight.share.bracket
    assert files(tmp_path / "once") == files(tmp_path / "again")


def test_what_is_solved_in_time_is_proven(tmp_path: Path) -> None:
    entries, parameters = walkers(3, 60)
    problem, bounds, _ = whole(entries, parameters)
    widths = []
    for in_time in (0, 3, 100):
        windows: Iterator[int] = iter(range(in_time))

        def run(tasks: Mapping[str, Task], windows: Iterator[int] = windows) -> None:
            def one(output: str) -> None:
                task = tasks[output]
                if getattr(task, "func", None) is solve_window:
                    task = partial(task, end=0.0 if next(windows, None) is None else None)
                task(output)

            run_tasks(dict.fromkeys(tasks, one))

        work = tmp_path / str(in_time)
        long = component(work, entries, parameters, len(entries) // 2, 5)
        told: list[PartialSums] = []
        ended = None if in_time == 100 else 0.0  # 1970
        joined = long(run, told.append, end=ended)
        lower, upper = joined.share.bracket
        assert lower <= bounds.lower * (1 + 1e-12)
        assert upper >= bounds.upper * (1 - 1e-12)
        assert told[-1].bracket == (lower, upper)
        check_parts(joined, problem, entries, parameters)
        widths.append(upper - lower)
    assert widths[0] > widths[1] > widths[2]
    assert widths[2] <= 1e-9 * bounds.upper
