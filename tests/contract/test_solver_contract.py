"""One contract for every solver: its bracket holds the optimum of a plain LP."""

import numpy as np
import pytest
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import lagrangian_bound, tgospa_lp
from strategies import ORDERS, SWITCH, few_among_many, pairs_of_sets, scene

from tgospa_eval import Certified, ConfigError, Exact, Result, Sinkhorn, evaluate
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.kernels import KERNEL
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.metric_family import Parameters, tgospa_problem
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import ONE, States, merge_runs
from tgospa_eval.solvers import SOLVERS, Solver, solver_class

# relative error of the total that each solver promises, None for a bracket only
PROMISE = {"certified": 1e-9, "exact": 1e-6, "sinkhorn": None}


def check(
    truth: np.ndarray, estimate: np.ndarray, c: float, p: float, g: float, *names: str
) -> None:
    optimum = tgospa_lp(truth, estimate, c, p, g)
    for name in names:
        held(evaluate(truth, estimate, c, p, g, solver=name), optimum, c, p, name)


def held(result: Result, optimum: float, c: float, p: float, name: str) -> None:
    """What a solver promises, kept."""
    slack = 1e-7 * c**p + 1e-9 * optimum  # of the oracle, whose tolerances are absolute
    lower, upper = result.lower_bound**p, result.upper_bound**p
    assert lower <= optimum + slack
    assert upper >= optimum - slack
    if PROMISE[name] is not None:
        assert upper - lower <= PROMISE[name] * upper + 1e-12 * c**p
    if name == "certified":
        assert result.certified
    parts = result.localisation + result.missed + result.false + result.switch
    assert parts == pytest.approx(upper, rel=1e-12, abs=1e-12 * c**p)


def test_every_solver_is_under_contract() -> None:
    assert set(PROMISE) == set(SOLVERS)


@settings(max_examples=examples(100))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH, c=st.sampled_from([1.0, 2.0, 3.0]))
def test_small(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, c: float) -> None:
    check(*sides, c, p, gamma, "certified", "sinkhorn")


@settings(max_examples=examples(25))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH)
def test_small_referee(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float) -> None:
    check(*sides, 2.0, p, gamma, "exact")


CUTOFFS = st.sampled_from([2.0, 5.0, 50.0])


@settings(max_examples=examples(15))
@given(sides=few_among_many(longest=60), p=ORDERS, gamma=SWITCH, c=CUTOFFS)
def test_few_among_many(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, c: float
) -> None:
    check(*sides, c, p, gamma, "certified")


@pytest.mark.slow
@settings(max_examples=1000)
@given(sides=few_among_many(), p=ORDERS, gamma=SWITCH, c=CUTOFFS)
def test_few_among_many_and_longer(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, c: float
) -> None:
    check(*sides, c, p, gamma, "certified")


@pytest.mark.parametrize("seed", [341, 449])
@pytest.mark.parametrize("swapped", [False, True])
def test_programmes_without_a_capacity_of_rows(seed: int, swapped: bool) -> None:
    """Slow walks in rounded places: no row of the last programme could be assigned twice."""
    rng = np.random.default_rng(seed)
    steps, few = int(rng.integers(60, 110)), int(rng.integers(2, 4))

    def side(count: int, spread: list[int]) -> np.ndarray:
        walk = np.cumsum(rng.normal(0, rng.choice([0.1, 0.3]), (steps, count, 2)), axis=0)
        return np.round(walk + rng.normal(0, rng.choice(spread), (1, count, 2)))

    sides = side(2 * few, [0, 1, 3]), side(few, [0, 1, 30])
    check(*(sides[::-1] if swapped else sides), 50.0, 2.0, 25.0, "certified")


