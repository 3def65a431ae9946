"""Frozen records against those of the standard library."""

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import field
from typing import Any, ClassVar

import pytest

from tgospa_eval.common import frozen

Make = Callable[..., Any]


def _classes(dataclass: Make) -> tuple[type[Any], type[Any]]:
    """A class by name and one by position, defined with this decorator."""

    @dataclass(frozen=True, kw_only=True)
    class Base:
        """Fields with and without a default."""

        a: int
        b: float = 2.0
        kind: ClassVar[str] = "base"

    @dataclass(frozen=True, kw_only=True)
    class Named(Base):
        """A field that follows from nothing, and a check."""

        c: list[int] = field(default_factory=list)

        def __post_init__(self) -> None:
            if self.a < 0:
                raise ValueError("a")

    @dataclass(frozen=True)
    class Placed:
        """By position as well."""

        a: int
        b: str = "b"

    return Named, Placed


OURS, THEIRS = _classes(frozen.dataclass), _classes(dataclasses.dataclass)


@frozen.dataclass(frozen=True, eq=False, repr=False)
class Plain:
    """Only the same is equal."""

    a: int


@frozen.dataclass(frozen=True)
class Named:
    """Has a representation of its own."""

    a: int

    def __repr__(self) -> str:
        return f"the {self.a}"


def test_a_representation_of_its_own_stays() -> None:
    assert repr(Named(3)) == "the 3"
    assert repr(Plain(3)).startswith("<")


@pytest.mark.parametrize(
    ("which", "positional", "values"),
    [
        (0, (), {"a": 1}),
        (0, (), {"c": [3], "a": 1, "b": 4}),
        (1, (1,), {}),
        (1, (1, "x"), {}),
        (1, (1,), {"b": "y"}),
        (1, (), {"a": 1, "b": "y"}),
    ],
)
def test_records_are_as_those_of_the_library(
    which: int, positional: tuple[Any, ...], values: dict[str, Any]
) -> None:
    ours, theirs = (kinds[which](*positional, **values) for kinds in (OURS, THEIRS))
    assert list(vars(ours).items()) == list(vars(theirs).items())
    assert repr(ours) == repr(theirs)
    assert dataclasses.asdict(ours) == dataclasses.asdict(theirs)
    assert ours == copy.copy(ours)
    assert ours != theirs
    other, theirs_too = (dataclasses.replace(record, a=5) for record in (ours, theirs))
    assert vars(other) == vars(theirs_too)
    assert (other == ours) is (theirs_too == theirs) is False
    if which:
        assert hash(ours) == hash(theirs)
    for record in (ours, theirs):
        with pytest.raises(dataclasses.FrozenInstanceError, match="cannot assign to field 'a'"):
            record.a = 2
        with pytest.raises(dataclasses.FrozenInstanceError, match="cannot delete field 'a'"):
            del record.a


@pytest.mark.parametrize(
    ("which", "positional", "values", "message"),
    [
        (0, (), {"b": 1.0}, "missing 1 required keyword-only argument: 'a'"),
        (0, (), {"a": 1, "d": 1}, "unexpected keyword argument 'd'"),
        (0, (1,), {}, "takes 1 positional argument but 2 were given"),
        (1, (1, "x", 2), {}, "takes from 2 to 3 positional arguments but 4 were given"),
        (1, (1,), {"a": 1}, "multiple values for argument 'a'"),
    ],
)
def test_wrong_arguments(
    which: int, positional: tuple[Any, ...], values: dict[str, Any], message: str
) -> None:
    with pytest.raises(TypeError):
        THEIRS[which](*positional, **values)
    with pytest.raises(TypeError, match=message):
        OURS[which](*positional, **values)


def test_what_follows_is_checked_and_made_for_each_record() -> None:
    with pytest.raises(ValueError, match="a"):
        OURS[0](a=-1)
    assert OURS[0](a=1).c is not OURS[0](a=1).c


def test_a_record_without_equality_is_equal_to_itself_only() -> None:
    one = Plain(1)
    assert one == one
    assert one != Plain(1)
    assert len({one, Plain(1)}) == 2
    assert vars(pickle.loads(pickle.dumps(one))) == {"a": 1}
    assert "Plain object at" in repr(one)


def test_records_of_one_field_or_none_are_equal_by_it() -> None:
    @frozen.dataclass(frozen=True)
    class One:
        a: float

    @frozen.dataclass(frozen=True)
    class Nothing:
        pass

    nan = float("nan")
    assert One(nan) == One(nan)
    assert One(nan) != One(float("nan"))
    assert hash(One(2.0)) == hash((2.0,))
    assert Nothing() == Nothing()
    assert One(1.0) != Nothing()
    assert {Nothing(), Nothing()} == {Nothing()}


def test_help_shows_the_arguments() -> None:
    for ours, theirs in zip(OURS, THEIRS, strict=True):
        shown, expected = (inspect.signature(kind).parameters for kind in (ours, theirs))
        assert list(shown) == list(expected)
        assert [p.kind for p in shown.values()] == [p.kind for p in expected.values()]
        assert shown["a"].annotation is int
    assert inspect.signature(OURS[0]).parameters["b"].default == 2.0


def test_a_record_that_changes_is_refused() -> None:
    with pytest.raises(TypeError, match="say frozen=True"):
        frozen.dataclass(frozen=False)
