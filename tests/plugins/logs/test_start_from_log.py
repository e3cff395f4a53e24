"""`init --from LOG`: a campaign around a logged flight, and what cannot be one."""

import math
import re
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.conftest import Fly
from tests.orchestrator.recording.ros2_bag import vector, write_bag
from tests.plugins.logs.logs_of_flights import CORNERS, EPOCH_S, FRAME, flown, write_tlog
from wil_campaign.campaigns.schema.vehicles import BodyPart
from wil_campaign.campaigns.setup.vehicle_setups import EMBEDDED_BODY
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.ardupilot.copter.data_flash import DataFlash
from wil_campaign.plugins.logs.course import course_of_flight
from wil_campaign.plugins.logs.dataflash_reader import _Vehicle
from wil_campaign.plugins.logs.log_reader import read_log
from wil_campaign.plugins.logs.logged_flight import (
    FlightLogError,
    LoggedFlight,
    PowerSample,
    TrackPoint,
)
from wil_campaign.plugins.logs.ros_bag_reader import _receive_pose
from wil_campaign.plugins.logs.start import battery_of_flight, files_from_log
from wil_campaign.plugins.logs.tlog_reader import _frames, _Skipped
from wil_campaign.plugins.logs.track_builder import TrackBuilder
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import (
    ParameterTable,
    TableParameter,
)
from wil_campaign.vehicles.embedded.autopilot.services.log_formats import ULog
from wil_campaign.vehicles.embedded.physics.states import BodyMotion
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

LOCAL_POSITION_NED = 32
Capture = pytest.CaptureFixture[str]
ODOMETRY = """\
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""


def vehicle_log(kind: type[DataFlash] | type[ULog], path: Path) -> Path:
    """Write the log that the embedded autopilot writes."""
    name, is_px4 = ("MPC_XY_CRUISE", True) if kind is ULog else ("WPNAV_SPEED_DN", False)
    log = kind(0, ParameterTable((TableParameter(name, 9, 123.0),), bytewise=is_px4))
    log.text(0, "ArduCopter V4.7.0-dev (8d3c51a7)")
    log.text(0, "Frame: QUAD/X")
    for t_s, north_m, east_m, up_m in flown():
        zero = (0.0, 0.0, 0.0)
        now = BodyMotion((north_m, east_m, -up_m), zero, (0.0, 0.0, math.radians(30)), zero, zero)
        log.position(round(t_s * 1e6), now)
    path.write_bytes(log.data())
    return path


def bag(path: Path) -> Path:
    """Write a bag of ROS 2: odometry in east, north, up."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("nav_msgs/msg/Odometry", ODOMETRY)
        for t_s, north_m, east_m, up_m in flown():
            yaw = math.pi / 2 - math.radians(30)
            orientation = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
            pose = {"position": {"x": east_m, "y": north_m, "z": up_m}, "orientation": orientation}
            header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "odom"}
            message = {"header": header, "child_frame_id": "base", "pose": {"pose": pose}}
            stamp_ns = round((EPOCH_S + t_s) * 1e9)
            writer.write_message("/odom", schema, message, stamp_ns, stamp_ns)
        writer.finish()
    return path


def of_kind(kind: str, folder: Path) -> Path:
    path = folder / f"flight.{kind}"
    match kind:
        case "tlog":
            return write_tlog(path)
        case "ulg":
            return vehicle_log(ULog, path)
        case "bin":
            return vehicle_log(DataFlash, path)
        case _:
            return bag(path)


@pytest.mark.parametrize("kind", ["tlog", "ulg", "bin", "mcap"])
def test_the_course_of_each_format(tmp_path: Path, kind: str) -> None:
    flight = read_log(of_kind(kind, tmp_path))
    course = course_of_flight(flight)
    assert course is not None
    assert course.yaw_rad == pytest.approx(math.radians(30), abs=1e-5)
    assert course.altitude_m == pytest.approx(3.0, abs=0.05)
    corners = [(waypoint.north_m, waypoint.east_m) for waypoint in course.waypoints]
    assert corners[0] == pytest.approx(CORNERS[1], abs=0.3)
    assert corners[1] == pytest.approx(CORNERS[2], abs=0.3)
    assert course.waypoints[0].speed_m_s == pytest.approx(2.0, abs=0.1)
    assert course.box == ((-5, 13), (-5, 9), (-2.0, 8))
    assert flight.autopilot == {"bin": "ardupilot", "mcap": None}.get(kind, "px4")


