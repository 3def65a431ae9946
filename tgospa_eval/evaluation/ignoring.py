"""Rules for states that are not evaluated: attributes, marks, regions, steps without truth.

Their effect on the numbers is defined in `problem.metric_family.ignore_states`.
"""

import operator
import re
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import parsed
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.regions import inside
from tgospa_eval.formats import ROLES, Reading
from tgospa_eval.formats.options import class_named
from tgospa_eval.formats.reading import Regions
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.coverage import MARKED, MARKS, OWN_MARKS, marked, marks_of
from tgospa_eval.tracks.interpolation import match_times
from tgospa_eval.tracks.trajectories import Trajectories, Values

OUTSIDE, GAPS, IN_REGIONS = "outside-truth-steps", "truth-gaps", "in-regions"
WORDS = (*MARKS, OUTSIDE, IN_REGIONS, GAPS)

CLASS = "class"

COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}

RULE = re.compile(r"\s*([^<>=]+?)\s*(?<!!)(<=|>=|<|>|=)\s*([^<>=].*?)\s*")


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Rule that selects rows of the truth by the value of a column.

    Parameters
    ----------
    text : str
        Rule as it was given.
    column : str
        Name of the column.
    sign : str
        ``=``, or one of `COMPARISONS`.
    values : tuple of str
        One value; for ``=`` one or more. For ``=``, a row is selected if it has one of the values.
    """

    text: str
    column: str
    sign: str
    values: tuple[str, ...]

    def fits(self, values: Values) -> Mask:
        """Return a mask of the values (R,) that match the rule; missing values do not.

        Raises
        ------
        ConfigError
            The column has texts, but the rule compares by size. Or the column has numbers, but the
            rule has a text.
        """
        numbers = [parsed(text) for text in self.values]
        if self.sign == "=":
            if values.dtype.kind == "f":
                if None in numbers and not np.isnan(values).all():
                    wrong = self.values[numbers.index(None)]
                    raise ConfigError(
                        f"{option('ignore')} {quoted(self.text)}: column {quoted(self.column)} "
                        f"has numbers, but {quoted(wrong)} is not a number"
                    )
                return np.isin(values, [number for number in numbers if number is not None])
            return np.array([text in self.values for text in values.tolist()], bool)
        if values.dtype.kind != "f":
            given = [text for text in values.tolist() if text]
            if given:
                raise ConfigError(
                    f"{option('ignore')} {quoted(self.text)}: column {quoted(self.column)} has "
                    f"texts, such as {quoted(given[0])}; compare them with ="
                )
            return np.zeros(len(values), bool)
        fitting: Mask = COMPARISONS[self.sign](values, numbers[0])  # NaN matches no condition
        return fitting


@dataclass(frozen=True, kw_only=True)
class Ignoring:
    """Rules for states that are not evaluated.

    Parameters
    ----------
    texts : tuple of str
        Rules as they were given.
    conditions : tuple of Condition
        Conditions for the rows of the truth that are ignored.
    regions : Regions, optional
        Regions in which states of the estimate are excused.
    max_speed : float
        Where the truth has a gap, it is a straight line. `max_speed` is the largest speed at which
        the object may move away from this line. Its unit is that of the states per second; if the
        timestamps are plain numbers, that of the states per unit of the timestamps.
    """

    texts: tuple[str, ...] = ()
    conditions: tuple[Condition, ...] = ()
    regions: Regions | None = None
    max_speed: float = 0.0

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the truth that are ignored."""
        return tuple(v for one in self.conditions if one.column == CLASS for v in one.values)

    @property
    def recorded(self) -> dict[str, object]:
        """Settings that change the number, by their JSON names; regions by their digest."""
        given = {
            "ignore": list(self.texts),
            "max_speed": self.max_speed,
            "ignore_regions": self.regions and self.regions.sha256,
        }
        return {name: value for name, value in given.items() if value}

    @property
    def gaps(self) -> bool:
        """True if gaps of an interpolated truth are ignored."""
        return GAPS in self.texts

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the files that the rules need, besides the class."""
        marks = (column for rule, column in MARKS.items() if rule in self.texts)
        return (*(one.column for one in self.conditions if one.column != CLASS), *marks)

    def mark(self, sides: Sequence[Reading], names: Sequence[str]) -> tuple[Reading, ...]:
        """Mark the rows of both sides that the rules select by columns of the files.

        Raises
        ------
        ConfigError
            The truth lacks the column of a rule, or a side lacks the column ``ignored`` or
            ``excused`` that a rule needs.
        InputError
            A value in the column ``ignored`` or ``excused`` is neither yes nor no.
        """
        self.check_marks([side.trajectories.attributes for side in sides], names)
        spelt, absent = self.spelt(sides[0].named)
        truth, estimate = map(spelt.marked, sides, ROLES, names)
        return replace(truth, notices=(*truth.notices, *absent)), estimate

    def check_marks(self, attributes: Sequence[Container[str]], names: Sequence[str]) -> None:
        """Check that both sides have the columns of marks that the rules need.

        Raises
        ------
        ConfigError
            A side lacks such a column.
        """
        for (rule, column), there, name in zip(MARKS.items(), attributes, names, strict=True):
            if rule in self.texts and column not in there:
                other = f"; for marks of estimates use {OWN_MARKS}" * (rule == MARKED)
                raise ConfigError(f"{option('ignore', rule)}: {name} has no column {column}{other}")

    def spelt(self, named: Sequence[str]) -> tuple["Ignoring", list[str]]:
        """Return the rules with classes as the truth spells them, and messages on absent classes.

        `named` are the classes of the truth. An absent class is not an error, because one recording
        of many may lack it.
        """
        conditions, absent = [], []
        for rule in self.conditions:
            if rule.column == CLASS:
                spellings = {value: class_named(value, named) for value in rule.values}
                absent += [
                    f"{option('ignore', rule.text)}: no row of class {quoted(value)}; there are "
                    f"{listed(named)}"
                    for value, name in spellings.items()
                    if name is None
                ]
                rule = replace(rule, values=tuple(name for name in spellings.values() if name))
            conditions.append(rule)
        return replace(self, conditions=tuple(conditions)), absent

    def marked(self, side: Reading, role: str, name: str) -> Reading:
        """Mark the rows of one side that the rules select by columns of its file.

        Raises
        ------
        ConfigError
            The truth lacks the column of a rule.
        InputError
            A value in the column ``ignored`` or ``excused`` is neither yes nor no.
        """
        rows = np.zeros(side.taken, bool)
        rule, column = list(MARKS.items())[ROLES.index(role)]
        if rule in self.texts:
            try:
                rows |= marks_of(side.trajectories, column)
            except InputError as error:
                raise InputError(f"{name}, {error}") from None
        for one in self.conditions if role == ROLES[0] else ():
            rows |= one.fits(_values(side, one, name))
        return replace(side, trajectories=marked(side.trajectories, rows))

    def ignore_inside(self, truth: Trajectories, tolerance: float, name: str) -> Trajectories:
        """Mark the rows of the truth in a region as ignored, if a rule says so."""
        if self.regions is None or IN_REGIONS not in self.texts or not len(truth.step):
            return truth
        return marked(truth, inside(self.regions, truth, tolerance, name))

    def messages(self, *, ignored: bool, excused: bool) -> Iterator[str]:
        """Yield a message if the regions excuse no estimate, and one if the rules mark no state.

        `ignored` says whether some rows of the truth are marked, and `excused` whether some rows of
        the estimate are marked.
        """
        if self.regions is not None and not excused:
            what = "no state of the estimate is inside" if self.regions.shapes else "no regions"
            yield f"{self.regions.name}: {what}"
        if self.texts and not (ignored or excused):
            yield f"{option('ignore')} {listed(self.texts)}: no state matches; all are evaluated"

    def excuse(
        self, estimate: Trajectories, truth: Trajectories, tolerance: float, names: tuple[str, str]
    ) -> Trajectories:
        """Mark the excused rows of the estimate, which are in a region or at a step without truth.

        Rows at steps without truth are only excused if a rule says so.
        """
        if not len(estimate.step):
            return estimate
        rows = np.zeros(len(estimate.step), bool)
        if OUTSIDE in self.texts:
            _, there = match_times(estimate, truth, tolerance, (names[1], names[0]))
            rows |= ~there[estimate.step]
        if self.regions is not None:
            rows |= inside(self.regions, estimate, tolerance, names[1])
        return marked(estimate, rows)


def parse_ignoring(texts: Iterable[str], max_speed: float = 0.0) -> Ignoring:
    """Parse texts with one or more rules each; `max_speed` is that of `Ignoring`.

    Raises
    ------
    ConfigError
        A rule cannot be understood.
    """
    given = tuple(dict.fromkeys(rule for text in texts for rule in _rules(text)))
    conditions = []
    for text in given:
        if text in WORDS:
            continue
        match = RULE.fullmatch(text)
        values = tuple(v.strip() for v in match[3].split(",")) if match else ()
        if match is None or not all(values):
            raise ConfigError(
                f"{option('ignore')} {quoted(text)}: must be a condition on a column, such as "
                f"class=Van, class=Van,Bus, occlusion>1 or occlusion<1, or one of the words "
                f"{', '.join(WORDS[:-1])} and {GAPS}"
            )
        if match[1] == CLASS and match[2] != "=":
            raise ConfigError(f"{option('ignore')} {quoted(text)}: compare classes with =")
        if match[2] != "=" and (len(values) > 1 or parsed(values[0]) is None):
            raise ConfigError(
                f"{option('ignore')} {quoted(text)}: {quoted(match[3])} is not a plain, finite "
                "number"
            )
        conditions.append(Condition(text=text, column=match[1], sign=match[2], values=values))
    return Ignoring(texts=given, conditions=tuple(conditions), max_speed=max_speed)


def _rules(text: str) -> list[str]:
    """Split a text into rules at commas.

    A part that is not a rule is a further value of the rule before it, so
    ``class=Van,Person,marked`` has the rules ``class=Van,Person`` and ``marked``.
    """
    rules: list[str] = []
    for part in (part.strip() for part in text.split(",")):
        if rules and part not in WORDS and not set("<>=") & {*part}:
            rules[-1] += f",{part}"
        else:
            rules.append(part)
    return rules


def _values(truth: Reading, rule: Condition, name: str) -> Values:
    """Return the value of each row of the truth in the column of a rule."""
    if rule.column != CLASS:
        values = truth.trajectories.attributes.get(rule.column)
        if values is None:
            raise ConfigError(
                f"{option('ignore')} {quoted(rule.text)}: {name} has no column "
                f"{quoted(rule.column)}; it has {listed(truth.trajectories.offered)}"
            )
        return values
    if truth.klass is None:
        raise ConfigError(f"{option('ignore')} {quoted(rule.text)}: {name} has no classes")
    return np.array(truth.classes, dtype=object)[truth.klass]
