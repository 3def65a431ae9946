"""Conversion of the rows of a file to Trajectories: filters, duplicates and order.

Here, (id, t) means the id and the time of a row. The key of a row is a number that stands for its
step and its track. Rows that are sorted by key are sorted by step, and within a step by track.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, places_of
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, more, plain
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import MISSING, Coded, attribute_of, is_rounded
from tgospa_eval.formats.headers import CORNERS, GROUP, ask, parse_columns
from tgospa_eval.formats.options import ROLES, ReadOptions, class_named, is_alike
from tgospa_eval.formats.reading import BOX, Reading, Regions, Shape
from tgospa_eval.formats.roles import FLAG, Roles
from tgospa_eval.formats.rows import AS_REGIONS, Rows, named_ids, spacings
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.conversion import scaled, scaled_spread
from tgospa_eval.tracks.coverage import IGNORED, MARKED
from tgospa_eval.tracks.trajectories import ROW, TimeArray, Trajectories, Values

if TYPE_CHECKING:
    from tgospa_eval.formats.particles import Particles
    from tgospa_eval.formats.spread import SpreadColumns


AIS_UNKNOWN = (91.0, 181.0)
"""Latitude and longitude that ships send while their position is unknown (ITU-R M.1371)."""


def rules_said() -> dict[str, str]:
    """Return, for each rule that leaves out rows, the end of the message about these rows."""
    return {
        "time": f"left out by {option('time')}",
        "blank": "with a blank or NaN position: absent at that step",
        "no place": "without a position (latitude 91, longitude 181, of AIS): absent at that step",
        "class": f"left out by {option('class_')}",
        "region": f"left out by {option('region')}",
        "invalid": f"left out by {option('on_invalid', 'drop')}",
    }


def no_classes() -> str:
    """Return the notice that a filter by class has no effect, as the file has no classes."""
    return f"no column class, so {option('class_')} leaves out none of its rows"


def centres_compared() -> str:
    """Return the notice that boxes are compared as points."""
    overlap = option("distance", "iou")
    return f"boxes are compared by their centres (x, y); {overlap} compares their overlap"


def assemble(rows: Rows, options: ReadOptions, format: str) -> Reading:
    """Build the trajectories of the rows that take part, and count left-out rows by rule.

    A row is counted under the first rule that leaves it out. Each time of the file within the range
    of time is a step, even if all its rows are left out.

    Raises
    ------
    InputError
        An (id, t) is repeated, or a state is invalid, and the options do not say what to do.
    """
    roles = rows.roles
    rows, halves = signed(rows)
    state = roles.mixed(rows.numbers, roles.state)
    factors = options.conversion.factors(roles.names)
    if factors is not None:
        state = scaled(state, factors, rows.name)
    choice = _Choice(len(state))
    choice.warnings += (*rows.warnings, *roles.doubts, *_about_corners(rows, options))
    choice.warnings += [notice for notice in halves if notice.code]
    choice.notices += [notice.text for notice in halves if not notice.code]
    # The range of time is applied first, as a file that is read in parts has only rows within it.
    timestamps, step, labels = _grid(rows, options, choice)
    for rule, (mask, sentence) in rows.excluded.items():
        if rule not in options.kept:
            choice.keep(~mask, rule, sentence)
    filled = (state == state).all(axis=1)  # False for NaN
    choice.keep(filled, "blank")
    if roles.names[:2] == ("lat", "lon"):
        choice.keep((state[:, :2] != AIS_UNKNOWN).any(axis=1), "no place")
    _keep_classes(rows, options, choice)
    for one in options.where:
        values = {name: _values(rows, roles.where[name]) for name in one.columns}
        choice.keep(one.inside(values, rows.where), "where", f"left out by {one.option}")
    track_ids, track = rows.ids
    if options.by_class and rows.classes is not None:
        rows = _ids_of_classes(rows, step, choice.mask)
        track_ids, track = rows.ids
    key = step.astype(np.int64) * max(len(track_ids), 1) + track
    flagged = list(_about_flags(rows, state, choice.mask))
    choice.warnings += [notice for notice in flagged if notice.code]
    choice.notices += [notice.text for notice in flagged if not notice.code]
    particles = None
    if roles.weight is not None:
        from tgospa_eval.formats.particles import gather  # lazy: most states are points

        particles = gather(rows, key, choice.mask, always=options.clouds and roles.spread is None)
    _keep_region(rows, options, particles, choice)
    droppable = format != "frame" and particles is None  # a cloud stays whole
    _check_states(rows, state, options, choice, droppable=droppable)
    chosen = None if choice.all() else np.flatnonzero(choice.mask)
    taken, ordered = _by_key(key, chosen)
    clouds = None
    if particles is not None:
        clouds, taken, ordered = particles.clouds(rows, state, taken, ordered)
        choice.notices += particles.notices(clouds, compared=options.clouds)
    else:
        drop = _repeats(rows, key, taken, ordered, options, format, choice)
        if drop is not None:
            taken, ordered = np.delete(taken, drop), np.delete(ordered, drop)
    choice.warnings += _about_ids(rows, taken, options)
    # Steps and tracks come from the sorted keys: taking them from the unsorted rows is slower.
    step, track = np.divmod(ordered, max(len(track_ids), 1))
    used, track = _renumbered(track, len(track_ids))
    covariance = None
    if roles.spread is not None and clouds is None:
        covariance = _covariances(rows, taken, roles.spread, options, choice)
        if factors is not None:
            covariance = scaled_spread(covariance, factors, rows.name)
    trajectories = Trajectories(
        step=step,
        track=track,
        state=state.take(taken, axis=0) if clouds is None else clouds.means,
        clouds=clouds,
        ids=track_ids[used],
        times=timestamps,
        columns=roles.names,
        clock=rows.times.clock,
        labels=labels,
        covariance=covariance,
        attributes={
            **(attributes_of(rows, taken) if roles.attributes else {}),
            **({ROW: taken.astype(np.float64)} if options.numbered else {}),
        },
        offered=roles.headers if options.attributes else (),
    )
    classes, klass = _classes(rows, taken, options, choice)
    return Reading(
        trajectories=trajectories,
        rows=len(state),
        notices=(
            *_notices(rows, clouds=clouds is not None),
            *([centres_compared()] if roles.centres else ()),
            *choice.notices,
        ),
        warnings=tuple(choice.warnings),
        left_out=choice.left_out,
        format=format,
        classes=classes,
        klass=klass,
        named=() if rows.classes is None else tuple(rows.classes[0]),
        missing=roles.missing,
        headers=roles.named,
        unused=roles.unused,
        centres=roles.centres,
        pixels=roles.centres and roles.fixed,
        idle=_idle(rows, options),
        height=roles.height,
        units=roles.units,
        regions=_regions(rows, state) if options.regions else None,
    )


def _notices(rows: Rows, *, clouds: bool) -> Iterator[str]:
    """Yield the notices of the roles, without that on another column with the same ids."""
    same, other = False, rows.roles.other_id
    if other is not None and other in rows.attributes and len(rows.roles.other_ids) == 1:
        of_other, code = np.unique(rows.attributes[other].astype(np.str_), return_inverse=True)
        pairs = np.unique(rows.ids[1] * len(of_other) + code)
        same = len(pairs) == len(of_other) == len(rows.ids[0])
    for notice in rows.roles.notices(clouds=clouds):
        if not (same and notice.startswith("id is read from")):
            yield notice


def signed(rows: Rows) -> tuple[Rows, list[Notice]]:
    """Make latitudes in the south and longitudes in the west negative, if another column says so.

    Also return notices about this, and a warning about rows for which the column does not say it.
    """
    roles, notices, numbers = rows.roles, [], rows.numbers
    for column in [column for column in roles.halves if column in rows.attributes]:
        values = rows.attributes[column].astype(np.str_)
        is_text = np.char.isalpha(values) & ~np.isin(values, [*MISSING])
        letter = np.where(is_text, np.char.upper(values.astype("U1")), "")
        for name, marks in (("lat", ("N", "S")), ("lon", ("E", "W"))):
            minus, header = letter == marks[1], quoted(roles.headers[column])
            if name in roles.names and minus.any():
                k = roles.numbers.index(roles.state[roles.names.index(name)][0][0])
                unknown = int(np.count_nonzero(~np.isin(letter, marks) & (numbers[:, k] > 0)))
                numbers = numbers.copy(order="F")
                numbers[minus, k] = -np.abs(numbers[minus, k])
                text = f"{name} is negative where {header} is {marks[1]}"
                notices.append(Notice(text=text))
                if unknown:
                    text = f"{header} is neither {' nor '.join(marks)} in {counted(unknown, 'row')}"
                    text, remedy = f"{text}, where {name} keeps its sign", "write it in all rows"
                    notices.append(Notice(code="hemispheres", text=text, remedy=remedy))
    return replace(rows, numbers=numbers), notices


UTM_ZONE = re.compile(r"0*([1-9]|[1-5]\d|60)([A-Za-z]|\.0)?")
SMALLEST_EASTING = 1e5
"""Metres that eastings of UTM exceed; smaller coordinates are not of UTM."""


def _about_zones(values: Values, state: Floats) -> Iterator[Notice]:
    """Warn if the zone of UTM changes; both arguments have the rows that take part."""
    matches = map(UTM_ZONE.fullmatch, np.unique(values.astype(np.str_)).tolist())
    zones = sorted({int(match[1]) for match in matches if match})
    if len(zones) > 1 and np.median(state[:, 0]) > SMALLEST_EASTING:
        yield Notice(
            code="utm-zones",
            text=f"positions of several zones ({listed(zones)}) are compared as if in one",
            remedy="write all positions in one zone, or as lat,lon",
        )


def _about_corners(rows: Rows, options: ReadOptions) -> Iterator[Notice]:
    """Warn if widths and heights, in a format without headers, seem to be edges of boxes.

    They seem so if they exceed the left and top edges in all rows, three objects or more move along
    both axes, and in each object the excess varies at most a tenth as much as they do.
    """
    roles, track = rows.roles, rows.ids[1]
    is_fixed = roles.fixed and rows.whole and len(rows.numbers) > 0
    if not (is_fixed and roles.sizes and {*PLACED} <= {*roles.headers}):
        return
    columns = [roles.headers.index(name) for name in PLACED]
    box = roles.mixed(rows.numbers, [((column, 1.0),) for column in columns])
    count = np.maximum(np.bincount(track), 1)

    def spread(values: Floats) -> Floats:
        mean = (np.bincount(track, values) / count)[track]
        return np.bincount(track, (values - mean) ** 2).astype(np.float64)

    with np.errstate(over="ignore", invalid="ignore"):  # boxes too large for numbers are told later
        size = box[:, 2:] - box[:, :2]
        each = [(spread(size[:, k]), spread(box[:, 2 + k])) for k in (0, 1)]
    if (size > 0).all() and all(
        (10 * of_size <= of_edge).all() and np.count_nonzero(of_edge > count) > 2
        for of_size, of_edge in each
    ):
        edges = dict(zip(columns, CORNERS, strict=True)) | {roles.id: "id", roles.time: "t"}
        named = [edges.get(k, "-") for k in range(max(edges) + 1)]
        yield Notice(
            code="corner-or-centre",
            text="width and height grow with left and top, as if they were the right bottom corner",
            remedy=f"{ask(options.option, named)} reads them so; leave "
            f"{option(f'{_side(rows)}format')} out",
        )


def _ids_of_classes(rows: Rows, step: Ints, mask: Mask) -> Rows:
    """Append the class to all ids, if several classes have the same id at one step."""
    assert rows.classes is not None
    (names, number), (classes, klass) = rows.ids, rows.classes
    taken = np.flatnonzero(mask)
    track = step[taken].astype(np.int64) * max(len(names), 1) + number[taken]
    pair = track * max(len(classes), 1) + klass[taken]
    if len(np.unique(track)) == len(np.unique(pair)):
        return rows
    both = named_ids([Coded(names.tolist(), number), Coded(classes.tolist(), klass)])
    return replace(rows, ids=both)


def _about_flags(rows: Rows, state: Floats, mask: Mask) -> Iterator[Notice]:
    """Yield notices about rows that count, although they may be marked as excluded or unknown."""
    roles, side = rows.roles, _side(rows)
    for column in roles.flags:
        values, header = rows.attributes.get(column), roles.headers[column]
        match = FLAG.fullmatch(header)
        if match is None or values is None:
            continue
        if match["zone"]:
            yield from _about_zones(values[mask], state[mask])
            continue
        if values.dtype == object:  # True and False
            names = {"true": 1.0, "false": 0.0}
            values = np.array([names.get(str(one).casefold(), np.nan) for one in values.tolist()])
        off = mask & ((values > 0) if match["mark"] else (values == 0))
        at = np.flatnonzero(off)
        if not 0 < len(at) < np.count_nonzero(mask):
            continue
        test = "== 0" if match["mark"] else "> 0"
        if values is not rows.attributes[column]:
            test = f"== {rows.attributes[column][mask & ~off][0]}"
        remedy = f"{ask(f'{side}where', [f'{header} {test}'])} leaves them out"
        if side == "truth_" and (match["mark"] or match["score"]):
            rule = ">0" if match["mark"] else "=0"
            if values is not rows.attributes[column]:
                rule = f"={rows.attributes[column][at[0]]}"
            is_marked = header == IGNORED and np.isin(values, (0, 1)).all()
            rule = MARKED if is_marked else f"{header}{rule}"
            remedy = f"{ask('ignore', [rule])} lets tracks follow them at no cost"
        if match["mark"] or match["score"]:
            flag = "not 0" if match["mark"] else "0"
            yield Notice(text=f"rows whose {quoted(header)} is {flag} count; {remedy}")
        elif (
            len(at) > 1
            and np.isin(rows.ids[1][at], rows.ids[1][mask & ~off]).all()
            and (off == mask & (state == state[at[0]]).all(axis=1)).all()
        ):
            place = ",".join(f"{value:g}" for value in state[at[0]].tolist())
            text = f"all rows whose {quoted(header)} is 0 are at {place}, as if unknown"
            yield Notice(code="not-visible", text=text, remedy=remedy)
            return
    if rows.whole:
        yield from _about_places(rows, mask)


def _side(rows: Rows) -> str:
    """Return the beginning of the names of the options of this side; blank for a single table."""
    option = rows.roles.options.option
    return option.removesuffix("columns") or f"{rows.name}_" * (rows.name in ROLES)


LEAP = 5.0
"""Multiple of a usual displacement between consecutive rows of a track, see `_about_places`."""

MARKS = (-1, -999, *(k * (10**n - 1) for n in range(4, 8) for k in (1, -1)), -(2**15), -(2**31))
"""Numbers that programs write in place of an unknown coordinate."""


def _about_places(rows: Rows, mask: Mask) -> Iterator[Notice]:
    """Yield a warning if some rows seem to have a mark, such as -999,-999, instead of a position.

    All columns of the position have one number of `MARKS` in these rows, to which tracks jump. The
    number can be 0 for latitudes and longitudes, and -1 only if all other numbers are positive.
    """
    roles, track = rows.roles, rows.ids[1]
    columns = list(dict.fromkeys(column for mix in roles.state[:2] for column, _ in mix))
    if len(columns) < 2 or not roles.headers:
        return
    marks = (*MARKS, 0) if roles.names[:2] == ("lat", "lon") else MARKS
    place = rows.numbers[:, [roles.numbers.index(column) for column in columns]]
    alike = mask & np.isin(place[:, 0], marks) & (place == place[:, :1]).all(axis=1)
    if np.count_nonzero(alike) < 2:
        return
    values, counts = np.unique(place[alike, 0], return_counts=True)
    value = values[counts.argmax()]
    off = alike & (place[:, 0] == value)
    if value == -1 and not (place[mask & ~off] > 0).all():
        return
    order = np.flatnonzero(mask)
    order = order[np.lexsort((rows.times.value[order], track[order]))]
    own = np.diff(track[order]) == 0
    with np.errstate(over="ignore", invalid="ignore"):
        moves = np.linalg.norm(np.diff(place[order], axis=0), axis=1)
    before, after = off[order][:-1], off[order][1:]
    moving, leaps = moves[own & ~before & ~after & (moves > 0)], moves[own & (before != after)]
    largest = np.quantile(moving, 0.9) if len(moving) else 0.0
    if len(leaps) and np.median(leaps) > LEAP * largest:
        count = np.count_nonzero((place == value)[mask], axis=0)
        number, header = plain(float(value)), roles.headers[columns[int(count.argmin())]]
        header = header if header.isidentifier() else f'"{header}"'
        remedy = ask(f"{_side(rows)}where", [f"{header} != {number}"])
        yield Notice(
            code="no-place",
            text=f"{counted(int(off.sum()), 'row is', 'rows are')} at {number},{number}, far from "
            "the other rows of their tracks, as if the position is unknown",
            remedy=f"{remedy} leaves them out",
        )


NO_TRACK = ("-1", "None", "none", "nan", "NaN", "null", "NA", "N/A", "<NA>")
"""Texts that programs write as the id of a row without a track."""


def _about_ids(rows: Rows, taken: Ints, options: ReadOptions) -> Iterator[Notice]:
    """Yield warnings about doubtful ids.

    There are five kinds of doubtful ids:

    - An id may mean "no track".
    - An id is a rounded number.
    - Ids may be swapped with times.
    - Ids may number rows instead of tracks.
    - Ids may restart in each group of rows, such as a recording (`headers.GROUP`).
    """
    names, number = rows.ids
    whole, roles, count = rows.whole, rows.roles, np.bincount(number[taken], minlength=len(names))
    for k in np.flatnonzero(np.isin(names, NO_TRACK) & (count > 0)) if len(names) > 1 else ():
        # Without all rows of the file the count is not known.
        of_rows = f" of {counted(int(count[k]), 'row')}" if whole else ""
        yield Notice(
            code="no-track",
            text=f"id {names[k]}{of_rows} counts as one track; {OFTEN_NONE}",
            remedy=without_id(names[k], rows, options.option),
        )
    if (name := _rounded(names[count > 0])) is not None:
        yield Notice(code="ids-rounded", text=_lost(name), remedy="write all digits of the ids")
    used = count[count > 0]
    if not whole:
        return
    exchanged = _exchanged(roles, options)
    if exchanged and _are_exchanged(rows, taken):
        yield Notice(
            code="ids-exchanged",
            text="rows of one id are far apart, and rows of one step are near each other: the "
            "columns of ids and times may be swapped",
            remedy=f"{ask(options.option, exchanged)} reads them so",
        )
    if roles.other_ids:
        own, other = (roles.headers[k] for k in (roles.id, roles.other_ids[0]))
        text = f"every id of {quoted(own)} has a single row: these are not tracks"
        if len(used) < 3 or (used > 1).any():
            text = f"ids of {quoted(own)} may number rows: {quoted(other)} has other tracks"
        if text.startswith("every") or _may_number_rows(rows, taken):
            remedy = f"{ask(options.option, [f'id={other}'])} reads another column"
            yield Notice(code="ids-of-rows", text=text, remedy=remedy)
    groups = []
    for column in roles.groups:
        header = roles.headers[column]
        if column in rows.attributes and GROUP.fullmatch(header):
            values = rows.attributes[column][taken]
            _, code = np.unique(values.astype(np.str_), return_inverse=True)
            pairs = np.unique(number[taken] * (int(code.max(initial=0)) + 1) + code)
            groups += [header] if len(pairs) > len(used) else []
    if groups:
        own = roles.headers[roles.id]
        whole_id = "+".join([*groups, own])
        yield Notice(
            code="ids-begin-anew",
            text=f"ids of {quoted(own)} repeat in several values of {quoted(groups[0])}, and "
            "each id counts as one track",
            remedy=f"use {ask(options.option, [f'id={whole_id}'])} if ids restart in each",
        )


def _may_number_rows(rows: Rows, taken: Ints, *, repeated: bool = False) -> bool:
    """Return whether ids seem to number rows, while another column has the ids of the tracks.

    With `repeated`, only the first of these conditions must be true; without it, all three.

    - The other column has a value in each row, and each value only once in a step.
    - At least one value of the other column occurs with several ids.
    - The other column has fewer distinct values than the column of ids. Or ids number the rows of
      each step in order.
    """
    column = rows.roles.other_id
    if column is None or column not in rows.attributes or not len(taken):
        return False
    other = rows.attributes[column][taken].astype(np.str_)
    columns = other, rows.ids[1][taken], rows.times.value[taken]
    code, number, step = (np.unique(each, return_inverse=True)[1] for each in columns)
    count = code.max() + 1
    pairs, at_once = (len(np.unique(each * count + code)) for each in (number, step))
    if at_once < len(taken) or np.isin(other, ("", "nan")).any():
        return False
    order = np.lexsort((taken, step))
    rank = np.arange(len(taken)) - np.searchsorted(step[order], step[order])
    if repeated or pairs == count:
        return repeated
    return count <= number.max() or bool((number[order] == rank).all())


PLACED = ("left", "top", "width", "height")
"""Columns of boxes in formats without headers."""


def _exchanged(roles: Roles, options: ReadOptions) -> list[str]:
    """Return the items of the option `columns` that would exchange ids and times.

    The list is empty if neither the user nor a format with boxes names ids and times.
    """
    if roles.fixed and "left" in roles.headers:
        placed = [name if name in PLACED else "-" for name in roles.headers]
        placed[roles.id], placed[roles.time] = "t", "id"
        return placed
    named = [*map(str.strip, options.placed or options.columns or ())]
    if "t" in named and not roles.fixed:  # columns without headers
        return [{"id": "t", "t": "id"}.get(name, name) for name in named]
    states = [item for item in named if not item.startswith(("id=", "t="))]
    places = [f"id={roles.headers[roles.time]}", f"t={roles.headers[roles.id]}"]
    return [*states, *places] if len(states) < len(named) else []


def _are_exchanged(rows: Rows, taken: Ints) -> bool:
    """Return whether ids and times seem to be swapped.

    They seem to be swapped if rows of one step are much nearer to each other than consecutive rows
    of one id.
    """
    taken = taken[:SAMPLED]
    of_ids, of_steps = spacings(rows.ids[1][taken], rows.times.value[taken], rows.numbers[taken])
    return of_ids > EXCHANGED * of_steps > 0


SAMPLED, EXCHANGED = 10_000, 5.0
"""Number of rows that are examined, and ratio of distances above which ids and times seem to be
swapped."""


def _rounded(names: Iterable[str]) -> str | None:
    """Return the first name that is a rounded number; None if there is no such name."""
    return next((name for name in names if "+" in name and is_rounded(name)), None)


def _lost(name: str) -> str:
    """Return the message about an id that is a rounded number."""
    return f"id {quoted(name)} has lost digits, as in spreadsheets, so several objects may share it"


OFTEN_NONE = "many programs write it for rows without a track"


def without_id(name: str, rows: Rows, columns: str) -> str:
    """Return the option that leaves out the rows of an id, for messages."""
    header = rows.roles.headers[rows.roles.id] if rows.roles.headers else "id"
    where = ask(columns.replace("columns", "where") or "where", [f"{header} != {name}"])
    return f"{where} leaves such rows out"


UNKNOWN = (-1.0, 0.0)
"""Numbers that programs write in all columns of an unknown position."""


def _idle(rows: Rows, options: ReadOptions) -> tuple[str, ...]:
    """Return the headers of the states, if all positions seem to be unknown.

    Positions seem to be unknown in three cases:

    - All positions are blank.
    - All positions are the same, and there are several objects.
    - All columns have one number of `UNKNOWN` in all rows. In a single row, only -1 counts.

    In other cases, and if the user named the states, the result is empty.
    """
    columns = dict.fromkeys(column for mix in rows.roles.state for column, _ in mix)
    if not len(rows.numbers) or not rows.roles.headers or parse_columns(options.columns)[1]:
        return ()
    numbers = rows.numbers[:, [rows.roles.numbers.index(column) for column in columns]]
    first = numbers[0]
    same = (numbers[-1] == first) | (first != first)  # a quick test, as most columns vary
    if not same.all() or not ((numbers == first) | (numbers != numbers)).all():
        return ()
    is_unknown = any((first == value).all() for value in UNKNOWN[: len(numbers)])
    is_unknown |= bool((first != first).all()) or len(rows.ids[0]) > 1
    return tuple(rows.roles.headers[column] for column in columns) if is_unknown else ()


def _regions(rows: Rows, state: Floats) -> Regions | None:
    """Return the boxes that the format marks as ignored regions; None without such boxes."""
    at = [np.flatnonzero(mask) for rule, (mask, _) in rows.excluded.items() if rule in AS_REGIONS]
    boxes = np.concatenate([np.zeros(0, np.int64), *at])
    boxes = boxes[(state[boxes, 2:] > 0).all(axis=1)]
    if not len(boxes):
        return None
    timestamps = rows.times.value[boxes].tolist()
    shapes = (
        Shape(kind=BOX, rings=(state[k],), where=rows.where(k), moment=moment)
        for k, moment in zip(boxes.tolist(), timestamps, strict=True)
    )
    return Regions(shapes=tuple(shapes), clock=rows.times.clock, name=rows.name)


def said_of(rule: str, count: int, which: str) -> str:
    """Return the message about `count` rows that a rule leaves out.

    `which` says which of several duplicates was used: first or last.
    """
    if rule == "duplicate":
        rows_repeat = counted(count, "row repeats", "rows repeat")
        return f"{rows_repeat} an (id, t): the {which} one was used"
    return f"{counted(count, 'row')} {rules_said()[rule]}"


def class_notices(options: ReadOptions, there: Sequence[str], *, whole: bool) -> Iterator[str]:
    """Yield notices about requested classes that are missing or spelled in another way.

    `there` has classes of the file, and `whole` says whether it has all of them. If it has all,
    a requested name can also mean a class that is spelled in another way (see `class_named`).
    """
    requested = {name.strip() for name in options.classes or ()}
    for name in sorted(requested):
        match = class_named(name, there) if whole else name
        variants = [other for other in there if is_alike(name, other) and other not in requested]
        if match not in there:
            shown = ", ".join(map(quoted, there[:10])) or "none"
            yield f"no row of class {quoted(name)}; there are {shown}"
        elif match != name:
            yield f"class {quoted(match)} is read as {quoted(name)}"
        elif variants:
            yield f"class {quoted(name)} does not include {quoted(variants[0])}"


class _Choice:
    """Rows that still take part, counts of left-out rows, and messages for the user."""

    def __init__(self, rows: int) -> None:
        self.mask = np.ones(rows, bool)
        self.left_out: dict[str, int] = {}
        self.notices: list[str] = []
        self.warnings: list[Notice] = []

    def keep(self, inside: Mask, rule: str, sentence: str = "") -> None:
        """Leave out rows where `inside` is False; `sentence` replaces the message of the rule."""
        if inside.all():
            return
        before = int(np.count_nonzero(self.mask))
        self.mask &= inside
        count = before - int(np.count_nonzero(self.mask))
        if count:
            self.left_out[rule] = self.left_out.get(rule, 0) + count
            said = f"{counted(count, 'row')} {sentence}" if sentence else said_of(rule, count, "")
            self.notices.append(said)

    def all(self) -> bool:
        """Return whether no row was left out."""
        return not self.left_out


LONGER = 1.5
"""If the next day makes a recording longer by this factor, times are probably not times of day."""


def _may_pass_midnight(times: TimeArray) -> bool:
    """Return whether sorted times may span more than half a day.

    The unit of the times is not known, and seconds are the largest possible unit. So the result is
    True if the times span more than 43,200, which is half a day in seconds.
    """
    return len(times) > 0 and float(times[-1]) - float(times[0]) > 43_200


def _may_be_calendar(times: TimeArray) -> bool:
    """Return whether sorted times may be dates or times of day that are written as numbers.

    If it is False, `calendar_format` is not called.
    """
    if len(times) < 2 or times[0] < 10_000:
        return False
    return bool(times[0] > 1.9e7 or (times % 100 < 60).all())


def _grid(
    rows: Rows, options: ReadOptions, choice: _Choice
) -> tuple[TimeArray, Ints, NDArray[np.object_] | None]:
    """Return the distinct times in order, the step of each row, and the text of each distinct time.

    The texts are None if times are numbers. Only times within the range of time are returned, and
    rows outside this range are left out.
    """
    times = rows.times
    if options.day_begins is not None:
        from tgospa_eval.formats.clocks import carried  # lazy: seldom needed

        times = carried(times, options.day_begins, rows.name)
        if len(times.value) and np.ptp(times.value) > LONGER * np.ptp(rows.times.value):
            text = f"{option('day_begins', plain(options.day_begins))} makes the recording longer"
            remedy = "leave it out if times are frames, or if none are after midnight"
            choice.warnings.append(Notice(code="midnight", text=text, remedy=remedy))
    timestamps, step = _number_times(times.value)
    if options.day_begins is None and rows.whole and _may_pass_midnight(timestamps):
        from tgospa_eval.formats.clocks import over_midnight  # lazy: seldom needed

        anew = over_midnight(times, timestamps, rows.ids[1])
        if anew is not None:
            place = rows.where(anew[0]).removeprefix(f"{rows.name}, ")
            text = f"{place}: the time of day jumps back, as at midnight"
            choice.warnings.append(Notice(code="midnight", text=text, remedy=anew[1]))
    if times.clock == "number" and _may_be_calendar(timestamps):
        from tgospa_eval.formats.clocks import calendar_format  # lazy: seldom needed

        side = options.option.rpartition("columns")[0]
        sides = (side,) if side else ("truth_", "estimate_")
        if form := calendar_format(timestamps):
            ways = " or ".join(option(f"{side}time_format", form) for side in sides)
            first = timestamps[0].item()
            such = f" such as {first if first % 1 else int(first)}"
            such *= rows.whole  # not for each part of a file
            shown = f"times{such} look like dates or times of day, and count as numbers"
            remedy = f"{ways} reads them" if rows.whole and form != "?" else "write ISO 8601 times"
            choice.warnings.append(Notice(code="calendar-numbers", text=shown, remedy=remedy))
    labels = None
    if times.text is not None:
        labels = np.empty(len(timestamps), dtype=object)
        labels[step[::-1]] = np.array([text.strip() for text in times.text], dtype=object)[::-1]
    timestamps, labels = options.conversion.times(timestamps, times.clock, labels, rows.name)
    if options.time_range is None:
        return timestamps, step, labels
    inside = options.time_range.inside(timestamps, times.clock, rows.name)
    choice.keep(inside[step], "time")
    labels = None if labels is None else labels[inside]
    return timestamps[inside], (np.cumsum(inside) - 1)[step], labels


def _keep_classes(rows: Rows, options: ReadOptions, choice: _Choice) -> None:
    """Leave out rows of classes that were not requested, if there is a filter by class."""
    if options.classes is None:
        return
    if rows.classes is None:
        choice.notices.append(no_classes())
        return
    there = rows.classes[0].tolist()
    requested = [name.strip() for name in options.classes]
    requested += options.also
    taken = {class_named(name, there) for name in requested} if rows.whole else {*requested}
    known = np.array([name in taken for name in there], bool)
    choice.keep(known[rows.classes[1]], "class")
    choice.notices += class_notices(options, there, whole=rows.whole)


def _values(rows: Rows, column: int) -> Values:
    """Return the values of a column as numbers or texts; ids and classes are always texts.

    Raises
    ------
    InputError
        The column is that of the weights, and one of its values is not a number.
    """
    roles = rows.roles
    if column in rows.attributes:
        return rows.attributes[column]
    if column in roles.numbers:
        if column == roles.weight and rows.weight_fault is not None:
            raise InputError(*rows.weight_fault.split("\n"))
        return cast(Values, rows.numbers[:, roles.numbers.index(column)])
    if column == roles.time:
        times = rows.times
        return np.array(times.value if times.text is None else list(times.text))
    numbered = rows.ids if column == roles.id else rows.classes
    assert numbered is not None  # the column has ids or classes
    return cast(Values, numbered[0][numbered[1]])


def _keep_region(
    rows: Rows, options: ReadOptions, particles: "Particles | None", choice: _Choice
) -> None:
    """Leave out rows outside the region; a cloud is left out if its mean is outside."""
    if not rows.roles.region:
        return
    values = rows.roles.mixed(rows.numbers, tuple(rows.roles.region.values()))
    if particles is not None:
        values = particles.means(values)
    inside = np.ones(len(values), bool)
    factors = options.conversion.factors(rows.roles.names)
    scale = {} if factors is None else dict(zip(rows.roles.names, factors.tolist(), strict=True))
    for column, (name, (low, high)) in zip(values.T, options.ranges.items(), strict=True):
        column = column * scale[name] if name in scale else column
        inside &= (column >= low) & (column <= high)
    choice.keep(inside, "region")


def _check_states(
    rows: Rows, state: Floats, options: ReadOptions, choice: _Choice, *, droppable: bool
) -> None:
    """Refuse or leave out invalid states of the rows that take part.

    A state is invalid if its box has a wrong size or is too large for a number, or if the distance
    does not allow it. With `droppable`, the option `on_invalid` can leave such rows out.

    Raises
    ------
    InputError
        A state is invalid, and the options do not leave such rows out.
    """

    def leave_out(wrong: Mask, column: str, fault: str, remedy: str = "") -> None:
        """Leave out wrong rows, or raise an error about the first of them."""
        at = np.flatnonzero(wrong & choice.mask)
        if not len(at):
            return
        of_column = f", column {quoted(column)}" if column else ""
        text = f"{of_column}: {fault}{more(len(at)) if remedy else ''}{remedy}"
        if options.on_invalid == "error" or not droppable:
            left = (choice.mask & ~wrong).any()
            way = (
                f"; to leave such rows out, use {option('on_invalid', 'drop')}"
                if droppable and left
                else ""
            )
            way = way if left else ", and no row is valid"
            raise InputError(f"{rows.where(int(at[0]))}{text}{way}")
        place = rows.where(int(at[0])).removeprefix(f"{rows.name}, ")  # notices begin with the name
        choice.keep(~wrong, "invalid", f"{rules_said()['invalid']}: {place}{text}")

    sizes = rows.roles.sizes
    if rows.roles.centres or options.boxes:
        infinite = np.asarray(~np.isfinite(state).all(axis=1))
        leave_out(infinite, "", "a box too large for a number", "; use another unit")
    # Sizes of -1 in all rows mean unknown boxes. They are not checked at the first reading, because
    # `by_place` then reads the file again with the option `hidden`, if possible by other columns.
    again = rows.roles.fixed and rows.whole and not (options.hidden or options.boxes)
    unknown = again and _idle(rows, options) and (rows.roles.mixed(rows.numbers, sizes) == -1).all()
    for name, size in zip(("width", "height"), () if unknown else sizes, strict=False):
        extent = rows.roles.mixed(rows.numbers, (size,))[:, 0]
        wrong = np.asarray(~(extent > 0 if options.boxes else extent >= 0)) & choice.mask
        bound = f"> 0 for {option('distance', 'iou')}" if options.boxes else ">= 0"
        first = extent[wrong][:1].sum()
        leave_out(wrong, name, f"{first:g} is not a {name} of a box", f"; it must be {bound}")
    while options.fault is not None:
        taking = state if choice.all() else state[choice.mask]
        fault = options.fault(rows.roles.names, taking.T)
        if fault is None:
            return
        wrong = np.zeros(len(state), bool)
        wrong[choice.mask], column, what = fault
        leave_out(wrong, column, what)


def _repeats(
    rows: Rows,
    key: Ints,
    taken: Ints,
    ordered: Ints,
    options: ReadOptions,
    format: str,
    choice: _Choice,
) -> Ints | None:
    """Return which rows to leave out because their (id, t) is repeated; None without such rows.

    `taken` has the rows that take part, in the order of their keys, and `ordered` has these keys.
    The result has indices in `taken`.

    Raises
    ------
    InputError
        An (id, t) is repeated, and the options do not say which row to use; or every id is -1.
    """
    which = options.on_duplicate
    again = places_of(ordered[1:] == ordered[:-1])
    if not len(again):
        if which == "error" and len(taken) > 1 and [*rows.ids[0][:2]] == ["-1"]:
            raise InputError(only_detections(rows.name))
        return None
    if which == "error":
        for name in ("id", "t"):  # a missing column may be the reason
            if name in rows.roles.missing:
                raise InputError(rows.roles.missing[name])
        raise InputError(refusal(taken, again, key, rows, format, options.option))
    if 2 * len(again) > len(taken):
        choice.warnings.append(
            Notice(
                code="duplicates",
                text=f"{len(again):,} of {len(taken):,} rows repeat an (id, t), and the {which} "
                "one was used: the value says little about the tracker",
                remedy=_cause(taken, again, rows, options.option)
                or f"name the columns of ids and times, {option('columns', 'id=HEADER,t=HEADER')}",
            )
        )
    choice.notices.append(said_of("duplicate", len(again), which))
    choice.left_out["duplicate"] = len(again)
    return again + 1 if which == "first" else again


def _renumbered(number: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the distinct values of `number`, and all values renumbered without gaps.

    All values are below `count`.
    """
    occurs = np.bincount(number, minlength=count) > 0
    used = places_of(occurs)
    return used, number if len(used) == count else (np.cumsum(occurs) - 1)[number]


