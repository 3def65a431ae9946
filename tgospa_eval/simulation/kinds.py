"""The kinds of long recordings, by name."""

from tgospa_eval.simulation import Tracker
from tgospa_eval.simulation.recordings import RecordingKind
from tgospa_eval.simulation.routes import ShippingLanes, Streets

AIS = RecordingKind(
    targets=2000,
    lifetimes=(50, 300),
    area=400e3,
    motion=ShippingLanes(
        area=400e3,
        ports=8,
        in_lanes=0.8,
        right=500.0,
        spread=60.0,
        speeds=(30.0, 120.0),
        sways=(0.0, 60.0),
        periods=(60.0, 240.0),
    ),
    false_speed=75.0,
    tracker=Tracker(
        noise=10.0,
        detection=0.95,
        swaps=0.25,
        near=50.0,
        fragmentation=0.002,
        false_rate=6.0,
    ),
    cutoff=100.0,
    switch_penalty=50.0,
)

CITY = RecordingKind(
    targets=500,
    lifetimes=(200, 400),
    area=1000.0,
    motion=Streets(blocks=10, block=100.0, right=3.0, speeds=(3.0, 12.0), most=400),
    false_speed=7.5,
    tracker=Tracker(
        noise=1.0,
        detection=0.93,
        swaps=0.1,
        near=5.0,
        fragmentation=0.01,
        false_rate=2.0,
    ),
    cutoff=10.0,
    switch_penalty=5.0,
)

RECORDINGS = {"ais": AIS, "city": CITY}
