"""What pyproject.toml cannot say: builds begin clean, and links in the description are absolute."""

import re
import shutil
import tomllib
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent

for stale in ROOT.glob("build/lib*"):  # modules of an old build would go into the next wheel
    shutil.rmtree(stale)

home = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"][
    "Source"
]
readme = (ROOT / "README.md").read_text(encoding="utf-8")
readme = re.sub(r"(!\[[^]]*\]\()(?!https:)", rf"\1{home}/raw/HEAD/", readme)
readme = re.sub(r"(\]\()(?!https:|#)", rf"\1{home}/blob/HEAD/", readme)

setup(long_description=readme, long_description_content_type="text/markdown")
