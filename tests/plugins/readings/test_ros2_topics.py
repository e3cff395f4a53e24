"""A bag of ROS 2 as a sensor: each type of message in our units and axes, and what is of no use."""

import builtins
import itertools
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from tests.orchestrator.recording.ros2_bag import vector, write_bag
from wil_campaign.plugins.readings.ros2_messages import ROS2_TYPES
from wil_campaign.plugins.readings.topic_readings import TopicReadings
from wil_campaign.vehicles.readings import (
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.vehicles.readings.checks import reading_fault, reading_fault_after
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, euler_from_quat, quat_from_euler

AT_S = 1_795_000_000.25
NOSE = Pose((0.1, 0.0, 0.05), quat_from_euler(0.0, 0.2, 0.0))
HALF = math.sqrt(0.5)
EAST = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
"""A body (forward, left, up) that looks east in east, north, up: a yaw of 90 degrees of ours."""
PLACE = {"position": vector(1.0, 2.0, 3.0), "orientation": EAST}
ZEROS9, ZEROS36 = [0.0] * 9, [0.0] * 36


def cloud(*points: tuple[float, float, float], order: str = "<") -> dict[str, Any]:
    fields = [
        {"name": name, "offset": 4 + 4 * k, "datatype": 7, "count": 1}
        for k, name in enumerate("xyz")
    ]
    data = b"".join(struct.pack(f"{order}f3f", 9.0, *point) for point in points)
    shape = {"height": 1, "width": len(points), "point_step": 16, "row_step": len(data)}
    big = order == ">"
    return {"fields": fields, **shape, "data": list(data), "is_bigendian": big, "is_dense": True}


def fix(north_deg: float = 0.0, *, status: int = 0, known: int = 1) -> dict[str, Any]:
    return {
        "status": {"status": status, "service": 1},
        "latitude": 47.0 + north_deg,
        "longitude": 8.0,
        "altitude": 500.0,
        "position_covariance": [0.25, 0, 0, 0, 0.16, 0, 0, 0, 1.0],
        "position_covariance_type": known,
    }


def imu(**changes: Any) -> dict[str, Any]:
    return {
        "orientation": EAST,
        "orientation_covariance": ZEROS9,
        "angular_velocity": vector(0.1, 0.2, 0.3),
        "angular_velocity_covariance": ZEROS9,
        "linear_acceleration": vector(0.5, 0.25, 9.81),
        "linear_acceleration_covariance": ZEROS9,
        **changes,
    }


def distance(range_m: float) -> dict[str, Any]:
    limits = {"min_range": 0.25, "max_range": 8.0}
    return {"radiation_type": 0, "field_of_view": 0.1, **limits, "range": range_m, "variance": 0.0}


def read(path: Path, kind: str, topic: str | None = None) -> list[Reading]:
    file = TopicReadings(path=path, kind=kind, topic=topic, mount=NOSE)
    file.open()
    found = []
    while (one := file.next()) is not None:
        found.append(one)
    file.close()
    return found


def one_of(tmp_path: Path, kind: str, schema: str, fields: dict[str, Any]) -> Any:
    path = write_bag(tmp_path / "bag.mcap", [("/it", schema, AT_S, fields)])
    (found,) = read(path, kind)
    assert ROS2_TYPES[schema].kind == kind
    assert found.t_s == pytest.approx(AT_S, abs=1e-6)
    assert found.arrived_s == pytest.approx(AT_S + 0.01, abs=1e-6)
    return found


@pytest.mark.parametrize(
    ("stamps_s", "steps_s"),
    [
        ([0.0, 0.02, 0.04], [0.02, 0.02]),
        ([0.0, AT_S + 0.03, AT_S + 0.05], [0.02, 0.02]),
        ([AT_S, 0.0, AT_S + 0.05], [0.02, 0.03]),
        ([0.0, 0.0, 0.0], [0.02, 0.02]),
    ],
    ids=["simulated", "unset first", "unset later", "never set"],
)
def test_a_stamp_of_0_loses_no_reading(
    tmp_path: Path, stamps_s: list[float], steps_s: list[float]
) -> None:
    """All readings after the first stamp of a simulation's time were older than it: damaged."""
    schema = "sensor_msgs/msg/Range"
    told = [("/it", schema, stamp_s, distance(2.0)) for stamp_s in stamps_s]
    logged_s = [AT_S + 0.01 + 0.02 * k for k in range(3)]
    found = read(write_bag(tmp_path / "bag.mcap", told, logged_s=logged_s), "rangefinder")
    steps = [after.t_s - before.t_s for before, after in itertools.pairwise(found)]
    assert steps == pytest.approx(steps_s, abs=0.011)
    assert all(
        reading_fault_after(after, before) is None for before, after in itertools.pairwise(found)
    )


def test_a_sender_whose_clock_was_set_is_named(tmp_path: Path) -> None:
    """No later reading was due in the flight: 'no rangefinder reading for 1 s'."""
    schema = "sensor_msgs/msg/Range"
    told = [("/it", schema, AT_S + t_s, distance(2.0)) for t_s in (0.0, 0.02, 3600.0, 3600.02)]
    logged_s = [AT_S + 0.01 + 0.02 * k for k in range(4)]
    bag = write_bag(tmp_path / "bag.mcap", told, logged_s=logged_s)
    with pytest.raises(SourceError, match=r"3599.98 s after .* clock was set; cut the recording"):
        read(bag, "rangefinder")


@pytest.mark.parametrize(
    ("said", "meant"), [(2.5, 2.5), (9.0, math.inf), (math.inf, math.inf), (-math.inf, 0.25)]
)
def test_a_range_message_becomes_a_reading(tmp_path: Path, said: float, meant: float) -> None:
    found = one_of(tmp_path, "rangefinder", "sensor_msgs/msg/Range", distance(said))
    assert isinstance(found, RangefinderReading)
    assert (found.range_m, found.range_min_m, found.range_max_m) == (meant, 0.25, 8.0)
    assert found.mount == NOSE


LENS = Intrinsics.from_fov(3, 2, 1.2)
SEEN_M = np.array([[1.0, 2.0, 3.0], [math.inf, 5.0, 65.535]], np.float32)


def depth_image(encoding: str = "16UC1", *, order: str = "<", **changes: Any) -> dict[str, Any]:
    """An image of SEEN_M, whose rows are padded by a byte."""
    seen = np.nan_to_num(SEEN_M, posinf=0.0)
    values = (seen * 1000).round() if encoding == "16UC1" else np.where(seen, seen, np.nan)
    rows = values.astype(f"{order}u2" if encoding == "16UC1" else f"{order}f4")
    data = b"".join(row.tobytes() + b"!" for row in rows)
    return {
        "height": 2,
        "width": 3,
        "encoding": encoding,
        "is_bigendian": int(order == ">"),
        "step": len(data) // 2,
        "data": data,
        **changes,
    }


def read_depth(path: Path, **more: Any) -> list[Any]:
    file = TopicReadings(path=path, kind="depth", camera=LENS, **more)
    file.open()
    return list(iter(file.next, None))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_images_are_in_millimetres_or_metres(
    tmp_path: Path, encoding: str, order: str
) -> None:
    fields = depth_image(encoding, order=order)
    bag = write_bag(tmp_path / "bag.mcap", [("/it", "sensor_msgs/msg/Image", AT_S, fields)])
    (found,) = read_depth(bag)
    assert found.depth_m == pytest.approx(SEEN_M)
    assert (found.intrinsics, found.rendered, reading_fault(found)) == (LENS, False, None)


def test_what_is_too_near_to_measure_is_at_the_lens(tmp_path: Path) -> None:
    """REP 117: -inf is nearer than any distance that is measured, inf further."""
    given = np.array([[-math.inf, 2.0, math.inf], [math.nan, -1.0, 6.0]], "<f4")
    fields = depth_image("32FC1", step=12, data=given.tobytes())
    bag = write_bag(tmp_path / "bag.mcap", [("/it", "sensor_msgs/msg/Image", AT_S, fields)])
    (found,) = read_depth(bag, mount=NOSE)
    assert found.depth_m.tolist() == [[0.0, 2.0, math.inf], [math.inf, -1.0, 6.0]]
    assert reading_fault(found) is not None
    assert found.mount == NOSE


def test_a_depth_image_of_ros_1_is_read_without_the_extra(tmp_path: Path) -> None:
    image, path = depth_image(), tmp_path / "bag.mcap"
    body = struct.pack("<IIII6sII", 7, 100, 500_000_000, 6, b"camera", 2, 3)
    body += struct.pack("<I5sBII", 5, b"16UC1", 0, image["step"], len(image["data"]))
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/Image", "ros1msg", b"")
        topic = writer.register_channel("/it", "ros1", schema)
        for data in (body + image["data"], body):
            writer.add_message(topic, log_time=100_510_000_000, data=data, publish_time=0)
        writer.finish()  # type: ignore[no-untyped-call]
    file = TopicReadings(path=path, kind="depth", camera=LENS)
    file.open()
    found = file.next()
    assert isinstance(found, DepthReading)
    assert found.depth_m == pytest.approx(SEEN_M)
    assert (found.t_s, found.arrived_s) == pytest.approx((100.5, 100.51))
    with pytest.raises(SourceError, match="14 bytes too early"):
        file.next()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"encoding": "rgb8"}, "'rgb8': depth is 16UC1"),
        ({"width": 2}, "is 2x2, and the sensor of the campaign has 3x2"),
        ({"data": b"12345"}, "it has 5 bytes, in 2 rows of 7"),
        ({"step": 5, "data": b"1234567890"}, "in 2 rows of 5"),
        ({"encoding": "32FC1", "step": 12, "data": b"\xff" * 24}, "all of its distances are NaN"),
    ],
)
def test_an_image_that_is_no_depth_of_this_camera_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    fields = depth_image(**changes)
    bag = write_bag(tmp_path / "bag.mcap", [("/it", "sensor_msgs/msg/Image", AT_S, fields)])
    with pytest.raises(SourceError, match=said):
        read_depth(bag)


