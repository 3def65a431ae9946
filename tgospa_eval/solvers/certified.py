"""The exact solver: prices by entropic ascent, then the linear programme of what is left open.

Whatever happens here only proposes; the bracket is made by `tgospa_eval.result.certify`.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tgospa_eval.compiled import kernels
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem import Floats, Ints
from tgospa_eval.result import ONE, Solution, repair
from tgospa_eval.solvers.ascent import Ascent
from tgospa_eval.solvers.kernels import capped_price, check_time_limit, settled
from tgospa_eval.solvers.residual import residual
from tgospa_eval.solvers.rounding import polish
from tgospa_eval.solvers.trivial import solve_trivial
from tgospa_eval.states import States
from tgospa_eval.timing import Stopwatch

STAGES = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
SWEEPS = 16
"""Temperatures, as fractions of c^p, and sweeps at each."""

ROUNDS = ((0.03, 0.03), (0.1, 0.03), (0.3, 0.1), (0.3, 0.1), (1.0, 0.3), (np.inf, np.inf))
FEW = 3000
BATCH = 20_000
