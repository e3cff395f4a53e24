"""The ports that strangers reach: operator's socket and topics, MAVLink, captures, simulators."""

import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.fuzzing.targets import Prepared, Target
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.plugins.mocap.motion_capture import PROTOCOL, decode_frame
from wil_campaign.plugins.mqtt.message_signing import signed_message
from wil_campaign.plugins.mqtt.mqtt_commands import CommandReader, RefusedCommandError
from wil_campaign.plugins.readings.messagepack import BadMessageError, pack_header
from wil_campaign.plugins.simulator.simulator_protocol import PROTOCOL as SIMULATOR
from wil_campaign.plugins.simulator.simulator_protocol import (
    ImageRequest,
    simulated_image_of,
    welcome_of,
)
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.events import GuardedVehicle, ToVehicle
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError, parse_line
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, command_long
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget as Addressed
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import frame_checksum
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

_NOW_S = 1_763_739_600.0
_KINDS = ("abort", "hold", "resume", "geofence")


class UnauthorisedError(AssertionError):
    """A command was accepted of somebody who has no right to give one."""


def _lines(folder: Path) -> Prepared:
    del folder
    seeds = [
        json.dumps({"command": kind, "who": "eve", "token": "guess"}).encode()
        for kind in (*_KINDS, "status", "watch")
    ]

    def take(data: bytes) -> None:
        asked = parse_line(data, token="of the fuzzer")  # noqa: S106 - opens nothing
        raise UnauthorisedError(repr(asked))

    return Prepared(seeds, take)


def _topics(folder: Path) -> Prepared:
    del folder
    reader = CommandReader(
        base="wil/gate",
        token="of the fuzzer",  # noqa: S106 - opens nothing
        session="s",
        flying=lambda: ["large/wil/1"],
    )
    body = json.dumps({"session": "s", "id": "a1", "at": _NOW_S, "who": "eve"}).encode()
    seeds = [signed_message(f"wil/gate/operator/{kind}", body, b"guess") for kind in _KINDS]

    def take(data: bytes) -> None:
        for kind in _KINDS:
            asked = reader.read(kind, data, retained=False, now_s=_NOW_S)
            raise UnauthorisedError(repr(asked))

    return Prepared(seeds, take)


