"""The script of docs/theory/published-table.md, on videos that are worked out by hand."""

import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from checkout import DOCS

from tgospa_eval import evaluate

pytestmark = pytest.mark.usefixtures("proven")  # every value has a proof

PAGE = DOCS / "theory" / "published-table.md"
BOX = (100.0, 100.0, 10.0, 20.0)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(DOCS / "theory")
    return import_module("published_table")


def rows(frames: Iterable[int], box: tuple[float, ...] = BOX) -> np.ndarray:
    return np.array([(frame, *box) for frame in frames])


def write(folder: Path, truth: list[np.ndarray], detections: np.ndarray) -> None:
    """One video; a last object of the truth is not to be considered."""
    tracks = [*truth, rows(range(1, 9), (500.0, 500.0, 10.0, 20.0))]
    for part in ("gt", "det"):
        (folder / part).mkdir(parents=True)
    (folder / "gt" / "gt.txt").write_text(
        "".join(
            f"{frame:.0f},{k},{left},{top},{width},{height},{int(k < len(truth))},1,1.0\n"
            for k, track in enumerate(tracks)
            for frame, left, top, width, height in track
        )
    )
    (folder / "det" / "det.txt").write_text(
        "".join(
            f"{frame:.0f},-1,{left},{top},{width},{height},0.9\n"
            for frame, left, top, width, height in detections
        )
    )


def scene() -> tuple[list[np.ndarray], np.ndarray]:
    """Three people walk; each is missed for a frame, and there are false detections of a frame."""
    rng = np.random.default_rng(0)
    frames = np.arange(1.0, 41)
    truth, seen = [], []
    for k in range(3):
        left, top = 100 + 300 * k + (3 - 2 * k) * frames, 200 + 50 * k + frames
        truth.append(np.column_stack((frames, left, top, np.full((40, 2), (40, 90)))))
        seen.append(np.delete(truth[-1], 15 + 7 * k, axis=0))
        seen[-1][:, 1:] += rng.normal(size=(39, 4))
    false = np.array([(12, 50, 600, 40, 90), (13, 900, 20, 40, 90), (30, 700, 500, 40, 90)])
    return truth, np.concatenate((*seen, false))


def run(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *arguments: object) -> None:
    monkeypatch.setattr(sys, "argv", ["published_table.py", *map(str, arguments)])
    script.main()


@pytest.mark.parametrize(
    ("seen", "reported"),
    [
        (range(1, 7), {1: range(1, 7)}),  # in the first frames at once
        (range(5, 12), {1: range(8, 12)}),  # later with the third detection after the first
        ([*range(1, 8), *range(9, 14)], {1: [*range(1, 8), *range(11, 14)]}),  # survives 1 frame
        ([*range(1, 8), *range(10, 16)], {1: range(1, 8), 2: range(13, 16)}),  # and not 2
    ],
)
def test_when_a_track_is_reported(
    script: ModuleType, seen: Iterable[int], reported: dict[int, Iterable[int]]
) -> None:
    found = script.sort(rows(seen))
    assert {k: [f for f, i, _ in found if i == k] for k in {i for _, i, _ in found}} == {
        k: list(frames) for k, frames in reported.items()
    }
    np.testing.assert_allclose([box for *_, box in found], [BOX] * len(found), rtol=1e-12)


def test_a_gain_of_the_filter(script: ModuleType) -> None:
    track = script.Track(id=1, mean=np.array([0, 0, 200, 0.5, 0, 0, 0.0]), covariance=script.BIRTH)
    track.predict()
    assert track.covariance[0, 0] == 10 + 1e4 + 1
    track.update(np.array([10011 / 10012 + 2, 0, 200, 0.5]))
    gain = 10011 / 10012, 1e4 / 10012
    assert track.mean[[0, 4]] == pytest.approx(np.multiply(gain, 10011 / 10012 + 2))


def test_overlap(script: ModuleType) -> None:
    found = script.overlaps(rows([1])[:, 1:], np.array([BOX, (106, 100, 10, 20), (300, 0, 1, 1)]))
    assert found.tolist() == [[1, 0.25, 0]]


