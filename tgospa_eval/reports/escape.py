"""One way into each language of the outputs: what is text there is no markup, and stays visible.

Of JSON and HTML the libraries take care, `json` and the autoescape of the template. Nothing else in
the reports writes a text of the user without one of these.
"""

import re

from tgospa_eval.common.figures import PLAIN_DECIMAL
from tgospa_eval.text import visible

LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
}

# Patterns are compiled when they are used: a small evaluation needs none.
_NAMES = r"(?<!\w)@(?=\w)"
"""Where GitHub sees the name of someone who is to be notified."""

_LINKS = r":(?=//)|(?<=www)\."
"""Where an address becomes a link."""

_FORMULA = "'*[-=+@\t\r\n\uff1d\uff0b\uff0d\uff20]"
"""How a text begins that a spreadsheet takes for a formula, after marks of ours if any."""

_NO_XML = "[\ufffe\uffff]"
"""What is visible and XML 1.0 cannot express, escaped or not."""

_XML = '[&<>"]'


def markdown(text: str) -> str:
    """The text in a paragraph, a list or a cell of Markdown."""
    text = visible(text).replace("&", "&amp;").replace("<", "&lt;")
    text = "".join(f"\\{c}" if c in "\\`*_|[]#~$" else c for c in text)
    return re.sub(_NAMES, "@&#8203;", re.sub(_LINKS, lambda found: f"\\{found[0]}", text))


def markdown_code(text: str) -> str:
    """A name as code of Markdown, in which nothing is a name of someone or a new cell."""
    text = visible(text)
    if not text.strip() or any(mark in text for mark in "`|\\"):
        return f"<code>{''.join(map(_entity, text))}</code>"
    return f"`{text}`"


def _entity(c: str) -> str:
    return c if c.isalnum() or c in " .,;:+%-=()/'\"" else f"&#{ord(c)};"


def latex(text: str) -> str:
    """The text in LaTeX."""
    return "".join(LATEX.get(c, c) for c in visible(text))


def latex_comment(text: str) -> str:
    """The text as a line of LaTeX that is not set."""
    return f"% {visible(text)}"


def xml(text: str) -> str:
    """Lines of text in an element or an attribute of XML."""
    text = "\n".join(map(visible, text.split("\n")))
    text = re.sub(_NO_XML, lambda found: f"\\u{ord(found[0]):04x}", text)
    return re.sub(_XML, lambda found: f"&#{ord(found[0])};", text).replace("\n", "&#10;")


def workflow_data(text: str) -> str:
    """Lines of text as the message of a workflow command."""
    text = "\n".join(map(visible, text.split("\n")))
    return text.replace("%", "%25").replace("\n", "%0A")


def workflow_property(text: str) -> str:
    """The text as a property of a workflow command."""
    return workflow_data(visible(text)).replace(":", "%3A").replace(",", "%2C")


def csv_cell(value: object) -> object:
    """The value in a CSV table: what a spreadsheet would take for a formula gets a ' in front.

    So does a text that begins so after marks of that kind, so that all texts stay different and
    the first ' before a formula is always ours. Numbers stay as they are.
    """
    if (
        isinstance(value, str)
        and re.match(_FORMULA, value)
        and not re.fullmatch(PLAIN_DECIMAL, value)
    ):
        return f"'{value}"
    return value
