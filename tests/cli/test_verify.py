"""Proof folders as users meet them: written with a result, checked again, by the script alone."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest
from answer import Invoke, Write
from browser import PATIENCE
from checkout import SAMPLES

from tgospa_eval import SolverError, evaluate, verify
from tgospa_eval.api.options import OF_THE_NUMBER
from tgospa_eval.distances import DISTANCES
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof import write as write_module

QUICK = tuple(str(SAMPLES / "quickstart" / f"{name}.csv") for name in ("truth", "estimate"))
KITTI = tuple(str(SAMPLES / "kitti" / f"{name}.txt") for name in ("gt", "res"))
CLOUDS = tuple(str(SAMPLES / "clouds" / f"{name}.csv") for name in ("truth", "estimate"))


@pytest.mark.parametrize(
    ("files", "options", "folders"),
    [
        (QUICK, ("-c", "10", "-g", "5"), [""]),
        (QUICK, ("-p", "1.7", "--grid", "common", "--time", "10:40", "--solver", "sinkhorn"), [""]),
        (QUICK, ("--periodic", "x=360", "--scale", "y=2", "-p", "3"), [""]),
        (KITTI, ("--distance", "iou", "--by", "class"), ["/Car"]),
        (CLOUDS, ("--distance", "cloud-wasserstein", "--reduce", "5"), [""]),
        (CLOUDS, ("--distance", "max-sliced-wasserstein", "--directions", "9"), [""]),
    ],
    ids=["plain", "filtered", "periodic", "classes", "clouds", "sliced"],
)
def test_from_files_to_a_verdict(
    invoke: Invoke, files: tuple[str, str], options: tuple[str, ...], folders: list[str]
) -> None:
    assert invoke(*files, *options, "-o", "r", "--proof", "-q").status in (0, 4)
    answer = invoke("verify", "r", *files)
    assert answer.status == 0
    lines = answer.out.splitlines()
    assert [line.partition(":")[0] for line in lines] == [f"r/proof{name}" for name in folders]
    assert all("; the tables follow from the files" in line for line in lines)
    # A verdict on a part of the files says of which.
    for option in ("--grid", "--time"):
        assert all((f", {option} '" in line) == (option in options) for line in lines)
    assert all((", class 'Car'" in line) == ("--by" in options) for line in lines)
    # Written anew, by another run.
    assert invoke(*files, *options, "-o", "r", "-q").status in (0, 4)
    assert not Path("r/proof").exists()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the result of the quickstart is kept once it is made."""
    return tmp_path_factory.mktemp("kept") / "r"


@pytest.fixture
def quick(invoke: Invoke, kept: Path) -> None:
    """A result of the quickstart with its proof, in the folder r."""
    if not kept.exists():
        call = (*QUICK, "-c", "10", "-g", "5", "-o", str(kept), "--proof", "-q")
        assert invoke(*call).status == 0
    shutil.copytree(kept, "r")


@pytest.mark.usefixtures("quick")
def test_the_script_alone_gives_the_same_verdict(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "verify_tgospa.py").write_text(invoke("verify", "--script").out, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-I", "-S", "verify_tgospa.py", "r/proof"],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    )
    assert done.stdout == invoke("verify", "r/proof").out
    assert "42.535161525495588 <= TGOSPA <= 42.535161525495589" in done.stdout


@pytest.mark.usefixtures("quick")
def test_what_does_not_hold(invoke: Invoke, write: Write) -> None:
    other = invoke("verify", "r", QUICK[0], QUICK[0])
    assert other.status == 1
    assert "estimate.csv does not follow from" in other.err
    assert "line 2 is '105,5,9.082,130.631', must be '5,3,12.455,136.513'" in other.err
    path = Path("r/proof/proof.json")
    document = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(document | {"upper_bound": "1809"}), encoding="utf-8")
    answer = invoke("verify", "r")
    assert (answer.status, answer.out) == (1, "")
    assert "<= total <= 1809 is not proven, only" in answer.err
    path.write_text(json.dumps(document | {"options": {"colour": 1}}), encoding="utf-8")
    answer = invoke("verify", "r", *QUICK)
    assert answer.status == 3
    assert "options has an unknown 'colour'" in answer.err
    evaluate(*QUICK).proof.save("p")
    answer = invoke("verify", "p", *QUICK)
    assert answer.status == 3
    assert "p: does not record how the files were read" in answer.err


