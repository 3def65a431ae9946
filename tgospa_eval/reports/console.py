"""The table for a terminal: 80 columns, no colour, plain ASCII but for the user's own words."""

import math
import textwrap
from collections.abc import Iterator
from typing import Any

from tgospa_eval.evaluation import Summary

WIDTH = 80
SHOWN = 5
PARTS = ("localisation", "missed", "false", "switch")


def table(result: Summary) -> str:
    """The result in words, for someone who sees it for the first time."""
    blocks = (
        _headline(result),
        _meaning(result),
        _parts(result),
        _classes(result),
        _scale(result),
        _worst(result),
        _switches(result),
        _footer(result),
    )
    return "\n\n".join("\n".join(block) for block in map(list, blocks) if block) + "\n"


def headline(result: Summary) -> str:
    """The value and what is known about it, in one sentence."""
    value = quantity(result, result.tgospa)
    if result.certified:
        # No more than 12 digits, for the last ones are rounding and differ from machine to machine.
        digits = math.floor(-math.log10(max(result.relative_gap, 1e-12)) + 1e-9)
        agree = f"to {digits} digits" if digits >= 1 else "within rounding"
        return f"TGOSPA = {value}, exact: proven lower and upper bound agree {agree}"
    low = quantity(result, result.lower_bound)
    return (
        f"TGOSPA is between {low} and {value}, proven "
        f"(the totals differ by {100 * result.relative_gap:.2g}%)"
    )


def quantity(result: Summary, value: float) -> str:
    """A value with the unit of the states."""
    return f"{value:.6g}" + (f" {result.labels.unit}" if result.labels.unit else "")


def _headline(result: Summary) -> Iterator[str]:
    yield from _wrap(headline(result), "")
    sizes = result.sizes
    yield (
        f"{_count(sizes['truth'], 'truth')}, {_count(sizes['estimates'], 'estimate')}, "
        f"{_count(sizes['steps'], 'step')}"
    )


def _meaning(result: Summary) -> Iterator[str]:
    parameters = result.proof.parameters
    p = parameters.order
    miss, price = result.scale / 2, _power(parameters.switch_penalty, p)
    cutoff = quantity(result, parameters.cutoff)
    gamma = quantity(result, parameters.switch_penalty)
    yield from _wrap(
        f"  c     = {cutoff}, cutoff: no error counts more; a missed or a false target "
        f"costs c^p/2 = {miss:.6g}"
    )
    yield from _wrap(
        f"  p     = {p:g}, order: costs are errors to the power p, TGOSPA is the p-th root "
        "of their total"
    )
    yield from _wrap(
        f"  gamma = {gamma}, switch penalty: changing to another track costs "
        f"gamma^p = {price}, to or from none half of it"
    )


def _power(value: float, order: float) -> str:
    try:
        return f"{float(value**order):.6g}"
    except OverflowError:
        return "more than 1e308"


def _wrap(text: str, indent: str = " " * 10) -> list[str]:
    return textwrap.wrap(text, WIDTH, subsequent_indent=indent)


def _parts(result: Summary) -> Iterator[str]:
    notes = {
        "localisation": "",
        "missed": "object-steps without estimate",
        "false": "estimate-steps without object",
        "switch": "track switches",
    }
    total = result.total
    yield f"  {'part':<14}{'cost':>12}{'share':>9}{'count':>10}"
    for name in PARTS:
        cost = getattr(result, name)
        count = f"{result.counts[name]:.6g}" if name in result.counts else ""
        share = _share(cost, total)
        yield f"  {name:<14}{cost:>12.6g}{share:>9}{count:>10}  {notes[name]}".rstrip()
        if name == "localisation" and result.split is not None:
            for part, half in zip(("means", "spread"), result.split, strict=True):
                yield f"    {part:<12}{half:>12.6g}{_share(half, total):>9}"
    yield f"  {'total':<14}{total:>12.6g}{_share(total, total):>9}{'':>10}  = TGOSPA^p".rstrip()


def _classes(result: Summary) -> Iterator[str]:
    classes = result.per_class_table()
    if not classes:
        return
    names = ("TGOSPA", "total", "local.", "missed", "false", "switch")
    yield f"  {'class':<15}" + "".join(f"{name:>10}" for name in names)
    for name, *values in zip(*classes.values(), strict=True):
        numbers = "".join(f"{value:>10.5g}" for value in values)
        yield f"  {clip(name or '(blank)')[:14]:<15}{numbers}"


def _scale(result: Summary) -> Iterator[str]:
    objects = max(result.objects)
    if not objects:
        return
    order = result.proof.parameters.order
    typical = (result.total / objects) ** (1 / order)
    per_step = quantity(result, result.normalised["tgospa"])
    yield f"  per step             {per_step}  (total / steps)^(1/p)"
    yield f"  per object and step  {quantity(result, typical)}  a typical error, misses included"


def _worst(result: Summary) -> Iterator[str]:
    worst = result.worst(SHOWN)
    names = {"steps": "worst steps", "truth": "worst truths", "estimates": "worst estimates"}
    for key, name in names.items():
        if worst[key]:
            yield clip(f"  {name:<17}{'  '.join(map(str, worst[key]))}")


def _switches(result: Summary) -> Iterator[str]:
    switches = result.switches_table()
    count = len(switches["t"])
    if not count:
        return
    yield f"  switches{'':<9}{'t':>10}  truth: from -> to"
    for k in range(min(count, SHOWN)):
        before, after = (_name(switches[key][k]) for key in ("from", "to"))
        half = "" if switches["mass"][k] == 1 else f"  ({switches['mass'][k]:.3g} of a switch)"
        moment, truth = switches["t"][k], switches["truth"][k]
        yield clip(f"  {'':<17}{moment!s:>10}  {truth}: {before} -> {after}{half}")
    if count > SHOWN:
        yield f"  {'':<17}{'':>10}  and {count - SHOWN} more (--format json, or -o DIR)"


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
    """The line, cut to a width, with control characters escaped."""
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)
    return line if len(line) <= width else line[: width - 3] + "..."


def _name(value: Any) -> str:
    return "none" if value is None else str(value)


def _share(part: float, total: float) -> str:
    return f"{100 * part / total:.1f} %" if total > 0 else "-"


def _count(number: int, word: str) -> str:
    return f"{number} {word}" + ("" if number == 1 else "s")
