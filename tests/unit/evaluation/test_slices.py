"""Slices: they add up, to what an independent count of the written files gives."""

import csv
import json
import math
import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from answer import Answer
from any_options import AnyOptions
from hypothesis import assume, given
from hypothesis import strategies as st

from tgospa_eval import ConfigError, Result, Trajectories, evaluate
from tgospa_eval.api.result import ByClass
from tgospa_eval.common.frozen import recast
from tgospa_eval.evaluation.pair import add_up
from tgospa_eval.kernels import kernels
from tgospa_eval.results.slices import Slicing, added_up

PARTS = ("localisation", "missed", "false", "switch")
ASKED = (
    *("level", "level=-1:0:0.5", "level=:0:", "level=0.25", "share=weight", "share=0:0.5:1"),
    *("kind", "one", "none=weight", "t=1:3", "x", "x=0:2", "one * level=0.5"),
    *("range=0:2:4", "range@1=1", "speed", "speed=0:1", "age", "density", "region=x=1:3"),
    *("kind * share=weight", "share=weight * age=1", "none * one=weight", "range=1:2 * kind"),
)


def check_sums(result: Result | ByClass, slicings: tuple[Slicing, ...]) -> None:
    truth, estimates = result.objects
    if isinstance(result, Result) and result.ignored is not None:
        truth -= result.ignored["truth_states"]
    wanted = {
        **{part: getattr(result, part) for part in PARTS},
        **{f"{part}_count": count for part, count in result.counts.items()},
        "truth_steps": truth,
        "estimate_steps": estimates,
        "total": result.total,
    }
    for slicing in slicings:
        assert len({one.name for one in slicing.slices}) == len(slicing.slices)
        for name, whole in wanted.items():
            found = math.fsum(getattr(one, name) for one in slicing.slices)
            assert abs(found - whole) <= 1e-12 * max(whole, result.total), (slicing.by, name)
        assert abs(slicing.total - result.total) <= 1e-12 * result.total
        summary = result.summary
        assigned = math.fsum(one.assigned_steps for one in slicing.slices)
        assert assigned == pytest.approx(summary["assigned_states"], rel=1e-12, abs=1e-12)
        squares = math.fsum(one.squared_error for one in slicing.slices)
        if summary["rmse"]:
            assert (squares / assigned) ** 0.5 == pytest.approx(summary["rmse"], rel=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_slices_add_up(seed: int) -> None:
    """Under all options; a split that is the only one is that of tracks in another order."""
    scene = AnyOptions(seed)
    scene.truth["one"] = np.round(scene.rng.random(len(scene.truth)))
    scene.estimate["none"] = scene.rng.random(len(scene.estimate))
    result = scene.evaluate(slices=ASKED)
    assume(result is not None)
    slicings = result.slices()
    assert [slicing.by for slicing in slicings] == list(ASKED)
    check_sums(result, slicings)
    again = [Slicing.of(slicing.record()) for slicing in slicings]
    assert [one.table() for one in again] == [one.table() for one in slicings]
    (twice,) = added_up([slicings[:1], slicings[:1]])
    assert twice.total == pytest.approx(2 * result.total)
    if not slicings[0].unique:
        return
    for side in (scene.truth, scene.estimate):
        side["id"] = side["id"].map(lambda name: f"{name[0]}{9 - int(name[1])}")
    other = scene.evaluate(slices=ASKED).slices()
    for first, second in zip(slicings, other, strict=True):
        assert [one.name for one in first.slices] == [one.name for one in second.slices]
        for one, same in zip(first.slices, second.slices, strict=True):
            for part in PARTS:
                assert abs(getattr(one, part) - getattr(same, part)) <= 1e-7 * result.total


def test_a_switch_at_an_ignored_state_is_in_its_slice() -> None:
    """What is at such a state alone has no states that count, and its cost is there."""
    truth = table("id,t,x,ignored,occlusion\na,0,0,0,1\na,1,0,0,1\na,2,0,1,\na,3,0,1,\n")
    estimate = table("id,t,x\nb,0,0\nb,1,0\nc,2,0\nc,3,0\n")
    options = {"ignore": "marked", "slices": "occlusion", "columns": "x"}
    found = evaluate(truth, estimate, 10, 1, 1, **options).slices()[0]
    rows = {one.name: (one.truth_steps, one.switch, one.switch_count) for one in found.slices}
    assert rows == {"1": (2, 0, 0), "(missing)": (0, 1, 1), "(none)": (0, 0, 0)}


def test_a_large_scene_adds_up() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, 40, (300, 40, 2))
    estimate = truth + rng.normal(0, 0.3, truth.shape)
    estimate[rng.random((300, 40)) < 0.1] = np.nan
    result = evaluate(truth, estimate, 2, 2, 0.7)
    check_sums(result, result.slices("x=0:20:40", "range * density=1", "speed", "age=0:10:300"))


