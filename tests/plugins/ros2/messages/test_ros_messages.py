"""Messages of readings, as rosbags reads them: values, axes, and the same bytes that it writes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup, OtherSensorSetup
from wil_campaign.plugins.navigation.gps import GpsOptions
from wil_campaign.plugins.ros2.messages.reading_messages import reading_messages, sensor_transforms
from wil_campaign.plugins.ros2.messages.ros_messages import (
    CAMERA_INFO,
    CLOCK,
    COMPRESSED,
    FIX,
    IMAGE,
    IMU,
    ODOMETRY,
    POINTS,
    POSE,
    RANGE,
    SCAN,
    TF,
    FrameTransform,
    RosMessages,
)
from wil_campaign.plugins.ros2.messages.ros_types import (
    BadRosMessageError,
    dds_name,
    ros_name,
    ros_types,
)
from wil_campaign.plugins.ros2.messages.topics import sensor_topics
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
    sensor_type_of,
)
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose, quat_from_euler

TYPES = ros_types("jazzy")
MAKE = RosMessages(TYPES)
STAMP_NS = 1_700_000_000_123_456_789
LENS = Intrinsics(8, 6, 5.0, 5.5, 3.5, 2.5, (0.1, 0.0, 0.0, 0.0, 0.0))
PIXELS = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(6, 8, 3)
CAMERA = CameraReading(1.0, 1.1, 0, "mixed", PIXELS, LENS, sensor="camera")
DEPTHS = np.linspace(0.5, 4.0, 48, dtype=np.float32).reshape(6, 8)
DEPTHS[0, 0] = np.inf
RANGES = np.array([1.0, 2.0, np.inf, 4.0], np.float32)
SCANNED = LidarScanReading(1.0, 1.0, 0, "mixed", RANGES, -0.2, 0.1, 0.1, 9.0, sensor="lidar")
CLOUD = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)
READINGS: tuple[Reading, ...] = (
    CAMERA,
    DepthReading(1.0, 1.0, 0, "mixed", DEPTHS, LENS, sensor="depth"),
    SCANNED,
    LidarPointsReading(1.0, 1.0, 0, "mixed", CLOUD, sensor="lidar"),
    RangefinderReading(1.0, 1.0, 0, "mixed", 2.5, 0.1, 9.0, sensor="down"),
    GpsReading(1.0, 1.0, 0, "mixed", 47.0, 8.5, 450.0, (1.0, 0.0, 0.0), 1.5, 2.0, sensor="gps"),
    PoseReading(1.0, 1.0, "mixed", Pose((1.0, 2.0, -3.0)), sensor="mocap"),
    ImuReading(1.0, 1.0, 0, "mixed", (0.1, 0.2, -9.8), (0.01, 0.02, 0.03), sensor="imu"),
)


def read(cdr: bytes, name: str):  # type: ignore[no-untyped-def]  # a message of any type
    return TYPES.deserialize(cdr, name)


@pytest.mark.parametrize("reading", READINGS, ids=sensor_type_of)
@pytest.mark.parametrize("distribution", ["humble", "iron", "jazzy", "kilted"])
def test_every_topic_of_a_sensor_has_a_message_of_its_type(
    reading: Reading, distribution: str
) -> None:
    types = ros_types(distribution)
    made = dict(reading_messages(reading, RosMessages(types), STAMP_NS, compressed=True))
    kind = sensor_type_of(reading)
    topics = {
        sensor_topic.name: sensor_topic.type
        for sensor_topic in sensor_topics(reading.sensor, kind, compressed=True)
    }
    assert set(made) == set(topics)
    for topic, name in topics.items():
        message = types.deserialize(made[topic](), name)
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == STAMP_NS


def test_sound_has_no_topic() -> None:
    samples = np.zeros(10, np.int16)
    sound = MicrophoneReading(1.0, 1.0, 0, "mixed", samples, 8000, 1.0, sensor="ear")
    assert list(reading_messages(sound, MAKE, STAMP_NS, compressed=True)) == []
    assert sensor_topics("ear", "microphone", compressed=True) == ()


def test_an_image_has_the_bytes_that_rosbags_writes() -> None:
    message = read(MAKE.image(CAMERA, STAMP_NS, "camera_optical"), IMAGE)
    assert (message.width, message.height, message.step) == (8, 6, 24)
    assert (message.encoding, message.header.frame_id) == ("bgr8", "camera_optical")
    assert np.array_equal(message.data.reshape(6, 8, 3), PIXELS)
    assert TYPES.serialize(message, IMAGE) == MAKE.image(CAMERA, STAMP_NS, "camera_optical")


def test_an_image_that_is_a_part_of_another_is_published_whole() -> None:
    part = CameraReading(1.0, 1.0, 0, "mixed", PIXELS[::2, ::-1], LENS)
    assert np.array_equal(
        read(MAKE.image(part, 0, "c"), IMAGE).data.reshape(3, 8, 3), PIXELS[::2, ::-1]
    )


def test_a_compressed_image_is_a_jpeg() -> None:
    message = read(MAKE.compressed(CAMERA, STAMP_NS, "c"), COMPRESSED)
    assert message.format == "jpeg"
    decoded = cv2.imdecode(message.data, cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape == (6, 8, 3)


def test_depth_is_in_metres_and_infinite_where_nothing_is() -> None:
    depth = DepthReading(1.0, 1.0, 0, "mixed", DEPTHS, LENS, sensor="depth")
    message = read(MAKE.depth(depth, STAMP_NS, "d"), IMAGE)
    assert (message.encoding, message.step) == ("32FC1", 32)
    assert np.array_equal(message.data.view(np.float32).reshape(6, 8), DEPTHS)


def test_intrinsics_become_a_camera_info() -> None:
    message = read(MAKE.camera_info(LENS, STAMP_NS, "c"), CAMERA_INFO)
    assert list(message.k) == [5.0, 0.0, 3.5, 0.0, 5.5, 2.5, 0.0, 0.0, 1.0]
    assert list(message.p) == [5.0, 0, 3.5, 0, 0, 5.5, 2.5, 0, 0, 0, 1, 0]
    assert (message.distortion_model, list(message.d)) == ("plumb_bob", [0.1, 0, 0, 0, 0])


def test_beams_of_a_scan_turn_to_the_left() -> None:
    """Ours is at -0.2, -0.1, 0.0 and 0.1 rad to the right."""
    message = read(MAKE.scan(SCANNED, STAMP_NS, "lidar"), SCAN)
    assert list(message.ranges) == [4.0, np.inf, 2.0, 1.0]
    angles = message.angle_min + message.angle_increment * np.arange(4)
    assert angles == pytest.approx([-0.1, 0.0, 0.1, 0.2], abs=1e-6)
    assert message.angle_max == pytest.approx(0.2)


def test_points_are_forward_left_up() -> None:
    points = LidarPointsReading(1.0, 1.0, 0, "mixed", CLOUD)
    message = read(MAKE.points(points, STAMP_NS, "lidar"), POINTS)
    assert [(field.name, field.offset, field.datatype) for field in message.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
    ]
    assert message.data.view(np.float32).tolist() == [1.0, -2.0, -3.0, 4.0, -5.0, -6.0]
    assert (message.width, message.point_step, message.row_step) == (2, 12, 24)


def test_an_accelerometer_at_rest_feels_gravity_upwards() -> None:
    still = ImuReading(1.0, 1.0, 0, "mixed", (0.0, 0.0, -9.81), (0.1, 0.2, 0.3))
    message = read(MAKE.imu(still, STAMP_NS, "imu"), IMU)
    assert message.linear_acceleration.z == 9.81
    rates = message.angular_velocity
    assert (rates.x, rates.y, rates.z) == (0.1, -0.2, -0.3)
    assert message.orientation_covariance[0] == -1.0


def test_a_fix_has_variances_and_says_when_it_is_none() -> None:
    fix = GpsReading(1.0, 1.0, 0, "mixed", 47.0, 8.5, 450.0, (1.0, 0.0, 0.0), 1.5, 2.0)
    message = read(MAKE.fix(fix, STAMP_NS, "gps"), FIX)
    assert (message.latitude, message.longitude, message.altitude) == (47.0, 8.5, 450.0)
    assert list(message.position_covariance) == [2.25, 0, 0, 0, 2.25, 0, 0, 0, 4.0]
    for fix_type, status in ((1, -1), (2, 0), (3, 0), (4, 1), (5, 2), (6, 2)):
        other = MAKE.fix(replace(fix, fix_type=fix_type), STAMP_NS, "gps")
        assert read(other, FIX).status.status == status


def test_a_range_reading_becomes_a_message() -> None:
    found = RangefinderReading(1.0, 1.0, 0, "mixed", np.inf, 0.1, 9.0)
    message = read(MAKE.range(found, STAMP_NS, "down"), RANGE)
    assert (message.range, message.min_range) == (np.inf, pytest.approx(0.1))


def test_odometry_is_east_north_up_with_the_velocity_of_the_body() -> None:
    pose = Pose((1.0, 2.0, -3.0), quat_from_euler(0.0, 0.0, 0.0))
    message = read(MAKE.odometry(pose, (0.5, 0.1, -0.2), STAMP_NS), ODOMETRY)
    place, moves = message.pose.pose.position, message.twist.twist.linear
    assert (place.x, place.y, place.z) == (2.0, 1.0, 3.0)
    assert (moves.x, moves.y, moves.z) == pytest.approx((0.5, -0.1, 0.2))
    turned = message.pose.pose.orientation
    assert (turned.w, turned.z) == pytest.approx((0.5**0.5, 0.5**0.5))
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")


def test_clock_pose_and_transforms() -> None:
    assert read(MAKE.clock(STAMP_NS), CLOCK).clock.nanosec == 123_456_789
    assert read(MAKE.pose(Pose((1.0, 2.0, -3.0)), STAMP_NS), POSE).pose.position.x == 2.0
    one = FrameTransform("base_link", "camera_optical", (0.1, 0.2, 0.3))
    (found,) = read(MAKE.transforms([one], STAMP_NS), TF).transforms
    assert (found.header.frame_id, found.child_frame_id) == ("base_link", "camera_optical")
    assert found.transform.translation.y == 0.2


def test_frames_of_sensors_have_names_that_topics_can_have() -> None:
    camera = CameraSetup(name="front-left", rate_hz=10, intrinsics=LENS, mount=CameraMount())
    gimbal = CameraSetup(
        name="down", rate_hz=10, intrinsics=LENS, mount=CameraMount(stabilized=True)
    )
    depth = DepthSetup(name="stereo", rate_hz=10, intrinsics=LENS, mount=CameraMount())
    found = sensor_transforms(
        (camera, gimbal, depth, OtherSensorSetup(kind="gps", name="gps", options=GpsOptions()))
    )
    of_points = "stereo"
    assert [one.child for one in found] == [
        "front_left_optical",
        "stereo_optical",
        of_points,
        "gps",
    ]


def test_names_and_hashes_are_those_of_ros() -> None:
    """The hash of rclpy (kilted) for sensor_msgs/msg/Image."""
    assert TYPES.hash(IMAGE) == (
        "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
    )
    assert ros_types("humble").hash(IMAGE) == "TypeHashNotSupported"
    assert dds_name(IMAGE) == "sensor_msgs::msg::dds_::Image_"
    assert ros_name(dds_name(IMAGE)) == IMAGE
    assert ros_name("other") == "other"


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\xff" * 40])
def test_bytes_that_are_no_message(data: bytes) -> None:
    with pytest.raises(BadRosMessageError, match=r"is no nav_msgs/msg/Odometry"):
        TYPES.deserialize(data, ODOMETRY)
