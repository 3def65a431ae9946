"""Patterns of paths with fields, ``runs/{tracker}/{sequence}.txt``, and the files that match.

A pattern can also name a variable in a file of MATLAB, ``study.mat:X``, or cells of a variable:
``study.mat:Y{run}`` matches ``Y{1}``, ``Y{2}`` and so on, as in MATLAB. The caller gives a function
`Inside` that lists the variables and cells of a file. This module opens only the files by which
this program recognises its folders of results.
"""

import functools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from tgospa_eval.common.words import counted

FIELD = r"\{([A-Za-z_]\w*)\}"

WITH_VARIABLES = r"(?s:(.+\.(?i:mat(?:\.gz|\.gzip|\.zst|\.zstd)?))):"
"""Regular expression of the path of a file of MATLAB, with the colon before a variable."""

Inside = Callable[[str], Iterable[str]]
"""Function that receives the path of a file and returns the names of its variables and cells."""

DOTTED, WRITTEN, TRUTH = "hidden by a dot", "in a folder of results", "the truth itself"
"""Reasons to skip a file that matches."""


def fields(pattern: str) -> list[str]:
    """Return the names of the fields of a pattern in order, without repetitions."""
    return list(dict.fromkeys(re.findall(FIELD, pattern)))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """Replace the fields of a pattern by values."""
    return re.sub(FIELD, lambda match: values[match[1]], _of_cell(pattern)) if values else pattern