def test_names_and_times_of_all_kinds(invoke: Invoke, write: Write) -> None:
    """Line ends in ids, times a few nanoseconds apart, classes like folders, or long."""
    ids = ("'a\rb'", "'c\nd'", "' e'")
    classes = ("..", ".", "日" * 100, "a/b", "")
    rows = "".join(
        f"{ids[k % 3]},2024-01-01T00:00:00.{100 * k:09d},{k},{name}\n".replace("'", '"')
        for k, name in enumerate(classes * 2)
    )
    write("t.csv", f"id,t,x,class\n{rows}")
    for options, many in ((("--by", "class"), len(classes)), ((), 1)):
        # The second in place of the first.
        assert invoke("t.csv", "t.csv", *options, "-o", "r", "--proof", "-q").status == 0
        assert {path.name for path in Path().iterdir()} == {"t.csv", "r"}
        answer = invoke("verify", "r", "t.csv", "t.csv")
        assert (answer.status, answer.err) == (0, "")
        assert answer.out.count("verified: 0 <= TGOSPA <= 0, 0 <= total <= 0; ") == many


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"covariance": [[4.0]]}, "the parameter covariance is [[4.0]], must be [[1.0]]"),
        ({"order": "3.0"}, "the parameter order is '3.0', must be '2.0'"),
        ({"scale": {"x": "0.1"}}, "the parameter scale is {'x': '0.1'}, must be None"),
        ({}, "a, b at t = 0 is 10.0, must be 3.0"),
    ],
)
def test_parameters_and_distances_that_do_not_follow_from_the_files(
    invoke: Invoke, write: Write, changes: dict[str, Any], message: str
) -> None:
    """A proof that holds, but of something else: no pair is near."""
    files = write("t.csv", "id,t,x\na,0,0\n"), write("e.csv", "id,t,x\nb,0,3\n")
    write("c.csv", "1\n")
    metric = ("--distance", "mahalanobis", "--covariance", "c.csv", "-c", "10")
    assert invoke(*files, *metric, "-o", "r", "--proof", "-q").status == 0
    table, path = Path("r/proof/distances.csv"), Path("r/proof/proof.json")
    table.write_text("truth,estimate,t,distance\n", encoding="utf-8")
    proof = json.loads(path.read_text(encoding="utf-8"))
    proof |= {
        "lower_bound": "0",
        "upper_bound": "9999",
        "parameters": proof["parameters"] | changes,
    }
    proof["sha256"]["distances.csv"] = hashlib.sha256(table.read_bytes()).hexdigest()
    path.write_text(json.dumps(proof), encoding="utf-8")
    assert invoke("verify", "r").status == 0
    answer = invoke("verify", "r", *files, "--covariance", "c.csv")
    assert answer.status == 1
    assert message in answer.err


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("verify",), 2, "name a proof folder, or --script"),
        (("verify", "r", "--script"), 2, "--script takes no folder"),
        (("verify", "r", QUICK[0]), 2, "name both files"),
        (("verify", "nowhere"), 3, "nowhere: there is no proof.json in it"),
        (("verify", QUICK[0]), 3, "is a file; name the folder that it is in"),
        ((*QUICK, "--proof"), 2, "--proof needs -o DIR"),
        (
            (*QUICK, "--proof", "--sweep", "c=1,2", "-o", "r"),
            2,
            "--proof is not supported with --sweep",
        ),
    ],
)
def test_wrong_usage(invoke: Invoke, arguments: tuple[str, ...], status: int, message: str) -> None:
    answer = invoke(*arguments)
    assert answer.status == status
    assert message in answer.err
    assert answer.out == ""


def test_gate_writes_the_proofs_of_baseline_and_run(invoke: Invoke) -> None:
    metric = ("--baseline", "b.json", "--proof", "proofs", "-q")
    assert invoke("gate", *QUICK, "-c", "10", "-g", "5", "--update-baseline", *metric).status == 0
    assert invoke("gate", *QUICK, *metric).status == 0
    for name in ("baseline", "run"):
        answer = invoke("verify", f"proofs/{name}", *QUICK)
        assert answer.status == 0
        assert "1809.2399660000001 <= total" in answer.out


def test_gate_suite_has_a_proof_for_each_pair(invoke: Invoke, write: Write) -> None:
    pairs = "".join(
        f"[[pair]]\nname = \"{name}\"\ntruth = '{QUICK[0]}'\nestimate = '{QUICK[1]}'\n"
        for name in ("a/b", "c")
    )
    write("s.toml", f'baseline = "b.json"\n{pairs}')
    assert invoke("gate", "--suite", "s.toml", "--update-baseline", "--proof", "p").status == 0
    assert sorted(path.name for path in Path("p/baseline").iterdir()) == ["a%2Fb", "c"]
    assert len(invoke("verify", "p/baseline").out.splitlines()) == 2


def test_large_coordinates_are_told(invoke: Invoke, write: Write) -> None:
    for name, error in (("t.csv", 0), ("e.csv", 0.3)):
        rows = "".join(f"a,{k},{10**9 + k + error:.1f},{0.1 * k:.1f}\n" for k in range(20))
        write(name, f"id,t,x,y\n{rows}")
    (warning,) = json.loads(invoke("t.csv", "e.csv", "-c", "9", "--format", "json", "-q").out)[
        "warnings"
    ][:1]
    assert warning["code"] == "rounded-coordinates"
    assert "are 1.2e-07 apart: digit 8 of the total" in warning["text"]


