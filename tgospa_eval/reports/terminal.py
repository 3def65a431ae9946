"""The table with colours, cost over time and worst steps, for a terminal of 80 columns.

Where the terminal cannot show the blocks of a sparkline ASCII signs stand in.
"""

import os
from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.words import number
from tgospa_eval.reports.console import SHOWN, blocks, worst
from tgospa_eval.reports.tables import Table, clip, text_lines
from tgospa_eval.results.numbers import costliest
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import visible

BLOCKS = " ▁▂▃▄▅▆▇█"
SIGNS = " .:-=+*#@"
GRAPH = 62
GRAPH_BEFORE = "scale"
"""The block above which the cost over time is drawn."""

BOLD, DIM, GREEN, YELLOW = "1", "2", "32", "33"
PART_LOOKS = {"localisation": "34", "missed": "31", "false": "35", "switch": YELLOW}
"""Codes of colours and weights (SGR)."""


def report(result: Summary, encoding: str) -> str:
    """The text with colours, unless `NO_COLOR` is set; `encoding` is that of stdout."""
    ramp = BLOCKS if encoding.casefold().startswith("utf") else SIGNS
    shown: list[list[str]] = []
    for name, lines in blocks(result).items():
        if name == GRAPH_BEFORE:
            shown.append(list(_graph(result, ramp)))
        shown.append(_styled(result, name, lines))
    return "\n\n".join("\n".join(lines) for lines in shown if lines) + "\n"


def _looking(text: str, *codes: str) -> str:
    if not text or not codes or os.environ.get("NO_COLOR"):
        return text
    return f"\x1b[{';'.join(codes)}m{text}\x1b[0m"


def sparkline(values: list[float], high: float, ramp: str = BLOCKS, width: int = GRAPH) -> str:
    """The values as heights from 0 to `high`; what is not 0 is never shown as nothing.

    Where there are more values than `width` each sign stands for the largest of several.
    """
    together = max(1, -(-len(values) // width))
    tops = [max(values[k : k + together]) for k in range(0, len(values), together)]
    most = len(ramp) - 1
    levels = (0 if top <= 0 else max(1, round(top / high * most)) for top in tops)
    return "".join(ramp[level] for level in levels)


def _graph(result: Summary, ramp: str) -> Iterator[str]:
    """A row for the whole cost and each part, all to one scale, over the times."""
    table = result.table("per_step")
    high = max(table["total"], default=0.0)
    if not high > 0:
        return
    steps = len(table["t"])
    together = max(1, -(-steps // GRAPH))
    each = f", each sign the largest of {together}" if together > 1 else ""
    yield f"  cost of each step, to {number(high)}{each}"
    for name in ("total", *PARTS):
        if any(table[name]):
            graph = sparkline(table[name], high, ramp)
            yield f"  {name:<14}  {_looking(graph, PART_LOOKS.get(name, BOLD))}"
    first, last = str(table["t"][0]), str(table["t"][-1])
    wide = -(-steps // together)
    gap = max(1, wide - len(first) - len(last))
    yield _looking(clip(f"  {'t':<14}  {first}{' ' * gap}{last if steps > 1 else ''}"), DIM)


def _styled(result: Summary, name: str, lines: list[str]) -> list[str]:
    """The lines of a block with its looks; most are shown as they are."""
    if name == "headline":
        *claim, sizes = lines
        colour = GREEN if result.certified else YELLOW
        return [*(_looking(line, BOLD, colour) for line in claim), sizes]
    if name == "parts":
        return [_part(result, line) for line in lines]
    if name == "worst":  # with costs and counts of the steps, for which the plain table has no room
        return [*_worst_steps(result), *map(visible, worst(result, ("truth", "estimates")))]
    return [_looking(line, DIM) for line in lines] if name in ("meaning", "footer") else lines


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


def _part(result: Summary, line: str) -> str:
    name = line.split()[0]
    if name not in PART_LOOKS:
        return _looking(line, BOLD) if name == "total" else line
    weight = () if getattr(result, name) else (DIM,)
    before, after = line.split(name, 1)
    return before + _looking(name, *weight, PART_LOOKS[name]) + _looking(after, *weight)
