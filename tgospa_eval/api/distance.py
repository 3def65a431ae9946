"""From the options to a base distance."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.options import OF_CLOUDS, Request
from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import parsed
from tgospa_eval.distances import Distance
from tgospa_eval.distances.base import Fault
from tgospa_eval.distances.vector import Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.sides import as_distance
from tgospa_eval.formats.columns.headers import BOX, parse_columns
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.trajectories import PLACES

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tgospa_eval.distances import CloudWasserstein, Reduction


REDUCTION_NAMES = ("reduce_method", "directions", "iterations", "restarts", "polish", "seed")
CLOUD_OPTIONS = ("cloud_order", "inner", "inner_cov", "reduce", *REDUCTION_NAMES, "no_gating")

ITERATED = ("sliced", "recursive", "atl", "kmeans")
USED_BY = {
    "directions": ITERATED[:2],
    "iterations": ITERATED,
    "restarts": ITERATED,
    "polish": ITERATED[:2],
    "seed": (*ITERATED, "systematic", "stratified", "multinomial"),
}
"""Methods that an option of the reduction is for."""


def given_particles(options: Request) -> Iterator[str]:
    """Options of clouds that were given, as they are spelt."""
    for name in CLOUD_OPTIONS:
        value = getattr(options, name)
        if value is not None and (not isinstance(value, int) or value):
            yield _spelt(name)


def reduction(options: Request, size: int | None, shared: Sequence[str] = ()) -> "Reduction | None":
    """How to reduce; None without a size. Some options are `shared` with the distance.

    Raises
    ------
    ConfigError
        An option needs ``--reduce``, or is not for the method.
    """
    from tgospa_eval.distances import Reduction  # here, as below: most states are no clouds

    given = {
        name: value for name in REDUCTION_NAMES if (value := getattr(options, name)) is not None
    }
    if size is None:
        alone = [name for name in given if name not in shared]
        if alone:
            raise ConfigError(f"--{_spelt(alone[0])} is for --reduce N, which is missing")
        return None
    method = given.pop("reduce_method", "sliced")
    for name in [name for name in given if method not in USED_BY[name]]:
        if name in shared:
            del given[name]
        else:
            raise ConfigError(
                f"--{name} is for the methods {', '.join(USED_BY[name])}, not for {method}"
            )
    return Reduction(size=size, method=method, **given)


def cloud_distance(options: Request) -> "CloudWasserstein":
    """The distance that the options ask for.

    Raises
    ------
    ConfigError
        They do not fit each other.
    InputError
        The file of a covariance is missing or wrong.
    """
    from tgospa_eval.distances import CloudWasserstein, PairCloudWasserstein, SlicedWasserstein
    from tgospa_eval.formats.text.small import read_matrix

    inner = options.inner or "euclidean"
    pairwise = options.pairwise
    path = options.inner_cov
    if path is not None and inner != "mahalanobis":
        raise ConfigError("--inner-cov is for --inner mahalanobis")
    matrix: Any = None
    if not isinstance(path, str):
        matrix = path
    elif path not in ("global", "pair"):
        matrix = read_matrix(path, options.decimal)
    named = as_distance(options.distance or OF_CLOUDS[0])
    sliced = named if isinstance(named, SlicedWasserstein) else None
    shared = ("directions", "seed") if sliced else ()
    settings: dict[str, Any] = {
        "order": options.cloud_order or 2,
        "reduction": reduction(options, options.reduce, shared),
        "gating": not options.no_gating,
        **{name: value for name in shared if (value := getattr(options, name)) is not None},
    }
    pair = isinstance(path, str) and path == "pair"
    if pair or (pairwise and inner == "mahalanobis" and path is None and not sliced):
        if not pairwise or sliced:
            raise ConfigError(
                "--inner-cov pair makes no metric, and is for associate with cloud-wasserstein; "
                "take global or a file"
            )
        return PairCloudWasserstein(**settings)
    try:
        if sliced:
            return replace(sliced, inner=inner, covariance=matrix, **settings)
        return CloudWasserstein(inner=inner, covariance=matrix, **settings)
    except ConfigError as error:
        if not isinstance(path, str):
            raise
        raise InputError(f"{path}: {error}") from None


def _spelt(name: str) -> str:
    return name.replace("_", "-")


USUAL = "euclidean"
"""The distance if none is chosen."""


class DistanceOptions:
    """The options of a distance, checked as far as they can be without the columns of the files.

    Parameters
    ----------
    options : Request
        Values of the options.
    nees : bool
        Whether covariances are read for NEES, whatever the distance.

    Raises
    ------
    ConfigError
        An option is not understood, or not one of the distance.
    InputError
        The covariance file is missing or wrong.
    """

    def __init__(self, options: Request, *, nees: bool = False) -> None:
        self.chosen = options.distance is not None
        self.named = as_distance(USUAL if options.distance is None else options.distance)
        self.is_record = self.chosen and not isinstance(options.distance, str)
        self.period = numbers_by_name("periodic", options.periodic, 2 * math.pi)
        self.scale = numbers_by_name("scale", options.scale)
        self.path = options.covariance
        self.mixed = options.mixed
        self.boxes = self.named.columns == BOX
        # By name: to ask for the type would import the members that are not used.
        of_matrix = self.named.name == "mahalanobis" and not self.is_record
        of_pairs = of_matrix and self.path is None and options.pairwise
        moments = self.named.name == "gaussian-wasserstein" and not self.is_record
        of_gaussians = moments or of_pairs or nees
        of_norms = (isinstance(self.named, Norm) and not self.is_record) or moments
        of_heights = self.named.name == "geodesic" and not self.is_record
        zero = options.missing_cov != "error"
        of_clouds = self.named.name in OF_CLOUDS and not self.is_record
        for name, given, allowed, whose in (
            ("periodic", self.period, of_norms, "the norms and gaussian-wasserstein"),
            (
                "scale",
                self.scale,
                of_norms or of_matrix or of_clouds,
                "the norms, mahalanobis, gaussian-wasserstein and distances of clouds",
            ),
            ("fix-cov", options.fix_cov, of_gaussians, "gaussian-wasserstein and NEES"),
            ("missing-cov", zero, of_gaussians, "gaussian-wasserstein and NEES"),
            ("mixed", self.mixed != "error", moments, "gaussian-wasserstein"),
            ("covariance", self.path is not None, of_matrix, "mahalanobis"),
            ("vertical-weight", options.vertical_weight is not None, of_heights, "geodesic"),
            *((name, True, of_clouds, "distances of clouds") for name in given_particles(options)),
        ):
            if given and not allowed:
                other = "a record with settings of its own" if self.is_record else self.named.name
                raise ConfigError(f"--{name} is for {whose}, not for {other}")
        if of_matrix and not of_pairs:
            if self.path is None:
                raise ConfigError("--distance mahalanobis needs --covariance FILE")
            self.named = _mahalanobis(self.path, options.decimal)
        if of_pairs:
            from tgospa_eval.distances.mahalanobis import PairMahalanobis

            self.named = PairMahalanobis()
        if options.vertical_weight is not None:
            self.named = _with(self.named, vertical_weight=options.vertical_weight)
        if moments:
            self.named = _with(self.named, mixed=self.mixed)
        if of_clouds:
            self.named = cloud_distance(options)

    @property
    def needed(self) -> tuple[str, ...] | None:
        """State columns that the distance needs; None where readers find them."""
        return None if self.boxes else self.named.columns

    @staticmethod
    def columns(
        asked: Sequence[str] | None, needed: tuple[str, ...] | None
    ) -> tuple[str, ...] | None:
        """State columns to read: those asked for, else those that are needed."""
        if needed is None or parse_columns(asked)[1]:
            return None if asked is None else tuple(asked)
        return (*(asked or ()), *needed)

    def fault(self, columns: tuple[str, ...], axes: Floats) -> Fault | None:
        """Which states (d, R) the distance cannot compare, if it needs such columns."""
        needed = self.named.columns
        fits = needed is not None and columns[: len(needed)] == needed
        return self.named.fault(axes) if fits else None

    def distance(self, columns: tuple[str, ...]) -> Distance:
        """The distance of states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that does not enter the distance, or states are in degrees, and
            no distance is chosen.
        """
        if not self.chosen and columns[:2] == PLACES:
            raise ConfigError(
                "lat,lon are degrees, whose differences are no lengths: choose --distance "
                "haversine or geodesic, in metres; --distance euclidean takes them as plain numbers"
            )
        period = _by_column("periodic", self.period, columns, math.inf)
        scale = _by_column("scale", self.scale, columns, 1.0)
        given = {"period": period, "scale": scale}
        return _with(self.named, **{name: value for name, value in given.items() if value})


WIDE = 1.0
"""Degrees, 111 km: a larger cutoff was meant in metres."""


def notices(distance: Distance, columns: tuple[str, ...], cutoff: float) -> list[Notice]:
    """What the user should know about the choice."""
    found = []
    if isinstance(distance, Norm) and columns[:2] == PLACES:
        mixed = len(columns) > len(PLACES)
        found.append(
            Notice(
                code="degrees" if mixed or cutoff >= WIDE else "",
                text=f"{listed(columns)} are compared as plain numbers: "
                + ("degrees are added to others" * mixed or "c, gamma and errors are in degrees"),
                remedy=f"--distance {'geodesic' if mixed else 'haversine'} gives metres",
            )
        )
    if distance.name == "iou" and cutoff > 1:
        found.append(
            Notice(
                text=f"cutoff {cutoff:g} is above 1, the largest distance of boxes: all pairs of a "
                "step count as near, also those that share nothing; time and memory grow with all "
                "pairs"
            )
        )
    return found


def _with(distance: Distance, **settings: object) -> Distance:
    """The same distance with other settings, which are those of its type."""
    record: Any = distance
    changed: Distance = replace(record, **settings)
    return changed


def _mahalanobis(given: "str | ArrayLike", decimal: str) -> Distance:
    from tgospa_eval.distances.mahalanobis import Mahalanobis
    from tgospa_eval.formats.text.small import read_matrix

    if not isinstance(given, str):
        return Mahalanobis(covariance=given)
    matrix = read_matrix(given, decimal)
    try:
        return Mahalanobis(covariance=matrix)
    except ConfigError as error:
        raise InputError(f"{given}: {error}") from None


def numbers_by_name(
    option: str, items: Sequence[str], default: float | None = None
) -> dict[str, float]:
    """Numbers by name of ``name=number,name=number``."""
    found: dict[str, float] = {}
    for item in (part.strip() for text in items for part in str(text).split(",")):
        name, equals, text = (part.strip() for part in item.partition("="))
        number = default if default is not None and not equals else parsed(text)
        if not name or number is None or number <= 0:
            form = "name=number" if default is None else "name or name=number"
            raise ConfigError(f"--{option} {quoted(item)}: must be {form}, with a number > 0")
        if name in found:
            raise ConfigError(f"--{option}: {quoted(name)} is given twice")
        found[name] = number
    return found


def _by_column(
    option: str, numbers: dict[str, float], columns: tuple[str, ...], other: float
) -> tuple[float, ...] | None:
    """One number for each column, None if none is given."""
    if not numbers:
        return None
    unknown = [name for name in numbers if name not in columns]
    if unknown:
        raise ConfigError(
            f"--{option}: {quoted(unknown[0])} is none of the state columns {','.join(columns)}; "
            "choose them with --columns"
        )
    return tuple(numbers.get(name, other) for name in columns)
