"""Which column is which: names of headers, what maps them, and rows that are no tracks."""

from pathlib import Path

import pandas as pd
import pytest
from answer import Write
from rows import PLAIN, SAME, refusal, rows_of

from tgospa_eval import ConfigError, InputError, evaluate, read_trajectories
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.options import parse_where


@pytest.mark.parametrize(
    ("name", "time"),
    [
        *((name, "t") for name in ("track_id", "target_id", "object_id", "ID", "Track_ID")),
        *(("id", time) for time in ("time", "timestamp", "frame", "step", "T", "TimeStamp")),
    ],
)
def test_header_aliases(write: Write, name: str, time: str) -> None:
    path = write("a.csv", PLAIN.replace("id,t,x,y", f"{name},{time},X,y"))
    assert rows_of(read_trajectories(path)) == SAME


@pytest.mark.parametrize(
    "header",
    [
        "TrackID,time_s,x_m,y_m",
        "track id,Time [s],pos_x,pos_y",
        "trackId,Timestamp (ns),Position X (m),Position Y (m)",
        "obj_id,frame_id,utm_x,utm_y",
        "uuid,frameNumber,Easting,Northing",
        "target-id,datetime,xPosition,yPosition",
    ],
)
def test_usual_headers(write: Write, header: str) -> None:
    assert rows_of(read_trajectories(write("a.csv", PLAIN.replace("id,t,x,y", header)))) == SAME


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("id,stamp,ts,x", '"stamp" and "ts" may both be t; choose one, columns=(\'t=ts\','),
        ("id,t,pos_x,utm_x", '"pos_x" and "utm_x" may both be x; choose one, columns=('),
        ("uuid,track,t,x", '"uuid" and "track" may both be id; choose one, columns=(\'id=track\','),
        ("id,Time,TIME,x", '"Time" and "TIME" may both be t'),
    ],
)
def test_two_candidates_are_refused(write: Write, header: str, said: str) -> None:
    assert said in refusal(write("a.csv", f"{header}\n1,2,3,4\n"))[0]


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    ("name", "taken", "passed"),
    [
        ("t", "time", "frame"),
        ("t", "timestamp", "step"),
        ("t", "timestamp", "frame"),
        ("t", "Time", "TIMESTAMP"),
        ("t", "time", "ts"),
        ("t", "time", "time_ns"),
        ("t", "frame", "time_s"),
        ("t", "frame", "frame_id"),
        ("id", "track_id", "object_id"),
        ("id", "track_id", "mmsi"),
        ("id", "track_id", "track_name"),
        ("id", "target_id", "track"),
    ],
)
def test_the_first_aliases_have_an_order(
    write: Write, name: str, taken: str, passed: str, swapped: bool
) -> None:
    pair = (passed, taken) if swapped else (taken, passed)
    other = "t" if name == "id" else "id"
    values = {taken: 1, passed: 2, other: 3, "x": 4, "y": 5}
    header = (*pair, other, "x", "y")
    text = f"{','.join(header)}\n{','.join(str(values[column]) for column in header)}\n"
    path = write("a.csv", text)
    reading = read(path)
    key = ("1", 3) if name == "id" else ("3", 1)
    assert rows_of(reading.trajectories) == {key: (4.0, 5.0)}
    remedy = f"columns=('{name}={passed}',)"
    said = f'{name} is read from "{taken}", not from "{passed}"; {remedy} reads that'
    assert said in reading.notices
    mapped = read(path, ReadOptions(columns=(f"{name}={passed}",)))
    key = ("2", 3) if name == "id" else ("3", 2)
    assert rows_of(mapped.trajectories) == {key: (4.0, 5.0)}


def test_only_columns_that_are_wanted_may_be_doubtful(write: Write) -> None:
    path = write("a.csv", "id,t,x,y,bb_left,bbox_left\n1,2,3,4,5,6\n")
    assert rows_of(read_trajectories(path)) == {("1", 2): (3.0, 4.0)}
    path = write("b.csv", "id,time,frame,x\n1,2,3,4\n")
    named = read(path, ReadOptions(columns=("x", "frame")))
    assert rows_of(named.trajectories) == {("1", 2): (4.0, 3.0)}
    assert not named.notices


