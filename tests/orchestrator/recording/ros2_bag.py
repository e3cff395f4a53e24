"""A bag of ROS 2 with readings of a vehicle: the definitions as `ros2 bag record` writes them."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcap_ros2.writer import Writer

_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "sensor_msgs/NavSatStatus": "int8 STATUS_NO_FIX=-1\nint8 status\nuint16 service",
    "sensor_msgs/PointField": "uint8 FLOAT32=7\nstring name\nuint32 offset\nuint8 datatype\n"
    "uint32 count",
}
_TYPES = {
    "sensor_msgs/msg/Image": "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
    "uint32 step\nuint8[] data",
    "sensor_msgs/msg/Range": "uint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\n"
    "float32 max_range\nfloat32 range\nfloat32 variance",
    "sensor_msgs/msg/LaserScan": "float32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n"
    "float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
    "float32[] ranges\nfloat32[] intensities",
    "sensor_msgs/msg/PointCloud2": "uint32 height\nuint32 width\n"
    "sensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\n"
    "uint8[] data\nbool is_dense",
    "sensor_msgs/msg/Imu": "geometry_msgs/Quaternion orientation\n"
    "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
    "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance",
    "sensor_msgs/msg/NavSatFix": "sensor_msgs/NavSatStatus status\nfloat64 latitude\n"
    "float64 longitude\nfloat64 altitude\nfloat64[9] position_covariance\n"
    "uint8 COVARIANCE_TYPE_UNKNOWN=0\nuint8 position_covariance_type",
    "geometry_msgs/msg/PoseStamped": "geometry_msgs/Pose pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "geometry_msgs/PoseWithCovariance pose",
    "nav_msgs/msg/Odometry": "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist",
    "std_msgs/msg/Temperature": "float64 temperature",
}
Bag = Iterable[tuple[str, str, float, Mapping[str, Any]]]


def vector(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def definition(kind: str) -> str:
    """Return a type's definition with all that it is made of."""
    parts = [f"std_msgs/Header header\n{_TYPES[kind]}"]
    parts += [f"MSG: {name}\n{text}" for name, text in _PARTS.items()]
    return f"\n{'=' * 80}\n".join(parts)


def write_bag(
    path: Path, bag: Bag, *, delay_s: float = 0.01, logged_s: Sequence[float] | None = None
) -> Path:
    """Write a bag: topic, type, stamp and the other fields of each message.

    delay_s: from stamp to log time, where no log times are given.
    """
    with path.open("wb") as file:
        writer = Writer(file)
        schemas = {}
        for number, (topic, kind, t_s, fields) in enumerate(bag):
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition(kind))
            stamp = {"sec": int(t_s), "nanosec": round(t_s % 1.0 * 1e9)}
            header = {"stamp": stamp, "frame_id": "of the sensor"}
            logged_ns = round((t_s + delay_s if logged_s is None else logged_s[number]) * 1e9)
            message = {"header": header, **fields}
            writer.write_message(topic, schemas[kind], message, logged_ns, logged_ns)
        writer.finish()
    return path
