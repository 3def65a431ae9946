"""Sliding windows: stretches of as many steps, each some steps after the one before."""

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.problem import Ints


@dataclass(frozen=True, kw_only=True)
class Sliding:
    """Windows of `size` steps that begin at the steps 0, `every`, 2 `every`, and so on.

    Parameters
    ----------
    size : int
        Steps of each, 1 or more; no more than there are.
    every : int
        Steps from one to the next, from 1 to `size`, so that each step is in a window.

    Raises
    ------
    ConfigError
        A number is out of its range.
    """

    size: int
    every: int

    def __post_init__(self) -> None:
        for name, value in (("window", self.size), ("every", self.every)):
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if not whole or value < 1:
                raise ConfigError(
                    f"{name} is {value!r}: must be a whole number of steps, 1 or more"
                )
        if self.every > self.size:
            raise ConfigError(
                f"every is {self.every}: must be at most the {self.size} steps of a window, or "
                "there would be steps in none"
            )

    @classmethod
    def asked(cls, window: int | None, every: int | None) -> "Sliding | None":
        """From options: `every` is half a window by default; None without a window.

        Raises
        ------
        ConfigError
            `every` is given without a window, or a number is out of its range.
        """
        if window is None:
            if every is not None:
                raise ConfigError("every is given without window: say how long a window is")
            return None
        half = cls(size=window, every=1).size // 2
        return cls(size=window, every=max(half, 1) if every is None else every)

    def spans(self, steps: int) -> tuple[Ints, Ints]:
        """First and last step of each window among so many steps, (K,), (K,).

        Where the last regular window ends before the last step, one more ends with it, so that all
        are of one length and no step is left out.
        """
        size = min(self.size, steps)
        every = min(self.every, size)  # numbers of any size are asked for
        first = np.arange(0, steps - size + 1, every) if steps else np.zeros(0, np.int64)
        if len(first) and first[-1] + size < steps:
            first = np.append(first, steps - size)
        return first, first + size - 1
