"""The verbs as functions: what they give is what the command prints and writes."""

import inspect
import json
import os
import pkgutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from checkout import SAMPLES
from runs import write_runs

import tgospa_eval
from tgospa_eval import (
    Certified,
    ConfigError,
    InputError,
    TgospaWarning,
    associate,
    batch,
    compare,
    evaluate,
    gate,
    simulate,
    verify,
)
from tgospa_eval.api.keywords import OF_THE_COMMAND
from tgospa_eval.api.options import OPTION_SPECS
from tgospa_eval.cli.simulate import OPTIONS
from tgospa_eval.distances import Mahalanobis
from tgospa_eval.quoting import option
from tgospa_eval.simulation.settings import DEFAULT_ERRORS, default_tracker

TRUTHS, ESTIMATES = ("truth", "gt"), ("estimate", "res")
METRIC = ("-c", "10", "-g", "5")
GIVEN = {"cutoff": 10.0, "switch_penalty": 5.0}


def test_no_folder_takes_the_name_of_a_function() -> None:
    """It would, as soon as something in it is imported."""
    modules = {module.name for module in pkgutil.iter_modules(tgospa_eval.__path__)}
    assert not modules & set(tgospa_eval.__all__)
    functions = [getattr(tgospa_eval, name) for name in tgospa_eval.__all__ if name.islower()]
    for function in filter(inspect.isroutine, functions):
        described = inspect.getdoc(function) or ""
        named = [n.rstrip("_") for n in inspect.signature(function).parameters]
        assert [name for name in named if name not in described] == []


def test_every_option_is_a_keyword() -> None:
    named = {name for name in OPTION_SPECS if name not in OF_THE_COMMAND}
    for function in (evaluate, gate):
        assert named <= inspect.signature(function).parameters.keys()
    with pytest.raises(TypeError, match=r"evaluate\(\) has no keyword cutof; did you mean cutoff"):
        evaluate([], [], cutof=3)
    for name, meant in {
        "gamma": "switch_penalty",
        "c": "cutoff",
        "p": "order",
        "g": "switch_",
    }.items():
        with pytest.raises(TypeError, match=f"no keyword {name}; did you mean {meant}"):
            evaluate([], [], **{name: 3.0})
    with pytest.raises(ConfigError, match='grid is "both": must be one of union, truth'):
        evaluate([], [], grid="both")
    with pytest.raises(ConfigError, match="region is 3: must be a text"):
        evaluate([], [], region=3)
    with pytest.raises(ConfigError, match="time is for files and tables, and truth is neither"):
        evaluate({"a": np.zeros((2, 2))}, [], time="0:1")
    with pytest.raises(ConfigError, match='with_ cannot be combined with by="class"'):
        evaluate([], [], by="class", with_="gospa")
    with pytest.raises(ConfigError, match="similarity is not supported with step"):
        evaluate([], [], similarity=1, step_weights=[1.0])
    with pytest.raises(ConfigError, match=r"scale is for .*, not for a distance given as a record"):
        evaluate([], [], distance=Mahalanobis(covariance=np.eye(2)), scale="x=2")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"columns": "x"}, "columns is for files and tables, and truth is neither"),
        ({"decimal": ","}, "decimal is for files and tables"),
        ({"estimate_columns": "x"}, "estimate_columns is for files and tables, and estimate is"),
        ({"solver": Certified(), "gap": 0.1}, "gap is for a solver given by name"),
        ({"fix_cov": "no"}, "fix_cov is 'no': must be True or False"),
        ({"max_input": "much"}, "max_input is 'much': must be a number"),
        ({"max_input": -1}, "max_input is -1: must be 0 or more"),
        ({"cloud_order": 0}, "cloud_order is 0: must be 1 or more"),
        ({"cloud_order": 3}, "cloud_order is 3: must be 2 or less"),
        ({"class_": 3}, "class is 3: must be a text, or several"),
        ({"columns": ["x", 3]}, "columns is .*: must be a text, or several"),
        ({"cutoff": [10]}, "cutoff is .10.: must be a number"),
        ({"max_gap": np.array([2, 3])}, "max-gap is array"),
        ({"missing_cov": "zero"}, "missing_cov is for gaussian-wasserstein and NEES, not for"),
    ],
)
def test_wrong_keywords(options: dict[str, object], said: str) -> None:
    side = {"a": np.zeros((2, 2))}
    with pytest.raises(ConfigError, match=said):
        evaluate(side, side, **options)


