"""The gate as CI meets it: files, verdicts, exit statuses, baselines, suites."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from answer import Invoke, Write
from browser import PATIENCE
from checkout import ROOT, SAMPLES

TRUTH = "id,t,x,y\n" + "".join(f"a,{t},{t},0\n" for t in range(5))
METRIC = ("-c", "4", "-p", "1", "-g", "1")


def estimate(error: float, steps: int = 5) -> str:
    """One track beside the truth for all steps: with METRIC the total is `steps * error`."""
    return "id,t,x,y\n" + "".join(f"7,{t},{t},{error}\n" for t in range(steps))


@pytest.fixture
def gate(invoke: Invoke, write: Write) -> Invoke:
    """The gate on t.csv and e.csv with the baseline b.json, whose total is 5 * 1."""
    write("t.csv", TRUTH)
    write("e.csv", estimate(1))

    def gate(*arguments: str) -> Any:
        return invoke("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q", *arguments)

    assert gate(*METRIC, "--update-baseline").status == 0
    return gate


def pair(answer: Any) -> dict[str, Any]:
    """The only pair of a JSON report."""
    (found,) = json.loads(answer.out)["pairs"]
    assert isinstance(found, dict)
    return found


def edit(path: str, change: Callable[[dict[str, Any]], Any], name: str = "pair") -> None:
    """Change an entry of a baseline by hand."""
    document = json.loads(Path(path).read_text(encoding="utf-8"))
    change(document["pairs"][name])
    Path(path).write_text(json.dumps(document), encoding="utf-8")


# --- verdicts -------------------------------------------------------------------------------------


def test_passes_and_takes_options_from_the_baseline(gate: Invoke) -> None:
    answer = gate("--format", "json")
    assert answer.status == 0
    assert pair(answer)["verdict"] == "pass"
    assert pair(answer)["rules"][0]["upper"] == 5


def test_fails_when_the_lower_bound_is_worse(gate: Invoke, write: Write) -> None:
    write("e.csv", estimate(1.1))
    answer = gate()
    assert answer.status == 1
    assert answer.out.startswith("gate: fail (exit status 1)\n")
    assert "total is at least 5.5 (proven); total:+0.001% allows 5.00005" in answer.out
    assert gate("--fail-on", "total:+11%").status == 0
    assert gate("--fail-on", "total:+0.51").status == 0
    assert gate("--fail-on", "total:+0.49").status == 1
    # Only a warning; --fail-on has replaced the default rule.
    answer = gate("--fail-on", "missed:+0", "--warn-on", "total:+0.49")
    assert answer.status == 0
    assert "warning: total is at least 5.5" in answer.out


def test_maximum_adds_to_what_holds(gate: Invoke, write: Write) -> None:
    assert gate("--max", "tgospa=5").status == 0
    assert gate("--max", "tgospa=4.9").status == 1
    write("e.csv", estimate(1.1))
    assert gate("--max", "tgospa=50").status == 1  # by the default rule


def test_absolute_limits_need_no_baseline(invoke: Invoke, write: Write) -> None:
    write("t.csv", TRUTH)
    write("e.csv", estimate(1))
    given = ("gate", "t.csv", "e.csv", *METRIC, "-q")
    assert invoke(*given, "--max", "tgospa=5").status == 0
    broken = invoke(*given, "--max", "tgospa=4.9", "--max", "counts.switch=1")
    assert broken.status == 1
    assert "counts.switch<=1 *" in broken.out
    assert "\n* the reported split, not proven" in broken.out
    for arguments in ((), ("--max", "total=9", "--fail-on", "total:+1"), ("--update-baseline",)):
        refused = invoke(*given, *arguments)
        assert refused.status == 2
        assert "no baseline: " in refused.err
        assert "--baseline FILE" in refused.err


def test_undecided_inside_the_bracket(gate: Invoke, invoke: Invoke, crowd: tuple[str, str]) -> None:
    """Between the bounds of a coarse approximation; outside them all is proven."""
    for name, path in zip(("t.csv", "e.csv"), crowd, strict=True):
        shutil.copy(path, name)
    coarse = ("--solver", "sinkhorn", "--epsilon", "0.5", "-c", "5", "-g", "2")
    assert gate(*coarse, "-p", "2", "--update-baseline").status == 0
    values = json.loads(Path("b.json").read_text(encoding="utf-8"))["pairs"]["pair"]["values"]
    lower, upper = values["lower_bound"], values["upper_bound"]
    assert upper > lower * 1.001
    assert gate().status == 0
    between = ("--max", f"tgospa={(lower + upper) / 2}")
    assert invoke("gate", "t.csv", "e.csv", *coarse, "-p", "2", "-q", *between).status == 4
    answer = gate(*between)
    assert answer.status == 4
    assert "undecided: use a smaller --epsilon than 0.5, or --solver certified" in answer.out
    assert gate("--max", f"tgospa={lower * 0.99}").status == 1
    # The options of solving may differ: what is proven holds for any solver.
    decided = gate(*between, "--solver", "certified")
    assert decided.status in (0, 1)


@pytest.mark.parametrize("suite", [False, True])
def test_a_value_inside_the_bracket_of_the_baseline_is_not_better(
    invoke: Invoke, crowd: tuple[str, str], suite: bool
) -> None:
    for name, path in zip(("t.csv", "e.csv"), crowd, strict=True):
        shutil.copy(path, name)
    Path("s.toml").write_text(
        'baseline = "b.json"\npair = [{truth = "t.csv", estimate = "{seed}.csv"}]\n'
        '[[group]]\nfail-on = ["total:+0.001%"]\n',
        encoding="utf-8",
    )
    paths = ("--suite", "s.toml") if suite else ("t.csv", "e.csv", "--baseline", "b.json")
    coarse = ("--solver", "sinkhorn", "--epsilon", "0.5", "-c", "5", "-g", "2")
    assert invoke("gate", *paths, *coarse, "-q", "--update-baseline").status == 0
    answer = invoke("gate", *paths, "--solver", "certified", "-q", "--format", "json")
    said = json.loads(answer.out)
    (one,) = said["groups"] if suite else said["pairs"]
    (rule,) = one["rules"]
    assert (answer.status, rule["upper"] < rule["baseline"] * 0.999) == (0, True)
    assert (rule["improved"], said["update"]) == (False, "")
    assert any("not exact" in note and "changes in per cent" in note for note in one["notes"])


def test_improvement(gate: Invoke, write: Write) -> None:
    write("e.csv", estimate(0.5))
    answer = gate()
    assert answer.status == 0
    assert "baseline can be tightened: total" in answer.out
    assert "--update-baseline" in answer.out
    answer = gate("--update-baseline")
    assert answer.status == 0
    assert next(line.split()[1:] for line in answer.out.splitlines() if " total " in line) == [
        "total",
        "5",
        "2.5",
    ]
    write("e.csv", estimate(1))
    assert gate().status == 1


def test_ties_move_the_split(invoke: Invoke, write: Write) -> None:
    """c = 4, p = 1, gamma = 4: one switch costs as much as a miss and a false target, 4.

    The rule on the split fails where the other optimum was the baseline's, and says what that is.
    """
    write("t.csv", "id,t,x\na,0,0\na,1,0\na,2,0\n")
    write("e.csv", "id,t,x\n1,0,0\n1,1,0\n2,2,0\n")
    common = ("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q")
    assert invoke(*common, "-c", "4", "-p", "1", "-g", "4", "--update-baseline").status == 0

    def other_optimum(entry: dict[str, Any]) -> None:
        assert entry["values"]["total"] == 4
        switched = entry["values"]["switch"] == 4
        entry["values"] |= {"switch": 0.0 if switched else 4.0}
        entry["values"] |= dict.fromkeys(("missed", "false"), 2.0 if switched else 0.0)
        one, none = (1, 0) if switched else (0, 1)
        entry["values"]["counts"] = {"missed": one, "false": one, "switch": none}

    edit("b.json", other_optimum)
    assert invoke(*common).status == 0  # the total is unique
    rules = ("--fail-on", "switch:+0", "--fail-on", "missed:+0", "--fail-on", "false:+0")
    answer = invoke(*common, *rules)
    assert answer.status == 1
    assert "(split, not proven)" in answer.out
    assert "in another way" in answer.out
    assert " *" in answer.out


def test_by_class(invoke: Invoke, write: Write) -> None:
    rows = [f"{k},{t},{t},0,{k}\n" for k in ("car", "van.big") for t in range(3)]
    write("t.csv", "id,t,x,y,class\n" + "".join(rows))
    write("e.csv", "id,t,x,y,class\n" + "".join(rows))
    common = ("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q")
    answer = invoke(*common, *METRIC, "--by", "class", "--update-baseline")
    assert answer.status == 0, answer.err
    write("e.csv", "id,t,x,y,class\n" + "".join(rows[:3]))
    assert invoke(*common, "--fail-on", "by_class.car.total:+0").status == 0
    assert invoke(*common, "--fail-on", "by_class.van.big.counts.missed:+2").status == 1
    answer = invoke(*common, "--fail-on", "by_class.bus.total:+0")
    assert answer.status == 2
    assert "the result has no by_class.bus.total" in answer.out


# --- not comparable -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-c", "5"), "cutoff is 5.0, in the baseline 4.0"),
        (("-g", "2"), "switch_penalty is 2.0, in the baseline 1.0"),
        (("--distance", "manhattan"), 'distance is "manhattan", in the baseline "euclidean"'),
        (("--columns", "x"), 'columns is ["x"], in the baseline ["x", "y"]'),
        (("--grid", "common"), "grid"),
        (("--time", "0:3"), "time is \"0:3\", in the baseline not set"),
    ],
)  # fmt: skip
def test_given_options_that_differ(gate: Invoke, arguments: tuple[str, ...], said: str) -> None:
    answer = gate(*arguments)
    assert answer.status == 2
    assert "not comparable" in answer.out
    assert said in answer.out


def test_given_by_environment_or_file_counts_as_given(
    gate: Invoke, invoke: Invoke, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGOSPA_EVAL_CUTOFF", "5")
    assert gate().status == 2
    assert gate("-c", "4").status == 0
    monkeypatch.delenv("TGOSPA_EVAL_CUTOFF")
    write("tgospa-eval.toml", "cutoff = 5\n")
    assert gate().status == 2
    assert gate("-c", "4").status == 0
    write("ours.toml", 'baseline = "b.json"\nfail-on = ["total:+9%", "missed:+1"]\n')
    monkeypatch.setenv("TGOSPA_EVAL_CONFIG", "ours.toml")
    answer = gate("--format", "json")
    assert [rule["rule"] for rule in pair(answer)["rules"]] == ["total:+9%", "missed:+1"]
    assert invoke("t.csv", "e.csv").status == 0  # other verbs pass over the keys of the gate


def test_a_rule_whose_limit_is_no_number_passes_nothing(
    gate: Invoke, invoke: Invoke, write: Write
) -> None:
    write("e.csv", estimate(100))
    assert gate("-c", "1000", "-g", "1", "--update-baseline").status == 0  # a total of 5e4
    for rule in ("total:+1e308%", "total:+1_0%", "total:+\u0661%"):
        for key in ("--fail-on", "--warn-on"):
            answer = gate(key, rule)
            assert (answer.status, answer.out) == (2, "")
            assert rule in answer.err
            assert len(answer.err.splitlines()) == 1
    pair = '[[pair]]\ntruth = "t.csv"\nestimate = "e.csv"\n'
    for text in ('max = ["tgospa=1_0"]', 'max = "tgospa=9"\noptions = {cutoff = "1_0"}'):
        answer = invoke("gate", "--suite", write("suite.toml", f"{pair}{text}\n"))
        assert answer.status == 2
        assert "1_0" in answer.err


def test_other_truth(gate: Invoke, write: Write) -> None:
    write("t.csv", TRUTH.replace("a,4,4,0", "a,4,4,0.001"))
    answer = gate()
    assert answer.status == 2
    assert "not judged on the same truth: states of the truth changed, but not" in answer.out
    assert "--resample" not in answer.out
    # The same numbers in another text are the same truth.
    write("t.csv", TRUTH.replace("a,4,4,0", "a,4,4.0,0e0").replace("\n", "\r\n"))
    assert gate().status == 0


def test_header_maps_and_matrices_come_from_the_baseline(invoke: Invoke, write: Write) -> None:
    text = TRUTH.replace("id,t,x,y", "trk,time_s,px,py")
    write("t.csv", text)
    write("e.csv", text)
    write("cov.csv", "4,0\n0,1\n")
    common = ("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q")
    given = ("--columns", "id=trk,t=time_s,x=px,y=py", "--distance", "mahalanobis")
    assert invoke(*common, *given, "--covariance", "cov.csv", "--update-baseline").status == 0
    assert invoke(*common).status == 0
    write("cov.csv", "4,0\n0,2\n")
    answer = invoke(*common)
    assert answer.status == 2
    assert "covariance" in answer.out


def test_a_baseline_stands_where_a_file_has_two_times(gate: Invoke, write: Write) -> None:
    rows = [f"{9 - t},{t},a,{t},0" for t in range(5)]
    write("t.csv", "\n".join(["frame,timestamp,id,x,y", *rows, ""]))
    answer = gate()
    assert answer.status == 0, answer.err


def test_defaults_of_the_distance_are_kept(invoke: Invoke, write: Write) -> None:
    write("t.csv", "id,t,left,top,width,height\n1,1,0,0,10,10\n")
    common = ("gate", "t.csv", "t.csv", "--baseline", "b.json", "-q")
    assert invoke(*common, "--distance", "iou", "--update-baseline").status == 0
    answer = invoke(*common, "--format", "json")
    assert answer.status == 0
    entry = json.loads(Path("b.json").read_text(encoding="utf-8"))["pairs"]["pair"]
    assert entry["options"] == {"cutoff": 0.5, "switch-penalty": 0.5, "distance": "iou"}


def test_missing_baseline_says_how_to_make_it(invoke: Invoke, write: Write) -> None:
    write("t.csv", TRUTH)
    write("my e.csv", estimate(1))
    typed = ("gate", "t.csv", "my e.csv", "--baseline", "new/b.json", "-c", "4", "-q")
    answer = invoke(*typed)
    assert answer.status == 2
    assert "the baseline new/b.json does not exist; --update-baseline makes it" in answer.out
    command = "tgospa-eval gate t.csv 'my e.csv' --baseline new/b.json -c 4 -q --update-baseline"
    assert f"\n  {command}\n" in answer.out
    assert invoke(*typed, "--update-baseline").status == 0
    assert invoke(*typed).status == 0
    assert (
        "-q --update-baseline -- t.csv"
        in invoke("gate", "--baseline", "other.json", "-q", "--", "t.csv", "my e.csv").out
    )


def test_usage(invoke: Invoke, gate: Invoke) -> None:
    assert invoke("gate").status == 2
    assert invoke("gate", "t.csv").status == 2
    assert "--baseline" in invoke("gate", "t.csv", "e.csv").err
    assert invoke("gate", "t.csv", "e.csv", "--suite", "s.toml", "--baseline", "b").status == 2
    assert "must be a value of the result with its limit" in gate("--fail-on", "total").err
    assert invoke("--baseline", "b.json", "gate", "t.csv", "e.csv", "-q").status == 0


def test_bad_input(gate: Invoke, write: Write) -> None:
    write("e.csv", "id,t,x,y\n7,0,1.2.3,0\n")
    answer = gate("--junit", "j.xml")
    assert answer.status == 3
    assert answer.err.count('e.csv, line 2, column "x": not a number') == 1
    assert "<error" in Path("j.xml").read_text(encoding="utf-8")
    assert gate("--update-baseline").status == 3


# --- the baseline file ----------------------------------------------------------------------------


def test_baseline_is_made_for_git(gate: Invoke) -> None:
    text = Path("b.json").read_bytes()
    document = json.loads(text)
    assert text.decode() == json.dumps(document, sort_keys=True, indent=1) + "\n"
    assert document["schema"] == "tgospa-eval/baseline/2"
    entry = document["pairs"]["pair"]
    assert entry["values"]["total"] == 5 <= entry["values"]["upper_bound"] < 5 + 1e-12
    assert entry["parameters"]["order"] == 1
    before = Path("b.json").stat().st_mtime_ns
    answer = gate("--update-baseline")
    assert "unchanged" in answer.out
    assert Path("b.json").stat().st_mtime_ns == before
    assert Path("b.json").read_bytes() == text
    Path("b.json").write_bytes(text.replace(b"\n", b"\r\n"))
    assert gate().status == 0


def spoil(*keys: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(entry: dict[str, Any]) -> None:
        for key in keys[:-1]:
            entry = entry[key]
        if value is None:
            del entry[keys[-1]]
        else:
            entry[keys[-1]] = value

    return change


SPOILT = (
    (spoil("values", "total", value=float("nan")), "NaN is not a JSON number"),
    (spoil("values", "total", value=float("inf")), "Infinity is not a JSON number"),
    (spoil("values", "total", value="5"), 'pair.values.total is "5"; expected a finite'),
    (spoil("values", "total", value=True), "values.total is true"),
    (spoil("values", "total", value=-1), "values.total is -1"),
    (spoil("values", "total", value=10**400), "values.total"),
    (spoil("values", "total", value=None), "values.total: is missing; expected a"),
    (spoil("values", "counts", value=3), "pairs.pair.values.counts is 3; expected an object"),
    (spoil("values", value=[]), "pairs.pair.values is a list; expected an object"),
    (spoil("parameters", value=None), "pairs.pair.parameters: is missing; expected an object"),
    (spoil("judged", "truth_sha256", value=None), "judged.truth_sha256"),
    (spoil("version", value=1), "version"),
    (spoil("options", "cutof", value=1), 'unknown key "cutof"'),
    (spoil("options", "cutoff", value="wide"), "cutoff"),
    (spoil("options", "unit", value={}), '"unit" is a table'),
    (spoil("options", "cutoff", value=None), "cutoff is 10.0, in the baseline 4.0"),
    (spoil("parameters", "cutoff", value=5), "cutoff is 4.0, in the baseline 5"),
)  # fmt: skip


def test_edited_by_hand(gate: Invoke) -> None:
    good = Path("b.json").read_bytes()
    for change, said in SPOILT:
        Path("b.json").write_bytes(good)
        edit("b.json", change)
        answer = gate()
        assert answer.status == 2, said
        assert said in answer.out + answer.err


NO_BASELINES: tuple[tuple[str | bytes, str], ...] = (
    ("", "is not a baseline: Expecting value: line 1"),
    ("[]", "is not a baseline"),
    ("{}", "is not a baseline"),
    ('{"schema": "tgospa-eval/result/1"}', 'its schema is "tgospa-eval/result/1"'),
    ("id,t,x\n1,0,0\n", "is not a baseline"),
    ("<!doctype html>", "is not a baseline"),
    ('{"schema": "tgospa-eval/baseline/1", "pairs": {}}', "this version reads"),
    ('{"schema": "tgospa-eval/baseline/2"}', "pairs: is missing; expected an object"),
    ("{\n<<<<<<< HEAD\n", "line 2 column 1"),
    ('{"a": 1,\n "a": 2}', '"a" is a duplicate key'),
    ("[" * 100_000, "b.json"),
    (b"\xff\xfe", "can't decode byte 0xff"),
)


def test_no_baselines(gate: Invoke, write: Write) -> None:
    """Neither judged by nor overwritten."""
    for content, said in NO_BASELINES:
        write("b.json", content)
        for arguments in ((), ("--update-baseline",)):
            answer = gate(*arguments)
            assert answer.status == 2, said
            assert said in answer.err
            assert "delete it" not in answer.err  # it can be an input that was named by mistake
            assert len(answer.err.splitlines()) == 1
        kept = Path("b.json").read_bytes()
        assert kept == (content.encode() if isinstance(content, str) else content)


def test_places_that_cannot_be_written(gate: Invoke, invoke: Invoke, write: Write) -> None:
    Path("folder").mkdir()
    assert "is a folder" in gate("--junit", "folder").err
    assert gate("--junit", "folder").status == 2
    write("file", "")
    assert gate("--junit", "file/j.xml").status == 2
    answer = invoke("gate", "t.csv", "e.csv", "--baseline", "file/b.json", "--update-baseline")
    assert answer.status == 2
    assert "file/b.json" in answer.err
    assert gate("--junit", os.devnull).status == 0
    assert not Path(os.devnull).is_file()
    write("e.csv", estimate(2))
    assert gate("--junit", "folder").status == 1  # the regression is not hidden by it


@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be replaced there")
def test_two_writers(gate: Invoke, environment: dict[str, str]) -> None:
    """Both end well, one wins, and nothing is left beside."""
    command = [
        *(sys.executable, "-m", "tgospa_eval", "gate", "t.csv", "e.csv", "-q"),
        *("--baseline", "two/b.json", "--update-baseline", *METRIC),
    ]
    running = [
        subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) for _ in range(3)
    ]
    assert [process.wait(PATIENCE) for process in running] == [0, 0, 0]
    assert [path.name for path in Path("two").iterdir()] == ["b.json"]
    assert json.loads(Path("two/b.json").read_text(encoding="utf-8"))["pairs"]


# --- suites ---------------------------------------------------------------------------------------

SUITE = """
baseline = "base.json"

