"""What a terminal gets: the table in colours; and what a pipe goes on getting."""

import os
import pty
import re
import select
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from browser import PATIENCE

from tgospa_eval import evaluate
from tgospa_eval.show.result_text import report, table

COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def on_terminal(
    arguments: list[str], folder: Path, env: dict[str, str], stream: str = "stdout"
) -> str:
    """What the command shows on a terminal of its own, of 60 columns."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 60))
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen(
        [sys.executable, "-m", "tgospa_eval", *arguments],
        **streams | {stream: theirs}, cwd=folder, env=env,
    )  # fmt: skip
    os.close(theirs)
    shown = b""
    while select.select([ours], [], [], PATIENCE)[0]:
        try:
            part = os.read(ours, 1 << 16)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait(PATIENCE) == 0
    return shown.decode().replace("\r\n", "\n")


def test_a_terminal_gets_colours_and_80_columns(
    quickstart: tuple[str, str], tmp_path: Path, environment: dict[str, str]
) -> None:
    more = "--curve", "--window", "12"
    shown = on_terminal([*quickstart, "-c", "10", "-g", "5", *more], tmp_path, environment)
    assert "\x1b[1;32mTGOSPA = 42.5352" in shown
    lines = COLOUR.sub("", shown).splitlines()
    assert max(map(len, lines)) <= 80
    assert any("1: 101 -> 103" in line for line in lines)
    assert any(line.startswith("TGOSPA per step of the steps up to t") for line in lines)
    assert any(line.startswith("TGOSPA of 9 windows of 12 steps") for line in lines)


UNLIKE = "  seconds "
"""A line that no two runs share."""


def kept(text: str) -> list[str]:
    """Lines of a table that a terminal and a pipe show alike."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith(UNLIKE)]


def has_all(shown: str, plain: str) -> bool:
    """Whether a terminal shows every line of the plain table, in the same order."""
    lines = iter(COLOUR.sub("", shown).splitlines())
    return all(line in lines for line in kept(plain))


OPTIONS: dict[str, tuple[str, ...]] = {
    "slice": ("--slice", "age=0:5:60"),
    "curve": ("--curve",),
    "window": ("--window", "12"),
    "explain": ("--explain",),
    "with": ("--with", "hota,gospa"),
    "similarity": ("--similarity", "2"),
    "step-weights": ("--step-weights", "{folder}/weights.csv"),
    "existence": ("--existence", "use"),
    "by": ("--by", "class"),
}
"""Each adds lines to the table."""


def scene(folder: Path, quickstart: tuple[str, str]) -> list[str]:
    """The files of the quickstart with classes, probabilities of existence and weights."""
    pandas, paths = pytest.importorskip("pandas"), []
    for path in map(Path, quickstart):
        rows = pandas.read_csv(path)
        rows["class"] = np.where(rows["id"] % 100 < 3, "car", "van")
        rows["existence"] = 0.9
        rows.to_csv(folder / path.name, index=False)
        paths.append(path.name)
    weights = pandas.DataFrame({"t": range(100)}).assign(weight=2.0)
    weights.to_csv(folder / "weights.csv", index=False)
    return [*paths, "-c", "10", "-g", "5"]


