"""Checks of the settings that solvers share."""

import numpy as np

from tgospa_eval.errors import ConfigError, real_number


def check_gap(gap: float) -> float:
    """The gap as a float.

    Raises
    ------
    ConfigError
        The gap is no number, negative or infinite.
    """
    gap = real_number("gap", gap)
    if not 0 <= gap < np.inf:
        raise ConfigError(f"gap is {gap:g}: must be finite and 0 or more")
    return gap


def check_time_limit(seconds: float | None) -> float | None:
    """The limit as a float; None is no limit.

    Raises
    ------
    ConfigError
        The limit is no number, infinite, zero or negative.
    """
    if seconds is None:
        return None
    seconds = real_number("time limit", seconds)
    if not 0 < seconds < np.inf:
        raise ConfigError(f"time limit is {seconds:g} s: must be finite and more than 0")
    return seconds


def check_jobs(jobs: int | None) -> int | None:
    """The number of threads; None is all cores.

    Raises
    ------
    ConfigError
        The number is no whole number of at least 1.
    """
    if jobs is None:
        return None
    if isinstance(jobs, bool) or not isinstance(jobs, int | np.integer) or jobs < 1:
        raise ConfigError(f"jobs is {jobs!r}: must be a whole number, 1 or more")
    return int(jobs)
