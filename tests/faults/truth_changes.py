"""How a fault alters the ground truth that a vehicle's simulator sends over MAVLink."""

import math
import struct
from collections.abc import Iterable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.alterations import JUMPS_FRAMES, Alteration
from tests.faults.relay import Change
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame, frame_with_payload
from wil_campaign.worlds.frames import Vec3

HIL_STATE: int = mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
SIM_STATE: int = mavlink.MAVLINK_MSG_ID_SIM_STATE
_M_PER_1E7_DEG = 0.0111319
"""Northwards; eastwards at 47 degrees two thirds of it."""


def truth_change(signal: str, alteration: Alteration) -> Change:
    """Return what goes on in the place of a ground truth, from the first one on."""
    first: list[MavlinkFrame] = []

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        first.append(frame)
        match alteration.kind:
            case "stop":
                return
            case "delay":
                yield abs(alteration.step_s), frame.raw
            case "freeze" if signal == "places":
                yield 0.0, _placed(frame, _place(first[0]))
            case "freeze" | "duplicate":
                yield 0.0, first[0].raw
            case "nan":
                yield 0.0, _without_attitude(frame)
            case "jump" if len(first) % (2 * JUMPS_FRAMES) >= JUMPS_FRAMES:
                yield 0.0, frame.raw
            case _:
                yield 0.0, moved(frame, alteration.offset_m)

    return change


def moved(frame: MavlinkFrame, offset_m: Vec3) -> bytes:
    """Return a ground truth from another place; its velocity and attitude stay."""
    latitude, longitude, up = _place(frame)
    north_m, east_m, down_m = offset_m
    millimetres = 1e3 if frame.message_id == HIL_STATE else 1.0
    place = (
        latitude + north_m / _M_PER_1E7_DEG,
        longitude + east_m / _M_PER_1E7_DEG / math.cos(math.radians(latitude * 1e-7)),
        up - down_m * millimetres,
    )
    return _placed(frame, place)


def _full(frame: MavlinkFrame) -> bytearray:
    size = mavlink.mavlink_map[frame.message_id].unpacker.size
    return bytearray(frame.payload.ljust(size, b"\0"))


def _place(frame: MavlinkFrame) -> Vec3:
    """Return latitude and longitude in 1e-7 degrees, and the height in the message's own unit."""
    payload = _full(frame)
    if frame.message_id == HIL_STATE:
        latitude, longitude, height = struct.unpack_from("<3i", payload, 36)
        return latitude, longitude, height
    latitude, longitude = struct.unpack_from("<2i", payload, 84)
    (height,) = struct.unpack_from("<f", payload, 60)
    return latitude, longitude, height


def _placed(frame: MavlinkFrame, place: Vec3) -> bytes:
    payload = _full(frame)
    latitude, longitude, height = place
    if frame.message_id == HIL_STATE:
        struct.pack_into("<3i", payload, 36, round(latitude), round(longitude), round(height))
    else:
        struct.pack_into("<2i", payload, 84, round(latitude), round(longitude))
        struct.pack_into("<f", payload, 60, height)
    return frame_with_payload(frame, bytes(payload))


def _without_attitude(frame: MavlinkFrame) -> bytes:
    payload = _full(frame)
    struct.pack_into("<f", payload, 8 if frame.message_id == HIL_STATE else 0, math.nan)
    return frame_with_payload(frame, bytes(payload))