def test_a_scan_counts_to_the_right(tmp_path: Path) -> None:
    scan = {
        "angle_min": -0.5,
        "angle_max": 1.0,
        "angle_increment": 0.5,
        "time_increment": 0.0,
        "scan_time": 0.1,
        "range_min": 0.2,
        "range_max": 6.0,
        "ranges": [1.0, 2.0, 0.1, math.nan],
        "intensities": [],
    }
    found = one_of(tmp_path, "lidar", "sensor_msgs/msg/LaserScan", scan)
    assert isinstance(found, LidarScanReading)
    # Half a radian to the right, as ROS has it, is 0.5 here.
    at = dict(zip(found.angles_rad.round(6).tolist(), found.ranges_m.tolist(), strict=True))
    assert at == {-1.0: math.inf, -0.5: math.inf, 0.0: 2.0, 0.5: 1.0}
    assert found.mount == NOSE


def scan(*ranges_m: float) -> dict[str, Any]:
    limits = {"range_min": 0.2, "range_max": 6.0, "time_increment": 0.0, "scan_time": 0.1}
    angles = {"angle_min": 0.0, "angle_max": 1.0, "angle_increment": 0.5}
    return {**limits, **angles, "ranges": list(ranges_m), "intensities": []}


def test_a_beam_that_is_too_near_or_not_measured_is_no_free_space(tmp_path: Path) -> None:
    laser = "sensor_msgs/msg/LaserScan"
    found = one_of(tmp_path, "lidar", laser, scan(-math.inf, 1.0, math.inf))
    assert isinstance(found, LidarScanReading)
    assert found.ranges_m.tolist() == pytest.approx([math.inf, 1.0, 0.2])
    path = write_bag(tmp_path / "blind.mcap", [("/it", laser, AT_S, scan(math.nan, math.nan))])
    with pytest.raises(SourceError, match=r"none of its messages is usable.*are NaN"):
        read(path, "lidar")
    lost = [("/it", "sensor_msgs/msg/Range", AT_S, distance(math.nan))]
    (one,) = read(write_bag(tmp_path / "lost.mcap", lost), "rangefinder")
    assert reading_fault(one) is not None