@pytest.mark.parametrize(
    ("numbers", "apart"),
    [(("1e16", "10000000000000003"), "2"), (("9007199254740992", "9007199254740993"), "2")],
)
def test_integers_that_no_double_holds_are_told(
    invoke: Invoke, write: Write, numbers: tuple[str, str], apart: str
) -> None:
    for name, number in zip(("t.csv", "e.csv"), numbers, strict=True):
        write(name, f"id,t,x\na,0,{number}\na,1,{number}\n")
    told = invoke("t.csv", "e.csv", "-c", "10", "-g", "1").err
    assert f"are {apart} apart: finer digits of coordinates are lost" in told
    assert "exactly the states" not in told


def test_a_class_without_its_proof_is_missed(invoke: Invoke, write: Write) -> None:
    rows = [f"{name},{k},{k},0,{name}\n" for name in ("bus", "car") for k in range(3)]
    for name, own in (("t.csv", rows), ("e.csv", rows[:1] + rows[2:])):
        write(name, f"id,t,x,y,class\n{''.join(own)}")
    asked = ("--by", "class", "--resample", "1", "--max-gap", "2")  # one period for all classes
    assert invoke("t.csv", "e.csv", *asked, "-o", "r", "--proof", "-q").status == 0
    assert invoke("verify", "r", "t.csv", "e.csv").status == 0
    for path in Path("r/proof/bus").iterdir():
        path.unlink()
    answer = invoke("verify", "r")
    assert answer.status == 1
    assert "r: there is no proof of the class 'bus'" in answer.err
    car = Path("r/proof/car/proof.json")
    document = json.loads(car.read_text())
    for changes in ({"classes": ["car"]}, {"classes": []}, {"class": "tram"}):
        car.write_text(json.dumps(document | changes))
        answer = invoke("verify", "r/proof/car", "t.csv", "e.csv")
        assert answer.status == 1
        assert "classes: are" in answer.err or changes.get("class")  # its tables differ
    assert invoke("t.csv", "e.csv", "-o", "s", "--proof", "-q").status == 0
    whole = Path("s/proof/proof.json")
    whole.write_text(json.dumps(json.loads(whole.read_text()) | {"classes": ["bus", "car"]}))
    answer = invoke("verify", "s", "t.csv", "e.csv")
    assert (answer.status, "must be of []" in answer.err) == (1, True)


def test_scenes_in_which_nothing_of_a_side_is_judged(invoke: Invoke, write: Write) -> None:
    write("t.csv", "id,t,x,ignored\n2,0,0,1\n2,1,0,1\n1,2,0,1\n2,2,2,1\n")
    write("e.csv", "id,t,x\n3,0,1\n0,1,1\n2,2,2\n")
    write("u.csv", "id,t,x,excused\n3,0,1,1\n0,1,1,1\n2,2,2,1\n")
    metric = ("-c", "10", "-p", "3", "-g", "0.1", "--columns", "x")
    for truth, estimate, rho, ignored, excused in (
        ("t.csv", "e.csv", "0.5", 4, 0),
        ("t.csv", "e.csv", "0.2", 4, 0),
        ("e.csv", "u.csv", "0.3", 0, 3),
        ("t.csv", "u.csv", "0.9", 4, 3),
    ):
        rules = ["marked"] * (truth == "t.csv") + ["marked-estimates"] * (estimate == "u.csv")
        asked = (*metric, "--ignore", ",".join(rules), "--rho", rho)
        answer = invoke(truth, estimate, *asked, "-o", "r", "--proof", "-q")
        assert answer.status == 0, answer.err
        answer = invoke("verify", "r", truth, estimate)
        assert answer.status == 0, answer.err
        many = 4 if truth == "t.csv" else 3
        what = f"not judged: {ignored} of {many} truth states, {excused} of 3 estimate states; "
        assert what in answer.out


def test_a_folder_that_does_not_prove_its_claim_is_not_written(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_module, "estimate_prices", lambda *_: Counter({(0, 0): 1 << 99}))
    answer = invoke(*QUICK, "-o", "r", "--proof", "-q")
    assert answer.status == 4
    assert "the proof folder does not prove the bounds of this result, the claim" in answer.err
    assert "is not proven, only" in answer.err
    assert not Path("r").exists()
    with pytest.raises(SolverError, match="is not proven, only"):
        evaluate(*QUICK).proof.save("p")
    assert not Path("p").exists()


