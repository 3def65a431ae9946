"""compare: what follows from brackets, several solvers, several estimates, hostile names."""

import csv
import io
import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from answer import Invoke, Write
from hypothesis import given
from hypothesis import strategies as st

from tgospa_eval.campaign import solver_runs
from tgospa_eval.campaign.solver_runs import contradictions, errors, referee
from tgospa_eval.common.interval import (
    Interval,
    equal,
    excess,
    less,
    narrowest,
    overlap,
    places,
    verdict,
)
from tgospa_eval.common.progress import Progress
from tgospa_eval.evaluation.prepare import PreparedPair
from tgospa_eval.results.records import Json
from tgospa_eval.show.table_text import Document, Table, as_latex, as_markdown, as_text, csv_text
from tgospa_eval.solvers import Solver

TRUTH = "id,t,x\n1,0,0\n1,1,0\n1,2,0\n"


def bracket(lower: float, upper: float) -> Interval:
    return Interval(lower=lower, upper=upper)


def track(*positions: float) -> str:
    rows = "".join(f"7,{t},{x}\n" for t, x in enumerate(positions))
    return f"id,t,x\n{rows}"


# --- brackets -------------------------------------------------------------------------------------


def test_brackets() -> None:
    a, b, c = bracket(1, 2), bracket(2, 3), bracket(2.5, 4)
    assert overlap(a, b)
    assert not overlap(a, c)
    assert not less(a, b)  # both may be 2
    assert less(a, c)
    assert narrowest([a, bracket(0, 1.5)]) == bracket(1, 1.5)
    assert excess(3, 2) == 0.5
    assert (excess(0, 0), excess(1, 0)) == (0, float("inf"))
    assert equal(bracket(0, 0), bracket(0, 0))
    assert equal(bracket(1, 1 + 2e-10), bracket(1 - 2e-10, 1))
    assert not equal(bracket(1, 1.1), bracket(1, 1.1))  # overlap proves nothing


def test_places_are_those_that_are_proven() -> None:
    # a < b surely; c may be anywhere between both, or beyond b
    assert places([bracket(1, 2), bracket(3, 4), bracket(1.5, 9)]) == [(1, 2), (2, 3), (1, 3)]
    assert places([bracket(1, 1), bracket(2, 2), bracket(1, 1)]) == [(1, 1), (3, 3), (1, 1)]
    assert places([bracket(1, 2), bracket(1, 2)]) == [(1, 2), (1, 2)]
    assert places([bracket(1, 2), bracket(1, 2)], lambda *_: True) == [(1, 1), (1, 1)]
    # nearer than 1e-9: equal, although one is surely smaller
    near = bracket(1 - 1e-10, 1 - 1e-10), bracket(1, 1)
    assert (verdict(*near), places(near)) == ("equal", [(1, 1), (1, 1)])


# --- solvers --------------------------------------------------------------------------------------


