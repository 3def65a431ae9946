"""--ignore: states that are not judged, from files to every output."""

import json
from pathlib import Path

import pandas as pd
import pytest
from answer import Answer

from tgospa_eval import ConfigError, Trajectories, evaluate

TRUTH = """id,t,x,y,class,occlusion
1,0,0,0,Car,0
1,1,1,0,Car,0
1,2,2,0,Car,2
1,3,3,0,Car,
2,0,20,0,Van,0
2,1,21,0,Van,0
2,2,22,0,Van,0
"""
ESTIMATE = """id,t,x,y
a,0,0.5,0
a,1,1.5,0
a,2,2.5,0
a,5,9,0
b,0,20,0
b,1,21,0
b,2,22,0
"""
METRIC = ("-c", "4", "-p", "1", "-g", "1", "-q")
HALF = 2.0


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    monkeypatch.chdir(tmp_path)
    Path("truth.csv").write_text(TRUTH, encoding="utf-8")
    Path("estimate.csv").write_text(ESTIMATE, encoding="utf-8")
    return "truth.csv", "estimate.csv"


def ignoring(*specs: str) -> tuple[str, ...]:
    return tuple(part for spec in specs for part in ("--ignore", spec))


@pytest.mark.parametrize(
    ("specs", "filters", "total", "counts"),
    [
        # The false state at t = 5 and the miss at t = 3 cost HALF each, three errors 0.5.
        (("class=Van",), (), 1.5 + 2 * HALF, (3, 3.0, 0)),
        (("class=van",), ("--class", "Car"), 1.5 + 2 * HALF, (3, 3.0, 0)),
        ((), ("--class", "Car"), 1.5 + 2 * HALF + 3 * HALF, None),
        (("class=Van", "occlusion>1"), (), 1.0 + 2 * HALF, (4, 4.0, 0)),
        (("class=Van", "outside-truth-steps"), (), 1.5 + HALF, (3, 3.0, 1)),
        (("x>=20",), (), 1.5 + 2 * HALF, (3, 3.0, 0)),
        (("class=Van,Car",), (), HALF, (7, 6.0, 0)),
    ],
)
def test_what_is_ignored_costs_nothing(files, invoke, specs, filters, total, counts) -> None:
    answer = invoke(*files, *METRIC, *ignoring(*specs), *filters, "--format", "json")
    found = json.loads(answer.out)
    assert found["total"] == pytest.approx(total, abs=1e-12)
    if counts is None:
        assert "ignored" not in found
        assert found["metric"] == "tgospa"
        return
    names = ("truth_states", "absorbed", "excused")
    assert (*(found["ignored"][name] for name in names),) == counts
    assert found["metric"] == "masked-tgospa"
    assert found["parameters"]["ignore"] == list(specs)
    assert found["judged"]["truth_states"] == 7 - counts[0]
    for name, count in zip(("ignored", "absorbed", "excused"), counts, strict=True):
        assert sum(row[name] for row in found["per_step"]) == count


def test_every_report_says_what_is_not_judged(files, invoke) -> None:
    for style in ("table", "markdown", "latex"):
        text = invoke(*files, *METRIC, "--ignore", "class=Van", "--format", style).out
        assert "3 ground-truth states" in text, style
    result = evaluate(*files, cutoff=4, switch_penalty=1, ignore="class=Van")
    assert "3 ground-truth states" in result.to_html()
    assert "3 ground-truth states" in result._repr_html_()
    Path("other.csv").write_text(ESTIMATE, encoding="utf-8")
    text = invoke("compare", *files, "other.csv", *METRIC, "--ignore", "class=Van").out
    assert "not judged: class=Van" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--ignore", "colour=red"), 'truth.csv has no column "colour"; it has id, t, x, y, class'),
        (("--ignore", "x==3"), "must be a condition on a column"),
        (("--ignore", "x!=3"), "must be a condition on a column"),
        (("--ignore", "x=far"), 'column "x" has numbers, but "far" is not a number'),
        (("--ignore", "class>3"), "compare classes with ="),
        (("--ignore", "x>a"), '"a" is not a plain, finite number'),
        (("--ignore", "x"), "must be a condition on a column"),
        (("--ignore", "marked"), "truth.csv has no column ignored; for marks of estimates"),
        (("--ignore", "truth-gaps"), "needs --interpolate truth or --resample"),
        (("--ignore", "class=Van", "--by", "class"), "cannot be combined with --by class"),
        (("--ignore", "x>1", "--existence", "use"), "cannot be combined"),
        (
            ("--ignore", "outside-truth-steps", "--resample", "1", "--max-gap", "2"),
            "--ignore truth-gaps leaves",
        ),
    ],
)
def test_bad_rules_get_one_sentence(files, invoke, options, message) -> None:
    answer: Answer = invoke(*files, *METRIC, *options)
    assert answer.status == 2
    assert message in answer.err
    assert len(answer.err.splitlines()) == 1


