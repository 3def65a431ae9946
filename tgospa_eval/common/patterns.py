"""Patterns of paths with fields: ``runs/{tracker}/{sequence}.txt``. Knows no content of a file.

A file of MATLAB has variables, ``study.mat:X``, and cells: ``study.mat:Y{run}`` is like ``Y{1}``,
``Y{2}`` and so on, as in MATLAB itself. Which there are is told by `Inside`.
"""

import functools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping

FIELD = r"\{([A-Za-z_]\w*)\}"

WITH_VARIABLES = r"(?s:(.+\.(?i:mat(?:\.gz|\.gzip|\.zst|\.zstd)?))):"
"""What names a file that has variables, before the name of one."""

Inside = Callable[[str], Iterable[str]]
"""Names of what can be read of such a file."""


def fields(pattern: str) -> list[str]:
    """The names of the fields, each once, in order."""
    return list(dict.fromkeys(re.findall(FIELD, pattern)))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """The pattern with values in place of its fields."""
    return re.sub(FIELD, lambda found: values[found[1]], _of_cell(pattern)) if values else pattern


def matches(pattern: str, folder: str, inside: Inside) -> Iterator[dict[str, str]]:
    """What the fields stand for in each file that is like the pattern, sorted by path.

    A field is one part of a path, or a piece of one, and the same wherever it is named.
    """
    for path, values in found(pattern, folder, inside):
        del path
        yield values


def found(
    pattern: str, folder: str = "", inside: Inside = lambda _: ()
) -> Iterator[tuple[str, dict[str, str]]]:
    """The paths that are like a pattern, below a folder, with what its fields stand for."""
    import glob  # here: the name of a file is no pattern

    file, variable = _split(pattern)
    parts = re.split(FIELD, file)  # text, name, text, name, ..., text
    wild = "*".join(glob.escape(text) for text in parts[::2])
    shape = _shape(pattern, "+")
    paths: Iterable[str] = sorted(glob.glob(wild, root_dir=folder or None))
    if fields(variable):
        paths = (f"{path}:{name}" for path in paths for name in inside(os.path.join(folder, path)))
    elif variable:
        paths = (f"{path}:{variable}" for path in paths)
    for path in paths:
        match = shape.fullmatch(path.replace("\\", "/"))
        if match is not None:
            yield path, match.groupdict()


def is_ambiguous(pattern: str, path: str) -> bool:
    """Whether the fields could stand for other things in the same path."""
    slashed = path.replace("\\", "/")
    greedy, lazy = (_shape(pattern, repeated).fullmatch(slashed) for repeated in ("+", "+?"))
    return bool(greedy and lazy and greedy.groupdict() != lazy.groupdict())


@functools.lru_cache
def _shape(pattern: str, repeated: str) -> re.Pattern[str]:
    """The regular expression of a pattern, for thousands of paths."""
    file = _split(pattern)[0]
    parts = re.split(FIELD, _of_cell(pattern))
    shape, seen, size = "", set(), 0
    for text, name in zip(parts[::2], (*parts[1::2], None), strict=True):
        shape += re.escape(text.replace("\\", "/"))
        size += len(text)
        if name is not None:
            piece = "[^/]" if size < len(file) else "[^{}]"
            shape += f"(?P={name})" if name in seen else f"(?P<{name}>{piece}{repeated})"
            seen.add(name)
            size += len(name) + 2
    return re.compile(shape)


def _split(pattern: str) -> tuple[str, str]:
    """A file, and its variable; blank if none is named."""
    named = re.match(WITH_VARIABLES, pattern)
    return (named[1], pattern[named.end() :]) if named else (pattern, "")


def _of_cell(pattern: str) -> str:
    """The pattern with the braces of a cell around its field."""
    variable = _split(pattern)[1]
    cell = re.fullmatch(rf"\w+{FIELD}", variable)
    return f"{pattern[: -len(cell[1]) - 2]}{{{{{cell[1]}}}}}" if cell else pattern
