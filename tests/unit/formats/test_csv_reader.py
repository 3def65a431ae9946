"""The CSV reader: what it takes, what it refuses, and in which words."""

import csv
import io
import math
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Write
from hypothesis import example, given
from hypothesis import strategies as st
from rows import PLAIN, SAME, refusal, rows_of

from tgospa_eval import InputError, Trajectories, read_trajectories
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.options import parse_where
from tgospa_eval.formats.text import lines


@pytest.fixture(autouse=True, scope="module", params=["compiled", "careful", "large"])
def route(request: pytest.FixtureRequest) -> Iterator[None]:
    """Everything three times: how a file is read must not show."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "careful":
            patch.setattr(lines, "scanner", None)
        if request.param == "large":
            patch.setattr(lines, "LARGE_BYTES", 0)
        yield


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file for all examples of a property."""
    return tmp_path_factory.mktemp("table") / "table.csv"


# --- one table in many spellings ------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(PLAIN, id="plain"),
        pytest.param(PLAIN.rstrip("\n"), id="no last line end"),
        pytest.param(b"\xef\xbb\xbf" + PLAIN.encode(), id="BOM"),
        pytest.param(PLAIN.replace("\n", "\r\n"), id="CRLF"),
        pytest.param(PLAIN.replace("\n", "\r"), id="CR"),
        pytest.param(PLAIN.replace(",", ";"), id="semicolons"),
        pytest.param(PLAIN.replace(",", "\t"), id="tabs"),
        pytest.param('"id","t","x","y"\n"a","1","1.5","2"\n"b","2","3","-4.25"\n', id="quotes"),
        pytest.param(b'\xef\xbb\xbf"id",t,x,y\r\na,1,1.5,2\r\n"b",2,3,-4.25', id="BOM and quotes"),
        pytest.param("id, t , x,y\n a ,1 , 1.5,2\nb, 2,3 ,-4.25 \n", id="spaces"),
        pytest.param(
            '"id", "t",  "x",y\n "a",1, "1.5",2\nb, "2",3,-4.25\n', id="quotes and spaces"
        ),
        pytest.param('"id", "t", "x", "y"\n' + PLAIN[9:], id="a header with quotes and spaces"),
        pytest.param("\n\n" + PLAIN.replace("\nb", "\n\n  \nb") + "\n\n", id="blank lines"),
        pytest.param(PLAIN.replace("\nb", "\n,,,\nb") + ",,,\n , ,,\n", id="blank rows"),
        pytest.param(PLAIN.replace(",", ";") + ";;;\n;;\n", id="blank rows, some short"),
        pytest.param("y,x,t,id\n2,1.5,1,a\n-4.25,3,2,b\n", id="columns in another order"),
        pytest.param("id,t,x,y\nb,2,3,-4.25\na,1,1.5,2\n", id="rows in another order"),
        pytest.param("id,t,x,y\na,1,15e-1,+2.\nb,2,3E0,-4.25\n", id="exponents"),
    ],
)
def test_spelling_does_not_matter(write: Write, content: str | bytes) -> None:
    trajectories = read_trajectories(write("a.csv", content))
    assert rows_of(trajectories) == SAME
    assert trajectories.columns == ("x", "y")
    assert trajectories.times.dtype == np.int64


