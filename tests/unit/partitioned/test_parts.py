"""Evaluations in parts: blocks, shards and processes change no bit of the result."""

import math
from pathlib import Path

import numpy as np
import pytest
from held_sides import plan

import tgospa_eval as tg
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.writing import FRESH, writing
from tgospa_eval.engines import PersistentPool, Processes
from tgospa_eval.errors import ConfigError, SolverError
from tgospa_eval.partitioned import run, tasks
from tgospa_eval.partitioned.run import Evaluated, Stages, evaluate_parts, scan_parts
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.tracks.trajectories import Trajectories


def scene(seed: int) -> tuple[Trajectories, Trajectories, Parameters]:
    rng = np.random.default_rng(seed)
    names = ["crossing", "parallel", "convoy", "dense", "births", "manoeuvring"]
    sides = simulate(
        Scene(
            scenario=str(rng.choice(names)),
            targets=int(rng.integers(0, 9)),
            steps=int(rng.integers(1, 40)),
            area=float(rng.choice([30, 100, 400])),
        ),
        Tracker(noise=2, detection=0.9, swaps=0.3, near=10, fragmentation=0.05, false_rate=0.2),
        rng,
    )
    parameters = Parameters(
        cutoff=float(rng.choice([3, 10, 50])),
        order=float(rng.choice([1, 2, 3])),
        switch_penalty=float(rng.choice([0, 1, 5])),
        rho=float(rng.choice([0.5, 0.5, 0.3])),
    )
    return *sides, parameters


def evaluated(
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    work: Path,
    engine: PersistentPool | None = None,
) -> Evaluated:
    stages, cut = Stages(Stopwatch(), engine), plan(sides, parameters)
    _, blocks = scan_parts(cut, work, 1 << 30, stages)
    return evaluate_parts(cut, blocks, work, 1 << 30, stages)


def same(first: Evaluated, second: Evaluated) -> None:
    assert first.proof.bounds == second.proof.bounds
    for name, part in vars(first.proof.breakdown).items():
        assert np.array_equal(part, getattr(second.proof.breakdown, name)), name
    for mine, other in zip(first.track_costs, second.track_costs, strict=True):
        assert all(np.array_equal(part, getattr(other, name)) for name, part in vars(mine).items())
    names = ("assigned.npy", "switched.npy")
    for mine, other in zip(first.folders, second.folders, strict=True):
        assert all((mine / name).read_bytes() == (other / name).read_bytes() for name in names)


@pytest.mark.parametrize("group", range(2))
def test_parts_add_up_to_the_whole(
    group: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in range(5 * group, 5 * group + 5):
        truth, estimate, parameters = scene(seed)
        whole = tg.evaluate(
            truth,
            estimate,
            parameters.cutoff,
            parameters.order,
            parameters.switch_penalty,
            rho=parameters.rho,
        )
        monkeypatch.setattr(run, "SHARD_ENTRIES", 1 + 40 * (seed % 3))
        found = []
        for rows in (1 + 9 * (seed % 3), 10_000):
            monkeypatch.setattr(run, "MOST_ROWS", rows)
            work = tmp_path / f"{seed}-{rows}"
            found.append(evaluated((truth, estimate), parameters, work))
        same(found[0], found[1])
        parts = found[0]
        bounds, breakdown, known = parts.proof.bounds, parts.proof.breakdown, whole.proof
        assert bounds.met(1e-9)
        assert math.isclose(breakdown.total, known.breakdown.total, rel_tol=1e-12, abs_tol=0)
        assert bounds.lower <= known.bounds.upper
        assert known.bounds.lower <= bounds.upper
        names = ("localisation", "missed", "false", "switch")
        by_step = sum(getattr(breakdown, name).sum() for name in names)
        assert math.isclose(by_step, breakdown.total, rel_tol=1e-12)
        for name, table in zip(("missed", "false"), parts.track_costs, strict=True):
            assert math.isclose(
                table.unassigned.sum(), getattr(breakdown, name).sum(), rel_tol=1e-12
            )
            assert math.isclose(
                table.localisation.sum(), breakdown.localisation.sum(), rel_tol=1e-12
            )
        assert parts.sizes.items() <= whole.sizes.items()
        assert parts.tracks[0].ids.tolist() == truth.ids.tolist()
        assert parts.tracks[1].ids.tolist() == estimate.ids.tolist()


def test_processes_and_interruptions_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, estimate, parameters = scene(9)
    monkeypatch.setattr(run, "SHARD_ENTRIES", 30)
    monkeypatch.setattr(run, "MOST_ROWS", 20)
    alone = evaluated((truth, estimate), parameters, tmp_path / "alone")
    with PersistentPool(Processes(2), 2) as pool:
        together = evaluated((truth, estimate), parameters, tmp_path / "2", pool)
    same(alone, together)
    # A run that stops after each task in turn goes on where it was.
    begun = 0
    original = tasks.do_task

    def stops(job: tuple[str, tasks.Task]) -> tuple[str, bool]:
        nonlocal begun
        if begun == 2:
            begun = 0
            raise KeyboardInterrupt
        begun += 1
        return original(job)

    monkeypatch.setattr(tasks, "do_task", stops)
    interrupted = 0
    while True:
        try:
            again = evaluated((truth, estimate), parameters, tmp_path / "again")
            break
        except KeyboardInterrupt:
            interrupted += 1
    assert interrupted > 3
    same(alone, again)
    assert not list(tmp_path.rglob(f"{FRESH}*"))


def kill(output: str) -> None:
    import os

    os._exit(1)


def test_a_task_of_which_processes_die_is_named(tmp_path: Path) -> None:
    with (
        PersistentPool(Processes(1), 1) as pool,
        pytest.raises(SolverError, match="a process died of 000007, most likely for want of"),
    ):
        tasks.run_tasks({str(tmp_path / "000007"): kill}, pool)


def fill(beside: Path) -> None:
    beside.write_text("half")
    raise OSError("10931 requested and 5520 written")  # as NumPy says it


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(ConfigError, match="cannot be written: no space left on the disk"),
        writing(str(tmp_path / "out" / "block")) as beside,
    ):
        fill(beside)
    assert not list((tmp_path / "out").iterdir())
