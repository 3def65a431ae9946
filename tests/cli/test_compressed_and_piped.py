"""Compressed files and the standard input: the answer of the plain file, or a sentence."""

import gzip
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from answer import Run, Write
from checkout import SAMPLES

from tgospa_eval import InputError
from tgospa_eval.formats import ReadOptions, loading, read
from tgospa_eval.formats.text import lines

zstd = pytest.importorskip(loading.ZSTD)

ASKED = ("-c", "50", "-g", "25", "--format", "csv")
PAIRS = {
    "quickstart": ("truth.csv", "estimate.csv"),
    "motchallenge": ("gt.txt", "res.txt"),
    "kitti": ("gt.txt", "res.txt"),
    "visdrone": ("gt.txt", "res.txt"),
}


@pytest.mark.parametrize("size", [lines.LARGE_BYTES, 0], ids=["small", "large"])
@pytest.mark.parametrize("folder", PAIRS)
def test_compressed_text(
    invoke: Run, write: Write, monkeypatch: pytest.MonkeyPatch, folder: str, size: int
) -> None:
    monkeypatch.setattr(lines, "LARGE_BYTES", size)
    paths = [SAMPLES / folder / name for name in PAIRS[folder]]
    truth, estimate = (path.read_bytes() for path in paths)
    half = len(truth) // 2
    members = gzip.compress(truth[:half]) + gzip.compress(truth[half:])  # as bgzip writes
    packed = (
        write(f"a{paths[0].suffix}.GZ", members),
        write(f"b{paths[1].suffix}.zst", zstd.compress(estimate)),
    )
    want, found = invoke(*map(str, paths), *ASKED), invoke(*packed, *ASKED)
    assert (found.status, found.out) == (0, want.out)
    assert found.err == want.err.replace(str(paths[0]), packed[0]).replace(str(paths[1]), packed[1])


def test_bombs_and_damage(write: Write) -> None:
    zeros = bytes(50_000_000)
    for name, data in (("a.csv.gz", gzip.compress(zeros)), ("a.csv.zst", zstd.compress(zeros))):
        path = write(name, data)
        with pytest.raises(InputError, match=r"unpack to more than 0.033 GB; .*max_input"):
            read(path, ReadOptions(max_input=0.1))
    text = b"id,t,x\n" + b"".join(b"%d,0,1.5\n" % k for k in range(999))
    for pack in (gzip.compress, zstd.compress):
        whole = pack(text)
        assert read(write("a.csv", whole)).rows == 999  # by its first bytes
        flipped = whole[:-6] + b"\xff\xff" + whole[-4:]  # of gzip the checksum
        damaged = (flipped,) if pack is gzip.compress else (whole + b"x",)
        for data in (whole[:-1], whole[:20], *damaged):
            with pytest.raises(InputError, match=r"a\.csv: cannot be unpacked, it is damaged: "):
                read(write("a.csv", data))
        with pytest.raises(InputError, match=r"binary data|compressed"):
            read(write("a.csv", pack(pack(text))))


def test_zstd_that_is_not_installed(
    invoke: Run, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loading, "ZSTD", "backports.none")
    path = write("a.csv.zst", zstd.compress(b"id,t,x\n"))
    done = invoke(path, path)
    assert done.status == 2
    assert "zstd needs the extra zstd: " in done.err
    assert '"tgospa-eval[zstd]"' in done.err


def test_weights_and_matrices_may_be_compressed(invoke: Run, write: Write) -> None:
    table = write("a.csv", "id,t,x,y\n1,0,0,0\n1,1,0,0\n")
    weights = write("w.csv.gz", gzip.compress(b"t,weight\n0,1\n1,2\n"))
    matrix = write("c.csv.gz", gzip.compress(b"4,0\n0,4\n"))
    asked = ("--step-weights", weights, "--distance", "mahalanobis", "--covariance", matrix)
    assert invoke(table, table, *asked, "-c", "1", "-g", "1").status == 0


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[[bytes], None]]:
    """Hand bytes to the standard input."""
    with ExitStack() as opened:

        def pipe(data: bytes) -> None:
            (tmp_path / "piped").write_bytes(data)
            monkeypatch.setattr(sys, "stdin", opened.enter_context((tmp_path / "piped").open()))

        yield pipe


def test_one_side_from_the_standard_input(
    invoke: Run, monkeypatch: pytest.MonkeyPatch, pipe: Callable[[bytes], None]
) -> None:
    truth, estimate = (str(SAMPLES / "quickstart" / name) for name in PAIRS["quickstart"])
    want = invoke(truth, estimate, *ASKED).out
    for path in (truth, estimate):
        for size in (lines.LARGE_BYTES, 0):
            monkeypatch.setattr(lines, "LARGE_BYTES", size)
            pipe(gzip.compress(Path(path).read_bytes()) if size else Path(path).read_bytes())
            sides = ["-" if side == path else side for side in (truth, estimate)]
            assert invoke(*sides, *ASKED).out == want
    pipe(Path(estimate).read_bytes())
    found = json.loads(invoke(truth, "-", "-c", "50", "-g", "25", "--format", "json").out)
    assert found["files"] == {"truth": truth, "estimate": "<stdin>"}
    done = invoke("compare", truth, "-", estimate, "-c", "50", "-g", "25", "--format", "csv")
    assert (done.status, "<stdin>" in done.out) == (0, True)
    assert "<stdin>" in invoke("inspect", "-", truth).out
    for arguments in (("-", "-"), ("inspect", "-", "-"), ("compare", "-", "-")):
        done = invoke(*arguments)
        assert (done.status, done.out) == (2, "")
        assert "- is the standard input, which can be one file only" in done.err
    pipe(b"id,t,x\n1,0,one\n")
    done = invoke("-", truth)
    assert (done.status, done.err) == (
        3,
        '<stdin>, line 2, column "x": not a number: "one"; leave it blank where the '
        "object is absent\n",
    )
    pipe(bytes(100_000))
    assert "larger than" in invoke("-", truth, "--max-input", "1e-5").err
    monkeypatch.setattr(sys, "stdin", None)
    done = invoke("-", truth)
    assert (done.status, done.err) == (3, "<stdin>: there is none, it is closed; name a file\n")
