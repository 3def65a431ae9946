"""Compiled kernels against their plain twins, and what must not depend on them."""

import dataclasses
import json

import numpy as np
import pytest
from fallback import without_kernels
from strategies import scene

import tgospa_eval.solvers.certified as certified_module
import tgospa_eval.solvers.sinkhorn as sinkhorn_module
from tgospa_eval import Certified, InputError, Result, Sinkhorn, evaluate
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import check_size
from tgospa_eval.kernels import kernels
from tgospa_eval.problem import states
from tgospa_eval.problem.certificate import break_down, certify, lower_bounds
from tgospa_eval.problem.paths import best_values, relative_gains, row_steps
from tgospa_eval.problem.problem import Problem, sum_parts
from tgospa_eval.problem.states import ONE, Slots, States, merge_runs, repair
from tgospa_eval.solvers import dual_ascent as ascent

compiled_only = pytest.mark.skipif(kernels is None, reason="no compiled kernels here")


def problem_of(
    seed: int, m: int, n: int, steps: int, *, side: float, gamma: float = 1.0
) -> Problem:
    truth, estimate = scene(seed, m, n, steps, side=side)
    return evaluate(truth, estimate, 4.0, 2, gamma).proof.states.problem


def sparse_problem() -> Problem:
    """Two crowds far apart, tracks that come and go, an estimate that serves two truths."""
    truth, estimate = scene(5, 8, 9, 60, side=9.0)
    truth = np.concatenate((truth, truth + 1000.0), axis=1)
    estimate = np.concatenate((estimate, estimate[::-1] + 1000.0), axis=1)
    rng = np.random.default_rng(5)
    for side in (truth, estimate):
        for k in range(side.shape[1]):
            first, last = np.sort(rng.integers(0, 60, 2))
            side[:first, k] = side[last + 1 :, k] = np.nan
    return evaluate(truth, estimate, 4.0, 2, 1.0).proof.states.problem


PROBLEMS = {
    "small": lambda: problem_of(1, 4, 5, 12, side=5.0),
    "crowd": lambda: problem_of(2, 12, 14, 40, side=10.0),
    "sparse": sparse_problem,
    "estimate alone": lambda: problem_of(3, 6, 1, 20, side=4.0),
    "one step": lambda: problem_of(4, 8, 9, 1, side=6.0),
    "nothing": lambda: problem_of(4, 2, 2, 3, side=1e9),
    "gamma free": lambda: problem_of(6, 6, 6, 20, side=5.0, gamma=0.0),
}


