"""Decodes readings in messages of other programs: MessagePack or JSON, SI units, FRD; pure.

docs/reading-message.md defines the message. Every value in it is checked.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from wil_campaign.plugins.readings.depth_images import check_depth_camera, metres_of_depths
from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader
from wil_campaign.vehicles.readings import (
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
    Source,
    reading_types,
)
from wil_campaign.vehicles.readings.numbers import number_fields_of_reading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3, quat_normalize

PROTOCOL = "wil/reading/1"
MAX_READING_BYTES = 4 * 2**20
"""A cloud of 300,000 points; no 3-D lidar has more in one turn."""
_MOST_BEAMS = 100_000
_MOST_SAMPLES = 65_536
_ROUNDING = 1.0 + 1e-6
_FIX_3D, _SATELLITES = 3, 12
_LEAST_WHOLE = -(2**63)


@dataclass(frozen=True, slots=True)
class ReadingEnvelope:
    """A message's fields beside its reading. sent_s: sampling, on the sender's clock."""

    sensor: str
    kind: str
    seq: int
    sent_s: float


@dataclass(frozen=True, slots=True)
class SampleStamps:
    """When a message was sampled and when it arrived, on the run clock; side: of which vehicle.

    mount: the sensor's pose in the body's FRD frame, by the campaign. camera: the model of a depth
    camera, by the campaign.
    """

    t_s: float
    arrived_s: float
    side: Source
    mount: Pose
    camera: Intrinsics | None = None

    @property
    def stamps(self) -> tuple[float, float, int, Source]:
        """Return the first fields of its reading: times, number 0, vehicle."""
        return self.t_s, self.arrived_s, 0, self.side


def read_header(data: bytes | memoryview) -> MessageHeader:
    """Return a message's map, from MessagePack or JSON. Raises BadMessageError."""
    if len(data) > MAX_READING_BYTES:
        raise BadMessageError(f"it has {len(data)} bytes, more than {MAX_READING_BYTES}")
    if bytes(data[:1]) != b"{":
        return MessageHeader.unpack(data, most_bytes=MAX_READING_BYTES)
    try:
        return MessageHeader.of(json.loads(bytes(data)))
    except (ValueError, RecursionError) as error:
        raise BadMessageError(f"it is not JSON: {error}") from error


def read_envelope(header: MessageHeader) -> ReadingEnvelope:
    """Return a message's fields beside its reading. Raises BadMessageError."""
    if header.text("protocol") != PROTOCOL:
        raise BadMessageError(f"it speaks {header.text('protocol')!r:.40}, we speak {PROTOCOL!r}")
    return ReadingEnvelope(
        header.text("sensor"), header.text("type"), header.whole("seq"), header.number("t_s")
    )


def read_reading(header: MessageHeader, kind: str, when: SampleStamps) -> Reading:
    """Return the reading in a message of a type of sensor. Raises BadMessageError."""
    reader = _READERS.get(kind)
    reading: Reading = _numbers(header, kind, when) if reader is None else reader(header, when)
    return reading


def _numbers(header: MessageHeader, kind: str, when: SampleStamps) -> Any:
    """Return a reading that is numbers alone: its fields are the message's keys."""
    reading_type: Any = reading_types()[kind]
    numbers = {
        name: header.number(name) if of is float else header.whole(name, low=_LEAST_WHOLE)
        for name, of in number_fields_of_reading(reading_type).items()
    }
    return reading_type(t_s=when.t_s, arrived_s=when.arrived_s, seq=0, source=when.side, **numbers)


def _rangefinder(header: MessageHeader, when: SampleStamps) -> RangefinderReading:
    range_m = header.number("range_m") if "range_m" in header else math.inf
    return RangefinderReading(
        *when.stamps,
        range_m=range_m,
        range_min_m=header.number("range_min_m"),
        range_max_m=_reach_m(header, "range_m", range_m),
        mount=when.mount,
    )


def _lidar(header: MessageHeader, when: SampleStamps) -> LidarScanReading:
    ranges_m = header.array("ranges_m", np.dtype("<f4"), most=_MOST_BEAMS)
    farthest_m = float(np.max(ranges_m, initial=0.0, where=np.isfinite(ranges_m)))
    return LidarScanReading(
        *when.stamps,
        ranges_m=ranges_m,
        start_angle_rad=header.number("start_angle_rad"),
        step_rad=header.number("step_rad"),
        range_min_m=header.number("range_min_m"),
        range_max_m=_reach_m(header, "ranges_m", farthest_m),
        mount=when.mount,
    )