def _classes(
    rows: Rows, taken: Ints, options: ReadOptions, choice: _Choice
) -> tuple[tuple[str, ...], Ints | None]:
    """Return the names of the classes, and for each of the rows `taken` the index of its class.

    The result is ``((), None)`` if classes are not requested, or the file has none.
    """
    if not options.by_class or rows.classes is None:
        return (), None
    names, number = rows.classes
    used, klass = _renumbered(number[taken], len(names))
    classes = tuple(names[used])
    if "" in classes:
        count = int(np.count_nonzero(klass == classes.index("")))
        rows_have = counted(count, "row has", "rows have")
        choice.notices.append(f'{rows_have} no class: evaluated as a class named ""')
    return classes, klass


def _covariances(
    rows: Rows, taken: Ints, spread: "SpreadColumns", options: ReadOptions, choice: _Choice
) -> Floats:
    """Return the covariances of the rows `taken`, and add notices about them to `choice`."""
    from tgospa_eval.formats.spread import covariances_of

    numbers = rows.roles.numbers
    covariance, notices = covariances_of(
        {column: rows.numbers[taken, numbers.index(column)] for column in spread.columns},
        taken,
        lambda row: f"{rows.where(row)} (id {rows.quoted_id(row)}, t {rows.moment(row)})",
        spread,
        missing=options.missing_covariance,
        fix=options.fix_covariance,
    )
    choice.warnings += [notice for notice in notices if notice.code]
    choice.notices += [notice.text for notice in notices if not notice.code]
    return covariance


