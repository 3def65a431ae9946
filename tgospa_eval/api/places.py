"""Folders and patterns where a file is needed: what is in them, and what to type instead."""

import os
import re
from collections.abc import Iterator, Sequence
from itertools import product

from tgospa_eval.common.files import STDIN
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.guess import file_of, folder_format
from tgospa_eval.formats.loading import plain_name
from tgospa_eval.text import listed

SUFFIXES = (".csv", ".tsv", ".txt", ".parquet", ".pq", ".feather", ".arrow", ".npz", ".mat")
ASIDE = {"det", "img1", "seqmaps"}
"""Folders of MOTChallenge without tracks."""

DEEP = 4
"""Folders are looked into so far: train/MOT17-02/gt/gt.txt."""

FILES_SEEN = 10_000
"""Files that are looked at."""

FILES_SHOWN = 3
SHAPES = 20


@dataclass(frozen=True)
class Place:
    """A folder or a pattern, the files that it stands for below `folder`, and the message."""

    folder: str
    files: tuple[str, ...]
    message: str


def check_places(paths: Sequence[str]) -> None:
    """Whether these can be files: the truth, and the estimate if there is one.

    Raises
    ------
    InputError
        One is a folder or a pattern; the message has what to type.
    """
    places = [find_place(path) for path in paths]
    if any(places):
        messages = [
            f"{path}: no such file" if place is None else place.message
            for path, place in zip(paths, places, strict=True)
            if place is not None or not (path == STDIN or os.path.lexists(file_of(path)))
        ]
        raise InputError(*messages, *_advice(paths, places))


def find_place(path: str) -> Place | None:
    """What is at a path, unless it is a file or nothing."""
    if os.path.isdir(path) and not folder_format(path):
        files = tuple(_files(path))
        inside = f"in it: {listed(files, FILES_SHOWN)}" if files else "no table is in it"
        return Place(path, files, f"{path}: is a folder, not a file; {inside}")
    pattern = re.search(r"[*?[]", path)
    if pattern is None or os.path.lexists(path):
        return None
    import glob  # lazy: most paths are no patterns

    folder = os.path.dirname(path[: pattern.start()])
    found = sorted(name for name in glob.glob(path) if os.path.isfile(name))
    if found:
        files = tuple(os.path.relpath(name, folder or ".").replace(os.sep, "/") for name in found)
        message = f"{path}: is a pattern, not a file; it fits {listed(found, FILES_SHOWN)}"
        return Place(folder, files, message)
    files = tuple(_files(folder or "."))
    inside = (
        f"{folder or 'this folder'} has {listed(files, FILES_SHOWN)}" if files else "there is none"
    )
    return Place(folder, files, f"{path}: no file fits this pattern; {inside}")


def _files(folder: str) -> Iterator[str]:
    """Tables, and folders that are one side, below a folder, by their paths from there."""
    count = 0
    for parent, folders, files in os.walk(folder):
        inner = os.path.relpath(parent, folder).replace(os.sep, "/")
        depth = 0 if inner == "." else inner.count("/") + 1
        folders[:] = sorted(
            name for name in folders if name not in ASIDE and name[0] != "." and depth + 1 < DEEP
        )
        count += len(files)
        if inner != "." and folder_format(parent):
            folders.clear()
            yield inner
            continue
        for name in sorted(files):
            if plain_name(name).endswith(SUFFIXES):
                yield name if inner == "." else f"{inner}/{name}"
        if count > FILES_SEEN:
            return


def _advice(paths: Sequence[str], places: Sequence[Place | None]) -> Iterator[str]:
    """What to type."""
    shapes = [
        _shapes(("", (path,)) if place is None else (place.folder, place.files))
        for path, place in zip(paths, places, strict=True)
    ]
    if len(shapes) == 1:
        first = next((next(iter(found.values())) for found in shapes[0].values()), None)
        if first is not None:
            yield f"for one of them: tgospa-eval inspect {_quoted(first)}"
        return
    if not all(shapes):
        return
    best = max(product(*shapes), key=lambda pair: _fit(shapes, *pair))
    truth, estimate = (found[shape] for found, shape in zip(shapes, best, strict=True))
    names = [name for name in truth if name in estimate and truth[name] != estimate[name]]
    if not names:
        # One each: no names are needed to see what belongs together.
        files = [{path for group in found.values() for path in group.values()} for found in shapes]
        if all(len(found) == 1 for found in files) and files[0] != files[1]:
            yield _type(*(found.pop() for found in files))
        elif all(places):
            yield "no file of one has the name of a file of the other: name a pair"
        return
    name = names[0]
    yield _type(truth[name], estimate[name])
    from tgospa_eval.campaign.pairs import layout_of  # lazy: slow to import, for faults only

    layout = layout_of(*paths) if len(names) > 1 else None
    if layout is not None:
        folders = " ".join(map(_quoted, paths))
        yield f"for all: tgospa-eval batch --layout {layout} {folders} -o results"
    elif len(names) > 1:
        yield from _all(names, *best)


def _quoted(path: str) -> str:
    import shlex  # lazy: for faults only

    return shlex.quote(path)


def _type(truth: str, estimate: str) -> str:
    return f"type: tgospa-eval {_quoted(truth)} {_quoted(estimate)}"


def _all(names: list[str], truth: str, estimate: str) -> Iterator[str]:
    """What to type for all sequences; `{}` stands for the name in the two paths."""
    sides = [side.format("{name}") for side in (truth, estimate)]
    options = " ".join(
        f"--{role} {_quoted(side)}" for role, side in zip(("truth", "estimate"), sides, strict=True)
    )
    yield f"for all {len(names)}: tgospa-eval batch {options} -o results"
    yield (
        "or judge all by a baseline: tgospa-eval gate --suite FILE, with [[pair]] "
        f'truth = "{sides[0]}", estimate = "{sides[1]}"'
    )


def _shapes(place: tuple[str, tuple[str, ...]]) -> dict[str, dict[str, str]]:
    """Paths by what they have in common and what differs: gt/{}/gt/gt.txt, MOT17-02."""
    folder, files = place
    found: dict[str, dict[str, str]] = {}
    for file in files:
        path = os.path.normpath(os.path.join(folder, file)).replace(os.sep, "/")
        parts = path.split("/")
        begin = len(parts) - len(os.path.normpath(file).split(os.sep)) if folder else 0
        for k in range(begin, len(parts)):
            is_file = k == len(parts) - 1 and "." in parts[k]
            stem, dot, suffix = parts[k].rpartition(".") if is_file else (parts[k], "", "")
            if not stem or "{" in path or "}" in path:
                continue
            shape = "/".join((*parts[:k], f"{{}}{dot}{suffix}", *parts[k + 1 :]))
            found.setdefault(shape, {})[stem] = path
    most = sorted(found, key=lambda shape: -len(found[shape]))[:SHAPES]
    return {shape: found[shape] for shape in most}


def _fit(
    shapes: Sequence[dict[str, dict[str, str]]], truth: str, estimate: str
) -> tuple[int, bool, int]:
    """How well two shapes go together: by common names, then by the usual name of truth."""
    common = len(set(shapes[0][truth]) & set(shapes[1][estimate])) if truth != estimate else 0
    return common, "gt" in re.split(r"[/._]", truth), -len(truth) - len(estimate)