def test_marks_of_files_and_what_they_may_be(files, invoke) -> None:
    truth = pd.read_csv(files[0]).assign(ignored=lambda table: table["class"] == "Van")
    truth.to_csv("marked.csv", index=False)
    rule = ("--ignore", "marked", "--format", "json")
    found = json.loads(invoke("marked.csv", files[1], *METRIC, *rule).out)
    assert found["ignored"]["truth_states"] == 3
    truth.assign(ignored="perhaps").to_csv("marked.csv", index=False)
    answer = invoke("marked.csv", files[1], *METRIC, *rule)
    assert answer.status == 3
    assert 'marked.csv, column "ignored": id "1" at t = 0 is "perhaps"; must be 0 or 1' in (
        answer.err
    )


def test_a_column_of_that_name_counts_only_where_it_is_asked_for(files, invoke) -> None:
    pd.read_csv(files[0]).assign(ignored=1).to_csv("marked.csv", index=False)
    plain = json.loads(invoke(*files, *METRIC, "--format", "json").out)
    sliced = ("--slice", "ignored", "--ignore", "x>100", "--format", "json")
    found = json.loads(invoke("marked.csv", files[1], *METRIC, *sliced).out)
    assert found["total"] == plain["total"]


def test_proofs_have_the_marks(files, invoke) -> None:
    rules = ignoring("class=Van", "outside-truth-steps")
    invoke(*files, *METRIC, *rules, "--proof", "-o", "out", "--pictures", "none")
    assert "the tables follow from the files" in invoke("verify", "out", *files).out
    table = Path("out/proof/truth.csv")
    table.write_text(table.read_text().replace("2,0,20.0,0.0,0", "2,0,20.0,0.0,1"))
    assert "was changed" in invoke("verify", "out").err


def test_values_are_comparable_only_where_the_same_is_ignored(files, invoke) -> None:
    base = ("--baseline", "base.json")
    invoke("gate", *files, *base, "--update-baseline", *METRIC, "--ignore", "class=Van")
    assert invoke("gate", *files, *base).out.startswith("gate: pass")
    answer = invoke("gate", *files, *base, "--ignore", "occlusion>1")
    assert answer.status in (1, 2)


def test_a_ship_between_its_reports_is_not_false() -> None:
    clock = [0, 10, 20, 30, 300, 310, 600]
    ship = pd.DataFrame({"id": "ship", "t": clock, "x": [5.0 * t for t in clock]})
    radar = pd.DataFrame({"id": 1, "t": range(0, 601, 10)}).assign(x=lambda rows: 5 * rows.t + 3.0)
    options = {"cutoff": 50, "switch_penalty": 10, "max_gap": 30}
    for clock_of in ({"resample": 10}, {"interpolate": "truth"}):
        with pytest.warns(UserWarning, match='ignore="truth-gaps" leaves these states out'):
            charged = evaluate(ship, radar, **options, **clock_of)
        assert charged.counts["false"] == 54
        found = evaluate(ship, radar, **options, **clock_of, ignore="truth-gaps")
        assert found.counts["false"] == 0
        assert found.ignored == {"truth_states": 54, "absorbed": 54.0, "excused": 0}
        far = evaluate(
            ship, radar.assign(x=radar.x + 60), **options, **clock_of, ignore="truth-gaps"
        )
        assert far.counts["false"] == 61


