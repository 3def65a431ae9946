"""Blocks of pages that are made: tables of options and headers from the code, and examples.

They stand in the pages, as a forge shows these, from a comment to ``<!-- end -->``: of options
``<!-- options VERB -->`` or ``<!-- options VERB SECTION -->``, as `tgospa-eval help VERB` prints
them; of headers that are found without options ``<!-- headers -->``; of a file
``<!-- file PATH LANGUAGE -->``. ``python docs/option_tables.py`` makes them anew; a test holds them
true.
"""

import re
from pathlib import Path

import click

from tgospa_eval.cli.shared.command import SECTIONS
from tgospa_eval.cli.verbs import load
from tgospa_eval.formats.headers import HEADER_ALIASES

BLOCK = re.compile(r"^<!-- (options|headers|file) ?(.*) -->\n(?:.*\n)*?<!-- end -->$", re.M)
DEFAULT = "evaluate"
"""Of the other verbs those options are shown that this one has not, or not with the same help."""


def records(verb: str) -> dict[str, dict[str, str]]:
    """By section the help of each option by its declaration."""
    command = load(verb)
    context = click.Context(command, info_name=verb)
    found: dict[str, dict[str, str]] = {name: {} for name in SECTIONS}
    for item in command.get_params(context):
        record = item.get_help_record(context) if isinstance(item, click.Option) else None
        if record is not None:
            found[getattr(item, "section", SECTIONS[-1])][record[0]] = record[1]
    return found


def escaped(text: str) -> str:
    """For a cell of a table."""
    return text.replace("|", r"\|")


def cell(text: str) -> str:
    """A text of help as Markdown: options as code, nothing else with a meaning."""
    parts = re.split(r"(?<![\w-])(--?[a-z][\w-]*)", re.sub(r"\s+", " ", text))
    plain = [re.sub(r"([\\`*_{}\[\]<>$~])", r"\\\1", part) for part in parts[::2]]
    code = [f"`{part}`" for part in parts[1::2]] + [""]
    return escaped("".join(map("".join, zip(plain, code, strict=True))))


def rows(options: dict[str, str]) -> str:
    """A table."""
    lines = [f"| `{escaped(name)}` | {cell(text)} |" for name, text in options.items()]
    return "\n".join(("| option | meaning |", "|---|---|", *lines))


def table(verb: str, section: str | None = None) -> str:
    """Options of a section, or all; but of `evaluate` those of its own, and names of the others."""
    sections = records(verb)
    if section is not None:
        return rows(sections[section])
    options = {name: text for part in sections.values() for name, text in part.items()}
    if verb == DEFAULT:
        return rows(options)
    usual = {item for part in records(DEFAULT).values() for item in part.items()}
    shared = [name for name, text in options.items() if (name, text) in usual]
    text = rows({name: text for name, text in options.items() if name not in shared})
    names = ", ".join(f"`{re.findall(r'--[a-z-]+|-h', name)[0]}`" for name in shared)
    return f"{text}\n\nOptions that `evaluate` has too: {names}."


def headers() -> str:
    """By column the headers that are found."""
    lines = [
        f"| {name} | {', '.join(f'`{alias}`' for alias in aliases)} |"
        for name, aliases in HEADER_ALIASES.items()
    ]
    return "\n".join(("| column | headers |", "|---|---|", *lines))


def filled(page: Path) -> str:
    """The text of a page with its blocks as they should be."""

    def block(found: re.Match[str]) -> str:
        kind, given = found[1], found[2].split()
        if kind == "file":
            text = page.parent.joinpath(given[0]).read_text(encoding="utf-8")
            made = f"```{given[1]}\n{text}```"
        else:
            made = table(*given) if kind == "options" else headers()
        return f"<!-- {' '.join((kind, *given))} -->\n\n{made}\n\n<!-- end -->"

    return BLOCK.sub(block, page.read_text(encoding="utf-8"))


if __name__ == "__main__":
    for path in Path(__file__).parent.rglob("*.md"):
        path.write_text(filled(path), encoding="utf-8")
