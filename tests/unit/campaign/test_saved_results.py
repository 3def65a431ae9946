"""Rankings of saved results: the same as of the files they were made from, or refused."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke, Write

from tgospa_eval.results.saved import read_result

TRUTH = "id,t,x\n1,0,0\n1,1,0\n1,2,0\n"
OPTIONS = ("-c", "5", "-g", "1", "-q")
Save = Callable[..., str]


def track(*positions: float) -> str:
    return "id,t,x\n" + "".join(f"7,{t},{x}\n" for t, x in enumerate(positions))


@pytest.fixture
def save(write: Write, invoke: Invoke) -> Save:
    """Evaluate, and save the result in a folder."""

    def save(folder: str, estimate: str, *options: str, truth: str = TRUTH) -> str:
        paths = write("t.csv", truth), write(f"{folder.replace('/', '-')}.csv", estimate)
        made = invoke(*paths, *OPTIONS, "-o", folder, *options)
        assert made.status == 0, made.err
        return folder

    return save


def ranking(invoke: Invoke, *arguments: str) -> Any:
    answer = invoke("compare", *arguments, "-q", "--format", "json")
    assert answer.status == 0, answer.err
    return json.loads(answer.out)


NAMES = ("paths", "truth", "warnings")


def without_names(value: Any) -> Any:
    """A document but for the names of files."""
    if isinstance(value, dict):
        return {name: without_names(item) for name, item in value.items() if name not in NAMES}
    return [without_names(item) for item in value] if isinstance(value, list) else value


def approximate(document: Any) -> Any:
    """The same, numbers but for rounding."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: rounded(item) for name, item in value.items()}
        if isinstance(value, list):
            return [rounded(item) for item in value]
        return pytest.approx(value, rel=1e-12, abs=1e-12) if isinstance(value, float) else value

    return rounded(without_names(document))


def test_the_same_as_of_the_files(save: Save, invoke: Invoke, tmp_path: Path) -> None:
    """Totals 12 and 1, and a miss of two steps, 12.5 each."""
    tracks = {"bad": (2, 2, 2), "good": (0, 1, 0), "lost": (0,)}
    for name, positions in tracks.items():
        save(name, track(*positions))
    (tmp_path / "good.json").write_bytes((tmp_path / "good" / "result.json").read_bytes())
    found = ranking(invoke, "bad/result.json", "good", "lost", "-o", "saved")
    files = [f"{name}.csv" for name in tracks]
    asked = ranking(invoke, "t.csv", *files, "-c", "5", "-g", "1", "-o", "asked")
    assert approximate(asked) == without_names(found)
    assert found["warnings"][0]["text"].startswith("lost/result.json: only 33 % of the steps")
    assert [item["total"] for item in found["estimates"]] == pytest.approx([1, 12, 25])
    assert {path.name for path in Path("saved").iterdir()} == {
        path.name for path in Path("asked").iterdir()
    }
    rows = [
        list(csv.DictReader(io.StringIO(Path(folder, "per_step.csv").read_text(encoding="utf-8"))))
        for folder in ("saved", "asked")
    ]
    assert rows[0] == rows[1]
    shown = invoke("compare", "bad", "good", "lost", "-q").out
    assert "Proven order of these files by TGOSPA per step, best first: good, bad, lost" in shown
    printed = ranking(invoke, "bad", "good.json")["estimates"]  # what --format json prints
    assert [item["paths"] for item in printed] == [["good.json"], ["bad/result.json"]]


def test_solvers_may_differ(save: Save, invoke: Invoke) -> None:
    """A hot sinkhorn proves less, and equal data are equal all the same."""
    save("cool", track(0, 2, 0), "--unit", "m")
    save("hot", track(0, 2, 0), "--solver", "sinkhorn", "--epsilon", "0.5")
    found = ranking(invoke, "cool", "hot")
    assert found["pairs"][0]["verdict"] == "equal"
    assert {"solver", "unit", "gap"} & found["parameters"].keys() == {"gap"}


