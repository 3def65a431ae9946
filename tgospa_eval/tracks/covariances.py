"""Covariances as packed lower triangles: factors, checks, and corrections.

A covariance (d, d) is stored as its lower triangle row by row, d (d + 1) / 2 numbers: xx, xy, yy.
In this module, R covariances are an array (d (d + 1) / 2, R). The module is independent of files
and of the metric.
"""

import math
from collections.abc import Callable

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.quoting import option

MACHINE_EPSILON = 2.0**-52

ROUNDED_EIGENVALUE = 1e-13
"""A negative eigenvalue of at most this share of the largest eigenvalue counts as rounding."""

CLAMPED_EIGENVALUE = 1e-3 * (1 + 1e-9)  # a thousandth itself is included despite rounding
"""A negative eigenvalue of at most this share of the largest one counts as a lack of digits in the
file: the matrix is corrected, with a warning."""

LARGEST_VARIANCE = 1e150
"""Largest entry of a covariance; the product of two entries still fits in a double."""

ASYMMETRY = 1e-6 * (1 + 1e-9)
"""Largest relative difference between the entries xy and yx; their mean is used."""

ILL = 1e-4
"""Limit of the share of a variance that earlier components do not determine. Matrices of d >= 3
with a smaller share are factored with pivots."""

MATRICES_TOGETHER = 1 << 13
"""Number of matrices that are factored with pivots at a time."""


def size_of(count: int) -> int:
    """Return the dimension d of lower triangles with d (d + 1) / 2 numbers."""
    return (math.isqrt(8 * count + 1) - 1) // 2


def pack(matrices: Floats) -> Floats:
    """Pack matrices (R, d, d) as lower triangles (d (d + 1) / 2, R)."""
    row, column = np.tril_indices(matrices.shape[-1])
    return np.ascontiguousarray(matrices[:, row, column].T)


def unpack(packed: Floats, *, lower: bool = False) -> Floats:
    """Unpack lower triangles (d (d + 1) / 2, R) to matrices (R, d, d), symmetric or lower."""
    d = size_of(len(packed))
    row, column = np.tril_indices(d)
    matrices = np.zeros((packed.shape[1], d, d))
    if not lower:
        matrices[:, column, row] = packed.T
    matrices[:, row, column] = packed.T
    return matrices


def factor(packed: Floats) -> Floats:
    """Return packed lower factors L of covariances C = L L', which may be singular.

    The equations are ``L_jj^2 = C_jj - sum L_jk^2`` and ``L_ij = (C_ij - sum L_ik L_jk) / L_jj``,
    with sums over k < j. There are two guards: ``L_jj^2`` is set to 0 if it could be only rounding,
    and ``L_ij^2`` is limited to the remainder ``C_ii - sum L_ik^2``. Differences of nearly equal
    numbers are computed with exact products for d = 2, and with pivots and more digits for d >= 3
    (docs/theory/gaussian.md, "Equations").
    """
    d = size_of(len(packed))
    if d == 1:
        return np.sqrt(np.maximum(packed, 0.0))
    if d == 2:
        return _factor_two(*packed)
    factors, share = _factor_many(packed)
    ill = np.flatnonzero(share < ILL)
    for begin in range(0, len(ill), MATRICES_TOGETHER):
        part = ill[begin : begin + MATRICES_TOGETHER]
        factors[:, part] = _factor_pivoted(packed[:, part])
    return factors


