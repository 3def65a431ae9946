"""Places and units as people have them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from checkout import SAMPLES

from tgospa_eval import ConfigError, InputError, TgospaWarning, evaluate
from tgospa_eval.common.earth import topocentric

FLIGHT = pd.DataFrame({"id": 1, "t": [0, 1], "lat": 55.0, "lon": 12.0, "alt": [3000.0, 3048.0]})
FEET = FLIGHT.assign(alt=[10000.0, 10000.0])
EARTH = {"distance": "geodesic", "columns": "lat,lon,alt", "cutoff": 500, "switch_penalty": 100}


def test_heights_in_feet_have_a_factor_of_their_own() -> None:
    result = evaluate(FLIGHT, FEET, **EARTH, estimate_scale="alt=0.3048")
    assert result.total == pytest.approx(48.0**2)
    assert result.parameters["estimate_scale"] == {"alt": 0.3048}
    assert evaluate(FEET, FLIGHT, **EARTH, truth_scale="alt=0.3048").total == result.total
    heavier = evaluate(FLIGHT, FEET, **EARTH, estimate_scale="alt=0.3048", vertical_weight=2)
    assert heavier.total == pytest.approx(4 * 48.0**2)


def test_scales_of_columns_are_those_of_arrays_and_covariances() -> None:
    truth = np.zeros((3, 1, 2))
    options = {"cutoff": 5, "switch_penalty": 1}
    found = evaluate(truth, truth + np.array([0.001, 1]), **options, estimate_scale=("x=1000",))
    assert found.total == pytest.approx(3 * 2)
    spread = pd.DataFrame({"id": 1, "t": [0], "x": 0.0, "cov_xx": 1.0})
    wide = {"distance": "gaussian-wasserstein", **options, "estimate_scale": "x=3"}
    assert evaluate(spread, spread, **wide).total == pytest.approx(4.0)  # (3 - 1)^2 of deviations


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"estimate_scale": "z=2"}, '"z" is not a state column; state columns: x,y'),
        ({"truth_scale": "x=0"}, "must be name=number, with a number > 0"),
        ({"truth_scale": "x=1,x=2"}, '"x" is given twice'),
    ],
)
def test_wrong_scales_get_a_message(options: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(np.zeros((3, 1, 2)), np.zeros((3, 1, 2)), cutoff=5, switch_penalty=1, **options)


def test_degrees_need_a_distance_that_is_chosen() -> None:
    options = {"cutoff": 5, "switch_penalty": 1}
    place = FLIGHT.drop(columns="alt")
    for columns in ("lat,lon", "lat,lon,alt"):
        side = place if columns == "lat,lon" else FLIGHT
        with pytest.raises(ConfigError, match='choose distance="haversine" or geodesic'):
            evaluate(side, side, **options, columns=columns)
        plain = evaluate(side, side, **options, columns=columns, distance="euclidean")
        assert plain.total == 0


ORIGIN = (55.7, 12.6)


def radar() -> tuple[pd.DataFrame, np.ndarray, np.ndarray]:
    """Truths up to 200 km around a radar, on the ellipsoid, and range and bearing of each."""
    pyproj = pytest.importorskip("pyproj")
    rng = np.random.default_rng(1)
    bearing, length = rng.uniform(0, 360, 100), rng.uniform(0, 2e5, 100)
    centre = (np.full(100, number) for number in ORIGIN[::-1])
    lon, lat, _ = pyproj.Geod(ellps="WGS84").fwd(*centre, bearing, length)
    rows = {"id": np.arange(100) % 5, "t": np.arange(100) // 5, "lat": lat, "lon": lon}
    return pd.DataFrame(rows), length, bearing


@pytest.mark.parametrize("turn", [0, 90, 37.5])
def test_a_radar_in_local_axes_is_compared_with_places_on_the_earth(turn: float) -> None:
    """To less than a millimetre within 200 km, against geodesics of pyproj."""
    truth, length, bearing = radar()
    angle = np.radians(bearing - turn)
    east, north = length * np.sin(angle), length * np.cos(angle)
    rows = truth[["id", "t"]]
    axes = f":{turn:g}" if turn else ""
    for crs, side in (
        (f"enu{axes}", rows.assign(x=east, y=north)),
        (f"ned{axes}", rows.assign(x=north, y=east)),
        ("range,bearing", rows.assign(range=length, bearing=bearing)),
    ):
        result = evaluate(
            truth, side, cutoff=100, switch_penalty=10, estimate_crs=crs, origin=ORIGIN
        )
        assert result.tgospa < 1e-3
        assert result.parameters["columns"] == ["x", "y"]
        assert result.parameters["estimate_crs"] == crs
        other = evaluate(side, truth, cutoff=100, switch_penalty=10, truth_crs=crs, origin=ORIGIN)
        assert other.tgospa < 1e-3


def test_heights_are_on_straight_axes_at_the_origin() -> None:
    """By hand: a place above the origin is straight up; one a quarter of the Earth away is down."""
    above = pd.DataFrame({"id": 1, "t": [0], "lat": 0.0, "lon": 0.0, "alt": 1000.0})
    far = pd.DataFrame({"id": 1, "t": [0], "lat": 0.0, "lon": 90.0, "alt": 0.0})
    options = {"cutoff": 10, "switch_penalty": 1, "truth_crs": "lat,lon,alt", "origin": "0,0,200"}
    up = pd.DataFrame({"id": 1, "t": [0], "x": 0.0, "y": 0.0, "z": 800.0})
    assert evaluate(above, up, **options, estimate_crs="enu").tgospa < 1e-6
    down = up.assign(z=-800.0)
    assert evaluate(above, down, **options, estimate_crs="ned").tgospa < 1e-6
    axis = 6378137.0
    edge = up.assign(x=axis, z=-axis - 200)
    assert evaluate(far, edge, **options, estimate_crs="enu").tgospa < 1e-6
    polar = up.drop(columns=["x", "y", "z"]).assign(range=800.0, bearing=77.0, elevation=90.0)
    crs = "range,bearing,elevation"
    assert evaluate(above, polar, **options, estimate_crs=crs).tgospa < 1e-6
    # Heights take part where both sides have some.
    flat = up.drop(columns="z")
    assert evaluate(above, flat, **options, estimate_crs="enu").parameters["columns"] == ["x", "y"]


def test_projected_systems_and_places_are_compared_on_the_earth() -> None:
    truth, _, _ = radar()
    pyproj = pytest.importorskip("pyproj")
    utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25833", always_xy=True)
    x, y = utm.transform(truth.lon, truth.lat)
    side = truth[["id", "t"]].assign(x=x, y=y)
    options = {"cutoff": 100, "switch_penalty": 10, "estimate_crs": "EPSG:25833"}
    assert evaluate(truth, side, **options, distance="geodesic").tgospa < 1e-3
    with pytest.raises(ConfigError, match='choose distance="haversine" or geodesic'):
        evaluate(truth, side, **options)


def test_particles_are_converted_and_covariances_are_not() -> None:
    truth, length, bearing = radar()
    angle = np.radians(bearing)
    east, north = length * np.sin(angle), length * np.cos(angle)
    rows = truth[["id", "t"]].assign(x=east, y=north)
    cloud = pd.concat([rows.assign(x=east + s, weight=0.5) for s in (-3, 3)])
    options = {"cutoff": 100, "switch_penalty": 10, "estimate_crs": "enu", "origin": ORIGIN}
    found = evaluate(truth, cloud, **options, distance="cloud-wasserstein")
    assert found.total == pytest.approx(100 * 9, rel=1e-6)
    wide = rows.assign(cov_xx=1.0, cov_xy=0.0, cov_yy=1.0)
    with pytest.raises(InputError, match="has covariances, which are not converted"):
        evaluate(truth, wide, **options, distance="gaussian-wasserstein")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"estimate_crs": "enu"}, "need origin, where the local axes begin"),
        ({"estimate_crs": "EPSG:999999"}, "pyproj does not know this system"),
        ({"estimate_crs": "EPSG:4326"}, "is not projected; for latitudes and longitudes write"),
        ({"estimate_crs": "west"}, "must be lat,lon"),
        ({"estimate_crs": "enu", "origin": "95,1"}, "must be LAT,LON or LAT,LON,ALT"),
        ({"origin": "1,2"}, "needs truth_crs or estimate_crs, such as enu"),
    ],
)
def test_wrong_systems_get_a_message(options: dict[str, str], message: str) -> None:
    truth, _, _ = radar()
    with pytest.raises(ConfigError, match=message):
        evaluate(truth, truth, cutoff=5, switch_penalty=1, **options)


COAST = SAMPLES / "coast"


def test_messages_lead_from_the_files_of_a_coast_to_the_number(invoke) -> None:
    """Semicolons, MMSI with zeros, days first, a zone, axes north and east, a clock ahead."""
    files, metric = (str(COAST / "ais.csv"), str(COAST / "radar.csv")), ("-c", "200", "-g", "100")
    answer = invoke(*files, *metric)
    assert "'%d/%m/%Y %H:%M:%S' reads 2025-04-03" in answer.err
    told = ["--truth-time-format", "%d/%m/%Y %H:%M:%S", "--truth-time-zone", "UTC"]
    answer = invoke(*files, *metric, *told)
    assert (
        "give --estimate-crs enu and --origin LAT,LON of this point (ned: north and east)"
        in answer.err
    )
    told += ["--estimate-crs", "ned", "--origin", "55.6,12.8"]
    assert "the clock of the estimate seems to be 4.6" in invoke(*files, *metric, *told).err
    answer = invoke(*files, *metric, *told, "--resample", "4s", "--max-gap", "60s,10s")
    assert "--ignore truth-gaps leaves these states out" in answer.err
    told += ["--resample", "4s", "--max-gap", "60s,10s", "--time-offset", "-4.7"]
    answer = invoke(*files, *metric, *told, "--ignore", "truth-gaps", "--format", "json")
    found = json.loads(answer.out)
    assert found["sizes"]["truth"] == 4
    pairs = found["judged"]["truth_states"] - found["counts"]["missed"]
    # Noise of 15 m on two axes, also of those that are held.
    assert (found["localisation"] / pairs) ** 0.5 == pytest.approx(15 * 2**0.5, rel=0.05)
    assert (found["counts"]["missed"], found["counts"]["false"]) == (37, 35)


def test_feet_beside_metres_are_proposed_by_column(invoke) -> None:
    files = str(COAST / "adsb.csv"), str(COAST / "tracker.csv")
    earth = ("--distance", "geodesic", "--columns", "lat,lon,alt", "-c", "300", "-g", "100")
    assert "or use --truth-scale alt=0.3048\n" in invoke(*files, *earth).err
    assert "seem" not in invoke(*files, *earth, "--truth-scale", "alt=0.3048").err


@pytest.mark.parametrize("cutoff", [3000, 5000, 20000])
@pytest.mark.parametrize("header", ["baro_altitude", "geoaltitude"])
def test_feet_below_a_large_cutoff(invoke: Any, cutoff: int, header: str) -> None:
    def write(name: str, low: float, *, unit: float = 1, noise: float = 0) -> str:
        rows = [
            f"{k},{t},{48 + t / 1000},{11 + k / 20},{unit * low * (1 + k / 5) + noise * (-1) ** t}"
            for t in range(20)
            for k in range(3)
        ]
        Path(name).write_text("\n".join((f"id,t,lat,lon,{header}", *rows)))
        return name

    truth, feet = write("gt.csv", 1000), write("feet.csv", 1000, unit=1 / 0.3048)
    metric = ("--distance", "geodesic", "-c", str(cutoff), "-g", "100")
    assert "or use --estimate-scale alt=0.3048\n" in invoke(truth, feet, *metric).err
    answer = invoke(truth, feet, *metric, "--estimate-scale", "alt=0.3048")
    assert "RMS error 0," in answer.out.replace("\n", " ")
    noisy = write("noisy.csv", 1000, noise=900)
    low, wide = write("low.csv", 1), write("wide.csv", 1, noise=900)
    assert "feet" not in invoke(truth, noisy, *metric).err
    assert "feet" not in invoke(low, wide, *metric).err


@pytest.mark.parametrize("header", ["alt", "altitude", "hae", "z"])
@pytest.mark.parametrize("role", ["truth", "estimate"])
def test_feet_are_converted_to_metres_without_named_columns(
    invoke: Any, header: str, role: str
) -> None:
    rows = [f"1,{k},50,{8 + k / 1000}" for k in range(12)]
    for name, height in (("feet", 32808.4), ("metres", 10030)):
        text = "\n".join((f"id,t,lat,lon,{header}", *(f"{row},{height}" for row in rows)))
        Path(f"{name}.csv").write_text(text)
    files = ("feet.csv", "metres.csv") if role == "truth" else ("metres.csv", "feet.csv")
    metric = ("--distance", "geodesic", "-c", "500", "-g", "100")
    assert f"or use --{role}-scale alt=0.3048\n" in invoke(*files, *metric).err
    for name in ("alt", header):
        answer = invoke(*files, *metric, f"--{role}-scale", f"{name}=0.3048")
        assert "TGOSPA = 103.922" in answer.out


def test_a_remedy_for_axes_units_or_a_zone_works(invoke: Any) -> None:
    """A sensor with ranges in kilometres, exchanged headers, or coordinates of a projection."""
    pyproj = pytest.importorskip("pyproj")

    def write(name: str, header: str, rows: Any) -> str:
        lines = (f"{k},{t},{','.join(map(str, row))}" for (k, t), row in rows.items())
        Path(name).write_text("\n".join((f"id,t,{header}", *lines)))
        return name

    polar = {(k, t): (r + 50 * t, b) for t in range(9) for k, r, b in ((1, 5e3, 30), (2, 9e3, 200))}
    earth = {}
    for key, (length, bearing) in polar.items():
        lon, lat, _ = pyproj.Geod(ellps="WGS84").fwd(12, 55, bearing, length)
        earth[key] = (lat, lon, 900.0)
    truth = write("earth.csv", "Lat,Lon,Height", earth)
    here = ("-c", "200", "-g", "100", "--origin", "55,12", "--estimate-crs", "range,bearing")
    km = write("km.csv", "range,bearing", {key: (r / 1000, b) for key, (r, b) in polar.items()})
    answer = invoke(truth, km, *here)
    assert "in kilometres instead of metres; with range of the" in answer.err
    assert "use --unit-scale 1000\n" in answer.err
    assert "100 % of 18" in invoke(truth, km, *here, "--unit-scale", "1000").out
    flat = write("flat.csv", "range,bearing", {key: (r, 90 - b) for key, (r, b) in polar.items()})
    assert invoke(truth, flat, *here).err.endswith("write both files in the same axes\n")
    up = {key: (*row, 4.0) for key, row in polar.items()}
    slant = write("slant.csv", "range,bearing,elevation", up)
    assert "--estimate-columns range,bearing leaves them out" in invoke(truth, slant, *here).err
    assert invoke(truth, slant, *here, "--estimate-columns", "range,bearing").status == 0
    high = {key: (lon, lat, 1200.0) for key, (lat, lon, _) in earth.items()}
    swapped = write("swapped.csv", "Lat,Lon,Height", high)
    metric = ("-c", "500", "-g", "100", "--distance", "geodesic")
    named = "lat=Lon,lon=Lat,alt=Height"
    assert f"swap the headers with --estimate-columns {named}\n" in (
        invoke(truth, swapped, *metric).err
    )
    answer = invoke(truth, swapped, *metric, "--estimate-columns", named)
    assert "RMS error 300," in answer.out
    zone = pyproj.Transformer.from_crs(4326, 32633, always_xy=True)
    utm = write(
        "utm.csv", "x,y", {k: zone.transform(lon, lat) for k, (lat, lon, _) in earth.items()}
    )
    answer = invoke(truth, utm, *metric)
    assert (
        "if x,y are coordinates of a map, such as UTM, give --estimate-crs EPSG:CODE" in answer.err
    )
    answer = invoke(truth, utm, *metric[:4])
    assert "--estimate-crs EPSG:32633 and --distance geodesic" in answer.err
    answer = invoke(truth, utm, *metric, "--estimate-crs", "EPSG:32633")
    assert "100 % of 18 object-steps" in answer.out


def test_north_and_east_that_are_swapped_get_the_axes_that_are_right() -> None:
    local = pd.DataFrame({"id": 1, "t": range(30), "x": 10.0 * np.arange(30), "y": 400.0})
    earth = local.assign(lat=55 + local["x"] / 111_320, lon=12 + local["y"] / 63_850)
    sides = earth[["id", "t", "lat", "lon"]], local
    options = {"cutoff": 20.0, "switch_penalty": 10.0, "origin": "55,12"}
    with pytest.warns(TgospaWarning, match='seem swapped.*; estimate_crs="ned"$'):
        wrong = evaluate(*sides, **options, estimate_crs="enu")
    right = evaluate(*sides, **options, estimate_crs="ned")
    assert (wrong.counts["missed"], right.counts["missed"]) == (30, 0)


@pytest.mark.parametrize(
    ("change", "option"),
    [
        ({"z": 1 / 0.3048}, "z=0.3048"),
        ({"x": 1e-3, "y": 1e-3}, "x=1000,y=1000"),
        ({"x": 1e-3, "y": 1e-3, "z": 1e-3}, None),
    ],
)
def test_units_of_some_columns_are_proposed_for_these_alone(
    change: dict[str, float], option: str | None, tmp_path: Path, invoke
) -> None:
    t, track = np.repeat(np.arange(40), 4), np.tile(np.arange(4), 40)
    truth = pd.DataFrame({"id": track, "t": t, "x": 900.0 * track + 20 * t})
    truth = truth.assign(y=300.0 * track - 9 * t, z=2000 + 1000.0 * track)
    side = truth.assign(**{name: truth[name] * factor for name, factor in change.items()})
    paths = [str(tmp_path / name) for name in ("truth.csv", "estimate.csv")]
    for frame, path in zip((truth, side), paths, strict=True):
        frame.to_csv(path, index=False)
    proposed = f"--estimate-scale {option}" if option else "--unit-scale 1000"
    told = invoke(*paths, "-c", "50", "-g", "10").err
    assert f"or use {proposed}\n" in told
    answer = invoke(*paths, "-c", "50", "-g", "10", *proposed.split(), "--format", "json")
    assert json.loads(answer.out)["total"] < 1e-12


@pytest.mark.parametrize("earth", [False, True])
@pytest.mark.parametrize(
    ("heights", "cutoff"),
    [((1.5, 400), 500), ((0, 400), 500), ((0, 8), 9), ((50, 450), 500), ((1.5, 40), 50)],
)
@pytest.mark.parametrize("way", [1, -1])
def test_a_constant_height_shows_no_unit(
    heights: tuple[float, float], cutoff: int, way: int, *, earth: bool, invoke: Any
) -> None:
    for name, moved, height in zip("ge", (0, 3), heights[::way], strict=True):
        places = [(100 * k + moved, 1000 * i) for k in range(6) for i in (0, 1)]
        if earth:
            places = [(48 + x / 111_200, 11 + y / 74_000) for x, y in places]
        rows = [f"{i % 2},{i // 2},{x},{y},{height}" for i, (x, y) in enumerate(places)]
        columns = "lat,lon,alt" if earth else "x,y,z"
        Path(name).write_text("\n".join((f"id,t,{columns}", *rows)))
    metric = ("--distance", "geodesic") if earth else ()
    told = invoke("g", "e", "-c", str(cutoff), "-g", "1", *metric).err
    assert "times too" not in told


def test_degrees_beside_heights_are_told_and_never_scaled(invoke, tmp_path: Path) -> None:
    files = str(COAST / "adsb.csv"), str(COAST / "tracker.csv"), "--columns", "lat,lon,alt"
    told = invoke(*files, "--distance", "euclidean", "-c", "300", "-g", "100").err
    assert "lat, lon, alt are compared as plain numbers: degrees are added to other units" in told
    assert "or use --estimate-scale alt=3.2808" in told
    told = invoke(*files, "--distance", "haversine", "-c", "300", "-g", "100").err
    assert "haversine does not use heights; use --distance geodesic" in told
    feet = tmp_path / "feet.csv"
    feet.write_text("id,t,lat,lon,alt_ft\n1,0,56,13,900\n")
    both = (*[str(feet)] * 2, "--columns", "lat,lon,alt=alt_ft", "-c", "300", "-g", "100")
    told = invoke(*both, "--distance", "haversine").err
    assert "haversine does not use heights; use --distance geodesic" in told
    local = "--estimate-crs", "enu", "--origin", "56,13", "--distance", "geodesic", "-c", "300"
    assert "leave --distance out" in invoke(*files[:2], *local).err


def test_a_filter_by_place_takes_a_circle_or_a_file(tmp_path: Path) -> None:
    truth, length, bearing = radar()
    options = {"cutoff": 100, "switch_penalty": 10}
    near = truth[length <= 5e4]
    earth = options | {"distance": "geodesic"}
    found = evaluate(truth, truth, **earth, region="circle=55.7,12.6,49850")
    assert abs(found.judged["truth_states"] - len(near)) <= 1  # caps are those of the sphere
    local = options | {"estimate_crs": "range,bearing", "origin": ORIGIN}
    plots = truth[["id", "t"]].assign(range=length, bearing=bearing)
    found = evaluate(truth, plots, **local, region="circle=55.7,12.6,49850")
    assert found.total < 1e-6
    assert abs(found.judged["truth_states"] - len(near)) <= 1
    assert found.parameters["region"] == "circle=55.7,12.6,49850"
    file = tmp_path / "coverage.csv"
    file.write_text("x,y,radius\n0,0,30000\n0,0,50000\n")
    found = evaluate(truth, plots, **local, region=str(file))
    assert found.judged["truth_states"] == len(near)
    assert found.input["estimate"]["left_out"] == {"region": 100 - len(near)}
    flat = truth.rename(columns={"lat": "x", "lon": "y"})
    found = evaluate(flat, flat, **options, region="circle=55.7,12.6,0.3")
    assert found.judged["truth_states"] == np.count_nonzero(
        np.hypot(flat.x - 55.7, flat.y - 12.6) <= 0.3
    )
    with pytest.raises(ConfigError, match="must be circle=LAT,LON,RADIUS"):
        evaluate(truth, plots, **local, region="circle=0,0")
    with pytest.raises(InputError, match="nor an existing file"):
        evaluate(truth, plots, **local, region="missing.geojson")


def test_regions_on_the_earth_hold_states_along_local_axes() -> None:
    """lon, lat of GeoJSON, and lat, lon of circles; x, y of other shapes are local metres."""
    pytest.importorskip("shapely")
    truth = pd.DataFrame({"id": 1, "t": range(3), "lat": 55.6, "lon": 12.8})
    estimate = pd.DataFrame({"id": 7, "t": range(3), "x": [0.0, 3000, 9000], "y": [0.0, 0, 4000]})
    options = {"cutoff": 50, "switch_penalty": 1, "estimate_crs": "enu", "origin": (55.6, 12.8)}
    square = [[12.84, 55.59], [12.86, 55.59], [12.86, 55.61], [12.84, 55.61], [12.84, 55.59]]
    regions = (
        {"type": "Polygon", "coordinates": [square]},
        pd.DataFrame({"lat": [55.6], "lon": [12.85], "radius": [300]}),
        pd.DataFrame({"x": [3000], "y": [0], "radius": [300]}),
    )
    for given in regions:
        found = evaluate(truth, estimate, **options, ignore_regions=given)
        assert (found.ignored["excused"], found.counts["false"]) == (1, 1)


def test_what_no_sensor_reports_is_an_error() -> None:
    truth = pd.DataFrame({"id": 1, "t": [0], "lat": 55.6, "lon": 12.8, "alt": 0.0})
    seen = pd.DataFrame({"id": 7, "t": [0], "range": -1.0, "bearing": 0.0, "elevation": 91.0})
    options = {"cutoff": 50, "switch_penalty": 1, "origin": "55.6,12.8"}
    with pytest.raises(InputError, match='column "range": -1 must be >= 0'):
        evaluate(truth, seen, **options, estimate_crs="range,bearing")
    polar = {"truth_crs": "lat,lon,alt", "estimate_crs": "range,bearing,elevation"}
    with pytest.raises(InputError, match='column "elevation": 91 must be from -90 to 90'):
        evaluate(truth, seen.assign(range=1.0), **options, **polar)
    for origin in (5, (1,), ("a", 2), (55, 400)):
        with pytest.raises(ConfigError, match="must be LAT,LON or LAT,LON,ALT"):
            evaluate(truth, seen, **{**options, "origin": origin}, estimate_crs="range,bearing")


def test_a_weight_of_heights_needs_heights() -> None:
    with pytest.raises(InputError, match="vertical_weight needs heights"):
        evaluate(FLIGHT, FLIGHT, **{**EARTH, "columns": "lat,lon"}, vertical_weight=2)


HIGH = (55.4, 13.5, 9000.0)
RADAR = (55.0, 13.0, 50.0)


def _radar(**columns: Any) -> pd.DataFrame:
    return pd.DataFrame({"id": "r", "t": range(3), **columns})


def test_heights_of_both_sides_take_part() -> None:
    """An aircraft at 9 km, 54 km from a radar that is perfect."""
    pytest.importorskip("pyproj")
    latitude, longitude, height = HIGH
    truth = pd.DataFrame(
        {"id": "a", "t": range(3), "lat": latitude, "lon": longitude, "altitude": height}
    )
    x, y, z = topocentric(*RADAR).transform(longitude, latitude, height)
    local = {"cutoff": 3000, "switch_penalty": 10, "origin": RADAR}
    assert evaluate(truth, _radar(x=x, y=y, z=z), **local, estimate_crs="enu").tgospa < 1e-6
    polar = {"range": np.hypot(np.hypot(x, y), z), "bearing": np.degrees(np.arctan2(x, y))}
    up = np.degrees(np.arctan2(z, np.hypot(x, y)))
    slant = _radar(**polar, elevation=up)
    assert evaluate(truth, slant, **local, estimate_crs="range,bearing").tgospa < 1e-6
    # Without heights of the truth those of the radar still say where it is above.
    flat = truth.drop(columns="altitude")
    assert evaluate(flat, slant, **local, estimate_crs="range,bearing").tgospa < 1e-3
    for side, crs, least in (
        (_radar(x=x, y=y), "enu", 70),
        (_radar(**polar), "range,bearing", 700),
    ):
        with pytest.warns(
            TgospaWarning, match=r"heights of truth are left out.* by up to [0-9.]+ m"
        ):
            result = evaluate(truth, side, **local, estimate_crs=crs)
        assert least < result.normalised["tgospa"] < 1.3 * least
        (text,) = (text for text in result.messages if "by up to" in text)
        assert float(text.split("by up to ")[1].split()[0]) == pytest.approx(
            result.normalised["tgospa"], rel=1e-3
        )
    metric = {"cutoff": 3000, "switch_penalty": 10}
    higher = truth.assign(altitude=height + 100)
    result = evaluate(truth, higher, distance="geodesic", **metric)
    assert result.normalised["tgospa"] == pytest.approx(100)
    assert evaluate(truth, flat, distance="geodesic", **metric).total == 0
    columns = ("lat", "lon")
    assert evaluate(truth, higher, distance="geodesic", columns=columns, **metric).total == 0
    with pytest.raises(ConfigError, match="both files have heights"):
        evaluate(truth, higher, distance="haversine", **metric)
    utm = pd.DataFrame({"id": "a", "t": range(3), "x": 5e5, "y": 5e6, "height": height})
    system: dict[str, Any] = dict.fromkeys(("truth_crs", "estimate_crs"), "EPSG:32632")
    with pytest.raises(ConfigError, match=r"with truth_columns=\('x', 'y'\) estimate_columns"):
        evaluate(utm, utm, distance="haversine", **system, **metric)
    both = dict.fromkeys(("truth_columns", "estimate_columns"), ("x", "y"))
    assert evaluate(utm, utm, distance="haversine", **system, **metric, **both).total == 0
    partly = higher.assign(altitude=[1.0, np.nan, 2.0])
    result = evaluate(truth, partly, distance="geodesic", **metric)
    assert (result.total, result.evaluated_on.truth_states) == (0, 3)
    codes = {notice.code: notice.text for notice in result.warnings}
    assert "(altitude) are left out: estimate has 1 row without" in codes["heights-left-out"]
    notice, *_ = evaluate(truth, flat, distance="geodesic", **metric).warnings
    assert "truth_columns=('lat', 'lon') leaves them out" in notice.remedy


def test_estimates_in_unlike_frames_clocks_and_units_are_ranked(invoke: Any) -> None:
    """What must agree is the truth, and the frame in which distances are taken."""
    pytest.importorskip("pyproj")
    t = np.arange(20)
    pd.DataFrame({"id": 1, "t": t, "lat": 55.6 + 1e-4 * t, "lon": 12.8 + 2e-4 * t}).to_csv(
        "truth.csv", index=False
    )
    east, north = 12.5 * t + 3, 11.1 * t + 4
    pd.DataFrame({"id": 1, "t": t, "x": east, "y": north}).to_csv("enu.csv", index=False)
    pd.DataFrame({"id": 1, "t": t + 90, "x": north + 9, "y": east}).to_csv("ned.csv", index=False)
    metric = ("-c", "200", "-g", "50", "--origin", "55.6,12.8", "-q")
    for name, more in (("enu", ()), ("ned", ("--time-offset", "-90"))):
        answer = invoke(
            "truth.csv", f"{name}.csv", *metric, "--estimate-crs", name, *more, "-o", name
        )
        assert answer.status == 0, answer.err
    assert "best first: enu, ned" in invoke("compare", "enu", "ned").out
    head = "truth,estimate,tracker,estimate-crs,time-offset"
    rows = ("truth.csv,enu.csv,a,enu,0", "truth.csv,ned.csv,b,ned,-90")
    Path("jobs.csv").write_text("\n".join((head, *rows, "")))
    found = invoke(
        "batch", "jobs.csv", *metric, "-o", "store", "--by", "tracker", "--format", "json"
    )
    assert [one["name"] for one in json.loads(found.out)["ranking"]] == ["a", "b"]


def test_options_of_one_side_lead_on(invoke: Any) -> None:
    """Rows of nowhere are dropped, columns and zones are those of the side that lacks them."""
    pytest.importorskip("pyproj")
    rows = ["a,2025-03-04T10:00:00,55.6,12.8", "a,2025-03-04T10:00:10,55.6001,12.8001"]
    Path("ais.csv").write_text(
        "\n".join(("MMSI,time,LAT,LON", *rows, "b,2025-03-04T10:00:10,91,12", ""))
    )
    lines = ["trk,time,east_m,north_m", "1,1741082400,3,4", "1,1741082410,9,15", ""]
    Path("radar.csv").write_text("\n".join(lines))
    metric = ("-c", "200", "-g", "50", "--origin", "55.6,12.8", "--estimate-crs", "enu", "-q")
    answer = invoke("ais.csv", "radar.csv", *metric)
    assert "radar.csv, line 1: no column for id" in answer.err
    metric += ("--estimate-columns", "id=trk,x=east_m,y=north_m")
    answer = invoke("ais.csv", "radar.csv", *metric, "--resample", "10s", "--max-gap", "10s")
    assert 'line 4, column "lat": 91 must be from -90 to 90; to leave such rows out' in answer.err
    metric += ("--on-invalid", "drop")
    answer = invoke("ais.csv", "radar.csv", *metric, "--resample", "10s", "--max-gap", "10s")
    assert "--truth-time-zone UTC or another" in answer.err
    answer = invoke("ais.csv", "radar.csv", *metric, "--truth-time-zone", "UTC")
    assert (answer.status, "1 ground-truth object, 1 estimate, 2 steps" in answer.out) == (0, True)


def test_milliseconds_beside_seconds_whose_stamps_do_not_coincide(invoke: Any) -> None:
    seconds = [f"1,{1741082400 + 10 * k},{2000 * k},0" for k in range(30)]
    millis = [f"1,{1741082400370 + 1000 * k},{200 * k + 74},30" for k in range(300)]
    for name, rows in (("a.csv", seconds), ("b.csv", millis)):
        Path(name).write_text("\n".join(("id,t,x,y", *rows, "")))
    given = ("a.csv", "b.csv", "-c", "200", "-g", "100")
    for more in ((), ("--resample", "1", "--max-gap", "10")):
        assert "; --time-scale 0.001" in invoke(*given, *more).err
    more = ("--time-scale", "0.001", "--resample", "1", "--max-gap", "10")
    answer = invoke(*given, *more, "--format", "json")
    assert json.loads(answer.out)["normalised"]["tgospa"] < 40
    assert "; --time-scale" not in answer.err
    for offset, status in (("0.5", 0), ("500ms", 2), ("5 apples", 2)):
        assert invoke(*given, *more, "--time-offset", offset, "-q").status == status


@pytest.mark.parametrize(
    "header",
    [
        *("alt_ft", "altitude (ft)", "geo_altitude_feet", "alt_geom", "alt_mm", "flight_level"),
        *("Altitude Feet MSL", "alt_msl"),
    ],
)
def test_heights_in_feet_are_told(tmp_path: Path, header: str) -> None:
    table = f"id,t,lat,lon,{header}\n1,0,50,8,328\n1,1,50.001,8,328\n"
    files = [tmp_path / f"{name}.csv" for name in ("truth", "estimate")]
    for file in files:
        file.write_text(table)
    warnings = evaluate(*files, distance="geodesic", cutoff=100, switch_penalty=50).warnings
    assert sum(f"heights ({header}) are left out" in str(one) for one in warnings) == 2


def test_the_height_of_an_object_beside_its_length_is_no_altitude() -> None:
    car = FLIGHT.drop(columns="alt").assign(length=4.0, height=1.5)
    other = car.assign(lat=55.001, height=40.0)
    found = evaluate(car, other, distance="geodesic", cutoff=500, switch_penalty=100)
    assert found.total == pytest.approx(2 * 111.3**2, rel=1e-2)


@pytest.mark.parametrize(
    ("crs", "header"),
    [
        ("ned", "north,east,down"),
        ("ned", "north_m,east_m,up"),
        ("ned", "Northing,Easting,alt"),
        ("ned", "north,east,z"),
        ("ned:0", "x=north,y=east,z=down"),
        ("enu", "north,east,up"),
        ("enu", "east,north,down"),
        ("enu", "east,north,altitude"),
    ],
)
def test_headers_that_name_directions_are_read_so(invoke: Any, crs: str, header: str) -> None:
    """Whatever the order and sign of the axes, 97 m east, 111 m north and 50 m up."""
    names = [item.rpartition("=")[2] for item in header.split(",")]
    places = {"n": "111.2{k}", "e": "97{k}", "d": "-50", "u": "50", "a": "50", "z": "-50"}
    rows = (",".join(places[name[0].lower()] for name in names).format(k=k) for k in range(6))
    lines = (f"1,{k},{row}" for k, row in enumerate(rows))
    Path("e.csv").write_text("\n".join((f"id,t,{','.join(names)}", *lines)))
    lines = (f"1,{k},97{k},111.2{k},50" for k in range(6))
    Path("g.csv").write_text("\n".join(("id,t,x,y,z", *lines)))
    options = ("--truth-crs", "enu", "--estimate-crs", crs, "-c", "9", "-g", "1")
    mapped = ("--estimate-columns", header) if "=" in header else ()
    assert "TGOSPA = 0," in invoke("g.csv", "e.csv", *options, *mapped).out


def test_a_header_of_the_other_axis_is_refused_with_a_way_that_works(invoke: Any) -> None:
    Path("g.csv").write_text("id,t,lat,lon\n1,0,48,11\n1,1,48.01,11\n")
    Path("e.csv").write_text("id,t,north,east\n1,0,0,0\n1,1,1112,0\n")
    options = ("--estimate-crs", "ned", "--origin", "48,11", "-c", "9", "-g", "1")
    answer = invoke("g.csv", "e.csv", *options, "--estimate-columns", "x=east,y=north")
    assert 'x is read from "east"' in answer.err
    remedy = answer.err.strip().rpartition("use ")[2].split()
    assert remedy == ["--estimate-columns", "x=north,y=east"]
    assert "100 % of 2 object-steps" in invoke("g.csv", "e.csv", *options, *remedy).out


@pytest.mark.parametrize(
    ("y", "x", "named"),
    [
        ("north", "east", ()),
        ("y", "x", ("--truth-columns", "x,y,z=up", "--estimate-columns", "x,y,z=down")),
    ],
)
def test_up_against_down_is_refused_with_a_way_that_works(
    invoke: Any, x: str, y: str, named: tuple[str, ...]
) -> None:
    Path("g.csv").write_text(f"id,t,{x},{y},up\n1,0,7,3,50\n1,1,9,4,60\n")
    Path("e.csv").write_text(f"id,t,{y},{x},down\n1,0,3,7,-50\n1,1,4,9,-60\n")
    options = ("-c", "9", "-g", "1", *named)
    answer = invoke("g.csv", "e.csv", *options)
    remedy = answer.err.rpartition("use ")[2].partition(" (")[0].replace(" and ", " ").split()
    assert "TGOSPA = 0," in invoke("g.csv", "e.csv", *options, *remedy).out
