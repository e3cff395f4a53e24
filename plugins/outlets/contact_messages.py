"""Encodes contacts as MAVLink messages for a ground station; pure."""

from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Threat = Literal["none", "low", "high"]
_THREATS: dict[Threat, int] = {
    "none": mavlink.MAV_COLLISION_THREAT_LEVEL_NONE,
    "low": mavlink.MAV_COLLISION_THREAT_LEVEL_LOW,
    "high": mavlink.MAV_COLLISION_THREAT_LEVEL_HIGH,
}


def collision(
    *,
    thing_id: int,
    threat: Threat,
    time_to_closest_s: float,
    horizontal_m: float,
    vertical_m: float,
) -> Any:
    """Return a (virtual) contact or near miss as COLLISION (247), for ground stations.

    No autopilot acts on it. thing_id: the object's id, or an intruder's ICAO address.
    time_to_closest_s: 0 for contact. horizontal_m, vertical_m: separation at the closest.
    """
    return mavlink.MAVLink_collision_message(
        src=mavlink.MAV_COLLISION_SRC_ADSB,
        id=thing_id,
        action=mavlink.MAV_COLLISION_ACTION_REPORT,
        threat_level=_THREATS[threat],
        time_to_minimum_delta=time_to_closest_s,
        altitude_minimum_delta=vertical_m,
        horizontal_minimum_delta=horizontal_m,
    )