def _factor_two(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the factor of [[a, b], [b, c]]: ``sqrt(a), b / sqrt(a), sqrt((a c - b b) / a)``."""
    factors = np.zeros((3, len(a)))
    a, c = np.maximum(a, 0.0), np.maximum(c, 0.0)
    np.sqrt(a, out=factors[0])
    bound = np.sqrt(c)
    left = c.copy()
    # If b / sqrt(a) overflows, it is clipped. If the remainder overflows, it is negative, and its
    # root is left at 0.
    with np.errstate(over="ignore"):
        np.divide(b, factors[0], out=factors[1], where=a > 0)
        np.clip(factors[1], -bound, bound, out=factors[1])
        np.divide(_determinant(a, b, c), a, out=left, where=a > 0)
    np.sqrt(left, out=factors[2], where=left > 4 * MACHINE_EPSILON * c)
    return factors


def _determinant(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return ``a c - b b`` from exact products, which Dekker's splitting gives."""
    first, second = a * c, b * b
    return (first - second) + (_rest(a, c, first) - _rest(b, b, second))


def _rest(a: Floats, b: Floats, product: Floats) -> Floats:
    """Return the rounding error ``a b - product`` of a rounded product."""
    a_high, b_high = (
        (134217729.0 * x) - (134217729.0 * x - x)
        for x in (a, b)  # times 2^27 + 1
    )
    a_low, b_low = a - a_high, b - b_high
    exact: Floats = a_low * b_low - (product - a_high * b_high - a_low * b_high - a_high * b_low)
    return exact


def _factor_many(packed: Floats) -> tuple[Floats, Floats]:
    """Factor without pivots; also return the smallest share of a variance, as in `ILL`, (R,)."""
    d = size_of(len(packed))
    at = {(i, j): i * (i + 1) // 2 + j for i in range(d) for j in range(i + 1)}
    factors = np.zeros_like(packed)
    variance = [np.maximum(packed[at[i, i]], 0.0) for i in range(d)]
    left = [v.copy() for v in variance]
    share = np.ones(packed.shape[1])
    for j in range(d):
        own = np.divide(left[j], variance[j], out=np.ones_like(share), where=variance[j] > 0)
        np.minimum(share, own, out=share)
        positive = left[j] > 0
        pivot = factors[at[j, j]]
        np.sqrt(left[j], out=pivot, where=positive)
        for i in range(j + 1, d):
            entry = factors[at[i, j]]
            rest = packed[at[i, j]] - sum(factors[at[i, k]] * factors[at[j, k]] for k in range(j))
            with np.errstate(over="ignore"):  # clipped below
                np.divide(rest, pivot, out=entry, where=positive)
            bound = np.sqrt(np.maximum(left[i], 0.0))
            np.clip(entry, -bound, bound, out=entry)
            left[i] -= entry * entry
    return factors, share


def _factor_pivoted(packed: Floats) -> Floats:
    """Factor matrices that are singular or nearly singular.

    Correlations are factored in extended precision, if the machine has it. The next pivot is always
    the component with the largest remainder, so that rounding errors do not grow and do not raise
    the rank. Then a rotation makes the factor lower triangular; it does not enlarge the errors of a
    row.
    """
    d = size_of(len(packed))
    matrices = unpack(packed).astype(np.longdouble)
    row = np.arange(len(matrices))
    deviation = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 0))
    unit = np.where(deviation > 0, deviation, 1)
    matrices /= unit[:, :, None]
    matrices /= unit[:, None, :]
    factors = np.zeros_like(matrices)
    left = np.where(deviation > 0, np.longdouble(1), np.longdouble(0))
    for k in range(d):
        pivot = np.argmax(left, axis=1)
        size = left[row, pivot]
        positive = size > 4 * d * MACHINE_EPSILON
        root = np.sqrt(np.where(positive, size, 1))
        known = (factors[:, :, :k] * factors[row, pivot, None, :k]).sum(axis=2)
        entry = (matrices[row, :, pivot] - known) / root[:, None]
        bound = np.sqrt(np.maximum(left, 0))  # 0 if the component was a pivot
        entry = np.where(positive[:, None], np.clip(entry, -bound, bound), 0)
        factors[:, :, k] = entry
        left -= entry * entry
        left[row, pivot] = -1  # never a pivot again
    columns = (factors * unit[:, :, None]).astype(np.float64).transpose(0, 2, 1)
    upper = np.asarray(np.linalg.qr(columns, mode="r"))
    upper *= np.where(np.diagonal(upper, axis1=1, axis2=2) < 0, -1.0, 1.0)[:, :, None]
    return pack(upper.transpose(0, 2, 1))


