"""Tables of text with one row per object and step: CSV, MOTChallenge, VisDrone and KITTI.

A CSV file has a header with ``id,t,x[,y[,z]]`` and other columns. It is read without pandas, which
is slow to import. Floats and integers stay exact, and messages name the line. A compiled loop reads
most files; the csv module splits the lines of all others.

The other formats have no header. The number of fields decides the names of the columns.

MOTChallenge: ``frame,id,left,top,width,height[,conf[,...]]``. Column 7 is a score in results. In
the truth it is a flag; 0 means that the object is not considered. The columns after it depend on
the number of fields: class (8), class and visibility (9), or a position in space (10).

VisDrone: ``frame,id,left,top,width,height,score,class,truncation,occlusion``. In the truth the
score is a flag; 0 means that the object is not considered. In results truncation and occlusion are
-1. Classes are numbers, which are converted to names.

KITTI: 17 fields separated by blanks, or 18 with a score. Columns have the edges of the image box,
and sizes and positions in space in metres, in the coordinates of the camera. Truth and results
have the same columns.
"""

import csv
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import MISSING, Coded, attribute_of, is_number
from tgospa_eval.formats.guess import COMMENTS, foreign
from tgospa_eval.formats.guess import split as split_line
from tgospa_eval.formats.headers import BOX, unit_of
from tgospa_eval.formats.loading import check_text_memory
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import (
    FLAG,
    Roles,
    are_numbers,
    find_roles,
    placed_names,
    without_header,
)
from tgospa_eval.formats.rows import AS_REGIONS, NOT_CONSIDERED, Rows, numbered, spacings
from tgospa_eval.formats.text.lines import (
    BLANKS,
    ROWS_OF_BLOCK,
    Comments,
    beginning,
    blocks_of,
    check_text,
    convert,
    decode,
    gather,
    lines_of,
    numbers,
    plain_id,
    scanned,
)
from tgospa_eval.quoting import option, quoted

DELIMITERS = ",;\t"

DECIMAL = r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?"
GROUPED_NUMBER = r"[+-]?[1-9]\d{0,2}[.,]\d{3}"
"""Pattern of numbers in which a point or comma may separate thousands instead of decimals."""

FIELDS_BY_BLANKS = re.compile(r'"([^"\n]*)"|([^ \t\n]+)')

LINES_ASIDE = 4
"""Largest number of lines of titles above a header, and of lines of units or names below it."""

WORD = re.compile(r"[^\d\s+.,-].*[^\W\d_].*|[^\W\d_].*|[^\w\s+.,-]")
"""Pattern of a name or unit in a line below a header, with or without brackets.

Numbers and times do not match it."""

FEWEST = 3
"""Smallest number of columns (id, t and x) of a table whose columns are separated by blanks."""


