"""Another clock, another unit, interpolation: the options equal the change made by hand."""

import json
import warnings
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run, Write

from tgospa_eval import (
    ConfigError,
    InputError,
    TgospaWarning,
    Trajectories,
    evaluate,
    read_trajectories,
)
from tgospa_eval.tracks.clouds import Clouds
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.interpolation import interpolated

METRIC = ("-c", "5", "-g", "2")
SAME = ("tgospa", "lower_bound", "per_step", "switches", "counts")


def json_of(done: Any) -> dict[str, Any]:
    assert done.status == 0, done.err
    document: dict[str, Any] = json.loads(done.out)
    return document


@pytest.mark.parametrize(
    ("truth", "estimate", "factors", "ways"),
    [
        ("x_m,y_m", "x_ft,y_ft", (0.3048, 0.3048), "--estimate-scale x=0.3048,y=0.3048"),
        ("x (m),y (m)", "x [km],y [m]", (1000, 1), "--estimate-scale x=1000"),
        ("x,y\n-,s,m,m", "x,y\n-,s,km,cm", (1000, 0.01), "--estimate-scale x=1000,y=0.01"),
        ("x,y", "x_m,y_km", (1, 1000), "--estimate-scale y=1000"),
        ("x_km,y_km", "x_km,y_km", (1, 1), ""),
        ("x_px,y_px", "x_m,y_m", (1, 1), "write both in one unit"),
    ],
)
def test_units_that_the_files_state(
    invoke: Run, write: Write, truth: str, estimate: str, factors: tuple[float, float], ways: str
) -> None:
    sides = [
        write(f"{k}.csv", f"id,t,{head}\n" + "".join(f"a,{t},{t / f},{9 / g}\n" for t in range(9)))
        for k, head, (f, g) in (("t", truth, (1, 1)), ("e", estimate, factors))
    ]
    answer = invoke(*sides, *METRIC)
    if not ways:
        assert answer.status == 0, answer.err
        return
    assert (answer.status, ways in answer.err) == (2, True), answer.err
    if ways.startswith("--"):
        done = json_of(invoke(*sides, *METRIC, *ways.split(), "--format", "json"))
        assert done["total"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("crs", "head", "scale"),
    [
        ("enu", "x_km,y_km", "x=1000,y=1000"),
        ("ned", "x [ft],y [m]", "x=0.3048"),
        ("range,bearing", "range_km,bearing_rad", "range=1000,bearing=57.2957795131"),
        ("lat,lon", "lat_rad,lon_rad", "lat=57.2957795131,lon=57.2957795131"),
    ],
)
def test_units_other_than_those_of_a_frame_are_refused(
    invoke: Run, write: Write, crs: str, head: str, scale: str
) -> None:
    names = crs.split(",") if "," in crs else ["x", "y"]
    factors = dict(item.split("=") for item in scale.split(","))
    place = [0.01 / float(factors.get(name, 1)) for name in names]
    sides = [
        write(name, f"id,t,{header}\n" + "".join(f"a,{t},{x},{y}\n" for t in range(3)))
        for name, header, (x, y) in (
            ("t.csv", ",".join(names), (0.01, 0.01)),
            ("e.csv", head, place),
        )
    ]
    options = ("--truth-crs", crs, "--estimate-crs", crs, "--origin", "48,11", *METRIC)
    options = (*METRIC, "--distance", "haversine") if crs == "lat,lon" else options
    answer = invoke(*sides, *options)
    assert answer.status == 2
    assert f"use --estimate-scale {scale}\n" in answer.err
    done = json_of(invoke(*sides, *options, "--estimate-scale", scale, "--format", "json"))
    assert done["total"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    "truth", ["range_m,bearing_rad", "range,bearing_deg", "range,bearing", "x,y"]
)
def test_bearings_are_degrees_without_an_origin_too(invoke: Run, write: Write, truth: str) -> None:
    sides = [
        write(name, f"id,t,{head}\n" + "".join(f"a,{t},1000,0.5\n" for t in range(3)))
        for name, head in (("t.csv", truth), ("e.csv", "range_m,bearing_rad"))
    ]
    crs = "enu" if truth == "x,y" else "range,bearing"
    options = ("--truth-crs", crs, "--estimate-crs", "range,bearing", *METRIC)
    answer = invoke(*sides, *options)
    assert (answer.status, "needs degrees; use " in answer.err) == (2, True)
    assert "--estimate-scale bearing=57.2957795131\n" in answer.err
    way = answer.err.split("; use ")[1].replace(" and ", " ").split()
    assert invoke(*sides, *options, *way).status == 0
    degrees = write("d.csv", "id,t,range,bearing_deg\na,0,1000,0.5\n")
    options = ("--truth-crs", "range,bearing", *options[2:])
    assert "the unit is called" not in invoke(degrees, degrees, *options, "--unit", "m").err


