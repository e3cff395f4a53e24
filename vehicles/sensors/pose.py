"""A pose sensor: motion capture, as far as a recipe mixes it; its `PoseStream` captures it."""

import math
from typing import Any, ClassVar

from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.readings.faults import ReadingFault, are_reading_numbers_finite
from wil_campaign.vehicles.readings.messages import (
    POSE_SCHEMA,
    Json,
    pose_from_json,
    pose_to_json,
    stamped_message_schema,
    vector_from_json,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions, SensorSpec, TruthRate
from wil_campaign.worlds.frames import Pose, angle_between, norm, subtract
from wil_campaign.worlds.geodesy import LocalFrame

_UNIT_SLACK = 1e-3
"""On the square of a quaternion's length: single precision over a link stays far below."""

_POSE_M = 3.0
"""Two sources of a pose differ by less: an estimate at rest drifts by a metre."""
_ASIDE_RAD = math.radians(45.0)


class PoseOptions(SensorOptions):
    """A pose sensor: motion capture. rate_hz: highest rate; by default the profile's."""

    embedded_only: ClassVar[bool] = True
    rate_hz: TruthRate | None = None


def _fault(reading: PoseReading) -> ReadingFault | None:
    """Check a pose reading; return its fault or None."""
    fault, velocity = _pose_fault(reading.pose), reading.velocity_ned_m_s
    if fault is None and velocity is not None and not are_reading_numbers_finite(velocity):
        return ReadingFault("not_finite", f"velocity {velocity} m/s")
    return fault


def _pose_fault(pose: Pose) -> ReadingFault | None:
    if not are_reading_numbers_finite((*pose.position_ned_m, *pose.q_wxyz)):
        return ReadingFault("not_finite", f"pose {pose.position_ned_m}, {pose.q_wxyz}")
    if abs(sum(part * part for part in pose.q_wxyz) - 1.0) > _UNIT_SLACK:
        return ReadingFault("out_of_range", f"quaternion {pose.q_wxyz} is not of length 1")
    return None


def _encode(reading: PoseReading) -> Encoded:
    """Return a pose reading as the fields of a foxglove.PoseInFrame."""
    velocity = reading.velocity_ned_m_s
    facts = {"velocity_ned_m_s": None if velocity is None else list(velocity)}
    return {"pose": pose_to_json(reading.pose), "wil": facts}, None


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    velocity = document["wil"]["velocity_ned_m_s"]
    return {
        "pose": pose_from_json(document["pose"]),
        "velocity_ned_m_s": None if velocity is None else vector_from_json(velocity),
    }


def _speed_m_s(reading: PoseReading) -> float | None:
    velocity = reading.velocity_ned_m_s
    return None if velocity is None else norm(velocity)


def _rest_fault(reading: PoseReading, pose: Pose, _: LocalFrame) -> str | None:
    apart_m = norm(subtract(reading.pose.position_ned_m, pose.position_ned_m))
    if apart_m > _POSE_M:
        return (
            f"its position is {apart_m:.4g} m from the vehicle's place: its unit or frame is wrong"
        )
    turned_rad = angle_between(reading.pose.q_wxyz, pose.q_wxyz)
    if turned_rad > _ASIDE_RAD:
        return f"its attitude is {math.degrees(turned_rad):.0f} degrees off: its axes are wrong"
    return None


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=stamped_message_schema("foxglove.PoseInFrame", pose=POSE_SCHEMA),
    encode=_encode,
    decode=_decode,
    compared=lambda r: (*r.pose.position_ned_m, *r.pose.q_wxyz),
    at_rest=_rest_fault,
    in_world=True,
    overlaid=True,
    quantities={"up_m": lambda r: -r.pose.position_ned_m[2], "speed_m_s": _speed_m_s},
)
POSE = SensorSpec("pose", PoseReading, PoseOptions, traits=_TRAITS)