def test_periods_stand_with_their_estimates(write: Write, save: Save, invoke: Invoke) -> None:
    """A ranking on a common clock has no period of its own, whichever estimate is the first."""
    clock = ("--resample", "1", "--max-gap", "2")
    rows = "".join(f"7,{t},0\n" for t in range(0, 9, 2))
    paths = write("a.csv", track(*[1] * 9)), write("b.csv", f"id,t,x\n{rows}")
    write("t.csv", truth := track(*[0] * 9))

    def periods(document: Any) -> Any:
        items = document["estimates"]
        own = {item["name"]: item["runs"][0]["parameters"].get("period") for item in items}
        return own, document["parameters"].get("period")

    for files in (paths, paths[::-1]):
        asked = (*files, "-c", "5", "-g", "1", *clock)
        assert periods(ranking(invoke, "t.csv", *asked)) == ({"a": 1, "b": 2}, None)
        assert "clock: b 2, a 1" in " ".join(invoke("compare", "t.csv", *asked, "-q").out.split())
        found = ranking(invoke, "t.csv", *asked, "--period", "2")
        assert periods(found) == ({"a": 2, "b": 2}, 2)
    write("m.csv", "truth,estimate,tracker\nt.csv,a.csv,a\nt.csv,b.csv,b\n")
    folder = ("m.csv", "-c", "5", "-g", "1", *clock, "--by", "tracker", "-q", "-o", "store")
    assert "clock: a 1, b 2" in " ".join(invoke("batch", *folder).out.split())
    assert ">a 1, b 2<" in Path("store/report.html").read_text(encoding="utf-8")
    save("one", f"id,t,x\n{rows}", *clock, "--period", "1", truth=truth)
    save("two", f"id,t,x\n{rows}", *clock, "--period", "2", truth=truth)
    found = ranking(invoke, "one", "two")  # the same data, and both values are right
    assert periods(found) == ({"two": 2, "one": 1}, None)
    assert found["pairs"][0]["verdict"] == "less"


def test_runs(save: Save, invoke: Invoke) -> None:
    """Errors 1 and 3 at one of three steps against 4: means of totals 5 and 16."""
    for run, error in (("1", 1), ("2", 3)):
        save(f"a/{run}", track(0, error, 0))
        save(f"b/{run}", track(0, 4, 0))
    for patterns in (("a/*", "b/*"), ("a/*/result.json", "b/*/result.json")):
        found = ranking(invoke, *patterns)
        assert [(e["name"], e["total"]) for e in found["estimates"]] == [
            ("a", pytest.approx(5)), ("b", pytest.approx(16)),
        ]  # fmt: skip
        assert found["runs"] == 2
    assert ranking(invoke, "a/*")["estimates"][0]["total"] == pytest.approx(5)
    answer = invoke("compare", "a/*", "b/1")
    assert (answer.status, answer.err) == (
        2, "b/1: has no * in place of the run, but other results have one\n",
    )  # fmt: skip


def test_times_are_ordered_whatever_they_are(save: Save, invoke: Invoke) -> None:
    """One estimate has a false target between two steps of the truth, the other none."""
    stamps = ["2026-01-01T00:00:00Z", "2026-01-01T00:00:00.5Z", "2026-01-01T01:00:01+01:00"]
    truth = f"id,t,x\n1,{stamps[0]},0\n1,{stamps[2]},0\n"
    save("a", truth.replace("0\n1", "1\n1"), truth=truth)
    save("b", f"{truth}9,{stamps[1]},50\n", truth=truth)
    found = ranking(invoke, "a", "b", "-o", "out")
    assert found["steps"] == [2]
    assert [item["total"] for item in found["estimates"]] == pytest.approx([1, 12.5])
    rows = list(csv.DictReader(io.StringIO(Path("out/per_step.csv").read_text(encoding="utf-8"))))
    assert [row["t"] for row in rows] == [*stamps[::2], *stamps]


def test_steps_at_which_the_recorder_ran_count(save: Save, invoke: Invoke) -> None:
    """Nothing is at step 3, and a false target at step 4 makes no step of the truth."""
    truth = TRUTH + "1,3,\n"
    save("a", track(1, 0, 1), truth=truth)
    save("b", track(2, 0, 1) + "9,4,0\n", truth=truth)
    found = ranking(invoke, "a", "b")
    assert found["steps"] == [4]
    assert [e["normalised"]["tgospa"] for e in found["estimates"]] == pytest.approx(
        [0.5**0.5, (17.5 / 4) ** 0.5]
    )


def test_perfect_estimates(save: Save, invoke: Invoke) -> None:
    save("a", TRUTH)
    save("b", TRUTH.replace("\n1,", "\n7,"))
    found = ranking(invoke, "a", "b")
    assert (found["steps"], found["pairs"][0]["verdict"]) == ([3], "equal")


def test_sums_of_classes_are_ranked(save: Save, invoke: Invoke) -> None:
    truth = "id,t,x,class\n1,0,0,car\n2,0,9,bike\n"
    for name, place in (("a", 1), ("b", 2)):
        save(name, truth.replace("1,0,0", f"1,0,{place}"), "--by", "class", truth=truth)
    assert [e["total"] for e in ranking(invoke, "a", "b")["estimates"]] == pytest.approx([1, 4])


