"""Filters by comparisons of columns, of both files or of one."""

import json
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from answer import Invoke

from tgospa_eval import ConfigError, InputError, associate, evaluate
from tgospa_eval.formats.options import parse_where

METRIC = ("-c", "5", "-g", "2")


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One object, and beside its track one of low scores, of which one is blank."""
    monkeypatch.chdir(tmp_path)
    truth = [f"{k},1,{10 + k},10" for k in range(6)]
    track = [f"{k},7,{10.5 + k},10,0.9,van" for k in range(6)]
    false = [f"{k},8,{50 + k},50,{'' if k == 5 else 0.1 + 0.02 * k},car" for k in range(6)]
    Path("gt.csv").write_text("\n".join(["frame,id,x,y", *truth, ""]))
    Path("res.csv").write_text("\n".join(["frame,id,x,y,score,my type", *track, *false, ""]))


@pytest.mark.parametrize(
    "test",
    [
        "score >= 0.5",
        "score>.5",
        "'score' != 0.1 and score > 0.2",
        "'my type' == van",
        "\"my type\" != 'car' AND frame >= 0",
        "id == 7",
        "id != '8'",
        "track < 8",
    ],
)
def test_rows_of_one_file(invoke: Invoke, test: str) -> None:
    more = ("--estimate-columns", "id=track") if "track" in test else ()
    if more:
        text = Path("res.csv").read_text()
        Path("res.csv").write_text(text.replace("frame,id,", "frame,track,"))
    answer = invoke(
        "gt.csv", "res.csv", *METRIC, "--estimate-where", test, *more, "--format", "json"
    )
    assert answer.status == 0, answer.err
    document = json.loads(answer.out)
    assert document["total"] == pytest.approx(1.5)
    assert document["parameters"]["estimate_where"] == [test]
    assert document["input"]["estimate"]["left_out"] == {"where": 6}
    assert document["input"]["truth"]["left_out"] == {}
    assert "res.csv: 6 rows left out by --estimate-where" in answer.err


def test_filters_add_up(invoke: Invoke) -> None:
    """Those of both files, and those of one; a blank passes no comparison with a number."""
    asked = ("--where", "frame >= 1", "--where", "frame != 3", "--estimate-where", "score != 0.9")
    answer = invoke("gt.csv", "res.csv", *METRIC, *asked, "--format", "json")
    found = json.loads(answer.out)
    assert found["parameters"]["where"] == ["frame >= 1", "frame != 3"]
    assert found["input"]["truth"]["left_out"] == {"where": 2}
    assert found["input"]["estimate"]["left_out"] == {"where": 9}
    assert found["counts"]["false"] == 3


def test_every_way_to_ask(invoke: Invoke) -> None:
    keyword: dict[str, Any] = {"cutoff": 5, "switch_penalty": 2, "estimate_where": "score >= 0.5"}
    tables = pd.read_csv("gt.csv"), pd.read_csv("res.csv")
    for sides in (("gt.csv", "res.csv"), tables):
        assert evaluate(*sides, **keyword).total == pytest.approx(1.5)
    assert associate(*tables, 5, b_where="score >= 0.5").total == pytest.approx(3)
    Path("tgospa-eval.toml").write_text(
        'cutoff = 5\nswitch-penalty = 2\nestimate-where = "score >= 0.5"\n'
    )
    pair = ("gt.csv", "res.csv")
    shutil.copy("res.csv", "other.csv")
    for asked in (
        pair,
        ("compare", *pair, "other.csv"),
        ("explain", *pair),
        ("inspect", *pair),
        ("batch", "--truth", "gt.csv", "--estimate", "{run}s.csv", "-o", "store"),
        ("gate", *pair, "--max", "tgospa=1.3"),
    ):
        answer = invoke(*asked)
        assert answer.status == 0, answer.err
        assert asked[0] == "inspect" or "1.2247" in answer.out
    status = invoke("associate", "gt.csv", "res.csv", "-c", "5", "--b-where", "score < 0.5").status
    assert status == 0


def test_columns_of_other_formats(invoke: Invoke) -> None:
    Path("gt.txt").write_text("1,1,10,20,4,6,1,1,1\n2,1,12,20,4,6,1,1,1\n")
    Path("res.txt").write_text("1,7,10,20,4,6,0.9,-1,-1,-1\n1,8,50,50,4,6,0.2,-1,-1,-1\n")
    answer = invoke("gt.txt", "res.txt", *METRIC, "--estimate-where", "conf >= 0.5", "-q")
    assert answer.out.startswith("TGOSPA = 3.53553")  # one state is missed
    for name in ("gt", "res"):
        pd.read_csv(f"{name}.csv").to_parquet(f"{name}.parquet")
    test = ("--estimate-where", "'my type' == van")
    assert "1.22474" in invoke("gt.parquet", "res.parquet", *METRIC, *test).out


def test_a_column_of_one_file_is_told_from_those_of_both(invoke: Invoke) -> None:
    for option, value in (("--region", "score=0.5:"), ("--where", "score >= 0.5")):
        answer = invoke("gt.csv", "res.csv", *METRIC, option, value)
        assert answer.status == 3
        assert f'gt.csv, line 1: no column "score" for {option}' in answer.err
        assert "for a column of one file use --truth-where or --estimate-where" in answer.err
    answer = invoke("gt.csv", "res.csv", *METRIC, "--estimate-where", "scor >= 0.5")
    assert 'no column "scor" for --estimate-where (found: frame, id' in answer.err


def test_what_cannot_be_compared_is_an_error(invoke: Invoke) -> None:
    keyword: dict[str, Any] = {"cutoff": 5, "switch_penalty": 2}
    text = Path("res.csv").read_text()
    Path("res.csv").write_text(text.replace("0.9,van", "high,van", 1))
    with pytest.raises(InputError, match=r'line 2, column "score": "high" is not a number as in'):
        evaluate("gt.csv", "res.csv", **keyword, estimate_where="score >= 0.5")
    with pytest.raises(InputError, match=r'line 2, column "x": 10 is a number, and .* a text'):
        evaluate("gt.csv", "res.csv", **keyword, truth_where="x == left")
    with pytest.raises(ConfigError, match="where is for files and tables, and truth is neither"):
        evaluate({"a": {0: [1, 2]}}, {"a": {0: [1, 2]}}, **keyword, truth_where="x > 1")
    answer = invoke("gt.csv", "res.csv", *METRIC, "--where", "x > 1000")
    assert (answer.status, "--where: no row is left to evaluate" in answer.err) == (2, True)
    for name in ("gt", "res"):
        Path(name).mkdir()
        Path(f"{name}.csv").rename(f"{name}/{name}.csv")
    answer = invoke("gt", "res", *METRIC, "--truth-where", "x > 1", "--memory", "1GB")
    assert answer.status == 2
    assert "--truth-where is not supported for data in parts" in answer.err


@pytest.mark.parametrize(
    ("test", "fault"),
    [
        *(
            (test, "must be COLUMN >= NUMBER or COLUMN == TEXT")
            for test in (
                *(
                    "",
                    "a",
                    "a ==",
                    "a == 1 and",
                    "a == 1 or b == 2",
                    "a = 1",
                    "a == b c",
                    "1 < a < 2",
                ),
                "__import__('os').system('x') == 1",
            )
        ),
        ("t < 2026-01-01", "texts are compared only by == and !=; time"),
        ("a > '1'", "texts are compared only by == and !="),
    ],
)
def test_tests_that_are_none(test: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=f"^--where .*{fault}"):
        parse_where(test, "--where")