def project(packed: Floats) -> tuple[Floats, Floats]:
    """Replace negative eigenvalues of symmetric matrices by 0, which gives the nearest covariances.

    Returns
    -------
    packed : (d (d + 1) / 2, R) float array
        The covariances. A matrix whose negative eigenvalues are only rounding is unchanged.
    ratio : (R,) float array
        For changed matrices the smallest eigenvalue divided by the largest, or -inf if no
        eigenvalue is positive; 0 for unchanged matrices.
    """
    d = size_of(len(packed))
    ratio = np.zeros(packed.shape[1])
    diagonal = [packed[i * (i + 3) // 2] for i in range(d)]
    largest = np.max(np.abs(packed), axis=0, initial=0.0)
    lower = factor(packed)
    off = np.zeros(packed.shape[1])
    for i in range(d):
        for j in range(i + 1):
            row, column = i * (i + 1) // 2, j * (j + 1) // 2
            product = sum(lower[row + k] * lower[column + k] for k in range(j + 1))
            np.maximum(off, np.abs(product - packed[row + j]), out=off)
    doubtful = np.flatnonzero(
        (off > 16 * d * MACHINE_EPSILON * largest) | (np.min(diagonal, axis=0) < 0)
    )
    if not len(doubtful):
        return packed, ratio
    values, vectors = np.linalg.eigh(unpack(packed[:, doubtful]))
    low, high = values[:, 0], values[:, -1]
    own = np.divide(low, high, out=np.full(len(low), -np.inf), where=high > 0)
    wrong = np.flatnonzero(own < -ROUNDED_EIGENVALUE)
    ratio[doubtful[wrong]] = own[wrong]
    answer = packed.copy()
    roots = vectors[wrong] * np.sqrt(np.maximum(values[wrong], 0.0))[:, None, :]
    answer[:, doubtful[wrong]] = pack(roots @ roots.transpose(0, 2, 1))
    return answer, ratio


def accept(
    packed: Floats, where: Callable[[int], str], *, fix: bool = False
) -> tuple[Floats, list[Notice]]:
    """Return covariances that a distance can use, and notices about changed matrices.

    Parameters
    ----------
    packed : (d (d + 1) / 2, R) float array
        Finite matrices.
    where : callable
        Function that receives the index of a matrix, and returns its name for messages.
    fix : bool
        Whether to replace an invalid matrix by the nearest positive semi-definite matrix instead of
        raising an error.

    Raises
    ------
    InputError
        An entry is too large. Without `fix` also: a variance is negative, or a matrix has a
        negative eigenvalue of more than a thousandth of the largest.
    """
    d = size_of(len(packed))
    diagonal = packed[[i * (i + 3) // 2 for i in range(d)]]
    wrong = np.flatnonzero(np.max(np.abs(packed), axis=0, initial=0.0) > LARGEST_VARIANCE)
    if len(wrong):
        raise InputError(
            f"{where(int(wrong[0]))}: covariance above {LARGEST_VARIANCE:g}{more(len(wrong))}; "
            "use another unit"
        )
    negative = np.min(diagonal, axis=0, initial=0.0) < 0
    if negative.any() and not fix:
        wrong = np.flatnonzero(negative)
        value = diagonal[:, wrong[0]].min()
        raise InputError(
            f"{where(int(wrong[0]))}: negative variance {value:g}{more(len(wrong))}; "
            f"correct it or use {option('fix_cov')}"
        )
    answer, ratio = project(packed)
    refused = ratio < -CLAMPED_EIGENVALUE
    wrong = np.flatnonzero(refused)
    if len(wrong) and not fix:
        values = np.linalg.eigvalsh(unpack(packed[:, wrong[:1]]))[0]
        raise InputError(
            f"{where(int(wrong[0]))}: covariance not positive semi-definite (eigenvalues "
            f"{', '.join(f'{value:.6g}' for value in values)}){more(len(wrong))}; "
            f"correct it or use {option('fix_cov')}"
        )
    notices = []
    mended = np.flatnonzero(refused | negative)
    if len(mended):
        what = counted(len(mended), "covariance was", "covariances were")
        notices.append(
            Notice(
                text=f"{what} replaced by the nearest positive semi-definite one "
                f"({option('fix_cov')}), the first at {where(int(mended[0]))}"
            )
        )
    clamped = np.flatnonzero((ratio < 0) & ~refused & ~negative)
    if len(clamped):
        worst = int(clamped[np.argmin(ratio[clamped])])
        what = counted(len(clamped), "covariance is", "covariances are")
        notices.append(
            Notice(
                code="covariance-repaired",
                text=f"{what} not quite positive semi-definite, by up to "
                f"{-ratio[worst]:.2g} of the largest eigenvalue ({where(worst)}): the nearest "
                "valid one is used",
                remedy="more digits in the file avoid that",
            )
        )
    return answer, notices


def symmetric(entry: Floats, mirrored: Floats, scale: Floats) -> tuple[Floats, Ints]:
    """Return the mean of the entries xy and yx of matrices, and the indices of unsymmetric ones.

    Entries of a symmetric matrix differ by at most a millionth, or by at most 1e-12 times `scale`,
    the root of the product of the two variances.
    """
    difference = np.abs(entry - mirrored)
    largest = np.maximum(np.abs(entry), np.abs(mirrored))
    wrong = difference > np.maximum(ASYMMETRY * largest, 1e-12 * scale)
    return entry + 0.5 * (mirrored - entry), np.flatnonzero(wrong)


def from_matrices(
    matrices: Floats, where: Callable[[int], str], *, fix: bool = False
) -> tuple[Floats, list[Notice]]:
    """Pack matrices (R, d, d) and pass them to `accept`; refuse matrices that are not symmetric."""
    packed = pack(matrices)
    deviation = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)))
    for k, (i, j) in enumerate(zip(*np.tril_indices(matrices.shape[1]), strict=True)):
        packed[k], wrong = symmetric(
            packed[k], matrices[:, j, i], deviation[:, i] * deviation[:, j]
        )
        if len(wrong):
            at = int(wrong[0])
            raise InputError(
                f"{where(at)}: not symmetric: {matrices[at, i, j]:g} in row {i + 1}, column "
                f"{j + 1}, but {matrices[at, j, i]:g} in row {j + 1}, column {i + 1}"
                f"{more(len(wrong))}"
            )
    return accept(packed, where, fix=fix)