def _by_key(key: Ints, chosen: Ints | None) -> tuple[Ints, Ints]:
    """Return the chosen rows (by default all) in the order of their keys, and the sorted keys."""
    if chosen is not None:
        key = key[chosen]
    if (key[1:] > key[:-1]).all():  # most programs write sorted rows
        return (np.arange(len(key)) if chosen is None else chosen), key
    if len(key) and key.max() < 4 * len(key):  # few gaps: quicker than sorting
        table = np.full(int(key.max()) + 1, -1)
        table[key] = np.arange(len(key))
        ordered = np.flatnonzero(table >= 0)
        if len(ordered) == len(key):
            rows = table[ordered]
            return (rows if chosen is None else chosen[rows]), ordered
    rows = np.argsort(key, kind="stable")
    return (rows if chosen is None else chosen[rows]), key[rows]


def _number_times(value: TimeArray) -> tuple[TimeArray, Ints]:
    """Return the distinct times in order, and the index of the time of each row."""
    if (value[1:] >= value[:-1]).all():  # most programs write rows in the order of time
        begins = np.ones(len(value), bool)
        np.greater(value[1:], value[:-1], out=begins[1:])
        return value[begins], np.cumsum(begins) - 1
    timestamps, step = np.unique(value, return_inverse=True)
    return cast(TimeArray, timestamps), step


