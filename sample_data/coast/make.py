"""Makes the files of this folder: ships by AIS and by a radar, aircraft by ADS-B and by a tracker.

The radar stands at 55.6 N, 12.8 E. Its axes are north and east, its clock is 4.7 s ahead, and it
counts seconds since 1970; AIS has dates of days and months in UTC, semicolons, and a ship that is
silent for four minutes. ADS-B has heights in feet, the tracker in metres.
"""

import csv
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from pyproj import Geod

FOLDER = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
START = datetime(2025, 4, 3, 10, 0, 0, tzinfo=UTC)
RADAR = (55.6, 12.8)
AHEAD = 4.7
SECONDS = 1200
EARTH = Geod(ellps="WGS84")

# MMSI, bearing and range of the start in metres, course, speed in m/s, turn in degrees per second
SHIPS = (
    ("002190001", 20.0, 9000.0, 200.0, 6.0, 0.00),
    ("219000002", 75.0, 14000.0, 265.0, 8.0, 0.02),
    ("219000003", 140.0, 6000.0, 10.0, 4.0, -0.03),
    ("265000004", 300.0, 18000.0, 120.0, 9.0, 0.00),
)
SILENT = ("219000002", 420, 660)
LOST = ("265000004", 800, 950)


def path(bearing, distance, course, speed, turn, seconds):
    """East and north of the radar at each second."""
    angle = np.radians(course + turn * np.arange(seconds))
    start = distance * np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
    step = speed * np.stack((np.sin(angle), np.cos(angle)), axis=1)
    return start + np.cumsum(step, axis=0)


def on_earth(places):
    """Latitudes and longitudes of places east and north of the radar."""
    centre = np.full(len(places), RADAR[1]), np.full(len(places), RADAR[0])
    direction = np.degrees(np.arctan2(places[:, 0], places[:, 1]))
    lon, lat, _ = EARTH.fwd(*centre, direction, np.hypot(*places.T))
    return lat, lon


def write(name, header, rows, delimiter=","):
    """Write a table."""
    with (FOLDER / name).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def ships():
    """AIS reports every 10 s, radar plots every 4 s."""
    rng = np.random.default_rng(1)
    reports, plots = [], []
    for number, (mmsi, *motion) in enumerate(SHIPS):
        places = path(*motion, SECONDS + 1)
        lat, lon = on_earth(places)
        for second in range(number, SECONDS + 1, 10):
            if mmsi == SILENT[0] and SILENT[1] < second < SILENT[2]:
                continue
            stamp = (START + timedelta(seconds=second)).strftime("%d/%m/%Y %H:%M:%S")
            reports.append((stamp, mmsi, f"{lat[second]:.6f}", f"{lon[second]:.6f}"))
        for second in range(0, SECONDS + 1, 4):
            if mmsi == LOST[0] and LOST[1] < second < LOST[2]:
                continue
            east, north = places[second] + rng.normal(0, 15, 2)
            clock = START.timestamp() + second + AHEAD
            track = 11 + number + 10 * (mmsi == LOST[0] and second >= LOST[2])
            plots.append((track, f"{clock:.1f}", f"{north:.1f}", f"{east:.1f}"))
    for second in range(300, 400, 4):  # clutter
        clock = START.timestamp() + second + AHEAD
        plots.append((99, f"{clock:.1f}", f"{-4000.0 + second:.1f}", "-2500.0"))
    reports.sort(key=lambda row: (row[0], row[1]))
    plots.sort(key=lambda row: (row[1], row[0]))
    write("ais.csv", ("Timestamp", "MMSI", "Latitude", "Longitude"), reports, ";")
    write("radar.csv", ("track", "time", "x", "y"), plots)


def aircraft():
    """Two descents: ADS-B in feet, a tracker in metres with an error of 30 m in height."""
    rng = np.random.default_rng(2)
    truth, tracks = [], []
    for number, (name, bearing, course, height) in enumerate(
        (("45ac2e", 40.0, 220.0, 24000.0), ("4ca7b1", 310.0, 130.0, 31000.0))
    ):
        places = path(bearing, 60000.0, course, 150.0, 0.05, 301)
        lat, lon = on_earth(places)
        noisy = on_earth(places + rng.normal(0, 60, places.shape))
        for second in range(0, 301, 5):
            stamp = (START + timedelta(seconds=second)).strftime("%Y-%m-%dT%H:%M:%SZ")
            feet = height - 25.0 * second
            metres = 0.3048 * feet + 30.0 * rng.normal()
            truth.append((stamp, name, f"{lat[second]:.6f}", f"{lon[second]:.6f}", f"{feet:.0f}"))
            here = (f"{place[second]:.6f}" for place in noisy)
            tracks.append((stamp, number + 1, *here, f"{metres:.1f}"))
    header = ("time", "id", "lat", "lon", "alt")
    write("adsb.csv", header, sorted(truth))
    write("tracker.csv", header, sorted(tracks))


if __name__ == "__main__":
    ships()
    aircraft()
