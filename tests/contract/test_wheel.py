"""What a wheel brings, built from a tree with the leavings of an older build."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest
from checkout import ROOT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    tree = tmp_path_factory.mktemp("tree")
    for name in ("LICENSE", "README.md", "pyproject.toml", "setup.py"):
        shutil.copy(ROOT / name, tree)
    for name in ("kernels/_kernels.pyx", "formats/text/_scan.pyx", "kept.py"):
        (tree / "tgospa_eval" / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / "tgospa_eval" / name).touch()
    shutil.copy(ROOT / "tgospa_eval/_version.py", tree / "tgospa_eval")
    (tree / "tgospa_eval/__init__.py").touch()
    for name in ("lib", "lib.linux-x86_64-cpython-311"):
        stale = tree / "build" / name / "tgospa_eval"
        stale.mkdir(parents=True)
        (stale / "deleted.py").touch()
    subprocess.run(
        [sys.executable, "-c", "from setuptools import build_meta; build_meta.build_wheel('dist')"],
        check=True,
        capture_output=True,
        cwd=tree,
        env=os.environ | {"CC": "false"},  # the extensions are optional
    )
    return zipfile.ZipFile(next((tree / "dist").glob("*.whl")))


def test_modules_that_were_deleted_are_not_in_it(wheel: zipfile.ZipFile) -> None:
    names = {Path(name).name for name in wheel.namelist()}
    assert "kept.py" in names
    assert "deleted.py" not in names


def test_its_description_has_absolute_links_to_files_that_are_there(wheel: zipfile.ZipFile) -> None:
    name = next(name for name in wheel.namelist() if name.endswith("METADATA"))
    metadata = message_from_bytes(wheel.read(name))
    urls = dict(str(url).split(", ") for url in metadata.get_all("Project-URL", []))
    assert {"Source", "Documentation", "Changelog", "Issues"} <= urls.keys()
    text = metadata.get_payload()
    assert isinstance(text, str)
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert len(links) > 20
    for link in (*links, urls["Documentation"], urls["Changelog"]):
        kind, _, path = link.removeprefix(f"{urls['Source']}/").partition("/HEAD/")
        assert kind in ("blob", "raw"), link
        assert (ROOT / path.partition("#")[0]).is_file(), link
        assert (kind == "raw") == path.endswith(".png")