@pytest.mark.parametrize(
    ("head", "options", "unit", "own"),
    [
        ("x_km,y_km", "", "m", "km"),
        ("x_px,y_px", "", "m", "px"),
        ("x_ft,y_ft", "", "feet", ""),
        ("x_km,y_km", "--unit-scale 1000", "m", ""),
        ("x,y", "", "km", ""),
        ("x_m,y_m", "", "cells", ""),
        ("lat,lon", "--distance haversine", "km", "m"),
        ("lat,lon", "--distance haversine", "metres", ""),
        ("lat,lon", "--distance euclidean", "m", "degrees"),
        ("lat,lon", "--distance euclidean", "deg", ""),
    ],
)
def test_a_false_unit_gets_a_warning_with_the_true_one(
    invoke: Run, write: Write, head: str, options: str, unit: str, own: str
) -> None:
    side = write("t.csv", f"id,t,{head}\na,0,3,4\na,1,3,4\n")
    given = (*METRIC, *options.split(), "--unit")
    assert ("is called" in invoke(side, side, *given, unit).err) == bool(own)
    if own:
        assert f"are in {own}; use --unit {own}\n" in invoke(side, side, *given, unit).err
        assert "is called" not in invoke(side, side, *given, own).err


TRUTH = "id,t,x,y\n" + "".join(f"a,{k / 10:.1f},{k},0\nb,{k / 10:.1f},{k},9\n" for k in range(12))


def rows(time: str, x: str, spread: str = "1,0.5,2") -> str:
    """An estimate, its stamps and places written by these formats of k."""
    lines = []
    for k in range(12):
        t = time.format(k=k, ms=100 * k, ns=10**8 * k, late=(k + 25) / 10)
        for track, y in (("1", 0), ("2", 8)):
            place = x.format(x=k + 0.5, y=y, kx=(k + 0.5) / 1000, ky=y / 1000)
            lines.append(f"{track},{t},{place},{spread}")
    return "id,t,x,y,cov_xx,cov_xy,cov_yy\n" + "\n".join(lines) + "\n"


@pytest.mark.parametrize("distance", ["euclidean", "gaussian-wasserstein"])
def test_options_equal_files_that_were_changed_by_hand(
    invoke: Run, write: Write, distance: str
) -> None:
    truth = write("t.csv", TRUTH)
    plain = write("e.csv", rows("{late:.1f}", "{x},{y}"))
    seconds = write(
        "s.csv", "\n".join(_at(line, -2.5) for line in Path(plain).read_text().splitlines())
    )
    base = (*METRIC, "--distance", distance, "--format", "json")
    wanted = json_of(invoke(truth, seconds, *base))
    shifted = json_of(invoke(truth, plain, *base, "--time-offset", "-2.5"))
    ms = write("ms.csv", rows("{ms}", "{x},{y}"))
    ns = write("ns.csv", rows("{ns}", "{kx},{ky}", "1e-6,0.5e-6,2e-6"))
    scaled = json_of(invoke(truth, ms, *base, "--time-scale", "0.001"))
    both = json_of(
        invoke(
            truth, ns, *base, "--time-scale", "1e-9", "--unit-scale", "1000", "--time", "0.2:0.9"
        )
    )
    only = json_of(invoke(truth, seconds, *base, "--time", "0.2:0.9"))
    assert all(shifted[name] == scaled[name] == wanted[name] for name in SAME)
    assert both["tgospa"] == pytest.approx(only["tgospa"], rel=1e-12)
    assert [step["t"] for step in both["per_step"]] == [step["t"] for step in only["per_step"]]
    assert shifted["input"] == wanted["input"]
    given = {"time_scale": 1e-9, "unit_scale": 1000.0, "time": "0.2:0.9"}
    assert given.items() <= both["parameters"].items()
    assert not {"time_offset", "unit_scale", "max_gap"} & wanted["parameters"].keys()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TgospaWarning)
        python = evaluate(truth, ns, 5, 2, 2, distance=distance, time_scale=1e-9, unit_scale=1000)
    assert python.tgospa == pytest.approx(float(wanted["tgospa"]), rel=1e-12)
    assert python.to_dict()["parameters"]["unit_scale"] == 1000


def _at(line: str, offset: float) -> str:
    name, time, *rest = line.strip().split(",")
    return ",".join((name, time if time == "t" else f"{float(time) + offset:.1f}", *rest))


