"""The table for a terminal: 80 columns, no colour, plain ASCII but for the user's own words."""

import textwrap
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from tgospa_eval.common.figures import number
from tgospa_eval.common.words import counted
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import clipped, visible

WIDTH = 80
SHOWN = 5
COUNTED = {
    "missed": ("object-step without estimate", "object-steps without estimate"),
    "false": ("estimate-step without object", "estimate-steps without object"),
    "switch": ("track switch", "track switches"),
}
"""What the counts of parts count: one, and any other number of them."""


def table(result: Summary) -> str:
    """The result in words, for someone who sees it for the first time."""
    shown = ("\n".join(lines) for lines in blocks(result).values() if lines)
    return "\n\n".join(shown) + "\n"


def blocks(result: Summary) -> dict[str, list[str]]:
    """The lines of each block by name, none where it does not apply."""
    makers = {
        "headline": _headline,
        "meaning": _meaning,
        "parts": _parts,
        "classes": _classes,
        "scale": _scale,
        "worst": worst,
        "switches": _switches,
        "curve": _curve,
        "footer": _footer,
    }
    return {name: list(map(visible, make(result))) for name, make in makers.items()}


def headline(result: Summary) -> str:
    """The value and what is known about it, in one sentence."""
    return f"{result.claim}, {result.proven}"


def _headline(result: Summary) -> Iterator[str]:
    yield from _wrap(headline(result), "")
    sizes = result.sizes
    yield (
        f"{counted(sizes['truth'], 'truth')}, {counted(sizes['estimates'], 'estimate')}, "
        f"{counted(sizes['steps'], 'step')}"
    )


def meaning(result: Summary) -> list[tuple[str, str]]:
    """The parameters by name, each in words."""
    parameters = result.proof.parameters
    p = parameters.order
    miss, price = result.scale / 2, _power(parameters.switch_penalty, p)
    cutoff = result.quantity(parameters.cutoff)
    gamma = result.quantity(parameters.switch_penalty)
    return [
        (
            "c",
            f"{cutoff}, cutoff: no error counts more; a missed or a false target "
            f"costs c^p/2 = {number(miss)}",
        ),
        (
            "p",
            f"{p:g}, order: costs are errors to the power p, TGOSPA is the p-th root "
            "of their total",
        ),
        (
            "gamma",
            f"{gamma}, switch penalty: changing to another track costs "
            f"gamma^p = {price}, to or from none half of it",
        ),
    ]


def _meaning(result: Summary) -> Iterator[str]:
    for name, words in meaning(result):
        yield from _wrap(f"  {name:<5} = {words}")


def _power(value: float, order: float) -> str:
    try:
        return number(float(value**order))
    except OverflowError:
        return "more than 1e308"


def _wrap(text: str, indent: str = " " * 10) -> list[str]:
    return textwrap.wrap(visible(text), WIDTH, subsequent_indent=indent)


def _parts(result: Summary) -> Iterator[str]:
    total = result.total
    yield f"  {'part':<14}{'cost':>12}{'share':>9}{'count':>10}"
    for name in PARTS:
        cost = getattr(result, name)
        count = number(result.counts[name]) if name in result.counts else ""
        share = result.share(cost)
        note = COUNTED[name][count != "1"] if name in COUNTED else ""
        yield f"  {name:<14}{number(cost):>12}{share:>9}{count:>10}  {note}".rstrip()
        if name == "localisation" and result.split is not None:
            for part, half in zip(("means", "spread"), result.split, strict=True):
                yield f"    {part:<12}{number(half):>12}{result.share(half):>9}"
    of = "= TGOSPA^p" if result.certified else "= upper bound^p: another may cost less"
    yield f"  {'total':<14}{number(total):>12}{result.share(total):>9}{'':>10}  {of}"


def _classes(result: Summary) -> Iterator[str]:
    classes = result.per_class_table()
    if not classes:
        return
    names = ("TGOSPA", "total", "local.", "missed", "false", "switch")
    yield f"  {'class':<15}" + "".join(f"{name:>10}" for name in names)
    for name, *values in zip(*classes.values(), strict=True):
        numbers = "".join(f"{number(value, 5):>10}" for value in values)
        yield f"  {clip(name or '(blank)')[:14]:<15}{numbers}"