def test_arrays_and_sets_as_values(quickstart: tuple[str, str]) -> None:
    plain = evaluate(*quickstart, **GIVEN)
    boxed = evaluate(*quickstart, cutoff=np.array(10.0), switch_penalty=np.array(5.0))
    assert boxed.total == plain.total
    assert evaluate(*quickstart, **GIVEN, with_={"gospa"}).with_.keys() == {"gospa"}
    names = evaluate(*quickstart, **GIVEN, columns=pd.Index(["x", "y"]))
    assert names.total == plain.total
    with pytest.raises(ConfigError, match="no table"):
        plain.table("nope")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("quickstart", {"cutoff": 10, "time": "2:9", "region": "x=0:60"}),
        ("quickstart", {"curve": True, "window": 5, "every": 2, "similarity": 1.0}),
        ("quickstart", {"resample": 0.5, "max_gap": (3, 2), "columns": ["y"]}),
        ("quickstart", {"slices": ["range=0:50:100", "age=0:3"], "with_": ["gospa"]}),
        ("quickstart", {"time_offset": 1, "unit_scale": 1.1, "steps": "3:9:2", "rho": 0.4}),
        ("quickstart", {"solver": "sinkhorn", "epsilon": 0.1, "gap": 0.5}),
        ("quickstart", {"periodic": "x=90", "scale": "y=2", "unit": "m"}),
        ("motchallenge", {"distance": "iou", "preprocess": "motchallenge"}),
        ("kitti", {"distance": "iou", "by": "class", "on_invalid": "drop"}),
        ("clouds", {"distance": "cloud-wasserstein", "reduce": 3, "seed": 1}),
        ("gaussian", {"distance": "gaussian-wasserstein", "fix_cov": True}),
    ],
)
@pytest.mark.filterwarnings("ignore::tgospa_eval.TgospaWarning")
def test_python_and_the_command_make_one_document(
    invoke, name: str, options: dict[str, object]
) -> None:
    found = sorted((SAMPLES / name).iterdir())
    pair = [str(next(p for p in found if p.stem in stems)) for stems in (TRUTHS, ESTIMATES)]
    typed = []
    for field, value in options.items():
        flag = f"--{OPTION_SPECS[field].key}"
        several = value if isinstance(value, list) and field == "slices" else [value]
        for one in several:
            text = ",".join(map(str, one)) if isinstance(one, list | tuple) else str(one)
            typed += [flag] if one is True else [flag, text]
    shown = invoke(*pair, *typed, "--format", "json")
    theirs = json.loads(shown.out)
    ours = json.loads(evaluate(*pair, **options).to_json())
    for document in (theirs, ours):
        for part in (document, *document.get("by_class", {}).values()):
            del part["timings"]
        for warning in document["warnings"]:
            warning["remedy"] = ""  # each in its own words
        document["notices"] = len(document["notices"])
    assert ours == theirs


def test_compare_ranks(invoke, quickstart: tuple[str, str]) -> None:
    truth, estimate = quickstart
    shifted = np.asarray(tgospa_eval.read_trajectories(estimate).dense()) + 3.0
    with pytest.warns(TgospaWarning):  # of the empty one, by its name
        found = compare(truth, {"far": {}, "near": estimate}, **GIVEN)
    assert found.table()["name"].tolist() == ["near", "far"]
    assert found.table()["total"][0] == pytest.approx(evaluate(*quickstart, **GIVEN).total)
    assert found.comparisons["verdict"].tolist() == ["less"]
    assert "Proven order of these files by TGOSPA per step, best first: near, far" in str(found)
    assert "tgospa-eval" not in repr(found)
    assert json.loads(found.to_json()) == json.loads(json.dumps(found.to_dict()))
    times = tgospa_eval.read_trajectories(estimate).times
    late = compare(truth, [estimate], **GIVEN, time_offset=1.0, interpolate="estimate", max_gap=2.0)
    there = evaluate(*quickstart, **GIVEN, time_offset=1.0, interpolate="estimate", max_gap=2.0)
    assert late.table()["total"][0] == pytest.approx(there.total)
    assert late.document["parameters"]["time_offset"] == 1.0
    three = compare(truth, {"a": estimate, "b": (times, shifted), "c": {}}, **GIVEN)
    assert {notice["code"] for notice in three.document["warnings"]} >= {"offset", "empty-side"}
    assert len(three.comparisons) == 3
    for name, by in (("b", 3.0), ("c", 6.0)):
        rows = pd.read_csv(estimate).assign(x=lambda table, by=by: table["x"] + by)
        rows.to_csv(f"{name}.csv", index=False)
    shown = invoke("compare", truth, estimate, "b.csv", "c.csv", *METRIC, "--format", "json")
    theirs, ours = json.loads(shown.out), compare(truth, [estimate, "b.csv", "c.csv"], **GIVEN)
    for item, own in zip(theirs["estimates"], ours.to_dict()["estimates"], strict=True):
        assert {**own, "name": item["name"], "runs": item["runs"]} == item
    assert [pair["per_step"] for pair in theirs["pairs"]] == [
        pair["per_step"] for pair in ours.to_dict()["pairs"]
    ]