def test_a_plain_name_goes_before_aliases(write: Write) -> None:
    path = write("a.csv", "id,track_id,t,frame,lat,lon,easting,northing\na,b,1,2,3,4,5,6\n")
    trajectories = read_trajectories(path)
    assert rows_of(trajectories) == {("a", 1): (3.0, 4.0)}
    assert rows_of(read_trajectories(path, columns=("x", "y"))) == {("a", 1): (5.0, 6.0)}
    path = write("b.csv", "id,t,pos_x,pos_y,left,top,width,height\na,1,0,0,10,20,4,6\n")
    assert rows_of(read_trajectories(path)) == {("a", 1): (12.0, 23.0)}


@pytest.mark.parametrize(
    "header", ["x,z", "east,north,up", "north,east,down", "x,y,z_m", "x_pos,y_pos,z_pos"]
)
def test_no_axis_of_a_position_is_left_out(write: Write, header: str) -> None:
    size = len(header.split(","))
    path = write("a.csv", f"id,t,{header}\na,1,{','.join('345'[:size])}\n")
    found = read(path)
    assert not found.unused
    assert found.trajectories.columns == (("x", "z") if size == 2 else ("x", "y", "z"))


@pytest.mark.parametrize("other", ["utm_x,utm_y,utm_z", "pos_z", "pos_z,z_pos", "up", "down"])
def test_a_z_of_another_position_is_not_used(write: Write, other: str) -> None:
    more = [",yes", ","][other == "pos_z"] * len(other.split(","))
    found = read(write("a.csv", f"id,t,x,y,{other}\na,1,3,4{more}\n"))
    assert rows_of(found.trajectories) == {("a", 1): (3.0, 4.0)}
    assert found.unused == (*other.split(","),)


@pytest.mark.parametrize("marks", [("S", "W"), ("south", "West")])
@pytest.mark.parametrize("header", ["lat,ns,lon,ew", "Latitude,LatDir,Longitude,lon_ref"])
def test_hemispheres_are_the_signs_of_places(
    write: Write, header: str, marks: tuple[str, str]
) -> None:
    path = write("a.csv", f"id,t,{header}\na,1,48,{marks[0]},11,E\na,2,-48,N,11,{marks[1]}\n")
    reading = read(path)
    assert rows_of(reading.trajectories) == {("a", 1): (-48.0, 11.0), ("a", 2): (-48.0, -11.0)}
    assert not reading.unused
    assert sum("is negative where" in text for text in reading.notices) == 2
    other = write("b.csv", "id,sec,ns,lat,lon\na,1,0,48,11\na,2,0,48,11\n")
    assert "ns" in read(other, ReadOptions(columns=("t=sec",))).unused


def test_hemispheres_are_known_by_row(write: Write) -> None:
    lines = "a,1,48,S,11,E\na,2,,,,\na,3,47,,11,e\na,4,49,s,11,W"
    reading = read(write("a.csv", f"id,t,lat,ns,lon,ew\n{lines}\n"))
    states = {("a", 1): (-48.0, 11.0), ("a", 3): (47.0, 11.0), ("a", 4): (-49.0, -11.0)}
    assert rows_of(reading.trajectories) == states
    assert [one.code for one in reading.warnings] == ["hemispheres"]
    assert '"ns" is neither N nor S in 1 row, where lat keeps' in reading.warnings[0].text


@pytest.mark.parametrize(("south", "sign"), [("S", -1), (b"S", -1), ([1], 1), (None, 1)])
def test_hemispheres_of_other_types(south: object, sign: int) -> None:
    table = pd.DataFrame({"id": 1, "t": [0, 1], "lat": 48.0, "lon": 11.0, "lon_ref": "E"})
    found = read(table.assign(lat_ref=[south, south]), role="truth").trajectories
    assert (found.state == [48 * sign, 11]).all()


