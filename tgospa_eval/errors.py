"""The exceptions that a user can meet, and the exit statuses of the command line.

TgospaError
    ConfigError    options, configuration files, arguments of functions (exit 2)
    InputError     the content of an input file or table (exit 3)
    SolverError    a solver failed and left no usable answer (exit 4)

TgospaWarning is the category of Python warnings that the data look wrong or were repaired.
"""

from enum import IntEnum
from operator import index

from tgospa_eval.quoting import visible

LARGEST_COUNT = 2**31 - 2
"""Largest number of things with 32-bit indices. The end of a range of indices can be one larger. It
still fits into 32 bits."""


class ExitStatus(IntEnum):
    """Exit statuses of the command line (docs/reference/cli.md)."""

    DONE = 0
    REGRESSION = 1  # gate: a regression is proven
    NOT_PROVEN = 1  # verify: the folder does not prove its claim
    WRONG_OPTION = 2
    WRONG_INPUT = 3
    NOT_REACHED = 4  # requested accuracy not reached, or a fault of a solver or of this program
    INTERRUPTED = 130


class TgospaError(Exception):
    """Base class of the errors of this package.

    Parameters
    ----------
    *lines : str
        Lines of the message. Line breaks and control characters within a line are escaped, so that
        text of a file cannot begin a line or send commands to a terminal.
    """

    exit_status = ExitStatus.NOT_REACHED

    def __init__(self, *lines: object) -> None:
        super().__init__(*(visible(str(line)) for line in lines))

    def __str__(self) -> str:
        return "\n".join(self.args)


class ConfigError(TgospaError, ValueError):
    """Error in an option or argument; the message names the option and the allowed values."""

    exit_status = ExitStatus.WRONG_OPTION


class MemoryTooSmallError(ConfigError):
    """Error that the memory limit is too small; the work can begin again with another limit."""

    @property
    def reason(self) -> str:
        """First part of the message, without the advice."""
        return str(self).partition("; ")[0]


def real_number(name: str, value: object) -> float:
    """Return the value as a float.

    Raises
    ------
    ConfigError
        The value is not a number.
    """
    if isinstance(value, bool | str | bytes):
        raise ConfigError(f"{name} is {value!r}: must be a number")
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ConfigError(f"{name} is {value!r}: must be a number") from None


def whole_number(name: str, value: object, minimum: int = 1, maximum: int | None = None) -> int:
    """Return the value as an int from `minimum` to `maximum`.

    Raises
    ------
    ConfigError
        The value is not a whole number, or it is outside these limits.
    """
    try:
        number = None if isinstance(value, bool) else index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or number < minimum or (maximum is not None and number > maximum):
        allowed = f"{minimum} or more" if maximum is None else f"from {minimum} to {maximum}"
        raise ConfigError(f"{name} is {value!r}: must be a whole number, {allowed}")
    return number


class NothingLeftError(ConfigError):
    """Error that the options leave out all rows. A batch takes 0 as the total of such a job."""


class InputError(TgospaError, ValueError):
    """Error in an input file or table; the message has place, error and remedy."""

    exit_status = ExitStatus.WRONG_INPUT


def check_size(what: str, count: int) -> None:
    """Check that 32-bit indices suffice for a count; `what` names the counted things.

    Raises
    ------
    InputError
        The count is above `LARGEST_COUNT`.
    """
    if count > LARGEST_COUNT:
        raise InputError(
            f"{count} {what} are too many, at most {LARGEST_COUNT} are possible; evaluate the "
            "scene in parts, or with a smaller cutoff"
        )


class TgospaWarning(UserWarning):
    """Warning about data that look wrong, as in `Result.warnings`."""


class SolverError(TgospaError, RuntimeError):
    """Error of a solver that gave no usable answer."""

    exit_status = ExitStatus.NOT_REACHED
