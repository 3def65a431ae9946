"""Digests of the files of a recording as they are, by which one that was changed is seen."""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

from tgospa_eval.common.files import CHUNK, named
from tgospa_eval.errors import InputError
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.partitioned.tasks import Run, removing, writing

TOGETHER = 1 << 26
"""Bytes of files that are one task."""

CONTENT = "content"
"""In the folder of work, that of the digests of the files that it is derived from."""

Stretch = tuple[File, int, int]
"""Bytes of a file, from one to another."""


def changed_file(files: Sequence[tuple[File, os.stat_result]], work: Path, run: Run) -> str | None:
    """Empty a folder of work that was derived from files with another content.

    A file that was changed may have the size and the times of the old one. So all are read, when
    the work is begun and whenever it is gone on with.

    Parameters
    ----------
    files : sequence of pairs
        Those of both sides, as `listing.stored` finds them.
    work : Path
        The folder.
    run : callable
        Does tasks, as `partitioned.tasks.run_tasks`.

    Returns
    -------
    str or None
        The first that has changed, if the work has to be begun anew.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    kept = work / CONTENT / "digests.json"
    kept.parent.mkdir(parents=True, exist_ok=True)
    fresh = tempfile.mkdtemp(dir=kept.parent)  # what was found before says nothing of now
    stretches = {
        os.path.join(fresh, str(number)): some for number, some in enumerate(_stretches(files))
    }
    run({output: partial(write_digests, stretches=some) for output, some in stretches.items()})
    now: dict[str, list[str]] = {}
    for output, some in stretches.items():
        found = json.loads(Path(output).read_bytes())
        for (file, _, _), digest in zip(some, found, strict=True):
            now.setdefault(file.path, []).append(digest)
    shutil.rmtree(fresh, ignore_errors=True)
    before = now
    if kept.exists():
        try:
            before = json.loads(kept.read_bytes())
        except ValueError:  # the machine has stopped before it was written
            before = {}
    changed = [path for path in {**before, **now} if before.get(path) != now.get(path)]
    if changed:
        with removing(work, but=CONTENT):  # the old digests go last
            pass
    if changed or not kept.exists():
        with writing(str(kept)) as beside:
            beside.write_text(json.dumps(now), encoding="utf-8")
    return next(iter(changed), None)


def write_digests(output: str, stretches: tuple[Stretch, ...]) -> None:
    """Write the digests of stretches of files.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    digests = []
    for file, begin, end in stretches:
        sha = hashlib.sha256()
        with named(file.path, InputError), open(file.place, "rb", buffering=0) as source:
            source.seek(begin)
            while begin < end and (content := source.read(min(CHUNK, end - begin))):
                sha.update(content)
                begin += len(content)
        digests.append(sha.hexdigest())
    with writing(output) as beside:
        beside.write_text(json.dumps(digests), encoding="utf-8")


def _stretches(files: Iterable[tuple[File, os.stat_result]]) -> Iterator[tuple[Stretch, ...]]:
    """The bytes of all files in order, so many together."""
    waiting: list[Stretch] = []
    size = 0
    for file, found in files:
        for begin in range(0, max(found.st_size, 1), TOGETHER):
            end = min(begin + TOGETHER, found.st_size)
            waiting.append((file, begin, end))
            size += end - begin
            if size >= TOGETHER:
                yield tuple(waiting)
                waiting, size = [], 0
    if waiting:
        yield tuple(waiting)
