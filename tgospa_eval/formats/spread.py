"""Columns of covariances: which entry a header means, and the matrices of the rows.

Headers are `cov_xx`, `cov_xy`, `cov_yy` or `std_x`, `std_y`, `rho_xy`. If a state has a name of
several letters, an underscore is between the names, as in `cov_x_vx`. `SPELLINGS` has other usual
headers. `tracks.covariances` checks the matrices.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.quoting import option
from tgospa_eval.tracks.covariances import LARGEST_VARIANCE, accept, size_of, symmetric

BEYOND = 1e-3
"""Largest excess of a correlation over 1 that is taken for rounding in a file."""


@dataclass(frozen=True, kw_only=True)
class SpreadColumns:
    """Columns of the covariances of a table.

    Parameters
    ----------
    names : tuple of str
        State columns.
    entries : tuple of tuple of int
        For each entry of the lower triangle of the covariance matrix, row by row: the indices of
        its columns in the table. An entry has two columns if the table also has the symmetric
        entry; other entries have one column or none.
    spelling : int
        Spelling of the headers, as an index in `SPELLINGS`.
    """

    names: tuple[str, ...]
    entries: tuple[tuple[int, ...], ...]
    spelling: int

    @property
    def deviations(self) -> bool:
        """True if the columns have standard deviations and correlations instead of covariances."""
        return SPELLINGS[self.spelling][2]

    @property
    def is_unusual(self) -> bool:
        """True if the headers begin with P."""
        return self.spelling in (NAMED, NUMBERED)

    @property
    def columns(self) -> tuple[int, ...]:
        """Positions of the columns of all entries."""
        return tuple(column for entry in self.entries for column in entry)

    def labels(self) -> list[tuple[int, int, str]]:
        """Return row, column and usual header of each entry of the lower triangle."""
        return list(entries(self.names, self.spelling))

    @property
    def absent(self) -> list[str]:
        """Usual headers of the entries without a column; these entries are 0."""
        named = zip(self.labels(), self.entries, strict=True)
        return [label for (_, _, label), entry in named if not entry]


First = Callable[[Mask], tuple[int, str, str]]
"""Callable that receives a mask of wrong rows.

It returns the index of the first of these rows, and two texts for messages: where this row is in
the file, and how many other rows are wrong, such as " (and 1 more)"."""


NAMED, NUMBERED = 1, 2
"""Indices in `SPELLINGS` of Pxx, Pxy, Pyy and of P11, P12, P22."""

SPELLINGS = (
    (("cov_{0}{1}", "cov_{0}_{1}"), ("cov_{0}{1}", "cov_{0}_{1}", "var_{0}"), False),
    (("P{0}{1}", "P_{0}{1}", "P_{0}_{1}"), ("P{0}{1}", "P_{0}{1}", "P_{0}_{1}"), False),
    (("P{2}{3}", "P_{2}{3}", "P_{2}_{3}"), ("P{2}{3}", "P_{2}{3}", "P_{2}_{3}"), False),
    (("rho_{0}{1}", "rho_{0}_{1}"), ("std_{0}", "sigma_{0}"), True),
)
"""Headers of covariances, in order of priority.

