"""nuScenes: the answer of the CSV files, what is left out, and what is refused."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run
from checkout import SAMPLES

from tgospa_eval import InputError, evaluate
from tgospa_eval.formats import ReadOptions, read

FOLDER = SAMPLES / "formats"
TABLES, RESULTS = FOLDER / "v1.0-mini", FOLDER / "nuscenes_results.json"
BESIDE = ReadOptions(beside=(str(TABLES),))


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TABLES, tmp_path / "tables"))


def edit(path: Path, change: Callable[[Any], object]) -> Path:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return Path(shutil.copy(RESULTS, tmp_path / "results.json"))


def objects(document: Any) -> list[dict[str, Any]]:
    return [item for items in document["results"].values() for item in items]


def test_the_answer_of_the_csv_files(invoke: Run) -> None:
    scene = evaluate(str(FOLDER / "truth.csv"), str(FOLDER / "estimate.csv"), 10, 2, 5)
    result = evaluate(TABLES, RESULTS, 10, 2, 5)
    assert (result.total, result.lower_bound) == (scene.total, scene.lower_bound)
    assert result.counts == scene.counts
    asked = ("-c", "10", "-g", "5", "--by", "class", "--format", "json")
    want = invoke(str(FOLDER / "truth.csv"), str(FOLDER / "estimate.csv"), *asked)
    found = invoke(str(TABLES), str(RESULTS), *asked)
    document, plainly = json.loads(found.out), json.loads(want.out)
    assert document["by_class"].keys() == plainly["by_class"].keys()
    for name, part in plainly["by_class"].items():
        for key in ("total", "lower_bound", "counts"):
            assert document["by_class"][name][key] == part[key]
    steps = [row["t"] for row in document["per_step"]]
    assert steps == [1_717_243_200_000_000 + 500_000 * step for step in range(1, 13)]
    assert document["input"]["truth"]["left_out"] == {"not tracked": 1, "no points": 1}
    side, plain = read(RESULTS, BESIDE).trajectories, read(FOLDER / "estimate.csv").trajectories
    assert np.array_equal(side.state, plain.state)
    assert side.ids.tolist() == plain.ids.tolist()
    answer = invoke("inspect", str(TABLES), str(RESULTS))
    assert "nuscenes" in answer.out


def test_height_attributes_and_classes() -> None:
    options = ReadOptions(
        columns=("x", "y", "z"), attributes=("score", "size_length", "class"), by_class=True,
        beside=(str(TABLES),),
    )  # fmt: skip
    reading = read(RESULTS, options)
    side = reading.trajectories
    assert set(side.state[:, 2]) == {0.9}
    assert set(side.attributes["score"]) == {0.9}
    assert set(side.attributes["size_length"]) == {4.5}
    assert reading.classes == ("car", "pedestrian", "truck")
    assert np.isnan(read(TABLES, options).trajectories.attributes["score"]).all()


def test_a_sample_without_objects_is_a_step(results: Path, tables: Path) -> None:
    def empty(document: Any) -> None:
        for items in list(document["results"].values())[:5]:
            items.clear()

    edit(results, empty)
    options = ReadOptions(beside=(str(tables),), by_class=True)
    reading = read(results, options)
    assert reading.left_out == {"no object": 5}
    assert len(reading.trajectories.times) == 12
    assert "" not in reading.named
    edit(results, lambda document: [items.clear() for items in document["results"].values()])
    reading = read(results, options)
    assert (len(reading.trajectories.times), len(reading.trajectories.ids)) == (12, 0)
    edit(tables / "sample_annotation.json", list.clear)
    assert read(tables).left_out == {"no object": 12}
    edit(results, lambda document: document["results"].clear())
    assert read(results, options).rows == 0


def test_an_id_is_a_track_in_each_scene(results: Path, tables: Path) -> None:
    edit(tables / "scene.json", lambda rows: rows.append({"token": "2", "name": "scene-0103"}))

    def split(rows: Any) -> None:
        for row in rows[6:]:
            row["scene_token"] = "2"

    edit(tables / "sample.json", split)
    ids = read(results, ReadOptions(beside=(str(tables),))).trajectories.ids.tolist()
    assert {"scene-0061/101", "scene-0103/101", "103", "105"} <= set(ids)
    assert "101" not in ids


def test_where_the_tables_are_found(invoke: Run, results: Path, tables: Path) -> None:
    answer = invoke("inspect", str(results))
    assert (answer.status, answer.out) == (3, "")
    assert "times are in the tables of nuScenes" in answer.err
    truth = shutil.copy(results, tables / "truth.json")  # in the form of results
    answer = invoke(str(truth), str(results), "--format", "csv")
    assert answer.status == 0
    assert invoke("compare", str(tables), str(results), str(truth), "-q").status == 0
    for name in ("sample.json", "scene.json"):
        shutil.copy(tables / name, results.parent / name)
    assert invoke("inspect", str(results)).status == 0
    assert invoke(str(tables), "nothing.json").status == 3
    answer = invoke(str(tables / "sample.json"), str(results))
    assert f"sample.json: one of the tables of nuScenes; name their folder, {tables}" in answer.err
    (results.parent / "sample.json").unlink()
    answer = invoke(str(results.parent), str(results))
    assert (answer.status, "is a folder, not a file; in it: tables" in answer.err) == (3, True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda item: item.pop("tracking_id"), "object 1: no tracking_id"),
        (lambda item: item.update(tracking_id=" "), 'tracking_id is " "'),
        (lambda item: item.update(tracking_id=None), "tracking_id is"),
        (lambda item: item.update(tracking_id="\ud800"), r"tracking_id is .* must be a text"),
        (lambda item: item.update(tracking_name=["car"]), "tracking_name is"),
        (lambda item: item.update(translation=[1, 2]), "translation is .* three numbers"),
        (lambda item: item.update(translation=[1, "2", 3]), "translation is .*finite"),
        (lambda item: item.update(translation=[1, True, 3]), "translation is .*finite"),
        (lambda item: item.update(translation=[1e400, 2, 3]), "translation is .* finite"),
        (lambda item: item.update(translation=[10**400, 2, 3]), "translation is .* finite"),
        (lambda item: item.update(size="big"), "size is"),
        (lambda item: item.update(tracking_score="high"), "tracking_score is"),
        (
            lambda item: (item.pop("tracking_id"), item.update(detection_name="car")),
            "a detection; TGOSPA compares tracks",
        ),
    ],
)
def test_wrong_objects(results: Path, change: Callable[[Any], object], message: str) -> None:
    edit(results, lambda document: change(objects(document)[0]))
    with pytest.raises(InputError, match=message):
        read(results, BESIDE)
    edit(results, lambda document: next(iter(document["results"].values())).insert(0, "car"))
    with pytest.raises(InputError, match="object 1: not an object with keys"):
        read(results, BESIDE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ('{"results": {', "line 1, column 14: not readable JSON"),
        ('{"results": {"a": []}}', 'sample "a" is not in .*sample.json'),
        ('{"results": []}', "not results of nuScenes"),
        ("[1]", "not results of nuScenes"),
        ("[" * 100_000, "not readable JSON: nested too deeply"),
        ('{"results": {"a": ' + "9" * 5000 + "}}", "not readable JSON"),
        (b'{"results": {"\xff": []}}', "not readable JSON"),
        (b"\xff\xfe{", "not readable JSON"),
    ],
)
def test_wrong_documents(write: Callable[..., str], text: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(write("r.json", text), BESIDE, format="nuscenes")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("sample", lambda rows: rows[1].pop("scene_token"), 'row 2: no text "scene_token"'),
        ("sample", lambda rows: rows[1].update(timestamp=1.5), "row 2: timestamp is"),
        ("sample", lambda rows: rows[1].update(timestamp=2**63), "row 2: timestamp is"),
        ("sample", lambda rows: rows.pop(), 'sample ".*" is not in'),
        ("instance", lambda rows: rows[0].update(token="\udfff"), 'row 1: no text "token"'),
        ("instance", lambda rows: rows.clear(), 'instance ".*" is not in instance.json'),
        ("category", lambda rows: rows.append(7), 'row 5: no text "token"'),
        ("sample_annotation", lambda rows: rows[0].pop("translation"), "row 1: no translation"),
        ("sample_annotation", lambda rows: rows[0].update(token=None), 'row 1: no text "token"'),
    ],
)
def test_wrong_tables(
    tables: Path, name: str, change: Callable[[Any], object], message: str
) -> None:
    edit(tables / f"{name}.json", change)
    with pytest.raises(InputError, match=message):
        read(tables)


def test_missing_tables_and_too_large_ones(tables: Path) -> None:
    with pytest.raises(InputError, match=r"sample_annotation.json: .* JSON: reading it needs"):
        read(tables, ReadOptions(max_input=2e-5))
    (tables / "scene.json").unlink()
    assert read(tables).rows == 50
    (tables / "instance.json").unlink()
    with pytest.raises(InputError, match=r"instance.json: no such file"):
        read(tables)
    (tables / "instance.json").write_text("{}")
    with pytest.raises(InputError, match="not a table of nuScenes, which is a list"):
        read(tables)
