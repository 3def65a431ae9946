"""Columns that each object has of its own: headers by pattern, ``x=x{id},y=y{id}``."""

import re
from collections.abc import Mapping, Sequence

ID_MARK = "{id}"
"""Id of an object in its headers."""

PLACES = (("x", "y"), ("X", "Y"))


def objects_in(names: Sequence[str], mapped: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """Columns of each object that has all, by what they are; none if no header fits a pattern."""
    patterns = {name: header for name, header in mapped.items() if ID_MARK in header}
    objects: dict[str, dict[str, int]] = {}
    for name, pattern in patterns.items():
        before, _, after = pattern.partition(ID_MARK)
        fits = re.compile(f"{re.escape(before)}(.+){re.escape(after)}", re.IGNORECASE)
        for column, header in enumerate(names):
            if match := fits.fullmatch(header):
                objects.setdefault(match[1], {}).setdefault(name, column)
    return {key: columns for key, columns in objects.items() if len(columns) == len(patterns)}


def shared_columns(names: Sequence[str], objects: Mapping[str, Mapping[str, int]]) -> list[int]:
    """Columns of no object, but for those whose names are of the columns of objects."""
    used = {k for columns in objects.values() for k in columns.values()}
    taken = {"id", *next(iter(objects.values()))}
    return [k for k, name in enumerate(names) if k not in used and name not in taken]


def pattern_in(names: Sequence[str]) -> list[str]:
    """Items of columns by pattern, if these headers may be pairs of several objects; or none."""
    for one, two in PLACES:
        first = [name for name in names if one in name and name.replace(one, two) in names]
        before = _common(first)
        after = _common([name[len(before) :][::-1] for name in first])[::-1]
        pattern = f"{before}{ID_MARK}{after}"
        is_whole = all(len(name) > len(before + after) for name in first)
        if len(first) > 1 and is_whole and one in before + after:
            return [f"x={pattern}", f"y={pattern.replace(one, two)}"]
    return []


def _common(texts: Sequence[str]) -> str:
    """What all texts begin with."""
    least, most = min(texts, default=""), max(texts, default="")
    pairs = enumerate(zip(least, most, strict=False))
    end = next((k for k, (a, b) in pairs if a != b), min(len(least), len(most)))
    return least[:end]
