"""The compiled kernels where they were built; everything works without them, more slowly."""

import os
from typing import Any


def _load() -> Any:
    if os.environ.get("TGOSPA_EVAL_KERNEL") == "numpy":
        return None
    try:
        from tgospa_eval import _kernels
    except ImportError:
        return None
    return _kernels


kernels: Any = _load()
"""The extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` leaves it aside, for comparison."""

KERNEL = "compiled" if kernels else "numpy"
"""Its name in results."""