[options]
cutoff = 4
order = 1
switch-penalty = 1

[[pair]]
truth = "data/{name}/truth.csv"
estimate = "out/{name}.csv"
"""


@pytest.fixture
def suite(invoke: Invoke, tmp_path: Path) -> Invoke:
    """A suite of the pairs a and b in the folder s, with its baseline."""
    folder = tmp_path / "s"
    for name in ("a", "b"):
        (folder / "data" / name).mkdir(parents=True)
        (folder / "data" / name / "truth.csv").write_text(TRUTH, encoding="utf-8")
    (folder / "out").mkdir()
    for name in ("a", "b"):
        (folder / "out" / f"{name}.csv").write_text(estimate(1), encoding="utf-8")
    (folder / "suite.toml").write_text(SUITE, encoding="utf-8")

    def suite(*arguments: str) -> Any:
        return invoke("gate", "--suite", "s/suite.toml", "-q", *arguments)

    assert suite("--update-baseline").status == 0
    return suite


def verdicts(answer: Any) -> dict[str, str]:
    return {found["name"]: found["verdict"] for found in json.loads(answer.out)["pairs"]}


def test_sample_data_pass(invoke: Invoke) -> None:
    answer = invoke("gate", "--suite", str(SAMPLES / "gate" / "suite.toml"), "-q")
    assert answer.status == 0, answer.out
    assert "tightened" not in answer.out


def test_suite(suite: Invoke, write: Write) -> None:
    answer = suite("--format", "json")
    assert answer.status == 0
    assert verdicts(answer) == {"a": "pass", "b": "pass"}
    write("s/out/b.csv", estimate(2))
    answer = suite("--format", "json")
    assert answer.status == 1
    assert verdicts(answer) == {"a": "pass", "b": "fail"}


def test_suite_never_passes_by_halves(suite: Invoke, write: Write) -> None:
    """A pair that is new, gone or broken; and a proven regression is not hidden by any of them."""
    Path("s/data/c").mkdir()
    write("s/data/c/truth.csv", TRUTH)
    write("s/out/c.csv", estimate(1))
    answer = suite("--format", "json")
    assert (answer.status, verdicts(answer)["c"]) == (2, "not comparable")
    assert '"not in s' in answer.out
    shutil.rmtree("s/data/c")
    shutil.rmtree("s/data/a")
    answer = suite("--format", "json")
    assert answer.status == 2
    assert verdicts(answer) == {"b": "pass", "a": "not comparable"}
    Path("s/data/a").mkdir()
    write("s/data/a/truth.csv", TRUTH)
    Path("s/out/a.csv").unlink()
    answer = suite("--format", "json")
    assert (answer.status, verdicts(answer)) == (3, {"a": "error", "b": "pass"})
    assert answer.err == "a: s/out/a.csv: no such file\n".replace("s/out", str(Path("s/out")))
    write("s/out/b.csv", estimate(2))
    assert suite().status == 1


def test_suite_update_is_whole_or_absent(suite: Invoke, write: Write) -> None:
    before = Path("s/base.json").read_bytes()
    write("s/out/a.csv", estimate(2))
    write("s/out/b.csv", "")
    answer = suite("--update-baseline")
    assert answer.status == 3
    assert answer.err.startswith("b: ")
    assert Path("s/base.json").read_bytes() == before
    shutil.rmtree("s/data/b")
    answer = suite("--update-baseline")
    assert answer.status == 0
    assert "not in the suite: kept; --prune removes it" in answer.out
    answer = suite("--update-baseline", "--prune")
    assert "1 removed" in answer.out
    assert list(json.loads(Path("s/base.json").read_text(encoding="utf-8"))["pairs"]) == ["a"]


def test_suite_rules_and_options(suite: Invoke, write: Write) -> None:
    more = """