def test_a_tlog_tells_vehicle_firmware_place_and_parameters(tmp_path: Path) -> None:
    flight = read_log(write_tlog(tmp_path / "flight.tlog"))
    assert (flight.autopilot, flight.vehicle_type) == ("px4", "hexarotor")
    assert flight.firmware == "1.16.2 (abcdef12)"
    assert flight.parameters == {"MPC_XY_CRUISE": 2.5, "SYS_AUTOSTART": 4001}
    assert flight.origin is not None
    north, east, down = FRAME.to_ned(
        flight.origin.latitude_deg, flight.origin.longitude_deg, flight.origin.altitude_m
    )
    assert (north, east, down) == pytest.approx((-5.0, 0.0, -0.2), abs=0.05)


def test_the_logs_of_embedded_vehicles_tell_their_parameters(tmp_path: Path) -> None:
    flight = read_log(of_kind("bin", tmp_path))
    assert flight.firmware == "4.7.0-dev (8d3c51a7)"
    assert flight.vehicle_type == "quadrotor"
    assert flight.parameters == {"WPNAV_SPEED_DN": 123.0}
    assert read_log(of_kind("ulg", tmp_path)).parameters == {"MPC_XY_CRUISE": 123.0}


def test_a_campaign_of_a_log_validates(tmp_path: Path, capsys: Capture) -> None:
    log = write_tlog(tmp_path / "flight: a.tlog")
    place = tmp_path / "again"
    assert main(["init", "again", "--in", str(place), "--from", str(log), "--profile"]) == 0
    assert main(["validate", str(place / "campaign.yaml")]) == 0
    assert "warning" not in capsys.readouterr().err
    world = yaml.safe_load((place / "world.yaml").read_text())
    assert world["origin"]["latitude_deg"] == pytest.approx(47.0, abs=1e-6)
    assert world["origin"]["altitude_m"] == pytest.approx(500.0, abs=0.05)
    text = (place / "campaign.yaml").read_text()
    assert "# firmware: 1.16.2 (abcdef12)" in text
    assert "# The embedded vehicle is a quadrotor" in text
    campaign = yaml.safe_load(text)
    for vehicle in campaign["vehicles"].values():
        assert vehicle["profile"] == "profile.yaml"
        assert BodyPart(**vehicle["body"]).shape() == EMBEDDED_BODY
    assert campaign["vehicles"]["real"]["params"] == {"MPC_XY_CRUISE": 2.5}
    assert campaign["vehicles"]["real"]["start"]["yaw_deg"] == 30.0
    assert (place / "px4.params").read_text().splitlines()[1:] == [
        "MPC_XY_CRUISE,2.5",
        "SYS_AUTOSTART,4001",
    ]
    profile = yaml.safe_load((place / "profile.yaml").read_text())
    assert profile["battery"]["full_v"] == 16.8
    said = (place / "profile.yaml").read_text().splitlines()[0]
    assert "; its 4 cells are a guess, by the greatest voltage. The rest" in said
    assert profile["battery"]["hover_current_a"] == 15.0
    assert profile["airframe"]["mass_kg"] == 0.5, "a log does not tell it"


