"""Blocks of pages that are made: tables of options and headers from the code, and examples.

They stand in the pages, as a forge shows these, from a comment to ``<!-- end -->``: options of
`evaluate` that answer a question, ``<!-- question WORDS -->``; options of another verb,
``<!-- options VERB -->``; headers that are found without options, ``<!-- headers -->``; a file,
``<!-- file PATH LANGUAGE -->``. ``python docs/option_tables.py`` makes them anew; a test holds them
true.
"""

import re
from pathlib import Path

import click

from tgospa_eval.cli.shared.command import SECTIONS
from tgospa_eval.cli.verbs import VERBS, load
from tgospa_eval.formats.headers import HEADER_ALIASES

BLOCK = re.compile(
    r"^<!-- (options|question|headers|file) ?(.*) -->\n(?:.*\n)*?<!-- end -->$", re.M
)
DEFAULT = "evaluate"
"""Of the other verbs those options are shown that this one has not, or not with the same help."""

QUESTIONS = {
    "What does an error cost?": ("Metric",),
    "How far apart are two states?": (
        "distance", "covariance", "vertical-weight", "periodic", "scale",
    ),
    "How are covariances compared?": ("Gaussians",),
    "How are particles compared?": ("Particles",),
    "Which steps count?": (
        "steps", "grid", "time", "time-tolerance", "interpolate", "max-gap", "outage", "resample",
        "period",
    ),
    "Which objects count?": ("Filters",),
    "How is it read?": ("Files",),
    "Which clock, unit and place?": (
        "time-offset", "time-scale", "unit-scale", "truth-crs", "estimate-crs", "origin",
        "truth-scale", "estimate-scale", "truth-time-format", "estimate-time-format",
        "truth-time-zone", "estimate-time-zone", "day-begins",
    ),
    "How is it solved?": ("Solver",),
    "What else is computed?": (
        "with", "slice", "sweep", "curve", "window", "every", "similarity", "tracked-shares",
        "explain",
    ),
    "What is printed and written?": ("Output",),
    "Where do settings come from?": ("General",),
}  # fmt: skip
"""Options of `evaluate`, or sections of its help: these have what no question names."""


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


def long_name(declared: str) -> str:
    """``--cutoff`` of ``-c, --cutoff C``."""
    return re.findall(r"--[a-z-]+|-h", declared)[0]


def answers(question: str) -> str:
    """Options of `evaluate`, in the order of its help."""
    named = {f"--{name}" for names in QUESTIONS.values() for name in names}
    wanted = QUESTIONS[question]
    return rows(
        {
            name: text
            for section, options in records(DEFAULT).items()
            for name, text in options.items()
            if (section in wanted and long_name(name) not in named)
            or long_name(name).removeprefix("--") in wanted
        }
    )


def has(verb: str) -> dict[str, str]:
    """Help of every option of a verb by its declaration."""
    return {name: text for part in records(verb).values() for name, text in part.items()}


def alone() -> list[str]:
    """Options of `evaluate` that no other verb has."""
    others = {long_name(name) for verb in VERBS if verb != DEFAULT for name in has(verb)}
    return [long_name(name) for name in has(DEFAULT) if long_name(name) not in others]


def table(verb: str) -> str:
    """Options of a verb's own, and names of those of `evaluate` that it has, or has not."""
    if verb == DEFAULT:
        return f"No other verb has {listed(alone())}."
    options, usual = has(verb), has(DEFAULT)
    shared = [long_name(name) for name, text in options.items() if usual.get(name) == text]
    own = {name: text for name, text in options.items() if long_name(name) not in shared}
    known = {*shared, *map(long_name, own), *alone()}
    lacks = [long_name(name) for name in usual if long_name(name) not in known]
    few = shared if len(shared) <= len(lacks) else lacks
    rest = "" if few is shared else " all other options but"
    return f"{rows(own)}\n\nAs in `evaluate`:{rest} {listed(few)}."


def listed(names: list[str]) -> str:
    """As code, with commas."""
    return ", ".join(f"`{name}`" for name in names)


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
        kind, given = found[1], found[2]
        if kind == "file":
            path, language = given.split()
            text = page.parent.joinpath(path).read_text(encoding="utf-8")
            made = f"```{language}\n{text}```"
        elif kind == "question":
            made = answers(given)
        else:
            made = table(given) if kind == "options" else headers()
        return f"<!-- {f'{kind} {given}'.strip()} -->\n\n{made}\n\n<!-- end -->"

    return BLOCK.sub(block, page.read_text(encoding="utf-8"))


if __name__ == "__main__":
    for path in Path(__file__).parent.rglob("*.md"):
        path.write_text(filled(path), encoding="utf-8")
