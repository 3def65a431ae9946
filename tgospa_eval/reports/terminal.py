"""The table with colours, cost over time and worst steps, for a terminal of 80 columns (rich).

The user's words are never read as markup. Where the terminal cannot show the blocks of a sparkline
ASCII signs stand in.
"""

import io
from collections.abc import Callable, Iterable, Iterator

from rich.console import Console
from rich.text import Text

from tgospa_eval.common.words import number
from tgospa_eval.reports.console import SHOWN, blocks, fitting, worst
from tgospa_eval.reports.tables import WIDTH, Table, clip, text_lines
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import visible

BLOCKS = " ▁▂▃▄▅▆▇█"
SIGNS = " .:-=+*#@"
GRAPH = 62
GRAPH_BEFORE = "scale"
"""The block above which the cost over time is drawn."""

PART_STYLES = {"localisation": "blue", "missed": "red", "false": "magenta", "switch": "yellow"}


def report(result: Summary, encoding: str) -> str:
    """The text, with what colours the terminal has; `encoding` is that of stdout.

    `NO_COLOR` and `TERM` are respected.
    """
    console = Console(file=io.StringIO(), force_terminal=True, width=WIDTH, highlight=False)
    shown: list[list[Text]] = []
    for name, lines in blocks(result).items():
        if name == GRAPH_BEFORE:
            shown.append(list(_graph(result, BLOCKS if _can(BLOCKS, encoding) else SIGNS)))
        shown.append(list(STYLED.get(name, _plain)(result, lines)))
    with console.capture() as captured:
        for k, texts in enumerate(filter(None, shown)):
            if k:
                console.print()
            for text in texts:
                console.print(text, no_wrap=True, overflow="crop")
    return captured.get()


def sparkline(values: list[float], high: float, ramp: str = BLOCKS, width: int = GRAPH) -> str:
    """The values as heights from 0 to `high`; what is not 0 is never shown as nothing.

    Where there are more values than `width` each sign stands for the largest of several.
    """
    together = max(1, -(-len(values) // width))
    tops = [max(values[k : k + together]) for k in range(0, len(values), together)]
    most = len(ramp) - 1
    levels = (0 if top <= 0 else max(1, round(top / high * most)) for top in tops)
    return "".join(ramp[level] for level in levels)


def _graph(result: Summary, ramp: str) -> Iterator[Text]:
    """A row for the whole cost and each part, all to one scale, over the times."""
    table = result.table("per_step")
    high = max(table["total"], default=0.0)
    if not high > 0:
        return
    steps = len(table["t"])
    together = max(1, -(-steps // GRAPH))
    each = f", each sign the largest of {together}" if together > 1 else ""
    yield Text(f"  cost of each step, to {number(high)}{each}")
    for name in ("total", *PARTS):
        if any(table[name]):
            line = Text(f"  {name:<14}  ")
            line.append(sparkline(table[name], high, ramp), style=PART_STYLES.get(name, "bold"))
            yield line
    first, last = str(table["t"][0]), str(table["t"][-1])
    wide = -(-steps // together)
    gap = max(1, wide - len(first) - len(last))
    yield Text(clip(f"  {'t':<14}  {first}{' ' * gap}{last if steps > 1 else ''}"), style="dim")


def _plain(_: Summary, lines: Iterable[str]) -> Iterator[Text]:
    return map(Text, lines)


def _dim(_: Summary, lines: Iterable[str]) -> Iterator[Text]:
    return (Text(line, style="dim") for line in lines)


def _headline(result: Summary, lines: list[str]) -> Iterator[Text]:
    *claim, sizes = lines
    style = "bold green" if result.certified else "bold yellow"
    yield from (Text(line, style=style) for line in claim)
    yield Text(sizes)


def _worst(result: Summary, _: list[str]) -> Iterator[Text]:
    """With costs and counts of the steps, for which the plain table has no room."""
    yield from map(Text, _worst_steps(result))
    yield from map(Text, map(visible, worst(result, ("truth", "estimates"))))


def _worst_steps(result: Summary) -> Iterator[str]:
    table, counts = result.table("per_step"), result.proof.breakdown
    costliest = sorted(range(len(table["t"])), key=lambda k: (-table["total"][k], k))[:SHOWN]
    costliest = [k for k in costliest if table["total"][k] > 0]
    if not costliest:
        return
    times = fitting([table["t"][k] for k in costliest], 28, lambda: table["t"])
    wide = max(12, *map(len, times))
    name = max(12, min(17, 40 - wide))
    rows = []
    for k, time in zip(costliest, times, strict=True):
        found = (counts.missed_count[k], counts.false_count[k], counts.switch_count[k])
        cost = number(table["total"][k], 5)
        rows.append(("", time, cost, *(number(count, 4) for count in found)))
    head = ("worst steps", "t", "cost", "missed", "false", "switches")
    yield from map(clip, text_lines(Table(head=head, rows=rows, widths=(name, wide, 11, 9, 8, 10))))
    yield ""


def _parts(result: Summary, lines: list[str]) -> Iterator[Text]:
    for line in lines:
        text = Text(line)
        name = line.split()[0]
        if name in PART_STYLES:
            text.stylize(PART_STYLES[name], 2, 2 + len(name))
            if getattr(result, name) == 0:
                text.stylize("dim")
        elif name == "total":
            text.stylize("bold")
        yield text


STYLED: dict[str, Callable[[Summary, list[str]], Iterator[Text]]] = {
    "headline": _headline,
    "meaning": _dim,
    "parts": _parts,
    "worst": _worst,
    "footer": _dim,
}
"""Blocks of the plain table that look otherwise here; all others are shown as they are."""


def _can(text: str, encoding: str) -> bool:
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True