def matching_paths(
    pattern: str, folder: str = "", inside: Inside = lambda _: ()
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each path below a folder that matches a pattern, and the values of the fields in it.

    A field matches the name of a file or folder, or a part of such a name. A field that occurs
    several times has the same value everywhere. A name of a file or folder that begins with a dot
    matches only if the pattern has this dot, too. Paths are in alphabetical order.
    """
    for path, values in _all(pattern, folder, inside):
        if _dotted(pattern, path) is None:
            yield path, values


def match_files(
    pattern: str,
    folder: str = "",
    *,
    output: str | None = None,
    truth: tuple[str, str] | None = None,
    inside: Inside = lambda _: (),
) -> tuple[list[tuple[str, dict[str, str]]], dict[str, str]]:
    """Return the files that match a pattern, without those that users did not mean.

    These files are skipped:

    - files in the store of a batch or in a folder of results, if a field of the pattern matches the
      name of this folder or of a folder above it
    - files with a dot at the begin of a name, if the pattern does not have this dot
    - truths that match the pattern of the estimates, if this pattern has all fields of the pattern
      of the truths and at least one more

    Parameters
    ----------
    pattern : str
        Pattern of the files.
    folder : str
        Folder to which the pattern is relative.
    output : str, optional
        Folder into which the batch writes. It counts as a store even if it has no files yet.
    truth : pair of str, optional
        Pattern of the truths, and the folder to which it is relative. Only for a pattern of
        estimates.
    inside : callable
        Function as described at `Inside`.

    Returns
    -------
    list of (str, dict)
        Path of each file, and the values of the fields in it.
    dict of str to str
        Sentence about the skipped files, by reason.
    """
    from tgospa_eval.common.writing import results_in  # lazy: only batches need it

    real = functools.cache(os.path.realpath)  # cached: a folder may have thousands of files

    def place(above: str, name: str) -> str:
        return os.path.join(real(above), name)

    matches = list(_all(pattern, folder, inside))
    truths: set[str] = set()
    if truth is not None and set(fields(truth[0])) < set(fields(pattern)):
        named = {os.path.join(truth[1], fill(truth[0], values)) for _, values in matches}
        truths = {place(*os.path.split(path)) for path in named}
    store = None if output is None else os.path.realpath(output)

    @functools.cache
    def results(above: str) -> Callable[[str], bool]:
        whole = os.path.join(folder, above)
        return (lambda _: True) if real(whole) == store else results_in(Path(whole))

    files: list[tuple[str, dict[str, str]]] = []
    left: dict[str, list[str]] = {}
    for path, values in matches:
        if any(results(above)(below) for above, below in _cuts(pattern, path)):
            left.setdefault(WRITTEN, []).append(path)
        elif _dotted(pattern, path) is not None:
            left.setdefault(DOTTED, []).append(path)
        elif truths and place(*os.path.split(os.path.join(folder, path))) in truths:
            left.setdefault(TRUTH, []).append(path)
        else:
            files.append((path, values))
    notices = {}
    for why, (first, *more) in left.items():
        write = truth[0] if truth and why == TRUTH else _dotted(pattern, first)
        remedy = f"name {'their' if more else 'its'} folder" if why == WRITTEN else f"write {write}"
        which = os.path.join(folder, first)
        which += f" and {counted(len(more), 'more file')}" if more else ""
        it = "them" if more else "it"
        notices[why] = f"{which}: skipped ({why}); to evaluate {it}, {remedy}"
    return files, notices


def _dotted(pattern: str, path: str) -> str | None:
    """Return the pattern with a dot before each field that stands for a name with a first dot.

    The result is None if no name in the path begins with a dot that a field of the pattern matches.
    """
    if path[:1] != "." and "/." not in _slashed(path):  # most paths have no dots
        return None
    pairs = list(zip(_slashed(pattern).split("/"), _slashed(path).split("/"), strict=True))
    hidden = [bool(re.match(FIELD, part)) and name.startswith(".") for part, name in pairs]
    if not any(hidden):
        return None
    return "/".join("." * dot + part for dot, (part, _) in zip(hidden, pairs, strict=True))


def _cuts(pattern: str, path: str) -> Iterator[tuple[str, str]]:
    """Yield the ways to split a path into a folder and the rest.

    The folder is named by a field, or is below a folder that a field names.
    """
    parts = _slashed(path).split("/")
    named = _slashed(re.split(FIELD, pattern)[0]).count("/")  # folders before the first field
    for k in range(named + 1, len(parts)):
        yield "/".join(parts[:k]), "/".join(parts[k:])


def _slashed(path: str) -> str:
    return path.replace("\\", "/")


def _all(pattern: str, folder: str, inside: Inside) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield what `matching_paths` yields, and also paths in which a field matches a first dot."""
    import glob  # lazy: only patterns need it

    file, variable = _split(pattern)
    parts = re.split(FIELD, file)  # text, name, text, name, ..., text
    wild = "*".join(glob.escape(text) for text in parts[::2])
    shape = _shape(pattern, "+")
    paths: Iterable[str] = sorted(glob.glob(wild, root_dir=folder or None, include_hidden=True))
    if fields(variable):
        paths = (f"{path}:{name}" for path in paths for name in inside(os.path.join(folder, path)))
    elif variable:
        paths = (f"{path}:{variable}" for path in paths)
    for path in paths:
        match = shape.fullmatch(_slashed(path))
        if match is not None:
            yield path, match.groupdict()


def values_of(pattern: str, folder: str, path: str) -> dict[str, str] | None:
    """Return the values of the fields of a pattern in a path; None if the path does not match."""
    file = os.path.relpath(os.path.join(folder, _split(pattern)[0]))
    match = _shape(file, "+").fullmatch(_slashed(path))
    return match.groupdict() if match and _dotted(file, path) is None else None


def is_ambiguous(pattern: str, path: str) -> bool:
    """Return whether a path matches a pattern with more than one set of values of the fields."""
    slashed = _slashed(path)
    greedy, lazy = (_shape(pattern, repeated).fullmatch(slashed) for repeated in ("+", "+?"))
    return bool(greedy and lazy and greedy.groupdict() != lazy.groupdict())


@functools.lru_cache
def _shape(pattern: str, repeated: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern.

    If `repeated` is ``+``, each field matches as much as possible; if it is ``+?``, as little.
    """
    file = _split(pattern)[0]
    parts = re.split(FIELD, _of_cell(pattern))
    shape, named, size = "", set(), 0
    for text, name in zip(parts[::2], (*parts[1::2], None), strict=True):
        shape += re.escape(_slashed(text))
        size += len(text)
        if name is not None:
            piece = "[^/]" if size < len(file) else "[^{}]"
            shape += f"(?P={name})" if name in named else f"(?P<{name}>{piece}{repeated})"
            named.add(name)
            size += len(name) + 2
    return re.compile(shape)


def _split(pattern: str) -> tuple[str, str]:
    """Split a path into the file and the variable; the variable is blank if none is named."""
    named = re.match(WITH_VARIABLES, pattern)
    return (named[1], pattern[named.end() :]) if named else (pattern, "")


def _of_cell(pattern: str) -> str:
    """Add the braces of MATLAB to the field of a cell: ``Y{run}`` becomes ``Y{{run}}``."""
    variable = _split(pattern)[1]
    cell = re.fullmatch(rf"\w+{FIELD}", variable)
    return f"{pattern[: -len(cell[1]) - 2]}{{{{{cell[1]}}}}}" if cell else pattern
