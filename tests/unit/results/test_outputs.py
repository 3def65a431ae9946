"""What a result says, in every form: attributes, JSON, tables, text."""

import csv
import io
import json
import math
import pickle
import re
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke, Write

from tgospa_eval import (
    Result,
    Trajectories,
    __version__,
    evaluate,
    read_trajectories,
    simulate,
)
from tgospa_eval.results.records import Columns
from tgospa_eval.show.result_text import REPORTS, explanation_document
from tgospa_eval.show.table_text import csv_text

Pair = tuple[str, str]

PARTS = ("localisation", "missed", "false", "switch")

# One truth, followed by 7 and then by 12, missed at the end; 9 is false. Every cost is known.
TRUTH = "id,t,x\n" + "".join(f"3,{t},0\n" for t in (1, 2, 3, 4))
ESTIMATE = "id,t,x\n7,1,1\n7,2,-1\n9,2,100\n12,3,2\n"


def parse(text: str) -> Any:
    """JSON as a strict reader sees it: NaN and Infinity are errors, and so are repeated keys."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in the JSON")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert len(dict(pairs)) == len(pairs)
        return dict(pairs)

    return json.loads(text, parse_constant=refuse, object_pairs_hook=unique)


def read_csv(text: str) -> list[dict[str, str]]:
    """Rows of a CSV table."""
    return list(csv.DictReader(io.StringIO(text)))


def total(rows: list[dict[str, Any]], *names: str) -> float:
    """Sum of columns of a table."""
    return math.fsum(float(row[name]) for row in rows for name in names)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The scene of which every cost is known, with p = 2."""
    folder = tmp_path_factory.mktemp("known")
    (folder / "t.csv").write_text(TRUTH, encoding="utf-8")
    (folder / "e.csv").write_text(ESTIMATE, encoding="utf-8")
    return evaluate(read_trajectories(folder / "t.csv"), read_trajectories(folder / "e.csv"))


@pytest.fixture(scope="module")
def sample(quickstart: Pair) -> Result:
    """The sample data."""
    return evaluate(*map(read_trajectories, quickstart), unit="m")


# --- JSON -----------------------------------------------------------------------------------------


def test_keys_of_the_json(sample: Result) -> None:
    document = parse(sample.to_json())
    assert set(document) == {
        "schema", "headline", "summary",
        "metric", "tgospa", "total", "lower_bound", "upper_bound", "relative_gap",
        "certified", "within_rounding",
        "localisation", "missed", "false", "switch", "counts", "normalised", "parameters", "sizes",
        "judged", "per_step", "switches", "worst", "solver", "timings", "input", "version",
        "warnings", "notices", "files",
    }  # fmt: skip
    assert document["schema"] == "tgospa-eval/result/1"
    assert document["version"] == __version__
    assert set(document["counts"]) == {"missed", "false", "switch"}
    ends = ("lower_bound", "upper_bound")
    assert set(document["normalised"]) == {"tgospa", "per_object"}.union(
        ends, (f"per_object_{end}" for end in ends)
    )
    assert set(document["sizes"]) == {
        "truth", "estimates", "steps", "candidate_pairs", "pair_steps", "components",
    }  # fmt: skip
    assert {"t", *PARTS, "total"} == set(document["per_step"][0])
    assert set(document["switches"][0]) == {"t", "truth", "from", "to", "mass", "cost"}
    assert set(document["worst"]) == {"steps", "truth", "estimates"}
    assert {"name", "status", "iterations", "kernel"} <= set(document["solver"])
    timings = {"read", "distances", "solve", "certify", "report", "total"}
    assert timings <= set(document["timings"])
    assert {"preparation", "sweeps", "lp"} <= set(document["timings"]["solve"])
    for side in document["input"].values():
        assert set(side) == {"rows", "sha256", "left_out"}
        assert re.fullmatch("[0-9a-f]{64}", side["sha256"])
    assert set(document["input"]) == {"truth", "estimate"}