def test_iso_times_move_and_are_shown_as_such(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x\na,2024-01-01T00:00:00Z,0\na,2024-01-01T00:00:01.5Z,1\n")
    late = "id,t,x\n1,2024-01-01T01:00:00.25+01:00,0\n1,2024-01-01T00:00:01.75Z,1\n"
    estimate = write("e.csv", late)
    files = (truth, estimate, *METRIC)
    document = json_of(invoke(*files, "--time-offset", "-0.25", "--format", "json"))
    assert document["total"] == 0
    scaled = invoke(*files, "--time-scale", "2")
    assert scaled.status == 2
    assert "--time-scale is for times that are numbers" in scaled.err
    moved = read_trajectories(estimate, time_offset=-0.25)
    assert list(moved.shown) == [
        "2024-01-01T00:00:00Z",
        "2024-01-01T00:00:01.500Z".replace("00Z", "Z"),
    ]


@pytest.mark.parametrize("offset", ["500ms", "-2s", "1h"])
def test_numbers_have_no_unit_for_an_offset(invoke: Run, write: Write, offset: str) -> None:
    files = write("t.csv", TRUTH), write("e.csv", TRUTH.replace("t,x", "time_ms,x"))
    refused = invoke(*files, *METRIC, "--time-offset", offset)
    assert (refused.status, f"--time-offset {offset}: the times are plain" in refused.err) == (
        2,
        True,
    )
    with pytest.raises(ConfigError, match=f"time_offset {offset}: the times"):
        evaluate(*files, cutoff=5, switch_penalty=2, time_offset=offset)


def test_stamps_are_converted_as_decimals() -> None:
    """Against fractions; what cannot be told apart any more is refused."""
    times = np.array([0.1, 0.2, 0.3, 1.1, 100.5, 2**40 + 0.5])
    for scale, offset in ((0.001, 0.0), (1000.0, 0.1), (1e9, 0.0), (1 / 3, 7.25)):
        found, _ = Conversion(time_scale=scale, time_offset=offset).times(
            times, "number", None, "e.csv"
        )
        exact = [_exact(t) * _exact(scale) + _exact(offset) for t in times.tolist()]
        assert found.tolist() == [float(value) for value in exact]
    whole = np.array([0, 2**62, 2**62 + 1])
    moved, _ = Conversion(time_offset=5).times(whole, "number", None, "e.csv")
    assert moved.tolist() == [5, 2**62 + 5, 2**62 + 6]
    with pytest.raises(ConfigError, match="would become the same number"):
        Conversion(time_scale=0.001).times(whole, "number", None, "e.csv")
    with pytest.raises(ConfigError, match="become too large"):
        Conversion(time_scale=1e308).times(times * 10, "number", None, "e.csv")


def _exact(value: float) -> Fraction:
    return Fraction(repr(value))


def test_unit_scale_changes_lengths_alone() -> None:
    state, spread = np.array([[1.0, 2.0]]), np.array([[3.0, 0.5, 0.25]])
    side = replace(Trajectories.from_array(state[None]), columns=("x", "theta"), covariance=spread)
    made = Conversion(unit_scale=10, angles=("theta",))(side, "estimate")
    assert made.state.tolist() == [[10, 2]]
    assert made.covariance is not None
    assert made.covariance.tolist() == [[300, 5, 0.25]]
    cloud = Clouds(
        points=np.array([[0.0, 0], [2, 4]]), weights=np.full(2, 0.5), first=np.array([0, 2])
    )
    found = Conversion(unit_scale=0.5)(side.with_clouds(cloud), "estimate")
    assert found.clouds is not None
    assert found.clouds.points.tolist() == [[0, 0], [1, 2]]
    assert found.state.tolist() == [[0.5, 1]]
    with pytest.raises(ConfigError, match="degrees"):
        Conversion(unit_scale=2)(replace(side, columns=("lat", "lon")), "estimate")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--unit-scale", "0"), "--unit-scale is 0: must be > 0"),
        (("--time-scale", "-1"), "--time-scale is -1: must be > 0"),
        (("--time-offset", "nan"), '--time-offset is "nan": must be a number, or one with a unit'),
        (("--unit-scale", "inf"), "'--unit-scale': 'inf' is no plain, finite number"),
        (("--unit-scale", "1e308"), "times its scale is too large for a number"),
        (("--max-gap", "1"), "--max-gap is for --interpolate"),
        (("--interpolate", "truth"), "needs --max-gap DT: longer gaps"),
        (("--interpolate", "truth", "--max-gap", "0"), "max-gap is 0: must be finite and > 0"),
        (("--interpolate", "both"), "'both' is not one of"),
    ],
)
def test_what_is_refused(
    invoke: Run, quickstart: tuple[str, str], options: tuple[str, ...], message: str
) -> None:
    done = invoke(*quickstart, *METRIC, *options)
    assert (done.status, done.out) == (2, "")
    assert message in done.err


def scene(seed: int) -> tuple[Trajectories, np.ndarray]:
    """Tracks of 40 random stamps with holes, and other stamps, of which some are the same."""
    rng = np.random.default_rng(seed)
    times = np.unique(np.round(rng.uniform(0, 20, 40), 2))
    table = rng.normal(size=(len(times), 4, 2)).cumsum(axis=0)
    table[rng.random(table.shape[:2]) < 0.3] = np.nan
    stamps = np.unique(np.concatenate((np.round(rng.uniform(-1, 21, 60), 2), times[::5])))
    return replace(Trajectories.from_array(table), times=times), stamps


