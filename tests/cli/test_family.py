"""``--rho`` and ``--step-weights`` as a user types them."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from answer import Answer

Run = Callable[..., Answer]
Write = Callable[[str, str], str]


@pytest.fixture
def pair(write: Write) -> list[str]:
    return [
        write("truth.csv", "id,t,x\na,0,0\na,1,0\na,2,0\n"),
        write("estimate.csv", "id,t,x\nb,0,1\nb,1,1\n"),
        *("-c", "5", "-g", "1"),
    ]


def test_prices_of_missed_and_false(invoke: Run, pair: list[str]) -> None:
    answer = invoke(*pair, "--rho", "0.3")
    assert answer.status == 0
    assert answer.out.startswith("TGOSPA = 4.41588, exact")
    words = " ".join(answer.out.split())
    assert "a missed target costs (1 - rho) c^p = 17.5, a false one rho c^p = 7.5" in words
    document = json.loads(invoke(*pair, "--rho", "0.3", "--format", "json").out)
    assert (document["metric"], document["parameters"]["rho"]) == ("quasi-tgospa", 0.3)
    assert "rho" not in json.loads(invoke(*pair, "--format", "json").out)["parameters"]
    assert "rho is 1: must be between 0 and 1" in invoke(*pair, "--rho", "1").err
    table = invoke(*pair, "--sweep", "rho=0.3,0.5", "--format", "csv").out.splitlines()
    assert table[0].startswith("rho,tgospa")
    assert [float(line.split(",")[3]) for line in table[1:]] == pytest.approx([19.5, 14.5])
    shown = invoke(*pair, "--sweep", "rho=0.3,0.5", "-o", "out", "--pictures", "png").out
    assert "at 2 values of the rho from rho = 0.3 to 0.5, all proven exact" in shown
    assert "c = 5, p = 2, gamma = 1; euclidean" in shown
    assert Path("out/sweep.png").exists()


def test_a_score_beside_the_value(invoke: Run, pair: list[str]) -> None:
    options = ("--similarity", "2")
    found = json.loads(invoke(*pair, *options, "--format", "json").out)["similarity"]
    assert (found["false_targets"], found["score_of_false_targets"]) == (2, 0.1)
    assert found["lower_bound"] <= found["score"] <= found["upper_bound"]
    words = f"{found['score']:.4f}, from 0 to 1; 2 false a step score 0.1"
    for form in ("table", "markdown", "latex"):
        assert words in invoke(*pair, *options, "--format", form).out
    invoke(*pair, *options, "-o", "out")
    assert f"<dt>similarity</dt><dd>{words}</dd>" in Path("out/report.html").read_text()
    assert "similarity" not in invoke(*pair, "--format", "json").out
    for more, said in (
        (("--similarity", "0"), "--similarity: false targets is 0: must be > 0"),
        ((*options, "--sweep", "c=1,2"), "not for --sweep"),
        ((*options, "--step-weights", "w.csv"), "not for --step-weights"),
    ):
        answer = invoke(*pair, *more)
        assert (answer.status, answer.out, said in answer.err) == (2, "", True)


def test_proof_folders_know_the_prices(invoke: Run, pair: list[str]) -> None:
    assert invoke(*pair, "--rho", "0.3", "-o", "out", "--proof").status == 0
    answer = invoke("verify", "out")
    assert answer.status == 0
    assert "rho 0.3" in answer.out
    proof = Path("out/proof/proof.json")
    proof.write_text(proof.read_text().replace('"rho": "0.3"', '"rho": "0.31"'))
    assert invoke("verify", "out").status == 1


def test_weights_of_steps(invoke: Run, write: Write, pair: list[str]) -> None:
    weights = write("w.csv", "t;weight\n2;4\n0;1\n1;2\n7;9\n")
    answer = invoke(*pair, "--step-weights", weights)
    assert answer.out.startswith("TGOSPA = 7.28011, exact")
    assert "weights of the steps" in answer.out
    markdown = invoke(*pair, "--step-weights", weights, "--format", "markdown").out
    assert "(c = 5, p = 2, gamma = 1, weighted steps)" in markdown
    document = json.loads(invoke(*pair, "--step-weights", weights, "--format", "json").out)
    assert document["metric"] == "time-weighted-tgospa"
    assert [step["total"] for step in document["per_step"]] == pytest.approx([1, 2, 50])
    refused = invoke(*pair, "--step-weights", weights, "-o", "out", "--proof")
    assert (refused.status, "--step-weights" in refused.err) == (2, True)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,weight\n0,1\n1,1\n", "w.csv: no weight for t = 2; give every step"),
        ("t,weight\n0,1\n1,x\n", 'w.csv, line 3, column "weight": not a number: "x"'),
        ("t,weight\n0,1\n1,-1\n2,1\n", 'w.csv, line 3, column "weight": a weight of -1'),
        ("t,weight\n0,1\n1,\n2,1\n", 'w.csv, line 3, column "weight": a blank weight'),
        ("t,weight\n0,1\n1,1\n0,1\n", 'line 4, column "t": t = 0 is there twice, first on line 2'),
        ("t,w\n0,1\n", 'w.csv, line 1: no column "weight"'),
        ("t,weight\n0,1\n1\n", "w.csv, line 3: 1 field, the header has 2"),
        ("t,weight\n", "w.csv: a header alone"),
        ("", "w.csv: the file is empty"),
        ("t,weight\n2020-01-01,1\n", "w.csv has ISO times without zone, the tracks have numbers"),
    ],
)
def test_wrong_weights(invoke: Run, write: Write, pair: list[str], text: str, message: str) -> None:
    answer = invoke(*pair, "--step-weights", write("w.csv", text))
    assert answer.status == 3
    assert message in answer.err
    assert answer.out == ""


def test_weights_that_leave_nothing(invoke: Run, write: Write, pair: list[str]) -> None:
    answer = invoke(*pair, "--step-weights", write("w.csv", "t,weight\n0,0\n1,0\n2,0\n"))
    assert (answer.status, "all weights of steps are 0" in answer.err) == (2, True)


def test_a_gate_finds_the_weights_beside_its_baseline(
    invoke: Run, write: Write, pair: list[str]
) -> None:
    weights = write("w.csv", "t,weight\n0,1\n1,2\n2,4\n")
    Path("ci").mkdir()
    baseline = ("gate", *pair[:2], "--baseline", "ci/b.json")
    made = invoke(*baseline, *pair[2:], "--step-weights", weights, "--update-baseline")
    assert made.status == 0
    assert invoke(*baseline).status == 0
    write("w.csv", "t,weight\n0,1\n1,2\n2,5\n")
    assert invoke(*baseline).status == 2  # another metric
