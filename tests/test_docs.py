"""The Python examples of README and docs run as they stand.

In a folder that has the sample data, as a checkout has, and the quickstart pair as truth.csv and
estimate.csv, as the tutorial has.
"""

import re
import shutil
from pathlib import Path

import pytest

from tgospa_eval.cli import main

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
    """Commands of ours in console blocks, with the lines that the page shows of their output."""
    found = []
    for block in re.findall(
        r"^```console\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S
    ):
        for part in re.split(r"^\$ ", block, flags=re.M)[1:]:
            command, *lines = part.splitlines()
            if command.startswith("tgospa-eval "):
                found.append((command, lines))
    return found


SHOWING = [
    "index.md",
    "tutorial.md",
    "how-to/asynchronous-stamps.md",
    "how-to/number-looks-wrong.md",
]


@pytest.mark.parametrize("page", SHOWING)
def test_shown_output_is_true(
    page: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "sample_data" / "quickstart", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    shown = runs(ROOT / "docs" / page)
    assert shown
    names: dict[str, object] = {}
    for code in blocks(ROOT / "docs" / page):
        exec(compile(code, page, "exec"), names)
    capfd.readouterr()
    for command, lines in shown:
        with pytest.raises(SystemExit) as ended:
            main(command.split()[1:])
        assert ended.value.code == 0
        out, err = capfd.readouterr()
        printed = [line for line in (err + out).splitlines() if "compiled kernels" not in line]
        stop = lines.index("...") if "..." in lines else len(lines)
        timeless = [line for line in lines[:stop] if "seconds" not in line]
        assert timeless == [line for line in printed if "seconds" not in line][: len(timeless)]
