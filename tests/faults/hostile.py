"""What an attacker, or a broken radio, puts on a MAVLink link; all of it seeded."""

import struct
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import frame_checksum

BURST_HZ = 50.0
_FLOOD_FRAMES = 60
"""A turn; with the rate above 3,000 frames a second, thirty times what a vehicle sends."""
_FOREIGN = 77
Burst = Callable[[], list[bytes]]
"""Gives what is sent in one turn."""


def garbage(rng: np.random.Generator) -> Burst:
    """Return bytes without sense: noise, start bytes, frames cut and frames with wrong sums."""
    codec = MavlinkCodec(system_id=1, component_id=1)

    def burst() -> list[bytes]:
        noise = rng.integers(0, 256, size=int(rng.integers(1, 400)), dtype=np.uint8).tobytes()
        whole = codec.pack(_heartbeat(armed=False))
        broken = bytearray(whole)
        broken[int(rng.integers(1, len(broken)))] ^= 1 << int(rng.integers(8))
        header = struct.pack("<BBBBBBB", 0xFD, 255, 0, 0, 0, 1, 1)
        return [noise, b"\xfd" * int(rng.integers(1, 40)), bytes(broken), header, whole[:-3]]

    return burst


def foreign(rng: np.random.Generator) -> Burst:
    """Return frames of other systems and components that say what would matter of the vehicle."""
    codecs = [
        MavlinkCodec(system_id=system, component_id=component)
        for system, component in ((_FOREIGN, 1), (1, 191), (255, 190), (2, 190))
    ]

    def burst() -> list[bytes]:
        codec = codecs[int(rng.integers(len(codecs)))]
        return [codec.pack(message) for message in _lies(rng)]

    return burst


def forged(rng: np.random.Generator) -> Burst:
    """Return unsigned frames, and wrongly signed ones, in the names of the vehicles themselves."""
    codecs = [MavlinkCodec(system_id=system, component_id=1) for system in (1, 2)]

    def burst() -> list[bytes]:
        frames = [codec.pack(message) for codec in codecs for message in _lies(rng)]
        return [*frames, *(_signed_wrongly(frame, rng) for frame in frames)]

    return burst


def replayed(rng: np.random.Generator, heard: Sequence[bytes]) -> Burst:
    """Return once more what was heard before, some of it from before the takeoff."""
    kept = list(heard)

    def burst() -> list[bytes]:
        if not kept:
            return []
        return [kept[int(rng.integers(len(kept)))] for _ in range(4)]

    return burst


def flood(rng: np.random.Generator) -> Burst:
    """Return sound frames, many, of nobody in particular and of the vehicle's own system."""
    codecs = [MavlinkCodec(system_id=system, component_id=190) for system in (1, _FOREIGN, 255)]

    def burst() -> list[bytes]:
        codec = codecs[int(rng.integers(len(codecs)))]
        ping = mavlink.MAVLink_ping_message(int(rng.integers(1 << 40)), 1, 0, 0)
        text = mavlink.MAVLink_statustext_message(2, b"Mayday " * 6)
        return [b"".join(codec.pack(ping) + codec.pack(text) for _ in range(_FLOOD_FRAMES // 2))]

    return burst


def cutting() -> Burst:
    """Return commands that would stop motors in the air, as a program might send them."""
    codec = MavlinkCodec(system_id=255, component_id=190)
    disarm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
    terminate = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0)
    everyone = mavlink.MAVLink_command_long_message(0, 0, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
    located = mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 0, 21196, 0, 0, 0, 0, 0)
    return lambda: [codec.pack(one) for one in (disarm, terminate, everyone, located)]


def _lies(rng: np.random.Generator) -> Iterator[mavlink.MAVLink_message]:
    yield _heartbeat(armed=False)
    yield mavlink.MAVLink_extended_sys_state_message(0, 1)
    far_m = float(rng.uniform(5.0, 500.0))
    yield mavlink.MAVLink_local_position_ned_message(1000, far_m, far_m, -far_m, 9.0, 9.0, 9.0)
    yield mavlink.MAVLink_statustext_message(0, b"Crash: Disarming")


def _heartbeat(*, armed: bool) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(2, 12, 157 if armed else 29, 4 << 16 | 3 << 24, 3, 3)


def _signed_wrongly(frame: bytes, rng: np.random.Generator) -> bytes:
    """Return a frame with a signature that nobody's key made, and the right checksum."""
    body = bytes((frame[1], 1)) + frame[3:-2]
    extra = bytes([mavlink.mavlink_map[frame[7] | frame[8] << 8 | frame[9] << 16].crc_extra])
    late = (1 << 47).to_bytes(6, "little")
    made_up = rng.integers(0, 256, size=6, dtype=np.uint8).tobytes()
    return (
        frame[:1]
        + body
        + frame_checksum(body, extra).to_bytes(2, "little")
        + b"\0"
        + late
        + made_up
    )
