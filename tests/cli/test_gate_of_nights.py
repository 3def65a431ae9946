"""The gate of many nights: dead runs, jumps, the same verdict for the same data, several nights."""

import json
import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke
from evaluated_once import evaluated_once as evaluated_once  # a fixture of all tests here

pytestmark = pytest.mark.usefixtures("evaluated_once")

STEPS = 12
SUITE = """
baseline = "base.json"
[options]
cutoff = 10
[[pair]]
truth = "data/{scene}/{seed}/truth.csv"
estimate = "out/{scene}/{seed}.csv"
[[group]]
name = "{scene}"
fail-on = ["total:+2%"]
"""
ARGUMENTS = ("gate", "--suite", "suite.toml", "-q", "--jobs", "1")


def write(path: str, text: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8")


def runs(
    night: int,
    *,
    scenes: Iterable[str] = "abc",
    seeds: Iterable[int] = range(1, 7),
    factor: float = 1.0,
    spread: float = 0.15,
    steps: int = STEPS,
) -> None:
    """Runs with totals of about 100, by the random numbers of this night."""
    rng = np.random.default_rng(night)
    for scene in scenes:
        for seed in seeds:
            error = (100 * factor * np.exp(rng.normal(0, spread)) / steps) ** 0.5
            for name, y in ((f"data/{scene}/{seed}/truth", 0), (f"out/{scene}/{seed}", error)):
                rows = "".join(f"a,{k},{k},{y:.12g}\n" for k in range(steps))
                write(f"{name}.csv", f"id,t,x,y\n{rows}")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the baseline that every test begins with is kept once it is made."""
    return tmp_path_factory.mktemp("kept") / "base.json"


@pytest.fixture
def gate(invoke: Invoke, kept: Path) -> Invoke:
    """The gate of three scenes with six seeds, whose baseline is night 0."""
    write("suite.toml", SUITE)
    runs(0)

    def gate(*arguments: str) -> Any:
        return invoke(*ARGUMENTS, *arguments)

    if not kept.exists():
        assert gate("--update-baseline").status == 0
        shutil.copy("base.json", kept)
    shutil.copy(kept, "base.json")
    return gate


def groups(answer: Any) -> dict[str, Any]:
    return {one["name"]: one for one in json.loads(answer.out)["groups"]}


def entries() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("base.json").read_text(encoding="utf-8"))["pairs"]
    return found


# --- dead runs and jumps --------------------------------------------------------------------------


def test_a_run_without_rows_fails(gate: Invoke) -> None:
    runs(1)
    assert gate().status == 0
    write("out/a/3.csv", "id,t,x,y\n")
    answer = gate("--format", "json")
    assert answer.status == 1
    found = groups(answer)
    assert {name for name, one in found.items() if one["verdict"] == "fail"} >= {"a"}
    assert found["b"]["verdict"] != "fail"
    dead = found["a"]["rules"][0]
    assert (dead["rule"], dead["verdict"], dead["upper"]) == ("no dead run", "fail", STEPS)
    assert dead["proven"]
    write("out/a/4.csv", "id,t,x,y\n")
    gate("--junit", "gate.xml")
    cases = re.findall('classname="group a" name="(no.*?)"', Path("gate.xml").read_text())
    assert cases == ["no dead run: a/3", "no dead run: a/4"]
    runs(1, scenes="a", seeds=[4])
    assert (
        "a/3: the tracker failed: it misses 12 of 12 ground-truth states" in found["a"]["notes"][0]
    )
    # Whatever the limit says, and where nothing else is judged.
    write("suite.toml", SUITE.replace("+2%", "+900%"))
    assert gate().status == 1


@pytest.mark.parametrize("others", [[], ["--add"]])
def test_a_run_that_was_dead_before_is_as_ever_but_no_other_run(
    gate: Invoke, others: list[str]
) -> None:
    write("out/a/3.csv", "id,t,x,y\n")
    answer = gate("--update-baseline", *others)
    assert answer.status == 0
    effect = "this night raises the limits" if others else "a baseline with a dead run allows"
    assert f"a/3: misses all ground-truth states: {effect}" in " ".join(answer.out.split())
    assert gate().status == (1 if others else 0)  # it lived in the first of two nights
    runs(0, scenes="a", seeds=[3])
    write("out/a/5.csv", "id,t,x,y\n")
    answer = gate("--format", "json")
    assert answer.status == 1
    note = groups(answer)["a"]["notes"][0]
    assert "a/5: the tracker failed" in note
    assert "no living run of scene a in the baseline missed more than 0" in note


def test_a_new_run_is_dead_or_only_warned_about(gate: Invoke) -> None:
    runs(0, scenes="a", seeds=range(1, 8))
    answer = gate("--format", "json")
    assert (answer.status, groups(answer)["a"]["warnings"][0]["code"]) == (0, "not-in-baseline")
    assert "a/7: not in the baseline, so only the rule on dead runs and 'max' apply" in answer.err
    assert gate("--strict").status == 2
    write("suite.toml", SUITE.replace("[[group]]", 'max = ["total=0"]\n[[group]]'))
    (pair,) = (
        one for one in json.loads(gate("--format", "json").out)["pairs"] if one["name"] == "a/7"
    )
    assert pair["verdict"] == "fail"
    write("suite.toml", SUITE)
    write("out/a/7.csv", "id,t,x,y\n")
    answer = gate("--format", "json")
    assert answer.status == 1
    assert groups(answer)["a"]["notes"][0].startswith("a/7: the tracker failed")


def test_copies_of_a_run_infer_nothing(gate: Invoke) -> None:
    def copied(factor: float) -> None:
        runs(0, scenes="a", seeds=[1], spread=0, factor=factor)
        for path in ("data/a/{}/truth.csv", "out/a/{}.csv"):
            for seed in range(2, 7):
                shutil.copy(path.format(1), path.format(seed))

    copied(1)
    assert gate("--update-baseline").status == 0
    copied(1.1)
    found = groups(gate("--format", "json"))
    ((warning,), (rule,)) = (found["a"][name] for name in ("warnings", "rules"))
    assert (warning["code"], "6 runs are copies" in warning["text"]) == ("copies", True)
    assert (rule["verdict"], "inference" in rule) == ("fail", False)
    (rule,) = found["all of {scene}"]["rules"]
    assert rule["inference"]["runs"] == 13


@pytest.mark.parametrize("before", [False, True])  # whether the copies are in the baseline
@pytest.mark.parametrize("ids", [False, True])  # whether each copy has ids of its own
@pytest.mark.parametrize("first", [1, 11])  # other seeds than in the baseline
def test_copies_on_one_side_infer_nothing(
    gate: Invoke, before: bool, ids: bool, first: int
) -> None:
    costs = np.exp(np.random.default_rng(3).normal(0, 0.15, 6))
    sums = {True: costs[0], False: costs.mean()}

    def night(copies: bool, first: int, factor: float = 1.0) -> None:
        for folder in ("data/a", "out/a"):
            shutil.rmtree(folder)
        runs(3, scenes="a", seeds=range(first, first + 6), factor=factor)
        for seed in range(first + 1, first + 6) if copies else ():
            text = Path(f"out/a/{first}.csv").read_text()
            write(f"out/a/{seed}.csv", text.replace("\na,", f"\n{seed},") if ids else text)

    night(before, 1)
    said = gate("--update-baseline", "--format", "json").out
    assert ("group a: warning: 6 runs are copies" in said) is before
    night(not before, first, 1.1 * sums[before] / sums[not before])
    answer = gate("--format", "json")
    found = groups(answer)["a"]
    side = "6 runs of the baseline" if before else "6 runs"
    assert (answer.status, side in found["warnings"][0]["text"]) == (0, True)
    assert found["rules"][0]["verdict"] == "undecided by seeds"


def test_a_dead_run_of_a_short_recording(gate: Invoke) -> None:
    for seed, steps in enumerate((1000, 900, 800, 60, 50, 40), 1):
        runs(0, scenes="a", seeds=[seed], steps=steps)
        path = Path(f"out/a/{seed}.csv")  # every tenth state is missed
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(line for k, line in enumerate(lines) if k % 10 or k == 0))
    assert gate("--update-baseline").status == 0
    write("out/a/6.csv", "id,t,x,y\n")
    answer = gate("--format", "json")
    assert answer.status == 1
    assert "it misses 40 of 40 ground-truth states" in groups(answer)["a"]["notes"][0]


def test_an_absent_estimate_cannot_be_accepted(gate: Invoke) -> None:
    runs(0, scenes="a", seeds=[9])
    Path("out/a/9.csv").unlink()
    answer = gate("--format", "json")
    assert (answer.status, json.loads(answer.out)["update"]) == (3, "")


def test_fewer_runs_with_other_seeds_do_not_pass(gate: Invoke) -> None:
    for folder in ("data/a", "out/a"):
        shutil.rmtree(folder)
    runs(0, scenes="a", seeds=range(11, 16))
    answer = gate("--format", "json")
    assert answer.status == 2
    assert "5 runs, but 6 in the baseline, with other seeds" in groups(answer)["a"]["notes"][0]
    runs(0, scenes="a", seeds=range(11, 17))
    assert gate().status == 0


@pytest.mark.parametrize("own", [False, True])  # whether each seed has a truth of its own
def test_other_seeds_are_judged_on_the_same_truth_and_steps(gate: Invoke, own: bool) -> None:
    def seeds(first: int, steps: int) -> None:
        for folder in ("data/a", "out/a"):
            shutil.rmtree(folder)
        runs(0, scenes="a", seeds=range(first, first + 6), steps=steps)
        for path in Path("data/a").glob("*/truth.csv") if own else ():
            path.write_text(path.read_text().replace(",0\n", f",{int(path.parent.name) / 1e4}\n"))

    seeds(1, STEPS)
    assert gate("--update-baseline").status == 0
    seeds(11, STEPS)
    assert gate().status == 0
    seeds(11, STEPS // 2)
    answer = gate("--format", "json")
    assert answer.status == 2
    assert "11: not judged on the same steps and truth" in groups(answer)["a"]["notes"][0]


@pytest.mark.parametrize(  # copies: whether two runs of the baseline are copies
    ("before", "copies"), [("20 20 20 20 20 20", False), ("19 19 20 21 22 18", True), ("20", False)]
)
def test_other_seeds_with_truths_of_their_own_are_comparable(
    gate: Invoke, before: str, copies: bool
) -> None:
    def seeds(first: int, steps: list[str]) -> None:
        for folder in ("data/a", "out/a"):
            shutil.rmtree(folder)
        for seed, own in enumerate(steps, first):
            runs(seed, scenes="a", seeds=[seed], steps=int(own), spread=0.01)
            text = Path(f"data/a/{seed}/truth.csv").read_text()
            write(f"data/a/{seed}/truth.csv", text.replace(",0\n", f",{seed / 1e5}\n"))

    write("suite.toml", SUITE.replace('name = "{scene}"', 'name = "all"'))
    seeds(1, before.split())
    for path in ("data/a/{}/truth.csv", "out/a/{}.csv") if copies else ():
        shutil.copy(path.format(1), path.format(2))
    assert gate("--update-baseline", "--prune").status == 0
    seeds(11, ["23", "17", "25", "20", "19", "26"][: len(before.split())])
    assert gate().status == 0


def test_a_run_that_stops_early_fails(gate: Invoke) -> None:
    lines = Path("out/b/2.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    write("out/b/2.csv", "".join(lines[:4]))
    answer = gate("--format", "json")
    assert answer.status == 1
    assert groups(answer)["b"]["rules"][0]["verdict"] == "fail"
    write("out/b/2.csv", "".join(lines[:-1]))  # the last step alone
    assert groups(gate("--format", "json"))["b"]["rules"][0]["rule"] == "total:+2%"


def test_a_run_that_crashes_in_its_second_half_fails(gate: Invoke) -> None:
    runs(0, steps=60)
    assert gate("--update-baseline").status == 0
    runs(1, steps=60)
    assert gate().status == 0
    lines = Path("out/b/2.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    write("out/b/2.csv", "".join(lines[:37]))
    answer = gate("--format", "json")
    assert answer.status == 1
    dead = groups(answer)["b"]["rules"][0]
    assert (dead["rule"], dead["verdict"], dead["upper"]) == ("no dead run", "fail", 24)
    write("out/b/2.csv", "".join(lines[:49]))  # a fifth is missing: no jump of so few
    assert groups(gate("--format", "json"))["b"]["rules"][0]["rule"] == "total:+2%"


def test_runs_that_fail_now_and_then_are_no_jump_if_the_baseline_has_such(gate: Invoke) -> None:
    for night, scene in enumerate("abc", 1):
        runs(night)
        runs(night, scenes=scene, seeds=[night], factor=3)
        assert gate("--update-baseline", "--add").status == 0
    runs(5)
    runs(6, scenes="b", seeds=[5], factor=2.8)
    (rule,) = groups(gate("--format", "json"))["b"]["rules"]
    assert rule["inference"]["jump"] == ""
    runs(6, scenes="b", seeds=[5], factor=10)
    (rule,) = groups(gate("--format", "json"))["b"]["rules"]
    assert "b/5" in rule["inference"]["jump"]


def test_a_scene_far_outside_what_its_seeds_do_fails(gate: Invoke) -> None:
    runs(1)
    runs(2, scenes="b", factor=3)
    answer = gate("--format", "json")
    assert answer.status == 1
    found = groups(answer)
    (rule,) = found["b"]["rules"]
    assert rule["verdict"] == "fail"
    jump = "total is far above the usual spread of its seeds (a jump)"
    assert rule["inference"]["jump"] == jump
    assert {found[name]["rules"][0]["inference"]["jump"] for name in "ac"} == {""}
    assert f"seeds are an unlikely reason: {jump}" in " ".join(gate().out.split())


def test_a_run_far_outside_fails_and_is_named(gate: Invoke) -> None:
    runs(1)
    runs(2, scenes="c", seeds=[4], factor=11)
    (rule,) = groups(gate("--format", "json"))["c"]["rules"]
    assert rule["verdict"] == "fail"
    assert rule["inference"]["jump"] == (
        "c/4: total is far above the usual spread of the runs of scene c (a jump)"
    )


def test_equal_runs_are_no_jump(gate: Invoke) -> None:
    for night in range(1, 4):
        runs(night)
        found = groups(gate("--format", "json"))
        assert all(not rule["inference"]["jump"] for one in found.values() for rule in one["rules"])


# --- the same verdict for the same data -----------------------------------------------------------


def test_shares_of_the_error_do_not_depend_on_names(gate: Invoke) -> None:
    write("suite.toml", SUITE)
    runs(0, scenes="d")
    for scene in "bc":
        for seed in range(1, 7):
            shutil.copy(f"out/a/{seed}.csv", f"out/{scene}/{seed}.csv")
    assert gate("--update-baseline").status == 0
    for scene in "abcd":
        runs(1, scenes=scene, factor=1.3)
    for lost in ("d", "a"):
        path = Path(f"out/{lost}/6.csv")
        kept = path.read_text(encoding="utf-8")
        path.unlink()
        found = groups(gate("--format", "json"))
        write(str(path), kept)
        assert found.pop(lost)["verdict"] == "not comparable"
        same = [found[name]["rules"][0] for name in "abc" if name != lost]
        assert all(rule["inference"] == same[0]["inference"] for rule in same)
        assert all(rule["verdict"] == same[0]["verdict"] for rule in same)


def test_what_is_said_of_runs_never_contradicts_itself(gate: Invoke) -> None:
    rng, verdicts = np.random.default_rng(3), set()
    for night in range(8):
        for scene in "abc":
            factor = float(rng.choice([1.0, 1.2, 1.6, 3.0]))
            seeds = range(1, int(rng.integers(2, 8)))
            runs(night, scenes=scene, seeds=seeds, factor=factor, spread=0.02)
        for one in groups(gate("--format", "json")).values():
            for rule in (rule for rule in one["rules"] if "inference" in rule):
                about = rule["inference"]
                observed = rule["lower"] / rule["baseline"] - 1
                supported = about["p_value"] <= 1 - about["confidence"]
                verdicts.add((rule["verdict"], supported))
                if supported:
                    assert about["runs"] >= about["needed"]
                    assert "can support nothing" not in " ".join(one["notes"])
                if rule["verdict"] == "undecided by seeds":
                    assert not supported
                    assert about["noticeable"] is None or about["noticeable"] > observed
    assert {("fail", True), ("undecided by seeds", False), ("pass", False)} <= verdicts


# --- several nights -------------------------------------------------------------------------------


def test_the_limit_is_judged_against_the_mean_of_the_nights(gate: Invoke) -> None:
    first = {name: entry["values"]["total"] for name, entry in entries().items()}
    runs(1, factor=1.4)
    said = gate("--update-baseline", "--add").out
    assert "2 nights, whose mean is the baseline" in said
    second = {name: entry["values"]["total"] for name, entry in entries().items()}
    assert {name: entry["nights"][0]["total"] for name, entry in entries().items()} == first
    answer = gate("--format", "json")
    (rule,) = groups(answer)["a"]["rules"]
    mean = sum(first[f"a/{k}"] + second[f"a/{k}"] for k in range(1, 7)) / 2
    assert rule["baseline"] == pytest.approx(mean)
    assert rule["inference"]["paired"]
    # A pair by itself as well; of roots those of the mean.
    write("suite.toml", SUITE.split("[[group]]")[0])
    answer = gate("--format", "json", "--fail-on", "total:+900%", "--fail-on", "tgospa:+900%")
    pair = next(one for one in json.loads(answer.out)["pairs"] if one["name"] == "a/1")
    total = (first["a/1"] + second["a/1"]) / 2
    assert [rule["baseline"] for rule in pair["rules"]] == pytest.approx([total, total**0.5])


def test_the_oldest_night_goes_and_the_same_night_is_none(gate: Invoke) -> None:
    shutil.rmtree("data")
    for night in range(12):
        runs(night, scenes="a", seeds=[1, 2])
        assert gate("--update-baseline", "--add", "--prune").status == 0
    kept = entries()
    assert {len(entry["nights"]) for entry in kept.values()} == {9}
    assert "2 unchanged" in gate("--update-baseline", "--add").out
    assert entries() == kept
    assert gate().status == 0
    said = " ".join(gate("--update-baseline", "--only", "a/*").out.split())
    assert "one night replaces 10; --add keeps those of the same data" in said
    assert "nights" not in entries()["a/1"]
    assert gate("--add").status == 2


def test_nights_of_other_data_are_left_out(gate: Invoke) -> None:
    runs(1)
    assert gate("--update-baseline", "--add").status == 0
    for path in ("data/a/1/truth.csv", "out/a/1.csv"):
        write(path, Path(path).read_text(encoding="utf-8").replace("a,3,3,", "a,3,3.5,"))
    said = gate("--update-baseline", "--add").out
    assert "one night replaces 2" in said
    assert "nights" not in entries()["a/1"]
    assert len(entries()["a/2"]["nights"]) == 1


@pytest.mark.parametrize("ids", [False, True])
def test_a_night_is_not_added_twice(gate: Invoke, ids: bool) -> None:
    for night in (1, 0, 1, 0):
        runs(night)
        for path in Path("out").glob("*/*.csv") if ids else ():
            path.write_text(path.read_text().replace("\na,", f"\n{night},"))
        said = gate("--update-baseline", "--add").out
    assert "the baseline has a night with the same values, so this one is not added again" in (
        " ".join(said.split())
    )
    assert {len(entry["nights"]) for entry in entries().values()} == {1}


def test_wrong_nights_are_refused(gate: Invoke) -> None:
    runs(1)
    assert gate("--update-baseline", "--add").status == 0
    text = Path("base.json").read_text(encoding="utf-8")
    document = json.loads(text)
    document["pairs"]["a/2"]["nights"][0]["localisation"] *= 3
    write("base.json", json.dumps(document))
    answer = gate()
    assert answer.status == 2
    assert "pairs.a/2.nights.0." in answer.err


def test_more_nights_see_smaller_changes(gate: Invoke) -> None:
    runs(20, factor=1.15)
    before = groups(gate("--format", "json"))["a"]["rules"][0]["inference"]
    for night in range(1, 5):
        runs(night)
        assert gate("--update-baseline", "--add").status == 0
    runs(20, factor=1.15)
    after = groups(gate("--format", "json"))["a"]["rules"][0]["inference"]
    assert after["needed"] <= before["needed"]
    assert after["noticeable"] is not None


# --- seeds that are too few -----------------------------------------------------------------------


def test_an_update_says_how_many_seeds_are_needed(gate: Invoke) -> None:
    answer = gate("--update-baseline", "--format", "json")
    (said,) = json.loads(answer.out)["notices"]
    assert "group a (6), b (6), c (6): with so few runs the test can never show" in said
    assert "10 runs are needed, or further nights with --add" in said
    runs(0, seeds=range(1, 11))
    assert json.loads(gate("--update-baseline", "--format", "json").out)["notices"] == []
    Path("base.json").unlink()
    answer = gate("--format", "json")
    assert (answer.status, json.loads(answer.out)["notices"]) == (2, [])
