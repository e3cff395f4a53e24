"""Which SET_POSITION_TARGET_* ArduCopter flies in GUIDED; any other stops it.

Source: ArduCopter/GCS_MAVLink_Copter.cpp, handle_message_set_position_target_local_ned and
handle_message_set_position_target_global_int (4.7).
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.places import is_on_globe
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
)

_POSITION, _VELOCITY, _ACCELERATION = 0b111, 0b111 << 3, 0b111 << 6
_FORCE = 1 << 9
_FASTEST_M_S = 1000.0
"""sane_vel_or_acc_vector."""
_LOCAL_FRAMES = {
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_BODY_OFFSET_NED,
}
_TERRAIN_FRAMES = {mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT}
GLOBAL_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT,
    *RELATIVE_ALTITUDE_FRAMES,
}


def is_flown_local_setpoint(message: Any) -> bool:
    """Return whether ArduCopter flies a SET_POSITION_TARGET_LOCAL_NED, or stops.

    Of a vector with an ignored axis the whole vector is ignored, in the message's mask too.
    """
    _ignore_incomplete(message)
    place = (message.x, message.y, message.z)
    return message.coordinate_frame in _LOCAL_FRAMES and _flies(message, place)


def is_flown_global_setpoint(message: Any) -> bool:
    """Return whether ArduCopter flies a SET_POSITION_TARGET_GLOBAL_INT, or stops.

    As `is_flown_local_setpoint`; above terrain it flies no position with a velocity.
    """
    _ignore_incomplete(message)
    frame, mask = message.coordinate_frame, message.type_mask
    if not mask & _POSITION:
        placed = is_on_globe(message.lat_int * 1e-7, message.lon_int * 1e-7)
        if not placed or frame not in GLOBAL_FRAMES:
            return False
        if frame in _TERRAIN_FRAMES and not mask & _VELOCITY:
            return False
    return _flies(message, (message.lat_int, message.lon_int, message.alt))


def _ignore_incomplete(message: Any) -> None:
    for vector in (_POSITION, _VELOCITY, _ACCELERATION):
        if message.type_mask & vector:
            message.type_mask |= vector


def _flies(message: Any, place: tuple[float, float, float]) -> bool:
    """Return whether the vectors of a setpoint are ones that ArduCopter flies.

    It flies an acceleration alone too, which is not emulated: it stops. Positions that are not
    finite, which ArduCopter does not check, stop it as well.
    """
    mask = message.type_mask
    has_place, has_velocity = not mask & _POSITION, not mask & _VELOCITY
    if not mask & _ACCELERATION and (mask & _FORCE or not has_velocity):
        return False
    speeds = (message.vx, message.vy, message.vz)
    if has_velocity and not all(abs(speed) <= _FASTEST_M_S for speed in speeds):
        return False
    if has_place and not all(map(math.isfinite, place)):
        return False
    return has_place or has_velocity
