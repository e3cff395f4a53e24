"""Converts ROS 2 messages, as mcap-ros2-support decodes them, to readings; pure.

Axes by REP 103: a body's forward, left, up; of frames that end in `_optical` right, down, forward;
the world's east, north, up. Only those fields of
sensor_msgs, geometry_msgs and nav_msgs are read that all versions of ROS 2 have.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from wil_campaign.plugins.readings.depth_images import ros_depth
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.reading_message import SampleStamps
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
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.worlds.frames import (
    Pose,
    Quat,
    Vec3,
    frd_from_flu,
    ned_from_enu,
    quat_multiply,
    quat_normalize,
    rotate,
)
from wil_campaign.worlds.geodesy import LocalFrame

_HALF = math.sqrt(0.5)
_NED_OF_ENU: Quat = (0.0, _HALF, _HALF, 0.0)
_FLU_OF_FRD: Quat = (0.0, 1.0, 0.0, 0.0)
_UNKNOWN = 0
"""NavSatFix.COVARIANCE_TYPE_UNKNOWN."""
_FIX_TYPES: Mapping[int, int] = MappingProxyType({0: 3, 1: 4, 2: 5})
"""GPS_FIX_TYPE of MAVLink by NavSatStatus: a fix, with SBAS, with ground stations (RTK float)."""
_FLOATS: Mapping[int, str] = MappingProxyType({7: "f4", 8: "f8"})
"""NumPy's format by PointField.datatype."""
_OPTICAL = ("_optical", "_optical_frame")
"""Ends of frame_id (REP 103, "Suffix Frames"); drivers write the second."""


@dataclass(frozen=True, slots=True)
class Ros2Type:
    """The sensor type of a ROS 2 message (kind), and its decoder."""

    kind: str
    read: Callable[[Any, SampleStamps], Any]


def ros2_stamp_s(message: Any) -> float:
    """Return the time in a message's header, seconds; its clock is the sender's."""
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def read_ros2(schema: str, message: Any, when: SampleStamps, before: Reading | None) -> Reading:
    """Return the reading in a message of ROS 2. Raises BadMessageError.

    schema: as in "sensor_msgs/msg/Imu". before: the last faultless reading; a fix has no velocity
    of its own: it is the change of place since then, and 0 for the first.
    """
    try:
        reading: Reading = ROS2_TYPES[schema].read(message, when)
    except (ValueError, TypeError, AttributeError, IndexError, KeyError, OverflowError) as error:
        raise BadMessageError(f"is not a {schema}: {error}") from error
    if not isinstance(reading, GpsReading) or not isinstance(before, GpsReading):
        return reading
    return _add_velocity(reading, before) if reading_fault(reading) is None else reading


def _rangefinder(message: Any, when: SampleStamps) -> RangefinderReading:
    low_m, high_m = float(message.min_range), float(message.max_range)
    range_m = float(message.range)
    if range_m == -math.inf:
        range_m = low_m  # REP 117: something is nearer than that
    return RangefinderReading(
        *when.stamps,
        range_m=math.inf if range_m > high_m else range_m,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=when.mount,
    )


def _lidar(message: Any, when: SampleStamps) -> LidarScanReading:
    low_m, high_m = float(message.range_min), float(message.range_max)
    ranges_m = np.asarray(message.ranges, np.float32)
    if len(ranges_m) and np.isnan(ranges_m).all():
        raise BadMessageError("all of its ranges are NaN")
    # REP 117: something is nearer than that.
    ranges_m = np.where(np.isneginf(ranges_m), np.float32(low_m), ranges_m)
    missed = ~((ranges_m >= np.float32(low_m)) & (ranges_m <= np.float32(high_m)))
    step_rad = float(message.angle_increment)
    last_rad = float(message.angle_min) + (len(ranges_m) - 1) * step_rad
    # ROS counts beams to the left: in reverse they count to the right.
    return LidarScanReading(
        *when.stamps,
        ranges_m=np.where(missed, np.float32(np.inf), ranges_m)[::-1],
        start_angle_rad=-last_rad,
        step_rad=step_rad,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=when.mount,
    )


def _points(message: Any, when: SampleStamps) -> LidarPointsReading:
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    names = ("x", "y", "z")
    kind = np.dtype(
        {
            "names": list(names),
            "formats": [order + _FLOATS[fields[name].datatype] for name in names],
            "offsets": [fields[name].offset for name in names],
            "itemsize": message.point_step,
        }
    )
    data, row_bytes = bytes(message.data), message.width * message.point_step
    # Rows may be padded; what is behind the only one is left alone.
    step = message.row_step if message.height > 1 else row_bytes
    rows = (data[row * step : row * step + row_bytes] for row in range(message.height))
    cloud = np.frombuffer(b"".join(rows), kind, count=message.width * message.height)
    xyz_m = np.stack([cloud[name] for name in names], axis=-1).astype(np.float32)
    xyz_m = xyz_m[np.isfinite(xyz_m).all(axis=1)]
    is_optical = _is_optical(message)
    frd_m = np.roll(xyz_m, 1, axis=1) if is_optical else xyz_m * np.array((1, -1, -1), np.float32)
    return LidarPointsReading(
        *when.stamps,
        points_frd_m=frd_m,
        mount=when.mount,
    )