@pytest.mark.usefixtures("quick")
def test_what_a_proof_says_of_the_files_is_checked(invoke: Invoke) -> None:
    file = Path("r/proof/proof.json")
    good = file.read_text(encoding="utf-8")
    for path, value in (
        (("judged", "steps"), 61),
        (("judged", "truth_states"), 1),
        (("judged", "truth_sha256"), "0" * 64),
        (("judged", "first"), "1"),
        (("inputs", "truth", "sha256"), "0" * 64),
        (("inputs", "estimate", "sha256"), "0" * 64),
    ):
        document = json.loads(good)
        place = document
        for name in path[:-1]:
            place = place[name]
        right, place[path[-1]] = place[path[-1]], value
        file.write_text(json.dumps(document), encoding="utf-8")
        if path[-1] == "steps":
            assert invoke("verify", "r").status == 0  # no part of what is proven
        answer = invoke("verify", "r", *QUICK)
        assert answer.status == 1
        assert f"is {value!r}, must be {right!r} by" in answer.err
        assert answer.err.startswith(f"r/proof: {path[0]}, ")


# --- what a verdict says, of folders that somebody else wrote -------------------------------------

MOT = tuple(str(SAMPLES / "motchallenge" / f"{name}.txt") for name in ("gt", "res"))
GAUSSIANS = tuple(str(SAMPLES / "gaussian" / f"{name}.csv") for name in ("truth", "estimate"))
GAUSSIAN = ("--distance", "gaussian-wasserstein")

COAST = tuple(str(SAMPLES / "coast" / f"{name}.csv") for name in ("ais", "radar"))
SAID = {
    "truth_crs": "lat,lon",
    "estimate_crs": "ned",
    "origin": "55.6,12.8",
    "truth_time_format": "%d/%m/%Y %H:%M:%S",
    "estimate_time_format": "s",
    "truth_time_zone": "UTC",
}


