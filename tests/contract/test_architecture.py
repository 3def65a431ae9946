"""Lists that are spelled out in several places say the same."""

import ast
import re
import subprocess
import sys
from collections.abc import Collection

import pytest
from checkout import ROOT

from tgospa_eval import __all__ as public
from tgospa_eval.api import options
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.distances import DISTANCES
from tgospa_eval.formats import FORMATS
from tgospa_eval.show.result_text import REPORTS
from tgospa_eval.solvers import SOLVERS, solver_class


@pytest.mark.parametrize(
    ("listed", "members"),
    [
        (DISTANCES.own, DISTANCES.own),
        (options.SOLVERS, SOLVERS),
        ((*click_builder.REPORT_FORMATS, "methods"), REPORTS),
        (FORMATS.own, FORMATS.own),
    ],
)
def test_members_are_offered_and_documented(
    listed: Collection[str], members: Collection[str]
) -> None:
    assert set(listed) == set(members)
    page = (ROOT / "docs" / "reference" / "options.md").read_text(encoding="utf-8")
    for name in members:
        assert f"`{name}`" in page


def test_members_know_their_names() -> None:
    assert all(distance.name == name for name, distance in DISTANCES.items())
    assert all(solver_class(name)().name == name for name in SOLVERS)


def test_public_names_are_there() -> None:
    import tgospa_eval

    assert all(hasattr(tgospa_eval, name) for name in public)
    assert dir(tgospa_eval) == public


REGISTRIES = {"cli/verbs.py", "solvers/__init__.py"}
"""Files that import members by name, so that a start needs those alone that are asked for; the
others do it by `common.registry`."""


def test_only_registries_import_our_modules_by_name() -> None:
    """The linter of layers and circles sees statements, and no strings."""
    by_name = set()
    for path in (ROOT / "tgospa_eval").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if not re.search("import_module|__import__", text):
            continue
        nodes = list(ast.walk(ast.parse(text)))
        calls = [ast.unparse(node) for node in nodes if isinstance(node, ast.Call)]
        imports = [
            call for call in calls if re.match(r"(importlib\.)?(import_module|__import__)", call)
        ]
        texts = [str(node.value) for node in nodes if isinstance(node, ast.Constant)]
        ours = any(re.match(r"tgospa_eval(\.|$)", text) for text in texts)
        if imports and (ours or re.search(r"__name__|__package__|\(f?['\"]\.", "".join(imports))):
            by_name.add(path.relative_to(ROOT / "tgospa_eval").as_posix())
    assert by_name == REGISTRIES


@pytest.mark.process
@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import tgospa_eval.cli", ("numpy", "pandas", "scipy", "highspy", "cvxpy")),
        ("from tgospa_eval import evaluate, Certified", ("pandas", "scipy", "cvxpy", "clarabel")),
        ("import tgospa_eval.api.result as r; r.Result", ("jinja2", "matplotlib", "pandas")),
    ],
)
def test_imports_are_lazy(statement: str, absent: tuple[str, ...]) -> None:
    code = f"import sys; {statement}; print([n for n in {absent!r} if n in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
