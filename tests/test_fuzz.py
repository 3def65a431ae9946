"""Whatever a file holds, a reader answers with a reading or with one of our errors.

Bytes are changed in files that are right, and tables are edited; a fast subset runs always, the
long version with ``-m slow``. Hypothesis ends a run whose examples never end.
"""

import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tgospa_eval.errors import TgospaError
from tgospa_eval.formats import FORMATS, ReadOptions, read, table

FAST, SLOW = 60, 12_500
"""Cases of each of the ten tests; the slow ones are 1.25 x 10^5."""

MEMORY = 50_000_000
"""Bytes beyond what the largest of these files, some kilobytes, may ever need."""

ROWS = [(k % 3, k // 3, 10.5 * k, 20 + k) for k in range(9)]
SEEDS = {
    "csv": "id,t,x,y,left,top,width,height,class\n"
    + "".join(f"{i},{t},{x},{y},{x},{y},4,6,car\n" for i, t, x, y in ROWS),
    "motchallenge": "".join(f"{t},{i},{x},{y},4,6,1,-1,-1,-1\n" for i, t, x, y in ROWS),
    "kitti": "".join(
        f"{t} {i} Car 0 0 0.5 {x} {y} {x + 9} {y + 9} 1 2 3 4 5 6 7\n" for i, t, x, y in ROWS
    ),
}
BINARY = ("parquet", "npz")
PIECES = [
    *(b"", b",", b";", b"\t", b" ", b"\n", b"\r", b"\r\n", b'"', b'""', b"\x00", b"\xff", b"\xfe"),
    *(b"nan", b"inf", b"-inf", b"1e999", b"1e308", b"-1", b"0", b"007", b"1_0", b"0x1", b"True"),
    *(b"9" * 25, b"2024-01-01", b"2024-01-01T10:00:00Z", b"9999-12-31T23:59:59+23:59", b"1,5"),
    *("é車\u0661\u2003\x85".encode(), b"\xef\xbb\xbf", b"id", b"x", b"DontCare", b"PAR1"),
]
OPTIONS = st.builds(
    ReadOptions,
    columns=st.sampled_from([None, ("x", "y"), ("x", "y", "z"), ("left", "top"), ("id=t", "x=y")]),
    decimal=st.sampled_from([".", ","]),
    on_duplicate=st.sampled_from(["error", "first", "last"]),
    boxes=st.booleans(),
    time=st.sampled_from([None, "1:", "0.5:2.5", "2024-01-01:"]),
    classes=st.sampled_from([None, ("car", "Car")]),
    region=st.sampled_from([None, "x=0:50"]),
    by_class=st.booleans(),
    clouds=st.booleans(),
).filter(lambda options: not (options.boxes and options.columns))


@st.composite
def changed_bytes(draw: st.DrawFn, seed: bytes) -> bytes:
    """A right file with pieces cut out, put in or doubled."""
    data = seed
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, len(data)))
        end = min(len(data), begin + draw(st.integers(0, 12)))
        middle = draw(
            st.one_of(st.sampled_from(PIECES), st.binary(max_size=4), st.just(data[begin:end] * 2))
        )
        data = data[:begin] + middle + data[end:]
    return data


@st.composite
def edited_tables(draw: st.DrawFn, seed: bytes, delimiter: bytes) -> bytes:
    """A right table with fields replaced, and rows and columns taken away, doubled or moved."""
    rows = [line.split(delimiter) for line in seed.splitlines()]
    for _ in range(draw(st.integers(1, 4))):
        if not rows:
            break
        row = draw(st.integers(0, len(rows) - 1))
        column = draw(st.integers(0, max(len(rows[row]) - 1, 0)))
        edit = draw(st.sampled_from(["field", "drop", "double", "column", "cut", "swap"]))
        if edit == "field" and rows[row]:
            rows[row][column] = draw(st.sampled_from(PIECES))
        elif edit == "drop":
            del rows[row]
        elif edit == "double":
            rows.append(list(rows[row]))
        elif edit == "column":
            rows = [fields[:column] + fields[column + 1 :] for fields in rows]
        elif edit == "cut":
            rows[row] = rows[row][:column]
        else:
            rows[0], rows[row] = rows[row], rows[0]
    return b"\n".join(delimiter.join(fields) for fields in rows) + b"\n"


def seed_of(name: str) -> bytes:
    if name not in BINARY:
        return SEEDS[name].encode()
    import io

    import pandas as pd

    buffer = io.BytesIO()
    frame = pd.read_csv(io.StringIO(SEEDS["csv"]))
    if name == "npz":
        columns = {column: frame[column].to_numpy() for column in frame}
        np.savez(
            buffer, **{c: a.astype(str) if a.dtype.kind == "O" else a for c, a in columns.items()}
        )
        return buffer.getvalue()
    pytest.importorskip("pyarrow")
    frame.to_parquet(buffer)
    return buffer.getvalue()


def answers(path: Path, data: bytes, options: ReadOptions, role: str, format_: str | None) -> None:
    """Read it twice, the second time as a large file."""
    path.write_bytes(data)
    for size in (table.SIZE, 0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(table, "SIZE", size)
            try:
                reading = read(path, options, role, format_)
            except TgospaError:
                continue
            left = sum(reading.left_out.values())
            assert reading.rows == left + len(reading.trajectories.step)


def fuzz(name: str, edited: bool, cases: int, folder: Path) -> None:
    seed, path = seed_of(name), folder / "any.txt"
    delimiter = b" " if name == "kitti" else b","
    contents = edited_tables(seed, delimiter) if edited else changed_bytes(seed)

    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(
        data=contents,
        options=OPTIONS,
        role=st.sampled_from(["truth", "estimate"]),
        format_=st.sampled_from([name, None]),
    )
    def run(data: bytes, options: ReadOptions, role: str, format_: str | None) -> None:
        answers(path, data, options, role, format_)

    run()


CASES = [(name, edited) for name in FORMATS for edited in (False, True)]


@pytest.mark.parametrize(("name", "edited"), CASES)
def test_never_a_traceback(name: str, edited: bool, tmp_path: Path) -> None:
    fuzz(name, edited, FAST, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "edited"), CASES)
def test_never_a_traceback_in_many_cases(name: str, edited: bool, tmp_path: Path) -> None:
    fuzz(name, edited, SLOW, tmp_path)


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in BINARY])
def test_memory_is_bounded_by_the_file(name: str, write: Callable[[str, str | bytes], str]) -> None:
    # Numbers that a careless reader takes for sizes: frames, ids and widths of 18 digits.
    big = str(10**18 - 1)
    text = (
        SEEDS[name].replace("10.5", big).replace("\n1,", f"\n{big},").replace("\n2 ", f"\n{big} ")
    )
    path = write("a.txt", text)
    with suppress(TgospaError):
        read(path, format=name)
    tracemalloc.start()
    try:
        with suppress(TgospaError):
            read(path, format=name)
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()
