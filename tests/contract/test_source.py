"""What every file of the package keeps to: sizes, words, and what the docs say of it."""

import ast
import inspect
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from checkout import DOCS, ROOT

from tgospa_eval import __version__

PACKAGE = ROOT / "tgospa_eval"

LINES = 800
BODY = 80
PARAMETERS = 7
ROOMS = 26

WIDE = {
    "evaluate": "tgospa_eval",
    "read_trajectories": "tgospa_eval",
    "sweep": "tgospa_eval",
    "compare": "tgospa_eval",
    "batch": "tgospa_eval",
    "reduce_cloud": "tgospa_eval.distances",
    "tgospa_problem": "tgospa_eval.problem.tgospa",
}
"""Functions whose settings, or arrays, are keywords with names that stay."""

SAME: dict[str, set[str]] = {
    # Choices of the command line, which are checked against their home by its own tests.
    name: {"cli/shared/options.py", home}
    for name, home in (
        ("DISTANCES", "distances/__init__.py"),
        ("GRIDS", "tracks/alignment.py"),
        ("SOLVERS", "solvers/__init__.py"),
    )
} | {
    "PUBLISHED": {"cli/simulate/command.py", "simulation/settings.py"},
    "SCENARIOS": {"cli/simulate/command.py", "simulation/scenarios.py"},
    "INTERPOLATED": {"cli/shared/clock_options.py", "tracks/alignment.py"},
    "LAYOUTS": {"cli/batch/command.py", "batches/jobs.py"},
    "_HOME": {"__init__.py", "distances/__init__.py"},
    "SCHEMA": {
        *("inspection.py", "regression/report.py", "regression/baseline.py", "comparison/log.py"),
        *("comparison/__init__.py", "proof/verify_tgospa.py", "reports/manifest.py"),
        "batches/store.py",
    },
}
"""Constants of one meaning in several modules."""

RETIRED = {
    "contest", "contested", "dearest", "hub", "laws", "offer", "remark", "remarks", "residual",
    "rough", "sheet", "sheets", "stamps", "crossing_price",
}  # fmt: skip
"""Words that became terms of the field; docs/glossary.md has those."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def sources() -> dict[str, tuple[str, ast.Module]]:
    """Text and tree of every file, by its path in the package."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        found[path.relative_to(PACKAGE).as_posix()] = text, ast.parse(text)
    return found


def functions() -> Iterator[tuple[str, Function]]:
    for name, (_, tree) in sources().items():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                yield f"{name}: {node.name}", node


def body_lines(node: Function) -> int:
    """Lines without the signature and the docstring."""
    body = node.body[1:] if ast.get_docstring(node) else node.body
    return node.end_lineno - body[0].lineno + 1 if body else 0  # type: ignore[operator]


def parameters(node: Function) -> int:
    asked = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([each for each in asked if each.arg not in ("self", "cls")])


def test_modules_are_small() -> None:
    lines = {name: text.count("\n") for name, (text, _) in sources().items()}
    assert {name: count for name, count in lines.items() if count > LINES} == {}


def test_functions_are_small() -> None:
    lines = {name: body_lines(node) for name, node in functions()}
    assert {name: count for name, count in lines.items() if count > BODY} == {}


def test_settings_travel_as_records() -> None:
    counts = {name: parameters(node) for name, node in functions() if node.name not in WIDE}
    assert {name: count for name, count in counts.items() if count > PARAMETERS + 3} == {}


@pytest.mark.parametrize("name", WIDE)
def test_who_has_more_parameters_is_public(name: str) -> None:
    asked = inspect.signature(getattr(import_module(WIDE[name]), name)).parameters.values()
    assert len(asked) > PARAMETERS
    assert len([each for each in asked if each.kind is not each.KEYWORD_ONLY]) <= PARAMETERS


def test_rooms_of_the_top_level_are_few() -> None:
    rooms = [path for path in PACKAGE.iterdir() if path.suffix == ".py" or is_room(path)]
    rooms = [path for path in rooms if path.stem not in ("torch", "jax")]  # named as users say them
    assert len(rooms) <= ROOMS


def is_room(path: Path) -> bool:
    return (path / "__init__.py").exists()


def names(tree: ast.Module) -> Iterator[str]:
    """Every name that the code of a file gives or uses."""
    for node in ast.walk(tree):
        for field in ("id", "attr", "name", "arg"):
            if isinstance(name := getattr(node, field, None), str):
                yield name


def constants(tree: ast.Module) -> Iterator[str]:
    """Names of the constants of a module."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for name in (each for target in targets if target for each in ast.walk(target)):
            if isinstance(name, ast.Name) and name.id.isupper() and len(name.id) > 1:
                yield name.id


def test_a_constant_has_one_meaning() -> None:
    homes: dict[str, set[str]] = {}
    for file, (_, tree) in sources().items():
        for name in constants(tree):
            homes.setdefault(name, set()).add(file)
    assert {name: files for name, files in homes.items() if len(files) > 1} | SAME == SAME


def test_retired_words_are_not_in_names() -> None:
    found = {
        f"{file}: {name}"
        for file, (_, tree) in sources().items()
        for name in names(tree)
        if name in RETIRED
        or RETIRED & {word.lower() for word in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)}
    }
    assert found == set()


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


def test_unit_tests_mirror_the_package() -> None:
    units = ROOT / "tests" / "unit"
    folders = {path.parent.relative_to(units) for path in units.rglob("test_*.py")}
    assert [folder for folder in folders if not is_room(PACKAGE / folder)] == []


def test_the_page_of_the_architecture_has_the_tree() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    listed = {
        folder.removeprefix("tgospa_eval").strip("/"): set(re.findall("`(.+?)`", modules))
        for folder, modules in re.findall(r"^\| `([\w/]+/)` \| .+ \| (.+) \|$", page, re.M)
    }
    there: dict[str, set[str]] = {}
    for path in (*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.pyx")):
        name = path.name.removesuffix(".py")
        folder = path.parent.relative_to(PACKAGE).as_posix().removeprefix(".")
        there.setdefault(folder, set()).update({name} - {"__init__"})
    assert listed == there


def test_the_page_of_the_architecture_has_the_layers() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    layers = contracts["contracts"][0]["layers"]
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    assert "\n".join("   " + layer.replace(" : ", " | ") for layer in layers) in page