def test_a_scan_whose_sender_left_out_the_angle_between_beams_is_faulty(tmp_path: Path) -> None:
    fields = {**scan(1.0, 2.0), "angle_increment": 0.0}
    found = one_of(tmp_path, "lidar", "sensor_msgs/msg/LaserScan", fields)
    fault = reading_fault(found)
    assert fault is not None
    assert fault.kind == "out_of_range"


@pytest.mark.parametrize("latitude_deg", [math.nan, 120.0])
def test_a_fix_after_one_that_is_nowhere_is_read(tmp_path: Path, latitude_deg: float) -> None:
    schema = "sensor_msgs/msg/NavSatFix"
    nowhere = {**fix(), "latitude": latitude_deg}
    bag = [("/gps", schema, AT_S + k, one) for k, one in enumerate((fix(), nowhere, fix(1e-5)))]
    sound = [
        one for one in read(write_bag(tmp_path / "bag.mcap", bag), "gps") if not reading_fault(one)
    ]
    assert [one.t_s - AT_S for one in sound] == pytest.approx([0.0, 2.0], abs=1e-6)


@pytest.mark.parametrize("order", ["<", ">"])
def test_points_are_forward_right_down(tmp_path: Path, order: str) -> None:
    given = cloud((1.0, 2.0, 3.0), (math.nan, 0.0, 0.0), (4.0, -5.0, -6.0), order=order)
    found = one_of(tmp_path, "lidar_points", "sensor_msgs/msg/PointCloud2", given)
    assert isinstance(found, LidarPointsReading)
    assert found.points_frd_m.tolist() == [[1.0, -2.0, -3.0], [4.0, 5.0, 6.0]]
    assert found.points_frd_m.dtype == np.float32


