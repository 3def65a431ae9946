"""The Python examples of README and docs run as they stand.

In a folder that has the sample data, as a checkout has, and the quickstart pair as truth.csv and
estimate.csv, as the tutorial has.
"""

import math
import os
import re
import shlex
import shutil
from pathlib import Path

import pytest

from tgospa_eval.cli import main, progress

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p)], ids=lambda p: p.relative_to(ROOT).as_posix()
)
def test_examples_run(page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Blocks of a page share their names, as a reader would type them one after the other."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    shutil.copytree(ROOT / "sample_data" / "quickstart", tmp_path, dirs_exist_ok=True)
    names: dict[str, object] = {}
    for code in blocks(page):
        exec(compile(code, str(page), "exec"), names)


def test_readme_has_an_example() -> None:
    assert "evaluate(" in "".join(blocks(ROOT / "README.md"))


def runs(page: Path) -> list[tuple[str, list[str]]]:
    """Commands in console blocks, with the lines that the page shows of their output."""
    found = []
    for block in re.findall(
        r"^```console\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S
    ):
        for part in re.split(r"^\$ ", re.sub(r"(?<!\\)\\\n", "", block), flags=re.M)[1:]:
            command, *lines = part.splitlines()
            found.append((command, lines))
    return found


def shown(lines: list[str]) -> list[str]:
    """What of an output is the same each time."""
    return [line for line in lines if "seconds  " not in line and "compiled kernels" not in line]


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES[1:] if any(c.startswith("tgospa-eval") for c, _ in runs(page))],
    ids=lambda p: p.relative_to(ROOT / "docs").as_posix(),
)
def test_shown_output_is_true(
    page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Files that a page shows by `cat` are those that its commands read; `...` leaves lines out."""
    shutil.copytree(ROOT / "sample_data", tmp_path, dirs_exist_ok=True)
    shutil.copytree(ROOT / "sample_data" / "quickstart", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(progress, "FIRST", math.inf)  # a busy machine would show how far it is
    names: dict[str, object] = {}
    for code in blocks(page):
        exec(compile(code, str(page), "exec"), names)
    capfd.readouterr()
    status: object = None
    for command, lines in runs(page):
        program, *arguments = shlex.split(command)
        if program == "tgospa-eval":
            if arguments[0] == "simulate":
                shutil.rmtree(arguments[1], ignore_errors=True)
            with pytest.raises(SystemExit) as ended:
                main(arguments)
            status = ended.value.code
            out, err = capfd.readouterr()
            at, printed = 0, shown((err + out).splitlines())
            for part in re.split(r"^\.\.\.$", "\n".join(shown(lines)), flags=re.M):
                expected = part.strip("\n").splitlines()
                if expected:
                    at = printed.index(expected[0], at)
                    assert expected == printed[at : at + len(expected)]
        elif program == "cat" and arguments[0] == ">":
            assert lines[-1] == "EOF"
            Path(arguments[1]).write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
        elif program == "cat" and not Path(arguments[0]).exists():
            Path(arguments[0]).write_text("\n".join(lines) + "\n", encoding="utf-8")
        elif program in ("cat", "head"):
            text = Path(arguments[-1]).read_text(encoding="utf-8").splitlines()
            assert lines == text[: int(arguments[0][1:]) if program == "head" else None]
        elif program == "ls":
            assert " ".join(lines).split() == sorted(os.listdir(arguments[0]))
        elif command == "echo $?":
            assert lines == [str(status)]
        else:
            assert program == "pip"
