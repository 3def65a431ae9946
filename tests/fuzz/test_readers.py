"""Whatever a file holds, a reader answers with a reading or with one of our errors.

Bytes are changed in files that are right, and tables are edited; small and large files are read in
two ways, which must give the same reading or the same message. The same few cases run always,
new ones by ``make fuzz``.
"""

import io
import tracemalloc
import zipfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import SAMPLES
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tgospa_eval import TgospaError
from tgospa_eval.formats import FORMATS, ROLES, ReadOptions, read
from tgospa_eval.formats.text import lines

MEMORY = 50_000_000
"""Bytes beyond what the largest of these files, some kilobytes, may ever need."""

ROWS = [(k % 3, k // 3, 10.5 * k, 20 + k) for k in range(9)]
CLASSES = ("1", "01", "1e22")
SEEDS = {
    "csv": "id,t,x,y,left,top,width,height,class\n"
    + "".join(f"{i},{t},{x},{y},{x},{y},4,6,{CLASSES[t]}\n" for i, t, x, y in ROWS),
    "quoted": '"id","t","x","y","class"\n'
    + "".join(f'"{i}",2024-01-01T10:00:0{t},{x},"{y}","{CLASSES[t]}"\n' for i, t, x, y in ROWS),
    "motchallenge": "".join(f"{t},{i},{x},{y},4,6,1,-1,-1,-1\n" for i, t, x, y in ROWS),
    "visdrone": "".join(
        f"{t},{i},{x},{y},4,6,{t % 2},{t and i + 1},{t % 2},{t}\n" for i, t, x, y in ROWS
    ),
    "kitti": "".join(
        f"{t} {i} Car 0 0 0.5 {x} {y} {x + 9} {y + 9} 1 2 3 4 5 6 7\n" for i, t, x, y in ROWS
    ),
}
SHAPES = {
    "json": "".join(f'{{"id": {i}, "t": {t}, "x": {x}, "y": {y}}}\n' for i, t, x, y in ROWS),
    "wide": "t,x1,y1,x2,y2\n" + "".join(f"{t},{x},{y},{x},\n" for _, t, x, y in ROWS),
    "deeplabcut": "scorer,a,a,a\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n"
    + "".join(f"{t},{x},{y},0.9\n" for _, t, x, y in ROWS[::3]),
    "tum": "".join(f"{t}.5 {x} {y} 0 0 0 0 1\n" for _, t, x, y in ROWS[::3]),
    "csv-per-object": "t,x,y\n" + "".join(f"{t},{x},{y}\n" for _, t, x, y in ROWS[::3]),
    "yolo": "".join(f"0 .{i} .{t} .1 .1 {i}\n" for i, t, _, _ in ROWS),
}
"""Of formats that pandas reads."""
BINARY = ("xlsx", "parquet", "feather", "npy", "npz", "mat", "nuscenes", "argoverse")
PIECES = [
    *(
        b"",
        b",",
        b";",
        b"\t",
        b" ",
        b"\n",
        b"\r",
        b"\r\n",
        b'"',
        b'""',
        b', "',
        b"\x00",
        b"\xff",
        b"\xfe",
    ),
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
    classes=st.sampled_from([None, ("1", "Car"), ("1e22",)]),
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


@cache
def seed_of(name: str) -> bytes:
    if name not in BINARY:
        return (SEEDS | SHAPES)[name].encode()
    if name == "xlsx":
        return b"PK\x03\x04\x14\x00\x00\x00xl/workbook.xml"
    if name == "mat":
        return (SAMPLES / "formats" / "run.mat").read_bytes()
    if name == "nuscenes":
        return (SAMPLES / "formats" / "nuscenes_results.json").read_bytes()
    if name == "argoverse":
        pytest.importorskip("pyarrow")
        return (SAMPLES / "formats" / "annotations.feather").read_bytes()
    import io

    import pandas as pd

    buffer = io.BytesIO()
    frame = pd.read_csv(io.StringIO(SEEDS["csv"]))
    if name == "npy":
        np.save(buffer, frame[["x", "y", "left"]].to_numpy().reshape(3, 3, 3))
        return buffer.getvalue()
    if name == "npz":
        columns = {column: frame[column].to_numpy() for column in frame}
        np.savez(
            buffer, **{c: a.astype(str) if a.dtype.kind == "O" else a for c, a in columns.items()}
        )
        return buffer.getvalue()
    pytest.importorskip("pyarrow")
    frame.to_parquet(buffer) if name == "parquet" else frame.to_feather(buffer)
    return buffer.getvalue()


@cache
def contents(name: str, edited: bool) -> st.SearchStrategy[bytes]:
    """Files of a format that are nearly right."""
    if edited:
        return edited_tables(seed_of(name), b" " if name in ("kitti", "tum", "yolo") else b",")
    return changed_bytes(seed_of(name))


def answer(path: Path, options: ReadOptions, role: str, format_: str | None) -> tuple[object, ...]:
    """Everything that a reading says, or its refusal."""
    try:
        reading = read(path, options, role, format_)
    except TgospaError as error:
        return type(error).__name__, str(error)
    side = reading.trajectories
    assert reading.rows == sum(reading.left_out.values()) + len(side.step)
    arrays = (side.step, side.track, side.times, side.state, reading.klass)
    return (
        *(None if array is None else (array.dtype.kind, array.tolist()) for array in arrays),
        *(side.ids.tolist(), list(side.shown), side.columns, side.clock),
        *(reading.rows, reading.notices, reading.left_out, reading.classes, reading.named),
    )


def answers(path: Path, options: ReadOptions, role: str, format_: str | None) -> None:
    """Read it as it comes, without the compiled loop, and as a large file."""
    found = []
    for size, scanner in ((lines.LARGE_BYTES, lines.scanner), (lines.LARGE_BYTES, None), (0, None)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(lines, "LARGE_BYTES", size)
            patch.setattr(lines, "scanner", scanner)
            found.append(answer(path, options, role, format_))
    assert found[0] == found[1] == found[2]


def column_of_a_frame(kind: str) -> st.SearchStrategy[Any]:
    """Arrow arrays of one type, five values of which some may be missing."""
    import pyarrow as pa

    type_, values = {
        "int8": (pa.int8(), st.integers(0, 3)),
        "int64": (pa.int64(), st.sampled_from([0, 1, -1, 2**53, 2**53 + 1, 2**63 - 1])),
        "uint64": (pa.uint64(), st.sampled_from([0, 1, 2**64 - 1])),
        "float32": (pa.float32(), st.floats(width=32)),
        "float64": (pa.float64(), st.floats()),
        "decimal": (pa.decimal128(9, 2), st.decimals(-99, 99, places=2)),
        "large decimal": (pa.decimal256(76, 2), st.decimals(-(10**70), 10**70, places=2)),
        "bool": (pa.bool_(), st.booleans()),
        "text": (pa.string(), st.sampled_from(["", "1", "01", "1_0", "1e22", "a", "2024-01-01"])),
        "any text": (pa.large_string(), st.text(max_size=3)),
        "bytes": (pa.binary(), st.binary(max_size=2)),
        "seconds": (pa.timestamp("s"), st.integers(-(10**15), 10**15)),
        "zoned": (pa.timestamp("us", "Europe/Berlin"), st.integers(-(10**18), 10**18)),
        "offset": (pa.timestamp("ns", "+05:00"), st.integers(2**63 - 10**14, 2**63 - 1)),
        "nanoseconds": (pa.timestamp("ns"), st.integers(0, 10**18)),
        "date": (pa.date32(), st.integers(-(10**6), 3 * 10**6)),
        "time": (pa.time64("ns"), st.integers(0, 10**12)),
        "duration": (pa.duration("ns"), st.integers(0, 10**12)),
        "null": (pa.null(), st.none()),
        "list": (pa.list_(pa.int64()), st.lists(st.integers(0, 2), max_size=2)),
        "pair": (pa.list_(pa.int64(), 2), st.just([1, 2])),
        "struct": (pa.struct([("a", pa.int64())]), st.fixed_dictionaries({"a": st.just(1)})),
        "map": (pa.map_(pa.string(), pa.int64()), st.just([("a", 1)])),
    }[kind]
    some = st.lists(st.one_of(values, values, st.none()), min_size=5, max_size=5)
    return some.map(lambda items: pa.array(items, type_))


KINDS = (
    *("int8", "int64", "uint64", "float32", "float64", "decimal", "large decimal"),
    *(
        "bool",
        "text",
        "any text",
        "bytes",
        "seconds",
        "zoned",
        "offset",
        "nanoseconds",
        "date",
        "time",
        "duration",
        "null",
    ),
    *("list", "pair", "struct", "map"),
)


CASES = [
    (name, edited)
    for name in (*FORMATS, "quoted")
    for edited in (False, True)
    if not (name in BINARY and name != "npz" and edited)  # tables as frames, below
]


@pytest.mark.parametrize(("name", "edited"), CASES)
@settings(suppress_health_check=list(HealthCheck))
@given(data=st.data(), options=OPTIONS, role=st.sampled_from(ROLES), guessed=st.booleans())
def test_never_a_traceback(
    name: str,
    edited: bool,
    tmp_path: Path,
    data: st.DataObject,
    options: ReadOptions,
    role: str,
    guessed: bool,
) -> None:
    path = tmp_path / "any.txt"
    path.write_bytes(data.draw(contents(name, edited)))
    answers(path, options, role, None if guessed else "csv" if name == "quoted" else name)


@settings(suppress_health_check=list(HealthCheck))
@given(
    at=st.integers(128, 600),
    byte=st.sampled_from([0, 1, 5, 14, 127, 128, 255]),
    role=st.sampled_from(ROLES),
)
@example(at=264, byte=0, role="truth")  # ends the process with SciPy 1.17, as do the next two
@example(at=232, byte=5, role="truth")
@example(at=233, byte=255, role="estimate")
def test_sizes_and_types_of_a_mat_file(tmp_path: Path, at: int, byte: int, role: str) -> None:
    """Bytes where SciPy's reader believes what it is told."""
    data = bytearray(seed_of("mat"))
    data[at] = byte
    path = tmp_path / "a.mat"
    path.write_bytes(data)
    with suppress(TgospaError):
        read(path, role=role)


@settings(suppress_health_check=list(HealthCheck))
@given(data=st.data(), options=OPTIONS)
def test_never_a_traceback_by_a_frame(
    tmp_path: Path, data: st.DataObject, options: ReadOptions
) -> None:
    """Parquet tables with columns of other types, with nulls, coded, or away."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    right = {"id": list("aabbc"), "t": [0, 1, 0, 1, 0], "x": [0.5, 1, 2, 3, 4], "y": [1.0] * 5}
    right |= {"class": ["1", "01", "1e22", "car", "1"]}
    path = tmp_path / "a.parquet"
    columns = {name: pa.array(values) for name, values in right.items()}
    for name in data.draw(st.lists(st.sampled_from(list(right)), min_size=1, max_size=3)):
        edit = data.draw(st.sampled_from(["type", "type", "type", "coded", "away"]))
        if edit == "type":
            columns[name] = data.draw(column_of_a_frame(data.draw(st.sampled_from(KINDS))))
        elif edit == "coded":
            with suppress(pa.ArrowException, KeyError):
                columns[name] = columns[name].dictionary_encode()
        else:
            columns.pop(name, None)
    with suppress(pa.ArrowException):  # what cannot be written
        pq.write_table(pa.table(columns), path)
        answers(path, options, "truth", None)


SIZES = st.sampled_from([0, 1, 2, 3, 10**9, 2**31, 10**18, 2**63, 10**30, -1])
TYPES = st.sampled_from(["<f8", ">f4", "<i8", "|b1", "<U3", "<c16", "<M8[ns]", "|O", "|V0", "<f16"])


@settings(suppress_health_check=list(HealthCheck))
@given(
    shapes=st.lists(st.lists(SIZES, max_size=4).map(tuple), min_size=1, max_size=3),
    types=st.lists(TYPES, min_size=3, max_size=3),
    names=st.permutations(["x.npy", "t.npy", "id.npy", "P.npy", "a.txt", "x", "weight.npy"]),
    rest=st.binary(max_size=64),
    options=OPTIONS,
)
def test_never_a_traceback_by_a_header(
    tmp_path: Path,
    shapes: list[tuple[int, ...]],
    types: list[str],
    names: list[str],
    rest: bytes,
    options: ReadOptions,
) -> None:
    """Headers of arrays of any shape and type, before few bytes; alone, and in zip files."""
    arrays = []
    for shape, kind in zip(shapes, types, strict=False):
        buffer = io.BytesIO()
        about = {"descr": kind, "fortran_order": len(shapes) > 1, "shape": shape}
        np.lib.format.write_array_header_1_0(buffer, about)
        arrays.append(buffer.getvalue() + rest)
    path = tmp_path / "a.npy"
    path.write_bytes(arrays[0])
    answers(path, options, "truth", None)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name, content in zip(names, arrays, strict=False):
            archive.writestr(name, content)
    answers(tmp_path / "a.npz", options, "truth", None)


@pytest.mark.parametrize("name", ["motchallenge", "kitti"])
def test_a_return_alone_ends_a_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("\r" + SEEDS[name].replace(" ", "", 1), newline="")
    answers(path, ReadOptions(by_class=True), "truth", name)


@pytest.mark.parametrize("name", SEEDS)
def test_memory_is_bounded_by_the_file(name: str, write: Callable[[str, str | bytes], str]) -> None:
    format_ = "csv" if name == "quoted" else name
    # Numbers that a careless reader takes for sizes: frames, ids and widths of 18 digits.
    big = str(10**18 - 1)
    text = (
        SEEDS[name].replace("10.5", big).replace("\n1,", f"\n{big},").replace("\n2 ", f"\n{big} ")
    )
    path = write("a.txt", text)
    with suppress(TgospaError):
        read(path, format=format_)
    tracemalloc.start()
    try:
        with suppress(TgospaError):
            read(path, format=format_)
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()


END = {
    "csv": ("0,0,", "%d,%d,"),
    "quoted": ('"0",2024-01-01T10:00:00,', '"%d",2024-01-01T10:00:00.%03d,'),
    "motchallenge": ("0,0,", "%d,%d,"),
    "visdrone": ("0,0,", "%d,%d,"),
    "kitti": ("0 0 ", "%d %d "),
}
"""Ids and times of the first row of a seed, and what they are written as."""


@pytest.mark.parametrize("size", [-(10**9), 10**9, 0], ids=["compiled", "careful", "quick"])
@pytest.mark.parametrize("name", SEEDS)
def test_memory_per_byte(
    name: str, size: int, write: Callable[[str, str | bytes], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A row takes 32 bytes as numbers, some 80 with keys and their order: two or three times its
    # text. A list of fields would take twenty times.
    monkeypatch.setattr(lines, "LARGE_BYTES", abs(size))
    monkeypatch.setattr(lines, "scanner", lines.scanner if size < 0 else None)
    monkeypatch.setattr(lines, "LETTERS_TOGETHER", 1 << 12)
    monkeypatch.setattr(lines, "ROWS_OF_BLOCK", 1 << 7)
    format_ = "csv" if name == "quoted" else name
    seed = SEEDS[name].splitlines()
    head = [seed.pop(0)] if format_ == "csv" else []
    found = []
    for count in (500, 2_000):
        rows = [seed[0].replace(*END[name], 1) % divmod(k, 500) for k in range(count)]
        path = write("a.txt", "\n".join([*head, *rows]) + "\n")
        read(path, format=format_)
        tracemalloc.start()
        try:
            assert read(path, format=format_).rows == count
            found.append((tracemalloc.get_traced_memory()[1], Path(path).stat().st_size))
        finally:
            tracemalloc.stop()
    (low, small), (high, large) = found
    assert (high - low) / (large - small) < 9