Each spelling has three items: headers off the diagonal, headers on the diagonal, and True if the
headers on the diagonal are of standard deviations. {0} and {1} are names of state columns, {2} and
{3} their numbers from 1. Only names of one letter are joined without an underscore."""


def spelt(first: int, second: int, names: Sequence[str], spelling: int = 0) -> list[str]:
    """Return the headers that an entry of a covariance can have; the usual one is first."""
    beside, diagonal, _ = SPELLINGS[spelling]
    headers = []
    for i, j in dict.fromkeys([(first, second), (second, first)]):
        one, other = names[i], names[j]
        for form in diagonal if i == j else beside:
            is_joined = "}{" in form and "{0}" in form
            if not is_joined or len(one) == len(other) == 1:
                headers.append(form.format(one, other, i + 1, j + 1))
    return sorted(headers, key=lambda name: (name.startswith(("var", "sigma")), len(name)))


def entries(names: Sequence[str], spelling: int = 0) -> Iterator[tuple[int, int, str]]:
    """Yield row, column and usual header of each entry of the lower triangle, row by row."""
    for i in range(len(names)):
        for j in range(i + 1):
            yield i, j, spelt(j, i, names, spelling)[0]


def find_spread(
    names: Sequence[str], find: Callable[[str], int | None], where: str
) -> SpreadColumns | None:
    """Find the columns of the covariances of these state columns; None if there are none.

    The first spelling of `SPELLINGS` that the table has is used. For numbered entries, such as P12,
    the state columns must be in the order of the table. No number may be larger than the count of
    the state columns. `find` returns the position of a header.

    Raises
    ------
    InputError
        The table has some entries of the covariances, but not all variances.
    """
    columns = [find(name) for name in names]
    in_order = None not in columns and columns == sorted(columns)  # type: ignore[type-var]
    for spelling in range(len(SPELLINGS)):
        if spelling == NUMBERED and not in_order:
            continue
        wider = [*names, *"?" * (spelling == NUMBERED)]
        entries = []
        for k in range(len(wider)):
            for first in range(k + 1):
                places = (find(header) for header in spelt(first, k, wider, spelling))
                there = tuple(dict.fromkeys(at for at in places if at is not None))
                entries.append(there[:1] if k == first else there)
        if any(entries[len(names) * (len(names) + 1) // 2 :]):
            continue
        entries = entries[: len(names) * (len(names) + 1) // 2]
        if not any(entries):
            continue
        spread = SpreadColumns(names=tuple(names), entries=tuple(entries), spelling=spelling)
        for (i, j, label), entry in zip(spread.labels(), entries, strict=True):
            if i == j and not entry:
                header = label if spread.deviations else spelt(i, i, names)[0]
                raise InputError(
                    f"{where}: no column {label}, but other covariance columns; add it, map it "
                    f"with {option('columns', f'{header}=HEADER')}, "
                    f"or choose state columns with {option('columns')}"
                )
        return spread
    return None


def covariances_of(
    values: Mapping[int, Floats],
    row: Ints,
    where: Callable[[int], str],
    spread: SpreadColumns,
    *,
    missing: str,
    fix: bool,
) -> tuple[Floats, list[Notice]]:
    """Return the covariances of R rows as lower triangles (R, d (d + 1) / 2), and notices.

    Parameters
    ----------
    values : dict of int to (R,) float array
        For each index of a column, the values of the R evaluated rows; NaN where a cell is blank.
    row : (R,) int array
        For each evaluated row, its index among the rows of the file.
    where : callable
        Callable that takes such an index and returns a text: the line, the id and the time.
    spread : SpreadColumns
        Columns of the entries.
    missing : {"error", "zero"}
        Meaning of a row without a covariance: an error or a point.
    fix : bool
        Whether to replace an invalid covariance by the nearest valid matrix.

    Raises
    ------
    InputError
        A covariance is blank, not symmetric, or not positive semi-definite.
    """

    def first(wrong: Mask) -> tuple[int, str, str]:
        """Return what `First` describes."""
        at = np.flatnonzero(wrong)
        position = int(at[np.argmin(row[at])])
        return position, where(int(row[position])), more(len(at))

    notices = []
    if spread.absent:
        what = "column" if len(spread.absent) == 1 else "columns"
        notices.append(Notice(text=f"no {what} {', '.join(spread.absent)}: taken as 0"))
    without = _blank(values, spread, first)
    if without.any():
        if missing == "error":
            _, place, rest = first(without)
            raise InputError(
                f"{place}: no covariance{rest}; add it, or {option('missing_cov', 'zero')} "
                "makes such states points"
            )
        states = counted(int(np.count_nonzero(without)), "state has", "states have")
        text = f"{states} no covariance: compared as points ({option('missing_cov', 'zero')})"
        notices.append(Notice(text=text))
    packed = np.zeros((len(spread.entries), len(without)))
    for k in range(len(packed)):
        if spread.entries[k]:
            packed[k] = _entry(k, values, spread, without, first)
    if spread.deviations:
        packed = _products(packed, spread, first, fix=fix)
    order = np.argsort(row, kind="stable")  # messages name the first wrong row
    packed[:, order], changed = accept(
        packed[:, order], lambda k: where(int(row[order[k]])), fix=fix
    )
    return np.ascontiguousarray(packed.T), notices + changed


def _blank(values: Mapping[int, Floats], spread: SpreadColumns, first: First) -> Mask:
    """Return a mask of the rows that have no covariance.

    Raises
    ------
    InputError
        A row has some blank entries and some that are not blank.
    """
    blank = {column: np.isnan(values) for column, values in values.items()}
    without = np.asarray(np.all(list(blank.values()), axis=0), bool)
    partly = np.any(list(blank.values()), axis=0) & ~without
    if partly.any():
        at, place, rest = first(partly)
        named = zip(spread.labels(), spread.entries, strict=True)
        labels = [
            label for (*_, label), entry in named if any(blank[column][at] for column in entry)
        ]
        raise InputError(
            f"{place}: {labels[0]} is blank and other entries of the covariance are not{rest}; "
            f"fill it, or leave all blank and use {option('missing_cov', 'zero')}"
        )
    return without


def _entry(
    k: int,
    values: Mapping[int, Floats],
    spread: SpreadColumns,
    without: Mask,
    first_of: First,
) -> Floats:
    """Return the k-th entry of the lower triangles of all rows.

    If the entry has two columns, it is their mean. `without` is the mask of rows without a
    covariance.

    Raises
    ------
    InputError
        The two columns differ by more than rounding.
    """
    i, j, label = list(spread.labels())[k]
    first, *mirrored = (np.where(without, 0.0, values[c]) for c in spread.entries[k])
    for other in mirrored:
        scale = np.ones(len(without))
        if not spread.deviations:
            one, two = (values[spread.entries[k * (k + 3) // 2][0]] for k in (i, j))
            scale = np.sqrt(np.abs(one)) * np.sqrt(np.abs(two))
        mean, wrong = symmetric(first, other, np.where(without, 0.0, scale))
        if len(wrong):
            at, place, rest = first_of(np.isin(np.arange(len(without)), wrong))
            raise InputError(
                f"{place}: covariance not symmetric: {label} is given as {first[at]:.15g} "
                f"and as {other[at]:.15g}{rest}; correct one, or leave it out"
            )
        first = mean
    return np.asarray(first, np.float64)


def _products(packed: Floats, spread: SpreadColumns, first: First, *, fix: bool) -> Floats:
    """Compute covariances from standard deviations and correlations.

    With `fix`, correlations may be beyond -1 and 1, as the matrices are repaired later.
    """
    beyond = np.inf if fix else 1 + BEYOND
    for k, (i, j, label) in enumerate(spread.labels()):
        low, high = (0.0, LARGEST_VARIANCE**0.5) if i == j else (-beyond, beyond)
        wrong = ~((packed[k] >= low) & (packed[k] <= high))
        if wrong.any():
            at, place, rest = first(wrong)
            rule = f"0 to {high:g}" if i == j else f"-1 to 1; correct it or use {option('fix_cov')}"
            raise InputError(f"{place}: {label} is {packed[k, at]:g}{rest}; it must be from {rule}")
    d = size_of(len(packed))
    deviation = [packed[i * (i + 3) // 2] for i in range(d)]
    answer = np.empty_like(packed)
    for k, (i, j, _) in enumerate(spread.labels()):
        product = deviation[i] * deviation[j]
        with np.errstate(over="ignore"):  # values that are too large are refused later
            answer[k] = product if i == j else packed[k] * product
    return answer
