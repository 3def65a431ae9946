"""Files of the target branch: of a git revision, or of a folder beside the working tree."""

import filecmp
import os
import re
import subprocess
from collections.abc import Iterable, Iterator
from functools import cached_property

from tgospa_eval.common.files import is_missing, read_bytes
from tgospa_eval.common.patterns import WITH_VARIABLES
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import quoted

OPTION = "--against"


class Target:
    """Reads files of the target by their paths in the working tree.

    Parameters
    ----------
    where : str
        A git revision such as ``origin/main``, or a folder with a checkout of the target, which
        is written as no revision is: ``./target``, ``/target``, ``target/``.

    Raises
    ------
    ConfigError
        There is no such revision, or no such folder.
    """

    def __init__(self, where: str) -> None:
        self.where, self.commit = where, ""
        if where.startswith(".") or where.endswith(("/", os.sep)) or os.path.isabs(where):
            if not os.path.isdir(where):
                raise ConfigError(f"{OPTION} {quoted(where)}: there is no such folder")
            return
        commit = _git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{where}^{{commit}}")
        if commit is None:
            folder = f"; write ./{where} for the folder" if os.path.isdir(where) else ""
            raise ConfigError(
                f"{OPTION} {quoted(where)}: is no git revision that is here; a CI system may have "
                f"to fetch it: git fetch origin BRANCH{folder}"
            )
        self.commit = commit.decode().strip()

    def name(self, path: str) -> str:
        """The name of a file in messages."""
        return f"{self.where}:{path}" if self.commit else os.path.join(self.where, path)

    def read(self, path: str) -> bytes | None:
        """The content of a file, links followed; None where the target has no such file.

        Raises
        ------
        ConfigError
            It cannot be read.
        """
        if not self.commit:
            path = os.path.join(self.where, os.path.relpath(path))
            return None if is_missing(path) else read_bytes(path, ConfigError)
        relative = os.path.relpath(path).replace(os.sep, "/")
        name = f"{self.commit}:./{relative}\n".encode("utf-8", "surrogateescape")
        answer = _git("cat-file", "--batch", "--follow-symlinks", given=name) or b""
        head, _, content = answer.partition(b"\n")
        return content[:-1] if re.fullmatch(rb"[0-9a-f]+ blob [0-9]+", head) else None

    def demand(self, path: str) -> bytes:
        """The content of a file that has to be there.

        Raises
        ------
        ConfigError
            The target has no such file, or it cannot be read.
        """
        content = self.read(path)
        if content is None:
            raise ConfigError(f"{self.name(path)}: there is no such file")
        return content

    def has(self, path: str) -> bool:
        """Whether it has this file, or a folder with files."""
        return not self._with_folders.isdisjoint(_places(path))

    def has_another(self, path: str) -> bool:
        """Whether it has this file, or a file of this folder, with another content."""
        if self.commit:
            return not self._changed.isdisjoint(_places(path))
        file = os.path.join(self.where, os.path.relpath(_file(path)))
        for other in [file] if os.path.isfile(file) else _walk(file):
            mine = os.path.relpath(other, self.where)
            if not os.path.isfile(mine) or not filecmp.cmp(mine, other, shallow=False):
                return True
        return False

    @cached_property
    def missing(self) -> list[str]:
        """Its files that the working tree lacks, by their paths from the current folder."""
        return [os.path.relpath(file) for file in self._files if not os.path.lexists(file)]

    @cached_property
    def _files(self) -> list[str]:
        """All its files, by their paths in the working tree."""
        if self.commit:
            tree = ("ls-tree", "-r", "-z", "--name-only", "--full-tree", self.commit)
            return self._listed(*tree)
        return [os.path.abspath(os.path.relpath(path, self.where)) for path in _walk(self.where)]

    @cached_property
    def _with_folders(self) -> set[str]:
        return _with_folders(self._files)

    @cached_property
    def _changed(self) -> set[str]:
        """Files with another content in the working tree, or that it lacks; and their folders.

        By git, which knows of ends of lines and of large files that are kept elsewhere.
        """
        return _with_folders(self._listed(*DIFF, self.commit))

    def _listed(self, *arguments: str) -> list[str]:
        """Paths that git lists, in the working tree.

        Raises
        ------
        ConfigError
            It fails.
        """
        top, names = _git("rev-parse", "--show-toplevel"), _git(*arguments)
        if top is None or names is None:
            raise ConfigError(f"{OPTION} {self.where}: git {' '.join(arguments)} fails here")
        folder = os.path.realpath(os.fsdecode(top).rstrip("\n"))
        return [os.path.join(folder, name) for name in map(os.fsdecode, names.split(b"\0")) if name]


def last_change(path: str) -> Target | None:
    """The commit that changed a file last; None without one."""
    commit = _git("log", "-1", "--format=%h", "--", path) if path else None
    return Target(commit.decode().strip()) if commit else None


DIFF = (
    *("-c", "core.fileMode=false", "-c", "diff.relative=false", "diff", "--name-only", "-z"),
    *("--diff-filter=MTD", "--no-ext-diff", "--no-renames", "--ignore-submodules=all"),
)


def _file(path: str) -> str:
    """The file of a path, which may name a variable in it."""
    named = re.match(WITH_VARIABLES, path)
    return named[1] if named else path


def _places(path: str) -> set[str]:
    """A file as its links name it, and where it is."""
    return {os.path.abspath(_file(path)), os.path.realpath(_file(path))}


def _walk(folder: str) -> Iterator[str]:
    """All files below a folder."""
    for above, inner, names in os.walk(folder):
        inner[:] = sorted(name for name in inner if name != ".git")
        yield from (os.path.join(above, name) for name in sorted(names))


def _with_folders(files: Iterable[str]) -> set[str]:
    """Files, and the folders above them."""
    seen = set[str]()
    for file in files:
        while file not in seen:
            seen.add(file)
            file = os.path.dirname(file)
    return seen


def _git(*arguments: str, given: bytes = b"") -> bytes | None:
    """The output of git, of what it reads; None where it fails."""
    try:
        done = subprocess.run(("git", *arguments), input=given, capture_output=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout if done.returncode == 0 else None