def test_the_mark_of_thousands_of_a_large_file_is_none_of_decimals(
    write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where what is looked at first, 64 KiB, ends within a number as well: after ``1,2``."""
    start = f"id;t;x\n{'0' * 12}"
    rows = "".join(f"{k:06d};{k:06d};1,250\n" for k in range(5_000))
    text = start + rows
    monkeypatch.setattr(lines, "LARGE_BYTES", 1 << 16)
    assert len(text) > lines.LARGE_BYTES
    assert text[: 1 << 16].endswith(";1,2")
    assert "1,250" in refusal(write("a.csv", text))[0]


def test_decimal_comma(write: Write) -> None:
    path = write("a.csv", "id;t;x;y\na;1;1,5;2\nb;2;3;-4,25\n")
    assert rows_of(read_trajectories(path, decimal=",")) == SAME
    path = write("b.csv", "id;t;x\na;0,25;1\n")
    assert rows_of(read_trajectories(path, decimal=",")) == {("a", 0.25): (1.0,)}


@pytest.mark.parametrize(
    ("text", "asked", "said"),
    [
        ("id;t;x;y\na;1;1,5;2\nb;2;3;-4,25\n", ".", "comma"),
        ("id\tt\tx\ty\na\t1,0\t1,5\t2\nb\t2,0\t3\t-4,25\n", ".", "comma"),
        ("id,t,x,y\na,1,1.5,2\nb,2,3,-4.25\n", ",", "point"),
        ("id;t;x;y;name\na;1;1.5;2;7,5\nb;2;3;-4.25;7,5\n", ",", "point"),
    ],
)
def test_decimal_mark_of_the_numbers(write: Write, text: str, asked: str, said: str) -> None:
    reading = read(write("a.csv", text), ReadOptions(decimal=asked))
    assert rows_of(reading.trajectories) == SAME
    assert f"read with a decimal {said}, as its numbers have it" in reading.notices


@pytest.mark.parametrize(
    "text",
    ["id;t;x\na;1;1,250\n", "id;t;x\na;1;0.5\na;2;0,5\n", 'id,t,x\na,1,"0,5"\n'],
)
def test_decimal_marks_in_doubt(write: Write, text: str) -> None:
    assert 'decimal=","' in refusal(write("a.csv", text))[0]


@pytest.mark.parametrize(
    ("x", "doubtful"), [("1.234", True), ("1.23", False), ("0.234", False), ("1234", False)]
)
def test_thousands_marks_in_doubt(write: Write, x: str, doubtful: bool) -> None:
    path = write("a.csv", f"id;t;x;conf\na;1;{x};0,95\na;2;{x};0,5\n")
    assert ("thousands" in [one.code for one in read(path).warnings]) is doubtful
    tests = parse_where("conf >= 0.6", "estimate_where")
    with pytest.raises(InputError, match="write decimal points, or use decimal"):
        read(path, ReadOptions(where=tests))
    if x == "1234":
        assert read(path, ReadOptions(where=tests, decimal=",")).taken == 1


def test_pairs_in_an_unused_column_are_no_decimals(write: Write) -> None:
    assert not read(write("a.csv", "id;t;x;cell\na;1;1.250;3,4\na;2;2.375;3,5\n")).warnings


def test_a_comma_in_another_column_is_no_decimal_mark(write: Write) -> None:
    path = write("a.csv", "id;t;x;y;weight\na;1;15;2;0,5\nb;2;3;-4.25;0,5\n")
    assert rows_of(read_trajectories(path)) == {("a", 1): (15.0, 2.0), ("b", 2): (3.0, -4.25)}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# my tracker, v1\n\n# end\n", "line 1: a comment where the header should be"),
        ("# my tracker, v1\na,b,c\n", "line 2: no column for id, t, position"),
        ("id,t,x\na,1,2\n#b,1,2\n", "line 3: begins like a comment"),
        ("id,t,x\n // b,1,2\na,1,2\n", "line 2: begins like a comment"),
        ('id,t,x\na,1,2\n" %b",1,2\n', "line 3: begins like a comment"),
        ("| id | t | x |\n|---|---|---|\n", "line 1: columns separated by vertical bars"),
        (
            "0 1 2 3\n",
            "line 1: the numbers 0, 1, 2, 3 instead of a header",
        ),
        ("id t x\na 1\n", "line 2: 2 fields, the header has 3"),
        ("id t x\n#a 1 2\nb 1 2\n", "line 2: begins like a comment"),
        ("id|t|x\na|1|2\n", "line 1: columns separated by vertical bars"),
        ('[{"id": 0, "t": 0}, {"id": 1, "t": 0}]', "a.csv: no column for position"),
        ('{"id": 0, "t": 0, "x": 1}\n', "a.csv: JSON, not a table"),
        ('{"tracks": [' + "0, " * 50_000 + "0]}", "a.csv: no column for id, t, position"),
        ("<html>\n", "line 1: XML or HTML, not a table"),
    ],
)
def test_what_is_no_table(write: Write, text: str, said: str) -> None:
    assert said in refusal(write("a.csv", text))[0]


@pytest.mark.parametrize("above", ["", "# my tracker, v1\n", '% a\n\n// b, "c"\n'])
@pytest.mark.parametrize("header", ["# id,t,x", "id,t,x"])
def test_comments_above_the_header(write: Write, above: str, header: str) -> None:
    """They are passed over; a header may begin like one."""
    reading = read(write("a.csv", f"{above}{header}\na,1,2\n"))
    assert rows_of(reading.trajectories) == {("a", 1): (2.0,)}
    count = sum(map(bool, above.split("\n")))
    passed = f"{count} line{'s' * (count > 1)} of comments above the header passed over"
    assert [text for text in reading.notices if "comment" in text] == [passed] * bool(above)
    with pytest.raises(InputError, match=f"line {above.count(chr(10)) + 2}, column"):
        read(write("b.csv", f"{above}{header}\na,1,y\n"))


@pytest.mark.parametrize("size", [lines.LARGE_BYTES, 0])
def test_comments_between_rows(write: Write, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    monkeypatch.setattr(lines, "LARGE_BYTES", size)
    text = 'id,t,x\n# start\na,1,2\n\n  // the "second" part: 2, 3, 4, 5\n{}"b",1,3\n% end'
    reading = read(write("a.csv", text.format("")))
    assert rows_of(reading.trajectories) == {("a", 1): (2.0,), ("b", 1): (3.0,)}
    assert "3 lines of comments passed over" in reading.notices
    with pytest.raises(InputError, match="line 6: begins like a comment"):
        read(write("a.csv", text.format("#")))
    for name, row in (("motchallenge", "1,7,10,20,4,6,1"), ("kitti", KITTI)):
        for where in ("# a, b\n{}\n", "{}\n#1,7\n", "# 1 2 3 4 5 6\n\n{}\n% b\n"):
            reading = read(write("a.txt", where.format(row)))
            assert (reading.format, reading.rows) == (name, 1)
            assert any("of comments passed over" in text for text in reading.notices)


KITTI = "0 1 Car 0 0 -1.8 100 50 140 80 2.0 1.8 4.4 -4.5 1.5 13.5 -2.1"

TABLES_BY_BLANKS = (
    "# id t x y\n1.0e+00 0.0e+00 2.5e+00 1\n1.0 1.0 3.5 2\n",  # numpy.savetxt
    "id t x y\n1 0 2.5 1\n1 1 3.5 2\n",
    "  id   t   x   y \n\t1  0 2.5\t 1\n\n  1 1   3.5 2",
    '#t id "x" y\r\n0 "1" 2.5 1\r\n# a comment here now\r\n#\r\n1 1 3.5 2\r\n',
    "// ran on Monday at noon, twice\n# the second run\n\n% id t x y\n1 0 2.5 1\n1 1 3.5 2\n",
)


@pytest.mark.parametrize("size", [lines.LARGE_BYTES, 0])
@pytest.mark.parametrize("scanner", [lines.scanner, None])
@pytest.mark.parametrize("text", TABLES_BY_BLANKS)
def test_columns_separated_by_blanks(
    write: Write, monkeypatch: pytest.MonkeyPatch, text: str, scanner: object, size: int
) -> None:
    monkeypatch.setattr(lines, "LARGE_BYTES", size)
    monkeypatch.setattr(lines, "scanner", scanner)
    reading = read(write("a.txt", text))
    assert rows_of(reading.trajectories) == {("1", 0): (2.5, 1.0), ("1", 1): (3.5, 2.0)}
    assert reading.format == "csv"
    comma = text.replace("2.5", "2,5").replace("3.5", "3,5")
    if "," not in text and "e" not in text:
        found = read(write("a.txt", comma), ReadOptions(decimal=","))
        assert rows_of(found.trajectories) == rows_of(reading.trajectories)


def test_ids_of_tables_by_blanks(write: Write) -> None:
    text = 'id t x class\n007 0 1 "small car"\n#5 0 2 van\n'
    found = read(write("a.txt", text.replace("#", "")), ReadOptions(by_class=True))
    assert found.trajectories.ids.tolist() == ["5", "007"]
    assert found.classes == ("small car", "van")
    marked = read(write("a.txt", text.replace("007", "#7")))
    assert marked.trajectories.ids.tolist() == ["#5", "#7"]
    # Of one body, as of robots: numbers below the names are no other format.
    rows = "0.1 1.4 0.6 1.7 0.7 0.6 -0.3 -0.4\n0.2 1.4 0.6 1.7 0.7 0.6 -0.3 -0.4\n"
    with pytest.raises(InputError, match="line 2: no column for id, position"):
        read(write("tum.txt", "# trajectory\n# timestamp tx ty tz qx qy qz qw\n" + rows))
    # A comment that names columns above a table with commas.
    above = write("a.csv", "# columns: frame id x y\nid,t,x\n1,0,2\n")
    assert rows_of(read_trajectories(above)) == {("1", 0): (2.0,)}


def test_all_ids_may_begin_like_comments(write: Write) -> None:
    path = write("a.csv", "id,t,x\n#1,1,2\n#2,1,3\n")
    assert rows_of(read_trajectories(path)) == {("#1", 1): (2.0,), ("#2", 1): (3.0,)}


def test_decimal_comma_in_quotes_between_commas(write: Write) -> None:
    path = write("a.csv", 'id,t,x,y\na,1,"1,5",2\nb,2,3,"-4,25"\n')
    assert rows_of(read_trajectories(path, decimal=",")) == SAME


@pytest.mark.parametrize("name", ["x,position", "x;position", "x\tposition"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiter_inside_quotes(write: Write, delimiter: str, name: str) -> None:
    header = delimiter.join(("id", "t", "x", f'"{name}{name}{name}"'))
    row = delimiter.join(('"a,;\t""b"""', "1", '"2"', "note"))
    trajectories = read_trajectories(write("a.csv", f"{header}\n{row}\n"))
    assert rows_of(trajectories) == {('a,;\t"b"', 1): (2.0,)}


def test_line_end_inside_quotes(write: Write) -> None:
    path = write("a.csv", 'id,t,x\r\n"two\r\nlines",1,2\r\n')
    assert rows_of(read_trajectories(path)) == {("two\nlines", 1): (2.0,)}


@pytest.mark.parametrize(
    "content", ["id,t,x,y", "id,t,x,y\n", "id;t;x;y\r\n\r\n", "\nid,t,x,y\n\n"]
)
def test_header_alone_is_an_empty_set(write: Write, content: str) -> None:
    reading = read(write("a.csv", content))
    assert reading.rows == 0
    assert rows_of(reading.trajectories) == {}
    assert len(reading.trajectories.times) == len(reading.trajectories.ids) == 0
    assert reading.trajectories.columns == ("x", "y")


# --- ids ------------------------------------------------------------------------------------------


def test_ids_are_opaque(write: Write) -> None:
    path = write("a.csv", "id,t,x\n7,1,1\n007,1,2\n7.0,1,3\nA,1,4\na,1,5\n1e3,1,6\nnan,1,7\n")
    expected = {"7": 1, "007": 2, "7.0": 3, "A": 4, "a": 5, "1e3": 6, "nan": 7}
    assert rows_of(read_trajectories(path)) == {(k, 1): (v,) for k, v in expected.items()}


def test_ids_come_in_natural_order(write: Write) -> None:
    names = ["car-10", "10", "car-9", "2", "02", "car-9b", "b", "1"]
    path = write("a.csv", "id,t,x\n" + "".join(f"{name},1,0\n" for name in names))
    expected = ["1", "02", "2", "10", "b", "car-9", "car-9b", "car-10"]
    assert read_trajectories(path).ids.tolist() == expected


@pytest.mark.parametrize("digits", [18, 19, 20, 40, 5000])  # beyond C, beyond int()
def test_id_of_many_digits(write: Write, digits: int) -> None:
    name = "9" * digits
    path = write("a.csv", f"id,t,x\n{name},1,2\n")
    assert rows_of(read_trajectories(path)) == {(name, 1): (2.0,)}


@pytest.mark.parametrize("other", ["b", "b c"])
def test_whether_an_id_is_stripped_does_not_depend_on_other_ids(write: Write, other: str) -> None:
    path = write("a.csv", f"id,t,x\nfirst,1,0\n{other},1,0\n\u2003a\u2003,1,2\n".encode())
    assert "a" in read_trajectories(path).ids


@pytest.mark.parametrize("names", [["7", "10", "0"], ["7", "007"], ["0", "-0", "00"], ["7", "+7"]])
def test_ids_of_digits_are_opaque(write: Write, names: list[str]) -> None:
    path = write("a.csv", "id,t,x\n" + "".join(f"{name},1,0\n" for name in names))
    assert set(read_trajectories(path).ids) == set(names)


# --- numbers --------------------------------------------------------------------------------------

DECIMALS = st.one_of(
    st.from_regex(r"[+-]?[0-9]{1,30}(\.[0-9]{0,40})?([eE][+-]?[0-9]{1,3})?", fullmatch=True),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    # Halfway between two doubles, where sloppy parsers round the wrong way.
    st.integers(2**53, 2**60).map(lambda k: f"{2 * k + 1}.0"),
    st.integers(2**52, 2**53 - 1).map(lambda k: f"{k}.5"),
).filter(lambda text: math.isfinite(float(text)))


@given(st.lists(DECIMALS, min_size=1, max_size=30))
@example(["2.2250738585072011e-308", "1e23", "5e-324", "2.4703282292062328e-324", "-0.0"])
@example(["9007199254740993", "9007199254740992.999999999999999999", "1.7976931348623157e308"])
@example(["0.1000000000000000055511151231257827021181583404541015625", "00012", ".5", "5."])
def test_numbers_are_the_nearest_doubles(scratch: Path, texts: list[str]) -> None:
    lines = "".join(f"{k},1,{text}\n" for k, text in enumerate(texts))
    scratch.write_text("id,t,x\n" + lines, encoding="utf-8")
    trajectories = read_trajectories(scratch)
    assert trajectories.ids.tolist() == [str(k) for k in range(len(texts))]
    assert trajectories.state[:, 0].tobytes() == np.array([float(t) for t in texts]).tobytes()


# --- times ----------------------------------------------------------------------------------------


def test_integer_stamps_are_exact(write: Write) -> None:
    stamps = [2**53 + 1, 2**53, 1_700_000_000_123_456_789, 2**63 - 1, -1, 0]
    path = write("a.csv", "id,t,x\n" + "".join(f"a,{t},{t % 7}\n" for t in stamps))
    trajectories = read_trajectories(path)
    assert trajectories.times.tolist() == sorted(stamps)
    assert rows_of(trajectories) == {("a", t): (t % 7,) for t in stamps}


def test_integer_stamps_may_lie_as_far_apart_as_they_can(write: Write) -> None:
    path = write("a.csv", f"id,t,x\na,{-(2**63)},0\na,{2**63 - 1},0\n")
    assert read_trajectories(path).times.tolist() == [-(2**63), 2**63 - 1]


@pytest.mark.parametrize("other", ["0.5", str(2**64)])
def test_integer_stamps_are_never_merged_in_silence(write: Write, other: str) -> None:
    path = write("a.csv", f"id,t,x\na,{2**53},0\nb,{2**53 + 1},0\nc,{other},0\n")
    try:
        kept = len(read_trajectories(path).times)
    except InputError:
        kept = 3  # refusing is fine
    assert kept == 3


def test_decimal_times(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,0.1,1\na,1e-3,2\na,-5,3\nb,-0.0,4\nc,0,5\n")
    trajectories = read_trajectories(path)
    assert trajectories.times.tolist() == [-5.0, 0.0, 0.001, 0.1]  # -0.0 and 0 are one step
    assert rows_of(trajectories)["b", 0.0] == (4.0,)


@pytest.mark.parametrize(
    ("text", "nanoseconds", "clock"),
    [
        ("1970-01-01", 0, "local"),
        ("1970-01-01T00:00:01", 10**9, "local"),
        ("1970-01-02 00:00:00.5", 86_400 * 10**9 + 5 * 10**8, "local"),
        ("19700101T000001", 10**9, "local"),
        ("1969-12-31T23:59:59.999999999", -1, "local"),
        ("1970-01-01T00:00:00.000000001", 1, "local"),
        ("1970-01-01T00:00:00,25", 25 * 10**7, "local"),
        ("1970-01-01T00:00:00Z", 0, "zoned"),
        ("1970-01-01T01:00:00+01:00", 0, "zoned"),
        ("1970-01-01T00:00:00.123456789-00:30", 1800 * 10**9 + 123456789, "zoned"),
        ("2024-02-29T12:00:00.123456789Z", 1_709_208_000_123_456_789, "zoned"),
        ("1970-01-01t00:00:00.25", 25 * 10**7, "local"),  # RFC 3339 allows a small t
    ],
)
def test_iso_times(write: Write, text: str, nanoseconds: int, clock: str) -> None:
    trajectories = read_trajectories(write("a.csv", f'id,t,x\na,"{text}",1\n'))
    assert trajectories.times.tolist() == [nanoseconds]
    assert trajectories.clock == clock
    assert trajectories.labels is not None
    assert trajectories.labels.tolist() == [text]


@given(st.datetimes(datetime(1700, 1, 1), datetime(2200, 1, 1)), st.integers(0, 999))
def test_iso_times_agree_with_datetime(scratch: Path, moment: datetime, extra: int) -> None:
    text = f"{moment.isoformat(timespec='microseconds')}{extra:03d}"
    scratch.write_text(f"id,t,x\na,{text},1\n", encoding="utf-8")
    expected = (moment - datetime(1970, 1, 1)) // timedelta(microseconds=1) * 1000 + extra
    assert read_trajectories(scratch).times.tolist() == [expected]


def test_one_moment_in_two_zones_is_one_step(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,2024-01-01T12:00:00Z,1\nb,2024-01-01T13:00:00+01:00,2\n")
    assert len(read_trajectories(path).times) == 1


# --- absent rows, duplicates, columns -------------------------------------------------------------


def test_blank_and_nan_rows_are_absent_and_counted(write: Write) -> None:
    path = write("a.csv", "id,t,x,y\na,1,,2\na,2,NaN,2\na,3,1,  \na,4,1,2\nb,5,,\n")
    reading = read(path)
    assert rows_of(reading.trajectories) == {("a", 4): (1.0, 2.0)}
    assert reading.rows == 5
    # The steps exist in the file, even where nothing does.
    assert reading.trajectories.times.tolist() == [1, 2, 3, 4, 5]
    assert [n for n in reading.notices if n.startswith("4 rows ") and "absent" in n]


def test_nothing_absent_no_notice(write: Write) -> None:
    assert read(write("a.csv", PLAIN)).notices == ()


def test_duplicates(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,1,1\nb,7,5\na,1,2\na,2,9\na,1,3\n")
    (message,) = refusal(path)
    # The repeated line first, because that is the one to look at.
    assert message.startswith(f"{path}, line 4: ")
    assert message.index("line 4") < message.index("line 2")
    for part in ('"a"', "t 1 ", "and 1 more", "on_duplicate"):
        assert part in message
    kept = {}
    for choice in ("first", "last"):
        reading = read(path, ReadOptions(on_duplicate=choice))
        kept[choice] = rows_of(reading.trajectories).pop(("a", 1))
        assert len(rows_of(reading.trajectories)) == 3
        assert [n for n in reading.notices if n.startswith("2 rows ") and choice in n]
    assert kept == {"first": (1.0,), "last": (3.0,)}


def test_half_of_the_rows_are_duplicates(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,0,1\na,0,2\nb,0,3\nb,0,4\n")
    assert not read(path, ReadOptions(on_duplicate="last")).warnings


def test_an_absent_row_is_no_duplicate(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,1,\na,1,2\n")
    assert rows_of(read_trajectories(path)) == {("a", 1): (2.0,)}


# --- what is refused ------------------------------------------------------------------------------


REFUSED = [
    (
        'id,t,x\na,1,1\na,2,"12,3"\na,3,oops\n',
        (3, "x"),
        ["not a number", '"12,3"', "and 1 more", "decimal="],
    ),
    ("id;t;x\na;1;1,500\n", (2, "x"), ["not a number", '"1,500"', "decimal="]),
    ("id;t;x\na;1,5;0.1\n", (2, "t"), ['"1,5"', "decimal="]),
    ("id,t,X\na,1,1_000\n", (2, "X"), ["not a number", '"1_000"']),
    ("id,t,X\na,1,1\na,2,\u0661\u0662\n", (3, "X"), ["not a number", '"\u0661\u0662"']),
    ("id,frame,x\na,1_000,1\n", (2, "frame"), ["not a time", '"1_000"']),
    (
        "id,t,x\na,1,1\n\na,2,1e999\na,3,-inf\na,4,Infinity\n",
        (4, "x"),
        ["infinite", '"1e999"', "and 2 more", "blank"],
    ),
    ("id,t,x\na,1,1\na,inf,1\na,-inf,1\n", (3, "t"), ["not a finite time", '"inf"', "and 1 more"]),
    ("id,t,x\na,nan,1\n", (2, "t"), ["not a finite time", '"nan"']),
    ("id,t,x\na,1,1\na, ,1\na,,1\na,,1\n", (3, "t"), ["blank", "and 2 more"]),
    (
        "id,t,x\na,1,1\na,yesterday,1\na,soon,1\n",
        (3, "t"),
        ['not a time: "yesterday"', "and 1 more", "ISO-8601"],
    ),
    (
        "id,t,x\na,2024-01-01T00:00:00,1\na,5,1\n",
        (3, "t"),
        ["mixed", '"2024-01-01T00:00:00"', '"5"'],
    ),
    (
        "id,t,x\na,5,1\na,2024-01-01T00:00:00,1\n",
        (3, "t"),
        ["mixed", '"2024-01-01T00:00:00"', '"5"'],
    ),
    (
        "id,t,x\na,2024-01-01T00:00:00Z,1\na,2024-01-01T00:00:01,1\n",
        (3, "t"),
        ["mixed", '"2024-01-01T00:00:00Z"', '"2024-01-01T00:00:01"'],
    ),
    ("id,t,x\na,1,1\na,2\na,3,1\na,4,1,1\n", 3, ["2 fields", "header has 3"]),
    ("id,t,x\na,1,1\na,3,1,5\n", 3, ["4 fields", "header has 3"]),
    ("id,t,x\na,1,1\na\n", 3, ["1 field,", "header has 3"]),
    ("id,t,x\na,1,1,a,2,1\n", 2, ["6 fields", "header has 3"]),
    ("id,t,class,x\na,1,car,2\na,2,car,2,5\n", 3, ["5 fields", "header has 4"]),
    ("id,t,x,class\na,1,2,car,5\na,2,2\n", 2, ["5 fields", "header has 4"]),
    ("id,t,x\na,1,1\n,2,1\n  ,3,1\n", (3, "id"), ["blank id", "and 1 more"]),
    ('id,t,x\na,1,1\n"a,2,1\na,3,1\n', 3, ["quote"]),
    ('id,t,x\n"two\nlines",1,1\n\na,2,oops\n', (5, "x"), ['"oops"']),
    ("\r\n\r\nid,t,x\r\na,1,1\r\na,2,oops\r\n", (5, "x"), ['"oops"']),
    ("id,t,X\na,1," + "9" * 70 + "x\n", (2, "X"), ['"' + "9" * 57 + '..."']),
    ('id,t,x\na,1,"1\n\x1b[31m"\n', (2, "x"), ["not a number", r"1\n\x1b[31m"]),
    ("id,t,x,name\na,1,1,ok\na,2,2,Ren\u00e9\n".encode("latin-1"), 3, ["not UTF-8", "0xe9"]),
    (b"id,t,x\na,1,1\n\x89PNG\x00\x00", 3, ["binary", "CSV"]),
    (PLAIN.encode("utf-16"), 1, ["UTF-16", "UTF-8"]),
    (b"\xfe\xff" + PLAIN.encode("utf-16-be"), 1, ["UTF-16", "UTF-8"]),
    (b"", None, ["empty", "header"]),
    ("\n \r\n\n", None, ["blank", "header"]),
    (b"\xef\xbb\xbf", None, ["blank", "header"]),
    ("id,t,x,y,x\na,1,2,3,4\n", 1, ['"x" twice', "rename"]),
    ("\nid,t,,x\na,1,2,3\n", 2, ["column 3"]),
    (
        "id,t,u,v\na,1,2,3\n",
        1,
        ["no column for position", "id, t, u, v", "columns=('x=HEADER', 'y=HEADER')"],
    ),
    ("id,t,lat\na,1,2\n", 1, ["no column for position", "columns=('x=HEADER', 'y=HEADER')"]),
    ("who,t,x\na,1,2\n", 1, ["no column for id", "who, t, x", "columns=('id=who',)"]),
    ("id,when,x\na,1,2\n", 1, ["no column for t", "id, when, x", "columns=('t=when',)"]),
    ("1,2,3.5,4\n1,3,4,5\n", 1, ["the numbers 1, 2", "in the order of the file"]),
]
"""What a file holds, the line (and column) that the message names, and words of it."""


@pytest.mark.parametrize(("content", "place", "parts"), REFUSED)
def test_refused(
    write: Write, content: str | bytes, place: tuple[int, str] | int | None, parts: list[str]
) -> None:
    path = write("a.csv", content)
    (message,) = refusal(path)  # one line, however many rows are wrong
    where = (
        f', line {place[0]}, column "{place[1]}"'
        if isinstance(place, tuple)
        else (f", line {place}" if place else "")
    )
    assert message.startswith(f"{path}{where}: ")
    assert "; " in message  # what to do
    for part in parts:
        assert part in message


def test_one_line_for_each_kind(write: Write) -> None:
    path = write("a.csv", "id,t,x,y\na,1,oops,1\n,2,1,inf\na,3,ouch,1\na,,1,1\n")
    messages = refusal(path)
    expected = {
        ', line 2, column "x": ': '"oops" (and 1 more)',
        ', line 3, column "id": ': "blank id",
        ', line 3, column "y": ': '"inf"',
        ', line 5, column "t": ': "blank",
    }
    assert len(messages) == len(expected)
    for beginning, part in expected.items():
        (message,) = (m for m in messages if m.startswith(path + beginning))
        assert part in message


def test_both_mistakes_of_one_column_are_told(write: Write) -> None:
    path = write("a.csv", "id,t,x\na,1,oops\na,2,inf\n")
    messages = refusal(path)
    assert ['"oops"' in messages[0], '"inf"' in messages[-1]] == [True, True]


def test_decimal_point_under_decimal_comma(write: Write) -> None:
    path = write("a.csv", "id;t;x\na;1;1,5\na;2;2.5\n")
    (message,) = refusal(path, decimal=",")
    assert message.startswith(f'{path}, line 3, column "x": ')
    assert '"2.5"' in message
    assert "(decimal)" in message


# --- any table comes back as it was written -------------------------------------------------------

NAMES = st.one_of(
    st.text(st.sampled_from("ab07 ,;\t\"'\n-_é車"), min_size=1, max_size=6)
    .map(str.strip)
    .filter(bool),
    # Neighbours that a parser of numbers would take for one.
    st.sampled_from(["0", "-0", "00", "7", "07", "007", "+7", "7.0", "7e0", "70", "1_0", "10"]),
    st.sampled_from(["nan", "NaN", "NA", "None", "null", "True", "inf"]),
)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TIMES = st.one_of(
    st.lists(st.integers(-(2**62) + 1, 2**62), min_size=1, max_size=6, unique=True),
    st.lists(FLOATS.map(lambda value: value + 0.0), min_size=1, max_size=6, unique=True),
)


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Names of the columns, and rows in any order: an id, a time, and the state."""
    size = draw(st.integers(1, 3))
    times = draw(TIMES)
    cell = st.tuples(NAMES, st.sampled_from(times))
    cells = draw(st.lists(cell, max_size=12, unique=True))
    state = st.tuples(*[FLOATS] * size)
    rows = [(name, time, *draw(state)) for name, time in cells]
    return ["id", "t", *"xyz"[:size]], rows


@given(
    content=tables(),
    delimiter=st.sampled_from(",;\t"),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]),
    terminator=st.sampled_from(["\n", "\r\n"]),
    decimal=st.sampled_from(".,"),
    seed=st.randoms(use_true_random=False),
)
def test_any_table_comes_back_in_any_order(
    scratch: Path,
    content: tuple[list[str], list[tuple[Any, ...]]],
    delimiter: str,
    quoting: int,
    terminator: str,
    decimal: str,
    seed: Any,
) -> None:
    header, rows = content
    if decimal == "," == delimiter:
        delimiter = ";"

    def spell(value: Any) -> Any:
        return repr(value).replace(".", decimal) if isinstance(value, float) else value

    def reread(rows: list[tuple[Any, ...]]) -> Trajectories:
        text = io.StringIO()
        writer = csv.writer(text, delimiter=delimiter, quoting=quoting, lineterminator=terminator)
        writer.writerow(header)
        writer.writerows([spell(value) for value in row] for row in rows)
        scratch.write_bytes(text.getvalue().encode())
        return read_trajectories(scratch, decimal=decimal)

    trajectories = reread(rows)
    assert rows_of(trajectories) == {(row[0], row[1]): row[2:] for row in rows}
    assert trajectories.columns == tuple(header[2:])
    shuffled = list(rows)
    seed.shuffle(shuffled)
    again = reread(shuffled)
    for name in ("step", "track", "state", "ids", "times"):
        assert np.array_equal(getattr(again, name), getattr(trajectories, name)), name
