"""What was read, as a table of 80 columns or as JSON."""

import math
from collections.abc import Iterator

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, in_both, number, plain, shortest
from tgospa_eval.distances import DISTANCES
from tgospa_eval.results.records import Json, Time
from tgospa_eval.show.rendering import WIDTH, Table, clip, text_lines, wrap
from tgospa_eval.text import ending, option

Extent = dict[str, float]
"""From where to where, as min and max; with a median too."""

Row = tuple[str, list[str]]


NAME_WIDTH = 18
"""Width of the first column."""

CELL = 28
"""Least width of the columns of the files; two of them and a gap of 2 fit in a line."""


def table(document: Json) -> str:
    """The document in words, for someone who sees it for the first time."""
    files = [document["truth"], *([document["estimate"]] if "estimate" in document else [])]
    blocks = [_columns(list(_files(files)))]
    if "both" in document:
        warned = any(warning["code"] == "clock-shift" for warning in document["warnings"])
        blocks.append(list(_both(document["both"], document["parameters"], warned=warned)))
    lines = [(file["path"], text) for file in files for text in file["notices"]]
    blocks.append([line for path, text in lines for line in wrap(f"{path}: {text}")])
    warnings = (str(Notice(**record)) for record in document["warnings"])
    blocks.append([line for text in warnings for line in wrap(text)])
    return "\n\n".join("\n".join(map(clip, block)) for block in blocks if block) + "\n"


def _columns(rows: list[Row]) -> list[str]:
    """Rows as lines: a cell that is too wide for its column goes on below."""
    count = len(rows[0][1])
    room = WIDTH - NAME_WIDTH - 1 - 2 * (count - 1)
    widths = [max(CELL, *(len(cells[k]) for _, cells in rows)) for k in range(count)]
    if sum(widths) > room:
        widths = [room] if count == 1 else [CELL] * count
    head, *lines = [(clip(name, NAME_WIDTH), *cells) for name, cells in rows]
    wide = (NAME_WIDTH + 1, *(width + 2 for width in widths))
    table = Table(head=head, rows=lines, align="l" * len(wide), widths=wide, wrapped=(1, 2))
    return text_lines(table, "")


def _files(files: list[Json]) -> Iterator[Row]:
    """A row for each property, a cell for each file."""
    yield "", ["truth", "estimate"][: len(files)]
    yield "file", [ending(file["path"], CELL) for file in files]
    yield "format", [file["format"] for file in files]
    if any(file["headers"] for file in files):
        named = [(f"{k}={clip(v, CELL)}" for k, v in file["headers"].items()) for file in files]
        yield "headers", [", ".join(names) or "-" for names in named]
    yield "rows", [f"{file['rows']:,}" for file in files]
    reasons = {  # where the JSON's word for it is not enough
        "blank": "no position",
        "duplicate": "repeated",
        "time": f"outside {option('time')}",
        "class": f"not in {option('class_')}",
        "region": f"outside {option('region')}",
    }
    for rule in dict.fromkeys(rule for file in files for rule in file["left_out"]):
        counts = [f"{file['left_out'].get(rule, 0):,}" for file in files]
        yield f"  {reasons.get(rule, rule)}", counts
    yield "trajectories", [f"{file['trajectories']:,}" for file in files]
    yield "  length", [_range(file["length"], "row", "rows") for file in files]
    yield "  with holes", [_holes(file["holes"]) for file in files]
    yield "steps", [f"{file['steps']:,}" for file in files]
    yield "  objects at", [_range(file["objects"]) for file in files]
    if any("particles" in file for file in files):
        one = {"min": 1.0, "median": 1.0, "max": 1.0}
        yield "  particles", [_range(file.get("particles", one)) for file in files]
    yield "  first t", [_moment(file["time"]["first"]) for file in files]
    yield "  last t", [_moment(file["time"]["last"]) for file in files]
    second = "s" if any(file["time"]["kind"] != "number" for file in files) else ""
    yield "  t to next t", [_steps(file["time"], second) for file in files]
    for column in files[0]["columns"]:
        yield column, [_interval(file["extent"].get(column)) for file in files]
        if any("deviation" in file for file in files):
            deviations = [file.get("deviation", {}).get(column) for file in files]
            yield "  std", [_range(spread, digits=3) for spread in deviations]
    for name in dict.fromkeys(name for file in files for name in file["classes"]):
        yield f"class {name}", [_class(file["classes"].get(name)) for file in files]


def _class(part: dict[str, int] | None) -> str:
    if part is None:
        return "none"
    tracks = counted(part["trajectories"], "trajectory", "trajectories")
    return f"{counted(part['rows'], 'row')}, {tracks}"


