"""Makes the files beside it: python sample_data/formats/make.py [FOLDER].

One small scene, in metres, as trackers of several fields find it on their disks.
"""

import hashlib
import io
import json
import sys
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pandas as pd
import scipy.io

from tgospa_eval.simulation import Scene, Tracker, simulate

SCENE = Scene(scenario="crossing", targets=4, steps=12, area=200)
TRACKER = Tracker(noise=1.5, detection=0.9, fragmentation=0.05, false_rate=0.3)
CLASSES = ("car", "pedestrian", "car", "truck")
"""Of the targets; false tracks are cars."""

START = datetime(2024, 6, 1, 12, tzinfo=UTC)


class Row(NamedTuple):
    """An object at a step."""

    number: int
    step: int
    x: float
    y: float
    klass: str


def main(folder: Path) -> None:
    """All files."""
    folder.mkdir(parents=True, exist_ok=True)
    truth, estimate = (
        list(rows(side)) for side in simulate(SCENE, TRACKER, np.random.default_rng(4))
    )
    for name, side in (("truth", truth), ("estimate", estimate)):
        lines = [f"{r.number},{r.step},{r.x},{r.y},{r.klass}" for r in side]
        write(folder / f"{name}.csv", ["id,t,x,y,class", *lines])
    mat_5(folder / "run.mat", {"X": structure(truth), "Y": structure(estimate)})
    mat_73(folder / "truth73.mat", structure(truth))
    argoverse(folder / "annotations.feather", truth, {"num_interior_pts": 12})
    argoverse(folder / "argoverse_tracks.feather", estimate, {"score": 0.9})
    nuscenes_tables(folder / "v1.0-mini", truth)
    write_json(folder / "nuscenes_results.json", nuscenes_results(estimate))
    write(folder / "ais.csv", ais(truth))
    write(folder / "vessel_tracks.csv", vessel_tracks(estimate))
    write(folder / "adsb.csv", adsb(truth))
    write(folder / "aircraft_tracks.csv", aircraft_tracks(estimate))


def rows(side) -> Iterator[Row]:
    """Yield the rows of trajectories."""
    for step, track, (x, y) in zip(side.step, side.track, side.state, strict=True):
        number = int(side.ids[track])
        known = 0 <= number % 100 - 1 < len(CLASSES) and number < 200
        klass = CLASSES[number % 100 - 1] if known else "car"
        yield Row(number, int(side.times[step]), float(x), float(y), klass)


def place(row: Row, scale: float) -> tuple[str, str]:
    """Latitude and longitude: in the Gulf of Mexico, a metre of the scene as so many metres."""
    degree = 111_195 / scale
    return f"{28.5 + row.y / degree:.6f}", f"{-94.2 + row.x / degree / 0.8788:.6f}"


def ais(truth: list[Row]) -> Iterator[str]:
    """Ships every minute, as of MarineCadastre; an MMSI may begin with 0, a position be unknown."""
    yield (
        "MMSI,BaseDateTime,LAT,LON,SOG,COG,Heading,VesselName,IMO,CallSign,VesselType,Status,Length,"
        "Width,Draft,Cargo,TransceiverClass"
    )
    for r in truth:
        lat, lon = place(r, 50)
        stamp = (START + timedelta(minutes=r.step)).strftime("%Y-%m-%dT%H:%M:%S")
        yield f"00366{r.number:04},{stamp},{lat},{lon},9.1,45.0,511.0,,,,70,0,120,20,,,A"
    stamp = (START + timedelta(minutes=1)).strftime("%Y-%m-%dT%H:%M:%S")
    yield f"003660099,{stamp},91.0,181.0,0.0,360.0,511.0,,,,,,,,,,B"


def vessel_tracks(estimate: list[Row]) -> Iterator[str]:
    """Yield the lines of a coastal radar."""
    yield "track_id,time,latitude,longitude"
    for r in estimate:
        stamp = (START + timedelta(minutes=r.step)).strftime("%Y-%m-%d %H:%M:%S")
        yield ",".join((str(r.number), stamp, *place(r, 50)))


def adsb(truth: list[Row]) -> Iterator[str]:
    """Aircraft every ten seconds, as state vectors of OpenSky; one is heard but not placed."""
    yield (
        "time,icao24,lat,lon,velocity,heading,vertrate,callsign,onground,alert,spi,squawk,"
        "baroaltitude,geoaltitude,lastposupdate,lastcontact,hour"
    )
    hour = int(START.timestamp())
    for r in truth:
        lat, lon = place(r, 500)
        time = hour + 10 * r.step
        yield (
            f"{time},00a{r.number:03x},{lat},{lon},230.5,45.0,0.0,SIM{r.number:<5},false,false,"
            f"false,1000,9144.0,9200.0,{time - 0.4:.1f},{time - 0.1:.1f},{hour}"
        )
    yield f"{hour + 10},00affe,,,,,,,false,false,false,,,,,{hour + 9.9:.1f},{hour}"


def aircraft_tracks(estimate: list[Row]) -> Iterator[str]:
    """Yield the lines of a surveillance radar."""
    yield "track,time,lat,lon"
    for r in estimate:
        yield ",".join((f"R{r.number}", str(int(START.timestamp()) + 10 * r.step), *place(r, 500)))


