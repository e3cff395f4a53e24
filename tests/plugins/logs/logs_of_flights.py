"""Logs of one made-up flight in each format: up 3 m, 8 m north, 4 m east, and down again."""

import itertools
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.geodesy import LocalFrame

FRAME = LocalFrame(47.0, 8.0, 500.0)
CORNERS = ((0.0, 0.0), (8.0, 0.0), (8.0, 4.0))
EPOCH_S = 1_700_000_000.0
HZ = 10


def flown(begin_s: float = 1.0) -> Iterator[tuple[float, float, float, float]]:
    """Yield time, north, east and up: 2 m/s on the way, 1 m/s up and down."""
    t_s = 0.0
    places = [(0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (8.0, 0.0, 3.0), (8.0, 4.0, 3.0), (8.0, 4.0, 0.0)]
    while t_s < begin_s:
        yield (t_s, *places[0])
        t_s += 1 / HZ
    for before, after in itertools.pairwise(places):
        speed = 1.0 if before[:2] == after[:2] else 2.0
        steps = round(math.dist(before, after) / speed * HZ)
        for k in range(1, steps + 1):
            place = tuple(a + (b - a) * k / steps for a, b in zip(before, after, strict=True))
            yield t_s, place[0], place[1], place[2]
            t_s += 1 / HZ
    yield (t_s, *places[-1])


def write_tlog(path: Path, *, damage: bool = False) -> Path:
    """Write a MAVLink log of the flight, of system 7, with a ground station beside it."""
    codec, station = (
        MavlinkCodec(system_id=7, component_id=1),
        MavlinkCodec(system_id=255, component_id=190),
    )
    data = bytearray()

    def add(t_s: float, message: Any, of: MavlinkCodec = codec) -> None:
        data.extend(struct.pack(">Q", round((EPOCH_S + t_s) * 1e6)) + of.pack(message))

    def beat(t_s: float, *, armed: bool) -> None:
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (128 if armed else 0)
        kind, px4 = mavlink.MAV_TYPE_HEXAROTOR, mavlink.MAV_AUTOPILOT_PX4
        add(t_s, mavlink.MAVLink_heartbeat_message(kind, px4, mode, 0, 4, 3))

    def parameter(name: bytes, number: int, raw: float, kind: int) -> None:
        add(0.0, mavlink.MAVLink_param_value_message(name, raw, kind, 2, number))

    add(0.0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), station)
    beat(0.0, armed=False)
    version = mavlink.MAVLink_autopilot_version_message(
        0, 1 << 24 | 16 << 16 | 2 << 8 | 255, 0, 0, 0, b"abcdef12", b"\0" * 8, b"\0" * 8, 0, 0, 5
    )
    add(0.0, version)
    parameter(b"MPC_XY_CRUISE", 0, 2.5, mavlink.MAV_PARAM_TYPE_REAL32)
    (bits,) = struct.unpack("<f", struct.pack("<i", 4001))
    parameter(b"SYS_AUTOSTART", 1, bits, mavlink.MAV_PARAM_TYPE_INT32)
    for t_s, north_m, east_m, up_m in flown():
        ms = round(t_s * 1000)
        beat(t_s, armed=t_s >= 0.5)
        # The local frame begins 5 m south of the start.
        down = -(up_m - 0.2)
        add(t_s, mavlink.MAVLink_local_position_ned_message(ms, north_m + 5, east_m, down, 0, 0, 0))
        add(t_s, mavlink.MAVLink_attitude_message(ms, 0, 0, math.radians(30), 0, 0, 0))
        place = FRAME.to_geodetic((north_m, east_m, -up_m))
        degrees = (round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7))
        altitude_mm = round(place.altitude_m * 1e3)
        add(
            t_s,
            mavlink.MAVLink_global_position_int_message(
                ms, *degrees, altitude_mm, round(up_m * 1e3), 0, 0, 0, 0
            ),
        )
        sensors = (0, 0, 0, 0, 15_600, 1500, 80)
        add(t_s, mavlink.MAVLink_sys_status_message(*sensors, 0, 0, 0, 0, 0, 0))
        if damage and 3.0 < t_s < 3.05:
            data.extend(b"\xfd" * 40)
    beat(60.0, armed=False)
    path.write_bytes(data)
    return path