def test_solvers_are_compared(write: Write, invoke: Invoke) -> None:
    """One error of 2 at one step: the total is 4 whatever solves it."""
    files = write("t.csv", TRUTH), write("e.csv", track(0, 2, 0))
    answer = invoke("compare", *files, "-c", "5", "-g", "1", "--epsilon", "0.1,0.02",
                    "--format", "json")  # fmt: skip
    assert answer.status == 0
    document = json.loads(answer.out)
    assert [run["name"] for run in document["runs"]] == [
        "certified", "exact", "sinkhorn 0.1", "sinkhorn 0.02",
    ]  # fmt: skip
    assert document["agree"] is True
    for run in document["runs"]:
        assert run["total"] == pytest.approx(4)
        assert run["error"] < 1e-9
        assert run["seconds"]["solve"] >= 0
        if run["epsilon"] is None:
            assert run["entropic"] is None
            continue
        # Of one pair a sum over 8 paths, with gains 1, 21/25, 1 and half a switch of 1/50.
        paths = np.array(list(itertools.product((0, 1), repeat=3)))
        values = paths @ [1, 21 / 25, 1] - np.abs(np.diff(paths)).sum(axis=1) / 50
        value = 25 * (3 - run["epsilon"] * np.log(np.exp(values / run["epsilon"]).sum()))
        found = run["entropic"]
        assert found["primal"] == pytest.approx(value, rel=1e-9)
        assert found["dual"] == pytest.approx(value, rel=1e-9)
        assert found["error"] == pytest.approx(abs(value - 4) / 4, rel=1e-6)
        assert found["history"][-1]["epsilon"] == run["epsilon"]
        assert found["history"][-1]["dual"] == found["dual"]
    text = invoke("compare", *files, "-c", "5", "-g", "1", "--epsilon", "0.1").out
    assert "  entropic         value" in text
    memory = document["runs"][0]["memory"]
    if Path("/proc/self/clear_refs").exists():
        assert memory["peak"] >= memory["before"] > 1e6


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run solvers in this process, with a change to what they answer."""

    def here(change: Callable[[Solver, Json], Json] = lambda _, made: made) -> None:
        run_here = solver_runs.run_here

        def run(prepared: PreparedPair, solver: Solver, progress: Progress) -> solver_runs.Run:
            made, result = run_here(prepared, solver, progress)
            return change(solver, made), result

        monkeypatch.setattr(solver_runs, "run_here", run)

    return here


def test_wrong_solver_is_found(write: Write, invoke: Invoke, here, tmp_path: Path) -> None:
    """A solver whose proof says 0 to 3 of a total that the others prove to be 4."""
    wrong = {"total_lower": 0.0, "total": 3.0}
    here(lambda solver, made: made | wrong if solver.name == "exact" else made)
    paths = write("t.csv", TRUTH), write("e.csv", track(0, 2, 0))
    answer = invoke("compare", *paths, "-c", "5", "-g", "1", "--epsilon", "0.1", "-o", "out")
    assert answer.status == 4
    assert "The brackets of certified and exact; exact and sinkhorn 0.1 do not" in answer.out
    document = json.loads((tmp_path / "out" / "compare.json").read_text(encoding="utf-8"))
    assert document["referee"] is None  # nothing is proven, so there is no error to show
    assert [run["error"] for run in document["runs"]] == [None] * 3
    assert not list((tmp_path / "out").glob("*.png"))


def test_one_that_fails_leaves_the_others(write: Write, invoke: Invoke, here) -> None:
    def change(solver: Solver, made: Json) -> Json:
        if solver.name == "exact":
            raise ZeroDivisionError("by nothing")
        return made

    here(change)
    paths = write("t.csv", TRUTH), write("e.csv", track(0, 2, 0))
    call = ("compare", *paths, "-c", "5", "-g", "1", "--epsilon", "0.1", "-q")
    answer = invoke(*call, "--format", "json")
    told = "failed: ZeroDivisionError: by nothing; this is an error of this program"
    assert (answer.status, answer.err.startswith(f"exact: {told}")) == (4, True)
    certified, exact, _ = json.loads(answer.out)["runs"]
    assert certified["total"] == pytest.approx(4)
    assert (exact["total"], exact["error"], exact["seconds"]) == (None, None, None)
    assert exact["status"].startswith(told)
    assert "Both brackets overlap" in invoke(*call).out
    assert invoke(*call, "--solvers", "exact").out.splitlines()[2] == "No solver has a result"
    assert "exact" in invoke(*call, "--format", "csv").out


def test_errors_are_against_what_all_prove() -> None:
    a, b, lost = (
        {"name": name, "total_lower": lower, "total": upper}
        for name, lower, upper in (("a", 90, 100), ("b", 80, 96), ("failed", None, None))
    )
    known = referee([a, b, lost])
    assert known == bracket(90, 96)
    assert errors(a, known)[0] == pytest.approx(10 / 90)
    assert errors(b, known)[1] == pytest.approx(16 / 96)
    assert errors(lost, known) == (None, None)
    assert not contradictions([a, b, lost])


def test_exact_is_left_out_where_it_is_slow(
    write: Write, invoke: Invoke, monkeypatch, here
) -> None:
    here()
    monkeypatch.setattr("tgospa_eval.campaign.solver_runs.takes_long", lambda _: 123_456)
    paths = write("t.csv", TRUTH), write("e.csv", track(0, 2, 0))
    answer = invoke("compare", *paths, "--epsilon", "0.1")
    assert "exact left out: with 123,456 reduced states" in answer.out
    asked = invoke("compare", *paths, "--solvers", "exact")
    assert "left out" not in asked.out


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--solvers", "simplex"], 2, '--solvers "simplex": must be of certified, exact, sinkhorn'),
        (["--epsilon", "0.1,x"], 2, '--epsilon "x": must be numbers with commas'),
        (["--epsilon", "0.1,1_0"], 2, '--epsilon "1_0": must be numbers with commas'),
        (["--epsilon", "0.1,0.1"], 2, "sinkhorn 0.1 is given twice"),
        (["--epsilon", "0"], 2, "epsilon is 0: must be finite and more than 0"),
        (["--solvers", ""], 2, '--solvers "": must be of certified, exact, sinkhorn'),
        (["--by", "class"], 2, "choose one class by --class NAME"),
        (["--by", "class", "--simulate"], 2, "--by is for files, not for --simulate"),
        (["--runs", "3"], 2, "--runs is for --simulate"),
        (["--simulate"], 2, "--simulate makes its own scenes"),
        (["--against", "per-step-gospa", "--solvers", "exact,certified"], 2, "with one solver"),
        (["missing.csv"], 3, "missing.csv: no such file"),
        (["."], 3, ".: is a folder, not a file"),
        (["/"], 3, "/: is a folder, not a file"),
        ([""], 3, '"": no such file'),
        (["./e.csv"], 2, "./e.csv: is the same as "),
        (["-o", "t.csv/x"], 2, "--output t.csv/x: "),
        (["-o", "/proc/x/y"], 2, "--output /proc/x/y: cannot be written: "),
    ],
)
def test_wrong_use(
    arguments: list[str], status: int, message: str, write: Write, invoke: Invoke
) -> None:
    answer = invoke("compare", write("t.csv", TRUTH), write("e.csv", track(0)), *arguments, "-q")
    assert answer.status == status
    assert message in answer.err
    assert answer.out == ""


# --- estimates ------------------------------------------------------------------------------------


def test_ranking(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Totals by hand: good 1, twin 1 (mirrored), bad 4 + 4 + 4, missing two steps 12.5 + 12.5."""
    truth = write("t.csv", TRUTH)
    paths = [
        write(f"{name}.csv", track(*positions))
        for name, positions in (
            ("bad", (2, 2, 2)), ("good", (0, 1, 0)), ("twin", (0, -1, 0)), ("lost", (0,)),
        )
    ]  # fmt: skip
    folder = tmp_path / "out"
    answer = invoke("compare", truth, *paths, "-c", "5", "-g", "1", "-q", "--format", "json",
                    "-o", str(folder))  # fmt: skip
    document = json.loads(answer.out)
    assert [(e["name"], e["place"]) for e in document["estimates"]] == [
        ("good", [1, 1]), ("twin", [1, 1]), ("bad", [3, 3]), ("lost", [4, 4]),
    ]  # fmt: skip
    assert document["steps"] == [3]
    assert [e["total"] for e in document["estimates"]] == pytest.approx([1, 1, 12, 25])
    assert document["estimates"][3]["normalised"]["missed"] == pytest.approx((25 / 3) ** 0.5)
    first = {(p["first"], p["second"]): p for p in document["pairs"]}
    assert first["good", "twin"]["verdict"] == "equal"
    assert first["good", "bad"]["verdict"] == "less"
    assert first["good", "bad"]["per_step"]["total"] == pytest.approx([11 / 3, 11 / 3])
    assert first["good", "bad"]["steps"] == {"better": 0, "worse": 3}
    assert first["good", "lost"]["per_step"]["missed"] == pytest.approx(25 / 3)
    rows = list(csv.DictReader(io.StringIO((folder / "per_step.csv").read_text())))
    difference = [float(r["difference"]) for r in rows if r["estimate"] == "bad"]
    assert difference == pytest.approx([4, 3, 4])
    shown = invoke("compare", truth, *paths, "-c", "5", "-g", "1", "-q").out
    assert shown.startswith(
        "Ranking of 4 estimates; to compare solvers on one: tgospa-eval compare "
    )
    assert "Proven order of these files by TGOSPA per step, best first: good = twin, " in shown
    assert re.search(r"^  twin .* 1=$", shown, re.MULTILINE)
    assert re.search(r"^  vs good .*\n  twin +\+0 +equal ", shown, re.MULTILINE)
    latex = invoke("compare", truth, *paths, "-c", "5", "-g", "1", "-q", "--format", "latex").out
    bold = re.findall(r"^([a-z]+) & \\textbf", latex, re.MULTILINE)
    assert bold == ["good", "twin"] * 2  # RMS-TGOSPA and costs
    assert re.findall(r"^([a-z]+) & \\underline", latex, re.MULTILINE) == []  # the second is third