def test_the_reach_of_a_gap_grows_with_the_speed_that_is_allowed(tmp_path: Path) -> None:
    ship = pd.DataFrame({"id": "ship", "t": [0, 10, 110, 120], "x": [0.0, 10, 110, 120], "y": 0.0})
    radar = pd.DataFrame({"id": 1, "t": range(0, 121, 10)}).assign(x=lambda rows: 1.0 * rows.t)
    radar["y"] = 1.5 * (radar.t.clip(10, 110) - 10).combine(110 - radar.t.clip(10, 110), min)
    options = {"cutoff": 20, "switch_penalty": 5, "resample": 10, "max_gap": 10}
    found = [
        evaluate(ship, radar, **options, ignore="truth-gaps", max_speed=speed)
        for speed in (None, 0.6, 1.5)
    ]
    # 15, 30, 45, 60, 75, 60, 45, 30 and 15 off the line, 10 to 50 s from the nearer report
    assert [one.counts["false"] for one in found] == [7, 5, 0]
    assert max(found[2].table("assignments")["distance"]) == 75
    assert found[2].parameters["max_speed"] == 1.5
    iso = [
        side.assign(t=pd.Timestamp("2026-01-01") + pd.to_timedelta(side.t, unit="s"))
        for side in (ship, radar)
    ]
    clock = {"resample": "10s", "max_gap": "10s"}
    again = evaluate(*iso, **options | clock, ignore="truth-gaps", max_speed=0.6)
    assert again.counts == found[1].counts
    with pytest.raises(ConfigError, match="cannot hold a reach that grows"):
        found[2].proof.save(tmp_path / "proof")
    with pytest.raises(ConfigError, match="needs ignore"):
        evaluate(ship, radar, **options, max_speed=2)


@pytest.mark.parametrize("clock_of", [{"interpolate": "truth"}, {"resample": 1}])
def test_what_is_between_two_ignored_states_is_ignored(clock_of) -> None:
    """Beside gaps, of which there is none here, as without."""
    truth = pd.DataFrame({"id": [1, 1, 2, 2], "t": [0, 4] * 2, "x": [0.0, 0, 9, 9]})
    truth["class"] = ["Car", "Car", "Van", "Van"]
    estimate = pd.DataFrame({"id": 7, "t": range(5), "x": 0.0})
    options = {"cutoff": 2, "switch_penalty": 1, "max_gap": 10, **clock_of}
    for rules in (["class=Van"], ["class=Van", "truth-gaps"]):
        found = evaluate(truth, estimate, **options, ignore=rules)
        assert (found.total, found.ignored["truth_states"]) == (0, 5)


@pytest.mark.parametrize("empty", [0, 1])
@pytest.mark.parametrize("clock_of", [{"interpolate": "truth"}, {"resample": 1}])
def test_an_empty_side_has_no_gaps(clock_of, empty) -> None:
    sides = [pd.DataFrame({"id": 1, "t": [0, 5], "x": 0.0}) for _ in range(2)]
    sides[empty] = sides[empty].iloc[:0]
    options = {"cutoff": 2, "switch_penalty": 1, "max_gap": 1, **clock_of}
    found = evaluate(*sides, **options, ignore="truth-gaps", max_speed=1)
    assert found.total == 2 * 2


def test_other_metrics_are_without_what_is_not_judged() -> None:
    pytest.importorskip("trackeval")
    truth = pd.DataFrame({"id": 1, "t": range(10), "x": 0.0})
    other = truth.assign(id=2, x=50.0)
    estimate = pd.concat([truth, other])
    options = {"cutoff": 5, "switch_penalty": 1, "with_": "clear,identity"}
    both = pd.concat([truth.assign(ignored=0), other.assign(ignored=1)])
    found = evaluate(both, estimate, **options, ignore="marked")
    alone = evaluate(truth, truth, **options)
    assert found.with_ == alone.with_