def _depth(message: Any, when: SampleStamps) -> DepthReading:
    if when.camera is None:
        raise BadMessageError("is an image, and the sensor is no depth camera")
    depth_m = ros_depth(message, when.camera)
    return DepthReading(
        *when.stamps,
        depth_m=depth_m,
        intrinsics=when.camera,
        rendered=False,
        mount=when.mount,
    )


def _imu(message: Any, when: SampleStamps) -> ImuReading:
    for name in ("linear_acceleration", "angular_velocity"):
        if getattr(message, f"{name}_covariance")[0] == -1.0:
            raise BadMessageError(f"it has no {name} ({name}_covariance begins with -1)")
    return ImuReading(
        *when.stamps,
        specific_force_frd_m_s2=_frd(message, message.linear_acceleration),
        rates_frd_rad_s=_frd(message, message.angular_velocity),
    )


def _is_optical(message: Any) -> bool:
    """Return whether a message's axes are those of an image: right, down, forward."""
    return str(message.header.frame_id).endswith(_OPTICAL)


def _frd(message: Any, three: Any) -> Vec3:
    """Return a vector of a message's frame, forward, right, down."""
    right, down, forward = vector = _vector(three)
    return (forward, right, down) if _is_optical(message) else frd_from_flu(vector)


def _gps(message: Any, when: SampleStamps) -> GpsReading:
    if message.status.status not in _FIX_TYPES:
        raise BadMessageError("it has no fix (its status is not 0, 1 or 2)")
    if message.position_covariance_type == _UNKNOWN:
        raise BadMessageError("it has no accuracy (position_covariance_type is 0)")
    east, north, up = (float(message.position_covariance[at]) for at in (0, 4, 8))
    return GpsReading(
        *when.stamps,
        latitude_deg=float(message.latitude),
        longitude_deg=float(message.longitude),
        altitude_m=float(message.altitude),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        horizontal_accuracy_m=math.sqrt(max(east, north)),
        vertical_accuracy_m=math.sqrt(up),
        fix_type=_FIX_TYPES[message.status.status],
        satellites=0,
    )


def _add_velocity(fix: GpsReading, before: GpsReading) -> GpsReading:
    took_s = fix.t_s - before.t_s
    if took_s <= 0.0:
        return fix
    frame = LocalFrame(before.latitude_deg, before.longitude_deg, before.altitude_m)
    north, east, down = frame.to_ned(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
    return replace(fix, velocity_ned_m_s=(north / took_s, east / took_s, down / took_s))


def _pose_stamped(message: Any, when: SampleStamps) -> PoseReading:
    return PoseReading(when.t_s, when.arrived_s, when.side, _pose_of(message.pose))


def _pose_with_covariance(message: Any, when: SampleStamps) -> PoseReading:
    return PoseReading(when.t_s, when.arrived_s, when.side, _pose_of(message.pose.pose))


def _odometry(message: Any, when: SampleStamps) -> PoseReading:
    pose = _pose_of(message.pose.pose)
    # By nav_msgs/Odometry's definition the twist is in the frame of the body.
    velocity = rotate(pose.q_wxyz, frd_from_flu(_vector(message.twist.twist.linear)))
    return PoseReading(when.t_s, when.arrived_s, when.side, pose, velocity)


def _pose_of(pose: Any) -> Pose:
    """Return a pose of a body (FLU) in the world (ENU) as one of FRD in NED."""
    q = pose.orientation
    body = quat_normalize((float(q.w), float(q.x), float(q.y), float(q.z)))
    turned = quat_multiply(quat_multiply(_NED_OF_ENU, body), _FLU_OF_FRD)
    return Pose(ned_from_enu(_vector(pose.position)), quat_normalize(turned))


def _vector(three: Any) -> Vec3:
    return (float(three.x), float(three.y), float(three.z))


ROS2_TYPES: Mapping[str, Ros2Type] = MappingProxyType(
    {
        "sensor_msgs/msg/Image": Ros2Type("depth", _depth),
        "sensor_msgs/msg/Range": Ros2Type("rangefinder", _rangefinder),
        "sensor_msgs/msg/LaserScan": Ros2Type("lidar", _lidar),
        "sensor_msgs/msg/PointCloud2": Ros2Type("lidar_points", _points),
        "sensor_msgs/msg/Imu": Ros2Type("imu", _imu),
        "sensor_msgs/msg/NavSatFix": Ros2Type("gps", _gps),
        "geometry_msgs/msg/PoseStamped": Ros2Type("pose", _pose_stamped),
        "geometry_msgs/msg/PoseWithCovarianceStamped": Ros2Type("pose", _pose_with_covariance),
        "nav_msgs/msg/Odometry": Ros2Type("pose", _odometry),
    }
)
"""The ROS 2 messages that are read, by the names of their definitions."""
