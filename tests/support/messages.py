"""Every message of the package in one text: ``python tests/support/messages.py > messages.txt``.

Errors, warnings and notices, as a user may read them, with the names of what is put in. For who
reads all of them in one go.
"""

import ast
import re
from collections.abc import Iterator

from checkout import ROOT

PACKAGE = ROOT / "tgospa_eval"
SPEAKERS = re.compile(r"(Error|Notice|Parameter|Warning|_notice|notify|say|about|advise)$")
"""Names of what takes a message."""

SHORTEST = 12
"""Characters of the shortest text that is a message."""


def template(node: ast.expr) -> str:
    """A text as it is written, with names in braces."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(map(template, node.values))
    if isinstance(node, ast.FormattedValue):
        return f"{{{ast.unparse(node.value)}}}"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return template(node.left) + template(node.right)
    return ""


def messages(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and text of each message: what errors and notices are given, and texts that wait."""
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    inside: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func).rpartition(".")[2]
            given = [*node.args, *(keyword.value for keyword in node.keywords)]
            spoken = bool(SPEAKERS.search(name))
        elif isinstance(node, ast.Return | ast.Yield) and node.value is not None:
            given, spoken = [node.value], True
        elif isinstance(node, ast.Assign | ast.Dict | ast.Tuple | ast.List | ast.IfExp):
            given, spoken = [*ast.iter_child_nodes(node)], True  # type: ignore[list-item]
        else:
            continue
        for part in given if spoken else ():
            text = template(part) if isinstance(part, ast.expr) else ""
            words = re.sub(r"\{[^{}]*\}", "", text)
            if id(part) in docs | inside or len(words) < SHORTEST or " " not in words.strip():
                continue
            inside.update(map(id, ast.walk(part)))
            yield part.lineno, text


def main() -> None:
    """Print the messages of all files."""
    for path in sorted(PACKAGE.rglob("*.py")):
        found = sorted({*messages(ast.parse(path.read_text(encoding="utf-8")))})
        if found:
            print(f"\n{path.relative_to(ROOT).as_posix()}")
        for line, text in found:
            print(f"{line:>5}  {text}")


if __name__ == "__main__":
    main()
