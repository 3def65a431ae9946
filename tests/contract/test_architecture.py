"""Lists that are spelled out in several places say the same."""

import subprocess
import sys
from collections.abc import Collection

import pytest
from checkout import ROOT

from tgospa_eval import __all__ as public
from tgospa_eval.api import options
from tgospa_eval.cli.shared import click_options
from tgospa_eval.distances import DISTANCES
from tgospa_eval.formats import FORMATS
from tgospa_eval.reports import REPORTS
from tgospa_eval.solvers import SOLVERS, solver_class


@pytest.mark.parametrize(
    ("listed", "members"),
    [
        (DISTANCES.own, DISTANCES.own),
        (options.SOLVERS, SOLVERS),
        (click_options.REPORT_FORMATS, REPORTS),
        (FORMATS.own, FORMATS.own),
    ],
)
def test_members_are_offered_and_documented(
    listed: Collection[str], members: Collection[str]
) -> None:
    assert set(listed) == set(members)
    page = (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8")
    for name in members:
        assert f"`{name}`" in page


def test_members_know_their_names() -> None:
    assert all(distance.name == name for name, distance in DISTANCES.items())
    assert all(solver_class(name)().name == name for name in SOLVERS)


def test_public_names_are_there() -> None:
    import tgospa_eval

    assert all(hasattr(tgospa_eval, name) for name in public)
    assert dir(tgospa_eval) == public


@pytest.mark.process
@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import tgospa_eval.cli", ("numpy", "pandas", "scipy", "highspy", "cvxpy")),
        ("from tgospa_eval import evaluate, Certified", ("pandas", "scipy", "cvxpy", "clarabel")),
    ],
)
def test_imports_are_lazy(statement: str, absent: tuple[str, ...]) -> None:
    code = f"import sys; {statement}; print([n for n in {absent!r} if n in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
