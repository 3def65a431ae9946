"""Types of the keywords of Python, made from the options: `tgospa_eval/api/option_types.py`.

``python docs/option_types.py`` writes the file again; a test holds the two together.
"""

import inspect
import json
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import tgospa_eval
from tgospa_eval.api.keywords import IN_OBJECTS, OPTION_SPECS, TYPES
from tgospa_eval.api.options import DEFAULTS

TARGET = Path(tgospa_eval.__file__).parent / "api" / "option_types.py"

FUNCTIONS = (
    "evaluate",
    "evaluate_many",
    "compare",
    "sweep",
    "batch",
    "gate",
    "associate",
    "reduce",
)

AS_OBJECT = {
    "distance": "Distance",
    "covariance": "Matrix",
    "inner_cov": "Matrix",
    "solver": "Solver",
    "origin": "Sequence[float]",
    "step_weights": "StepWeightsLike",
    "ignore_regions": "RegionsLike",
    "a number": "float",
    "a number, or a pair of truth and estimate": "float | list[float] | tuple[float, float]",
    "a number of steps": "int",
    "a sequence of names": "Iterable[str]",
}
"""Types of what a keyword takes beside its text, by its name or by the words in `IN_OBJECTS`."""

RECORDS = tuple(name for name in AS_OBJECT if name in OPTION_SPECS and name != "origin")
"""Keywords of which a store keeps the text alone: `batch` takes nothing else."""

HEAD = '''\
"""Keywords of the functions with their types, for editors and type checkers.

Made by ``python docs/option_types.py`` from the options: change those. Nothing imports it when a
program runs, as ``**options: "Unpack[EvaluateOptions]"`` is for people and for type checkers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias, TypedDict

import numpy.typing as npt

from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.regions import RegionsLike
from tgospa_eval.formats.objects import ArrayLike, StepWeightsLike
from tgospa_eval.solvers import Solver

Matrix: TypeAlias = "npt.ArrayLike | ArrayLike"
'''

RECORDER = '''\
class RecorderOptions(_Cutoff, EvaluateOptions):
    """Keywords of `Recorder.evaluate`."""
'''

WIDTH = 100


def type_of(name: str, *, plain: bool = False) -> str:
    """The type of a keyword; `plain` leaves out what is no text."""
    about, default = OPTION_SPECS[name], DEFAULTS[name]
    if default == ():
        return "str | Iterable[str]"
    kinds = [kind for kind in get_args(TYPES[name]) or (TYPES[name],) if kind is not NoneType]
    parts = [kind.__name__ if kind in (str, float, int, bool) else str(kind) for kind in kinds]
    if isinstance(about.choices, tuple) and about.choices:  # a registry takes those of others
        parts = [f"Literal[{', '.join(map(json.dumps, about.choices))}]"]
    if about.kind == "path" or name in ("region", "inner_cov"):
        parts.append("os.PathLike[str]")
    if name in IN_OBJECTS and not plain:
        parts.append(AS_OBJECT.get(name) or AS_OBJECT[IN_OBJECTS[name]])
    return " | ".join([*parts, *["None"] * (default is None)])


def keywords(function: str) -> list[str]:
    """Names of the options of a function that are no parameters of its own."""
    called: Any = getattr(tgospa_eval, function)
    own = inspect.signature(called.__wrapped__).parameters
    return [name for name in inspect.signature(called).parameters if name not in own]


def groups() -> dict[str, tuple[list[str], set[str]]]:
    """Options that the same functions take, and these functions; by the name of their class."""
    takers: dict[tuple[str, ...], list[str]] = {}
    taking = {function: keywords(function) for function in FUNCTIONS}
    for name in OPTION_SPECS:
        those = tuple(function for function, names in taking.items() if name in names)
        if name in RECORDS and "batch" in those:
            takers.setdefault(("batch",), []).append(name)
            those = tuple(function for function in those if function != "batch")
        takers.setdefault(those, []).append(name)
    return {
        f"_{'Plain' * (those == ('batch',))}{camel(names[0])}": (names, {*those})
        for those, names in takers.items()
        if those
    }


def camel(name: str) -> str:
    """The name of a class."""
    return "".join(map(str.capitalize, name.split("_")))


def text() -> str:
    """The module."""
    made, classes, aliases = groups(), [], []
    for title, (names, those) in made.items():
        fields = []
        for name in names:
            kind = type_of(name, plain=those == {"batch"})
            if len(f"    {name}: {kind}") > WIDTH:
                listed, tail = kind.removeprefix("Literal[").split("]")
                lines = "".join(f"    {text},\n" for text in listed.split(", "))
                aliases.append(f"{camel(name)}: TypeAlias = Literal[\n{lines}]\n")
                kind = f"{camel(name)}{tail}"
            fields.append(f"    {name}: {kind}\n")
        plain = those == {"batch"}
        about = "Texts that `batch` keeps." if plain else f"Keywords of {listing(those)}."
        head = f'class {title}(TypedDict, total=False):\n    """{about}"""\n\n'
        classes.append(head + "".join(fields))
    taken = {f: {title for title, (_, those) in made.items() if f in those} for f in FUNCTIONS}
    ordered = sorted(FUNCTIONS, key=lambda function: len(taken[function]))
    for k, function in enumerate(ordered):
        # Of those before, the one with most of its keywords and no others.
        inner = [other for other in ordered[:k] if taken[other] <= taken[function]][-1:]
        rest = taken[function].difference(*(taken[other] for other in inner))
        bases = ", ".join([*(title for title in made if title in rest), *map(title_of, inner)])
        head = f"class {title_of(function)}({bases}):"
        if len(head) > WIDTH:
            head = f"class {title_of(function)}(\n    {bases}\n):"
        classes.append(f'{head}\n    """Keywords of `{function}` beside its own parameters."""\n')
    classes.append(RECORDER)
    return "\n".join([HEAD, *aliases]) + "\n\n" + "\n\n".join(classes)


def title_of(function: str) -> str:
    """The name of the class of a function; `BatchOptions` and `GateOptions` are other records."""
    return f"{camel(function)}{'Evaluation' * (function in ('batch', 'gate'))}Options"


def listing(functions: set[str]) -> str:
    """Functions in their order."""
    if functions == {*FUNCTIONS}:
        return "all functions"
    return ", ".join(f"`{name}`" for name in FUNCTIONS if name in functions)


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
