"""Tables as plain text or Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

WIDTH = 100


@dataclass(frozen=True)
class Table:
    """A title, columns (the first to the left, the others to the right) and notes below."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def plain(self) -> str:
        """Aligned columns."""
        cells = [self.header, *self.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [self.title, ""]
        for row in cells:
            first, *others = row
            padded = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
            lines.append("  ".join(["  " + first.ljust(widths[0]), *padded]).rstrip())
        if self.notes:
            lines.append("")
        lines += [
            fill(note, WIDTH, initial_indent="  ", subsequent_indent="    ") for note in self.notes
        ]
        return "\n".join(lines) + "\n"

    def markdown(self) -> str:
        """A Markdown table."""
        aligned = ["---", *("---:" for _ in self.header[1:])]
        lines = [f"**{self.title}**", ""]
        lines += ["| " + " | ".join(row) + " |" for row in (self.header, aligned, *self.rows)]
        if self.notes:
            lines.append("")
        lines += [f"- {note}" for note in self.notes]
        return "\n".join(lines) + "\n"
