"""Which jobs there are, what is stored of them, and what survives a kill."""

import errno
import os
from pathlib import Path

import pytest
from answer import Write
from stored import settings_of, stored_row

from tgospa_eval import ConfigError, InputError
from tgospa_eval.api.options import FLAGS
from tgospa_eval.campaign import pairs as jobs
from tgospa_eval.campaign.store import Store
from tgospa_eval.campaign.sums import tabulated


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two sequences; tracker b lacks one of them, and has one without truth."""
    for name in ("gt/s1.csv", "gt/s2.csv", "out/a/s1.csv", "out/a/s2.csv", "out/b/s1.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_patterns(tree: Path) -> None:
    plan = jobs.of_patterns("gt/{sequence}.csv", "out/{tracker}/{sequence}.csv")
    assert [dict(job.labels) for job in plan.jobs] == [
        {"tracker": "a", "sequence": "s1"},
        {"tracker": "a", "sequence": "s2"},
        {"tracker": "b", "sequence": "s1"},
    ]
    assert plan.jobs[2].truth == "gt/s1.csv"
    assert plan.faults == ("gt/s2.csv: there is no estimate out/b/s2.csv",)
    (tree / "out/b/s9.csv").touch()
    plan = jobs.of_patterns("gt/{sequence}.csv", "out/{tracker}/{sequence}.csv")
    assert "out/b/s9.csv: ground truth gt/s9.csv does not exist" in plan.faults
    with pytest.raises(ConfigError, match=r'the field \{run\} is not in estimate="'):
        jobs.of_patterns("gt/{run}.csv", "out/{tracker}/{sequence}.csv")
    with pytest.raises(ConfigError, match="no file matches"):
        jobs.of_patterns("gt/{sequence}.csv", "none/{sequence}.csv")


def test_a_path_that_fits_a_pattern_in_two_ways(tree: Path) -> None:
    for name in ("x_y.csv", "x_y_z.csv"):
        (tree / name).touch()
    plan = jobs.of_patterns("gt/s1.csv", "{tracker}_{run}.csv")
    assert [dict(job.labels) for job in plan.jobs] == [{"tracker": "x", "run": "y"}]
    assert plan.faults == ("x_y_z.csv: the fields of {tracker}_{run}.csv match it in two ways",)


def test_layout_and_seqmap(tree: Path, write: Write) -> None:
    for name in ("g/s1/gt/gt.txt", "g/s2/gt/gt.txt", "t/a/data/s1.txt", "t/a/data/s2.txt"):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).touch()
    names = jobs.read_sequences(write("map.txt", "name\ns2\n"))
    (job,) = jobs.of_layout("motchallenge", "g", "t", names).jobs
    assert (job.truth, job.estimate) == (
        os.path.join("g", "s2/gt/gt.txt"), os.path.join("t", "a/data/s2.txt")
    )  # fmt: skip
    with pytest.raises(InputError, match="has no sequence"):
        jobs.read_sequences(write("map.txt", "name\n"))


def touch(*names: str) -> None:
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).touch()


def test_a_seqmap_keeps_what_is_missing_of_other_sequences_out(tree: Path) -> None:
    touch("g/s1/gt/gt.txt", "g/s1-DPM/gt/gt.txt", "t/a/data/s1.txt", "t/b/data/s1-DPM.txt")
    assert jobs.of_layout("motchallenge", "g", "t", ["s1"]).faults == ()
    plan = jobs.of_layout("motchallenge", "g", "t", ["s1-DPM", "s1", "s7"])
    assert len(plan.jobs) == 2
    lone = os.path.join("g", "s1-DPM/gt/gt.txt"), os.path.join("t", "a/data/s1-DPM.txt")
    assert f"{lone[0]}: there is no estimate {lone[1]}" in plan.faults
    assert plan.faults[-1] == "sequence s7: there is no truth, or no tracker has it"


def test_layout_of_kitti_as_trackeval_has_it(tree: Path, write: Write) -> None:
    touch(
        "gt/kitti/kitti_2d_box_train/label_02/0000.txt",
        "gt/kitti/kitti_2d_box_train/label_02/0001.txt",
        "trackers/kitti/kitti_2d_box_train/CIWT/data/0000.txt",
        "trackers/kitti/kitti_2d_box_train/CIWT/data/0001.txt",
        "trackers/kitti/kitti_2d_box_train/CIWT/car_summary.txt",
    )
    seqmap = write("evaluate_tracking.seqmap.training", "0000 empty 000000 000154\n")
    folders = (f"{side}/kitti/kitti_2d_box_train" for side in ("gt", "trackers"))
    (job,) = jobs.of_layout("kitti", *folders, jobs.read_sequences(seqmap)).jobs
    assert dict(job.labels) == {"tracker": "CIWT", "sequence": "0000"}


@pytest.mark.parametrize(
    ("truth", "trackers", "name"),
    [
        ("data", "data/MOT17-train", "data/gt/MOT17-train"),
        ("data/gt", "trackers/MOT17-train", "data/gt/MOT17-train"),
        ("data/gt/MOT17-train/s1", "trackers/MOT17-train", "data/gt/MOT17-train"),
        ("data/gt/MOT17-train", "trackers", "one of trackers/MOT17-train, trackers/MOT20-train"),
        ("data/gt/MOT17-train", "trackers/MOT17-train/a/data", "trackers/MOT17-train"),
    ],
)
def test_the_right_level_of_a_layout_is_named(
    tree: Path, truth: str, trackers: str, name: str
) -> None:
    touch("data/gt/MOT17-train/s1/gt/gt.txt", "data/gt/seqmaps/MOT17-train.txt")
    touch("trackers/MOT17-train/a/data/s1.txt", "trackers/MOT20-train/{a}/data/s1.txt")
    with pytest.raises(ConfigError) as caught:
        jobs.of_layout("motchallenge", truth, trackers)
    assert f'as layout="motchallenge" needs; name {name}' in str(caught.value)


def test_folders_of_a_layout_that_are_not_there_or_have_braces(tree: Path) -> None:
    touch("{x}/s/gt/gt.txt", "[t]/{a}/data/s.txt")
    (job,) = jobs.of_layout("motchallenge", "{x}", "[t]").jobs
    assert dict(job.labels) == {"tracker": "{a}", "sequence": "s"}
    with pytest.raises(ConfigError, match=r"^none: no such folder, as layout"):
        jobs.of_layout("motchallenge", "none", "[t]")


OPTIONS = {key.replace("-", mark) for key in FLAGS for mark in "-_"}

ALMOST_OPTIONS = (
    *((name, "cutoff") for name in ("c", "Cutoff", "cut-off", "cutoff ", "cutof", "cotoff")),
    *((name, "switch-penalty") for name in ("g", "gamma", "switchpenalty", "switch penalty",
                                            "SWITCH-PENALTY", "swich-penalty")),
    ("P", "order"),
    ("Truth_Class", "truth-class"),
)  # fmt: skip


def test_manifest(tree: Path, write: Write) -> None:
    path = write(
        "m.csv",
        "truth,estimate,run,cutoff\ngt/s1.csv,out/a/s1.csv,1,5\ngt/s2.csv,none.csv,2,\n",
    )
    plan = jobs.of_manifest(path, {"cutoff"})
    (job,) = plan.jobs
    assert (dict(job.labels), dict(job.options)) == ({"run": "1"}, {"cutoff": "5"})
    assert plan.faults == (f"{path}, line 3: {tree / 'none.csv'} does not exist",)
    path = write("blank.csv", "truth,estimate,run\ngt/s1.csv,out/a/s1.csv, \n")
    assert dict(jobs.of_manifest(path, {"cutoff"}).jobs[0].labels) == {"run": '""'}
    for text, message in (
        ("a,b\n", "line 1: no column truth and estimate; a manifest has the columns truth and"),
        ("truth,b\n", "line 1: no column estimate; a manifest has the columns truth and"),
        ("truth,estimate\n1\n", "line 2: 1 fields, the header has 2"),
        ("truth,estimate,run\n", "m.csv: has no jobs, only a header; add a line for each job"),
        *(
            (
                f"truth,estimate,{name}\na,b,1\n",
                f'column "{name}" is not an option; did you mean {meant}\\?',
            )
            for name, meant in ALMOST_OPTIONS
        ),
        ("truth,estimate,run\na,b," + "x" * 200_000, "line 2: field larger than field limit"),
        (
            "truth,estimate,run\n" + "gt/s1.csv,out/a/s1.csv,1\n" * 2,
            "add a column with different values",
        ),
    ):
        with pytest.raises(InputError, match=message):
            jobs.of_manifest(write("m.csv", text), OPTIONS)
    labels = "confirm,c1,instance,iteration,sample,step"
    row = "gt/s1.csv,out/a/s1.csv, 1 ,2,3,4,5,6\n"
    (job,) = jobs.of_manifest(write("m.csv", f"truth,estimate,{labels}\n{row}"), OPTIONS).jobs
    assert dict(job.labels) == dict(zip(labels.split(","), "123456", strict=True))
    (fault,) = jobs.of_manifest(write("m.csv", "truth,estimate\ngt,out/a/s1.csv\n"), ()).faults
    assert fault.endswith(f"m.csv, line 2: {tree / 'gt'} is a folder; batch takes files")


def test_the_store_keeps_the_last_row_that_is_done(tmp_path: Path) -> None:
    store = Store(str(tmp_path / "s"))
    store.open(settings_of(5.0))
    store.add([stored_row("a", "failed", 1), stored_row("b", "done", 2)])
    store.add([stored_row("a", "done", 3), stored_row("b", "failed", 4)])
    assert store.rows()[["key", "status"]].values.tolist() == [["a", "done"], ["b", "done"]]
    store.add([stored_row("c", "done", 5, **{"label.run": "b"})])  # b, with a file that has changed
    assert store.rows()["key"].tolist() == ["a", "c"]
    store.expect(["c", "d"])
    assert (store.rows()["key"].tolist(), store.unfinished(1)) == (["c"], "1 of 2 jobs are done")
    store.expect(["d"])
    assert store.rows().empty
    store.open(settings_of(5.0))
    with pytest.raises(ConfigError, match=r"options.cutoff was 5.0, is 6.0"):
        store.open(settings_of(6.0))
    with pytest.raises(InputError, match="is not a batch: "):
        Store(str(tmp_path)).settings()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(ConfigError, match="is not empty and not a batch"):
        Store(str(tmp_path / "other")).open(settings_of(5.0))


def parts_of(store: Store) -> list[str]:
    return sorted(path.name for path in (store.folder / "jobs").iterdir())


def test_a_damaged_part_is_named_and_a_full_disk_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(str(tmp_path / "s"))
    store.open(settings_of(5.0))
    store.add([stored_row("1", "done", 1)])
    before, names = store.rows(), parts_of(store)

    def full(_: object, path: Path) -> None:
        path.write_bytes(b"PAR1")
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("pyarrow.parquet.write_table", full)
        with pytest.raises(ConfigError, match="cannot be written: No space left on device"):
            store.add([stored_row("4", "done", 4)])
    assert parts_of(store) == names
    assert store.rows().equals(before)
    path = store.folder / "jobs" / names[0]
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"part-.*\.parquet: cannot be read"):
        store.rows()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"total_upper": 0.15}, "total_lower is 1.49999999999999, but total_upper is 0.15"),
        ({"upper_bound": 9.0}, "tgospa is 1.22474487139159, but upper_bound is 9"),
        ({"total": 2.0}, "total is 2, but total_upper is 1.5"),
        ({"missed": 1.0}, "total is 1.5, but localisation, missed, false, switch sum to 2.5"),
        ({"counts.missed": 2.0}, "missed is 0, but counts.missed makes it 9"),
        ({"normalised.tgospa": 3.0}, "normalised.tgospa is 3, but total and judged.steps make"),
        ({"judged.steps": 5}, "normalised.tgospa is 0.70710678118"),
        ({"localisation_mean": 1.0, "localisation_spread": 1.0}, "localisation is 1.5, but"),
        ({"cutoff": 4.0}, "cutoff is 4.0, but parameters.cutoff is 3.0"),
        ({"tgospa": -1.0}, "row 1: tgospa is -1.0; expected a finite number >= 0"),
        ({"tgospa": float("nan")}, "tgospa is NaN; expected a finite number >= 0"),
        ({"tgospa": None}, "tgospa is null; expected a finite number >= 0"),
        ({"certified": "yes"}, 'certified is "yes"; expected true or false'),
        ({"judged.steps": "3"}, 'judged.steps is "3"; expected a whole number >= 0'),
        ({"options": "[]"}, "options is a list; expected an object"),
        ({"warnings": '[{"code": "x"}]'}, r"warnings\[0\].text: is missing; expected a text"),
        ({"parameters": "{"}, "row 1: parameters: Expecting property name"),
        ({"status": "new"}, 'status is "new"; expected one of done, open, failed'),
        ({"with.clear.MOTA": "x"}, "with.clear.MOTA is .x.; expected a finite number, a list"),
        ({"nees.sums": "{}"}, "nees.sums.components: is missing; expected a whole number > 0"),
    ],
)
def test_rows_that_contradict_themselves_are_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    store = Store(str(tmp_path / "s"))
    store.open(settings_of(5.0))
    store.add([stored_row("a", "done", 1) | change])
    with pytest.raises(InputError, match=rf"jobs.part-\w+-\w+.parquet: .*{message}.*; delete the"):
        store.rows()


def test_a_row_lacks_a_column(tmp_path: Path) -> None:
    store, row = Store(str(tmp_path / "s")), stored_row("a", "done", 1)
    store.open(settings_of(5.0))
    del row["total_upper"]
    store.add([row])
    with pytest.raises(InputError, match="column total_upper: is missing; expected a finite"):
        store.rows()


def test_costs_are_added_and_roots_are_not() -> None:
    import pandas as pd

    base = {
        "status": "done", "certified": True, "distance": "euclidean", "cutoff": 5.0, "order": 2.0,
        "switch_penalty": 1.0, "localisation": 0.0, "missed": 0.0, "false": 0.0, "switch": 0.0,
        "counts.missed": 0.0, "counts.false": 0.0, "counts.switch": 0.0, "judged.steps": 10,
        "truth": "t", "options": "{}", "finished": 1, "judged.steps_sha256": "h",
        "judged.truth_sha256": "d", "parameters": "{}",
    }  # fmt: skip
    rows = pd.DataFrame(
        [
            base | {"label.t": t, "total": v, "total_lower": v - w, "total_upper": v}
            for t, v, w in (("a", 9.0, 0.0), ("a", 16.0, 0.0), ("b", 4.0, 1.0))
        ]
    )
    table = tabulated(rows, ["t"]).groups
    assert table["t"].tolist() == ["a", "b"]
    assert table["combined"].tolist() == [5.0, 2.0]
    assert table["rms"].tolist() == pytest.approx([12.5**0.5, 2.0])
    assert table["per_step"].tolist() == pytest.approx([1.25**0.5, 0.4**0.5])
    assert table["combined_lower"].tolist() == pytest.approx([5.0, 3**0.5])
    assert tabulated(rows, []).groups["combined"].tolist() == pytest.approx([29**0.5])
    # Other parameters are another group, whatever was asked for.
    rows.loc[2, "cutoff"] = 6.0
    assert tabulated(rows, []).groups["cutoff"].tolist() == [5.0, 6.0]
    with pytest.raises(ConfigError, match='by="x": no such label; there are t'):
        tabulated(rows, ["x"])
