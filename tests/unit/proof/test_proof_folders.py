"""Proof folders: what is claimed follows from the folder, and from no folder more than is true."""

import ast
import copy
import csv
import hashlib
import json
import sys
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from claims import claim, may_be_refused, reference_of
from examples import seeds
from far_scenes import FarScene
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import ANY_ORDERS, ORDERS, SWITCH, WHOLE_ORDERS, far_scenes, pairs_of_sets, scene

from tgospa_eval import ConfigError, Result, Sinkhorn, evaluate
from tgospa_eval.distances import Norm
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.write import proof_texts

DISTANCES = st.sampled_from(["euclidean", "manhattan", "chebyshev"])

Document = dict[str, Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that tests write over."""
    return tmp_path_factory.mktemp("proof")


def write(result: Result, folder: Path) -> Document:
    """Write the proof of a result into a folder, in place of another; its document."""
    for file in folder.iterdir():
        file.unlink()
    for name, text in proof_texts(result.proof).items():
        (folder / name).write_bytes(text.encode())
    document: Document = json.loads((folder / "proof.json").read_text(encoding="utf-8"))
    return document


def read(folder: Path, document: Document) -> Any:
    """A folder as the checker reads it, with this document."""
    return verify_tgospa.ClaimedScene(verify_tgospa.Folder(folder), document)


def verify(folder: Path) -> str:
    """The verdict on a folder."""
    found: str = verify_tgospa.verify(verify_tgospa.Folder(folder))
    return found


def shares(folder: Path, document: Document) -> tuple[Fraction, Fraction]:
    """The bounds that the checker finds, in units of c^p."""
    checked = read(folder, document)
    lower = verify_tgospa.lower_bound(checked, document)
    upper = verify_tgospa.upper_bound(checked, document)
    one = 1 << checked.bits
    return Fraction(lower, one), Fraction(upper, one * document["weight_unit"])


# --- what the program writes ----------------------------------------------------------------------


@given(pairs_of_sets(most=5, most_steps=8), ORDERS, SWITCH, DISTANCES, st.sampled_from([0.5, 2, 9]))
def test_found_bounds_are_within_the_printed_ones(
    folder: Path, sides: tuple[Any, Any], p: float, gamma: float, distance: str, c: float
) -> None:
    result = evaluate(*sides, c, p, gamma, distance=distance)
    document = write(result, folder)
    assert verify(folder).startswith("verified: ")
    lower, upper = shares(folder, document)
    # Not a digit is lost: these distances have proven errors, so the certificate has allowed more.
    assert (
        Fraction(result.proof.bounds.lower) <= lower <= upper <= Fraction(result.proof.bounds.upper)
    )
    printed = result.total_bounds
    assert Decimal(printed[0]) <= Decimal(document["upper_bound"])
    assert float(document["lower_bound"]) == pytest.approx(printed[0], rel=1e-14)
    assert float(document["upper_bound"]) == pytest.approx(printed[1], rel=1e-14)


@given(far_scenes(orders=WHOLE_ORDERS | ANY_ORDERS, farthest=12.0, most=4))
def test_cutoffs_far_above_the_errors(folder: Path, scene: FarScene) -> None:
    try:
        result = claim(scene)
    except ConfigError:
        assume(may_be_refused(reference_of(scene)))
        raise
    assume(result.certified and not result.within_rounding)
    document = write(result, folder)
    lower, upper = shares(folder, document)
    assert upper - lower <= Fraction(1, 10**9) * upper
    reference = reference_of(scene)
    assert reference.costs.of_share(lower)[0] <= reference.upper
    assert reference.costs.of_share(upper)[1] >= reference.lower


@pytest.mark.parametrize("solver", ["certified", "exact", Sinkhorn(epsilon=0.1)], ids=str)
def test_all_solvers_in_a_crowd_with_fractional_optimum(folder: Path, solver: Any) -> None:
    result = evaluate(*scene(3, 8, 9, 25, side=6.0, noise=1.0), 5, 2, 2, solver=solver)
    lower, upper = shares(folder, write(result, folder))
    assert (
        Fraction(result.proof.bounds.lower) <= lower <= upper <= Fraction(result.proof.bounds.upper)
    )


@pytest.mark.parametrize("several", ["truth", "estimate"])
def test_a_single_track_on_one_side(folder: Path, several: str) -> None:
    """Its prices are those of a value function: the program itself needs none."""
    one = np.cumsum(np.ones((40, 1, 2)), axis=0)
    many = np.concatenate([one + 0.3 * k for k in range(4)], axis=1)
    for k in range(4):
        many[: 10 * k, k] = many[10 * k + 12 :, k] = np.nan
    sides = (many, one) if several == "truth" else (one, many)
    for gamma in (0.0, 0.5, 20.0):
        result = evaluate(*sides, 5, 2, gamma)
        lower, upper = shares(folder, write(result, folder))
        assert lower == pytest.approx(float(upper), rel=1e-12)
        assert lower >= Fraction(result.proof.bounds.lower)


@pytest.mark.parametrize(("settings", "exact"), [
    ({"distance": "iou", "cutoff": 0.7}, True),
    ({"distance": "haversine", "cutoff": 900.0}, False),
])  # fmt: skip
def test_distances_with_and_without_a_formula(
    folder: Path, settings: dict[str, Any], exact: bool
) -> None:
    rng = np.random.default_rng(5)
    truth = rng.uniform(1, 4, (12, 3, 4 if exact else 2))
    result = evaluate(truth, truth + rng.normal(0, 0.1, truth.shape), switch_penalty=1, **settings)
    document = write(result, folder)
    assert (folder / "distances.csv").exists() is not exact
    found = verify(folder)
    assert ("given the distances" in found) is not exact
    assert float(document["upper_bound"]) == pytest.approx(result.total, rel=1e-12)


def test_periodic_and_scaled_columns(folder: Path) -> None:
    rng = np.random.default_rng(6)
    truth = rng.uniform(-4, 400, (9, 4, 3))
    estimate = truth + rng.normal(0, 1, truth.shape)
    estimate[..., 1] += 360 * rng.integers(-3, 4, estimate.shape[:2])
    norm = Norm(name="euclidean", power=2.0, scale=(1, 0.1, 2.5), period=(np.inf, 360.0, np.inf))
    result = evaluate(truth, estimate, 10, 2, 3, distance=norm)
    document = write(result, folder)
    assert document["parameters"]["periodic"] == {"y": "360.0"}
    lower, upper = shares(folder, document)
    assert float(lower) == pytest.approx(result.proof.bounds.lower, rel=1e-9)
    assert float(upper) == pytest.approx(result.proof.bounds.upper, rel=1e-9)


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_steps_at_which_nothing_exists_are_in_no_table_and_no_proof(
    tmp_path: Path, seed: int
) -> None:
    """At the ends and between, of both forms of a block; nothing of the bounds is lost."""
    rng = np.random.default_rng(seed)
    shape = (24, int(rng.integers(1, 4)), 2)
    truth = np.cumsum(rng.normal(0, 0.5, shape), axis=0)
    estimate = truth[:, rng.permutation(shape[1])[: int(rng.integers(1, 4))]] + 0.4
    for side in (truth, estimate):
        side[rng.random(side.shape[:2]) < 0.2] = np.nan
    empty = rng.random(24) < 0.4
    empty[[0, 1, -1]] = True
    truth[empty] = estimate[empty] = np.nan
    result = evaluate(truth, estimate, 3, 2, float(rng.choice([0.3, 1.0, 9.0])))
    document = write(result, tmp_path)
    times = {t for _, t, _ in document["prices"]}
    times |= {t for row in document["assignment"] for t in row[2:4]}
    assert times
    assert times.isdisjoint(map(str, np.flatnonzero(empty).tolist()))
    assert verify(tmp_path).startswith("verified: ")
    lower, upper = shares(tmp_path, document)
    bounds = result.proof.bounds
    assert Fraction(bounds.lower) <= lower <= upper <= Fraction(bounds.upper)


@pytest.mark.parametrize("solver", ["exact", "certified"])
@pytest.mark.parametrize("rho", [0.1, 0.2, 0.3, 0.9])
def test_prices_that_are_no_doubles(tmp_path: Path, rho: float, solver: str) -> None:
    """The value is as small as what 1 - rho and rho are off by."""
    truth = [(0, 0, 2, 0), (2, 0, 1, 0), (0, 1, 2, 0), (1, 1, 1, 1), (2, 1, 1, 1)]
    estimate = [(1, 0, 1), (2, 0, 0), (0, 1, 0), (2, 1, 1)]
    result = evaluate(
        pd.DataFrame(truth, columns=["id", "t", "x", "ignored"]),
        pd.DataFrame(estimate, columns=["id", "t", "x"]),
        *(1e6, 2, 1e-3),
        rho=rho,
        solver=solver,
        ignore="marked",
    )
    result.proof.save(tmp_path / "p")
    assert verify(tmp_path / "p").startswith("verified: ")


def test_a_time_that_no_table_has_changes_nothing(proof: Document, tmp_path: Path) -> None:
    for rows in ({"prices": [["0", "2.5", 1]]}, {"assignment": [["0", "0", "2.5", "2.5", 1]]}):
        (tmp_path / "proof.json").write_text(json.dumps(proof | rows), encoding="utf-8")
        with pytest.raises(verify_tgospa.Wrong, match=r"no table has '2\.5'"):
            verify(tmp_path)


@pytest.mark.parametrize("name", ["a\udcff", "a" * 140_000])
def test_names_that_no_checker_reads_are_refused(tmp_path: Path, name: str) -> None:
    result = evaluate({name: np.zeros((3, 2))}, {"b": np.zeros((3, 2))})
    with pytest.raises(ConfigError, match="cannot hold the name"):
        result.proof.save(tmp_path / "p")
    assert not (tmp_path / "p").exists()


def test_a_distance_of_another_name_has_no_proof(tmp_path: Path) -> None:
    own = Norm(name="minkowski", power=1.0)
    result = evaluate(np.zeros((2, 1, 2)), np.zeros((2, 1, 2)), distance=own)
    with pytest.raises(ConfigError, match='cannot hold the distance "minkowski"'):
        result.proof.save(tmp_path / "p")


# --- what the checker believes --------------------------------------------------------------------


@given(
    far_scenes(most=3, farthest=2.0),
    st.integers(0, 2**32 - 1),
)
def test_no_prices_and_no_assignment_prove_too_much(
    folder: Path, scene: FarScene, seed: int
) -> None:
    """Bounds of arbitrary prices and assignments hold for the exact optimum."""
    rng = np.random.default_rng(seed)
    document = write(claim(scene), folder)
    checked = read(folder, document)
    times, unit = checked.times, 6
    assume(times)
    document["weight_unit"] = unit
    document["prices"] = [
        [j, t, int(2.0 ** (document["price_bits"] - 1) * rng.random())]
        for j in checked.estimates
        for t in times
        if rng.random() < 0.7
    ]
    who = rng.permutation(list(checked.estimates))[: len(checked.truths)].tolist()
    ends = [sorted(rng.integers(0, len(times), 2)) for _ in who]
    document["assignment"] = [
        [i, j, times[first], times[last], int(rng.integers(0, unit + 1))]
        for i, j, (first, last) in zip(checked.truths, who, ends, strict=False)
    ]
    try:
        lower, upper = shares(folder, document)
    except verify_tgospa.Wrong:  # switches that cost more than all objects
        assume(False)
    reference = reference_of(scene)
    assert reference.costs.of_share(lower)[0] <= reference.upper
    assert reference.costs.of_share(upper)[1] >= reference.lower


TRUTH = np.array([[[0.0, 0], [3, 0]]] * 4)
ESTIMATE = TRUTH[:, ::-1] + 0.5


@pytest.fixture
def proof(tmp_path: Path) -> Document:
    """The proof of a small scene, in the test's own folder."""
    return write(evaluate(TRUTH, ESTIMATE, 5, 2, 1), tmp_path)


def changed(document: Document, path: list[Any], value: Any) -> Document:
    """The document with another value in one place."""
    other = copy.deepcopy(document)
    place = other
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value(place[path[-1]]) if callable(value) else value
    return other


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["lower_bound"], lambda text: str(Decimal(text) * Decimal("1.0001")), "is not proven"),
        (["upper_bound"], lambda text: str(Decimal(text) * Decimal("0.9999")), "is not proven"),
        (["assignment", 0, 4], lambda weight: 2 * weight, "truth '0' is assigned more than once"),
        (["assignment", 0, 4], lambda weight: -weight, "must be a whole number"),
        (["assignment", 0, 0], "1", "truth '1' is assigned more than once at t = 0"),
        (["assignment", 0, 1], "0", "estimate '0' is assigned more than once at t = 0"),
        (["prices"], [["0", "1", -(2**80)]], "must be a whole number"),
        (["prices"], [["0", "1", 2**90]], "is not proven"),
        (["sha256", "truth.csv"], "0" * 64, "truth.csv was changed"),
        (["lower_bound"], lambda text: str(Decimal(text) * Decimal("1.0000001")), "is not proven"),
        (["upper_bound"], lambda text: str(Decimal(text) * Decimal("0.9999999")), "is not proven"),
        (["assignment", 0, 2], "1", "is not proven"),
        (["assignment", 0, 3], "2", "is not proven"),
        (["assignment"], lambda rows: rows[1:], "is not proven"),
        (["parameters", "order"], "3.0", "is not proven"),
        (["weight_unit"], lambda unit: unit - 1, "is assigned more than once"),
    ],
)
def test_a_changed_proof_is_refused(
    proof: Document, tmp_path: Path, path: list[Any], value: Any, message: str
) -> None:
    (tmp_path / "proof.json").write_text(json.dumps(changed(proof, path, value)), encoding="utf-8")
    with pytest.raises(verify_tgospa.Wrong, match=message):
        verify(tmp_path)