def test_marks_of_trajectories(files) -> None:
    truth = pd.read_csv(files[0])
    side = Trajectories.from_array([[[0.0]], [[1.0]]], columns=("x",))
    assert not side.attributes
    found = evaluate(truth, truth, cutoff=4, switch_penalty=1, ignore=["class=Van", "occlusion>1"])
    assert found.ignored == {"truth_states": 4, "absorbed": 4.0, "excused": 0}


def test_a_rule_that_fits_nothing_is_told(files, invoke) -> None:
    """One recording of many may have no Bus: that is no error."""
    answer = invoke(*files, *METRIC[:-1], "--ignore", "class=Bus,Van")
    assert answer.status == 0
    assert '--ignore class=Bus,Van: no row of class "Bus"; there are Car, Van' in answer.err
    assert "no state fits" not in answer.err
    answer = invoke(*files, *METRIC[:-1], "--ignore", "occlusion>7")
    assert "--ignore occlusion>7: no state matches; all are evaluated" in answer.err


def test_several_rules_with_commas_are_those_of_a_list(files, invoke) -> None:
    rules = ["class=Van,Bus", "occlusion>1", "outside-truth-steps"]
    Path("s.toml").write_text(f"ignore = {json.dumps(rules)}\n", encoding="utf-8")
    asked = (ignoring(*rules), ("--ignore", ",".join(rules)), ("--config", "s.toml"))
    texts = [invoke(*files, *METRIC, *given, "--format", "json").out for given in asked]
    first, *others = map(json.loads, texts)
    assert first["parameters"]["ignore"] == rules
    for other in others:
        assert (other["total"], other["parameters"]) == (first["total"], first["parameters"])


def test_a_class_of_which_nothing_is_ignored_has_the_same_columns(files, invoke) -> None:
    """Pairs of each class say whether their truth is ignored."""
    rows = [f"{name},{t},{t},0,{name}" for name in ("car", "van") for t in range(3)]
    marks = ["ignored", *("01"[row.startswith("van")] for row in rows)]
    table = "\n".join(map(",".join, zip(["id,t,x,y,class", *rows], marks, strict=True)))
    Path("t.csv").write_text(table + "\n", encoding="utf-8")
    Path("e.csv").write_text("id,t,x,y,class\n" + "\n".join(rows) + "\n", encoding="utf-8")
    answer = invoke("t.csv", "e.csv", *METRIC, "--ignore", "marked", "--by", "class", "-o", "out")
    assert answer.status == 0, answer.err
    pairs = pd.read_csv("out/assignments.csv")
    assert pairs.groupby("class")["ignored"].unique().map(list).to_dict() == {
        "car": [0],
        "van": [1],
    }


def test_a_zone_of_both_sides_has_no_jump_at_its_edge(invoke) -> None:
    """Truths inside are ignored, estimates excused; one outside may be followed from inside."""
    zone = pd.DataFrame({"left": [0.0], "top": [0.0], "width": [100.0], "height": [10.0]})
    asked = {"cutoff": 10, "switch_penalty": 1, "ignore_regions": zone}
    asked["ignore"] = "in-regions"

    def total(truth: float | None, estimate: float | None) -> float:
        """Of one object and one track at heights above or below the edge at 10."""
        sides = (
            pd.DataFrame({"id": "a", "t": [0], "x": [50.0], "y": [place]})[: int(place is not None)]
            for place in (truth, estimate)
        )
        return evaluate(*sides, **asked).total

    assert total(5.0, None) == 0
    assert total(None, 5.0) == 0
    assert total(5.0, 8.0) == 0
    assert total(15.0, None) == total(None, 15.0) == 50
    assert total(12.0, 9.0) == pytest.approx(9)  # followed from inside
    assert total(12.0, 9.999) == pytest.approx(total(12.0, 10.001), abs=0.01)
    assert total(9.999, 12.0) == 0  # an ignored truth is followed at no cost
    assert total(9.0, 30.0) == 50
    answer = invoke("evaluate", "a.csv", "b.csv", "--ignore", "in-regions")
    assert (answer.status, "needs --ignore-regions FILE" in answer.err) == (2, True)
