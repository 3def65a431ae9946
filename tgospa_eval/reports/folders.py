"""Folders of results: known again, without files of the run before, whole or absent."""

import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from tgospa_eval.errors import ConfigError
from tgospa_eval.files import named

PICTURES = ("png", "svg", "pdf")
FRESH, REPLACED = ".tgospa-eval-new-", ".tgospa-eval-replaced-"
"""What names begin with that stand in a folder only while it is written."""

AS_FORMAT = {".json": "json", ".csv": "csv", ".md": "markdown", ".tex": "latex"}


def _pictures(*names: str) -> tuple[str, ...]:
    return tuple(f"{name}.{kind}" for name, kind in product(names, PICTURES))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What one kind of folder holds.

    Parameters
    ----------
    document : str
        The file that goes first and comes last, so that it never stands beside files of another
        run.
    pattern : bytes
        Regular expression by which a document of ours is known.
    names : collection of str
        All files that may be there; those that a run does not write are of an older one.
    log : str, optional
        A file by which the folder is known even without a document, and which stays.
    opens : tuple of str
        What to open, the first that there is.
    options : str
        Options that make pictures, for messages.
    """

    document: str
    pattern: bytes
    names: Collection[str]
    log: str | None = None
    opens: tuple[str, ...] = ()
    options: str = ""

    def owns(self, folder: Path) -> bool:
        """Whether the folder is one of this kind."""
        if self.log is not None and (folder / self.log).is_file():
            return True
        document = folder / self.document
        return (folder / (REPLACED + self.document)).is_file() or (
            document.is_file() and re.search(self.pattern, document.read_bytes()) is not None
        )


RESULT = Kind(
    document="result.json",
    pattern=rb'"schema": "tgospa-eval/result/',
    names=frozenset(
        (
            "result.json", "per_step.csv", "assignments.csv", "switches.csv", "per_truth.csv",
            "per_estimate.csv", "timings.csv", "curve.csv", "per_class.csv", "report.html",
            *_pictures("costs", "lanes", "plane", "cumulative", "worst"),
        )
    ),
    opens=("report.html",),
    options=" --pictures {0}",
)  # fmt: skip
SWEEP = Kind(
    document="sweep.json",
    pattern=rb'"schema": "tgospa-eval/sweep/',
    names=frozenset(("sweep.json", "sweep.csv", *_pictures("sweep"))),
    opens=_pictures("sweep"),
    options=" --pictures {0}",
)
COMPARISON = Kind(
    document="compare.json",
    pattern=rb'(?s)"kind": "(solvers|estimates)".*"schema": "tgospa-eval/compare/',
    names=frozenset(
        (
            "compare.json", "compare.csv", "per_step.csv", "pairs.csv",
            *_pictures("time_over_error", "error_over_epsilon", "convergence", "cumulative"),
        )
    ),
    opens=("time_over_error.png", "cumulative.png"),
)  # fmt: skip
STUDY = Kind(
    document="compare.json",
    pattern=rb'(?s)"kind": "study".*"schema": "tgospa-eval/compare/',
    names=frozenset(
        ("compare.json", "compare.csv", "report.md", *_pictures("error_over_epsilon", "scaling"))
    ),
    log="runs.jsonl",
    opens=("report.md",),
)


@dataclass(frozen=True, kw_only=True)
class Written:
    """What was written.

    Parameters
    ----------
    folder : str
        Where, as typed.
    names : tuple of str
        The files.
    removed : int
        How many files of an older run were taken away.
    opens : tuple of str
        What to open, the first that there is.
    """

    folder: str
    names: tuple[str, ...]
    removed: int = 0
    opens: tuple[str, ...] = ()

    def __str__(self) -> str:
        pictures = sum(name.endswith(PICTURES) for name in self.names)
        parts = [
            f"{count} {what}{'' if count == 1 else 's'}"
            for count, what in ((len(self.names) - pictures, "file"), (pictures, "picture"))
            if count
        ]
        text = f"wrote {' and '.join(parts)} to {os.path.join(self.folder, '')}"
        if self.removed:
            text += f", removed {self.removed} of the run before"
        shown = next((name for name in self.opens if name in self.names), None)
        return text if shown is None else f"{text}; open {os.path.join(self.folder, shown)}"


def check_folder(
    folder: str, kind: Kind | None = None, *, force: bool, option: str = "--output"
) -> None:
    """See that a folder can be written, before any work is done.

    Parameters
    ----------
    folder : str
        Where.
    kind : Kind, optional
        A folder of this kind may be written anew.
    force : bool
        Whether it may hold whatever it does.
    option : str
        What messages begin with.

    Raises
    ------
    ConfigError
        It is a file, or looks like the name of one, or is not empty and of no such kind.
    """
    if not folder:
        raise ConfigError(f"{option} is empty; name a folder")
    path = Path(folder)
    with named(f"{option} {folder}", ConfigError, "cannot be written"):
        if path.exists() and not path.is_dir():
            raise ConfigError(f"{option} {folder}: is a file; name a folder")
        if not path.is_dir():
            _check_name(folder, kind, option)
        elif not force and not (kind and kind.owns(path)) and any(_others(path)):
            raise ConfigError(f"{option} {folder}: is not empty; name another folder, or --force")


def probe_folder(
    folder: str, kind: Kind | None = None, *, force: bool, option: str = "--output"
) -> None:
    """`check_folder`, and see that files can be made where `write_texts` will make them.

    Raises
    ------
    ConfigError
        As for `check_folder`, or nothing can be written there.
    """
    import tempfile

    check_folder(folder, kind, force=force, option=option)
    with named(f"{option} {folder}", ConfigError, "cannot be written"):
        path = Path(os.path.realpath(folder))
        there = next(above for above in (path, *path.parents) if above.exists())
        os.rmdir(tempfile.mkdtemp(prefix=FRESH, dir=there))


def write_texts(
    texts: Mapping[str, str | bytes],
    folder: str,
    kind: Kind | None = None,
    *,
    force: bool,
    option: str = "--output",
) -> Written:
    """Write the files of a folder, in place of those that an older run of its kind has left.

    A new folder appears whole. In one that is there, the old document goes before anything else
    changes and the new one comes last; of two runs that write it at once one waits.

    Raises
    ------
    ConfigError
        As for `check_folder`, or the folder cannot be written.
    """
    check_folder(folder, kind, force=force, option=option)
    with named(f"{option} {folder}", ConfigError, "cannot be written"):
        path = Path(os.path.realpath(folder))
        if not path.exists() and _write_new(texts, path):
            removed = 0
        else:  # perhaps since a moment ago
            check_folder(folder, kind, force=force, option=option)
            removed = _write_over(texts, path, kind)
    opens = () if kind is None else kind.opens
    return Written(folder=folder, names=tuple(texts), removed=removed, opens=opens)


def _check_name(folder: str, kind: Kind | None, option: str) -> None:
    """A folder that is not there yet and is called like a file is a misunderstanding.

    Raises
    ------
    ConfigError
        It is called so.
    """
    stem, suffix = os.path.splitext(folder)
    suffix = suffix.lower()
    pictures, letter = suffix[1:] in PICTURES, "-o " if option == "--output" else ""
    if suffix in AS_FORMAT and kind is not None:
        remedy = f"--format {AS_FORMAT[suffix]} > {folder}"
    elif pictures and kind is not None:
        remedy = f"-o {stem}{kind.options.format(suffix[1:])}"
    elif suffix == ".html" and kind is RESULT:
        remedy = f"-o {stem}, and open {os.path.join(stem, 'report.html')}"
    elif suffix in (*AS_FORMAT, ".html", ".txt") or pictures:
        remedy = f"{letter}{stem}"
    else:
        return
    raise ConfigError(f"{option} {folder}: must be a folder, not a file; type {remedy}")


def _others(path: Path) -> Iterator[Path]:
    """What is in a folder but for what an interrupted run has left."""
    return (item for item in path.iterdir() if not item.name.startswith((FRESH, REPLACED)))


def _write_all(texts: Mapping[str, str | bytes], folder: Path) -> None:
    folder.mkdir()
    for name, text in texts.items():
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))


def _unique(prefix: str) -> str:
    return f"{prefix}{os.getpid()}-{os.urandom(4).hex()}"


def _write_new(texts: Mapping[str, str | bytes], path: Path) -> bool:
    """Write a folder beside, then rename it; False if another one has come up meanwhile."""
    import shutil  # here: it brings compression

    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(_unique(FRESH))
    try:
        _write_all(texts, beside)
        try:
            os.rename(beside, path)
        except OSError:
            if not path.is_dir():
                raise
            return False
        return True
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _write_over(texts: Mapping[str, str | bytes], path: Path, kind: Kind | None) -> int:
    """Write into a folder that is there; how many files of an older run were taken away."""
    import shutil

    with _locked(path) as locked:
        for left in path.glob(f"{FRESH}*") if locked else ():
            shutil.rmtree(left, ignore_errors=True)
        fresh = path / _unique(FRESH)
        try:
            _write_all(texts, fresh)
            owned = kind is not None and kind.owns(path)
            stale = [
                path / name
                for name in (kind.names if owned and kind is not None else ())
                if name not in texts and (path / name).is_file()
            ]
            blocked = next((name for name in texts if (path / name).is_dir()), None)
            if blocked is not None:
                raise IsADirectoryError(0, f"{blocked} is a folder in it")
            _replace(fresh, path, tuple(texts), stale, None if kind is None else kind.document)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
    return len(stale)


def _replace(
    fresh: Path, path: Path, names: tuple[str, ...], stale: list[Path], document: str | None
) -> None:
    """Files of a folder by fresh ones; while that is going on, a hidden file says whose it is."""
    mark = path / (REPLACED + (document or ""))
    if document is not None:
        if (path / document).is_file():
            os.replace(path / document, mark)
        else:
            mark.touch()
    for old in stale:
        old.unlink()
    for name in sorted(names, key=lambda name: name == document):
        os.replace(fresh / name, path / name)
    if document is not None:
        mark.unlink()


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Others that write this folder wait; yields whether they do, as not all systems can."""
    try:
        import fcntl
    except ImportError:
        yield False
        return
    at = os.open(path, os.O_RDONLY)
    locked = False
    try:
        with suppress(OSError):  # of some network file systems
            fcntl.flock(at, fcntl.LOCK_EX)
            locked = True
        yield locked
    finally:
        os.close(at)