# --- against files -----------------------------------------------------------------------------


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def recount(folder: Path, slice_of: Callable[[dict[str, str]], str]) -> dict[str, dict[str, float]]:
    """Costs of the slices from assignments.csv, switches.csv and the two files alone."""
    truth = {(row["t"], row["id"]): slice_of(row) for row in rows_of(folder / "truth.csv")}
    estimate = {(row["t"], row["id"]): slice_of(row) for row in rows_of(folder / "estimate.csv")}
    found: dict[str, dict[str, float]] = defaultdict(lambda: dict.fromkeys(PARTS, 0.0))
    left = dict.fromkeys(truth, 1.0), dict.fromkeys(estimate, 1.0)
    for row in rows_of(folder / "out" / "assignments.csv"):
        pair, weight = (row["t"], row["truth"]), float(row["weight"])
        found[truth[pair]]["localisation"] += float(row["cost"])
        left[0][pair] -= weight
        left[1][row["t"], row["estimate"]] -= weight
    for part, places, rest in zip(("missed", "false"), (truth, estimate), left, strict=True):
        for key, share in rest.items():
            found[places[key]][part] += 50.0 * share
    for row in rows_of(folder / "out" / "switches.csv"):
        own = sorted((int(t), key) for t, name in truth if (key := name) == row["truth"])
        later = [t for t, _ in own if t >= int(row["t"])]
        at = str(later[0] if later else own[-1][0])
        found[truth[at, row["truth"]]]["switch"] += float(row["cost"])
    return found


def kinds(row: dict[str, str]) -> str:
    return row["kind"] or "(missing)"


def far(row: dict[str, str]) -> str:
    distance = math.hypot(float(row["x"]) - 100, float(row["y"]) - 100)
    return "below 60" if distance < 60 else "60 and more"