def attributes_of(rows: Rows, taken: Ints) -> dict[str, Values]:
    """Return the requested attributes of the rows `taken`; a cloud has those of its first row."""
    roles = rows.roles
    columns: dict[int, Values] = dict(rows.attributes)
    columns |= dict(zip(roles.numbers, rows.numbers.T, strict=True))
    values: dict[str, Values] = {}
    for name, column in roles.attributes.items():
        if column in columns:
            values[name] = columns[column][taken]
        elif column == roles.time:
            times = np.array([rows.moment(row) for row in taken.tolist()], dtype=object)
            values[name] = times if rows.times.text is not None else times.astype(np.float64)
        else:
            numbered = rows.ids if column == roles.id else rows.classes
            assert numbered is not None  # the column has ids or classes
            values[name] = attribute_of(Coded(numbered[0].tolist(), numbered[1][taken]))
    return values


PARTICLES_HINT = 'if the rows are particles of one object, add a column "weight"'

ONLY_DETECTIONS = "every id is -1: these are detections, and TGOSPA compares tracks"

NEARLY_ALL = 0.9
"""Smallest share of equal ids for which a message says that nearly every id is the same."""


def only_detections(name: str) -> str:
    """Return the message about a file whose only id is -1."""
    return f"{name}: {ONLY_DETECTIONS}; give a single track another id"