@pytest.mark.slow
@settings(max_examples=1000)
@given(sides=pairs_of_sets(most=5, most_steps=8), p=ORDERS, gamma=SWITCH)
def test_many(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float) -> None:
    check(*sides, 2.0, p, gamma, "certified", "sinkhorn")


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize(
    ("seed", "m", "n", "steps", "gamma"),
    [(0, 5, 6, 12, 2.0), (1, 6, 5, 12, 0.5), (2, 2, 7, 15, 1.0), (3, 7, 2, 15, 4.0)],
)
def test_scenes(name: str, seed: int, m: int, n: int, steps: int, gamma: float) -> None:
    truth, estimate = scene(seed, m, n, steps, side=6.0)
    check(truth, estimate, 3.0, 2.0, gamma, name)


@pytest.mark.parametrize("name", SOLVERS)
def test_fractional_optimum(name: str) -> None:
    """T9 of the literature's counterexamples: the LP is 7.875, the best integer assignment 8."""
    truth = np.array([[3, 2, 1], [2, 3, 0], [2, 0, 1]], float)[..., None]
    estimate = np.array([[3, 1, 0], [1, 2, 1], [1, 2, 2]], float)[..., None]
    for gamma, value in ((0.25, 7.4375), (0.5, 7.875), (0.75, 8.25), (1, 8.5), (2, 9)):
        result = evaluate(truth, estimate, 2.0, 1, gamma, solver=name)
        assert result.lower_bound <= value + 1e-9
        assert result.upper_bound >= value - 1e-9
        if PROMISE[name] is not None:
            assert result.tgospa == pytest.approx(value, rel=1e-6)


def test_fractional_scene_is_exact() -> None:
    """A crowd whose optimum has fractions: exact all the same, below the best whole assignment."""
    truth, estimate = scene(5, 8, 9, 30, side=5.0, noise=2.0)
    result = evaluate(truth, estimate, 5.0, 2, 2.0)
    weight = result.assignments["weight"]
    assert ((weight > 0.01) & (weight < 0.99)).any()
    assert result.certified
    assert result.total == pytest.approx(tgospa_lp(truth, estimate, 5.0, 2, 2.0), rel=1e-8)


@pytest.mark.skipif(KERNEL == "numpy", reason="start bases of programmes need compiled loops")
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("size", "shift"), [(10, 1.0), (12, 0.5)])
def test_switches_that_cost_nearly_nothing_where_much_ties(
    seed: int, size: int, shift: float
) -> None:
    """On a line, with p = 1, many assignments of a step tie; switches alone decide, for 1e-6."""
    rng = np.random.default_rng(seed)
    truth, estimate = (rng.normal(mean, 1, (size, size, 1)) for mean in (0, shift))
    result = evaluate(truth, estimate, 300.0, 1, 1e-5)
    assert result.certified
    assert result.total == pytest.approx(tgospa_lp(truth, estimate, 300.0, 1, 1e-5), rel=1e-12)
    assert result.solver["iterations"] < 500  # of simplex and sweeps; 1,000 if from afar


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("distance", ["euclidean", "manhattan", "chebyshev"])
def test_distances(name: str, distance: str) -> None:
    truth, estimate = scene(4, 3, 4, 8, side=4.0)
    expected = tgospa_lp(truth, estimate, 2.0, 2, 1.0, distance)
    result = evaluate(truth, estimate, 2.0, 2, 1.0, distance=distance, solver=name)
    assert result.lower_bound**2 <= expected * (1 + 1e-8)
    assert result.upper_bound**2 >= expected * (1 - 1e-8)


@pytest.mark.parametrize("epsilon", [1.0, 0.1, 1e-3, 1e-6, 1e-12])
def test_sinkhorn_is_stable_at_any_temperature(epsilon: float) -> None:
    truth, estimate = scene(6, 6, 6, 20, side=6.0)
    exact = evaluate(truth, estimate, 4.0, 2, 1.0)
    result = evaluate(truth, estimate, 4.0, 2, 1.0, solver=Sinkhorn(epsilon=epsilon))
    assert result.lower_bound <= exact.tgospa * (1 + 1e-12)
    assert result.upper_bound >= exact.tgospa * (1 - 1e-12)
    for check in result.solver["history"]:
        assert all(np.isfinite(value) for value in check.values())
    if epsilon < 0.1:
        assert result.relative_gap < 1e-3


