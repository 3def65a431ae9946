"""All rows of a file, as readers return them, before any are left out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, natural
from tgospa_eval.formats.fields import Coded, Times
from tgospa_eval.formats.roles import Roles
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import Values

Numbered = tuple[NDArray[np.object_], Ints]
"""Distinct texts in natural order, and for each row the index of its text among them."""

NOT_CONSIDERED = "not considered"
"""Name of the rule that leaves out rows of the truth with the flag 0."""

AS_REGIONS = ("DontCare", "ignored regions", "others")
"""Names of the rules of KITTI and VisDrone for rows that are regions without evaluation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """All rows of a file, before any are left out.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    roles : Roles
        Roles of the columns.
    ids : Numbered
        Id of each row.
    times : Times
        Time of each row.
    numbers : (R, n) float array
        Values of the n columns `Roles.numbers`: finite numbers, or NaN where blank.
    where : callable
        Callable that returns the place of a row, for messages.
    classes : Numbered, optional
        Class of each row, if the roles have a column of classes.
    attributes : dict of int to (R,) array
        Values of the columns `Roles.texts`, by the position of the column.
    weight_fault : str, optional
        Message about weights that are not numbers. It is raised only if weights are needed.
    excluded : dict of str to (R,) bool array and str
        Rows that the format leaves out, and the message about them, by the name of the rule.
    warnings : tuple of Notice
        Warnings about the rows.
    read_as : callable, optional
        Callable that converts a time to its text or number in the file. It is given only if the
        rows are one part of the file, see `whole`.
    """

    name: str
    roles: Roles
    ids: Numbered
    times: Times
    numbers: Floats
    where: Callable[[int], str]
    classes: Numbered | None = None
    attributes: Mapping[int, Values] = field(default_factory=dict)
    weight_fault: str | None = None
    excluded: dict[str, tuple[Mask, str]] = field(default_factory=dict)
    warnings: tuple[Notice, ...] = ()
    read_as: Callable[[float], str | float] | None = None

    @property
    def whole(self) -> bool:
        """True if these are all rows of the file, False if the file is read in parts."""
        return self.read_as is None

    def quoted_id(self, row: int) -> str:
        """Return the id of a row, for messages."""
        return quoted(self.ids[0][self.ids[1][row]])

    def moment(self, row: int) -> str | float:
        """Return the time of a row as it was read."""
        times = self.times
        if self.read_as is not None:
            return self.read_as(times.value[row].item())
        return times.text[row].strip() if times.text is not None else times.value[row].item()


def rows_by_components(
    component: Callable[[int], Floats], times: Sequence[int] | Ints, roles: Roles, **more: Any
) -> Rows:
    """Build rows from a function that returns the values of a column.

    `component` receives the position of the column. `more` are further parameters of `Rows`.
    """
    numbers = np.empty((len(times), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        numbers[:, k] = component(column)
    return Rows(
        roles=roles,
        times=Times(value=np.asarray(times, np.int64), clock="number", text=None),
        numbers=numbers,
        attributes={column: component(column) for column in roles.texts},
        **more,
    )


def number_ids(ids: Sequence[str]) -> Numbered:
    """Return the distinct ids in natural order (2 before 10), and the index of each id of `ids`."""
    numbering: dict[str, int] = {}
    number = np.array([numbering.setdefault(text, len(numbering)) for text in ids], np.int64)
    names = np.array([*numbering], dtype=object)
    order = natural_order(names)
    rank = np.empty(len(names), np.int64)
    rank[order] = np.arange(len(names))
    return names[order], rank[number]


def natural_order(names: NDArray[Any]) -> Ints:
    """Return the indices that sort distinct texts by `natural`.

    If all texts are whole numbers, NumPy sorts them, which is ten times as fast.
    """
    joined = "".join(names)
    if joined.isascii() and joined.isdigit() and "" not in names and max(map(len, names)) < 19:
        whole = names.astype(np.int64)
        order = np.argsort(whole)
        if np.diff(whole[order]).all():  # unless 7 and 07 both occur
            return order
    keys = [natural(name) for name in names.tolist()]
    return np.array(sorted(range(len(keys)), key=keys.__getitem__), np.int64)


def numbered(column: Coded, name: Callable[[str], str] = str.strip) -> Numbered:
    """Return the distinct names of a column in natural order, and the index of each row's name.

    `name` converts a text to a name.
    """
    table, number = number_ids([name(text) for text in column.distinct])
    return table, number[column.code]


def name_objects() -> str:
    """Return the remedy for blank ids, for messages."""
    return f"give it an id, or leave such rows out with {option('on_invalid', 'drop')}"


def named_ids(columns: Sequence[Coded], name: Callable[[str], str] = str.strip) -> Numbered:
    """Return the ids in one column, or in several columns joined by a slash.

    A joined id is blank if one of its parts is blank.
    """
    whole = columns[0]
    for column in columns[1:]:
        distinct, code = np.unique(
            np.stack([whole.code, column.code]).astype(np.int64), axis=1, return_inverse=True
        )
        texts = [
            "/".join(parts) if all(parts) else ""
            for parts in (
                (name(whole.distinct[a]), name(column.distinct[b])) for a, b in distinct.T.tolist()
            )
        ]
        whole = Coded(texts, code.reshape(-1))
    return numbered(whole, name)


def spacings(ids: NDArray[Any], times: NDArray[Any], places: Floats) -> tuple[float, float]:
    """Return two median distances: of consecutive rows of one id, and of rows of one time.

    A median is NaN if there are too few such rows. The first two columns of `places` are the
    position.
    """

    def spacing(first: NDArray[Any], second: NDArray[Any]) -> float:
        order = np.lexsort((second, first))
        alike = first[order][1:] == first[order][:-1]
        lengths = np.linalg.norm(np.diff(places[order, :2], axis=0)[alike], axis=1)
        return float(np.median(lengths)) if 2 * len(lengths) >= len(ids) > 2 else np.nan

    return spacing(ids, times), spacing(times, ids)


def without_ids(ids: Numbered) -> dict[str, tuple[Mask, str]]:
    """Return the rule that excludes rows without an id, in the form of `Rows.excluded`."""
    blank = blanks(ids)
    if not len(blank):
        return {}
    mask = np.zeros(len(ids[1]), bool)
    mask[blank] = True
    return {"no id": (mask, f"without an id left out, by {option('on_invalid', 'drop')}")}


def without_blank(roles: Roles, count: int) -> Roles:
    """Return the roles with a notice about `count` rows without any value, if there are any."""
    notice = f"{counted(count, 'blank row')} passed over"
    return replace(roles, passed=(*roles.passed, notice)) if count else roles


def blanks(column: Numbered) -> Ints:
    """Return the positions of the rows whose name is blank."""
    table, number = column
    names = table.tolist()  # a list is searched ten times as fast
    return np.flatnonzero(number == names.index("")) if "" in names else number[:0]