@pytest.mark.parametrize(
    ("header", "zones", "x", "warned"),
    [
        ("easting,northing,utm_zone", ("32", "33"), 500000, True),
        ("x,y,zone", ("32U", "33U"), 500000, True),
        ("x,y,zone", ("32U", "33T"), 50, False),
        ("x,y,zone", ("32U", "32V"), 500000, False),
        ("x,y,zone", ("32", "32"), 500000, False),
        ("x,y,zone", ("A", "B"), 500000, False),
    ],
)
def test_a_change_of_the_utm_zone_is_told(
    write: Write, header: str, zones: tuple[str, str], x: int, warned: bool
) -> None:
    path = write("a.csv", f"id,t,{header}\na,1,{x},6,{zones[0]}\na,2,{x},6,{zones[1]}\n")
    assert [one.code for one in read(path).warnings] == ["utm-zones"] * warned
    assert not read(path, ReadOptions(where=parse_where("t < 2", "where"))).warnings


@pytest.mark.parametrize(
    ("header", "corners"),
    [
        *((f"{name},width,height", False) for name in ("upper_left_x,upper_left_y", "x_lu,y_lu")),
        *((f"{name},w,h", False) for name in ("topleft_x,topleft_y", "top_left_x,top_left_y")),
        *(
            (name, True)
            for name in ("xtl,ytl,xbr,ybr", "x0,y0,x1,y1", "box_x0,box_y0,box_x1,box_y1")
        ),
    ],
)
def test_boxes_are_known_by_the_names_of_their_corners(
    write: Write, header: str, corners: bool
) -> None:
    end = "14,26" if corners else "4,6"
    path = write("a.csv", f"id,t,{header}\na,1,10,20,{end}\n")
    assert rows_of(read_trajectories(path)) == {("a", 1): (12.0, 23.0)}
    boxes = read(path, ReadOptions(boxes=True)).trajectories
    assert rows_of(boxes) == {("a", 1): (10.0, 20.0, 4.0, 6.0)}


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("x,y,alt", "x', 'y', 'z=alt'"),
        ("easting,northing,Elevation (m)", "'z=Elevation (m)'"),
        ("x,y,height", ""),
        ("lat,lon,alt_ft", "are left out: they are not in metres; to compare"),
        ("lat,lon,dx,dy,height_m", ""),
        ("x,y,length,height", ""),
        ("x,y,person_height", ""),
        ("x,y,alt_rate", ""),
    ],
)
def test_heights_beside_x_and_y_are_told(write: Write, header: str, said: str) -> None:
    path = write("a.csv", f"id,t,{header}\na,1{',2' * (header.count(',') + 1)}\n")
    reading = read(path, ReadOptions(heights="tell" if "lat" in header else ""))
    assert not reading.height
    assert [said in str(one) for one in reading.warnings] == [True] * bool(said)
    assert {one.code for one in reading.warnings} <= {"heights-left-out"}


@pytest.mark.parametrize(
    ("header", "row", "items"),
    [
        ("trk,clock,px,py", "a,1,2,3", "id=trk,t=clock,x=px,y=py"),
        ("name,secs,gps_east,gps_north", "b,2,3,4", "id=name,t=secs,x=gps_east,y=gps_north"),
        ("vx,vy,x1,y1,who,when", "0,0,1,1,a,2024-01-01", "id=who,t=when,x=x1,y=y1"),
        ("my id,t,a x,a y", "a,1,2,3", "id=my id,x=a x,y=a y"),
        ("id,t,ECEF_X,ECEF_Y,ECEF_Z", "a,1,2,3,4", "x=ECEF_X,y=ECEF_Y,z=ECEF_Z"),
        ("id,t,px,py,pz", "a,1,2,3,4", "x=px,y=py,z=pz"),
        ("id,t,my_lat,my_lon,my_alt", "a,1,2,3,4", "lat=my_lat,lon=my_lon,alt=my_alt"),
        ("id,t,my_north,my_east,my_down", "a,1,2,3,4", "x=my_east,y=my_north,z=my_down"),
    ],
)
def test_missing_columns_are_guessed(write: Write, header: str, row: str, items: str) -> None:
    path = write("a.csv", f"{header}\n{row}\n")
    assert f"columns={tuple(items.split(','))!r}" in refusal(path)[0]
    assert len(read_trajectories(path, columns=tuple(items.split(","))).ids) == 1


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (
            "a,b,c,d",
            "map them with columns=('id=HEADER', 't=HEADER', 'x=HEADER', 'y=HEADER'); ",
        ),
        ("scan,range_m", "columns=('id=HEADER', 't=scan', 'x=HEADER', 'y=HEADER'); rows without"),
        ("timestamp tx ty tz qx", "map them with columns=('id=HEADER', 'x=tx', 'y=ty', 'z=tz'); "),
        ("id,t,lower_left_x,lower_left_y", "is read from columns left, top and width, height or"),
    ],
)
def test_what_headers_do_not_hint_at_is_not_guessed(write: Write, header: str, said: str) -> None:
    assert said in refusal(write("a.csv", header + "\n"))[0]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("event-id,timestamp,location-long,location-lat,individual-local-identifier", "lat,lon"),
        ("y,x,mass,size,frame,particle", "x,y"),  # trackpy
        ("t,shipid,lon,lat,heading", "lat,lon"),
        ("x_min,y_min,x_max,y_max,class_id,confidence,tracker_id,frame_index", "x,y"),
    ],
)
def test_headers_of_public_data(write: Write, header: str, columns: str) -> None:
    row = ",".join(map(str, range(1, 2 + header.count(","))))
    found = read_trajectories(write("a.csv", f"{header}\n{row}\n"))
    assert ",".join(found.columns) == columns


