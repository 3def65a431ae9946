"""--geojson: what programs with maps open."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import ConfigError, evaluate

TRUTH = pd.DataFrame(
    {
        "id": ["a"] * 4 + ["b"],
        "t": [0, 1, 2, 3, 3],
        "lat": [10.0, 10.0, 10.0, 10.0, 50.0],
        "lon": [179.99, 180.0, 180.01, -179.98, 7.0],
    }
)
ESTIMATE = pd.DataFrame(
    {
        "id": ["1", "1", "2", "3"],
        "t": [0, 1, 2, 2],
        "lat": [10.0001, 10.0001, 10.0001, -33.0],
        "lon": [179.99, -180.0, -179.99, 151.0],
    }
)
METRIC = {"cutoff": 100, "switch_penalty": 30, "distance": "haversine"}


def test_features_are_places_with_costs_that_add_up() -> None:
    result = evaluate(TRUTH, ESTIMATE, **METRIC)
    document = json.loads(result.to_geojson())
    assert document["type"] == "FeatureCollection"
    own = [(one["properties"], one["geometry"]) for one in document["features"]]
    kinds = Counter(about["kind"] for about, _ in own)
    assert kinds == {"truth": 2, "estimate": 3, "error": 3, "missed": 2, "false": 1, "switch": 1}
    parts = ("error", "missed", "false", "switch")
    costs = sum(about["cost"] for about, _ in own if about["kind"] in parts)
    assert costs == pytest.approx(result.total)
    tracks = {about["id"]: about for about, _ in own if about["kind"] == "truth"}
    assert (tracks["a"]["first"], tracks["a"]["last"], tracks["a"]["states"]) == (0, 3, 4)
    for about, shape in own:
        if about["kind"] == "missed" and about["id"] == "b":
            assert shape == {"type": "Point", "coordinates": [7.0, 50.0]}
        if about["kind"] == "switch":
            assert about["truth"] == "a"
            assert "from" in about
    # A line across the date line is parted there; longitudes are from -180 to 180.
    (line,) = [shape for about, shape in own if about["kind"] == "truth" and about["id"] == "a"]
    assert line["type"] == "MultiLineString"
    (track,) = [shape for about, shape in own if about["kind"] == "estimate" and about["id"] == "1"]
    assert [place[0] for part in track["coordinates"] for place in part] == [
        *([179.99] * 2),
        *([-180.0] * 2),
    ]


def test_local_axes_are_brought_back_to_the_earth(tmp_path: Path, invoke) -> None:
    pytest.importorskip("pyproj")
    local = pd.DataFrame({"id": 1, "t": [0, 1], "x": [3000.0, 3100.0], "y": [-4000.0, -4000.0]})
    options = {"cutoff": 100, "switch_penalty": 1, "estimate_crs": "enu", "origin": (55.7, 12.6)}
    place = TRUTH.head(2).assign(lat=[55.664058, 55.664057], lon=[12.647700, 12.649290])
    document = json.loads(evaluate(place, local, **options).to_geojson())
    lines = {one["properties"]["kind"]: one["geometry"] for one in document["features"]}
    assert np.allclose(lines["truth"]["coordinates"], place[["lon", "lat"]], atol=1e-9)
    assert np.allclose(lines["estimate"]["coordinates"], place[["lon", "lat"]], atol=1e-5)

    for name, table in (("truth", place), ("estimate", local)):
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    crs = ("--estimate-crs", "enu", "--origin", "55.7,12.6", "-c", "100", "-g", "1")
    answer = invoke("truth.csv", "estimate.csv", *crs, "-o", "out", "--geojson", "-q")
    assert answer.status == 0
    assert json.loads((tmp_path / "out/result.geojson").read_text()) == document


def test_heights_and_classes_stand_with_the_features() -> None:
    pytest.importorskip("pyproj")
    side = TRUTH.assign(alt=1000.0).assign(**{"class": ["ship"] * 4 + ["buoy"]})
    earth = METRIC | {"distance": "geodesic", "columns": "lat,lon,alt"}
    document = json.loads(evaluate(side, side, **earth, by="class").to_geojson())
    assert {one["properties"]["class"] for one in document["features"]} == {"ship", "buoy"}
    buoy = next(
        one["geometry"]
        for one in document["features"]
        if (one["properties"]["kind"], one["properties"]["class"]) == ("truth", "buoy")
    )
    assert buoy == {"type": "Point", "coordinates": [7.0, 50.0, 1000.0]}


def test_what_is_not_on_the_earth_is_refused(invoke) -> None:
    flat = np.zeros((2, 1, 2))
    with pytest.raises(ConfigError, match="needs places on the Earth, and the states are x,y"):
        evaluate(flat, flat, cutoff=1, switch_penalty=1).to_geojson()
    answer = invoke("truth.csv", "estimate.csv", "--geojson")
    assert answer.status == 2
    assert "--geojson needs -o DIR" in answer.err