def _holes(holes: dict[str, int]) -> str:
    if not holes["trajectories"]:
        return "none"
    return f"{holes['trajectories']}, {counted(holes['steps'], 'step')}, longest {holes['longest']}"


def _both(both: Json, parameters: dict[str, object], *, warned: bool) -> Iterator[str]:
    """How the files fit; `warned` is whether a warning has the other clock."""
    steps = both["steps"]
    yield in_both(steps["common"], steps["union"]) + (
        f", {steps['joined']} of them joined" if steps["joined"] else ""
    )
    for side, rows in both["left_out"].items():
        if rows:
            yield (
                f"{counted(rows, 'row')} of the {side} left out "
                f"({option('grid', parameters['grid'])})"
            )
    yield from wrap(_stretch(both["time"]))
    if both["clock"] is not None and not warned:
        yield from wrap(f"  {_clock(both['clock'])}")
    for column, extent in both["extent"].items():
        yield f"  {clip(column, NAME_WIDTH):<{NAME_WIDTH}}" + (
            f"{_interval(extent)} in both" if extent else "the ranges do not overlap"
        )
    nearest = both["nearest"]
    if nearest is None:
        yield "no step has both a truth and an estimate: no distances"
        return
    distance = DISTANCES.get(str(parameters["distance"]))
    unit = parameters["unit"] or ("m" if distance is not None and distance.on_earth else "")
    truths = counted(nearest["truths"], "truth")
    yield ""
    yield f"distance from a truth to the nearest estimate of its step, {truths}"
    quantiles = nearest["quantiles"]
    head = ("share of truths", *(f"{q} %" for q in quantiles))
    row = ("distance up to", *map(_number, quantiles.values()))
    yield from text_lines(Table(head=head, rows=[row], widths=(15, *[11] * len(quantiles))))
    share = 100 * nearest["within_cutoff"]
    cutoff = f"{nearest['cutoff']:g} {unit}".strip()
    yield f"  nearer than the cutoff c = {cutoff}: {share:.1f} %"
    if nearest["suggested"] is not None:
        value = f"{nearest['suggested']['cutoff']:g} {unit}".strip()
        text = f"  cutoff to begin with, c = {value}: {nearest['suggested']['reason']}"
        yield from wrap(text)


def _stretch(time: Json | None) -> str:
    """The time that both files cover."""
    if time is None:
        return "no stretch of time is in both files"
    if time["steps"] == 1:
        return f"both have rows at t = {_moment(time['first'])} only"
    ends = f"{_moment(time['first'])} to {_moment(time['last'])}"
    return f"both have rows from t = {ends}, {counted(time['steps'], 'step')}"


def _clock(clock: Json) -> str:
    """The stamps of the estimate that fit better."""
    values = {name: clock[name] for name in ("time_scale", "time_offset")}
    settings = " ".join(
        option(name, plain(value))
        for (name, value), neutral in zip(values.items(), (1, 0), strict=True)
        if value != neutral
    )
    return (
        f"the stamps of the estimate fit better with {settings} (+/- {clock['uncertainty']:g}): "
        f"{100 * clock['saving']:.0f} % of the cost of {counted(clock['steps'], 'step')} goes away"
    )


def _range(spread: Extent | None, one: str = "", many: str = "", digits: int = 6) -> str:
    """Smallest to largest, and the median between them, with a noun or unit."""
    if spread is None:
        return "-"
    low, middle, high = (_number(spread[key], digits) for key in ("min", "median", "max"))
    text = low if low == high else f"{low} to {high}, median {middle}"
    return f"{text} {one if text == '1' else many}".strip()


def _steps(time: Json, unit: str) -> str:
    """From how long to how long a step takes, without what rounding the stamps adds to it."""
    ends = [t for t in (time["first"], time["last"]) if isinstance(t, float)]
    noise = 2 * math.ulp(max(map(abs, ends), default=0.0))
    spread = time["step"]
    return _range(spread and {k: shortest(v, noise) for k, v in spread.items()}, unit, unit)


def _interval(extent: Extent | None) -> str:
    """From where to where, with digits enough for the ends to differ."""
    if extent is None:
        return "-"
    low, high = extent["min"], extent["max"]
    size, wide = max(abs(low), abs(high)), high - low
    digits = 6 if low < high else 9
    if 0 < wide < size and wide / size > 0:
        digits = min(max(6, 4 - math.floor(math.log10(wide / size))), 15)
    ends = _number(low, digits), _number(high, digits)
    return ends[0] if low == high else " to ".join(ends)


def _number(value: float | None, digits: int = 6) -> str:
    return "-" if value is None else number(value, digits)


def _moment(value: Time | None) -> str:
    """A time as read, without the last digits of sums of decimals: 5.8, not 5.800000000000001."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    exact, short = repr(value), f"{value:.14g}"
    return short if len(short) < len(exact) - 3 else exact