@pytest.mark.parametrize(
    "header",
    [
        "t,x,y,conf",
        "frame,score,x,y",
        "t,x,y,p_exist,class,heading",
        "t,x,y,rcs",
        "t,objectness,x,y",
        "t,x,y,snr_db,num_points",
    ],
)
def test_scores_are_no_ids(write: Write, header: str) -> None:
    row = ",".join("0.5" if name[0] in "cphs" else "2" for name in header.split(","))
    (message,) = refusal(write("a.csv", f"{header}\n{row}\n"))
    assert "no column for id (" in message
    assert "columns=('id=HEADER',)" in message
    assert "rows without ids are detections, which TGOSPA cannot evaluate" in message


@pytest.mark.parametrize(
    ("header", "meant"),
    [
        ("device_id,t,x,y", "id=device_id"),
        ("device_id,t,target,x,y", "id="),
        ("id,t,px,py,e,n", "x=px"),
        ("id,t,my_east,my_north,z", "x=my_east"),
        ("id,t,my_lat,my_lon", "('lat=my_lat', 'lon=my_lon')"),
        ("id,t,qx,qy,qz,qw,tx_m,ty_m", "x=tx_m"),
        ("id,t,ax,ay,dx,dy,omega_x,omega_y,px,py", "x=px"),
        ("id,t,dx,dy,rot_x,rot_y,goal_x,goal_y,xx,yy", "x=xx"),
        ("id,t,orientation_x,orientation_y,translation_x,translation_y", "x=translation_x"),
        ("id,t,foo_x,foo_y,x1,y1", "('x=HEADER', 'y=HEADER'); positions may be foo_x,foo_y or x1"),
        ("id,t,fx,fy,length_x,length_y", "('x=HEADER', 'y=HEADER')"),
        ("frame,category_id,sensor_id,team_id,detection_id,trajectory,x,y", "('id=trajectory',)"),
        ("frame,camera_id,object_type,is_valid,x,y", "('id=HEADER',)"),
        ("time,callsign,flight,lat,lon,track", "('id=callsign',); if \"track\" is not a direction"),
        ("time,lat,lon,altitude,speed,track", "('id=HEADER',)"),
    ],
)
def test_what_may_be_something_else_is_asked_for(write: Write, header: str, meant: str) -> None:
    row = ",".join(map(str, range(2, 3 + header.count(","))))
    assert meant in refusal(write("a.csv", f"{header}\n{row}\n"))[0]


def test_a_table_of_both_sides(write: Write) -> None:
    path = write("a.csv", "id,t,x_gt,y_gt,x_est,y_est\n1,1,0,0,1,1\n")
    with pytest.raises(InputError, match=r"truth_columns=\('x=x_gt', 'y=y_gt'\)"):
        evaluate(path, path, 2, 2, 1)
    with pytest.raises(InputError, match=r"rename\(columns={'x_est': 'x', 'y_est': 'y'}\)"):
        evaluate(write("b.csv", PLAIN), pd.read_csv(path), 2, 2, 1)
    assert "positions may be x_gt,y_gt or x_est,y_est" in refusal(path)[0]


