"""Base distances and reductions of clouds, made from options."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.options import DEFAULTS, OPTION_SPECS, Request
from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import parsed
from tgospa_eval.distances import Distance, as_distance
from tgospa_eval.distances.base import Fault
from tgospa_eval.distances.vector import Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.headers import BOX, parse_columns
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.trajectories import PLACES

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tgospa_eval.distances import CloudWasserstein, Reduction


REDUCTION_NAMES = ("reduce_method", "directions", "iterations", "restarts", "polish", "seed")


def reduction(options: Request, size: int | None, shared: Sequence[str] = ()) -> "Reduction | None":
    """Return how to reduce particle clouds to `size` particles; None if no size is given.

    Options that the reduction does not use are an error, except those in `shared`, which the
    distance can use.

    Raises
    ------
    ConfigError
        An option needs ``--reduce``, or does not apply to the chosen method of reduction.
    """
    from tgospa_eval.distances import Reduction  # lazy: most states are no clouds

    given = {
        name: value for name in REDUCTION_NAMES if (value := getattr(options, name)) is not None
    }
    if size is None:
        unused = [name for name in given if name not in shared]
        if unused:
            raise ConfigError(f"{option(unused[0])} needs {option('reduce', metavar='N')}")
        return None
    method = given.pop("reduce_method", "sliced")
    for name in [name for name in given if method not in OPTION_SPECS[name].methods]:
        if name in shared:
            del given[name]
        else:
            raise ConfigError(
                f"{option(name)} is for the methods {', '.join(OPTION_SPECS[name].methods)}, "
                f"not for {method}"
            )
    return Reduction(size=size, method=method, **given)


def cloud_distance(options: Request, named: "CloudWasserstein") -> "CloudWasserstein":
    """Return `named`, a distance of clouds, with the settings of the options.

    Raises
    ------
    ConfigError
        Options contradict each other.
    InputError
        The covariance file is missing or wrong.
    """
    from tgospa_eval.distances import PairCloudWasserstein
    from tgospa_eval.formats.text.small import read_matrix

    inner = options.inner or "euclidean"
    pairwise = options.pairwise
    path = options.inner_cov
    if path is not None and inner != "mahalanobis":
        raise ConfigError(f"{option('inner_cov')} is for {option('inner', 'mahalanobis')}")
    matrix: Any = None
    if not isinstance(path, str):
        matrix = path
    elif path not in ("global", "pair"):
        matrix = read_matrix(path, options.decimal)
    shared = tuple(name for name in ("directions", "seed") if hasattr(named, name))
    settings: dict[str, Any] = {
        "order": options.cloud_order or 2,
        "reduction": reduction(options, options.reduce, shared),
        "gating": not options.no_gating,
        **{name: value for name in shared if (value := getattr(options, name)) is not None},
    }
    pair = isinstance(path, str) and path == "pair"
    plain = named.name == PairCloudWasserstein.name
    if pair or (pairwise and inner == "mahalanobis" and path is None and plain):
        if not pairwise or not plain:
            raise ConfigError(
                f"{option('inner_cov', 'pair')} is not a metric, so only associate with "
                "cloud-wasserstein has it; choose global or a file"
            )
        return PairCloudWasserstein(**settings)
    try:
        return replace(named, inner=inner, covariance=matrix, **settings)
    except ConfigError as error:
        if not isinstance(path, str):
            raise
        raise InputError(f"{path}: {error}") from None


def _is_given(value: object, default: object) -> bool:
    """Return whether an option has a value that is not its default.

    An array cannot be compared with a default, so it always counts as given.
    """
    plain = value is None or isinstance(value, int | str | Sequence | Mapping)
    return not plain or (bool(value) and value != default)


class DistanceOptions:
    """Options of the base distance, checked as far as possible without the columns of the files.

    Parameters
    ----------
    options : Request
        Values of the options.
    nees : bool
        Whether NEES is requested. Then the options for covariances apply with any distance.

    Raises
    ------
    ConfigError
        An option has a wrong value, or is not for this distance.
    InputError
        The covariance file is missing or wrong.
    """

    def __init__(self, options: Request, *, nees: bool = False) -> None:
        self.chosen = options.distance is not None
        self.named = as_distance(options.distance)
        self.is_record = self.chosen and not isinstance(options.distance, str)
        self.period = numbers_by_name("periodic", options.periodic, 2 * math.pi)
        self.scale = numbers_by_name("scale", options.scale)
        self.path = options.covariance
        self.mixed = options.mixed
        self.boxes = self.named.columns == BOX
        allowed = () if self.is_record else self.named.options
        of_matrix = "covariance" in allowed
        of_pairs = self.named.name == "mahalanobis" and of_matrix
        of_pairs &= self.path is None and options.pairwise
        if of_pairs:
            from tgospa_eval.distances.mahalanobis import PairMahalanobis

            self.named = PairMahalanobis()
            allowed = (*self.named.options, "covariance")
        if nees:
            allowed += ("fix_cov", "missing_cov")
        for name, about in OPTION_SPECS.items():
            is_free = not about.whose or name in allowed
            if not is_free and _is_given(getattr(options, name), DEFAULTS[name]):
                other = "a distance given as a record" if self.is_record else self.named.name
                way = (
                    f"; for local axes, {option('scale', 'z=W')} does the same"
                    if name == "vertical_weight"
                    else ""
                )
                raise ConfigError(f"{option(name)} is for {about.whose}, not for {other}{way}")
        if of_matrix and not of_pairs:
            if self.path is None:
                raise ConfigError(
                    f"{option('distance', self.named.name)} needs "
                    f"{option('covariance', metavar='FILE')}"
                )
            self.named = _with_covariance(self.named, self.path, options.decimal)
        if options.vertical_weight is not None:
            self.named = _with(self.named, vertical_weight=options.vertical_weight)
        if "mixed" in allowed:
            self.named = _with(self.named, mixed=self.mixed)
        if "cloud_order" in allowed:
            of_clouds: Any = self.named
            self.named = cloud_distance(options, of_clouds)

    @property
    def needed(self) -> tuple[str, ...] | None:
        """State columns that the distance needs; None if readers choose them from the headers."""
        return None if self.boxes else self.named.columns

    @staticmethod
    def columns(
        requested: Sequence[str] | None, needed: tuple[str, ...] | None
    ) -> tuple[str, ...] | None:
        """Return the requested columns; if none of these is a state column, add the `needed`."""
        if needed is None or parse_columns(requested)[1]:
            return None if requested is None else tuple(requested)
        return (*(requested or ()), *needed)

    def fault(self, columns: tuple[str, ...], axes: Floats) -> Fault | None:
        """Return which of R states the distance cannot compare, and why; None for no such state.

        The check is done only if the distance needs certain columns, and if `columns` begins with
        these. `axes` (d, R) has the values of the R states in each of the d columns.
        """
        needed = self.named.columns
        fits = needed is not None and columns[: len(needed)] == needed
        return self.named.fault(axes) if fits else None

    def distance(self, columns: tuple[str, ...]) -> Distance:
        """Return the distance of states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that is no state column; or states are in degrees and no
            distance is chosen.
        """
        if not self.chosen and columns[:2] == PLACES:
            raise ConfigError(
                "lat,lon are degrees, not lengths: choose "
                f"{option('distance', 'haversine')} or geodesic, in metres; "
                f"{option('distance', 'euclidean')} takes them as plain numbers"
            )
        period = _by_column("periodic", self.period, columns, math.inf)
        scale = _by_column("scale", self.scale, columns, 1.0)
        given = {"period": period, "scale": scale}
        return _with(self.named, **{name: value for name, value in given.items() if value})


WIDE = 1.0
"""Number of degrees. A cutoff of this or more (1 degree is 111 km) was probably meant in metres."""


def notices(distance: Distance, columns: tuple[str, ...], cutoff: float) -> list[Notice]:
    """Return notices about a distance that may not suit the state columns or the cutoff."""
    warnings = []
    if isinstance(distance, Norm) and columns[:2] == PLACES:
        mixed = len(columns) > len(PLACES)
        warnings.append(
            Notice(
                code="degrees" if mixed or cutoff >= WIDE else "",
                text=f"{listed(columns)} are compared as plain numbers: "
                + (
                    "degrees are added to other units" * mixed
                    or "c, gamma and errors are in degrees"
                ),
                remedy=f"{option('distance', 'geodesic' if mixed else 'haversine')} gives metres",
            )
        )
    if cutoff > distance.largest:
        warnings.append(
            Notice(
                text=f"cutoff {cutoff:g} is above {distance.largest:g}, the largest distance of "
                f"{distance.name}: every pair of a step is a possible match, even without "
                "overlap; this needs more time and memory"
            )
        )
    return warnings


def _with(distance: Distance, **settings: object) -> Distance:
    """Return the distance with these settings changed; the distance must have them."""
    record: Any = distance
    changed: Distance = replace(record, **settings) if settings else record
    return changed


def _with_covariance(distance: Distance, given: "str | ArrayLike", decimal: str) -> Distance:
    from tgospa_eval.formats.text.small import read_matrix

    if not isinstance(given, str):
        return _with(distance, covariance=given)
    matrix = read_matrix(given, decimal)
    try:
        return _with(distance, covariance=matrix)
    except ConfigError as error:
        raise InputError(f"{given}: {error}") from None


def numbers_by_name(
    keyword: str, items: Sequence[str], default: float | None = None
) -> dict[str, float]:
    """Parse texts such as ``x=2,y=3`` to numbers by name.

    `keyword` is the option, for messages. If `default` is given, a name without ``=`` and number
    gets this number.
    """
    numbers: dict[str, float] = {}
    for item in (part.strip() for text in items for part in str(text).split(",")):
        name, equals, text = (part.strip() for part in item.partition("="))
        number = default if default is not None and not equals else parsed(text)
        if not name or number is None or number <= 0:
            form = "name=number" if default is None else "name or name=number"
            raise ConfigError(
                f"{option(keyword)} {quoted(item)}: must be {form}, with a number > 0"
            )
        if name in numbers:
            raise ConfigError(f"{option(keyword)}: {quoted(name)} is given twice")
        numbers[name] = number
    return numbers


def _by_column(
    keyword: str, numbers: dict[str, float], columns: tuple[str, ...], other: float
) -> tuple[float, ...] | None:
    """Return a number for each column; None if `numbers` is empty.

    Columns that `numbers` lacks get the number `other`. `keyword` is the option, for messages.
    """
    if not numbers:
        return None
    unknown = [name for name in numbers if name not in columns]
    if unknown:
        raise ConfigError(
            f"{option(keyword)}: {quoted(unknown[0])} is not a state column; state columns: "
            f"{','.join(columns)} (see {option('columns')})"
        )
    return tuple(numbers.get(name, other) for name in columns)