def test_equal_data_are_equal_whatever_the_brackets_are(
    invoke: Invoke, crowd, tmp_path: Path
) -> None:
    truth, estimate = crowd
    copy, renamed = tmp_path / "copy.csv", tmp_path / "renamed.csv"
    text = Path(estimate).read_text(encoding="utf-8")
    copy.write_text(text, encoding="utf-8")
    renamed.write_text(text.replace("\n", "\nx").removesuffix("x"), encoding="utf-8")
    call = ("compare", truth, estimate, str(copy), str(renamed), "-c", "15", "-q")
    assert "Proven to be equal on these files by TGOSPA per step: " in invoke(*call).out
    hot = ("--solvers", "sinkhorn", "--epsilon", "0.5", "--format", "json")
    verdicts = {
        ("renamed" in pair["first"] + pair["second"], pair["verdict"])
        for pair in json.loads(invoke(*call, *hot).out)["pairs"]
    }
    assert verdicts == {(False, "equal"), (True, "not separated")}


def test_wide_brackets_prove_no_order(invoke: Invoke, crowd, tmp_path: Path) -> None:
    """The other is worse by one row, which the bracket of a hot sinkhorn does not show."""
    truth, estimate = crowd
    lines = Path(estimate).read_text(encoding="utf-8").splitlines(keepends=True)
    other = tmp_path / "other.csv"
    other.write_text("".join(lines[:-1]), encoding="utf-8")
    verdicts = []
    for options in ([], ["--solvers", "sinkhorn", "--epsilon", "0.5"]):
        answer = invoke("compare", truth, estimate, str(other), "-c", "15", "-q", "--format",
                        "json", *options)  # fmt: skip
        document = json.loads(answer.out)
        verdicts.append((document["pairs"][0]["verdict"], document["estimates"][0]["place"]))
    assert verdicts == [("less", [1, 1]), ("not separated", [1, 2])]