def of_coast(name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The files of a coast with one of the options that they need in front of the others."""
    others = ((f"--{other.replace('_', '-')}", value) for other, value in SAID.items())
    return COAST, (SAID[name], *(part for pair in others if name not in pair[0].replace("-", "_")
                                 for part in pair))  # fmt: skip


SMALL = ("small.csv", "small.csv")
NAMED: dict[str, tuple[tuple[str, str], tuple[str, ...]]] = {
    "columns": (SMALL, ("x",)),
    "truth_columns": (SMALL, ("x,y",)),
    "estimate_columns": (SMALL, ("x,y",)),
    "truth_format": (SMALL, ("csv",)),
    "estimate_format": (SMALL, ("csv",)),
    "time_tolerance": (SMALL, ("0.25",)),
    "grid": (SMALL, ("common",)),
    "interpolate": (SMALL, ("estimate", "--max-gap", "2")),
    "max_gap": (SMALL, ("2", "--interpolate", "truth")),
    "steps": (SMALL, ("3:50",)),
    "resample": (SMALL, ("0.5", "--max-gap", "3")),
    "period": (SMALL, ("2", "--resample", "1", "--max-gap", "3")),
    "outage": (SMALL, ("9", "--interpolate", "truth", "--max-gap", "2")),
    "time_offset": (SMALL, ("1",)),
    "time_scale": (SMALL, ("2",)),
    "unit_scale": (SMALL, ("1.5",)),
    "on_duplicate": (SMALL, ("first",)),
    "on_invalid": (SMALL, ("drop",)),
    "decimal": (("t.csv", "t.csv"), (",",)),
    "time": (SMALL, ("3:9",)),
    "class_": (KITTI, ("Car", "--distance", "iou")),
    "truth_class": (KITTI, ("Car", "--distance", "iou")),
    "estimate_class": (KITTI, ("Car", "--distance", "iou")),
    "region": (SMALL, ("x=0:50",)),
    **{f"{side}where": (SMALL, ("x >= 0",)) for side in ("", "truth_", "estimate_")},
    "day_begins": (SMALL, ("43200",)),
    "ignore_regions": (SMALL, ("r.csv",)),
    "ignore": (SMALL, ("x>50",)),
    "truth_scale": (SMALL, ("x=2",)),
    "estimate_scale": (SMALL, ("x=2,y=2",)),
    "estimate_time_zone": (SMALL, ("UTC",)),
    **{name: of_coast(name) for name in SAID},
    "by": (KITTI, ("class", "--distance", "iou")),
    "preprocess": (MOT, ("motchallenge", "--distance", "iou")),
    "fix_cov": (GAUSSIANS, GAUSSIAN),
    "missing_cov": (GAUSSIANS, ("zero", *GAUSSIAN)),
}
"""Options that change what is read, each with files and its value."""

PARAMETERS = {
    *("cutoff", "order", "switch_penalty", "rho", "distance", "covariance", "periodic", "scale"),
    *(
        "vertical_weight",
        "mixed",
        "cloud_order",
        "inner",
        "inner_cov",
        "reduce",
        "reduce_method",
        "directions",
    ),
    *("iterations", "restarts", "polish", "seed"),
}
"""Options that a verdict has as parameters of the metric, files or not."""

NEITHER = {
    *("unit", "solver", "gap", "epsilon", "time_limit", "no_gating"),  # the claim is the same
    *("step_weights", "existence", "max_speed"),  # --proof refuses them
    "pairwise",  # of another verb
}


def test_every_option_that_a_proof_records_is_one_of_these() -> None:
    """A new option of `evaluate` has to be named in a verdict, or to say here why not."""
    recorded = {*OF_THE_NUMBER}
    assert recorded == {*NAMED, *PARAMETERS, *NEITHER}
    assert {*verify_tgospa.RECORDED.split()} == recorded
    settings = {*" ".join(verify_tgospa.EXTRAS.values()).split()}
    assert settings == PARAMETERS - {"cutoff", "order", "switch_penalty", "rho", "distance"}
    assert {*verify_tgospa.EXTRAS} <= {*DISTANCES.own}


@pytest.mark.parametrize("name", NAMED)
def test_a_verdict_names_how_the_files_were_read(invoke: Invoke, write: Write, name: str) -> None:
    write("t.csv", "id;t;x\na;0;0,5\n")
    rows = "".join(f"{k},{t},{40 * k + t},{t}\n" for k in range(3) for t in range(12))
    write("small.csv", f"id,t,x,y\n{rows}")
    write("r.csv", "x,y,radius\n90,90,40\n")
    files, values = NAMED[name]
    option = f"--{name.strip('_').replace('_', '-')}"
    answer = invoke(*files, option, *values, "-o", "r", "--proof", "-q")
    assert answer.status == 0, answer.err
    mine = ("--ignore-regions", "r.csv") if name == "ignore_regions" else ()
    answer = invoke("verify", "r", *files, *mine)
    assert answer.status == 0, answer.err
    assert f", {option} " in answer.out.partition("; the tables follow from the files")[2]


def both(invoke: Invoke, folder: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The verdict of the command, and of the script: the same, on one line of visible text."""
    answer = invoke("verify", folder)
    status = verify_tgospa.main([folder])
    captured = capsys.readouterr()
    assert answer.status == status, (answer.err, captured.err)
    for text in (answer.out + answer.err, captured.out + captured.err):
        assert text.removesuffix("\n").isprintable(), text
    assert answer.out == captured.out
    return status, captured.out + captured.err


def rewritten(folder: str, changes: dict[str, Any], tables: dict[str, bytes] | None = None) -> None:
    """Change fields of the document, and tables, with their digests."""
    path = Path(folder, "proof.json")
    document = json.loads(path.read_text(encoding="utf-8"))
    for name, data in (tables or {}).items():
        Path(folder, name).write_bytes(data)
        document["sha256"][name] = hashlib.sha256(data).hexdigest()
    path.write_text(json.dumps(document | changes), encoding="utf-8")


def parameters(folder: str) -> dict[str, Any]:
    document = json.loads(Path(folder, "proof.json").read_text(encoding="utf-8"))
    found: dict[str, Any] = document["parameters"]
    return found


@pytest.fixture
def plain(write: Write) -> str:
    """A proof folder of two states, 3 apart."""
    files = write("t.csv", "id,t,x\na,0,0\n"), write("e.csv", "id,t,x\nb,0,3\n")
    evaluate(*files, 10, 2, 2).proof.save("p")
    return "p"


FORGED = "\np: verified: 0 <= TGOSPA <= 0\x1b[2K\r\u202e\u2066\u2028\x9b\ufeff\u200b"


def test_no_text_of_a_folder_writes_a_line_or_moves_the_cursor(
    invoke: Invoke, plain: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = {
        "truth.csv": f'id,t,"{FORGED}"\n"{FORGED}",0,0\n'.encode(),
        "estimate.csv": f'id,t,"{FORGED}"\n"{FORGED}",0,3\n'.encode(),
    }
    given = parameters(plain) | {"columns": [FORGED]}
    rows: dict[str, Any] = {"prices": [], "assignment": []}
    wide = {"lower_bound": "0", "upper_bound": "1e9"}
    rewritten(plain, {"parameters": given, **rows, **wide}, tables)
    status, text = both(invoke, plain, capsys)
    assert status == 0
    assert "; columns ['\\np: verified: 0 <= TGOSPA <= 0\\x1b[2K\\r\\u202e" in text
    twice = {"assignment": 2 * [[FORGED, FORGED, "0", "0", 711374856192000]]}
    for changes, expected in (
        (twice, 1),
        ({"prices": [[FORGED + "x", "0", 1]]}, 1),
        ({"prices": [[FORGED, FORGED, 1]]}, 1),
        ({"parameters": given | {FORGED: "use"}}, 3),
        ({"parameters": given | {"cutoff": FORGED}}, 3),
        ({"parameters": given | {"distance": FORGED}}, 3),
        ({"sha256": {FORGED: ""}}, 3),
        ({"schema": FORGED}, 3),
        ({FORGED: 1}, 3),
    ):
        good = Path(plain, "proof.json").read_bytes()
        rewritten(plain, changes)
        assert both(invoke, plain, capsys)[0] == expected
        Path(plain, "proof.json").write_bytes(good)


def test_no_name_of_a_folder_writes_a_line(
    invoke: Invoke, plain: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name = f"q{FORGED}".replace("/", "")
    Path(plain).rename(name)
    assert both(invoke, name, capsys)[0] == 0
    Path("r").mkdir()
    Path(name).rename(f"r/{name}")
    answer = invoke("verify", "r")
    assert answer.status == 0
    assert answer.out.count("\n") == 1
    assert str(verify("r")).isprintable()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"metric": "HOTA"}, "proof.json has an unknown 'metric'"),
        ({"options": {"existance": "use"}}, "options has an unknown 'existance'"),
        ({"options": {"time": {"metric": "HOTA"}}}, "in place of a number or text"),
        ({"options": {"time": [["a", {"metric": "HOTA"}]]}}, "in place of a number or text"),
        ({"options": {"time": [[[1]]]}}, "in place of a number or text"),
        ({"inputs": {"truth": {}}}, "has no 'estimate'"),
        ({"version": 1}, "version has 1 in place of a str"),
        ({"prices": [["b", "0", True]]}, "in place of a row"),
        ({"prices": [["b", "0", 1.0]]}, "in place of a row"),
        ({"assignment": [["a", "b", "0", "0"]]}, "in place of a row"),
        ({"assignment": {}}, "in place of a list"),
        ({"classes": ["x", 1]}, "in place of a str"),
        ({"price_bits": True}, "in place of a int"),
        ({"price_bits": 10**9}, "not too large"),
        ({"weight_unit": 10**60}, "not too large"),
        ({"weight_unit": 0}, "assigned more than once"),
        ({"upper_bound": "inf"}, "not a plain decimal number"),
        ({"upper_bound": "1_000_000"}, "not a plain decimal number"),
        ({"prices": [["b", "9", 1]]}, "no table has '9'"),
        ({"assignment": [["a", "b", "0", "9", 1]]}, "no table has '9'"),
        ({"assignment": [["c", "b", "0", "0", 1]]}, "no table has 'c'"),
        ({"options": {"time": float("nan")}}, "not a plain decimal number"),
        ({"options": {"time": 10**5000}}, "not a complete proof"),
    ],
)
def test_both_checkers_refuse_what_is_outside_the_schema(
    invoke: Invoke,
    plain: str,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    message: str,
) -> None:
    unlimited = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)  # to write the last
    rewritten(plain, changes)
    sys.set_int_max_str_digits(unlimited)
    status, text = both(invoke, plain, capsys)
    assert status in (1, 3)
    assert message in text