def _reach_m(header: MessageHeader, key: str, range_m: float) -> float:
    """Return the greatest distance that a message states, which no range exceeds.

    Raises BadMessageError for one that does: it has another unit, or says that nothing came back.
    """
    reach_m = header.number("range_max_m")
    if reach_m * _ROUNDING < range_m < math.inf:
        raise BadMessageError(
            f"`{key}` has {range_m:g} m, and `range_max_m` is {reach_m:g} m: send both in one "
            "unit, and null where nothing came back"
        )
    return reach_m


def _points(header: MessageHeader, when: SampleStamps) -> LidarPointsReading:
    flat = header.array("points_frd_m", np.dtype("<f4"), most=MAX_READING_BYTES // 4)
    if len(flat) % 3:
        raise BadMessageError(f"`points_frd_m` has {len(flat)} numbers: three for each point")
    return LidarPointsReading(
        *when.stamps,
        points_frd_m=flat.reshape(-1, 3),
        mount=when.mount,
    )


def _gps(header: MessageHeader, when: SampleStamps) -> GpsReading:
    return GpsReading(
        *when.stamps,
        latitude_deg=header.number("latitude_deg"),
        longitude_deg=header.number("longitude_deg"),
        altitude_m=header.number("altitude_m"),
        velocity_ned_m_s=_vector(header, "velocity_ned_m_s"),
        horizontal_accuracy_m=header.number("horizontal_accuracy_m"),
        vertical_accuracy_m=header.number("vertical_accuracy_m"),
        fix_type=header.whole("fix_type", high=8) if "fix_type" in header else _FIX_3D,
        satellites=header.whole("satellites", high=255) if "satellites" in header else _SATELLITES,
    )


def _imu(header: MessageHeader, when: SampleStamps) -> ImuReading:
    return ImuReading(
        *when.stamps,
        specific_force_frd_m_s2=_vector(header, "specific_force_frd_m_s2"),
        rates_frd_rad_s=_vector(header, "rates_frd_rad_s"),
    )


def _pose(header: MessageHeader, when: SampleStamps) -> PoseReading:
    w, x, y, z = header.numbers("q_wxyz", 4)
    try:
        q = quat_normalize((w, x, y, z))
    except ValueError as error:
        raise BadMessageError(f"`q_wxyz`: {error}") from error
    moves = "velocity_ned_m_s" in header
    return PoseReading(
        t_s=when.t_s,
        arrived_s=when.arrived_s,
        source=when.side,
        pose=Pose(_vector(header, "position_ned_m"), q),
        velocity_ned_m_s=_vector(header, "velocity_ned_m_s") if moves else None,
    )


def _microphone(header: MessageHeader, when: SampleStamps) -> MicrophoneReading:
    return MicrophoneReading(
        *when.stamps,
        samples=header.array("samples", np.dtype("<i2"), most=_MOST_SAMPLES),
        sample_rate_hz=header.whole("sample_rate_hz", low=1000, high=192_000),
        full_scale_pa=header.number("full_scale_pa"),
    )


def _depth(header: MessageHeader, when: SampleStamps) -> DepthReading:
    camera, sent = when.camera, header.header("camera")
    if camera is None:
        raise BadMessageError("it is a depth image, and the sensor is no depth camera")
    width_px, height_px = sent.whole("width_px"), sent.whole("height_px")
    focal_px = sent.number("fx_px") if "fx_px" in sent else None
    check_depth_camera(camera, width_px=width_px, height_px=height_px, fx_px=focal_px)
    key = "depth_mm" if "depth_mm" in header else "depth_m"
    sent_as = np.dtype("<u2" if key == "depth_mm" else "<f4")
    flat = header.array(key, sent_as, most=MAX_READING_BYTES // sent_as.itemsize)
    if len(flat) != width_px * height_px:
        raise BadMessageError(f"`{key}` has {len(flat)} numbers, not {width_px}x{height_px}")
    image = flat.reshape(height_px, width_px)
    depth_m = metres_of_depths(image) if key == "depth_mm" else image
    return DepthReading(
        *when.stamps, depth_m=depth_m, intrinsics=camera, rendered=False, mount=when.mount
    )


def _vector(header: MessageHeader, key: str) -> Vec3:
    x, y, z = header.numbers(key, 3)
    return (x, y, z)


_READERS: Mapping[str, Callable[[MessageHeader, SampleStamps], Any]] = MappingProxyType(
    {
        "depth": _depth,
        "rangefinder": _rangefinder,
        "lidar": _lidar,
        "lidar_points": _points,
        "gps": _gps,
        "imu": _imu,
        "pose": _pose,
        "microphone": _microphone,
    }
)
"""The decoders of the types whose readings are more than numbers."""
