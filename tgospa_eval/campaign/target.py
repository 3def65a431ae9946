"""Files of the target branch: of a git revision, or of a folder beside the working tree."""

import os
import subprocess
from collections.abc import Sequence

from tgospa_eval.common.files import is_missing, read_bytes
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import quoted

OPTION = "--against"


class Target:
    """Reads files of the target by their paths in the working tree.

    Parameters
    ----------
    where : str
        A git revision such as ``origin/main``, or a folder with a checkout of the target.

    Raises
    ------
    ConfigError
        It is neither, or both.
    """

    def __init__(self, where: str) -> None:
        self.where = where
        commit = _git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{where}^{{commit}}")
        is_folder = os.path.isdir(where)
        self.commit = "" if is_folder else (commit or b"").decode().strip()
        if is_folder and commit is not None and not where.startswith((".", "/")):
            raise ConfigError(
                f"{OPTION} {where}: is a folder and a git revision; write ./{where} for the "
                f"folder, refs/heads/{where} for the branch"
            )
        if not is_folder and commit is None:
            raise ConfigError(
                f"{OPTION} {quoted(where)}: is neither a folder nor a git revision that is here; "
                "a CI system may have to fetch it: git fetch origin BRANCH"
            )

    def name(self, path: str) -> str:
        """What a file is called in messages."""
        return f"{self.where}:{path}" if self.commit else os.path.join(self.where, path)

    def read(self, path: str) -> bytes | None:
        """The content of a file; None where the target has no such file.

        Raises
        ------
        ConfigError
            It cannot be read.
        """
        if not self.commit:
            path = os.path.join(self.where, os.path.relpath(path))
            return None if is_missing(path) else read_bytes(path, ConfigError)
        return _git("cat-file", "blob", f"{self.commit}:./{_relative(path)}")

    def changed(self, paths: Sequence[str]) -> list[str]:
        """Those of the files that are others than in the target, which has them."""
        if self.commit:
            # By git, which knows of ends of lines and of large files that are kept elsewhere.
            found, top = b"", os.fsdecode(_git("rev-parse", "--show-toplevel") or b"").rstrip("\n")
            for at in range(0, len(paths), AT_ONCE):
                some = map(_relative, paths[at : at + AT_ONCE])
                found += _git("--literal-pathspecs", *DIFF, self.commit, "--", *some) or b""
            names = map(os.fsdecode, found.split(b"\0"))
            changed = {os.path.realpath(os.path.join(top, name)) for name in names if name}
            return [path for path in paths if os.path.realpath(path) in changed]
        there = ((path, self.read(path)) for path in paths)
        return [
            path for path, old in there if old is not None and old != read_bytes(path, ConfigError)
        ]


DIFF = ("diff", "--name-only", "-z", "--no-ext-diff", "--no-renames", "--diff-filter=MTD")
AT_ONCE = 500
"""Files of one command line."""


def _relative(path: str) -> str:
    """A path from the current folder, with slashes, as git takes it."""
    return os.path.relpath(path).replace(os.sep, "/")


def _git(*arguments: str) -> bytes | None:
    """What git prints; None where it fails."""
    command: Sequence[str] = ("git", *arguments)
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout if done.returncode == 0 else None
