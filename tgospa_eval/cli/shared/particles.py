"""From the options of particle clouds to records."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from tgospa_eval.cli.shared.values import EvaluationOptions
from tgospa_eval.errors import ConfigError, InputError

if TYPE_CHECKING:
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


def given_particles(options: EvaluationOptions) -> Iterator[str]:
    """Options of clouds that were given, as they are spelt."""
    yield from (_spelt(name) for name in CLOUD_OPTIONS if getattr(options, name))


def reduction(options: EvaluationOptions, size: int | None) -> "Reduction | None":
    """How to reduce; None without a size.

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
        if given:
            raise ConfigError(f"--{_spelt(next(iter(given)))} is for --reduce N, which is missing")
        return None
    method = given.pop("reduce_method", "sliced")
    for name in given:
        if method not in USED_BY[name]:
            raise ConfigError(
                f"--{name} is for the methods {', '.join(USED_BY[name])}, not for {method}"
            )
    return Reduction(size=size, method=method, **given)


def cloud_distance(options: EvaluationOptions) -> "CloudWasserstein":
    """The distance that the options ask for.

    Raises
    ------
    ConfigError
        They do not fit each other.
    InputError
        The file of a covariance is missing or wrong.
    """
    from tgospa_eval.distances import CloudWasserstein, PairCloudWasserstein
    from tgospa_eval.formats.text.matrix import read_matrix

    inner = options.inner or "euclidean"
    pairwise = options.pairwise
    path = options.inner_cov
    if path and inner != "mahalanobis":
        raise ConfigError("--inner-cov is for --inner mahalanobis")
    matrix = None if path in (None, "global", "pair") else read_matrix(path, options.decimal)
    settings: dict[str, Any] = {
        "order": options.cloud_order or 2,
        "reduction": reduction(options, options.reduce),
        "gating": not options.no_gating,
    }
    if path == "pair" or (pairwise and inner == "mahalanobis" and not path):
        if not pairwise:
            raise ConfigError(
                "--inner-cov pair makes no metric, and is for associate; take global or a file"
            )
        return PairCloudWasserstein(**settings)
    try:
        return CloudWasserstein(inner=inner, covariance=matrix, **settings)
    except ConfigError as error:
        if matrix is None:
            raise
        raise InputError(f"{path}: {error}") from None


def _spelt(name: str) -> str:
    return name.replace("_", "-")