@pytest.mark.parametrize("name", ["proof.json", "truth.csv"])
@pytest.mark.parametrize(
    ("code", "message"),
    [
        (lambda data: b"\xef\xbb\xbf" + data, "begins with a byte order mark"),
        (lambda data: data.decode().encode("utf-16"), "is not UTF-8"),
        (lambda data: data.replace(b"a", b"\xe9"), "is not UTF-8"),
        (lambda data: data.replace(b"a", b"\xed\xb3\xbf"), "is not UTF-8"),
        (lambda data: data.decode().encode("utf-32-le"), "not a complete proof"),
    ],
    ids=["mark", "utf-16", "latin-1", "surrogate", "utf-32"],
)
def test_files_are_utf_8(
    invoke: Invoke,
    plain: str,
    capsys: pytest.CaptureFixture[str],
    name: str,
    code: Callable[[bytes], bytes],
    message: str,
) -> None:
    data = code(Path(plain, name).read_bytes())
    if name == "proof.json":
        Path(plain, name).write_bytes(data)
    else:
        rewritten(plain, {}, {name: data})
    status, text = both(invoke, plain, capsys)
    assert status == 3
    assert message in text


SECRET = "API_KEY=abc123"


@pytest.mark.parametrize(
    ("options", "mine", "status", "message"),
    [
        ({"ignore_regions": "secret"}, (), 3, "'secret', which is not opened automatically; name"),
        ({"ignore_regions": "pipe"}, (), 3, "name your copy with --ignore-regions FILE"),
        ({"region": "secret"}, (), 3, "proof.json, options, region: names a file, 'secret'"),
        ({"distance": "mahalanobis", "covariance": "secret"}, (), 3, "name your copy with --cov"),
        ({"inner_cov": "secret"}, (), 3, "name your copy with --inner-cov FILE"),
        ({"step_weights": "secret"}, (), 3, "proof.json, options, step_weights: names a file"),
        ({"ignore_regions": 3}, (), 3, "names a file, 3"),
        ({"ignore_regions": "secret"}, ("--ignore-regions", "r.csv"), 1, "parameter masked"),
        (
            {"region": "x=0:9"},
            ("--region", "r.csv"),
            2,
            "--region: the proof was written without this option",
        ),
        (
            {},
            ("--covariance", "r.csv"),
            2,
            "--covariance: the proof was written without this option",
        ),
        ({"cutoff": -1}, (), 3, "p: proof.json, options: cutoff is -1"),
        ({"cutoff": "x"}, (), 3, "p: proof.json, options: cutoff is 'x': must be a number"),
        ({"time": [["a"]]}, (), 3, "p: proof.json, options: time is"),
    ],
)
def test_no_file_is_opened_that_only_a_proof_names(
    invoke: Invoke,
    plain: str,
    write: Write,
    options: dict[str, Any],
    mine: tuple[str, ...],
    status: int,
    message: str,
) -> None:
    write("secret", f"{SECRET}\n{SECRET}\n")
    write("r.csv", "left,top,width,height\n3,1,1,1\n" if status == 1 else "x,y,radius\n3,1,1\n")
    os.mkfifo("pipe")
    files = write("t.csv", "id,t,x,y\na,0,0,0\n"), write("e.csv", "id,t,x,y\nb,0,3.5,1.5\n")
    evaluate(*files, 10, 2, 2).proof.save(plain)
    rewritten(plain, {"options": {"cutoff": 10.0} | options})
    answer = invoke("verify", plain, *files, *mine)
    assert answer.status == status, answer.err
    assert message in answer.err
    assert SECRET not in answer.err
    assert answer.out == ""


