"""A particle PHD filter with labels of tracks, for measurements that are missed or false.

[Danu] has such a filter (TLPHD) of another source, which says more about labels than is known
here. This one keeps a cloud for each label. Its weights sum to the expected number of targets of
that label, and all clouds are corrected together, as a PHD is:

    w <- w (1 - P_D + sum_z P_D g(z | x) / (kappa + sum over all particles of P_D g(z | x) w)).

What no track explains of a measurement begins a new label. Labels neither split nor merge.
"""

from dataclasses import dataclass

import numpy as np
from crossing import NOISE, PLACE, STEPS, Cloud, Floats, moved

REGION = np.array([(-100.0, 60.0), (-20.0, 80.0)])
"""Where false measurements come from, in x and y; the source does not tell its own."""

FALSE, DETECTED, SURVIVES = 4.0, 0.95, 0.99
"""False measurements per scan (as in the source), probabilities (not said there)."""

BIRTH, SPEED = 0.02, 4.0
"""Expected targets in an unexplained measurement; standard deviation of their velocities."""

REPORTED, FORGOTTEN = 0.5, 1e-3
"""Expected targets from which a label is a track, and below which it ends."""

PARTICLES, FIRST = 2000, 500
"""Particles of a label, and of a new one."""


@dataclass(frozen=True, kw_only=True)
class Label:
    """A cloud whose weights sum to the expected number of its targets."""

    points: Floats
    weights: Floats

    @property
    def cloud(self) -> Cloud:
        """With weights that sum to 1."""
        return self.points, self.weights / self.weights.sum()


def scans(truths: Floats, rng: np.random.Generator) -> list[Floats]:
    """Measurements (M, 2) of each step: of targets with `DETECTED`, and false ones."""
    found = []
    for states in truths[1:]:
        real = states[rng.random(len(states)) < DETECTED][:, PLACE]
        false = rng.uniform(*REGION.T, (rng.poisson(FALSE), 2))
        found.append(np.concatenate((real + NOISE * rng.standard_normal(real.shape), false)))
    return found


def tracks(seen: list[Floats], rng: np.random.Generator) -> dict[int, list[Cloud]]:
    """Clouds of the reported labels at `STEPS`, before they are resampled."""
    labels: list[Label] = []
    kept = {}
    for step, scan in enumerate(seen, 1):
        labels, unexplained = _corrected([_predicted(each, rng) for each in labels], scan)
        labels = [each for each in labels if each.weights.sum() > FORGOTTEN]
        if step in STEPS:
            kept[step] = [each.cloud for each in labels if each.weights.sum() >= REPORTED]
        labels = [_resampled(each, rng) for each in labels]
        born = zip(scan, unexplained, strict=True)
        labels += [_born(z, BIRTH * share, rng) for z, share in born]
    return kept


def _predicted(label: Label, rng: np.random.Generator) -> Label:
    return Label(points=moved(label.points, rng), weights=SURVIVES * label.weights)


def _corrected(labels: list[Label], scan: Floats) -> tuple[list[Label], Floats]:
    """The labels, and of each measurement the share that none of them explains."""
    density = [DETECTED * _likelihood(each.points, scan) for each in labels]
    kappa = FALSE / np.prod(np.diff(REGION))
    total = kappa + sum(
        (each.weights @ d for each, d in zip(labels, density, strict=True)), np.zeros(len(scan))
    )
    corrected = [
        Label(points=each.points, weights=each.weights * (1 - DETECTED + (d / total).sum(axis=1)))
        for each, d in zip(labels, density, strict=True)
    ]
    return corrected, kappa / total


def _likelihood(points: Floats, scan: Floats) -> Floats:
    """Densities (N, M) of the measurements at the particles."""
    squares = ((points[:, None, PLACE] - scan) ** 2).sum(axis=2) / NOISE**2
    return np.exp(-0.5 * squares) / (2 * np.pi * NOISE**2)


def _resampled(label: Label, rng: np.random.Generator) -> Label:
    points, weights = label.cloud
    chosen = rng.choice(len(points), PARTICLES, p=weights)
    return Label(points=points[chosen], weights=np.full(PARTICLES, label.weights.sum() / PARTICLES))


def _born(z: Floats, targets: float, rng: np.random.Generator) -> Label:
    points = np.empty((FIRST, 4))
    points[:, PLACE] = z + NOISE * rng.standard_normal((FIRST, 2))
    points[:, [1, 3]] = SPEED * rng.standard_normal((FIRST, 2))
    return Label(points=points, weights=np.full(FIRST, targets / FIRST))
