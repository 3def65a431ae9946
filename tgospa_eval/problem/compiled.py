"""The compiled kernels where they were built; everything works without them, more slowly."""

from typing import Any

from tgospa_eval.common.machine import compiled

kernels: Any = compiled("tgospa_eval.problem._kernels")
"""The extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` leaves it aside, for comparison."""

KERNEL = "compiled" if kernels else "numpy"
"""Its name in results."""