def test_runs_are_averaged_before_the_root(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Errors 1 and 3 at one of three steps: totals 1 and 9, mean 5; RMS per step (5/3)^(1/2)."""
    for k, error in ((1, 1), (2, 3), (10, 1)):
        (tmp_path / f"{k}").mkdir()
        write(f"{k}/gt.csv", TRUTH)
        write(f"{k}/a.csv", track(0, error, 0))
        write(f"{k}/b.csv", track(0, 4, 0))
    folder = tmp_path.as_posix()
    (tmp_path / "10").rename(tmp_path / "x")
    patterns = [f"{folder}/[12]/{name}.csv" for name in ("gt", "a", "b")]  # no pattern of ours
    assert "is a pattern, not a file" in invoke("compare", *patterns).err
    (tmp_path / "x").rename(tmp_path.parent / f"{tmp_path.name}-10")
    patterns = [f"{folder}/*/{name}.csv" for name in ("gt", "a", "b")]
    answer = invoke("compare", *patterns, "-c", "5", "-g", "1", "-q", "--format", "json")
    document = json.loads(answer.out)
    best = document["estimates"][0]
    assert document["runs"] == 2
    assert best["total"] == pytest.approx(5)
    assert best["normalised"]["tgospa"] == pytest.approx((5 / 3) ** 0.5)
    pair = document["pairs"][0]["per_run"]
    # differences of totals 15 and 7, of 3 steps each: 5 and 7/3
    assert pair["mean"] == pytest.approx((5 + 7 / 3) / 2)
    assert pair["standard_error"] == pytest.approx((5 - 7 / 3) / 2)
    assert pair["first_less"] == 2
    latex = invoke("compare", *patterns, "-c", "5", "-g", "1", "-q", "--format", "latex").out
    assert r"estimate & RMS-TGOSPA & local. & missed & false & switch \\" in latex
    assert rf"a & \textbf{{{(5 / 3) ** 0.5:.4f}}}" in latex
    assert r"b & \underline{" in latex


@pytest.mark.parametrize("ids", [False, True])  # whether each copy has ids of its own
@pytest.mark.parametrize(("a", "pairs"), [([1] * 7, 1), ([1, 2, 3, 4, 5, 6, 6], 6)])
def test_copies_of_a_run_count_once(
    write: Write, invoke: Invoke, tmp_path: Path, a: list[int], pairs: int, ids: bool
) -> None:
    for tracker, more in (("a", 0), ("b", 1)):
        (tmp_path / tracker).mkdir()
        for run, error in enumerate(a):
            text = track(error / 2, error + more + 1 / 7, 0)
            write(f"{tracker}/{run}.csv", text.replace("\n7,", f"\n{run}9,") if ids else text)
    metric = "-c", "90", "-g", "1", "-q", "--format", "json"
    folder, truth = tmp_path.as_posix(), write("t.csv", TRUTH)
    one = invoke("compare", truth, f"{folder}/a/*.csv", f"{folder}/b/*.csv", *metric)
    compared = json.loads(one.out)
    assert [item["code"] for item in compared["warnings"]].count("copies") == 2
    assert all(bool(item["confidence"]) is (pairs > 1) for item in compared["estimates"])
    assert (compared["pairs"][0]["per_run"]["standard_error"] is None) is (pairs == 1)
    estimate = "--estimate", f"{folder}/{{tracker}}/{{run}}.csv", "-o", f"{folder}/s"
    batch = invoke("batch", "--truth", truth, *estimate, "--by", "tracker", "--per-step", *metric)
    assert f"warning: {7 if pairs == 1 else 2} runs of b are copies of one" in batch.out
    document = json.loads(batch.out)
    (pair,) = document["comparisons"]
    p_value = 2 / 2**pairs if pairs > 1 else None
    assert (pair["pairs"], pair["p_value"], compared["pairs"][0]["p_value"]) == (
        pairs,
        p_value,
        p_value,
    )
    for name in ("ranking", "groups"):
        each = [item.get("confidence_upper", item.get("confidence")) for item in document[name]]
        assert [bool(value) for value in each] == [pairs > 1] * 2
    assert all(
        (p["band_low"] is None) is (pairs == 1) for c in document["curves"] for p in c["points"]
    )


def test_runs_that_are_no_copies(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Runs that crashed are in every test, and so are runs with the same few round numbers."""
    for tracker in "ab":
        (tmp_path / tracker).mkdir()
    errors = [0, 1, 1, 2, 3, 2, 2, 1]
    for run in range(8):
        write(f"a/{run}.csv", track(*errors[run:], *errors[:run]))
        write(f"b/{run}.csv", track(*[4 + run / 7] * 8) if run < 4 else "id,t,x\n")
    truth, folder = write("t.csv", track(*[0] * 8)), tmp_path.as_posix()
    both = f"{folder}/a/*.csv", f"{folder}/b/*.csv"
    answer = invoke("compare", truth, *both, "-c", "90", "-g", "1", "-q", "--format", "json")
    document = json.loads(answer.out)
    assert "copies" not in [item["code"] for item in document["warnings"]]
    assert document["pairs"][0]["p_value"] == pytest.approx(2 / 2**8)


def test_the_interval_of_a_random_tracker_beside_copies(
    write: Write, invoke: Invoke, tmp_path: Path
) -> None:
    for tracker in "ab":
        (tmp_path / tracker).mkdir()
        for run in range(8):
            write(f"{tracker}/{run}.csv", track(1 / 3, (2 + run) / 7 if tracker == "a" else 3, 0))
    truth, metric = write("t.csv", TRUTH), ("-c", "90", "-g", "1")
    said = invoke("compare", truth, "a/*.csv", "b/*.csv", *metric)
    assert "a test needs different runs of both, or several truths" in " ".join(said.out.split())
    answer = invoke("compare", truth, "a/*.csv", "b/*.csv", *metric, "--format", "json")
    compared = {item["name"]: item["confidence"] for item in json.loads(answer.out)["estimates"]}
    jobs = "--estimate", "{tracker}/{run}.csv", "-o", "s", "--by", "tracker"
    batch = json.loads(
        invoke("batch", "--truth", truth, *jobs, *metric, "--format", "json", "-q").out
    )
    each = {item["name"]: item["per_step_confidence"] for item in batch["ranking"]}
    assert each == {
        name: ends and [pytest.approx(end) for end in ends] for name, ends in compared.items()
    }
    assert (compared["b"], bool(compared["a"])) == (None, True)


def test_what_is_ranked_is_shown(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Runs of 1 and 4 steps. Costs of a: 4 and 0, of b: 0 and 8 = 4 * 2; per step 4/5 and 8/5.

    Long runs count more, as in a batch and in groups of a gate. Were each run to count the same, b
    would be the first: a (4/1 + 0/4) / 2 = 2, b (0/1 + 8/4) / 2 = 1.
    """
    for k, lengths in ((1, 1), (2, 4)):
        (tmp_path / f"{k}").mkdir()
        write(f"{k}/gt.csv", track(*[0] * lengths))
    for name, short, long in (("a", 2, 0), ("b", 0, 2**0.5)):
        write(f"1/{name}.csv", track(short))
        write(f"2/{name}.csv", track(*[long] * 4))
    call = ("compare", "*/gt.csv", "*/a.csv", "*/b.csv", "-c", "5", "-g", "1")
    answer = invoke(*call, "--format", "json")
    document = json.loads(answer.out)
    best, other = document["estimates"]
    assert (best["name"], best["total"], other["total"]) == ("a", *map(pytest.approx, (2, 4)))
    assert document["ranked_by"] == "normalised.tgospa"
    pair = document["pairs"][0]
    assert best["normalised"]["tgospa"] == pytest.approx((4 / 5) ** 0.5)
    assert pair["per_step"]["total"] == pytest.approx([4 / 5, 4 / 5])
    assert pair["verdict"] == "less"
    assert "is before" not in answer.err
    jobs = ("batch", "--truth", "{run}/gt.csv", "--estimate", "{run}/{name}.csv", "-c", "5")
    asked = ("-g", "1", "-q", "-o", "rows", "--by", "name", "--format", "json")
    ranking = json.loads(invoke(*jobs, *asked).out)["ranking"]
    assert [item["name"] for item in ranking] == ["a", "b"]
    assert [item["per_step"] for item in ranking] == pytest.approx(
        [item["normalised"]["tgospa"] for item in document["estimates"]]
    )
    lines = invoke(*call, "-q").out.splitlines()
    head = next(line for line in lines if "local." in line)
    assert head.split()[:3] == ["estimate", "RMS-TGOSPA", "local."]
    assert lines[lines.index(head) + 1].split()[:2] == ["a", "0.8944"]


@pytest.mark.parametrize("grid", ["estimate", "common"])
def test_one_that_stops_after_a_perfect_step_is_not_the_best(
    grid: str, write: Write, invoke: Invoke
) -> None:
    """What it misses is charged; where that is declined there is no order."""
    paths = [write("t.csv", TRUTH), write("early.csv", track(0)), write("e.csv", track(0, 1, 0))]
    asked = ("compare", *paths, "--grid", grid, "-q", "-c", "5")
    assert "best first: e, early" in invoke(*asked).out
    answer = invoke(*asked, "--outage", "none")
    assert (answer.status, answer.out) == (2, "")
    assert "no ranking: not judged on the same steps and truth (early, " in answer.err
    assert "1 truth state at 1 of 1 step" in answer.err
    ranked = invoke("compare", *paths, "--grid", "truth", "-q", "-c", "5").out
    assert "best first: e, early" in ranked


def test_nothing_is_read_where_a_file_is_missing(write: Write, invoke: Invoke) -> None:
    """The first file is wrong, too; that is told when it is read."""
    answer = invoke("compare", write("t.csv", "nonsense"), write("e.csv", TRUTH), "none.csv")
    assert (answer.status, answer.err) == (3, "none.csv: no such file\n")


def test_a_star_may_be_part_of_a_name(write: Write, invoke: Invoke) -> None:
    answer = invoke("compare", write("t.csv", TRUTH), write("x*y.csv", track(0, 1, 0)), "-c", "5",
                    "--solvers", "certified", "--format", "json")  # fmt: skip
    assert json.loads(answer.out)["kind"] == "solvers"


def test_classes_of_the_settings_are_left_aside(write: Write, invoke: Invoke) -> None:
    paths = write("t.csv", TRUTH), write("a.csv", TRUTH), write("b.csv", track(0, 1, 0))
    config = write("tgospa-eval.toml", 'by = "class"\n')
    answer = invoke("compare", *paths, "-c", "5", "--config", config)
    assert answer.status == 0
    assert "by = class in the settings is ignored" in answer.err


@pytest.mark.parametrize(
    ("files", "patterns", "message"),
    [
        (
            ["1/gt", "2/gt", "1/a"],
            ["*/gt", "*/a"],
            "2/a.csv: no such file, but other patterns have this run",
        ),
        (["1/gt", "1/a", "2/a"], ["*/gt", "*/a"], "2/a.csv: this run is missing in other patterns"),
        (["1/gt"], ["*/gt", "*/a"], "*/a.csv: no such files"),
        (["1/gt", "1/a"], ["*/gt", "1/a"], "1/a.csv: has no *"),
        (["1/gt", "1/a"], ["*/gt", "*/*"], "must have a single *"),
        (["gt", "a"], ["gt", "a", "a"], "a.csv: is given twice"),
    ],
)
def test_patterns_fit_each_other(
    files: list[str], patterns: list[str], message: str, tmp_path: Path, invoke: Invoke
) -> None:
    for name in files:
        path = tmp_path / f"{name}.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_text(TRUTH, encoding="utf-8")
    answer = invoke("compare", *(f"{name}.csv" for name in patterns))
    assert answer.status in (2, 3)
    assert message in answer.err


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["out/a.csv", "out/b.txt"], ["a", "b"]),
        (["x/careful/est.csv", "x/eager/est.csv"], ["careful", "eager"]),
        (["mc/*/a.csv", "mc/*/b.csv"], ["a", "b"]),
        (["a/*/est.csv", "b/*/est.csv"], ["a", "b"]),
        (["a.csv", "a.txt"], ["a.csv", "a.txt"]),
        (["x/a.csv", "a.csv"], ["x/a.csv", "a.csv"]),
        (["x/a.csv"], ["a"]),
    ],
)
def test_names_are_what_differs(paths: list[str], names: list[str]) -> None:
    from tgospa_eval.campaign.pairs import short_names

    assert short_names(tuple(paths)) == names


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Write a file below the current folder, with its folders."""
    monkeypatch.chdir(tmp_path)

    def write(name: str, text: str) -> str:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text, encoding="utf-8")
        return name

    return write


def test_fields_stand_for_runs_and_estimates(tree: Write, invoke: Invoke) -> None:
    names = ("gt/r1.csv", "gt/r10.csv", "gt/r2.csv")
    for name in names:
        tree(name, TRUTH)
        for k, tracker in enumerate(("b*", "a")):
            tree(f"out/{tracker}/by-{Path(name).stem}.csv", track(0, k + 1, 0))
    arguments = ("compare", "gt/{run}.csv", "out/{tracker}/by-{run}.csv", "--format", "json", "-q")
    answer = invoke(*arguments)
    assert answer.status == 0, answer.err
    found = json.loads(answer.out)
    assert found["runs"] == 3
    paths = {item["name"]: item["paths"] for item in found["estimates"]}
    assert paths["a"] == [f"out/a/by-{run}.csv" for run in ("r1", "r2", "r10")]
    assert sorted(paths) == ["a", "b*"]
    single = invoke("compare", "gt/r1.csv", "out/{tracker}/by-r1.csv", "--format", "json", "-q")
    assert [item["name"] for item in json.loads(single.out)["estimates"]] == [
        item["name"] for item in found["estimates"]
    ]
    Path("out/a/by-r2.csv").unlink()
    answer = invoke(*arguments)
    assert answer.status == 3
    assert "out/a/by-r2.csv: no such file, but other patterns have this run" in answer.err


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        (("gt/{run}.csv", "a.csv"), "a.csv: has no {run}, but gt/{run}.csv has it"),
        (("gt/{run}.csv", "out/*.csv"), "out/*.csv: has a *, but gt/{run}.csv has fields"),
        (("gt/r1.csv", "out/{tracker}.csv"), "out/{tracker}.csv: no such files"),
        (
            ("gt/{run}.csv", "on/{tracker}/{run}.csv"),
            "on/{tracker}/{run}.csv: matches {x}, which has braces like a field",
        ),
        (("gt/{run}.csv", "gt/{run}.csv", "{run}.csv"), "r1.csv: no such file"),
        (
            ("gt/r1.csv", "gt/{tracker}_{run}.csv"),
            "x_y_z.csv: the fields of gt/{tracker}_{run}.csv",
        ),
    ],
)
def test_fields_that_do_not_fit(
    tree: Write, invoke: Invoke, paths: tuple[str, ...], message: str
) -> None:
    for name in ("gt/r1.csv", "gt/r2.csv", "a.csv", "gt/x_y_z.csv", "on/{x}/r1.csv"):
        tree(name, TRUTH)
    answer = invoke("compare", *paths)
    assert answer.status in (2, 3)
    assert message in answer.err


