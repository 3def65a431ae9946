"""The table with colours, cost over time and worst steps, for a terminal of 80 columns (rich).

The user's words are never read as markup. Where the terminal cannot show the blocks of a sparkline
ASCII signs stand in.
"""

import io
from collections.abc import Iterator
from functools import partial

import numpy as np
from rich.console import Console
from rich.text import Text

from tgospa_eval.common.words import number
from tgospa_eval.reports.console import SHOWN, blocks, worst
from tgospa_eval.reports.tables import WIDTH, Table, clip, text_lines
from tgospa_eval.results.numbers import costliest
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
        shown.append(_styled(result, name, lines))
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


def _styled(result: Summary, name: str, lines: list[str]) -> list[Text]:
    """The lines of a block with its looks; most are shown as they are."""
    if name == "headline":
        *claim, sizes = lines
        style = "bold green" if result.certified else "bold yellow"
        return [*(Text(line, style=style) for line in claim), Text(sizes)]
    if name == "parts":
        return list(map(partial(_part, result), lines))
    if name == "worst":  # with costs and counts of the steps, for which the plain table has no room
        others = map(visible, worst(result, ("truth", "estimates")))
        return [*map(Text, _worst_steps(result)), *map(Text, others)]
    return [Text(line, style="dim" if name in ("meaning", "footer") else "") for line in lines]


def _worst_steps(result: Summary) -> Iterator[str]:
    table, counts = result.table("per_step"), result.proof.breakdown
    chosen = costliest(list(range(len(table["t"]))), np.array(table["total"]), SHOWN)
    if not chosen:
        return
    parts = counts.missed_count, counts.false_count, counts.switch_count
    rows = [
        (str(table["t"][k]), number(table["total"][k], 5), *(number(part[k], 4) for part in parts))
        for k in chosen
    ]
    head = (f"{'worst steps':<17}{'t':>12}", "cost", "missed", "false", "switches")
    yield from map(clip, text_lines(Table(head=head, rows=rows, align="r" * 5)))
    yield ""


def _part(result: Summary, line: str) -> Text:
    text = Text(line)
    name = line.split()[0]
    if name in PART_STYLES:
        text.stylize(PART_STYLES[name], 2, 2 + len(name))
        if getattr(result, name) == 0:
            text.stylize("dim")
    elif name == "total":
        text.stylize("bold")
    return text


def _can(text: str, encoding: str) -> bool:
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True
