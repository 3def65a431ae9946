"""A sweep of a parameter as a table. Computes nothing that is not in it."""

from collections.abc import Iterator

from tgospa_eval.common.words import number, sizes_in_words
from tgospa_eval.results.records import COUNTED_PARTS
from tgospa_eval.results.sweep import Point, Sweep
from tgospa_eval.show.phrases import LETTERS, parameters_of
from tgospa_eval.show.rendering import Document, table_of


def sweep_document(found: Sweep) -> Document:
    """A row for each value."""
    points = found.points
    columns = {LETTERS[found.parameter]: [number(point.value) for point in points]}
    if not found.certified:
        columns["lower bound"] = [number(point.lower_bound) for point in points]
    columns["TGOSPA"] = [number(point.tgospa) for point in points]
    columns["localisation"] = [number(point.localisation, 5) for point in points]
    for part in COUNTED_PARTS:
        columns[part] = [
            f"{number(getattr(point, part), 5)} ({number(_count(point, part))})" for point in points
        ]
    return Document(
        title=_title(found),
        lines=[
            f"{parameters_of(found.settings, '; ')}; {sizes_in_words(found.sizes)}",
            "costs, and in brackets how many of each:",
        ],
        tables=[table_of(columns)],
        notes=list(_notes(found)),
        warnings=found.told,
    )


def _count(point: Point, part: str) -> float:
    count: float = getattr(point, f"{part}_count")
    return count


def _title(found: Sweep) -> str:
    points = found.points
    word, letter = found.parameter.replace("_", " "), LETTERS[found.parameter]
    first, last = (_quantity(found, k) for k in (0, -1))
    over = f"at {letter} = {first}"
    if len(points) > 1:
        over = f"at {len(points)} values of the {word} from {letter} = {first} to {last}"
    wide = [point for point in points if not point.certified]
    if not wide:
        return f"TGOSPA {over}, all proven exact"
    gap = max(point.relative_gap for point in wide)
    return (
        f"TGOSPA {over}: {len(points) - len(wide)} exact, {len(wide)} between proven bounds (the "
        f"totals differ by up to {number(100 * gap, 2)}%)"
    )


def _quantity(found: Sweep, k: int) -> str:
    """The value at a point, with its unit if it has one."""
    return number(found.points[k].value) + (f" {found.unit}" if found.unit else "")


def _notes(found: Sweep) -> Iterator[str]:
    """Where the counts do not depend on the parameter; of the best assignments only."""
    letter = LETTERS[found.parameter]
    if len(found.points) < 2 or not found.certified:
        return
    for names in (COUNTED_PARTS[:2], COUNTED_PARTS[2:]):
        words = " and ".join("switches" if name == "switch" else name for name in names)
        span = found.unchanged(*(f"{name}_count" for name in names))
        if span is None:
            yield f"{words}: the counts differ between all neighbouring values"
            continue
        counts = " and ".join(number(_count(found.points[span[0]], name)) for name in names)
        low, high = (_quantity(found, k) for k in span)
        many = span[1] - span[0] + 1
        yield f"{words}: {counts} at all {many} values from {letter} = {low} to {high}"
