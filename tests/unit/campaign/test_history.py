"""Tests values of a gate over time."""

import json
from pathlib import Path

import pytest

from tgospa_eval.campaign.history import append_history, best_of_last, load_history
from tgospa_eval.campaign.outcome import PairOutcome
from tgospa_eval.campaign.rules import Value, Verdict
from tgospa_eval.errors import ConfigError


def outcome(total: float, judged: str = "x") -> PairOutcome:
    value = Value(lower=total, upper=total, proven=True, unit=1.0)
    return PairOutcome(
        name="a", truth="", estimate="", verdict=Verdict.PASS, status=0,
        values={"total": value}, judged=judged,
    )  # fmt: skip


def test_lines_are_appended_and_read_in_order_of_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "history.jsonl"
    assert load_history(str(path)) == []
    monkeypatch.setenv("GITHUB_SHA", "abc")
    append_history(str(path), [outcome(3)])
    old = json.dumps({"time": "2020-01-01T01:00:00+01:00", "commit": "", "values": {}})
    path.write_text(path.read_text() + old)  # without a newline at its end
    append_history(str(path), [outcome(4)])
    append_history(str(path), [])
    points = load_history(str(path))
    assert [point.commit for point in points] == ["", "abc", "abc"]
    assert points[0].time == "2020-01-01T00:00:00+00:00"
    assert points[1].values == {"a": {"values": {"total": 3.0}, "judged": "x", "verdict": "pass"}}
    assert path.read_bytes().count(b"\n") == 3


@pytest.mark.parametrize(
    "line",
    ["{", "[]", "<<<<<<< HEAD", '{"time": "now", "commit": "", "values": {}}', '{"values": 3}'],
)
def test_a_line_that_is_wrong(tmp_path: Path, line: str) -> None:
    path = tmp_path / "history.jsonl"
    append_history(str(path), [outcome(3)])
    path.write_text(f"{path.read_text()}\n{line}\n")
    with pytest.raises(ConfigError, match="line 3: is no line of a history"):
        load_history(str(path))


def test_best_of_the_last_that_were_judged_alike(tmp_path: Path) -> None:
    path = str(tmp_path / "history.jsonl")
    for value, judged in [(1, "x"), (4, "x"), (2, "y"), (3, "x"), (5, "x")]:
        append_history(path, [outcome(value, judged)])
    history = load_history(path)
    assert best_of_last(history, "a", "x", "total", 3) == 3
    assert best_of_last(history, "a", "x", "total", 9) == 1
    assert best_of_last(history, "a", "x", "missed", 9) is None
    assert best_of_last(history, "b", "x", "total", 9) is None


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be written"):
        append_history(str(tmp_path / "no" / "history.jsonl"), [outcome(3)])