def test_other_metrics_of_one_run(save: Save, invoke: Invoke) -> None:
    """Per-step GOSPA, which needs no extra, for the others."""
    for name in ("a/1", "b/1", "a/2"):
        save(name, track(0, 1, 0), "--with", "gospa")
    save("b/2", track(0, 2, 0))
    own = json.loads(Path("a/1/result.json").read_text(encoding="utf-8"))["with"]
    answer = invoke("compare", "a/1", "b/1", "--format", "json")
    assert [item["with"] for item in json.loads(answer.out)["estimates"]] == [own, own]
    assert "best is low: GOSPA" in invoke("compare", "a/1", "b/1").out
    for results in (["a/2", "b/2"], ["a/*", "b/*"]):
        answer = invoke("compare", *results, "--format", "json")
        assert "with" not in json.loads(answer.out)["estimates"][0]
        assert (
            answer.err == "not shown: gospa; shown only for a single run, if all results have it\n"
        )


def test_warnings_travel(save: Save, invoke: Invoke) -> None:
    save("far", track(900, 900, 900))
    save("near", track(1, 1, 1))
    answer = invoke("compare", "far", "near", "-q", "--format", "latex")
    assert answer.err.startswith(
        "warning: far/result.json: no ground-truth state has an estimate within c = 5"
    )
    assert f"% {answer.err.splitlines()[0]}" in answer.out


NO_RANKING = (
    (
        ["moved"],
        "no ranking: the ground truth of moved, moved/result.json, has other states, ",
    ),
    (["later"], "states, ids or times than that of a/result.json"),
    (["km"], 'km/result.json: cannot be ranked with m/result.json: unit is "km", but "m" there'),
    (["other"], "than that of a/result.json; evaluate all estimates on the same ground truth\n"),
    (["wide"], "a/result.json: cutoff is 6.0, but 5.0 there; switch_penalty is 2.0, but 1.0"),
    (["a.csv"], "a.csv: is not a saved result, but a is; a saved result is the result.json of"),
    (["none"], "none: is not a saved result, but a is"),
    (["baseline.json"], "baseline.json: is not a saved result, but a is"),
    (["./a"], "a/result.json: is the same as "),
    ([], "a: is a single saved result; name other results to rank it with"),
    (["b", "--cutoff", "5"], "--cutoff needs the data, but a is a saved result"),
    (["b", "--against", "per-step-gospa"], "--against needs the data"),
    (["b", "-o", "a"], "--output a: "),
)


def test_what_cannot_be_ranked(save: Save, write: Write, invoke: Invoke) -> None:
    save("moved", track(0, 1, 0), truth=TRUTH.replace("1,2,0", "1,2,0.5"))
    save("other", track(0, 1, 0), truth=TRUTH.replace("\n1,", "\n9,"))
    save("wide", track(0, 2, 0), "-c", "6", "-g", "2")
    later = "id,t,x\n1,100,0\n1,101,0\n1,102,0\n"
    save("later", later, truth=later)
    for unit in ("m", "km"):
        save(unit, track(0, 1, 0), "--unit", unit)
    for name in ("a", "b"):
        save(name, track(0, 1, 0))
    write("baseline.json", '{"schema": "tgospa-eval/baseline/1"}')
    for arguments, message in NO_RANKING:
        answer = invoke("compare", "m" if arguments == ["km"] else "a", *arguments)
        assert (answer.status, answer.out) == (2, ""), arguments
        assert message in answer.err


def test_what_is_judged_on_other_steps_has_no_order(save: Save, invoke: Invoke) -> None:
    for name, states in (("a", (0, 1, 0)), ("b", (0, 2, 0)), ("early", (0,))):
        save(name, track(*states), "--grid", "common", "--outage", "none")
    assert invoke("compare", "a", "b").status == 0
    answer = invoke("compare", "a", "early")
    assert (answer.status, answer.out) == (2, "")
    assert (
        "no ranking: not judged on the same steps and truth (a, a/result.json: 3 truth states at 3 "
        "of 3 steps; early, early/result.json: 1 truth state at 1 of 1 step)"
    ) in answer.err
    assert "common clock" in answer.err