@pytest.mark.parametrize(
    ("asked", "slice_of"),
    [
        ("kind", kinds),
        ("range@100,100=60", far),
        ("kind * range@100,100=60", lambda row: f"{kinds(row)} * {far(row)}"),
    ],
)
def test_as_recounted_from_files(
    asked: str,
    slice_of: Callable[[dict[str, str]], str],
    invoke: Callable[..., Answer],
    quickstart: tuple[str, str],
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(1)
    for name, path in zip(("truth.csv", "estimate.csv"), quickstart, strict=True):
        frame = pd.read_csv(path, dtype=str)
        frame["kind"] = rng.choice(["car", "van", ""], len(frame))
        frame.to_csv(tmp_path / name, index=False)
    files = [str(tmp_path / name) for name in ("truth.csv", "estimate.csv")]
    answer = invoke(
        *(*files, "-c", "10", "-g", "5", "--slice", asked, "-o", str(tmp_path / "out")),
        *("--pictures", "none"),
    )
    assert answer.status == 0
    wanted = recount(tmp_path, slice_of)
    written = {row["slice"]: row for row in rows_of(tmp_path / "out" / "slices.csv")}
    assert {row["by"] for row in written.values()} == {asked}
    assert set(wanted) <= set(written)
    for name, row in written.items():
        for part in PARTS:
            assert float(row[part]) == pytest.approx(wanted[name][part], abs=1e-9), (name, part)


def test_every_output_has_them(
    invoke: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("truth.csv").write_text("id,t,x,class,seen\na,0,0,car,0.2\na,1,0,car,1\nb,1,90,<van>,\n")
    Path("estimate.csv").write_text("id,t,x,class\nc,0,1,car\nd,1,70,<van>\n")
    call = ["truth.csv", "estimate.csv", "-c", "4", "-g", "1"]
    asked = ["--slice", "seen=weight", "--slice", "class * t", "-q"]
    tiny = "1.2345678901234567e-100"
    more = ("--with", "gospa", "--slice", f"class * range={tiny}")
    shown = invoke(*call, *asked, *more).out
    assert "\n\n\n" not in shown
    assert re.search(rf"\n  \.*[<van>* ]*{tiny} and more  ", shown)
    assert "  by seen=weight\n  slice      states  total   share" in shown
    assert "  seen          1.2    8.2  32.8 %" in shown
    assert "  followed " in shown
    assert " RMSE" in shown
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert (
        r"| car \* 0 | 1 | 1 | 4.0 % | 1 | 0 | 0 | 0 | 100 % | 1 |"
        in invoke(*call, *asked, "--format", "markdown").out
    )
    assert r"by seen=weight & states & total" in invoke(*call, *asked, "--format", "latex").out
    document = json.loads(invoke(*call, *asked, "--format", "json").out)
    total = document["total"]
    for slicing in document["slices"]:
        assert math.fsum(row["total"] for row in slicing["slices"]) == pytest.approx(total)
    assert "slices" not in json.loads(invoke(*call, "-q", "--format", "json").out)
    Path("empty.csv").write_text("id,t,x\n")
    nothing = invoke("empty.csv", "empty.csv", "--slice", "speed", "--slice", "x=0:1", "-q")
    assert nothing.status == 0
    assert "  by speed\n  slice  states  total  share" in nothing.out
    assert invoke(*call, *asked, "-o", "out", "--pictures", "none").status == 0
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "&lt;van&gt; * 1" in page
    assert "Cost by <bdi>seen=weight</bdi>" in page
    by_class = invoke(*call, *asked, "--by", "class", "--format", "json")
    summed = json.loads(by_class.out)
    assert summed["slices"][1]["slices"] == document["slices"][1]["slices"]
    assert summed["total"] == total
    assert [len(one["slices"]) for one in summed["by_class"]["car"]["slices"]] == [3, 2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--slice", "nothing"], '--slice "nothing": neither file has such a column (there are '),
        (["--slice", "x=3:1"], "edges must increase"),
        (["--slice", "x", "--sweep", "c=1,2"], "--slice is not supported with --sweep"),
    ],
)
def test_errors_of_the_command_line(
    arguments: list[str], message: str, invoke: Callable[..., Answer], quickstart: tuple[str, str]
) -> None:
    answer = invoke(*quickstart, "-q", *arguments)
    assert (answer.status, answer.out) == (2, "")
    assert message in answer.err


def test_sums_of_results_need_edges(quickstart: tuple[str, str]) -> None:
    parts = {name: evaluate(*quickstart, 10, 2, 5) for name in ("near", "far")}
    whole = recast(add_up(parts, [{"rows": 1, "left_out": {}}] * 2, 0.0), ByClass)
    with pytest.raises(ConfigError, match=r'slices="y": .* need edges, such as y=:\d+:\d+:\d+:$'):
        whole.slices("y")
    check_sums(whole, whole.slices("y=0:100:200", "age=5"))


# --- what attributes are -----------------------------------------------------------------------


def table(text: str) -> pd.DataFrame:
    return pd.read_csv(pd.io.common.StringIO(text))


TRUTH = "id,t,x,y,lane\na,0,0,0,L\na,1,3,4,L\na,3,3,4,\nb,1,3,5,R\n"
ESTIMATE = "id,t,x,y\nc,0,0,1\nc,1,3,4\nd,1,30,40\nd,2,30,40\n"


def cells(asked: str, **more: object) -> dict[str, tuple[float, ...]]:
    """Truth and estimate states of each slice, and its total, of a scene worked out by hand."""
    given_ = {"cutoff": 2, "order": 1, "switch_penalty": 1, "slices": asked, **more}
    slicing = evaluate(table(TRUTH), table(ESTIMATE), **given_).slices()[0]
    return {one.name: (one.truth_steps, one.estimate_steps, one.total) for one in slicing.slices}


@pytest.mark.parametrize(
    ("asked", "wanted"),
    [
        # c follows a at t = 0 and 1 (costs 1, 0); a is missed at 3, b at 1, d is false twice.
        ("lane", {"L": (2, 0, 1), "R": (1, 0, 1), "(missing)": (1, 0, 1), "(none)": (0, 4, 2)}),
        ("lane=R", {"R": (1, 0, 1), "(others)": (2, 0, 1), "(missing)": (1, 0, 1),
                    "(none)": (0, 4, 2)}),
        ("range=0:5:50", {"0 to 5": (1, 1, 1), "5 to 50": (3, 2, 2), "above 50": (0, 0, 0)}),
        ("range@3,4=:5:", {"below 5": (3, 2, 2), "5 and more": (1, 2, 3)}),
        ("range@3=1", {"below 1": (3, 1, 2), "1 and more": (1, 3, 3)}),
        ("age", {"0": (2, 2, 3), "1": (1, 2, 1), "3": (1, 0, 1)}),
        ("speed=0:1:5", {"0 to 1": (1, 2, 3), "1 to 5": (2, 2, 1), "(missing)": (1, 0, 1)}),
        ("density", {"0": (2, 4, 4), "1": (2, 0, 1)}),
        ("region=x=0:3,y=4:", {"inside": (3, 1, 2), "outside": (1, 3, 3)}),
        ("t=1:3", {"below 1": (1, 1, 1), "1 to 3": (3, 3, 4)}),
        ("id", {"a": (3, 0, 2), "b": (1, 0, 1), "c": (0, 2, 0), "d": (0, 2, 2)}),
    ],
)  # fmt: skip
def test_slices_by_hand(asked: str, wanted: dict[str, tuple[float, ...]]) -> None:
    found = cells(asked)
    found = {name: row for name, row in found.items() if any(row) or name in wanted}
    if "above 50" in wanted:  # beyond the edges nothing is shown where nothing is
        assert "below 0" not in found
        wanted = {name: row for name, row in wanted.items() if any(row)} | {"5 to 50": (3, 3, 4)}
    assert found == {name: pytest.approx(row) for name, row in wanted.items()}


def test_columns_go_before_what_follows_from_states() -> None:
    truth = table(TRUTH).assign(speed=[0, 1, 1, 1])
    found = evaluate(truth, table(ESTIMATE), 2, 1, 1, slices="speed").slices()[0]
    assert {one.name: one.truth_steps for one in found.slices} == {"0": 1, "1": 3, "(none)": 0}


def test_other_states() -> None:
    boxes = "id,t,left,top,width,height\na,0,0,0,2,3\na,1,1,0,2,4\n"
    result = evaluate(table(boxes), table(boxes), distance="iou", slices=["size", "x", "speed"])
    sizes, places, speeds = ([one.name for one in found.slices] for found in result.slices())
    assert (sizes, places, speeds) == (["6", "8"], ["1", "2"], ["1.118033988749895"])
    moving = "id,t,x,y,vx,vy\na,0,0,0,3,4\n"
    frame = table(moving)
    side = Trajectories.from_array(
        frame[["x", "y", "vx", "vy"]].to_numpy()[None], ("x", "y", "vx", "vy")
    )
    assert [one.name for one in evaluate(side, side, slices="speed").slices()[0].slices] == ["5"]
    ships = "id,t,lat,lon\na,2020-01-01T00:00:00,0,0\na,2020-01-01T00:00:10,0,1\n"
    result = evaluate(table(ships), table(ships), 1e5, distance="haversine",
                      slices=["speed=11119:11120", "range@0,0=0:1:200000"])  # fmt: skip
    assert [one.truth_steps for one in result.slices()[0].slices] == [2]
    assert [one.truth_steps for one in result.slices()[1].slices] == [1, 1]
    columns = table(TRUTH).assign(width=2, length=[1, 1, 2, 2])
    found = evaluate(columns, columns, 2, slices="size").slices()[0]
    assert [one.name for one in found.slices] == ["2", "4"]


def test_numbers_of_one_side_are_read_beside_the_texts_of_the_other() -> None:
    truth = pd.DataFrame({"id": ["a", "b"], "t": 0, "x": [0.0, 50.0], "kind": [1, 2]})
    estimate = truth.assign(kind=["1", "x"])
    (slicing,) = evaluate(truth, estimate, 2.0, slices="kind").slices()
    assert [(one.name, one.truth_steps, one.estimate_steps) for one in slicing.slices] == [
        ("1", 1, 1), ("2", 1, 0), ("x", 0, 1),
    ]  # fmt: skip


def test_shares_that_are_not_known() -> None:
    truth = table(TRUTH).assign(seen=[-1, 0.25, 1, np.nan])
    found = evaluate(truth, table(ESTIMATE).assign(seen=-1), 2, 1, 1, slices="seen=weight").slices()
    rows = {one.name: (one.truth_steps, one.estimate_steps) for one in found[0].slices}
    assert rows == {"seen": (1.25, 0), "1 - seen": (0.75, 0), "(missing)": (2, 4)}


def test_ties_are_said() -> None:
    truth = table("id,t,x\na,0,0\nb,0,1\n")
    estimate = table("id,t,x\nc,0,0.5\n")
    tied = evaluate(truth, estimate, 2, 1, 1, slices="id").slices()[0]
    assert not tied.unique
    alone = evaluate(truth.iloc[:1], estimate, 2, 1, 1).slices("id")[0]
    assert alone.unique == bool(kernels)  # without them nothing is shown


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("lame", r'slices "lame": neither file has such a column \(there are id, lane, t, x, y\)'),
        ("", "must be NAME, NAME=EDGES"),
        ("lane=", "must be NAME, NAME=EDGES"),
        ("x=1:0", "edges must increase"),
        ("x=0::1", "edges are finite numbers"),
        ("x=:", "no edge is given"),
        ("x=inf", "edges are finite numbers"),
        ("lane=L::R", "a value is blank or given twice"),
        ("lane=L:L", "a value is blank or given twice"),
        ("lane=Q", "no such value; the values are L, R"),
        ("lane=0:1", r'has texts \(L, R\), which have no edges; slices="lane" makes'),
        ("lane=weight", r"has texts \(L, R\), which have no weight"),
        ("x=weight", "x of the truth is 3; a weight must be from 0 to 1"),
        ("size", "neither file has boxes or columns width and height"),
        ("range@a=0:1", "the point behind @ must be numbers"),
        ("range@0,0,0=0:1", "the point has 3 numbers, positions have 2"),
        ("region", "must name ranges of columns"),
        ("region=lane=0:1", 'column "lane" has texts'),
        ("region=q=0:1", 'slices "q": neither file has such a column'),
        ("x=0:1 * y=0:1 * t", "at most two attributes can be crossed"),
    ],
)  # fmt: skip
def test_what_is_refused(asked: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(table(TRUTH), table(ESTIMATE), 2, 1, 1, slices=[asked])


def test_quarters_are_those_of_a_side_with_finite_numbers() -> None:
    many = pd.DataFrame({"id": "a", "t": np.arange(30.0), "x": 0.0, "far": np.inf})
    result = evaluate(many, many.assign(far=np.arange(30.0)), 2, 1, 1, slices="far")
    names = [one.name for one in result.slices()[0].slices]
    assert names == ["below 7", "7 to 14", "14 to 21", "21 and more"]


def test_refused_later() -> None:
    with pytest.raises(ConfigError, match="given twice"):
        evaluate(table(TRUTH), table(ESTIMATE), slices=["x", "x"])
    for wrong in (3, ["x", 3]):
        with pytest.raises(ConfigError, match=r"slices is .*3.*: must be a text, or several"):
            evaluate(table(TRUTH), table(ESTIMATE), slices=wrong)  # type: ignore[arg-type]
    result = evaluate(table(TRUTH), table(ESTIMATE), 2, 1, 1)
    with pytest.raises(ConfigError, match="neither file has such a column"):
        result.slices("lane")
    assert result.slices() == ()