def read_table(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a CSV file; `role` has no effect.

    Raises
    ------
    InputError
        The content is wrong (see `formats.read`).
    """
    check_text_memory(path, data, options.max_input)
    check_text(data, path)
    text, whole = beginning(data, path)
    names, roles, delimiter, first, start = header_of(text, path, options)
    roles, decimal = with_decimal(text[start:], delimiter, roles, options.decimal)
    name_id = plain_id if delimiter == BLANKS else str.strip  # numpy.savetxt writes 1.000e+00
    fields = scanned(data, first, len(names), delimiter, roles, decimal)
    if fields is None:
        text = text if whole else decode(data, path)
        rule = f"the header has {len(names)}; give every row one field per column"
        lines, comments = lines_of(text, start), Comments()
        blocks = blocks_of(
            lines,
            partial(split_rows, delimiter=delimiter),
            len(names),
            first,
            path,
            rule,
            comments,
            delimiter=delimiter,
            quotes='"' in text,
        )
        fields = gather(blocks, roles, decimal)
        roles = comments.noted(roles)
    return convert(fields, roles, decimal, path, names, name_id)


def header_of(
    text: str, path: str, options: ReadOptions, *, wide: bool = False
) -> tuple[list[str], Roles, str, int, int]:
    """Find the header; return headers, roles, delimiter, and line and position of the first row.

    The position counts characters of the text. The header is the first line that is understood as
    one, even if it begins like a comment. Comments and a few lines of titles may be above the
    header, and a few lines of units or names below it.
    """
    faults: dict[int, InputError] = {}  # by number of fields; the first is raised
    comments = skipped = 0
    for number, match in enumerate(re.finditer(r".*\n?", text), start=1):
        line, start = match[0].removesuffix("\n"), match.end()
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        stop = text.find("\n", start)
        after = text[start : stop if stop >= 0 else None].replace('"', "")
        by_blanks = header_by_blanks(line, after)
        delimiter = BLANKS if by_blanks else _delimiter(line, options.decimal)
        fields = by_blanks or line.split(delimiter)
        placed = options.placed or options.columns
        by_place = placed_names(placed, len(fields), where) if are_numbers(fields) else None
        if by_place:
            mapped = tuple(item for item in placed or () if "=" in item)
            roles = find_roles(by_place, replace(options, columns=mapped or None), where)
            return by_place, roles, delimiter, number, match.start()
        names: list[str] = []
        try:
            names = [name.strip() for name in by_blanks or next(split_rows([line], delimiter))]
            roles = find_roles(names, options, where, wide=wide)
        except (InputError, csv.Error) as caught:
            error: Exception = caught
            # If the line may be a header, the error names its columns; else it describes the line.
            if are_numbers(fields) and not foreign(line):
                rows = split_rows(lines_of(text, match.start()), delimiter)
                order = _likely_order(itertools.islice(rows, ROWS_OF_BLOCK), options.decimal)
                error = InputError(without_header(fields, options.option, where, order))
            error = _as_formats_have_it(error, delimiter, len(fields))
            why = foreign(line) or f"{error}; it must be the header, id,t,x,y"  # an error of csv
            is_named = isinstance(error, InputError) and not foreign(line)
            mistake = InputError(f"{where}: {why}")
            if isinstance(error, InputError):
                mistake = error if is_named else mistake
                row = _fields(after, delimiter)
                if len(row) == len(names) > 1 and any(map(is_number, row)):
                    raise faults.get(len(names), error) from None  # this line is the header
            is_comment = line.lstrip().startswith(COMMENTS)
            faults.setdefault(-1 if is_comment else len(names), mistake)
            comments, skipped = comments + is_comment, skipped + (not is_comment)
            if skipped > LINES_ASIDE:
                break
            continue
        passed = list(roles.passed)
        if comments or skipped:
            what = "" if skipped else " of comments"
            above = counted(comments + skipped, "line")
            passed.append(f"{above}{what} above the header passed over")
        below = 0  # wide tables have no lines of units
        if not wide:
            below, begin = _lines_of_units(text, start, len(names), delimiter, roles)
            stated = {
                k: unit
                for line in itertools.islice(lines_of(text, start), below)
                for k, field in enumerate(_fields(line, delimiter))
                if (unit := unit_of(f"in {field}"))
            }
            roles, start = replace(roles, stated=stated), begin
        if below:
            lines = counted(below, "line")
            passed.append(f"{lines} of units or names below the header passed over")
        roles = replace(roles, passed=tuple(passed))
        return names, roles, delimiter, number + 1 + below, start
    blank = InputError(f"{path}: blank lines only; a set without objects is a header alone")
    of_comments = faults.pop(-1, blank)
    raise next(iter(faults.values()), of_comments)


def _as_formats_have_it(error: Exception, delimiter: str, width: int) -> Exception:
    """Return the error; if it proposes to name a format, correct this proposal.

    If files of the format cannot have this delimiter, the new proposal says to separate fields by
    blanks.
    """
    if delimiter != ";" and not (delimiter == "," and width in KITTI_WIDTHS):
        return error
    way = "or separate the fields by blanks and name the"
    return type(error)(str(error).replace("or name the", way))


def _likely_order(rows: Iterable[list[str]], decimal: str) -> str:
    """Return the likely order of the columns id, t, x, y, by distances of consecutive rows."""
    with suppress(ValueError, csv.Error):  # rows with mistakes: the usual order
        kept = [[float(field.replace(decimal, ".")) for field in row[:4]] for row in rows if row]
        first, second, *places = np.array(kept).T
        of_ids, of_steps = spacings(first, second, np.array(places).T)
        return "t,id,x,y" if of_ids > of_steps else "id,t,x,y"
    return "id,t,x,y"


def _lines_of_units(
    text: str, start: int, width: int, delimiter: str, roles: Roles
) -> tuple[int, int]:
    """Return the number of lines of units below the header, and the position of the first row.

    If no row follows these lines, they are taken for rows with mistakes, and the number is 0.
    """
    state = {column for mix in roles.state for column, _ in mix}
    count, begin = 0, start
    for line in itertools.islice(lines_of(text, start), LINES_ASIDE + 1):
        fields = [field.strip() for field in _fields(line, delimiter)]
        if len(fields) != width:
            break
        filled = {k for k in {roles.time, *state} if fields[k].strip("-–()[] ") not in MISSING}
        if not filled & state or not all(WORD.fullmatch(fields[k]) for k in filled):
            return (count, begin) if filled else (0, start)
        count, begin = count + 1, begin + len(line)
    return 0, start


def _fields(line: str, delimiter: str) -> list[str]:
    """Split a line into its fields; return an empty list if its quotes are wrong."""
    with suppress(csv.Error):
        return next(split_rows([line], delimiter), [])
    return []


def _delimiter(header: str, decimal: str) -> str:
    """Return the most frequent delimiter in a header, outside of quotes.

    The decimal mark is the delimiter only if the header has no other.
    """
    plain = _unquoted(header)
    return max(
        DELIMITERS,
        key=lambda mark: (mark != decimal, plain.count(mark)) if plain.count(mark) else (False, 0),
    )


def header_by_blanks(line: str, after: str) -> list[str]:
    """Return the headers in a line that separates them by blanks; an empty list for other lines.

    numpy.savetxt and programs of robotics write such lines, sometimes with a comment mark first. If
    a line has this mark, the next line, `after`, decides. If `after` is blank or has as many words,
    the line is a header, and its mark is removed. If not, the line is a comment, and the list is
    empty.
    """
    line = line.strip()
    if any(mark in _unquoted(line) for mark in ",;\t|"):
        return []
    mark = next((mark for mark in COMMENTS if line.startswith(mark)), "")
    words = _split_at_blanks(line.removeprefix(mark))
    fits = not mark or not after.strip() or len(after.split()) == len(words)
    return words if len(words) >= FEWEST and fits else []


def _split_at_blanks(line: str) -> list[str]:
    """Split a line at blanks; if its first word is a comment mark, the whole line is one field."""
    fields = [within or plain for within, plain in FIELDS_BY_BLANKS.findall(line)]
    return [line] if fields and fields[0] in COMMENTS else fields


def _unquoted(line: str) -> str:
    """Return a line without the parts in quotes."""
    return re.sub(r'"[^"]*"', "", line) if '"' in line else line


def split_rows(each: Iterable[str], delimiter: str) -> Iterator[list[str]]:
    """Split lines into fields; fields in quotes may have line ends if the delimiter is no blank."""
    if delimiter == BLANKS:
        return map(_split_at_blanks, each)
    return csv.reader(each, delimiter=delimiter, strict=True, skipinitialspace=True)


def with_decimal(text: str, delimiter: str, roles: Roles, requested: str) -> tuple[Roles, str]:
    """Return the roles, and the decimal mark of the numbers in the first rows.

    Decimal marks are the point and the comma. The mark that was not requested is returned in one
    case, with a notice in the roles: no number has the requested mark, and at least one number has
    the other mark for certain. 1,250 is not certain, as its comma may separate thousands.
    """
    columns = {roles.time, *roles.numbers} - {roles.weight}  # a weight may be no number
    other = {".": ",", ",": "."}[requested]
    if other == delimiter or other not in text:
        return roles, requested
    rows = split_rows(itertools.islice(lines_of(text), ROWS_OF_BLOCK), delimiter)
    scores = {k for k, name in enumerate(roles.headers) if FLAG.fullmatch(name)}
    grouped, certain, elsewhere = "", False, False
    with suppress(csv.Error):  # reported when rows are read
        for row in rows:
            for k, field in enumerate(map(str.strip, row)):
                if re.fullmatch(DECIMAL, field):
                    is_clear = not re.fullmatch(GROUPED_NUMBER, field)
                    if k not in columns:
                        elsewhere |= k in scores and is_clear and other in field
                    elif requested in field and is_clear:
                        return roles, requested
                    elif requested in field:
                        grouped = field
                    else:
                        certain |= is_clear
    if grouped and (elsewhere or certain):
        mark = "comma" if other == "," else "point"
        text = f"{quoted(grouped)} may have a thousands mark: other numbers have a decimal {mark}"
        doubt = Notice(code="thousands", text=text, remedy="write numbers without thousands marks")
        return replace(roles, doubts=(*roles.doubts, doubt)), requested
    if grouped or not certain:
        return roles, requested
    notice = f"read with a decimal {'comma' if other == ',' else 'point'}, as its numbers have it"
    return replace(roles, passed=(*roles.passed, notice)), other


# -------------------------------------------------------------------------------------------------
# Formats without a header.

Layouts = Mapping[int, tuple[str, ...]]
"""Names of the columns by the number of fields; the first item is also used for an empty file."""

MOT_FIELDS = ("frame", "id", *BOX, "conf", "class", "visibility")
MOT_LAYOUTS = {width: MOT_FIELDS[:width] for width in (9, 6, 7, 8)}
MOT_LAYOUTS[10] = (*MOT_FIELDS[:7], "loc_x", "loc_y", "loc_z")
MOT_RULE = "MOTChallenge text has 6 to 10: frame,id,left,top,width,height,conf,..."
MOT_UNKNOWN = -1.0
"""Value of each coordinate of an unknown position in space."""

VISDRONE_FIELDS = ("frame", "id", *BOX, "score", "class", "truncation", "occlusion")
VISDRONE_RULE = f"VisDrone tracks have 10: {','.join(VISDRONE_FIELDS)}"
CATEGORIES = (
    *("ignored regions", "pedestrian", "people", "bicycle", "car", "van", "truck"),
    *("tricycle", "awning-tricycle", "bus", "motor", "others"),
)
"""Names of the classes 0 to 11 of VisDrone."""
IGNORED, *NOT_EVALUATED = AS_REGIONS
"""Types of KITTI and classes of VisDrone that are not tracked."""
UNCLASSED = "-1"
"""Number that trackers without classes write in the column of the class."""

KITTI_FIELDS = (
    *("frame", "id", "class", "truncated", "occluded", "alpha"),
    *("left", "top", "right", "bottom"),
    *("size_height", "size_width", "size_length"),
    *("loc_x", "loc_y", "loc_z", "rotation_y", "score"),
)
KITTI_RULE = (
    "KITTI tracking labels have 17, or 18 with a score: frame track_id type truncated occluded "
    "alpha left top right bottom ..."
)
KITTI_WIDTHS = (17, 18)
KITTI_UNKNOWN = -1000.0


def read_motchallenge(
    path: str, data: bytes, options: ReadOptions, role: str, *, given: bool
) -> Rows:
    """Read the rows of a MOTChallenge file.

    Raises
    ------
    InputError
        The content is wrong (see `formats.read`).
    """
    flagged = ("conf",) if role == "truth" else ()
    rows, texts = _read(path, data, options, MOT_LAYOUTS, MOT_RULE, flagged, given=given)
    _refuse_detections(rows)
    _leave_out_unknown(rows, MOT_UNKNOWN)
    if rows.classes is not None and list(rows.classes[0]) == ["-1"] and "class" in options.shared:
        # Some trackers write -1 as the class of all rows.
        missing = {**rows.roles.missing, "class": f"{path}: every class is -1, not known"}
        rows = replace(rows, classes=None, roles=replace(rows.roles, missing=missing))
    _leave_out_flagged(rows, texts, "conf", "0 in column 7")
    return rows


def read_visdrone(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """Read the rows of a VisDrone file.

    Raises
    ------
    InputError
        The content is wrong (see `formats.read`), or a class is not one of VisDrone.
    """
    texts_of = ("class", "score") if role == "truth" else ("class",)
    layouts = {len(VISDRONE_FIELDS): VISDRONE_FIELDS}
    rows, texts = _read(path, data, options, layouts, VISDRONE_RULE, texts_of, given=given)
    _refuse_detections(rows)
    category = _category(texts["class"], rows)
    for name in NOT_EVALUATED:
        there = np.array([text == name for text in category.distinct], bool)
        if there.any():
            number = CATEGORIES.index(name)
            rows.excluded[name] = there[category.code], f"left out: {name}, class {number}"
    _leave_out_flagged(rows, texts, "score", "score 0")
    attributes, column = dict(rows.attributes), VISDRONE_FIELDS.index("class")
    if column in attributes:
        attributes[column] = attribute_of(category)
    classes = None if rows.classes is None else numbered(category)
    return replace(rows, classes=classes, attributes=attributes)


def read_kitti(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a KITTI file; `role` has no effect.

    Raises
    ------
    InputError
        The content is wrong (see `formats.read`).
    """
    layouts = {width: KITTI_FIELDS[:width] for width in KITTI_WIDTHS}
    rows, texts = _read(
        path, data, options, layouts, KITTI_RULE, ("class",), given=given, commas=False
    )
    kind = texts["class"]
    ignored = np.array([text == IGNORED for text in kind.distinct], bool)
    rows.excluded[IGNORED] = ignored[kind.code], f"of type {IGNORED} left out"
    _leave_out_unknown(rows, KITTI_UNKNOWN)
    return rows


def _read(
    path: str,
    data: bytes,
    options: ReadOptions,
    layouts: Layouts,
    rule: str,
    texts: tuple[str, ...],
    *,
    given: bool,
    commas: bool = True,
) -> tuple[Rows, dict[str, Coded]]:
    """Return the rows of a file without a header, and the texts of some columns by their names.

    Parameters
    ----------
    options : ReadOptions
        Options of reading; the decimal mark is always a point.
    layouts
        Names of the columns by the number of fields.
    rule
        End of the message about a row with another number of fields.
    texts : tuple of str
        Names of the columns to return as texts, if the file has them.
    given : bool
        Whether the user named the format. If so, a file without content is a set without objects.
        Such a set cannot be written in any other way, as there is no header.
    commas : bool
        Whether fields can be separated by commas instead of blanks.

    Raises
    ------
    InputError
        The text is wrong.
    """
    check_text_memory(path, data, options.max_input)
    blank = given and not data.strip()
    if not blank:
        check_text(data, path)
    text, whole = ("", True) if blank else beginning(data, path)
    first, line = _first_line(text)
    if not line and not whole:
        text, whole = decode(data, path), True
        first, line = _first_line(text)
    if not line and not given:
        raise InputError(f"{path}: blank lines only; name the format if the set is empty")
    split = split_line if commas else str.split
    place = f"{path}, line {first}"
    count = len(split(line)) if line else next(iter(layouts))
    if count not in layouts:
        marks = f"; separate the fields by {'commas or ' * commas}blanks" * (count == 1)
        raise InputError(f"{place}: {counted(count, 'field')}; {rule}{marks}")
    names = layouts[count]
    roles = replace(find_roles(names, options, place, fixed=True), unused=())
    wanted = {name: names.index(name) for name in texts if name in names}
    fields = None
    delimiter = "," if commas and "," in line else " "
    if first == 1 and data.isascii() and not (commas and delimiter == " " and b"," in data):
        columns = tuple(wanted.values())
        fields = scanned(data, 1, len(names), delimiter, roles, texts=columns, quotes=False)
    if fields is None:
        lines = lines_of(text if whole else decode(data, path))
        rule = f"line {first} has {len(names)}; give every row the same number"
        comments = Comments()

        def split_all(several: Iterable[str]) -> Iterator[list[str]]:
            for each in several:
                yield [each] if each.lstrip().startswith(COMMENTS) else split(each)

        blocks = blocks_of(lines, split_all, len(names), 1, path, rule, comments)
        fields = gather(blocks, roles, ".", tuple(wanted.values()))
        roles = comments.noted(roles)
    rows = convert(fields, roles, ".", path, names, plain_id)
    return rows, {name: fields.coded[column] for name, column in wanted.items()}


def _first_line(text: str) -> tuple[int, str]:
    """Return the number of the first line with content that is not a comment, and the line."""
    for number, line in enumerate(lines_of(text), start=1):
        if line.strip() and not line.lstrip().startswith(COMMENTS):
            return number, line
    return 1, ""


def _refuse_detections(rows: Rows) -> None:
    """Check that not all rows have the id -1, as in files of detections.

    Raises
    ------
    InputError
        The id of all rows is -1.
    """
    if list(rows.ids[0]) == ["-1"]:
        raise InputError(
            f"{rows.where(0)}: every id is -1: these are detections; TGOSPA compares tracks"
        )


def _leave_out_flagged(rows: Rows, texts: Mapping[str, Coded], name: str, flag: str) -> None:
    """Exclude the rows with the number 0 in column `name`.

    `texts` has the texts of columns, by name. If it lacks the column `name`, no row is excluded.
    `flag` is the reason in the message.
    """
    if name not in texts:
        return
    column = texts[name]
    values, wrong = numbers([text.strip() for text in column.distinct], ".")
    if wrong:
        _, wrong = numbers([text.strip() for text in column], ".")  # row by row
        row, message = wrong[0]
        raise InputError(f"{rows.where(row)}, column {quoted(name)}: {message}")
    mask = values[column.code] == 0
    rows.excluded[NOT_CONSIDERED] = mask, f"left out: {flag}, not to be considered"


def _leave_out_unknown(rows: Rows, unknown: float) -> None:
    """Exclude the rows whose position in space is unknown, if the states are positions in space.

    In such a row, all coordinates are `unknown`.

    Raises
    ------
    InputError
        All positions are unknown.
    """
    place = [
        k
        for k, mix in enumerate(rows.roles.state)
        if len(mix) == 1 and rows.roles.headers[mix[0][0]].startswith("loc_")
    ]
    if not place:
        return
    state = rows.roles.mixed(rows.numbers, rows.roles.state)[:, place]
    mask = np.asarray((state == unknown).all(axis=1), bool)
    if len(mask) and mask.all():
        raise InputError(
            f"{rows.name}: no row has a place in space, all are {unknown:g}; leave "
            f"{option('columns')} out to compare the centres of boxes, or use "
            f"{option('distance', 'iou')} to compare boxes"
        )
    rows.excluded["no place"] = mask, f"without a place in space ({unknown:g}): absent at that step"


def _category(texts: Coded, rows: Rows) -> Coded:
    """Convert numbers of classes of VisDrone to names; the name is blank for -1.

    Raises
    ------
    InputError
        A number is not a class.
    """
    known = {str(number): name for number, name in enumerate(CATEGORIES)} | {UNCLASSED: ""}
    names = [known.get(plain_id(text)) for text in texts.distinct]
    wrong = np.array([name is None for name in names], bool)
    if wrong.any():
        at = np.flatnonzero(wrong[texts.code])
        row = int(at[0])
        raise InputError(
            f'{rows.where(row)}, column "class": {quoted(texts[row].strip())} is not a class of '
            f"VisDrone{more(len(at))}; these are 0 to {len(CATEGORIES) - 1}, or -1 for none"
        )
    return Coded([name or "" for name in names], texts.code)