NOTICE = {"code": "a", "text": "b", "remedy": "c"}
CHANGES: tuple[tuple[Callable[[Any], Any], str], ...] = (
    (
        lambda d: d.update(schema="tgospa-eval/result/9"),
        'its schema is "tgospa-eval/result/9", this version reads "tgospa-eval/result/1"',
    ),
    (lambda d: d.update(lower_bound=2.0), "lower_bound is 2, but upper_bound is 1.00000"),
    (lambda d: d.update(total=2.5), "total is 2.5, but tgospa to the power of the order is 1"),
    (lambda d: d["per_step"][1].update(total=5.0), "the numbers of per_step.total sum to 5"),
    (lambda d: d.update(upper_bound=float("nan")), "NaN is not a JSON number"),
    (lambda d: d.update(missed=True), "missed is true; expected a finite number >= 0"),
    (lambda d: d["normalised"].update(tgospa=9.0), "normalised.tgospa is 9, but total and"),
    (lambda d: d["normalised"].update(tgospa=0), "normalised.tgospa is 0, but total and"),
    (lambda d: d["counts"].update(false=10**400), "counts.false is 1000"),
    (lambda d: d["counts"].update(false=3), "false is 0, but counts.false makes it 37.5"),
    (lambda d: d.update(relative_gap=0.5), "relative_gap is 0.5, but lower_bound and upper"),
    (lambda d: d["parameters"].update(order=0), "parameters.order is 0; expected a finite"),
    (lambda d: d.pop("tgospa"), "tgospa: is missing; expected a finite number >= 0"),
    (lambda d: d.pop("judged"), "judged: is missing; expected an object; evaluate again and"),
    (lambda d: d["judged"].update(truth_sha256=5), "judged.truth_sha256 is 5; expected a text"),
    (lambda d: d.update(files=None), "files is null; expected an object"),
    (lambda d: d["solver"].pop("finished"), "solver.finished: is missing; expected true or"),
    (lambda d: d.update(per_step=[1]), "per_step[0] is 1; expected an object"),
    (lambda d: d["per_step"].reverse(), "per_step: times are not in order"),
    (lambda d: d["per_step"][1].update(t=None), "per_step[1].t is null; expected a finite"),
    (lambda d: d["per_step"][1].update(t="noon"), "mixed kinds of time: "),
    (lambda d: [s.update(t=f"day {s['t']}") for s in d["per_step"]], "not a time: "),
    (lambda d: d.update(warnings=[{"code": 1}]), "warnings[0].text: is missing; expected a"),
    (lambda d: d.update(warnings=[NOTICE | {"more": 1}]), "warnings[0].more: is an unknown field"),
)
"""Of a document, with what the refusal says."""


def test_changed_results_are_refused(save: Save, invoke: Invoke) -> None:
    paths = [Path(save(name, track(0, 1, 0)), "result.json") for name in ("a", "b")]
    saved = [path.read_text(encoding="utf-8") for path in paths]
    for change, message in CHANGES:
        for path, text in zip(paths, saved, strict=True):
            document = json.loads(text)
            change(document)
            path.write_text(json.dumps(document), encoding="utf-8")
        answer = invoke("compare", "a", "b")
        assert (answer.status, answer.out) == (3, ""), message
        assert message in answer.err


def test_bounds_that_were_not_met_are_told(save: Save, invoke: Invoke, write: Write) -> None:
    for name in ("a", "b"):
        save(name, track(0, 1, 0))
    path = Path("b/result.json")
    text = path.read_text(encoding="utf-8").replace('"finished": true', '"finished": false')
    path.write_text(text, encoding="utf-8")
    answer = invoke("compare", "a", "b", "-q")
    assert (answer.status, answer.err) == (4, "accuracy not reached: b/result.json: solved\n")
    assert answer.out


@pytest.mark.parametrize(
    "options",
    [
        ("--rho", "0.2"),
        ("--ignore", "marked"),
        ("--existence", "use", "-p", "1"),
        ("--by", "class", "--slice", "class", "--curve"),
        ("--solver", "sinkhorn", "--epsilon", "0.5", "-p", "3"),
        ("--resample", "0.5", "--max-gap", "2", "--with", "hota"),
        ("--step-weights", "w.csv", "--window", "2"),
        ("-c", "1e-140", "-g", "1e-140"),
        ("-c", "1e140", "-g", "1e120"),
        ("-g", "1e100", "-p", "3"),
    ],
)
def test_whatever_was_saved_is_right(
    options: tuple[str, ...], write: Callable[[str, str], str], invoke: Invoke
) -> None:
    """What contradicts itself is refused: nothing that the program writes does."""
    rng = np.random.default_rng(1)
    for name, noise in (("t", 0.1), ("e", 0.7)):
        rows = [
            f"{k},{t},{3 * k + noise * rng.normal()},{t},{'ab'[k % 2]},{k % 3 // 2},0.8"
            for k in range(4)
            for t in range(6)
            if rng.random() < 0.8
        ]
        write(f"{name}.csv", "\n".join(["id,t,x,y,class,ignored,existence", *rows, ""]))
    write("w.csv", "t,weight\n" + "".join(f"{t},{t % 3}\n" for t in range(6)))
    common = ("-c", "2", "-g", "1", "--columns", "x,y", *options)
    assert invoke("t.csv", "e.csv", *common, "-q", "-o", "out").status in (0, 4)
    assert read_result("out/result.json")["schema"].startswith("tgospa-eval/result/")
    write("m.csv", "truth,estimate,run\nt.csv,e.csv,a\ne.csv,t.csv,b\n")
    if not {"--by", "--window"} & {*options}:
        batch = ("batch", "m.csv", *common, "--per-step", "-q", "-o", "s", "--workers", "1")
        answer = invoke(*batch)  # which reads what it has stored
        assert answer.status in (0, 4), answer.err