def test_people_keep_their_tracks(script: ModuleType) -> None:
    truth, detections = scene()
    found = script.sort(detections)
    owner: dict[int, set[int]] = {}
    for frame, track, box in found:
        iou = script.overlaps(np.array([t[frame - 1, 1:] for t in truth]), box[None])[:, 0]
        assert iou.max() > 0.8
        owner.setdefault(track, set()).add(int(iou.argmax()))
    assert sorted(owner.values(), key=min) == [{0}, {1}, {2}]
    assert len(found) == 3 * (40 - 1 - 2)  # missed for one frame, and two that it needs anew


def test_totals_worked_out_by_hand(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """IoU of 1/4 in 10 frames; a switch with 5 missed; 6 false boxes beside an exact track."""
    far = rows(range(1, 7), (300.0, 300.0, 10.0, 20.0))
    shifted = rows(range(1, 11), (106.0, 100.0, 10.0, 20.0))
    gap = rows([*range(1, 20), *range(22, 41)])
    write(tmp_path / "MOT17-02-FRCNN", [rows(range(1, 11))], shifted)
    write(tmp_path / "MOT17-04-FRCNN", [rows(range(1, 41))], gap)
    exact = rows(range(1, 11))
    write(tmp_path / "MOT17-09-FRCNN", [exact], np.concatenate((exact, far)))
    run(script, monkeypatch, tmp_path)
    printed = capsys.readouterr().out
    p = script.ORDER
    for name, values in {
        "MOT17-02": (5 ** (1 / p), 5, 10, 0, 0, 0),
        "MOT17-04": (12.5 ** (1 / p), 0, 35, 5, 0, 1),
        "MOT17-09": (3 ** (1 / p), 0, 10, 0, 6, 0),
    }.items():
        published = script.line(name, "published", script.PUBLISHED[name])
        assert f"{published}\n{script.line('', 'here', values)}\n" in printed


def test_the_evaluation_is_that_of_the_files(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    truth, detections = scene()
    for name in script.PUBLISHED:
        write(tmp_path / f"{name}-FRCNN", truth, detections)
    run(script, monkeypatch, tmp_path, "--output", tmp_path / "tracks", "--order", 2)
    result = evaluate(
        tmp_path / "MOT17-04-FRCNN" / "gt" / "gt.txt",
        tmp_path / "tracks" / "MOT17-04.txt",
        cutoff=1,
        order=2,
        switch_penalty=10 ** (np.log(4 / 3) / np.log(2)),
        distance="iou",
    )
    assert result.counts == {"missed": 9, "false": 0, "switch": 0}
    printed = capsys.readouterr().out
    assert printed.count(script.line("", "here", script.values_of(result))) == 3
    proven = f"{result.lower_bound!r} <= TGOSPA <= {result.upper_bound!r}"
    assert printed.count(proven) == 3


def test_a_folder_without_the_data_gets_one_sentence(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match=r"^3$"):
        run(script, monkeypatch, tmp_path)
    out, err = capsys.readouterr()
    missing = tmp_path / "MOT17-02-FRCNN" / "gt" / "gt.txt"
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"error: {missing} is missing: ")


def test_no_detections_get_one_sentence(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in script.PUBLISHED:
        write(tmp_path / f"{name}-FRCNN", [rows([1])], rows([1]))
    (tmp_path / "MOT17-02-FRCNN" / "det" / "det.txt").write_text("no numbers\n")
    with pytest.raises(SystemExit, match=r"^3$"):
        run(script, monkeypatch, tmp_path)
    err = capsys.readouterr().err
    assert "det.txt: no detections of MOTChallenge" in err
    assert err.count("\n") == 1


def test_the_page_shows_what_the_script_prints(script: ModuleType) -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert f"p = {script.ORDER!r}, gamma = {script.SWITCH_PENALTY!r}\n\n{script.HEADER}\n" in page
    for name, values in script.PUBLISHED.items():
        assert f"\n{script.line(name, 'published', values)}\n          here  " in page