def test_the_log_of_a_run_is_flown_again(fly_run: Fly, tmp_path: Path) -> None:
    result, folder = fly_run(mode="sim", has_cameras=True)
    assert result.verdict == "PASS"
    place = tmp_path / "again"
    assert main(["init", "again", "--in", str(place), "--from", str(folder)]) == 0
    options = ["--mode", "sim", "--clock", "virtual", "--out", str(tmp_path / "out"), "--json"]
    assert main(["run", str(place / "campaign.yaml"), *options]) == 0


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is empty"),
        (b"hello, world, this is no log", "is not a known flight log"),
        (b"#ROSBAG V2.0\n", "is a bag of ROS 1; convert it"),
        (b"SQLite format 3\0" + bytes(100), "is a bag of ROS 2 in SQLite; convert it"),
        (b"ULog\x01\x12\x35\x01" + bytes(8), "contains no flight"),
        (b"\xa3\x95\x80" + bytes(200), "has no message of a flight"),
        (b"\x89MCAP0\r\n" + bytes(64), "it has no schemas: was it cut off?"),
        (bytes(8) + b"\xfd" + bytes(300), "has no message of an autopilot"),
    ],
)
def test_a_file_that_is_no_log_is_refused(
    tmp_path: Path, capsys: Capture, content: bytes, text: str
) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    assert main(["init", "again", "--in", str(tmp_path / "x"), "--from", str(path)]) == 2
    said = capsys.readouterr().err
    assert text in said
    assert "Traceback" not in said
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("kind", ["tlog", "ulg", "bin", "mcap"])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_log_that_was_cut_off(tmp_path: Path, kind: str, share: float) -> None:
    path = of_kind(kind, tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    if kind == "mcap" and share < 0.5:  # its only chunk is not whole
        with pytest.raises(FlightLogError, match="it has no schemas: was it cut off"):
            read_log(path)
    else:
        flight = read_log(path)
        assert len(flight.track) >= share * 60
        if kind != "bin":  # its last page ends anywhere
            assert any("damaged" in text or "cut" in text for text in flight.problems)


@pytest.mark.parametrize(
    "garbage",
    [bytes(range(40, 90)), bytes(400), b"\xa3\x95\xee" * 9],
    ids=["text", "zeros", "heads"],
)
def test_behind_damage_a_dataflash_log_is_read_on(tmp_path: Path, garbage: bytes) -> None:
    path = of_kind("bin", tmp_path)
    data = path.read_bytes()
    whole = read_log(path)
    at = data.index(b"\xa3\x95", len(data) // 2) + 2
    path.write_bytes(data[:at] + garbage + data[at:])
    found = read_log(path)
    assert len(found.track) >= len(whole.track) - 1
    assert (whole.problems, len(found.problems)) == ((), 1)


def test_a_ulog_tells_what_its_logger_lost(tmp_path: Path) -> None:
    path = of_kind("ulg", tmp_path)
    with path.open("ab") as stream:
        stream.write(struct.pack("<HBH", 2, ord("O"), 1500))
    assert read_log(path).problems == ("its logger lost 1.50 s in 1 gaps",)


def test_frames_of_a_tlog_with_another_checksum_are_counted(tmp_path: Path) -> None:
    path = write_tlog(tmp_path / "flight.tlog")
    data, at, lost = bytearray(path.read_bytes()), 0, 0
    while at < len(data):
        length = 12 + data[at + 9]
        if data[at + 15] == LOCAL_POSITION_NED and at > len(data) // 2:
            data[at + 20] ^= 0x55
            lost += length
        at += 8 + length
    path.write_bytes(data)
    assert read_log(path).problems == (f"{lost} bytes are damaged, and were skipped",)


def test_vehicles_of_a_tlog_that_are_left_out_are_named(tmp_path: Path) -> None:
    path = write_tlog(tmp_path / "flight.tlog")
    other = MavlinkCodec(system_id=9, component_id=1)
    raw = other.pack(mavlink.MAVLink_local_position_ned_message(0, 90, 0, 0, 0, 0, 0))
    path.write_bytes(path.read_bytes() + struct.pack(">Q", round(EPOCH_S * 1e6)) + raw)
    (problem,) = read_log(path).problems
    assert problem.endswith("left out: system 9")


def test_the_topics_of_a_bag_that_are_left_out_are_named(tmp_path: Path) -> None:
    schema = "geometry_msgs/msg/PoseStamped"
    place = {"position": vector(1.0, 2.0, 3.0), "orientation": {**vector(0, 0, 0), "w": 1.0}}
    bag = [(topic, schema, EPOCH_S, {"pose": place}) for topic in ("/mine", "/other")]
    problems = read_log(write_bag(tmp_path / "two.mcap", bag)).problems
    assert "its topics /other were left out: /mine is used" in problems


def test_a_place_without_a_fix_is_no_place(tmp_path: Path) -> None:
    covariance = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
    bag = []
    for k, (status, latitude_deg) in enumerate(((-1, 10.0), (0, 47.0), (0, 47.0))):
        place = {"latitude": latitude_deg, "longitude": 8.0, "altitude": 500.0, **covariance}
        fields = {"status": {"status": status, "service": 1}, **place}
        bag.append(("/fix", "sensor_msgs/msg/NavSatFix", EPOCH_S + k, fields))
    flight = read_log(write_bag(tmp_path / "fix.mcap", bag))
    assert flight.origin is not None
    assert (flight.origin.latitude_deg, len(flight.track)) == (47.0, 2)
    assert "1 of its 3 positions are invalid, and were left out" in flight.problems
    height = "the origin's altitude is above the ellipsoid, not above mean sea level"
    assert height in flight.problems, "48 m in Zurich"


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_statistics": False, "use_summary_offsets": False, "index_types": IndexType.NONE},
    ],
)
def test_a_bag_is_read_whole_whatever_its_index_has(
    options: dict[str, Any], tmp_path: Path
) -> None:
    wanted = read_log(bag(tmp_path / "a.mcap"))
    with (tmp_path / "a.mcap").open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())
    with (tmp_path / "b.mcap").open("wb") as stream:
        writer = McapWriter(stream, **options)
        writer.start("ros2")
        schema, channel, _ = messages[0]
        assert schema is not None
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        channel_id = writer.register_channel(channel.topic, "cdr", number)
        for _, _, message in reversed(messages):  # they count by their log times
            writer.add_message(channel_id, message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    assert read_log(tmp_path / "b.mcap").track == wanted.track
    assert len(wanted.track) > 100


def test_a_bag_that_was_cut_off_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap")
    whole = read_log(path)
    path.write_bytes(path.read_bytes()[:-200])
    flight = read_log(path)
    assert flight.track == whole.track
    assert any(text.startswith("it is cut after byte") for text in flight.problems)


def test_a_bag_with_a_damaged_definition_is_refused(tmp_path: Path) -> None:
    path = of_kind("mcap", tmp_path)
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start("ros2")
        text = ODOMETRY.replace("geometry_msgs/Pose pose", "geometry!msgs/Pose pose")
        schema = writer.register_schema("nav_msgs/msg/Odometry", "ros2msg", text.encode())
        channel = writer.register_channel("/odom", "cdr", schema)
        writer.add_message(channel, log_time=1, publish_time=1, data=bytes(99))
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    with pytest.raises(FlightLogError, match="cannot be read as an MCAP file"):
        read_log(path)


def test_damage_in_a_tlog_is_skipped_and_reported(tmp_path: Path) -> None:
    flight = read_log(write_tlog(tmp_path / "flight.tlog", damage=True))
    assert any("bytes are damaged, and were skipped" in text for text in flight.problems)
    assert len(flight.track) > 125


def test_the_longest_of_several_flights_is_flown() -> None:
    def flight(begin_s: float, up_s: int) -> list[TrackPoint]:
        ups = [0.0, 0.0, *([2.0] * up_s), 0.0]
        return [TrackPoint(begin_s + k, 1.5 * k, 0.0, up, 0.0) for k, up in enumerate(ups)]

    track = [*flight(0, 5), *flight(100, 20)]
    armed = [(0.0, True), (8.0, False), (100.0, True), (123.0, False)]
    course = course_of_flight(LoggedFlight(kind="", track=track, armed=armed))
    assert course is not None
    assert (course.flights, course.duration_s) == (2, 19.0)
    assert course_of_flight(LoggedFlight(kind="", track=track[:2])) is None


def test_the_hover_current_is_that_of_the_flight_however_long_it_stood_armed() -> None:
    ups = [0.0] * 60 + [2.0] * 30 + [0.0]
    track = [TrackPoint(float(k), 0.0, 0.0, up, 0.0) for k, up in enumerate(ups)]
    power = [PowerSample(float(k), 15.0, 12.0 if up else 1.0) for k, up in enumerate(ups)]
    flight = LoggedFlight(kind="", track=track, armed=[(0.0, True), (90.0, False)], power=power)
    battery = battery_of_flight(flight, course_of_flight(flight))
    assert battery is not None
    assert battery.values["hover_current_a"] == 12.0


def test_positions_that_a_px4_calls_invalid_are_left_out_of_a_bag_too(tmp_path: Path) -> None:
    fields = "bool xy_valid\nbool z_valid\nbool xy_global\nbool z_global\nfloat64 ref_lat\n"
    fields += "float64 ref_lon\nfloat32 ref_alt\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 heading\n"
    with (tmp_path / "px4.mcap").open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("px4_msgs/msg/VehicleLocalPosition", fields)
        for k, known in enumerate((False, True, True)):
            message = dict.fromkeys(("xy_valid", "z_valid"), known) | {"x": 1.0 if known else 900.0}
            writer.write_message("/fmu/out/vehicle_local_position", schema, message, k, k)
        writer.finish()
    flight = read_log(tmp_path / "px4.mcap")
    assert [point.north_m for point in flight.track] == [1.0, 1.0]
    assert "1 of its 3 positions are invalid, and were left out" in flight.problems


def test_of_two_estimators_in_a_dataflash_log_one_is_the_track(tmp_path: Path) -> None:
    track = read_log(of_kind("bin", tmp_path)).track
    vehicle = _Vehicle()
    for point in track:
        for kind, aside_m in (("XKF1", 0.0), ("NKF1", 100.0)):
            names = {"PN": point.north_m + aside_m, "PE": point.east_m, "PD": -point.up_m}
            message = SimpleNamespace(**names, Yaw=0.0, C=0, get_type=lambda kind=kind: kind)
            vehicle.local(point.t_s, message)
    found = vehicle.flight(is_damaged=False).track
    assert [point[:4] for point in found] == [point[:4] for point in track]


def test_a_log_that_is_not_there_is_refused(tmp_path: Path, capsys: Capture) -> None:
    assert main(["init", "again", "--in", str(tmp_path), "--from", str(tmp_path / "no")]) == 2
    assert "No such file" in capsys.readouterr().err


def test_a_device_is_no_log(tmp_path: Path) -> None:
    """It may have no end: /dev/zero filled the memory."""
    (tmp_path / "null.tlog").symlink_to("/dev/null")
    with pytest.raises(FlightLogError, match="is not a file"):
        read_log(tmp_path / "null.tlog")


@pytest.mark.parametrize("back_s", [3.0, 100.0])
def test_a_tlog_whose_clock_was_set_back_is_led_on(tmp_path: Path, back_s: float) -> None:
    """By 3 s its course went to and fro at 12 m/s, by 100 s it had never left the ground."""
    path = write_tlog(tmp_path / "flight.tlog")
    stamped = list(_frames(path.read_bytes(), _Skipped()))
    begin_s = stamped[0][0]
    path.write_bytes(
        b"".join(
            struct.pack(">Q", round((t_s - (back_s if t_s - begin_s > 5.0 else 0.0)) * 1e6)) + raw
            for t_s, raw in stamped
        )
    )
    flight = read_log(path)
    course = course_of_flight(flight)
    assert course is not None
    assert [point[:2] for point in course.waypoints] == [(8, 0), (8, 4), (8, 4)]
    assert course.duration_s == pytest.approx(11.0, abs=0.2)
    (problem,) = flight.problems
    assert re.fullmatch(r"its clock goes back by [\d.]+ s, and is led on from there", problem)


def _course(*places: tuple[float, float, float]) -> tuple[str, ...]:
    """Return the problems of a course that rises 3 m in 3 s, and then is at (t_s, north, up)."""
    rise = [TrackPoint(k * 0.1, 0.0, 0.0, k * 0.1, None) for k in range(31)]
    track = [*rise, *(TrackPoint(t_s, north_m, 0.0, up_m, None) for t_s, north_m, up_m in places)]
    course = course_of_flight(LoggedFlight(kind="made up", track=track))
    assert course is not None
    return course.problems


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([(3.0 + k, float(k), 3.0) for k in range(9)], ""),
        ([(4.0, 0.0, 3.0), (3604.0, 1.0, 3.0)], "gaps in its positions in the air: 1, of up to 36"),
        ([(4.0, 0.0, 3.0), (4.1, 50.0, 3.0)], "jumps of its position: 1, of up to 50.0 m, as"),
        ([(3.0 + k, 20.0 * k, 3.0) for k in range(9)], "legs of up to 20.0 m/s are flown at 12 m"),
        ([(3.0 + k, 2.0 * k, 3.0 - 2 * k) for k in range(9)], "it flew down to 13.0 m below its"),
    ],
    ids=["sound", "gap", "jump", "fast", "under"],
)
def test_a_course_says_where_it_is_not_what_was_flown(
    places: list[tuple[float, float, float]], said: str
) -> None:
    assert any(problem.startswith(said) for problem in _course(*places)) is bool(said)


