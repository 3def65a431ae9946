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
        "Replace a matrix that is no covariance by the nearest one that is. Without it such a "
        "matrix is an error.",
    ),
    _gaussians(
        "--missing-cov NAME",
        "A row without covariance is an error, or a point (zero).",
        type=click.Choice(("error", "zero")),
        default="error",
    ),
    _gaussians(
        "--mixed NAME",
        "A particle cloud is an error, or a Gaussian with its mean and covariance (moments).",
        type=click.Choice(("error", "moments")),
        default="error",
    ),
)

REDUCTION = (
    _particles(
        "--reduce-method METHOD",
        "How clouds are reduced. sliced, recursive: least squares on projections; atl: transport "
        "and new locations in turn; kmeans: clustering; systematic, stratified, multinomial: "
        "resampling; top: the highest weights.",
        type=click.Choice(REDUCTIONS),
        show_default="sliced",
    ),
    _particles(
        "--directions N",
        "Number of projections of sliced and recursive.",
        type=COUNT,
        show_default="32; 24 each from 3-D on",
    ),
    _particles(
        "--iterations N",
        "Most iterations of sliced, recursive, atl and kmeans.",
        type=COUNT,
        show_default="25",
    ),
    _particles(
        "--restarts N",
        "Number of starts of these four; the nearest result is kept.",
        type=COUNT,
        show_default="1",
    ),
    _particles(
        "--polish N",
        "Number of atl iterations after sliced and recursive.",
        type=click.IntRange(min=0),
        show_default="0",
    ),
    _particles(
        "--seed N",
        "Seed of the random choices; equal clouds are reduced alike.",
        type=click.IntRange(min=0),
        show_default="0",
    ),
)
"""How clouds are reduced; without defaults, to see what was given."""

PARTICLES = (
    _particles(
        "--cloud-order 1|2",
        "Order of the Wasserstein distance, whatever the order p of the metric is.",
        type=click.IntRange(1, 2),
        show_default="2",
    ),
    _particles(
        "--inner NAME",
        "Distance between two particles: euclidean or mahalanobis.",
        type=click.Choice(("euclidean", "mahalanobis")),
        show_default="euclidean",
    ),
    _particles(
        "--inner-cov global|FILE",
        "Covariance of --inner mahalanobis. global: the mean over all clouds; or a CSV file with "
        "a matrix. With associate also pair, its default: the mean of the two clouds.",
        show_default="global",
    ),
    _particles("--reduce N", "Reduce clouds to N particles first.", type=COUNT),
    *REDUCTION,
    _particles(
        "--no-gating",
        "Solve all pairs of clouds, also those that bounds show to be far apart. Slow; to check "
        "the bounds.",
    ),
)
"""Of clouds as states."""
