"""The options of states that are more than points: Gaussians, and clouds of particles."""

from functools import partial

import click

from tgospa_eval.cli.shared.option import option

REDUCTIONS = (
    "sliced",
    "recursive",
    "atl",
    "kmeans",
    "systematic",
    "stratified",
    "multinomial",
    "top",
)

COUNT = click.IntRange(min=1)
_gaussians = partial(option, section="Gaussians")
_particles = partial(option, section="Particles")

GAUSSIANS = (
    _gaussians(
        "--fix-cov",
        is_flag=True,
        help="Replace a matrix that is no covariance by the nearest one that is. Without it such "
        "a matrix is an error.",
    ),
    _gaussians(
        "--missing-cov",
        type=click.Choice(("error", "zero")),
        metavar="NAME",
        default="error",
        help="A row without covariance is an error, or a point (zero).",
    ),
    _gaussians(
        "--mixed",
        type=click.Choice(("error", "moments")),
        metavar="NAME",
        default="error",
        help="A particle cloud is an error, or a Gaussian with its mean and covariance (moments).",
    ),
)

REDUCTION = (
    _particles(
        "--reduce-method",
        type=click.Choice(REDUCTIONS),
        metavar="METHOD",
        show_default="sliced",
        help="How clouds are reduced. sliced, recursive: least squares on projections; atl: "
        "transport and new locations in turn; kmeans: clustering; systematic, stratified, "
        "multinomial: resampling; top: the highest weights.",
    ),
    _particles(
        "--directions",
        type=COUNT,
        metavar="N",
        show_default="32; 24 each from 3-D on",
        help="Number of projections of sliced and recursive.",
    ),
    _particles(
        "--iterations",
        type=COUNT,
        metavar="N",
        show_default="25",
        help="Most iterations of sliced, recursive, atl and kmeans.",
    ),
    _particles(
        "--restarts",
        type=COUNT,
        metavar="N",
        show_default="1",
        help="Number of starts of these four; the nearest result is kept.",
    ),
    _particles(
        "--polish",
        type=click.IntRange(min=0),
        metavar="N",
        show_default="0",
        help="Number of atl iterations after sliced and recursive.",
    ),
    _particles(
        "--seed",
        type=click.IntRange(min=0),
        metavar="N",
        show_default="0",
        help="Seed of the random choices; equal clouds are reduced alike.",
    ),
)
"""How clouds are reduced; without defaults, to see what was given."""

PARTICLES = (
    _particles(
        "--cloud-order",
        type=click.IntRange(1, 2),
        metavar="1|2",
        show_default="2",
        help="Order of the Wasserstein distance, whatever the order p of the metric is.",
    ),
    _particles(
        "--inner",
        type=click.Choice(("euclidean", "mahalanobis")),
        metavar="NAME",
        show_default="euclidean",
        help="Distance between two particles: euclidean or mahalanobis.",
    ),
    _particles(
        "--inner-cov",
        metavar="global|FILE",
        show_default="global",
        help="Covariance of --inner mahalanobis. global: the mean over all clouds; or a CSV file "
        "with a matrix. With associate also pair, its default: the mean of the two clouds.",
    ),
    _particles(
        "--reduce",
        type=COUNT,
        metavar="N",
        help="Reduce clouds to N particles first.",
    ),
    *REDUCTION,
    _particles(
        "--no-gating",
        is_flag=True,
        help="Solve all pairs of clouds, also those that bounds show to be far apart. Slow; to "
        "check the bounds.",
    ),
)
"""Of clouds as states."""
