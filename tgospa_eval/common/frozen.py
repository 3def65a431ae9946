"""Frozen dataclasses that cost little to define.

`dataclasses.dataclass` writes and compiles up to seven methods for each class. With Python 3.11,
this takes 0.7 ms for each class at every start. An evaluation of two small files takes only 10 ms,
but needs seventy classes. In this module, all classes share their methods. Then a class takes
0.06 ms, and an instance is made as fast as with `dataclasses`.
"""

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass  # `as` makes the name public
else:
    T = TypeVar("T")

    def dataclass(
        *, frozen: bool, kw_only: bool = False, eq: bool = True, repr: bool = True
    ) -> Callable[[type[T]], type[T]]:
        """Make a class a frozen dataclass. All functions of `dataclasses` work with it.

        Parameters
        ----------
        frozen : bool
            Must be true.
        kw_only : bool
            Whether all arguments of ``__init__`` are given by keyword.
        eq : bool
            Whether instances are equal, and have the same hash, if their fields are equal.
        repr : bool
            Whether ``repr`` shows the fields, unless the class has its own ``__repr__``.
        """
        if not frozen:
            raise TypeError("a record that can be changed: say frozen=True")

        def define(cls: type[T]) -> type[T]:
            dataclasses.dataclass(init=False, repr=False, eq=False, kw_only=kw_only)(cls)
            fields = dataclasses.fields(cls)
            cls.__init__ = _initialiser(fields, hasattr(cls, "__post_init__"))
            cls.__signature__ = _Signature()
            cls.__setattr__, cls.__delattr__ = _refuse_to_set, _refuse_to_delete
            if repr and "__repr__" not in cls.__dict__:
                cls.__repr__ = _shown
            if eq:
                cls.__eq__, cls.__hash__ = _comparison([field.name for field in fields])
            return cls

        return define


R = TypeVar("R")


def replace(record: R, **changes: Any) -> R:
    """Copy a record with changes, like `dataclasses.replace` but faster."""
    return recast(record, type(record), **changes)


def recast(record: object, cls: type[R], **changes: Any) -> R:
    """Make a record of the class `cls` from the values of `record`, with changes."""
    kept = vars(record)
    names = type(record).__dataclass_fields__  # type: ignore[attr-defined]
    return cls(**{name: kept[name] for name in names if name in kept} | changes)


Fields = tuple[dataclasses.Field[Any], ...]


def _initialiser(fields: Fields, followed: bool) -> Callable[..., None]:
    """Return ``__init__`` for a class with these fields.

    If `followed`, the class has a ``__post_init__``, which is called at the end.
    """
    order = tuple(field.name for field in fields)
    places = tuple(field.name for field in fields if not field.kw_only)
    size = len(order)
    constant = {f.name: f.default for f in fields if f.default is not dataclasses.MISSING}
    made = [(f.name, f.default_factory) for f in fields if callable(f.default_factory)]

    def __init__(self: Any, /, *positional: Any, **values: Any) -> None:  # noqa: N807
        if positional:
            given = dict(zip(places, positional, strict=False))
            if len(positional) > len(places) or not given.keys().isdisjoint(values):
                _standard(type(self))(*positional, **values)  # raises TypeError
            values = given | values
        if len(values) < size:
            values = constant | values
            for name, default in made:
                if name not in values:
                    values[name] = default()
        kept = self.__dict__
        try:
            for name in order:
                kept[name] = values[name]
        except KeyError:
            _standard(type(self))(**values)  # raises TypeError
        if len(values) > size:
            _standard(type(self))(**values)  # raises TypeError
        if followed:
            self.__post_init__()

    return __init__


def _standard(cls: type) -> type:
    """Return a class of `dataclasses` with the same fields, which gives errors and a signature."""
    fields = [(field.name, field.type, field) for field in dataclasses.fields(cls)]
    return dataclasses.make_dataclass(cls.__qualname__, fields)


def _refuse_to_set(_: object, name: str, __: object) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_to_delete(_: object, name: str) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _shown(record: Any) -> str:
    names = [field.name for field in dataclasses.fields(record)]
    shown = [f"{name}={getattr(record, name)!r}" for name in names]
    return f"{type(record).__qualname__}({', '.join(shown)})"


def _comparison(
    names: list[str],
) -> tuple[Callable[[object, object], bool], Callable[[object], int]]:
    """Return ``__eq__`` and ``__hash__`` that compare the values of these fields."""

    def few(record: object) -> tuple[Any, ...]:
        return tuple([getattr(record, name) for name in names])

    values: Callable[[object], Any] = attrgetter(*names) if len(names) > 1 else few

    def __eq__(self: object, other: object) -> bool:  # noqa: N807
        return values(self) == values(other) if type(other) is type(self) else NotImplemented

    def __hash__(self: object) -> int:  # noqa: N807
        return hash(values(self))

    return __eq__, __hash__


class _Signature:
    """Attribute ``__signature__`` of a class. Its value is made when ``help()`` needs it."""

    def __get__(self, record: object, cls: Any) -> Any:
        from inspect import signature  # lazy: for help() only

        if record is not None:  # an instance with `__call__` has the signature of `__call__`
            raise AttributeError("__signature__")
        return signature(_standard(cls))