@pytest.mark.parametrize(
    ("order", "solver"), [(1, "sinkhorn"), (1.5, "certified"), (2, "sinkhorn"), (3, "certified")]
)
def test_the_numbers_of_the_json_agree(quickstart: Pair, order: float, solver: str) -> None:
    result = evaluate(*map(read_trajectories, quickstart), 7.0, order, 3.0, solver=solver)
    document = parse(result.to_json())
    value = document["total"]
    assert document["upper_bound"] >= document["tgospa"] >= document["lower_bound"] > 0
    assert document["tgospa"] == pytest.approx(document["upper_bound"], rel=1e-12)
    assert document["tgospa"] ** order == pytest.approx(value, rel=1e-12)
    assert math.fsum(document[part] for part in PARTS) == pytest.approx(value, rel=1e-12)
    steps = document["per_step"]
    for part in (*PARTS, "total"):
        expected = value if part == "total" else document[part]
        assert total(steps, part) == pytest.approx(expected, rel=1e-12)
    for step in steps:
        assert total([step], *PARTS) == pytest.approx(step["total"], rel=1e-12)
    counts = document["counts"]
    assert document["missed"] == pytest.approx(counts["missed"] * 7.0**order / 2, rel=1e-12)
    assert document["false"] == pytest.approx(counts["false"] * 7.0**order / 2, rel=1e-12)
    assert document["switch"] == pytest.approx(counts["switch"] * 3.0**order, rel=1e-12)
    switches = document["switches"]
    assert total(switches, "cost") == pytest.approx(document["switch"], rel=1e-12)
    assert total(switches, "mass") == pytest.approx(counts["switch"], rel=1e-12)
    lower, upper = document["lower_bound"] ** order, document["upper_bound"] ** order
    assert document["relative_gap"] == pytest.approx((upper - lower) / upper, abs=1e-12)
    occupied = len(steps)  # something exists at every step of the sample
    assert document["normalised"]["tgospa"] == pytest.approx((value / occupied) ** (1 / order))
    assert document["parameters"]["cutoff"] == 7
    assert document["parameters"]["order"] == order
    assert document["parameters"]["switch_penalty"] == 3
    assert document["parameters"]["solver"] == solver


@pytest.mark.parametrize("order", [1, 2, 3])
def test_every_number_of_a_known_scene(invoke: Invoke, write: Write, order: int) -> None:
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    status, out, _ = invoke(*paths, "-p", str(order), "--format", "json")
    document = parse(out)
    half, switch, far = 10**order / 2, 2**order, 2**order
    expected = {"localisation": 2 + far, "missed": half, "false": half, "switch": switch}
    assert status == 0
    for part, cost in expected.items():
        assert document[part] == pytest.approx(cost, rel=1e-12)
    assert document["total"] == pytest.approx(sum(expected.values()), rel=1e-12)
    assert document["certified"] is True
    assert document["counts"] == {"missed": 1, "false": 1, "switch": 1}
    assert document["sizes"] == {
        "truth": 1, "estimates": 3, "steps": 4, "candidate_pairs": 2, "pair_steps": 3,
        "components": 1,
    }  # fmt: skip
    table = [(step["t"], *(step[part] for part in PARTS)) for step in document["per_step"]]
    assert table == [
        pytest.approx(row, rel=1e-12)
        for row in ((1, 1, 0, 0, 0), (2, 1, 0, half, 0), (3, far, 0, 0, switch), (4, 0, half, 0, 0))
    ]
    (row,) = document["switches"]
    assert row.pop("cost") == pytest.approx(switch, rel=1e-12)
    assert row == {"t": 3, "truth": "3", "from": "7", "to": "12", "mass": 1}
    assert document["worst"]["steps"][0] == 2
    assert sorted(document["worst"]["steps"]) == [1, 2, 3, 4]
    assert document["worst"]["truth"] == ["3"]
    assert document["worst"]["estimates"][0] == "9"
    assert sorted(document["worst"]["estimates"]) == ["12", "7", "9"]  # a tie for p = 1
    assert [document["input"][side]["rows"] for side in ("truth", "estimate")] == [4, 4]