def structure(side: list[Row]) -> dict[str, np.ndarray]:
    """Return trajectories as in the published MATLAB code: steps from 1 on, NaN in holes."""
    numbers = sorted({r.number for r in side})
    state = np.zeros((2, SCENE.steps, len(numbers)))
    first, last = np.zeros((2, len(numbers), 1))
    for k, number in enumerate(numbers):
        own = {r.step: (r.x, r.y) for r in side if r.number == number}
        first[k], last[k] = min(own), max(own)
        for step in range(min(own), max(own) + 1):
            state[:, step - 1, k] = own.get(step, (np.nan, np.nan))
    return {"tVec": first, "iVec": last - first + 1, "xState": state}


def mat_5(path: Path, variables: dict[str, dict[str, np.ndarray]]) -> None:
    """As by save(FILE, 'X', 'Y', '-v6'), with a date that stays."""
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, variables)
    text = b"MATLAB 5.0 MAT-file, Platform: GLNXA64, Created on: Sat Jun  1 12:00:00 2024"
    path.write_bytes(text.ljust(116) + buffer.getvalue()[116:])


def mat_73(path: Path, fields: dict[str, np.ndarray]) -> None:
    """As by save(FILE, 'X', '-v7.3')."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("X")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in fields.items():
            group.create_dataset(name, data=values.T)
            group[name].attrs["MATLAB_class"] = np.bytes_("double")
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sat Jun  1 12:00:00 2024"
    head = text.ljust(116) + bytes(8) + b"\x00\x02IM"
    data = path.read_bytes()
    path.write_bytes(head + data[len(head) :])


AV2_CATEGORIES = {"car": "REGULAR_VEHICLE", "pedestrian": "PEDESTRIAN", "truck": "BOX_TRUCK"}


def argoverse(path: Path, side: list[Row], more: dict[str, object]) -> None:
    """Boxes ten times a second, around a car; stamps of nanoseconds."""
    start = 315_967_376_959_702_000
    frame = pd.DataFrame(
        {
            "timestamp_ns": [start + 99_999_951 * r.step for r in side],
            "track_uuid": [str(uuid.UUID(token("track", r.number))) for r in side],
            "category": [AV2_CATEGORIES[r.klass] for r in side],
            "length_m": 4.5,
            "width_m": 1.9,
            "height_m": 1.7,
            "qw": 1.0,
            "qx": 0.0,
            "qy": 0.0,
            "qz": 0.0,
            "tx_m": [r.x for r in side],
            "ty_m": [r.y for r in side],
            "tz_m": 0.6,
            **more,
        }
    )
    frame.to_feather(path)


CATEGORIES = {
    "car": "vehicle.car",
    "pedestrian": "human.pedestrian.adult",
    "truck": "vehicle.truck",
    "barrier": "movable_object.barrier",
}


def token(*parts: object) -> str:
    """Return a token as those of nuScenes."""
    return hashlib.md5(" ".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def nuscenes_tables(folder: Path, truth: list[Row]) -> None:
    """Annotations twice a second; a barrier is not tracked, and a car had no point of a sensor."""
    stamp = int(START.timestamp()) * 1_000_000
    barrier = Row(90, 3, 5.0, 5.0, "barrier")
    unseen = Row(91, 3, 150.0, 10.0, "car")
    objects = {r.number: r for r in (*truth, barrier, unseen)}
    tables = {
        "scene": [{"token": token("scene"), "name": "scene-0061", "nbr_samples": SCENE.steps}],
        "sample": [
            {
                "token": token("sample", step),
                "timestamp": stamp + 500_000 * step,
                "scene_token": token("scene"),
            }
            for step in range(1, SCENE.steps + 1)
        ],
        "category": [{"token": token(name), "name": name} for name in CATEGORIES.values()],
        "instance": [
            {"token": token("instance", r.number), "category_token": token(CATEGORIES[r.klass])}
            for r in objects.values()
        ],
        "sample_annotation": [
            {
                "token": token("annotation", r.number, r.step),
                "sample_token": token("sample", r.step),
                "instance_token": token("instance", r.number),
                "translation": [r.x, r.y, 1.0],
                "size": [1.9, 4.5, 1.7],
                "rotation": [1.0, 0.0, 0.0, 0.0],
                "num_lidar_pts": 0 if r is unseen else 7,
                "num_radar_pts": 0,
            }
            for r in (*truth, barrier, unseen)
        ],
    }
    for name, rows in tables.items():
        write_json(folder / f"{name}.json", rows)


def nuscenes_results(estimate: list[Row]) -> dict[str, object]:
    """Return a submission to the tracking task; its samples are in no order."""
    results: dict[str, list[object]] = {
        token("sample", step): [] for step in range(SCENE.steps, 0, -1)
    }
    for r in estimate:
        results[token("sample", r.step)].append(
            {
                "sample_token": token("sample", r.step),
                "translation": [r.x, r.y, 0.9],
                "size": [1.9, 4.5, 1.7],
                "rotation": [1.0, 0.0, 0.0, 0.0],
                "velocity": [0.0, 0.0],
                "tracking_id": str(r.number),
                "tracking_name": r.klass,
                "tracking_score": 0.9,
            }
        )
    return {"meta": {"use_camera": False, "use_lidar": True}, "results": results}


def write_json(path: Path, document: object) -> None:
    """Write a file of JSON."""
    write(path, [json.dumps(document, separators=(",", ":"))])


def write(path: Path, lines) -> None:
    """Write a file of text."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