def weighted(problem: Problem, w1: np.ndarray, w2: np.ndarray) -> Problem:
    """The time-weighted member of the family: the same problem with other arrays."""
    at = w1[problem.entry_step]
    return Problem(
        **{
            **{name: getattr(problem, name) for name in problem.__dataclass_fields__},
            "truth_price": problem.truth_price * w1[problem.truth_step],
            "estimate_price": problem.estimate_price * w1[problem.estimate_step],
            "cost": problem.cost * at,
            "switch_price": problem.switch_price * w2,
        }
    )


def problem_of(truth: np.ndarray, estimate: np.ndarray, c: float, p: float, g: float) -> Problem:
    """The product's own problem, through its own distances."""
    return evaluate(truth, estimate, c, p, g).proof.states.problem


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("seed", range(4))
def test_time_varying_prices(name: str, seed: int) -> None:
    """Runs are not merged when the switch price varies; the family's arrays still solve."""
    truth, estimate = scene(seed, 4, 4, 7, side=4.0)
    truth[2:4, 0] = np.nan
    rng = np.random.default_rng(seed)
    w1, w2 = rng.uniform(0.2, 2, 7), rng.uniform(0.2, 2, 6)
    problem = weighted(problem_of(truth, estimate, 2.0, 1, 0.7), w1, w2)
    states = merge_runs(problem)
    bounds, _, _ = certify(states, solver_class(name)()(states, Stopwatch()))
    expected = tgospa_lp(truth, estimate, 2.0, 1, 0.7, w1=w1, w2=w2) / 2.0
    assert bounds.lower <= expected + 1e-7
    assert bounds.upper >= expected - 1e-7
    if PROMISE[name] is not None:
        assert bounds.relative_gap < 1e-6