# --- times and digests ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (["1", "2"], [1, 2]),
        ([str(2**53), str(2**53 + 1)], [2**53, 2**53 + 1]),
        (["0.1", "0.25"], [0.1, 0.25]),
        (
            ["2024-01-01T00:00:00.000000001Z", "2024-01-01 01:00:00.000000002+01:00"],
            ["2024-01-01T00:00:00.000000001Z", "2024-01-01 01:00:00.000000002+01:00"],
        ),
    ],
)
def test_times_are_written_as_read(write: Write, texts: list[str], expected: list[Any]) -> None:
    path = write("a.csv", "id,t,x\n" + "".join(f"a,{text},1\n" for text in texts))
    result = evaluate(read_trajectories(path), read_trajectories(write("b.csv", "id,t,x\n")))
    assert [row["t"] for row in parse(result.to_json())["per_step"]] == expected
    assert [row["t"] for row in read_csv(REPORTS["csv"](result))] == texts


def test_the_digest_is_of_the_table_and_not_of_the_bytes(invoke: Invoke, write: Write) -> None:
    def digest(text: str, estimate: str = "id,t,x,y\n") -> str:
        paths = write("t.csv", text), write("e.csv", estimate)
        document = parse(invoke(*paths, "--format", "json").out)
        sha: str = document["input"]["truth"]["sha256"]
        return sha

    text = "id,t,x,y\na,1,2,3\nb,1,4,5\na,2,0.5,6\n"
    same = [
        text.replace("\n", "\r\n"),
        text.replace(",", ";"),
        "track_id,frame,y,x,class\na,2,6,5e-1,car\nb,1,5,4.0,car\na,1,3,2,car\n",
    ]
    assert {digest(other) for other in same} == {digest(text)}
    others = [
        text.replace("6", "7"),
        text.replace("b", "c"),
        text.replace("a,2", "a,3"),
        text.replace("b,1,4,5\n", ""),
    ]
    assert len({digest(other) for other in (text, *others)}) == 5
    # What the estimate is like is no property of the truth.
    assert digest(text, "id,t,x,y\nb,1,2,3\n") == digest(text)
    assert digest(text, "id,t,x,y\nb,0.5,2,3\n") == digest(text)


# --- the result folder ----------------------------------------------------------------------------


@pytest.fixture
def folder(invoke: Invoke, quickstart: Pair, tmp_path: Path) -> dict[str, Any]:
    """The result folder of the sample data, parsed."""
    assert invoke(*quickstart, "-o", "out").status == 0
    texts = {path.name: path.read_text("utf-8") for path in (tmp_path / "out").glob("[!.]*")}
    assert not any("\r" in text or "nan" in text.lower() for text in texts.values())
    return {
        name: parse(text) if name.endswith(".json") else read_csv(text)
        for name, text in texts.items()
    }


