"""Tables of text, one row per object and step: CSV, MOTChallenge, VisDrone and KITTI.

CSV is ``id,t,x[,y[,z]]`` and other columns, with a header. It is parsed here and not by pandas, for
exact floats, exact integers, messages that name the line, and a start without importing pandas.
What the compiled loop leaves is split here: text without quotes in one call a piece, after the
delimiters of every line were counted; the rest by the csv module.

The others have no header: the names of the columns follow from their number.

MOTChallenge: ``frame,id,left,top,width,height[,conf[,...]]``. Column 7 is a flag in truth, 0 for
what is not to be considered, and a score in results. What follows depends on the number of fields:
class and visibility (8 or 9), or a place in space (10).

VisDrone: ``frame,id,left,top,width,height,score,class,truncation,occlusion``. In truth the score is
a flag, 0 for what is not to be considered; in results truncation and occlusion are -1. Classes are
numbers, read by their names.

KITTI: 17 fields separated by blanks, 18 with a score. The image box is given by its edges; sizes
and places in space are in metres, in the coordinates of the camera. Truth and results are read
alike.
"""

import csv
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import BOX, Roles, find_roles
from tgospa_eval.formats.fields import Coded, attribute_of, is_number
from tgospa_eval.formats.guess import COMMENTS, foreign
from tgospa_eval.formats.guess import split as split_line
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, numbered
from tgospa_eval.formats.text.scan import (
    Block,
    beginning,
    check_text,
    chunks,
    convert,
    decode,
    gather,
    numbers,
    plain_id,
    scanned,
    with_comments,
)
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Ints

DELIMITERS = ",;\t"

DECIMAL = r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?"
GROUPED_NUMBER = r"[+-]?[1-9]\d{0,2}[.,]\d{3}"
"""Numbers whose mark may be one between thousands."""

BLANKS = " "
"""Delimiter of tables whose columns are separated by any number of blanks."""

ROWS_OF_BLOCK = 1 << 13
"""Rows of a block from the csv module."""

QUOTED_OR_BLANKS = re.compile(r'"[^"\n]*"|[ \t]+')
QUOTED_OR_ODD = re.compile(r'["\x0b\x0c\x1c-\x1f]')
OUTER_BLANKS = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
COMMENT = re.compile(rf"^[ \t]*(?:{'|'.join(map(re.escape, COMMENTS))})(?:[ \t].*)?$", re.MULTILINE)
"""A line of a table by blanks that is a comment: no id is a mark alone."""

FEWEST = 3
"""Columns of a table by blanks: id, t and x."""