def _scale(result: Summary) -> Iterator[str]:
    objects = max(result.objects)
    if not objects:
        return
    order = result.proof.parameters.order
    typical = (result.total / objects) ** (1 / order)
    per_step = result.quantity(result.normalised["tgospa"])
    yield f"  per step             {per_step}  (total / steps)^(1/p)"
    yield f"  per object and step  {result.quantity(typical)}  a typical error, misses included"


def _curve(result: Summary) -> Iterator[str]:
    """The normalised curve at a few steps, the last one included."""
    table, traced = result.curve_table(), result.traced
    if traced is None or not table["t"]:
        return
    met, size = traced.met(result.gap), len(table["t"])
    known = "all proven exact" if met.all() else f"{np.count_nonzero(~met)} of them upper bounds"
    yield from _wrap(
        f"TGOSPA per step of the steps up to each of {size}, {known}; its parts are costs per step"
    )
    count = min(size, 2 * SHOWN)
    shown = np.unique(np.linspace(0, size - 1, count).round().astype(int)).tolist()
    times = fitting([table["t"][k] for k in shown], 19)
    first = max(13, *map(len, times))
    each = 13 if first == 13 else 11  # so that long stamps have their place
    widths = (first, 13, 13, each, each, each)
    yield "  " + _row(("up to t", "TGOSPA", *PARTS), widths)
    for k, time in zip(shown, times, strict=True):
        value = ("" if met[k] else "<= ") + number(table["tgospa"][k], 5)
        yield "  " + _row((time, value, *(number(table[name][k], 5) for name in PARTS)), widths)


def _row(cells: Iterable[str], widths: Iterable[int]) -> str:
    return "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))


def fitting(texts: Iterable[Any], width: int) -> list[str]:
    """Stamps in so many columns, as far as they all begin alike: that gives way to dots."""
    shown = [visible(str(text)) for text in texts]
    cut = max(map(len, shown), default=0) - width + 3
    if cut <= 3 or len({text[:cut] for text in shown}) > 1:
        return shown
    return [f"...{text[cut:]}" for text in shown]


WORST = {"steps": "worst steps", "truth": "worst truths", "estimates": "worst estimates"}


def worst(result: Summary, kinds: Iterable[str] = WORST) -> Iterator[str]:
    """The worst of each kind by name, on as many lines as they need."""
    found = result.worst(SHOWN)
    for kind in kinds:
        line = f"  {WORST[kind]:<15}"
        for name in found[kind]:
            cell = clip(str(name), WIDTH - 19)
            if len(line) > 17 and len(line) + 2 + len(cell) > WIDTH:
                yield line
                line = " " * 17
            line += f"  {cell}"
        if found[kind]:
            yield line


def _switches(result: Summary) -> Iterator[str]:
    switches = result.switches_table()
    count = len(switches["t"])
    if not count:
        return
    times = fitting(switches["t"][:SHOWN], 22)
    wide = max(10, *map(len, times))
    yield f"  switches{'':<9}{'t':>{wide}}  truth: from -> to"
    for k, time in enumerate(times):
        before, after = (_name(switches[key][k]) for key in ("from", "to"))
        mass = switches["mass"][k]
        half = "" if mass == 1 else f"  ({number(mass, 3)} of a switch)"
        move = f"{switches['truth'][k]}: {before} -> {after}{half}"
        yield clip(f"  {'':<17}{time:>{wide}}  {move}")
    if count > SHOWN:
        yield f"  {'':<17}{'':>{wide}}  and {count - SHOWN} more (--format json, or -o DIR)"


def _footer(result: Summary) -> Iterator[str]:
    solve = result.timings["solve"]
    spent = {
        "read": result.timings["read"],
        "distances": result.timings["distances"],
        "solve": sum(solve.values()),
        "certify": result.timings["certify"],
    }
    parts = "  ".join(f"{name} {seconds:.3f}" for name, seconds in spent.items())
    yield clip(f"  solver           {result.solver['name']}: {result.solver['status']}")
    yield clip(f"  seconds          {parts}")


def clip(line: str, width: int = WIDTH) -> str:
    """The line, visible and cut to a width."""
    return clipped(line, width)


def _name(value: Any) -> str:
    return "none" if value is None else str(value)