def test_tables_of_the_folder_agree_with_the_json(folder: dict[str, Any]) -> None:
    document = folder["result.json"]
    counts = document["counts"]

    def near(value: float) -> Any:
        return pytest.approx(value, rel=1e-12)

    assert [{k: float(v) for k, v in row.items()} for row in folder["per_step.csv"]] == [
        {k: float(v) for k, v in row.items()} for row in document["per_step"]
    ]

    pairs = folder["assignments.csv"]
    assert list(pairs[0]) == ["t", "truth", "estimate", "weight", "distance", "cost"]
    assert total(pairs, "cost") == near(document["localisation"])
    for row in pairs:
        assert 0 <= float(row["distance"]) < 10
        assert 0 < float(row["weight"]) <= 1
        cost = float(row["weight"]) * float(row["distance"]) ** 2
        assert float(row["cost"]) == near(cost)
    rows = {side: document["input"][side]["rows"] for side in ("truth", "estimate")}
    assert total(pairs, "weight") == near(rows["truth"] - counts["missed"])
    assert total(pairs, "weight") == near(rows["estimate"] - counts["false"])

    switches = folder["switches.csv"]
    assert list(switches[0]) == ["t", "truth", "from", "to", "mass", "cost"]
    as_json = [{k: "" if v is None else str(v) for k, v in r.items()} for r in document["switches"]]
    assert switches == as_json

    for side, kind in (("truth", "missed"), ("estimate", "false")):
        table = folder[f"per_{side}.csv"]
        assert len(table) == document["sizes"][{"truth": "truth", "estimate": "estimates"}[side]]
        assert total(table, "steps") == rows[side]
        assert total(table, "localisation") == near(document["localisation"])
        assert total(table, kind) == near(document[kind])
        assert total(table, f"{kind}_count") == near(counts[kind])
        assert total(table, "switch") == near(document["switch"])
        assert total(table, "switch_count") == near(counts["switch"])
        for row in table:
            mine = [pair for pair in pairs if pair[side] == row["id"]]
            assert float(row["localisation"]) == pytest.approx(total(mine, "cost"), rel=1e-9)
            unassigned = float(row["steps"]) - total(mine, "weight")
            assert float(row[f"{kind}_count"]) == pytest.approx(unassigned, abs=1e-9)

    spent = {row["stage"]: float(row["seconds"]) for row in folder["timings.csv"]}
    assert spent["read"] == document["timings"]["read"]
    assert spent["solve/lp"] == document["timings"]["solve"]["lp"]
    assert spent["total"] >= spent["read"]


def test_folder_tables_of_a_known_scene(known: Result) -> None:
    frame = known.assignments
    assert frame[["t", "truth", "estimate"]].to_numpy().tolist() == [
        [1, "3", "7"],
        [2, "3", "7"],
        [3, "3", "12"],
    ]
    assert frame["distance"].tolist() == pytest.approx([1, 1, 2], rel=1e-12)
    assert known.per_truth.to_dict("records") == [
        pytest.approx(
            {"id": "3", "steps": 4, "localisation": 6, "missed": 50, "switch": 4}
            | {"missed_count": 1, "switch_count": 1, "followed": 0.75, "completeness": 0.5}
            | {"rmse": 2**0.5, "fragments": 0, "longest_stretch": 3, "time_to_first": 0}
        )
    ]
    by_id = known.per_estimate.set_index("id")
    assert by_id["false"].to_dict() == {"7": 0, "9": 50, "12": 0}
    assert by_id["localisation"].to_dict() == pytest.approx({"7": 2, "9": 0, "12": 4})
    assert by_id["switch"].to_dict() == pytest.approx({"7": 2, "9": 0, "12": 2})


# --- text -----------------------------------------------------------------------------------------


def test_table_of_the_sample(invoke: Invoke, quickstart: Pair) -> None:
    _, out, _ = invoke(*quickstart, "--unit", "m")
    assert re.match(r"TGOSPA = 41\.788 m, exact: proven", out)
    assert "\n5 ground-truth objects, 7 estimates, 56 steps\n" in out
    for pattern in (
        r"c += 10 m, .*",
        r"p += 2, .*",
        r"gamma += 2 m, .*",
        r"localisation +284\.24 +16\.3 %",
        r"missed +1,050 +60\.1 % +21  .*",
        r"false +400 +22\.9 % +8  .*",
        r"switch +12 +0\.7 % +3  .*",
        r"total +1,746\.24 +100\.0 % .*",
        r"per step +5\.58416 m .*",  # (1746.24 / 56) ** (1 / 2)
        r"worst objects +5 .*",
        r"worst estimates +107 .*",
        r"37 +1: 101 -> 103",
        r"12 +5: none -> 106 +\(0\.5 of a switch\)",
        r"solver +certified: solved",
    ):
        assert re.search(rf"^ +{pattern}$", out, re.MULTILINE), pattern


