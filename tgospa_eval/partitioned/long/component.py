"""A long component, and what is proven of it."""

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.long.rows import RowsTask
from tgospa_eval.partitioned.long.tables import WindowPiece
from tgospa_eval.partitioned.share import PartialSums
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters

OVERLAP = 20
"""Steps with near pairs that a window has on either side of what its answer is for."""


@dataclass(frozen=True, kw_only=True)
class Long:
    """A component to solve in windows.

    Parameters
    ----------
    entries : tuple of str
        Files of ENTRY, by time.
    parameters : Parameters
        Of the metric.
    work : str
        Folder for what lies between.
    gap : float
        Relative gap that counts as exact.
    together : int
        Entries that a task may hold.
    overlap : int
        Steps with entries on either side of a window.
    end : float, optional
        In `time.time()`: what is not solved by then is left unassigned.
    """

    entries: tuple[str, ...]
    parameters: Parameters
    work: str
    gap: float = 1e-9
    together: int = 1_000_000
    overlap: int = OVERLAP
    end: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ComponentBounds:
    """What is proven.

    Parameters
    ----------
    share : PartialSums
        What the component contributes.
    folders : tuple of str
        What it contributes, as folders of shards; all but one have an empty share.
    pieces : tuple of WindowPiece
        Whose answers it was made of.
    rows : tuple of RowsTask
        By which it was proven.
    lost : (L,) float array
        Prices that nobody pays, by step.
    regret : (3, N) float array
        Of rows that could do better: by how much, first and last step.
    """

    share: PartialSums
    folders: tuple[str, ...]
    pieces: tuple[WindowPiece, ...]
    rows: tuple[RowsTask, ...]
    lost: Floats
    regret: Floats
