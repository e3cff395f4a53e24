"""What kind of sender a HEARTBEAT is of, read from its frame; pure.

The ids of a frame do not tell it: a companion computer's program or a router may send as system 1,
component 1, as an autopilot does.
"""

from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.names import enum_name

_TYPE_AT, _AUTOPILOT_AT = 4, 5


class HeartbeatKind(NamedTuple):
    """The MAV_TYPE and the MAV_AUTOPILOT of a heartbeat."""

    vehicle_type: int
    autopilot: int

    def __str__(self) -> str:
        """Return the kind in words."""
        kind = enum_name("MAV_TYPE", self.vehicle_type).removeprefix("MAV_TYPE_").lower()
        autopilot = enum_name("MAV_AUTOPILOT", self.autopilot).removeprefix("MAV_AUTOPILOT_")
        return f"{kind} with autopilot {autopilot.lower()}"


def heartbeat_kind(frame: MavlinkFrame) -> HeartbeatKind | None:
    """Return the kind of a frame's heartbeat; None for another message."""
    if frame.message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
        return None
    payload = frame.payload.ljust(_AUTOPILOT_AT + 1, b"\0")
    return HeartbeatKind(payload[_TYPE_AT], payload[_AUTOPILOT_AT])