def test_csv_is_per_step(sample: Result) -> None:
    rows = read_csv(REPORTS["csv"](sample))
    assert list(rows[0]) == ["t", *PARTS, "total"]
    assert [row["t"] for row in rows] == [str(t) for t in range(3, 59)]
    assert total(rows, "total") == pytest.approx(sample.total, rel=1e-12)


def test_values_that_are_not_exact_are_ranges() -> None:
    """Per step and per object too, in all reports."""
    truth, estimate = simulate(targets=12, steps=30, seed=3, area=60.0, noise=3.0)
    options = {"solver": "sinkhorn", "epsilon": 0.9, "gap": 0.5}
    result = evaluate(truth, estimate, 10.0, 2, 5.0, **options)
    assert not result.certified
    each, low, high = result.normalised, result.lower_bound, result.upper_bound
    assert each["lower_bound"] == pytest.approx(low / 30**0.5, rel=1e-12)
    assert each["upper_bound"] == pytest.approx(high / 30**0.5, rel=1e-12)
    assert each["lower_bound"] < each["tgospa"] <= each["upper_bound"]
    step = f"{each['lower_bound']:.6g} to {each['tgospa']:.6g}"
    per_object = f"{each['per_object_lower_bound']:.6g} to {each['per_object']:.6g}"
    total = f"{result.total_bounds[0]:,.6g} to {result.total:,.6g}"
    for name in ("table", "markdown", "latex"):
        text = REPORTS[name](result)
        assert f" {step}" in text
        assert f" {per_object}" in text
        assert name == "table" or total in text
    short = f"{each['per_object_lower_bound']:.3g} to {each['per_object']:.3g}"
    assert result.headline.endswith(f"TGOSPA per object and step {short}")
    assert f"Per step {step}, per object and step {per_object}." in result.to_html()
    lines = explanation_document(result.explain(1)).lines
    assert any(line.startswith(f"total {total}, at the upper end: ") for line in lines)


def test_markdown(sample: Result) -> None:
    lines = REPORTS["markdown"](sample).splitlines()
    assert "41.788 m" in lines[0]
    assert lines[2].startswith("89.2 % of 195 object-steps followed, RMS error 1.28 m, 3 switches")
    assert lines[4] == "c = 10, p = 2, gamma = 2"
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[6:]]
    assert ["detection rate", "0.8923"] in cells
    assert cells[0] == ["part", "cost", "share", "count"]
    assert "> 53 of 56 steps are in both files" in "\n".join(lines)
    assert lines[-1].endswith("per step 5.58416 m; per object and step 2.9925 m")
    assert cells[2:8] == [
        ["localisation", "284.24", "16.3 %", ""],
        ["missed", "1,050", "60.1 %", "21"],
        ["false", "400", "22.9 %", "8"],
        ["switch", "12", "0.7 %", "3"],
        ["total", "1,746.24", "100.0 %", ""],
        ["TGOSPA", "41.788", "", ""],
    ]


def test_markdown_splits_localisation_of_normal_laws() -> None:
    truth = Trajectories.from_array(np.zeros((1, 1, 2)))
    law = Trajectories.from_array(np.full((1, 1, 2), 0.6), covariance=0.5 * np.eye(2))
    result = evaluate(truth, law, 10.0, distance="gaussian-wasserstein")
    lines = REPORTS["markdown"](result).splitlines()
    assert lines[8:11] == [
        "| localisation | 1.72 | 100.0 % |  |",
        "| of which means | 0.72 | 41.9 % |  |",  # 2 * 0.6^2
        "| of which spread | 1 | 58.1 % |  |",  # the trace
    ]