def at_stamps(side: Trajectories, stamps: np.ndarray, gap: float, **more: Any) -> tuple:
    other = replace(Trajectories.from_array(np.zeros((len(stamps), 1, 2))), times=stamps)
    return interpolated(side, other, max_gap=gap, **more)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("gap", [0.4, 1.5, 100.0])
def test_interpolation_is_that_of_numpy_track_by_track(seed: int, gap: float) -> None:
    side, stamps = scene(seed)
    made, (between, there, unused) = at_stamps(side, stamps, gap)
    found = np.full((len(stamps), len(side.ids), 2), np.nan)
    found[made.step, [int(made.ids[k]) for k in made.track]] = made.state
    wanted = np.full_like(found, np.nan)
    for track in range(len(side.ids)):
        own = side.step[side.track == track]
        time, state = side.times[own], side.state[side.track == track]
        for k, stamp in enumerate(stamps):
            after = np.searchsorted(time, stamp)
            exact = after < len(time) and time[after] == stamp
            if exact or (0 < after < len(time) and time[after] - time[after - 1] <= gap + 1e-12):
                wanted[k, track] = [np.interp(stamp, time, column) for column in state.T]
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert there + between == len(made.step)
    assert there + unused == len(side.step)


def test_angles_go_the_shorter_way_and_longitudes_stay_such() -> None:
    states = np.array([[[0.0, 350.0]], [[10.0, 10.0]], [[20.0, 350.0]]])
    side = replace(Trajectories.from_array(states), columns=("x", "a"), times=np.array([0, 4, 8]))
    found = at_stamps(side, np.arange(9), 4, periods={"a": 360.0})[0].state
    assert (found[:, 1] % 360).tolist() == [350, 355, 0, 5, 10, 5, 0, 355, 350]
    assert found[:, 0].tolist() == [0, 2.5, 5, 7.5, 10, 12.5, 15, 17.5, 20]
    globe = replace(side, columns=("lat", "lon"), state=side.state - [0, 180])
    lon = at_stamps(globe, np.arange(9), 4, periods={"lon": 360.0})[0].state[:, 1]
    assert np.abs(lon).max() <= 180
    assert lon[[1, 3]].tolist() == [175, -175]


def test_interpolated_evaluation_is_recorded_and_its_proof_holds(
    invoke: Run, write: Write, tmp_path: Path
) -> None:
    truth = write("t.csv", TRUTH)
    lines = "".join(f"1,{k / 4:.2f},{k * 2.5},0\n" for k in range(5)) + "1,9,0,0\n"
    estimate = write("e.csv", "id,t,x,y\n" + lines)
    options = (*METRIC, "--interpolate", "estimate", "--max-gap", "0.25")
    folder = str(tmp_path / "out")
    done = invoke(truth, estimate, *options, "--format", "json", "-o", folder, "--proof")
    document = json_of(done)
    assert document["counts"]["missed"] == 13  # of a the last, and b
    assert document["localisation"] == pytest.approx(0, abs=1e-20)
    wanted = {"interpolate": "estimate", "max_gap": 0.25}
    assert wanted.items() <= document["parameters"].items()
    assert "estimate at the timestamps of the truth: 8 states interpolated in gaps" in done.err
    assert "3 as read, 3 at other timestamps are not compared" in done.err
    verified = invoke("verify", folder, truth, estimate)
    assert verified.status == 0, verified.err
    assert "--interpolate 'estimate', --max-gap '0.25'" in verified.out
    python = evaluate(truth, estimate, 5, 2, 2, interpolate="estimate", max_gap=0.25)
    assert python.tgospa == document["tgospa"]
    assert python.explain().repairs[0].saving_lower > 0
    other = json_of(invoke(truth, estimate, *METRIC, "--interpolate", "truth", "--max-gap", "0.2",
                           "--format", "json"))  # fmt: skip
    assert other["sizes"]["steps"] == 6
    assert other["input"] == document["input"]


def test_clouds_are_not_interpolated() -> None:
    side = Trajectories.from_array(np.zeros((3, 1, 2)))
    points = Clouds(points=np.zeros((3, 2)), weights=np.ones(3), first=np.arange(4))
    with pytest.raises(ConfigError, match="clouds of particles, which are not interpolated"):
        at_stamps(side.with_clouds(points), np.arange(3) + 0.5, 1)
    assert at_stamps(side, np.zeros(0), 1)[0] is side
    with pytest.raises(InputError, match="times of one run must be of one kind"):
        interpolated(side, replace(side, clock="local"), max_gap=1)
