"""Frozen records against those of the standard library."""

import copy
import dataclasses
import inspect
import pickle
from dataclasses import field
from typing import Any, ClassVar

import pytest

from tgospa_eval.common import frozen


def _classes(dataclass: Any) -> tuple[type[Any], ...]:
    """Classes by name, by position and of nothing, defined with this decorator."""

    @dataclass(frozen=True, kw_only=True)
    class Base:
        a: int
        b: float = 2.0
        kind: ClassVar[str] = "base"

    @dataclass(frozen=True, kw_only=True)
    class Named(Base):
        c: list[int] = field(default_factory=list)

        def __post_init__(self) -> None:
            if self.a < 0:
                raise ValueError("a")

    @dataclass(frozen=True)
    class Placed:
        a: int
        b: str = "b"

    @dataclass(frozen=True)
    class One:
        a: float

        def __repr__(self) -> str:
            return f"the {self.a}"

    @dataclass(frozen=True)
    class Nothing:
        pass

    return Named, Placed, One, Nothing


OURS, THEIRS = _classes(frozen.dataclass), _classes(dataclasses.dataclass)


@frozen.dataclass(frozen=True, eq=False, repr=False)
class Plain:
    """Only the same is equal."""

    a: int


@pytest.mark.parametrize(
    ("which", "positional", "values"),
    [
        (0, (), {"a": 1}),
        (0, (), {"c": [3], "a": 1, "b": 4}),
        (1, (1,), {}),
        (1, (1, "x"), {}),
        (1, (), {"a": 1, "b": "y"}),
        (2, (float("nan"),), {}),
        (3, (), {}),
    ],
)
def test_records_are_as_those_of_the_library(
    which: int, positional: tuple[Any, ...], values: dict[str, Any]
) -> None:
    ours, theirs = (kinds[which](*positional, **values) for kinds in (OURS, THEIRS))
    assert list(vars(ours).items()) == list(vars(theirs).items())
    assert repr(ours) == repr(theirs)
    assert ours == copy.copy(ours)
    assert ours != theirs
    if which:
        assert hash(ours) == hash(theirs)
    shown, expected = (inspect.signature(kinds[which]).parameters for kinds in (OURS, THEIRS))
    described = [(p.name, p.kind, p.default is p.empty) for p in shown.values()]
    assert described == [(p.name, p.kind, p.default is p.empty) for p in expected.values()]
    if which < 2:
        assert dataclasses.replace(ours, a=5) != ours
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
    for kinds in (OURS, THEIRS):
        with pytest.raises(TypeError, match=message):
            kinds[which](*positional, **values)


def test_what_follows_is_checked_and_a_record_that_changes_is_refused() -> None:
    with pytest.raises(ValueError, match="a"):
        OURS[0](a=-1)
    assert OURS[0](a=1).c is not OURS[0](a=1).c
    with pytest.raises(TypeError, match="say frozen=True"):
        frozen.dataclass(frozen=False)


def test_a_record_without_equality_is_equal_to_itself_only() -> None:
    one = Plain(1)
    assert one == one
    assert len({one, Plain(1)}) == 2
    assert vars(pickle.loads(pickle.dumps(one))) == {"a": 1}
    assert "Plain object at" in repr(one)
