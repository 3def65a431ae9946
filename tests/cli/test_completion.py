"""Completion in a shell: verbs, options, values and files."""

import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from tgospa_eval.cli.verbs import cli

OTHERS = ("clear", "identity", "gospa", "nees")
PROGRAM = Path(sys.executable).with_name("tgospa-eval")


def offered(
    monkeypatch: pytest.MonkeyPatch, words: str, shell: type[ShellComplete] = BashComplete
) -> list[str]:
    """What is printed where the cursor is behind the words."""
    *before, last = words.split(" ")
    monkeypatch.setenv("COMP_WORDS", words if shell is FishComplete else " ".join([*before, last]))
    monkeypatch.setenv("COMP_CWORD", last if shell is FishComplete else str(len(before)))
    made = shell(cli, {}, "tgospa-eval", "_TGOSPA_EVAL_COMPLETE")
    return made.complete().splitlines()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("gt.csv", "est.csv", "two words.csv", ".hidden"):
        (tmp_path / name).touch()
    (tmp_path / "gates").mkdir()
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("tgospa-eval g", ["plain,gate", "plain,gates/", "plain,gt.csv"]),
        ("tgospa-eval est", ["file,est"]),
        ("tgospa-eval gates/x", ["file,gates/x"]),
        ("tgospa-eval --time-s", ["plain,--time-scale"]),
        ("tgospa-eval gt.csv e", ["file,e"]),
        ("tgospa-eval gate gt.csv e", ["file,e"]),
        ("tgospa-eval gt.csv est.csv --interp", ["plain,--interpolate"]),
        ("tgospa-eval gt.csv est.csv --interpolate ", ["plain,estimate", "plain,truth"]),
        ("tgospa-eval gt.csv est.csv --with h", ["plain,hota"]),
        ("tgospa-eval gt.csv est.csv --with hota,", [f"plain,hota,{name}" for name in OTHERS]),
        ("tgospa-eval gt.csv est.csv --distance geo", ["plain,geodesic"]),
        ("tgospa-eval gt.csv est.csv --format j", ["plain,json"]),
        ("tgospa-eval gt.csv est.csv --solver c", ["plain,certified"]),
        ("tgospa-eval gt.csv est.csv --truth-format kit", ["plain,kitti"]),
        ("tgospa-eval compare gt.csv est.csv --solvers exact,s", ["plain,exact,sinkhorn"]),
        ("tgospa-eval compare gt.csv est.csv --config ", ["file,"]),
        ("tgospa-eval simulate demo --setting x", ["plain,xia-2019"]),
    ],
)
def test_what_is_offered(monkeypatch: pytest.MonkeyPatch, words: str, wanted: list[str]) -> None:
    assert offered(monkeypatch, words) == wanted


def test_the_first_word_is_a_verb_or_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    found = offered(monkeypatch, "tgospa-eval ")
    assert found[:2] == ["plain,evaluate", "plain,inspect"]
    assert found[-3:] == ["plain,est.csv", "plain,gates/", "plain,gt.csv"]
    assert "gate" in "".join(offered(monkeypatch, "tgospa-eval g", ZshComplete))
    assert any(
        line.startswith("plain,gate")
        for line in offered(monkeypatch, "tgospa-eval g", FishComplete)
    )


@pytest.mark.process
@pytest.mark.skipif(sys.platform == "win32", reason="needs bash")
def test_bash_completes_by_the_line_of_the_docs() -> None:
    script = f"""
    PATH="{PROGRAM.parent}:$PATH"
    eval "$(_TGOSPA_EVAL_COMPLETE=bash_source tgospa-eval)"
    COMP_WORDS=(tgospa-eval g); COMP_CWORD=1
    _tgospa_eval_completion tgospa-eval
    printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.split() == ["gate", "gates/", "gt.csv"]