def test_columns_of_several_levels(write: Write) -> None:
    path = write("a.csv", PLAIN)
    table = pd.read_csv(path)
    levels = zip([1, 1, "pos", "pos"], table.columns, strict=True)
    table.columns = pd.MultiIndex.from_tuples([*levels])
    with pytest.raises(
        InputError, match=r"have 2 levels; join the levels, table\.columns = "
    ) as caught:
        evaluate(path, table, 2, 2, 1)
    exec(str(caught.value).split("levels, ")[1], {"table": table})
    named = {"id": "1_id", "t": "1_t", "x": "pos_x", "y": "pos_y"}
    columns = [f"{name}={header}" for name, header in named.items()]
    assert evaluate(path, table, 2, 2, 1, estimate_columns=columns).total == 0


def test_two_columns_of_the_same_ids(write: Write) -> None:
    same = "id,track_id,t,x\na,1,0,2\nb,2,0,3\na,1,1,2\nb,2,1,3\n"
    assert read(write("a.csv", same)).notices == ("columns not used: track_id",)
    notices = read(write("b.csv", same.replace("b,2,1", "b,1,1"))).notices
    assert 'id is read from "id", not from "track_id"' in notices[0]


def test_a_track_of_an_aircraft_is_a_direction(write: Write) -> None:
    path = write("a.csv", "time,icao24,lat,lon,track\n0,a,55,12,90\n1,a,55,12,91\n")
    reading = read(path)
    assert list(reading.trajectories.ids) == ["a"]
    assert reading.notices == ("columns not used: track",)
    other = "time,id,icao24,lat,lon,track\n0,7,a,55,12,90\n1,7,b,55,12,91\n"
    said = 'id is read from "id", not from "icao24" or "track"; columns=(\'id=icao24\',) reads that'
    assert said in read(write("id.csv", other)).notices
    assert list(read_trajectories(path, columns=("id=track",)).ids) == ["90", "91"]
    for table in ("lat,lon,speed,course\n0,1,55,12,90,80\n", "x,y,flight\n0,1,55,12,2\n"):
        assert list(read_trajectories(write("b.csv", f"time,track,{table}")).ids) == ["1"]


def test_two_parts_of_a_stamp_are_not_one(write: Write) -> None:
    path = write("a.csv", "id,stamp_sec,stamp_nanosec,x\na,1,0,2\na,2,400000000,3\n")
    assert "t=stamp_sec+stamp_nanosec" in refusal(path)[0]
    assert rows_of(read_trajectories(path, columns=("t=stamp_sec", "x"))) == {
        ("a", 1): (2.0,), ("a", 2): (3.0,)
    }  # fmt: skip


def test_latitude_and_longitude_are_the_second_choice(write: Write) -> None:
    path = write("a.csv", "id,t,lon,lat\na,1,11,48\n")
    trajectories = read_trajectories(path)
    assert trajectories.columns == ("lat", "lon")
    assert rows_of(trajectories) == {("a", 1): (48.0, 11.0)}
    path = write("b.csv", "id,t,lon,lat,x\na,1,11,48,5\n")
    assert read_trajectories(path).columns == ("x",)


@pytest.mark.parametrize(
    ("header", "remedy"),
    [
        ("id,secs,nsecs,x", "secs+nsecs"),
        ("id,Pose.Sec,Pose.Nanosec,x", "Pose.Sec+Pose.Nanosec"),
        ("id,tv_sec,tv_usec,x", "tv_sec+tv_usec"),
        ("id,time_s,time_ns,x", "time_s+time_ns"),
    ],
)
def test_two_parts_of_a_stamp(write: Write, header: str, remedy: str) -> None:
    path = write("a.csv", f"{header}\na,1600000000,500000,2\n")
    assert f"two parts of one time; read both, columns=('t={remedy}',)" in refusal(path)[0]
    part = 500_000_000 if "usec" in header else 500_000
    read = read_trajectories(path, columns=(f"t={remedy}", "x"))
    assert rows_of(read) == {("a", 16 * 10**17 + part): (2.0,)}