def test_compare_solvers(quickstart: tuple[str, str]) -> None:
    found = compare(*quickstart, **GIVEN, solvers=["certified", "sinkhorn"])
    assert found.table()["name"].tolist() == ["certified", "sinkhorn 0.03"]
    assert found.document["agree"]
    assert not len(found.comparisons)
    assert "Both brackets overlap" in str(found)


def test_gate_and_the_command_know_each_other(
    invoke, quickstart: tuple[str, str], tmp_path: Path
) -> None:
    ours, theirs = str(tmp_path / "ours.json"), str(tmp_path / "theirs.json")
    none = gate(*quickstart, ours, **GIVEN)
    assert (none.verdict, bool(none)) == ("not comparable", False)
    assert gate(*quickstart, ours, update_baseline=True, **GIVEN).verdict == "updated"
    made = invoke("gate", *quickstart, *METRIC, "--baseline", theirs, "--update-baseline")
    assert made.status == 0
    for baseline in (ours, theirs):  # cutoff and penalty are those of the baseline
        passed = gate(*quickstart, baseline, limits={"tgospa": 43.0}, warn_on="switch:+1")
        assert passed
        assert passed.findings["verdict"].tolist() == ["pass"] * 3
        assert passed.result.total == evaluate(*quickstart, **GIVEN).total
        assert invoke("gate", *quickstart, "--baseline", baseline).status == 0
    with pytest.warns(TgospaWarning) as told:
        failed = gate(quickstart[0], {}, Path(theirs))
    assert {warning.filename for warning in told} == {__file__}  # where the user can do something
    assert failed.verdict == "fail"
    assert any("total is at least 9,750 (proven)" in note for note in failed.notes)
    other = gate(*quickstart, theirs, cutoff=9.0)
    assert other.notes == ("cutoff is 9.0, in the baseline 10.0",)
    assert str(other).startswith("gate: not comparable")
    undecided = gate(
        *quickstart, theirs, solver=tgospa_eval.Sinkhorn(epsilon=0.5, gap=0.9), fail_on="total:+1%"
    )
    assert undecided.verdict in ("undecided", "pass")
    assert not any("--" in note for note in undecided.notes)
    with pytest.raises(ConfigError, match='fail_on "total": must be'):
        gate(*quickstart, theirs, fail_on="total")
    with pytest.raises(ConfigError, match="is not a baseline"):
        gate(*quickstart, quickstart[0])


