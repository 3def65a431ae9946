"""``--rho`` and ``--step-weights`` as a user types them."""

import json
from pathlib import Path

import pytest
from answer import Run, Write


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
    words = f"{found['score']:.4f}, from 0 to 1; 2 false targets a step score 0.1"
    for form in ("table", "markdown", "latex"):
        assert words in invoke(*pair, *options, "--format", form).out
    invoke(*pair, *options, "-o", "out")
    assert f"<dt>similarity</dt><dd>{words}</dd>" in Path("out/report.html").read_text()
    assert "similarity" not in invoke(*pair, "--format", "json").out
    for more, said in (
        (("--similarity", "0"), "--similarity: false targets is 0: must be > 0"),
        ((*options, "--sweep", "c=1,2"), "is not supported with --sweep"),
        ((*options, "--step-weights", "w.csv"), "not supported with --step-weights"),
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
    assert "c = 5, p = 2, gamma = 1, weighted steps" in markdown
    document = json.loads(invoke(*pair, "--step-weights", weights, "--format", "json").out)
    assert document["metric"] == "time-weighted-tgospa"
    assert [step["total"] for step in document["per_step"]] == pytest.approx([1, 2, 50])
    refused = invoke(*pair, "--step-weights", weights, "-o", "out", "--proof")
    assert (refused.status, "--step-weights" in refused.err) == (2, True)
    assert not Path("out").exists()


def test_probabilities_of_existence(invoke: Run, write: Write, pair: list[str]) -> None:
    """Y at 0 for three steps with s = 0.5, 0.8, 1; and a state that does not exist."""
    truth, *_ = pair
    rows = "id,t,x,existence\nb,0,0,0.5\nb,1,0,0.8\nb,2,0,1\nc,1,70,0\n"
    files, metric = (truth, write("likely.csv", rows)), ("-c", "4", "-p", "1", "-g", "1")
    ignored = invoke(*files, *metric)
    assert "TGOSPA = 2, exact" in ignored.out  # c is false
    assert "existence; --existence use takes existence as probabilities" in ignored.err
    use = (*files, *metric, "--existence", "use")
    answer = invoke(*use)
    assert (answer.status, answer.out.startswith("TGOSPA = 1.4, exact")) == (0, True)
    assert "existence" not in answer.err
    words = " ".join(answer.out.split())
    assert "mismatch 1.4 100.0 %" in words
    assert "the paper does not say that switches cost the same" in words
    assert max(map(len, answer.out.splitlines())) <= 80
    document = json.loads(invoke(*use, "--format", "json").out)
    assert document["metric"] == "probabilistic-tgospa"
    assert (document["existence_mismatch"], document["expected_localisation"]) == (
        pytest.approx(1.4),
        0,
    )
    plain = json.loads(invoke(*files, *metric, "--format", "json").out)
    assert "existence_mismatch" not in plain
    assert plain["input"]["estimate"]["sha256"] != document["input"]["estimate"]["sha256"]
    assert "of which mismatch" in invoke(*use, "--format", "markdown").out
    assert "probabilities of existence (experimental)" in invoke(*use, "--format", "latex").out
    assert invoke(*use, "-o", "out").status == 0
    assert "mismatch 100.0 %" in Path("out/report.html").read_text()
    swept = invoke(*use, "--sweep", "gamma=1,2").out
    assert "probabilities of existence (experimental)" in swept
    windowed = json.loads(invoke(*use, "--window", "2", "--every", "1", "--format", "json").out)
    assert [each["tgospa"] for each in windowed["windows"]] == pytest.approx([1.0 + 0.4, 0.4])


def test_verbs_that_know_probabilities(invoke: Run, write: Write, pair: list[str]) -> None:
    truth, *_ = pair
    half, sure = (
        write(name, "id,t,x,existence\n" + "".join(f"b,{t},0,{s}\n" for t in range(3)))
        for name, s in (("half.csv", 0.5), ("sure.csv", 1))
    )
    metric = ("-c", "4", "-p", "1", "-g", "1", "-q", "--existence", "use")
    ranked = json.loads(invoke("compare", truth, half, sure, *metric, "--format", "json").out)
    assert [round(each["tgospa"], 9) for each in ranked["estimates"]] == [0, 3]
    assert ranked["parameters"]["existence"] == "use"
    gate = ("gate", truth, half, "--baseline", "b.json")
    assert invoke(*gate, *metric[:-2], "--update-baseline").status == 0
    assert invoke(*gate, *metric).status == 2  # another metric
    assert invoke(*gate, *metric, "--update-baseline").status == 0
    assert invoke(*gate, "-q").status == 0
    document = json.loads(invoke("explain", truth, half, *metric, "--format", "json").out)
    assert document["total"] == 3
    for folder, name in (("a", "half.csv"), ("b", "sure.csv")):
        Path(folder).mkdir()
        Path(folder, "e.csv").write_text(Path(name).read_text())
    jobs = ("--truth", truth, "--estimate", "{tracker}/e.csv", "--by", "tracker", "--workers", "1")
    made = invoke("batch", *jobs, *metric, "-o", "store", "--format", "json")
    assert made.status == 0
    assert sorted(group["total"] for group in json.loads(made.out)["groups"]) == [0, 3]
    for options, said in (
        (("--rho", "0.3"), "no proof is known that the result is a metric"),
        (("-o", "out", "--proof"), "--proof is not supported with --existence use"),
    ):
        answer = invoke(truth, half, *metric, *options)
        assert (answer.status, answer.out, said in answer.err) == (2, "", True)
    answer = invoke(truth, truth, *metric)
    assert (answer.status, "has a column existence" in answer.err) == (2, True)
    bad = write("bad.csv", "id,t,x,existence\nb,0,0,0.5\nb,1,0,\nb,2,0,2\n")
    answer = invoke(truth, bad, *metric)
    assert answer.status == 3
    assert 'bad.csv, column "existence": id "b" at t = 1 is blank (and 1 more)' in answer.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,weight\n0,1\n1,1\n", "w.csv: no weight for t = 2; give every step"),
        ("t,weight\n0,1\n1,x\n", 'w.csv, line 3, column "weight": not a number: "x"'),
        ("t,weight\n0,1\n1,-1\n2,1\n", 'w.csv, line 3, column "weight": a weight of -1'),
        ("t,weight\n0,1\n1,\n2,1\n", 'w.csv, line 3, column "weight": a blank weight'),
        ("t,weight\n0,1\n1,1\n0,1\n", 'line 4, column "t": t = 0 is a duplicate, first on line 2'),
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


def test_the_weight_0_leaves_out_the_states_of_a_step(invoke: Run, write: Write) -> None:
    """A tracker that follows one object at all four steps, of which two have the weight 0."""
    rows = [f"1,{t},{t}" for t in range(4)]
    truth = write("truth.csv", "\n".join(["id,t,x", *rows]))
    late = write("estimate.csv", "\n".join(["id,t,x", *(f"{row}.5" for row in rows), "2,1,90"]))
    weights = write("w.csv", "t,weight\n0,1\n1,0\n2,0\n3,1\n")
    asked = (truth, late, "-c", "2", "-g", "1", "--step-weights", weights, "--with", "clear,gospa")
    answer = invoke(*asked, "--format", "json", "-o", "out", "--pictures", "none")
    assert "2 of 4 steps have the weight 0: their states are left out" in answer.err
    found = json.loads(answer.out)
    summary = found["summary"]
    assert (found["total"], found["counts"]) == (0.5, {"missed": 0, "false": 0, "switch": 0})
    assert (summary["truth_states"], summary["estimate_states"], summary["unique"]) == (2, 2, True)
    assert summary["detection_rate"] == summary["precision"] == summary["purity"] == 1
    assert (summary["fragments"], summary["false_tracks"]) == (0, 0)
    assert found["judged"]["truth_states"] == 2
    assert found["with"]["clear"]["MOTA"] == 1
    assert invoke("gate", truth, late, *asked[2:-2], "-q", "--max", "counts.missed=0").status == 0


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