def refusal(
    taken: Ints, again: Ints, key: Ints, rows: Rows, format: str, columns: str = "columns"
) -> str:
    """Return the message about the first row of the file that repeats an (id, t).

    Parameters
    ----------
    taken : int array
        Rows that take part, in the order of their keys.
    again : int array
        Indices in `taken` of the rows that have the same key as the next row.
    key : (R,) int array
        Keys of all rows of the file.
    rows, format
        Rows of the file, and name of its format.
    columns : str
        Option with which the user names columns; blank for a DataFrame.
    """
    second = taken[again + 1]
    k = int(np.argmin(second))
    row = int(second[k])
    first = int(taken[np.searchsorted(key[taken], key[row])])
    where, roles = rows.where, rows.roles
    already = where(first).removeprefix(f"{rows.name}, ")
    duplicates = f" (and {counted(len(again) - 1, 'more duplicate')})" if len(again) > 1 else ""
    message = (
        f"{where(row)}: id {rows.quoted_id(row)} at t {rows.moment(row)} is already in "
        f"{already}{duplicates}; "
    )
    if _may_number_rows(rows, taken, repeated=True):
        other = roles.headers[roles.other_ids[0]]
        return f"{message}{ask(columns, [f'id={other}'])} reads the ids of {quoted(other)}"
    cause = _cause(taken, again, rows, columns)
    is_single = len(np.unique(rows.ids[1][taken])) == 1
    groups = [
        roles.headers[column]
        for column in roles.groups
        if column in rows.attributes
        and (GROUP.fullmatch(roles.headers[column]) or not is_single)
        and len(set(rows.attributes[column][[first, row]].astype(np.str_).tolist())) == 2
    ]
    if cause and not (groups and is_single and cause != ONLY_DETECTIONS):
        return message + cause
    if groups:
        whole_id = "+".join([*groups, roles.headers[roles.id]])
        mapped = "" if groups[0] == "class" else f"{ask(columns, [f'class={groups[0]}'])} with "
        return (
            f"{message}ids restart in each {quoted(groups[0])}: "
            f"{ask(columns, [f'id={whole_id}'])} evaluates all as one scene, "
            f"{mapped}{option('by', 'class')} each separately"
        )
    remedy = f"{option('on_duplicate', 'first')} or last"
    if format == "frame":
        remedy = f"drop_duplicates({[roles.headers[roles.id], roles.headers[roles.time]]!r})"
    return f"{message}write one row per object and step, or use {remedy}; {PARTICLES_HINT}"