def random_solution(states: States, seed: int) -> Solution:
    """Nonsense, with some of everything that a broken solver could leave."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(0.3, 0.6, len(states.pair))
    prices = rng.normal(0.1, 0.4, len(states.columns.node))
    weights[rng.random(len(weights)) < 0.1] = np.nan
    prices[rng.random(len(prices)) < 0.1] = np.inf
    return Solution(weights=weights, prices=prices, status="nonsense")


@settings(max_examples=examples(100))
@given(sides=pairs_of_sets(), gamma=SWITCH, seed=st.integers(0, 1000))
def test_certificate_is_true_whatever_the_solver_says(
    sides: tuple[np.ndarray, np.ndarray], gamma: float, seed: int
) -> None:
    problem = problem_of(*sides, 2.0, 2.0, gamma)
    states = merge_runs(problem)
    bounds, weights, breakdown = certify(states, random_solution(states, seed))
    optimum = tgospa_lp(*sides, 2.0, 2.0, gamma) / 4.0
    assert bounds.lower <= optimum + 1e-7
    assert bounds.upper >= optimum - 1e-7
    for slots in (states.rows, states.columns):
        sums = slots.sums(weights)
        assert not len(sums) or (sums.max() <= ONE and sums.min() >= 0)
    assert breakdown.total <= bounds.upper <= breakdown.total * (1 + 1e-12)


@settings(max_examples=examples(60))
@given(sides=pairs_of_sets(), seed=st.integers(0, 1000))
def test_lower_bound_is_no_worse_than_a_plain_viterbi(
    sides: tuple[np.ndarray, np.ndarray], seed: int
) -> None:
    """Merged runs are a subset of the paths of the unreduced row form: the bound can but gain."""
    problem = problem_of(*sides, 2.0, 2.0, 1.0)
    states = merge_runs(problem)
    rng = np.random.default_rng(seed)
    prices = rng.exponential(0.2, len(states.columns.node))
    full = np.zeros((problem.steps, problem.estimates))
    track = np.zeros(states.nodes, int)
    track[states.pair_column] = states.pair_estimate
    if states.transposed.any():
        prices[:] = 0.0  # priced columns are truths there, which the oracle does not price
    else:
        full[states.columns.step, track[states.columns.node]] = prices
    solution = Solution(weights=np.zeros(len(states.pair)), prices=prices, status="")
    bounds, _, _ = certify(states, solution)
    assert bounds.lower >= lagrangian_bound(problem, full) - 1e-12


def test_gamma_beyond_every_price() -> None:
    truth, estimate = scene(3, 4, 4, 10, side=4.0)
    held = evaluate(truth, estimate, 2.0, 2, 1000.0)
    for gamma in (1e6, 1e100, 1e300):
        result = evaluate(truth, estimate, 2.0, 2, gamma)
        assert result.certified
        assert result.counts["switch"] == 0
        assert result.tgospa == pytest.approx(held.tgospa, rel=1e-12)


def test_limits_give_true_brackets() -> None:
    truth, estimate = scene(9, 20, 20, 60, side=12.0, noise=1.5)
    exact = evaluate(truth, estimate, 5.0, 2, 2.0)
    for solver in (
        Certified(time_limit=1e-3),
        Certified(time_limit=0.05),
        Sinkhorn(time_limit=0.01),
    ):
        result = evaluate(truth, estimate, 5.0, 2, 2.0, solver=solver)
        assert result.lower_bound <= exact.tgospa * (1 + 1e-12)
        assert result.upper_bound >= exact.tgospa * (1 - 1e-12)
        assert not result.solver["finished"]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Parameters(cutoff=0.0, switch_penalty=2.0),
        lambda: Parameters(cutoff=float("nan"), switch_penalty=2.0),
        lambda: Parameters(cutoff=10.0, order=0.5, switch_penalty=2.0),
        lambda: Parameters(cutoff=10.0, switch_penalty=-1.0),
        lambda: Parameters(cutoff=1e-200, order=3, switch_penalty=2.0),
        lambda: Certified(gap=-1.0),
        lambda: Certified(time_limit=0.0),
        lambda: Exact(time_limit=-1.0),
        lambda: Sinkhorn(epsilon=0.0),
        lambda: solver_class("simplex"),
    ],
)
def test_settings_out_of_range(wrong) -> None:
    with pytest.raises(ConfigError, match=r"must be|range|there are"):
        wrong()


def test_problem_rejects_pairs_across_steps() -> None:
    zero, one = np.array([0]), np.array([1])
    with pytest.raises(ConfigError, match="different steps"):
        tgospa_problem(
            parameters=Parameters(cutoff=10.0, switch_penalty=2.0),
            steps=2, truths=1, estimates=1,
            truth_step=zero, truth_track=zero, estimate_step=one, estimate_track=zero,
            truth_row=zero, estimate_row=zero, distance=np.array([1.0]),
        )  # fmt: skip


def test_a_custom_solver_keeps_its_arrays() -> None:
    """Only what our own solvers return may be written over by the proof."""
    truth, estimate = scene(1, 5, 6, 20, side=6.0)

    class Cached(Solver):
        name = "cached"

        def __call__(
            self, states: States, stopwatch: Stopwatch, warm_start: object = None
        ) -> Solution:
            del warm_start
            if not hasattr(self, "found"):
                answer = Certified()(states, stopwatch)
                self.found = (answer.weights, answer.prices)
            return Solution(weights=self.found[0], prices=self.found[1], status=Status.SOLVED)

    solver = Cached()
    first = evaluate(truth, estimate, 4.0, 2, 1.0, solver=solver)
    again = evaluate(truth, estimate, 4.0, 2, 1.0, solver=solver)
    assert first.certified
    assert first.tgospa == again.tgospa
    assert first.lower_bound == again.lower_bound
