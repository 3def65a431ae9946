"""Options of an evaluation as keywords of Python functions."""

import functools
import inspect
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from types import NoneType
from typing import Any, ParamSpec, TypeVar, get_args

from tgospa_eval.api.options import DEFAULTS, OPTION_SPECS, TYPES, Request
from tgospa_eval.common.config import OptionSpec
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import quoted

P = ParamSpec("P")
T = TypeVar("T")

OF_THE_COMMAND = ("memory", "scheduler", "explain")
"""Options that `with_options` does not add as keywords.

Functions that need `memory` and `scheduler` declare them. `explain` is a method of results."""

KEYWORDS = {about.key: name for name, about in OPTION_SPECS.items()}
"""Keyword of each option, by its name on the command line: ``"class"`` has ``"class_"``."""

IN_OBJECTS = {
    "distance": "a record of `tgospa_eval.distances`",
    "covariance": "a matrix (d, d)",
    "inner_cov": "a matrix (d, d)",
    "solver": "`Certified`, `Exact` or `Sinkhorn` with settings",
    "origin": "a sequence of two or three numbers",
    "step_weights": "a mapping from time to weight, a table ``t, weight[, switch_weight]``, an "
    "array (T,)",
    "ignore_regions": "a table, a GeoJSON document as a dictionary",
    "max_gap": "a number, or a pair of truth and estimate",
    **dict.fromkeys(("time_tolerance", "resample", "time_offset", "period", "outage"), "a number"),
    **dict.fromkeys(("window", "every"), "a number of steps"),
    **dict.fromkeys(("columns", "truth_columns", "estimate_columns"), "a sequence of names"),
    **dict.fromkeys(("class_", "truth_class", "estimate_class", "with_"), "a sequence of names"),
}
"""Options that can also be objects in Python, and which objects these are."""


def taken(without: Iterable[str] = ()) -> list[str]:
    """Return the keywords of all options, except those in `OF_THE_COMMAND` and in `without`."""
    return [name for name in OPTION_SPECS if name not in (*OF_THE_COMMAND, *without)]


def with_options(*without: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Make a decorator that gives a function the options of an evaluation as keywords.

    `without` names options that the function does not get. The last parameter of the function is
    ``**options``. The decorator adds the options to its signature and to its docstring.
    """
    names = taken(without)

    def wrap(function: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        more = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=DEFAULTS[name])
            for name in names
            if name not in signature.parameters
        ]
        known = [p.name for p in (*own, *more)]

        @functools.wraps(function)
        def wrapped(*args: P.args, **kwargs: P.kwargs) -> T:
            check_names(function.__name__, kwargs, known)
            return function(*args, **kwargs)

        described: Any = wrapped
        described.__signature__ = signature.replace(parameters=[*own, *more])
        if wrapped.__doc__ is not None:  # python -OO removes docstrings
            wrapped.__doc__ = _documented(wrapped.__doc__, [p.name for p in more])
        return wrapped

    return wrap


def check_names(function: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Check that all `given` keywords are `known`; `function` is a name for the message.

    Raises
    ------
    TypeError
        A keyword is unknown.
    """
    there = list(known)
    for name in given:
        if name not in there:
            from difflib import get_close_matches  # lazy: few calls have an unknown keyword

            own = _keyword_of(name)
            near = [own] if own in there else get_close_matches(name, there, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise TypeError(f"{function}() has no keyword {name}{hint}")


def _keyword_of(name: str) -> str | None:
    """Return the keyword for a name on the command line: ``switch_penalty`` for ``gamma``."""
    for field, about in OPTION_SPECS.items():
        if name.replace("_", "-") in re.findall(r"-([\w-]+)", about.declaration.replace("--", "-")):
            return field
    return None


def _documented(doc: str, names: Iterable[str]) -> str:
    """Return a docstring with a section of these options after its parameters."""
    lines = ["Other Parameters", "----------------"]
    for name in names:
        about = OPTION_SPECS[name]
        text = re.sub(r"([*|`])", r"\\\1", about.help)
        text = re.sub(r"--([a-z][a-z-]*)", lambda match: f"`{KEYWORDS[match[1]]}`", text)
        if name in IN_OBJECTS:
            text += f" Also {IN_OBJECTS[name]}."
        if about.shown or DEFAULTS[name] not in (None, ()):
            text += f" Default: {about.shown or DEFAULTS[name]}."
        lines += [f"{name} : {_kind(name)}", textwrap.indent(textwrap.fill(text, 92), "    ")]
    head, returns, tail = inspect.cleandoc(doc).partition("\nReturns\n")
    return "\n".join([head, *lines, "", f"{returns.lstrip()}{tail}"])


def _kind(name: str) -> str:
    """Return the type of a keyword, as a docstring names it."""
    kinds = [kind for kind in get_args(TYPES[name]) or (TYPES[name],) if kind is not NoneType]
    known = [kind.__name__ for kind in kinds if isinstance(kind, type)]
    return " or ".join(known or ["str or iterable of str"])


def each(given: str | Iterable[str]) -> tuple[str, ...]:
    """Return one text, or several, as a tuple."""
    return (given,) if isinstance(given, str) else tuple(given)


def requested(values: Mapping[str, object]) -> Request:
    """Check the values of keywords one by one, and return them as a `Request`.

    Raises
    ------
    ConfigError
        A value is of the wrong type, or is not allowed.
    """
    return Request(**{name: _value(name, value) for name, value in values.items()})


KINDS = {float: "a number", int: "a whole number", bool: "True or False"}


def _value(name: str, value: object) -> Any:
    """Check the value of a keyword, and return it in the type that `Request` has for it."""
    if name not in OPTION_SPECS or value is None:
        return value
    about, option = OPTION_SPECS[name], name.rstrip("_")
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    kinds = [kind for kind in get_args(TYPES[name]) or (TYPES[name],) if kind is not NoneType]
    if DEFAULTS[name] == () or IN_OBJECTS.get(name) == "a sequence of names":
        return _names(name, value)
    if isinstance(value, str):
        # Names of distances and solvers are checked later, when the objects are made.
        known = about.choices if name not in ("distance", "solver") else ()
        if known and value not in known:
            raise ConfigError(f"{option} is {quoted(value)}: must be one of {', '.join(known)}")
        if str in kinds:
            return value
    elif name in IN_OBJECTS:
        return tuple(value) if isinstance(value, list) else value
    elif str in kinds:
        raise ConfigError(f"{option} is {value!r}: must be a text, as the command line takes it")
    if isinstance(value, str) or isinstance(value, bool) is not (bool in kinds):
        raise ConfigError(f"{option} is {value!r}: must be {KINDS[kinds[0]]}")
    if isinstance(value, int | float):
        _check_range(option, about, value)
    return value


def _names(name: str, value: object) -> str | tuple[str, ...]:
    """Check that a value is a text or several texts; return several as a tuple."""
    if isinstance(value, str):
        return (value,) if DEFAULTS[name] == () else value
    texts = tuple(value) if isinstance(value, Iterable) else (value,)
    if not all(isinstance(text, str) for text in texts):
        raise ConfigError(f"{name.rstrip('_')} is {value!r}: must be a text, or several")
    return texts


def _check_range(option: str, about: OptionSpec, value: float) -> None:
    """Check that a number is in the range that the command line also requires."""
    if about.low is not None and not value >= about.low:
        raise ConfigError(f"{option} is {value}: must be {about.low} or more")
    if about.high is not None and not value <= about.high:
        raise ConfigError(f"{option} is {value}: must be {about.high} or less")
