"""What every file of the package keeps to: words, and what the docs say of it."""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from checkout import DOCS, ROOT

from tgospa_eval import __version__

PACKAGE = ROOT / "tgospa_eval"

RETIRED = {
    "contest", "contested", "dearest", "hub", "laws", "offer", "remark", "remarks", "residual",
    "rough", "sheet", "sheets", "stamps", "crossing_price",
    "alone", "apart", "asked", "called", "charged", "continued", "cut", "drawn", "effort",
    "endings", "found", "held", "holds", "judged", "least", "look", "meant", "moments", "most",
    "others", "seen", "silences", "slid", "spoken", "told", "traced", "usual", "whence",
}  # fmt: skip
"""Words that say less than the thing itself, or became terms of the field (docs/glossary.md)."""

ALLOWED = {
    "FileNotFoundError", "ModuleNotFoundError", "ZoneInfoNotFoundError",
    "holds",  # of a verification
    "judged",  # a key of JSON documents, and the attribute of a result
    "most",  # of the brackets of the kernels
}  # fmt: skip
"""Names that keep such a word: of other libraries, public, or compiled."""


@cache
def sources() -> dict[str, tuple[str, ast.Module]]:
    """Text and tree of every file, by its path in the package."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        found[path.relative_to(PACKAGE).as_posix()] = text, ast.parse(text)
    return found


@cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    """Every node of a file."""
    return [*ast.walk(tree)]


def names(tree: ast.Module) -> Iterator[str]:
    """Every name that the code of a file gives or uses."""
    for node in nodes(tree):
        for field in ("id", "attr", "name", "arg"):
            if isinstance(name := getattr(node, field, None), str):
                yield name


def test_retired_words_are_not_in_names() -> None:
    found = {
        f"{file}: {name}"
        for file, (_, tree) in sources().items()
        for name in {*names(tree)} - ALLOWED
        if name in RETIRED
        or RETIRED & {word.lower() for word in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)}
    }
    assert found == set()


NO_BEGIN = {
    "By", "For", "From", "How", "In", "Of", "That", "Those", "To", "What", "Where", "Whether",
    "Which", "Why",
}  # fmt: skip
"""Words with which a docstring would only continue the name before it."""


def test_docstrings_stand_without_the_name_before_them() -> None:
    found = {
        f"{file}: {text.splitlines()[0]}"
        for file, (_, tree) in sources().items()
        for node in nodes(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if (text := ast.get_docstring(node)) and text.split()[0] in NO_BEGIN
    }
    assert found == set()


def test_sections_of_docstrings_are_indented_as_sphinx_reads_them() -> None:
    """A parameter one level too deep becomes part of the text of the one before it."""
    found = []
    for file, (_, tree) in sources().items():
        for node in nodes(tree):
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                body = re.split(r"^(\w[\w ]*)\n-{3,}$", ast.get_docstring(node) or "", flags=re.M)
                for text in body[2::2] if "Examples" not in body else ():
                    deep = re.findall(r"^(?: {5,}.*| {4}\w+(?:, \w+)* : .*)$", text, re.M)
                    found += [f"{file}: {line.strip()}" for line in deep]
    assert found == []


RETIRED_IN_TEXT = r"\b(contest|contested|hubs?|laws?|made-up|rough bounds?)\b"

PAGES = [
    path
    for path in (*ROOT.glob("*.md"), *DOCS.rglob("*.md"))
    if path.name != "CHANGELOG.md" and "_build" not in path.parts
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_paths_that_a_page_names_are_there(page: Path) -> None:
    named = re.findall(
        r"`((?:tgospa_eval|tests|sample_data|\.github)/[\w./-]+)`", page.read_text("utf-8")
    )
    made = {"tests/benchmarks/results"}
    assert [path for path in named if not (ROOT / path).exists() and path not in made] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_retired_words_are_not_in_pages(page: Path) -> None:
    assert re.findall(RETIRED_IN_TEXT, page.read_text("utf-8")) == []


def test_the_citation_is_of_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in text


def test_the_lock_names_no_place() -> None:
    text = (ROOT / "requirements-dev.txt").read_text(encoding="utf-8")
    assert re.search("https?:|file:|index-url|find-links", text) is None


def test_the_page_of_the_architecture_has_the_folders() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([\w/]+/)` \| .+ \|$", page, re.M)
    there = {path.parent.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py")}
    assert sorted(listed) == sorted("tgospa_eval/" if name == "." else f"{name}/" for name in there)


def test_both_pages_name_the_same_file_to_read_first() -> None:
    first = [
        re.findall(r"Read `([^`]+)` first", page.read_text("utf-8"))
        for page in (ROOT / "CONTRIBUTING.md", DOCS / "architecture.md")
    ]
    assert first[0] == first[1] == ["tgospa_eval/api/evaluate.py"]


def test_the_page_of_the_architecture_has_the_layers() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    layers = contracts["contracts"][0]["layers"]
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    assert "\n".join("   " + layer.replace(" : ", " | ") for layer in layers) in page


OF_OTHER_PROGRAMS = {
    "api/options.py": "declarations and help of the options themselves",
    "api/reading.py": "commands to type in a shell",
    "campaign/gate/baseline.py": "a command to type in a shell",
    "campaign/gate/outcome.py": "arguments of the command that a gate proposes",
    "campaign/gate/suite.py": "arguments of git",
    "common/words.py": "a command of uv",
    "proof/check.py": "a command to type in a shell",
    "results/saved.py": "files are saved by the command line",
    "show/html.py": "names of CSS",
    "quoting.py": "the spelling itself",
    "campaign/gate/judge_pairs.py": "arguments of the command that a gate proposes",
    "campaign/gate/options.py": "help",
}
"""Files in whose texts there are options, and why."""


def texts(tree: ast.Module) -> Iterator[str]:
    """Every text that is no docstring."""
    docs = {id(node.value) for node in nodes(tree) if isinstance(node, ast.Expr)}
    for node in nodes(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def test_options_in_messages_are_spelled_for_the_surface() -> None:
    found = {
        file
        for file, (_, tree) in sources().items()
        if not file.startswith("cli/") and file != "proof/verify_tgospa.py"
        for text in texts(tree)
        if re.search(r"(?<![\w-])--[a-z]", text)
    }
    assert found == set(OF_OTHER_PROGRAMS)


def test_no_option_is_spelled_before_the_surface_is_known() -> None:
    """That is at the import, by a constant or a default."""
    early = set()
    for file, (text, tree) in sources().items():
        if file.startswith("cli/") or "option(" not in text:  # the command line declares some
            continue
        inside = {
            id(node)
            for function in nodes(tree)
            if isinstance(function, ast.FunctionDef | ast.Lambda)
            for part in (function.body if isinstance(function.body, list) else [function.body])
            for node in ast.walk(part)
        }
        early |= {
            f"{file}: {node.lineno}"
            for node in nodes(tree)
            if isinstance(node, ast.Call) and id(node) not in inside
            if isinstance(node.func, ast.Name) and node.func.id == "option"
        }
    assert early == set()