@compiled_only
@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("name", PROBLEMS)
def test_merging_compiled_equals_plain(
    name: str, varying: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = PROBLEMS[name]()
    if varying:
        price = np.linspace(0.1, 0.2, max(problem.steps - 1, 0))
        problem = dataclasses.replace(problem, switch_price=price)
    fast = merge_runs(problem)
    sides = [(fast.rows, fast.columns)]
    without_kernels(monkeypatch)
    plain = merge_runs(problem)
    sides.append((plain.rows, plain.columns))
    for one, other in zip(*sides, strict=True):
        for part in dataclasses.fields(Slots):
            assert np.array_equal(getattr(one, part.name), getattr(other, part.name))
    for field in dataclasses.fields(States):
        if field.name not in ("problem", "columns"):
            assert np.array_equal(getattr(fast, field.name), getattr(plain, field.name)), field.name


@pytest.mark.parametrize("plain", [False, True])
def test_more_states_than_indices_are_refused(plain: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = PROBLEMS["small"]()
    check_size("states", 2**31 - 2)
    if plain:
        without_kernels(monkeypatch)
    ends = np.zeros(2, np.int32), np.full(2, 2**30, np.int32)
    with pytest.raises(InputError, match="2147483650 states are too many"):
        states.split_pairs(np.arange(2, dtype=np.int32), ends[0], *ends, single=True)
    for field, what in (("steps", "steps"), ("truths", "trajectories")):
        large = dataclasses.replace(problem, **{field: 2**31 - 1})
        with pytest.raises(InputError, match=f"{what} are too many"):
            merge_runs(large)


def ascent_of(states: States) -> ascent.Ascent:
    """An ascent of all blocks."""
    return ascent.Ascent(
        states,
        np.ones(len(states.block_begin), bool),
        1e-9,
        np.zeros(len(states.begin)),
        np.zeros(len(states.columns.step)),
    )


@compiled_only
@pytest.mark.parametrize("kind", ["plain", "varying", "priced"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_certificate_compiled_has_the_bits_of_the_plain(
    name: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, rng = PROBLEMS[name](), np.random.default_rng(7)
    if kind == "varying":
        price = rng.exponential(0.3, max(problem.steps - 1, 0))
        problem = dataclasses.replace(problem, switch_price=price)
    if kind == "priced":
        price = problem.truth_price * rng.uniform(1, 2, len(problem.truth_price))
        problem = dataclasses.replace(problem, truth_price=price)
    states = merge_runs(problem)
    slots_ = len(states.columns.step)
    prices = np.where(rng.random(slots_) < 0.5, rng.exponential(0.3, slots_), 0.0)
    weights = repair(states, rng.integers(-1, 4, len(states.begin)) / 3)

    def found() -> list[np.ndarray]:
        steps = row_steps(states)
        gains = relative_gains(states, steps, states.columns.totals(prices))
        return [
            *gains,
            best_values(states, gains[0], steps, gains[1]),
            best_values(states, states.gain),
            lower_bounds(states, prices),
            *map(np.asarray, vars(break_down(states, weights)).values()),
        ]

    fast = found()
    without_kernels(monkeypatch)
    for one, other in zip(fast, found(), strict=True):
        assert one.tobytes() == other.tobytes()


@compiled_only
@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize("name", ["small", "crowd", "sparse", "estimate alone"])
def test_relative_gains_are_those_of_the_certificate(name: str, uniform: bool) -> None:
    problem = PROBLEMS[name]()
    if not uniform:
        prices = 0.5 + np.random.default_rng(0).random(len(problem.truth_price))
        problem = dataclasses.replace(problem, truth_price=prices)
    states = merge_runs(problem)
    field = ascent_of(states)
    steps = row_steps(states)
    value, offset, _ = relative_gains(states, steps)
    assert np.array_equal(field.layout.group_first, steps.first)
    if uniform:  # else the cheapest pair need not be the one that gains most
        assert field.layout.offset == pytest.approx(offset, abs=1e-15)
        assert field.layout.gain == pytest.approx(value, abs=1e-12)
    off = np.add.reduceat(np.append(field.layout.offset, 0.0), steps.first[:-1])
    off[np.diff(steps.first) == 0] = 0.0
    field.mark(np.zeros(len(states.columns.step)), 0.0)
    assert field.best + off == pytest.approx(best_values(states, states.gain), abs=1e-10)


@compiled_only
@pytest.mark.parametrize("reach", [0.05, 0.4, 1.1])
@pytest.mark.parametrize("name", ["small", "crowd", "sparse"])
def test_a_survey_says_what_forcing_a_state_costs(name: str, reach: float) -> None:
    """Slack of a state, and of doing without any, against best paths that are forced that way."""
    states = merge_runs(PROBLEMS[name]())
    survey = ascent_of(states)
    rng = np.random.default_rng(1)
    prices = rng.exponential(0.2, len(states.columns.step))
    survey.mark(prices, reach)
    value = states.gain - states.columns.totals(prices)
    best = best_values(states, value)
    row, end = states.pair_row[states.pair], states.end
    off = sum_parts(survey.layout.offset, survey.layout.group_first)
    assert (survey.best + off)[np.unique(row)] == pytest.approx(best[np.unique(row)], abs=1e-10)
    for s in rng.choice(len(value), 12, replace=False):
        forced = value.copy()
        forced[s] += 100.0
        slack = best[row[s]] - (best_values(states, forced)[row[s]] - 100.0)
        here = (row == row[s]) & (states.begin <= states.begin[s]) & (end >= states.begin[s])
        without = best[row[s]] - best_values(states, np.where(here, -100.0, value))[row[s]]
        for loss, flag, below in (
            (slack, kernels.NEAR, True),
            (without, kernels.NEEDED, False),
        ):
            if abs(loss - reach) > 1e-9:
                assert survey.has(flag)[s] == ((loss <= reach) == below)
        assert survey.has(kernels.TEMPTED)[s] == (slack <= 1e-6)
        if survey.has(kernels.BEST)[s]:
            assert slack < 1e-10


@compiled_only
@pytest.mark.parametrize("blocks", [1, 7, 9, 200, 700])
def test_sums_over_open_blocks_have_the_bits_of_numpy(blocks: int) -> None:
    """Stages are skipped and ended by these sums: another order of adding is another result."""
    rng = np.random.default_rng(blocks)
    truth = np.arange(blocks)[None, :, None] * 100.0 + rng.normal(0, 1, (3, blocks, 1))
    states = evaluate(truth, truth + rng.normal(0, 1, truth.shape), 10.0, 2, 1.0).proof.states
    field = ascent_of(states)
    assert len(field.dual) == blocks
    field.keep(rng.random(blocks) < 0.8)
    field.dual[:], field.primal[:] = rng.exponential(1, (2, blocks)) * 10.0 ** rng.integers(-9, 3)
    kept = field.open
    assert field.open_gap == (field.dual - field.primal)[kept].sum()
    assert field.open_cost == np.maximum(field.base_cost - field.primal, 0.0)[kept].sum()
    assert field.brackets.open_dual == field.dual[kept].sum()
    assert np.array_equal(field.wide(0.1), kept & (field.gap > 0.1 * field.cost))


@compiled_only
def test_sweeps_find_the_entropic_optimum() -> None:
    """Shares of all paths, listed one by one, at the prices of a converged chain."""
    truth, estimate = scene(7, 3, 3, 4, side=3.0)
    problem = evaluate(truth, estimate, 4.0, 2, 1.0).proof.states.problem
    states = merge_runs(problem)
    epsilon = 0.2
    field = ascent_of(states)
    chosen = np.ones(len(states.begin), np.uint8)
    start = np.zeros(len(states.columns.step))
    chain = kernels.Chain(field.layout, chosen, start, 10**6)
    chain.heat(epsilon)
    assert chain.sweep(400)[1] < 1e-9
    prices = np.zeros(len(states.columns.step))
    masses = np.zeros(len(states.begin), np.float32)
    chain.write_masses(masses, field.flags)
    chain.cool(epsilon)
    chain.write_prices(prices)

    value = states.gain - states.columns.totals(prices)
    price = problem.switch_price_at
    shares = np.zeros(len(value))
    for node in np.unique(states.pair_row):
        own = np.flatnonzero(states.pair_row[states.pair] == node)
        totals: dict[int, float] = {}
        weight_of_all = 0.0
        for path in all_paths(states, own):
            score = value[list(path)].sum() if path else 0.0
            on = np.zeros(len(value))
            on[list(path)] = 1.0
            follows = states.pair[1:] == states.pair[:-1]
            moved = np.flatnonzero(follows & (np.diff(on) != 0)) + 1
            # A switch from and to the same state through "none" is a path of its own: q^2 each.
            score -= price[states.begin[moved]].sum()
            weight = np.exp(score / epsilon)
            weight_of_all += weight
            for s in path:
                totals[s] = totals.get(s, 0.0) + weight
        for s, weight in totals.items():
            shares[s] = weight / weight_of_all
    assert masses == pytest.approx(shares, abs=1e-6)
    assert np.array_equal(field.has(kernels.MAJORITY), shares > 0.5)
    load = np.zeros(len(prices))
    for s in range(len(shares)):
        load[states.columns.begin[s] : states.columns.end[s]] += shares[s]
    # Columns: exp(-price / epsilon) is the share of being idle.
    assert load + np.exp(-prices / epsilon) == pytest.approx(1.0, abs=1e-6)


def all_paths(states: States, own: np.ndarray) -> list[tuple[int, ...]]:
    """All sets of states of one row that do not overlap in time."""
    found: list[tuple[int, ...]] = [()]
    for s in own.tolist():
        found += [
            (*path, s)
            for path in found
            if all(states.end[t] < states.begin[s] or states.begin[t] > states.end[s] for t in path)
        ]
    return found


def bytes_of(truth: np.ndarray, estimate: np.ndarray, solver: Certified | Sinkhorn) -> str:
    result = evaluate(truth, estimate, 4.0, 2, 1.0, solver=solver).to_dict()
    result.pop("timings")
    return json.dumps(result, sort_keys=True)


@pytest.mark.parametrize("kind", [Certified, Sinkhorn])
def test_threads_do_not_change_a_byte(kind: type, monkeypatch: pytest.MonkeyPatch) -> None:
    import tgospa_eval.solvers.batches as batches
    from tgospa_eval.distances import pair_search

    monkeypatch.setattr(batches, "BATCH_STATES", 100)
    monkeypatch.setattr(pair_search, "ROWS_TOGETHER", 60)
    truth, estimate = scene(11, 5, 6, 16, side=5.0)
    offsets = 1e4 * np.arange(5)[:, None, None, None]
    many = np.concatenate(list(truth[None] + offsets), axis=1)
    others = np.concatenate(list(estimate[None] + offsets), axis=1)
    assert bytes_of(many, others, kind(jobs=1)) == bytes_of(many, others, kind(jobs=4))


@compiled_only
@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_loads_of_slots(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    reduced = merge_runs(PROBLEMS[name]())
    rng = np.random.default_rng(0)
    weights = rng.integers(0, 4, len(reduced.begin)) / 8.0
    marked = rng.random(len(reduced.begin)) < 0.5
    sides = reduced.rows, reduced.columns
    found = [side.loads(of) for side in sides for of in (weights, marked)]
    without_kernels(monkeypatch)
    plain = [side.loads(of) for side in sides for of in (weights, marked)]
    for fast, slow in zip(found, plain, strict=True):
        np.testing.assert_array_equal(fast, slow)


@compiled_only
@pytest.mark.parametrize("seed", range(6))
def test_compiled_and_plain_solvers_agree(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    truth, estimate = scene(seed, 9, 10, 30, side=7.0, noise=1.5)
    fast = evaluate(truth, estimate, 5.0, 2, 2.0)
    soft = evaluate(truth, estimate, 5.0, 2, 2.0, solver="sinkhorn")
    for module in (states, certified_module, sinkhorn_module):
        monkeypatch.setattr(module, "kernels", None)
    plain = evaluate(truth, estimate, 5.0, 2, 2.0)
    plain_soft = evaluate(truth, estimate, 5.0, 2, 2.0, solver="sinkhorn")
    assert fast.certified
    assert plain.certified
    assert fast.total == pytest.approx(plain.total, rel=1e-9)
    for result in (soft, plain_soft):
        assert result.lower_bound <= fast.tgospa * (1 + 1e-12)
        assert result.upper_bound >= fast.tgospa * (1 - 1e-12)
        assert result.relative_gap < 0.2


@pytest.fixture(scope="module")
def hard() -> tuple[np.ndarray, np.ndarray, Result]:
    """A crowd with a fractional optimum, that takes all stages and programmes."""
    truth, estimate = scene(21, 24, 26, 50, side=11.0, noise=2.0)
    exact = evaluate(truth, estimate, 5.0, 2, 2.0)
    assert exact.certified
    return truth, estimate, exact


@pytest.mark.parametrize("limit", [1e-4, 3e-3, 1e-2, 3e-2, 0.1, 0.3])
def test_a_time_limit_in_any_stage_gives_a_true_bracket(
    limit: float, hard: tuple[np.ndarray, np.ndarray, Result]
) -> None:
    truth, estimate, exact = hard
    for solver in (Certified(time_limit=limit), Sinkhorn(epsilon=1e-3, time_limit=limit)):
        result = evaluate(truth, estimate, 5.0, 2, 2.0, solver=solver)
        assert result.lower_bound <= exact.tgospa * (1 + 1e-12)
        assert result.upper_bound >= exact.tgospa * (1 - 1e-12)


@pytest.mark.parametrize("gamma", [0.0, 1e-6, 5e3, 1e300])
@pytest.mark.parametrize("epsilon", [1e-3, 1e-9])
def test_extremes(gamma: float, epsilon: float) -> None:
    truth, estimate = scene(31, 8, 9, 40, side=8.0)
    exact = evaluate(truth, estimate, 5.0, 2, gamma)
    assert exact.certified
    result = evaluate(truth, estimate, 5.0, 2, gamma, solver=Sinkhorn(epsilon=epsilon))
    assert result.lower_bound <= exact.tgospa * (1 + 1e-12)
    assert result.upper_bound >= exact.tgospa * (1 - 1e-12)


def test_sinkhorn_stops_at_the_gap_asked() -> None:
    truth, estimate = scene(41, 20, 20, 60, side=12.0)
    loose = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Sinkhorn(epsilon=1e-3, gap=0.05))
    tight = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Sinkhorn(epsilon=1e-3, gap=1e-4))
    assert loose.relative_gap <= 0.05
    assert tight.relative_gap <= 1e-4
    assert loose.solver["iterations"] <= tight.solver["iterations"]
    assert loose.certified == (kernels is None)  # without them it is a linear programme


def test_gap_of_certified_stops_early_and_is_kept(
    hard: tuple[np.ndarray, np.ndarray, Result],
) -> None:
    truth, estimate, exact = hard
    result = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Certified(gap=0.05))
    assert result.certified
    assert result.relative_gap <= 0.05
    if kernels:  # a linear programme alone has no early end
        assert result.solver["iterations"] < exact.solver["iterations"]


def test_parts_of_the_states_are_problems_of_their_own() -> None:
    states = merge_runs(sparse_problem())
    blocks = len(states.block_begin)
    assert blocks > 1
    solution = Certified()(states, Stopwatch())
    bounds, weights, _ = certify(states, solution)
    assert bounds.relative_gap < 1e-9
    covered = 0
    for low, high in states.cuts(100):
        part, state, slot = states.between(low, high)
        covered += len(part.begin)
        assert np.array_equal(part.gain, states.gain[state])
        assert np.array_equal(part.end, states.end[state])
        for mine, whole in ((part.rows, states.rows), (part.columns, states.columns)):
            sums = mine.sums(weights[state])
            assert not len(sums) or sums.max() <= ONE
            assert np.array_equal(mine.end - mine.begin, (whole.end - whole.begin)[state])
        assert len(part.columns.step) == slot.stop - slot.start
    assert covered == len(states.begin)


@compiled_only
def test_a_working_set_with_too_many_ties_is_swept_whole() -> None:
    """Coincident truths and cheap switches: no threshold keeps the chain short."""
    rng = np.random.default_rng(0)
    steps, m, n = 200, 20, 60
    estimate = rng.normal(0, 1, (steps, n, 2))
    estimate[rng.random((steps, n)) > 0.03] = np.nan
    solver = Certified(time_limit=1.0)
    result = evaluate(np.zeros((steps, m, 2)), estimate, 5.0, 2, 0.1, solver=solver)
    assert 0 < result.lower_bound <= result.upper_bound


@compiled_only
@pytest.mark.parametrize("seed", range(5))
def test_dear_pairs_do_not_lower_the_switch_price(seed: int) -> None:
    """The cap on switch prices is one on the largest gain, not on that of the cheapest pair."""
    rng = np.random.default_rng(seed)
    problem = problem_of(seed, 4, 4, 10, side=2.0)
    dear = np.where(rng.random(problem.estimates) < 0.5, 10 ** rng.uniform(1, 3), 0.5)
    price = dear[problem.estimate_track]
    base = problem.truth_price[problem.truth_row] + price[problem.estimate_row]
    cost = np.where(base > 2, rng.uniform(1.5, 2.5, len(base)), 0.98 * base)
    problem = dataclasses.replace(
        problem, estimate_price=price, cost=cost, switch_price=float(10 ** rng.uniform(0, 2))
    )
    states = merge_runs(problem)
    bounds, _, _ = certify(states, Certified()(states, Stopwatch()))
    assert bounds.met(1e-9)