@pytest.mark.parametrize("name", ["truth.csv", "estimate.csv"])
def test_a_table_that_was_changed_in_a_last_digit(
    proof: Document, tmp_path: Path, name: str
) -> None:
    """Told by its digest; and with a new digest by the bounds, if it matters."""
    table = tmp_path / name
    text = table.read_text(encoding="utf-8").replace("0.5", "0.51").replace("3.0,", "3.01,")
    table.write_text(text, encoding="utf-8")
    with pytest.raises(verify_tgospa.Wrong, match=f"{name} was changed"):
        verify(tmp_path)
    proof["sha256"][name] = hashlib.sha256(table.read_bytes()).hexdigest()
    (tmp_path / "proof.json").write_text(json.dumps(proof), encoding="utf-8")
    with pytest.raises(verify_tgospa.Wrong, match="is not proven"):
        verify(tmp_path)


def test_a_stretch_that_ends_before_it_begins_is_no_assignment(
    proof: Document, tmp_path: Path
) -> None:
    """Two such would take weight away where others have put too much."""
    unit = proof["weight_unit"]
    back = [["0", "0", "3", "0", unit], ["1", "1", "3", "0", unit]]
    forth = [["0", "1", "0", "3", 2 * unit], ["1", "0", "0", "3", 2 * unit]]
    (tmp_path / "proof.json").write_text(
        json.dumps(proof | {"assignment": forth + back}), encoding="utf-8"
    )
    with pytest.raises(verify_tgospa.Wrong):
        verify(tmp_path)