def _cause(taken: Ints, again: Ints, rows: Rows, columns: str) -> str:
    """Return the likely reason why rows repeat an (id, t), with a remedy; blank if unknown."""
    counts = np.bincount(rows.ids[1][taken])
    name = rows.ids[0][int(counts.argmax())]
    is_single = counts.max() == len(taken)
    if name == "-1" and is_single:
        return ONLY_DETECTIONS
    repeated = {rows.ids[0][k] for k in np.unique(rows.ids[1][taken[again]]).tolist()}
    if (rounded := _rounded(repeated)) is not None:
        return f"{_lost(rounded)}; write all digits of the ids"
    if len(repeated) == 1 and len(rows.ids[0]) > 1 and repeated <= {*NO_TRACK, "0"}:
        (name,) = repeated
        return f"{OFTEN_NONE}; {without_id(name, rows, columns)}"
    most = NEARLY_ALL * len(taken)
    if counts.max() < most or (4 if is_single and len(again) > 1 else 2) * len(again) <= len(taken):
        return ""
    fault = f"nearly every id is {quoted(name)}, as in detections, but TGOSPA compares tracks"
    if rows.roles.fixed:
        return fault
    return (
        f"{fault}; if the ids are not in {quoted(rows.roles.headers[rows.roles.id])}, name their "
        f"column, {option('columns', 'id=HEADER')}; {PARTICLES_HINT}"
    )