def _capture(folder: Path) -> Prepared:
    del folder
    body = {"name": "real", "position_m": [1.0, 2.0, -1.0], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    frame = {"protocol": PROTOCOL, "frame": "ned", "seq": 4, "t_s": 1.5, "bodies": [body]}
    return Prepared([bytes(pack_header(frame)), json.dumps(frame).encode()], decode_frame)


_IMAGE_BYTES = 8 * 6 * 3
_INTRINSICS = Intrinsics(width_px=8, height_px=6, fx_px=7.0, fy_px=7.0, cx_px=4.0, cy_px=3.0)
_ASK = ImageRequest(
    seq=1, t_s=1.0, camera_pose=Pose((0.0, 0.0, -1.0)), intrinsics=_INTRINSICS, want_depth=True
)


def _simulator(folder: Path) -> Prepared:
    del folder
    pose = {"position_ned_m": [0.0, 0.0, -1.0], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    shape = {"gate": {"kind": "box", "size_m": [1.0, 0.1, 1.0], **pose}}
    welcome = {
        "protocol": SIMULATOR, "type": "welcome", "simulator": "x", "objects": ["gate"],
        "world": "gate", "case": "large", "shapes": shape,
    }  # fmt: skip
    listed = [{"name": "image", "encoding": "bgr8"}, {"name": "depth", "encoding": "f32"}]
    picture = {
        "protocol": SIMULATOR, "type": "picture", "seq": 1, "t_s": 1.0, "parts": listed, **pose
    }  # fmt: skip
    image, depth = bytes(range(_IMAGE_BYTES)), struct.pack("<48f", *[2.0] * 48)
    taken: tuple[Callable[[bytes], object], ...] = (
        lambda data: welcome_of([data]),
        # Two ends of the bytes are its parts: what is changed in front moves neither.
        lambda data: simulated_image_of(
            [data[: -len(depth) - len(image)], data[-len(depth) - len(image) :][: len(image)],
             data[-len(depth) :]], _ASK,
        ),
    )  # fmt: skip

    def take(data: bytes) -> None:
        for number, each in enumerate(taken):
            try:
                each(data)
            except BadMessageError:
                if number:
                    raise
            else:
                return

    return Prepared(
        [bytes(pack_header(welcome)), bytes(pack_header(picture)) + image + depth], take
    )


def _mavlink_seeds(system: int) -> list[bytes]:
    """Return one frame of every message of the dialect, in a system's name."""
    codec = MavlinkCodec(system_id=system, component_id=1)
    return [codec.pack(_blank(kind)) for kind in mavlink.mavlink_map.values()]


def _blank(kind: Any) -> Any:
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    values: list[Any] = []
    for name in kind.fieldnames:
        if types[name] == "char":
            values.append(b"x")
        else:
            values.append([1] * lengths[name] if lengths[name] else 1)
    return kind(*values)


def _resealed(data: bytes) -> bytes:
    """Return MAVLink 2 bytes with the first frame's checksum made right again."""
    if len(data) < 12 or data[0] != 0xFD:
        return data
    end = 10 + data[1]
    kind = mavlink.mavlink_map.get(int.from_bytes(data[7:10], "little"))
    if kind is None or len(data) < end + 2:
        return data
    total = frame_checksum(data[1:end], bytes([kind.crc_extra]))
    return data[:end] + total.to_bytes(2, "little") + data[end + 2 :]


def _frames(folder: Path) -> Prepared:
    del folder
    codec = MavlinkCodec(system_id=245, component_id=190)

    def take(data: bytes) -> None:
        for message in codec.parse(_resealed(data)):
            message.to_dict()

    return Prepared(_mavlink_seeds(1), take)


def _guard(folder: Path) -> Prepared:
    del folder
    fence = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(-1, 6))
    makers = {"real": Px4(), "twin": ArduCopter()}

    def made() -> GuardCore:
        return GuardCore(
            vehicles={
                name: GuardedVehicle(autopilot=autopilot, target=Addressed(number), fence=fence)
                for number, (name, autopilot) in enumerate(makers.items(), 1)
            }
        )

    state: dict[str, Any] = {"core": made(), "count": 0}
    driver = MavlinkCodec(system_id=245, component_id=190)
    seeds = [
        *_mavlink_seeds(1),
        driver.pack(command_long(Addressed(1), 400, 1.0)),
        driver.pack(Px4().set_mode(Addressed(1), FlightMode.LAND)),
        driver.pack(
            Px4().velocity_setpoint(Addressed(1), t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0))
        ),
    ]

    def take(data: bytes) -> None:
        if state["count"] % 2000 == 0:
            state["core"] = made()
        state["count"] += 1
        core, t_s = state["core"], state["count"] * 0.01
        frame = _resealed(data)
        core.from_orchestrator("real", frame, t_s)
        for one in core.from_vehicle("real", frame, t_s):
            # Whoever speaks in a vehicle's name commands none.
            if isinstance(one, ToVehicle) and any(raw in frame for raw in one.frames):
                raise UnauthorisedError(repr(one))
        core.from_gcs("twin", frame, t_s)
        core.tick(t_s)

    return Prepared(seeds, take)


PORT_TARGETS: Sequence[Target] = (
    Target("operator's socket", (RefusedLineError,), _lines, takes_seeds=False),
    Target("operator's topics", (RefusedCommandError,), _topics, takes_seeds=False),
    Target("motion capture", (BadMessageError,), _capture),
    Target("simulator", (BadMessageError,), _simulator),
    Target("mavlink", (), _frames),
    Target("guard", (), _guard),
)
