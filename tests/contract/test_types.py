"""What editors and type checkers know of the keywords, and whether it is true."""

import inspect
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from checkout import ROOT

import tgospa_eval
from tgospa_eval import distances

sys.path.insert(0, str(ROOT / "docs"))
import option_types

CALLS = ROOT / "tests" / "support" / "typed_calls.py"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
SETTINGS = """
[mypy]
python_version = 3.11
strict = True
follow_imports = silent
follow_imports_for_stubs = True
cache_dir = {cache}
[mypy-IPython.*,click.*,cvxpy.*,distributed.*,highspy.*,jinja2.*,matplotlib.*,pyarrow.*,scipy.*]
follow_imports = skip
"""
"""Of mypy, for calls alone: what the package does inside is for `make lint`."""
Checker = Callable[[list[Path]], set[tuple[str, int, str]]]
OF_CALLS = {"call-arg", "arg-type", "reportCallIssue", "reportArgumentType"}
"""Codes of errors in calls: pages give a name first one value, and then another."""


def test_the_types_are_those_of_the_options() -> None:
    made = option_types.TARGET.read_text(encoding="utf-8")
    assert made == option_types.text(), "run: python docs/option_types.py"


def test_no_keyword_is_left_out_and_nothing_is_imported() -> None:
    from tgospa_eval.api import option_types as types

    for function in option_types.FUNCTIONS:
        called = getattr(tgospa_eval, function)
        own = inspect.signature(called.__wrapped__).parameters
        typed = getattr(types, option_types.title_of(function)).__annotations__
        assert {*own, *typed} - {"options"} == {*inspect.signature(called).parameters}
        assert not {*own} & {*typed}
    code = "import sys, tgospa_eval as t; t.evaluate, t.batch, t.gate; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "tgospa_eval.api.option_types" not in done.stdout.split()


def test_distances_are_listed() -> None:
    assert {"Norm", "Geodesic", "Distance", "cloud_wasserstein"} <= {*dir(distances)}
    assert all(hasattr(distances, name) for name in dir(distances))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The Python of each page as a module."""
    folder = tmp_path_factory.mktemp("pages")
    made = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
        if blocks:
            name = "_".join(page.relative_to(ROOT).with_suffix("").parts).replace("-", "_")
            made.append(folder / f"{name}.py")
            made[-1].write_text("\n".join(blocks), encoding="utf-8")
    return made


def by_mypy(files: list[Path]) -> set[tuple[str, int, str]]:
    pytest.importorskip("mypy", reason="mypy is in the extra test")
    settings = files[-1].with_name("mypy.ini")
    settings.write_text(SETTINGS.format(cache=ROOT / ".mypy_cache" / "calls"), encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--no-error-summary", "--config-file", str(settings)]
    done = subprocess.run(
        [*command, *map(str, files)], capture_output=True, text=True, cwd=ROOT, timeout=600
    )
    assert done.returncode in (0, 1), done.stderr
    lines = re.findall(r"^(.+?):(\d+): error: .*?\[([\w-]+)\]$", done.stdout, re.M)
    return {(Path(file).name, int(line), code) for file, line, code in lines}


def by_pyright(files: list[Path]) -> set[tuple[str, int, str]]:
    near = Path(sys.executable).with_name("pyright")
    program = str(near) if near.exists() else shutil.which("pyright")
    if program is None:
        pytest.skip("pyright is not installed; it is in the extra test")
    probe = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=600)
    if probe.returncode:
        pytest.skip("pyright does not start: at first it fetches Node.js and itself")
    done = subprocess.run(
        [program, "--pythonpath", sys.executable, "--outputjson", *map(str, files)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=600,
    )
    return {
        (Path(one["file"]).name, one["range"]["start"]["line"] + 1, one.get("rule", ""))
        for one in json.loads(done.stdout)["generalDiagnostics"]
        if one["severity"] == "error"
    }


@pytest.mark.types
@pytest.mark.parametrize("check", [by_mypy, by_pyright])
def test_a_type_checker_takes_right_calls_and_no_other(check: Checker, pages: list[Path]) -> None:
    """Those of the pages by one of them: the other takes three times as long for them."""
    errors = check([CALLS, *(pages if check is by_mypy else ())])
    lines = CALLS.read_text(encoding="utf-8").splitlines()
    wrong = {number for number, line in enumerate(lines, 1) if "  # wrong" in line}
    assert len(wrong) > 25
    assert {line for file, line, _ in errors if file == CALLS.name} == wrong
    of_pages = [one for one in errors if one[0] != CALLS.name and one[2] in OF_CALLS]
    assert of_pages == []
