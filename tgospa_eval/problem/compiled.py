"""The compiled kernels where they were built; everything works without them, more slowly."""

import os
from importlib import import_module
from typing import Any


def _load() -> Any:
    if os.environ.get("TGOSPA_EVAL_KERNEL") == "numpy":
        return None
    try:
        return import_module("tgospa_eval.problem._kernels")
    except ImportError:
        return None


kernels: Any = _load()
"""The extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` leaves it aside, for comparison."""

KERNEL = "compiled" if kernels else "numpy"
"""Its name in results."""
