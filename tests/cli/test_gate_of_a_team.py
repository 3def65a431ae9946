"""The gate of a team: noisy seeds, pull requests, accepting in part."""

import base64
import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import yaml
from answer import Invoke
from evaluated_once import evaluated_once as evaluated_once  # a fixture of all tests here

import tgospa_eval
from tgospa_eval.api import batch_row
from tgospa_eval.campaign.gate.outcome import PairOutcome, Report
from tgospa_eval.campaign.gate.report import GATE_REPORTS
from tgospa_eval.campaign.gate.rules import STATUS, Value, judge, parse_rules

pytestmark = pytest.mark.usefixtures("evaluated_once")

STEPS = 20
SUITE = """
baseline = "base.json"
[options]
cutoff = 10
switch-penalty = 5
[[pair]]
truth = "data/{scene}/{seed}/truth.csv"
estimate = "out/{scene}/{seed}.csv"
"""
GROUPS = """
[[group]]
name = "{scene}"
fail-on = ["total:+2%"]
[[group]]
fail-on = ["total:+2%"]
"""
SCENES = {"slow": 100.0, "fast": 40.0, "dense": 200.0}


def write(path: str, text: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8")


def runs(
    change: float, noise: int, *, seeds: Iterable[int] = range(1, 6), spread: float = 0.05
) -> None:
    """Runs whose totals are those of the scenes, changed, with a noise of some per cent.

    The error is across the way, so that nobody looks for another clock.
    """
    rng = np.random.default_rng(noise)
    for scene, total in SCENES.items():
        for seed in seeds:
            error = (total * (1 + change) * np.exp(rng.normal(0, spread)) / STEPS) ** 0.5
            truth, estimate = (
                "".join(f"{name},{k},{k},{y:.12g}\n" for k in range(STEPS))
                for name, y in (("a", 0), ("b", error))
            )
            write(f"data/{scene}/{seed}/truth.csv", f"id,t,x,y\n{truth}")
            write(f"out/{scene}/{seed}.csv", f"id,t,x,y\n{estimate}")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the baseline that every test begins with is kept once it is made."""
    return tmp_path_factory.mktemp("kept") / "base.json"


@pytest.fixture
def gate(invoke: Invoke, tmp_path: Path, kept: Path) -> Invoke:
    """The gate of a suite with groups, whose baseline is there."""
    write("suite.toml", SUITE + GROUPS)
    runs(0, 1)

    def gate(*arguments: str, **about: Any) -> Any:
        return invoke("gate", "--suite", "suite.toml", "-q", *arguments, **about)

    if not kept.exists():
        assert gate("--update-baseline").status == 0
        shutil.copy("base.json", kept)
    shutil.copy(kept, "base.json")
    return gate


def groups(answer: Any) -> dict[str, Any]:
    """The groups of a JSON report by name."""
    return {one["name"]: one for one in json.loads(answer.out)["groups"]}


# --- groups ---------------------------------------------------------------------------------------


def test_a_change_of_the_tracker_fails(gate: Invoke) -> None:
    runs(0.14, 2)
    answer = gate("--format", "json")
    assert answer.status == 1
    found = groups(answer)
    assert found["all"]["verdict"] == "fail"
    (rule,) = found["all"]["rules"]
    assert rule["proven"]
    assert rule["inference"]["runs"] == 15
    assert rule["inference"]["paired"]
    assert rule["inference"]["p_value"] <= 0.05
    # Totals of a group are sums of those of its pairs.
    pairs = json.loads(Path("base.json").read_text(encoding="utf-8"))["pairs"]
    totals = {name: pairs[name]["values"]["total"] for name in pairs}
    (rule,) = found["slow"]["rules"]
    assert rule["baseline"] == pytest.approx(sum(totals[f"slow/{k}"] for k in range(1, 6)))
    text = gate().out
    assert "the tracker is worse than allowed, inferred from 15 runs with the same" in " ".join(
        text.split()
    )


def test_noise_passes_and_says_what_would_be_noticed(gate: Invoke) -> None:
    runs(0.05, 3)
    answer = gate("--format", "json")
    assert answer.status == 0
    assert json.loads(answer.out)["verdict"] == "pass"
    (rule,) = groups(answer)["all"]["rules"]
    assert rule["verdict"] == "undecided by seeds"
    assert 0.03 < rule["inference"]["noticeable"] < 0.15
    answer = gate("--github")
    text = answer.out
    assert "warning" not in text + answer.err
    assert text.startswith("gate: pass (exit status 0): ")
    assert "groups in noise" in text
    assert re.search(r"; a change of about \+\S+% would be detected", " ".join(text.split()))
    answer = gate("--strict")
    assert answer.status == 1
    assert "because of --strict, although within the noise of 15 runs" in " ".join(
        answer.out.split()
    )
    assert not tgospa_eval.gate(suite="suite.toml", strict=True)
    assert max(map(len, text.splitlines())) <= 80


def test_an_equal_tracker_passes_and_nothing_can_be_tightened(gate: Invoke) -> None:
    runs(-0.02, 4)
    answer = gate()
    assert answer.status == 0
    assert "tightened" not in answer.out
    runs(-0.2, 4)
    assert "baseline can be tightened" in gate().out


def without_seconds(report: Any) -> Any:
    """A report of JSON without times and the command that accepts it."""
    if isinstance(report, dict):
        kept = report.keys() - {"seconds", "update"}
        return {key: without_seconds(report[key]) for key in kept}
    return [*map(without_seconds, report)] if isinstance(report, list) else report


def test_python_judges_a_suite(gate: Invoke) -> None:
    runs(0.14, 2)
    answer = gate("--format", "json")
    judged = tgospa_eval.gate(suite="suite.toml")
    assert not judged
    assert judged.result is None
    text = GATE_REPORTS["json"](judged.report)
    assert without_seconds(json.loads(text)) == without_seconds(json.loads(answer.out))
    table = judged.findings
    assert set(table[table.verdict == "fail"].pair) == {"all", "all of {scene}"}
    assert any("the tracker is worse than allowed" in note for note in judged.notes)
    assert tgospa_eval.gate(suite="suite.toml", fail_on="total:+90%", group="scene")
    renewed = tgospa_eval.gate(suite="suite.toml", update_baseline=True, only="slow/*")
    assert renewed.report.tally == {"updated": 5, "unchanged": 10, "removed": 0}
    with pytest.raises(tgospa_eval.ConfigError, match="group is for suites"):
        tgospa_eval.gate("a.csv", "b.csv", "c.json", group="scene")
    with pytest.raises(TypeError, match="takes truth and estimate, or suite"):
        tgospa_eval.gate("a.csv", suite="suite.toml")


def test_processes_find_what_one_finds(gate: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("out/slow/2.csv").unlink()
    write("out/fast/3.csv", "id,t,x,y\na,1,2\n")
    alone = gate("--format", "json", "--jobs", "1")
    monkeypatch.setattr(batch_row, "PATIENCE", 0.0)
    several = gate("--format", "json", "--jobs", "2")
    assert (several.status, several.err) == (alone.status, alone.err)
    assert without_seconds(json.loads(several.out)) == without_seconds(json.loads(alone.out))


def test_other_seeds_are_no_proof(gate: Invoke) -> None:
    for folder in ("data", "out"):
        subprocess.run(["rm", "-r", folder], check=True)
    runs(0.14, 5, seeds=range(6, 11))
    answer = gate("--format", "json")
    assert answer.status == 1
    (rule,) = groups(answer)["all"]["rules"]
    assert not rule["proven"]
    assert not rule["inference"]["paired"]
    assert "proven" not in gate().out


def test_one_scene_that_is_worse_is_seen(invoke: Invoke, tmp_path: Path) -> None:
    write("suite.toml", SUITE + '[[group]]\nname = "{scene}"\nfail-on = ["total:+2%"]\n')
    seeds = range(1, 11)
    runs(0, 1, seeds=seeds)
    arguments = ("gate", "--suite", "suite.toml", "-q", "--format", "json")
    assert invoke(*arguments, "--update-baseline").status == 0
    kept = [Path(f"out/fast/{seed}.csv").read_text(encoding="utf-8") for seed in seeds]
    runs(0.3, 2, seeds=seeds)
    worse = [Path(f"out/fast/{seed}.csv").read_text(encoding="utf-8") for seed in seeds]
    runs(-0.1, 3, seeds=seeds)
    for seed, text, old in zip(seeds, worse, kept, strict=True):
        assert text != old
        write(f"out/fast/{seed}.csv", text)
    answer = invoke(*arguments)
    assert answer.status == 1
    found = {name: one["verdict"] for name, one in groups(answer).items()}
    assert found == {"all of {scene}": "pass", "dense": "pass", "fast": "fail", "slow": "pass"}


def test_runs_that_the_baseline_lacks_count_for_nothing(gate: Invoke) -> None:
    runs(0.3, 2)
    runs(-0.9, 3, seeds=range(6, 16))
    answer = gate("--format", "json")
    assert answer.status == 1
    ((warning,), none) = (groups(answer)[name]["warnings"] for name in ("slow", "all of {scene}"))
    assert (warning["code"], none) == ("not-in-baseline", [])
    assert "slow/6, slow/7, slow/8, slow/9, slow/10 and 5 more: not in the base" in warning["text"]
    assert "group slow: warning: slow/6" in answer.err
    subprocess.run(["rm", "-r", "data/slow/2"], check=True)
    assert groups(gate("--format", "json"))["slow"]["verdict"] == "not comparable"


def test_few_runs_decide_nothing(invoke: Invoke, tmp_path: Path) -> None:
    write("suite.toml", SUITE + '[[group]]\nname = "{scene}"\nfail-on = ["total:+2%"]\n')
    runs(0, 1, seeds=[1, 2])
    arguments = ("gate", "--suite", "suite.toml", "-q")
    said = invoke(*arguments, "--update-baseline").out
    assert "group dense (2), fast (2), slow (2): with so few runs the test can never show" in said
    runs(0.2, 2, seeds=[1, 2])
    out = " ".join(invoke(*arguments).out.split())
    assert "within noise: 2 runs with the same seeds, too few different runs for the test" in out
    assert "group all of {scene}: the tracker is worse than allowed" in out


def test_without_seeds_a_group_is_judged_by_its_bracket(invoke: Invoke, tmp_path: Path) -> None:
    write("suite.toml", SUITE + "[[group]]\nfail-on = ['tgospa:+1%', 'normalised.tgospa:+1%']\n")
    runs(0, 1, seeds=[1])
    arguments = ("gate", "--suite", "suite.toml", "-q", "--format", "json")
    assert invoke(*arguments, "--update-baseline").status == 0
    runs(0.03, 1, seeds=[1])
    answer = invoke(*arguments)
    assert answer.status == 1
    for rule in groups(answer)["all"]["rules"]:
        assert "inference" not in rule
        assert rule["proven"]
        assert rule["upper"] / rule["baseline"] == pytest.approx(1.03**0.5)
    runs(0, 1, seeds=[2])
    subprocess.run(["rm", "-r", "data/slow/1", "data/fast/1", "data/dense/1"], check=True)
    answer = invoke(*arguments)  # one run of each, with another seed: nothing is known
    assert answer.status == 2
    assert "each scene has only one run" in groups(answer)["all"]["notes"][0]


def test_a_group_with_a_run_that_fails_is_not_judged(gate: Invoke) -> None:
    write("out/slow/2.csv", "")
    answer = gate("--format", "json")
    assert answer.status == 3
    found = groups(answer)
    assert found["slow"]["verdict"] == found["all"]["verdict"] == "not comparable"
    assert found["fast"]["verdict"] == "pass"


def test_another_truth_is_not_comparable(gate: Invoke) -> None:
    text = Path("data/slow/2/truth.csv").read_text(encoding="utf-8")
    write("data/slow/2/truth.csv", text.replace("a,3,3,0\n", "a,3,3.5,0\n"))
    answer = gate("--format", "json")
    assert answer.status == 2
    assert groups(answer)["slow"]["verdict"] == "not comparable"


def test_groups_on_the_command_line_and_of_batches(gate: Invoke, invoke: Invoke) -> None:
    write("suite.toml", SUITE)
    runs(0.14, 2)
    answer = gate("--group", "scene", "--fail-on", "total:+2%", "--format", "json")
    assert answer.status == 1
    assert set(groups(answer)) == {*SCENES, "all of {scene}"}
    answer = gate("--group", "all", "--confidence", "0.9999", "--fail-on", "total:+2%")
    assert answer.status == 0
    labels = ("--truth", "data/{scene}/{seed}/truth.csv", "--estimate", "out/{scene}/{seed}.csv")
    assert invoke("batch", *labels, "-c", "10", "-g", "5", "-o", "new", "-q").status == 0
    runs(0, 1)
    assert invoke("batch", *labels, "-c", "10", "-g", "5", "-o", "old", "-q").status == 0
    answer = invoke("gate", "old", "new", "--group", "all", "--fail-on", "total:+2%", "-q")
    assert answer.status == 1
    assert "group all" in answer.out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[group]]\nname = "{site}"\n', '"{site}": {site} is in no pattern of a pair'),
        ('[[group]]\nname = "{seed}"\n', "must not have {seed}, which tells its runs"),
        ('[[group]]\nseed = "run"\n', "no pattern of a pair has {run}"),
        ('[[group]]\nname = "{scene"\n', "a brace without a label"),
        ("[[group]]\n[[group]]\n", 'two groups have the name "all"'),
        ("[[group]]\nconfidence = 1\n", "confidence is 1: must be from 0.5 to below 1"),
        ('[[group]]\nconfidence = "x"\n', '"confidence" must be a number'),
        ("[group]\n", '"group" must be a list of tables; write [[group]]'),
        (
            "[[group]]\nfail-on = 'total'\n",
            '--fail-on "total": must be a value of the result',
        ),
        ("[[limits]]\nfail-on = 'total:+1%'\n", '"match" must be a text'),
        ("[[limits]]\nmatch = 'x/*'\n", 'no pair has a name that matches "x/*"'),
    ],
)
def test_wrong_tables(gate: Invoke, text: str, said: str) -> None:
    write("suite.toml", SUITE + text)
    answer = gate()
    assert answer.status == 2
    assert said in answer.err


def test_limits_of_their_own(gate: Invoke) -> None:
    more = "fail-on = ['total:+1%']\n"
    limits = "[[limits]]\nmatch = 'slow/*'\nfail-on = ['total:+50%']\nmax = ['total=1']\n"
    write("suite.toml", more + SUITE + limits)
    runs(0.3, 1, spread=0)
    found = {one["name"]: one for one in json.loads(gate("--format", "json").out)["pairs"]}
    assert [rule["rule"] for rule in found["slow/1"]["rules"]] == ["total:+50%", "total<=1"]
    assert [rule["rule"] for rule in found["fast/1"]["rules"]] == ["total:+1%"]


# --- accepting in part ----------------------------------------------------------------------------


def entries() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("base.json").read_text(encoding="utf-8"))["pairs"]
    return found


def test_an_update_of_some(gate: Invoke) -> None:
    before = entries()
    runs(0.2, 1)
    answer = gate("--update-baseline", "--only", "slow/*")
    assert answer.status == 0
    assert "5 updated, 10 unchanged, 0 removed" in answer.out
    after = entries()
    assert {name for name in before if before[name] != after[name]} == {
        f"slow/{k}" for k in range(1, 6)
    }
    before = Path("base.json").read_bytes()
    answer = gate("--update-baseline", "--only", "fast/*", "--only", "none")
    assert (answer.status, '--only "none": no pair has such a name' in answer.err) == (2, True)
    assert Path("base.json").read_bytes() == before
    assert gate("--only", "slow/*").status == 2


def test_entries_without_a_pair_stay_unless_pruned(gate: Invoke) -> None:
    subprocess.run(["rm", "-r", "data/slow", "data/fast"], check=True)
    answer = gate("--update-baseline")
    assert "0 updated, 15 unchanged, 0 removed" in answer.out
    assert len(entries()) == 15
    answer = gate("--update-baseline", "--prune", "--only", "slow/*")
    assert "0 updated, 10 unchanged, 5 removed" in answer.out
    assert not any(name.startswith("slow") for name in entries())


def test_the_command_accepts_what_failed_and_nothing_else(gate: Invoke, invoke: Invoke) -> None:
    write("suite.toml", SUITE)
    runs(0.1, 1)
    accepted = gate("--update-baseline").status
    runs(0.1, 1)
    write(
        "out/slow/3.csv", Path("out/slow/3.csv").read_text(encoding="utf-8").replace("b,3", "c,3")
    )
    answer = gate("--format", "json")
    assert accepted == 0
    assert answer.status == 1
    command = json.loads(answer.out)["update"]
    assert (
        command
        == "tgospa-eval gate --suite suite.toml -q --format json --update-baseline --only slow/3"
    )
    before = entries()
    assert invoke(*command.split()[1:]).status == 0
    assert {name for name in before if before[name] != entries()[name]} == {"slow/3"}
    assert gate().status == 0


def test_the_command_names_a_scene_that_failed_whole_by_a_pattern(gate: Invoke) -> None:
    write("suite.toml", SUITE)
    slow = {path: path.read_text(encoding="utf-8") for path in Path("out/slow").iterdir()}
    runs(0.3, 1)
    for path, content in slow.items():  # as in the baseline
        path.write_text(content, encoding="utf-8")
    command = json.loads(gate("--format", "json").out)["update"]
    assert command.endswith("--update-baseline --only 'dense/*' --only 'fast/*'")


@pytest.mark.parametrize("lost", ["out/slow/*.csv", "out/*/*.csv", "new\nname"])
def test_no_command_is_proposed_that_does_not_work(
    against: Invoke, gate: Invoke, lost: str
) -> None:
    for path in Path().glob(lost):
        path.unlink()
    if "\n" in lost:
        for folder in ("data", "out"):
            Path(folder, "slow").rename(Path(folder, lost))
    for judged in (against, gate):
        answer = judged("--format", "json")
        assert answer.status in (2, 3)
        assert json.loads(answer.out)["update"] == ""
        assert "--prune" not in answer.out


def test_an_update_says_which_parameter_changed(gate: Invoke) -> None:
    answer = gate("--update-baseline", "--only", "slow/1", "-c", "9")
    assert "slow/1: cutoff is 9.0, was 10.0" in answer.out


def branches_that_accept(gate: Invoke) -> None:
    """A merge of two branches that both changed an entry, and of which each added one."""
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    git("checkout", "-b", "mine")
    for change, branch in ((0.2, "mine"), (0.4, "main")):
        git("checkout", branch)
        runs(change, 1)
        assert gate("--update-baseline", "--only", "slow/2").status == 0
        git("commit", "-m", branch, "base.json")
        git("checkout", ".")
    with pytest.raises(subprocess.CalledProcessError):
        git("merge", "mine")


@pytest.mark.parametrize("style", ["merge", "diff3"])
def test_a_baseline_in_conflict_is_resolved_by_an_update_of_some(gate: Invoke, style: str) -> None:
    git("init")
    git("config", "merge.conflictStyle", style)
    branches_that_accept(gate)
    before = Path("base.json").read_bytes()
    assert b"<<<<<<<" in before
    answer = gate()
    assert answer.status == 2
    said = (
        "base.json: has a merge conflict; --update-baseline --only slow/2 renews only the entries"
    )
    assert said in answer.err
    assert gate("--update-baseline", "--only", "fast/*").status == 2
    assert Path("base.json").read_bytes() == before
    runs(0.4, 1)  # what this side has already
    updated = gate("--update-baseline", "--only", "slow/2").out
    assert "base.json: the merge conflict is resolved" in updated
    assert gate().status != 2
    Path("base.json").write_bytes(before)
    runs(0, 1)
    answer = gate("--update-baseline", "--only", "slow/2")
    assert (answer.status, len(entries())) == (0, 15)
    assert gate().status == 0


def test_a_mark_of_a_conflict_that_was_forgotten(gate: Invoke) -> None:
    text = Path("base.json").read_text(encoding="utf-8")
    write("base.json", f"<<<<<<< HEAD\n{text}")
    answer = gate()
    assert answer.status == 2
    assert "base.json: has a merge conflict; delete the conflict markers" in answer.err


# --- whether the tracker ran ----------------------------------------------------------------------


def test_estimates_that_are_older_fail(gate: Invoke, tmp_path: Path) -> None:
    for path in Path("out").glob("*/*.csv"):
        os.utime(path, (1000, 1000))
    write("started", "")
    os.utime("started", (2000, 2000))
    os.utime("out/fast/1.csv", (2000, 2000))
    assert gate().status == 0
    answer = gate("--newer-than", "started", "--junit", "gate.xml", "--format", "json")
    assert answer.status == 1
    verdicts = {one["name"]: one["verdict"] for one in json.loads(answer.out)["pairs"]}
    assert [name for name in verdicts if verdicts[name] == "pass"] == ["fast/1"]
    assert 'failures="14"' in Path("gate.xml").read_text(encoding="utf-8")
    assert gate("--newer-than", "1970-01-01T00:10Z").status == 0
    answer = gate("--newer-than", "2026-11-28T06:00+01:00")
    assert (answer.status, "did the tracker run?" in answer.out) == (1, True)
    assert gate("--newer-than", "yesterday").status == 2
    assert gate("--newer-than", "started", "--update-baseline").status == 3
    assert not tgospa_eval.gate(suite="suite.toml", newer_than=Path("started"))


# --- against the target branch --------------------------------------------------------------------


def git(*arguments: str) -> None:
    names = ("-c", "user.name=a", "-c", "user.email=a@example.com", "-c", "init.defaultBranch=main")
    subprocess.run(("git", *names, *arguments), check=True, capture_output=True)


@pytest.fixture
def against(gate: Invoke) -> Invoke:
    """The same against the branch main, which has all of this."""
    git("init")
    git("add", ".")
    git("commit", "-m", "first")

    def against(*arguments: str, **about: Any) -> Any:
        return gate("--against", "main", *arguments, **about)

    return against


def edit(path: str, old: str, new: str) -> None:
    text = Path(path).read_text(encoding="utf-8")
    assert old in text
    write(path, text.replace(old, new))


def edits(*changes: tuple[str, str], path: str = "suite.toml") -> Callable[[], None]:
    """What makes these edits of a file, one after another."""

    def made() -> None:
        for old, new in changes:
            edit(path, old, new)

    return made


OF_SCENES = 'name = "{scene}"\nfail-on'
loosened = edits((f'{OF_SCENES} = ["total:+2%"]', f'{OF_SCENES} = ["total:+900%"]'))
baseline_options = edits(('"cutoff": 10.0', '"cutoff": 0.1'), path="base.json")


def other_baseline() -> None:
    edit("suite.toml", '"base.json"', '"other.json"')
    write("other.json", Path("base.json").read_text(encoding="utf-8").replace(": 1", ": 9"))


def edited_sums() -> None:
    text = Path("base.json").read_text(encoding="utf-8")
    document = json.loads(text)
    for entry in document["pairs"].values():
        values = entry["values"]
        for name in ("total", "localisation"):
            values[name] *= 9
        for name in ("tgospa", "lower_bound", "upper_bound"):
            values[name] *= 3
    write("base.json", json.dumps(document))


def linked_suite() -> None:
    write("lax.toml", SUITE)
    Path("suite.toml").unlink()
    Path("suite.toml").symlink_to("lax.toml")


def appended_limits() -> None:
    for name in ("*", "slow/*"):
        text = f'[[limits]]\nmatch = "{name}"\nfail-on = ["total:+900%"]\n'
        write("suite.toml", Path("suite.toml").read_text(encoding="utf-8") + text)


def attributes_of_git() -> None:
    write(".gitattributes", "* -diff -text binary\n*.json merge=ours\n")
    loosened()


def a_folder_of_the_same_name() -> None:
    edited_sums()
    git("commit", "-am", "lax")
    git("checkout", "-b", "pull")
    git("branch", "-f", "main", "main~1")
    Path("main").mkdir()
    shutil.copytree("data", "main/data")
    write("main/suite.toml", SUITE)


def of_metric(more: str) -> Callable[[], None]:
    """More options of the suite."""
    return edits(("cutoff = 10", f"cutoff = 10\n{more}"))


WEAKER: dict[str, tuple[Callable[[], object], ...]] = {
    "looser rules": (
        attributes_of_git,
        appended_limits,
        partial(write, "pyproject.toml", "[tool.tgospa-eval]\nscale = 'y=0.01'\n"),
    ),
    "warnings": (
        edits(
            (OF_SCENES, 'name = "{scene}"\nmax = "missed=1"\nwarn-on'),
            ("max =", "fail-on = 'missed:+1'\nmax ="),
        ),
        other_baseline,
    ),
    "other metric": (
        edits(("cutoff = 10", "cutoff = 3")),
        partial(write, "tgospa-eval.toml", "scale = 'x=0.1'\n"),
        edits(("[[group]]\nname", "[[group]]\nconfidence = 0.9999\nname")),
    ),
    "other distance": (
        of_metric('distance = "chebyshev"\nscale = "y=0.01"'),
        edits((GROUPS, f"{GROUPS}[[group]]\nname = 'more {{scene}}'\n")),
        edited_sums,
    ),
    "fewer steps": (
        of_metric('time = "0:0"'),
        edits(
            ("[[group]]\nname", '[[group]]\nseed = "scene"\nname'), ('"{scene}"\n', '"{seed}"\n')
        ),
        edits(('"scene": "slow"', '"scene": "gone"'), path="base.json"),
    ),
    "other names": (
        edits((GROUPS, "")),
        edits((TRUTHS := 'truth = "data/{scene}/{seed}', f'name = "{{scene}}-{{seed}}"\n{TRUTHS}')),
        baseline_options,
    ),
    "other label": (
        edits(("{seed}", "{run}")),
        partial(write, "base.json", '{"schema": "tgospa-eval/baseline/2", "pairs": {}}'),
    ),
    "fewer pairs": (edits(("data/{scene}/", "data/{scene}w/"), ("out/{scene}/", "out/{scene}w/")),),
    "nothing": (partial(os.remove, "suite.toml"), partial(os.remove, "base.json")),
    "link": (linked_suite,),
    "mark": (partial(write, "suite.toml", f"\ufeff{SUITE}"),),
    "folder": (a_folder_of_the_same_name,),
}
"""Ways to weaken a gate; those of one entry act on different parts of it."""


@pytest.mark.parametrize("weaken", WEAKER.values(), ids=WEAKER)
def test_what_a_branch_makes_of_its_gate_counts_for_nothing(
    against: Invoke, weaken: tuple[Callable[[], object], ...]
) -> None:
    runs(0.3, 2)
    for change in weaken:
        change()
    answer = against("--format", "json")
    assert (answer.status, json.loads(answer.out)["against"]) == (1, "main")
    rules = {
        (one["name"], rule["rule"]) for one in groups(answer).values() for rule in one["rules"]
    }
    assert rules == {(name, "total:+2%") for name in (*SCENES, "all of {scene}", "all")}
    assert groups(answer)["all"]["verdict"] == "fail"


def test_the_same_of_a_folder(
    gate: Invoke, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = str(tmp_path_factory.mktemp("target"))
    shutil.copytree(".", other, dirs_exist_ok=True)
    assert gate("--against", other).status == 0
    loosened()
    baseline_options()
    write("tgospa-eval.toml", "scale = 'x=0.1'\n")
    edit("data/slow/1/truth.csv", "a,3,3,0\n", "a,3,3.5,0\n")
    shutil.rmtree("data/fast/2")
    answer = gate("--against", other, "--format", "json")
    assert answer.status == 3
    assert {one["name"]: one["verdict"] for one in json.loads(answer.out)["groups"]} == {
        "all": "not comparable",
        "dense": "pass",
        "fast": "not comparable",
        "slow": "not comparable",
    }
    shutil.copytree(Path(other) / "data", "data", dirs_exist_ok=True)
    runs(0.3, 2)
    assert gate("--against", other).status == 1


def test_a_truth_is_that_of_the_target(against: Invoke, gate: Invoke) -> None:
    edit("data/slow/1/truth.csv", "a,3,3,0\n", "a,3,3.5,0\n")
    assert gate("--update-baseline").status == 0
    answer = against()
    assert answer.status == 2
    said = " ".join(answer.out.split())
    assert "slow/1: data/slow/1/truth.csv: this branch changes this file, but main judges" in said
    assert "first state that differs: a at 3: 3.0, 0.0 -> 3.5, 0.0 (was -> is; since main)" in (
        said
    )
    assert groups(against("--format", "json"))["slow"]["verdict"] == "not comparable"
    git("checkout", ".")
    truth = Path("data/slow/1/truth.csv")
    truth.rename("moved.csv")
    truth.symlink_to("../../../moved.csv")
    assert against().status == 2


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("a,3,3,0\n", "a,3,3.5,0\n", "a at 3: 3.0, 0.0 -> 3.5, 0.0"),
        ("a,3,3,0\n", "", "a at 3: 3.0, 0.0 -> nothing"),
        ("a,3,3,0\n", "a,3,3,0\nnew,2,1,1\n", "new at 2: nothing -> 1.0, 1.0"),
    ],
)
def test_a_truth_that_changed_since_its_baseline(
    against: Invoke, gate: Invoke, old: str, new: str, said: str
) -> None:
    edit("data/slow/1/truth.csv", old, new)
    git("commit", "-am", "the truth alone")
    answer = gate()
    assert answer.status == 2
    out = " ".join(answer.out.split())
    assert "slow/1: not judged on the same " in out
    assert f"first state that differs: {said} (was -> is; since " in out
    assert "--resample" not in out


def test_variables_that_set_nothing_are_named(
    gate: Invoke, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGOSPA_EVAL_CUTTOFF", "1")
    monkeypatch.setenv("TGOSPA_EVAL_GROUP", "scene")
    monkeypatch.setenv("TGOSPA_EVAL_GAMMA", "5")
    files = ("data/slow/1/truth.csv", "out/slow/1.csv")
    for answer in (gate(), invoke("inspect", *files), invoke(*files)):
        assert answer.status == 0
        assert "TGOSPA_EVAL_CUTTOFF: has no effect; did you mean TGOSPA_EVAL_CUTOFF?" in answer.err
        assert "TGOSPA_EVAL_GROUP: has no effect" in answer.err
        assert "TGOSPA_EVAL_GAMMA" not in answer.err
    assert "--group is only for the command line" in gate().err


@pytest.mark.parametrize("gone", ["data/slow", "data/slow/1", "out/slow", "out/slow/1.csv"])
def test_a_scene_that_is_removed_or_renamed_is_a_failure(
    against: Invoke, gate: Invoke, gone: str
) -> None:
    Path(gone).rename(f"{gone}-moved")
    gate("--update-baseline", "--prune")
    answer = against("--format", "json")
    assert answer.status in (2, 3)
    assert groups(answer)["slow"]["verdict"] == "not comparable"


def test_seeds_that_the_target_does_not_know_decide_nothing(against: Invoke, gate: Invoke) -> None:
    for folder in ("data", "out"):
        shutil.rmtree(folder)
    runs(0, 9, seeds=range(21, 26))
    assert gate("--update-baseline", "--prune").status == 0
    answer = against("--format", "json")
    assert answer.status == 3
    assert {one["verdict"] for one in groups(answer).values()} == {"not comparable"}


def test_a_new_scene_passes_until_the_target_has_it(
    against: Invoke, gate: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    write("suite.toml", f"max = ['total=300']\n{SUITE}{GROUPS}")
    git("commit", "-am", "limit")
    monkeypatch.setitem(SCENES, "new", 250.0)
    runs(0, 1)
    assert gate("--update-baseline").status == 0
    answer = against("--format", "json")
    assert answer.status == 0
    document = json.loads(answer.out)
    assert "new" not in groups(answer)
    new = [one for one in document["pairs"] if one["name"].startswith("new/")]
    assert {one["verdict"] for one in new} == {"new, not judged"}
    assert [rule["rule"] for rule in new[0]["rules"]] == ["total<=300"]
    monkeypatch.setitem(SCENES, "new", 400.0)
    runs(0, 1, spread=0)
    answer = against()
    assert answer.status == 0
    assert "5 pairs new, not judged" in " ".join(answer.out.split())
    assert "warning: total is at least" in answer.out
    runs(0, 1)
    monkeypatch.setitem(SCENES, "slow", 400.0)  # above the limit, which only warns
    runs(0, 1, seeds=[7])  # another seed of scenes that are known
    answer = against("--strict")
    assert (answer.status, "9 pairs new, not judged" in " ".join(answer.out.split())) == (0, True)
    assert "slow/7: warning: total is at least" in answer.out
    write("out/new/1.csv", "")
    assert against().status == 3
    write("out/slow/7.csv", "id,t,x,y\n")  # its truth is not in the target
    answer = against()
    assert (answer.status, "slow/7: the tracker failed" in answer.out) == (1, True)


def test_a_new_tracker_passes_until_the_target_has_it(against: Invoke) -> None:
    text = SUITE.replace("out/{scene}", "out/{tracker}/{scene}") + "[[group]]\nname = '{tracker}'\n"
    write("suite.toml", text + "fail-on = ['total:+2%']\n")
    shutil.move("out", "mine")
    shutil.move("mine", "out/mine")
    git("add", ".")
    git("commit", "-m", "trackers")
    document = json.loads(Path("base.json").read_text(encoding="utf-8"))
    document["pairs"] = {
        f"mine/{name}": entry | {"labels": entry["labels"] | {"tracker": "mine"}}
        for name, entry in document["pairs"].items()
    }
    write("base.json", json.dumps(document))
    git("commit", "-am", "baseline")
    shutil.copytree("out/mine", "out/other")
    answer = against("--format", "json")
    assert (answer.status, list(groups(answer))) == (0, ["mine"])
    shutil.rmtree("out/mine")
    assert against().status == 3


def test_limits_alone_need_no_baseline_of_the_target(against: Invoke) -> None:
    write("suite.toml", "max = ['total=300']\n" + SUITE.replace('baseline = "base.json"\n', ""))
    git("commit", "-am", "limits")
    assert against().status == 0
    write("suite.toml", "max = ['total=9000']\n" + SUITE)
    shutil.rmtree("data/slow/1")
    answer = against()
    assert answer.status == 3
    assert "data/slow/1/truth.csv: this branch lacks the file, but main has it" in answer.err
    runs(3, 1)
    assert against().status == 1
    shutil.rmtree("out/slow")
    answer = against()
    assert (answer.status, answer.err.count("out/slow/1.csv")) == (1, 1)


@pytest.mark.parametrize("option", ["ignore-regions", "region"])
def test_files_that_options_name_are_the_target_s(against: Invoke, option: str) -> None:
    write("regions.csv", "left,top,width,height\n900,900,1,1\n")
    options = f"[options]\n{option} = 'regions.csv'"
    write("suite.toml", SUITE.replace("[options]", options))
    git("add", "regions.csv")
    git("commit", "-am", "regions")
    write("regions.csv", "left,top,width,height\n-900,-900,1800,1800\n")
    answer = against()
    assert answer.status == 2
    assert "regions.csv: this branch changes this file, but main judges" in " ".join(
        answer.out.split()
    )


def test_a_baseline_that_is_updated_passes_nothing(against: Invoke, gate: Invoke) -> None:
    runs(0.3, 2)
    assert gate("--update-baseline").status == 0
    assert gate().status == 0
    answer = against()
    assert answer.status == 1
    assert "To accept the new values, if they are right; main judges until it has" in answer.out
    assert "\n  tgospa-eval gate --suite suite.toml -q --update-baseline" in answer.out


def test_variables_count_for_nothing(
    against: Invoke, gate: Invoke, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    lax = f"fail-on = ['total:+900%']\n{SUITE}"
    write("lax.toml", lax)
    write("other.toml", "suite = 'lax.toml'\nfail-on = 'total:+900%'\nscale = 'y=0.1'\n")
    git("add", ".")
    git("commit", "-m", "more")
    runs(0.3, 2)
    values = {
        "FAIL_ON": "total:+900%",
        "CUTOFF": "0.1",
        "SUITE": "lax.toml",
        "GAMMA": "0",
        "CONFIG": "other.toml",
        "BASELINE": "none.json",
        "TIME": "0:1",
        "SOLVER": "sinkhorn",
    }
    for name, value in values.items():
        monkeypatch.setenv(f"TGOSPA_EVAL_{name}", value)
    assert against().status == 1
    answer = invoke("gate", "--suite", "suite.toml", "--against", "main")
    assert answer.status == 1
    assert "TGOSPA_EVAL_CUTOFF" in answer.err
    assert "ignored, because the settings of main count" in answer.err
    assert invoke("gate", "--against", "main", "-q").status == 2  # no suite is named
    for name in values:
        monkeypatch.delenv(f"TGOSPA_EVAL_{name}")
    loosened()
    monkeypatch.setenv("TGOSPA_EVAL_AGAINST", "main")
    assert gate("--format", "json").status == 1


def test_configuration_is_that_of_the_target(against: Invoke, gate: Invoke, invoke: Invoke) -> None:
    write("tgospa-eval.toml", "unit = 'm'\n")
    write("ci.toml", "suite = 'suite.toml'\nmax = 'total=300'\n")
    git("add", ".")
    git("commit", "-m", "configuration")
    write("tgospa-eval.toml", "unknown = 3\n")
    write("ci.toml", "suite = 'none.toml'\n")
    settings = json.loads(against("--format", "json").out)["settings_file"]
    assert (settings["path"], settings["options"]) == ("main:tgospa-eval.toml", {"unit": "m"})
    named = ("gate", "--against", "main", "-q", "--config")
    assert invoke(*named, "ci.toml").status == 0
    runs(4, 1)
    assert "total<=300" in invoke(*named, "ci.toml", "--format", "json").out
    write("mine.toml", "suite = 'suite.toml'\n")
    answer = invoke(*named, "mine.toml")
    assert (answer.status, "main:mine.toml: there is no such file" in answer.err) == (2, True)


def test_two_honest_pull_requests_pass(
    against: Invoke, gate: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    git("checkout", "-b", "tracker")  # worse, and right
    runs(0.3, 2)
    git("commit", "-am", "tracker")
    command = json.loads(against("--format", "json").out)["update"].split()
    assert gate(*command[5:]).status == 0
    accepted = Path("base.json").read_bytes()
    git("checkout", "base.json")
    git("checkout", "-b", "accepted", "main")
    Path("base.json").write_bytes(accepted)
    assert against().status == 0
    git("commit", "-am", "baseline")
    git("branch", "-f", "main")
    git("checkout", "tracker")
    assert against().status == 0
    monkeypatch.setitem(SCENES, "new", 250.0)
    runs(0.3, 2)
    assert against().status == 0


def test_flags_of_an_update_are_none_of_a_target(against: Invoke) -> None:
    runs(0.3, 2)
    for flag in ("--only", "--prune"):
        answer = against(flag, *(["slow/*"] if flag == "--only" else []))
        assert (answer.status, f"{flag} is for --update-baseline" in answer.err) == (2, True)


def test_stricter_flags_hold(against: Invoke) -> None:
    assert against("--max", "total=1").status == 1


def test_an_error_is_in_the_folder_too(gate: Invoke) -> None:
    assert gate("-o", "report").status == 0
    write("base.json", "{")
    assert gate("-o", "report").status == 2
    assert "base.json: is not a baseline" in Path("report/gate.md").read_text(encoding="utf-8")


def test_a_suite_that_is_a_link_or_has_a_byte_order_mark(against: Invoke, gate: Invoke) -> None:
    text = Path("suite.toml").read_text(encoding="utf-8")
    write("ci/real.toml", f"\ufeff{text}")
    Path("suite.toml").unlink()
    Path("suite.toml").symlink_to("ci/real.toml")
    assert gate().status == 0
    git("add", ".")
    git("commit", "-m", "link")
    write("ci/real.toml", "")
    assert against().status == 0
    write("ci/real.toml", "unknown = 1")
    git("commit", "-am", "unknown")
    answer = against()
    assert (answer.status, 'main:suite.toml: unknown key "unknown"' in answer.err) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--against", "no"), "is not a git revision in this repository"),
        (("--against", "data"), "write ./data for the folder"),
        (("--against", "HEAD:ci"), "is not a git revision in this repository"),
        (("--against=--output=x",), "is not a git revision in this repository"),
        (("--against", "./none"), "there is no such folder"),
        (("--against", "main", "--suite", "none.toml"), "main:none.toml: there is no such file"),
        (("--against", "main", "--baseline", "no.json"), "main:no.json: there is no such file"),
        (("--protect",), "--protect is gone: --against TARGET judges by the suite"),
        (("--history", "h.jsonl"), "--history is gone: keep the output of"),
        (("--format", "bencher"), "--format bencher is gone: --format json"),
        (("--fail-on", "total:+5% best-of-last 20"), "best-of-last is gone; use a rule such as"),
        (("--against", "main", "--update-baseline"), "leave one of them out"),
    ],
)
def test_wrong_targets_and_what_is_gone(
    against: Invoke, gate: Invoke, arguments: tuple[str, ...], said: str
) -> None:
    answer = gate(*arguments)
    assert answer.status == 2
    assert said in answer.err


def test_the_configuration_of_the_branch_hides_no_wrong_target(gate: Invoke) -> None:
    write("tgospa-eval.toml", 'fail-on = "total:+900%"\n')
    answer = gate("--against", "main", "--junit", "g.xml")
    assert answer.status == 2
    assert '--against "main": this folder is in no git repository' in answer.err
    assert "fail-on" not in answer.err
    assert Path("g.xml").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--seed-label", "sed"), "--seed-label sed: no pattern of a pair has {sed}"),
        (("--seed-label", "scene"), '"{scene}" must not have {scene}, which tells'),
        (("--steps", "0..3"), '--steps "0..3": must be FIRST:LAST'),
    ],
)
def test_a_wrong_option_is_said_once(gate: Invoke, arguments: tuple[str, ...], said: str) -> None:
    answer = gate(*arguments)
    assert answer.status == 2
    assert answer.err.count(said) == 1
    assert len(answer.err.splitlines()) == 1


def test_targets_are_for_files(against: Invoke, gate: Invoke, invoke: Invoke) -> None:
    labels = ("--truth", "data/{scene}/{seed}/truth.csv", "--estimate", "out/{scene}/{seed}.csv")
    assert invoke("batch", *labels, "-c", "10", "-g", "5", "-o", "store", "-q").status == 0
    answer = invoke("gate", "store", "--baseline", "base.json", "--against", "main")
    assert answer.status == 2
    assert "--against is for files and suites, not for stores" in answer.err
    before = Path("data/slow/1/truth.csv").read_text(encoding="utf-8")
    answer = against("--junit", "data/slow/1/truth.csv")
    assert answer.status == 2
    assert "is an input of the gate" in answer.err
    assert Path("data/slow/1/truth.csv").read_text(encoding="utf-8") == before


# --- reports --------------------------------------------------------------------------------------


def test_markdown_has_failures_first_and_fits_into_a_comment(gate: Invoke) -> None:
    write("suite.toml", SUITE)
    runs(0, 2, seeds=range(1, 6))
    text = gate("--format", "markdown").out
    failing, _, passing = text.partition("<details>")
    assert "**fail**" in failing
    assert "| pass |" not in failing
    assert "**fail**" not in passing
    assert "%" in failing.splitlines()[4].split("|")[6]
    files = 'truth = "data/slow/1/truth.csv"\nestimate = "out/slow/1.csv"\n'
    many = "".join(f'[[pair]]\nname = "{"x" * 99}{k}"\n{files}' for k in range(900))
    write("suite.toml", SUITE + many)
    text = gate("--format", "markdown").out
    assert 0 < len(text.encode()) <= 60_000
    assert "does not fit" in text


def test_what_fails_and_the_command_survive_in_any_length() -> None:
    def found(k: int, now: float, name: str = "") -> PairOutcome:
        about = {"name": name or f"{'x' * 40}{k}", "truth": "t", "estimate": "e"}
        rules = parse_rules(["total:+30%"], ["total:+1%"], [])
        value = Value(lower=now, upper=now, proven=True, unit=1.0)
        findings = tuple(judge(rule, value, 1.0) for rule in rules)
        verdict = findings[0].verdict
        return PairOutcome(
            verdict=verdict, status=STATUS[verdict], findings=findings, notes=(f"why {k}",), **about
        )

    def text(fail: int) -> str:
        some = [found(k, 1.1) for k in range(2000)] + [
            found(k, 9.0, f"bad{k}") for k in range(fail)
        ]
        again = ("tgospa-eval", "gate", "--update-baseline", "--only", "bad*")
        report = Report(baseline="b.json", outcomes=tuple(some), version="1", again=again)
        return GATE_REPORTS["markdown"](report)

    few, many = text(3), text(900)
    for one in (few, many):
        assert len(one.encode()) <= 60_000
        assert one.count("--only 'bad*'") == 1
    assert few.startswith(
        "**TGOSPA gate: fail (exit status 1): 2000 pass, 3 fail; with warnings: 2,0"
    )
    assert [line.split("`")[1] for line in few.splitlines()[4:7]] == [f"bad{k}" for k in range(3)]
    assert "- bad2: why 2" in few[: few.index("--only")]
    assert many.count("| **fail** |") > 500
    assert "`xxxx" not in many


def test_a_group_that_fails_says_where(gate: Invoke) -> None:
    runs(0.14, 2)
    slow = Path("out/slow/4.csv").read_text(encoding="utf-8")
    write("out/slow/4.csv", "".join(line for line in slow.splitlines(True) if line[:4] != "b,3,"))
    notes = " ".join(groups(gate("--format", "json"))["all"]["notes"])
    assert "parts of the cost, not proven: localisation 1,700.486 -> " in notes
    assert ", missed 0 -> 50" in notes
    assert "worst scenes: dense +15.0%, slow +" in notes
    assert "worst runs: slow/4 +" in notes
    assert "worst" not in " ".join(groups(gate("--format", "json"))["slow"]["notes"])


def test_the_page_draws_the_runs_of_the_baseline(gate: Invoke) -> None:
    pytest.importorskip("matplotlib")
    runs(0.14, 2)
    gate("-o", "report")
    page = Path("report/gate.html").read_text(encoding="utf-8")
    image = base64.b64decode(page.partition("data:image/svg+xml;base64,")[2].partition('"')[0])
    assert b"<svg" in image
    assert "img-src data:" in page
    assert page.index(">group all of {scene}<") < page.index(">group dense<")


def test_markdown_of_a_broken_baseline_says_so(gate: Invoke) -> None:
    write("base.json", "{")
    answer = gate("--format", "markdown")
    assert answer.status == 2
    assert "base.json: is not a baseline" in answer.out


def test_names_differ_where_they_differ(gate: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    text = SUITE.replace("truth =", 'name = "recordings/2026/{scene}-{seed}/estimate"\ntruth =')
    write("suite.toml", text)
    out = gate("--update-baseline").out
    assert "dense-1" in out
    monkeypatch.setenv("COLUMNS", "120")
    assert "recordings/2026/dense-1/estimate" in gate().out


def test_a_folder_with_a_page(gate: Invoke) -> None:
    runs(0.14, 2)
    assert gate("-o", "report").status == 1
    page = Path("report/gate.html").read_text(encoding="utf-8")
    assert "group all" in page
    assert 'href="pairs/slow%252F1.html"' in page
    assert Path("report/pairs/slow%2F1.html").is_file()
    assert json.loads(Path("report/gate.json").read_text(encoding="utf-8"))["status"] == 1


def test_estimates_without_a_truth_are_reported(gate: Invoke, invoke: Invoke) -> None:
    write("out/slow/9.csv", "id,t,x,y\n")
    answer = invoke("gate", "--suite", "suite.toml")
    assert (
        'out/slow/9.csv: not judged: no truth matches "data/{scene}/{seed}/truth.csv"' in answer.err
    )


def test_what_cannot_be_written_hides_no_regression(gate: Invoke) -> None:
    runs(0.14, 2)
    answer = gate("--junit", "suite.toml/file", "-o", "report")
    assert answer.status == 1
    assert "--junit suite.toml/file: cannot be written" in answer.err
    assert "group all" in answer.out
    assert Path("report/gate.md").is_file()


# --- the shell parts of the example workflows -----------------------------------------------------

EXAMPLES = Path(__file__).parents[2] / "docs/examples"


@pytest.fixture
def shell(gate: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Invoke:
    """Runs a line of a workflow in a clone whose branch is behind a pull request to main."""
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    git("clone", ".", "clone")
    monkeypatch.chdir("clone")
    runs(0.14, 2)
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"

    def shell(script: str, **variables: str) -> Any:
        environ = {**os.environ, "PATH": programs, **variables}
        return subprocess.run(
            ["bash", "-e", "-c", script], env=environ, capture_output=True, text=True, check=False
        )

    return shell


def test_the_steps_for_github(shell: Invoke, tmp_path: Path) -> None:
    steps = yaml.safe_load((EXAMPLES / "github.yml").read_text())["jobs"]["gate"]["steps"]
    judge, comment = (step["run"] for step in steps if "run" in step and "pip" not in step["run"])
    write("gh", '#!/bin/sh\nprintf "%s\\n" "$@" > asked.txt\n')
    Path("gh").chmod(0o755)
    summary = tmp_path / "summary.md"
    answer = shell(judge, GITHUB_BASE_REF="main", GITHUB_STEP_SUMMARY=str(summary))
    assert answer.returncode == 1, answer.stderr
    assert "::error" in answer.stderr
    assert summary.read_text(encoding="utf-8") == Path("gate/gate.md").read_text(encoding="utf-8")
    uploaded = yaml.safe_load(steps[-1]["with"]["path"].replace("\n", " ")).split()
    assert all(Path(path).exists() for path in uploaded)
    assert shell(f"PATH=.:$PATH\n{comment}", NUMBER="7").returncode == 0
    asked = Path("asked.txt").read_text().split()
    assert asked[:3] == ["pr", "comment", "7"]
    assert Path(asked[-1]).is_file()


class Notes(BaseHTTPRequestHandler):
    """The notes of a merge request, as the interface of GitLab has them."""

    bodies: ClassVar[list[str]] = ["LGTM"]

    def do_GET(self) -> None:
        self.answer([{"id": k, "body": body} for k, body in enumerate(self.bodies)])

    def do_POST(self) -> None:
        self.bodies.append(self.body())
        self.answer({})

    def do_PUT(self) -> None:
        self.bodies[int(self.path.rpartition("/")[2])] = self.body()
        self.answer({})

    def body(self) -> str:
        sent = self.rfile.read(int(self.headers["Content-Length"]))
        return str(json.loads(sent)["body"])

    def answer(self, document: Any) -> None:
        known = self.headers["PRIVATE-TOKEN"] == "token"
        self.send_response(200 if known else 401)
        self.end_headers()
        self.wfile.write(json.dumps(document).encode())

    def log_message(self, *_: Any) -> None:
        pass


def test_the_steps_for_gitlab(shell: Invoke) -> None:
    job = yaml.safe_load((EXAMPLES / "gitlab-ci.yml").read_text())["gate"]
    script = "\n".join(line for line in job["script"] if "pip install" not in line)
    (note,) = yaml.safe_load((EXAMPLES / "gitlab-note.yml").read_text())["after_script"]
    with ThreadingHTTPServer(("127.0.0.1", 0), Notes) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        about = {
            "CI_API_V4_URL": f"http://127.0.0.1:{server.server_port}/api/v4",
            "CI_PROJECT_ID": "3",
            "CI_MERGE_REQUEST_IID": "7",
            "GATE_TOKEN": "token",
            "NO_PROXY": "*",
        }
        answer = shell(script, CI_MERGE_REQUEST_TARGET_BRANCH_NAME="main")
        assert answer.returncode == 1, answer.stderr
        assert all(Path(path).exists() for path in ("gate/gate.html", "report.xml"))
        for text in (Path("gate/gate.md").read_text(encoding="utf-8"), "of a later run\n"):
            Path("gate/gate.md").write_text(text, encoding="utf-8")  # one note, with the last text
            sent = shell(note, **about)
            assert sent.returncode == 0, sent.stderr
            assert Notes.bodies[-1].partition("\n")[2] == text
        server.shutdown()
    assert len(Notes.bodies) == 2
    assert Notes.bodies[0] == "LGTM"


# --- pytest and pre-commit ------------------------------------------------------------------------


@pytest.mark.process
def test_an_assert_shows_the_table(gate: Invoke) -> None:
    runs(0.14, 2)
    write(
        "test_it.py",
        "from tgospa_eval import gate\n\n\ndef test_it():\n"
        "    assert gate(suite='suite.toml', group='scene', fail_on='total:+2%')\n",
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "pair             rule                   baseline      limit        now" in done.stdout
    assert "group... {scene} total:+2%             1,700.486  1,734.496  1,935.175 fail" in (
        done.stdout
    )


@pytest.mark.process
def test_the_how_to_is_one_of_xunit2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (EXAMPLES.parent / "how-to/pytest.md").read_text(encoding="utf-8")
    for name in ("truth.csv", "estimate.csv"):
        shutil.copy(EXAMPLES.parents[1] / "sample_data/quickstart" / name, name)
    for name in ("conftest.py", "test_tracker.py"):
        write(name, page.partition(f"> {name} <<'EOF'\n")[2].partition("EOF\n")[0])
    strict = ("-W", "error", "-o", "junit_family=xunit2", "-p", "no:cacheprovider")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            *strict,
            "--junitxml",
            "report.xml",
            "test_tracker.py",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert '<property name="test_tracker.tgospa" value="42.5' in Path("report.xml").read_text()


def test_a_hook_sees_any_file_and_proposes_what_works(
    gate: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    (hook,) = yaml.safe_load((EXAMPLES.parents[1] / ".pre-commit-hooks.yaml").read_text())
    assert (hook["always_run"], hook["pass_filenames"]) == (True, False)
    runs(0.14, 2)
    monkeypatch.setenv("PRE_COMMIT", "1")
    command = json.loads(gate("--format", "json").out)["update"]
    assert subprocess.run(command, shell=True, capture_output=True, check=False).returncode == 0
    assert gate().status == 0