@pytest.mark.parametrize("kind", ["ignore_regions", "region"])
def test_a_baseline_names_files_from_its_own_folder(
    invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    Path("sub/area.csv").write_text("left,top,width,height\n-5,-5,50,50\n", encoding="utf-8")
    for name, rows in (("truth", "1,0,0,0\n"), ("estimate", "1,0,0,1\n2,0,9,0\n")):
        Path(f"{name}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")
    pair = ("truth.csv", "estimate.csv")
    given = {kind: Path("sub/area.csv")} if kind == "ignore_regions" else {kind: "sub/area.csv"}
    made = gate(*pair, "sub/ours.json", update_baseline=True, **GIVEN, **given)
    assert made.verdict == "updated"
    option = (f"--{kind.replace('_', '-')}", "sub/area.csv", "--baseline", "sub/theirs.json")
    assert invoke("gate", *pair, *METRIC, *option, "--update-baseline").status == 0
    assert Path("sub/ours.json").read_text() == Path("sub/theirs.json").read_text()
    Path("area.csv").write_text("left,top,width,height\n90,90,1,1\n", encoding="utf-8")
    assert gate(*pair, "sub/theirs.json")
    assert invoke("gate", *pair, "--baseline", "sub/ours.json").status == 0


def test_fixed_limits_need_no_baseline(quickstart: tuple[str, str]) -> None:
    assert gate(*quickstart, limits={"tgospa": 50.0}, **GIVEN)
    assert gate(*quickstart, limits={"tgospa": 5.0}, **GIVEN).verdict == "fail"
    with pytest.raises(ConfigError, match="no baseline: give one with baseline; total"):
        gate(*quickstart, limits={"tgospa": 5.0}, fail_on="total:+1%", **GIVEN)


def test_verify(quickstart: tuple[str, str], tmp_path: Path) -> None:
    folder = tmp_path / "proof"
    evaluate(*quickstart, **GIVEN).proof.save(folder)
    found = verify(folder)
    assert found
    assert verify(tmp_path).claims == found.claims  # the folder that it is in
    assert str(found).startswith(f"{folder}: verified: 42.535")
    document = json.loads((folder / "proof.json").read_text())
    document["upper_bound"] = "1.0"
    (folder / "proof.json").write_text(json.dumps(document))
    assert not verify(folder)
    with pytest.raises(InputError, match=r"no proof.json in it"):
        verify(quickstart[0].rpartition("/")[0])


def test_simulate_as_the_command(invoke, tmp_path: Path) -> None:
    defaults = {item.name: item.default for item in OPTIONS}
    assert {name: defaults[name] for name in DEFAULT_ERRORS} == DEFAULT_ERRORS
    usual = default_tracker(200.0, {})
    for name in ("confirmation", "merges", "lost", "latency"):
        assert getattr(usual, name) == defaults[name]
    assert usual.false_length == tuple(map(int, str(defaults["false_length"]).split(":")))
    folder = str(tmp_path / "scene")
    assert invoke("simulate", folder, "--targets", "4", "--seed", "3").status == 0
    files = [os.path.join(folder, name) for name in ("truth.csv", "estimate.csv")]
    made = simulate(targets=4, seed=3)
    assert evaluate(*made, **GIVEN).total == pytest.approx(evaluate(*files, **GIVEN).total)
    with pytest.raises(ConfigError, match="'noize' is not an error of a tracker; use noise, "):
        simulate(noize=1.0)


def test_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    write_runs(2)
    patterns = {"truth": "gt/{run}.csv", "estimate": "out/{tracker}/{run}.csv"}
    found = batch(**patterns, output="store", workers=1, cutoff=10.0, by="tracker", with_="gospa")
    assert found.rows["total"].tolist() == pytest.approx([5.0, 5.0, 20.0, 20.0])
    assert found.groups["total"].tolist() == pytest.approx([10.0, 40.0])
    assert not found.faults
    assert found.rows["with.gospa.total"].tolist() == pytest.approx([5.0, 5.0, 20.0, 20.0])
    assert "tracker" in str(found)
    Path("out/b/1.csv").write_text("id,t,x,y\n1,0,0,oops\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r'^output="store": has a batch with other settings'):
        batch(**patterns, output="store", workers=1, cutoff=9.0)
    again = batch(**patterns, output="store", workers=1, cutoff=10.0, with_=["gospa"])
    assert len(again.faults) == 1
    assert "oops" in again.faults[0]
    with pytest.raises(TypeError, match=r"batch\(\) has no keyword cutof; did you mean cutoff"):
        batch(**patterns, output="store", cutof=10.0)


def test_limits_of_a_gate_are_a_mapping(quickstart: tuple[str, str]) -> None:
    with pytest.raises(TypeError, match="limits is 'total:43': must be a mapping"):
        gate(*quickstart, {}, limits="total:43")  # type: ignore[arg-type]


def test_a_message_that_proposes_a_filter_can_be_pasted(tmp_path: Path) -> None:
    rows = "".join(f"{one},{t},{t},0\n" for t in range(3) for one in (1, -1, -1))
    (tmp_path / "a.csv").write_text(f"id,t,x,y\n{rows}")
    with pytest.raises(InputError, match=r'truth_where="id != -1" leaves such rows out'):
        evaluate(tmp_path / "a.csv", tmp_path / "a.csv")
    assert option("where", 'class == "car"') == "where='class == \"car\"'"


def test_everything_public_prints_as_a_short_table_or_a_sentence() -> None:
    truth, estimate = tgospa_eval.simulate(targets=3, steps=20, seed=1, state="gaussian")
    result = evaluate(truth, estimate, 10.0, with_="nees", slices="range=0:50:100")
    made = associate(truth, estimate, 10.0)
    explained = result.explain()
    public = [result, result.nees, result.proof, made, explained, explained.repairs[0]]
    for one in (*public, *result.slices("range=0:50"), truth, tgospa_eval.Recorder()):
        for text in (str(one), repr(one)):
            assert len(text) < 700
            assert "array(" not in text
            assert "object at" not in text
    assert str(result.nees).startswith("NEES 1.672 where 2 is expected")
    assert str(made).splitlines()[0] == "53 associated, 7 of A and 6 of B unassociated, in 20 steps"
    assert str(made).splitlines()[-1] == "and 56 more; all of them: associations"


def test_an_association_has_its_tables_as_other_results_have() -> None:
    made = associate({"a": [[0.0, 0.0]]}, {"b": [[0.0, 1.0]], "c": [[9.0, 9.0]]}, 5.0)
    assert made.table("associations") == made.associations_table()
    assert made.associations["id_b"].tolist() == ["b", "c"]
    assert made.costs["associated"].tolist() == [1]
    with pytest.raises(ConfigError, match=r"no table .pairs.; there are associations, costs"):
        made.table("pairs")
    with pytest.raises(InputError, match="cross-covariances need particles"):
        print(made.cross_covariances)
