"""Messages about headers that a table lacks."""

from collections.abc import Sequence

from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.asked import PREFIXES, ask
from tgospa_eval.formats.columns.headers import Headers, Mix
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.text import listed, quoted

DETECTIONS = "rows without ids are detections, and TGOSPA compares tracks"


def without_maps(headers: Headers, options: ReadOptions) -> dict[str, str]:
    """Take back what is mapped to headers that another file may have; the message if none has.

    Raises
    ------
    InputError
        A header is missing that this very file should have.
    """
    lacking = {}
    spreads = [name for name in headers.mapped if name.startswith(PREFIXES)]
    points = all(headers.spelt(headers.mapped[name], name) is None for name in spreads)
    for name, header in list(headers.mapped.items()):
        if headers.spelt(header, name) is None:
            near = headers.nearest(header)
            mend = {f"{name}={header}": name if near == name else f"{name}={near or 'HEADER'}"}
            given = ("=".join(map(str.strip, item.split("=", 1))) for item in options.columns or ())
            remedy = ask(headers.option, [mend.get(item, item) for item in given])
            remedy = f"name one of these, {remedy}" if near is None else f"did you mean {remedy}?"
            fault = (
                f"{headers.where}: no header {quoted(header)} for {name} "
                f"(found: {headers.shown}); {remedy}"
            )
            if name not in options.shared and not (points and name in spreads):
                raise InputError(fault)
            lacking[name] = fault
            del headers.mapped[name]
    return lacking


def absent(
    headers: Headers,
    needed: tuple[int | None, int | None],
    states: dict[str, Mix | None],
    sample: Sequence[str],
) -> str:
    """The message about columns that are missing, with what to type."""
    missing = [name for name, found in zip(("id", "t"), needed, strict=True) if found is None]
    missing += [name for name, mix in states.items() if mix is None] if states else ["position"]
    lost = f"{headers.where}: no column for {listed(missing)} (found: {headers.shown})"
    used = {k for k in needed if k is not None}
    used |= {k for mix in states.values() for k, _ in mix or ()}
    parts = headers.stamp(headers.names) if "t" in missing else ""
    if parts:
        return f"{lost}; {parts}"
    items = headers.guess(missing, used, sample)
    if not items:
        remedy = ask(headers.option, [f"{missing[0]}=HEADER"])
        why = f"; {DETECTIONS}" if missing[0] == "id" else ""
        return f"{lost}; rename one, or map it with {remedy}{why}"
    named = {item.partition("=")[0] for item in items}
    rest = [name for name in missing if name not in named and name != "position"]
    # What the user has mapped stays so, and so does the choice of states.
    items += [f"{name}={header}" for name, header in headers.mapped.items() if name not in named]
    if named & set(states):
        items += [name for name in states if name not in {*named, *headers.mapped, *rest}]
    also = f"; {', '.join(rest)} must be added" if rest else ""
    also += f": {DETECTIONS}" if "id" in rest else ""
    return f"{lost}; try {ask(headers.option, items)}{also}"


def no_class(headers: Headers, options: ReadOptions, *, fixed: bool) -> str:
    """The message where there are no classes."""
    option = "--class" if options.classes is not None else options.class_for
    remedy = f"add it, or map it with {ask(headers.option, ['class=HEADER'])}"
    return (
        f"{headers.where}: no column class for {option} (found: {headers.shown}); "
        f"{'rows of this length have none' if fixed else remedy}"
    )
