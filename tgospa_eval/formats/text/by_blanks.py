"""Tables whose columns are separated by blanks, as tables separated by tabs.

So numpy.savetxt writes them, and the trajectories of robotics: a header behind a comment mark,
columns of numbers, comments on lines of their own.
"""

import re

from tgospa_eval.formats.guess import COMMENTS

QUOTED_OR_BLANKS = re.compile(r'"[^"\n]*"|[ \t]+')
OUTER_BLANKS = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
COMMENT = re.compile(rf"^[ \t]*(?:{'|'.join(map(re.escape, COMMENTS))})(?:[ \t].*)?$", re.MULTILINE)
"""A line that is a comment: no id is a mark alone."""

QUOTED_OR_ODD = re.compile(r'["\x0b\x0c\x1c-\x1f]')
"""Quotes, and blanks of other kinds."""

FEWEST = 3
"""Columns of a table: id, t and x."""


def header_by_blanks(line: str, after: str) -> str | None:
    """A line without any other delimiter with tabs in place of blanks; None where it has another.

    A comment mark in front is left out if the line after has as many words: else it is a comment.
    """
    line = line.strip()
    plain = unquoted(line)
    if any(mark in plain for mark in ",;\t|"):
        return None
    mark = next((mark for mark in COMMENTS if line.startswith(mark)), "")
    words = _tabbed(line.removeprefix(mark).strip())
    count = words.count("\t") + 1
    fits = not mark or not after.strip() or len(after.split()) == count
    return words if count >= FEWEST and fits else None


def unquoted(line: str) -> str:
    """A line without what is in quotes."""
    return re.sub(r'"[^"]*"', "", line) if '"' in line else line


def rows_by_tabs(text: str) -> tuple[str, int]:
    """The rows with tabs in place of blanks, comments as blank lines, and their number."""
    text, comments = COMMENT.subn("", text)
    if text.isascii() and not QUOTED_OR_ODD.search(text):  # ten times as fast
        return "\n".join(map("\t".join, map(str.split, text.split("\n")))), comments
    return _tabbed(OUTER_BLANKS.sub("", text)), comments


def _tabbed(text: str) -> str:
    return QUOTED_OR_BLANKS.sub(lambda found: found[0] if found[0][0] == '"' else "\t", text)