@pytest.mark.parametrize(
    ("ids", "cause"),
    [
        ("-1", "every id is -1: these are detections, and TGOSPA compares tracks"),
        ("7", 'nearly every id is "7", as in detections, but TGOSPA compares tracks'),
        ("abcde", "name the columns of ids and times"),
    ],
)
def test_most_rows_are_duplicates(write: Write, ids: str, cause: str) -> None:
    names = [ids] if ids != "abcde" else list(ids)
    rows = [f"{name},0,{k}" for name in names for k in range(3)]
    path = write("a.csv", "\n".join(["id,t,x", *rows]))
    reading = read(path, ReadOptions(on_duplicate="first"))
    (warning,) = reading.warnings
    assert warning.code == "duplicates"
    assert f"{2 * len(names)} of {3 * len(names)} rows repeat an (id, t)" in warning.text
    assert warning.remedy.startswith(cause)
    (message,) = refusal(path)
    assert (cause in message) == (ids != "abcde")


def test_detections_of_one_row_a_frame(write: Write) -> None:
    path = write("a.csv", "id,t,x\n-1,0,1\n-1,1,2\n")
    assert refusal(path) == [
        f"{path}: every id is -1: these are detections, and TGOSPA compares tracks; give a single "
        "track another id"
    ]
    assert len(read(path, ReadOptions(on_duplicate="first")).trajectories.step) == 2
    assert rows_of(read_trajectories(write("b.csv", "id,t,x\n-1,0,1\n"))) == {("-1", 0): (1.0,)}


def test_columns_map_headers(write: Write) -> None:
    path = write("a.csv", "trk,time_s,px,py,x,id\na,1,2,3,4,5\n")
    mapping = ("id=trk", "t=time_s", "x=px", "y=py")
    assert rows_of(read_trajectories(path, columns=mapping)) == {("a", 1): (2.0, 3.0)}
    reading = read(path, ReadOptions(columns=("id=trk", "t=time_s", "x=px")))
    assert rows_of(reading.trajectories) == {("a", 1): (2.0,)}
    assert reading.trajectories.columns == ("x",)
    assert "columns not used: py, x, id" in reading.notices
    # The order on the command line is the order of the state.
    trajectories = read_trajectories(path, columns=("py", "px", "id=trk", "t=time_s"))
    assert trajectories.columns == ("py", "px")
    assert rows_of(trajectories) == {("a", 1): (3.0, 2.0)}


def test_mapping_of_ids_alone_leaves_the_default_state(write: Write) -> None:
    path = write("a.csv", "trk,t,x,y\na,1,2,3\n")
    assert read_trajectories(path, columns=("id=trk",)).columns == ("x", "y")


def test_unused_columns_are_one_notice_and_not_read(write: Write) -> None:
    path = write("a.csv", "id,t,x,class,vx\na,1,2,car,oops\n")
    assert read(path).notices == ("columns not used: class, vx",)


@pytest.mark.parametrize("columns", [("x", "x"), ("=",), ("x=",), ("",), ("id=a", "id=b")])
def test_columns_that_mean_nothing(write: Write, columns: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError, match="columns"):
        read_trajectories(write("a.csv", PLAIN), columns=columns)


@pytest.mark.parametrize("option", [{"decimal": ";"}, {"on_duplicate": "both"}])
def test_options_that_mean_nothing(option: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=next(iter(option.values()))):
        ReadOptions(**option)


def test_mapped_header_that_is_not_there(write: Write) -> None:
    (message,) = refusal(write("a.csv", PLAIN), columns=("id=trk", "x"))
    for part in (", line 1: ", "trk", "id, t, x, y", "columns=('id="):
        assert part in message


def test_no_such_file_and_folder(tmp_path: Path) -> None:
    path = str(tmp_path / "none.csv")
    assert refusal(path) == [f"{path}: no such file"]
    (message,) = refusal(str(tmp_path))
    assert message.startswith(f"{tmp_path}: ")
    assert "folder" in message
