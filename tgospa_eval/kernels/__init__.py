"""The compiled kernels where they were built; everything works without them, more slowly."""

from typing import Any

from tgospa_eval.common.machine import compiled

REGRET = 1e-11
"""Gain of a row by leaving its path that may be rounding: sums of gains round to 1e-12."""

kernels: Any = compiled("tgospa_eval.kernels._kernels")
"""The extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` leaves it aside, for comparison."""

KERNEL = "compiled" if kernels else "numpy"
"""Its name in results."""