def test_files_of_options_are_those_of_the_command_line(invoke: Invoke, write: Write) -> None:
    """Also those that were named otherwise when the proof was written."""
    write("r.csv", "x,y,radius\n90,90,40\n")
    for option in ("--region", "--ignore-regions"):
        assert invoke(*QUICK, option, "r.csv", "-o", "r", "--proof", "-q").status == 0
        write("mine.csv", "x,y,radius\n90,90,40\n")
        answer = invoke("verify", "r", *QUICK, option, "mine.csv")
        assert answer.status == 0, answer.err
        assert f"{option} 'mine.csv'" in answer.out
        write("mine.csv", "x,y,radius\n90,90,20\n")
        assert invoke("verify", "r", *QUICK, option, "mine.csv").status == 1
    answer = invoke("verify", "r", "--ignore-regions", "r.csv")
    assert answer.status == 2
    assert "--ignore-regions needs TRUTH and ESTIMATE: name both" in answer.err


@pytest.mark.parametrize("name", ["proof.json", "truth.csv"])
def test_files_of_a_folder_are_its_own(
    invoke: Invoke, plain: str, write: Write, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    write("secret", f"{SECRET}\n")
    path = Path(plain, name)
    good = path.read_bytes()
    for make, message in (
        (lambda: path.symlink_to("../secret"), f"{name} is a link out of the folder"),
        (lambda: path.symlink_to(path.name), f"{name} is missing, or is not a file"),
        (lambda: os.mkfifo(path), f"{name} is missing, or is not a file"),
        (lambda: path.symlink_to("/dev/zero"), f"{name} is missing, or is not a file"),
        (path.mkdir, f"{name} is missing, or is not a file"),
        (lambda: sparse(path), f"{name} is too large"),
    ):
        path.unlink()
        make()
        if message.startswith("proof.json is missing"):
            assert verify_tgospa.main([plain]) == invoke("verify", plain).status == 3
            capsys.readouterr()
        else:
            status, text = both(invoke, plain, capsys)
            assert status == 3
            assert message in text
            assert SECRET not in text
        if path.is_dir():
            path.rmdir()
            path.touch()
    path.unlink()
    path.write_bytes(good)
    Path("alias").symlink_to(plain)  # the folder that is named may be one
    assert both(invoke, "alias", capsys)[0] == 0


def sparse(path: Path) -> None:
    """A file that takes no room on the disk, and more memory than there is."""
    with path.open("wb") as file:
        file.truncate(1 << 40)


def test_folders_of_a_result_are_its_own(invoke: Invoke, plain: str) -> None:
    Path("r").mkdir()
    Path("r/proof").symlink_to(f"../{plain}")
    answer = invoke("verify", "r")
    assert answer.status == 3
    assert "r/proof: is a link out of r; name the folder it leads to" in answer.err


def test_no_option_of_a_proof_ends_in_a_traceback(invoke: Invoke, plain: str, write: Write) -> None:
    random = Random(2)
    files = "t.csv", "e.csv"
    values = [None, True, -1, 2**70, 1.5, 1e300, "", "x", "1_0", "nan", "1e-9", [], {}, [[]], ["a"]]
    for name in verify_tgospa.RECORDED.split():
        value = random.choice(values)
        rewritten(plain, {"options": {"cutoff": 10.0, name: value}})
        assert invoke("verify", plain, *files).status in (0, 1, 3)


def crowd(states: int) -> dict[str, bytes]:
    """All objects at one place and one time: every pair is near."""
    rows = "".join(f"{k},0,{k % 7}\n" for k in range(states))
    return dict.fromkeys(("truth.csv", "estimate.csv"), f"id,t,x\n{rows}".encode())


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """So little work is allowed that tests need not make what takes seconds."""
    monkeypatch.setattr(verify_tgospa, "WORK", 1e4)


@pytest.mark.usefixtures("patience")
@pytest.mark.parametrize(
    ("changes", "given", "states", "expected"),
    [
        ({}, {}, 20, 0),
        ({}, {"order": "1.7"}, 20, 3),
        ({}, {"order": "9999.3", "switch_penalty": "1e308", "cutoff": "7"}, 20, 3),
        ({"price_bits": 1200}, {}, 20, 3),
        ({}, {"switch_penalty": "5e-324", "cutoff": "1e308", "order": "30"}, 20, 3),
        ({}, {}, 40, 3),
        ({}, {"order": "1000003"}, 1, 3),
        ({}, {"cutoff": "1e999999999"}, 1, 3),
    ],
)
def test_folders_that_would_take_long_are_refused(
    invoke: Invoke,
    plain: str,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, Any],
    given: dict[str, Any],
    states: int,
    expected: int,
) -> None:
    rows = {"prices": [], "assignment": [], "lower_bound": "0"}
    given = parameters(plain) | given
    rewritten(plain, {"parameters": given, **rows, **changes, "upper_bound": "1e9"}, crowd(states))
    status, text = both(invoke, plain, capsys)
    assert status == expected
    assert ("not a complete proof" in text) == (status == 3)