@pytest.mark.parametrize("frame", ["camera_depth_optical_frame", "front_optical"])
def test_an_optical_frame_is_right_down_forward(tmp_path: Path, frame: str) -> None:
    """What was 2 m in front of a depth camera was 2 m above it."""
    stamp = {"sec": int(AT_S), "nanosec": round(AT_S % 1.0 * 1e9)}
    header = {"header": {"stamp": stamp, "frame_id": frame}}
    points = {**cloud((0.25, 0.5, 2.0)), **header}
    found = one_of(tmp_path, "lidar_points", "sensor_msgs/msg/PointCloud2", points)
    assert found.points_frd_m.tolist() == [[2.0, 0.25, 0.5]]
    at_rest = imu(linear_acceleration=vector(0.25, -9.81, 0.5), angular_velocity=vector(1, 2, 3))
    felt = one_of(tmp_path, "imu", "sensor_msgs/msg/Imu", {**at_rest, **header})
    assert felt.specific_force_frd_m_s2 == (0.5, 0.25, -9.81)
    assert felt.rates_frd_rad_s == (3.0, 1.0, 2.0)


def test_padding_behind_the_rows_of_a_cloud_is_no_point(tmp_path: Path) -> None:
    flat = cloud((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    first, second = flat["data"][:16], flat["data"][16:]
    rows = {"height": 2, "width": 1, "row_step": 20}
    padded = {**flat, **rows, "data": [*first, *[9] * 4, *second, *[9] * 4]}
    found = one_of(tmp_path, "lidar_points", "sensor_msgs/msg/PointCloud2", padded)
    assert found.points_frd_m.tolist() == [[1.0, -2.0, -3.0], [4.0, -5.0, -6.0]]


def test_an_imu_at_rest_feels_gravity_upwards(tmp_path: Path) -> None:
    found = one_of(tmp_path, "imu", "sensor_msgs/msg/Imu", imu())
    assert isinstance(found, ImuReading)
    assert found.specific_force_frd_m_s2 == (0.5, -0.25, -9.81)
    assert found.rates_frd_rad_s == (0.1, -0.2, -0.3)


@pytest.mark.parametrize(
    ("schema", "fields", "moves"),
    [
        ("geometry_msgs/msg/PoseStamped", {"pose": PLACE}, None),
        (
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            {"pose": {"pose": PLACE, "covariance": ZEROS36}},
            None,
        ),
        (
            "nav_msgs/msg/Odometry",
            {
                "child_frame_id": "base_link",
                "pose": {"pose": PLACE, "covariance": ZEROS36},
                "twist": {
                    "twist": {"linear": vector(1.0, 0.0, 0.5), "angular": vector(0, 0, 0)},
                    "covariance": ZEROS36,
                },
            },
            (0.0, 1.0, -0.5),  # forward is east; up is not down
        ),
    ],
)
def test_a_pose_is_in_the_world(
    tmp_path: Path, schema: str, fields: dict[str, Any], moves: tuple[float, ...] | None
) -> None:
    found = one_of(tmp_path, "pose", schema, fields)
    assert isinstance(found, PoseReading)
    assert found.pose.position_ned_m == (2.0, 1.0, -3.0)
    assert euler_from_quat(found.pose.q_wxyz) == pytest.approx((0.0, 0.0, math.pi / 2))
    assert found.velocity_ned_m_s == (None if moves is None else pytest.approx(moves))


def test_a_body_that_looks_north_and_leans_back(tmp_path: Path) -> None:
    # A yaw of 90 degrees to the left from east, then 0.4 rad up with the nose: down the other way.
    lean = 0.2
    q = {
        "x": math.sin(lean) * HALF,
        "y": -math.sin(lean) * HALF,
        "z": math.cos(lean) * HALF,
        "w": math.cos(lean) * HALF,
    }
    place = {"position": vector(0.0, 0.0, 1.0), "orientation": q}
    found = one_of(tmp_path, "pose", "geometry_msgs/msg/PoseStamped", {"pose": place})
    # Of ROS a positive turn about left lowers the nose; of ours one about right lifts it.
    assert euler_from_quat(found.pose.q_wxyz) == pytest.approx((0.0, 0.4, 0.0), abs=1e-9)


def test_a_fix_moves_by_its_change_of_place(tmp_path: Path) -> None:
    schema = "sensor_msgs/msg/NavSatFix"
    bag = [("/gps", schema, AT_S + k / 5, fix(k * 1e-5, status=k)) for k in range(3)]
    first, second, third = read(write_bag(tmp_path / "bag.mcap", bag), "gps")
    assert isinstance(first, GpsReading)
    assert isinstance(second, GpsReading)
    assert isinstance(third, GpsReading)
    assert (first.latitude_deg, first.altitude_m) == (47.0, 500.0)
    assert (first.horizontal_accuracy_m, first.vertical_accuracy_m) == (0.5, 1.0)
    assert [one.fix_type for one in (first, second, third)] == [3, 4, 5]
    # A hundred thousandth of a degree of latitude is 1.112 m there, and it took 0.2 s.
    assert third.velocity_ned_m_s == pytest.approx((5.56, 0.0, 0.0), abs=0.01)


def test_useless_messages_are_skipped_and_counted(tmp_path: Path) -> None:
    schema = "sensor_msgs/msg/NavSatFix"
    fixes = (fix(status=-1), fix(known=0), fix())
    bag = [("/gps", schema, AT_S + k, one) for k, one in enumerate(fixes)]
    file = TopicReadings(path=write_bag(tmp_path / "bag.mcap", bag), kind="gps")
    file.open()
    assert file.next() is not None
    assert (file.unusable, file.next()) == (2, None)
    path = write_bag(tmp_path / "none.mcap", bag[:2])
    with pytest.raises(SourceError, match=r"none of its messages is usable.*covariance_type"):
        read(path, "gps")
    unfelt = imu(linear_acceleration_covariance=[-1.0, *ZEROS9[1:]])
    path = write_bag(tmp_path / "imu.mcap", [("/imu", "sensor_msgs/msg/Imu", AT_S, unfelt)])
    with pytest.raises(SourceError, match="it has no linear_acceleration"):
        read(path, "imu")


def test_a_topic_of_another_type_and_one_that_is_not_there_are_named(tmp_path: Path) -> None:
    bag = [
        ("/below", "sensor_msgs/msg/Range", AT_S, distance(1.0)),
        ("/above", "sensor_msgs/msg/Range", AT_S, distance(2.0)),
        ("/warm", "std_msgs/msg/Temperature", AT_S, {"temperature": 20.0}),
    ]
    path = write_bag(tmp_path / "bag.mcap", bag)
    for kind, topic, said in (
        ("rangefinder", None, "set `topic` to .* (available: /above, /below)"),
        ("imu", "/below", "has readings of type rangefinder, but the sensor is a imu"),
        ("imu", "/warm", "has no readable readings, but the sensor is a imu"),
        ("imu", "/there", "has no topic '/there' (available: /above, /below)"),
    ):
        with pytest.raises(SourceError) as caught:
            read(path, kind, topic)
        for part in said.split(" .* "):
            assert part in str(caught.value)
    (above,) = read(path, "rangefinder", "/above")
    assert isinstance(above, RangefinderReading)
    assert above.range_m == 2.0


def test_a_clock_of_another_time_delays_nothing(tmp_path: Path) -> None:
    bag = [("/it", "sensor_msgs/msg/Range", 12.5, distance(1.0))]
    (found,) = read(write_bag(tmp_path / "sim.mcap", bag, delay_s=AT_S), "rangefinder")
    assert found.t_s == found.arrived_s == 12.5
    bag = [("/it", "sensor_msgs/msg/Range", 0.0, distance(1.0))]
    (found,) = read(write_bag(tmp_path / "unset.mcap", bag, delay_s=AT_S), "rangefinder")
    assert found.t_s == pytest.approx(AT_S)


def test_without_the_extra_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / "bag.mcap", [("/it", "sensor_msgs/msg/Range", AT_S, distance(1.0))])
    imported = builtins.__import__

    def lacking(name: str, *others: Any) -> Any:
        if name.startswith("mcap_ros2"):
            raise ImportError(name)
        return imported(name, *others)

    monkeypatch.setattr(builtins, "__import__", lacking)
    with pytest.raises(SourceError, match=r"pip install 'wil-campaign\[ros\]'"):
        read(path, "rangefinder")


def test_where_a_recording_is_cut_off_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    schema = "sensor_msgs/msg/Range"
    write_bag(path, [("/it", schema, AT_S + k, distance(1.0)) for k in range(3)])
    data = path.read_bytes()
    path.write_bytes(data[:-8])
    file = TopicReadings(path=path, kind="rangefinder")
    file.open()
    assert [file.next() is not None for _ in range(3)] == [True] * 3
    with pytest.raises(SourceError, match="the recording is over; it is cut after byte"):
        file.next()
    path.write_bytes(data[:8])
    with pytest.raises(SourceError, match=r"available: none\); it is cut after byte 8"):
        read(path, "rangefinder")


def test_a_damaged_message_or_definition_is_named(tmp_path: Path) -> None:
    good = write_bag(tmp_path / "bag.mcap", [("/it", "sensor_msgs/msg/Range", AT_S, distance(1.0))])
    file = TopicReadings(path=good, kind="rangefinder")
    file.open()
    decoders, message = next(iter(file._messages()))
    for size in range(len(message.data)):
        cut = type(message)(**{**vars(message), "data": message.data[:size]})
        with pytest.raises(SourceError, match="message 0 "):
            file._reading(decoders, cut)
    for old, new in ((b"float32", b"float 32"), (b"radiation_type", b"radi*tion_type")):
        decoders, message = next(iter(file._messages()))
        for schema in decoders._schemas.values():
            schema.data = schema.data.replace(old, new)
        with pytest.raises(SourceError, match="is damaged"):
            file._reading(decoders, message)