def test_latex(sample: Result) -> None:
    lines = REPORTS["latex"](sample).splitlines()
    assert lines[0].startswith("% ")
    assert "41.788 m" in lines[0]
    rows = [line.removesuffix(r"\\").split("&") for line in lines if line.endswith(r"\\")]
    assert {len(row) for row in rows} == {4, 2}
    assert [[cell.strip() for cell in row] for row in rows[1:7]] == [
        ["localisation", "284.24", r"16.3 \%", ""],
        ["missed", "1,050", r"60.1 \%", "21"],
        ["false", "400", r"22.9 \%", "8"],
        ["switch", "12", r"0.7 \%", "3"],
        ["total", "1,746.24", r"100.0 \%", ""],
        ["TGOSPA", "41.788", "", ""],
    ]
    assert [line for line in lines if line.startswith((r"\begin", r"\end"))] == [
        r"\begin{tabular}{lrrr}",
        r"\end{tabular}",
        r"\begin{tabular}{lr}",
        r"\end{tabular}",
    ]


def test_html_of_a_notebook(sample: Result) -> None:
    html = sample._repr_html_()
    assert html.count("<table") == html.count("</table>") == 1
    assert "http" not in html
    assert "<script" not in html
    for name, number in (("TGOSPA", "41.788"), ("missed", "1,050"), ("false", "400")):
        assert re.search(rf"{name}\D*{re.escape(number)}\D", html)


# --- empty sets -----------------------------------------------------------------------------------


@pytest.mark.parametrize("format_", list(REPORTS))
def test_nothing_against_nothing(invoke: Invoke, write: Write, format_: str) -> None:
    paths = write("t.csv", "id,t,x,y\n"), write("e.csv", "id,t,x,y\n")
    status, out, _ = invoke(*paths, "--format", format_, "-o", "out")
    assert status == 0
    assert out
    assert not re.search(r"\bnan\b", out, re.IGNORECASE)
    if format_ == "json":
        document = parse(out)
        for name in ("tgospa", "total", "lower_bound", "upper_bound", "relative_gap", *PARTS):
            assert document[name] == 0
        assert document["certified"] is True
        assert document["normalised"] == {"tgospa": 0, "lower_bound": 0, "upper_bound": 0}
        assert set(document["counts"].values()) == {0}
        assert set(document["sizes"].values()) == {0}
        assert document["per_step"] == document["switches"] == []
        assert document["worst"] == {"steps": [], "truth": [], "estimates": []}


@pytest.mark.parametrize(
    ("part", "format_"), [*(("missed", name) for name in REPORTS), ("false", "json")]
)
def test_something_against_nothing(invoke: Invoke, write: Write, part: str, format_: str) -> None:
    paths = (
        write("some.csv", "id,t,x,y\na,1,0,0\nb,1,0,0\na,2,0,0\n"),
        write("no.csv", "id,t,x,y\n"),
    )
    pair = paths if part == "missed" else paths[::-1]
    status, out, _ = invoke(*pair, "-c", "4", "--format", format_)
    assert status == 0
    if format_ == "csv":
        assert total(read_csv(out), part) == 24  # three half cutoffs: 3 * 4 ** 2 / 2
    else:
        assert re.search(r"\b24\b", out)
    if format_ == "json":
        document = parse(out)
        assert document["total"] == document[part] == pytest.approx(24, rel=1e-12)
        assert sum(document["counts"].values()) == document["counts"][part] == 3
        assert document["normalised"]["tgospa"] == pytest.approx(math.sqrt(12), rel=1e-12)
        assert document["worst"]["steps"] == [1, 2]


def test_a_perfect_estimate_costs_nothing(quickstart: Pair) -> None:
    truth = read_trajectories(quickstart[0])
    result = evaluate(truth, truth)
    assert (result.tgospa, result.total, result.certified) == (0, 0, True)
    assert all(report(result) for report in REPORTS.values())
    assert result.worst() == {"steps": [], "truth": [], "estimates": []}


# --- Python ---------------------------------------------------------------------------------------


