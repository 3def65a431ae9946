"""Patterns of paths with fields: ``runs/{tracker}/{sequence}.txt``. Knows no content of a file."""

import functools
import glob
import re
from collections.abc import Iterator, Mapping

FIELD = r"\{([A-Za-z_]\w*)\}"


def fields(pattern: str) -> list[str]:
    """The names of the fields, each once, in order."""
    return list(dict.fromkeys(re.findall(FIELD, pattern)))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """The pattern with values in place of its fields."""
    return re.sub(FIELD, lambda found: values[found[1]], pattern) if values else pattern


def matches(pattern: str, folder: str = "") -> Iterator[dict[str, str]]:
    """What the fields stand for in each file that is like the pattern, sorted by path.

    A field is one part of a path, or a piece of one, and the same wherever it is named.
    """
    for path, values in found(pattern, folder):
        del path
        yield values


def found(pattern: str, folder: str = "") -> Iterator[tuple[str, dict[str, str]]]:
    """The paths that are like a pattern, below a folder, with what its fields stand for."""
    parts = re.split(FIELD, pattern)  # text, name, text, name, ..., text
    wild = "*".join(glob.escape(text) for text in parts[::2])
    shape = _shape(pattern, "+")
    for path in sorted(glob.glob(wild, root_dir=folder or None)):
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
    parts = re.split(FIELD, pattern)
    shape, seen = "", set()
    for text, name in zip(parts[::2], (*parts[1::2], None), strict=True):
        shape += re.escape(text.replace("\\", "/"))
        if name is not None:
            shape += f"(?P={name})" if name in seen else f"(?P<{name}>[^/]{repeated})"
            seen.add(name)
    return re.compile(shape)
