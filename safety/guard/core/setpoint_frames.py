"""Reads setpoints from MAVLink frames, and rewrites frames with limited setpoints; pure.

Only SET_POSITION_TARGET_LOCAL_NED (84) in MAV_FRAME_LOCAL_NED with a complete position or velocity
can be limited. Layout: message definitions of MAVLink common, in the order of the payload.
"""

import math
import struct

from wil_campaign.vehicles.autopilots.autopilot import (
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
)
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame, frame_with_payload
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint

LOCAL_NED = 84
SETPOINTS = frozenset({82, LOCAL_NED, 86})
"""SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT."""
_MAV_FRAME_LOCAL_NED = 1
_layout = struct.Struct("<I11fHBBB")


def read_setpoint(frame: MavlinkFrame, anchor: Anchor | None) -> Setpoint | None:
    """Return a frame's setpoint in the world frame; None if it cannot be limited.

    anchor: the place of the autopilot's local frame in the world; None if it is the world's frame.
    """
    if frame.message_id != LOCAL_NED or len(payload := frame.payload) > _layout.size:
        return None
    _, x, y, z, vx, vy, vz, _, _, _, yaw, yaw_rate, mask, _, _, kind = _layout.unpack(
        payload.ljust(_layout.size, b"\0")
    )
    if kind != _MAV_FRAME_LOCAL_NED or mask & IGNORE_ACCELERATION != IGNORE_ACCELERATION:
        return None
    # Fields that the type mask ignores may have any value.
    needed = 0.0 if mask & IGNORE_POSITION == IGNORE_POSITION else x + y + z
    needed += 0.0 if mask & IGNORE_VELOCITY == IGNORE_VELOCITY else vx + vy + vz
    if not math.isfinite(needed):
        return None
    heading = None if mask & IGNORE_YAW else yaw
    if mask & IGNORE_VELOCITY == IGNORE_VELOCITY and not mask & IGNORE_POSITION:
        return _in_world(PositionSetpoint((x, y, z), heading), anchor)
    if mask & IGNORE_POSITION == IGNORE_POSITION and not mask & IGNORE_VELOCITY:
        turning = None if mask & IGNORE_YAW_RATE or heading is not None else yaw_rate
        return _in_world(VelocitySetpoint((vx, vy, vz), heading, turning), anchor)
    return None


def rewritten_setpoint_frame(
    frame: MavlinkFrame, setpoint: Setpoint, anchor: Anchor | None
) -> bytes:
    """Return the setpoint frame with another position or velocity, the rest unchanged."""
    local = setpoint if anchor is None else anchor.to_local(setpoint)
    fields = list(_layout.unpack(_pad_payload(frame)))
    if isinstance(local, PositionSetpoint):
        fields[1:4] = local.position_ned_m
    else:
        fields[4:7] = local.velocity_ned_m_s
    return frame_with_payload(frame, _layout.pack(*fields))


def _pad_payload(frame: MavlinkFrame) -> bytes:
    """Return a setpoint frame's payload padded to its full size."""
    return frame.payload.ljust(_layout.size, b"\0")


def _in_world(local: Setpoint, anchor: Anchor | None) -> Setpoint:
    """Return a setpoint converted from the vehicle's local frame to the world frame."""
    # Only the limited part is converted: heading and heading rate stay unchanged.
    if anchor is None:
        return local
    if isinstance(local, PositionSetpoint):
        return PositionSetpoint(anchor.position(local.position_ned_m), local.yaw_rad)
    velocity = anchor.velocity(local.velocity_ned_m_s)
    return VelocitySetpoint(velocity, local.yaw_rad, local.yaw_rate_rad_s)