def test_results_come_back_from_pickles(quickstart: Pair, sample: Result) -> None:
    sides = (pd.read_csv(path).assign(**{"class": "car"}) for path in quickstart)
    classes = evaluate(*sides, cutoff=10.0, switch_penalty=5.0, by="class")
    repairs = sample.explain(2)
    assert isinstance(repairs.result, Result)
    assert all(type(part) is Result for part in classes.results.values())
    for result in (sample, classes):
        again = pickle.loads(pickle.dumps(result))
        assert type(again) is type(result)
        assert (again.to_json(), repr(again)) == (result.to_json(), repr(result))
    assert callable(pickle.loads(pickle.dumps(sample)).proof.save)
    repaired = pickle.loads(pickle.dumps(repairs)).repaired()
    assert (repaired.state == repairs.repaired().state).all()


def test_attributes_bear_the_names_of_the_json(sample: Result) -> None:
    document = parse(sample.to_json())
    for name, value in document.items():
        if name in ("schema", "worst"):
            continue
        attribute = getattr(sample, name)
        if isinstance(attribute, pd.DataFrame):
            attribute = attribute.astype(object).where(attribute.notna(), None).to_dict("records")
        if name == "warnings":
            attribute = [notice.record() for notice in attribute]
        attribute = list(attribute) if name == "notices" else attribute
        assert attribute == value, name


def test_metrics_are_flat_numbers_of_the_json(known: Result) -> None:
    """Localisation 1 + 1 + 4; one miss and one false target, c^2/2 = 50 each; one switch, 4."""
    found = known.metrics()
    assert all(type(value) is float for value in found.values())
    assert found.pop("relative_gap") < 1e-9
    document = parse(known.to_json())
    for path, value in found.items():
        assert value == reduce(getitem, path.split("."), document), path
    found = {path: value for path, value in found.items() if not path.startswith("summary.")}
    assert found == pytest.approx({
        "tgospa": 110**0.5, "total": 110, "lower_bound": 110**0.5, "upper_bound": 110**0.5,
        "certified": 1, "localisation": 6, "missed": 50, "false": 50, "switch": 4,
        "counts.missed": 1, "counts.false": 1, "counts.switch": 1,
        "normalised.tgospa": 27.5**0.5,
        "normalised.lower_bound": 27.5**0.5, "normalised.upper_bound": 27.5**0.5,
        "normalised.per_object": (each := (110 / known.evaluated_on.truth_states) ** 0.5),
        "normalised.per_object_lower_bound": each, "normalised.per_object_upper_bound": each,
    })  # fmt: skip
    assert "metrics" in dir(known)


def test_metrics_have_the_split_where_there_is_one() -> None:
    points = Trajectories.from_array(np.zeros((2, 1, 2)))
    found = evaluate(points, points, cutoff=1.0, distance="gaussian-wasserstein").metrics()
    assert (found["localisation_mean"], found["localisation_spread"]) == (0.0, 0.0)


def test_tables_are_frames(sample: Result) -> None:
    assert sample.per_step.columns.tolist() == ["t", *PARTS, "total"]
    assert all(np.issubdtype(kind, np.number) for kind in sample.per_step.dtypes)


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({}, "\n"),
        ({"a": [], "=b": []}, "a,'=b\n"),
        (
            {"a": ["=1", "-5", "b", "b"], "n": [1, None, 2.5, True]},
            "a,n\n'=1,1\n-5,\nb,2.5\nb,True\n",
        ),
        ({"a": ["x\r\ny", "-z"], "n": [0.1, 2]}, 'a,n\n"x\r\ny",0.1\n\'-z,2\n'),
        ({"a": ["x\ry", 'say "no"', None], "n": [1, 2, 3]}, 'a,n\n"x\ry",1\n"say ""no""",2\n,3\n'),
    ],
)
def test_tables_as_csv(table: Columns, text: str) -> None:
    assert csv_text(table) == text
