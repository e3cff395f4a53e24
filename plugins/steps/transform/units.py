"""Transform of a source's units into those used here."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from wil_campaign.plugins.steps.operations.unit_factors import (
    METRES,
    METRES_PER_SECOND,
    METRES_PER_SECOND_SQUARED,
    PASCALS,
    RADIANS,
    AccelerationUnit,
    AngleUnit,
    LengthUnit,
    PressureUnit,
    SpeedUnit,
)
from wil_campaign.recipes.model.registry import EVERY_SENSOR, SidedParameters, StepContext, step
from wil_campaign.recipes.working import AnyMasked, Masked, Operator
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
)
from wil_campaign.worlds.frames import Pose, Vec3, scale

_MEASURED = {
    "length": ("camera", "depth", "lidar", "lidar_points", "rangefinder", "gps", "pose"),
    "angle": ("lidar", "gps", "imu"),
    "speed": ("gps", "pose"),
    "acceleration": ("imu",),
    "pressure": ("microphone",),
}
"""The sensor types that have a quantity and are handled by `converted`; others are refused."""


class UnitsParameters(SidedParameters):
    """The units in which a source gives its numbers; null: those used here already.

    length: of ranges, depth, points, positions, altitude and accuracies; ours m. angle: of a
    scan's beams and of an IMU's rates, ours rad, and of latitude and longitude, ours deg. speed:
    ours m/s. acceleration: ours m/s2. pressure: of a microphone's full scale, ours Pa.
    """

    length: LengthUnit | None = None
    angle: AngleUnit | None = None
    speed: SpeedUnit | None = None
    acceleration: AccelerationUnit | None = None
    pressure: PressureUnit | None = None

    def names_none(self) -> bool:
        """Return whether no unit has to be converted."""
        return all(getattr(self, quantity) is None for quantity in _MEASURED)

    def refuses(self, kind: str) -> str:
        """Return which quantity with units a sensor of this type does not have."""
        for quantity, kinds in _MEASURED.items():
            if getattr(self, quantity) is not None and kind not in kinds:
                return f"a {kind} has no {quantity}"
        return ""


@step(
    "units",
    stage="transform",
    sensors=EVERY_SENSOR,
    parameters=UnitsParameters,
)
def units(parameters: UnitsParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert the numbers of a source into the units used here: m, rad, m/s, m/s2, Pa.

    Shapes do not change. Latitude and longitude become degrees.
    """

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        return Masked(converted_to_our_units(work.reading, parameters), work.mask)

    return operator


def converted_to_our_units(reading: Reading, given: UnitsParameters) -> Reading:
    """Return the reading converted to our units."""
    metres = METRES[given.length or "m"]
    match reading:
        case CameraReading():
            depth_m = reading.depth_m
            made = None if depth_m is None else depth_m * np.float32(metres)
            return replace(reading, depth_m=made)
        case DepthReading():
            return replace(reading, depth_m=reading.depth_m * np.float32(metres))
        case LidarScanReading():
            radians = RADIANS[given.angle or "rad"]
            return replace(
                reading,
                ranges_m=reading.ranges_m * np.float32(metres),
                range_min_m=reading.range_min_m * metres,
                range_max_m=reading.range_max_m * metres,
                start_angle_rad=reading.start_angle_rad * radians,
                step_rad=reading.step_rad * radians,
            )
        case LidarPointsReading():
            return replace(reading, points_frd_m=reading.points_frd_m * np.float32(metres))
        case RangefinderReading():
            return replace(
                reading,
                range_m=reading.range_m * metres,
                range_min_m=reading.range_min_m * metres,
                range_max_m=reading.range_max_m * metres,
            )
        case _:
            return _motion(reading, given, metres)


def _motion(reading: Any, given: UnitsParameters, metres: float) -> Reading:
    """Return a pose, fix or IMU reading with its lengths and speeds in our units."""
    speed = METRES_PER_SECOND[given.speed or "m_s"]
    match reading:
        case PoseReading():
            pose = Pose(scale(reading.pose.position_ned_m, metres), reading.pose.q_wxyz)
            velocity = reading.velocity_ned_m_s
            moving: Vec3 | None = None if velocity is None else scale(velocity, speed)
            return replace(reading, pose=pose, velocity_ned_m_s=moving)
        case GpsReading():
            degrees = math.degrees(RADIANS[given.angle or "deg"])
            return replace(
                reading,
                latitude_deg=reading.latitude_deg * degrees,
                longitude_deg=reading.longitude_deg * degrees,
                altitude_m=reading.altitude_m * metres,
                horizontal_accuracy_m=reading.horizontal_accuracy_m * metres,
                vertical_accuracy_m=reading.vertical_accuracy_m * metres,
                velocity_ned_m_s=scale(reading.velocity_ned_m_s, speed),
            )
        case ImuReading():
            force = METRES_PER_SECOND_SQUARED[given.acceleration or "m_s2"]
            return replace(
                reading,
                specific_force_frd_m_s2=scale(reading.specific_force_frd_m_s2, force),
                rates_frd_rad_s=scale(reading.rates_frd_rad_s, RADIANS[given.angle or "rad"]),
            )
        case MicrophoneReading():
            scale_pa = reading.full_scale_pa * PASCALS[given.pressure or "pa"]
            return replace(reading, full_scale_pa=scale_pa)
        case _ if given.names_none():
            unchanged: Reading = reading
            return unchanged
        case _:
            raise TypeError(f"units of a {type(reading).__name__} are unknown")
