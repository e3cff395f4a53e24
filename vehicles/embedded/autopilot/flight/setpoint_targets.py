"""Converts SET_POSITION_TARGET_* to local setpoints: frames and masks of MAVLink's common.xml."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.guidance import WantedMotion
from wil_campaign.vehicles.embedded.autopilot.flight.places import (
    FARTHEST_M,
    FASTEST_M_S,
    bounded_value,
)
from wil_campaign.vehicles.embedded.physics.states import BodyMotion
from wil_campaign.worlds.frames import Vec3, add, quat_from_euler, rotate
from wil_campaign.worlds.geodesy import LocalFrame

_PLACE_BITS = 0b11
_VELOCITY_BITS = 0b111 << 3
_YAW_BIT = 1 << 10
_YAW_RATE_BIT = 1 << 11

_BODY_FRAMES = {mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED}
_OFFSET_FRAMES = {*_BODY_FRAMES, mavlink.MAV_FRAME_LOCAL_OFFSET_NED}


def local_setpoint(message: Any, now: BodyMotion) -> WantedMotion | None:
    """Return the target in a SET_POSITION_TARGET_LOCAL_NED; None when it has none.

    Offsets count from the present position; body frames turn with the heading alone (ArduPilot's
    BODY_NED and BODY_OFFSET_NED).
    """
    position: Vec3 = (message.x, message.y, message.z)
    velocity: Vec3 = (message.vx, message.vy, message.vz)
    frame, yaw = message.coordinate_frame, message.yaw
    if frame in _BODY_FRAMES:
        heading = quat_from_euler(0.0, 0.0, now.euler_rad[2])
        position, velocity = rotate(heading, position), rotate(heading, velocity)
        yaw += now.euler_rad[2]
    if frame in _OFFSET_FRAMES:
        position = add(position, now.position_ned_m)
    return _wanted_motion(message, position, velocity, yaw)


def global_setpoint(message: Any, frame: LocalFrame, home_down_m: float) -> WantedMotion | None:
    """Return the target in a SET_POSITION_TARGET_GLOBAL_INT; None when it has none."""
    altitude_m = message.alt
    if message.coordinate_frame in RELATIVE_ALTITUDE_FRAMES:
        altitude_m += frame.altitude_m - home_down_m
    if message.type_mask & _PLACE_BITS:
        # Over a place that is not given a height would be far beneath the horizon.
        position = (math.nan, math.nan, frame.altitude_m - altitude_m)
    else:
        position = frame.to_ned(message.lat_int * 1e-7, message.lon_int * 1e-7, altitude_m)
    return _wanted_motion(message, position, (message.vx, message.vy, message.vz), message.yaw)


RELATIVE_ALTITUDE_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
}


def _wanted_motion(
    message: Any, position: Vec3, velocity: Vec3, yaw_rad: float
) -> WantedMotion | None:
    """Return the target of a setpoint by its type mask; None when it has none."""
    mask = message.type_mask
    axes = [
        None
        if mask >> i & 1 or not math.isfinite(position[i])
        else bounded_value(position[i], FARTHEST_M)
        for i in range(3)
    ]
    speeds = [
        0.0
        if mask >> (3 + i) & 1 or not math.isfinite(velocity[i])
        else bounded_value(velocity[i], FASTEST_M_S)
        for i in range(3)
    ]
    has_position = any(axis is not None for axis in axes)
    has_velocity = mask & _VELOCITY_BITS != _VELOCITY_BITS
    has_yaw = not mask & _YAW_BIT and math.isfinite(yaw_rad)
    has_rate = not mask & _YAW_RATE_BIT and math.isfinite(message.yaw_rate)
    if not (has_position or has_velocity):
        return None
    return WantedMotion(
        (axes[0], axes[1], axes[2]),
        (speeds[0], speeds[1], speeds[2]),
        yaw_rad if has_yaw else None,
        bounded_value(message.yaw_rate, FASTEST_M_S) if has_rate and not has_yaw else 0.0,
        has_velocity,
        has_yaw or has_rate,
    )
