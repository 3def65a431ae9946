"""The two sides as they were compared, and what is proven of them. Knows no solver and no file."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.solution import Reduced
from tgospa_eval.problem.states import States
from tgospa_eval.results.records import Costs, Labels

if TYPE_CHECKING:
    from tgospa_eval.tracks.alignment import Held
    from tgospa_eval.tracks.clouds import Clouds


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSides:
    """The two sides as they were compared, after filters, grid and joined stamps.

    Parameters
    ----------
    moments : (T,) int or float array
        The steps, as numbers.
    labels : Labels
        Ids.
    settings : mapping of str to object
        Every option that changes the number.
    columns : tuple of str
        Names of the d state columns.
    truth, estimate : (R, d) float arrays
        States as they were read, before the distance prepared them, in the order of the rows of the
        problem, by step and track.
    truth_covariance, estimate_covariance : (R, d (d + 1) / 2) float arrays, optional
        Lower triangles of the covariances of these states, of clouds the second moments: for NEES
        and pictures.
    truth_clouds, estimate_clouds : Clouds, optional
        The particles.
    held : Held, optional
        Reports of which the rows of the estimate are, on a common clock.
    """

    moments: NDArray[Any]
    labels: Labels
    settings: Mapping[str, object]
    columns: tuple[str, ...]
    truth: Floats
    estimate: Floats
    truth_covariance: Floats | None = None
    estimate_covariance: Floats | None = None
    truth_clouds: "Clouds | None" = None
    estimate_clouds: "Clouds | None" = None
    held: "Held | None" = None


@dataclass(frozen=True, kw_only=True, eq=False)
class PairProof(Costs):
    """What `certify` returned, with what it was proven for.

    Parameters
    ----------
    states : States
        The reduced problem.
    weights : (S,) int array
        The feasible assignment.
    prices : (K,) float array
        The prices of the lower bound.
    reduced : tuple of Reduced
        Blocks whose lower bound is of a smaller cutoff.
    compared : ComparedSides
        What the numbers of steps and tracks stand for.
    """

    states: States
    weights: Ints
    prices: Floats
    reduced: tuple[Reduced, ...]
    compared: ComparedSides