def test_a_distance_that_is_listed_twice_counts_once(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    truth = rng.uniform(1, 4, (3, 1, 2))
    document = write(evaluate(truth, truth + 0.001, 900, distance="haversine"), tmp_path)
    table = tmp_path / "distances.csv"
    text = table.read_text(encoding="utf-8")
    table.write_text(text + text.splitlines()[1] + "\n", encoding="utf-8")
    document["sha256"]["distances.csv"] = hashlib.sha256(table.read_bytes()).hexdigest()
    (tmp_path / "proof.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ValueError, match="duplicate pair"):
        verify(tmp_path)


@pytest.mark.parametrize(
    ("parameters", "table", "message"),
    [
        ({"distance": "manhattan", "periodic": {"y": "-9.0"}}, "", "out of range"),
        ({"scale": {"y": "0.0"}}, "", "out of range"),
        ({"scale": {"y": "-1.0"}}, "", "out of range"),
        ({"switch_penalty": "-1.0"}, "", "out of range"),
        ({"order": "1e60"}, "", "out of range"),
        ({"columns": ["x"]}, "", "must have the columns id, t, x,"),
        ({"columns": ["x", "x"]}, "", "the distance euclidean cannot have the columns"),
        ({"distance": "HOTA"}, "", "the distance 'HOTA' is unknown"),
        ({"metric": "HOTA"}, "", "parameters has an unknown 'metric'"),
        ({"existence": "use"}, "", "an unknown 'existence'"),
        ({"inner": "euclidean"}, "", "an unknown 'inner'"),
        ({"scale": {"z": "2"}}, "", "scale has an unknown 'z'"),
        ({"scale": {"x": 2.0}}, "", "x has 2.0 in place of a str"),
        ({"scale": {"x": "inf"}}, "", "'inf' is not a plain decimal number"),
        ({"cutoff": "1_0"}, "", "'1_0' is not a plain decimal number"),
        ({"cutoff": "0x1p3"}, "", "'0x1p3' is not a plain decimal number"),
        ({"cutoff": "\u0661"}, "", "'\u0661' is not a plain decimal number"),
        ({"cutoff": " 1"}, "", "' 1' is not a plain decimal number"),
        ({"cutoff": "1e999"}, "", "in the range of binary64"),
        ({"cutoff": "1e9999"}, "", "is not a plain decimal number"),
        ({"cutoff": "0" * 61}, "", "is not a plain decimal number"),
        ({}, "9,9,nan,9.0\n", "'nan' is not a plain decimal number"),
        ({}, "9,9,1_0,9.0\n", "'1_0' is not a plain decimal number"),
        ({}, "9,\u0663,1,9.0\n", "'\u0663' is not a plain decimal number"),
        ({}, "9,1e99999999,1,9.0\n", "is not a plain decimal number"),
        ({}, "9,9,9.0,9.0,9.0\n", "in each row"),
        ({}, '"9,9,9.0,9.0\n', "unexpected end of data"),
        ({}, "9,0,9.0,9.0\n9,0.0,9.0,9.0\n", "written in two ways"),
    ],
)
def test_what_is_no_metric_or_no_table_proves_nothing(
    tmp_path: Path, parameters: Document, table: str, message: str
) -> None:
    """Each of these makes distances smaller, or hides rows, if it is read."""
    truth = np.zeros((2, 1, 2))
    document = write(evaluate(truth, truth + 1.0, 10, 2, 5), tmp_path)
    path = tmp_path / "truth.csv"
    path.write_text(path.read_text(encoding="utf-8") + table, encoding="utf-8")
    document["sha256"]["truth.csv"] = hashlib.sha256(path.read_bytes()).hexdigest()
    document["parameters"] |= parameters
    document |= {"lower_bound": "0", "upper_bound": "1e9"}
    (tmp_path / "proof.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises((ValueError, csv.Error), match=message):
        verify(tmp_path)


def test_a_name_that_is_there_twice(proof: Document, tmp_path: Path) -> None:
    """Who reads the first of two cutoffs takes the claim for another one."""
    path = tmp_path / "proof.json"
    text = path.read_text(encoding="utf-8")
    for name in ('"cutoff": ', '"upper_bound": '):
        assert text.count(name) == 1
        path.write_text(text.replace(name, f'{name}"1e9", {name}'), encoding="utf-8")
        assert verify_tgospa.main([str(tmp_path)]) == 3
    assert proof == json.loads(text)


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param("[" * 100_000, id="deep"),
        *("{", "[]", "{}", '{"schema": "tgospa-eval/proof/2"}', None),
    ],
)
def test_damaged_folders(
    proof: Document, tmp_path: Path, damage: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    del proof
    path = tmp_path / "proof.json"
    path.unlink() if damage is None else path.write_text(damage, encoding="utf-8")
    assert verify_tgospa.main([str(tmp_path)]) == 3
    assert "not a complete proof folder" in capsys.readouterr().err


# --- the script -----------------------------------------------------------------------------------


def test_the_script_is_short_and_needs_the_standard_library_alone() -> None:
    path = Path(verify_tgospa.__file__)
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 450
    modules = {
        name.name.partition(".")[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import)
        for name in node.names
    } | {
        (node.module or "").partition(".")[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom)
    }
    assert modules <= set(sys.stdlib_module_names)


def test_powers_are_enclosed() -> None:
    """Roots and other powers, against the same in 400 digits."""
    import decimal

    rng = np.random.default_rng(1)
    halves = (Fraction(1, 2), Fraction(3, 2), Fraction(2), Fraction(5, 4), Fraction(29, 16))
    for exponent in (*halves, Fraction(33, 32), Fraction(1.7), Fraction(2.9)):
        for _ in range(30):
            a, b = (int(rng.integers(1, 10**6)) for _ in range(2))
            low, high = verify_tgospa.power(a, b, exponent, 200)
            with decimal.localcontext(prec=400):
                power = Decimal(exponent.numerator) / exponent.denominator
                value = (power * (Decimal(a) / b).ln()).exp() * 2**200
                # Squares and the like are exact, but not by way of logarithms.
                assert low - Decimal("1e-9") <= value <= high + Decimal("1e-9")
            assert high - low <= 2
    assert verify_tgospa.power(9, 4, Fraction(1, 2), 3) == (12, 12)
    assert verify_tgospa.power(0, 7, Fraction(1.7), 8) == (0, 0)