def test_rows_of_an_assignment_that_overlap_cost_no_time(
    invoke: Invoke, plain: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = dict.fromkeys(
        ("truth.csv", "estimate.csv"),
        ("id,t,x\n" + "".join(f"a,{k},0\n" for k in range(10_000))).encode(),
    )
    rows: dict[str, Any] = {"prices": [], "assignment": [["a", "a", "0", "9999", 1]] * 24_000}
    wide = {"lower_bound": "0", "upper_bound": "1e9", "weight_unit": 24_000}
    rewritten(plain, {**rows, **wide}, tables)
    status, text = both(invoke, plain, capsys)
    assert status == 0
    assert "0 <= total <= 0; " in text


@pytest.mark.usefixtures("patience")
def test_classes_share_the_work_that_a_folder_may_take(invoke: Invoke, plain: str) -> None:
    rows = {"prices": [], "assignment": [], "lower_bound": "0", "upper_bound": "1e9"}
    rewritten(plain, rows, crowd(20))
    for name in ("r/a", "r/b"):
        assert invoke("verify", plain).status == 0
        shutil.copytree(plain, name)
    answer = invoke("verify", "r")
    assert answer.status == 3
    assert "too many near pairs" in answer.err


@pytest.mark.usefixtures("patience")
def test_proof_refuses_what_checkers_refuse(invoke: Invoke, write: Write) -> None:
    rows = "".join(f"{k},0,{k % 7}.5\n" for k in range(20))
    write("t.csv", f"id,t,x\n{rows}")
    for options, message in (
        (("-p", "1.7", "-c", "10"), "takes too long to check: choose a smaller cutoff"),
        (("-p", "20000", "-c", "1"), "cannot hold the order 20000: the largest is 10000"),
    ):
        answer = invoke("t.csv", "t.csv", *options, "-o", "r", "--proof", "-q")
        assert answer.status == 2
        assert message in answer.err
        assert not Path("r").exists()
    # More pairs, of which few are near: the checker is asked.
    far = "".join(f"{k},0,{100 * k}\n" for k in range(60))
    write("t.csv", f"id,t,x\n{far}")
    assert invoke("t.csv", "t.csv", "-o", "r", "--proof", "-q").status == 0
    assert invoke("verify", "r", "t.csv", "t.csv").status == 0


def test_checkers_agree_on_damaged_folders(
    invoke: Invoke, plain: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A part of the document replaced, left out or repeated, bytes of a table changed."""
    random = Random(1)
    good = {path.name: path.read_bytes() for path in Path(plain).iterdir()}
    values = [None, True, -1, 2**70, 1.5, "", "1_0", "nan", "1e400", [], {}, [[]], {"x": "1"}, "b"]
    seen = set()
    for _ in range(300):
        document = json.loads(good["proof.json"])
        data = bytearray(good["truth.csv"])
        place, key = document, random.choice([*document])
        while isinstance(place[key], dict | list) and place[key] and random.random() < 0.8:
            place = place[key]
            key = random.choice([*place] if isinstance(place, dict) else range(len(place)))
        if random.random() < 0.3:
            data[random.randrange(len(data))] = random.randrange(256)
        elif random.random() < 0.7:
            place[key] = random.choice(values)
        else:
            del place[key]
        Path(plain, "truth.csv").write_bytes(data)
        with suppress(KeyError, TypeError):
            document["sha256"]["truth.csv"] = hashlib.sha256(data).hexdigest()
        Path(plain, "proof.json").write_text(json.dumps(document), encoding="utf-8")
        seen.add(both(invoke, plain, capsys)[0])
    assert seen == {0, 1, 3}