fail-on = ["total:+50%"]

[[pair]]
name = "{name} by two"
truth = "data/{name}/truth.csv"
estimate = "out/{name}.csv"
options = { scale = "x=2" }
warn-on = "total:+0"
max = ["missed=0"]
"""
    text = SUITE.replace("\n[options]", "fail-on = 'total:+20%'\n[options]")
    write("s/suite.toml", text + more)
    assert suite("--update-baseline").status == 0
    write("s/out/b.csv", estimate(1.1))
    answer = suite("--format", "json")
    assert answer.status == 0
    rules = {found["name"]: found["rules"] for found in json.loads(answer.out)["pairs"]}
    assert [rule["rule"] for rule in rules["b"]] == ["total:+50%"]
    assert [r["rule"] for r in rules["b by two"]] == ["total:+20%", "total:+0", "missed<=0"]
    assert rules["b by two"][1]["verdict"] == "fail"  # which warns only
    assert suite("--fail-on", "total:+5%").status == 1  # a flag beats the suite
    assert suite("-c", "5").status == 2


@pytest.mark.parametrize(
    ("text", "status", "said"),
    [
        ("", 2, "no pairs; add"),
        ("pair = 3", 2, "write [[pair]]"),
        ("pairs = []", 2, 'unknown key "pairs"'),
        ("[[pair]]\ntruth = 't.csv'", 2, '"estimate" must be a text'),
        ("[[pair]]\ntruth = 't.csv'\nestimate = 't.csv'\ncutoff = 4", 2, "go under options"),
        ("[options]\ncutof = 4", 2, 'unknown key "cutof"'),
        ("[options]\nbaseline = 'b'", 2, 'unknown key "baseline"'),
        ("fail-on = 3\n[[pair]]\ntruth = 't'\nestimate = 't'", 2, '"fail-on" must be'),
        (
            "fail-on = ['x']\n[[pair]]\ntruth = 't'\nestimate = 't'",
            2,
            "must be a value of the result",
        ),
        ("[[pair]]\ntruth = 'no/{n}.csv'\nestimate = '{n}'", 3, "no file matches"),
        ("[[pair]]\ntruth = 'a.csv'\nestimate = '{n}.txt'", 3, "no file matches"),
        ("[[pair]]\nname = '{n}'\ntruth = 'a'\nestimate = 'b'", 2, "{n} is not in"),
        ("[[pair]]\ntruth = 'a'\nestimate = 'b'\n" * 2, 2, 'the name "pair" is a duplicate'),
        ("[[pair]\n", 2, "not valid TOML"),
    ],
)
def test_suites_that_are_wrong(
    suite: Invoke, write: Write, text: str, status: int, said: str
) -> None:
    write("s/suite.toml", 'baseline = "base.json"\n' + text)
    answer = suite()
    assert answer.status == status
    assert said in answer.err
    assert len(answer.err.splitlines()) == 1


def test_a_pair_of_a_suite_without_limits_is_named(suite: Invoke, write: Write) -> None:
    pairs = [f"[[pair]]\nname = '{n}'\ntruth = 't'\nestimate = 't'\n" for n in ("one", "two")]
    write("s/suite.toml", pairs[0] + "max = 'tgospa=5'\n" + pairs[1])
    answer = suite()
    assert answer.status == 2
    assert (
        "two: no baseline: give one with --baseline FILE; --update-baseline makes this file"
        in answer.err
    )


def test_patterns(invoke: Invoke, write: Write) -> None:
    """A placeholder stands for the same text everywhere, and brackets in names for themselves."""
    for name in ("s1/run_1", "s1/run_2", "s[2]/run_1", "s2/other_1"):
        Path(name).parent.mkdir(exist_ok=True)
        write(f"{name}.csv", TRUTH)
        write(f"{name}.out", estimate(1))
    text = (
        'baseline = "b.json"\n[[pair]]\ntruth = "{s}/run_{k}.csv"\nestimate = "{s}/run_{k}.out"\n'
    )
    write("suite.toml", text.replace("\n", "\r\n"))
    answer = invoke("gate", "--suite", "suite.toml", "--update-baseline", "-q", "--format", "json")
    assert answer.status == 0, answer.err
    assert list(verdicts(answer)) == ["s1/1", "s1/2", "s[2]/1"]


def test_suite_and_single_baselines_are_told_apart(suite: Invoke, invoke: Invoke) -> None:
    single = ("gate", "s/data/a/truth.csv", "s/out/a.csv", "--baseline", "s/base.json")
    for more in ((), ("--update-baseline",)):
        answer = invoke(*single, *more)
        assert answer.status == 2
        assert "is the baseline of a suite (a, b)" in answer.err


# --- what is no regression ------------------------------------------------------------------------


def test_a_spurious_class_is_a_regression(invoke: Invoke, write: Write) -> None:
    """The digest of the truth does not depend on the classes of the estimate."""
    rows = [f"{k},{t},{t},0,{k}\n" for k in ("car", "van") for t in range(3)]
    head = "id,t,x,y,class\n"
    write("t.csv", head + "".join(rows))
    write("e.csv", head + "".join(rows))
    common = ("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q")
    assert invoke(*common, *METRIC, "--by", "class", "--update-baseline").status == 0
    write("e.csv", head + "".join(rows) + "9,1,50,50,bus\n")
    answer = invoke(*common)
    assert answer.status == 1, answer.out
    assert invoke(*common, "--update-baseline").status == 0
    write("e.csv", head + "".join(rows))
    answer = invoke(*common, "--fail-on", "by_class.bus.total:+0")  # a class that is gone costs 0
    assert answer.status == 0, answer.out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[options]\ncutoff = 1" + "0" * 400, "is not a finite number"),
        ("[options]\njobs = inf", "is not a finite number"),
        ("[options]\ncutoff = 1" + "0" * 5000, "not valid TOML"),
        ("x = " + "[" * 20_000, "nested too deeply"),
        ('[[pair]]\ntruth = "a\\u0000b"\nestimate = "e"', ""),
    ],
)
def test_monstrous_numbers_are_no_regression(
    suite: Invoke, invoke: Invoke, write: Write, text: str, said: str
) -> None:
    write("s/suite.toml", 'baseline = "base.json"\n' + text)
    answer = suite()
    assert answer.status in (2, 3)
    assert said in answer.err
    assert "Traceback" not in answer.err
    if "[options]" in text:
        write("c.toml", text.replace("[options]\n", ""))
        answer = invoke("s/data/a/truth.csv", "s/out/a.csv", "--config", "c.toml")
        assert answer.status == 2
        assert said in answer.err


def test_a_fault_of_ours_is_no_regression(gate: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("deep inside")

    monkeypatch.setattr("tgospa_eval.api.gate.load_baseline", fails)
    answer = gate()
    assert answer.status == 4
    assert "Traceback" in answer.err
    assert "internal error: ZeroDivisionError: deep inside" in answer.err


def test_whole_stamps_are_the_same_with_and_without_a_point(gate: Invoke, write: Write) -> None:
    write("t.csv", "id,t,x,y\n" + "".join(f"a,{t}.0,{t},0\n" for t in range(5)))
    assert gate().status == 0


@pytest.mark.skipif(sys.platform == "win32", reason="has no modes of files")
def test_mode_of_a_file_is_kept(gate: Invoke, write: Write) -> None:
    Path("b.json").chmod(0o640)
    write("e.csv", estimate(0.5))
    assert gate("--update-baseline").status == 0
    assert Path("b.json").stat().st_mode & 0o777 == 0o640


# --- rules that cannot be judged, values that contradict each other -------------------------------


def test_a_rule_on_nothing_hides_no_regression(gate: Invoke, write: Write) -> None:
    rules = ("--fail-on", "by_class.bus.total:+0", "--fail-on", "total:+0.001%")
    assert gate(*rules).status == 2
    write("e.csv", estimate(2))
    answer = gate(*rules, "--format", "json", "--junit", "j.xml")
    assert answer.status == 1
    found = [rule["verdict"] for rule in pair(answer)["rules"]]
    assert found == ["not comparable", "fail"]
    assert "there is no by_class.bus.total" in Path("j.xml").read_text(encoding="utf-8")
    for form in ("table", "markdown"):
        assert "not comparable" in gate(*rules, "--format", form).out
    write("e.csv", estimate(1))
    answer = gate("--warn-on", "by_class.bus.total:+0")
    assert answer.status == 0
    assert "the result has no by_class.bus.total" in answer.out


def test_names_of_classes_with_dots_and_commas(invoke: Invoke, write: Write) -> None:
    """Class a has 3 misses, class a.counts none: by_class.a.counts.missed is the former."""
    rows = [f'{k},{t},{t},0,"{k}"\n' for k in ("a", "a.counts") for t in range(3)]
    rows += [f'9,{t},{t},0,"b,c"\n' for t in range(3)]
    write("t.csv", "id,t,x,y,class\n" + "".join(rows))
    write("e.csv", "id,t,x,y,class\n" + "".join(rows[3:]))
    common = ("gate", "t.csv", "e.csv", "--baseline", "b.json", "-q")
    assert invoke(*common, *METRIC, "--by", "class", "--update-baseline").status == 0
    values = json.loads(Path("b.json").read_text(encoding="utf-8"))["pairs"]["pair"]["values"]
    assert values["by_class"]["a"]["counts"]["missed"] == 3
    assert values["by_class"]["a.counts"]["missed"] == 0
    answer = invoke(
        *common, "--max", "by_class.a.counts.missed=2", "--fail-on",
        "by_class.b,c.total:+1,total:+2%", "--format", "json",
    )  # fmt: skip
    assert answer.status == 1
    found = [rule["rule"] for rule in pair(answer)["rules"]]
    assert found == ["by_class.b,c.total:+1", "total:+2%", "by_class.a.counts.missed<=2"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (spoil("values", "total", value=50), "total is 50, but tgospa to the power of the order"),
        (spoil("values", "lower_bound", value=6), "lower_bound is 6, but upper_bound is 5"),
        (spoil("values", "tgospa", value=6), "tgospa is 6, but upper_bound is 5"),
        (spoil("values", "missed", value=6), "but localisation, missed, false, switch sum to 11"),
        (spoil("values", "normalised", "tgospa", value=9), "normalised.tgospa is 9, but total and"),
        (spoil("values", "counts", "missed", value=7), "missed is 0, but counts.missed makes it"),
    ],
)
def test_badly_merged(gate: Invoke, change: Callable[[Any], None], said: str) -> None:
    edit("b.json", change)
    answer = gate()
    assert answer.status == 2
    assert said in answer.err


def test_unit_and_decimal_compare(gate: Invoke) -> None:
    assert gate("--unit", "m").status == 0
    assert gate("--unit", "m", "--update-baseline").status == 0
    answer = gate("--unit", "km")
    assert (answer.status, 'unit is "km", in the baseline "m"' in answer.out) == (2, True)


def test_an_undecided_warning_is_a_warning(
    gate: Invoke, crowd: tuple[str, str], write: Write
) -> None:
    for name, path in zip(("t.csv", "e.csv"), crowd, strict=True):
        shutil.copy(path, name)
    coarse = ("--solver", "sinkhorn", "--epsilon", "0.5", "-c", "5", "-g", "2", "-p", "2")
    assert gate(*coarse, "--update-baseline").status == 0
    values = json.loads(Path("b.json").read_text(encoding="utf-8"))["pairs"]["pair"]["values"]
    limit = (values["total"] + values["lower_bound"] ** 2) / 2 - values["total"]
    assert limit < 0
    edit("b.json", lambda entry: entry["values"].update(half(entry["values"], limit)))
    answer = gate("--warn-on", "total:+0", "--fail-on", "total:+900%", "--github")
    assert answer.status == 0
    assert " warning" in answer.out
    assert "::warning" in answer.err
    assert "the baseline is not exact, relative gap" in answer.out


def half(values: dict[str, Any], change: float) -> dict[str, Any]:
    """The values with a total that is changed by so much, and nothing that contradicts it."""
    total = values["total"] + change
    root = dict.fromkeys(("tgospa", "upper_bound"), total**0.5)
    each = values["normalised"]["tgospa"] * (total / values["total"]) ** 0.5
    changed = {"localisation": values["localisation"] + change, "normalised": {"tgospa": each}}
    return {"total": total, **root, **changed, "lower_bound": values["lower_bound"]}


# --- nothing hides a regression, and every failure is reported ------------------------------------


def test_a_pattern_without_a_file_does_not_stop_the_others(suite: Invoke, write: Write) -> None:
    more = '[[pair]]\ntruth = "no/{name}.csv"\nestimate = "{name}"\n'
    write("s/suite.toml", SUITE + more)
    answer = suite("--format", "json")
    assert answer.status == 3
    assert verdicts(answer) == {"a": "pass", "b": "pass", "{name}": "error"}
    assert "no file matches" in answer.err
    write("s/out/b.csv", estimate(2))
    assert suite().status == 1
    assert suite("--update-baseline").status == 3


def test_a_pair_is_never_read_in_two_ways(suite: Invoke, write: Write) -> None:
    """The tracker s of run 10 would also be the tracker s1 of run 0."""
    for name in ("s/gt0.csv", "s/gt10.csv", "s/of-s10.csv", "s/of-s0.csv"):
        write(name, estimate(1))
    more = '[[pair]]\nname = "{t}/{run}"\ntruth = "gt{run}.csv"\nestimate = "of-{t}{run}.csv"\n'
    write("s/suite.toml", SUITE + more)
    answer = suite("--format", "json")
    assert answer.status == 3
    assert verdicts(answer) == {"a": "pass", "b": "pass", "of-s10.csv": "error"}
    assert "match of-s10.csv in two ways" in answer.err


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="has no full device")
def test_a_full_disk_hides_no_regression(
    gate: Invoke, write: Write, environment: dict[str, str]
) -> None:
    write("e.csv", estimate(2))
    command = [
        *(sys.executable, "-m", "tgospa_eval", "gate", "t.csv", "e.csv", "-q"),
        *("--baseline", "b.json", "--junit", "j.xml"),
    ]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command, env=environment, stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert done.returncode == 1
    assert b"stdout cannot be written" in done.stderr
    assert "<failure" in Path("j.xml").read_text(encoding="utf-8")


def test_wrong_usage_is_published(invoke: Invoke) -> None:
    answer = invoke("gate", "t.csv", "--junit", "j.xml", "--github")
    assert answer.status == 2
    assert "ESTIMATE is missing; type tgospa-eval gate t.csv ESTIMATE" in answer.err
    assert "::error" in answer.err
    assert "<error" in Path("j.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", ["./t.csv", "e.csv", "b.json"])
def test_junit_is_not_written_over_an_input(gate: Invoke, path: str) -> None:
    before = Path(path).read_bytes()
    answer = gate("--junit", path)
    assert answer.status == 2
    assert "is an input of the gate" in answer.err
    assert Path(path).read_bytes() == before


def test_junit_is_not_written_over_a_suite(suite: Invoke) -> None:
    for path in ("s/suite.toml", "s/base.json", "s/out/a.csv"):
        before = Path(path).read_bytes()
        assert "is an input of the gate" in suite("--junit", path).err
        assert Path(path).read_bytes() == before


def test_arguments_beat_a_suite_of_the_environment(
    gate: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGOSPA_EVAL_SUITE", "other.toml")
    assert gate().status == 0


def test_an_unreached_accuracy_is_not_inherited(gate: Invoke, crowd: tuple[str, str]) -> None:
    for name, path in zip(("t.csv", "e.csv"), crowd, strict=True):
        shutil.copy(path, name)
    late = ("--time-limit", "1e-9", "--gap", "1e-8", "-c", "5", "-g", "2", "-p", "2")
    answer = gate(*late, "--update-baseline")
    assert answer.status == 0
    assert "not exact, relative gap" in answer.out
    options = json.loads(Path("b.json").read_text(encoding="utf-8"))["pairs"]["pair"]["options"]
    assert not {"time-limit", "gap", "solver", "epsilon"} & options.keys()
    answer = gate()
    assert answer.status == 0
    assert "the baseline is not exact, relative gap" in answer.out
    answer = gate("--max", "total=0.5", "--time-limit", "1e-9")
    assert answer.status == 1 or "a larger --time-limit than 1e-09" in answer.out


def test_covariance_is_found_from_any_folder(
    invoke: Invoke, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("in").mkdir()
    Path("run").mkdir()
    write("t.csv", TRUTH)
    write("in/cov.csv", "4,0\n0,1\n")
    given = ("--distance", "mahalanobis", "--covariance", "in/cov.csv", "--update-baseline", "-q")
    assert invoke("gate", "t.csv", "t.csv", "--baseline", "in/b.json", *given).status == 0
    options = json.loads(Path("in/b.json").read_text(encoding="utf-8"))["pairs"]["pair"]["options"]
    assert options["covariance"] == "cov.csv"
    monkeypatch.chdir("run")
    answer = invoke("gate", "../t.csv", "../t.csv", "--baseline", "../in/b.json", "-q")
    assert answer.status == 0, answer.err


# --- the action -----------------------------------------------------------------------------------

ACTION = ROOT / ".github" / "actions" / "gate" / "action.yml"


@pytest.mark.process
@pytest.mark.skipif(shutil.which("bash") is None, reason="has no bash")
@pytest.mark.parametrize(
    ("inputs", "passed"),
    [
        ({"SUITE": "s.toml"}, ["--suite", "s.toml"]),
        ({"SUITE": "s.toml", "TRUTH": "t"}, ["--suite", "s.toml", "--", "t"]),
        ({}, []),
        ({"TRUTH": "-t", "ESTIMATE": "a b"}, ["--", "-t", "a b"]),
        ({"ARGUMENTS": "  --max\n  tgospa=50\r\n\n"}, ["--max", "tgospa=50"]),
        ({"ARGUMENTS": "$(touch pwned)"}, ["$(touch pwned)"]),
    ],
)
def test_action_passes_its_inputs_on(
    inputs: dict[str, str], passed: list[str], write: Write, monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    script = ACTION.read_text(encoding="utf-8").rpartition("run: |\n")[2]
    Path("tgospa-eval/bin").mkdir(parents=True)
    write("tgospa-eval/bin/tgospa-eval", '#!/bin/sh\nprintf "%s\\n" "$@"\nexit 4\n')
    Path("tgospa-eval/bin/tgospa-eval").chmod(0o755)
    names = ("SUITE", "TRUTH", "ESTIMATE", "BASELINE", "JUNIT", "ARGUMENTS")
    places = {"RUNNER_TEMP": ".", "GITHUB_OUTPUT": "out"}
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", script],
        env={**os.environ, **dict.fromkeys(names, ""), **places, **inputs},
        stdout=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["gate", "--github", *passed]
    assert done.returncode == 4
    assert Path("out").read_text(encoding="utf-8") == "status=4\n"
    assert not Path("pwned").exists()


def test_a_baseline_keeps_the_period_of_its_tracker(invoke: Any, write: Any) -> None:
    """On a common clock a tracker that reports more often is judged as before."""
    rows = [f"a,{t},{t}" for t in range(31)]
    truth = write("truth.csv", "\n".join(("id,t,x", *rows, "")))

    def estimate(step: float) -> str:
        own = [f"e,{k * step + 0.3},{k * step + 0.3}" for k in range(int(29 / step))]
        return write("estimate.csv", "\n".join(("id,t,x", *own, "")))

    clock = ("-c", "5", "-g", "2", "--resample", "1", "--max-gap", "2")
    gate = ("gate", truth, estimate(2), "--baseline", "b.json", "-q")
    assert invoke(*gate, *clock, "--update-baseline").status == 0
    assert json.loads(Path("b.json").read_text())["pairs"]["pair"]["options"]["period"] == "2.0"
    assert invoke(*gate).status == 0
    estimate(1.5)
    answer = invoke(*gate, "--fail-on", "total:+50%")
    assert (answer.status, "period is" in answer.out) == (0, False)