def read_table(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a CSV file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    check_text(data, path)
    text, whole = beginning(data, path)
    names, roles, delimiter, first, start = header_of(text, path, options)
    roles, decimal = with_decimal(text[start:], delimiter, roles, options.decimal)
    name_id = plain_id if delimiter == BLANKS else str.strip  # numpy.savetxt writes 1.000e+00
    fields = scanned(data, first, len(names), delimiter, roles, decimal)
    if fields is None:
        text = text if whole else decode(data, path)
        if delimiter == BLANKS:
            tabs, comments = rows_by_tabs(text[start:])
            text, delimiter = text[:start] + tabs, "\t"
            roles = with_comments(roles, comments)
        rule = "the header has {}; give every row one field per column"
        marked = any(mark in text for mark in COMMENTS)
        odd = _Oddities(path, len(names), rule, marked=marked)
        fields = gather(tokenise(text, start, delimiter, first, odd), roles, decimal)
        roles = odd.settled(roles)
    return convert(fields, roles, decimal, path, names, name_id)


def header_of(text: str, path: str, options: ReadOptions) -> tuple[list[str], Roles, str, int, int]:
    """The headers, what they are, the delimiter, number and begin of the line after them.

    It is the first line with content that is no comment; one that begins like a comment is the
    header if it is understood as one.
    """
    fault, passed = None, 0
    for number, found in enumerate(re.finditer(r".*\n?", text), start=1):
        given = line = found[0].removesuffix("\n")
        start = found.end()
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        delimiter = _delimiter(line, options.decimal)
        stop = text.find("\n", start)
        after = text[start : stop if stop >= 0 else None].replace('"', "")
        spaced = header_by_blanks(line, after)
        if spaced is not None:
            line, delimiter = spaced, "\t"
        sample = after.split(None if spaced else delimiter)
        try:
            reader = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
            names = [name.strip() for name in next(reader)]
            roles = find_roles(names, options, where)
        except (InputError, csv.Error) as error:
            fault = fault or _explained(error, given, where)
            if not given.lstrip().startswith(COMMENTS):
                raise _explained(error, given, where) from None
            if spaced and all(map(is_number, sample)) and isinstance(error, InputError) and sample:
                raise  # numbers below it: no other line is the header
            passed += 1
            continue
        if passed:
            notice = f"{counted(passed, 'line')} of comments above the header passed over"
            roles = replace(roles, passed=(*roles.passed, notice))
        return names, roles, BLANKS if spaced else delimiter, number + 1, start
    blank = InputError(f"{path}: blank lines only; a set without objects is a header alone")
    raise fault or blank


def _explained(error: InputError | csv.Error, line: str, where: str) -> InputError:
    """Why a line is no header, by what it looks like if it is not one with other names."""
    other = foreign(line)
    if other:
        return InputError(f"{where}: {other}")
    if isinstance(error, InputError):
        return error
    return InputError(f"{where}: {error}; it must be the header, id,t,x,y")  # a field too long


def _delimiter(header: str, decimal: str) -> str:
    """The most frequent delimiter outside quotes; the decimal mark only if there is no other."""
    plain = _unquoted(header)
    return max(
        DELIMITERS,
        key=lambda mark: (mark != decimal, plain.count(mark)) if plain.count(mark) else (False, 0),
    )


def header_by_blanks(line: str, after: str) -> str | None:
    """A line without any other delimiter with tabs in place of blanks; None where it has another.

    So numpy.savetxt writes tables, and the trajectories of robotics. A comment mark in front is
    left out if the line after has as many words: else it is a comment.
    """
    line = line.strip()
    if any(mark in _unquoted(line) for mark in ",;\t|"):
        return None
    mark = next((mark for mark in COMMENTS if line.startswith(mark)), "")
    words = _tabbed(line.removeprefix(mark).strip())
    count = words.count("\t") + 1
    fits = not mark or not after.strip() or len(after.split()) == count
    return words if count >= FEWEST and fits else None


def rows_by_tabs(text: str) -> tuple[str, int]:
    """The rows with tabs in place of blanks, comments as blank lines, and their number."""
    text, comments = COMMENT.subn("", text)
    if text.isascii() and not QUOTED_OR_ODD.search(text):  # ten times as fast
        return "\n".join(map("\t".join, map(str.split, text.split("\n")))), comments
    return _tabbed(OUTER_BLANKS.sub("", text)), comments


def _tabbed(text: str) -> str:
    return QUOTED_OR_BLANKS.sub(lambda found: found[0] if found[0][0] == '"' else "\t", text)


def _unquoted(line: str) -> str:
    """A line without what is in quotes."""
    return re.sub(r'"[^"]*"', "", line) if '"' in line else line


def with_decimal(text: str, delimiter: str, roles: Roles, asked: str) -> tuple[Roles, str]:
    """The decimal mark of the first rows, with a notice in the roles if another one was asked for.

    It is another one only if no number has the one asked for and some have that for certain: 1,250
    and 1.250 may have a mark between thousands.
    """
    columns = {roles.time, *roles.numbers} - {roles.weight}  # weights may be something else
    other = {".": ",", ",": "."}[asked]
    if other == delimiter or other not in text:
        return roles, asked
    lines: Iterable[str] = itertools.islice(io.StringIO(text), ROWS_OF_BLOCK)
    if delimiter == BLANKS:
        lines, delimiter = rows_by_tabs("".join(lines))[0].split("\n"), "\t"
    certain = False
    with suppress(csv.Error):  # an error when all rows are read
        for row in csv.reader(lines, delimiter=delimiter, skipinitialspace=True):
            for field in (row[k].strip() for k in columns if k < len(row)):
                if re.fullmatch(DECIMAL, field):
                    if asked in field:
                        return roles, asked
                    certain |= not re.fullmatch(GROUPED_NUMBER, field)
    if not certain:
        return roles, asked
    notice = f"read with a decimal {'comma' if other == ',' else 'point'}, as its numbers have it"
    return replace(roles, passed=(*roles.passed, notice)), other


class _Oddities:
    """Lines of other lengths, and rows that begin like comments.

    A line that begins like a comment may be a row as well, for an id may begin so: where all do.

    Parameters
    ----------
    path : str
        The file, for messages.
    width : int
        Number of columns.
    rule : str
        What is said of lines of other lengths, with a place for how many more there are.
    marked : bool
        Whether there are marks of comments in the file.
    """

    def __init__(self, path: str, width: int, rule: str, *, marked: bool) -> None:
        self.path, self.width, self.rule, self.is_marked = path, width, rule, marked
        self.wrong: list[tuple[int, int]] = []
        self.comments: list[tuple[int, int]] = []
        self.marked: int | None = None
        self.all_marked = True

    def add(self, line: int, fields: list[str]) -> None:
        """A line of another length."""
        is_comment = "".join(fields[:1]).lstrip().startswith(COMMENTS)
        (self.comments if is_comment else self.wrong).append((line, len(fields)))

    def watched(self, lines: Ints, columns: Sequence[Sequence[str]]) -> Block:
        """The same rows; which of them begin like comments is noted."""
        if self.is_marked:
            begins = [text.lstrip(" \t").startswith(COMMENTS) for text in columns[0]]
            if self.marked is None and any(begins):
                self.marked = int(lines[begins.index(True)])
            self.all_marked = self.all_marked and all(begins)
        return lines, columns

    def settled(self, roles: Roles) -> Roles:
        """The roles with a notice about comments, when all rows are read.

        Raises
        ------
        InputError
            A row has the wrong length; or it may be a comment as well as a row.
        """
        wrong = self.wrong
        if self.marked is not None and self.all_marked:  # ids begin so
            wrong = sorted([*wrong, *self.comments])
        if wrong:
            line, found = wrong[0]
            raise InputError(
                f"{self.path}, line {line}: {counted(found, 'field')}, "
                f"{self.rule.format(f'{self.width}{more(len(wrong))}')}"
            )
        if self.marked is None:
            return with_comments(roles, len(self.comments))
        if not self.all_marked:
            raise InputError(
                f"{self.path}, line {self.marked}: a comment, not a row, or an id that begins like "
                "one; delete such lines (ids may begin like comments if all do)"
            )
        return roles


def tokenise(
    text: str, start: int, delimiter: str, first_line: int, odd: _Oddities
) -> Iterator[Block]:
    """The rows of the table from letter `start` on; lines that are none are told to `odd`."""
    if text.find('"', start) >= 0:
        rows = _rows_of_csv(chunks(text, start), delimiter, first_line, odd.path)
        yield from _in_blocks(rows, odd)
        return
    line, width = first_line, odd.width
    others = bytes(set(range(256)) - {ord(delimiter), ord("\n")})
    for chunk in chunks(text, start):
        count = chunk.count("\n") + 1
        marks = chunk.encode().translate(None, others) + b"\n"
        if width > 1 and marks == (delimiter.encode() * (width - 1) + b"\n") * count:
            fields = chunk.replace("\n", delimiter).split(delimiter)
            columns = [fields[k::width] for k in range(width)]
            yield odd.watched(np.arange(line, line + count), columns)
        else:
            yield from _in_blocks(_rows_of_csv([chunk], delimiter, line, odd.path), odd)
        line += count


def _in_blocks(rows: Iterable[tuple[int, list[str]]], odd: _Oddities) -> Iterator[Block]:
    """Lines with their fields in blocks; those of other lengths are told to `odd`."""
    lines: list[int] = []
    kept: list[list[str]] = []
    for line, fields in rows:
        if len(fields) != odd.width:
            odd.add(line, fields)
            continue
        lines.append(line)
        kept.append(fields)
        if len(kept) == ROWS_OF_BLOCK:
            yield odd.watched(np.array(lines), list(zip(*kept, strict=True)))
            lines, kept = [], []
    if kept:
        yield odd.watched(np.array(lines), list(zip(*kept, strict=True)))


def _rows_of_csv(
    parts: Iterable[str], delimiter: str, first_line: int, path: str
) -> Iterator[tuple[int, list[str]]]:
    """Line and fields of each row, quotes and blank lines through the csv module."""
    begin = first_line
    reader = csv.reader(_lines(parts), delimiter=delimiter, strict=True, skipinitialspace=True)
    try:
        for row in reader:
            if row and (len(row) > 1 or row[0].strip()):
                yield begin, row
            begin = first_line + reader.line_num
    except csv.Error as error:
        raise InputError(
            f"{path}, line {begin}: {error}; close quotes, and double those inside a field"
        ) from None


def _lines(parts: Iterable[str]) -> Iterator[str]:
    """The lines of the parts, with their ends; no others than line feeds are left."""
    for part in parts:
        yield from io.StringIO(part + "\n", newline="\n")


# -------------------------------------------------------------------------------------------------
# Formats without a header.

Layouts = Mapping[int, tuple[str, ...]]
"""Names of the columns by the number of fields, first those that an empty file does not have."""

MOT_FIELDS = ("frame", "id", *BOX, "conf", "class", "visibility")
MOT_LAYOUTS = {width: MOT_FIELDS[:width] for width in (7, 6, 8, 9)}
MOT_LAYOUTS[10] = (*MOT_FIELDS[:7], "loc_x", "loc_y", "loc_z")
MOT_RULE = "MOTChallenge text has 6 to 10: frame,id,left,top,width,height,conf,..."
MOT_UNKNOWN = -1.0
"""Each coordinate of a place in space that is not known."""

VISDRONE_FIELDS = ("frame", "id", *BOX, "score", "class", "truncation", "occlusion")
VISDRONE_RULE = f"VisDrone tracks have 10: {','.join(VISDRONE_FIELDS)}"
CATEGORIES = (
    *("ignored regions", "pedestrian", "people", "bicycle", "car", "van", "truck"),
    *("tricycle", "awning-tricycle", "bus", "motor", "others"),
)
"""Names of the classes 0 to 11."""
NOT_EVALUATED = ("ignored regions", "others")
"""Classes that are no objects to be tracked."""
UNCLASSED = "-1"
"""Class of trackers that tell none apart."""

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
KITTI_UNKNOWN = -1000.0
IGNORED = "DontCare"


def read_motchallenge(
    path: str, data: bytes, options: ReadOptions, role: str, *, given: bool
) -> Rows:
    """The rows of a MOTChallenge file.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    flagged = ("conf",) if role == "truth" else ()
    rows, texts = _read(path, data, options, MOT_LAYOUTS, MOT_RULE, flagged, given=given)
    _refuse_detections(rows)
    _leave_out_unknown(rows, MOT_UNKNOWN)
    if rows.classes is not None and list(rows.classes[0]) == ["-1"] and "class" in options.shared:
        # Results of some trackers fill the columns with -1.
        missing = {**rows.roles.missing, "class": f"{path}: every class is -1, not known"}
        rows = replace(rows, classes=None, roles=replace(rows.roles, missing=missing))
    _leave_out_flagged(rows, texts, "conf", "0 in column 7")
    return rows


def read_visdrone(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """The rows of a VisDrone file.

    Raises
    ------
    InputError
        See `formats.read`; or a class is none of VisDrone.
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
            rows.apart[name] = there[category.code], f"left out: {name}, class {number}"
    _leave_out_flagged(rows, texts, "score", "score 0")
    attributes, column = dict(rows.attributes), VISDRONE_FIELDS.index("class")
    if column in attributes:
        attributes[column] = attribute_of(category)
    classes = None if rows.classes is None else numbered(category)
    return replace(rows, classes=classes, attributes=attributes)


def read_kitti(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a KITTI file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    layouts = {width: KITTI_FIELDS[:width] for width in (17, 18)}
    rows, texts = _read(
        path, data, options, layouts, KITTI_RULE, ("class",), given=given, commas=False
    )
    kind = texts["class"]
    ignored = np.array([text == IGNORED for text in kind.distinct], bool)
    rows.apart[IGNORED] = ignored[kind.code], f"of type {IGNORED} left out"
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
    """The rows, and some columns as texts by name.

    Parameters
    ----------
    path, data
        The file.
    options : ReadOptions
        Decimal marks are points whatever the options are.
    layouts, rule
        Names of the columns, and what is said where the number of fields is none of these.
    texts : tuple of str
        Names of the columns to be returned as texts, as far as they are there.
    given : bool
        Whether the user named the format: then a file without content is an empty set. There is
        no other way to write one without a header.
    commas : bool
        Whether fields may be separated by commas instead of blanks.

    Raises
    ------
    InputError
        The text is wrong.
    """
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
        raise InputError(f"{place}: {counted(count, 'field')}; {rule}")
    names = layouts[count]
    roles = replace(find_roles(names, options, place, fixed=True), unused=())
    wanted = {name: names.index(name) for name in texts if name in names}
    fields = None
    delimiter = "," if commas and "," in line else " "
    if first == 1 and data.isascii() and not (commas and delimiter == " " and b"," in data):
        columns = tuple(wanted.values())
        fields = scanned(data, 1, len(names), delimiter, roles, texts=columns, quotes=False)
    if fields is None:
        lines = _lines(chunks(text if whole else decode(data, path)))
        each = (
            (number, [line] if line.lstrip().startswith(COMMENTS) else split(line))
            for number, line in enumerate(lines, start=1)
            if line.strip()
        )
        rule = f"line {first} has {{}}; give every row as many"
        odd = _Oddities(path, len(names), rule, marked=False)
        fields = gather(_in_blocks(each, odd), roles, ".", tuple(wanted.values()))
        roles = odd.settled(roles)
    rows = convert(fields, roles, ".", path, names, plain_id)
    return rows, {name: fields.coded[column] for name, column in wanted.items()}


def _first_line(text: str) -> tuple[int, str]:
    """The first line that is not blank, and its number."""
    for number, line in enumerate(_lines(chunks(text)), start=1):
        if line.strip() and not line.lstrip().startswith(COMMENTS):
            return number, line
    return 1, ""


def _refuse_detections(rows: Rows) -> None:
    """Refuse boxes of which none has an id.

    Raises
    ------
    InputError
        So it is.
    """
    if list(rows.ids[0]) == ["-1"]:
        raise InputError(
            f"{rows.where(0)}: every id is -1: these are detections; TGOSPA compares tracks"
        )


def _leave_out_flagged(rows: Rows, texts: Mapping[str, Coded], name: str, flag: str) -> None:
    """Set rows apart whose number in a column is 0, if it is among the texts."""
    if name not in texts:
        return
    column = texts[name]
    values, wrong = numbers([text.strip() for text in column.distinct], ".")
    if wrong:
        _, wrong = numbers([text.strip() for text in column], ".")  # with the row, and how many
        row, message = wrong[0]
        raise InputError(f"{rows.where(row)}, column {quoted(name)}: {message}")
    apart = values[column.code] == 0
    rows.apart["not considered"] = apart, f"left out: {flag}, not to be considered"


def _leave_out_unknown(rows: Rows, unknown: float) -> None:
    """Set rows apart whose place in space is not known, if the states are places.

    Raises
    ------
    InputError
        None is known.
    """
    place = [
        k
        for k, mix in enumerate(rows.roles.state)
        if len(mix) == 1 and rows.roles.headers[mix[0][0]].startswith("loc_")
    ]
    if not place:
        return
    state = rows.roles.mixed(rows.numbers, rows.roles.state)[:, place]
    apart = np.asarray((state == unknown).all(axis=1), bool)
    if len(apart) and apart.all():
        raise InputError(
            f"{rows.name}: no row has a place in space, all are {unknown:g}; without --columns the "
            "centres of the boxes are compared, with --distance iou the boxes"
        )
    rows.apart["no place"] = apart, f"without a place in space ({unknown:g}): absent at that step"


def _category(texts: Coded, rows: Rows) -> Coded:
    """The names of classes that are numbers; blank where no class is known.

    Raises
    ------
    InputError
        One is no class.
    """
    known = {str(number): name for number, name in enumerate(CATEGORIES)} | {UNCLASSED: ""}
    names = [known.get(plain_id(text)) for text in texts.distinct]
    wrong = np.array([name is None for name in names], bool)
    if wrong.any():
        at = np.flatnonzero(wrong[texts.code])
        row = int(at[0])
        raise InputError(
            f'{rows.where(row)}, column "class": {quoted(texts[row].strip())} is no class of '
            f"VisDrone{more(len(at))}; these are 0 to {len(CATEGORIES) - 1}, or -1 for none"
        )
    return Coded([name or "" for name in names], texts.code)
