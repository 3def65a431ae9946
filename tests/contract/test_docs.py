"""Whoever follows a page of README and docs, from its top, gets what it shows.

A page begins in a folder that has the sample data, as a checkout has, and nothing else: what its
commands read comes with that, or from an earlier block of the page.
"""

import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest
from checkout import ROOT

from tgospa_eval.cli import main
from tgospa_eval.cli.shared import progress
from tgospa_eval.cli.verbs import VERBS
from tgospa_eval.show import figure_tools as drawing

README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of what a reader runs, in their order."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r"^```(python|console)\n(.*?)^```", text, re.M | re.S)
    return [block for block in found if page != README or block[0] == "python"]


def runs(block: str) -> list[tuple[str, list[str]]]:
    """Commands of a console block, with the lines that the page shows of their output."""
    found = []
    for part in re.split(r"^\$ ", re.sub(r"(?<!\\)\\\n", "", block), flags=re.M)[1:]:
        command, *lines = part.splitlines()
        found.append((command, lines))
    return found


def shown(lines: list[str]) -> list[str]:
    """What of an output is the same each time."""
    return [line for line in lines if "seconds  " not in line and "compiled kernels" not in line]


def check_shown(lines: list[str], printed: list[str]) -> None:
    """`...` stands for lines that are left out."""
    at, printed = 0, shown(printed)
    for part in re.split(r"^\.\.\.$", "\n".join(shown(lines)), flags=re.M):
        expected = part.strip("\n").splitlines()
        if expected:
            at = printed.index(expected[0], at)
            assert expected == printed[at : at + len(expected)]


class Shell:
    """What the pages need of one."""

    def __init__(self, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.capfd, self.monkeypatch = capfd, monkeypatch
        self.status: object = None

    def run(self, command: str, lines: list[str]) -> None:
        program, *arguments = shlex.split(command)
        arguments, target = (
            (arguments[:-2], arguments[-1]) if ">" in arguments[1:] else (arguments, "")
        )
        if program == "tgospa-eval":
            self.capfd.readouterr()
            with pytest.raises(SystemExit) as ended:
                main(arguments)
            self.status = ended.value.code
            out, err = self.capfd.readouterr()
            if target:
                Path(target).write_text(out, encoding="utf-8")
            check_shown(lines, (err if target else err + out).splitlines())
        elif program == "python":
            done = subprocess.run(
                [sys.executable, "-I", *arguments], capture_output=True, text=True, check=True
            )
            check_shown(lines, done.stdout.splitlines())
        elif program == "cd":
            self.monkeypatch.chdir(arguments[0])
        elif program == "cat" and arguments[0] == ">":
            assert lines[-1] == "EOF"
            Path(arguments[1]).write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
        elif program in ("cat", "head"):
            text = Path(arguments[-1]).read_text(encoding="utf-8").splitlines()
            assert lines == text[: int(arguments[0][1:]) if program == "head" else None]
        elif program == "ls":
            assert " ".join(lines).split() == sorted(
                name for name in os.listdir(arguments[0]) if name[0] != "."
            )
        elif command == "echo $?":
            assert lines == [str(self.status)]
        else:
            raise AssertionError(f"the page has a command that is not tried: {command}")


@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p)], ids=lambda p: p.relative_to(ROOT).as_posix()
)
def test_a_page_from_its_top(
    page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(progress, "FIRST", math.inf)  # a busy machine would show how far it is
    # Figures are made, and not drawn, which takes two thirds of the time.
    monkeypatch.setattr(drawing, "written", lambda *_: b"")
    shell, names = Shell(capfd, monkeypatch), dict[str, object]()
    for language, text in blocks(page):
        if language == "python":
            exec(compile(text, str(page), "exec"), names)
        else:
            for command, lines in runs(text):
                shell.run(command, lines)


def test_readme_has_an_example() -> None:
    assert "evaluate(" in "".join(text for _, text in blocks(README))


def test_readme_prints_what_the_start_page_does() -> None:
    _, _, text = README.read_text(encoding="utf-8").partition("## What it prints\n\n```\n")
    printed = text.partition("```")[0]
    assert printed
    assert printed in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")


def test_a_forge_shows_what_the_pages_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables that are made from the code stand in the pages; links have words."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    filled = import_module("option_tables").filled
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert text == filled(page), f"{page}: run python docs/option_tables.py"
        assert "[](" not in text


def test_every_option_answers_one_question(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    tables = import_module("option_tables")
    page = (ROOT / "docs" / "reference" / "options.md").read_text(encoding="utf-8")
    assert re.findall("<!-- question (.*) -->", page) == list(tables.QUESTIONS)
    assert set(re.findall("<!-- options (.*) -->", page)) == set(VERBS)
    sections = tables.records(tables.DEFAULT)
    declared = [name for options in sections.values() for name in options]
    answered = [
        line for question in tables.QUESTIONS for line in tables.answers(question).splitlines()[2:]
    ]
    assert len(answered) == len(declared)
    known = {*sections, *(tables.long_name(name).removeprefix("--") for name in declared)}
    assert {name for names in tables.QUESTIONS.values() for name in names} <= known


def make(*arguments: str, folder: Path) -> list[str]:
    """Lines that a target prints, where everything is installed."""
    if not (shutil.which("make") and Path(sys.executable).with_name("tgospa-eval").exists()):
        pytest.skip("needs make, and the command beside this Python")
    given = ("-f", ROOT / "Makefile", "-C", folder, f"BIN={Path(sys.executable).parent}")
    done = subprocess.run(["make", *given, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.process
def test_the_demo_ends_with_its_page_also_the_second_time(tmp_path: Path) -> None:
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    for _ in range(2):
        lines = make("-o", ".venv/installed", "demo", folder=tmp_path)
        address = next(line.strip() for line in lines[::-1] if "file:" in line)
        page = Path(url2pathname(urlsplit(address).path))
        assert "TGOSPA = 42.5352" in page.read_text(encoding="utf-8")
    (made,) = {page.relative_to(tmp_path).parts[0]}
    assert f"/{made}/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


@pytest.mark.process
def test_an_old_python_is_refused_in_a_sentence(tmp_path: Path) -> None:
    if not shutil.which("make"):
        pytest.skip("needs make")
    old = tmp_path / "python3.10"
    code = "import sys; sys.version_info = (3, 10, 9); exec(sys.argv[2])"
    old.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{code}" "$@"\n', encoding="utf-8")
    old.chmod(0o755)
    given = ("-f", ROOT / "Makefile", "-C", tmp_path, f"PYTHON={old}", ".venv/bin/python")
    done = subprocess.run(["make", *given], capture_output=True, text=True)
    assert done.returncode
    assert "needs Python 3.11 or newer" in done.stderr
    assert "3.10. With another" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / ".venv").exists()


@pytest.mark.process
def test_nothing_is_installed_in_silence() -> None:
    lines = make("--dry-run", "--always-make", "demo", "test", "lint", folder=ROOT)
    slow = [k for k, line in enumerate(lines) if "-m pip install" in line or "-m venv" in line]
    assert len(slow) > 2
    assert [lines[k] for k in slow if not lines[k - 1].startswith("echo ")] == []