@pytest.mark.parametrize("name", OPTIONS)
def test_a_terminal_shows_every_block_of_the_table(
    name: str,
    invoke: Callable,
    quickstart: tuple[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = [*scene(tmp_path, quickstart), "-q"]
    asked = (*given, *(text.format(folder=tmp_path) for text in OPTIONS[name]))
    without, plain = invoke(*given).out, invoke(*asked).out
    assert set(kept(plain)) - set(kept(without))
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert has_all(invoke(*asked).out, plain)


def test_a_pseudo_terminal_shows_all_blocks_together(
    invoke: Callable,
    quickstart: tuple[str, str],
    tmp_path: Path,
    environment: dict[str, str],
) -> None:
    given = [*scene(tmp_path, quickstart), "-q"]
    for name in ("slice", "curve", "window", "explain", "with", "similarity"):
        given += OPTIONS[name]
    assert has_all(on_terminal(given, tmp_path, environment), invoke(*given).out)


def test_long_stamps_lose_no_digit_that_tells_them_apart(
    invoke: Callable, write: Callable[[str, str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stamps = [f"2014-06-24T19:03:{k:02}.163556123Z" for k in range(9)]
    truth = write("t.csv", "id,t,x\n" + "".join(f"a,{t},0\n" for t in stamps))
    estimate = write(
        "e.csv", "id,t,x\n" + "".join(f"{k // 5},{t},{k / 9}\n" for k, t in enumerate(stamps))
    )
    given = (truth, estimate, "-q", "--curve", "--window", "4")
    plain = invoke(*given).out
    assert all(stamp in plain for stamp in stamps[4:])  # the worst steps, whole
    assert f" {stamps[5]}  a: 0 -> 1\n" in plain  # the switch
    assert f"\n  {stamps[8]}\n" in plain  # the curve, with a line of its own
    assert f"\n  {stamps[4]} to {stamps[7]}\n" in plain  # a window, with a line of its own
    monkeypatch.setenv("FORCE_COLOR", "1")
    lively = COLOUR.sub("", invoke(*given).out)
    assert max(map(len, (plain + lively).splitlines())) <= 80


def test_stamps_are_cut_where_all_of_the_recording_begin_alike(
    invoke: Callable, write: Callable[[str, str], str]
) -> None:
    stamps = [f"2014-06-{day:02}T19:03:00.163556123Z" for day in (1, 2, 13, 14)]
    names = ("a", "b" * 40)
    truth = write("t.csv", "id,t,x\n" + "".join(f"{names[1]},{t},0\n" for t in stamps))
    estimate = write(
        "e.csv", "id,t,x\n" + "".join(f"{names[k // 2]},{t},0\n" for k, t in enumerate(stamps))
    )
    shown = invoke(truth, estimate, "-q", "--curve", "-c", "10", "-g", "1").out
    assert max(map(len, shown.splitlines())) <= 80
    assert "..." not in re.sub(r"b+\.\.\.", "", shown)  # of one switch the stamps begin alike
    assert all(f"\n  {stamp}\n" in shown for stamp in stamps)  # of the curve, a line of their own


@pytest.mark.parametrize("stamp", ["{}", "2014-06-{:02}T19:03:00.163556123Z"])
@pytest.mark.parametrize("size", [12, 36, 60])
def test_switches_of_long_ids_are_on_several_lines(
    stamp: str, size: int, invoke: Callable, write: Callable[[str, str], str]
) -> None:
    """No line is cut; ids as long as a UUID are whole, of longer ones the ends are there."""
    stamps = [stamp.format(t) for t in (1, 12, 13, 24)]
    truth, *estimates = (f"{name}-{'0' * (size - 6)}-{name}" for name in ("tr", "aa", "zz"))
    rows = "".join(f"{truth},{t},0\n" for t in stamps)
    found = "".join(f"{estimates[k // 2]},{t},0\n" for k, t in enumerate(stamps))
    given = write("t.csv", "id,t,x\n" + rows), write("e.csv", "id,t,x\n" + found)
    shown = invoke(*given, "-q", "-c", "10", "-g", "1").out
    block = shown[shown.index("  switches") : shown.index("  solver")].splitlines()
    assert max(map(len, block)) <= 80
    words = " ".join(block).split()
    names = [truth, *estimates] if size < 40 else ["00-tr", "00-aa", "00-zz"]
    arrow = words.index("->", words.index("->") + 1)  # the first is that of the head
    ends = words[arrow - 2].removesuffix(":"), words[arrow - 1], words[arrow + 1]
    assert all(end.endswith(name) for end, name in zip(ends, names, strict=True))
    assert all(len(end) == size or end.startswith("...") for end in ends)
    assert stamps[2] in words


def test_notices_are_wrapped_on_a_terminal_alone(
    quickstart: tuple[str, str], run: Callable, tmp_path: Path, environment: dict[str, str]
) -> None:
    shown = on_terminal([*quickstart], tmp_path, environment, "stderr").splitlines()
    piped = run(*quickstart).err.splitlines()
    assert max(map(len, piped)) > 60
    wide = [line for line in shown if len(line) > 60]
    assert all(" " not in line.strip() for line in wide)  # but for paths, which stay whole
    assert " ".join(line.strip() for line in shown) == " ".join(piped)
    assert any(line.startswith("  ") for line in shown)


@pytest.mark.parametrize("name", ["NO_COLOR", "TERM"])
def test_colours_can_be_declined(
    quickstart: tuple[str, str], tmp_path: Path, environment: dict[str, str], name: str
) -> None:
    env = environment | ({"NO_COLOR": "1"} if name == "NO_COLOR" else {"TERM": "dumb"})
    shown = on_terminal(list(quickstart), tmp_path, env)
    assert not re.search(r"\x1b\[[0-9;]*3[0-7]m", shown)


def test_a_pipe_gets_the_plain_table(run: Callable, quickstart: tuple[str, str]) -> None:
    out = run(*quickstart, env={"FORCE_COLOR": ""}).out
    assert out.isascii()


def test_ids_are_no_markup_and_lines_are_those_of_the_table() -> None:
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame(
        {"id": ["[red]x[/red]", "[/]"] * 2, "t": [0, 0, 1, 1], "x": [0.0, 9.0, 0.0, 9.0]}
    )
    result = evaluate(rows, rows.iloc[:0], cutoff=2.0, order=1)
    shown = COLOUR.sub("", report(result))
    assert "[/]  [red]x[/red]" in shown
    assert shown == table(result)
