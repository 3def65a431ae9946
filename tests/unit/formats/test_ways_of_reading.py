"""A table is read in two ways, by what it is like; which one it was must not show."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from examples import examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tgospa_eval import InputError, read_trajectories
from tgospa_eval.formats import ReadOptions
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.text import lines

WAYS = ("compiled", "careful")

compiled = pytest.mark.skipif(lines.scanner is None, reason="no compiled loop")

ODD_FIELDS = st.sampled_from(
    ["1", "1.0", "1e3", "10e2", "007", "+7", "-0", "-3", " 7", "7 ", "x", "", "nan", "inf", "True",
     "1_0", "0x1", "9" * 20, "1,5", "٣", "1.", ".5", "1e999"]
)  # fmt: skip


@contextmanager
def way(name: str) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if name != "compiled":
            patch.setattr(lines, "scanner", None)
        yield


@settings(max_examples=examples(120), suppress_health_check=list(HealthCheck))
@given(
    rows=st.lists(
        st.tuples(ODD_FIELDS | st.integers(0, 30).map(str), st.integers(0, 9).map(str) | ODD_FIELDS,
                  st.floats(-9, 9).map(repr) | ODD_FIELDS),
        min_size=1, max_size=8,
    ),
    tails=st.lists(st.sampled_from(["", "", "", ",", ",1", "\r"]), min_size=8, max_size=8),
    extra=st.booleans(),
)  # fmt: skip
def test_the_quick_way_reads_what_the_careful_way_reads(
    tmp_path: Path, rows: list[tuple[str, ...]], tails: list[str], extra: bool
) -> None:
    """The same table, or the same refusal in the same words."""
    lines = [",".join(("u", *row)[1 - extra :]) + tail for row, tail in zip(rows, tails)]  # noqa: B905
    path = tmp_path / "a.csv"
    header = "class,id,t,x" if extra else "id,t,x"
    path.write_bytes(("\n".join([header, *lines]) + "\n").encode())
    read = []
    for name in WAYS:
        with way(name):
            try:
                got = read_trajectories(path)
                read.append(
                    (got.ids.tolist(), got.times.tolist(), got.step.tolist(), got.track.tolist(),
                     got.state.tobytes())
                )  # fmt: skip
            except InputError as error:
                read.append(str(error))
    assert read[0] == read[1]


def fields(rows: str, header: str = "id,t,x,y", decimal: str = ".") -> object:
    """What the compiled loop finds in the rows below a header."""
    mark = ";" if ";" in header else ","
    names = header.split(mark)
    roles = find_roles(names, ReadOptions(), "a.csv")
    data = f"{header}\n{rows}".encode()
    return lines.scanned(data, 2, len(names), mark, roles, decimal)


@compiled
def test_plain_rows_are_scanned() -> None:
    found = fields("b,1, 2.5 ,-0\na,1,1e-3,\nb,2.0,NaN,+.5\n\n")
    assert isinstance(found, lines.Fields)
    assert list(found.lines) == [2, 3, 4]
    assert {column: list(texts) for column, texts in found.coded.items()} == {
        0: ["b", "a", "b"],
        1: ["1", "1", "2.0"],
    }
    assert repr(found.values.tolist()) == "[[2.5, -0.0], [0.001, nan], [nan, 0.5]]"


@compiled
@pytest.mark.parametrize(
    "rows",
    ["", "\n", "a,1,2\n", "a,1,2,3,4\n", "a,1,2,3\n\nb,1,2,3\n", "a,1,2,x\n", "a,1,2,1e\n",
     "a,1,2,.\n", "a,1,2,-\n", "a,1,2,1 2\n", "a,1,2,1_0\n", "a,1,2,0x1\n", "a,1,2,inf\n",
     "a,1,2,1e999\n", 'a,1,2,"3\n', 'a"b,1,2,3\n', "#a,1,2,3\n", "a,1,2,3\rb,1,2,3\n",
     "a,1,2,-nan\n", '"#a",1,2,3\n', 'a,1,2,"3"4\n', "a\x1c,1,2,3\n",
     f"a,1,2,{'1' * 121}\n"],
)  # fmt: skip
def test_the_rest_is_left_to_the_careful_way(rows: str) -> None:
    assert fields(rows) is None


@pytest.mark.parametrize("end", [",", ", ", ",\t"])
def test_a_delimiter_at_the_end_of_a_line_without_a_header_is_none(
    write: Callable[[str, str], str], end: str
) -> None:
    rows = "0,1,1,2,4,6,1,-1,-1,-1\n1,1,1,2,4,6,1,-1,-1"
    for name in WAYS:
        with way(name), pytest.raises(InputError, match="line 2: 9 fields, line 1 has 10"):
            read_trajectories(write("a.txt", rows + end))


@compiled
def test_a_decimal_comma_between_commas_is_none() -> None:
    assert fields("a,1,2,3\n", decimal=",") is None


@compiled
@settings(max_examples=examples(300))
@given(
    st.lists(
        st.floats(allow_nan=False, allow_infinity=False).map(repr)
        | st.floats(-1e3, 1e3).map("{:.18e}".format)
        | st.builds("{}e{}".format, st.integers(0, 10**20), st.integers(-70, 70))
        # Half way between two doubles, or nearly.
        | st.integers(2**53, 2**54).map(lambda m: str(4 * m + 2)),
        min_size=1,
    )
)
def test_numbers_are_rounded_correctly(texts: list[str]) -> None:
    found = fields("".join(f"a,1,{text},-{text.lstrip('-')}\n" for text in texts))
    assert isinstance(found, lines.Fields)
    want = list(map(float, texts))
    assert found.values[:, 0].tolist() == want
    assert found.values[:, 1].tolist() == [-abs(number) for number in want]


def test_times_in_any_order(write: Callable[[str, str], str]) -> None:
    ordered = read_trajectories(write("a.csv", "id,t,x\na,0.5,1\nb,0.5,2\na,2.5,3\n"))
    other = read_trajectories(write("b.csv", "id,t,x\na,2.5,3\nb,0.5,2\na,0.5,1\n"))
    for name in ("step", "track", "times", "state"):
        assert getattr(ordered, name).tolist() == getattr(other, name).tolist()
