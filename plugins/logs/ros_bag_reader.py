"""Reads bags of ROS 2 in MCAP: odometry, poses and fixes, and PX4's own messages."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema

from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight
from wil_campaign.plugins.logs.track_builder import TrackBuilder

_ODOMETRY, _POSE, _POSE_COV = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
_FIX, _PX4 = "sensor_msgs/msg/NavSatFix", "px4_msgs/msg/VehicleLocalPosition"
_ORDER = (_PX4, _ODOMETRY, _POSE_COV, _POSE)
"""The first of these that a bag has is its track."""
_LEAST_NORM = 1e-3


def read_ros_bag(path: Path) -> LoggedFlight:
    """Return the flight of a bag. Raises LogError."""
    try:
        from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise FlightLogError(
            f"{path} may be a bag of ROS 2, which mcap-ros2-support reads: "
            "pip install 'wil-campaign[ros]'"
        ) from error
    track = TrackBuilder()
    stream = RecordStream(path)
    try:
        schemas, channels, messages = _read_records(stream)
        topics = _topics(schemas, channels)
        first = [name for name in _ORDER if name in topics][:1]
        wanted = {topics[name][0]: name for name in (*first, _FIX) if name in topics}
        read = {number: one for number, one in channels.items() if one.topic in wanted}
        decoders = {
            number: DecoderFactory().decoder_for("cdr", schemas[one.schema_id])
            for number, one in read.items()
        }
        for message in sorted(messages, key=lambda message: message.log_time):
            if message.channel_id in read:
                ros = decoders[message.channel_id](message.data)
                kind = wanted[read[message.channel_id].topic]
                _TAKERS[kind](track, message.log_time * 1e-9, ros)
    except Exception as error:  # the decoders raise whatever a damaged file causes
        raise FlightLogError(f"{path} cannot be read as an MCAP file: {error}") from error
    if not topics:
        raise FlightLogError(_no_pose(path, schemas))
    problems = ["a bag has no parameters, firmware and arming", *track.problems]
    if stream.end is not None and not stream.end.whole:
        problems.append(f"it is {stream.end.reason}: its readable part is used")
    if track.origin is not None and _PX4 not in topics:
        problems.append("the origin's altitude is above the ellipsoid, not above mean sea level")
    others = sorted({topic for named in topics.values() for topic in named} - wanted.keys())
    if others:
        problems.append(
            f"its topics {', '.join(others)} were left out: {', '.join(wanted)} is used"
        )
    return LoggedFlight(
        kind="a bag of ROS 2",
        autopilot="px4" if _PX4 in topics else None,
        track=track.track,
        origin=track.origin,
        problems=tuple(problems),
    )


def _read_records(
    stream: RecordStream,
) -> tuple[dict[int, Schema], dict[int, Channel], list[Message]]:
    """Return a bag's schemas and channels by their numbers, and the messages that tell of a flight.

    Not by its index, which may lack some.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages: list[Message] = []
    for record in stream:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            schema = schemas.get(channels[record.channel_id].schema_id)
            if schema is not None and schema.name in _TAKERS:
                messages.append(record)
    return schemas, channels, messages


def _topics(schemas: Mapping[int, Schema], channels: Mapping[int, Channel]) -> dict[str, list[str]]:
    """Return by name of a known schema its topics."""
    found: dict[str, list[str]] = {}
    for channel in channels.values():
        schema = schemas.get(channel.schema_id)
        if schema is not None and schema.name in _TAKERS:
            found.setdefault(schema.name, []).append(channel.topic)
    return found


def _no_pose(path: Path, schemas: Mapping[int, Schema]) -> str:
    """Return in words that a file has no topic that tells of a flight."""
    names = sorted(schema.name for schema in schemas.values())
    has = f"it has {', '.join(names[:8])}" if names else "it has no schemas: was it cut off?"
    return f"{path} has no topic of {', '.join(_ORDER)}; {has}"


def _receive_px4(track: TrackBuilder, t_s: float, ros: Any) -> None:
    track.local(t_s, ros.x, ros.y, ros.z, is_valid=ros.xy_valid and ros.z_valid)
    track.yaw(t_s, ros.heading)
    if ros.xy_global and ros.z_global:
        track.set_origin(ros.ref_lat, ros.ref_lon, ros.ref_alt)


def _receive_pose(track: TrackBuilder, t_s: float, pose: Any) -> None:
    """Take a pose in ROS's frames: east, north, up; yaw counterclockwise from east."""
    place, q = pose.position, pose.orientation
    track.local(t_s, place.y, place.x, -place.z)
    if math.hypot(q.w, q.x, q.y, q.z) < _LEAST_NORM:
        return  # all zeros: nobody set it
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
    track.yaw(t_s, math.pi / 2.0 - yaw)


def _receive_fix(track: TrackBuilder, t_s: float, ros: Any) -> None:
    latitude_deg = ros.latitude if ros.status.status >= 0 else math.nan  # -1 is STATUS_NO_FIX
    track.place(t_s, latitude_deg, ros.longitude, ros.altitude)


_TAKERS: Mapping[str, Callable[[TrackBuilder, float, Any], None]] = {
    _PX4: _receive_px4,
    _ODOMETRY: lambda track, t_s, ros: _receive_pose(track, t_s, ros.pose.pose),
    _POSE_COV: lambda track, t_s, ros: _receive_pose(track, t_s, ros.pose.pose),
    _POSE: lambda track, t_s, ros: _receive_pose(track, t_s, ros.pose),
    _FIX: _receive_fix,
}
