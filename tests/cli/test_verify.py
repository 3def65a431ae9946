"""Proof folders as users meet them: written with a result, checked again, by the script alone."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from browser import PATIENCE
from checkout import SAMPLES

from tgospa_eval import evaluate

Invoke = Callable[..., Any]
Write = Callable[[str, str | bytes], str]

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
    ],
    ids=["plain", "filtered", "periodic", "classes", "clouds"],
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


def test_the_script_alone_gives_the_same_verdict(invoke: Invoke, tmp_path: Path) -> None:
    invoke(*QUICK, "-c", "10", "-g", "5", "-o", "r", "--proof", "-q")
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


def test_what_does_not_hold(invoke: Invoke, write: Write) -> None:
    invoke(*QUICK, "-c", "10", "-g", "5", "-o", "r", "--proof", "-q")
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
    assert "options has an unknown or no 'colour'" in answer.err
    evaluate(*QUICK).proof.save("p")
    answer = invoke("verify", "p", *QUICK)
    assert answer.status == 3
    assert "p: does not say how the files were read" in answer.err


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
    answer = invoke("verify", "r", *files)
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
        ((*QUICK, "--proof"), 2, "--proof is for the folder of -o"),
        ((*QUICK, "--proof", "--sweep", "c=1,2", "-o", "r"), 2, "--proof is for one evaluation"),
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
    assert "1.2e-07 apart as floating-point numbers: digit 8 of the total" in warning["text"]


def test_a_class_without_its_proof_is_missed(invoke: Invoke, write: Write) -> None:
    rows = "".join(f"{name},{k},{k},0,{name}\n" for name in ("bus", "car") for k in range(3))
    for name in ("t.csv", "e.csv"):
        write(name, f"id,t,x,y,class\n{rows}")
    assert invoke("t.csv", "e.csv", "--by", "class", "-o", "r", "--proof", "-q").status == 0
    assert invoke("verify", "r", "t.csv", "e.csv").status == 0
    for path in Path("r/proof/bus").iterdir():
        path.unlink()
    answer = invoke("verify", "r")
    assert answer.status == 1
    assert "r: there is no proof of the class 'bus'" in answer.err