def test_places_that_are_left_out_of_a_track_are_counted() -> None:
    track = TrackBuilder()
    for k in range(10):
        track.place(float(k), *((47.0, 8.0) if k % 2 else (0.0, 0.0)), 500.0)
    assert track.problems == ("5 of its 10 positions are invalid, and were left out",)


def test_an_unknown_heading_is_marked(tmp_path: Path) -> None:
    """An orientation of zeros, which nobody set, was a heading of 90 degrees."""
    zeros = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)
    track = TrackBuilder()
    for k in range(40):
        position = SimpleNamespace(x=0.0, y=0.0, z=min(3.0, 0.1 * k))
        _receive_pose(track, 0.1 * k, SimpleNamespace(position=position, orientation=zeros))
    assert {point.yaw_rad for point in track.track} == {None}
    path = write_tlog(tmp_path / "flight.tlog")
    assert "yaw_deg: 30.0}\n" in files_from_log(path, "x", profile=False)["campaign.yaml"]
    codec = MavlinkCodec(system_id=7, component_id=1)
    stamped = [
        (t_s, raw)
        for t_s, raw in _frames(path.read_bytes(), _Skipped())
        if next(iter(codec.split(raw))).message_id != mavlink.MAVLINK_MSG_ID_ATTITUDE
    ]
    path.write_bytes(b"".join(struct.pack(">Q", round(t_s * 1e6)) + raw for t_s, raw in stamped))
    text = files_from_log(path, "x", profile=False)["campaign.yaml"]
    assert text.count("yaw_deg: 0.0}  # its heading is unknown\n") == 2


def test_a_format_without_a_length_ends_a_dataflash_log(tmp_path: Path) -> None:
    """pymavlink read its message for ever."""
    path = vehicle_log(DataFlash, tmp_path / "flight.bin")
    data = bytearray(path.read_bytes())
    at = data.index(b"XKF1") - 1
    data[at : at + 1] = b"\0"
    data[at + 5 : at + 21] = bytes(16)
    path.write_bytes(data)
    with pytest.raises(FlightLogError, match="has no length"):
        read_log(path)


def test_samples_of_a_ulog_without_times_are_none(tmp_path: Path) -> None:
    path = vehicle_log(ULog, tmp_path / "flight.ulg")
    path.write_bytes(path.read_bytes().replace(b"uint64_t timestamp", b"uint64_t timestamq"))
    assert read_log(path).track == []
