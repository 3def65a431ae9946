"""Lines of a table that are no rows: comments, which are passed over, and rows of another length.

A line that begins like a comment may be a row as well, for an id may begin so.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.text.convert import Block


class Oddities:
    """Lines of other lengths, and rows that begin like comments.

    Parameters
    ----------
    path : str
        The file, for messages.
    width : int
        Number of columns.
    """

    def __init__(self, path: str, width: int) -> None:
        self.path = path
        self.width = width
        self.wrong: list[tuple[int, int]] = []
        self.comments: list[tuple[int, int]] = []
        self.marked: int | None = None
        self.all_marked = True

    def add(self, line: int, fields: list[str]) -> None:
        """A line of another length."""
        is_comment = fields[0].lstrip().startswith(COMMENTS)
        (self.comments if is_comment else self.wrong).append((line, len(fields)))

    def watched(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks; which of their rows begin like comments is noted."""
        for block in blocks:
            begins = [text.lstrip(" \t").startswith(COMMENTS) for text in block.columns[0]]
            if self.marked is None and any(begins):
                self.marked = int(block.lines[begins.index(True)])
            self.all_marked = self.all_marked and all(begins)
            yield block

    def settled(self, roles: Roles) -> Roles:
        """The roles with a notice about comments, when all rows are read.

        Raises
        ------
        InputError
            A row has the wrong length; or it may be a comment as well as a row.
        """
        wrong = self.wrong
        if self.marked is not None and self.all_marked:  # ids begin so
            wrong = sorted([*wrong, *self.comments])
        if wrong:
            line, found = wrong[0]
            raise InputError(
                f"{self.path}, line {line}: {counted(found, 'field')}, the header has "
                f"{self.width}{more(len(wrong))}; give every row one field per column"
            )
        if self.marked is None:
            return with_comments(roles, len(self.comments))
        if not self.all_marked:
            raise InputError(
                f"{self.path}, line {self.marked}: a comment, not a row, or an id that begins like "
                "one; delete such lines (ids may begin like comments if all do)"
            )
        return roles


def with_comments(roles: Roles, count: int) -> Roles:
    """The roles with a notice about so many comments."""
    if not count:
        return roles
    notice = f"{counted(count, 'line')} of comments passed over"
    return replace(roles, passed=(*roles.passed, notice))
