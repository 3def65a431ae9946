"""The compiled kernels, if they were built; without them everything works, but is slower."""

from typing import Any

from tgospa_eval.common.machine import compiled

REGRET = 1e-11
"""A regret of a row up to this size may come from rounding: sums of gains round to 1e-12."""

kernels: Any = compiled("tgospa_eval.kernels._kernels")
"""The extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` makes it None, for comparisons."""

KERNEL = "compiled" if kernels else "numpy"
"""Name of the kernels in results."""
