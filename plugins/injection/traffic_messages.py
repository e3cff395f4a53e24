"""Encodes intruders as MAVLink messages for an autopilot; pure."""

import math
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.worlds.frames import Vec3

_VALID = (
    mavlink.ADSB_FLAGS_VALID_COORDS
    | mavlink.ADSB_FLAGS_VALID_ALTITUDE
    | mavlink.ADSB_FLAGS_VALID_HEADING
    | mavlink.ADSB_FLAGS_VALID_VELOCITY
    | mavlink.ADSB_FLAGS_VALID_CALLSIGN
    | mavlink.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
    | mavlink.ADSB_FLAGS_SIMULATED
)


@dataclass(frozen=True, slots=True)
class Intruder:
    """Another aircraft in traffic messages.

    t_s: time of the position, run clock. icao_address: 1 to 0xFFFFFF, its identity. latitude_deg,
    longitude_deg: WGS-84. altitude_amsl_m: above mean sea level, as the autopilot's own.
    """

    t_s: float
    icao_address: int
    callsign: str
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_ned_m_s: Vec3


def adsb_vehicle(intruder: Intruder, *, now_s: float) -> Any:
    """Return an intruder as ADSB_VEHICLE (246), marked as simulated traffic.

    Raises ValueError for an invalid ICAO address or position.
    """
    if not 0 < intruder.icao_address <= 0xFFFFFF:
        raise ValueError(f"ICAO address {intruder.icao_address} is not within 1 to 0xFFFFFF")
    if abs(intruder.latitude_deg) > 90.0 or abs(intruder.longitude_deg) > 180.0:
        raise ValueError(
            f"latitude {intruder.latitude_deg}, longitude {intruder.longitude_deg}: not on Earth"
        )
    north, east, down = intruder.velocity_ned_m_s
    heading_cdeg = round(math.degrees(math.atan2(east, north)) * 100.0) % 36_000
    return mavlink.MAVLink_adsb_vehicle_message(
        ICAO_address=intruder.icao_address,
        lat=round(intruder.latitude_deg * 1e7),
        lon=round(intruder.longitude_deg * 1e7),
        altitude_type=mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        altitude=round(intruder.altitude_amsl_m * 1000.0),
        heading=heading_cdeg,
        hor_velocity=min(65_535, round(math.hypot(north, east) * 100.0)),
        ver_velocity=max(-32_768, min(32_767, round(-down * 100.0))),
        callsign=intruder.callsign.encode("ascii", "replace")[:8],
        emitter_type=mavlink.ADSB_EMITTER_TYPE_UAV,
        tslc=max(0, min(255, int(now_s - intruder.t_s))),
        flags=_VALID,
        squawk=0,
    )