def test_tables_escape_everything() -> None:
    name = "evil\n\x1b[31m\u202e{~^\\}"
    page = Document(title=name, lines=[name], tables=[Table(head=("a", "b"), rows=[(name, "1")])])
    for text in (as_text(page), as_markdown(page), as_latex(page)):
        assert not {"\x1b", "\u202e"} & set(text)
        assert "evil\n" not in text
    assert r"\{\textasciitilde{}\textasciicircum{}\textbackslash{}\}" in as_latex(page)
    table = {"=a": ["@x", -1.0, None, "-1", "'=x", "it's"]}
    assert csv_text(table) == "'=a\n'@x\n-1.0\n\"\"\n-1\n''=x\nit's\n"
    ends = ["a\rb", "a\nb", "a\r\nb"]
    assert csv_text({"a\r": ends}) == '"a\r"\n"a\rb"\n"a\nb"\n"a\r\nb"\n'


def test_tables_have_80_columns_and_every_cell(write: Write, invoke: Invoke) -> None:
    truth = write("t.csv", TRUTH)
    paths = [write(f"{'long' * 20}{k}.csv", track(0, k, 1e3)) for k in range(3)]
    for extra in ([], ["--against", "per-step-gospa"]):
        out = invoke("compare", truth, *paths, "-c", "123456.7", "-q", *extra).out
        assert max(map(len, out.splitlines())) <= 80
        assert out.count("  proven") + out.count("  open") == 2
        assert re.search(r"^  vs \.\.\.(long)*\w*0 ", out, re.MULTILINE)


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=12),
    st.lists(st.integers(1, 60), min_size=1, max_size=4),
)
def test_no_cell_is_cut(widths: list[int], names: list[int]) -> None:
    head = ("name", *(f"h{k}" for k in range(len(widths))))
    rows = [
        (f"n{'-' * size}{k}", *(f"{k}x{at}".rjust(w, "_") for at, w in enumerate(widths)))
        for k, size in enumerate(names)
    ]
    text = as_text(Document(title="t", lines=[], tables=[Table(head=head, rows=rows)]))
    assert max(map(len, text.splitlines())) <= 80
    words = text.split()
    for row in rows:
        assert set(row[1:]) <= set(words)
        assert any(word.endswith(row[0][-5:]) for word in words)


def test_rows_of_latex_begin_with_no_setting() -> None:
    page = Document(
        title="t", lines=[], tables=[Table(head=("a", "b"), rows=[("[x]", "1"), ("*", "2")])]
    )
    assert "\n{}[x] & 1" in as_latex(page)
    assert "\n{}* & 2" in as_latex(page)
