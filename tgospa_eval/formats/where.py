"""Filters by comparisons of columns, ``score >= 0.5 and type != van``: parsed, never executed."""

import operator
import re
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more, parsed, parsed_whole
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.text import option, quoted

if TYPE_CHECKING:
    from tgospa_eval.tracks.trajectories import Values

ITEM = r"""("[^"]*"|'[^']*'|[^\s"'<>=!]+)"""
ONE = re.compile(rf"\s*{ITEM}\s*([<>]=?|[!=]=)\s*{ITEM}\s*(?:\Z|(and)(?=\s))", re.IGNORECASE)
"""A comparison, up to the end or to the word that joins it with the next."""

COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A column beside a number or a text.

    Parameters
    ----------
    column : str
        Its header, or the name of its role.
    mark : str
        One of `COMPARED`.
    value : int, float or str
        What it is compared with; a text was in quotes, or is no number.
    """

    column: str
    mark: str
    value: int | float | str

    def holds(self, values: "Values", at: Callable[[int], str], asked: str) -> Mask:
        """Which rows fulfil it; a blank does so with a text alone.

        `at` says where a row is, `asked` what asks for this, for messages.

        Raises
        ------
        InputError
            A value and what it is compared with are no numbers both, nor texts.
        """
        compare, value = COMPARED[self.mark], self.value
        if isinstance(value, str) and values.dtype != object:
            filled = np.flatnonzero(~np.isnan(values))
            number = parsed(value)
            if len(filled) and value and number is None:
                raise InputError(
                    f"{at(int(filled[0]))}, column {quoted(self.column)}: "
                    f"{values[filled[0]]:g} is a number, and {asked} compares with a text; "
                    "compare with a number"
                )
            if number is None:  # which a blank may be
                return np.asarray(np.isnan(values) == ((self.mark == "==") == (value == "")))
            return np.asarray(compare(values, number))
        if isinstance(value, str):
            return np.asarray(compare(values, value), bool)
        if values.dtype == object:
            numbers = {text: parsed(str(text)) for text in dict.fromkeys(values.tolist())}
            wrong = [text for text, number in numbers.items() if number is None and text]
            if wrong:
                rows = np.flatnonzero(np.isin(values, wrong))
                raise InputError(
                    f"{at(int(rows[0]))}, column {quoted(self.column)}: {quoted(wrong[0])} is no "
                    f"number as for {asked}{more(len(rows))}; leave it blank, or compare texts, "
                    f"{self.column} == '{value}'"
                )
            values = np.array([numbers[text] for text in values.tolist()], float)
        return np.asarray(compare(values, value) & ~np.isnan(values))


@dataclass(frozen=True, kw_only=True)
class Where:
    """A filter: comparisons that all hold.

    Parameters
    ----------
    option : str
        The option that it is of, ``--estimate-where``.
    text : str
        As given.
    comparisons : tuple of Comparison
        They.
    """

    option: str
    text: str
    comparisons: tuple[Comparison, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that it looks at."""
        return tuple(one.column for one in self.comparisons)

    def inside(self, values: Mapping[str, "Values"], at: Callable[[int], str]) -> Mask:
        """Which rows fulfil it, from the values by column; parameters as of `Comparison.holds`."""
        asked = f"{self.option} {quoted(self.text)}"
        masks = (one.holds(values[one.column], at, asked) for one in self.comparisons)
        return np.asarray(np.logical_and.reduce(list(masks)), bool)


def parse_where(texts: str | Iterable[str], asked_by: str) -> tuple[Where, ...]:
    """Filters of an option that may be given several times.

    Raises
    ------
    ConfigError
        One cannot be understood.
    """
    each = (texts,) if isinstance(texts, str) else texts
    return tuple(
        Where(option=asked_by, text=text, comparisons=_parsed(text, asked_by)) for text in each
    )


def _parsed(text: str, asked_by: str) -> tuple[Comparison, ...]:
    comparisons: list[Comparison] = []
    end, is_joined = 0, True
    while is_joined:
        match = ONE.match(text, end)
        if match is None:
            raise ConfigError(
                f"{asked_by} {quoted(text)}: must be COLUMN >= NUMBER or COLUMN == TEXT, with ==, "
                "!=, <, <=, > or >=, several joined by and; what has blanks in quotes, 'a b' >= 1"
            )
        (column, given), mark = (_unquoted(match[k]) for k in (1, 3)), match[2]
        whole = parsed_whole(match[3])
        number = parsed(match[3]) if whole is None else whole
        value = given if number is None else number
        if isinstance(value, str) and mark not in ("==", "!="):
            raise ConfigError(
                f"{asked_by} {quoted(text)}: {quoted(value)} is no number, and texts are compared "
                f"by == and != alone; {option('time')} is for ranges of times"
            )
        comparisons.append(Comparison(column=column, mark=mark, value=value))
        end, is_joined = match.end(), bool(match[4])
    return tuple(comparisons)


def _unquoted(text: str) -> str:
    return text[1:-1] if text[0] in "\"'" else text
