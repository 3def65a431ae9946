"""How a solver ended. The value is what the user reads; nobody looks into it."""

from enum import StrEnum


class Status(StrEnum):
    """Why a solver stopped."""

    SOLVED = "solved"
    NOT_SOLVED = "not solved"
    LATE = "stopped by the time limit"
    INTERRUPTED = "interrupted"
    MET = "the bracket is met"
    SETTLED = "the bracket has stopped narrowing"
    FULL = "columns are full to 1e-06"
    SWEPT = "reached 2,000 sweeps"
    HIGHS_FAILED = "HiGHS failed"
    CLARABEL_FAILED = "failed"

    @property
    def good(self) -> bool:
        """Whether there was nothing left to do."""
        return self in (Status.SOLVED, Status.MET)
